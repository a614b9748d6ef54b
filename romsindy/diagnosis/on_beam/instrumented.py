"""A beam with its sensors, and the one coordinate that these show."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np

from romsindy.beam.assembly import factorise, solve
from romsindy.beam.beam import Beam
from romsindy.beam.equilibrium import ModalBasis, Shape, find_displaced, hold
from romsindy.beam.motion import History, SensorArray
from romsindy.beam.static_shapes import StaticCurve
from romsindy.record.decay import Decay
from romsindy.record.signals import downsample
from romsindy.record.units import parse_unit
from romsindy.text import Shown
from romsindy.typing import Array

UNIT = "kg^0.5 m"
_CASES, _GRID, _MARGIN = 41, 121, 1.15  # of the static curve


_ELEMENTS = 20  # of a beam that is simulated: three modes to 1e-5, whatever was asked for
_MODES = 3  # that are told apart: of what is let go or hit, higher ones move little and die soon


_ENERGY = 1e-3  # drift of the energy: 72 dB below the readings where a beam strikes a stop
_SMALL = 1e-6  # m kg^0.5 / s: of the second mode, for the slope of a damping
# Samples per cycle, at least: of the first mode, and of the highest that is told apart
_SAMPLES, _WITHIN = 16, 2.5


def coarse(beam: Beam) -> Beam:
    """A beam with as few elements as the first modes need."""
    return replace(beam, elements=min(beam.elements, _ELEMENTS))


class RingingModes(NamedTuple):
    """Higher modes that a beam starts with, beside what goes with its first."""

    momenta: Array  # (n_modes, n_nodes, 3), of the higher modes
    forces: Array  # the same, that move each by one
    displaced: Array  # (n_modes,), kg^0.5 m
    rates: Array  # (n_modes,), kg^0.5 m/s


class ModesAtRest(NamedTuple):
    """Modes about the equilibrium that the sensors tell apart: rad/s, 1/s, (n_modes,) each."""

    omega: Array
    rates: Array

    @classmethod
    def of(cls, beam: Beam, count: int) -> ModesAtRest:
        """Of a beam."""
        rest, basis = beam.equilibrium().displacement, beam.modes(count=count)
        still, _ = beam.assembly.residual(rest, np.zeros_like(rest))
        damping = [
            np.vdot(beam.assembly.residual(rest, _SMALL * phi)[0] - still, phi) / _SMALL
            for phi in basis.shapes
        ]
        return cls(basis.omega, np.array(damping) / 2)


@dataclass(frozen=True, eq=False)
class InstrumentedBeam:
    """A beam seen through sensors: its mode shapes there define the coordinate."""

    beam: Beam
    sensors: SensorArray

    @cached_property
    def basis(self) -> ModalBasis:
        """Modes about the equilibrium."""
        return self.beam.modes(count=_MODES)

    @cached_property
    def shapes(self) -> Array:
        """Mode shapes at the sensors, (n_sensors, n_modes)."""
        told_apart = max(1, min(_MODES, len(self.sensors.sensors) - 2))  # some sensors to spare
        return self.sensors.mode_shapes(self.basis, told_apart)

    @property
    def fastest(self) -> float:
        """Angular frequency of the highest mode that the sensors tell apart, rad/s."""
        return float(self.basis.omega[self.shapes.shape[1] - 1])

    @property
    def shown(self) -> Shown:
        """How amplitudes are told: as the sensor that moves most reads them."""
        sizes = np.abs(self.shapes[:, 0])
        i = int(np.argmax(sizes))
        return Shown("mm", 1e3 * float(sizes[i]), self.sensors.labels[i])

    @property
    def usual(self) -> float:
        """Where the first mode moves most, m: there an effect is put of which no place is known."""
        return self.basis.point(1) or self.beam.length

    def coordinate(self, displacements: Array) -> Array:
        """First modal coordinate of sensor displacements (..., n_sensors), kg^0.5 m."""
        return np.asarray(displacements @ np.linalg.pinv(self.shapes)[0])

    def decay(self, decay: Decay) -> Decay:
        """What the sensors measured as a decay of the first modal coordinate."""
        signals: dict[str, Any] = {n: self.coordinate(x) for n, x in decay.signals.items()}
        return replace(decay, unit=UNIT, **signals)

    def thinned(self, decay: Decay) -> Decay:
        """A decay without what only modes do that the sensors do not tell apart.

        Accelerations show them louder than displacements by the square of their frequencies.
        """
        told = len(self.shapes.T)
        f = self.beam.modes(count=told + 1).omega / (2 * np.pi)
        slow = min(1 / (_SAMPLES * f[0]), 1 / (_WITHIN * f[told - 1]))
        factor = max(int(min(np.ceil(0.5 / f[told] / decay.dt), slow / decay.dt)), 1)
        signals: dict[str, Any] = {n: downsample(x, factor) for n, x in decay.signals.items()}
        return replace(decay, t=decay.t[::factor], **signals)

    def seen(self, fields: Array) -> Array:
        """Coordinate of nodal displacements (..., n_nodes, 3) from the equilibrium."""
        return self.coordinate(fields.reshape(*fields.shape[:-2], -1) @ self.sensors.rows.T)

    def curve(self, reach: float) -> StaticCurve:
        """The static curve of the first mode, over the coordinate, a little beyond ``reach``."""
        own = self.beam.static_curve(amplitude=_MARGIN * reach, cases=_CASES)
        return own.read_by(self.seen, reach, _GRID)

    def held(
        self, beam: Beam, q: float, load: Array | None = None, ringing: RingingModes | None = None
    ) -> Shape:
        """Shape from which the first mode of a beam swings with the coordinate ``q``, kg^0.5 m.

        A nodal load, (n_nodes, 3) and of any size, holds it; by default the modal force of its
        first mode. Forces of higher modes move each of these as far as it rings.
        """
        momentum, rest = beam.modes(count=1).momenta[0], beam.equilibrium()
        reading = self.coordinate(self.sensors_on(beam).rows.T).reshape(momentum.shape)
        shape = hold(beam.assembly, rest, momentum, reading, q)
        if load is not None:
            # Other modes, which this load moves too, are seen in the coordinate, but soon die.
            swing = float(np.vdot(momentum, shape.displacement - rest.displacement))
            shape = hold(beam.assembly, rest, load, momentum, swing)
        if ringing is None or not ringing.displaced.any():
            return shape
        holding = momentum if load is None else load
        patterns = np.stack([holding, *ringing.forces])
        readings = np.stack([momentum, *ringing.momenta])
        size = np.vdot(shape.load, holding) / np.vdot(holding, holding)
        factors = np.append(size, np.zeros(len(ringing.forces)))
        targets = np.tensordot(readings, shape.displacement) + np.append(0.0, ringing.displaced)
        given = shape.displacement, patterns, readings, targets, factors
        x, factors = find_displaced(beam.assembly, *given)
        return Shape(shape.s, x, np.tensordot(factors, patterns, axes=1))

    def sensors_on(self, beam: Beam) -> SensorArray:
        """The sensors on a changed beam; those beyond the end of a shorter one sit there."""
        if (beam.length, beam.elements) == (self.beam.length, self.beam.elements):
            return self.sensors
        placed = [replace(s, at=min(s.at, beam.length)) for s in self.sensors.sensors]
        return beam.sensors(placed)

    def pushed(
        self, beam: Beam, shape: Shape, q_dot: float, ringing: RingingModes | None = None
    ) -> Array:
        """Velocity (n_nodes, 3) with which the first mode of a beam moves at ``q_dot``.

        It goes with the shapes that modal forces would bend the beam into from where it is.
        """
        momentum, a = beam.modes(count=1).momenta[0], beam.assembly
        stiffness, _ = a.tangents(shape.displacement)
        factors = factorise(stiffness, a.fixed)

        def bent(force: Array) -> Array:
            return np.asarray(solve(factors, np.where(a.fixed, 0.0, force)))

        first = bent(momentum)
        reading = self.coordinate(self.sensors_on(beam).rows.T).reshape(momentum.shape)
        velocity = np.asarray(q_dot * first / np.vdot(reading, first))
        if ringing is None or not ringing.rates.any():
            return velocity
        shapes = np.stack([first, *map(bent, ringing.forces)])
        readings = np.stack([momentum, *ringing.momenta])
        rates = np.tensordot(readings, shapes, axes=([1, 2], [1, 2]))
        more = np.linalg.solve(rates, np.append(0.0, ringing.rates))
        return velocity + np.tensordot(more, shapes, axes=1)

    def readings(
        self, beam: Beam, q: float, duration: float, step: float, load: Array | None = None
    ) -> Array:
        """Displacements (n, n_sensors), m, of a beam that is let go as `held`."""
        return self.motion(beam, q, duration, step, load).displacement

    def motion(
        self,
        beam: Beam,
        q: float,
        duration: float,
        step: float,
        load: Array | None = None,
        *,
        q_dot: float = 0.0,
        ringing: RingingModes | None = None,
    ) -> History:
        """What the sensors read, (n, n_sensors) each, of a beam that starts `held` and `pushed`."""
        shape, sensors = self.held(beam, q, load, ringing), self.sensors_on(beam)
        still = not q_dot and (ringing is None or not ringing.rates.any())
        velocity = None if still else self.pushed(beam, shape, q_dot, ringing)
        # Only what the sensors read is kept, so one mode is enough to record.
        motion = beam.simulate(
            shape,
            duration,
            step,
            sensors=sensors,
            modes=beam.modes(count=1),
            velocity=velocity,
            energy_tolerance=_ENERGY,
            progress=False,
        )
        # What is kept beside the modes is what the sensors read.
        return cast(History, motion.sensors)


def checked_readings(decay: Decay, i: int, sensors: SensorArray, length: float) -> Decay:
    """Return a decay, number ``i`` in messages, with one column per sensor, in m and s.

    Raises a ValueError for another number of channels, or another unit than m.
    """
    channels, n = decay.n_channels, len(sensors.sensors)
    if channels != n:
        are = "is" if n == 1 else "are"
        raise ValueError(
            f"decay {i} has {_count(channels, 'channel')}, but there {are} {_count(n, 'sensor')}:"
            " give one channel per sensor, in the order of the sensors"
        )
    if decay.unit not in (None, "m"):
        raise ValueError(f"decay {i} is in {decay.unit}, the beam in m: {_conversion(decay.unit)}")
    largest = float(np.abs(decay.q).max())
    if largest > length:
        raise ValueError(
            f"decay {i} reaches {largest:.3g} m, the beam is {length:.3g} m long: if it is in mm,"
            " give Decay(t, 0.001 * q, unit='m')"
        )
    signals = {n: x.reshape(len(decay.t), -1) for n, x in decay.signals.items()}
    return replace(decay, unit="m", **signals)


def _count(n: int, thing: str) -> str:
    return f"{n} {thing}" if n == 1 else f"{n} {thing}s"


def _conversion(unit: str) -> str:
    """What a user does with a decay in another unit."""
    try:
        known = parse_unit(unit)
    except ValueError:
        known = None
    if known is None or known.base != "m" or known.quantity != "displacement":
        return "give the displacements of the sensors, Decay(t, q, unit='m')"
    return f"give Decay(t, {known.factor:g} * q, unit='m')"
