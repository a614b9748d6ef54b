"""How well any subset of terms would predict, from the sensitivities of one fit.

Near a fit the simulated motion is linear in the coefficients, and in those that are still zero
too: their sensitivities are known. Measured motion on sensitivities is a linear regression whose
noise is that of the sensor, without the bias of noisy regressors. Subsets of its columns are
candidate models; leaving rows out is leaving cycles out. Where the models explain the data this
agrees with fitting each of them anew.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pysindy as ps
from numpy.typing import NDArray
from scipy.linalg import lstsq
from scipy.signal import freqz
from scipy.stats import f as f_distribution

from romsindy.fit.coefficient import free_coefficients
from romsindy.fit.record import Record
from romsindy.fit.refine import Fit, smoothed
from romsindy.fit.shooting import tables
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.noise import autoregression
from romsindy.typing import Array

Keys = tuple[str, ...]

# Cycles above this part of the largest amplitude are the amplitude range that is held out.
LARGE = 2 / 3


@dataclass(frozen=True, eq=False)
class LinearisedFit:
    """Linear regression of measured motion on its sensitivities, cycle by cycle.

    Rows are compressed to few a cycle. The first columns belong to ``keys``, the others to initial
    states, which every model has.
    """

    keys: Keys
    theta: Array  # (n_cycles, n_rows, n_columns), sensitivities over noise
    target: Array  # (n_cycles, n_rows)
    amplitude: Array  # (n_cycles,), half peak to peak, unit of q
    samples: Array  # (n_cycles,), of the record in each cycle
    colour: float  # part of the samples that count as independent; 1 for white noise

    @classmethod
    def at(cls, fit: Fit, terms: Sequence[Term]) -> LinearisedFit:
        """Linearise about a fit; terms that its model lacks join with coefficient zero."""
        records = fit.records
        keys = tuple(term.key for term in terms if term.key not in _fixed(fit))
        known = fit.model.coefficients
        extra = [term for term in terms if term.key not in known]
        model = ReducedModel(
            (*fit.model.terms, *extra), (*fit.model.values, *np.zeros(len(extra))), fit.model.unit
        )
        model = smoothed(model, records)
        parts = (*free_coefficients(model, keys), *fit.solution.parts[len(fit.free) :])
        values = np.array([model.coefficients[key] for key in keys])
        blocks, amplitudes, samples = [], [], []
        for i, rows in enumerate(tables(model, parts, records, fit.solution.motions)):
            # Coefficients themselves are sought, and changes of offsets and states.
            rows[:, -1] += rows[:, : len(keys)] @ values
            for a, b in _cycles(records[i]):
                blocks.append(_compressed(rows[a:b]))
                amplitudes.append(np.ptp(records[i].decay.q[a:b]) / 2)
                samples.append(b - a)
        width = blocks[0].shape[1]
        rows = np.array([np.pad(block, ((0, width - len(block)), (0, 0))) for block in blocks])
        colour = min(
            _independent(r.whitened(e)) for r, e in zip(records, fit.residuals, strict=True)
        )
        return cls(
            keys, rows[..., :-1], rows[..., -1], np.array(amplitudes), np.array(samples), colour
        )

    def solve(self, keys: Sequence[str]) -> dict[str, float]:
        """Coefficients of a model with these terms, by least squares."""
        x, scale = self._columns(keys)
        solution = lstsq(_flat(x), self.target.ravel(), cond=1e-13)[0] / scale
        return dict(zip(keys, solution[: len(keys)].tolist(), strict=True))

    def chi_squared(self, keys: Sequence[str]) -> float:
        """Sum of squared residuals over noise of a model with these terms."""
        return _misfit(np.concatenate(self._ranges)[:, self._table(keys)])

    def freedom(self, keys: Sequence[str]) -> int:
        """Number of samples less that of the fitted values."""
        return int(self.samples.sum()) - len(keys) - (self.theta.shape[2] - len(self.keys))

    def cycle_errors(self, keys: Sequence[str]) -> Array:
        """Squared error over noise of each cycle, predicted by the fit to all others, (n_cycles,).

        Exact, without fitting again: with H the hat matrix, the residual r of the rows c that are
        left out becomes (I - H_cc)^-1 r_c.
        """
        x, _ = self._columns(keys)
        q = np.linalg.qr(_flat(x))[0]
        y = self.target.ravel()
        residual = (y - q @ (q.T @ y)).reshape(self.target.shape)
        basis = q.reshape(x.shape)
        hat = basis @ basis.transpose(0, 2, 1)
        left_out = np.linalg.solve(np.eye(hat.shape[1]) - hat, residual[..., None])[..., 0]
        return np.sum(left_out**2, axis=1)

    def forecast(self, keys: Sequence[str]) -> tuple[float, float]:
        """Prediction of the cycles above `LARGE` of the largest amplitude, by the others alone.

        Returns
        -------
        error : float
            Rms over noise; nan where too few samples of smaller amplitude are left.
        p_value : float
            Probability that a right model errs as much: G. C. Chow, "Tests of equality between
            sets of coefficients in two linear regressions", Econometrica 28 (1960), 591-605.
            1 where there is no error to judge.
        """
        n = int(self.samples[self._large].sum())
        m = self.freedom(keys) - n
        if m < 1:
            return float("nan"), 1.0
        columns = self._table(keys)
        above, below = (table[:, columns] for table in self._ranges)
        solution = lstsq(below[:, :-1], below[:, -1], cond=1e-13)[0]
        error = above[:, -1] - above[:, :-1] @ solution
        rest = _misfit(below)
        beyond = _misfit(np.concatenate([above, below])) - rest
        p = float(f_distribution.sf(beyond / n / (rest / m), self.colour * n, self.colour * m))
        return float(np.sqrt(error @ error / n)), p

    def sparse_path(self, keys: Sequence[str]) -> list[Keys]:
        """Ever smaller subsets of these terms, by stepwise sparse regression (`pysindy.SSR`)."""
        x, _ = self._columns(keys)
        states = x.shape[2] - len(keys)
        columns = np.concatenate([_flat(x)[:, len(keys) :], _flat(x)[:, : len(keys)]], axis=1)
        table = _compressed(np.column_stack([columns, self.target.ravel()]))[states:]
        optimizer = ps.SSR(alpha=0, criteria="model_residual", max_iter=len(keys), unbias=False)
        optimizer.fit(table[:, states:-1], table[:, -1:])
        return [tuple(np.array(keys)[c[0] != 0].tolist()) for c in optimizer.history_[1:]]

    def _columns(self, keys: Sequence[str]) -> tuple[Array, Array]:
        """Columns of equal size of these terms and of the states, and what they were divided by."""
        chosen = [self.keys.index(key) for key in keys]
        x = self.theta[..., [*chosen, *range(len(self.keys), self.theta.shape[2])]]
        scale = np.sqrt(np.sum(x**2, axis=(0, 1)))
        scale = np.where(scale > 0, scale, 1.0)
        return x / scale, scale

    def _table(self, keys: Sequence[str]) -> list[int]:
        """Columns of these terms, of the states, and the target."""
        return [*map(self.keys.index, keys), *range(len(self.keys), self.theta.shape[2] + 1)]

    @property
    def _large(self) -> NDArray[np.bool_]:
        return np.asarray(self.amplitude > LARGE * self.amplitude.max())

    @cached_property
    def _ranges(self) -> tuple[Array, Array]:
        """Columns and target of the large cycles, and of all others, in few rows."""
        table = np.concatenate([self.theta, self.target[..., None]], axis=2)
        # Columns of equal size, which changes no prediction.
        size = np.sqrt(np.sum(self.theta**2, axis=(0, 1)))
        table[..., :-1] /= np.where(size > 0, size, 1.0)
        return _compressed(_flat(table[self._large])), _compressed(_flat(table[~self._large]))


def _misfit(table: Array) -> float:
    """Sum of squared residuals of the last column on the others."""
    rest = table[:, -1] - table[:, :-1] @ lstsq(table[:, :-1], table[:, -1], cond=1e-13)[0]
    return float(rest @ rest)


def _fixed(fit: Fit) -> set[str]:
    return set(fit.model.coefficients) - set(fit.free)


def _compressed(table: Array) -> Array:
    """Few rows with the same sums of squares and products."""
    return np.asarray(np.linalg.qr(table, mode="r"))


def _flat(x: Array) -> Array:
    return x.reshape(-1, x.shape[-1])


def _cycles(record: Record) -> list[tuple[int, int]]:
    """First and last sample of every cycle; what is left at the ends joins its neighbours."""
    return list(itertools.pairwise([0, *record.cycles[1:-1].tolist(), len(record.signal)]))


def _independent(x: Array) -> float:
    """Samples that count in the variance of a sum of squares: 1 / sum of squared correlations."""
    power = np.abs(freqz(1.0, autoregression(x), 4096)[1]) ** 2
    return float(np.mean(power) ** 2 / np.mean(power**2))
