"""The beam simulator: geometrically exact beams, their modes, motion and reduced models."""

from romsindy.beam.beam import Beam, load_beam
from romsindy.beam.equilibrium import ModalBasis, NoEquilibriumError, Shape
from romsindy.beam.excitation import BaseAcceleration, PointForce
from romsindy.beam.integrator import RadauIIA
from romsindy.beam.motion import (
    EnergyBalance,
    History,
    Motion,
    Sensor,
    SensorArray,
    StepTooLongError,
)
from romsindy.beam.static_shapes import StaticCurve, relative_error
from romsindy.beam.structure import CLAMPED, FREE, PINNED, Section, Support
