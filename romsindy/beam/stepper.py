"""From sample to sample in as many time steps as the energy balance asks for."""

from __future__ import annotations

import numpy as np

from romsindy.beam.assembly import Assembly
from romsindy.beam.integrator import Integrator, State

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
        self, integrator: Integrator, assembly: Assembly, state: State, budget: Budget, order: int
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

    def _energies_of(self, state: State) -> tuple[float, float, float]:
        a = self._assembly
        return a.kinetic(state.v), a.strain(state.x), a.potential(state.x)

    def advance(self, t: float, sample: float) -> bool:
        """Go on by one sample interval; return False if Newton fails in the finest steps."""
        parts, done = 2**FINEST, 0
        while done < parts:
            size = 2 ** (FINEST - self._level)
            h = sample * size / parts
            outcome = self._try(t + sample * done / parts, h)
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
