"""What a blind trial hides, and how strong it is: shares no code with the catalogue.

Everything is dimensionless: the largest release is 1, the linear frequency of the nominal
oscillator is 1, and time is counted in radians of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

FREQUENCY = {"weak": 0.001, "medium": 0.005, "strong": 0.02}  # relative shift
DAMPING = {"weak": 0.1, "medium": 0.3, "strong": 1.0}  # of the nominal ratio: .0005 to .005 of .005
READING = {"weak": 0.005, "medium": 0.015, "strong": 0.05}  # of the largest release
_SAMPLES, _CYCLES = 512, 4  # of the harmonic motion along which a force is measured


@dataclass
class Hidden:
    """One hidden effect, ready to integrate, with its truth.

    Attributes
    ----------
    force : (t, q, v, side, z) -> float
        Per unit mass, on the left side of the equation; ``side`` holds the signs of the switches.
    switches : list of (t, q, v) -> float
        Change sign where the force jumps or has a kink, so that the integration can stop there.
    mass, mass_slope : q -> float
        Added inertia and its derivative.
    reading : (t, q, record) -> array
        What the sensor shows.
    start : q -> list of float
        Inner states of a release from rest at q.
    rates : (t, q, v, z) -> list of float
    couple : (q, v, force, mass, z) -> (acceleration, list of float)
        For inner states that feel the acceleration, in the place of `rates`.
    time, longest : float
        Time constants: when a stiffness jumps (for `switches` in time), longest step.
    """

    name: str
    truth: dict
    force: Callable | None = None
    switches: list[Callable] = field(default_factory=list)
    mass: Callable | None = None
    mass_slope: Callable | None = None
    reading: Callable | None = None
    start: Callable = lambda q: []
    rates: Callable | None = None
    couple: Callable | None = None
    longest: float = math.inf


@dataclass(frozen=True)
class Setting:
    """What a hidden effect is drawn for.

    Attributes
    ----------
    strength : "weak", "medium" or "strong"
    zeta : float
        Nominal damping ratio.
    spans : list of (start, end)
        Of the records, rad; the last one may be held out.
    mains : float
        Frequency of the mains over that of the oscillator.
    rng : Generator
    """

    strength: str
    zeta: float
    spans: list[tuple[float, float]]
    mains: float
    rng: np.random.Generator

    @property
    def frequency(self) -> float:
        """Relative shift of frequency that is asked for."""
        return FREQUENCY[self.strength]

    @property
    def damping(self) -> float:
        """Damping ratio that is asked for."""
        return DAMPING[self.strength] * self.zeta

    @property
    def reading(self) -> float:
        """What the sensor is wrong by, of the largest release."""
        return READING[self.strength]

    @property
    def duration(self) -> float:
        """From the start of the first record to the end of the last, rad."""
        return self.spans[-1][1] - self.spans[0][0]

    def sign(self) -> float:
        """One or minus one."""
        return float(self.rng.choice([-1.0, 1.0]))

    def phases(self) -> np.ndarray:
        """One for each record."""
        return self.rng.uniform(0, 2 * np.pi, len(self.spans))

    def strength_of(self, shift: float, ratio: float) -> float:
        """Factor on a force of a given shift and damping ratio: the larger reaches its target."""
        return 1 / max(abs(shift) / self.frequency, abs(ratio) / self.damping)


def harmonic(force: Callable, rates: Callable | None = None, start: int = 0) -> tuple[float, float]:
    """Relative shift of frequency and damping ratio by a force (q, v, z) along cos t.

    Inner states, ``start`` in number and at rest at first, are followed by midpoint steps until
    they repeat; the last cycle counts.
    """
    phi = (np.arange(_CYCLES * _SAMPLES if rates else _SAMPLES) + 0.5) * 2 * np.pi / _SAMPLES
    step = phi[1] - phi[0]
    z = np.zeros(start)
    values = []
    for p in phi:
        q, v = math.cos(p), -math.sin(p)
        values.append(force(q, v, z))
        if rates is not None:
            middle = math.cos(p + step / 2), -math.sin(p + step / 2)
            half = z + 0.5 * step * np.asarray(rates(q, v, z))
            z = z + step * np.asarray(rates(*middle, half))
    last = np.array(values[-_SAMPLES:])
    last_phi = phi[-_SAMPLES:]
    return float(np.mean(last * np.cos(last_phi))), float(-np.mean(last * np.sin(last_phi)))


def power(x: float, p: float) -> float:
    """Return x to the power p with its sign kept."""
    return math.copysign(abs(x) ** p, x)
