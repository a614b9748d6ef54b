"""A diagnosis in sentences that its numbers write."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from romsindy.diagnosis.difference import Difference
from romsindy.diagnosis.gap import Gap
from romsindy.diagnosis.tolerance import DEFAULT, KINDS, Tolerance
from romsindy.fit.verdict import PREDICTED, SURE
from romsindy.text import listed

_SOURCES = {
    DEFAULT: "{} would not matter",
    "stated": "tolerance: {}",
    "repeats": "repeat runs differ by {}",
    "reference": "the model misses its own reference record by {}",
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


def percent(share: float) -> str:
    """A part of something in per cent, to two digits."""
    return f"{_two_digits(100 * share)} %"


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}" if np.isfinite(value) else "no end of"


def difference(differences: Sequence[Difference], tolerance: Tolerance, unit: str | None) -> str:
    """Whether simulation and records differ: by how much, over which amplitudes."""
    which = max(
        range(len(differences)), key=lambda i: differences[i].largest(tolerance).excess(tolerance)
    )
    worst = differences[which].worst(tolerance)
    over = _over(worst, unit) + (f" in {differences[which].name}" if len(differences) > 1 else "")
    if worst.apart:
        if differences[which].exceeds(tolerance):
            return (
                f"They differ by {percent(worst.signal)} of the amplitude {over}, and share hardly"
                " any cycles of the same amplitude."
            )
        return f"They agree within {percent(worst.signal)} of the amplitude {over}."
    sure = [k for k in KINDS if worst.excess_of(k, tolerance) > SURE]
    known = _known(tolerance, sure or KINDS)
    if sure:
        over += ", where they differ most" if worst is not differences[which] else ""
        return f"They differ: {_sizes(worst, sure)} {over} ({known})."
    worst = differences[which]  # all of it: chance is smaller there than in a part
    errors = {k: abs(getattr(worst, k)) + getattr(worst, f"{k}_std") for k in KINDS}
    within = listed([f"{percent(errors[k])} {_WHERE[k]}" for k in KINDS])
    return f"They agree within {within} {_over(worst, unit)} ({known})."


def single_swings(log_odds: float) -> str:
    """What is sure although no span of cycles is."""
    return f" Single swings differ ({_odds(log_odds)} against no difference)."


def _over(found: Difference, unit: str | None) -> str:
    low, high = (f"{a:.2g}" for a in found.amplitude)
    return f"over {low} to {high} {unit or '[q]'}"


def _sizes(found: Difference, kinds: Sequence[str]) -> str:
    texts = [f"{percent(abs(getattr(found, k)))} {_WHERE[k]}" for k in kinds]
    if "signal" in kinds and found.noise > 0:
        texts[-1] += f", {_two_digits(found.signal / found.noise)} times the noise,"
    return listed(texts)


def _known(tolerance: Tolerance, kinds: Sequence[str]) -> str:
    sizes = listed([percent(getattr(tolerance, k)) for k in kinds])
    return _SOURCES.get(tolerance.source, f"{tolerance.source}: {{}}").format(sizes)


def odds(log_odds: float, other: str) -> str:
    """Odds against the next explanation, by its name."""
    return f"{_odds(log_odds)} against the next, {other}"


def _odds(log_odds: float) -> str:
    more = "above " if log_odds > _MOST_ODDS else ""
    size = float(_two_digits(float(np.exp(min(log_odds, _MOST_ODDS)))))
    return f"odds {more}{size:.9g} : 1"


def closing(gap: Gap, tolerance: Tolerance, what: str) -> str:
    """How much of the gap closes, on what took no part if there is such."""
    if not gap.matters(tolerance) and gap.before < PREDICTED:
        return f"On {gap.where} the noise hides what it changes."
    share = {0: "nothing", 100: "all"}.get(round(100 * gap.closed), percent(gap.closed))
    return f"{what} {share} of the gap on {gap.where}."


def remainder(gap: Gap, kind: str) -> str:
    """How much is left, and what kind of thing it is."""
    worst = gap.predictions[gap.worst]
    times = f"{_two_digits(gap.after)} times the noise"
    if kind == "noise":
        return f"nothing but noise ({times})."
    return f"{percent(worst.beyond_noise(worst.after))} of the amplitude, {times}{_KINDS[kind]}."
