"""Where a response jumps while the frequency of its force changes at a steady rate.

A motion whose Fourier coefficients c change slowly needs the force of an orbit, and that of their
rate, D c_dot = f - R(c, omega(t)). Beyond a fold no orbit is near: the motion passes where it was,
slowly, and jumps late. Near the fold that is a Riccati equation, and the delay is

    2.338 r^(2/3) / (a b)^(1/3),    x_dot = a r t + b x^2,

where -2.338 is the first zero of Airy's function [1]. This gives the scale; c itself is integrated,
for its jump takes a time of its own.

[1] P. Jung, G. Gray, R. Roy, P. Mandel, "Scaling law for dynamical hysteresis", Phys. Rev. Lett. 65
    (1990) 1873.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from romsindy.orbits.curves import ForcedResponse
from romsindy.orbits.harmonic_balance import HarmonicBalance
from romsindy.physics.equations import Equations
from romsindy.typing import Array

_AIRY = 2.338107  # the first zero of Ai is at minus that
_HARMONICS = 3  # by which a delay is computed; a fold has all
_BEFORE, _AFTER = 6.0, 6.0  # delays by Airy's zero, of what is integrated
_SAMPLES = 2000
_PRECISION = 1e-4
LATE = 0.05  # standard deviation of a delay, as a part of it: noise ends it early


class LateJump(NamedTuple):
    """A jump of a sweep: number of the orbit at its fold, and how late it comes, rad/s."""

    fold: int
    delay: float


def jumps(model: Equations, response: ForcedResponse, rate: float) -> list[LateJump]:
    """Jumps of a sweep along a response of a model; ``rate`` in rad/s^2.

    A rising sweep jumps at folds where the frequency is largest, a falling one where it is least.
    A delay has the sign of the rate, and ends where amplitudes change fastest.
    """
    w = response.frequency
    turns = [k for k in response.folds.tolist() if (2 * w[k] - w[k - 1] - w[k + 1]) * rate > 0]
    return [LateJump(k, _delay(model, response, k, rate)) for k in turns]


def _delay(model: Equations, response: ForcedResponse, k: int, rate: float) -> float:
    balance = HarmonicBalance(model, min(_HARMONICS, response.coefficients.shape[1] - 1))
    w, kept = response.frequency, 2 * balance.n_harmonics + 1
    c = response.series.reshape(len(response), -1, model.n_coordinates)[:, :kept]
    scale = _by_airy(balance, c[k], float(w[k]), rate)
    side = -1 if response.stable[k - 1] else 1
    i = k + side
    while 0 < i < len(w) - 1 and abs(w[k] - w[i]) < _BEFORE * scale:
        i += side
    force = np.zeros_like(c[0])
    force[1] = response.force
    start = float(w[i])

    def flow(t: float, x: Array) -> Array:
        at = balance.series(x), start + rate * t
        return np.linalg.solve(balance.by_rate(*at), force.ravel() - balance.residual(*at))

    def slope(t: float, x: Array) -> Array:
        at = balance.series(x), start + rate * t
        return -np.linalg.solve(balance.by_rate(*at), balance.linearise(*at)[1])

    until = (abs(w[k] - start) + _AFTER * scale) / abs(rate)
    size = np.abs(c[k]).max()
    found = solve_ivp(
        flow,
        (0.0, until),
        c[i].ravel(),
        "Radau",
        np.linspace(0.0, until, _SAMPLES),
        rtol=_PRECISION,
        atol=_PRECISION * size / 10,
        jac=slope,
    )
    first = np.linalg.norm(found.y.reshape(*force.shape, -1)[1:3], axis=(0, 1))
    before = int(np.searchsorted(found.t, abs(w[k] - start) / abs(rate)))
    moved = first[before:] - first[before]
    sense = np.sign(moved[np.argmax(np.abs(moved))])
    at = found.t[before + int(np.argmax(sense * np.diff(moved)))]
    return float(start + rate * at - w[k])


def _by_airy(balance: HarmonicBalance, c: Array, omega: float, rate: float) -> float:
    """Size of the delay at a fold by its normal form, rad/s."""
    _, by_c, by_omega = balance.linearise(c, omega)
    u, _, vt = np.linalg.svd(by_c)
    left, right = u[:, -1], vt[-1]
    step = 1e-3 * np.abs(c).max() * balance.series(right)
    ahead, here, behind = (balance.residual(c + x, omega) for x in (step, 0 * step, -step))
    speed = left @ balance.by_rate(c, omega) @ right
    a = left @ by_omega / speed
    b = left @ (ahead - 2 * here + behind) / (2 * speed * float(np.sum(step**2)))
    return float(_AIRY * np.cbrt(rate**2 / abs(a * b)))
