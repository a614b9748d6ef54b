"""Which further measurement would tell apart what the data so far do not.

Every candidate test is simulated under each rival in turn, and each other rival is fitted to it
within what the data so far allow. What it cannot follow decides: half of that misfit, over the
noise, is the expected logarithm of the odds against it [1]. First all is linearised about the
motion of the rival that is taken for the truth; a test that would tell is then tried by fits.

[1] G. Box, W. Hill, Technometrics 9 (1967), "Discrimination among mechanistic models".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from romsindy.diagnosis.difference import Difference, Tolerance
from romsindy.diagnosis.evidence import Hypothesis, weights
from romsindy.diagnosis.found import titles
from romsindy.diagnosis.gap import LoudAndQuiet
from romsindy.effects.base import Effect
from romsindy.fit.kernel.collocation import Grid, Trajectory, TrajectoryError, integrate
from romsindy.fit.kernel.equation import ExtendedEquation, equation_of
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.linear_response import sampled
from romsindy.fit.kernel.part import Part, columns_of, limits, moved_parts, read
from romsindy.fit.process_noise import Marginal, Windows
from romsindy.fit.records.record import Record, scales
from romsindy.fit.verdict import EQUIVALENT, QUIET
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.noise import Noise
from romsindy.record.smoothing import HarmonicSpline
from romsindy.record.spectrum import Spectrum
from romsindy.text import Shown, two_digits
from romsindy.typing import Array

QUARTILE = float(norm.ppf(0.75))  # one in four comes out worse than what is promised
_STEPS = 12  # a cycle: truth and rival share their error
_LEAST_CYCLES = 6
_LOST = 1e4  # a linearised motion that goes so many amplitudes astray says nothing
_TURN = 2 * np.pi
_GROWS = 1.25  # times as much in loud cycles as in quiet ones, or the other way
_GROWN = 1.5  # a motion that goes so far beyond its release escapes


@dataclass(frozen=True)
class Experiment:
    """A test that could be made: the largest release so far with something changed."""

    words: str  # what to do; "{amplitude}" stands for that of the release
    cost: float  # in repetitions of that release
    amplitude: float = 1.0  # over the largest so far; negative to the other side
    duration: float = 1.0  # of the record over that of the largest
    noise: float = 1.0  # over that of the largest
    repetitions: int = 1
    # From the end of the last record so far, in lengths of the largest, where all share a clock
    wait: float = 1.0

    def action(self, largest: float, unit: str | None) -> str:
        """What to do, in words, where the largest release so far had this amplitude."""
        size = f"{abs(self.amplitude) * largest:.2g} {unit or ''}".rstrip()
        return self.words.format(amplitude=size)


AGAIN = Experiment("the same release again", 1.0)
LARGER = Experiment("a decay from {amplitude}", 1.0, amplitude=1.5)
LONGER = Experiment("a record twice as long", 2.0, duration=2.0)
EXPERIMENTS = (
    AGAIN,
    Experiment("a release to the other side", 1.0, amplitude=-1.0),
    Experiment("a decay from {amplitude}", 1.0, amplitude=0.5),
    LARGER,
    Experiment("the same release twice more", 2.0, repetitions=2),
    LONGER,
    Experiment("the same release after ten times the length of a record", 2.0, wait=10.0),
    Experiment("a decay from {amplitude}", 2.0, amplitude=2.0),
    Experiment("the same release four times more", 4.0, repetitions=4),
    Experiment("the same release with a sensor of a third of the noise", 4.0, noise=1 / 3),
    Experiment("a decay from {amplitude}", 4.0, amplitude=3.0),
)


class Test(Protocol):
    """What could be done next."""

    @property
    def cost(self) -> float:
        """In repetitions of the largest release so far."""


@dataclass(frozen=True)
class Advice:
    """The test to make next.

    Attributes
    ----------
    test : Experiment or another test with a ``cost``
    action : str
        What to do, in words.
    odds : float
        Expected of the right rival against the next, once the test is made: they come out higher
        in three of four cases, whichever is right. No more than 1000 are promised.
    rivals : tuple of str
        What it is to tell apart, the best first.
    otherwise : tuple of str
        What the effects themselves advise, for where no simulated test tells enough.
    """

    test: Test
    action: str
    odds: float
    rivals: tuple[str, ...]
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
    def _aim(self) -> str:
        *others, last = self.rivals
        return f"separate {', '.join(others)} {'and' if len(others) > 1 else 'from'} {last}"

    @property
    def sentence(self) -> str:
        """The advice in words, to follow "Next: "."""
        odds, aim = float(f"{self.odds:.2g}"), self._aim
        expected = f"(expected odds {odds:g} : 1)"
        if self.enough:
            return f"{self.action} would {aim} {expected}."
        best = f"; the best of them is {self.action} {expected}" if odds > 1 else ""
        beside = f"; what may: {', or '.join(self.otherwise)}" if self.otherwise else ""
        return f"no test that was simulated would {aim}{best}{beside}."


@dataclass(frozen=True)
class WithoutMotion(Advice):
    """A test that moves nothing, where rivals do exactly the same to every motion."""

    @property
    def sentence(self) -> str:
        return f"nothing that vibrates would {self._aim}; what does: {self.action}."


@dataclass(frozen=True)
class MoreOfIt:
    """The test to make next where nothing explains the data."""

    test: Experiment
    action: str  # what to do, in words
    left: LoudAndQuiet | None = None  # None where no cycles tell loud from quiet
    half: str = ""  # the amplitude between them, with its unit
    odds: None = None  # between what was refused mean nothing
    rivals: tuple[str, ...] = ()

    @property
    def cost(self) -> float:
        """In repetitions of the largest release so far."""
        return self.test.cost

    @property
    def sentence(self) -> str:
        """The advice in words, to follow "Next: "."""
        aim = "whether it repeats" if self.test == AGAIN else "more of what is missing"
        if self.left is None:
            return f"{self.action} would show {aim}."
        loud, quiet = (two_digits(x) for x in self.left[:2])
        return (
            f"{self.action} would show {aim}: what is left is {loud} times the noise above"
            f" {self.half}, {quiet} times below."
        )


def more_of_it(left: LoudAndQuiet | None, largest: float, shown: Shown) -> MoreOfIt:
    """Whether a larger amplitude, a longer record or the same again shows more of what is left.

    ``largest`` is the largest amplitude so far.
    """
    if left is None:
        return MoreOfIt(AGAIN, AGAIN.words)
    loud, quiet, half = left
    test = LARGER if loud > _GROWS * quiet else LONGER if quiet > _GROWS * loud else AGAIN
    action = test.words.format(amplitude=shown.told(abs(test.amplitude) * largest))
    return MoreOfIt(test, action, left, shown.told(half))


@dataclass(frozen=True)
class Extrapolation:
    """A hypothesis and what it says of a record that is still to be made."""

    model: ReducedModel
    fitted: Hypothesis
    parts: tuple[Part, ...]  # with the values that fit the data so far
    weaker: tuple[Part, ...]  # with the effect a quartile weaker, as these data allow
    start: Array  # state at the largest release so far
    information: Array  # of the data so far on the values

    @classmethod
    def of(
        cls, model: ReducedModel, hypothesis: Hypothesis, records: Sequence[Record], largest: int
    ) -> Extrapolation:
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
        return cls(model, fitted, parts, weaker, start, information)

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
        equation = ExtendedEquation(self.model, self.weaker, 0, grid.step, clock)
        try:
            motion = integrate(equation, test.amplitude * self.start, grid, guess)
        except TrajectoryError as error:  # diverges, or friction holds it
            if error.motion is None:
                return None
            motion = error.motion
        x = equation.sampled(motion, largest.derivative)
        t = t[: len(x)]
        signal = read(self.weaker, 0, t, x)[0]
        swing = np.abs(signal - np.median(signal))
        noise = _louder(largest.noise, test.noise)
        quiet = max(QUIET * swing.max(), 3 * noise.std)
        end = float(t[np.flatnonzero(swing >= quiet)[-1:]].sum())
        escaped = np.abs(motion.q).max() > _GROWN * abs(test.amplitude) * largest.amplitude
        if escaped or end * largest.rate < _TURN * _LEAST_CYCLES:
            return None
        q, q_dot, q_ddot = (sampled(motion, d)[:, 0] for d in range(3))
        decay = Decay(clock + t, q, q_dot, q_ddot, largest.decay.unit, largest.decay.measured)
        whole = Record(decay, signal, np.ones(len(t), bool), noise, largest.spline, motion)
        record = whole.until(end)
        return replace(record, spline=HarmonicSpline.fit(record.t, record.signal))

    def misfit(self, record: Record, test: Experiment) -> float:
        """Chi-square that is left of a test, and of what the data so far say, at the least.

        It is infinite where no motion near that of the test is its own.
        """
        n = len(self.information)
        # What is known beforehand is in the data so far.
        free = [tuple(replace(x, spread=None) for x in p.parameters) for p in self.parts]
        pairs = zip(self.parts, free, strict=True)
        parts = tuple(replace(p, tolerance=None, parameters=x) for p, x in pairs)
        try:
            with np.errstate(all="ignore"):
                windows = Windows.of(self.model, parts, 0, record, record.motion)
        except TrajectoryError:
            return np.inf
        far = np.abs(windows.rows[:, -1]).max()
        if not far < _LOST * np.abs(record.whitened(record.signal)).max():
            return np.inf
        several = [
            replace(windows, where=np.concatenate([np.arange(n), n + 2 * i + np.arange(2)]))
            for i in range(test.repetitions)
        ]
        system = Marginal.of(parts, several).equations(self.fitted.noise.jump, self._excess(test))
        system.matrix[:n, :n] += self.information
        return system.chi_squared(system.bounded_step(np.zeros(n, bool), *limits(parts)))

    def exact_misfit(
        self, record: Record, test: Experiment, records: Sequence[Record], largest: int
    ) -> tuple[float, Array]:
        """The same by a fit to all records, without jumps: values may go where they are needed.

        Beside it, what it shows of the test, (n,).
        """
        so_far, n = self.fitted.solution, test.repetitions
        parts = tuple(
            replace(p, strengths=np.concatenate([p.strengths, p.own(largest)[None].repeat(n, 0)]))
            if p.effect.per_record
            else p
            for p in so_far.parts
        )
        motions = [*so_far.motions, *[record.motion] * n]
        solution = fit(self.model, parts, [*records, *[record] * n], motions)
        last, found = len(records) + n - 1, solution.parts
        equation = equation_of(self.model, found, last, record)
        x = equation.sampled(solution.motions[-1], record.derivative)
        shown = read(found, last, record.t, x)[0]
        return (solution.chi_squared - so_far.chi_squared) / self._excess(test), shown

    def _excess(self, test: Experiment) -> float:
        # Structure is in proportion to the amplitude, and counts in proportion to the noise.
        return 1 + (self.fitted.excess - 1) * (test.amplitude / test.noise) ** 2


def _louder(noise: Noise, by: float) -> Noise:
    def power(of: Spectrum) -> Spectrum:
        return replace(of, power=by**2 * of.power)

    slow = None if noise.drift is None else power(noise.drift)
    return replace(noise, std=by * noise.std, spectrum=power(noise.spectrum), drift=slow)


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
    again = Hypothesis.of(model, solution, len(kept), records).at(hypothesis.noise)
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
    # A strength that is hardly known is halved, no more.
    weaker = min(QUARTILE, 0.5 * abs(values[i]) / std[i])
    return -weaker * np.sign(values[i]) * covariance[i] / std[i]


MOST_ODDS = 1000.0  # more depends on what no rival knows of
_RIVALS = 3
_UNLIKELY = 0.1  # rivals that share so little of the weight may stay untold


def next_test(
    rivals: Sequence[Hypothesis],
    model: ReducedModel,
    records: Sequence[Record],
    tolerance: Tolerance,
    tests: Sequence[Experiment] = EXPERIMENTS,
) -> Advice | None:
    """The cheapest test that would tell rivals apart; of several, that with the best expected odds.

    Where none would, the one that comes nearest; None where there is nothing to tell apart, or no
    test that the model, the simulation as it was, can simulate. The rivals are fitted to the
    records, the best first. What differs by less than a ``tolerance`` does not matter.
    """
    rivals = rivals[:_RIVALS]
    if len(rivals) < 2:
        return None
    largest = max(range(len(records)), key=lambda i: records[i].amplitude)
    beyond = [Extrapolation.of(model, h, records, largest) for h in rivals]
    scores = np.array([h.score for h in rivals])
    compared = _Comparison(beyond, scores, weights(rivals), records, largest, tolerance)
    value, test = _best(tests, compared)
    if test is None:
        return None
    action = test.action(records[largest].amplitude, records[largest].decay.unit)
    odds = float(np.exp(min(value, np.log(MOST_ODDS))))
    names = tuple(titles(h) for h in rivals)
    own = [p.effect.advice for h in rivals for p in h.effects]
    otherwise = tuple(dict.fromkeys(words for words in own if words != Effect.advice))
    return Advice(test, action, odds, names, otherwise)


def _best(tests: Sequence[Experiment], compared: _Comparison) -> tuple[float, Experiment | None]:
    """The cheapest test that tells, and its log odds; else the one that comes nearest.

    Of tests that cost the same, the one that promises most is tried by fits.
    """
    best: tuple[float, Experiment | None] = (-np.inf, None)
    for cost in sorted({test.cost for test in tests}):
        near = [(compared.log_odds(test), test) for test in tests if test.cost == cost]
        value, test = max(near, key=lambda found: found[0])
        if 2 * value >= EQUIVALENT:
            value = min(value, compared.log_odds(test, exact=True))
        if value > best[0]:
            best = (value, test)
        if 2 * value >= EQUIVALENT:
            break
    return best


@dataclass(frozen=True, eq=False)
class _Comparison:
    """Rivals, minus twice the logarithms of their evidence so far, and their weights, (n,)."""

    rivals: Sequence[Extrapolation]
    scores: Array
    shares: Array
    records: Sequence[Record]
    largest: int  # which of the records has the largest amplitude
    tolerance: Tolerance
    shown: dict[tuple, list[Record | None]] = field(default_factory=dict)

    def log_odds(self, test: Experiment, exact: bool = False) -> float:
        """Logarithm of the odds for the right rival against the next, whichever it is.

        But for the least likely; minus infinity where the test cannot be simulated.
        """
        told = []
        shown = self._shown(test)
        for i, record in enumerate(shown):
            if record is None:
                return -np.inf
            odds = [self._against(i, j, record, test, exact) for j in range(len(shown)) if j != i]
            told.append(min(odds))
        order = np.argsort(told)
        at = np.searchsorted(np.cumsum(self.shares[order]), _UNLIKELY)
        return float(told[order[at]])

    def _against(self, i: int, j: int, record: Record, test: Experiment, exact: bool) -> float:
        """The same for rival i against j, were i the truth."""
        other = self.rivals[j]
        misfit = other.misfit(record, test)
        if exact:
            fitted, simulated = other.exact_misfit(record, test, self.records, self.largest)
            misfit = min(misfit, fitted)
            # Values that do the same within the tolerance come first, whatever the odds.
            a, b = ({p.effect.name for p in self.rivals[k].fitted.effects} for k in (i, j))
            alone = a <= b or b <= a  # one says nothing but values beside what the other says
            if alone and Difference.of(record, simulated, exact=True).within(self.tolerance):
                return 0.0
        if not np.isfinite(misfit):
            return -np.inf
        misfit = max(misfit, 0.0)
        # Noise moves it by twice its root.
        noise = QUARTILE * float(np.sqrt(misfit))
        return 0.5 * float(misfit + self.scores[j] - self.scores[i]) - noise

    def _shown(self, test: Experiment) -> list[Record | None]:
        """What the test shows, were each of the rivals true; tests may share it."""
        spans = scales(self.records).spans
        now = max(end for _, end in spans) if spans else None
        key = (test.amplitude, test.duration, test.noise, now and test.wait)
        if key not in self.shown:
            found: list[Record | None] = []
            for rival in self.rivals:
                guess = found[-1].motion if found and found[-1] else None
                found.append(rival.shows(test, self.records[self.largest], now, guess))
            self.shown[key] = found
        return self.shown[key]
