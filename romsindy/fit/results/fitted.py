"""Models fitted by simulation to records that are ready: values, errors, verdict.

Fits start from the measured motion, smoothed (`romsindy.fit.kernel.gauss_newton`), so that the
phase is never a cycle off, and end with exact motions (`romsindy.fit.kernel.shooting`).

Vibrations of several coordinates that ring near a ratio of small whole numbers.

Read off the tones of the records, never put in: no fit asks for a ratio.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import cast

import numpy as np
from threadpoolctl import threadpool_limits

from romsindy.effects.base import Effect
from romsindy.effects.memory import MemoryEffect
from romsindy.effects.outside import Drive
from romsindy.fit.adequacy.independence import (
    Independence,
    examine_forced,
    examine_independence,
    judged,
    misses,
    of_decays,
    settled,
    told,
)
from romsindy.fit.adequacy.verdicts import Adequacy, ForcedAdequacy, examine
from romsindy.fit.choice import Linearised, counting_choice
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.kernel.gauss_newton import coloured_covariance, fit
from romsindy.fit.kernel.hypothesis import free_parts, laws_in, with_memories
from romsindy.fit.kernel.noises import Noises
from romsindy.fit.kernel.part import Part, Solution, extended
from romsindy.fit.kernel.prepared import Prepared, one_a_decay, record_notes
from romsindy.fit.kernel.shooting import (
    TOLERANCE,
    fit_growing,
    fit_pieces,
    lengths,
    moved,
    resimulated,
    shoot,
)
from romsindy.fit.process_noise import SIGMAS
from romsindy.fit.records.coupled import CurvedShape, Offset
from romsindy.fit.results.estimate import Estimate, checked_coordinate
from romsindy.fit.results.predict import Forecast, Sensors
from romsindy.fit.verdict import EXPLAINED
from romsindy.physics.equations import Equations
from romsindy.physics.input import input_in
from romsindy.physics.stiffness import Stiffness
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.noise import Noise
from romsindy.record.vibrations import Resonance, resonances_of
from romsindy.text import quantity, with_error
from romsindy.typing import Array


def resonances_in(records: Sequence[Prepared]) -> tuple[Resonance, ...]:
    """Pairs of modes, counted from 0 by frequency, where they come nearest to p : q in any record.

    Empty for records of one coordinate.
    """
    several = one_a_decay(records)
    if not several:
        return ()
    by_frequency = np.argsort([np.median(tone.frequency) for tone in several[0].tones])
    nearest: dict[tuple[int, int, int, int], Resonance] = {}
    for record in several:
        for r in resonances_of([record.tones[i] for i in by_frequency], record.derivative):
            pair = (r.lower, r.higher, r.p, r.q)
            nearest[pair] = min(nearest.get(pair, r), r, key=lambda x: x.off)
    return tuple(nearest[pair] for pair in sorted(nearest))


def resonance_notes(model: Equations, records: Sequence[Prepared]) -> list[str]:
    """A sentence for each of them."""
    return [
        f"modes {r.lower + 1} and {r.higher + 1} ring at {r.p}:{r.q} (ratio {r.ratio:.4g} at"
        f" {quantity(r.amplitude, model.unit or '[q]')})"
        f"{'' if _couples(model, r) else ', but no term of the model couples them'}"
        for r in resonances_in(records)
    ]


def _couples(model: Equations, resonance: Resonance) -> bool:
    """Whether the equation of one coordinate holds the other, in a motion of both."""
    main = np.argmax(np.abs(model.linear_modes[1]), axis=0)
    i, j = main[resonance.lower], main[resonance.higher]
    moving = np.ones(model.n_coordinates)
    return any(
        slope[i, j] or slope[j, i]
        for slope in model.residual_and_slopes(moving, moving, moving)[1:]
    )


# Change of chi-square at which a fit of several coordinates ends where the form of the equation
# decides, and no digit of its values matters.
_ROUGH = 1e-3
_TOLD = 3.0  # standard errors off zero: the delay of an input was looked for as well
_DRIVEN = 100  # iterations of a fit to motions that inputs drive: valleys are long


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Estimate):
    """A model fitted by simulation, with its errors and what it was made of.

    Saved is the `Estimate` alone: model, covariance, verdict and notes.

    Attributes
    ----------
    start : ReducedModel
        The equation to which the parts of the solution are added; a free force that jumps is all in
        its part, and other dry friction is smooth.
    records : tuple of Record
    solution : Solution
        Changes of the free coefficients, then the offsets of the sensor where they were fitted.

    Examples
    --------
    >>> from romsindy import ReducedModel, add_noise, refine
    >>> model = ReducedModel.from_coefficients({"omega^2": 36.0, "gamma_3": 9.0, "c_linear": 0.1})
    >>> decay = add_noise(model.simulate(1.0, 0.0, np.arange(0.0, 10.0, 0.05)), 40, seed=0)
    >>> fit = refine(model, decay)
    >>> [round(end, 1) for end in fit.interval("omega^2")], fit.verdict.explained
    ([35.9, 36.1], True)
    """

    start: Equations
    records: tuple[Prepared, ...]
    solution: Solution

    @property
    def residuals(self) -> tuple[Array, ...]:
        """Measured minus simulated for every decay, unit of the measured quantity."""
        return self.solution.residuals

    @property
    def chi_squared(self) -> float:
        """Sum of squares of the whitened residuals."""
        return self.solution.chi_squared

    @property
    def states(self) -> Array:
        """q and q_dot at the first sample of each decay, (n_decays, 2 R) for R coordinates."""
        return np.array([m.start for m in self.solution.motions])

    @property
    def offsets(self) -> Array:
        """Offset of the sensor in each record, unit of the measured quantity; 0 if not fitted.

        Of several channels (n_records, n_channels).
        """
        found = [p.strengths for p in self.solution.parts if isinstance(p.effect, Offset)]
        table = np.hstack(found) if found else np.zeros((len(self.records), 1))
        return table[:, 0] if table.shape[1] == 1 else table

    @property
    def mode_shapes(self) -> Array:
        """What each channel shows of each coordinate, (n_channels, R); 1 in its main channel."""
        return self.records[0].mode_shapes(self.solution.parts)

    @property
    def sensors(self) -> Sensors:
        """What is known of the sensors: the mean of their offsets, and the mode shapes."""
        curved = tuple(p for p in self.solution.parts if isinstance(p.effect, CurvedShape))
        shapes = self.mode_shapes if self.model.numbered else None
        return Sensors(self.offsets.mean(axis=0), shapes, curved)

    def reach_of(self, coordinate: int = 1) -> tuple[float, float]:
        """Least and largest value of a coordinate in the records, unit of q."""
        at = checked_coordinate(coordinate, self.model) - 1
        q = np.concatenate([m.q[:, at] for m in self.solution.motions])
        return float(q.min()), float(q.max())

    @property
    def resonances(self) -> tuple[Resonance, ...]:
        """Pairs of modes, from 0 by frequency, that come within 1 % of p : q in the records."""
        return resonances_in(self.records)

    @property
    def curved_shapes(self) -> dict[str, Array]:
        """What each channel shows of products of coordinates, (n_channels,), by product."""
        found: dict[str, Array] = {}
        for part in self.solution.parts:
            if isinstance(part.effect, CurvedShape):
                shown = found.setdefault(part.effect.product, np.zeros(len(self.mode_shapes)))
                shown[part.effect.channel] = part.own(0)[0]
        return found

    @property
    def decays(self) -> tuple[Decay, ...]:
        """What was fitted: the free parts, or pieces of them where notes say so."""
        return tuple(r.decay for r in self.records if not r.driven)

    def _fitted(self, kind: type[Effect]) -> Iterator[tuple[Part, Array]]:
        """Parts of a kind of effect, each with the standard errors of its values."""
        std = np.sqrt(np.diag(self.solution.covariance))
        for part, at in zip(self.solution.parts, self.solution.slices(), strict=True):
            if isinstance(part.effect, kind):
                yield part, std[at]

    @property
    def delays(self) -> dict[str, tuple[float, float]]:
        """By how much each input acts later than it was measured, and the standard error, s.

        By `Input.signal`: powers of an input, such as "force^3", have delays of their own.
        """
        found = ((cast(Drive, part.effect), std) for part, std in self._fitted(Drive))
        return {drive.of.signal: (drive.delay, float(std[-1])) for drive, std in found}

    @property
    def shapes(self) -> dict[str, tuple[float, float]]:
        """What shapes the forces that remember, such as "tuned_mass frequency": value and error.

        In the unit of q and seconds; the other values of a law are those of `model`.
        """
        return {
            f"{cast(MemoryEffect, part.effect).remembering.key} {p.name}": (float(v), float(e))
            for part, std in self._fitted(MemoryEffect)
            for p, v, e in zip(part.parameters, part.shape, std[part.strengths.size :], strict=True)
        }

    @property
    def noise(self) -> tuple[Noise | tuple[Noise, ...], ...]:
        """Noise of each decay, found without the model; a tuple of the channels of several."""
        return tuple(record.noise for record in self.records)

    def interval(self, name: str) -> tuple[float, float]:
        """As that of an `Estimate`, and of one of the `shapes`."""
        if name not in self.shapes:
            return super().interval(name)
        value, error = self.shapes[name]
        return value - SIGMAS * error, value + SIGMAS * error

    def remarks(self) -> list[str]:
        """The notes, as sentences, after what shapes the forces that remember."""
        shapes = [" ".join([n, "{} +- {}".format(*with_error(*x))]) for n, x in self.shapes.items()]
        return [*([f"Shapes: {', '.join(shapes)}."] if shapes else []), *super().remarks()]

    def __repr__(self) -> str:
        size = f"{len(self.free)} coefficients, {len(self.records)} records"
        return f"<Fit: {size}, adequacy {self.adequacy:.3f}>"


def refined(
    model: Equations,
    free: tuple[str, ...],
    records: Sequence[Prepared],
    more: tuple[Part, ...] = (),
    *,
    settled: bool = False,
    loss: str = "linear",
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """The same from records, whose motions it starts from, and with parts of their sensors.

    ``settled`` where the motions are those of the model already.
    """
    start, own = free_parts(model, free, records)
    parts = (*own, *more)
    # Tall and narrow matrices: threads of the linear algebra would only wait for each other.
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            solution, covariance = _followed(start, parts, records, settled, loss, progress)
        except TrajectoryError as error:
            raise TrajectoryError(
                f"the model with {len(free)} free coefficients has no motion near the measured one"
                f" ({error}): use fewer terms, or start from other values"
            ) from error
    solution = replace(solution, covariance=covariance)  # that of the residuals as they are
    return concluded(model, start, records, solution)


def concluded(
    model: Equations, start: Equations, records: Sequence[Prepared], solution: Solution
) -> Fit:
    """What a solution says of a model that was followed from ``start``."""
    peak = max(record.peak for record in records)
    new = extended(replace(model, values=start.values), solution.parts)
    new = with_memories(new, solution.parts)
    pairs = zip(solution.parts, solution.slices(), strict=True)
    laws = [(law, at.start + k) for p, at in pairs for k, law in enumerate(laws_in(p.effect))]
    named = {law.key: place for law, place in laws}
    free, places = tuple(named), list(named.values())
    covariance = solution.covariance[np.ix_(places, places)]
    grows = _growing(new, free, covariance)
    return Fit(
        model=replace(new, amplitude_range=model.amplitude_range or (0.0, peak)),
        free=free,
        covariance=covariance,
        verdict=_verdict(records, solution, _undetermined(new, free, covariance)),
        notes=(*_notes(records, solution), *resonance_notes(new, records), *grows),
        start=start,
        records=tuple(records),
        solution=solution,
    )


def examined(fit: Fit) -> Fit:
    """The same with its verdict by what is left of its driven records, or of its decays.

    Where that is noise, the values and their errors are those that it weighs. Decays of which more
    is left keep their verdict: it says from which amplitude on.
    """
    driven = [(i, r) for i, r in enumerate(fit.records) if r.driven]
    pairs = driven or [*enumerate(fit.records)]
    if not driven and told(fit.verdict, fit.records):
        return fit
    if not 0 < _size(fit, pairs).part < np.inf:
        return fit  # there is no motion, or nothing is left
    if driven:
        found = examine_independence(fit.start, fit.solution, pairs)
        first = judged(_size(fit, pairs), found, pairs)
        if first.structured:
            return replace(fit, verdict=first)
        moved = settled(fit.start, fit.solution, fit.records, _by_record(pairs, found))
    else:
        found, moved = of_decays(fit.start, fit.solution, fit.records)
        if misses(fit.verdict, found):
            return fit
    noises = _by_record(pairs, found)
    better = moved and _simulated_without(fit.start, moved, fit.records, noises)
    if better:
        own = fit.model.terms[: len(fit.start.terms)]
        model = replace(fit.model, terms=own, values=fit.start.values)
        fit = replace(concluded(model, fit.start, fit.records, better), notes=fit.notes)
    return replace(fit, verdict=judged(_size(fit, pairs), found, pairs))


def _simulated_without(
    model: Equations, moved: Solution, records: Sequence[Prepared], noises: Mapping[int, Noises]
) -> Solution | None:
    """The values of a solution that forces move, with motions that none do; None if there are none.

    Noise of the sensor of an input looks the same as a force that was not measured. The gain that
    follows the motion best is then too small, by the part of the power of the input that is noise
    (W. A. Fuller, "Measurement Error Models", Wiley 1987, section 1.1): its error counts both.
    """
    found = fit(model, moved.parts, records, moved.motions, fixed=True)
    if not found.converged:  # where motion is sensitive, it swings between two starts
        try:
            found = resimulated(model, moved, records)
        except TrajectoryError:
            return None
    both = [_of_inputs(part, records, noises) for part in moved.parts]
    return replace(found, covariance=moved.covariance + np.diag(np.concatenate(both) ** 2 / 2))


def _of_inputs(part: Part, records: Sequence[Prepared], noises: Mapping[int, Noises]) -> Array:
    """By how much the values of a part change where forces are noise of the sensor of its input."""
    change = np.zeros(part.size)
    if not isinstance(part.effect, Drive):
        return change
    source, gain, noisy = part.effect.of.source, part.strengths.ravel(), []  # parts of its power
    weights = np.square(part.effect.directions)
    for i, noise in noises.items():
        measured = records[i].decay
        if source in measured.names:
            u = measured.u[:, measured.names.index(source)]
            power = measured.dt * float(np.var(u)) * np.maximum(gain**2, 1e-300)
            # Its noise moves all coordinates: no more than is found at the least of them.
            noisy.append(min(1.0, float(np.min(weights @ noise.force / power))))
    change[: len(gain)] = float(np.mean(noisy)) * np.abs(gain)
    return change


def _by_record(pairs: Sequence[tuple[int, Prepared]], found: Independence) -> dict[int, Noises]:
    return {i: own for (i, _), own in zip(pairs, found.noises, strict=True)}


def _size(fit: Fit, pairs: Sequence[tuple[int, Prepared]]) -> ForcedAdequacy:
    """How much is left."""
    if isinstance(fit.verdict, ForcedAdequacy):
        return fit.verdict
    records, left = zip(*((r, fit.residuals[i]) for i, r in pairs), strict=True)
    return examine_forced(records, left, fit.solution.n_values)


def _undetermined(model: Equations, free: Sequence[str], covariance: Array) -> str:
    """Linear stiffness that is not told from 0, and inputs that move no coordinate for certain."""
    errors = dict(zip(free, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    values = model.coefficients
    lost = {n for n, std in errors.items() if abs(values[n]) < _TOLD * std}
    acting = [(t.key, i.signal) for t in model.terms if (i := input_in(t)) is not None]
    told = {signal for key, signal in acting if key not in lost}
    wrong = {key for key, signal in acting if signal not in told}
    wrong |= {t.key for t in model.terms if getattr(t, "law", t) == Stiffness(1)}
    return ", ".join(
        f"{n} is {values[n]:.3g} +- {std:.2g}" for n, std in errors.items() if n in wrong & lost
    )


def _verdict(records: Sequence[Prepared], solution: Solution, undetermined: str) -> Adequacy:
    """Of the driven records, where there are any: what decays say beside them is a note."""
    pairs = zip(records, solution.residuals, strict=True)
    driven = [(r, e) for r, e in pairs if r.driven]
    if driven:
        alone, left = zip(*driven, strict=True)
        return replace(examine_forced(alone, left, solution.n_values), undetermined=undetermined)
    return examine(records, solution.residuals, solution.n_values)


def _growing(model: Equations, free: Sequence[str], covariance: Array) -> list[str]:
    """A sentence for each coordinate of several whose small vibrations would grow, for certain."""
    std = np.sqrt(np.diag(covariance))
    surely = {n for n, s in zip(free, std, strict=True) if model.coefficients[n] < -SIGMAS * s}
    return [
        f"the linear damping of q{i + 1} is negative: its small vibrations would grow, which no"
        " decay shows; do not extrapolate to smaller amplitudes"
        for i in range(model.n_coordinates)
        if f"c_linear [q{i + 1}]" in surely
    ]


def _notes(records: Sequence[Prepared], solution: Solution) -> tuple[str, ...]:
    """What the reader must know of the records and of the fit."""
    notes = []
    if solution.interrupted:
        notes.append("interrupted before the simulations came to their end: not the best fit")
    elif not solution.converged:
        notes.append("the fit has not come to its end: start from other values")
    return (*notes, *record_notes(records))


def _followed(
    model: Equations,
    parts: tuple[Part, ...],
    records: Sequence[Prepared],
    settled: bool,
    loss: str,
    progress: Callable[[str], None] | None,
) -> tuple[Solution, Array]:
    """Fit from the motions of the records; where that does not settle, over growing horizons."""
    shot = partial(shoot, model, loss=loss, progress=progress)
    if settled:
        try:
            return shot(parts, records, [r.motion for r in records], tolerance=_ROUGH)
        except TrajectoryError:
            # Window by window a simulation may stumble over friction; all windows at once do not.
            near = fit(model, parts, records)
            if not near.converged:
                raise
            return near, coloured_covariance(model, near, records)
    if any(r.driven for r in records):  # inputs keep the phase: no need to shoot
        near = fit(model, parts, records, iterations=_DRIVEN)
        if not near.finite:
            raise TrajectoryError("it leads far away")
        with np.errstate(all="ignore"):
            covariance = coloured_covariance(model, near, records)
        if not np.all(np.isfinite(covariance)):
            raise TrajectoryError("it leads far away")
        return near, covariance
    near = fit(model, parts, records)
    if model.numbered:
        if not near.converged:
            near = _in_pieces(model, parts, records)
        rough = near.chi_squared > EXPLAINED**2 * sum(len(r.signal) for r in records)
        return shot(near.parts, records, near.motions, tolerance=_ROUGH if rough else TOLERANCE)
    if near.converged or model.memories:
        return shot(near.parts, records, near.motions)
    found, motions = fit_growing(model, parts, records)
    return shot(found, records, motions)


def _in_pieces(model: Equations, parts: Sequence[Part], records: Sequence[Prepared]) -> Solution:
    """Where a fit of whole records does not settle: to the longest pieces that the model follows.

    Raises a TrajectoryError if it follows none.
    """
    best = None
    for cycles in lengths(records):
        found = fit_pieces(model, parts, records, cycles)
        if found is None:
            break
        best, parts, records = found, found.parts, moved(records, found.motions)
    if best is None:
        raise TrajectoryError(f"it follows it over no {lengths(records)[0]:.0f} cycles")
    return best


def with_choice_error(fit: Fit, every: Linearised) -> Fit:
    """A fit with the errors of the choice of its terms, from all candidates about its motions.

    ``every`` has one part: all data.
    """
    covariance, notes = counting_choice(fit.free, fit.covariance, every)
    return replace(fit, covariance=covariance, notes=(*fit.notes, *notes))


_STATE = 50  # samples, from which the state is read at which a prediction starts
_LEAST = 8  # samples that are predicted


@dataclass(frozen=True, eq=False)
class HeldOut:
    """The end of a record, and its prediction."""

    vibration: ForcedVibration
    forecast: Forecast  # with its 95 % band; nan where the model has no motion that long

    @classmethod
    def of(cls, fit: Estimate, vibration: ForcedVibration) -> HeldOut:
        """Predict it, from the state that its first samples show."""
        try:
            return cls(vibration, fit.forecast(vibration, _STATE))
        except TrajectoryError:
            nothing = np.full_like(vibration.y, np.nan)
            return cls(vibration, Forecast(nothing, nothing, nothing, ()))

    @property
    def missed(self) -> Array:
        """Measured minus predicted."""
        return self.vibration.y - self.forecast.value

    @property
    def held(self) -> float:
        """Part of the samples after these that lie in the band."""
        y, (_, low, high, _) = self.vibration.y, self.forecast
        return float(np.mean(((low <= y) & (y <= high))[_STATE:]))

    @property
    def error(self) -> float:
        """Rms of what is missed after the samples that gave the state."""
        return float(np.sqrt(np.mean(self.missed[_STATE:] ** 2)))

    @property
    def part(self) -> float:
        """The same over the standard deviation of the response there."""
        return self.error / float(np.sqrt(np.mean(np.var(self.vibration.y[_STATE:], axis=0))))

    def __str__(self) -> str:
        v = self.vibration
        what = f"The last {v.t[-1] - v.t[0]:.4g} s ({len(v.t)} samples) took no part in the fit: "
        if not np.isfinite(self.error):
            return f"{what}the model has no motion that long from their first {_STATE} samples."
        return (
            f"{what}predicted from their first {_STATE} samples with an error of"
            f" {quantity(self.error, v.signal_unit)} rms, {100 * self.part:.2g} % of the response;"
            f" {100 * self.held:.0f} % of them lie in the 95 % band."
        )


def without_end(
    vibration: ForcedVibration, share: float
) -> tuple[ForcedVibration, ForcedVibration]:
    """The record without its end, and this end: a share of all samples.

    Raises a ValueError if too few samples are left on either side.
    """
    n = len(vibration.t)
    first = n - round(share * n)
    if min(first, n - first) < _STATE + _LEAST:
        raise ValueError(
            f"{share:.6g} of {n} samples are {n - first}, and {first} are left: both need"
            f" {_STATE + _LEAST} or more; hold out another share, or give a longer record"
        )
    return vibration.between(end=vibration.t[first - 1]), vibration.between(vibration.t[first])


@dataclass(frozen=True, eq=False)
class SmallVibration:
    """One mode of small vibrations, and the vibration of the decays that is near it."""

    number: int  # of the mode, by frequency, from 1
    coordinate: int  # that it moves most, from 1
    # Of small vibrations, Hz and without unit, with standard errors
    frequency: float
    frequency_std: float
    damping_ratio: float
    damping_ratio_std: float
    # (n,), of the coordinate, as it was followed in all decays; unit of q
    measured_amplitude: Array
    measured_frequency: Array  # (n,), at these amplitudes, Hz; the other coordinates move it, too


def small_vibrations(fit: Estimate, records: Sequence[Prepared]) -> tuple[SmallVibration, ...]:
    """The modes of a model that was fitted to some records, by frequency."""
    numbers = np.stack([_linear(fit.model), fit.errors_of(_linear)], axis=1)  # (2, 2, R)
    main = np.argmax(np.abs(fit.model.linear_modes[1]), axis=0)
    found = []
    for i, coordinate in enumerate(main.tolist()):
        frequency, frequency_std, ratio, ratio_std = numbers[:, :, i].ravel().tolist()
        found.append(
            SmallVibration(
                i + 1,
                coordinate + 1,
                frequency,
                frequency_std,
                ratio,
                ratio_std,
                *_ringing(fit, records, coordinate),
            )
        )
    return tuple(found)


def _ringing(fit: Estimate, records: Sequence[Prepared], coordinate: int) -> tuple[Array, Array]:
    """Amplitude of a coordinate, and its frequency in Hz, as followed in all decays.

    Where inputs drive it, its largest displacement; its frequency is theirs.
    """
    ringing = one_a_decay(records)
    if not ringing:
        return np.array([max(map(abs, fit.reach_of(coordinate + 1)))]), np.array([np.nan])
    tones = [(r.tones[coordinate], r) for r in ringing]
    amplitude = [t.amplitude / (2 * np.pi * t.frequency) ** r.derivative for t, r in tones]
    return np.concatenate(amplitude), np.concatenate([t.frequency for t, _ in tones])


def _linear(model: Equations) -> Array:
    """Frequencies, Hz, and damping ratios of the modes, (2, R)."""
    return np.array([model.linear_modes[0] / (2 * np.pi), model.linear_damping_ratios])
