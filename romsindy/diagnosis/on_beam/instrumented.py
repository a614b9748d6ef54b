"""A beam with its sensors, and the one coordinate that these show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from romsindy.beam import Beam, Shape, StaticCurve
from romsindy.beam.modes import ModalBasis
from romsindy.beam.sensors import SensorArray
from romsindy.beam.statics import hold
from romsindy.record.decay import Decay
from romsindy.typing import Array

UNIT = "kg^0.5 m"
_CASES, _GRID, _MARGIN = 41, 121, 1.15  # of the static curve


def projected_modes(n_sensors: int) -> int:
    """Modes that so many sensors tell apart, with some sensors to spare."""
    return max(1, min(2, n_sensors - 2))


@dataclass(frozen=True, eq=False)
class InstrumentedBeam:
    """A beam seen through sensors: its mode shapes there define the coordinate."""

    beam: Beam
    sensors: SensorArray

    @cached_property
    def basis(self) -> ModalBasis:
        """Modes about the equilibrium."""
        return self.beam.modes(count=max(3, projected_modes(len(self.sensors.sensors))))

    @cached_property
    def shapes(self) -> Array:
        """Mode shapes at the sensors, (n_sensors, n_modes)."""
        return self.sensors.mode_shapes(self.basis, projected_modes(len(self.sensors.sensors)))

    def coordinate(self, displacements: Array) -> Array:
        """First modal coordinate of sensor displacements (..., n_sensors), kg^0.5 m."""
        return np.asarray(displacements @ np.linalg.pinv(self.shapes)[0])

    def decay(self, decay: Decay) -> Decay:
        """Displacements of the sensors as a decay of the first modal coordinate."""
        return Decay(decay.t, self.coordinate(decay.q), unit=UNIT)

    def seen(self, fields: Array) -> Array:
        """Coordinate of nodal displacements (..., n_nodes, 3) from the equilibrium."""
        flat = fields.reshape(*fields.shape[:-2], -1)
        return self.coordinate(flat @ self.sensors.rows.T)

    def curve(self, reach: float) -> StaticCurve:
        """The static curve of the first mode, over the coordinate, a little beyond ``reach``."""
        own = self.beam.static_curve(amplitude=_MARGIN * reach, cases=_CASES)
        return own.read_by(self.seen, reach, _GRID)

    def held(self, beam: Beam, q: float, load: Array | None = None) -> Shape:
        """Shape from which the first mode of a beam swings with the coordinate ``q``, kg^0.5 m.

        A nodal load, (n_nodes, 3) and of any size, holds it; by default the modal force of its
        first mode.
        """
        momentum, rest = beam.modes(count=1).momenta[0], beam.equilibrium()
        reading = self.coordinate(self.sensors_on(beam).rows.T).reshape(momentum.shape)
        shape = hold(beam.assembly, rest, momentum, reading, q)
        if load is None:
            return shape
        # Other modes, which this load moves too, are seen in the coordinate, but soon die.
        swing = float(np.vdot(momentum, shape.displacement - rest.displacement))
        return hold(beam.assembly, rest, load, momentum, swing)

    def sensors_on(self, beam: Beam) -> SensorArray:
        """The sensors on a changed beam; those beyond the end of a shorter one sit there."""
        if beam.length == self.beam.length:
            return self.sensors
        placed = [replace(s, at=min(s.at, beam.length)) for s in self.sensors.sensors]
        return beam.sensors(placed)

    def readings(
        self, beam: Beam, q: float, duration: float, step: float, load: Array | None = None
    ) -> Array:
        """Displacements (n, n_sensors), m, of a beam that is let go as `held`."""
        shape, sensors = self.held(beam, q, load), self.sensors_on(beam)
        # Only what the sensors read is kept, so one mode is enough to record.
        motion = beam.simulate(
            shape, duration, step, sensors=sensors, modes=beam.modes(count=1), progress=False
        )
        return sensors.measure(motion)

    def keeping(self, channels: Sequence[int]) -> InstrumentedBeam:
        """The same with some of the sensors."""
        kept = [self.sensors.sensors[i] for i in channels]
        return InstrumentedBeam(self.beam, self.beam.sensors(kept))
