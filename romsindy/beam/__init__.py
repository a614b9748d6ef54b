"""The beam simulator: geometrically exact beams, their modes, motion and reduced models."""

from romsindy.beam.beam import Beam
from romsindy.beam.beam_file import load_beam
from romsindy.beam.excitation import BaseAcceleration, PointForce
from romsindy.beam.modes import ModalBasis
from romsindy.beam.motion import EnergyBalance, History, Motion, StepTooLongError
from romsindy.beam.radau import RadauIIA
from romsindy.beam.reduction import relative_error
from romsindy.beam.section import Section
from romsindy.beam.sensors import Sensor, SensorArray
from romsindy.beam.static_curve import StaticCurve
from romsindy.beam.statics import NoEquilibriumError, Shape
from romsindy.beam.structure import CLAMPED, FREE, PINNED, Support
