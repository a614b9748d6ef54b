"""Free motion from a released shape: Radau IIA with steps chosen by the energy balance."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from romsindy.beam import kernel
from romsindy.beam.assembly import Assembly
from romsindy.beam.collocation import RadauIIA
from romsindy.beam.errors import StepTooLongError
from romsindy.beam.modes import ModalBasis
from romsindy.beam.motion import Cost, Motion
from romsindy.beam.recorder import Recorder
from romsindy.beam.validation import require_positive

if TYPE_CHECKING:
    from romsindy.beam.beam import Beam, Shape
    from romsindy.beam.sensors import SensorArray

DEFAULT_STEP = 1e-3
DEFAULT_ENERGY_TOLERANCE = 1e-4
_DEFAULT_MODES = 10
_FINEST = 10  # a sample is cut into at most 2^10 steps
_MAX_ITERATIONS = 10
# of the largest acceleration: far below the 1e-3 to which accelerations are promised
_NEWTON_TOLERANCE = 1e-8
_RELEASE_TIME = 0.1  # [s], see Budget
_STIFFENING = 0.01  # [s], long against axial periods; see Assembly.thin_acceleration


@dataclass(frozen=True)
class _State:
    """Displacement, velocity, stage accelerations and the step that led here."""

    x: np.ndarray
    v: np.ndarray
    stages: np.ndarray
    h: float


class Integrator:
    """One Radau IIA step of the beam at a time."""

    def __init__(self, assembly: Assembly, method: RadauIIA) -> None:
        self._assembly = assembly
        self._method = method
        self._A2 = method.A @ method.A
        self._to_acceleration = np.linalg.inv(self._A2)
        self._extrapolations: dict[float, np.ndarray] = {}
        self._real, self._complex = (self._split(part) for part in method.parts())
        self._peak = 0.0
        self.iterations = 0

    def _split(self, part: tuple[np.ndarray, np.ndarray, np.ndarray]) -> tuple[np.ndarray, ...]:
        """Return eigenvalues, columns, rows and room for the factors of each eigenvalue."""
        room = np.zeros((len(part[0]), *self._assembly.mass.shape), dtype=part[0].dtype)
        return *part, room

    def start(self, x: np.ndarray) -> _State:
        """Return the state at rest in x.

        The first step is guessed without acceleration: Newton converges from the unmoved shape,
        but not from one that a full step of a guessed acceleration has stretched.
        """
        return _State(x, np.zeros_like(x), np.zeros((self._method.stages, *x.shape)), 0.0)

    def step(self, state: _State, h: float) -> tuple[_State, float] | None:
        """Return the state after a step of h [s] and the energy dissipated [J]; None on failure."""
        X, V, a = self._predict(state, h)
        theta = self._factorise(X, V, h)
        rate, change = 1.0, 0.0
        for iteration in range(_MAX_ITERATIONS):
            self.iterations += 1
            R = self._assembly.stage_residuals(X, V, a)
            last = change
            change, largest = kernel.newton_update(
                R, X, V, a, theta, h, self._method.A, self._to_acceleration,
                self._real, self._complex,
            )  # fmt: skip
            if not change < 1e15:  # also catches what is not a number
                return None
            if iteration > 0:
                rate = change / last if last > 0.0 else 0.0
                if rate > 2.0 or (rate > 0.9 and iteration > 3):
                    return None
            # what is left after this iteration, for a linear rate
            left = change * min(1.0, rate / (1.0 - rate)) if rate < 1.0 else change
            if left <= _NEWTON_TOLERANCE * max(largest, 1e-3 * self._peak):
                self._peak = max(self._peak, largest)
                powers = self._assembly.stage_powers(X, V)
                return _State(X[-1], V[-1], a, h), h * float(self._method.A[-1] @ powers)
        return None

    def _predict(self, state: _State, h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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


class Budget:
    """Shares out how much the energy balance may drift over a motion.

    Half goes evenly by time, a quarter to the moments after the release, where modes ring that
    soon have died, and a quarter to single steps (half of what is left of it each): a step across
    an impact, or the first, which loses the axial waves of the release.
    """

    def __init__(self, tolerance: float, duration: float, floor: float) -> None:
        self._even = 0.5 * tolerance / duration
        self._early = 0.25 * tolerance / _RELEASE_TIME
        self._reserve = 0.25 * tolerance
        self._floor = floor

    def _rate(self, t: float) -> float:
        return self._even + self._early * float(np.exp(-t / _RELEASE_TIME))

    def allowance(self, t: float, h: float) -> float:
        """Return the allowed drift [J] of the step from t to t + h."""
        return max(self._rate(t) * h + 0.5 * self._reserve, self._floor)

    def spend(self, t: float, h: float, drift: float) -> None:
        """Book the drift [J] of a step that was taken."""
        excess = drift - max(self._rate(t) * h, self._floor)
        self._reserve = max(self._reserve - max(excess, 0.0), 0.0)


class Stepper:
    """Goes from sample to sample in 1, 2, 4, ... steps, as many as the energy balance asks for."""

    def __init__(
        self, integrator: Integrator, assembly: Assembly, state: _State, budget: Budget, order: int
    ) -> None:
        self._integrator = integrator
        self._assembly = assembly
        self._budget = budget
        self._level = 0
        # Drift per time goes with h^order: coarsen only with that, and some more, in hand.
        self._margin = 0.5 ** (order + 1)
        self.state = state
        self.dissipated = 0.0
        self.energies = self._energies_of(state)
        self.steps = 0

    def _energies_of(self, state: _State) -> tuple[float, float, float]:
        a = self._assembly
        return a.kinetic(state.v), a.strain(state.x), a.potential(state.x)

    def advance(self, t: float, sample: float) -> bool:
        """Go on by one sample interval; return False if Newton fails in the finest steps."""
        parts, done = 2**_FINEST, 0
        while done < parts:
            size = 2 ** (_FINEST - self._level)
            h = sample * size / parts
            outcome = self._try(t + sample * done / parts, h)
            if outcome is None:
                if self._level == _FINEST:
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
        state, dissipated = found
        energies = self._energies_of(state)
        drift = abs(sum(energies) - sum(self.energies) + dissipated)
        share = drift / self._budget.allowance(t, h)
        if share > 1.0 and self._level < _FINEST:
            return None
        self._budget.spend(t, h, drift)
        self.state, self.energies = state, energies
        self.dissipated += dissipated
        self.steps += 1
        return share


def simulate(
    beam: Beam,
    shape: Shape,
    duration: float,
    step: float = DEFAULT_STEP,
    *,
    energy_tolerance: float = DEFAULT_ENERGY_TOLERANCE,
    modes: ModalBasis | None = None,
    sensors: SensorArray | None = None,
    keep_field: bool = False,
    method: RadauIIA | None = None,
    progress: bool = True,
) -> Motion:
    """Let the beam go from rest in `shape` and follow its free motion.

    The result is sampled every `step`; a sample interval is cut into 2, 4, ... time steps where
    the energy balance or Newton's method asks for it.  The first acceleration is that of a beam
    which neither stretches nor shears, since the axial waves that the release starts die long
    before the next sample.

    Parameters
    ----------
    beam
        The beam.
    shape
        Where it is let go.
    duration
        Time to follow [s].
    step
        Sampling interval and longest time step [s].
    energy_tolerance
        How far kinetic + strain + potential + dissipated energy may drift over
        the whole motion, relative to the energy at release.
    modes
        The modes to record (default: the first ten about the beam's own equilibrium).
    sensors
        Sensors to record.
    keep_field
        Whether to keep every node's motion as well (20 kB per sample at 150 elements).
    method
        The collocation method (default: Radau IIA of order 5).
    progress
        Whether to show a progress bar.

    Raises
    ------
    ValueError
        For a duration, step or tolerance that is not positive, or a shape of another
        mesh.
    StepTooLongError
        If Newton fails even in steps of step / 1024; the error carries the
        motion up to there and a step to try.
    """
    _check(beam, shape, duration, step, energy_tolerance)
    assembly = beam.assembly
    if progress and not kernel.is_compiled():
        print("compiling the beam kernel (first run only, about 20 s)", file=sys.stderr)
    equilibrium = beam.equilibrium()
    rest, start = equilibrium.displacement, shape.displacement
    rest_energy = (0.0, assembly.strain(rest), assembly.potential(rest))
    method = method or RadauIIA()
    integrator = Integrator(assembly, method)
    budget = _budget(assembly, start, sum(rest_energy), energy_tolerance, duration)
    stepper = Stepper(integrator, assembly, integrator.start(start), budget, method.order)
    acceleration = assembly.thin_acceleration(start, stiffening=_STIFFENING)
    basis = modes or beam.modes(equilibrium, _count_modes(assembly))
    n_samples = int(np.floor(duration / step * (1 + 1e-12))) + 1
    recorder = Recorder(basis, sensors, n_samples, keep_field)
    began = time.perf_counter()

    def motion(stop_reason: str) -> Motion:
        cost = Cost(stepper.steps, integrator.iterations, time.perf_counter() - began)
        return recorder.motion(step, cost, rest_energy, stop_reason)

    recorder.add(start, stepper.state.v, acceleration, stepper.energies, 0.0)
    try:
        for i in _samples(n_samples, progress):
            if not stepper.advance((i - 1) * step, step):
                finest = step / 2**_FINEST
                raise StepTooLongError(
                    f"Newton's method did not converge at t = {(i - 1) * step:.6g} s with step = "
                    f"{step:.6g} s, not even cut to {finest:.3g} s; try step = {0.1 * step:.3g} s "
                    "(the motion up to there is in this error's `motion`)",
                    motion(f"step too long at {(i - 1) * step:.6g} s"),
                    0.1 * step,
                )
            state = stepper.state
            recorder.add(state.x, state.v, state.stages[-1], stepper.energies, stepper.dissipated)
    except KeyboardInterrupt:
        return motion(f"interrupted at {(recorder.count - 1) * step:.6g} s of {duration:.6g} s")
    return motion("completed")


def _budget(
    assembly: Assembly, start: np.ndarray, rest_energy: float, tolerance: float, duration: float
) -> Budget:
    stored = assembly.strain(start) + assembly.potential(start)
    rounding = 1e-14 * (abs(stored) + abs(rest_energy))
    return Budget(tolerance * abs(stored - rest_energy), duration, rounding)


def _check(beam: Beam, shape: Shape, duration: float, step: float, energy_tolerance: float) -> None:
    require_positive("duration", duration)
    require_positive("step", step)
    require_positive("energy_tolerance", energy_tolerance)
    if step > duration:
        raise ValueError(f"step = {step} s is longer than duration = {duration} s; shorten it")
    if shape.displacement.shape != (beam.assembly.n_nodes, 3):
        raise ValueError(
            f"shape has {len(shape.displacement)} nodes, the beam has {beam.assembly.n_nodes}; "
            "release a shape of the same mesh"
        )


def _count_modes(assembly: Assembly) -> int:
    free = int(np.count_nonzero(~assembly.fixed))
    return min(_DEFAULT_MODES, free - 2)


def _samples(n_samples: int, progress: bool) -> Iterator[int]:
    return iter(tqdm(range(1, n_samples), desc="simulate", unit="step", disable=not progress))
