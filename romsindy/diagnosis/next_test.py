"""Which further measurement would tell apart what the data so far do not.

Every candidate test is simulated under each rival in turn, and each other rival is fitted to it
within what the data so far allow. What it cannot follow decides: half of that misfit, over the
noise, is the expected logarithm of the odds against it [1]. All is linearised about the motion of
the rival that is taken for the truth, so a test costs about as much as one step of a fit.

[1] G. Box, W. Hill, Technometrics 9 (1967), "Discrimination among mechanistic models".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from romsindy.diagnosis.evidence import Hypothesis, weights
from romsindy.diagnosis.form import FormError
from romsindy.diagnosis.found import titles
from romsindy.effects.base import Effect
from romsindy.fit.collocation import Grid, Trajectory, TrajectoryError, integrate
from romsindy.fit.gauss_newton import fit, limits, moved_parts
from romsindy.fit.linear_response import sampled
from romsindy.fit.part import ExtendedEquation, Part, columns_of, read
from romsindy.fit.process_noise import Marginal, Windows
from romsindy.fit.record import Record, scales
from romsindy.fit.verdict import EQUIVALENT, QUIET
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.smoothing import HarmonicSpline
from romsindy.typing import Array

_QUARTILE = float(norm.ppf(0.75))  # one in four comes out worse than what is promised
_MOST_ODDS = 1000.0  # more depends on what no rival knows of
_RIVALS = 4
_UNLIKELY = 0.1  # rivals that share so little of the weight may stay untold
_STEPS = 12  # a cycle: truth and rival share their error
_LEAST_CYCLES = 6
_TURN = 2 * np.pi
_LOST = 1e4  # a linearised motion that goes so many amplitudes astray says nothing
_GROWN = 1.5  # a motion that goes so far beyond its release escapes


@dataclass(frozen=True)
class Experiment:
    """A test that could be made: the largest release so far with something changed.

    Attributes
    ----------
    words : str
        What to do; "{amplitude}" stands for the amplitude of the release.
    cost : float
        In repetitions of that release.
    amplitude : float
        Of the release over the largest so far; negative for one to the other side.
    duration, noise : float
        Of the record and of its noise over those of the largest.
    repetitions : int
    wait : float
        From the end of the last record so far on, in lengths of the largest, where all records
        share one clock.
    """

    words: str
    cost: float
    amplitude: float = 1.0
    duration: float = 1.0
    noise: float = 1.0
    repetitions: int = 1
    wait: float = 1.0

    def action(self, largest: float, unit: str | None) -> str:
        """What to do, in words, where the largest release so far had this amplitude."""
        size = f"{abs(self.amplitude) * largest:.2g} {unit or ''}".rstrip()
        return self.words.format(amplitude=size)


EXPERIMENTS = (
    Experiment("the same release again", 1.0),
    Experiment("a release to the other side", 1.0, amplitude=-1.0),
    Experiment("a decay from {amplitude}", 1.0, amplitude=0.5),
    Experiment("a decay from {amplitude}", 1.0, amplitude=1.5),
    Experiment("the same release twice more", 2.0, repetitions=2),
    Experiment("a record twice as long", 2.0, duration=2.0),
    Experiment("the same release after ten times the length of a record", 2.0, wait=10.0),
    Experiment("a decay from {amplitude}", 2.0, amplitude=2.0),
    Experiment("the same release four times more", 4.0, repetitions=4),
    Experiment("the same release with a sensor of a third of the noise", 4.0, noise=1 / 3),
    Experiment("a decay from {amplitude}", 4.0, amplitude=3.0),
)


@dataclass(frozen=True)
class Advice:
    """The test to make next.

    Attributes
    ----------
    test : Experiment
    action : str
        What to do, in words.
    odds : float
        Expected of the right rival against the next, once the test is made: they come out higher
        in three of four cases, whichever is right. No more than 1000 are promised.
    rivals : tuple of str
        What it is to tell apart, the best first.
    explained : bool
        Whether they explain the data so far.
    otherwise : tuple of str
        What the effects themselves advise, for where no simulated test tells enough.
    """

    test: Experiment
    action: str
    odds: float
    rivals: tuple[str, ...]
    explained: bool
    otherwise: tuple[str, ...] = ()

    @property
    def cost(self) -> float:
        """In repetitions of the largest release so far."""
        return self.test.cost

    @property
    def enough(self) -> bool:
        """Whether the rivals are expected to be told apart."""
        return bool(2 * np.log(self.odds) >= EQUIVALENT)

    @property
    def sentence(self) -> str:
        """The advice in words, to follow "Next: "."""
        *others, last = self.rivals
        expected = f"(expected odds {float(f'{self.odds:.2g}'):g} : 1)"
        if self.explained:
            aim = f"separate {', '.join(others)} {'and' if len(others) > 1 else 'from'} {last}"
        else:
            aim = f"show whether what is missing is nearer to {', '.join(others)} or {last}"
        if self.enough:
            return f"{self.action} would {aim} {expected}."
        best = f"the best of them is {self.action} {expected}"
        beside = f"; what may: {', or '.join(self.otherwise)}" if self.otherwise else ""
        return f"no test that was simulated would {aim}; {best}{beside}."


def next_test(
    rivals: Sequence[Hypothesis],
    model: ReducedModel,
    records: Sequence[Record],
    tests: Sequence[Experiment] = EXPERIMENTS,
    *,
    explained: bool = True,
) -> Advice | None:
    """The cheapest test that would tell rivals apart; of several, that with the best expected odds.

    Where none would, the one that comes nearest; None where there is nothing to tell apart, or no
    test that the model can simulate.

    Parameters
    ----------
    rivals : sequence of Hypothesis
        Fitted to the records, the best first.
    model : ReducedModel
        The simulation as it was.
    records : sequence of Record
    tests : sequence of Experiment
        Those that can be made, with their costs.
    explained : bool
        Whether the rivals explain the records: else the odds so far mean nothing, and the test is
        to show which of them is nearest to what is missing.
    """
    rivals = rivals[:_RIVALS]
    if len(rivals) < 2:
        return None
    largest = max(range(len(records)), key=lambda i: records[i].amplitude)
    several = [_Rival.of(model, h, records, largest) for h in rivals]
    spans = scales(records).spans
    now = max(end for _, end in spans) if spans else None
    scores = np.array([h.score if explained else 0.0 for h in rivals])
    shares = weights(rivals) if explained else np.full(len(rivals), 1 / len(rivals))
    found: list[tuple[float, Experiment]] = []
    for cost in sorted({test.cost for test in tests}):
        for test in (test for test in tests if test.cost == cost):
            told = _log_odds(several, scores, records[largest], test, now)
            if told is not None:
                found.append((_sure(told, shares), test))
        if any(2 * value >= EQUIVALENT for value, _ in found):
            break
    if not found:
        return None
    value, test = max(found, key=lambda f: f[0])
    action = test.action(records[largest].amplitude, records[largest].decay.unit)
    odds = float(np.exp(min(value, np.log(_MOST_ODDS))))
    names = tuple(titles(h) for h in rivals)
    own = [p.effect.advice for h in rivals for p in h.effects]
    otherwise = tuple(dict.fromkeys(words for words in own if words != Effect.advice))
    return Advice(test, action, odds, names, explained, otherwise)


@dataclass(frozen=True)
class _Rival:
    """A hypothesis and what it says of a record that is still to be made."""

    model: ReducedModel
    parts: tuple[Part, ...]  # with the values that fit the data so far
    weaker: tuple[Part, ...]  # with the effect a quartile weaker, as these data allow
    start: Array  # state at the largest release so far
    information: Array  # of the data so far on the values
    form: FormError
    excess: float

    @classmethod
    def of(
        cls, model: ReducedModel, hypothesis: Hypothesis, records: Sequence[Record], largest: int
    ) -> _Rival:
        """The hypothesis without the values of the simulation that did not move."""
        fitted = _without_unmoved(model, hypothesis, records)
        parts = tuple(
            replace(p, strengths=p.own(largest)[None]) if p.effect.per_record else p
            for p in fitted.parts
        )
        own = columns_of(fitted.parts, largest)
        covariance = fitted.covariance[np.ix_(own, own)]
        # What differs from record to record is not known of the next one.
        known = ~_strengths(parts, [p.effect.per_record for p in parts])
        information = np.zeros_like(covariance)
        information[np.ix_(known, known)] = _inverse(covariance[np.ix_(known, known)])
        weaker = moved_parts(parts, _weakening(hypothesis, parts, covariance))
        start = fitted.solution.motions[largest].start
        return cls(model, parts, weaker, start, information, fitted.form, fitted.excess)

    def shows(
        self, test: Experiment, largest: Record, now: float | None, guess: Trajectory | None = None
    ) -> Record | None:
        """A test without noise, were this the truth; None where it has too few cycles.

        ``now`` (s) is the end of the last record on the clock that all share, if they do, and
        ``guess`` the motion of another rival.
        """
        t = largest.decay.dt * np.arange(round(test.duration * len(largest.t)))
        clock = largest.clock if now is None else now + test.wait * float(largest.t[-1])
        grid = Grid.over(t, _TURN / largest.rate, _STEPS)
        equation = ExtendedEquation(self.model, self.weaker, 0, grid.step, clock=clock)
        try:
            motion = integrate(equation, test.amplitude * self.start, grid, guess)
        except TrajectoryError as error:  # diverges, or friction holds it
            if error.motion is None:
                return None
            motion = error.motion
        x = sampled(motion, largest.derivative)
        t = t[: len(x)]
        signal = read(self.weaker, 0, t, x)[0]
        swing = np.abs(signal - np.median(signal))
        quiet = max(QUIET * swing.max(), 3 * test.noise * largest.noise.std)
        end = float(t[np.flatnonzero(swing >= quiet)[-1:]].sum())
        escaped = np.abs(motion.q).max() > _GROWN * abs(test.amplitude) * largest.amplitude
        if escaped or end * largest.rate < _TURN * _LEAST_CYCLES:
            return None
        q, q_dot, q_ddot = (sampled(motion, d)[:, 0] for d in range(3))
        decay = Decay(clock + t, q, q_dot, q_ddot, largest.decay.unit, largest.decay.measured)
        valid = np.ones(len(t), bool)
        whole = Record(decay, signal, valid, largest.noise, largest.spline, motion)
        record = whole.until(end)
        return replace(record, spline=HarmonicSpline.fit(record.t, record.signal))

    def misfit(self, record: Record, test: Experiment) -> float:
        """Chi-square that is left of a test, and of what the data so far say, at the least.

        It is infinite where no motion near that of the test is its own.
        """
        n = len(self.information)
        # What is known beforehand is in the data so far.
        parts = tuple(_without_priors(p) for p in self.parts)
        with np.errstate(all="ignore"):
            windows = Windows.of(self.model, parts, 0, record, record.motion)
        windows = replace(windows, rows=windows.rows / test.noise)
        far = np.abs(windows.rows[:, -1]).max()
        if not far < _LOST * np.abs(record.whitened(record.signal)).max() / test.noise:
            return np.inf
        several = [
            replace(windows, where=np.concatenate([np.arange(n), n + 2 * i + np.arange(2)]))
            for i in range(test.repetitions)
        ]
        # Structure is in proportion to the amplitude, and counts in proportion to the noise.
        excess = 1 + (self.excess - 1) * (test.amplitude / test.noise) ** 2
        system = Marginal.of(parts, several).equations(self.form.jump, excess)
        system.matrix[:n, :n] += self.information
        return system.chi_squared(system.bounded_step(np.zeros(n, bool), *limits(parts)))


def _without_priors(part: Part) -> Part:
    known = tuple(replace(p, spread=None) for p in part.parameters)
    return replace(part, tolerance=None, parameters=known)


def _without_unmoved(
    model: ReducedModel, hypothesis: Hypothesis, records: Sequence[Record]
) -> Hypothesis:
    """The hypothesis without what the simulation was unsure of and that did not move.

    With it a hypothesis would follow any other that moves it.
    """
    free, needed = hypothesis.parts[: hypothesis.n_free], hypothesis.moved
    kept = [p for p in free if p.tolerance is not None or p.effect.name in needed]
    if len(kept) == len(free):
        return hypothesis
    solution = fit(model, (*kept, *hypothesis.effects), records, hypothesis.solution.motions)
    again = Hypothesis.of(model, solution, len(kept), records).at(hypothesis.form)
    return again if again.misfit < hypothesis.misfit + EQUIVALENT else hypothesis


def _strengths(parts: Sequence[Part], chosen: Sequence[bool]) -> NDArray[np.bool_]:
    """Which of all values are strengths of some of the parts."""
    where: list[NDArray[np.bool_]] = [np.zeros(0, bool)]
    for i, p in enumerate(parts):
        there = i < len(chosen) and chosen[i]
        where += [np.full(p.strengths.size, there), np.zeros(len(p.shape), bool)]
    return np.concatenate(where)


def _inverse(covariance: Array) -> Array:
    scale = 1 / np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    outer = scale * scale[:, None]
    return np.linalg.pinv(covariance * outer, rcond=1e-12, hermitian=True) * outer


def _weakening(hypothesis: Hypothesis, parts: Sequence[Part], covariance: Array) -> Array:
    """Change of all values that makes the surest strength of an effect a quartile weaker."""
    values = np.concatenate([p.values for p in parts])
    std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    named = _strengths(parts, [p.effect.name in hypothesis.names for p in parts])
    i = int(np.argmax(np.where(named, np.abs(values) / std, -1.0)))
    return -_QUARTILE * np.sign(values[i]) * covariance[i] / std[i]


def _log_odds(
    rivals: Sequence[_Rival],
    scores: Array,
    largest: Record,
    test: Experiment,
    now: float | None,
) -> Array | None:
    """Logarithm of the odds for each rival against the next, were it true, (n,).

    None where it cannot be simulated.
    """
    told, motion = [], None
    for true, score in zip(rivals, scores, strict=True):
        record = true.shows(test, largest, now, motion)
        if record is None:
            return None
        motion = record.motion
        against = []
        for other, its_score in zip(rivals, scores, strict=True):
            if other is not true:
                misfit = max(other.misfit(record, test), 0.0)
                if not np.isfinite(misfit):
                    return None
                # Noise moves it by twice its root.
                misfit -= 2 * _QUARTILE * np.sqrt(misfit)
                against.append(0.5 * (misfit + its_score - score))
        told.append(min(against))
    return np.array(told)


def _sure(values: Array, share: Array) -> float:
    """Value that is reached whichever is true, but for the least likely."""
    order = np.argsort(values)
    return float(values[order][np.searchsorted(np.cumsum(share[order]), _UNLIKELY)])
