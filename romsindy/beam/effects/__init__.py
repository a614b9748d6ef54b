"""Physical effects that can be switched on: `beam.with_effect(Drag(coefficient=1.2))`."""

from romsindy.beam.effects.base import Effect, LineEffect, Point, PointEffect
from romsindy.beam.effects.clamp import ClampCompliance
from romsindy.beam.effects.cubic import CubicSpring
from romsindy.beam.effects.dashpot import Dashpot
from romsindy.beam.effects.drag import Drag
from romsindy.beam.effects.friction import Friction, SpringFriction
from romsindy.beam.effects.magnet import Magnet
from romsindy.beam.effects.mass import AddedMass
from romsindy.beam.effects.spring import ExtraTension, Spring
from romsindy.beam.effects.stop import Stop

__all__ = [
    "AddedMass",
    "ClampCompliance",
    "CubicSpring",
    "Dashpot",
    "Drag",
    "Effect",
    "ExtraTension",
    "Friction",
    "LineEffect",
    "Magnet",
    "Point",
    "PointEffect",
    "Spring",
    "SpringFriction",
    "Stop",
]
