"""Forces that are in no catalogue: a diagnosis must not name one for another."""

from __future__ import annotations

import math

import numpy as np
from hidden import Hidden, harmonic
from laws import velocity
from memory import scaled


def _fractional(name, at):
    """Damping c D^alpha q, as relaxation times over four decades about the vibration."""
    alpha, n = at.rng.uniform(0.25, 0.75), 14
    s = np.logspace(-2.3, 1.7, n)
    weight = s**alpha * np.log(s[1] / s[0]) * math.sin(math.pi * alpha) / math.pi
    force = lambda q, v, z: float(weight @ z)  # noqa: E731
    rates = lambda q, v, z: list(v - s * z)  # noqa: E731
    shift, zeta = (
        float(np.sum(weight / (1 + s**2))) / 2,
        float(np.sum(weight * s / (1 + s**2))) / 2,
    )
    k = at.strength_of(shift, zeta)
    return Hidden(
        name,
        {"strength": k, "alpha": alpha},
        lambda t, q, v, side, z: k * force(q, v, z),
        start=lambda q: [0.0] * n,
        rates=lambda t, q, v, z: rates(q, v, np.asarray(z)),
    )


def _pendulum(name, at):
    """A pendulum of half the frequency that the vibration of its pivot sets swinging."""
    w, zeta = 0.5 * at.rng.uniform(0.96, 1.04), at.rng.uniform(0.004, 0.012)
    length, mu = at.rng.uniform(1.6, 3.0), 4 * at.frequency
    first = at.rng.uniform(0.05, 0.2)

    def couple(q, v, force, mass, z):
        angle, speed = z
        sine, cosine = math.sin(angle), math.cos(angle)
        pull = w * w * sine + 2 * zeta * w * speed
        moved = mu * length * (pull * sine - speed * speed * cosine)
        a = (moved - force) / (mass + mu * cosine * cosine)
        return a, [speed, -pull - a / length * sine]

    truth = {"mu": mu, "frequency": w, "length": length}
    return Hidden(name, truth, start=lambda q: [first, 0.0], couple=couple)


def _pinched(name, at):
    """Hysteresis that slips near zero force (Baber and Noori 1985)."""
    beta, n = at.rng.uniform(1.5, 4), at.rng.uniform(1, 1.5)
    depth, width, offset = at.rng.uniform(0.7, 0.92), at.rng.uniform(0.1, 0.25), 0.05

    def rates(q, v, z):
        y = z[0]
        slip = 1 - depth * math.exp(-(((math.copysign(y, y * v) - offset) / width) ** 2))
        return [slip * (v - beta * (abs(v) * abs(y) ** (n - 1) * y + 0.3 * v * abs(y) ** n))]

    return scaled(name, at, {"beta": beta, "depth": depth}, lambda q, v, z: z[0], rates, 1)


def _particle(name, at):
    """A loose mass that knocks against the walls of its box."""
    half, mu = at.rng.uniform(0.15, 0.4), 0.5 * at.strength_of(0.25, 0.1)
    k, c = 60.0**2, 2 * at.rng.uniform(0.1, 0.4) * 60.0

    def wall(q, v, z):
        deep = z[0] - q - math.copysign(half, z[0] - q)
        touches = abs(z[0] - q) > half
        return k * deep + c * (z[1] - v) if touches else 0.0

    force = lambda t, q, v, side, z: -mu * wall(q, v, z)  # noqa: E731
    rates = lambda t, q, v, z: [z[1], -wall(q, v, z)]  # noqa: E731
    truth = {"mu": mu, "half": half}
    return Hidden(name, truth, force, start=lambda q: [q, 0.0], rates=rates, longest=0.1)


def _breathing(name, at):
    """Stiffness that comes and goes with a slow period."""
    k, w = 2 * at.frequency, 1 / at.rng.uniform(8, 30)
    phase = at.rng.uniform(0, 2 * math.pi)
    force = lambda t, q, v, side, z: k * math.cos(w * t + phase) * q  # noqa: E731
    return Hidden(name, {"strength": k, "frequency": w}, force)


def _piecewise(name, at):
    """Viscous damping that is met beyond a displacement to either side."""
    gap = at.rng.uniform(0.2, 0.6)
    c = at.damping / harmonic(lambda q, v, z: v * (abs(q) > gap))[1]

    def force(t, q, v, side, z):
        return c * v if side[0] > 0 or side[1] < 0 else 0.0

    switches = [lambda t, q, v: q - gap, lambda t, q, v: q + gap]
    return Hidden(name, {"strength": c, "gap": gap}, force, switches)


def _threshold(name, at):
    """Damping that sets in beyond a speed, as by a valve that opens."""
    least = at.rng.uniform(0.2, 0.6)

    def law(v):
        return math.copysign(max(abs(v) - least, 0.0), v)

    c = at.damping / harmonic(lambda q, v, z: law(v))[1]
    switches = [lambda t, q, v: v - least, lambda t, q, v: v + least]
    force = lambda t, q, v, side, z: c * law(v)  # noqa: E731
    return Hidden(name, {"strength": c, "speed": least}, force, switches)


def _negative_stiffness(name, at):
    """A spring that pushes away from the rest, and lets go with distance."""
    width = at.rng.uniform(0.2, 0.5)

    def law(q):
        return -q * math.exp(-0.5 * (q / width) ** 2)

    c = -at.frequency / harmonic(lambda q, v, z: law(q))[0]
    force = lambda t, q, v, side, z: c * law(q)  # noqa: E731
    return Hidden(name, {"strength": c, "width": width}, force)


def _self_heating(name, at):
    """A stiffness that sinks with the heat that the vibration leaves in it."""
    k, tau = 2 * at.frequency, at.rng.uniform(50, 300)
    force = lambda t, q, v, side, z: -k * z[0] * q  # noqa: E731
    rates = lambda t, q, v, z: [(2 * v * v - z[0]) / tau]  # noqa: E731
    return Hidden(name, {"strength": k, "time": tau}, force, start=lambda q: [0.0], rates=rates)


def _pressed_friction(name, at):
    """Friction at a support with play: it holds as hard as the support is pressed."""
    play = at.rng.uniform(0.15, 0.5)

    def pressed(q):
        return max(abs(q) - play, 0.0)

    c = at.damping / harmonic(lambda q, v, z: math.copysign(pressed(q), v))[1]
    force = lambda t, q, v, side, z: c * side[0] * pressed(q)  # noqa: E731
    switches = [velocity, lambda t, q, v: q - play, lambda t, q, v: q + play]
    return Hidden(name, {"strength": c, "play": play}, force, switches)


MAKERS = {
    "fractional": _fractional,
    "pendulum_absorber": _pendulum,
    "pinched": _pinched,
    "particle_damper": _particle,
    "breathing": _breathing,
    "piecewise_damping": _piecewise,
    "threshold": _threshold,
    "negative_stiffness": _negative_stiffness,
    "self_heating": _self_heating,
    "pressed_friction": _pressed_friction,
}
