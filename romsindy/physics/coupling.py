"""Laws of several coordinates q1 ... qR: along a direction, or shared by two of them.

R equations of motion follow from a potential V, a kinetic energy T and a damping matrix C ([1])::

    V(q),   T = q_dot^T M(q) q_dot / 2,   M_ij q_j_ddot + G_ijk q_j_dot q_k_dot + dV/dq_i
            + C_ij(q) q_j_dot = 0,   G_ijk = (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) / 2

A law of one coordinate acts along a direction w, on d = w^T q: its force on q_i is w_i times the
force on d (`Along`). What couples coordinates beyond that are powers of them in V and C, and the
kinetic energy of fast modes that follow several of them. Each has one coefficient, which stands in
several equations: reciprocity is built in.

[1] E. Nicolaidou, T. L. Hill, S. A. Neild, "Indirect reduced-order modelling: using nonlinear
    manifolds to conserve kinetic energy", Proc. R. Soc. A 476 (2020), doi 10.1098/rspa.2020.0589.
"""

from __future__ import annotations

import re
from abc import abstractmethod
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np

from romsindy.physics.term import Scalars, Term, WeakForm, exact, law_called, power_of, power_text
from romsindy.typing import Array

Powers = tuple[int, ...]

_POWER = r"q([1-9]\d*)(?:\^([1-9]\d*))?"
_POWERS = rf"{_POWER}(?: {_POWER})*"


class Monomial(NamedTuple):
    """factor q^powers times velocities and an acceleration, in one equation.

    Coordinates and equations count from 0; ``rates`` are those of the velocities, ``second`` is
    that of the acceleration, None where there is none.
    """

    equation: int
    factor: float
    powers: Powers
    rates: tuple[int, ...] = ()
    second: int | None = None


