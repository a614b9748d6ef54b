"""What a beam lacks, from decays measured by several sensors: from the records to a better beam."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from romsindy.beam import Beam
from romsindy.beam.modes import ModalBasis
from romsindy.beam.sensors import SensorArray
from romsindy.decay import Decay
from romsindy.diagnosis.catalogue import CATALOGUE
from romsindy.diagnosis.effects import Effect
from romsindy.diagnosis.fitting import Part
from romsindy.diagnosis.parameters import (
    ParameterEffect,
    parameter_effects,
    projected_modes,
    without,
)
from romsindy.diagnosis.physical import beam_with_effect
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.sensing import SensorFault, find_fault
from romsindy.diagnosis.workflow import diagnose
from romsindy.model import ReducedModel
from romsindy.refine import refine
from romsindy.typing import Array

_UNIT = "kg^0.5 m"
_ORDER = 7
# What a beam explains by its own parameters, and a sensor by comparison with the others.
_GENERIC = ("linear_frequency", "gain", "saturation", "bias", "sensor_nonlinearity")


@dataclass(frozen=True)
class Setup:
    """A beam seen through sensors: releases, simulations and the coordinate of the first mode."""

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

    def decay(self, decay: Decay, displacements: Array) -> Decay:
        """Displacements of the sensors as a decay of the first modal coordinate."""
        return Decay(decay.t, self.coordinate(displacements), unit=_UNIT)

    def readings(self, beam: Beam, q: float, duration: float, step: float) -> Array:
        """Displacements (n, n_sensors) of a beam that is let go where the coordinate is ``q``."""
        tip = q * float(self.basis.shapes[0, -1, 1])
        for _ in range(4):  # the tip is nearly proportional to the coordinate
            shape = beam.release_shape(tip, mode=1)
            held = shape.displacement - beam.equilibrium().displacement
            tip *= q / float(self.coordinate(self.sensors.rows @ held.ravel()))
        motion = beam.simulate(
            beam.release_shape(tip, mode=1), duration, step, sensors=self.sensors, progress=False
        )
        return self.sensors.measure(motion)

    def keeping(self, channels: Sequence[int]) -> Setup:
        """The same with some of the sensors."""
        kept = [self.sensors.sensors[i] for i in channels]
        return Setup(self.beam, self.beam.sensors(kept))


@dataclass(frozen=True)
class BeamReport:
    """What a beam and its sensors lack.

    Attributes
    ----------
    reduced : DiagnosisReport
        In the coordinate of the first mode.
    faults : tuple of SensorFault
        Sensors that were left out.
    setup : Setup
        The beam with the sensors that were used.
    channels : tuple of int
        Which of the measured channels these are.
    """

    reduced: DiagnosisReport
    faults: tuple[SensorFault, ...]
    setup: Setup
    channels: tuple[int, ...]
    start: float
    duration: float
    step: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what is missing: faults of sensors first, then effects."""
        found = () if self.reduced.verdict == "none" else self.reduced.best.names
        return (*(f"sensor_{fault.kind}" for fault in self.faults), *found)

    @property
    def verdict(self) -> str:
        """As of the reduced model; "named" where a sensor alone is to blame."""
        only_a_sensor = self.faults and self.reduced.verdict == "none"
        return "named" if only_a_sensor else self.reduced.verdict

    @property
    def sentence(self) -> str:
        """The finding in words, sensors first."""
        left_out = "".join(f"{str(f).capitalize()} and was left out. " for f in self.faults)
        return left_out + self.reduced.sentence

    def improved(self) -> tuple[Beam, float]:
        """The beam with the physical effect, and its coefficient fitted there.

        Raises
        ------
        ValueError
            If not exactly one effect was named that has a counterpart on a beam.
        """
        parts = self.reduced.best.effects
        first = _first_guess(self.setup, parts[0]) if len(parts) == 1 else 1.0

        def decay_of(beam: Beam) -> Decay:
            readings = self.setup.readings(beam, self.start, self.duration, self.step)
            return Decay(
                self.step * np.arange(len(readings)), self.setup.coordinate(readings), unit=_UNIT
            )

        return beam_with_effect(self.setup.beam, self.reduced, decay_of, first)

    def predicted(self, beam: Beam, measured: Decay) -> Array:
        """Displacements of a beam, (n, n_sensors), in a decay that took no part.

        Only the amplitude of the release is fitted, by two steps of Gauss and Newton.
        """
        wanted = measured.q[:, list(self.channels)]
        q = float(self.setup.coordinate(wanted[0]))
        duration = float(measured.t[-1] - measured.t[0])

        def readings(q: float) -> Array:
            return self.setup.readings(beam, q, duration, measured.dt)[: len(wanted)]

        best = readings(q)
        slope = (readings(1.002 * q) - best) / (0.002 * q)
        for _ in range(2):
            change = float(np.sum(slope * (wanted - best)) / np.sum(slope**2))
            trial = readings(q + change)
            if np.sum((wanted - trial) ** 2) >= np.sum((wanted - best) ** 2):
                break
            best, q = trial, q + change
        return best

    def sensor_errors(self, beam: Beam, measured: Decay, noise: Array) -> dict[str, float]:
        """Rms of measured minus predicted displacement, over the rms of the noise, per sensor."""
        misfit = measured.q[:, list(self.channels)] - self.predicted(beam, measured)
        errors = np.sqrt(np.mean(misfit**2, axis=0)) / noise[list(self.channels)]
        return dict(zip(self.setup.sensors.labels, errors.tolist(), strict=True))


