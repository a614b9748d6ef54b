"""What a simulated structure may lack, and where on it something acts.

The first mode alone does not tell where: a force elsewhere, as much larger as the point moves less,
does the same to it. Other modes are moved, damped and detuned in proportions that go with the
point. Points far from each other are tried first, on the first cycles, in which a mode that is
detuned has not lost step yet; then those about the likeliest, on more of them.

Nor does it tell a spring from a mass, or a part that is softer from all that is softer. To first
order a candidate adds its strength times what a little of it does. What is left of all sensors goes
with that or not, once all was taken off that values within tolerances do as well (a score test,
[1]).

[1] C. R. Rao, Large sample tests of statistical hypotheses concerning several parameters, Proc.
    Camb. Phil. Soc. 44 (1948), doi 10.1017/S0305004100023987.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from romsindy.diagnosis.all_sensors import orthonormal, tells
from romsindy.diagnosis.on_simulator.seen import Beginning, Failure, OnSimulator, ValueEffect
from romsindy.diagnosis.on_simulator.sensor_fit import FittedSimulator, SensorFit, known_rows
from romsindy.diagnosis.search import with_textbook_exponent
from romsindy.effects.base import Effect, Scales, TermEffect
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import scales
from romsindy.fit.verdict import EQUIVALENT, PLACE, PLACE_RISE
from romsindy.typing import Array

# Parts of what all sensors are heard of, one after the other, and how many new points in each
_LEVELS = ((0.25, 16), (0.5, 8), (1.0, 6), (1.0, 6), (1.0, 6))
_AROUND = 8  # nearest points of the likeliest, which are tried last, until none is better
_CLOSE = 0.01  # of the size: nearer to each other none is tried
_ALIKE = 0.01  # a strength that differs less is the same
_SPANS = 0.2  # of the size: along an axis on which the structure is smaller nothing is told


@dataclass(frozen=True, eq=False)
class PlaceOnStructure:
    """Where an effect acts: the likeliest point, and the box of those that may be, m."""

    point: str
    at: Array  # (3,)
    low: Array  # (3,)
    high: Array  # (3,)
    extent: Array  # (3,), of the structure
    ends: tuple[str, str]  # points at the ends of the box, along its longest edge
    # How many times as strong it would be at either end, to do the same
    strengths: tuple[float, float] = (1.0, 1.0)

    @property
    def told(self) -> bool:
        """Whether the data can tell where."""
        return bool(np.linalg.norm(self.high - self.low) < PLACE * np.linalg.norm(self.extent))

    def __str__(self) -> str:
        if not self.told:
            return "these data cannot tell at which point of the structure it acts"
        along = self.extent > _SPANS * np.linalg.norm(self.extent)
        rows = zip("xyz", self.at, self.low, self.high, along, strict=True)
        spans = [f"{n} = {x:.3g} ({a:.3g} to {b:.3g}) m" for n, x, a, b, told in rows if told]
        where = f"it acts at {self.point}, {', '.join(spans)}"
        low, high = sorted(self.strengths)
        if high - low < _ALIKE:
            return where
        return f"{where}; at the ends of that it is {low:.3g} and {high:.3g} times as strong"

    def content(self) -> dict[str, object]:
        """What JSON keeps of it."""
        box = {name: getattr(self, name).tolist() for name in ("at", "low", "high")}
        return {"point": self.point, **box, "told": self.told, "strengths": list(self.strengths)}


@dataclass(frozen=True, eq=False)
class Points:
    """Points of a structure at which something may act, ``own`` if nothing else is known."""

    points: Mapping[str, Array]
    own: str

    @cached_property
    def places(self) -> Array:
        """Of all points, (n, 3)."""
        return np.array([*self.points.values()])

    def apart(self) -> tuple[list[str], float]:
        """Points far from each other, the own one among them; how far the rest is from them.

        Where it acts nobody can choose if there are no points.
        """
        if not self.points:
            return [], 0.0
        return self.spread({self.own}, np.inf, _LEVELS[0][1])

    def nearest(self, point: str) -> list[str]:
        """Points about another one, the nearest first."""
        apart = np.linalg.norm(self.places - self.points[point], axis=1)
        names = [*self.points]
        return [names[i] for i in np.argsort(apart)[1 : 1 + _AROUND]]

    def spread(self, likely: Collection[str], reach: float, more: int) -> tuple[list[str], float]:
        """Likely points, the own one and so many ``more`` within reach, far from each other.

        As second how far the rest within reach is from them.
        """
        names, places = [*self.points], self.places
        chosen = {names.index(name) for name in (self.own, *likely)}
        near = np.flatnonzero(_distance(places, places[[names.index(n) for n in likely]]) <= reach)
        for _ in range(more):
            apart = _distance(places[near], places[[*chosen]])
            if apart.max() <= self._close:
                break
            chosen.add(int(near[np.argmax(apart)]))
        rest = float(_distance(places[near], places[[*chosen]]).max())
        return [names[i] for i in sorted(chosen)], max(rest, self._close)

    @property
    def _close(self) -> float:
        return _CLOSE * float(np.linalg.norm(np.ptp(self.places, axis=0)))


@dataclass(frozen=True, eq=False)
class PlaceSearch(Points):
    """Looks for the place of something among points, from afar to near.

    Where there are no ``points`` it is at the ``own`` one, which is tried before all others. Where
    that is ``stated`` it is kept unless another one is better beyond doubt. ``misfits`` are those
    of points on a part of the readings; ``tells`` says what a rise of it beyond the least counts
    for, as chi-square.
    """

    misfits: Callable[[Sequence[str], float], Sequence[float]]
    tells: Callable[[float, float, float], float]
    stated: bool = True
    known: dict[tuple[str, float], float] = field(default_factory=dict)

    def left(self, points: Iterable[str], share: float = 1.0) -> dict[str, float]:
        """The misfits of points; each is asked once."""
        names = [*points]
        new = [name for name in names if (name, share) not in self.known]
        if new:
            rows = zip(new, self.misfits(new, share), strict=True)
            self.known.update({(name, share): misfit for name, misfit in rows})
        return {name: self.known[name, share] for name in names}

    @cached_property
    def first(self) -> float:
        """The least misfit on the first cycles of points that are far from each other."""
        far = self.apart()[0] or [self.own]
        return min(self.left(far, _LEVELS[0][0]).values())

    def likeliest(self, most: float = np.inf) -> tuple[float, PlaceOnStructure | None]:
        """The least misfit, and its place.

        What leaves more than ``most`` of the first cycles already, wherever it is, leaves more of
        all: its place is not told.
        """
        if not self.points:
            return self.left([self.own])[self.own], None
        likely, reach = {self.own}, np.inf
        for level, (share, more) in enumerate(_LEVELS):
            chosen, reach = self.spread(likely, reach, more)
            left = self.left(chosen, share)
            least = min(left.values())
            if level and least > most and not self._alike(least, most, share):
                return least, None
            likely = {n for n, x in left.items() if self._alike(x, least, share)}
        best = min(left, key=lambda n: left[n])
        while True:
            left |= self.left(self.nearest(best))
            if left[best] <= min(left.values()):
                break
            best = min(left, key=lambda n: left[n])
        likely = {n for n, x in left.items() if self._alike(x, left[best], 1.0)}
        best = self.own if self.stated and self.own in likely else best
        return left[best], self._told(best, likely, reach)

    def _alike(self, x: float, least: float, share: float) -> bool:
        return self.tells(x - least, least, share) <= PLACE_RISE

    def _told(self, best: str, likely: Collection[str], reach: float) -> PlaceOnStructure:
        """The place, with the box of points that may be."""
        names, places = [*self.points], self.places
        extent = np.ptp(places, axis=0)
        known = np.array([self.points[n] for n in likely])
        inside = np.flatnonzero(_distance(places, known) <= reach)
        box = places[inside]
        along = box[:, int(np.argmax(np.ptp(box, axis=0)))]
        ends = names[inside[np.argmin(along)]], names[inside[np.argmax(along)]]
        spans = zip(places.T, box.min(axis=0), box.max(axis=0), strict=True)
        low, high = np.array([_beyond(*span) for span in spans]).T
        return PlaceOnStructure(best, self.points[best], low, high, extent, ends)


def _beyond(places: Array, low: float, high: float) -> tuple[float, float]:
    """Ends of an interval half-way to the next places outside: between them nothing is told."""
    below, above = places[places < low], places[places > high]
    first = (low + below.max()) / 2 if len(below) else low
    return float(first), float((high + above.min()) / 2 if len(above) else high)


def _distance(places: Array, others: Array) -> Array:
    """Of each place (n, 3) to the nearest of others (m, 3)."""
    return np.asarray(np.linalg.norm(places[:, None] - others, axis=2).min(axis=1))


# -- a linear look --------------------------------------------------------------------------------

_LITTLE = 1e-3  # of the restoring force: half as much in frequency, which does not matter
_FEW = 3  # of what may be missing: as many are fitted to all sensors
_TRIED = 6  # points at which each of these is fitted to the first cycles
_NEARER = 16  # points about the likeliest place of something, at a time


class Candidate(NamedTuple):
    """What may be missing, where it acts, and what of chi-square it explains."""

    part: Part
    there: OnSimulator
    gain: float = 0.0


@dataclass(frozen=True)
class LinearLook:
    """What is left of all sensors of all records, over the noise, and what else it may follow."""

    left: Array  # (m,), without what it follows
    basis: Array  # (m, k), orthonormal

    @classmethod
    def of(cls, left: Array, known: Array) -> LinearLook:
        """Of what is left, (m,), and what it may follow, (m, k)."""
        basis = orthonormal(known)
        return cls(left - basis @ (basis.T @ left), basis)

    @property
    def misfit(self) -> float:
        """Chi-square that is left."""
        return float(self.left @ self.left)

    def beside(self, change: Array) -> Array:
        """A change of readings without what it may follow: (m,), with that of priors, none."""
        change = np.append(change, np.zeros(len(self.left) - len(change)))
        return np.asarray(change - self.basis @ (self.basis.T @ change))

    def with_strength(self, candidate: Candidate, change: Array) -> Candidate:
        """The same with its likeliest strength: as it is it does a ``change`` of readings."""
        change = self.beside(change)
        size = float(change @ change)
        times = float(change @ self.left) / size if size else 0.0
        part = candidate.part
        part = part.moved((times - 1) * part.values * (np.arange(part.size) == 0))
        # What has a sign, or cannot be less, is kept within: that explains less.
        times = float(part.values[0] / candidate.part.values[0])
        gain = 2 * times * float(change @ self.left) - times**2 * size
        return candidate._replace(part=part, gain=gain)


def little_of(
    effects: Iterable[Effect], here: OnSimulator, scales: Scales, n_records: int
) -> list[Part]:
    """A little of each effect that the simulator can have, and of each value without a tolerance.

    They have one strength, and no other value but an exponent.
    """
    found = []
    for effect in effects:
        known = effect.parameters(scales)
        plain = {p.name for p in known} <= {"exponent"} and effect.n_strengths == 1
        if not (isinstance(effect, TermEffect) and plain):
            continue
        part = Part.of(effect, scales, n_records, [p.starts[0] for p in known])
        little = replace(part, strengths=np.array([[_strength(effect, scales)]]))
        little = with_textbook_exponent(little)  # one that is free takes the place of a strength
        if here.with_effects([little]):
            found.append(little)
    return found


def matters(part: Part, scales: Scales) -> bool:
    """Whether it does as much to the first mode as a little of it: less changes other modes alone.

    So may the mesh and the steps in time of a simulator, which no effect of a size explains.
    """
    assert isinstance(part.effect, TermEffect)  # as all of `little_of`
    return bool(abs(part.strengths[0, 0]) >= _strength(part.effect, scales))


def _strength(effect: TermEffect, scales: Scales) -> float:
    """Of a little of an effect."""
    if isinstance(effect, ValueEffect):
        return _LITTLE * effect.scale
    amplitude, omega = scales[:2]
    force = effect.term().strong(amplitude, amplitude * omega, omega**2 * amplitude)
    return _LITTLE * omega**2 * amplitude / max(abs(float(force)), 1e-300)


def best_of_each(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The likeliest place of each effect, the likeliest effect first."""
    best: dict[str, Candidate] = {}
    for c in candidates:
        name = c.part.effect.name
        if name not in best or c.gain > best[name].gain:
            best[name] = c
    return sorted(best.values(), key=lambda c: -c.gain)


