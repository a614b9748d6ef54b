"""Periodic orbits of a `ReducedModel`: backbone curves and forced responses with stability.

Orbits are Fourier series (`harmonic_balance`), and families of them (`families`) are followed as
branches (`continuation`): nothing is integrated in time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romsindy.orbits.continuation import ContinuationError, Steps
from romsindy.orbits.families import (
    LADDER,
    Family,
    ForcedFamily,
    FreeFamily,
    OrbitBranch,
    Path,
    Start,
    follow,
)
from romsindy.orbits.harmonic_balance import HarmonicBalance
from romsindy.orbits.stability import floquet_multipliers
from romsindy.physics.model import ReducedModel
from romsindy.text import TextTable, as_text
from romsindy.typing import Array, Indices

METHODS = ("conservative", "phase resonance")

# Multipliers of undamped orbits have size 1 to rounding; they do not count as unstable.
_NEUTRAL = 1e-7


@dataclass(frozen=True, eq=False, repr=False)
class PeriodicOrbits:
    """Periodic orbits along a branch, in the order of walking.

    Attributes
    ----------
    amplitude, frequency : (n,) arrays
        Half of peak to peak, unit of q; angular frequency omega, rad/s.
    coefficients : (n, H + 1) array of complex
        q(t) = Re sum_k coefficients[k] exp(i k omega t), unit of q.
    residual : (n,) array
        Largest force left over in the equation along the orbit, over the largest |M q_ddot|: the
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

    def __len__(self) -> int:
        return len(self.frequency)

    def motion(self, index: int, n_samples: int = 200) -> tuple[Array, Array]:
        """Time in s and displacement over one period of an orbit, (n_samples,) each."""
        phase = np.linspace(0, 2 * np.pi, n_samples)
        k = np.arange(self.coefficients.shape[1])
        q = np.real(np.exp(1j * np.outer(phase, k)) @ self.coefficients[index])
        return phase / self.frequency[index], q

    def __repr__(self) -> str:
        a, f = self.amplitude, self.frequency
        return (
            f"<{type(self).__name__}: {len(self)} orbits, amplitude {a.min():.4g} to {a.max():.4g}"
            f" {self.unit or '[q]'}, frequency {f.min():.5g} to {f.max():.5g} rad/s\n"
            f" {self.stop_reason}>"
        )


@dataclass(frozen=True, eq=False, repr=False)
class BackboneCurve(PeriodicOrbits):
    """Orbits that no outer force drives; what `PeriodicOrbits` has, and what sustains them.

    `negative_damping`, (n,), is mu of the force mu q_dot that balances the damping, 1/s.
    """

    negative_damping: Array


@dataclass(frozen=True)
class Bifurcation:
    """Where stability changes: its kind, and the first point of the branch past it."""

    kind: str
    index: int


@dataclass(frozen=True, eq=False, repr=False)
class ForcedResponse(PeriodicOrbits):
    """Orbits under force cos(omega t); what `PeriodicOrbits` has, and their stability.

    Attributes
    ----------
    force : float
        Per unit mass, unit of q per s^2.
    multipliers : (n, 2) array of complex
        Floquet multipliers, the larger one first.
    stable : (n,) array of bool
    bifurcations : tuple of Bifurcation
        "fold", "branch point", "period doubling" or "Neimark-Sacker", in the order of the branch.
    """

    force: float
    multipliers: NDArray[np.complex128]
    stable: NDArray[np.bool_]
    bifurcations: tuple[Bifurcation, ...]

    def __str__(self) -> str:
        """Points that matter, in the order of the branch, and where it is unstable."""
        unit = self.unit or "[q]"
        points = [("start", 0), ("largest", int(np.argmax(self.amplitude)))]
        points += [(b.kind, b.index) for b in self.bifurcations] + [("end", len(self) - 1)]
        hz = self.frequency / (2 * np.pi)
        rows = [["point", "frequency [Hz]", f"amplitude [{unit}]"]]
        for name, i in sorted(points, key=lambda point: point[1]):
            rows.append([name, f"{hz[i]:.5g}", f"{self.amplitude[i]:.4g}"])
        title = (
            f"Response to a force of {self.force:g} {unit}/s^2 per unit mass, {len(self)} orbits"
        )
        note = "Stable everywhere."
        if not np.all(self.stable):
            low, high = np.min(hz[~self.stable]), np.max(hz[~self.stable])
            note = f"Unstable orbits from {low:.5g} to {high:.5g} Hz: a test jumps across them."
        return as_text(TextTable(title, rows, note))


