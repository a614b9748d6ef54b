"""The table of effects, from the effects themselves: ``python -m romsindy.effects.table``."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields

from romsindy.effects import BEAM_CATALOGUE, CATALOGUE, look_alikes
from romsindy.effects.base import Effect, TermEffect
from romsindy.effects.memory import MemoryEffect

_HEAD = ("name", "what is missing", "class", "force", "on a beam", "looks like", "to tell apart")
_PAGE = """# Effects

What a diagnosis looks for. `python -m romsindy.effects.table` writes this page from the effects
themselves; CONTRIBUTING.md says how to add one.

"""


def rows(catalogue: Iterable[Effect] = (*CATALOGUE, *BEAM_CATALOGUE)) -> list[tuple[str, ...]]:
    """Rows of text, the first the header; variants of one effect share a row."""
    effects = list({type(effect): effect for effect in catalogue}.values())
    return [_HEAD, *(_row(effect, effects) for effect in effects)]


def _row(effect: Effect, effects: list[Effect]) -> tuple[str, ...]:
    law = effect.law if isinstance(effect, MemoryEffect) else effect.term()
    shape = ", ".join(f.name for f in fields(effect))  # type: ignore[arg-type]
    mounting = effect.mounting if isinstance(effect, TermEffect) else None
    return (
        effect.name,
        effect.label,
        f"`{type(effect).__name__}({shape})`",
        effect.family if law is None else f"`{law.expression()}`",
        "" if mounting is None else mounting.place,
        ", ".join(sorted(look_alikes(effect.name, effects))),
        effect.advice,
    )


def page() -> str:
    """The table as a page of the documentation, Markdown."""
    head, *body = rows()
    lines = [head, ("---",) * len(head), *body]
    cells = [[cell.replace("|", "\\|") for cell in line] for line in lines]
    return _PAGE + "".join(f"| {' | '.join(line)} |\n" for line in cells)


if __name__ == "__main__":
    print(page(), end="")
