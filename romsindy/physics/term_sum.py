"""Terms with their coefficients: names, checks and JSON that all models share.

Every number that is written reads back as the same number. JSON has no infinity and no NaN: they
are the strings "Infinity", "-Infinity" and "NaN", as in the JSON of protocol buffers
(https://protobuf.dev/programming-guides/json/), which Python's ``float`` and JavaScript's
``Number`` understand.
"""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Iterable, Mapping, Sequence, Sized
from dataclasses import dataclass, fields, replace
from functools import cached_property
from inspect import isabstract
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

from romsindy.physics import coupling, inertia, input, stiffness  # noqa: F401
from romsindy.physics.damping import DAMPING
from romsindy.physics.memory import MemoryLaw
from romsindy.physics.term import (
    MOST_COORDINATES,
    MOST_ORDER,
    MOST_TERMS,
    Term,
    law_called,
    type_name,
)
from romsindy.physics.validation import (
    finite,
    items,
    made,
    number,
    optional_text,
    several,
    table,
    text,
    whole,
)

_NAMES = (*(law.key for law in DAMPING.values()), "omega^2", "beta_1", "beta_2")


def term_from_key(key: str) -> Term:
    """Return the law whose coefficient is called ``key``.

    Raises a ValueError if no law has this key; the message names the keys there are and the nearest
    one.
    """
    term = law_called(key)
    if term is not None:
        return _small(term)
    near = difflib.get_close_matches(key, [*_NAMES, "gamma_2", "gamma_3", "Upsilon_3"], n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise ValueError(
        f"coefficient name {key!r} is not known: use {', '.join(_NAMES)}, gamma_m or Upsilon_k"
        f" (m, k >= 2); of several coordinates, each with [q1] behind it, V q1^2 q2, g(q1 q2)^2 or"
        f" C_12{hint}"
    )


def json_text(content: Mapping[str, Any] | Sequence[Any]) -> str:
    """Content of laws, arrays and numbers as JSON that every reader accepts."""
    return json.dumps(_plain(content), indent=2, allow_nan=False)


def read_json(text: str) -> Any:
    """Content of a JSON text.

    Raises a ValueError if it is none, or gives a name twice in one place.
    """
    try:
        return json.loads(text, object_pairs_hook=_once)
    except RecursionError as error:
        raise ValueError("the text nests brackets deeper than any model") from error
    except json.JSONDecodeError as error:
        raise ValueError(
            "the text is no JSON, or only the beginning of one (it cannot be read from line"
            f" {error.lineno}, column {error.colno} on): mend it there, or write the file again"
        ) from error


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in found if names.count(name) > 1)
        raise ValueError(f"the JSON text gives {twice!r:.60} twice in one place: keep one of them")
    return found


def _small(term: Term) -> Term:
    """The term, unless no model has an order, or so many coordinates, as this one."""
    order, coordinates = term.dimension[0], getattr(term, "n_coordinates", 1)
    if not abs(order) <= MOST_ORDER:
        raise ValueError(
            f"{term.key!r:.60} is of order {order:.6g}, beyond {MOST_ORDER}, the most that a model"
            " may have: leave it out, or correct its order"
        )
    if coordinates > MOST_COORDINATES:
        raise ValueError(
            f"{term.key!r:.60} is of {coordinates} coordinates, and {MOST_COORDINATES} are the most"
            " that a model may have: leave it out"
        )
    return term


def content_of(term: Term) -> dict[str, Any]:
    """Type and fields of a law."""
    values = {f.name: getattr(term, f.name) for f in fields(term)}  # type: ignore[arg-type]
    return {"type": type_name(type(term)), **values}


