"""How the choice of a model proceeds: screening by regression, then fits by simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from joblib import Parallel, delayed
from scipy.linalg import lstsq

from romsindy.fit.collocation import TrajectoryError
from romsindy.fit.record import Record
from romsindy.fit.refine import Fit, fit_records
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.regression.estimator import row_weights
from romsindy.regression.projection import HarmonicProjection, Rows
from romsindy.selection.candidates import EQUIVALENT, LOST, Structure, describe, judged
from romsindy.selection.linearised_fit import Keys, LinearisedFit
from romsindy.typing import Array, Indices

# Cycles are dealt into this many parts for the screening by regression.
_FOLDS = 5
# Best candidates of the screening that are tried as a start.
_TRIES = 6


@dataclass(frozen=True, eq=False)
class Screen:
    """Rows of the regression in the harmonic domain, shared by all candidates: its columns."""

    columns: dict[str, Array]
    target: Array
    cycle: Indices
    fixed: Mapping[str, float]
    unit: str | None

    @classmethod
    def of(
        cls, decays: Sequence[Decay], terms: Mapping[str, Term], fixed: Mapping[str, float]
    ) -> Screen:
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
class Search:
    """Fits that were made so far, and where new ones start."""

    records: tuple[Record, ...]
    screen: Screen
    terms: dict[str, Term]
    progress: Callable[[str], None]
    linearised: LinearisedFit | None = None
    fits: dict[Keys, Fit | None] = field(default_factory=dict)

    def first(self, structures: Sequence[Keys]) -> Fit:
        """Fit a candidate whose regression predicts held-out cycles well."""
        self.progress(f"screening {len(structures)} candidates by regression")
        order = self.screen.ranked(structures)[:_TRIES]
        for keys in order:
            if (fit := self.fit(keys)) is not None:
                return fit
        raise TrajectoryError(
            f"none of the {len(order)} candidates that regression finds best can be simulated,"
            f" the first of them {describe(order[0])}: give candidates with fewer terms, or look"
            " at the decay for what is not free vibration of one mode"
        )

    def fit(self, keys: Keys) -> Fit | None:
        """Fit by simulation; None where the model cannot be simulated."""
        self.progress(f"fitting {describe(keys)}")
        self.fits[keys] = _refined(self.records, self._starts(keys), self.screen.fixed)
        return self.fits[keys]

    def compare(
        self, fit: Fit, structures: Sequence[Keys], sparse: bool = False
    ) -> list[Structure]:
        """Every structure beside the others, seen from one fit."""
        every = dict.fromkeys([*structures, *self.fits])
        used = {key for keys in every for key in keys}
        terms = [term for key, term in self.terms.items() if key in used]
        self.linearised = linearised = LinearisedFit.at(fit, terms)
        errors = {keys: linearised.cycle_errors(keys) for keys in every}
        if sparse:
            start = min(errors, key=lambda keys: float(errors[keys].sum()))
            for keys in [*_largest(structures), start]:
                for step in linearised.sparse_path(keys):
                    if step not in errors:
                        errors[step] = linearised.cycle_errors(step)
        self.progress(f"compared {len(errors)} structures, seen from {describe(fit.free)}")
        return self._weighed(linearised, errors, structures)

    def _weighed(
        self, linearised: LinearisedFit, errors: Mapping[Keys, Array], structures: Sequence[Keys]
    ) -> list[Structure]:
        # Where a model was fitted by simulation, what the linearised fit has not seen is added.
        bent = {keys: self._bend(linearised, keys) for keys in errors}
        totals = {keys: float(e.sum()) + bent[keys] for keys, e in errors.items()}
        # Sparse subsets were sought for their small error: they are no fair measure of the others.
        leader = min(structures, key=lambda keys: totals[keys])
        sizes = [(len(keys), set(keys)) for keys in structures]
        compared = []
        for keys, error in errors.items():
            difference = error - errors[leader]
            fit = self.fits.get(keys)
            residual = (linearised.chi_squared(keys) + bent[keys]) / linearised.freedom(keys)
            compared.append(
                Structure(
                    keys,
                    min(size for size, whole in sizes if whole >= set(keys)),
                    fit.adequacy if fit else float(np.sqrt(residual)),
                    totals[keys] - totals[leader],
                    float(np.std(difference) * np.sqrt(len(difference))),
                    *linearised.forecast(keys),
                    fit,
                    LOST if keys in self.fits and fit is None else "",
                )
            )
        return compared

    def _bend(self, linearised: LinearisedFit, keys: Keys) -> float:
        fit = self.fits.get(keys)
        return fit.chi_squared - linearised.chi_squared(keys) if fit else 0.0

    def survivors(self, path: list[Structure], count: int, n_jobs: int | None) -> list[Structure]:
        """Fit the best of those that cannot be told apart by simulation, too."""
        equal = [c for c in judged(path) if c.verdict == EQUIVALENT]
        new = [c for c in sorted(equal, key=lambda c: c.excess) if c.fit is None][: count - 1]
        self.progress(f"fitting {len(new)} that may be as good")
        jobs = [
            delayed(_refined)(self.records, self._starts(c.keys), self.screen.fixed) for c in new
        ]
        fits = dict(zip((c.keys for c in new), Parallel(n_jobs)(jobs), strict=True))

        def known(c: Structure) -> Structure:
            if c.keys not in fits:
                return c
            fit = fits[c.keys]
            return replace(c, fit=fit, adequacy=fit.adequacy) if fit else replace(c, verdict=LOST)

        return [known(c) for c in path]

    def _starts(self, keys: Keys) -> list[ReducedModel]:
        """Coefficients from the linearised fit, if there is one, and from regression."""
        known = dict(self.screen.fixed)
        solutions = [self.linearised.solve(keys)] if self.linearised else []
        return [
            ReducedModel(
                tuple(self.terms[key] for key in (*keys, *known)),
                (*values.values(), *known.values()),
                self.screen.unit,
            )
            for values in [*solutions, self.screen.solve(keys)]
        ]


def _refined(
    records: Sequence[Record], starts: Sequence[ReducedModel], fixed: Mapping[str, float]
) -> Fit | None:
    for start in starts:
        try:
            fit = fit_records(start, records, tuple(fixed))
        except TrajectoryError:
            continue
        if fit.solution.interrupted:
            raise KeyboardInterrupt
        return fit
    return None


def _largest(structures: Sequence[Keys]) -> list[Keys]:
    """Structures that are part of no other one."""
    sets = [frozenset(keys) for keys in structures]
    return [
        keys for keys, own in zip(structures, sets, strict=True) if not any(own < s for s in sets)
    ]
