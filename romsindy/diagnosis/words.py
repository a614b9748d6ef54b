"""A diagnosis in sentences that its numbers write."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from romsindy.diagnosis.difference import DEFAULT, KINDS, WIDEST, Difference, Tolerance
from romsindy.diagnosis.found import FoundEffect
from romsindy.diagnosis.gap import Gap
from romsindy.fit.verdict import PREDICTED, SURE
from romsindy.text import Shown, left_over, listed, percent, two_digits

_SOURCES = {
    DEFAULT: "{} would not matter",
    "stated": "tolerance: {}",
    "repeats": "repeat runs differ by {}",
    "reference": "the model misses its own reference record by {}",
    "bands": "the model itself is known to {}",
}
_WHERE = {"frequency": "in frequency", "damping": "in damping", "signal": "in waveform"}
_MOST_ODDS = np.log(1e6)  # more depends on what no model of the noise knows
_KINDS = {
    "tolerance": ", which does not matter",
    "form": ", of the size by which the model misses its own reference record: its form, not a"
    " further effect",
    "little": ", less than 1 % of the squared gap: too little to name an effect",
    "effect": ", more than the form of the model leaves: a further effect, or another one",
}


def difference(differences: Sequence[Difference], tolerance: Tolerance, shown: Shown) -> str:
    """Whether simulation and records differ: by how much, over which amplitudes."""
    which = max(
        range(len(differences)), key=lambda i: differences[i].largest(tolerance).excess(tolerance)
    )
    worst = differences[which].worst(tolerance)
    over = f"over {shown.told(*worst.amplitude)}"
    over += f" in {differences[which].name}" if len(differences) > 1 else ""
    if worst.apart:
        if differences[which].exceeds(tolerance):
            return (
                f"They differ by {percent(worst.signal)} of the amplitude {over}, and share hardly"
                " any cycles of the same amplitude."
            )
        return f"They agree within {percent(worst.signal)} of the amplitude {over}."
    sure = [k for k in KINDS if worst.excess_of(k, tolerance) > SURE]
    if sure:
        known = tolerated(tolerance.over(*worst.amplitude), sure)
        over += ", where they differ most" if worst is not differences[which] else ""
        return f"They differ: {_sizes(worst, sure)} {over} ({known})."
    # All of it, of every record: chance is smaller there than in a part.
    several = [d for d in differences if not d.apart]
    ends = [d.amplitude for d in several]
    reach = min(low for low, _ in ends), max(high for _, high in ends)
    over, known = f"over {shown.told(*reach)}", tolerated(tolerance.over(*reach))
    told = {k: f"{percent(max(d.bound(k) for d in several))} {_WHERE[k]}" for k in KINDS}
    agree = [
        text
        for k, text in told.items()
        if all(d.agrees(k, tolerance.over(*d.amplitude)) for d in several)
    ]
    may_differ = [text for text in told.values() if text not in agree]
    if not may_differ:
        return f"They agree within {listed(agree)} {over} ({known})."
    unsure = f"may differ by {listed(may_differ)}, which these records do not determine ({known})."
    return f"They agree within {listed(agree)} {over}, and {unsure}" if agree else f"They {unsure}"


def single_swings(log_odds: float) -> str:
    """What is sure although no span of cycles is."""
    return f" Single swings differ ({_odds(log_odds)} against no difference)."


def _sizes(found: Difference, kinds: Sequence[str]) -> str:
    texts = [f"{percent(abs(getattr(found, k)))} {_WHERE[k]}" for k in kinds]
    if "signal" in kinds and found.noise > 0:
        texts[-1] += f", {two_digits(found.signal / found.noise)} times the noise,"
    return listed(texts)


def tolerated(tolerance: Tolerance, kinds: Sequence[str] = KINDS) -> str:
    """What is tolerated of each kind, with those of one source together."""
    of: dict[str, list[str]] = {}
    for kind in kinds:
        of.setdefault(tolerance.source_of(kind), []).append(kind)
    told = []
    for source, some in of.items():
        where = [f" {_WHERE[k]}" if len(of) > 1 else "" for k in some]
        sizes = [f"{percent(getattr(tolerance, k))}{w}" for k, w in zip(some, where, strict=True)]
        told.append(_SOURCES.get(source, f"{source}: {{}}").format(listed(sizes)))
    return "; ".join(told)


def undetermined(tolerance: Tolerance) -> list[str]:
    """What repeats or a reference were too far apart for, a sentence each."""
    return [
        f"{_SOURCES[source].format(percent(size))} {_WHERE[kind]}, which does not determine it:"
        f" more than {percent(WIDEST[kind])} matters."
        for kind, source, size in tolerance.undetermined
    ]


def odds(log_odds: float, other: str) -> str:
    """Odds against the next explanation, by its name where it is any rival."""
    return f"{_odds(log_odds)} against the next{'' if log_odds > _MOST_ODDS else f', {other}'}"


def _odds(log_odds: float) -> str:
    more = "above " if log_odds > _MOST_ODDS else ""
    size = float(two_digits(float(np.exp(min(log_odds, _MOST_ODDS)))))
    return f"odds {more}{size:.9g} : 1"


def closing(gap: Gap, tolerance: Tolerance, what: str) -> str:
    """How much of the gap closes, on what took no part if there is such."""
    if gap.within(tolerance) and gap.before < PREDICTED:
        return f"On {gap.where} the noise hides what it changes."
    share = {0: "nothing", 100: "all"}.get(round(100 * gap.closed), percent(gap.closed))
    return f"{what} {share} of the gap on {gap.where}."


def confirming(effects: Sequence[FoundEffect]) -> str:
    """What would confirm what was named."""
    return f"to confirm it, {'; '.join(dict.fromkeys(e.advice for e in effects))}."


def within(values: Sequence[FoundEffect]) -> list[str]:
    """Values that moved within their tolerances, a sentence each."""
    return [f"Within its tolerance {value.within}." for value in values]


def remainder(gap: Gap, kind: str) -> str:
    """How much is left, and what kind of thing it is."""
    worst = gap.predictions[gap.worst]
    left = worst.left(worst.after)
    return f"nothing but noise ({left})." if kind == "noise" else f"{left}{_KINDS[kind]}."


def over_sensors(gap: Gap, kind: str, sensor: str, part: float, times: float) -> str:
    """What is left of a beam: in its first mode, and ``part`` and ``times`` of the worst sensor."""
    of_worst = left_over(part, times)
    if times > PREDICTED and kind != "effect":
        first = gap.predictions[gap.worst]
        there = f"{first.left(first.after)} in the coordinate of the first mode"
        return f"{of_worst} at the worst sensor, {sensor}; {there}{_KINDS.get(kind, '')}."
    return f"{remainder(gap, kind).removesuffix('.')}; at the worst sensor, {sensor}, {of_worst}."
