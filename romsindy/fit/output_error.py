"""Measured minus simulated motion, and the values that make it least.

Everything here knows an equation of motion only through `romsindy.fit.collocation.Equation` with
``values`` and ``at``: `ModelEquation` is the plain one, a `ReducedModel`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from romsindy.fit.collocation import (
    Equation,
    Grid,
    Linearisation,
    Trajectory,
    TrajectoryError,
    integrate,
    sensitivity,
)
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.noise import Noise, autoregression, coloured_product, estimate_noise
from romsindy.record.signals import clipped, crossings
from romsindy.typing import Array

_DERIVATIVE = {"displacement": 0, "velocity": 1, "acceleration": 2}
# Horizons in cycles: a wrong frequency shows as a phase that drifts, and must not drift far before
# it is corrected.
_FIRST_HORIZON, _GROWTH = 2.5, 1.6
# A simulated motion this many times the noise away is as bad as none.
_FAR = 1e9
_EVALUATIONS = 40
# Sum of squares is about the number of samples: a change of it by this is far below one.
# Shorter horizons only lead there.
_TOLERANCE, _ROUGH = 1e-5, 1e-2
# Until the whole record is in sight, no term may change the acceleration by more than about this
# part of it: few cycles do not tell coefficients apart.
_LEASH = 0.01


class ParametricEquation(Equation, Protocol):
    """An equation of motion with values to be found."""

    @property
    def values(self) -> Array:
        """Present values of the parameters, (n_parameters,)."""

    def at(self, values: Array) -> ParametricEquation:
        """The same equation with other values."""


@dataclass(frozen=True)
class ModelEquation:
    """A `ReducedModel` as an equation whose parameters are some of its coefficients.

    Parameters
    ----------
    model : ReducedModel
    free : tuple of str
        Names of the coefficients that are parameters.
    """

    model: ReducedModel
    free: tuple[str, ...]

    def at(self, values: Sequence[float] | Array) -> ModelEquation:
        """The same equation with other values of the free coefficients."""
        new = {**self.model.coefficients, **dict(zip(self.free, map(float, values), strict=True))}
        return replace(self, model=replace(self.model, values=tuple(new.values())))

    @property
    def values(self) -> Array:
        """Values of the free coefficients."""
        return np.array([self.model.coefficients[name] for name in self.free])

    def linearise(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Linearisation:
        """R and its derivatives, shape (n,) each."""
        return Linearisation(*self.model.linearise(q, q_dot, q_ddot))

    def by_parameter(self, t: Array, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        """dR/dp: each free term, shape (n_free, n)."""
        terms = {term.key: term for term in self.model.terms}
        rows = [terms[name].strong(q, q_dot, q_ddot) for name in self.free]
        return np.array(rows).reshape(len(rows), len(q))


@dataclass(frozen=True)
class Record:
    """One decay, ready to be compared with a simulation.

    Attributes
    ----------
    decay : Decay
        Free part.
    signal : (n,) array
        The measured quantity.
    valid : (n,) array of bool
        False where the sensor was at the end of its range: such samples take no part.
    derivative : int
        0, 1, 2 for displacement, velocity, acceleration.
    noise : Noise
    grid : Grid
    start : (2,) array
        First guess of q and q_dot at the first sample.
    cycle : float
        Mean length of a cycle, s.
    """

    decay: Decay
    signal: Array
    valid: NDArray[np.bool_]
    derivative: int
    noise: Noise
    grid: Grid
    start: Array
    cycle: float

    @classmethod
    def of(cls, decay: Decay) -> Record:
        """Cut a decay to its free part and look at its noise and cycles."""
        single = decay.single()
        record = single if single.complete else single.free()
        derivative = _DERIVATIVE[record.measured]
        signal = np.asarray((record.q, record.q_dot, record.q_ddot)[derivative])
        up = crossings(signal, record.dt)[0]
        lengths = np.diff(up) * record.dt
        noise = estimate_noise(signal, record.dt)
        share = noise.std / float(np.abs(signal).max())
        return cls(
            record,
            signal,
            ~clipped(signal),
            derivative,
            noise,
            Grid.over(record.t, float(np.quantile(lengths, 0.1)), _steps_per_cycle(share)),
            _first_state(record, float(lengths[0])),
            float(lengths.mean()),
        )


def _first_state(record: Decay, cycle: float) -> Array:
    """q and q_dot at the first sample, from a polynomial through the first half cycle."""
    fine = record.upsampled()
    chosen = fine.t <= fine.t[0] + cycle / 2
    polynomial = np.polynomial.Polynomial.fit(fine.t[chosen], fine.q[chosen], 5)
    return np.array([polynomial(fine.t[0]), polynomial.deriv()(fine.t[0])])


def _steps_per_cycle(noise_share: float) -> int:
    """Steps that keep the error of the integration, of order six, at about 1 % of the noise."""
    return int(np.clip(20 * (0.01 / max(noise_share, 1e-12)) ** (1 / 6), 20, 60))


@dataclass
class OutputError:
    """Measured minus simulated motion as a function of coefficients, states and offsets.

    Values are ordered: free coefficients, then q and q_dot of each decay, then its offset if
    asked for.

    Parameters
    ----------
    equation : ParametricEquation
    records : tuple of Record
    offset : bool
        Whether an offset of each sensor is fitted.
    """

    equation: ParametricEquation
    records: tuple[Record, ...]
    offset: bool

    @classmethod
    def of(
        cls, equation: ParametricEquation, records: Sequence[Record], offset: bool = False
    ) -> OutputError:
        return cls(equation, tuple(records), offset)

    def __post_init__(self) -> None:
        # The last motions, from which the next ones start.
        self._motions: list[Trajectory | None] = [None] * len(self.records)

    @property
    def start(self) -> Array:
        """First guess of all values."""
        offsets = np.zeros(len(self.records) if self.offset else 0)
        return np.concatenate([self.equation.values, *(r.start for r in self.records), offsets])

    def split(self, values: Array) -> tuple[Array, Array, Array]:
        """Coefficients, states (n_decays, 2) and offsets (n_decays,)."""
        p, d = len(self.equation.values), len(self.records)
        offsets = values[p + 2 * d :] if self.offset else np.zeros(d)
        return values[:p], values[p : p + 2 * d].reshape(d, 2), offsets

    def motions(self, values: Array, horizon: float = np.inf) -> list[Trajectory]:
        """Simulated motions over the first ``horizon`` seconds of each decay."""
        coefficients, states, _ = self.split(values)
        equation = self.equation.at(coefficients)
        for i, record in enumerate(self.records):
            grid = record.grid.until(record.grid.start + horizon)
            self._motions[i] = integrate(equation, states[i], grid, self._motions[i])
        return [m for m in self._motions if m is not None]

    def residuals(self, values: Array, horizon: float = np.inf) -> list[Array]:
        """Measured minus simulated signal of each decay."""
        coefficients, _, offsets = self.split(values)
        equation = self.equation.at(coefficients)
        parts = []
        triples = zip(self.records, self.motions(values, horizon), offsets, strict=True)
        for record, motion, offset in triples:
            simulated = motion.samples(equation, record.derivative) + offset
            n = len(simulated)
            parts.append((record.signal[:n] - simulated) * record.valid[:n])
        return parts

    def jacobians(self, values: Array, horizon: float = np.inf) -> list[Array]:
        """Derivatives of each simulated signal with respect to all values, (n, n_values)."""
        coefficients, _, _ = self.split(values)
        equation = self.equation.at(coefficients)
        p, d = len(coefficients), len(self.records)
        blocks: list[Array] = []
        for i, motion in enumerate(self.motions(values, horizon)):
            slopes = sensitivity(equation, motion, self.records[i].derivative)
            block = np.zeros((len(slopes), len(values)))
            block[:, :p] = slopes[:, :p]
            block[:, p + 2 * i : p + 2 * i + 2] = slopes[:, p:]
            if self.offset:
                block[:, p + 2 * d + i] = 1.0
            blocks.append(block * self.records[i].valid[: len(slopes), None])
        return blocks

    def with_signals(self, signals: Sequence[Array]) -> OutputError:
        """The same problem with other measurements, such as simulated ones."""
        pairs = zip(self.records, signals, strict=True)
        return replace(self, records=tuple(replace(r, signal=x) for r, x in pairs))

    def polish(self, values: Array, loss: str = "linear") -> Array:
        """Least squares over the whole record from values that are close already."""
        return self._minimise(values, np.inf, loss, leashed=False)[0]

    def solve(
        self, loss: str = "linear", progress: Callable[[str], None] | None = None
    ) -> tuple[Array, str]:
        """Least squares over growing horizons: values, and how it ended.

        An interrupt (Ctrl-C) ends the fit with what it has.
        """
        values, message = self.start, ""
        longest = max(r.decay.t[-1] - r.decay.t[0] for r in self.records)
        cycle = max(r.cycle for r in self.records)
        horizon = _FIRST_HORIZON * cycle
        while True:
            whole = horizon >= longest
            horizon = np.inf if whole else horizon
            try:
                values, message = self._minimise(values, horizon, loss, not whole)
                if progress:
                    progress(f"{min(horizon, longest):.3g} s of {longest:.3g} s fitted")
            except KeyboardInterrupt:
                done = f"interrupted at a horizon of {min(horizon, longest):.3g} s"
                return values, f"{done} of {longest:.3g} s: not the best fit"
            except TrajectoryError as error:
                fitted = (
                    f"fitted to the first {horizon / _GROWTH:.3g} s" if message else "at the start"
                )
                raise TrajectoryError(
                    f"the model with {len(self.equation.values)} free coefficients, {fitted}, has"
                    f" no motion after that ({error}): use fewer terms, or start from other ones"
                ) from error
            if whole:
                return values, message
            horizon *= _GROWTH

    def _minimise(
        self, values: Array, horizon: float, loss: str, leashed: bool
    ) -> tuple[Array, str]:
        noise = [r.noise.std for r in self.records]
        leash = self._leash(values, horizon) if leashed else np.empty(0)
        anchor = values[: len(leash)]

        def residual(trial: Array) -> Array:
            try:
                parts = self.residuals(trial, horizon)
            except TrajectoryError:  # nan is a step too far: the solver shortens it
                return np.full(size, np.nan)
            scaled = [r / s for r, s in zip(parts, noise, strict=True)]
            if max(float(np.abs(r).max()) for r in scaled) > _FAR:
                return np.full(size, np.nan)
            return np.concatenate([*scaled, (trial[: len(leash)] - anchor) / leash])

        def jacobian(trial: Array) -> Array:
            blocks = self.jacobians(trial, horizon)
            scaled = [-b / s for b, s in zip(blocks, noise, strict=True)]
            ridge = np.eye(len(leash), len(trial)) / leash[:, None]
            return np.concatenate([*scaled, ridge])

        starting = np.concatenate(
            [r / s for r, s in zip(self.residuals(values, horizon), noise, strict=True)]
        )
        # Where the model misses more than the noise, its misfit takes the place of the noise.
        leash = leash / max(float(np.median(np.abs(starting))), 1.0)
        size = len(starting) + len(leash)
        result = least_squares(
            residual,
            values,
            jacobian,
            x_scale="jac",
            loss=loss,
            f_scale=3.0,
            ftol=_ROUGH if leashed else _TOLERANCE,
            xtol=1e-9,
            max_nfev=_EVALUATIONS,
        )
        return result.x, str(result.message)

    def _leash(self, values: Array, horizon: float) -> Array:
        """Change of each coefficient that changes the acceleration by one part in a hundred.

        In units of the residual, which has as many rows as samples.
        """
        motion = self.motions(values, horizon)[0]
        equation, grid = self.equation.at(self.split(values)[0]), motion.grid
        t = grid.start + grid.step * np.arange(grid.n_steps + 1)
        at = equation.linearise(t, motion.q, motion.q_dot, np.zeros_like(t))
        q_ddot = -at.residual / at.by_q_ddot
        slopes = equation.by_parameter(t, motion.q, motion.q_dot, q_ddot)
        sizes = np.sqrt(np.mean(slopes**2, axis=1))
        return _LEASH * np.sqrt(np.mean(q_ddot**2)) / np.maximum(sizes, 1e-300)

    def covariance(self, values: Array) -> Array:
        """Covariance of all values, for the colour that the residual really has.

        Least squares weighs all samples alike; where the residual is not white the covariance is
        the sandwich (J'J)^-1 J' S J (J'J)^-1 with S that of an autoregression.
        """
        size = len(values)
        normal, middle = np.zeros((size, size)), np.zeros((size, size))
        for record, r, block in zip(
            self.records, self.residuals(values), self.jacobians(values), strict=True
        ):
            j = block / record.noise.std
            a = autoregression(r / record.noise.std)
            whitened = np.convolve(r / record.noise.std, a)[: len(r)]
            freedom = max(len(r) - size / len(self.records), 1.0)
            normal += j.T @ j
            middle += coloured_product(a, j, j) * float(whitened @ whitened) / freedom
        scale = 1 / np.sqrt(np.diag(normal))
        inverse = np.linalg.pinv(normal * scale * scale[:, None], rcond=1e-14, hermitian=True)
        inverse = inverse * scale * scale[:, None]
        return inverse @ middle @ inverse
