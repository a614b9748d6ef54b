"""Force laws of the blind trials: written apart from the catalogue and sharing no code with it.

A law is a function of (t, q, v, a) that returns the force per unit mass on the left side of the
equation; `switch` functions change sign where it jumps or has a kink, so that the integration can
stop there. Exponents and shapes are drawn at random near those that an engineer would assume.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Hidden:
    """One hidden effect, ready to integrate, with its truth."""

    name: str
    truth: dict
    force: Callable | None = None  # (t, q, v, side) -> force; side holds the signs of the switches
    switches: list[Callable] = field(default_factory=list)  # (t, q, v) -> float
    mass: Callable | None = None  # q -> added inertia
    mass_slope: Callable | None = None
    reading: Callable | None = None  # (t, q) -> what the sensor shows
    phases: dict = field(default_factory=dict)  # what differs from record to record
    states: int = 0  # internal states
    rates: Callable | None = None  # (t, q, v, z) -> dz/dt; force then takes z as well


def _power(x: float, p: float) -> float:
    return math.copysign(abs(x) ** p, x)


def _first_harmonic(f: Callable, omega: float) -> tuple[float, float]:
    """Relative frequency shift and damping ratio of a force along cos(omega t)."""
    phi = (np.arange(4096) + 0.5) * 2 * np.pi / 4096
    values = np.array([f(math.cos(p), -omega * math.sin(p)) for p in phi])
    shift = np.mean(values * np.cos(phi)) / omega**2
    zeta = -np.mean(values * np.sin(phi)) / omega**2
    return shift, zeta


FREQUENCY = {"weak": 0.001, "medium": 0.005, "strong": 0.02}
DAMPING = {"weak": 0.0005, "medium": 0.0015, "strong": 0.005}
READING = {"weak": 0.005, "medium": 0.015, "strong": 0.05}  # of the full amplitude

IN_CATALOGUE = (
    "viscous",
    "quadratic_drag",
    "dry_friction",
    "amplitude_damping",
    "cubic_damping",
    "hysteretic",
    "rubbing",
    "linear_frequency",
    "added_mass",
    "cubic_stiffness",
    "quintic_stiffness",
    "quadratic_stiffness",
    "constant_force",
    "nonlinear_inertia",
    "bilinear",
    "stop",
    "two_sided_gap",
    "magnet",
    "drift",
    "sudden_change",
    "base_excitation",
    "mains_hum",
    "second_mode",
    "gain",
    "saturation",
    "sensor_nonlinearity",
)
OUTSIDE = ("bouc_wen", "maxwell", "tuned_mass", "play", "stribeck")


def hidden(name: str, strength: str, omega: float, rng: np.random.Generator) -> Hidden:
    """Draw one effect of a given strength for an oscillator of linear frequency omega."""
    make = _MAKERS[name]
    return make(name, strength, omega, rng)


def _scaled(unit: Callable, target: float, omega: float, which: int) -> float:
    return target / _first_harmonic(unit, omega)[which]


# -- damping -------------------------------------------------------------------------------------


def _smooth_damping(law: Callable, low: float, high: float):
    def make(name, strength, omega, rng):
        p = rng.uniform(low, high)

        def unit(q, v):
            return law(q, v, p)

        c = _scaled(unit, DAMPING[strength], omega, 1)
        if name == "viscous" and rng.random() < 0.3:
            c = -c  # the simulation may be damped too much
        return Hidden(
            name, {"coefficient": c, "exponent": p}, lambda t, q, v, side: c * law(q, v, p)
        )

    return make


def _jumping_damping(law: Callable, low: float, high: float, switches: Callable):
    """Forces c law(q, direction, p), with the direction of motion held between switches."""

    def make(name, strength, omega, rng):
        p = rng.uniform(low, high)
        c = _scaled(lambda q, v: law(q, math.copysign(1, v), p), DAMPING[strength], omega, 1)

        def force(t, q, v, side):
            return c * law(q, side[0], p)

        return Hidden(name, {"coefficient": c, "shape": p}, force, switches(p))

    return make


def _velocity(t, q, v):
    return v


# -- stiffness and mass --------------------------------------------------------------------------


def _stiffness(law: Callable, low: float, high: float, either_sign: bool, kinks: Callable):
    def make(name, strength, omega, rng):
        p = rng.uniform(low, high)
        unit = _first_harmonic(lambda q, v: law(q, p), omega)[0]
        c = FREQUENCY[strength] / unit
        if either_sign and rng.random() < 0.5:
            c = -c
        return Hidden(
            name, {"coefficient": c, "shape": p}, lambda t, q, v, side: c * law(q, p), kinks(p)
        )

    return make


def _none(p):
    return []


def _quadratic(name, strength, omega, rng):
    c = math.copysign(4 * FREQUENCY[strength] * omega**2, rng.uniform(-1, 1))
    return Hidden(name, {"coefficient": c}, lambda t, q, v, side: c * q * q)


def _constant(name, strength, omega, rng):
    c = math.copysign(READING[strength] * omega**2, rng.uniform(-1, 1))
    return Hidden(name, {"coefficient": c}, lambda t, q, v, side: c)


def _added_mass(name, strength, omega, rng):
    m = 2 * FREQUENCY[strength]
    return Hidden(name, {"coefficient": m}, mass=lambda q: m, mass_slope=lambda q: 0.0)


def _inertia(name, strength, omega, rng):
    # h = u q^2 shifts the frequency by -u/4.
    u = math.copysign(4 * FREQUENCY[strength], rng.uniform(-0.5, 1))
    return Hidden(
        name, {"coefficient": u}, mass=lambda q: u * q * q, mass_slope=lambda q: 2 * u * q
    )


def _stop(q, g):
    return max(q - g, 0.0) ** 1.05


def _gap(q, g):
    return math.copysign(max(abs(q) - g, 0.0) ** 1.02, q)


def _magnet(name, strength, omega, rng):
    d, n = rng.uniform(1.3, 1.8), rng.uniform(1.9, 2.1)

    def law(q):
        return -((d - q) ** -n) + d**-n

    c = -FREQUENCY[strength] / _first_harmonic(lambda q, v: law(q), omega)[0]
    c = abs(c)
    return Hidden(
        name, {"coefficient": c, "distance": d, "exponent": n}, lambda t, q, v, side: c * law(q)
    )


# -- in time and from outside --------------------------------------------------------------------

_LENGTH = 20.0


def _phases(rng):
    return {k: rng.uniform(0, 2 * np.pi) for k in range(3)}


def _drift(name, strength, omega, rng):
    k, p = 2 * FREQUENCY[strength] * omega**2 * rng.choice([-1, 1]), rng.uniform(0.9, 1.1)
    return Hidden(
        name,
        {"coefficient": k, "exponent": p},
        lambda t, q, v, side: k * (t / _LENGTH) ** p * q,
    )


def _sudden(name, strength, omega, rng):
    k = 2 * FREQUENCY[strength] * omega**2 * rng.choice([-1, 1])
    at = rng.uniform(0.15, 0.6) * _LENGTH
    return Hidden(
        name,
        {"coefficient": k, "time": at},
        lambda t, q, v, side: k * q if side[0] > 0 else 0.0,
        [lambda t, q, v: t - at],
    )


def _base(name, strength, omega, rng):
    ratio = rng.choice([rng.uniform(0.25, 0.8), rng.uniform(1.25, 2.6)])
    w, phase = ratio * omega, _phases(rng)
    f = READING[strength] * abs(omega**2 - w**2)
    return Hidden(
        name,
        {"force": f, "frequency": w},
        lambda t, q, v, side: f * math.cos(w * t + phase["now"]),
        phases=phase,
    )


def _hum(name, strength, omega, rng):
    w, phase = 2 * np.pi * (50 + rng.uniform(-0.1, 0.1)), _phases(rng)
    size = READING[strength]
    return Hidden(
        name,
        {"size": size, "frequency": w},
        reading=lambda t, q: q + size * np.cos(w * t + phase["now"]),
        phases=phase,
    )


def _second_mode(name, strength, omega, rng):
    w, zeta = rng.uniform(2.4, 6.6) * omega, rng.uniform(0.002, 0.01)
    size, phase = 2 * READING[strength], _phases(rng)
    return Hidden(
        name,
        {"size": size, "frequency": w, "damping_ratio": zeta},
        reading=lambda t, q: q + size * np.exp(-zeta * w * t) * np.cos(w * t + phase["now"]),
        phases=phase,
    )


# -- measurement ---------------------------------------------------------------------------------


def _bias(name, strength, omega, rng):
    b = READING[strength] * rng.choice([-1, 1])
    return Hidden(name, {"bias": b}, reading=lambda t, q: q + b)


def _gain(name, strength, omega, rng):
    g = 1 + 2 * READING[strength] * rng.choice([-1, 1])
    return Hidden(name, {"gain": g}, reading=lambda t, q: g * q)


def _saturation(name, strength, omega, rng):
    s = {"weak": 0.97, "medium": 0.9, "strong": 0.8}[strength] + rng.uniform(-0.02, 0.02)
    return Hidden(name, {"limit": s}, reading=lambda t, q: np.clip(q, -s, s))


def _sensor(name, strength, omega, rng):
    b, power = READING[strength] * rng.choice([-1, 1]), int(rng.choice([2, 3]))
    return Hidden(name, {"coefficient": b, "power": power}, reading=lambda t, q: q + b * q**power)


# -- outside every catalogue ---------------------------------------------------------------------


def _bouc_wen(name, strength, omega, rng):
    # A softening hysteretic spring beside the main one.
    beta, n = rng.uniform(2, 4), rng.uniform(1.0, 1.6)
    k = 6 * DAMPING[strength] * omega**2

    def rates(t, q, v, z):
        return [v - beta * (abs(v) * abs(z[0]) ** (n - 1) * z[0] + 0.5 * v * abs(z[0]) ** n)]

    return Hidden(
        name, {"k": k, "beta": beta}, lambda t, q, v, side, z: k * z[0], states=1, rates=rates
    )


def _maxwell(name, strength, omega, rng):
    # zeta = k/(2 omega^2) w tau/(1 + w^2 tau^2)
    tau = rng.uniform(0.5, 2) / omega
    k = 2 * DAMPING[strength] * omega**2 * (1 + (omega * tau) ** 2) / (omega * tau)
    return Hidden(
        name,
        {"k": k, "tau": tau},
        lambda t, q, v, side, z: k * z[0],
        states=1,
        rates=lambda t, q, v, z: [v - z[0] / tau],
    )


def _tuned_mass(name, strength, omega, rng):
    w, zeta = omega * rng.uniform(0.9, 1.12), rng.uniform(0.01, 0.03)
    mu = {"weak": 0.0004, "medium": 0.0012, "strong": 0.004}[strength]

    def force(t, q, v, side, z):
        return -mu * (w * w * (z[0] - q) + 2 * zeta * w * (z[1] - v))

    def rates(t, q, v, z):
        return [z[1], -w * w * (z[0] - q) - 2 * zeta * w * (z[1] - v)]

    return Hidden(name, {"mu": mu, "frequency": w}, force, states=2, rates=rates)


def _play(name, strength, omega, rng):
    # A spring that is dragged along with play: an elastic-friction (Jenkins) pair with its gap.
    half = rng.uniform(0.1, 0.3)
    k = 8 * DAMPING[strength] * omega**2

    def rates(t, q, v, z):
        gap = q - z[0]
        pushed = (gap >= half and v > 0) or (gap <= -half and v < 0)
        return [v if pushed else 0.0]

    return Hidden(
        name, {"k": k, "half": half}, lambda t, q, v, side, z: k * z[0], states=1, rates=rates
    )


def _stribeck(name, strength, omega, rng):
    vs, ratio = rng.uniform(0.15, 0.4) * omega, rng.uniform(2.5, 4)

    def law(v):
        return math.copysign(1 + (ratio - 1) * math.exp(-((v / vs) ** 2)), v)

    c = _scaled(lambda q, v: law(v), DAMPING[strength], omega, 1)

    def force(t, q, v, side):
        return c * math.copysign(1 + (ratio - 1) * math.exp(-((v / vs) ** 2)), side[0])

    return Hidden(name, {"coefficient": c, "ratio": ratio}, force, [_velocity])


_MAKERS = {
    "viscous": _smooth_damping(lambda q, v, p: v, 1, 1),
    "quadratic_drag": _smooth_damping(lambda q, v, p: _power(v, p), 1.9, 2.1),
    "amplitude_damping": _smooth_damping(lambda q, v, p: abs(q) ** p * v, 1.9, 2.1),
    "cubic_damping": _smooth_damping(lambda q, v, p: _power(v, p), 2.9, 3.1),
    "dry_friction": _jumping_damping(lambda q, s, p: s, 1, 1, lambda p: [_velocity]),
    "hysteretic": _jumping_damping(
        lambda q, s, p: abs(q) ** p * s, 0.95, 1.05, lambda p: [_velocity, lambda t, q, v: q]
    ),
    "rubbing": _jumping_damping(
        lambda q, s, g: s * (q > g),
        -0.05,
        0.05,
        lambda g: [_velocity, lambda t, q, v: q - g],
    ),
    "linear_frequency": _stiffness(lambda q, p: q, 1, 1, True, _none),
    "added_mass": _added_mass,
    "cubic_stiffness": _stiffness(lambda q, p: _power(q, p), 2.95, 3.05, True, _none),
    "quintic_stiffness": _stiffness(lambda q, p: _power(q, p), 4.9, 5.1, True, _none),
    "quadratic_stiffness": _quadratic,
    "constant_force": _constant,
    "nonlinear_inertia": _inertia,
    "bilinear": _stiffness(
        lambda q, g: max(q - g, 0.0), -0.05, 0.05, True, lambda g: [lambda t, q, v: q - g]
    ),
    "stop": _stiffness(_stop, 0.4, 0.75, False, lambda g: [lambda t, q, v: q - g]),
    "two_sided_gap": _stiffness(
        _gap, 0.3, 0.7, False, lambda g: [lambda t, q, v: q - g, lambda t, q, v: q + g]
    ),
    "magnet": _magnet,
    "drift": _drift,
    "sudden_change": _sudden,
    "base_excitation": _base,
    "mains_hum": _hum,
    "second_mode": _second_mode,
    "bias": _bias,
    "gain": _gain,
    "saturation": _saturation,
    "sensor_nonlinearity": _sensor,
    "bouc_wen": _bouc_wen,
    "maxwell": _maxwell,
    "tuned_mass": _tuned_mass,
    "play": _play,
    "stribeck": _stribeck,
}