def diagnose_beam(
    beam: Beam,
    sensors: SensorArray,
    measured: Decay | Sequence[Decay],
    *,
    held_out: Decay | None = None,
    free: Sequence[str] = (),
    catalogue: Sequence[Effect] = CATALOGUE,
    false_alarm: float = 0.01,
    n_jobs: int = 1,
    progress: Callable[[str], None] | None = None,
) -> BeamReport:
    """Find, name and add what a beam lacks.

    Parameters
    ----------
    beam : Beam
        The simulation.
    sensors : SensorArray
        Where the displacements were measured.
    measured : Decay or sequence of Decay
        Displacements from the equilibrium [m], one channel per sensor. The first mode rings down
        from rest at the first sample.
    held_out : Decay, optional
        As `measured`, to judge by.
    free : names
        As in `diagnose`; empty: the parameters of the beam are those assumed, or are to blame.
    catalogue, false_alarm, n_jobs, progress
        As in `diagnose`.

    Raises
    ------
    ValueError
        For records that do not fit the sensors, or that cannot be compared with the beam.
    """
    several = [measured] if isinstance(measured, Decay) else list(measured)
    everything = [*several, *([held_out] if held_out is not None else [])]
    _check(sensors, several, everything)
    setup = Setup(beam, sensors)
    largest = max(several, key=lambda d: float(np.abs(setup.coordinate(d.q)[0])))
    start = float(setup.coordinate(largest.q[0]))
    duration, step = float(largest.t[-1] - largest.t[0]), largest.dt
    simulated = setup.readings(beam, start, duration, step)
    fault = find_fault(
        np.concatenate([d.q for d in several]), simulated, setup.shapes, sensors.labels
    )
    channels = tuple(i for i in range(len(sensors.sensors)) if fault is None or i != fault.channel)
    setup = setup.keeping(channels)
    decays = [setup.decay(d, d.q[:, list(channels)]) for d in everything]
    simulated = simulated[:, list(channels)]
    own = Decay(step * np.arange(len(simulated)), setup.coordinate(simulated), unit=_UNIT)
    model, floor = calibrated(beam, own)
    reach = float(np.abs(own.q).max())
    parameters = parameter_effects(beam, setup.sensors, reach)
    unneeded = (*_GENERIC, *(p.name for p in parameters))
    reduced = diagnose(
        model,
        decays[: len(several)],
        held_out=decays[-1] if held_out is not None else None,
        free=free,
        catalogue=(*without(catalogue, unneeded), *parameters),
        false_alarm=false_alarm,
        floor=floor,
        n_jobs=n_jobs,
        progress=progress,
    )
    return BeamReport(
        reduced, () if fault is None else (fault,), setup, channels, start, duration, step
    )


def calibrated(beam: Beam, simulated: Decay) -> tuple[ReducedModel, float]:
    """Reduced model of a beam that follows its own simulated decay, and what it leaves.

    The static reduction is the start; the highest inertia terms stay as they are there. Twice the
    rms of what is left, as a part of the amplitude, is the floor of a diagnosis.
    """
    reach = float(np.abs(simulated.q).max())
    static = beam.reduce(order=_ORDER, amplitude=1.05 * reach).coefficients
    omega2 = static["omega^2"]
    damping = {"c_linear": beam.alpha + beam.eta * omega2, "c_q^2 q_dot": 0.0}
    start = ReducedModel.from_coefficients({**static, **damping}, unit=_UNIT)
    fitted = refine(start, simulated, fixed=("Upsilon_6", "Upsilon_7"))
    left = float(np.std(fitted.residuals[0])) / reach
    return replace(fitted.model, amplitude_range=None), max(2 * left, 2e-4)


def _check(sensors: SensorArray, several: Sequence[Decay], everything: Sequence[Decay]) -> None:
    if not several:
        raise ValueError("measured is empty: give at least one Decay")
    n = len(sensors.sensors)
    for i, decay in enumerate(everything):
        if decay.q.ndim != 2 or decay.q.shape[1] != n:
            channels = 1 if decay.q.ndim == 1 else decay.q.shape[1]
            raise ValueError(
                f"decay {i} has {channels} channels, but there are {n} sensors: give one channel"
                " per sensor, in the order of the sensors"
            )
        if decay.measured != "displacement":
            raise ValueError(
                f"decay {i} holds {decay.measured}: displacements are needed; integrate it first"
            )


def _first_guess(setup: Setup, part: Part) -> float:
    """Coefficient of an effect on the beam from its strength on the mode."""
    strength = float(part.strengths[0, 0])
    if isinstance(part.effect, ParameterEffect):
        return strength
    phi = setup.basis.shapes[0, :, 1]
    per_strength = {
        "viscous": phi[-1] ** 2,
        "dry_friction": abs(phi[-1]),
        # of a drag coefficient of 1: half the density of air times the width
        "quadratic_drag": 0.015
        * float(np.sum(setup.beam.assembly.tributary.ravel() * np.abs(phi) ** 3)),
    }
    return strength / float(per_strength.get(part.effect.name, 1.0))
