"""Which terms do the data ask for? The smallest model that predicts as well as the best one.

Regression in the harmonic domain says where to start. One fit by simulation and its sensitivities
say how well every candidate, and sparse subsets of them, predict what they have not seen
(`linearised_fit`). The few that the data cannot tell apart are fitted by simulation themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from romsindy.fit.estimate import Band
from romsindy.fit.refine import Fit, prepared
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.regression.library import ROMLibrary, library_terms
from romsindy.selection.candidates import CHOSEN, EQUIVALENT, Structure, best, judged
from romsindy.selection.linearised_fit import LARGE, Keys
from romsindy.selection.search import Screen, Search
from romsindy.typing import Array

ORDERS = (3, 5, 7, 9)
# Higher ones join, up to the last of these, where the choice uses the highest there is and leaves
# little: much misfit is not for want of powers.
_MORE_ORDERS, _LITTLE = (11, 13), 1.1
DAMPING = ("quadratic", "coulomb", "q^2 q_dot")
# Comparisons until the choice settles.
_ROUNDS = 10


@dataclass(frozen=True, eq=False, repr=False)
class Selection:
    """The chosen model and the path that led there.

    Attributes
    ----------
    fit : Fit
        Of the chosen model.
    path : tuple of Structure
        Everything that was compared, by number of coefficients.
    message : str
        How the search ended.
    """

    fit: Fit
    path: tuple[Structure, ...]
    message: str

    @property
    def model(self) -> ReducedModel:
        """The chosen model."""
        return self.fit.model

    @property
    def chosen(self) -> Structure:
        """The chosen model's place in the path."""
        return next(c for c in self.path if c.verdict == CHOSEN)

    @property
    def equivalent(self) -> tuple[Structure, ...]:
        """Structures that the data cannot tell from the chosen one."""
        return tuple(c for c in self.path if c.verdict == EQUIVALENT)

    def band(self, amplitudes: ArrayLike) -> Band:
        """Backbone and damping with standard errors that include the choice of the model.

        To the variance of each fitted model that cannot be told apart is added the square of its
        distance from the chosen one, and the mean is taken: K. P. Burnham, D. R. Anderson, "Model
        Selection and Multimodel Inference", 2002, eq. 4.9, with equal weights.

        Parameters
        ----------
        amplitudes : (n,) array
            Half peak to peak, positive, unit of q.
        """
        chosen = self.fit.band(amplitudes)
        others = [c.fit.band(amplitudes) for c in self.equivalent if c.fit is not None]

        def spread(name: str) -> Array:
            middle = getattr(chosen, name)
            squares = [
                getattr(b, f"{name}_std") ** 2 + (getattr(b, name) - middle) ** 2
                for b in (chosen, *others)
            ]
            return np.sqrt(np.mean(squares, axis=0))

        frequency_std, damping_ratio_std = spread("frequency"), spread("damping_ratio")
        return replace(chosen, frequency_std=frequency_std, damping_ratio_std=damping_ratio_std)

    def table(self, rows: int | None = None) -> list[list[str]]:
        """Rows of text, the first the header: the best ``rows`` of the path, by size."""
        ranked = sorted(self.path, key=lambda c: (c.verdict != CHOSEN, c.excess))[:rows]
        head = ["", "terms", "residual/noise", "held-out cycles", "held-out amplitudes", "verdict"]
        return [head, *(_row(c) for c in self.path if c in ranked)]

    def __str__(self) -> str:
        table = self.table(12)
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = [
            "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip()
            for row in table
        ]
        others = len(self.equivalent)
        told = f"The data cannot tell it from {others} of the other structures"
        told = told if others else "It alone predicts as well as the best"
        return "\n".join(
            [
                f"Chosen of {len(self.path)} structures: {self.chosen.name}. {told}"
                f" ({self.message}).",
                "Held-out cycles: squared error over noise beyond the best. Held-out amplitudes:",
                f"above {LARGE:.2g} of the largest, error over noise. ~ not fitted by simulation.",
                *lines,
                "",
                str(self.fit),
            ]
        )

    def __repr__(self) -> str:
        return f"<Selection: {self.chosen.name}; {len(self.equivalent)} not told apart>"


def _row(c: Structure) -> list[str]:
    return [
        str(len(c.keys)),
        c.name,
        f"{c.adequacy:.4f}{'' if c.fit else ' ~'}",
        f"{c.excess:.3g} +- {c.excess_std:.2g}",
        f"{c.forecast:.3g} (p = {c.forecast_p:.2g})",
        c.verdict,
    ]


