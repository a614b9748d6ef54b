"""A measured input as a part of the equation, and what may be wrong in its chain."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from romsindy.effects.base import Effect, Parameter, Scales, State
from romsindy.physics.coupling import Along
from romsindy.physics.input import Input
from romsindy.typing import Array


@dataclass(frozen=True)
class Drive(Effect):
    """An input of every record, late by ``delay`` (s), of at most ``most`` to either side."""

    of: Input = field(default_factory=Input)
    delay: float = 0.0
    most: float = 0.0

    name, family = "input", "outside"
    label = "a measured input"
    directions = ((1.0,),)  # weights of all coordinates

    @property
    def variant(self) -> str:
        """Name of the coefficient."""
        return self.of.key

    def parameters(self, scales: Scales | None = None) -> tuple[Parameter, ...]:
        """The delay, where it is free."""
        if not self.most:
            return ()
        return (Parameter("delay", (self.delay,), -self.most, self.most, unit="s"),)

    def term(self) -> Input:
        """The law, with the delay."""
        return replace(self.of, delay=self.delay)

    def forces(self, state: State) -> Array | None:
        """The input on the left side; None where nothing is measured of it, as in a decay."""
        samples = (state.inputs or {}).get(self.of.source)
        if samples is None:
            return None
        return -self.of.sign * samples.at(state.t, self.term())[None]

    def slopes(self, state: State, strengths: Array) -> tuple[Any, Any, Any]:
        """It does not depend on the motion."""
        return 0.0, 0.0, 0.0


@dataclass(frozen=True)
class DriveAlong(Drive):
    """An input that acts along directions of several coordinates: a strength for each, one delay.

    ``directions`` have the weights of all coordinates, (k, R).
    """

    directions: tuple[tuple[float, ...], ...] = Drive.directions  # type: ignore[assignment]

    @property
    def n_strengths(self) -> int:  # type: ignore[override]
        """One for each direction."""
        return len(self.directions)

    def laws(self) -> tuple[Along, ...]:
        """The input along each direction."""
        return tuple(Along(self.term(), weights) for weights in self.directions)

    def forces(self, state: State) -> Array | None:
        """As those of a `Drive`, in every equation: (k, n, R)."""
        alone = super().forces(state)
        if alone is None:
            return None
        return np.multiply.outer(np.array(self.directions), alone[0]).swapaxes(1, 2)


@dataclass(frozen=True)
class InputGain(Drive):
    """A known input that is stronger, or weaker; the strength is the change of its gain."""

    name = "input_gain"
    label = "another gain of the input than assumed"
    resembles = ("added_mass", "gain", "input_distortion")
    advice = "a force sensor where the force acts, calibrated"


@dataclass(frozen=True)
class InputDelay(Drive):
    """In the place of a known input, one that acts later or sooner; the strength is its gain."""

    name = "input_delay"
    label = "another delay of the input than assumed"
    resembles = ("input_lag", "input_between_samples")
    advice = "response and input through the same filters and converter"


@dataclass(frozen=True)
class InputLag(Drive):
    """In the place of a known input, what is left of it after a first-order lag.

    The current in a coil follows the voltage so, and an amplifier with a low corner its input. The
    strength is the gain, ``lag`` (s) the time constant.
    """

    lag: float = 0.0

    name = "input_lag"
    label = "a lag between the input and the force (coil, amplifier)"
    resembles = ("input_delay", "input_between_samples")
    advice = "a force sensor where the force acts, or an input with higher frequencies"

    def parameters(self, scales: Scales | None = None) -> tuple[Parameter, ...]:
        """The time constant."""
        return (Parameter("lag", (self.lag,), 0.0, self.most, unit="s"),)

    def term(self) -> Input:
        """The law, with the lag."""
        return replace(super().term(), lag=self.lag)


@dataclass(frozen=True)
class InputDistortion(Drive):
    """Beside a known input, a power of it: the strength is what multiplies u^2, or u^3."""

    name = "input_distortion"
    label = "a force that is not proportional to the input (amplifier, magnet)"
    resembles = ("input_gain",)
    advice = "a force sensor where the force acts, or other levels of the input"


@dataclass(frozen=True)
class InputBetweenSamples(Drive):
    """In the place of a known input, the same with something else between its samples."""

    name, n_strengths = "input_between_samples", 0
    label = "an input that is not what was assumed between its samples"
    resembles = ("input_delay", "input_lag")
    advice = "a record sampled faster"

    @property
    def variant(self) -> str:
        """What it does."""
        return self.of.interpolation

    def term(self) -> None:  # type: ignore[override]
        """None: no law is added, the input of the model becomes another."""

    def forces(self, state: State) -> Array:
        """It adds nothing."""
        return np.zeros((0, len(state.t)))