def backbone_curve(
    model: ReducedModel,
    amplitude: tuple[float, float],
    n_harmonics: int | None = None,
    *,
    method: str = "conservative",
    velocity_scale: float | None = None,
    n_points: int = 60,
) -> BackboneCurve:
    """Follow the periodic orbits around q = 0 from one amplitude to another.

    Unknown are the shape q / amplitude, the frequency omega and mu of a force mu q_dot that
    balances what damping takes. Without damping mu is zero, but it makes up for the free choice of
    phase, and so keeps the equations regular for any number of harmonics, down to the linear mode,
    where every branch is started.

    Parameters
    ----------
    model : ReducedModel
    amplitude : (float, float)
        Half of peak to peak where the branch starts and ends, unit of q. Damped orbits are a little
        asymmetric in time; theirs is half of q at phase 0 less q at phase pi.
    n_harmonics : int, optional
        Highest harmonic; as many as the forces need, at most 50, if it is not given.
    method : str
        "conservative" leaves the damping terms out; "phase resonance" keeps them.
    velocity_scale : float, optional
        Below which dry friction is made smooth, as tanh(q_dot / velocity_scale); unit of q per s.
        Phase resonance with dry friction needs it.
    n_points : int
        About how many orbits; more of them where the shape changes fast.

    Returns
    -------
    BackboneCurve
        It ends early where 1 + h(q) or the restoring force ceases to be positive, or the frequency
        falls to zero, and says so.

    Raises
    ------
    ValueError
        If an argument is out of its range, or the model is unstable at q = 0.
    ContinuationError
        If the family ends before the first amplitude.

    Examples
    --------
    >>> model = ReducedModel.from_coefficients({"omega^2": 1.0, "gamma_3": 1.0}, unit="m")
    >>> curve = backbone_curve(model, amplitude=(0.01, 2.9))
    >>> bool(np.allclose(curve.frequency, model.backbone(curve.amplitude), rtol=1e-9))
    True
    >>> curve.stop_reason
    'amplitude reached 2.9 m'
    """
    low, high = amplitude
    if not 0 < low < high < np.inf:
        raise ValueError(f"amplitude = {amplitude!r} must be two increasing positive numbers")
    if method not in METHODS:
        raise ValueError(f"method {method!r} is not known: use one of {list(METHODS)}")
    ladder = _ladder(n_harmonics)
    smooth = model.undamped() if method == "conservative" else _smooth(model, velocity_scale)
    omega_0 = _linear_frequency(smooth)

    def family(n: int) -> Family:
        return FreeFamily(HarmonicBalance(smooth, n), omega_0, high)

    # The branch is one unit long in p, and as much in shape and frequency.
    steps = _steps(n_points, 2.0)
    first = low / high
    linear_mode = Start(np.array([0.0, 1.0, 0.0, 1.0, 0.0]), 1e-3 * first)
    failure = f"no orbit of amplitude {low:g} is reached from the linear mode"
    start = _led(family, ladder, linear_mode, first, steps, failure)
    branch = follow(family, ladder, start, (first, 1.0), steps)
    end = f"amplitude reached {branch.end.p * high:.6g} {model.unit or '[q]'}"
    mu = omega_0 * branch.other[:, 1]
    return BackboneCurve(**_orbits(branch, end, model.unit), negative_damping=mu)


def forced_response(
    model: ReducedModel,
    force: float,
    frequency: tuple[float, float],
    n_harmonics: int | None = None,
    *,
    velocity_scale: float | None = None,
    n_points: int = 200,
) -> ForcedResponse:
    """Follow the periodic response to force cos(omega t) from one frequency to another.

    The branch starts from the orbit that grows out of rest as the force is raised.

    Parameters
    ----------
    model : ReducedModel
    force : float
        Amplitude of the force per unit mass, positive, unit of q per s^2.
    frequency : (float, float)
        Angular frequency where the branch starts and ends, rad/s; rising or falling.
    n_harmonics, velocity_scale
        As in `backbone_curve`.
    n_points : int
        About how many orbits.

    Returns
    -------
    ForcedResponse
        Folds are passed, and located; unstable parts are marked. A branch that folds may come back
        to the first frequency, and end there.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    ContinuationError
        If the force cannot be raised to its value at the first frequency, as where an undamped
        model is in resonance with a multiple of it.

    Examples
    --------
    >>> model = ReducedModel.from_coefficients({"omega^2": 1.0, "gamma_3": 1.0, "c_linear": 0.02})
    >>> response = forced_response(model, force=0.02, frequency=(0.8, 1.6))
    >>> [bifurcation.kind for bifurcation in response.bifurcations]
    ['fold', 'fold']
    """
    first, last = frequency
    if not (0 < first < np.inf and 0 < last < np.inf and first != last):
        raise ValueError(f"frequency = {frequency!r} must be two different positive numbers")
    if not 0 < force < np.inf:
        raise ValueError(f"force = {force!r} must be positive")
    ladder = _ladder(n_harmonics)
    smooth = _smooth(model, velocity_scale)
    omega = (first + last) / 2
    zeta = float(smooth.linearise(*np.zeros((3, 1)))[2][0]) / (2 * omega)
    size = force / (2 * omega**2 * float(np.clip(zeta, 0.01, 0.5)))  # of a linear resonance

    def family(path: Path, n: int) -> Family:
        return ForcedFamily(HarmonicBalance(smooth, n), path, size)

    # One unit in p, and twice up and down the resonance in two components.
    steps = _steps(n_points, 5.0)
    raising = partial(family, Path((first, first), (0.0, force)))
    failure = f"the force cannot be raised to {force:g} at {first:g} rad/s, start elsewhere"
    raised = _led(raising, ladder, Start(np.zeros(3), 0.0), 1.0, steps, failure)
    sweeping = partial(family, Path((first, last), (force, force)))
    branch = follow(sweeping, ladder, Start(raised.u, 0.0), (0.0, 1.0), steps)
    multipliers = floquet_multipliers(smooth, branch.c, branch.omega)
    stable = np.abs(multipliers[:, 0]) <= 1 + _NEUTRAL
    return ForcedResponse(
        **_orbits(branch, f"frequency reached {branch.omega[-1]:.6g} rad/s", model.unit),
        force=force,
        multipliers=multipliers,
        stable=stable,
        bifurcations=_bifurcations(multipliers, stable, branch.folds),
    )


