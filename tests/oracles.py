"""Closed forms and independent computations that tests compare with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from romsindy.fit.kernel.equation import ExtendedEquation
from romsindy.fit.kernel.part import free_coefficients

# The paper's beam, an asymmetric IC-ROM fitted to order 5.
ORDER_5 = {
    "omega^2": 1482.2,
    "gamma_2": -3.05e3,
    "gamma_3": 9.6e5,
    "gamma_4": 3.6e6,
    "gamma_5": -6.2e8,
    "Upsilon_3": 226.9,
    "Upsilon_4": 12.3,
    "Upsilon_5": 5.05e4,
}
# Made up, of the size of the order-5 terms at the largest amplitude.
ORDER_9 = ORDER_5 | {
    "gamma_6": 1e10,
    "gamma_7": 2e11,
    "gamma_8": -1e13,
    "gamma_9": 3e14,
    "Upsilon_6": 1e6,
    "Upsilon_7": 2e7,
    "Upsilon_8": 1e9,
    "Upsilon_9": 2e10,
}


def duffing_frequency(omega2: float, gamma3: float, amplitude: np.ndarray) -> np.ndarray:
    """Angular frequency of q'' + omega2 q + gamma3 q^3 = 0, exact."""
    stiff = omega2 + gamma3 * amplitude**2
    m = gamma3 * amplitude**2 / (2 * stiff)
    return np.pi * np.sqrt(stiff) / (2 * ellipk(m))


def pendulum_frequency(omega: float, angle: np.ndarray) -> np.ndarray:
    """Angular frequency of q'' + omega^2 sin q = 0 released at ``angle``, exact."""
    return np.pi * omega / (2 * ellipk(np.sin(angle / 2) ** 2))


def icrom_acceleration(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The example oscillator, written out by hand: no code of the package takes part."""
    h = 0.30 * q**2 + 2 * 0.05 * q**3 + 0.12 * q**4
    h_prime = 0.60 * q + 6 * 0.05 * q**2 + 0.48 * q**3
    return -(h_prime / 2 * v**2 + 36 * q + 2 * q**2 + 9 * q**3 + 0.06 * v) / (1 + h)


def integrate(acceleration: Callable, q0: float, v0: float, t: np.ndarray) -> np.ndarray:
    """q and v of q'' = acceleration(q, v), by an explicit Runge-Kutta pair of order 8."""
    solution = solve_ivp(
        lambda _, y: [y[1], acceleration(y[0], y[1])],
        (t[0], t[-1]),
        [q0, v0],
        "DOP853",
        t,
        rtol=1e-12,
        atol=1e-14,
    )
    return solution.y


def viscous_decay(t: np.ndarray, omega: float, zeta: float, q0: float = 1.0) -> np.ndarray:
    """Displacement of a linear oscillator released from rest at q0, exact."""
    damped = omega * np.sqrt(1 - zeta**2)
    phase = np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t)
    return q0 * np.exp(-zeta * omega * t) * phase


def falling_decay(
    t: np.ndarray, f: float = 5.0, rate: float = 0.3
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, envelope A and frequency [Hz] of a decay as of a clamped beam.

    The frequency f (1 + 0.8 A^2) falls from 1.8 f to f, the centre 0.2 A^2 comes back to rest.
    """
    envelope = np.exp(-rate * t)
    phase = 2 * np.pi * f * (t + 0.8 * (1 - envelope**2) / (2 * rate))
    q = envelope * np.cos(phase) + 0.2 * envelope**2
    return q, envelope, f * (1 + 0.8 * envelope**2)


def multisine(seed: int, low: float = 1.0, high: float = 12.0, lines: int = 60) -> Callable:
    """A force of random phases and lines of size 1 between two frequencies, exact at any time."""
    rng = np.random.default_rng(seed)
    frequency, phase = rng.uniform(low, high, lines), rng.uniform(0, 2 * np.pi, lines)
    return lambda t: np.cos(2 * np.pi * np.multiply.outer(t, frequency) + phase).sum(axis=-1)


def differences(function: Callable, z: np.ndarray, h: float = 1e-6) -> np.ndarray:
    """Derivatives (n, m) of a function (n,) of z (m,), by central differences."""
    return np.transpose([(function(z + d) - function(z - d)) / (2 * h) for d in h * np.eye(len(z))])


def equation_of(model, free=()):
    """The equation of a model, some of whose coefficients are free."""
    return ExtendedEquation(model, free_coefficients(model, free), 0, 0.01, 0.0)
