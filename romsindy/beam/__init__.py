"""The beam simulator: geometrically exact beams, their modes, motion and reduced models."""

from romsindy.beam.beam import CLAMPED, FREE, PINNED, Beam, Shape, Support
from romsindy.beam.collocation import RadauIIA
from romsindy.beam.errors import NoEquilibriumError, StepTooLongError
from romsindy.beam.modes import ModalBasis
from romsindy.beam.motion import EnergyBalance, History, Motion
from romsindy.beam.reduction import StaticCases, reduce, relative_error, solve_static_cases
from romsindy.beam.section import Section
from romsindy.beam.sensors import Sensor, SensorArray

__all__ = [
    "CLAMPED",
    "FREE",
    "PINNED",
    "Beam",
    "EnergyBalance",
    "History",
    "ModalBasis",
    "Motion",
    "NoEquilibriumError",
    "RadauIIA",
    "Section",
    "Sensor",
    "SensorArray",
    "Shape",
    "StaticCases",
    "StepTooLongError",
    "Support",
    "reduce",
    "relative_error",
    "solve_static_cases",
]
