"""The terms an equation of motion is made of.

Every model of this package is a sum of terms, each with its coefficient::

    M(q) q_ddot + N(q) q_dot^2 + K(q) + D(q, q_dot) = 0,      M(0) = 1

A `Term` says what it adds to inertia M, convection N, stiffness K and damping D. From these four
follow the strong form, energies and simulation; the weak form is stated beside them.

Notation as in [1], eqs. (8), (14)-(17).

[1] M. W. Ahmadi, T. L. Hill, J. Z. Jiang, S. A. Neild, "Reduced-order modelling-inspired system
    identification of geometrically nonlinear structures", Nonlinear Dynamics (2023),
    doi:10.1007/s11071-023-08813-z.
"""

from __future__ import annotations

import difflib
import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

Scalars = Any  # float or array: every method of a term takes both

DAMPING_KINDS = ("linear", "quadratic", "coulomb", "cubic", "q^2 q_dot")


class WeakForm(NamedTuple):
    """A term written as d^2(second)/dt^2 + d(first)/dt + zeroth; None stands for zero.

    ``second_rate`` is d(second)/dt, which the boundary terms of the integration by parts need.
    """

    second: Scalars = None
    second_rate: Scalars = None
    first: Scalars = None
    zeroth: Scalars = None


class Term(ABC):
    """One candidate term. Subclass it, state what it adds, and every library can use it.

    A subclass overrides those of `inertia`, `convection`, `stiffness` (with `potential`) and
    `damping` that are not zero, and their derivatives ``*_dq`` and ``*_dq_dot``. All take floats
    or arrays, in the unit of q and seconds.
    """

    @property
    @abstractmethod
    def key(self) -> str:
        """Name of the coefficient, such as ``"Upsilon_3"``."""

    @property
    @abstractmethod
    def dimension(self) -> tuple[int, int]:
        """Powers of (unit of q, second) that the term carries without its coefficient."""

    @abstractmethod
    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        """Text of the term without its coefficient."""

    def inertia(self, q: Scalars) -> Scalars:
        """What multiplies q_ddot."""
        return 0.0

    def convection(self, q: Scalars) -> Scalars:
        """What multiplies q_dot^2."""
        return 0.0

    def stiffness(self, q: Scalars) -> Scalars:
        """Force that depends on q alone."""
        return 0.0

    def potential(self, q: Scalars) -> Scalars:
        """Integral of the stiffness force from 0 to q."""
        return 0.0

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        """Force that depends on the velocity and does work."""
        return 0.0

    def inertia_dq(self, q: Scalars) -> Scalars:
        """Derivative of `inertia`."""
        return 0.0

    def convection_dq(self, q: Scalars) -> Scalars:
        """Derivative of `convection`."""
        return 0.0

    def stiffness_dq(self, q: Scalars) -> Scalars:
        """Derivative of `stiffness`."""
        return 0.0

    def damping_dq(self, q: Scalars, q_dot: Scalars) -> Scalars:
        """Derivative of `damping` with respect to q."""
        return 0.0

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        """Derivative of `damping` with respect to q_dot."""
        return 0.0

    def strong(self, q: Scalars, q_dot: Scalars, q_ddot: Scalars) -> Scalars:
        """Value of the term, shape of q."""
        return (
            self.inertia(q) * q_ddot
            + self.convection(q) * q_dot * q_dot
            + self.stiffness(q)
            + self.damping(q, q_dot)
        )

    @abstractmethod
    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        """Integrate the term by parts: no acceleration is needed."""

    @property
    def conservative_inertia(self) -> bool:
        """Whether convection is half the derivative of inertia, so that energy is M q_dot^2/2."""
        return True

    @property
    def smooth(self) -> bool:
        """False where the force jumps, as dry friction does when the motion reverses."""
        return True

    def has(self, part: str) -> bool:
        """Whether the term adds to a part, such as ``"damping"``: most add to one or two."""
        return getattr(type(self), part) is not getattr(Term, part)

    def regularised(self, velocity_scale: float) -> Term:
        """Smooth term in place of one that jumps, equal to it well above ``velocity_scale``."""
        return self

    def unit(self, unit: str | None) -> str:
        """Unit of the coefficient when q is measured in ``unit`` (None: not known)."""
        length, time = self.dimension
        return _unit_text({unit or "[q]": 1 - length, "s": -2 - time})


def _unit_text(powers: dict[str, int]) -> str:
    above = [_power(unit, p) for unit, p in powers.items() if p > 0]
    below = [_power(unit, -p) for unit, p in powers.items() if p < 0]
    if not below:
        return " ".join(above) or "1"
    text = " ".join(below)
    return f"{' '.join(above) or '1'}/{f'({text})' if len(below) > 1 else text}"


