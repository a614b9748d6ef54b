"""A measured input in the equation of motion: a force, or the acceleration of the base."""

from __future__ import annotations

import re
from dataclasses import dataclass

from romsindy.physics.term import Scalars, Term, WeakForm, exact, unit_text
from romsindy.record.forced import is_base, require_input
from romsindy.record.interpolation import INTERPOLATIONS, Interpolation

# Name of the coefficient: what stands on the right is the gain times a force, or minus the
# participation factor times an acceleration of the base.
_GAIN, _PARTICIPATION = "gain", "Gamma"
_KEY = re.compile(rf"(?:{_GAIN}|{_PARTICIPATION}) \[(.+)\]")


@dataclass(frozen=True)
class Input(Term):
    """What an input adds: nothing to the free motion, and its samples, late, to the right side.

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

    Raises
    ------
    ValueError
        For another source, or another way between samples.
    """

    source: str = "force"
    interpolation: Interpolation = "band-limited"
    delay: float = 0.0
    input_unit: str | None = None

    def __post_init__(self) -> None:
        require_input(self.source)
        if self.interpolation not in INTERPOLATIONS:
            raise ValueError(
                f"interpolation = {self.interpolation!r} must be one of {INTERPOLATIONS}"
            )

    @property
    def key(self) -> str:
        return f"{_PARTICIPATION if is_base(self.source) else _GAIN} [{self.source}]"

    @property
    def dimension(self) -> tuple[float, float]:
        return 0.0, 0.0

    @property
    def sign(self) -> int:
        """With which it stands on the right side: a base that goes up leaves the mass behind."""
        return -1 if is_base(self.source) else 1

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        return self.called(float(f"{self.delay:.4g}"))

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
        term = cls(match[1]) if match else None
        return term if term is not None and term.key == key else None

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        """Nothing: the free motion has no input."""
        return WeakForm()

    def unit(self, unit: str | None) -> str:
        """Unit of the coefficient when q is measured in ``unit``; that of its delay is s."""
        if is_base(self.source) and self.input_unit in (None, f"{unit}/s^2"):
            return "1"
        powers = {unit or "[q]": 1.0, "s": -2.0}
        powers[self.input_unit or "[input]"] = powers.get(self.input_unit or "", 0.0) - 1
        return unit_text(powers)
