"""Effects that can be anywhere on a beam: the same one elsewhere, and the error of its place."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from romsindy.diagnosis.evidence import Amended, Hypothesis, Solved
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.mounted import PLACE_ERRORS, MountedEffect, PlaceOnBeam
from romsindy.diagnosis.on_beam.parameters import ParameterEffect
from romsindy.effects.base import Effect, State
from romsindy.effects.mounting import AtPoint, PointMass
from romsindy.fit.kernel.linear_response import sampled
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.typing import Array

_TOLD = 1.96  # standard errors of a strength to either side


def can_be_anywhere(effect: Effect) -> bool:
    """Whether an effect acts at one point, which was not given."""
    if isinstance(effect, MountedEffect):
        usual = effect.effect.mounting
        return isinstance(usual, AtPoint) and usual.at is None
    return isinstance(effect, ParameterEffect) and effect.change is PointMass


def place_now(seen: InstrumentedBeam, effect: Effect) -> float:
    """Where an effect that can be anywhere is taken to act, m."""
    at = effect.mounting.at if isinstance(effect, MountedEffect) else effect.at  # type: ignore[attr-defined]
    return seen.beam.length if at is None else float(at)


def where(part: Part) -> str:
    """Where an effect that can be anywhere is taken to act, as its label says it."""
    effect = part.effect
    mounting = effect.mounting if isinstance(effect, MountedEffect) else AtPoint(effect.at)  # type: ignore[attr-defined]
    return str(mounting.place)


def moved_to(seen: InstrumentedBeam, part: Part, at: float, record: Record) -> Part:
    """An effect elsewhere, where it does the same to the first mode in a record.

    One at the end of the beam stays there where the beam is shorter than was said.
    """
    effect, strength = part.effect, float(part.strengths[0, 0])
    end = None if at == seen.beam.length else at
    if isinstance(effect, ParameterEffect):
        squared = (_lift(seen, effect.at) / _lift(seen, at)) ** 2
        weights = tuple(w / squared for w in effect.direction.weights)
        there = replace(effect, at=end, direction=replace(effect.direction, weights=weights))
        return replace(part, effect=there, strengths=part.strengths * squared)
    effect = cast(MountedEffect, effect)
    mounting = cast(AtPoint, effect.mounting)
    ratio = _lift(seen, at) / _lift(seen, mounting.at)
    metres = {p.name: effect.value(p.name) * ratio for p in part.parameters if p.unit == "m"}
    other = replace(effect.shaped(metres), mounting=replace(mounting, at=end))
    q, q_dot, q_ddot = (sampled(record.motion, k)[:, 0] for k in range(3))
    state = State(record.t, q, q_dot, q_ddot, record.motion.grid.step)
    here, elsewhere = effect.forces(state)[0], other.forces(state)[0]
    share = strength * float(here @ elsewhere) / float(elsewhere @ elsewhere)
    return replace(part, effect=other, strengths=np.array([[share]]))


def _lift(seen: InstrumentedBeam, at: float | None) -> float:
    """Transverse size of the first mode at a point."""
    return float(np.vdot(seen.beam.point_load((0.0, 1.0), at=at), seen.basis.shape(1)))


@dataclass(frozen=True)
class NearPlace(Amended):
    """What a fit says of its values, with the error of the place where one of its effects acts."""

    own: slice  # values of that effect
    moved: Array  # what they change by where it acts a standard error farther

    def amended(self, found: Solved) -> Solved:
        covariance = found.covariance.copy()
        covariance[self.own, self.own] += np.outer(self.moved, self.moved)
        return found._replace(covariance=covariance)


def with_error_of_place(
    seen: InstrumentedBeam, best: Hypothesis, place: PlaceOnBeam, record: Record
) -> tuple[Hypothesis, PlaceOnBeam]:
    """The same with errors of the values of its one effect that hold wherever it may act.

    Where the place is not told they are those at the place that was taken, and the place says how
    strong the effect is at its ends.
    """
    rows = zip(best.parts, best.solution.slices(), strict=True)
    part, own = next(
        (p, own) for p, own in rows if can_be_anywhere(p.effect) and np.any(p.strengths)
    )
    low, high = (moved_to(seen, part, at, record).values for at in (place.low, place.high))
    # Further apart by what the strength is unsure of at either end.
    error = float(best.covariance[own, own][0, 0]) ** 0.5
    unsure = _TOLD * error / abs(float(part.values[0]))
    ends = np.array([low[0], high[0]])
    ends += unsure * np.abs(ends) * ([-1, 1] if low[0] < high[0] else [1, -1])
    place = replace(place, strengths=(float(ends[0]), float(ends[1])))
    if not place.told:
        return best, place
    moved = (high - low) / (2 * PLACE_ERRORS)
    return replace(best, weighed=NearPlace(best.weighed, own, moved)), place