def _power(name: str, power: float) -> str:
    """Text of name^power; products in brackets, and nothing where the power is 0."""
    if power == 0:
        return ""
    base = f"({name})" if " " in name else name
    return base if power == 1 else f"{base}^{power:.4g}"


def _product(*factors: str) -> str:
    return " ".join(f for f in factors if f)


@dataclass(frozen=True)
class Stiffness(Term):
    """Restoring force q^degree: omega^2 for degree 1, gamma_m beyond.

    Raises
    ------
    ValueError
        If the degree is below 1.
    """

    degree: int

    def __post_init__(self) -> None:
        _check_order("degree", self.degree, 1)

    @property
    def key(self) -> str:
        return "omega^2" if self.degree == 1 else f"gamma_{self.degree}"

    @property
    def dimension(self) -> tuple[int, int]:
        return self.degree, 0

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return _power(q, self.degree)

    def stiffness(self, q: Scalars) -> Scalars:
        return _integer_power(q, self.degree)

    def potential(self, q: Scalars) -> Scalars:
        return _integer_power(q, self.degree + 1) / (self.degree + 1)

    def stiffness_dq(self, q: Scalars) -> Scalars:
        return _power_slope(q, self.degree)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(zeroth=self.stiffness(q))


@dataclass(frozen=True)
class Inertia(Term):
    """Inertial compensation s (q^(k-1) q_ddot + (k-1)/2 q^(k-2) q_dot^2) of order k ([1], eq. 17).

    s = 2 for even k, so that the coefficient is the paper's Upsilon_k. The kinetic energy behind
    it is s q^(k-1) q_dot^2 / 2.

    Raises
    ------
    ValueError
        If the order is below 2.
    """

    order: int

    def __post_init__(self) -> None:
        _check_order("order", self.order, 2)

    @property
    def key(self) -> str:
        return f"Upsilon_{self.order}"

    @property
    def dimension(self) -> tuple[int, int]:
        return self.order, -2

    @property
    def _scale(self) -> int:
        return 1 + (self.order % 2 == 0)

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        k, s = self.order, self._scale
        convection = s * (k - 1) // 2
        first = _product("2" if s == 2 else "", _power(q, k - 1), q_ddot)
        second = _product(
            str(convection) if convection > 1 else "", _power(q, k - 2), _power(q_dot, 2)
        )
        return f"({first} + {second})"

    def inertia(self, q: Scalars) -> Scalars:
        return self._scale * _integer_power(q, self.order - 1)

    def convection(self, q: Scalars) -> Scalars:
        return self._scale * (self.order - 1) / 2 * _integer_power(q, self.order - 2)

    def inertia_dq(self, q: Scalars) -> Scalars:
        return self._scale * _power_slope(q, self.order - 1)

    def convection_dq(self, q: Scalars) -> Scalars:
        return self._scale * (self.order - 1) / 2 * _power_slope(q, self.order - 2)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        inertia = self.inertia(q)
        return WeakForm(
            second=inertia * q / self.order,
            second_rate=inertia * q_dot,
            zeroth=-self.convection(q) * q_dot * q_dot,
        )


@dataclass(frozen=True)
class QuadraticInertia(Term):
    """q^2 q_ddot alone, as the cantilever model from the literature has it ([1], eq. 8)."""

    key = "beta_1"
    dimension = (3, -2)
    conservative_inertia = False

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"{_power(q, 2)} {q_ddot}"

    def inertia(self, q: Scalars) -> Scalars:
        return q * q

    def inertia_dq(self, q: Scalars) -> Scalars:
        return 2 * q

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(
            second=q * q * q / 3, second_rate=q * q * q_dot, zeroth=-2 * q * q_dot * q_dot
        )


@dataclass(frozen=True)
class LinearConvection(Term):
    """q q_dot^2 alone, the partner of `QuadraticInertia` ([1], eq. 8)."""

    key = "beta_2"
    dimension = (3, -2)
    conservative_inertia = False

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"{q} {_power(q_dot, 2)}"

    def convection(self, q: Scalars) -> Scalars:
        return q

    def convection_dq(self, q: Scalars) -> Scalars:
        return _power_slope(q, 1)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(zeroth=q * q_dot * q_dot)


@dataclass(frozen=True)
class LinearDamping(Term):
    """Viscous damping q_dot."""

    key = "c_linear"
    dimension = (1, -1)

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return q_dot

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return q_dot

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return _power_slope(q_dot, 1)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(first=q)


