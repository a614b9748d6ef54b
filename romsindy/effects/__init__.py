"""Effects that a simulation may lack: each written once, for models, beams and the diagnosis."""

from __future__ import annotations

from collections.abc import Iterable

from romsindy.effects.base import (
    Effect,
    Parameter,
    ReadingEffect,
    Scales,
    State,
    TermEffect,
    TimedEffect,
)
from romsindy.effects.damping import (
    AirDrag,
    Damper,
    DryFriction,
    GrowingDamping,
    Hysteretic,
    Rubbing,
    SpeedCubedDamping,
    SpringFriction,
    Viscous,
)
from romsindy.effects.memory import (
    Backlash,
    MemoryEffect,
    MicroSlip,
    SmallMass,
    SofteningLoop,
    Viscoelastic,
)
from romsindy.effects.mounting import AlongBeam, AtPoint, Load, Mounting, PointMass, TowardsAnchor
from romsindy.effects.outside import (
    BaseExcitation,
    Bias,
    Drift,
    Gain,
    Hum,
    Saturation,
    SecondMode,
    SensorNonlinearity,
    SuddenChange,
)
from romsindy.effects.stiffness import (
    Bilinear,
    CubicStiffness,
    LinearFrequency,
    Magnet,
    MoreMass,
    NonlinearInertia,
    QuadraticStiffness,
    QuinticStiffness,
    SteadyForce,
    Stop,
    TwoSidedGap,
)

# What a diagnosis looks for in the coordinate of one mode.
CATALOGUE: tuple[Effect, ...] = (
    Viscous(),
    AirDrag(),
    DryFriction(),
    GrowingDamping(),
    SpeedCubedDamping(),
    Hysteretic(),
    Rubbing(1),
    Rubbing(-1),
    MicroSlip(),
    SofteningLoop(),
    Viscoelastic(),
    LinearFrequency(),
    MoreMass(),
    SmallMass(),
    CubicStiffness(),
    QuinticStiffness(),
    QuadraticStiffness(),
    SteadyForce(),
    NonlinearInertia(),
    Bilinear(),
    Stop(1),
    Stop(-1),
    TwoSidedGap(),
    Backlash(),
    Magnet(1),
    Magnet(-1),
    Drift(),
    SuddenChange(),
    BaseExcitation(),
    Hum(),
    SecondMode(),
    Bias(),
    Gain(),
    SensorNonlinearity(2),
    SensorNonlinearity(3),
    Saturation(),
)

# What it looks for on a beam, each mounted; two dipoles attract with the fourth power.
BEAM_CATALOGUE: tuple[TermEffect, ...] = (
    Damper(),
    AirDrag(),
    DryFriction(),
    SpringFriction(),
    CubicStiffness(),
    Stop(1),
    Stop(-1),
    TwoSidedGap(),
    Magnet(1, exponent=4.0),
    Magnet(-1, exponent=4.0),
)


def look_alikes(name: str, catalogue: Iterable[Effect]) -> set[str]:
    """Names of the effects that one resembles, by its own word or by theirs."""
    found: set[str] = set()
    for effect in catalogue:
        if effect.name == name:
            found.update(effect.resembles)
        elif name in effect.resembles:
            found.add(effect.name)
    return found
