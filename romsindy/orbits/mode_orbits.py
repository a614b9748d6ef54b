"""Frequency and damping ratio of a normal mode of several coordinates, at given amplitudes.

The orbits are those of the undamped model; damping is small, and takes its work along them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from romsindy.orbits.curves import BackboneCurve, backbone_curve, linear_mode, peak_phase
from romsindy.orbits.harmonic_balance import FourierBasis, FreeFamily, HarmonicBalance
from romsindy.physics.equations import Equations
from romsindy.typing import Array

# Of the largest amplitude: there the mode is linear enough for the branch to start.
_START = 0.02
# Newton's iterations, and the step at which they end, in units of the largest amplitude.
_ITERATIONS, _LAST_STEP = 12, 1e-10
_ROUNDING = 1e-9  # to which amplitudes are reached, as a part of them
# Of the same unit, for differences: their error is its square.
_DIFFERENCE = 1e-4
# Gauss points over half a period: exact for smooth forces, and for those that jump or have a kink
# where all coordinates turn; 1e-5 where one turns in between.
_N_GAUSS = 200


@dataclass(frozen=True, eq=False)
class ModeOrbits:
    """Periodic orbits of an undamped model in one of its modes."""

    family: FreeFamily  # whose orbits these are, scaled with the largest amplitude
    model: Equations  # without damping
    amplitudes: Array  # (n,), half peak to peak of the coordinate that moves most, unit of q
    # (n, m + 3), unknowns of the family, then its parameter, and their derivatives by the scaled
    # amplitude; nan where there is no such orbit
    unknowns: Array
    slopes: Array
    # (n, m + 3, m + 3), of the derivatives of the equations by the unknowns; the last equation is
    # the amplitude
    inverses: Array

    def curves(self, model: Equations) -> Array:
        """Angular frequency (rad/s) and damping ratio of a model near this one, (2, n).

        Orbits move to first order in what differs, as standard errors ask for.
        zeta = (energy lost in a cycle) / (2 pi a dE/da), as in `ReducedModel.damping_ratio`: it
        falls towards a fold, where the energy grows and the amplitude does not.
        """
        undamped = model.undamped()
        orbits = self if undamped == self.model else self._moved(undamped)
        omega = self.family.omega_0 * orbits.unknowns[:, -3]
        losses = np.array([orbits._loss(model, x) for x in orbits.unknowns])
        return np.stack([omega, losses / (2 * np.pi * self.amplitudes * orbits._growth)])

    def _moved(self, model: Equations) -> ModeOrbits:
        """Orbits and slopes of another undamped model: a step of Newton's method for each."""
        family = replace(
            self.family, balance=HarmonicBalance(model, self.family.balance.n_harmonics)
        )
        unknowns, slopes = self.unknowns.copy(), self.slopes.copy()
        for x, slope, inverse in zip(unknowns, slopes, self.inverses, strict=True):
            x -= inverse @ np.append(family.residual(x[:-1], x[-1]), 0.0)
            h = _DIFFERENCE / np.max(np.abs(slope))
            high, low = (family.residual(y[:-1], y[-1]) for y in (x + h * slope, x - h * slope))
            off = np.append((high - low) / (2 * h), _reach(family, x) @ slope - 1)
            slope -= inverse @ off
        return replace(self, family=family, model=model, unknowns=unknowns, slopes=slopes)

    def _loss(self, model: Equations, x: Array) -> float:
        """Work of the damping of a model over a period."""
        c, omega = self.family.orbit(x[:-1], x[-1])
        basis, weights = _half_periods(self.family.balance.n_harmonics)
        q, q_dot = basis.values @ c, omega * (basis.first @ c)
        return float(weights @ np.sum(q_dot * model.damping(q, q_dot), axis=1) / omega)

    @property
    def _growth(self) -> Array:
        """dE/da from orbit to orbit, (n,): all coordinates rest at phase 0, where E is V."""
        start = self.family.balance.basis.values[0]
        q, by_amplitude = (
            np.array([start @ self.family.balance.series(x[:-3]) for x in several])
            for several in (self.family.amplitude_top * self.unknowns, self.slopes)
        )
        return np.sum(self.model.stiffness(q) * by_amplitude, axis=1)


