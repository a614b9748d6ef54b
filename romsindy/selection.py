"""Which terms do the data ask for? The smallest model that predicts as well as the best one.

Regression in the harmonic domain says where to start. One fit by simulation and its sensitivities
say how well every candidate, and sparse subsets of them, predict what they have not seen
(`romsindy.tangent`). The few that the data cannot tell apart are fitted by simulation themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import ArrayLike
from scipy.linalg import lstsq

from romsindy.contenders import (
    CHOSEN,
    EQUIVALENT,
    LOST,
    Contender,
    best,
    describe,
    judged,
)
from romsindy.decay import Decay
from romsindy.harmonic import HarmonicProjection, Rows
from romsindy.library import ROMLibrary, library_terms
from romsindy.model import ReducedModel
from romsindy.refine import Band, Fit, refine
from romsindy.regression import row_weights
from romsindy.tangent import LARGE, Keys, Tangent
from romsindy.terms import Term
from romsindy.trajectory import TrajectoryError
from romsindy.typing import Array, Indices

ORDERS = (3, 5, 7, 9)
# Higher ones join, up to the last of these, where the choice uses the highest there is and leaves
# little: much misfit is not for want of powers.
_MORE_ORDERS, _LITTLE = (11, 13), 1.1
DAMPING = ("quadratic", "coulomb", "q^2 q_dot")
# Cycles are dealt into this many parts for the screening by regression.
_FOLDS = 5
# Best candidates of the screening that are tried as a start; and comparisons until it settles.
_TRIES, _ROUNDS = 6, 10


@dataclass(frozen=True, eq=False, repr=False)
class Selection:
    """The chosen model and the path that led there.

    Attributes
    ----------
    fit : Fit
        Of the chosen model.
    path : tuple of Contender
        Everything that was compared, by number of coefficients.
    message : str
        How the search ended.
    """

    fit: Fit
    path: tuple[Contender, ...]
    message: str

    @property
    def model(self) -> ReducedModel:
        """The chosen model."""
        return self.fit.model

    @property
    def chosen(self) -> Contender:
        """The chosen model's place in the path."""
        return next(c for c in self.path if c.verdict == CHOSEN)

    @property
    def equivalent(self) -> tuple[Contender, ...]:
        """Contenders that the data cannot tell from the chosen one."""
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

        return replace(
            chosen, frequency_std=spread("frequency"), damping_ratio_std=spread("damping_ratio")
        )

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
        told = (
            f"The data cannot tell it from {others} of the other structures"
            if others
            else "It alone predicts as well as the best"
        )
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


def _row(c: Contender) -> list[str]:
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

    Every contender is judged by cycles that were left out of its fit, each predicted from all
    others, and by the largest amplitudes, predicted from those below. Of the contenders that
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
    if not several:
        raise ValueError("decays is empty: give at least one Decay")
    if survivors < 1:
        raise ValueError(f"survivors = {survivors!r} must be at least 1: the chosen model")
    known = dict(fixed or {})
    libraries = [default_candidates()] if candidates is None else [list(candidates)]
    if candidates is None:
        more = [(*ORDERS, *_MORE_ORDERS[: i + 1]) for i in range(len(_MORE_ORDERS))]
        libraries += [default_candidates(orders) for orders in more]
    stages = [_structures(stage, known) for stage in libraries]
    terms = {term.key: term for term in _terms(libraries[-1])}
    screen = _Screen.of(several, terms, known)
    search = _Search(several, screen, terms, progress or (lambda line: None))
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


