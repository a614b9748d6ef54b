"""Terms with their coefficients: names, checks and JSON that all models share."""

from __future__ import annotations

from collections.abc import Mapping, Sized
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

from romsindy.physics.entries import finite, items, optional_text, several, table
from romsindy.physics.memory import MemoryLaw
from romsindy.physics.serial import content_of, json_text, read_json, term_from_key, term_of
from romsindy.physics.term import MOST_TERMS, Term

if TYPE_CHECKING:
    from typing_extensions import Self


@dataclass(frozen=True)
class TermSum:
    """Terms of an equation of motion, each with its coefficient.

    Parameters
    ----------
    terms : tuple of Term
    values : tuple of float
        Coefficient of each term, in the unit of q and seconds.
    unit : str, optional
        Unit of q, such as "m"; None where it is not known.
    amplitude_range : (float, float), optional
        Least and largest amplitude of the data behind the model, in the unit of q.
    """

    terms: tuple[Term, ...]
    values: tuple[float, ...]
    unit: str | None = None
    amplitude_range: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple(self.terms))
        refuse_many(self.terms)
        if not isinstance(self.unit, str | None):
            raise ValueError(f"unit = {self.unit!r:.60} must be a text such as 'm', or none")
        if any(not isinstance(v, Real | np.ndarray) or isinstance(v, bool) for v in self.values):
            given = dict(zip((t.key for t in self.terms), self.values, strict=False))
            raise ValueError(f"coefficients must be numbers, got {given}")
        values = tuple(float(v) for v in self.values)
        object.__setattr__(self, "values", values)
        if len(self.terms) != len(self.values):
            raise ValueError(f"{len(self.values)} values for {len(self.terms)} terms")
        if len({t.key for t in self.terms}) != len(self.terms):
            raise ValueError(f"terms appear twice: {[t.key for t in self.terms]}")
        bad = {term.key: value for term, value in self._pairs if not np.isfinite(value)}
        if bad:
            raise ValueError(
                f"coefficients must be finite, got {bad}: correct them, or leave their terms out"
            )

    @classmethod
    def from_coefficients(
        cls,
        coefficients: Mapping[str, float],
        unit: str | None = None,
        amplitude_range: tuple[float, float] | None = None,
    ) -> Self:
        """Build a model from named coefficients.

        Raises
        ------
        ValueError
            If a name is not known (see `romsindy.physics.serial.term_from_key`).
        """
        refuse_many(coefficients)
        terms = tuple(term_from_key(key) for key in coefficients)
        return cls(terms, tuple(coefficients.values()), unit, amplitude_range)

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficients by name: "omega^2", "gamma_3", "Upsilon_3", "c_linear", ..."""
        return {term.key: value for term, value in self._pairs}

    @cached_property
    def _pairs(self) -> list[tuple[Term, float]]:
        return list(zip(self.terms, self.values, strict=True))

    @property
    def memories(self) -> dict[MemoryLaw, float]:
        """Forces among the terms that depend on the motion so far, with their coefficients."""
        return {term: value for term, value in self._pairs if isinstance(term, MemoryLaw)}

    def refuse_memory(self, what: str) -> None:
        """Refuse what is asked of the state alone, where a force remembers the motion."""
        if self.memories:
            raise ValueError(
                f"{next(iter(self.memories)).key} remembers the motion, and {what} follows from the"
                " state alone: simulate the model, or take its other terms alone"
            )

    def undamped(self) -> Self:
        """Model without its damping terms."""
        pairs = [(term.undamped(), value) for term, value in self._pairs]
        kept = {term: value for term, value in pairs if term is not None}
        return replace(self, terms=tuple(kept), values=tuple(kept.values()))

    def regularised(self, velocity_scale: float) -> Self:
        """Model whose forces do not jump (see `Term.regularised`); unit of q per second."""
        return replace(self, terms=tuple(t.regularised(velocity_scale) for t in self.terms))

    def to_json(self) -> str:
        """JSON text: type, fields, name and value of every term, unit and amplitude range.

        Every number reads back as the same number, see `romsindy.physics.serial`.
        """
        content = {
            "terms": [{"name": t.key, "value": v, **content_of(t)} for t, v in self._pairs],
            "unit": self.unit,
            "amplitude_range": self.amplitude_range,
        }
        return json_text(content)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read what `to_json` wrote, or ``{"coefficients": {"omega^2": ...}, "unit": ...}``.

        Other entries beside these do not matter: a saved `romsindy.fit.estimate.Estimate` is read
        as the model that it holds.

        Raises
        ------
        ValueError
            If the text is not JSON, or holds no model, or a law that is not known.
        """
        content = read_json(text)
        if not isinstance(content, dict) or not {"terms", "coefficients"} & set(content):
            raise ValueError(
                'the JSON text holds no model: expected {"terms": [...], ...} or'
                ' {"coefficients": {...}, ...}'
            )
        unit, reach = optional_text("unit", content.get("unit")), _reach(content)
        if "coefficients" in content:
            named = table("coefficients", content["coefficients"])
            return cls.from_coefficients({k: finite(k, v) for k, v in named.items()}, unit, reach)
        listed = items("terms", content["terms"])
        refuse_many(listed)
        terms = several(term_of)("terms", listed)
        values = [table(f"terms[{i}]", t, ("value",))["value"] for i, t in enumerate(listed)]
        return cls(
            terms, tuple(finite(f"terms[{i}].value", v) for i, v in enumerate(values)), unit, reach
        )


def refuse_many(terms: Sized) -> None:
    """Refuse more terms than a model may have."""
    if len(terms) > MOST_TERMS:
        raise ValueError(
            f"a model may have {MOST_TERMS} terms, and this one has {len(terms)}: leave some out"
        )


def _reach(content: Mapping[str, Any]) -> tuple[float, float] | None:
    if content.get("amplitude_range") is None:
        return None
    limits = several(finite)("amplitude_range", content["amplitude_range"])
    if len(limits) != 2 or not 0 <= limits[0] <= limits[1]:
        raise ValueError(
            f"amplitude_range = {list(limits)!r:.60} must be null or two numbers, [least, largest],"
            " of at least 0"
        )
    return float(limits[0]), float(limits[1])


def signed_text(value: float, text: str, precision: int, *, latex: bool = False) -> str:
    """A coefficient and what it multiplies, with its sign in front: " + 36 q"."""
    number = f"{abs(value):.{precision}g}"
    if latex and "e" in number:
        mantissa, exponent = number.split("e")
        number = rf"{mantissa} \times 10^{{{int(exponent)}}}"
    separator = r" \, " if latex else " "
    return f" {'-' if value < 0 else '+'} {number}{separator}{text}"
