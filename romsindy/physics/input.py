"""A measured input in the equation of motion: a force, or the acceleration of the base."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from romsindy.physics.term import Scalars, Term, WeakForm, exact, power_of, unit_text
from romsindy.record.interpolation import (
    INTERPOLATIONS,
    Interpolation,
    interpolated,
    is_base,
    require_input,
)
from romsindy.typing import Array

# Name of the coefficient: what stands on the right is the gain times a force, or minus the
# participation factor times an acceleration of the base.
_GAIN, _PARTICIPATION = "gain", "Gamma"
_KEY = re.compile(rf"(?:{_GAIN}|{_PARTICIPATION}) \[([^\[\]]+)\](?:\^([1-9]\d*))?")


@dataclass(frozen=True)
class Input(Term):
    """What an input adds: nothing to the free motion, and its samples, late, to the right side.

    Of a shaker that is not ideal, what is left of them after a lag acts, or a power of them as
    well, which is a term of its own.

    Parameters
    ----------
    source : str
        "force" or "base"; of several of a kind "force 2", ...
    interpolation : "band-limited", "linear" or "hold"
        What it does between its samples.
    delay : float
        By which it acts later than it was measured, s.
    input_unit : str, optional
        Of its samples.
    lag : float
        Time constant of a first-order lag, s: of the input u, x acts, lag x' + x = u.
    power : int
        With which it acts: u^power, or x^power.

    Raises
    ------
    ValueError
        For another source, another way between samples, a lag below 0 or a power below 1.
    """

    source: str = "force"
    interpolation: Interpolation = "band-limited"
    delay: float = 0.0
    input_unit: str | None = None
    lag: float = 0.0
    power: int = 1

    def __post_init__(self) -> None:
        require_input(self.source)
        if self.interpolation not in INTERPOLATIONS:
            raise ValueError(
                f"interpolation = {self.interpolation!r} must be one of {INTERPOLATIONS}"
            )
        if not 0 <= self.lag < math.inf:
            raise ValueError(f"lag = {self.lag!r} must be a time in s, 0 where there is none")
        if not (isinstance(self.power, int) and self.power >= 1):
            raise ValueError(f"power = {self.power!r} must be a whole number, 1 or more")

    @property
    def key(self) -> str:
        return self.raised(f"{_PARTICIPATION if is_base(self.source) else _GAIN} [{self.source}]")

    @property
    def signal(self) -> str:
        """What acts of the source: "force", or "force^3"."""
        return self.raised(self.source)

    @property
    def dimension(self) -> tuple[float, float]:
        return 0.0, 0.0

    @property
    def sign(self) -> int:
        """With which it stands on the right side: a base that goes up leaves the mass behind."""
        return -1 if is_base(self.source) else 1

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        text = self.called(float(f"{self.delay:.4g}"))
        return self.raised(f"({text}/(1 + {self.lag:.4g} d/dt))" if self.lag else text)

    @property
    def name(self) -> str:
        """The source as a name in code."""
        return self.source.replace(" ", "_")

    def called(self, delay: float) -> str:
        """Text of the input as a function of time, late by a delay (s)."""
        late = f" {'-' if delay > 0 else '+'} {exact(abs(delay))}" if delay else ""
        return f"{self.name}(t{late})"

    @classmethod
    def from_key(cls, key: str) -> Input | None:
        match = _KEY.fullmatch(key)
        term = cls(match[1], power=int(match[2] or 1)) if match else None
        return term if term is not None and term.key == key else None

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        """Nothing: the free motion has no input."""
        return WeakForm()

    def unit(self, unit: str | None) -> str:
        """Unit of the coefficient when q is measured in ``unit``; that of its delay is s."""
        length = unit or "[q]"
        if is_base(self.source) and self.input_unit in (None, f"{unit}/s^2"):
            return unit_text({length: 1 - self.power, "s": -2 * (1 - self.power)})
        powers = {length: 1.0, "s": -2.0}
        powers[self.input_unit or "[input]"] = powers.get(self.input_unit or "", 0.0) - self.power
        return unit_text(powers)

    def at(self, u: Array, place: Array, dt: float) -> Array:
        """What acts, were there no delay, at places counted in samples (n,), ``dt`` (s) apart."""
        return power_of(interpolated(u, place, self.interpolation, self.lag / dt), self.power)

    def raised(self, text: str) -> str:
        """Text of something, with the power."""
        return text if self.power == 1 else f"{text}^{self.power}"