@dataclass(frozen=True, eq=False)
class _Screen:
    """Rows of the regression in the harmonic domain, shared by all candidates: its columns."""

    columns: dict[str, Array]
    target: Array
    cycle: Indices
    fixed: Mapping[str, float]
    unit: str | None

    @classmethod
    def of(
        cls, decays: Sequence[Decay], terms: Mapping[str, Term], fixed: Mapping[str, float]
    ) -> _Screen:
        projection = HarmonicProjection()
        conditioned = [d.single().conditioned() for d in decays]
        rows = Rows.stacked([projection.rows(list(terms.values()), d) for d in conditioned])
        weights = np.sqrt(row_weights(rows))
        columns = dict(zip(terms, rows.theta.T * weights, strict=True))
        target = rows.target * weights
        for key, value in fixed.items():
            target = target - value * columns[key]
        return cls(columns, target, rows.cycle, fixed, decays[0].unit)

    def ranked(self, structures: Sequence[Keys]) -> list[Keys]:
        """The smallest within one standard error of the best first, then by error."""
        errors = {keys: self._errors(keys) for keys in structures}
        ranked = sorted(structures, key=lambda keys: float(errors[keys].sum()))
        excess = {keys: errors[keys] - errors[ranked[0]] for keys in ranked}
        good = [k for k, e in excess.items() if e.sum() <= e.std() * np.sqrt(len(e))]
        return list(dict.fromkeys([min(good, key=len), *ranked]))

    def _errors(self, keys: Keys) -> Array:
        """Squared error of every cycle, predicted from others, (n_cycles,)."""
        x, _ = self._scaled(keys)
        rest = np.empty_like(self.target)
        for fold in range(_FOLDS):
            out = self.cycle % _FOLDS == fold
            solution = lstsq(x[~out], self.target[~out], cond=1e-12)[0]
            rest[out] = self.target[out] - x[out] @ solution
        return np.asarray(np.bincount(self.cycle, rest**2), float)

    def solve(self, keys: Keys) -> dict[str, float]:
        """Coefficients by least squares."""
        x, scale = self._scaled(keys)
        solution = lstsq(x, self.target, cond=1e-12)[0] / scale
        return dict(zip(keys, solution.tolist(), strict=True))

    def _scaled(self, keys: Keys) -> tuple[Array, Array]:
        x = np.stack([self.columns[key] for key in keys], axis=1)
        scale = np.sqrt(np.mean(x**2, axis=0))
        scale = np.where(scale > 0, scale, 1.0)
        return x / scale, scale


