"""What is hidden in a beam, and how strong it must be to be of medium size.

Medium: half a per cent of the frequency, or 0.0015 of damping ratio, times 0.7 to 1.5, by the first
harmonic of the force along the first mode.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from beam_truth import BeamTruth, Force, Spring
from hidden import harmonic

FREQUENCY, DAMPING = 0.005, 0.0015
# Where one acts, and what a diagnosis calls it.
NAMES = {
    "damper": "viscous",
    "friction": "dry_friction",
    "stop": "stop",
    "gap": "two_sided_gap",
    "cubic": "cubic_stiffness",
    "magnet": "magnet",
    "mass": "added_mass",
    "drag": "quadratic_drag",
    "alpha": "mass_damping",
    "eta": "material_damping",
    "compliance": "clamp_compliance",
    "modulus": "bending_stiffness",
    "spring_stiffness": "spring_stiffness",
    "pre_tension": "pre_tension",
    "sensor_gain": "sensor_gain",
    "sensor_offset": "sensor_offset",
    "sensor_saturation": "sensor_saturation",
}
AT_A_PLACE = ("damper", "friction", "stop", "gap", "cubic", "magnet", "mass")
# A damper anywhere, which is at the tip in two of five, as often as both others.
LINEAR_DAMPING = ("damper", "alpha", "damper", "eta")
# What acts on a beam, sits on it or holds it.
MOUNTED = (
    "damper",
    "friction",
    "drag",
    "cubic",
    "stop",
    "magnet",
    "mass",
    "compliance",
    "spring_stiffness",
)
OF_A_SPRING = ("spring_stiffness", "pre_tension")


@dataclass(frozen=True)
class Mode:
    """The first mode of the beam about its rest, mass-normalised.

    Attributes
    ----------
    omega : float
        rad/s.
    x, shape, rest : (n,) arrays
        m; transverse, kg^-0.5; transverse displacement of the rest, m.
    bend : float
        Curvature of the shape at the left end, 1/m kg^-0.5.
    q : float
        Coordinate of the largest release, kg^0.5 m.
    """

    omega: float
    x: np.ndarray
    shape: np.ndarray
    rest: np.ndarray
    bend: float
    q: float

    def at(self, place: float) -> tuple[float, float, float]:
        """Shape, amplitude and rest at a place."""
        shape, rest = (float(np.interp(place, self.x, y)) for y in (self.shape, self.rest))
        return shape, abs(shape) * self.q, rest


def with_hidden(
    kind: str, truth: BeamTruth, mode: Mode, rng: np.random.Generator
) -> tuple[BeamTruth, dict[str, float]]:
    """The beam with one effect of medium size, and its values."""
    size, side = rng.uniform(0.7, 1.5), float(rng.choice([-1.0, 1.0]))
    if kind in AT_A_PLACE:
        place = _place(truth, rng)
        force = _AT_A_PLACE[kind](place, mode, size, side, rng)
        return replace(truth, forces=(force,)), {"place": place, **force.values}
    if kind == "drag":
        third = float(np.trapezoid(np.abs(mode.shape) ** 3, mode.x))
        c = DAMPING * size * 3 * np.pi / (4 * mode.q * third)
        return replace(truth, forces=(Force("drag", truth.length, {"coefficient": c}),)), {"c": c}
    if kind == "alpha":
        more = 2 * mode.omega * DAMPING * size
        return replace(truth, alpha=truth.alpha + more), {"change": more}
    if kind == "eta":
        more = 2 * DAMPING * size / mode.omega
        return replace(truth, eta=truth.eta + more), {"change": more}
    if kind == "compliance":
        EI = truth.young * truth.width * truth.thickness**3 / 12
        c = 2 * FREQUENCY * size * (mode.omega / (EI * mode.bend)) ** 2
        return replace(truth, compliance=c), {"compliance": c}
    if kind == "modulus":
        change = 1 + 4 * FREQUENCY * size * side
        return replace(truth, young=truth.young * change), {"factor": change}
    if kind in OF_A_SPRING and truth.spring is not None:
        s, factor = truth.spring, 1 + 0.05 * size * side
        changed = replace(s, stiffness=s.stiffness * factor)
        if kind == "pre_tension":
            changed = replace(s, tension=s.tension + 0.04 * size * side)
        # a stiffer spring keeps its natural length
        if kind == "spring_stiffness":
            changed = Spring(s.stiffness * factor, s.length, s.tension * factor)
        return replace(truth, spring=changed), {"factor": factor}
    return truth, {}  # of a sensor, or nothing


def _place(truth: BeamTruth, rng: np.random.Generator) -> float:
    """The tip of a cantilever in two of five cases, else where the mode moves enough."""
    if truth.supports == "cantilever":
        return truth.length * (1.0 if rng.random() < 0.4 else rng.uniform(0.45, 0.95))
    return truth.length * rng.uniform(0.25, 0.75)


def _damper(place, mode, size, side, rng):
    shape, _, _ = mode.at(place)
    return Force("damper", place, {"damping": 2 * mode.omega * DAMPING * size / shape**2})


def _friction(place, mode, size, side, rng):
    shape, y, _ = mode.at(place)
    force = DAMPING * size * y * mode.omega**2 * np.pi / (2 * shape**2)
    return Force("friction", place, {"force": force})


def _stiffness(law: Callable, place: float, mode: Mode, size: float) -> float:
    """Factor on a law (y) -> N at a place, for a shift of frequency that is asked for."""
    shape, y, _ = mode.at(place)
    shift = harmonic(lambda q, v, z: law(y * q))[0] * shape**2 / (y * mode.omega**2)
    return FREQUENCY * size / abs(shift)


def _stop(place, mode, size, side, rng):
    _, y, rest = mode.at(place)
    gap = rng.uniform(0.4, 0.75) * y
    k = _stiffness(lambda u: max(u - gap, 0.0), place, mode, size)
    far = 10.0
    low, high = (-far, rest + gap) if side > 0 else (rest - gap, far)
    return Force("stop", place, {"stiffness": k, "low": low, "high": high, "gap": side * gap})


def _gap(place, mode, size, side, rng):
    _, y, rest = mode.at(place)
    gap = rng.uniform(0.35, 0.7) * y
    k = _stiffness(lambda u: np.sign(u) * max(abs(u) - gap, 0.0), place, mode, size)
    values = {"stiffness": k, "low": rest - gap, "high": rest + gap, "gap": gap}
    return Force("stop", place, values)


def _cubic(place, mode, size, side, rng):
    return Force("cubic", place, {"stiffness": _stiffness(lambda u: u**3, place, mode, size)})


def _magnet(place, mode, size, side, rng):
    _, y, rest = mode.at(place)
    d, n = rng.uniform(1.4, 2.2) * y, rng.uniform(2.0, 4.0)
    law = lambda u: (d - side * u) ** -n - d**-n  # noqa: E731
    k = _stiffness(law, place, mode, size)
    values = {"strength": k, "exponent": n, "height": rest + side * d}
    return Force("magnet", place, values)


def _mass(place, mode, size, side, rng):
    shape, _, _ = mode.at(place)
    return Force("mass", place, {"mass": 2 * FREQUENCY * size / shape**2})


_AT_A_PLACE = {
    "damper": _damper,
    "friction": _friction,
    "stop": _stop,
    "gap": _gap,
    "cubic": _cubic,
    "magnet": _magnet,
    "mass": _mass,
}