def _newton(family: FreeFamily, x: Array, amplitude: float) -> tuple[Array, Array]:
    """The orbit of a scaled amplitude, from one nearby, and the inverse Jacobian there."""
    for _ in range(_ITERATIONS if np.isfinite(x[0]) else 0):
        reach = _reach(family, x)
        off = np.append(family.residual(x[:-1], x[-1]), reach @ x - amplitude)
        inverse = np.linalg.inv(np.vstack([family.jacobian(x[:-1], x[-1]), reach]))
        if np.max(np.abs(inverse @ off)) < _LAST_STEP:
            return x, inverse
        x = x - inverse @ off
    return np.full_like(x, np.nan), np.full((len(x), len(x)), np.nan)


def _reach(family: FreeFamily, x: Array) -> Array:
    """What multiplies the unknowns in the scaled amplitude, half of peak to peak."""
    row = np.zeros(len(x))
    own = slice(family.coordinate, len(x) - 3, family.balance.n_coordinates)
    c = x[own]
    series = np.append(c[0], c[1::2] - 1j * c[2::2])
    phases = peak_phase(np.stack([series, -series])[..., None])[:, 0]
    upper, lower = FourierBasis.at(phases, family.balance.n_harmonics).values
    row[own] = (upper - lower) / 2
    return row


def mode_orbits(model: Equations, amplitudes: Array, mode: int) -> ModeOrbits:
    """Follow a mode from small amplitudes on, without damping, to orbits at some of them.

    The damping of the model is left out. Amplitudes, (n,), are half peak to peak of the coordinate
    that moves most in the linear mode, unit of q; modes count from 1, by frequency. Orbits that the
    branch does not reach before it turns back are not there.

    Raises a ValueError if an amplitude is not positive, the model has no such mode, or inertia
    without an energy; a ContinuationError if the branch ends where it has hardly begun.
    """
    if amplitudes.ndim != 1 or not len(amplitudes) or not np.all(amplitudes > 0):
        raise ValueError(f"amplitudes must be positive and one-dimensional, got {amplitudes!r}")
    without = [term.key for term in model.terms if not term.conservative_inertia]
    if without:
        raise ValueError(
            f"the inertia of {without} has no kinetic energy, of which damping could take a part:"
            " give a model with Upsilon_3 and the like in its place"
        )
    undamped, top = model.undamped(), float(amplitudes.max())
    low = min(float(amplitudes.min()), _START * top)
    omega_0, shape = linear_mode(undamped, mode)
    curve = backbone_curve(undamped, (low, top), mode=mode)
    balance = HarmonicBalance(undamped, curve.coefficients.shape[1] - 1)
    family = FreeFamily(balance, omega_0, top, int(np.argmax(np.abs(shape))), from_rest=False)
    guesses = _guesses(curve, family, amplitudes)
    found = [_newton(family, x, a / top) for x, a in zip(guesses, amplitudes, strict=True)]
    unknowns, inverses = map(np.array, zip(*found, strict=True))
    return ModeOrbits(family, undamped, amplitudes, unknowns, inverses[..., -1], inverses)


def _guesses(curve: BackboneCurve, family: FreeFamily, amplitudes: Array) -> list[Array]:
    """Unknowns at amplitudes, between those of a curve up to where it first turns back."""
    c = curve.series / family.amplitude_top
    p = np.sum(c[:, 1::4, family.coordinate], axis=1)
    others = np.stack([curve.frequency, curve.negative_damping]) / family.omega_0
    known = np.column_stack([c.reshape(len(c), -1), *others, p])
    reached = curve.amplitude[:, family.coordinate]
    rises = np.append(np.diff(reached) > 0, False)
    reached = reached[: int(np.argmin(rises)) + 1]
    places = np.interp(amplitudes, reached, np.arange(len(reached)))
    last = len(reached) - 1
    beyond = amplitudes > reached[-1] * (1 + _ROUNDING)
    guesses = [
        known[int(k)] + k % 1 * (known[min(int(k) + 1, last)] - known[int(k)]) for k in places
    ]
    return [np.full_like(x, np.nan) if far else x for x, far in zip(guesses, beyond, strict=True)]


@lru_cache(maxsize=16)
def _half_periods(n_harmonics: int) -> tuple[FourierBasis, Array]:
    """Basis and weights of Gauss points on both halves of a period, from turn to turn."""
    x, w = np.polynomial.legendre.leggauss(_N_GAUSS)
    half = (x + 1) * np.pi / 2
    basis = FourierBasis.at(np.concatenate([half, half + np.pi]), n_harmonics)
    return basis, np.tile(w * np.pi / 2, 2)
