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

import numpy as np
import pysindy as ps
from scipy.linalg import lstsq
from scipy.signal import freqz
from scipy.stats import f as f_distribution

from romsindy.model import ReducedModel
from romsindy.noise import autoregression
from romsindy.output_error import ModelEquation, OutputError, Record
from romsindy.refine import Fit, smoothed
from romsindy.signals import crossings
from romsindy.terms import Term
from romsindy.typing import Array

Keys = tuple[str, ...]

# Cycles above this part of the largest amplitude are the amplitude range that is held out.
LARGE = 2 / 3


@dataclass(frozen=True, eq=False)
class Tangent:
    """Linear regression of measured motion on its sensitivities, cycle by cycle.

    Attributes
    ----------
    keys : tuple of str
        Coefficients of the first columns; the others belong to initial states, which every model
        has.
    theta : (n_cycles, n_rows, n_columns) array
        Sensitivities over noise, each cycle compressed to few rows.
    target : (n_cycles, n_rows) array
    amplitude : (n_cycles,) array
        Half peak to peak, unit of q.
    samples : (n_cycles,) integer array
        Of the record in each cycle.
    colour : float
        Part of the samples that count as independent in a sum of squares; 1 for white noise.
    """

    keys: Keys
    theta: Array
    target: Array
    amplitude: Array
    samples: Array
    colour: float

    @classmethod
    def at(cls, fit: Fit, terms: Sequence[Term]) -> Tangent:
        """Linearise about a fit; terms that its model lacks join with coefficient zero."""
        records = fit.problem.records
        keys = tuple(term.key for term in terms if term.key not in _fixed(fit))
        known = fit.model.coefficients
        extra = [term for term in terms if term.key not in known]
        model = ReducedModel(
            (*fit.model.terms, *extra), (*fit.model.values, *np.zeros(len(extra))), fit.model.unit
        )
        equation = ModelEquation(smoothed(model, records), keys)
        values = np.concatenate([equation.values, fit.values[len(fit.free) :]])
        problem = OutputError.of(equation, records, fit.problem.offset)
        blocks, amplitudes, samples = [], [], []
        residuals = problem.residuals(values)
        for record, r, j in zip(records, residuals, problem.jacobians(values), strict=True):
            # Coefficients themselves are sought, and changes of the states.
            y = r + j[:, : len(keys)] @ values[: len(keys)]
            table = np.column_stack([j, y]) / record.noise.std
            for a, b in _cycles(record, len(r)):
                blocks.append(np.linalg.qr(table[a:b], mode="r"))
                amplitudes.append(np.ptp(record.decay.q[a:b]) / 2)
                samples.append(b - a)
        width = blocks[0].shape[1]
        rows = np.array([np.pad(block, ((0, width - len(block)), (0, 0))) for block in blocks])
        colour = min(_independent(r) for r in residuals)
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
        return self._chi_squared(keys, np.ones(len(self.samples), bool))

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
            Rms over noise.
        p_value : float
            Probability that a right model errs as much: G. C. Chow, "Tests of equality between
            sets of coefficients in two linear regressions", Econometrica 28 (1960), 591-605.
        """
        large = self.amplitude > LARGE * self.amplitude.max()
        x, _ = self._columns(keys)
        solution = lstsq(_flat(x[~large]), self.target[~large].ravel(), cond=1e-13)[0]
        error = self.target[large] - x[large] @ solution
        rest = self._chi_squared(keys, ~large)
        beyond = self._chi_squared(keys, np.ones_like(large)) - rest
        n, m = self.samples[large].sum(), self.samples[~large].sum() - x.shape[2]
        ratio = (beyond / n) / (rest / m)
        p = float(f_distribution.sf(ratio, self.colour * n, self.colour * m))
        return float(np.sqrt(np.sum(error**2) / n)), p

    def sparse_path(self, keys: Sequence[str]) -> list[Keys]:
        """Ever smaller subsets of these terms, by stepwise sparse regression (`pysindy.SSR`)."""
        x, _ = self._columns(keys)
        states = x.shape[2] - len(keys)
        columns = np.concatenate([_flat(x)[:, len(keys) :], _flat(x)[:, : len(keys)]], axis=1)
        table = np.linalg.qr(np.column_stack([columns, self.target.ravel()]), mode="r")[states:]
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

    def _chi_squared(self, keys: Sequence[str], cycles: Array) -> float:
        x, y = _flat(self._columns(keys)[0][cycles]), self.target[cycles].ravel()
        rest = y - x @ lstsq(x, y, cond=1e-13)[0]
        return float(rest @ rest)


def _fixed(fit: Fit) -> set[str]:
    return set(fit.model.coefficients) - set(fit.free)


def _flat(x: Array) -> Array:
    return x.reshape(-1, x.shape[-1])


def _cycles(record: Record, n: int) -> list[tuple[int, int]]:
    """First and last sample of every cycle; what is left at the ends joins its neighbours."""
    up = crossings(record.signal, record.decay.dt)[0]
    return list(itertools.pairwise([0, *up[1:-1].tolist(), n]))


def _independent(x: Array) -> float:
    """Samples that count in the variance of a sum of squares: 1 / sum of squared correlations."""
    power = np.abs(freqz(1.0, autoregression(x), 4096)[1]) ** 2
    return float(np.mean(power) ** 2 / np.mean(power**2))
