"""Radau IIA time steps for M a + r(x, v) = 0, as many as the energy balance asks for.

A step from (x0, v0) of length h finds the accelerations a_i at the times c_i h, with

    x_i = x0 + c_i h v0 + h^2 sum_j (A^2)_ij a_j,     v_i = v0 + h sum_j A_ij a_j,
    M a_i + r(x_i, v_i) = 0,

by a simplified Newton iteration. The order is 2 s - 1, and the last stage is the end of the step:
its acceleration is consistent with its displacement, and what the step cannot resolve (the axial
vibration of a thin beam) dies within it, as it does in reality. Symplectic Gauss methods were tried
and left: the axial vibration that they keep spoils both Newton's convergence and the acceleration.

Source: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (2nd ed., 1996), IV.8.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import Polynomial, legendre

from romsindy.beam import kernel
from romsindy.beam.assembly import Assembly
from romsindy.beam.excitation import Excitation

Part = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class RadauIIA:
    """The method with `stages` stages, of order 2 * stages - 1."""

    stages: int = 3
    # (stages,), times of the stages as parts of the step; the last is 1
    c: np.ndarray = field(init=False, repr=False)
    # (stages, stages), the Butcher matrix; its last row holds the weights b
    A: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.stages < 2:
            raise ValueError(f"stages must be 2 or more, got {self.stages}; 3 gives order 5")
        c = _nodes(self.stages)
        integrals = [p.integ() for p in lagrange(c)]
        A = np.array([[p(ci) for p in integrals] for ci in c])
        object.__setattr__(self, "c", c)
        object.__setattr__(self, "A", A)

    def parts(self) -> tuple[Part, Part]:
        """Return A = T diag(eigenvalues) T^-1 as (eigenvalues, columns of T, rows of T^-1).

        The real eigenvalues come first, then one of each complex pair.  They split the Newton
        system of all stages into one real and a few complex systems of the size of the beam.
        """
        values, T = np.linalg.eig(self.A)
        inverse = np.linalg.inv(T)
        real, upper = values.imag == 0.0, values.imag > 0.0
        columns = np.ascontiguousarray
        return (
            (values[real].real, columns(T[:, real].real), inverse[real].real.copy()),
            (values[upper], columns(T[:, upper]), inverse[upper]),
        )

    @property
    def order(self) -> int:
        """The classical order."""
        return 2 * self.stages - 1

    def extrapolation(self, ratio: float) -> np.ndarray:
        """Return E: stages of a next step, `ratio` times as long, are about E @ stages."""
        return np.array([[p(1.0 + ratio * c) for p in lagrange(self.c)] for c in self.c])


def lagrange(nodes: np.ndarray) -> list[Polynomial]:
    """Return the Lagrange polynomials of the nodes."""
    basis = [Polynomial.fromroots(np.delete(nodes, i)) for i in range(len(nodes))]
    return [p / p(node) for p, node in zip(basis, nodes, strict=True)]


def _nodes(stages: int) -> np.ndarray:
    """Return the zeros of P_s(2c - 1) - P_(s-1)(2c - 1), P the Legendre polynomials."""
    series = np.zeros(stages + 1)
    series[[stages, stages - 1]] = 1.0, -1.0
    c = 0.5 * (1.0 + np.sort(legendre.legroots(series).real))
    c[-1] = 1.0
    return c


_MAX_ITERATIONS = 10
# of the largest acceleration: far below the 1e-3 to which accelerations are promised; readings of
# thirty cycles change by 1e-5 with it
_NEWTON_TOLERANCE = 1e-6


@dataclass(frozen=True)
class StepState:
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

    def start(self, x: np.ndarray, v: np.ndarray) -> StepState:
        """Return the state in x with velocity v.

        The first step is guessed without acceleration: Newton converges from the unmoved shape,
        but not from one that a full step of a guessed acceleration has stretched.
        """
        return StepState(x, v, np.zeros((self._method.stages, *x.shape)), 0.0, 0.0)

    def step(self, state: StepState, h: float) -> tuple[StepState, float, float] | None:
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
                return StepState(X[-1], V[-1], a, h, state.t + h), dissipated, work
            if rate > 2.0 or (rate > 0.9 and iteration > 3):
                return None
        return None

    def _predict(self, state: StepState, h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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


FINEST = 10  # a sample is cut into at most 2^10 steps
_RELEASE_TIME = 0.1  # [s], see Budget


class Budget:
    """Shares out how much the energy balance may drift over a motion.

    That is `tolerance` times the energy [J] at release and the largest work of an excitation so
    far. Half goes evenly by time, a quarter to the moments after the release, where modes ring that
    soon have died, and a quarter to single steps (half of what is left of it each): a step across
    an impact, or the first, which loses the axial waves of the release.
    """

    def __init__(self, tolerance: float, released: float, duration: float, floor: float) -> None:
        self._tolerance = tolerance
        self._released = released
        self._duration = duration
        self._floor = floor
        self._work = self._spent = 0.0

    def put_in(self, work: float) -> None:
        """Take note of the work [J] of the excitation up to a time."""
        self._work = max(self._work, abs(work))

    @property
    def _drift(self) -> float:
        return self._tolerance * (self._released + self._work)

    def _rate(self, t: float) -> float:
        early = 0.25 / _RELEASE_TIME * float(np.exp(-t / _RELEASE_TIME))
        return self._drift * (0.5 / self._duration + early)

    def allowance(self, t: float, h: float) -> float:
        """Return the allowed drift [J] of the step from t to t + h."""
        reserve = max(0.25 * self._drift - self._spent, 0.0)
        return max(self._rate(t) * h + 0.5 * reserve, self._floor)

    def spend(self, t: float, h: float, drift: float) -> None:
        """Book the drift [J] of a step that was taken."""
        self._spent += max(drift - max(self._rate(t) * h, self._floor), 0.0)


class Stepper:
    """Goes from sample to sample in 1, 2, 4, ... steps, as many as the energy balance asks for."""

    def __init__(
        self,
        integrator: Integrator,
        assembly: Assembly,
        state: StepState,
        budget: Budget,
        order: int,
    ) -> None:
        self._integrator = integrator
        self._assembly = assembly
        self._budget = budget
        self._level = 0
        # Drift per time goes with h^order: coarsen only with that, and some more, in hand.
        self._margin = 0.5 ** (order + 1)
        self.state = state
        self.dissipated = self.work = 0.0
        self.energies = self._energies_of(state)
        self.steps = 0

    def _energies_of(self, state: StepState) -> tuple[float, float, float]:
        a = self._assembly
        return a.kinetic(state.v), a.strain(state.x), a.potential(state.x)

    def advance(self, t: float, sample: float) -> bool:
        """Go on by one sample interval; return False if Newton fails in the finest steps."""
        parts, done = 2**FINEST, 0
        while done < parts:
            size = 2 ** (FINEST - self._level)
            outcome = self._try(t + sample * done / parts, sample * size / parts)
            if outcome is None:
                if self._level == FINEST:
                    return False
                self._level += 1
                continue
            done += size
            if self._level > 0 and outcome < self._margin and done % (2 * size) == 0:
                self._level -= 1
        return True

    def _try(self, t: float, h: float) -> float | None:
        """Take one step; return its drift as a part of the allowance, None if it must be halved."""
        found = self._integrator.step(self.state, h)
        if found is None:
            return None
        state, dissipated, work = found
        energies = self._energies_of(state)
        drift = abs(sum(energies) - sum(self.energies) + dissipated - work)
        self._budget.put_in(self.work + work)
        share = drift / self._budget.allowance(t, h)
        if share > 1.0 and self._level < FINEST:
            return None
        self._budget.spend(t, h, drift)
        self.state, self.energies = state, energies
        self.dissipated += dissipated
        self.work += work
        self.steps += 1
        return share
