"""Laws of damping: powers of the speed, of the displacement, and friction that jumps."""

from __future__ import annotations

import re
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from romsindy.physics.term import (
    NUMBER,
    SIDES,
    ForceLaw,
    Scalars,
    WeakForm,
    exact,
    power_of,
    power_slope,
    power_text,
    side_name,
    size_slope,
)

_POWERS = {1: "c_linear", 2: "c_quadratic", 3: "c_cubic"}


@dataclass(frozen=True)
class PowerDamping(ForceLaw):
    """|q_dot|^p sign(q_dot): viscous for p = 1, drag for p = 2."""

    exponent: float = 1.0

    least = 0.0  # it takes energy

    @property
    def key(self) -> str:
        return _POWERS.get(cast(int, self.exponent), f"c_|q_dot|^{exact(self.exponent)}")

    @classmethod
    def from_key(cls, key: str) -> PowerDamping | None:
        for exponent, name in _POWERS.items():
            if key == name:
                return cls(exponent)
        match = re.fullmatch(rf"c_\|q_dot\|\^{NUMBER}", key)
        return cls(float(match[1])) if match else None

    @property
    def dimension(self) -> tuple[float, float]:
        return self.exponent, -self.exponent

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        if self.exponent % 2 == 1:
            return power_text(q_dot, self.exponent)
        if self.exponent == 2:
            return f"|{q_dot}| {q_dot}"
        return f"|{q_dot}|^{self.exponent:.6g} sign({q_dot})"

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        if self.exponent == 2:
            return abs(q_dot) * q_dot
        if self.exponent % 2 == 1:
            return power_of(q_dot, self.exponent)
        return np.abs(q_dot) ** self.exponent * np.sign(q_dot)

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        if self.exponent == 2:
            return 2 * abs(q_dot)
        if self.exponent % 2 == 1:
            return power_slope(q_dot, self.exponent)
        return self.exponent * np.abs(q_dot) ** (self.exponent - 1)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(first=q) if self.exponent == 1 else super().weak(q, q_dot)


