"""Terms for effects that a model may lack: power laws, gaps, stops, magnets, rubbing.

Each is a `Term` with a shape: an exponent, a gap, a distance. Signs follow the equation of motion,
with every term on its left side.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from romsindy.physics import terms
from romsindy.physics.terms import Scalars, Term, WeakForm


def _size(x: Scalars, power: float) -> Scalars:
    return np.abs(x) ** power


def _superscript(exponent: float) -> str:
    return "" if exponent == 1 else f"^{exponent:.6g}"


def _slope_beyond(depth: Scalars, exponent: float) -> Scalars:
    """Derivative of max(depth, 0)^p; 0 up to contact, whatever p."""
    slope = exponent * np.where(depth > 0, depth, 1.0) ** (exponent - 1)
    return np.where(depth > 0, slope, 0.0)


class ForceLaw(Term):
    """A force of q and q_dot; its weak form is itself."""

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        """The force has no derivatives to integrate by parts."""
        return WeakForm(zeroth=self.stiffness(q) + self.damping(q, q_dot))


@dataclass(frozen=True)
class PowerDamping(ForceLaw):
    """|q_dot|^p sign(q_dot); p = 2 is drag."""

    exponent: float = 2.0

    @property
    def key(self) -> str:
        return f"c_|q_dot|^{self.exponent:.6g}"

    @property
    def dimension(self) -> tuple[float, float]:  # type: ignore[override]
        return self.exponent, -self.exponent

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"|{q_dot}|^{self.exponent:.6g} sign({q_dot})"

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return _size(q_dot, self.exponent) * np.sign(q_dot)

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return self.exponent * _size(q_dot, self.exponent - 1)


@dataclass(frozen=True)
class AmplitudePowerDamping(ForceLaw):
    """|q|^p q_dot; p = 2 is the damping of joints and of large strains."""

    exponent: float = 2.0

    @property
    def key(self) -> str:
        return f"c_|q|^{self.exponent:.6g} q_dot"

    @property
    def dimension(self) -> tuple[float, float]:  # type: ignore[override]
        return self.exponent + 1, -1

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"|{q}|^{self.exponent:.6g} {q_dot}"

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return _size(q, self.exponent) * q_dot

    def damping_dq(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return self.exponent * _size(q, self.exponent - 1) * np.sign(q) * q_dot

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return _size(q, self.exponent)


@dataclass(frozen=True)
class HystereticDamping(ForceLaw):
    """|q|^p sign(q_dot); p = 1 loses the same part of the energy at every amplitude."""

    exponent: float = 1.0

    smooth = False

    @property
    def key(self) -> str:
        return f"c_|q|^{self.exponent:.6g} sign(q_dot)"

    @property
    def dimension(self) -> tuple[float, float]:  # type: ignore[override]
        return self.exponent, 0

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"|{q}|^{self.exponent:.6g} sign({q_dot})"

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return _size(q, self.exponent) * np.sign(q_dot)

    def damping_dq(self, q: Scalars, q_dot: Scalars) -> Scalars:
        slope = self.exponent * _size(q, self.exponent - 1) * np.sign(q)
        return slope * np.sign(q_dot)


@dataclass(frozen=True)
class RubbingDamping(ForceLaw):
    """sign(q_dot) where side (q - gap) > 0: dry friction on one side of a gap."""

    gap: float = 0.0
    side: int = 1

    smooth = False
    dimension = (0, 0)

    @property
    def key(self) -> str:
        return f"c_rubbing {'above' if self.side > 0 else 'below'} {self.gap:.6g}"

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"sign({q_dot}) [{q} {'>' if self.side > 0 else '<'} {self.gap:.6g}]"

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return np.sign(q_dot) * (self.side * (q - self.gap) > 0)


@dataclass(frozen=True)
class PowerStiffness(ForceLaw):
    """|q|^p sign(q)."""

    exponent: float = 3.0

    @property
    def key(self) -> str:
        return f"gamma_|q|^{self.exponent:.6g}"

    @property
    def dimension(self) -> tuple[float, float]:  # type: ignore[override]
        return self.exponent, 0

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return f"|{q}|^{self.exponent:.6g} sign({q})"

    def stiffness(self, q: Scalars) -> Scalars:
        return _size(q, self.exponent) * np.sign(q)

    def potential(self, q: Scalars) -> Scalars:
        return _size(q, self.exponent + 1) / (self.exponent + 1)

    def stiffness_dq(self, q: Scalars) -> Scalars:
        return self.exponent * _size(q, self.exponent - 1)


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
class AddedMass(Term):
    """Mass beside the one that the model is scaled to: q_ddot."""

    key = "mu"
    dimension = (1, -2)

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return q_ddot

    def inertia(self, q: Scalars) -> Scalars:
        return np.ones_like(q)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        return WeakForm(second=q, second_rate=q_dot)


@dataclass(frozen=True)
class StopStiffness(ForceLaw):
    """(q - gap)^p beyond a gap, on one side; p = 1 and gap = 0 make a bilinear spring."""

    gap: float = 0.0
    side: int = 1
    exponent: float = 1.0

    @property
    def key(self) -> str:
        side = "above" if self.side > 0 else "below"
        return f"k_{side} {self.gap:.6g}{_superscript(self.exponent)}"

    @property
    def dimension(self) -> tuple[float, float]:  # type: ignore[override]
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
class TwoSidedGap(ForceLaw):
    """A spring met on both sides beyond a gap: sign(q) max(|q| - gap, 0)^p."""

    gap: float = 0.0
    exponent: float = 1.0

    @property
    def key(self) -> str:
        return f"k_gap {self.gap:.6g}{_superscript(self.exponent)}"

    @property
    def dimension(self) -> tuple[float, float]:  # type: ignore[override]
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
class Magnet(ForceLaw):
    """Pull towards a pole at a distance on one side, less its pull at rest.

    -side ((1 - side q/d)^-p - 1), which is -p q/d at small q.
    """

    distance: float = 1.0
    side: int = 1
    exponent: float = 2.0

    dimension = (0, 0)

    @property
    def key(self) -> str:
        return f"f_magnet at {self.side * self.distance:.6g}^{self.exponent:.6g}"

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        sign, back = ("-", "") if self.side > 0 else ("+", "(-1) ")
        d, p = f"{self.distance:.6g}", f"{self.exponent:.6g}"
        return f"{back}(1 - (1 {sign} {q}/{d})^-{p})"

    def _closeness(self, q: Scalars) -> Scalars:
        return np.maximum(1 - self.side * q / self.distance, 0.02)

    def stiffness(self, q: Scalars) -> Scalars:
        return -self.side * (self._closeness(q) ** -self.exponent - 1)

    def potential(self, q: Scalars) -> Scalars:
        p = self.exponent - 1
        return -(self._closeness(q) ** -p - 1) * self.distance / p + self.side * q

    def stiffness_dq(self, q: Scalars) -> Scalars:
        slope = self._closeness(q) ** (-self.exponent - 1)
        return -self.exponent / self.distance * slope


_NUMBER = r"(-?[\d.]+(?:e[+-]?\d+)?)"
_SIDE = {"above": 1, "below": -1}
_KEYS: dict[str, Callable[..., Term]] = {
    rf"c_\|q_dot\|\^{_NUMBER}": lambda p: PowerDamping(float(p)),
    rf"c_\|q\|\^{_NUMBER} q_dot": lambda p: AmplitudePowerDamping(float(p)),
    rf"c_\|q\|\^{_NUMBER} sign\(q_dot\)": lambda p: HystereticDamping(float(p)),
    rf"c_rubbing (above|below) {_NUMBER}": lambda s, g: RubbingDamping(float(g), _SIDE[s]),
    rf"gamma_\|q\|\^{_NUMBER}": lambda p: PowerStiffness(float(p)),
    "f_constant": lambda: ConstantForce(),
    "mu": lambda: AddedMass(),
    rf"k_(above|below) {_NUMBER}(?:\^{_NUMBER})?": lambda s, g, p: StopStiffness(
        float(g), _SIDE[s], float(p or 1)
    ),
    rf"k_gap {_NUMBER}(?:\^{_NUMBER})?": lambda g, p: TwoSidedGap(float(g), float(p or 1)),
    rf"f_magnet at {_NUMBER}\^{_NUMBER}": lambda d, p: Magnet(
        abs(float(d)), 1 if float(d) > 0 else -1, float(p)
    ),
}


def term_from_key(key: str) -> Term:
    """Return the term whose coefficient is called ``key``, here or in `romsindy.physics.terms`.

    Raises
    ------
    ValueError
        If no term has this key.
    """
    for pattern, make in _KEYS.items():
        match = re.fullmatch(pattern, key)
        if match:
            return make(*match.groups())
    return terms.term_from_key(key)
