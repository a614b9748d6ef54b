"""Marks of a diagnosis against what was hidden, and the line of a table that they add up to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

# The same in the frequency, or the damping, of one mode, or in the response of a linear one: one
# for another counts where the report says that they are not told apart.
ALIKE = ({"linear_frequency", "added_mass"}, {"gain", "input_gain"})
# Effects that laws of the generator are cases of.
ALSO_CALLED = {"jenkins": {"micro_slip"}, "iwan": {"micro_slip"}}


@dataclass(frozen=True)
class Said:
    """What a report said: verdict, names of the best, and of all that are not told apart."""

    verdict: str
    names: tuple[str, ...]
    equivalent: tuple[tuple[str, ...], ...]
    moved: tuple[str, ...] = ()
    members: tuple[str, ...] = ()  # of a family that was told

    @classmethod
    def of(cls, report: Any) -> Said:
        """Read a report of a model, of a beam or of two modes; a value that moved is no name."""
        whose = [getattr(report, part, None) for part in ("reduced", "one_coordinate")]
        best = next((of for of in whose if of is not None), report).best
        names = tuple(report.names) if hasattr(report, "names") else best.names
        family = getattr(report, "family", None)
        members = family.members if family is not None else ()
        return cls(report.verdict, names, tuple(report.equivalent), tuple(best.moved), members)


def marks(said: Said, hidden: Sequence[str], excused: Sequence[str] = ()) -> dict[str, bool]:
    """Right first, in the set, named and wrong; right first or of the family that was told.

    Parameters
    ----------
    said : Said
    hidden : names
        Nothing: then only "none" is right, and every name is wrong.
    excused : names
        Said beside what is hidden, or where nothing is: the hum that is really there.
    """
    truth = frozenset(hidden)
    names = _without(said.names, excused, truth)
    sets = {_without(s, excused, truth) for s in said.equivalent} | {names}
    answered = said.verdict in ("named", "ambiguous")
    if not truth:
        right = said.verdict == "none" or (answered and not names)
        wrong = said.verdict == "named" and bool(names)
        return {"right": right, "in_set": right, "wrong": wrong, "family": right}
    in_set = answered and any(_same(s, truth) for s in sets)
    alike = names and any(names | truth <= a for a in ALIKE)
    right = bool(in_set and (_same(names, truth) or alike))
    wrong, told = said.verdict == "named" and not right, truth <= {*said.members}
    return {"right": right, "in_set": in_set, "wrong": wrong, "family": right or told}


def of_a_stranger(said: Said) -> dict[str, bool]:
    """What is in no catalogue: right is not to name anything, and not to deny it."""
    right = said.verdict in ("unknown", "ambiguous")
    wrong = said.verdict == "named"
    return {"right": right, "in_set": right, "wrong": wrong, "family": right}


def _same(said: frozenset[str], truth: frozenset[str]) -> bool:
    return said == truth or any(said == ALSO_CALLED.get(t) and len(truth) == 1 for t in truth)


def _without(names: Sequence[str], excused: Sequence[str], truth: frozenset[str]) -> frozenset[str]:
    return frozenset(names) - (frozenset(excused) - truth)


def line(name: str, results: Sequence[dict], asked: str) -> str:
    """One row of the table."""
    n = len(results)
    if not n:
        return f"{name:22} nothing yet; asked: {asked}"
    counts = {k: sum(r[k] for r in results) for k in ("right", "in_set", "wrong")}
    family = sum(r.get("family", r["right"]) for r in results)  # older results tell none
    sizes = [max(len(r["equivalent"]), 1) for r in results if r["verdict"] != "none"]
    seconds = [r["seconds"] for r in results]
    verdicts = Counter(r["verdict"] for r in results)
    parts = [
        f"{name:22} n {n:3}  right {counts['right']:3} ({counts['right'] / n:4.0%})",
        f"in set {counts['in_set']:3} ({counts['in_set'] / n:4.0%})",
        f"named and wrong {counts['wrong']:2}",
        f"right, or its family told {family:3} ({family / n:4.0%})",
        f"names in a set {np.mean(sizes) if sizes else 0:.2f}",
        " ".join(f"{k} {v}" for k, v in sorted(verdicts.items())),
        f"{np.median(seconds):.1f} s, at most {max(seconds):.0f}",
    ]
    return "  ".join(parts) + f"\n{'':22} asked: {asked}"


def _gap(result: dict) -> str:
    if "error" in result:
        return result["error"]
    return f"{result['before']:.3g} -> {result['after']:.3g}"


def problems(results: Sequence[dict]) -> list[str]:
    """One line for each diagnosis that was not right first."""
    return [
        f"  {r['trial']:16} {'+'.join(r['hidden']) or 'nothing':18} {r['about']:28}"
        f" {r['verdict']:9} {' | '.join('+'.join(s) for s in r['equivalent'][:4])}"
        f" {'in set' if r['in_set'] else 'WRONG' if r['wrong'] else ''}"
        f" {_gap(r)}"
        for r in results
        if not r["right"]
    ]