@dataclass(frozen=True)
class QuadraticDamping(Term):
    """Drag |q_dot| q_dot."""

    key = "c_quadratic"
    dimension = (2, -2)

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"|{q_dot}| {q_dot}"

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return abs(q_dot) * q_dot

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return 2 * abs(q_dot)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(zeroth=self.damping(q, q_dot))


@dataclass(frozen=True)
class CoulombDamping(Term):
    """Dry friction sign(q_dot)."""

    key = "c_coulomb"
    dimension = (0, 0)
    smooth = False

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"sign({q_dot})"

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return np.sign(q_dot)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(zeroth=self.damping(q, q_dot))

    def regularised(self, velocity_scale: float) -> RegularisedCoulomb:
        return RegularisedCoulomb(velocity_scale)


@dataclass(frozen=True)
class RegularisedCoulomb(Term):
    """Dry friction without its jump, tanh(q_dot / velocity_scale): viscous creep where it sticks.

    It shares the coefficient, and the key, of `CoulombDamping`.

    Raises
    ------
    ValueError
        If the velocity scale (unit of q per second) is not positive.
    """

    velocity_scale: float

    key = "c_coulomb"
    dimension = (0, 0)

    def __post_init__(self) -> None:
        if not self.velocity_scale > 0:
            raise ValueError(f"velocity_scale = {self.velocity_scale!r} must be positive")

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"tanh({q_dot}/{self.velocity_scale:g})"

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return np.tanh(q_dot / self.velocity_scale)

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return (1 - np.tanh(q_dot / self.velocity_scale) ** 2) / self.velocity_scale

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(zeroth=self.damping(q, q_dot))


@dataclass(frozen=True)
class CubicDamping(Term):
    """q_dot^3."""

    key = "c_cubic"
    dimension = (3, -3)

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return _power(q_dot, 3)

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return q_dot * q_dot * q_dot

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return 3 * q_dot * q_dot

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(zeroth=self.damping(q, q_dot))


@dataclass(frozen=True)
class AmplitudeDamping(Term):
    """q^2 q_dot, damping that grows with the displacement."""

    key = "c_q^2 q_dot"
    dimension = (3, -1)

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"{_power(q, 2)} {q_dot}"

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return q * q * q_dot

    def damping_dq(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return 2 * q * q_dot

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return q * q

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(first=q * q * q / 3)


_DAMPING: dict[str, Callable[[], Term]] = dict(
    zip(
        DAMPING_KINDS,
        (LinearDamping, QuadraticDamping, CoulombDamping, CubicDamping, AmplitudeDamping),
        strict=True,
    )
)
_NAMED: dict[str, Callable[[], Term]] = {
    **{f"c_{kind}": term for kind, term in _DAMPING.items()},
    "omega^2": lambda: Stiffness(1),
    "beta_1": QuadraticInertia,
    "beta_2": LinearConvection,
}


def damping_term(kind: str) -> Term:
    """Return the damping term of a kind: one of `DAMPING_KINDS`.

    Raises
    ------
    ValueError
        If the kind is none of them.
    """
    if kind not in _DAMPING:
        raise ValueError(f"damping kind {kind!r} is not known: use one of {list(DAMPING_KINDS)}")
    return _DAMPING[kind]()


def term_from_key(key: str) -> Term:
    """Return the term whose coefficient is called ``key``.

    Raises
    ------
    ValueError
        If no term has this key; the message names the keys there are and the nearest one.
    """
    if key in _NAMED:
        return _NAMED[key]()
    match = re.fullmatch(r"(gamma|Upsilon)_(\d+)", key)
    if match and int(match[2]) >= 2:
        return Stiffness(int(match[2])) if match[1] == "gamma" else Inertia(int(match[2]))
    near = difflib.get_close_matches(key, [*_NAMED, "gamma_2", "gamma_3", "Upsilon_3"], n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    known = ", ".join(_NAMED)
    raise ValueError(
        f"coefficient name {key!r} is not known: use {known}, gamma_m or Upsilon_k"
        f" (m, k >= 2){hint}"
    )


def _integer_power(q: Scalars, power: int) -> Scalars:
    # Repeated products: several times faster than ** on arrays, and exact for floats alike.
    result = q if power else np.ones_like(q) if isinstance(q, np.ndarray) else 1.0
    for _ in range(power - 1):
        result = result * q
    return result


def _power_slope(q: Scalars, power: int) -> Scalars:
    """Derivative of q^power."""
    return power * _integer_power(q, max(power - 1, 0))


def _check_order(name: str, value: int, least: int) -> None:
    if isinstance(value, bool) or int(value) != value or value < least:
        raise ValueError(f"{name} = {value!r} must be a whole number of at least {least}")
