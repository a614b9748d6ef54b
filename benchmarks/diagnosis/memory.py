"""Forces with inner states: joints, dampers with a spring, masses that vibrate along."""

from __future__ import annotations

import math

import numpy as np
from hidden import Hidden, Setting, harmonic


def scaled(name: str, at: Setting, truth: dict, force, rates, states: int, start=None) -> Hidden:
    """A force k force(q, v, z) of the strength that is asked for."""
    k = at.strength_of(*harmonic(force, rates, states))
    return Hidden(
        name,
        {"strength": k, **truth},
        lambda t, q, v, side, z: k * force(q, v, z),
        start=start or (lambda q: [0.0] * states),
        rates=lambda t, q, v, z: rates(q, v, z),
    )


def _bouc_wen(name, at):
    beta, n, ratio = at.rng.uniform(1, 5), at.rng.uniform(1, 2), at.rng.uniform(-0.2, 0.9)

    def rates(q, v, z):
        y = z[0]
        return [v - beta * (abs(v) * abs(y) ** (n - 1) * y + ratio * v * abs(y) ** n)]

    return scaled(name, at, {"beta": beta, "n": n}, lambda q, v, z: z[0], rates, 1)


def _follows(q, v, slider, half):
    """Speed of a slider that is dragged along with play on either side."""
    gap = q - slider
    return v if (gap >= half and v > 0) or (gap <= -half and v < 0) else 0.0


def _play(name, at):
    """A slider that is pulled through a spring, and that through a clearance."""
    half, limit = at.rng.uniform(0.05, 0.35), at.rng.uniform(0.08, 0.5)
    rates = lambda q, v, z: [_follows(q, v, z[0], half + limit)]  # noqa: E731

    def force(q, v, z):
        return math.copysign(max(abs(q - z[0]) - half, 0.0), q - z[0])

    return scaled(name, at, {"half": half, "limit": limit}, force, rates, 1, lambda q: [q])


def _joint(name, at):
    """Micro-slip: sliders in parallel whose limits are spread by a power law (Segalman 2005)."""
    n, largest, chi = 5, at.rng.uniform(0.5, 1.6), at.rng.uniform(-0.7, -0.1)
    edges = largest * np.linspace(0, 1, n + 1)
    limits = 0.5 * (edges[1:] + edges[:-1])
    weight = np.diff(edges ** (chi + 2))
    weight /= weight.sum()

    def force(q, v, z):
        return float(weight @ (q - np.asarray(z)))

    def rates(q, v, z):
        return [_follows(q, v, y, limit) for y, limit in zip(z, limits, strict=True)]

    return scaled(name, at, {"largest": largest, "chi": chi}, force, rates, n, lambda q: [q] * n)


def _slider(name, at):
    """One spring in series with a slider (Jenkins)."""
    limit = at.rng.uniform(0.08, 0.6)
    rates = lambda q, v, z: [_follows(q, v, z[0], limit)]  # noqa: E731
    return scaled(name, at, {"limit": limit}, lambda q, v, z: q - z[0], rates, 1, lambda q: [q])


def _maxwell(name, at):
    tau = math.exp(at.rng.uniform(math.log(0.3), math.log(3)))
    rates = lambda q, v, z: [v - z[0] / tau]  # noqa: E731
    return scaled(name, at, {"tau": tau}, lambda q, v, z: z[0], rates, 1)


def _tuned_mass(name, at):
    w, zeta = at.rng.uniform(0.85, 1.18), math.exp(at.rng.uniform(math.log(0.005), math.log(0.04)))
    mu = {"weak": 0.0004, "medium": 0.0012, "strong": 0.004}[at.strength] * max(at.zeta / 0.005, 1)

    def force(t, q, v, side, z):
        return -mu * (w * w * (z[0] - q) + 2 * zeta * w * (z[1] - v))

    def rates(t, q, v, z):
        return [z[1], -w * w * (z[0] - q) - 2 * zeta * w * (z[1] - v)]

    truth = {"mu": mu, "frequency": w, "damping_ratio": zeta}
    return Hidden(name, truth, force, start=lambda q: [q, 0.0], rates=rates)


MAKERS = {
    "bouc_wen": _bouc_wen,
    "play": _play,
    "iwan": _joint,
    "jenkins": _slider,
    "tuned_mass": _tuned_mass,
    "maxwell": _maxwell,
}
