"""Displacement sensors, noise, and the modal transform of a measured response."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from romsindy.beam.assembly import Assembly
from romsindy.beam.modes import ModalBasis, Recorded
from romsindy.physics.validation import require_position, unit_vector
from romsindy.record.decay import Decay
from romsindy.record.signals import with_noise

TRANSVERSE = (0.0, 1.0)
AXIAL = (1.0, 0.0)


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
    """Sensors on a beam.

    Attributes
    ----------
    sensors : tuple of Sensor
        The sensors, one channel each.
    rows : (n_channels, n_nodes * 3) array
        What each reads of the nodal displacements.
    """

    sensors: tuple[Sensor, ...]
    rows: np.ndarray

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

        Raises
        ------
        ValueError
            If there are fewer sensors than modes, or the basis has fewer modes.
        """
        basis.index(modes)
        if modes > len(self.sensors):
            raise ValueError(
                f"modes = {modes} cannot be told apart by {len(self.sensors)} sensors; ask for "
                "fewer modes or place more sensors"
            )
        shapes = basis.shapes[:modes].reshape(modes, -1)
        clean = self.rows @ shapes.T
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

    Raises
    ------
    ValueError
        For no sensors, or one off the beam.
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