@dataclass(eq=False)
class _Search:
    """Fits that were made so far, and where new ones start."""

    decays: list[Decay]
    screen: _Screen
    terms: dict[str, Term]
    progress: Callable[[str], None]
    tangent: Tangent | None = None
    fits: dict[Keys, Fit | None] = field(default_factory=dict)

    def first(self, structures: Sequence[Keys]) -> Fit:
        """Fit a candidate whose regression predicts held-out cycles well."""
        self.progress(f"screening {len(structures)} candidates by regression")
        order = self.screen.ranked(structures)[:_TRIES]
        for keys in order:
            fit = self.fit(keys)
            if fit is not None:
                return fit
        raise TrajectoryError(
            f"none of the {len(order)} candidates that regression finds best can be simulated,"
            f" the first of them {describe(order[0])}: give candidates with fewer terms, or look"
            " at the decay for what is not free vibration of one mode"
        )

    def fit(self, keys: Keys) -> Fit | None:
        """Fit by simulation; None where the model cannot be simulated."""
        self.progress(f"fitting {describe(keys)}")
        self.fits[keys] = _refined(self.decays, self._starts(keys), self.screen.fixed)
        return self.fits[keys]

    def compare(
        self, fit: Fit, structures: Sequence[Keys], sparse: bool = False
    ) -> list[Contender]:
        """Every structure beside the others, seen from one fit."""
        every = dict.fromkeys([*structures, *self.fits])
        used = {key for keys in every for key in keys}
        tangent = Tangent.at(fit, [term for key, term in self.terms.items() if key in used])
        self.tangent = tangent
        errors = {keys: tangent.cycle_errors(keys) for keys in every}
        if sparse:
            start = min(errors, key=lambda keys: float(errors[keys].sum()))
            for keys in [*_largest(structures), start]:
                for step in tangent.sparse_path(keys):
                    if step not in errors:
                        errors[step] = tangent.cycle_errors(step)
        self.progress(f"compared {len(errors)} structures, seen from {describe(fit.free)}")
        return self._contenders(tangent, errors, structures)

    def _contenders(
        self, tangent: Tangent, errors: Mapping[Keys, Array], structures: Sequence[Keys]
    ) -> list[Contender]:
        # Where a model was fitted by simulation, what the tangent has not seen is added.
        bent = {keys: self._bend(tangent, keys) for keys in errors}
        totals = {keys: float(e.sum()) + bent[keys] for keys, e in errors.items()}
        # Sparse subsets were sought for their small error: they are no fair measure of the others.
        leader = min(structures, key=lambda keys: totals[keys])
        sizes = [(len(keys), set(keys)) for keys in structures]
        contenders = []
        for keys, error in errors.items():
            difference = error - errors[leader]
            fit = self.fits.get(keys)
            residual = (tangent.chi_squared(keys) + bent[keys]) / tangent.freedom(keys)
            contenders.append(
                Contender(
                    keys,
                    min(size for size, whole in sizes if whole >= set(keys)),
                    fit.adequacy if fit else float(np.sqrt(residual)),
                    totals[keys] - totals[leader],
                    float(np.std(difference) * np.sqrt(len(difference))),
                    *tangent.forecast(keys),
                    fit,
                    LOST if keys in self.fits and fit is None else "",
                )
            )
        return contenders

    def _bend(self, tangent: Tangent, keys: Keys) -> float:
        fit = self.fits.get(keys)
        if fit is None:
            return 0.0
        pairs = zip(fit.residuals, fit.noise, strict=True)
        return sum(float(r @ r) / n.std**2 for r, n in pairs) - tangent.chi_squared(keys)

    def survivors(self, path: list[Contender], count: int, n_jobs: int | None) -> list[Contender]:
        """Fit the best of those that cannot be told apart by simulation, too."""
        equal = [c for c in judged(path) if c.verdict == EQUIVALENT]
        new = [c for c in sorted(equal, key=lambda c: c.excess) if c.fit is None][: count - 1]
        self.progress(f"fitting {len(new)} that may be as good")
        jobs = [
            delayed(_refined)(self.decays, self._starts(c.keys), self.screen.fixed) for c in new
        ]
        fits = dict(zip((c.keys for c in new), Parallel(n_jobs)(jobs), strict=True))
        return [
            replace(
                c,
                fit=fits[c.keys],
                adequacy=fits[c.keys].adequacy if fits[c.keys] else c.adequacy,
                verdict="" if fits[c.keys] else LOST,
            )
            if c.keys in fits
            else c
            for c in path
        ]

    def _starts(self, keys: Keys) -> list[ReducedModel]:
        """Coefficients from the tangent, if there is one, and from regression."""
        known = dict(self.screen.fixed)
        solutions = [self.tangent.solve(keys)] if self.tangent else []
        return [
            ReducedModel(
                tuple(self.terms[key] for key in (*keys, *known)),
                (*values.values(), *known.values()),
                self.screen.unit,
            )
            for values in [*solutions, self.screen.solve(keys)]
        ]


def _refined(
    decays: list[Decay], starts: Sequence[ReducedModel], fixed: Mapping[str, float]
) -> Fit | None:
    for start in starts:
        try:
            fit = refine(start, decays, fixed=tuple(fixed))
        except TrajectoryError:
            continue
        if fit.message.startswith("interrupted"):
            raise KeyboardInterrupt
        return fit
    return None


def _largest(structures: Sequence[Keys]) -> list[Keys]:
    """Structures that are part of no other one."""
    sets = [frozenset(keys) for keys in structures]
    return [
        keys for keys, own in zip(structures, sets, strict=True) if not any(own < s for s in sets)
    ]
