"""Laws from the names of their coefficients, and laws as JSON: type and fields, exact.

Every number that is written reads back as the same number. JSON has no infinity and no NaN: they
are the strings "Infinity", "-Infinity" and "NaN", as in the JSON of protocol buffers
(https://protobuf.dev/programming-guides/json/), which Python's ``float`` and JavaScript's
``Number`` understand.
"""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from inspect import isabstract
from typing import Any

import numpy as np

# The laws must be there before they are looked up by name.
from romsindy.physics import (  # noqa: F401
    combination,
    coupling,
    inertia,
    input,
    memory,
    stiffness,
)
from romsindy.physics.damping import DAMPING
from romsindy.physics.entries import finite, made, number, several, table, text, whole
from romsindy.physics.term import (
    MOST_COORDINATES,
    MOST_ORDER,
    Term,
    law_called,
    type_name,
)

_NAMES = (*(law.key for law in DAMPING.values()), "omega^2", "beta_1", "beta_2")


def term_from_key(key: str) -> Term:
    """Return the law whose coefficient is called ``key``.

    Raises
    ------
    ValueError
        If no law has this key; the message names the keys there are and the nearest one.
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

    Raises
    ------
    ValueError
        If it is none, or gives a name twice in one place.
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

    Parameters
    ----------
    name : str
        Where it stands, as messages tell it.
    value : mapping

    Raises
    ------
    ValueError
        If its type is not known or has other fields; a law of your own must be imported first.
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
