"""The pictures of a diagnosis, each with the sentence that its own numbers write.

The force that the simulation lacks is its residual along the smoothed measured motion: it needs no
fit, and no simulation that keeps step with the measurement.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from romsindy.diagnosis.difference import Difference
from romsindy.diagnosis.gap import Gap, Prediction, name_of, predict
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.linear_response import nodes
from romsindy.fit.kernel.part import Part
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.records.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.record.smoothing import HarmonicSpline
from romsindy.show import compared as show
from romsindy.show.axes import Fact, with_unit
from romsindy.show.page import Picture
from romsindy.text import left_over, percent
from romsindy.typing import Array

HARMONICS = 3
_CYCLES = (2.0, 10.0)  # between knots, in short and in long records
_LEAST_NODES = 2  # in a cell of the plane of q and q_dot; one cycle leaves about three


@dataclass(frozen=True)
class MissingForce:
    """Residual force along the measured motion of one record, (n,) each.

    ``force`` is in parts of the largest restoring force, ``q`` and ``q_dot`` in parts of their
    largest; ``phase`` is that of q, in rad; ``t`` in s.
    """

    t: Array
    q: Array
    q_dot: Array
    phase: Array
    force: Array

    @classmethod
    def of(
        cls, model: ReducedModel, parts: Sequence[Part], record: Record, index: int = 0
    ) -> MissingForce:
        """Of a model with some parts, along a record: number ``index`` of those fitted."""
        t = nodes(record.motion)[0]
        # Of the displacement, whatever was measured: a velocity leads it by a quarter of a cycle.
        phase = HarmonicSpline.fit(record.t, record.decay.q).phase
        # Fewer knots and harmonics than a fit starts from: accelerations amplify noise.
        n_cycles = float(phase(record.t[-1]) - phase(0.0)) / (2 * np.pi)
        cycles = min(max(n_cycles / 10, _CYCLES[0]), _CYCLES[1])
        spline = HarmonicSpline.along(phase, record.t, record.decay.q, cycles, HARMONICS)
        q, q_dot, q_ddot = spline(t)
        equation = equation_of(model, parts, index, record)
        # What is missing on the right side: positive pushes towards positive q.
        state = (x[:, None] for x in (q, q_dot, q_ddot))
        force = equation.linearise(t, *state).residual[:, 0]
        scale = float(np.abs(q_ddot).max())
        return cls(t, q / np.abs(q).max(), q_dot / np.abs(q_dot).max(), phase(t), force / scale)

    def harmonics(self) -> Array:
        """Amplitudes (2, 4) of the loudest third on harmonics 0 to 3: with q, and with q_dot."""
        loud = self.t <= np.quantile(self.t, 1 / 3)
        phase, force = self.phase[loud], self.force[loud]
        # The phase counts from the up-crossing: q is a sine of it, q_dot a cosine.
        shift = phase - np.pi / 2
        orders = np.arange(HARMONICS + 1)[:, None]
        weight = np.where(orders == 0, 1.0, 2.0)
        inward = np.mean(weight * force * np.cos(orders * shift), axis=1)
        along = np.mean(weight * force * np.sin(orders * shift), axis=1)
        return np.stack([inward, along])

    def plane(self, rings: int = 6, sectors: int = 32) -> tuple[Array, Array, Array]:
        """Mean force over rings and sectors of the (q, q_dot) plane.

        Radii (rings + 1,), angles (sectors + 1,), force (rings, sectors); nan where there is no
        motion.
        """
        edges = (np.linspace(0, 1.001, rings + 1), np.linspace(-np.pi, np.pi, sectors + 1))
        where = (np.hypot(self.q, self.q_dot), np.arctan2(self.q_dot, self.q))
        total = np.histogram2d(*where, edges, weights=self.force)[0]
        count = np.histogram2d(*where, edges)[0]
        return *edges, np.where(count >= _LEAST_NODES, total / np.maximum(count, 1), np.nan)


def record_errors(
    model: ReducedModel, parts: Sequence[Part], records: Sequence[Record], gap: Gap
) -> tuple[list[str], Array, Array, Array]:
    """Names, and errors of every record and what was held out.

    Over the noise before and after, and after over the response. As in the table of the gap,
    "before" is the simulation as it was: only the initial state follows the record.
    """
    predictions = [predict(model, parts, r, name_of(i)) for i, r in enumerate(records)]
    names = [p.name if p.record.part is None else f"{p.name}, fitted" for p in predictions]
    if gap.unseen:
        predictions += gap.predictions
        names += [p.title for p in gap.predictions]
    told = [(p.error(p.before), p.error(p.after), p.of_response(p.after)) for p in predictions]
    before, after, part = np.transpose(told)
    return names, before, after, part


def errors_per_cycle(p: Prediction) -> tuple[Array, Array, Array]:
    """Times of the cycles of a record that are compared, and their errors before and after.

    Those over the noise (2, n), and over the response (2, n).
    """
    r = p.record
    part = np.ones(len(r.t), bool) if r.part is None else r.part
    signals = [np.where(part, x, 0.0) for x in (r.signal - p.before, r.signal - p.after, r.signal)]
    white = [r.whitened(r.signal - x) for x in (p.before, p.after)]
    times, rms = per_cycle(r.t, r.spline.phase(r.t), part, [*white, *signals])
    return times, np.array(rms[:2]), np.array(rms[2:4]) / rms[4]


def per_cycle(
    t: Array, phase: Array, taken: NDArray[np.bool_], signals: Sequence[Array]
) -> tuple[Array, list[Array]]:
    """Mean times of cycles, and the rms of signals, (n,), in the samples taken of each.

    A cycle that takes part in a few samples says little, and is left out.
    """
    cycle = np.floor(phase / (2 * np.pi)).astype(int)
    cycle -= cycle.min()
    count = np.bincount(cycle, taken)
    some = count > 0.5 * np.median(np.bincount(cycle))
    rms = [np.sqrt(np.bincount(cycle, e**2)[some] / count[some]) for e in signals]
    return np.bincount(cycle, t * taken)[some] / count[some], rms


def pictures(
    model: ReducedModel, parts: Sequence[Part], records: Sequence[Record], gap: Gap
) -> Iterator[Picture]:
    """What a simulation missed, and what it misses with the parts that were fitted to records."""
    prediction = gap.predictions[gap.worst]
    yield _in_time(prediction, gap)
    yield _by_amplitude(prediction, gap)
    before, after = (MissingForce.of(model, p, records[0]) for p in ((), parts))
    yield _by_phase(before)
    yield _by_harmonic(before.harmonics(), after.harmonics())
    yield _by_cycle(prediction)
    yield by("record", *record_errors(model, parts, records, gap))


Fitted = tuple[Sequence[Prepared], Sequence[Array]]  # records, and what a fit leaves of each


def pictures_of_two(gap: Gap, alone: Fitted, together: Fitted, words: str) -> Iterator[Picture]:
    """What a simulation of one coordinate missed, and what it misses with another mode.

    ``words`` say what fits of one coordinate and of two leave.
    """
    prediction = gap.predictions[gap.worst]
    yield _in_time(prediction, gap)
    yield _by_amplitude(prediction, gap)
    yield _by_cycle(prediction)
    yield _by_coordinates(alone, together, words)


def _by_coordinates(alone: Fitted, together: Fitted, words: str) -> Picture:
    """What one coordinate and two leave of the record of which one leaves most."""
    left = [
        [record.whitened(e) for record, e in zip(*fit, strict=True)] for fit in (alone, together)
    ]
    worst = int(np.argmax([np.mean(white**2) for white in left[0]]))
    record = together[0][worst]
    # Of several channels, the mean power.
    rms = [np.sqrt(np.mean(white[worst].reshape(-1, len(record.t)) ** 2, axis=0)) for white in left]
    every = np.ones(len(record.t), bool)
    t, (one, two) = per_cycle(record.t, record.tones[0].phase(record.t), every, rms)
    more = int(np.argmax(one / two))
    factor = one[more] / two[more]
    caption = f"{words} They differ most at {t[more]:.3g} s, by a factor of {factor:.3g}."
    names = ("one coordinate", "two coordinates")
    draw = partial(show.draw_cycles, t, one, two, [], names=names)
    return Picture("coordinates", "One coordinate and two", caption, draw)


def _in_time(p: Prediction, gap: Gap) -> Picture:
    worst = f" in {p.title}, the worst" if len(gap.predictions) > 1 else ""
    before, after = p.left(p.before), p.left(p.after)
    caption = f"On {gap.where} the error before is {before}; after, {after}{worst}."
    missed = {"before": p.misfit(p.before), "after": p.misfit(p.after)}
    channel = show.Compared(p.record.t, p.record.signal, missed, *_reading(p.record))
    return Picture("gap", "Before and after", caption, partial(show.draw_over_time, channel))


def _by_amplitude(p: Prediction, gap: Gap) -> Picture:
    signals = {"measured": p.record.signal, "before": p.before, "after": p.after}
    read = {name: p.backbone(signal) for name, signal in signals.items()}
    backbones = {name: backbone for name, backbone in read.items() if backbone is not None}
    differences = {"before": gap.differences_before, "after": gap.differences_after}
    off = "; ".join(f"{when}, {_off(d[gap.worst])}" for when, d in differences.items())
    caption = f"At equal amplitude, in {p.title}: {off}."
    draw = partial(show.draw_backbones, backbones, *_reading(p.record))
    return Picture("amplitude", "By amplitude", caption, draw)


def _off(found: Difference) -> str:
    if found.apart:
        return "hardly any cycles have an amplitude in common"
    return (
        f"the frequency is off by {percent(found.frequency)}, the damping ratio by"
        f" {percent(found.damping)} of itself"
    )


def _reading(record: Record) -> tuple[str, str]:
    """What a record holds, and its unit."""
    return record.decay.measured, record.decay.signal_unit


def _by_phase(missing: MissingForce) -> Picture:
    radius, angle, force = missing.plane()
    size, turn = np.meshgrid(*(0.5 * (e[1:] + e[:-1]) for e in (radius, angle)), indexing="ij")
    along_q = float(np.nansum(force * size * np.cos(turn)))
    along_v = float(np.nansum(force * size * np.sin(turn)))
    if abs(along_v) > abs(along_q):
        side = "against" if along_v < 0 else "with"
        text = f"it acts {side} the velocity: damping."
    else:
        side = "inward" if along_q < 0 else "outward"
        text = f"it acts {side}, with the displacement: stiffness, mass or the sensor."
    top = 100 * float(np.nanmax(np.abs(force)))
    return Picture(
        "phase",
        "By phase",
        f"Before, the missing force reaches {top:.2g} % of the largest restoring force; {text}",
        partial(show.draw_plane, radius, angle, force),
    )


def _by_harmonic(before: Array, after: Array) -> Picture:
    # Noise, which grows with the square of the harmonic, is in both alike.
    added = np.abs(before - after)
    what, size = ("force that is added", added) if added.any() else ("missing force", abs(before))
    kind, order = np.unravel_index(int(np.argmax(size)), size.shape)
    caption = (
        f"Over the loudest third the {what} is largest on harmonic {order}, in phase with the"
        f" {('displacement', 'velocity')[kind]}. What noise leaves grows with the square of the"
        " harmonic."
    )
    return Picture("harmonic", "By harmonic", caption, partial(show.draw_harmonics, before, after))


def _by_cycle(p: Prediction) -> Picture:
    t, errors, parts = errors_per_cycle(p)
    before, after = errors
    worst = np.argmax(errors, axis=1)
    was, now = (left_over(parts[i, k], errors[i, k]) for i, k in enumerate(worst))
    caption = f"After, the worst cycle leaves {now} (at {t[worst[1]]:.3g} s); before, {was}."
    draw = partial(show.draw_cycles, t, before, after, _measured_at(t, p))
    return Picture("time", "Over time", caption, draw)


def _measured_at(t: Array, p: Prediction) -> list[Fact]:
    """Amplitude and frequency that were measured about times, between the middles of cycles."""
    b = p.backbone(p.record.signal)
    if b is None:
        return []
    amplitude, hz = (np.interp(t, b.t, x, np.nan, np.nan) for x in (b.amplitude, b.frequency))
    label = with_unit("amplitude", _reading(p.record)[1])
    return [Fact(label, amplitude), Fact("frequency (Hz)", hz / (2 * np.pi))]


def by(what: str, names: Sequence[str], before: Array, after: Array, part: Array) -> Picture:
    """Errors over noise before and after, by record or by sensor; ``part`` over the response."""
    worst = int(np.nanargmax(after))
    return Picture(
        what,
        f"By {what}",
        f"After, the worst is {names[worst]}: {left_over(part[worst], after[worst])} (line: 1).",
        partial(show.draw_errors, names, before, after),
    )
