"""An equation of motion whose functions are series: stiffness, inertia and damping.

With z = q / reach on [-1, 1] and Chebyshev polynomials T_i::

    K(q) / q = rate^2 sum_i k_i T_i(z)                     stiffness
    h(q)     = z^2 sum_i r_i T_i(z)                        inertia, M = 1 + h
    D(q)     = decay (c (1 + h) + z sum_i d_i T_i(z))      damping force D(q) q_dot

Damping proportional to mass follows the inertia: alpha (1 + h). What the material adds,
eta S(q) with S the rates of strain along the motion, is a smooth function of q in the rest.
Orthogonal polynomials on the range of the data keep high orders well conditioned; Taylor
coefficients are read off them (`Series.taylor`).

A sensor shows y = x + e x^2 / x_max + offset of the quantity x that it measures. A curvature e is
no inertia and no stiffness, but makes a second harmonic as these do: it is fitted beside them, with
what is expected of such a sensor as its prior. A cube is not tried: of one coordinate q read as y =
r(q) nothing tells (dq/dy)^2 - 1 from inertia (`curvature_for`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from romsindy.fit.kernel.linear_steps import Linearisation
from romsindy.fit.verdict import EQUIVALENT
from romsindy.physics.damping import PositionDamping, PowerDamping
from romsindy.physics.inertia import Inertia
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.physics.validation import made, several, whole
from romsindy.typing import Array

_OFFSET = 0.1  # of the largest reading: no record is so far off its zero
_SMOOTHING = 0.01  # of dry friction, as a part of the largest speed
_STIFFNESS = {True: "stiffness polynomial", False: "linear"}


class SensorCurvature(NamedTuple):
    """What is not known of the sensor."""

    # Standard deviation of e: what the sensor is expected to be off a straight line at the largest
    # amplitude, as a part of that; 0 of one that is straight
    curvature: float
    n_records: int  # each has an offset of its own

    @property
    def size(self) -> int:
        """Number of its values: e, then the offset of each record."""
        return 1 + self.n_records

    @property
    def spread(self) -> list[float]:
        """Standard deviations of its values."""
        return [self.curvature, *[_OFFSET] * self.n_records]

    def shown(self, values: Array, x: Array, largest: float, record: int) -> tuple[Array, Array]:
        """What it shows of a motion x (n,), and the slope of that, (n,)."""
        e, offset = values[0], values[1 + record]
        return x + e * x * x / largest + offset * largest, 1 + 2 * e * x / largest

    def by_value(self, x: Array, largest: float, record: int) -> Array:
        """Derivatives of what is shown by its values, (n, size)."""
        slopes = np.zeros((len(x), self.size))
        slopes[:, 0], slopes[:, 1 + record] = x * x / largest, largest
        return slopes


STRAIGHT = SensorCurvature(0.0, 1)


def curvature_for(q: Array, h: Array) -> float:
    """How much less than q a sensor must show at the end of a range to look like inertia h there.

    q and h (n,) go from 0 to the end. As a part of the last q: a straight sensor of an oscillator
    without inertia shows int sqrt(1 + h) dq where this one shows q.
    """
    straight = np.trapezoid(np.sqrt(1 + h), q)
    return float((straight - q[-1]) / straight)


class Sizes(NamedTuple):
    """Number of terms of each series; 0 leaves inertia or the change of damping out."""

    stiffness: int
    inertia: int
    damping: int


class Magnitudes(NamedTuple):
    """What makes values of order one: largest |q|, angular frequency and decay rate, 1/s."""

    reach: float
    rate: float
    decay: float


@dataclass(frozen=True, eq=False)
class Series:
    """Equation of one coordinate with series for its functions; see above."""

    scales: Magnitudes
    sizes: Sizes
    forces: tuple[Term, ...]  # further damping, such as dry friction, which `near` makes smooth
    # (n,), k, then r, then c, then d, then strengths of the forces, all of order one; at last those
    # of the sensor, which are no part of the equation
    values: Array
    sensor: SensorCurvature  # through which its motions are seen

    @classmethod
    def linear(
        cls,
        scales: Magnitudes,
        sizes: Sizes,
        forces: Sequence[Term] = (),
        sensor: SensorCurvature = STRAIGHT,
    ) -> Series:
        """A linear oscillator, from which fits start."""
        values = np.zeros(sum(sizes) + 1 + len(forces) + sensor.size)
        values[0] = values[sizes.stiffness + sizes.inertia] = 1.0
        return cls(scales, sizes, tuple(forces), values, sensor)

    def moved(self, values: Array) -> Series:
        """The same with other values."""
        return replace(self, values=values)

    def split(self, values: Array) -> list[Array]:
        """Values (..., n) as k, r, c, d, strengths of forces and those of the sensor."""
        n_k, n_r, n_d = self.sizes
        return np.split(values, np.cumsum([n_k, n_r, 1, n_d, len(self.forces)]), axis=-1)

    def narrowed(self, sizes: Sizes) -> Series:
        """The same with fewer terms of some series."""
        k, r, c, d, *others = self.split(self.values)
        k, r, d = (x[:n] for x, n in zip((k, r, d), sizes, strict=True))
        return replace(self, sizes=sizes, values=np.concatenate([k, r, c, d, *others]))

    def widened(self, forces: Sequence[Term]) -> Series:
        """The same with further forces, without strength."""
        *equation, sensor = self.split(self.values)
        values = np.concatenate([*equation, np.zeros(len(forces)), sensor])
        return replace(self, forces=(*self.forces, *forces), values=values)

    def near(self, amplitude: float) -> Series:
        """The same for motions of an amplitude: friction turns round smoothly at their speeds.

        At a smoothness for the largest, quiet motions would see less friction than there is.
        """
        speed = _SMOOTHING * amplitude * self.scales.rate
        smooth = tuple(f if f.smooth else f.regularised(speed) for f in self.forces)
        return self if smooth == self.forces else replace(self, forces=smooth)

    @cached_property
    def _functions(self) -> tuple[Array, Array]:
        """Chebyshev coefficients over z of K, K', h, h', h'', D and D', as columns, and scales."""
        (reach, rate, decay), (k, r, c, d, *_) = self.scales, self.split(self.values)
        stiffness = rate**2 * reach * chebyshev.chebmul(k, [0, 1])
        inertia = chebyshev.chebmul(r, [0.5, 0, 0.5]) if len(r) else np.zeros(1)
        follows = chebyshev.chebadd(c * inertia, c)
        rest = chebyshev.chebmul(d, [0, 1]) if len(d) else np.zeros(1)
        damping = decay * chebyshev.chebadd(follows, rest)
        functions = ((stiffness, 2), (inertia, 3), (damping, 2))
        several = [chebyshev.chebder(c, i) for c, n in functions for i in range(n)]
        table = np.zeros((max(map(len, several)), 7))
        for column, c in zip(table.T, several, strict=True):
            column[: len(c)] = c
        return table, reach ** np.array([[0], [1], [0], [1], [2], [0], [1]])

    @cached_property
    def _unit_forces(self) -> list[float]:
        """Strength that makes each force as large as the viscous one at the largest speed."""
        reach, rate, decay = self.scales
        fastest = np.array([reach * rate])
        return [
            decay * fastest[0] / abs(float(f.damping(0 * fastest, fastest)[0])) for f in self.forces
        ]

    def linearise(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Linearisation:
        """Residual (n, 1) and its derivatives (n, 1, 1)."""
        q, v, a = q[:, 0], q_dot[:, 0], q_ddot[:, 0]
        table, scales = self._functions
        every = chebyshev.chebval(q / self.scales.reach, table) / scales
        stiffness, slope, inertia, gradient, curvature, d, by_place = every
        mass, convection = 1 + inertia, gradient / 2
        residual = mass * a + convection * v * v + stiffness + d * v
        by_q = 2 * convection * a + curvature / 2 * v * v + slope + by_place * v
        by_v = 2 * convection * v + d
        strengths = self.split(self.values)[4] * self._unit_forces
        for force, strength in zip(self.forces, strengths, strict=True):
            residual += strength * force.damping(q, v)
            by_q += strength * force.damping_dq(q, v)
            by_v += strength * force.damping_dq_dot(q, v)
        return Linearisation(residual[:, None], *(x[:, None, None] for x in (by_q, by_v, mass)))

    def by_parameter(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        """Derivatives of the residual by all values, (m, n, 1)."""
        q, v, a = q[:, 0], q_dot[:, 0], q_ddot[:, 0]
        (reach, rate, decay), (n_k, n_r, n_d) = self.scales, self.sizes
        z = q / reach
        polynomials, slopes = _polynomials(z, max(*self.sizes, 2))
        c = self.split(self.values)[2]
        t_r, dt_r = polynomials[:n_r], slopes[:n_r]
        inertia = z * z * (t_r * (a + decay * c * v)) + (2 * z * t_r + z * z * dt_r) * (
            v * v / (2 * reach)
        )
        mass = 1 + chebyshev.chebval(z, self._functions[0][:, 2])
        rows = [
            rate**2 * q * polynomials[:n_k],
            inertia,
            decay * (mass * v)[None],
            decay * z * v * polynomials[:n_d],
        ]
        for force, unit in zip(self.forces, self._unit_forces, strict=True):
            rows.append(unit * np.asarray(force.damping(q, v))[None])
        rows.append(np.zeros((self.sensor.size, len(q))))  # it sees the motion, and leaves it alone
        return np.concatenate(rows)[..., None]

    # -- as the sensor shows it -----------------------------------------------------------------

    def shown(self, x: Array, derivative: int, record: int) -> tuple[Array, Array]:
        """What the sensor of a record shows of x = q, q_dot or q_ddot, and its slope; (n,) each."""
        values = self.split(self.values)[5]
        return self.sensor.shown(values, x, self._largest(derivative), record)

    def shown_by_value(self, x: Array, derivative: int, record: int) -> Array:
        """Derivatives of what is shown by all values as far as they are the sensor's, (n, m)."""
        slopes = np.zeros((len(x), len(self.values)))
        largest = self._largest(derivative)
        slopes[:, -self.sensor.size :] = self.sensor.by_value(x, largest, record)
        return slopes

    def _largest(self, derivative: int) -> float:
        return self.scales.reach * self.scales.rate**derivative

    # -- as an equation of ordinary terms -----------------------------------------------------

    def terms(self) -> tuple[Term, ...]:
        """The terms of which `taylor` gives the coefficients."""
        n_k, n_r, n_d = self.sizes
        highest = max(n_r + 1 if n_r else 0, n_d)
        return (
            *(Stiffness(i) for i in range(1, n_k + 1)),
            *(Inertia(i) for i in range(3, n_r + 3)),
            PowerDamping(1),
            *(PositionDamping(i) for i in range(1, highest + 1)),
            *self.forces,
        )

    def taylor(self, values: Array) -> Array:
        """Coefficients of `terms`, (n_sets, n_terms), of sets of values, (n_sets, n)."""
        reach, rate, decay = self.scales
        k, r, c, d, forces, _ = self.split(np.atleast_2d(values))
        stiffness = rate**2 * k @ _to_powers(self.sizes.stiffness)
        inertia = r @ _to_powers(self.sizes.inertia)  # of h / z^2
        highest = max(inertia.shape[1] + 1 if inertia.shape[1] else 0, d.shape[1])
        damping = np.zeros((len(k), highest + 1))
        damping[:, :1] += c
        damping[:, 2 : 2 + inertia.shape[1]] += c * inertia
        damping[:, 1 : 1 + d.shape[1]] += d @ _to_powers(self.sizes.damping)

        def per_power(x: Array, first: int) -> Array:
            return x / reach ** np.arange(first, first + x.shape[1])

        orders = np.arange(3, self.sizes.inertia + 3)
        doubled = 1 + (orders % 2 == 0)  # the paper's 2 Upsilon_4, see `Inertia`
        return np.concatenate(
            [
                per_power(stiffness, 0),
                per_power(inertia, 2) / doubled,
                decay * per_power(damping, 0),
                forces * self._unit_forces,
            ],
            axis=1,
        )


def _polynomials(z: Array, n: int) -> tuple[Array, Array]:
    """T_0 .. T_(n-1) and their derivatives at z, (n, len(z)) each."""
    values = chebyshev.chebvander(z, n - 1).T
    second = np.ones_like(values)  # of the second kind: T_i' = i U_(i-1)
    second[1] = 2 * z
    for i in range(2, n):
        second[i] = 2 * z * second[i - 1] - second[i - 2]
    slopes = np.zeros_like(values)
    slopes[1:] = np.arange(1, n)[:, None] * second[:-1]
    return values, slopes


def _to_powers(n: int) -> Array:
    """Row i has the powers of z in T_i, (n, n)."""
    rows = np.zeros((n, n))
    for i in range(n):
        rows[i, : i + 1] = chebyshev.cheb2poly(np.eye(n)[i])[: i + 1]
    return rows


# So many polynomials resolve features down to a tenth of the range; the prior decides how many
# count. The inertia is smoother than the stiffness, of which it is a sum of squared slopes.
RICHEST = Sizes(stiffness=17, inertia=11, damping=8)


@dataclass(frozen=True)
class ModelStructure:
    """Which functions an equation has, and what the data say of it."""

    sizes: Sizes
    forces: tuple[str, ...] = ()  # names of further damping forces
    log_evidence: float = 0.0  # over that of the best structure, 0 or less

    @classmethod
    def from_content(cls, name: str, value: Any) -> ModelStructure:
        """Read what `dataclasses.asdict` wrote, after JSON, from where messages say it stands."""
        return made(cls, name, value, {"Sizes": _sizes})

    @property
    def name(self) -> str:
        """ "linear", "stiffness polynomial" or "IC-ROM"."""
        return "IC-ROM" if self.sizes.inertia else _STIFFNESS[self.sizes.stiffness > 1]

    @property
    def damping(self) -> str:
        """What its damping is."""
        follows = " that follows the inertia" if self.sizes.inertia else ""
        kind = "damping a function of q" if self.sizes.damping else f"linear damping{follows}"
        return ", ".join([kind, *self.forces])

    @property
    def equivalent(self) -> bool:
        """Whether the data cannot tell it from the best."""
        return -2 * self.log_evidence <= EQUIVALENT

    def __str__(self) -> str:
        return f"{self.name}, {self.damping}"


def _sizes(name: str, value: Any) -> Sizes:
    sizes = several(whole)(name, value)
    if len(sizes) != 3 or min(sizes) < 0:
        raise ValueError(f"{name} = {list(sizes)!r:.60} must be three numbers of at least 0")
    return Sizes(*sizes)


def simpler(series: Series) -> list[Series]:
    """The same equation with fewer functions, from all but the whole down to a linear one."""
    whole = series.sizes
    sizes = [
        Sizes(stiffness, inertia, damping)
        for stiffness, inertia in ((whole.stiffness, whole.inertia), (whole.stiffness, 0), (1, 0))
        for damping in (whole.damping, 0)
    ]
    return [series.narrowed(s) for s in sizes[1:]]


def contains(more: Sizes, less: Sizes) -> bool:
    """Whether one structure has all functions of another."""
    return all(a >= b for a, b in zip(more, less, strict=True))


def compared(structures: Sequence[ModelStructure]) -> tuple[ModelStructure, ...]:
    """The same with their evidence over that of the best."""
    best = max(s.log_evidence for s in structures)
    return tuple(replace(s, log_evidence=s.log_evidence - best) for s in structures)
