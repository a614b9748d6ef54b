"""Structures side by side: how each predicts what it has not seen, and which is to be chosen."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from romsindy.fit.refine import Fit
from romsindy.fit.verdict import FALSE_ALARM, ONE_STANDARD_ERROR, TOLD_APART
from romsindy.selection.linearised_fit import Keys

CHOSEN = "chosen"
EQUIVALENT = "not told apart"
WORSE = "predicts cycles worse"
NARROW = "fails at large amplitudes"
INADEQUATE = "does not explain the data"
LOST = "cannot be simulated"


@dataclass(frozen=True, eq=False)
class Structure:
    """One structure, and how it predicts what it has not seen.

    Attributes
    ----------
    keys : tuple of str
        Its free coefficients.
    size : int
        Number of coefficients of the smallest candidate that has all of its terms: a model of
        order 3 with a term of order 9 is one of order 9.
    adequacy : float
        Rms of the residual over the noise.
    excess, excess_std : float
        Squared error over noise of cycles that are each predicted from all others, summed over
        the cycles: what it has more than that of the best candidate, and the standard error of
        this difference. A useless coefficient costs about one; a needed one that lacks costs the
        square of its value over its standard error.
    forecast : float
        Rms error over noise of the cycles of large amplitude (`linearised_fit.LARGE`),
        predicted from all others.
    forecast_p : float
        Probability that a right model errs as much there.
    fit : Fit or None
        Where it was fitted by simulation.
    verdict : str
    """

    keys: Keys
    size: int
    adequacy: float
    excess: float
    excess_std: float
    forecast: float
    forecast_p: float
    fit: Fit | None = None
    verdict: str = ""

    @property
    def name(self) -> str:
        """Short text of its terms, such as "omega^2, gamma 2-5, Upsilon 3-5, c_linear"."""
        return describe(self.keys)

    @property
    def explained(self) -> bool:
        """Whether a fit by simulation explains the data to their noise."""
        return self.fit is not None and self.fit.verdict.explained


def best(compared: Sequence[Structure]) -> Structure:
    """Smallest candidate, then fewest of its terms, within one standard error of the best."""
    left = {c.keys for c in judged(compared) if c.verdict == EQUIVALENT}
    good = [c for c in compared if c.keys in left and c.excess <= ONE_STANDARD_ERROR * c.excess_std]
    if not good:  # the best prediction failed another test
        good = [min((c for c in compared if c.keys in left), key=lambda c: c.excess)]
    return min(good, key=lambda c: (c.size, len(c.keys), c.excess))


def judged(compared: Sequence[Structure], chosen: Structure | None = None) -> list[Structure]:
    """Structures with their verdicts, by number of coefficients.

    A test that none passes is not held against any: of models that are all wrong, too, one may
    predict best.
    """
    left = [c for c in compared if c.verdict != LOST]
    verdicts = {c.keys: c.verdict for c in compared}
    explaining = any(c.explained for c in left)
    tests = (
        (INADEQUATE, lambda c: c.explained or c.fit is None or not explaining),
        (WORSE, lambda c: c.excess <= TOLD_APART * c.excess_std),
        (NARROW, lambda c: c.forecast_p >= FALSE_ALARM),
    )
    for name, passes in tests:
        passed = [c for c in left if passes(c)]
        if passed:
            verdicts |= {c.keys: name for c in left if c not in passed}
            left = passed
    verdicts |= {c.keys: EQUIVALENT for c in left}
    if chosen is not None:
        verdicts[chosen.keys] = CHOSEN
    ordered = sorted(compared, key=lambda c: (len(c.keys), c.excess))
    return [replace(c, verdict=verdicts[c.keys]) for c in ordered]


def describe(keys: Iterable[str]) -> str:
    """Short text of coefficient names: orders that follow each other are joined."""
    names = list(keys)
    words = [key for key in names if key == "omega^2"]
    for family in ("gamma", "Upsilon"):
        orders = [int(key.split("_")[1]) for key in names if key.startswith(f"{family}_")]
        words += [f"{family} {_ranges(sorted(orders))}"] if orders else []
    others = [k for k in names if k != "omega^2" and not k.startswith(("gamma_", "Upsilon_"))]
    return ", ".join([*words, *others])


def _ranges(orders: Sequence[int]) -> str:
    parts: list[list[int]] = []
    for order in orders:
        if parts and order == parts[-1][-1] + 1:
            parts[-1].append(order)
        else:
            parts.append([order])
    return " ".join(str(p[0]) if len(p) == 1 else f"{p[0]}-{p[-1]}" for p in parts)
