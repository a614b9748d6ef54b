"""One Radau IIA time step of the beam, by a simplified Newton iteration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from romsindy.beam import kernel
from romsindy.beam.assembly import Assembly
from romsindy.beam.excitation import Excitation
from romsindy.beam.radau import RadauIIA

_MAX_ITERATIONS = 10
# of the largest acceleration: far below the 1e-3 to which accelerations are promised; readings of
# thirty cycles change by 1e-5 with it
_NEWTON_TOLERANCE = 1e-6


@dataclass(frozen=True)
class State:
    """Displacement, velocity, stage accelerations and the step that led here; time."""

    x: np.ndarray
    v: np.ndarray
    stages: np.ndarray
    h: float
    t: float


class Integrator:
    """One Radau IIA step of the beam at a time."""

    def __init__(self, assembly: Assembly, method: RadauIIA, excitation: Excitation) -> None:
        self._assembly = assembly
        self._excitation = excitation
        self._method = method
        self._A2 = method.A @ method.A
        self._to_acceleration = np.linalg.inv(self._A2)
        self._extrapolations: dict[float, np.ndarray] = {}
        # Eigenvalues, columns, rows and room for the factors of each eigenvalue.
        self._real, self._complex = (
            (*part, np.zeros((len(part[0]), *assembly.mass.shape), dtype=part[0].dtype))
            for part in method.parts()
        )
        self._peak = 0.0
        self.iterations = 0

    def start(self, x: np.ndarray, v: np.ndarray) -> State:
        """Return the state in x with velocity v.

        The first step is guessed without acceleration: Newton converges from the unmoved shape,
        but not from one that a full step of a guessed acceleration has stretched.
        """
        return State(x, v, np.zeros((self._method.stages, *x.shape)), 0.0, 0.0)

    def step(self, state: State, h: float) -> tuple[State, float, float] | None:
        """Return the state after a step of h [s], the energy dissipated and the work of the
        excitation [J]; None on failure.
        """
        load = self._excitation.load(state.t + h * self._method.c)
        X, V, a = self._predict(state, h)
        theta = self._factorise(X, V, h)
        rate, change = 1.0, 0.0
        for iteration in range(_MAX_ITERATIONS):
            self.iterations += 1
            R = self._assembly.stage_residuals(X, V, a) - load
            last = change
            change, largest = kernel.newton_update(
                R, X, V, a, theta, h, self._method.A, self._to_acceleration,
                self._real, self._complex,
            )  # fmt: skip
            if not change < 1e15:  # also catches what is not a number
                return None
            if iteration > 0:
                rate = change / last if last > 0.0 else 0.0
            # what is left after this iteration, for a linear rate
            left = change * min(1.0, rate / (1.0 - rate)) if rate < 1.0 else change
            converged = left <= _NEWTON_TOLERANCE * max(largest, 1e-3 * self._peak)
            stalled = iteration > 0 and rate > 0.5
            # A motion that is small beside the static sag drowns in the rounding of the sag.
            if converged or (stalled and change <= self._assembly.rounding(X)):
                self._peak = max(self._peak, largest)
                weights = self._method.A[-1]
                dissipated = h * float(weights @ self._assembly.stage_powers(X, V))
                work = h * float(weights @ np.einsum("inc,inc->i", load, V))
                return State(X[-1], V[-1], a, h, state.t + h), dissipated, work
            if rate > 2.0 or (rate > 0.9 and iteration > 3):
                return None
        return None

    def _predict(self, state: State, h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return first values of the stages, from the polynomial of the step before."""
        a = state.stages
        if state.h > 0.0:
            ratio = h / state.h
            if ratio not in self._extrapolations:
                self._extrapolations[ratio] = self._method.extrapolation(ratio)
            a = _mix(self._extrapolations[ratio], a)
        X = state.x + (h * self._method.c)[:, None, None] * state.v + _mix(h * h * self._A2, a)
        V = state.v + _mix(h * self._method.A, a)
        return X, V, a.copy()

    def _factorise(self, X: np.ndarray, V: np.ndarray, h: float) -> np.ndarray:
        """Factorise M + z C + z^2 K for z = h * eigenvalue; return the angles these hold for."""
        middle = len(X) // 2
        K, C = self._assembly.tangents(X[middle], V[middle])
        for values, _, _, factors in (self._real, self._complex):
            kernel.factorise_shifted(
                self._assembly.mass, C, K, h * values, self._assembly.fixed, factors
            )
        return X[middle, :, 2].copy()


def _mix(weights: np.ndarray, stages: np.ndarray) -> np.ndarray:
    """Return sum_j weights_ij stages_j."""
    return (weights @ stages.reshape(len(stages), -1)).reshape(-1, *stages.shape[1:])
