"""What a hypothesis says of a test still to be made, and how far it could follow another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.experiment import Experiment
from romsindy.fit.collocation import Grid, Trajectory, TrajectoryError, integrate
from romsindy.fit.equation import ExtendedEquation
from romsindy.fit.gauss_newton import fit, limits, moved_parts
from romsindy.fit.linear_response import sampled
from romsindy.fit.part import Part, columns_of, read
from romsindy.fit.process_noise import Marginal, Windows
from romsindy.fit.record import Record
from romsindy.fit.verdict import EQUIVALENT, QUIET
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.noise import Noise
from romsindy.record.smoothing import HarmonicSpline
from romsindy.record.spectrum import Spectrum
from romsindy.typing import Array

QUARTILE = float(norm.ppf(0.75))  # one in four comes out worse than what is promised
_STEPS = 12  # a cycle: truth and rival share their error
_LEAST_CYCLES = 6
_LOST = 1e4  # a linearised motion that goes so many amplitudes astray says nothing
_TURN = 2 * np.pi
_GROWN = 1.5  # a motion that goes so far beyond its release escapes


@dataclass(frozen=True)
class Rival:
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
    ) -> Rival:
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
        x = sampled(motion, largest.derivative)
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
        valid = np.ones(len(t), bool)
        whole = Record(decay, signal, valid, noise, largest.spline, motion)
        record = whole.until(end)
        return replace(record, spline=HarmonicSpline.fit(record.t, record.signal))

    def misfit(self, record: Record, test: Experiment) -> float:
        """Chi-square that is left of a test, and of what the data so far say, at the least.

        It is infinite where no motion near that of the test is its own.
        """
        n = len(self.information)
        # What is known beforehand is in the data so far.
        parts = tuple(_without_priors(p) for p in self.parts)
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
    ) -> float:
        """The same by a fit to all records, without jumps: values may go where they are needed."""
        so_far, n = self.fitted.solution, test.repetitions
        parts = tuple(
            replace(p, strengths=np.concatenate([p.strengths, p.own(largest)[None].repeat(n, 0)]))
            if p.effect.per_record
            else p
            for p in so_far.parts
        )
        motions = [*so_far.motions, *[record.motion] * n]
        solution = fit(self.model, parts, [*records, *[record] * n], motions)
        return (solution.chi_squared - so_far.chi_squared) / self._excess(test)

    def _excess(self, test: Experiment) -> float:
        # Structure is in proportion to the amplitude, and counts in proportion to the noise.
        return 1 + (self.fitted.excess - 1) * (test.amplitude / test.noise) ** 2


def _louder(noise: Noise, by: float) -> Noise:
    def power(of: Spectrum) -> Spectrum:
        return replace(of, power=by**2 * of.power)

    slow = None if noise.drift is None else power(noise.drift)
    return replace(noise, std=by * noise.std, spectrum=power(noise.spectrum), drift=slow)


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
