"""Laws of stiffness: powers of the displacement, a constant force, stops, gaps and magnets."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from romsindy.physics.term import (
    NUMBER,
    SIDES,
    ForceLaw,
    Scalars,
    exact,
    power_of,
    power_slope,
    power_text,
    side_name,
)


def _superscript(exponent: float) -> str:
    return "" if exponent == 1 else f"^{exact(exponent)}"


def _slope_beyond(depth: Scalars, exponent: float) -> Scalars:
    """Derivative of max(depth, 0)^p; 0 up to contact, whatever p."""
    slope = exponent * np.where(depth > 0, depth, 1.0) ** (exponent - 1)
    return np.where(depth > 0, slope, 0.0)


@dataclass(frozen=True)
class Stiffness(ForceLaw):
    """Restoring force: omega^2 q for degree 1, gamma_m q^m beyond.

    A degree that is no whole number gives |q|^m sign(q), and so does an even one where the force is
    ``odd``: joints that slip soften by |q| q.

    Raises a ValueError if the degree is below 1.
    """

    degree: float
    odd: bool = False

    def __post_init__(self) -> None:
        if isinstance(self.degree, bool) or not 1 <= self.degree < math.inf:
            raise ValueError(f"degree = {self.degree!r} must be a number of at least 1")
        if self.degree == int(self.degree):
            object.__setattr__(self, "degree", int(self.degree))
        object.__setattr__(self, "odd", bool(self.odd and self.degree % 2 == 0))

    @property
    def key(self) -> str:
        if self.degree == 1:
            return "omega^2"
        return f"gamma_{f'|q|^{exact(self.degree)}' if self._signed else self.degree}"

    @classmethod
    def from_key(cls, key: str) -> Stiffness | None:
        if key == "omega^2":
            return cls(1)
        match = re.fullmatch(rf"gamma_(?:(\d+)|\|q\|\^{NUMBER})", key)
        degree = float(match[1] or match[2]) if match else 0.0
        return cls(degree, odd=match[1] is None) if match and degree > 1 else None

    @property
    def _signed(self) -> bool:
        """Whether it is |q|^m sign(q), no power of q."""
        return self.odd or not isinstance(self.degree, int)

    @property
    def dimension(self) -> tuple[float, float]:
        return self.degree, 0

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        if not self._signed:
            return power_text(q, self.degree)
        return f"|{q}| {q}" if self.degree == 2 else f"|{q}|^{self.degree:.6g} sign({q})"

    def monomial(self, part: str) -> tuple[float, int] | None:
        n = self.degree
        if self._signed or not isinstance(n, int):
            return None
        return {"stiffness": (1.0, n), "potential": (1 / (n + 1), n + 1)}.get(part)

    def stiffness(self, q: Scalars) -> Scalars:
        return abs(q) * power_of(q, self.degree - 1) if self.odd else power_of(q, self.degree)

    def potential(self, q: Scalars) -> Scalars:
        return q * self.stiffness(q) / (self.degree + 1)

    def stiffness_dq(self, q: Scalars) -> Scalars:
        if self.odd:
            return self.degree * abs(q) * power_of(q, self.degree - 2)
        return power_slope(q, self.degree)


@dataclass(frozen=True)
class ConstantForce(ForceLaw):
    """A steady force: 1."""

    key = "f_constant"
    dimension = (0, 0)

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return "1"

    def stiffness(self, q: Scalars) -> Scalars:
        return np.ones_like(q)

    def potential(self, q: Scalars) -> Scalars:
        return q


@dataclass(frozen=True)
class StopForce(ForceLaw):
    """(q - gap)^p beyond a gap, on one side; p = 1 and gap = 0 make a bilinear spring."""

    gap: float = 0.0
    side: int = 1
    exponent: float = 1.0

    @property
    def key(self) -> str:
        return f"k_{side_name(self.side)} {exact(self.gap)}{_superscript(self.exponent)}"

    @classmethod
    def from_key(cls, key: str) -> StopForce | None:
        match = re.fullmatch(rf"k_(above|below) {NUMBER}(?:\^{NUMBER})?", key)
        return cls(float(match[2]), SIDES[match[1]], float(match[3] or 1)) if match else None

    @property
    def dimension(self) -> tuple[float, float]:
        return self.exponent, 0

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        inner = f"{q} - {self.gap:.6g}" if self.side > 0 else f"{self.gap:.6g} - {q}"
        sign = "" if self.side > 0 else "(-1) "
        return f"{sign}max({inner}, 0){_superscript(self.exponent)}"

    def _depth(self, q: Scalars) -> Scalars:
        return np.maximum(self.side * (q - self.gap), 0.0)

    def stiffness(self, q: Scalars) -> Scalars:
        return self.side * self._depth(q) ** self.exponent

    def potential(self, q: Scalars) -> Scalars:
        p = self.exponent + 1
        return (self._depth(q) ** p - self._depth(np.zeros_like(q)) ** p) / p

    def stiffness_dq(self, q: Scalars) -> Scalars:
        return _slope_beyond(self._depth(q), self.exponent)


@dataclass(frozen=True)
class GapForce(ForceLaw):
    """A spring met on both sides beyond a gap: sign(q) max(|q| - gap, 0)^p."""

    gap: float = 0.0
    exponent: float = 1.0

    @property
    def key(self) -> str:
        return f"k_gap {exact(self.gap)}{_superscript(self.exponent)}"

    @classmethod
    def from_key(cls, key: str) -> GapForce | None:
        match = re.fullmatch(rf"k_gap {NUMBER}(?:\^{NUMBER})?", key)
        return cls(float(match[1]), float(match[2] or 1)) if match else None

    @property
    def dimension(self) -> tuple[float, float]:
        return self.exponent, 0

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"sign({q}) max(|{q}| - {self.gap:.6g}, 0){_superscript(self.exponent)}"

    def _depth(self, q: Scalars) -> Scalars:
        return np.maximum(np.abs(q) - self.gap, 0.0)

    def stiffness(self, q: Scalars) -> Scalars:
        return np.sign(q) * self._depth(q) ** self.exponent

    def potential(self, q: Scalars) -> Scalars:
        return self._depth(q) ** (self.exponent + 1) / (self.exponent + 1)

    def stiffness_dq(self, q: Scalars) -> Scalars:
        return _slope_beyond(self._depth(q), self.exponent)


@dataclass(frozen=True)
class MagnetForce(ForceLaw):
    """Pull towards a pole at a distance on one side, in parts of the pull at rest, less that.

    -side ((1 - side q/d)^-p - 1), which is -p q/d at small q; `preload` is the pull at rest.
    """

    distance: float = 1.0
    side: int = 1
    exponent: float = 2.0

    dimension = (0, 0)

    @property
    def key(self) -> str:
        return f"f_magnet at {exact(self.side * self.distance)}^{exact(self.exponent)}"

    @classmethod
    def from_key(cls, key: str) -> MagnetForce | None:
        match = re.fullmatch(rf"f_magnet at {NUMBER}\^{NUMBER}", key)
        if not match:
            return None
        place = float(match[1])
        return cls(abs(place), 1 if place > 0 else -1, float(match[2]))

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        sign, back = ("-", "") if self.side > 0 else ("+", "(-1) ")
        d, p = f"{self.distance:.6g}", f"{self.exponent:.6g}"
        return f"{back}(1 - (1 {sign} {q}/{d})^-{p})"

    def _closeness(self, q: Scalars) -> Scalars:
        return np.maximum(1 - self.side * q / self.distance, 0.02)

    @property
    def preload(self) -> float:
        return -float(self.side)

    def stiffness(self, q: Scalars) -> Scalars:
        return -self.side * (self._closeness(q) ** -self.exponent - 1)

    def potential(self, q: Scalars) -> Scalars:
        p = self.exponent - 1
        return -(self._closeness(q) ** -p - 1) * self.distance / p + self.side * q

    def stiffness_dq(self, q: Scalars) -> Scalars:
        return -self.exponent / self.distance * (self._closeness(q) ** (-self.exponent - 1))
