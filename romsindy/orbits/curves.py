"""Periodic orbits of a model: backbone curves and forced responses with stability.

Orbits are Fourier series, and families of them (`harmonic_balance`) are followed as branches
(`continuation`): nothing is integrated in time.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from numbers import Real
from typing import Any, ClassVar, NamedTuple, Protocol, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from romsindy.notebook import Framed
from romsindy.orbits.continuation import ContinuationError, Steps
from romsindy.orbits.harmonic_balance import (
    LADDER,
    Family,
    ForcedFamily,
    FreeFamily,
    HarmonicBalance,
    OrbitBranch,
    Start,
    Sweep,
    floquet_multipliers,
    follow,
    free_multipliers,
)
from romsindy.physics.equations import Equations, gain_of
from romsindy.text import TextTable, as_text
from romsindy.typing import Array, Indices

METHODS = ("conservative", "phase resonance")

# Multipliers of undamped orbits have size 1 to rounding; they do not count as unstable.
_NEUTRAL = 1e-7
# Those of several coordinates have the size 1 to the error of the propagator; what grows less than
# this in a period is as good as stable.
_DRIFT = 1e-6
# Of the longest step: two branches that come nearer than this are taken to cross.
_CROSSING = 0.01
# Two orbits at one frequency that differ by more, as a part of their size, are two responses.
_APART = 1e-3
# Amplitudes this much larger than any of the data are as large: functions do not run away so soon.
_AS_LARGE = 1.02


@dataclass(frozen=True, eq=False, repr=False)
class PeriodicOrbits(Framed):
    """Periodic orbits along a branch, in the order of walking.

    Of a `ReducedModel`, the axis R of the coordinates is left out.

    Attributes
    ----------
    amplitude : (n, R) array
        Half of peak to peak of each coordinate, unit of q.
    frequency : (n,) array
        Angular frequency omega, rad/s.
    coefficients : (n, H + 1, R) array of complex
        q(t) = Re sum_k coefficients[k] exp(i k omega t), unit of q.
    residual : (n,) array
        Largest force left over in an equation along the orbit, over the largest |M q_ddot|: the
        truncation error of the harmonics, in force.
    folds : (k,) array of int
        Points where the amplitude of a backbone, or the frequency of a forced response, turns back.
    stop_reason, unit : str, str or None
        Why the branch ends where it ends; unit of q.
    """

    amplitude: Array
    frequency: Array
    coefficients: NDArray[np.complex128]
    residual: Array
    folds: Indices
    stop_reason: str
    unit: str | None

    _columns: ClassVar[tuple[str, ...]] = ("frequency", "amplitude", "residual")

    def __len__(self) -> int:
        return len(self.frequency)

    @property
    def series(self) -> Array:
        """The coefficients as a_0, a_1, b_1, ... of cosines and sines, (n, 2 H + 1, R)."""
        real, imaginary = self.coefficients.real, self.coefficients.imag
        c = np.zeros((len(self), 2 * real.shape[1] - 1, *real.shape[2:]))
        c[:, 0], c[:, 1::2], c[:, 2::2] = real[:, 0], real[:, 1:], -imaginary[:, 1:]
        return c

    def motion(self, index: int, n_samples: int = 200) -> tuple[Array, Array]:
        """Time in s, (n_samples,), and displacement, (n_samples, R), over one period."""
        phase = np.linspace(0, 2 * np.pi, n_samples)
        k = np.arange(self.coefficients.shape[1])
        q = np.real(np.exp(1j * np.outer(phase, k)) @ self.coefficients[index])
        return phase / self.frequency[index], q

    def __repr__(self) -> str:
        f, sizes = self.frequency, self.amplitude.reshape(len(self), -1).T
        reach = " and ".join(f"{a.min():.4g} to {a.max():.4g}" for a in sizes)
        return (
            f"<{type(self).__name__}: {len(self)} orbits, amplitude {reach}"
            f" {self.unit or '[q]'}, frequency {f.min():.5g} to {f.max():.5g} rad/s\n"
            f" {self.stop_reason}>"
        )


@dataclass(frozen=True)
class Bifurcation:
    """Where stability changes: its kind, and the first point of the branch past it."""

    kind: str
    index: int


@dataclass(frozen=True, eq=False, repr=False)
class BackboneCurve(PeriodicOrbits):
    """Orbits that no outer force drives; what `PeriodicOrbits` has, and what sustains them.

    Attributes
    ----------
    negative_damping : (n,) array
        mu of the force mu q_dot, on every coordinate, that balances the damping, 1/s.
    model : ReducedModel or CoupledModel
        Whose orbits these are: undamped, or with forces that do not jump.
    conservative : bool
        Whether the model has no damping.
    crossings : (k,) array of int
        First points past orbits of another mode, in which the first coordinate does not take part:
        there two curves cross.
    """

    negative_damping: Array
    model: Equations
    conservative: bool
    crossings: Indices

    _columns = (*PeriodicOrbits._columns, "negative_damping", "stable")

    @cached_property
    def multipliers(self) -> NDArray[np.complex128]:
        """Floquet multipliers, (n, 2 R), the largest first, but those that are always 1 last.

        These are two of a conservative orbit, and one with damping: one is 1 because the motion may
        start at any time, the other because orbits come in families.
        """
        others = free_multipliers(
            self.model, self.series, self.frequency, self.negative_damping, self.conservative
        )
        return np.concatenate([others, np.ones((len(self), 1 + self.conservative))], axis=1)

    @cached_property
    def stable(self) -> NDArray[np.bool_]:
        """Whether small deviations stay small, (n,)."""
        return np.max(np.abs(self.multipliers), axis=1) <= 1 + _DRIFT

    @property
    def bifurcations(self) -> tuple[Bifurcation, ...]:
        """Where stability changes: at a "fold", energy or, with damping, mu turns back."""
        q = np.real(np.sum(self.coefficients, axis=1))  # conservative orbits are at rest there
        at_rest = np.zeros_like(q)
        size = self.model.energy(q, at_rest) if self.conservative else self.negative_damping
        turns = np.flatnonzero(np.diff(np.sign(np.diff(size)))) + 1
        changes = np.flatnonzero(self.stable[1:] != self.stable[:-1])
        folds = np.intersect1d(turns, [changes, changes + 1])
        crossings = [self.crossings - 1, self.crossings]
        return _bifurcations(self.multipliers, self.stable, np.setdiff1d(folds, crossings))


class SteadyState(NamedTuple):
    """One of the responses at a frequency; of R coordinates an amplitude and a phase for each."""

    frequency: float  # rad/s
    amplitude: Array  # (R,)
    # (R,), by which the first harmonic leads the excitation, rad, from -pi to pi; nan without one
    phase: Array
    stable: bool
    low: Array  # (R,), ends of the 95 % bands; nan where there are none
    high: Array


class Fold(NamedTuple):
    """A frequency at which a response turns back, rad/s, with its 95 % interval if it is known."""

    frequency: float
    rising: bool  # whether a sweep of rising frequency jumps there, or one of falling
    low: float = np.nan
    high: float = np.nan


def crossings(along: Array, wanted: Array) -> Array:
    """Where a curve that may turn back has values (n,): counted in its points, (n_parts, n).

    Each part between two turns has a value once, or not at all: nan.
    """
    turns = np.flatnonzero(np.diff(np.sign(np.diff(along)))) + 1
    found = []
    for first, last in itertools.pairwise([0, *turns.tolist(), len(along) - 1]):
        part, forth = slice(first, last + 1), 1 if along[last] > along[first] else -1
        place = np.arange(first, last + 1.0)[::forth]
        found.append(np.interp(wanted, along[part][::forth], place, left=np.nan, right=np.nan))
    return np.array(found)


def rows_at(places: Array, table: Array) -> Array:
    """Rows of a table, (n, m), at places that are counted in them, between rows as well."""
    points = np.arange(len(table))
    return np.stack([np.interp(places, points, column) for column in table.T], axis=-1)


def crossed(curve: Array, omega: float) -> tuple[Array, Array]:
    """Places, (j,), and rows, (j, k), of a curve (k, n) at a frequency, the largest first.

    Its first two are frequency and amplitude.
    """
    places = crossings(curve[0], np.array([omega]))[:, 0]
    places = places[np.isfinite(places)]
    rows = rows_at(places, curve.T)
    order = np.argsort(-rows[:, 1])
    return places[order], rows[order]


@dataclass(frozen=True, eq=False, repr=False)
class ForcedResponse(PeriodicOrbits):
    """Orbits under force cos(omega t); what `PeriodicOrbits` has, and their stability.

    Attributes
    ----------
    force : float or (R,) array
        Per unit mass, unit of q per s^2.
    multipliers : (n, 2 R) array of complex
        Floquet multipliers, the largest one first.
    stable : (n,) array of bool
    bifurcations : tuple of Bifurcation
        "fold", "branch point", "period doubling" or "Neimark-Sacker", in the order of the branch.
    limit : float or None
        Largest amplitude of the data behind the model, where it is known.
    untraced : str
        What was not followed, in a sentence: frequencies that a branch which turned back did not
        reach, or another response where it ends. Empty where there is no such.
    """

    force: float | Array
    multipliers: NDArray[np.complex128]
    stable: NDArray[np.bool_]
    bifurcations: tuple[Bifurcation, ...]
    limit: float | None = None
    untraced: str = ""

    _columns = (*PeriodicOrbits._columns, "stable")

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """Whether an orbit is larger than any motion of the data behind the model, (n,)."""
        return self.larger(self.amplitude.reshape(len(self), -1).max(axis=1))

    def larger(self, amplitude: Array) -> NDArray[np.bool_]:
        """Whether amplitudes, (n,), are larger than those of the data."""
        return np.asarray(amplitude > _AS_LARGE * (np.inf if self.limit is None else self.limit))

    @property
    def jumps(self) -> tuple[Fold, ...]:
        """The folds as frequencies, in the order of the branch."""
        w = self.frequency
        return tuple(Fold(float(w[k]), bool(w[k] > w[k - 1])) for k in self.folds)

    def stable_at(self, places: ArrayLike) -> NDArray[np.bool_]:
        """Whether orbits are stable between others, at places that are counted in orbits.

        A fold is the last orbit of either side, and of neither.
        """
        before = np.clip(np.asarray(places).astype(int), 0, len(self) - 2)
        at_fold = np.isin(before, self.folds)
        return np.asarray(self.stable[np.where(at_fold, before + 1, before)])

    def steady_states(self, frequency: ArrayLike) -> list[SteadyState]:
        """All responses at angular frequencies, rad/s, those of the largest amplitude first."""
        n = len(self)
        amplitude, first = self.amplitude.reshape(n, -1), self.coefficients[:, 1].reshape(n, -1)
        columns = [
            self.frequency,
            amplitude.max(axis=1),
            *amplitude.T,
            *first.real.T,
            *first.imag.T,
        ]
        found = []
        for omega in np.atleast_1d(np.asarray(frequency, float)).tolist():
            places, rows = crossed(np.array(columns), omega)
            for stable, row in zip(self.stable_at(places), rows, strict=True):
                sizes, real, imaginary = np.split(row[2:], 3)
                some = np.hypot(real, imaginary) > _APART * sizes
                phase = np.where(some, np.arctan2(imaginary, real), np.nan)
                unknown = np.full_like(sizes, np.nan)
                found.append(SteadyState(omega, sizes, phase, bool(stable), unknown, unknown))
        return found

    @property
    def leaves(self) -> str:
        """Where it leaves the amplitudes of the data, in a sentence; nothing where it does not."""
        return self.leaves_within(0.0, np.inf)

    def leaves_within(self, low: float, high: float) -> str:
        """The same for a range of angular frequencies, rad/s."""
        there = self.beyond & (self.frequency >= low) & (self.frequency <= high)
        if not np.any(there):
            return ""
        hz = self.frequency[there] / (2 * np.pi)
        return (
            f"beyond the amplitudes of the data, {self.limit:.4g} {self.unit or '[q]'}, between"
            f" {np.min(hz):.5g} and {np.max(hz):.5g} Hz: nothing is known there"
        )

    def __str__(self) -> str:
        """Points that matter, in the order of the branch, and where it is unstable."""
        unit = self.unit or "[q]"
        sizes = self.amplitude.reshape(len(self), -1)
        several = sizes.shape[1] > 1
        names = [f"amplitude q{i + 1}" if several else "amplitude" for i in range(sizes.shape[1])]
        points = [("start", 0), ("largest", int(np.argmax(np.max(sizes, axis=1))))]
        points += [(b.kind, b.index) for b in self.bifurcations] + [("end", len(self) - 1)]
        hz = self.frequency / (2 * np.pi)
        rows = [["point", "frequency [Hz]", *(f"{name} [{unit}]" for name in names)]]
        for name, i in sorted(points, key=lambda point: point[1]):
            rows.append([name, f"{hz[i]:.5g}", *(f"{a:.4g}" for a in sizes[i])])
        force = _listed(np.atleast_1d(self.force))
        title = f"Response to a force of {force} {unit}/s^2 per unit mass, {len(self)} orbits"
        note = "Stable where it was followed." if self.untraced else "Stable everywhere."
        if not np.all(self.stable):
            low, high = np.min(hz[~self.stable]), np.max(hz[~self.stable])
            note = f"Unstable orbits from {low:.5g} to {high:.5g} Hz: a test jumps across them."
        if self.untraced:
            note += f" {self.untraced[0].upper()}{self.untraced[1:]}."
        if self.leaves:
            note += f" {self.leaves[0].upper()}{self.leaves[1:]}."
        return as_text(TextTable(title, rows, note))


def backbone_curve(
    model: Equations,
    amplitude: tuple[float, float],
    n_harmonics: int | None = None,
    *,
    mode: int = 1,
    method: str = "conservative",
    velocity_scale: float | None = None,
    n_points: int = 60,
) -> BackboneCurve:
    """Follow the periodic orbits around q = 0 that grow out of a linear mode.

    Unknown are the shape, the frequency omega and mu of a force mu q_dot, on every coordinate, that
    balances what damping takes. Without damping mu is zero, but it makes up for the free choice of
    phase, and so keeps the equations regular for any number of harmonics, down to the linear mode,
    where every branch is started.

    In a `CoupledModel`, the curve follows the mode through its interactions: where a multiple of
    its frequency meets that of another mode, it turns into a tongue in which the other coordinate
    moves. Where the first coordinate comes to rest in it, the curve goes on with the other phase.

    Parameters
    ----------
    model : ReducedModel or CoupledModel
    amplitude : (float, float)
        Half of peak to peak where the branch starts and ends, unit of q, of the coordinate that
        moves most in the linear mode. Damped orbits are a little asymmetric in time; theirs is half
        of q at phase 0 less q at phase pi.
    n_harmonics : int, optional
        Highest harmonic; as many as the forces need, at most 50, if it is not given.
    mode : int
        Number of the linear mode, by frequency, from 1.
    method : str
        "conservative" leaves the damping terms out; "phase resonance" keeps them.
    velocity_scale : float, optional
        Below which dry friction is made smooth, as tanh(q_dot / velocity_scale); unit of q per s.
        Phase resonance with dry friction needs it.
    n_points : int
        About how many orbits; more of them where the shape changes fast. A tongue much narrower
        than the steps, which are short with many points, is stepped over.

    Returns
    -------
    BackboneCurve
        It ends early where M(q) or the restoring force ceases to be positive, the frequency falls
        to zero, or another coordinate moves three times as far as the last amplitude, and says so.

    Raises
    ------
    ValueError
        If an argument is out of its range, or the model is unstable at q = 0.
    ContinuationError
        If the family ends before the first amplitude.

    Examples
    --------
    >>> from romsindy import ReducedModel
    >>> model = ReducedModel.from_coefficients({"omega^2": 1.0, "gamma_3": 1.0}, unit="m")
    >>> curve = backbone_curve(model, amplitude=(0.01, 2.9))
    >>> bool(np.allclose(curve.frequency, model.backbone(curve.amplitude), rtol=1e-9))
    True
    >>> curve.stop_reason
    'amplitude reached 2.9 m'
    """
    if len(amplitude) != 2 or not 0 < amplitude[0] < amplitude[1] < np.inf:
        raise ValueError(f"amplitude = {amplitude!r} must be two increasing positive numbers")
    low, high = amplitude
    if method not in METHODS:
        raise ValueError(f"method {method!r} is not known: use one of {list(METHODS)}")
    ladder = _ladder(n_harmonics)
    conservative = method == "conservative"
    smooth = model.undamped() if conservative else _smooth(model, velocity_scale)
    omega_0, shape = linear_mode(smooth, mode)
    coordinate = int(np.argmax(np.abs(shape)))

    def family(from_rest: bool, n: int) -> Family:
        balance = HarmonicBalance(smooth, n)
        return FreeFamily(balance, omega_0, high, coordinate, from_rest)

    # The branch is one unit long in p, and as much in shape and frequency.
    steps = _steps(n_points, 2.0)
    first = low / high
    still = np.zeros_like(shape)  # a vibration in the linear mode, from rest
    unknowns = np.concatenate([still, shape / shape[coordinate], still, [1.0, 0.0]])
    start = Start(unknowns, 1e-3 * first)
    failure = f"no orbit of amplitude {low:g} is reached from the linear mode: give a smaller one"
    led, ends = partial(family, True), (first, 1.0)
    if len(shape) > 1:  # a branch may pass through zero, but not start there
        start = _led(led, ladder, start, (0.0, 1e-2 * first), steps, failure)
        start = Start(np.append(start.p * start.u[:-2], start.u[-2:]), start.p)  # not from rest
        led, ends = partial(family, False), (-1.0, 1.0)
        steps = replace(steps, crossing=_CROSSING * steps.most)
    start = _led(led, ladder, start, (-first, first), steps, failure)
    branch = follow(led, ladder, start, ends, steps)
    end = f"amplitude reached {abs(branch.end.p) * high:.6g} {model.unit or '[q]'}"
    later = np.sum(branch.c[:, 1::4, coordinate], axis=1) < 0
    return BackboneCurve(
        **_orbits(_shifted(branch, later), end, model.unit),
        negative_damping=omega_0 * branch.other[:, 1],
        model=smooth,
        conservative=conservative,
        crossings=np.flatnonzero(later[1:] != later[:-1]) + 1,
    )


_Band = TypeVar("_Band", covariant=True)


class Estimated(Protocol[_Band]):
    """What knows the errors of its model, as `romsindy.Estimate` does."""

    def forced_response(
        self, force: Any, frequency: tuple[float, float], *args: Any, **kwargs: Any
    ) -> _Band:
        """Response with its band."""


@overload
def forced_response(
    model: Equations,
    force: ArrayLike,
    frequency: tuple[float, float],
    n_harmonics: int | None = None,
    *,
    velocity_scale: float | None = None,
    n_points: int = 200,
) -> ForcedResponse: ...


@overload
def forced_response(
    model: Estimated[_Band],
    force: ArrayLike,
    frequency: tuple[float, float],
    n_harmonics: int | None = None,
    *,
    velocity_scale: float | None = None,
    n_points: int = 200,
) -> _Band: ...


def forced_response(
    model: Any,
    force: ArrayLike,
    frequency: tuple[float, float],
    n_harmonics: int | None = None,
    *,
    velocity_scale: float | None = None,
    n_points: int = 200,
) -> Any:
    """Follow the periodic response to force cos(omega t) from one frequency to another.

    The branch starts from the orbit that grows out of rest as the force is raised.

    Parameters
    ----------
    model : ReducedModel, CoupledModel or Estimate
        Of an `Estimate`, such as a `SteadyFit`, its own ``forced_response``.
    force : float or (R,) array
        Amplitude of the force per unit mass, unit of q per s^2: positive, or those on the R
        coordinates of a `CoupledModel`, such as the mode shapes at the point of a force times it.
        Of a model with an input, and of a `SteadyFit`, in the unit of what was measured: a number.
    frequency : (float, float)
        Angular frequency where the branch starts and ends, rad/s; rising or falling.
    n_harmonics, velocity_scale
        As in `backbone_curve`.
    n_points : int
        About how many orbits.

    Returns
    -------
    ForcedResponse or ForcedBand
        Folds are passed, and located; unstable parts are marked. A branch that folds may come back
        to the first frequency, and end there. Of an `Estimate`, a `ForcedBand`.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    ContinuationError
        If the force cannot be raised to its value at the first frequency, as where an undamped
        model is in resonance with a multiple of it.

    Examples
    --------
    >>> from romsindy import ReducedModel
    >>> model = ReducedModel.from_coefficients({"omega^2": 1.0, "gamma_3": 1.0, "c_linear": 0.02})
    >>> response = forced_response(model, force=0.02, frequency=(0.8, 1.6))
    >>> [bifurcation.kind for bifurcation in response.bifurcations]
    ['fold', 'fold']
    """
    first, last = frequency_range(frequency)
    if hasattr(model, "forced_response"):
        return model.forced_response(
            force, frequency, n_harmonics, velocity_scale=velocity_scale, n_points=n_points
        )
    ladder = _ladder(n_harmonics)
    smooth = _smooth(model, velocity_scale)
    forces = _forces(smooth, force)
    size = _resonance(smooth, forces, (first + last) / 2)

    def family(path: Sweep, n: int) -> Family:
        return ForcedFamily(HarmonicBalance(smooth, n), path, size)

    # One unit in p, and twice up and down the resonance in two components.
    steps = _steps(n_points, 5.0)
    raising = partial(family, Sweep((first, first), (np.zeros_like(forces), forces)))
    failure = (
        f"no response was found at a force of {_listed(forces)} near {first:g} rad/s: give a"
        " smaller force, or another range of frequencies"
    )
    rest = Start(np.zeros(3 * len(forces)), 0.0)
    raised = _led(raising, ladder, rest, (0.0, 1.0), steps, failure)
    sweeping = partial(family, Sweep((first, last), (forces, forces)))
    resting = partial(family, Sweep((last, last), (np.zeros_like(forces), forces)))
    branch = follow(sweeping, ladder, Start(raised.u, 0.0), (0.0, 1.0), steps)
    multipliers = floquet_multipliers(smooth, branch.c, branch.omega)
    stable = np.abs(multipliers[:, 0]) <= 1 + _NEUTRAL
    return ForcedResponse(
        **_orbits(branch, f"frequency reached {branch.omega[-1]:.6g} rad/s", model.unit),
        force=float(forces[0]) if np.ndim(force) == 0 and len(forces) == 1 else forces,
        multipliers=multipliers,
        stable=stable,
        bifurcations=_bifurcations(multipliers, stable, branch.folds),
        limit=(model.amplitude_range or (0.0, None))[1],
        untraced=_untraced(
            branch, partial(_led, resting, ladder, rest, (0.0, 1.0), steps, ""), last
        ),
    )


def _untraced(branch: OrbitBranch, from_rest: Callable[[], Start], last: float) -> str:
    """What a branch of responses did not reach, in a sentence.

    ``from_rest`` raises the force at the last frequency, rad/s.
    """
    hz = 2 * np.pi
    if branch.end.p == 0:
        turned = branch.omega[np.argmin(np.abs(branch.omega - last))]
        return (
            f"nothing was followed from {turned / hz:.5g} to {last / hz:.5g} Hz: the branch turned"
            f" back before; start at the other end, frequency=({last:g}, {branch.omega[0]:g})"
        )
    if branch.end.p != 1:  # it was stopped
        return ""
    try:
        other = from_rest().u
    except ContinuationError:  # no response grows out of rest there
        return ""
    here, n = branch.end.u, min(len(other), len(branch.end.u))
    if np.linalg.norm(here[:n] - other[:n]) <= _APART * np.linalg.norm(here):
        return ""
    return (
        f"at {last / hz:.5g} Hz there is another response, which was not followed: start there,"
        f" frequency=({last:g}, {branch.omega[0]:g}), or go on beyond it"
    )


def _ladder(n_harmonics: int | None) -> tuple[int, ...]:
    if n_harmonics is None:
        return LADDER
    if n_harmonics not in range(1, 10**6) or isinstance(n_harmonics, bool):
        raise ValueError(f"n_harmonics = {n_harmonics!r} must be a positive whole number")
    return (int(n_harmonics),)


def _steps(n_points: int, length: float) -> Steps:
    """Steps for a branch of some length in its scaled unknowns."""
    if not isinstance(n_points, Real) or n_points < 2:
        raise ValueError(f"n_points = {n_points!r} must be at least 2")
    most = length / n_points
    return Steps(first=most / 10, least=1e-4 * most, most=most, max_points=100 * n_points)


def _smooth(model: Equations, velocity_scale: float | None) -> Equations:
    if velocity_scale is not None:
        return model.regularised(velocity_scale)
    jumps = [term.expression() for term in model.terms if not term.smooth]
    if jumps:
        raise ValueError(
            f"the force {jumps[0]} jumps: give velocity_scale, such as a hundredth of the largest"
            " velocity, below which it is made smooth"
        )
    return model


def linear_mode(model: Equations, number: int) -> tuple[float, Array]:
    """Angular frequency, rad/s, and shape, (R,), of a mode counted from 1."""
    require_mode(number, model)
    omega, shapes = model.linear_modes
    return float(omega[number - 1]), shapes[:, number - 1]


def require_mode(number: int, model: Equations) -> None:
    """Whether a model has a mode of this number, counted from 1, or else a ValueError."""
    count = model.n_coordinates
    if isinstance(number, bool) or number not in range(1, count + 1):
        several = f"the modes 1 to {count}: give one of them"
        one = "a model of one coordinate: give 1, or a CoupledModel"
        raise ValueError(f"mode = {number!r} is none of {several if count > 1 else one}")


def frequency_range(frequency: Any) -> tuple[float, float]:
    """Where a response starts and ends, rad/s, or else a ValueError."""
    ends = _numbers("frequency", frequency)
    if ends.shape != (2,):
        raise ValueError(f"frequency = {frequency!r} must be two numbers: give (from, to) in rad/s")
    if not (np.all((ends > 0) & (ends < np.inf)) and ends[0] != ends[1]):
        raise ValueError(
            f"frequency = {frequency!r} must be two different positive numbers, (from, to) in rad/s"
        )
    return float(ends[0]), float(ends[1])


def checked_force(force: ArrayLike, count: int) -> Array:
    """Amplitudes of the forces on the coordinates, (R,)."""
    forces = _numbers("force", force)
    if count == 1 and forces.ndim == 0:
        if not 0 < forces < np.inf:
            raise ValueError(f"force = {force!r} must be a finite positive number")
    elif forces.shape != (count,):
        wanted = "a number" if count == 1 else f"{count} numbers, one for each coordinate"
        raise ValueError(f"force = {force!r} has the shape {forces.shape}: give {wanted}")
    elif not (np.all(np.isfinite(forces)) and np.any(forces)):
        raise ValueError(f"force = {force!r} must be finite, and not all of it zero")
    return forces.reshape(count)


def _forces(model: Equations, force: ArrayLike) -> Array:
    """Amplitudes of the forces per unit mass on the coordinates, (R,)."""
    gain = gain_of(model)
    if np.ndim(gain):  # one input, which pushes all coordinates in phase
        return gain * checked_force(force, 1)
    return np.abs(gain) * checked_force(force, model.n_coordinates)


def _numbers(name: str, value: Any) -> Array:
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} = {value!r:.60} must be of numbers alone") from error


def _listed(forces: Array) -> str:
    return " and ".join(f"{f:g}" for f in forces)


def _resonance(model: Equations, forces: Array, omega: float) -> float:
    """Amplitude of a linear resonance at omega, unit of q: the size of what is to come."""
    rest = np.zeros(model.n_coordinates)
    damping = np.diag(model.residual_and_slopes(rest, rest, rest)[2])
    zeta = np.clip(damping / (2 * omega), 0.01, 0.5)
    return float(np.max(np.abs(forces) / (2 * omega**2 * zeta)))


def _led(
    family: Callable[[int], Family],
    ladder: tuple[int, ...],
    start: Start,
    p_range: tuple[float, float],
    steps: Steps,
    failure: str,
) -> Start:
    """Where a family that sets out from a known orbit arrives at the size of the last p."""
    try:
        branch = follow(family, ladder, start, p_range, steps)
        if abs(branch.end.p) != p_range[1]:
            raise ContinuationError(branch.stop_reason)
    except ContinuationError as error:  # who asks for orbits knows of no p
        told = "" if " p = " in str(error) else f" ({error})"
        raise ContinuationError(f"{failure}{told}") from error
    return branch.end


def _shifted(branch: OrbitBranch, later: NDArray[np.bool_]) -> OrbitBranch:
    """The same orbits, some of them, (n,), half a period later."""
    c = branch.c
    turned = (-1.0) ** ((np.arange(c.shape[1]) + 1) // 2)  # odd harmonics change their sign
    return replace(branch, c=np.where(later[:, None, None], turned[:, None] * c, c))


def _orbits(branch: OrbitBranch, end: str, unit: str | None) -> dict[str, Any]:
    """Fields of `PeriodicOrbits`; ``end`` says in physical terms that p has reached a limit."""
    cosines, sines = branch.c[:, 1::2], branch.c[:, 2::2]
    coefficients = np.concatenate([branch.c[:, :1], cosines - 1j * sines], axis=1)
    amplitude = (_peak(coefficients) + _peak(-coefficients)) / 2
    one = coefficients.shape[2] == 1
    return {
        "amplitude": amplitude[..., 0] if one else amplitude,
        "frequency": branch.omega,
        "coefficients": coefficients[..., 0] if one else coefficients,
        "residual": branch.leftover,
        "folds": branch.folds,
        "stop_reason": end if branch.stop_reason.startswith("p reached") else branch.stop_reason,
        "unit": unit,
    }


def _peak(coefficients: NDArray[np.complex128]) -> Array:
    """Largest value of each series, (n, R)."""
    ik = 1j * np.arange(coefficients.shape[1])
    turned = np.exp(peak_phase(coefficients)[..., None] * ik)
    return np.real(np.sum(coefficients.swapaxes(1, 2) * turned, axis=-1))


def peak_phase(coefficients: NDArray[np.complex128]) -> Array:
    """Where each series is largest, (n, R): the best of many samples, improved by Newton."""
    ik = 1j * np.arange(coefficients.shape[1])
    phases = np.linspace(0, 2 * np.pi, 16 * len(ik), endpoint=False)
    series = coefficients.swapaxes(1, 2)
    samples = np.real(series @ np.exp(np.outer(ik, phases)))
    phase = phases[np.argmax(samples, axis=-1)][..., None]
    for _ in range(4):
        q = series * np.exp(phase * ik)
        slope, curvature = (np.real(q @ x)[..., None] for x in (ik, ik**2))
        phase = phase - np.where(curvature < 0, slope / np.where(curvature < 0, curvature, 1), 0)
    return np.asarray(phase[..., 0])


def _bifurcations(
    multipliers: NDArray[np.complex128], stable: NDArray[np.bool_], folds: Indices
) -> tuple[Bifurcation, ...]:
    found = [Bifurcation("fold", int(k)) for k in folds]
    for i in np.flatnonzero(stable[1:] != stable[:-1]):
        if not np.any((folds == i) | (folds == i + 1)):
            unstable = i if stable[i + 1] else i + 1
            found.append(Bifurcation(_kind(multipliers[unstable, 0]), int(i) + 1))
    return tuple(sorted(found, key=lambda bifurcation: bifurcation.index))


def _kind(multiplier: complex) -> str:
    if multiplier.imag != 0:
        return "Neimark-Sacker"
    return "branch point" if multiplier.real > 0 else "period doubling"