def _plain(value: Any) -> Any:
    if isinstance(value, Term):
        return _plain(content_of(value))
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {name: _plain(v) for name, v in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return json.dumps(value)  # the name that Python's JSON has for it, as a string
    return value


def term_of(name: str, value: Any) -> Term:
    """The law that `content_of` describes; a name and a value beside it do not matter.

    ``name`` is where it stands, as messages tell it. Raises a ValueError if its type is not known
    or has other fields; a law of your own must be imported first.
    """
    content = table(name, value, ("type",))
    kind = Term.kinds.get(text(f"{name}.type", content["type"]))
    if kind is None or isabstract(kind):
        known = sorted(key for key, law in Term.kinds.items() if not isabstract(law))
        raise ValueError(
            f"{name}.type = {content['type']!r:.60} is no law that is known here: import the module"
            f" that defines it first; known are {', '.join(known)}"
        )
    own = {k: v for k, v in content.items() if k not in ("type", "name", "value")}
    ours = kind.__module__.startswith("romsindy.")
    return _small(made(kind, name, own, _FIELDS if ours else _FOREIGN))


def _any(name: str, value: Any) -> Any:
    """A field of a law from elsewhere, whatever it states."""
    if isinstance(value, dict):
        return term_of(name, value)
    return several(_any)(name, value) if isinstance(value, list) else value


# How fields of laws are read, beside those that any dataclass may have.
_FIELDS = {
    "float": finite,
    "tuple[float, ...]": several(finite),
    "Powers": several(whole),
    "Interpolation": text,
    "Term": term_of,
    "tuple[Term, ...]": several(term_of),
}
_FOREIGN = {**_FIELDS, "float": number, "": _any}


if TYPE_CHECKING:
    from typing_extensions import Self


@dataclass(frozen=True)
class TermSum:
    """Terms of an equation of motion, each with its coefficient: fields as of a `ReducedModel`."""

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
        object.__setattr__(self, "values", tuple(float(v) for v in self.values))
        if len(self.terms) != len(self.values):
            raise ValueError(f"{len(self.values)} values for {len(self.terms)} terms")
        if len({t.key for t in self.terms}) != len(self.terms):
            raise ValueError(f"terms appear twice: {[t.key for t in self.terms]}")
        bad = {term.key: value for term, value in self.pairs if not np.isfinite(value)}
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
            If a name is not known (see `romsindy.physics.term_sum.term_from_key`).
        """
        refuse_many(coefficients)
        terms = tuple(term_from_key(key) for key in coefficients)
        return cls(terms, tuple(coefficients.values()), unit, amplitude_range)

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficients by name: "omega^2", "gamma_3", "Upsilon_3", "c_linear", ..."""
        return {term.key: value for term, value in self.pairs}

    @cached_property
    def pairs(self) -> list[tuple[Term, float]]:
        """Terms, each with its coefficient."""
        return list(zip(self.terms, self.values, strict=True))

    def with_terms(self, pairs: Iterable[tuple[Term | None, float]]) -> Self:
        """Model of other terms, each with its coefficient; None is left out."""
        kept = {term: value for term, value in pairs if term is not None}
        return replace(self, terms=tuple(kept), values=tuple(kept.values()))

    @property
    def memories(self) -> dict[MemoryLaw, float]:
        """Forces among the terms that depend on the motion so far, with their coefficients."""
        return {term: value for term, value in self.pairs if isinstance(term, MemoryLaw)}

    def refuse_memory(self, what: str) -> None:
        """Refuse what is asked of the state alone, where a force remembers the motion."""
        if self.memories:
            raise ValueError(
                f"{next(iter(self.memories)).key} remembers the motion, and {what} follows from the"
                " state alone: simulate the model, or take its other terms alone"
            )

    def undamped(self) -> Self:
        """Model without its damping terms."""
        return self.with_terms((term.undamped(), value) for term, value in self.pairs)

    def regularised(self, velocity_scale: float) -> Self:
        """Model whose forces do not jump (see `Term.regularised`); unit of q per second."""
        return replace(self, terms=tuple(t.regularised(velocity_scale) for t in self.terms))

    def to_json(self) -> str:
        """JSON text: type, fields, name and value of every term, unit and amplitude range.

        Every number reads back as the same number, see `romsindy.physics.term_sum`.
        """
        content = {
            "terms": [{"name": t.key, "value": v, **content_of(t)} for t, v in self.pairs],
            "unit": self.unit,
            "amplitude_range": self.amplitude_range,
        }
        return json_text(content)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read what `to_json` wrote, or ``{"coefficients": {"omega^2": ...}, "unit": ...}``.

        Other entries beside these do not matter: a saved `romsindy.fit.results.estimate.Estimate`
        is read as the model that it holds.

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
