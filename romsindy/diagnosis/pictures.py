"""The pictures of a diagnosis, each with the sentence that its own numbers write."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from romsindy.diagnosis.difference import Difference
from romsindy.diagnosis.gap import Gap, Prediction
from romsindy.diagnosis.interaction import Interaction
from romsindy.diagnosis.missing_force import (
    MissingForce,
    errors_per_cycle,
    per_cycle,
    record_errors,
)
from romsindy.diagnosis.words import pieces
from romsindy.fit.part import Part
from romsindy.fit.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.record.recording import unit_of
from romsindy.show import diagnosis_plots as show
from romsindy.show.axes import with_unit
from romsindy.show.facts import Fact
from romsindy.show.page import Picture
from romsindy.text import percent
from romsindy.typing import Array


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


def pictures_of_two(gap: Gap, found: Interaction) -> Iterator[Picture]:
    """What a simulation of one coordinate missed, and what it misses with another mode."""
    prediction = gap.predictions[gap.worst]
    yield _in_time(prediction, gap)
    yield _by_amplitude(prediction, gap)
    yield _by_cycle(prediction)
    yield _by_coordinates(found)


def _by_coordinates(found: Interaction) -> Picture:
    """What one coordinate and two leave of the record of which one leaves most."""
    left = [
        [record.whitened(e) for record, e in zip(f.records, f.residuals, strict=True)]
        for f in (found.alone, found.together)
    ]
    worst = int(np.argmax([np.mean(white**2) for white in left[0]]))
    record = found.together.records[worst]
    # Of several channels, the mean power.
    rms = [np.sqrt(np.mean(white[worst].reshape(-1, len(record.t)) ** 2, axis=0)) for white in left]
    every = np.ones(len(record.t), bool)
    t, (one, two) = per_cycle(record.t, record.tones[0].phase(record.t), every, rms)
    more = int(np.argmax(one / two))
    caption = (
        f"Of {pieces(found.together)}, all values fitted: one coordinate leaves {found.before:.3g}"
        f" times the noise, two {found.after:.3g}; they differ most at {t[more]:.3g} s, by a factor"
        f" of {one[more] / two[more]:.3g}."
    )
    names = ("one coordinate", "two coordinates")
    draw = partial(show.draw_cycles, t, one, two, [], names=names)
    return Picture("coordinates", "One coordinate and two", caption, draw)


def _in_time(p: Prediction, gap: Gap) -> Picture:
    worst = f"; drawn is {p.title}, the worst afterwards" if len(gap.predictions) > 1 else ""
    caption = (
        f"On {gap.where} the error is {gap.before:.3g} times the noise before,"
        f" {gap.after:.3g} times after{worst}."
    )
    signals = (p.record.t, p.record.signal, p.misfit(p.before), p.misfit(p.after))
    draw = partial(show.draw_errors_in_time, *signals, *_reading(p.record))
    return Picture("gap", "Before and after", caption, draw)


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
    quantity = record.decay.measured
    return quantity, unit_of(quantity, record.decay.unit)


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
    t, before, after = errors_per_cycle(p)
    worst = int(np.argmax(after))
    caption = (
        f"After, no cycle is worse than {after[worst]:.3g} times the noise (at {t[worst]:.3g} s);"
        f" before, the worst was {before.max():.3g}."
    )
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


def by(what: str, names: Sequence[str], before: Array, after: Array) -> Picture:
    """Errors over noise before and after, by record or by sensor."""
    worst = int(np.nanargmax(after))
    return Picture(
        what,
        f"By {what}",
        f"After, the worst is {names[worst]} at {after[worst]:.3g} times its noise (line: 1).",
        partial(show.draw_errors, names, before, after),
    )
