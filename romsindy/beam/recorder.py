"""Keeps, sample by sample, what a simulation was asked for, and nothing else."""

from __future__ import annotations

import numpy as np

from romsindy.beam.excitation import Excitation
from romsindy.beam.modes import ModalBasis
from romsindy.beam.motion import Cost, EnergyBalance, History, Motion
from romsindy.beam.sensors import SensorArray


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
