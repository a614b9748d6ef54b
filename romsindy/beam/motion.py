"""What a simulation returns: modal and sensor histories, the energy balance, the cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from romsindy.beam.modes import ModalBasis
from romsindy.beam.sensors import SensorArray


@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """Energies over time, J, relative to the equilibrium without excitation.

    Attributes
    ----------
    kinetic, strain : (n_samples,) arrays
        Of beam and masses; stored in the beam and in elastic clamps.
    potential : (n_samples,) array
        Of gravity and of the effects that store energy (springs, magnets, stops).
    dissipated : (n_samples,) array
        What damping and dissipative effects have taken since the start.
    work : (n_samples,) array
        What the excitation has put in since the start; of a moving base, that of the inertial
        force in its frame.
    """

    kinetic: np.ndarray
    strain: np.ndarray
    potential: np.ndarray
    dissipated: np.ndarray
    work: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """Sum of the first four less the work, constant but for the error of time integration."""
        return self.kinetic + self.strain + self.potential + self.dissipated - self.work

    @property
    def drift(self) -> float:
        """Largest change of the total, relative to the energy at the start and the largest work."""
        scale = abs(self.total[0]) + np.max(np.abs(self.work))
        change = np.max(np.abs(self.total - self.total[0]))
        return float(change / scale) if scale > 0.0 else 0.0  # nothing has moved


@dataclass(frozen=True)
class Cost:
    """What a simulation took: time steps, Newton iterations, wall time in s."""

    steps: int
    iterations: int
    seconds: float


class History(NamedTuple):
    """Displacement, velocity and acceleration over time, (n_samples, n_channels) each."""

    displacement: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


@dataclass(frozen=True, eq=False)
class Motion:
    """A simulated motion, sampled uniformly.

    Attributes
    ----------
    t : (n_samples,) array
        Time, s.
    basis : ModalBasis
        The modes in which it was recorded.
    coordinates : History
        q, q_dot, q_ddot of these modes, (n_samples, n_modes), kg^0.5 m, per s, s^2.
    energy : EnergyBalance
    cost : Cost
    stop_reason : str
        "completed", or why it ended early.
    sensors, sensor_array : History, SensorArray, optional
        Displacements from equilibrium and their derivatives at the sensors, m; these sensors.
    field : History, optional
        Of all nodes, (n_samples, n_nodes * 3), if that was asked for.
    force : (n_samples,) or (n_samples, n_forces) array, optional
        The force that drove it, N; several in their order.
    base : (n_samples,) array, optional
        The acceleration of the base, m/s^2; all displacements are relative to the base.
    """

    t: np.ndarray
    basis: ModalBasis
    coordinates: History
    energy: EnergyBalance
    cost: Cost
    stop_reason: str
    sensors: History | None = None
    sensor_array: SensorArray | None = None
    field: History | None = None
    force: np.ndarray | None = None
    base: np.ndarray | None = None

    def __repr__(self) -> str:
        dt = self.t[1] - self.t[0] if len(self.t) > 1 else 0.0
        return (
            f"Motion({self.t[-1]:.6g} s in {len(self.t)} samples of {dt:.6g} s, "
            f"{self.stop_reason}; energy drift {self.energy.drift:.1e},\n"
            f"       {self.cost.steps} steps, {self.cost.iterations} iterations, "
            f"{self.cost.seconds:.3g} s)"
        )

    def modal(self, basis: ModalBasis) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, q_dot, q_ddot, (n_samples, n_modes) each, in the modes of `basis`.

        Raises
        ------
        ValueError
            If the motion was recorded in other modes, or fewer, and its full field was not kept.
        """
        if self.field is not None:
            shape = (len(self.t), *basis.shapes.shape[1:])
            x, v, a = (f.reshape(shape) for f in self.field)
            return basis.coordinates(x), basis.rates(v), basis.rates(a)
        n = len(basis.omega)
        if n > len(self.basis.omega) or not _same_modes(self.basis, basis):
            raise ValueError(
                f"the motion was recorded in {self.basis!r}, which do not hold {basis!r}; "
                "simulate with modes=... set to these, or with keep_field=True"
            )
        q, q_dot, q_ddot = self.coordinates
        return q[:, :n], q_dot[:, :n], q_ddot[:, :n]

    def readings(self, rows: np.ndarray) -> np.ndarray:
        """Return what sensors read of the displacements from equilibrium, (n_samples, n_rows), m.

        `rows`, (n_rows, n_nodes * 3), are those of a `SensorArray`.

        Raises
        ------
        ValueError
            If the motion did not record these sensors.
        """
        if self.field is not None:
            rest = self.basis.equilibrium.displacement.ravel()
            return np.asarray((self.field.displacement - rest) @ rows.T)
        recorded = self.sensor_array
        if self.sensors is None or recorded is None or not np.array_equal(recorded.rows, rows):
            raise ValueError(
                "the motion did not record these sensors; simulate with sensors=... set to them, "
                "or with keep_field=True"
            )
        return self.sensors.displacement


class StepTooLongError(RuntimeError):
    """Newton did not converge; holds the motion up to there and a step to try, s."""

    def __init__(self, message: str, motion: Motion, step_to_try: float) -> None:
        super().__init__(message)
        self.motion = motion
        self.step_to_try = step_to_try


def _same_modes(recorded: ModalBasis, asked: ModalBasis) -> bool:
    """Tell whether the first modes of `recorded` are those of `asked`, up to rounding."""
    n = len(asked.omega)
    if recorded.shapes.shape[1:] != asked.shapes.shape[1:]:
        return False
    # 1e-6 is far above what the eigenvalue solver leaves and far below any change of the beam
    same_shapes = np.allclose(
        recorded.shapes[:n], asked.shapes, rtol=0.0, atol=1e-6 * np.abs(asked.shapes).max()
    )
    same_rest = np.allclose(
        recorded.equilibrium.displacement, asked.equilibrium.displacement, rtol=0.0, atol=1e-9
    )
    return same_shapes and same_rest
