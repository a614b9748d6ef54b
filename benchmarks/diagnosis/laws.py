"""Forces without memory: damping, stiffness, mass. Exponents and places are drawn at random."""

from __future__ import annotations

import math
from collections.abc import Callable

from hidden import Hidden, Setting, harmonic, power


def velocity(t, q, v):
    """Switch of everything that depends on the direction of motion."""
    return v


def smooth_damping(law: Callable, low: float, high: float, either_sign: bool = False):
    """Maker of forces c law(q, v, p)."""

    def make(name: str, at: Setting) -> Hidden:
        p = at.rng.uniform(low, high)
        c = at.damping / harmonic(lambda q, v, z: law(q, v, p))[1]
        if either_sign and at.rng.random() < 0.3:
            c *= -0.7  # the simulation may be damped too much
        force = lambda t, q, v, side, z: c * law(q, v, p)  # noqa: E731
        return Hidden(name, {"strength": c, "exponent": p}, force)

    return make


def jumping_damping(law: Callable, low: float, high: float, switches: Callable):
    """Maker of forces c law(q, direction, p), with the direction held between switches."""

    def make(name: str, at: Setting) -> Hidden:
        p = at.rng.uniform(low, high)
        c = at.damping / harmonic(lambda q, v, z: law(q, math.copysign(1, v), p))[1]
        force = lambda t, q, v, side, z: c * law(q, side[0], p)  # noqa: E731
        return Hidden(name, {"strength": c, "shape": p}, force, switches(p))

    return make


def stiffness(law: Callable, low: float, high: float, either_sign: bool, kinks: Callable):
    """Maker of forces c law(q, p)."""

    def make(name: str, at: Setting) -> Hidden:
        p = at.rng.uniform(low, high)
        c = at.frequency / harmonic(lambda q, v, z: law(q, p))[0]
        if either_sign:
            c *= at.sign()
        force = lambda t, q, v, side, z: c * law(q, p)  # noqa: E731
        return Hidden(name, {"strength": c, "shape": p}, force, kinks(p))

    return make


def _none(p):
    return []


def _quadratic(name, at):
    c = 4 * at.frequency * at.sign()
    return Hidden(name, {"strength": c}, lambda t, q, v, side, z: c * q * q)


def _constant(name, at):
    c = at.reading * at.sign()
    return Hidden(name, {"strength": c}, lambda t, q, v, side, z: c)


def _added_mass(name, at):
    m = 2 * at.frequency
    return Hidden(name, {"strength": m}, mass=lambda q: m, mass_slope=lambda q: 0.0)


def _inertia(name, at):
    # h = u q^2 shifts the frequency by -u / 4
    u = math.copysign(4 * at.frequency, at.rng.uniform(-0.5, 1))
    return Hidden(name, {"strength": u}, mass=lambda q: u * q * q, mass_slope=lambda q: 2 * u * q)


def _stop(name, at):
    side, gap, p = at.sign(), at.rng.uniform(0.3, 0.85), at.rng.uniform(1.0, 1.2)

    def law(q):
        return side * max(side * q - gap, 0.0) ** p

    c = at.frequency / harmonic(lambda q, v, z: law(q))[0]
    truth = {"strength": c, "gap": side * gap, "exponent": p}
    force = lambda t, q, v, side, z: c * law(q)  # noqa: E731
    return Hidden(name, truth, force, [lambda t, q, v: side * q - gap])


def _gap(q, gap):
    return math.copysign(max(abs(q) - gap, 0.0) ** 1.05, q)


def _magnet(name, at):
    side, d, n = at.sign(), at.rng.uniform(1.25, 2.1), at.rng.uniform(1.9, 4.1)

    def law(q):
        return -side * ((d - side * q) ** -n - d**-n)

    c = abs(at.frequency / harmonic(lambda q, v, z: law(q))[0])
    truth = {"strength": c, "distance": d, "exponent": n}
    return Hidden(name, truth, lambda t, q, v, side, z: c * law(q))


def _beyond(gap):
    return [lambda t, q, v: q - gap]


MAKERS = {
    "viscous": smooth_damping(lambda q, v, p: v, 1, 1, either_sign=True),
    "quadratic_drag": smooth_damping(lambda q, v, p: power(v, p), 1.8, 2.2),
    "amplitude_damping": smooth_damping(lambda q, v, p: abs(q) ** p * v, 1.8, 2.2),
    "cubic_damping": smooth_damping(lambda q, v, p: power(v, p), 2.8, 3.2),
    "dry_friction": jumping_damping(lambda q, s, p: s, 1, 1, lambda p: [velocity]),
    "hysteretic": jumping_damping(
        lambda q, s, p: abs(q) ** p * s, 0.9, 1.1, lambda p: [velocity, *_beyond(0.0)]
    ),
    "rubbing": jumping_damping(
        lambda q, s, g: s * (q > g), -0.12, 0.12, lambda g: [velocity, *_beyond(g)]
    ),
    "linear_frequency": stiffness(lambda q, p: q, 1, 1, True, _none),
    "added_mass": _added_mass,
    "cubic_stiffness": stiffness(lambda q, p: power(q, p), 2.9, 3.1, True, _none),
    "quintic_stiffness": stiffness(lambda q, p: power(q, p), 4.8, 5.2, True, _none),
    "quadratic_stiffness": _quadratic,
    "constant_force": _constant,
    "nonlinear_inertia": _inertia,
    "bilinear": stiffness(lambda q, g: max(q - g, 0.0), -0.12, 0.12, True, _beyond),
    "stop": _stop,
    "two_sided_gap": stiffness(
        _gap, 0.2, 0.8, False, lambda g: [lambda t, q, v: q - g, lambda t, q, v: q + g]
    ),
    "magnet": _magnet,
}
