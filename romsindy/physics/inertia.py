"""Laws of inertia: the kinetic energy of what moves along."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from romsindy.physics.term import Scalars, Term, WeakForm, power_of, power_slope, power_text


@dataclass(frozen=True)
class Inertia(Term):
    """Inertial compensation s (q^(k-1) q_ddot + (k-1)/2 q^(k-2) q_dot^2) of order k ([1], eq. 17).

    s = 2 for even k, so that the coefficient is the paper's Upsilon_k. The kinetic energy behind
    it is s q^(k-1) q_dot^2 / 2. [1]: see `romsindy.physics.term`.

    Raises a ValueError if the order is below 2.
    """

    order: int

    def __post_init__(self) -> None:
        if isinstance(self.order, bool) or int(self.order) != self.order or self.order < 2:
            raise ValueError(f"order = {self.order!r} must be a whole number of at least 2")

    @property
    def key(self) -> str:
        return f"Upsilon_{self.order}"

    @classmethod
    def from_key(cls, key: str) -> Inertia | None:
        match = re.fullmatch(r"Upsilon_(\d+)", key)
        return cls(int(match[1])) if match and int(match[1]) >= 2 else None

    @property
    def dimension(self) -> tuple[int, int]:
        return self.order, -2

    @property
    def _scale(self) -> int:
        return 1 + (self.order % 2 == 0)

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        k, s = self.order, self._scale
        convection = s * (k - 1) // 2
        first = ["2" if s == 2 else "", power_text(q, k - 1), q_ddot]
        second = [str(convection) if convection > 1 else "", power_text(q, k - 2), f"{q_dot}^2"]
        return f"({' '.join(filter(None, first))} + {' '.join(filter(None, second))})"

    def monomial(self, part: str) -> tuple[float, int] | None:
        n, s = self.order - 1, float(self._scale)
        return {"inertia": (s, n), "convection": (s * n / 2, n - 1)}.get(part)

    def inertia(self, q: Scalars) -> Scalars:
        return self._scale * power_of(q, self.order - 1)

    def convection(self, q: Scalars) -> Scalars:
        return self._scale * (self.order - 1) / 2 * power_of(q, self.order - 2)

    def inertia_dq(self, q: Scalars) -> Scalars:
        return self._scale * power_slope(q, self.order - 1)

    def convection_dq(self, q: Scalars) -> Scalars:
        return self._scale * (self.order - 1) / 2 * power_slope(q, self.order - 2)

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
        return f"{power_text(q, 2)} {q_ddot}"

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
        return f"{q} {power_text(q_dot, 2)}"

    def convection(self, q: Scalars) -> Scalars:
        return q

    def convection_dq(self, q: Scalars) -> Scalars:
        return power_slope(q, 1)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(zeroth=q * q_dot * q_dot)


@dataclass(frozen=True)
class AddedMass(Term):
    """Mass beside the one that the model is scaled to: q_ddot."""

    key = "mu"
    dimension = (1, -2)
    least = -1.0  # a mass in all

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return q_ddot

    def inertia(self, q: Scalars) -> Scalars:
        return np.ones_like(q)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(second=q, second_rate=q_dot)
