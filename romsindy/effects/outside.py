"""Effects that change with time, come from outside, or sit in the sensor.

From outside come measured inputs, too, as a part of the equation, and what is wrong in their chain.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from romsindy.effects.base import Effect, Parameter, ReadingEffect, Scales, State, TimedEffect
from romsindy.physics.coupling import Along
from romsindy.physics.input import Input
from romsindy.typing import Array

# Steady lines that are slower are a drifting offset (`romsindy.record.noise`): noise.
_SLOWEST = 0.2
HIGHEST = 6  # harmonic of hum that is looked for
_SAME = 0.1  # of a frequency: modes of a simulation are not known better at large amplitude


@dataclass(frozen=True)
class OnClock(TimedEffect):
    """A change of stiffness since each release or, with ``origin`` (s), on one clock for all."""

    origin: float | None = None

    def times(self, state: State) -> Array:
        """From the origin on, or from the start of each record."""
        return state.t if self.origin is None else state.clock + state.t - self.origin

    def pull(self, t: Array, q: Array) -> Array:
        return self.pull_dq(t, q) * q


@dataclass(frozen=True)
class Drift(OnClock):
    """Stiffness that grows with a power of time."""

    exponent: float = 1.0

    name, family = "drift", "time"
    resembles = ("sudden_change",)
    formula = "t^exponent q"
    label = "a stiffness that drifts in time"
    advice = "the same decay repeated: a drift goes on, an amplitude effect comes back"

    @property
    def variant(self) -> str:
        """Whether it goes on from record to record."""
        return "" if self.origin is None else "over all records"

    def forms(self, scales: Scales) -> tuple[Effect, ...]:
        """After each release afresh or, where records follow one another, over all of them."""
        over_all = (replace(self, origin=min(scales.spans)[0]),) if scales.spans else ()
        return (self, *over_all)

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        return (Parameter.near("exponent", 1.0, 0.07),)

    def pull_dq(self, t: Array, q: Array) -> Array:
        return np.maximum(t, 0.0)[None] ** self.exponent


@dataclass(frozen=True)
class SuddenChange(OnClock):
    """Stiffness that jumps at one instant, within ``length`` (s); 0 where it is known."""

    time: float = 1.0
    length: float | None = None  # by default, that of the longest record
    rise: float = 0.002  # s: smooth over a short while, so that the instant can be fitted

    name, family = "sudden_change", "time"
    formula = "(1 + tanh((t - time)/rise)) q/2"
    label = "a sudden change of stiffness"
    advice = "the same decay repeated after an inspection"

    @property
    def variant(self) -> str:
        """When it happens, where it does so once for all records."""
        if self.origin is None:
            return ""
        if self.length == 0:
            return f"once, between two records at {self.origin:.6g} s"
        return f"once, in the record from {self.origin:.6g} s on"

    def forms(self, scales: Scales) -> tuple[Effect, ...]:
        """After each release, once within a record, and once between two."""
        any_time = replace(self, rise=1e-3 * scales.duration)
        spans = sorted(scales.spans)
        within = (replace(any_time, origin=a, length=b - a) for a, b in spans)
        # Any instant between two records is the same.
        middles = ((a[1] + b[0]) / 2 for a, b in itertools.pairwise(spans))
        between = (replace(any_time, origin=m, time=0.0, length=0.0) for m in middles)
        return (any_time, *within, *between)

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        end = scales.duration if self.length is None else self.length
        if end == 0:
            return ()
        starts = tuple(end * np.linspace(0.05, 0.9, 18))
        return (Parameter("time", starts, 0.02 * end, 0.97 * end, unit="s"),)

    def pull_dq(self, t: Array, q: Array) -> Array:
        return 0.5 + 0.5 * np.tanh((t - self.time) / self.rise)[None]


def _tone(scales: Scales, beside: tuple[float, ...]) -> Parameter:
    omega = scales.omega
    starts = tuple(tone for tone in scales.tones if not same_tone(tone, beside))
    return Parameter(
        "frequency", starts, _SLOWEST * omega, 60 * omega, reach=0.04 * omega, unit="rad/s"
    )


def same_tone(tone: float, others: tuple[float, ...]) -> bool:
    """Whether a frequency may be one of others, which a simulation has."""
    return any(abs(tone / other - 1) < _SAME for other in others)


@dataclass(frozen=True)
class BaseExcitation(TimedEffect):
    """Steady shaking of the support at one frequency, not one of those ``beside``, rad/s."""

    frequency: float = 1.0
    beside: tuple[float, ...] = field(default=(), repr=False, compare=False)

    name, family, per_record, n_strengths = "base_excitation", "outside", True, 2
    resembles = ("mains_hum", "second_mode")
    formula = "cos(w t), sin(w t)"
    label = "base excitation at one frequency"
    advice = "a sensor on the support, or a record of the structure at rest"

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        return (_tone(scales, self.beside),)

    def pull(self, t: Array, q: Array) -> Array:
        return np.stack([np.cos(self.frequency * t), np.sin(self.frequency * t)])


@dataclass(frozen=True)
class Hum(ReadingEffect):
    """Steady lines in the sensor: a frequency, and its harmonics where there are any.

    Frequencies ``beside``, rad/s, are those of something else.
    """

    frequency: float = 1.0
    harmonics: int = 1
    beside: tuple[float, ...] = field(default=(), repr=False, compare=False)

    name, family, per_record = "mains_hum", "outside", True
    resembles = ("second_mode",)
    formula = "cos(k w t), sin(k w t), k = 1, 2, ..."
    label = "mains hum in the sensor"
    advice = "a record with the structure at rest"

    @property
    def n_strengths(self) -> int:  # type: ignore[override]
        """Two for every harmonic."""
        return 2 * self.harmonics

    @property
    def variant(self) -> str:
        """How many lines it has."""
        return "" if self.harmonics == 1 else f"{self.harmonics} harmonics"

    def forms(self, scales: Scales) -> tuple[Effect, ...]:
        """One line, and the combs that there are."""
        combs = ((f, n) for f, n in scales.combs if not same_tone(f, self.beside))
        one = replace(self, harmonics=1)
        return (one, *(replace(one, frequency=f, harmonics=n) for f, n in combs))

    def elsewhere(self, t: Array) -> Effect:
        """Its wires may pick up other harmonics."""
        below = int(np.pi / (t[1] - t[0]) / self.frequency)
        return replace(self, harmonics=max(self.harmonics, min(below, HIGHEST)))

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        tone = _tone(scales, self.beside)
        return (tone if self.harmonics == 1 else replace(tone, starts=(self.frequency,)),)

    def readings(self, t: Array, q: Array) -> Array:
        angle = self.frequency * np.arange(1, self.harmonics + 1)[:, None] * t
        return np.concatenate([np.cos(angle), np.sin(angle)])


@dataclass(frozen=True)
class SecondMode(ReadingEffect):
    """A second mode that rings down beside the first, and those ``beside``, rad/s."""

    frequency: float = 1.0
    damping_ratio: float = 0.005
    beside: tuple[float, ...] = field(default=(), repr=False, compare=False)

    name, family, per_record, n_strengths = "second_mode", "outside", True, 2
    formula = "exp(-zeta w t) cos(w t), exp(-zeta w t) sin(w t)"
    label = "a second mode that vibrates along"
    advice = "a sensor at the node of the first mode"

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        damping = Parameter("damping_ratio", (0.002, 0.005, 0.012), 0.0003, 0.05)
        return (_tone(scales, self.beside), damping)

    def readings(self, t: Array, q: Array) -> Array:
        envelope = np.exp(-self.damping_ratio * self.frequency * t)
        return envelope * np.stack([np.cos(self.frequency * t), np.sin(self.frequency * t)])


TONES = (BaseExcitation, Hum, SecondMode)


@dataclass(frozen=True)
class Bias(ReadingEffect):
    """A zero that is not zero."""

    name = "bias"
    resembles = ("sensor_nonlinearity",)
    formula = "1"
    label = "an offset of the sensor"
    advice = "a record of the structure at rest"

    def readings(self, t: Array, q: Array) -> Array:
        return np.ones((1, len(t)))


@dataclass(frozen=True)
class Gain(ReadingEffect):
    """A wrong calibration."""

    name = "gain"
    tolerance = 0.1  # a calibration is seldom further off
    resembles = ("added_mass", "magnet")
    formula = "q"
    label = "a wrong gain of the sensor"
    advice = "a calibration of the sensor, or a second sensor beside it"

    def readings(self, t: Array, q: Array) -> Array:
        return q[None]

    def reading_slopes(self, t: Array, q: Array) -> Array:
        return np.ones((1, len(q)))


@dataclass(frozen=True)
class SensorNonlinearity(ReadingEffect):
    """A curved characteristic of the sensor."""

    power: int = 2

    name = "sensor_nonlinearity"
    formula = "q^power"
    label = "a sensor that is not linear"
    advice = "a calibration of the sensor over its range"

    @property
    def variant(self) -> str:
        return f"q^{self.power}"

    def readings(self, t: Array, q: Array) -> Array:
        return q[None] ** self.power

    def reading_slopes(self, t: Array, q: Array) -> Array:
        return self.power * q[None] ** (self.power - 1)


@dataclass(frozen=True)
class Saturation(ReadingEffect):
    """A sensor that shows no more than its limit; strength 1 clips hard."""

    limit: float = 1.0

    name, sign, start = "saturation", 1, 1.0
    formula = "-sign(q) max(|q| - limit, 0)"
    label = "a sensor that saturates"
    advice = "a sensor of larger range, or a decay from a smaller amplitude"

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        a = scales.amplitude
        starts = tuple(a * np.array([1.0, 0.985, 0.965, 0.94]))
        return (Parameter("limit", starts, 0.5 * a, 1.05 * a, unit="q"),)

    def readings(self, t: Array, q: Array) -> Array:
        return -(np.sign(q) * np.maximum(np.abs(q) - self.limit, 0.0))[None]

    def reading_slopes(self, t: Array, q: Array) -> Array:
        return -1.0 * (np.abs(q) > self.limit)[None]


# -- measured inputs, and their chain --------------------------------------------------------------


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
        return None if samples is None else -self.of.sign * samples.at(state.t, self.term())[None]

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
class Impulses(Effect):
    """What the hits of an input were stronger than their samples say: each by a part of itself.

    ``gains`` are those of the input in the equations of all coordinates, (R,); of a record that has
    fewer than ``n_strengths`` hits the others do nothing.
    """

    of: Input
    gains: tuple[float, ...]
    n_strengths: int = 1  # type: ignore[misc]

    name, family, per_record = "impulses", "outside", True
    label = "hits that are stronger than their samples say"

    def forces(self, state: State) -> Array | None:
        """In every equation, (n_strengths, n, R); None where nothing is measured of the input."""
        samples = (state.inputs or {}).get(self.of.source)
        if samples is None:
            return None
        own = samples.of_hits(state.t, self.of)
        each = np.concatenate([own, np.zeros((self.n_strengths - len(own), len(state.t)))])
        return -self.of.sign * each[..., None] * np.array(self.gains)


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
