"""The pictures of a diagnosis, each with the sentence that its own numbers write."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from romsindy.diagnosis.gap import Gap, Prediction
from romsindy.diagnosis.missing_force import MissingForce, errors_per_cycle, record_errors
from romsindy.fit.part import Part
from romsindy.fit.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.show import diagnosis_plots as show
from romsindy.show.page import Picture
from romsindy.typing import Array


def pictures(
    model: ReducedModel, parts: Sequence[Part], records: Sequence[Record], gap: Gap
) -> Iterator[Picture]:
    """What a simulation missed, and what it misses with the parts that were fitted to records."""
    prediction = gap.predictions[0]
    yield _in_time(prediction, gap)
    yield _by_amplitude(prediction)
    before, after = (MissingForce.of(model, p, records[0]) for p in ((), parts))
    yield _by_phase(before)
    yield _by_harmonic(before.harmonics(), after.harmonics())
    yield _by_cycle(prediction)
    yield by("record", *record_errors(model, parts, records, gap))


def _in_time(p: Prediction, gap: Gap) -> Picture:
    what = "On what was held out" if gap.unseen else "On the records themselves"
    caption = (
        f"{what} the error goes from {gap.before:.3g} to {gap.after:.3g} times the noise; drawn"
        " is the first of them."
    )
    signals = (p.record.t, p.record.signal, p.before, p.after, p.record.decay.unit)
    return Picture("gap", "Before and after", caption, partial(show.draw_errors_in_time, *signals))


def _by_amplitude(p: Prediction) -> Picture:
    signals = {"measured": p.record.signal, "before": p.before, "after": p.after}
    read = {name: p.backbone(signal) for name, signal in signals.items()}
    backbones = {name: backbone for name, backbone in read.items() if backbone is not None}
    before, after = (p.backbone_errors(x) for x in (p.before, p.after))
    caption = (
        f"At equal amplitude the frequency is off by {100 * before[0]:.2g} % rms before,"
        f" {100 * after[0]:.2g} % after; the damping ratio by {100 * before[1]:.2g} and"
        f" {100 * after[1]:.2g} % of critical."
    )
    unit = p.record.decay.unit
    return Picture(
        "amplitude", "By amplitude", caption, partial(show.draw_backbones, backbones, unit)
    )


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
        f"The missing force reaches {top:.2g} % of the largest restoring force; {text}",
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
    return Picture("time", "Over time", caption, partial(show.draw_cycles, t, before, after))


def by(what: str, names: Sequence[str], before: Array, after: Array) -> Picture:
    """Errors over noise before and after, by record or by sensor."""
    worst = int(np.nanargmax(after))
    return Picture(
        what,
        f"By {what}",
        f"After, the worst is {names[worst]} at {after[worst]:.3g} times its noise (line: 1).",
        partial(show.draw_errors, names, before, after),
    )
