"""What a simulation returns: modal and sensor histories, the energy balance, the cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from romsindy.beam.assembly import Assembly
from romsindy.beam.equilibrium import ModalBasis, Recorded
from romsindy.beam.excitation import Excitation
from romsindy.beam.structure import AXIAL, TRANSVERSE
from romsindy.physics.validation import require_position, unit_vector
from romsindy.record.decay import Decay
from romsindy.record.signals import with_noise


@dataclass(frozen=True)
class Sensor:
    """A displacement sensor.

    Parameters
    ----------
    at : float
        Position on the undeformed axis, m.
    direction : tuple of two float
        (x, y), of any length; (0, 1) is transverse, (1, 0) axial.

    Raises
    ------
    ValueError
        For a direction of length zero.
    """

    at: float
    direction: tuple[float, float] = TRANSVERSE

    def __post_init__(self) -> None:
        unit_vector(self.direction)


@dataclass(frozen=True, eq=False)
class SensorArray:
    """Sensors on a beam."""

    sensors: tuple[Sensor, ...]  # one channel each
    rows: np.ndarray  # (n_channels, n_nodes * 3), what each reads of the nodal displacements

    @property
    def labels(self) -> list[str]:
        """A name for each channel, such as "y(0.45)": direction and position [m]."""
        axes = {TRANSVERSE: "y", AXIAL: "x"}
        return [f"{axes.get(s.direction, 'd')}({s.at:g})" for s in self.sensors]

    def measure(
        self, motion: Recorded, snr_db: float | None = None, seed: int | None = 0
    ) -> np.ndarray:
        """Return displacements [m] from equilibrium, (n_samples, n_channels), noisy if asked.

        Parameters
        ----------
        motion : Recorded
            Simulated with these sensors, or with its full field kept.
        snr_db : float, optional
            Signal-to-noise ratio of each channel, rms over the record, dB; None is clean.
        seed : int, optional
            Of the noise.

        Raises
        ------
        ValueError
            If the motion did not record these sensors.
        """
        clean = motion.readings(self.rows)
        return clean if snr_db is None else with_noise(clean, snr_db, seed)

    def mode_shapes(
        self, basis: ModalBasis, modes: int = 3, snr_db: float | None = None, seed: int | None = 0
    ) -> np.ndarray:
        """Return the first `modes` mode shapes at the sensors, (n_channels, modes).

        Raises a ValueError if there are fewer sensors than modes, or the basis has fewer modes.
        """
        basis.index(modes)
        if modes > len(self.sensors):
            raise ValueError(
                f"modes = {modes} cannot be told apart by {len(self.sensors)} sensors; ask for "
                "fewer modes or place more sensors"
            )
        clean = self.rows @ basis.shapes[:modes].reshape(modes, -1).T
        return clean if snr_db is None else with_noise(clean, snr_db, seed)

    def experiment(
        self,
        motion: Recorded,
        modes: int = 3,
        snr_db: float | None = 35.0,
        seed: int = 0,
        basis: ModalBasis | None = None,
    ) -> Decay:
        """Return the modal coordinates, one channel per mode, that an experiment would find.

        Noise goes on displacements and on mode shapes; the pseudo-inverse of the noisy shapes
        gives q = Phi^+ x (the paper's eq. 21 and section 5).

        Parameters
        ----------
        motion : Recorded
            Simulated with these sensors.
        modes : int
            Number of modes that are told apart.
        snr_db : float, optional
            Signal-to-noise ratio of both, dB; None is clean.
        seed : int
            Of both noises.
        basis : ModalBasis, optional
            The modes (default: those in which the motion was recorded).
        """
        x = self.measure(motion, snr_db, seed)
        phi = self.mode_shapes(basis or motion.basis, modes, snr_db, seed + 1)
        return Decay(motion.t, x @ np.linalg.pinv(phi).T, unit="kg^0.5 m")


def place_sensors(assembly: Assembly, sensors: Sequence[Sensor | float]) -> SensorArray:
    """Return the sensors on a beam; a bare position, m, stands for a transverse and an axial one.

    Raises a ValueError for no sensors, or one off the beam.
    """
    placed: list[Sensor] = []
    for sensor in sensors:
        if isinstance(sensor, Sensor):
            placed.append(sensor)
        else:
            placed += [Sensor(float(sensor), TRANSVERSE), Sensor(float(sensor), AXIAL)]
    if not placed:
        raise ValueError("sensors is empty; give at least one position, in m")
    for sensor in placed:
        require_position("sensor at", sensor.at, assembly.structure.length)
    rows = [assembly.point_load(unit_vector(s.direction), at=s.at).ravel() for s in placed]
    return SensorArray(tuple(placed), np.array(rows))


@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """Energies over time, J, (n_samples,), relative to the equilibrium without excitation."""

    kinetic: np.ndarray  # of beam and masses
    strain: np.ndarray  # stored in the beam and in elastic clamps
    # Of gravity and of the effects that store energy (springs, magnets, stops)
    potential: np.ndarray
    dissipated: np.ndarray  # what damping and dissipative effects have taken since the start
    # What the excitation has put in since the start; of a moving base, that of the inertial force
    # in its frame
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

        Raises a ValueError if the motion was recorded in other modes, or fewer, and its full field
        was not kept.
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

        Raises a ValueError if the motion did not record these sensors.
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


class Recorder:
    """Histories of the modes, the sensors and, if asked, of the whole field, at the times t."""

    def __init__(
        self,
        basis: ModalBasis,
        sensors: SensorArray | None,
        t: np.ndarray,
        excitation: Excitation,
        keep_field: bool,
    ) -> None:
        size = basis.momenta[0].size
        self._basis = basis
        self._sensors = sensors
        self._t = t
        # also refuses a bad history before the work
        self._force, self._base = excitation.force(t), excitation.base(t)
        self._n_modes = len(basis.omega)
        modal = basis.momenta.reshape(self._n_modes, size)
        self._rows = modal if sensors is None else np.concatenate([modal, sensors.rows])
        self._offset = self._rows @ basis.equilibrium.displacement.ravel()
        self._readings = np.empty((3, len(t), len(self._rows)))
        self._field = np.empty((3, len(t), size)) if keep_field else None
        self._energies = np.empty((5, len(t)))
        self.count = 0

    def add(
        self,
        x: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        energies: tuple[float, float, float],
        dissipated: float,
        work: float,
    ) -> None:
        """Record one sample."""
        state = np.stack([x.ravel(), v.ravel(), a.ravel()])
        readings = state @ self._rows.T
        readings[0] -= self._offset
        self._readings[:, self.count] = readings
        self._energies[:, self.count] = (*energies, dissipated, work)
        if self._field is not None:
            self._field[:, self.count] = state
        self.count += 1

    def motion(self, cost: Cost, rest: tuple[float, float, float], stop_reason: str) -> Motion:
        """Return what was recorded; energies are counted from those at rest."""
        n = self.count
        readings = self._readings[:, :n]
        kinetic, strain, potential, dissipated, work = self._energies[:, :n]
        return Motion(
            t=self._t[:n],
            basis=self._basis,
            coordinates=History(*readings[:, :, : self._n_modes]),
            energy=EnergyBalance(kinetic, strain - rest[1], potential - rest[2], dissipated, work),
            cost=cost,
            stop_reason=stop_reason,
            sensors=History(*readings[:, :, self._n_modes :]) if self._sensors else None,
            sensor_array=self._sensors,
            field=None if self._field is None else History(*self._field[:, :n]),
            force=None if self._force is None else self._force[:n],
            base=None if self._base is None else self._base[:n],
        )