def default_candidates(
    orders: Sequence[int] = ORDERS, damping: Sequence[str] = DAMPING
) -> list[ROMLibrary]:
    """Stiffness up to each order, inertia up to each order not above it and none.

    Damping is linear alone, with each of ``damping``, and with all of them.
    """
    kinds = [("linear",), *(("linear", kind) for kind in damping), ("linear", *damping)]
    return [
        ROMLibrary(tuple(range(3, inertia + 1)), tuple(range(1, stiffness + 1)), kind)
        for stiffness in orders
        for inertia in (0, *orders)
        if inertia <= stiffness
        for kind in dict.fromkeys(kinds)
    ]


def select_model(
    decays: Decay | Sequence[Decay],
    candidates: Sequence[Any] | None = None,
    *,
    fixed: Mapping[str, float] | None = None,
    sparse: bool = True,
    survivors: int = 3,
    n_jobs: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> Selection:
    """Find the smallest model that explains the data and predicts as well as the best one.

    Every structure is judged by cycles that were left out of its fit, each predicted from all
    others, and by the largest amplitudes, predicted from those below. Of the structures that
    explain the data and predict within one standard error of the best candidate, that of the
    smallest candidate is chosen, with the fewest of its terms. Where none explains the data, the
    same holds without that condition. Models within two standard errors are reported as not told
    apart.

    Parameters
    ----------
    decays : Decay or sequence of Decay
        One channel each.
    candidates : sequence of feature libraries, optional
        Such as `ROMLibrary`; by default `default_candidates`.
    fixed : mapping of str to float, optional
        Known coefficients by name, in SI units of q; every candidate must have them.
    sparse : bool
        Look at subsets of the candidates' terms too.
    survivors : int
        How many of the models that the data cannot tell apart are fitted by simulation.
    n_jobs : int, optional
        Processes for these fits, as in joblib.
    progress : callable, optional
        Called with a line of text at every step.

    Returns
    -------
    Selection
        After an interrupt (Ctrl-C) in the search, the best found so far.

    Raises
    ------
    ValueError
        For no or unusable candidates or decays; the message names the argument and the remedy.
    TrajectoryError
        If none of the most promising candidates can be simulated.
    """
    several = [decays] if isinstance(decays, Decay) else list(decays)
    records = prepared(several, several[0].unit if several else None)
    if survivors < 1:
        raise ValueError(f"survivors = {survivors!r} must be at least 1: the chosen model")
    known = dict(fixed or {})
    libraries = [default_candidates()] if candidates is None else [list(candidates)]
    if candidates is None:
        more = [(*ORDERS, *_MORE_ORDERS[: i + 1]) for i in range(len(_MORE_ORDERS))]
        libraries += [default_candidates(orders) for orders in more]
    stages = [_structures(stage, known) for stage in libraries]
    terms = {term.key: term for term in _terms(libraries[-1])}
    screen = Screen.of([r.decay for r in records], terms, known)
    search = Search(records, screen, terms, progress or (lambda line: None))
    fit = search.first(stages[0])
    message, path = "search complete", search.compare(fit, [fit.free])
    structures = stages.pop(0)
    try:
        for _ in range(_ROUNDS):
            path = search.compare(fit, structures, sparse)
            winner = best(path)
            grown = winner.adequacy < _LITTLE and _highest(structures) & set(winner.keys)
            if stages and grown:
                structures = stages.pop(0)
            elif winner.fit is not None:
                break
            else:
                fit = search.fit(winner.keys) or fit
        path = search.survivors(path, survivors, n_jobs)
    except KeyboardInterrupt:
        message = "interrupted before the search was complete"
    winner = best([c for c in path if c.fit is not None])
    assert winner.fit is not None
    return Selection(winner.fit, tuple(judged(path, winner)), message)


def _terms(libraries: Sequence[Any]) -> list[Term]:
    """Terms of all candidates, each once."""
    terms = [term for library in libraries for term in library_terms(library)]
    return list({term.key: term for term in terms}.values())


def _highest(structures: Sequence[Keys]) -> set[str]:
    """Coefficients of the highest order of stiffness and of inertia."""
    powers = {key for keys in structures for key in keys if key.startswith(("gamma_", "Upsilon_"))}
    top = max((int(key.split("_")[1]) for key in powers), default=0)
    return {f"gamma_{top}", f"Upsilon_{top}"}


def _structures(libraries: Sequence[Any], fixed: Mapping[str, float]) -> list[Keys]:
    """The free coefficients of every candidate."""
    if not libraries:
        raise ValueError("candidates is empty: give at least one library, such as ROMLibrary()")
    structures = []
    for i, library in enumerate(libraries):
        own = [term.key for term in library_terms(library)]
        missing = sorted(set(fixed) - set(own))
        if missing:
            raise ValueError(f"fixed names {missing}, which candidate {i} has not: add the terms")
        free = tuple(key for key in own if key not in fixed)
        if not free:
            raise ValueError(f"candidate {i} has no free coefficient: leave one to fit")
        structures.append(free)
    return list(dict.fromkeys(structures))