class CoupledTerm(Term):
    """A law in the equations of several coordinates."""

    @property
    @abstractmethod
    def n_coordinates(self) -> int:
        """The last of the coordinates that it knows."""

    @abstractmethod
    def expressions(self, names: Names) -> dict[int, tuple[float, str]]:
        """A factor and text, without the coefficient, in each equation where the term stands."""

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        """Text in all of its equations."""
        found = self.expressions(Names()).values()
        return ", ".join(text if f == 1 else f"{exact(f)} {text}" for f, text in found)

    @abstractmethod
    def strong(self, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        """Value of the term in every equation, (..., R), from (..., R) each."""

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        """Refused with a TypeError: windows of coupled motion are not integrated by parts."""
        raise TypeError(f"{self.key} is a law of several coordinates: it has no weak form")


class Names(NamedTuple):
    """How coordinates, velocities, accelerations are written; ``{}`` stands for the number."""

    q: str = "q{}"
    q_dot: str = "q{}_dot"
    q_ddot: str = "q{}_ddot"

    def powers(self, powers: Powers) -> str:
        """Text of a product of powers of coordinates."""
        named = [power_text(self.q.format(i + 1), p) for i, p in enumerate(powers)]
        return " ".join(filter(None, named))

    def monomial(self, m: Monomial) -> str:
        """Text of a monomial without its factor."""
        parts = [self.powers(m.powers)]
        parts += [
            power_text(self.q_dot.format(j + 1), m.rates.count(j)) for j in sorted({*m.rates})
        ]
        parts.append("" if m.second is None else self.q_ddot.format(m.second + 1))
        return " ".join(filter(None, parts)) or "1"


@dataclass(frozen=True)
class Along(CoupledTerm):
    """A law of one coordinate along a direction: on q2 by itself, or on q1 - q2.

    Parameters
    ----------
    law : Term
    weights : tuple of float
        Of the coordinates in the direction, those at the end that are zero left out.

    Raises
    ------
    ValueError
        If all weights are zero, or the law is one of several coordinates.
    """

    law: Term
    weights: tuple[float, ...]

    def __post_init__(self) -> None:
        if isinstance(self.law, CoupledTerm):
            raise ValueError(f"law = {self.law.key} has a direction already: give its own law")
        object.__setattr__(self, "weights", _trimmed(self.weights))
        if not self.weights:
            raise ValueError("weights are all zero: a direction needs one that is not")

    @classmethod
    def coordinate(cls, law: Term, number: int) -> Along:
        """The law on one coordinate, counted from 1."""
        return cls(law, (0.0,) * (number - 1) + (1.0,))

    @property
    def n_coordinates(self) -> int:
        return len(self.weights)

    @property
    def key(self) -> str:
        return f"{self.law.key} [{self._direction('q{}')}]"

    @classmethod
    def from_key(cls, key: str) -> Along | None:
        match = re.fullmatch(r"(.+) \[(.+)\]", key)
        weights = _weights(match[2]) if match else None
        law = law_called(match[1]) if match else None
        return cls(law, weights) if law and weights else None

    @property
    def dimension(self) -> tuple[float, float]:
        return self.law.dimension

    def unit(self, unit: str | None) -> str:
        return self.law.unit(unit)

    def _direction(self, name: str) -> str:
        text = ""
        for i, w in enumerate(self.weights):
            if w:
                size = "" if abs(w) == 1 else f"{exact(abs(w))} "
                sign = (" - " if w < 0 else " + ") if text else ("-" if w < 0 else "")
                text += f"{sign}{size}{name.format(i + 1)}"
        return text

    def expressions(self, names: Names) -> dict[int, tuple[float, str]]:
        alone = sum(w != 0 for w in self.weights) == 1 and 1.0 in self.weights
        along = [self._direction(name) for name in names]
        text = self.law.expression(*(a if alone else f"({a})" for a in along))
        return {i: (w, text) for i, w in enumerate(self.weights) if w}

    def strong(self, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        n = self.n_coordinates
        along = (x[..., :n] @ np.array(self.weights) for x in (q, q_dot, q_ddot))
        value = np.zeros_like(q)
        value[..., :n] = np.asarray(self.law.strong(*along))[..., None] * self.weights
        return value

    def has(self, part: str) -> bool:
        return self.law.has(part)

    @property
    def conservative_inertia(self) -> bool:
        return self.law.conservative_inertia

    @property
    def smooth(self) -> bool:
        return self.law.smooth

    @property
    def least(self) -> float:
        return self.law.least

    def undamped(self) -> Along | None:
        law = self.law.undamped()
        return None if law is None else replace(self, law=law)

    def regularised(self, velocity_scale: float) -> Along:
        return replace(self, law=self.law.regularised(velocity_scale))


class PolynomialTerm(CoupledTerm):
    """A law that is a sum of products of coordinates, velocities and accelerations."""

    @abstractmethod
    def monomials(self) -> list[Monomial]:
        """What it adds to the equations."""

    def strong(self, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        value = np.zeros_like(q)
        for m in self.monomials():
            factors = [power_of(q[..., i], p) for i, p in enumerate(m.powers) if p]
            factors += [q_dot[..., j] for j in m.rates]
            factors += [] if m.second is None else [q_ddot[..., m.second]]
            value[..., m.equation] += m.factor * np.prod(factors, axis=0)
        return value

    def expressions(self, names: Names) -> dict[int, tuple[float, str]]:
        found = {}
        for i in range(self.n_coordinates):
            own = [m for m in self.monomials() if m.equation == i]
            if own:
                first = own[0].factor
                text = names.monomial(own[0])
                for m in own[1:]:
                    share = m.factor / first
                    size = "" if abs(share) == 1 else f"{exact(abs(share))} "
                    text += f" {'-' if share < 0 else '+'} {size}{names.monomial(m)}"
                found[i] = first, f"({text})" if len(own) > 1 else text
        return found


@dataclass(frozen=True)
class MixedStiffness(PolynomialTerm):
    """A potential q1^a q2^b ...: its force on q_i is its derivative.

    Raises a ValueError if the powers are not whole numbers of at least 0, or their sum is below 2.
    """

    powers: Powers

    def __post_init__(self) -> None:
        object.__setattr__(self, "powers", _checked_powers(self.powers, 2))

    @property
    def n_coordinates(self) -> int:
        return len(self.powers)

    @property
    def key(self) -> str:
        return f"V {Names().powers(self.powers)}"

    @classmethod
    def from_key(cls, key: str) -> MixedStiffness | None:
        match = re.fullmatch(rf"V ({_POWERS})", key)
        return cls(_powers_in(match[1])) if match else None

    @property
    def dimension(self) -> tuple[float, float]:
        return sum(self.powers) - 1, 0

    def monomials(self) -> list[Monomial]:
        return [Monomial(i, p, _lowered(self.powers, i)) for i, p in enumerate(self.powers) if p]


@dataclass(frozen=True)
class SlavedInertia(PolynomialTerm):
    """Kinetic energy of fast modes that follow: the product g_a^T M g_b of two of their shapes.

    The fast modes follow as g(q) = sum of g_a q^a over powers a, such as a = (1, 1) for q1 q2, and
    add J^T J with J = dg/dq to M(q) ([1]). The coefficient is the product of the shapes of two such
    powers, or the square of one.

    Raises a ValueError if powers are not whole numbers of at least 0, or their sum is below 2.
    """

    first: Powers
    second: Powers

    def __post_init__(self) -> None:
        both = sorted((_checked_powers(p, 2) for p in (self.first, self.second)), reverse=True)
        object.__setattr__(self, "first", both[0])
        object.__setattr__(self, "second", both[1])

    @property
    def n_coordinates(self) -> int:
        return max(len(self.first), len(self.second))

    @property
    def key(self) -> str:
        first, second = map(Names().powers, (self.first, self.second))
        return f"g({first})^2" if first == second else f"g({first}) g({second})"

    @classmethod
    def from_key(cls, key: str) -> SlavedInertia | None:
        square = re.fullmatch(rf"g\((?P<a>{_POWERS})\)\^2", key)
        product = re.fullmatch(rf"g\((?P<a>{_POWERS})\) g\((?P<b>{_POWERS})\)", key)
        if square:
            return cls(_powers_in(square["a"]), _powers_in(square["a"]))
        return cls(_powers_in(product["a"]), _powers_in(product["b"])) if product else None

    @property
    def dimension(self) -> tuple[float, float]:
        return sum(self.first) + sum(self.second) - 1, -2

    @property
    def least(self) -> float:
        return 0.0 if self.first == self.second else super().least  # a sum of squares

    def inertia_monomials(self) -> list[tuple[int, int, float, Powers]]:
        """What it adds to M: row and column from 0, factor and powers."""
        pairs = {(self.first, self.second), (self.second, self.first)}
        return [
            (i, j, float(p * s), _product(_lowered(a, i), _lowered(b, j)))
            for a, b in sorted(pairs)
            for i, p in enumerate(a)
            for j, s in enumerate(b)
            if p and s
        ]

    def monomials(self) -> list[Monomial]:
        found: dict[Monomial, float] = {}

        def add(factor: float, *place: Any) -> None:
            at = Monomial(place[0], 1.0, *place[1:])
            found[at] = found.get(at, 0.0) + factor

        for i, j, factor, powers in self.inertia_monomials():
            add(factor, i, powers, (), j)
            for k, p in enumerate(powers):
                if p:  # dM_ij/dq_k: on q_i with q_j_dot q_k_dot, on q_k with q_i_dot q_j_dot
                    low = _lowered(powers, k)
                    add(p * factor, i, low, tuple(sorted((j, k))))
                    add(-0.5 * p * factor, k, low, tuple(sorted((i, j))))
        parts = [m._replace(factor=f) for m, f in found.items() if f]
        return sorted(parts, key=lambda m: m.second is None)  # accelerations first


@dataclass(frozen=True)
class MixedDamping(PolynomialTerm):
    """Powers of the coordinates in C_ij and C_ji, which multiply the velocities.

    Rows and columns count from 1.

    Raises a ValueError if a row or column is no whole number from 1 to 9, or a power none of at
    least 0.
    """

    row: int
    column: int
    powers: Powers = ()

    def __post_init__(self) -> None:
        for name in ("row", "column"):
            value = getattr(self, name)
            if isinstance(value, bool) or int(value) != value or not 1 <= value <= 9:
                raise ValueError(f"{name} = {value!r} must be a whole number from 1 to 9")
        first, last = sorted((int(self.row), int(self.column)))
        object.__setattr__(self, "row", first)
        object.__setattr__(self, "column", last)
        object.__setattr__(self, "powers", _checked_powers(self.powers))

    @property
    def n_coordinates(self) -> int:
        return max(self.column, len(self.powers))

    @property
    def key(self) -> str:
        return f"C_{self.row}{self.column} {Names().powers(self.powers)}".rstrip()

    @classmethod
    def from_key(cls, key: str) -> MixedDamping | None:
        match = re.fullmatch(rf"C_([1-9])([1-9])(?: ({_POWERS}))?", key)
        return cls(int(match[1]), int(match[2]), _powers_in(match[3] or "")) if match else None

    @property
    def dimension(self) -> tuple[float, float]:
        return sum(self.powers) + 1, -1

    def monomials(self) -> list[Monomial]:
        i, j = self.row - 1, self.column - 1
        return [Monomial(a, 1.0, self.powers, (b,)) for a, b in sorted({(i, j), (j, i)})]

    def undamped(self) -> None:
        return None


def _trimmed(values: Any) -> tuple[Any, ...]:
    """Without the zeros at its end."""
    kept = list(values)
    while kept and kept[-1] == 0:
        kept.pop()
    return tuple(kept)


def _checked_powers(powers: Any, least: int = 0) -> Powers:
    """Whole numbers without the zeros at their end, of a sum that is large enough."""
    found = []
    for p in powers:
        if isinstance(p, bool) or int(p) != p or p < 0:
            raise ValueError(f"powers = {tuple(powers)} must be whole numbers of at least 0")
        found.append(int(p))
    if sum(found) < least:
        raise ValueError(f"powers = {tuple(powers)} must have a sum of at least {least}")
    return _trimmed(found)


def _lowered(powers: Powers, k: int) -> Powers:
    """Powers of a derivative by coordinate k."""
    return _trimmed([p - (i == k) for i, p in enumerate(powers)])


def _product(a: Powers, b: Powers) -> Powers:
    return tuple(p + s for p, s in zip_longest(a, b, fillvalue=0))


def _powers_in(text: str) -> Powers:
    """Powers in a text such as "q1^2 q2"."""
    found: dict[int, int] = {}
    for number, power in re.findall(_POWER, text):
        found[int(number)] = found.get(int(number), 0) + int(power or 1)
    return tuple(found.get(i, 0) for i in range(1, max(found, default=0) + 1))


def _weights(text: str) -> tuple[float, ...] | None:
    """Weights in a text such as "q1 - 0.5 q2"; None where it says something else."""
    spaced = re.sub(r"\s*([+-])\s*", r" \1", text).strip()
    found: dict[int, float] = {}
    for part in re.split(r" (?=[+-])", spaced):
        match = re.fullmatch(r"([+-]?)\s*(?:([\d.]+(?:e[+-]?\d+)?) )?q([1-9]\d*)", part)
        if not match:
            return None
        found[int(match[3])] = float(f"{match[1]}{match[2] or 1}")
    return tuple(found.get(i, 0.0) for i in range(1, max(found) + 1))
