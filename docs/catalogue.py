"""The catalogue of effects, from themselves: ``python docs/catalogue.py``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import fields

from fingerprint import Fingerprint, fingerprint

from romsindy.effects import BEAM_CATALOGUE, CATALOGUE, look_alikes
from romsindy.effects.base import Effect, ReadingEffect, TermEffect
from romsindy.effects.memory import MemoryEffect
from romsindy.typing import Array

_HEAD = ("what is missing", "family", "class")
_FAMILIES = ("damping", "stiffness", "inertia", "time", "outside", "measurement")
_FLAT = 0.02  # of the largest change: what is seen as none
# Values that stand in the text of a law for the names of fields, to be put back.
_STANDING = {"gap": 0.8125, "distance": 0.5625}


def rows(catalogue: Iterable[Effect] = (*CATALOGUE, *BEAM_CATALOGUE)) -> list[tuple[str, ...]]:
    """Rows of text, the first the header; variants of one effect share a row."""
    return [_HEAD, *map(_row, kinds_of(catalogue))]


def page(catalogue: Iterable[Effect] = (*CATALOGUE, *BEAM_CATALOGUE)) -> str:
    """Table and a section for every effect, MyST Markdown; pictures are ``effects/CLASS.svg``."""
    kinds = kinds_of(catalogue)
    head, *body = rows(kinds)
    lines = [head, ("---",) * len(head), *body]
    text = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    for family in _FAMILIES:
        text += f"\n## {family.capitalize()}\n"
        text += "".join(_section(e, kinds) for e in kinds if e.family == family)
    return text


def formula(effect: Effect) -> str:
    """What it adds for a strength of 1, in the names of its fields."""
    if isinstance(effect, MemoryEffect):
        return effect.law.rule()
    named = {f.name for f in fields(effect)} & _STANDING.keys()  # type: ignore[arg-type]
    law = effect.shaped({name: _STANDING[name] for name in named}).term()
    text = effect.formula if law is None else law.expression()
    for name, value in _STANDING.items():
        text = text.replace(str(value), name)
    return text


def described(found: Fingerprint) -> str:
    """What is seen in the picture of a fingerprint."""
    return f"Frequency: {_course(found.frequency)}. Damping ratio: {_course(found.damping_ratio)}."


def kinds_of(catalogue: Iterable[Effect]) -> list[Effect]:
    """The first effect of every class."""
    kinds: dict[type, Effect] = {}
    for effect in catalogue:
        kinds.setdefault(type(effect), effect)
    return list(kinds.values())


def _row(effect: Effect) -> tuple[str, ...]:
    kind = type(effect).__name__
    return f"[{effect.label}](#{kind.lower()})", effect.family, f"`{kind}`"


def _section(effect: Effect, kinds: list[Effect]) -> str:
    kind = type(effect).__name__
    mounting = effect.mounting if isinstance(effect, TermEffect) else None
    where = "reading" if isinstance(effect, ReadingEffect) else "equation of motion"
    named = sorted(fields(effect), key=lambda f: bool(f.kw_only))  # type: ignore[arg-type]
    shape = ", ".join(f.name for f in named)
    parts = [
        f"\n({kind.lower()})=\n### {effect.label[0].upper()}{effect.label[1:]}",
        f"`{kind}({shape})`, named `{effect.name}`, adds to the {where}"
        f"{f'; on a beam {mounting.place}' if mounting else ''}:",
        f"$${_typeset(formula(effect))}$$",
    ]
    found = fingerprint(effect)
    if found is not None:
        parts.append(f"![{described(found)}](effects/{kind}.svg)")
    alike = [e for e in kinds if e.name in look_alikes(effect.name, kinds)]
    links = ", ".join(f"[{e.label}](#{type(e).__name__.lower()})" for e in alike)
    parts.append(f"- *Looks like*: {links or 'nothing else in the catalogue'}.")
    return "\n\n".join(parts) + f"\n- *To tell it apart*: {effect.advice}.\n"


def _course(y: Array) -> str:
    """How a curve runs from small to large amplitudes."""
    if max(abs(y)) < _FLAT:
        return "no change"
    way = "up" if y[abs(y).argmax()] > 0 else "down"
    if y.max() - y.min() < _FLAT:
        return f"{way} alike at all amplitudes"
    size = abs(y)
    if size[-1] > size.max() - _FLAT:
        return f"{way}, more at large amplitudes"
    if size[0] > size.max() - _FLAT:
        return f"{way}, more at small amplitudes"
    return f"{way}, most in between"


_LATEX = (
    (r"\|([^|]+)\|", r"\\left|\1\\right|"),
    (r"q_ddot", r"\\ddot q"),
    (r"q_dot", r"\\dot q"),
    (r"<=", r"\\le "),
    (r"\bzeta\b", r"\\zeta"),
    (r"mean of ", r"\\text{mean of }"),
    (r"; ", r",\\quad "),
    (r"(?<![\\\w{])(?!left|right)([a-z]{3,})(?![a-z])", r"\\operatorname{\1}"),
    (r"\^(-?\w+|\\operatorname{\w+}|-?[\d.]+)", r"^{\1}"),
)


def _typeset(text: str) -> str:
    """The formula as LaTeX."""
    for pattern, latex in _LATEX:
        text = re.sub(pattern, latex, text)
    return text


if __name__ == "__main__":
    print(page(), end="")