@dataclass(frozen=True, eq=False)
class CandidateSearch:
    """What may be missing, by a linear look at the first cycles of records to learn from."""

    fit: SensorFit
    fitted: FittedSimulator  # to the first cycles, by values within tolerances
    look: LinearLook

    @classmethod
    def of(
        cls, fit: SensorFit, values: tuple[Part, ...], begins: Sequence[Beginning]
    ) -> CandidateSearch:
        """Beside values within tolerances, which follow the records first.

        Raises a failure of the simulator where these lead to no motion.
        """
        fitted = fit.grown(values, begins, fit.first)
        fitted = fitted._replace(now=fitted.now[: fit.n_training])
        parts, now = fitted.parts, fitted.now
        rows = fit.linear(now, parts, fit.first)
        pairs = zip(now, fit.records, strict=False)
        allowed = block_diag(*(n.allowed(fit.here, r.t) for n, r in pairs))
        starts = block_diag(*(r.by_start for r in rows))
        known = np.hstack([np.concatenate([r.by_value for r in rows]), starts, allowed])
        once, off = known_rows(parts, known.shape[1])
        gains = np.eye(known.shape[1])[-allowed.shape[1] :]
        left = np.concatenate([*(r.left for r in rows), off, np.zeros(len(gains))])
        return cls(fit, fitted, LinearLook.of(left, np.vstack([known, once, gains])))

    def promising(self, effects: Iterable[Effect]) -> list[Candidate]:
        """The few of some effects and values that tell most, the likeliest first.

        Each is looked for among points that are far from each other. The few are fitted to the
        first cycles, and settle where that leaves least: much of something does more than as many
        times what a little of it does.
        """
        here, known = self.fit.here, scales(self.fit.records)
        points = Points(here.points, here.at_point)
        far = here.at(points.apart()[0]) if here.points else [here]
        little = little_of(effects, here, known, len(self.fit.records))
        asked = [Candidate(p, t) for p in little for t in (far if here.acts([p]) else [here])]
        found = [c for c in self._told_by(asked) if matters(c.part, known)]
        few = [c.part.effect.name for c in best_of_each(found)[:_FEW]]
        several = [[c for c in found if c.part.effect.name == name] for name in few]
        best = best_of_each([self._settled(own, points) for own in several])
        least = self.look.misfit - max((c.gain for c in best), default=0.0)
        noise = max(least / len(self.look.left), 1.0)
        return [c for c in best if tells(c.gain, least, noise) > EQUIVALENT]

    def _settled(self, several: Sequence[Candidate], points: Points) -> Candidate:
        """One of the same fitted to the first cycles, where least is left, from afar to near.

        Where it was fitted it tells what the same does elsewhere.
        """
        best, *others = sorted(several, key=lambda c: -c.gain)[:_TRIED]
        fitted = [own for c in (best, *others) if (own := self._beside(c)) is not None]
        if not fitted:
            return best
        own = min(fitted, key=lambda search: search.look.misfit)
        near, reach = points.apart() if self.fit.here.acts([best.part]) else ([], 0.0)
        asked = {own.fit.here.at_point}
        while near:
            there = own._likeliest(near)
            other = own if there is own.fit.here else self._beside(best._replace(there=there))
            if other is not None and other.look.misfit < own.look.misfit:
                own = other
                continue
            asked.update(near)
            near, reach = points.spread({own.fit.here.at_point}, reach, _NEARER)
            near = [] if asked.issuperset(near) else near
        return Candidate(own.fitted.parts[-1], own.fit.here, self.look.misfit - own.look.misfit)

    def _beside(self, candidate: Candidate) -> CandidateSearch | None:
        """The same with what may be missing fitted beside it; None where that does not move."""
        fit, parts = replace(self.fit, here=candidate.there), self.fitted.parts
        try:
            return CandidateSearch.of(fit, (*parts, candidate.part), self.fitted.releases)
        except fit.here.failures:
            return None

    def _likeliest(self, points: Sequence[str]) -> OnSimulator:
        """Where its parts would leave least: at one of some points, or where they are."""
        here = self.fit.here
        others = [here, *here.at([name for name in points if name != here.at_point])]
        look, changes = self.look, self._changes([(t, self.fitted.parts) for t in others])
        left = [np.inf if x is None else sum((look.left - look.beside(x)) ** 2) for x in changes]
        return others[int(np.argmin(left))]

    def _told_by(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Candidates with their likeliest strengths, those that move at all."""
        changes = self._changes([(c.there, (*self.fitted.parts, c.part)) for c in candidates])
        rows = zip(candidates, changes, strict=True)
        return [self.look.with_strength(c, x) for c, x in rows if x is not None]

    def _changes(self, asked: Sequence[tuple[OnSimulator, tuple[Part, ...]]]) -> list[Array | None]:
        """What some parts change of the first cycles over the noise; None where these do not move.

        Then they are too strong, at a point that moves least.
        """
        now, begins = self.fitted.now, self.fitted.releases
        several = self.fit.moved([(*pair, begins) for pair in asked], self.fit.first)
        found: list[Array | None] = []
        for moved in several:
            own = [m for m in moved if not isinstance(m, Failure)]
            pairs = zip(own, now, strict=False)
            changes = [x.measured.cosines(m.readings - x.readings) for m, x in pairs]
            found.append(np.concatenate(changes) if len(own) == len(now) else None)
        return found