def _ladder(n_harmonics: int | None) -> tuple[int, ...]:
    if n_harmonics is None:
        return LADDER
    if isinstance(n_harmonics, bool) or int(n_harmonics) != n_harmonics or n_harmonics < 1:
        raise ValueError(f"n_harmonics = {n_harmonics!r} must be a positive whole number")
    return (int(n_harmonics),)


def _steps(n_points: int, length: float) -> Steps:
    """Steps for a branch of some length in its scaled unknowns."""
    if n_points < 2:
        raise ValueError(f"n_points = {n_points!r} must be at least 2")
    most = length / n_points
    return Steps(first=most / 10, least=1e-4 * most, most=most, max_points=100 * n_points)


def _smooth(model: ReducedModel, velocity_scale: float | None) -> ReducedModel:
    if velocity_scale is not None:
        return model.regularised(velocity_scale)
    jumps = [term.expression() for term in model.terms if not term.smooth]
    if jumps:
        raise ValueError(
            f"the force {jumps[0]} jumps: give velocity_scale, such as a hundredth of the largest"
            " velocity, below which it is made smooth"
        )
    return model


def _linear_frequency(model: ReducedModel) -> float:
    squared = float(model.linearise(*np.zeros((3, 1)))[1][0])
    if not squared > 0:
        raise ValueError(
            f"omega^2 = {squared:.6g} is not positive: orbits are followed around a stable q = 0;"
            " measure q from a stable position of rest"
        )
    return float(np.sqrt(squared))


def _led(
    family: Callable[[int], Family],
    ladder: tuple[int, ...],
    start: Start,
    p: float,
    steps: Steps,
    failure: str,
) -> Start:
    """Where a family that sets out from a known orbit arrives at p."""
    try:
        branch = follow(family, ladder, start, (0.0, p), steps)
    except ContinuationError as error:
        raise ContinuationError(f"{failure}: {error}") from None
    if branch.end.p != p:
        raise ContinuationError(f"{failure}: {branch.stop_reason}")
    return branch.end


def _orbits(branch: OrbitBranch, end: str, unit: str | None) -> dict[str, Any]:
    """Fields of `PeriodicOrbits`; ``end`` says in physical terms that p has reached a limit."""
    coefficients = np.column_stack([branch.c[:, 0], branch.c[:, 1::2] - 1j * branch.c[:, 2::2]])
    return {
        "amplitude": (_peak(coefficients) + _peak(-coefficients)) / 2,
        "frequency": branch.omega,
        "coefficients": coefficients,
        "residual": branch.leftover,
        "folds": branch.folds,
        "stop_reason": end if branch.stop_reason.startswith("p reached") else branch.stop_reason,
        "unit": unit,
    }


def _peak(coefficients: NDArray[np.complex128]) -> Array:
    """Largest value of each series: the best of many samples, improved by Newton's method."""
    ik = 1j * np.arange(coefficients.shape[1])
    phases = np.linspace(0, 2 * np.pi, 16 * len(ik), endpoint=False)
    samples = np.real(coefficients @ np.exp(np.outer(ik, phases)))
    phase = phases[np.argmax(samples, axis=1)]
    for _ in range(4):
        q = coefficients * np.exp(np.outer(phase, ik))
        slope, curvature = np.real(q @ ik), np.real(q @ ik**2)
        phase = phase - np.where(curvature < 0, slope / np.where(curvature < 0, curvature, 1), 0)
    return np.real(np.sum(coefficients * np.exp(np.outer(phase, ik)), axis=1))


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