@dataclass(frozen=True)
class AmplitudeDamping(ForceLaw):
    """|q|^p q_dot, damping that grows with the displacement: p = 2 in joints and large strains."""

    exponent: float = 2.0

    @property
    def key(self) -> str:
        return "c_q^2 q_dot" if self.exponent == 2 else f"c_|q|^{exact(self.exponent)} q_dot"

    @classmethod
    def from_key(cls, key: str) -> AmplitudeDamping | None:
        if key == "c_q^2 q_dot":
            return cls(2)
        match = re.fullmatch(rf"c_\|q\|\^{NUMBER} q_dot", key)
        return cls(float(match[1])) if match else None

    @property
    def dimension(self) -> tuple[float, float]:
        return self.exponent + 1, -1

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        size = power_text(q if self.exponent == 2 else f"|{q}|", float(f"{self.exponent:.6g}"))
        return f"{size} {q_dot}"

    def _size(self, q: Scalars) -> Scalars:
        return q * q if self.exponent == 2 else np.abs(q) ** self.exponent

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return self._size(q) * q_dot

    def damping_dq(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return (2 * q if self.exponent == 2 else size_slope(q, self.exponent)) * q_dot

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return self._size(q)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(first=power_of(q, 3) / 3) if self.exponent == 2 else super().weak(q, q_dot)


@dataclass(frozen=True)
class PositionDamping(ForceLaw):
    """q^p q_dot for a whole power p: a term of the series of damping that changes with q.

    Odd powers damp one side of the motion more than the other.

    Raises a ValueError if the power is not a whole number of at least 1.
    """

    power: int

    def __post_init__(self) -> None:
        if isinstance(self.power, bool) or int(self.power) != self.power or self.power < 1:
            raise ValueError(f"power = {self.power!r} must be a whole number of at least 1")

    @property
    def key(self) -> str:
        return f"delta_{self.power}"

    @classmethod
    def from_key(cls, key: str) -> PositionDamping | None:
        match = re.fullmatch(r"delta_([1-9]\d*)", key)
        return cls(int(match[1])) if match else None

    @property
    def dimension(self) -> tuple[float, float]:
        return self.power + 1, -1

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"{power_text(q, self.power)} {q_dot}"

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return power_of(q, self.power) * q_dot

    def damping_dq(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return power_slope(q, self.power) * q_dot

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return power_of(q, self.power)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(first=power_of(q, self.power + 1) / (self.power + 1))


_HELD = 1e-4  # of the velocity over which friction turns round: what is held creeps on by so much


class Averaged(NamedTuple):
    """A force that jumps, averaged over a step in time, and its derivatives, (n,) each."""

    force: Any
    by_q: Any
    by_q_dot: Any
    by_change: Any  # of q_dot


class FrictionLaw(ForceLaw):
    """N(q) sign(q_dot) with a normal force N; with a ``creep`` velocity, N(q) tanh(q_dot / creep).

    A subclass is a frozen dataclass with ``creep: float = 0.0`` among its fields.
    """

    creep: float

    least = 0.0  # it takes energy

    @abstractmethod
    def normal(self, q: Scalars, change: Scalars = 0.0) -> Scalars:
        """Normal force over that of a unit coefficient; averaged over q - change to q + change."""

    @abstractmethod
    def normal_dq(self, q: Scalars, change: Scalars = 0.0) -> Scalars:
        """Derivative of `normal`."""

    @property
    def smooth(self) -> bool:
        return self.creep > 0

    def regularised(self, velocity_scale: float) -> FrictionLaw:
        """Friction without its jump: viscous creep where it sticks.

        Raises a ValueError if the velocity scale (unit of q per second) is not positive.
        """
        if not velocity_scale > 0:
            raise ValueError(f"velocity_scale = {velocity_scale!r} must be positive")
        return replace(self, creep=velocity_scale)  # type: ignore[type-var]

    def jumping(self) -> FrictionLaw:
        """Friction with its jump."""
        return replace(self, creep=0.0)  # type: ignore[type-var]

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return self.normal(q) * self._turn(q_dot)

    def damping_dq(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return self.normal_dq(q) * self._turn(q_dot)

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        if not self.creep:
            return np.zeros_like(q_dot)
        return self.normal(q) * (1 - np.tanh(q_dot / self.creep) ** 2) / self.creep

    def _turn(self, q_dot: Scalars) -> Scalars:
        return np.tanh(q_dot / self.creep) if self.creep else np.sign(q_dot)

    def _sign_text(self, q_dot: str) -> str:
        return f"tanh({q_dot}/{self.creep:g})" if self.creep else f"sign({q_dot})"

    def averaged(
        self,
        q: Scalars,
        q_dot: Scalars,
        q_change: Scalars,
        q_dot_change: Scalars,
        creep: float = 0.0,
        held: NDArray[np.bool_] | None = None,
    ) -> Averaged:
        """The force where q and q_dot run from minus to plus their changes.

        With a ``creep`` velocity the slopes do not jump either: what is near the middle counts
        more, on a line down to both ends, and where q_dot hardly changes, as in a stop, the force
        turns round over this velocity. Where it is ``held`` the force is what keeps it there.
        """
        normal, by_q = self.normal(q, q_change), self.normal_dq(q, q_change)
        if creep:
            width = np.hypot(q_dot_change, creep)
            place = np.clip(q_dot / width, -1.0, 1.0)
            sign, by_q_dot = place * (2 - np.abs(place)), 2 * (1 - np.abs(place)) / width
            by_change = -by_q_dot * place * q_dot_change / width
        else:
            sign, by_q_dot = mean_sign(q_dot, q_dot_change), mean_sign_slope(q_dot, q_dot_change)
            turning = (by_q_dot > 0) & (q_dot_change != 0)
            by_change = -sign / np.where(turning, q_dot_change, 1.0) * turning
        if held is not None:
            stiff = 1 / (_HELD * creep)
            sign, by_q_dot = np.where(held, stiff * q_dot, sign), np.where(held, stiff, by_q_dot)
            by_change = np.where(held, 0.0, by_change)
        return Averaged(normal * sign, by_q * sign, normal * by_q_dot, normal * by_change)


@dataclass(frozen=True)
class Friction(FrictionLaw):
    """|q|^p sign(q_dot): dry for p = 0; hysteretic, the same loss factor everywhere, for p = 1."""

    exponent: float = 0.0
    creep: float = 0.0

    @property
    def key(self) -> str:
        return f"c_|q|^{exact(self.exponent)} sign(q_dot)" if self.exponent else "c_coulomb"

    @classmethod
    def from_key(cls, key: str) -> Friction | None:
        match = re.fullmatch(rf"c_coulomb|c_\|q\|\^{NUMBER} sign\(q_dot\)", key)
        return cls(float(match[1] or 0)) if match else None

    @property
    def dimension(self) -> tuple[float, float]:
        return self.exponent, 0

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"{power_text(f'|{q}|', self.exponent)} {self._sign_text(q_dot)}".lstrip()

    def normal(self, q: Scalars, change: Scalars = 0.0) -> Scalars:
        return np.abs(q) ** self.exponent if self.exponent else np.ones_like(q)

    def normal_dq(self, q: Scalars, change: Scalars = 0.0) -> Scalars:
        return size_slope(q, self.exponent) if self.exponent else np.zeros_like(q)


@dataclass(frozen=True)
class RubbingFriction(FrictionLaw):
    """sign(q_dot) where side (q - gap) > 0: dry friction on one side of a gap."""

    gap: float = 0.0
    side: int = 1
    creep: float = 0.0

    dimension = (0, 0)

    @property
    def key(self) -> str:
        return f"c_rubbing {side_name(self.side)} {exact(self.gap)}"

    @classmethod
    def from_key(cls, key: str) -> RubbingFriction | None:
        match = re.fullmatch(rf"c_rubbing (above|below) {NUMBER}", key)
        return cls(float(match[2]), SIDES[match[1]]) if match else None

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"{self._sign_text(q_dot)} [{q} {'>' if self.side > 0 else '<'} {self.gap:.6g}]"

    def _beyond(self, q: Scalars) -> Scalars:
        return self.side * (q - self.gap)

    def normal(self, q: Scalars, change: Scalars = 0.0) -> Scalars:
        return 0.5 + 0.5 * mean_sign(self._beyond(q), change)

    def normal_dq(self, q: Scalars, change: Scalars = 0.0) -> Scalars:
        return 0.5 * self.side * mean_sign_slope(self._beyond(q), change)


def mean_sign(x: Scalars, change: Scalars) -> Scalars:
    """Sign of x averaged over x - change to x + change: a jump spread over a step in time."""
    if np.ndim(change) == 0 and change == 0:
        return np.sign(x)
    return np.clip(x / _least(x, change), -1.0, 1.0)


def mean_sign_slope(x: Scalars, change: Scalars) -> Scalars:
    """Derivative of `mean_sign` with respect to x."""
    change = _least(x, change)
    return (np.abs(x) < change) / change


def _least(x: Scalars, change: Scalars) -> Scalars:
    # No change at all would divide by zero where x is zero too.
    return np.maximum(np.abs(change), 1e-12 * np.max(np.abs(x)) + 1e-300)


# Kinds of damping by the name that libraries and commands use.
DAMPING: dict[str, ForceLaw] = {
    "linear": PowerDamping(1),
    "quadratic": PowerDamping(2),
    "coulomb": Friction(),
    "cubic": PowerDamping(3),
    "q^2 q_dot": AmplitudeDamping(2),
}


def damping_law(kind: str) -> ForceLaw:
    """Return the law of a kind of damping: one of `DAMPING`.

    Raises a ValueError if the kind is none of them.
    """
    if kind not in DAMPING:
        raise ValueError(f"damping kind {kind!r} is not known: use one of {list(DAMPING)}")
    return DAMPING[kind]
