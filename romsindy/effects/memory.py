"""Effects that remember: slipping joints, play, viscoelastic parts, a mass that vibrates along."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

import numpy as np

from romsindy.effects.base import Effect, Parameter, Scales, State
from romsindy.physics.memory import (
    BoucWen,
    FadingLaw,
    MaxwellElement,
    Memory,
    MemoryLaw,
    Play,
    SlippingJoint,
    TunedMass,
)
from romsindy.typing import Array

_SMALL = 1e-6  # change of the size of a motion, to find how the force follows
_FLAT = 0.1  # least part of q_dot^2 + |q q_ddot| that the slopes are divided by


def _mean_of_cycle(t: Array, x: Array, period: float) -> Array:
    """Mean of x over the period about every t; 0 where there is no whole one."""
    if t[-1] - t[0] < period:
        return np.zeros(len(t))
    total = np.concatenate([[0.0], np.cumsum((x[1:] + x[:-1]) / 2 * np.diff(t))])
    first = np.clip(t - period / 2, t[0], t[-1] - period)
    return (np.interp(first + period, t, total) - np.interp(first, t, total)) / period


class MemoryEffect(Effect):
    """A force that depends on the motion so far; its ``law`` says how."""

    law: ClassVar[MemoryLaw]  # the fields of the effect are put in for its own
    sign = 1

    @property
    def remembering(self) -> MemoryLaw:
        """The law, with the fields of the effect."""
        shared = {f.name for f in fields(self.law)} & vars(self).keys()  # type: ignore[arg-type]
        law: MemoryLaw = replace(self.law, **{n: getattr(self, n) for n in shared})  # type: ignore[type-var]
        return law

    @classmethod
    def of_law(cls, law: MemoryLaw) -> MemoryEffect:
        """The effect that has this law.

        Raises a ValueError if none of those that are defined has.
        """
        known = [kind for base in cls.__subclasses__() for kind in (base, *base.__subclasses__())]
        kind = next((k for k in known if isinstance(getattr(k, "law", None), type(law))), None)
        if kind is None:
            raise ValueError(
                f"{law.key} is the law of no effect, which says what a fit may change: derive one"
                " from romsindy.effects.memory.MemoryEffect"
            )
        return kind(**vars(law))

    def along(self, state: State, size: float = 1.0) -> tuple[Array, Memory]:
        """The law along a motion of this size, (n,), and what is remembered at its end."""
        motion = state.t, size * state.q, size * state.q_dot
        return self.remembering.along(*motion, state.rate, state.memory, self.started)

    @property
    def started(self) -> Array | None:
        """Inner state (m,) at the start of a motion; None for that of a vibration."""
        return None

    def forces(self, state: State) -> Array:
        """The law along the motion."""
        return self.along(state)[0][None]

    def remembered(self, state: State) -> Memory:
        """What is remembered at the end of a state."""
        return self.along(state)[1]

    def slopes(self, state: State, strengths: Array) -> tuple[Any, Any, Any]:
        """How the force follows slow changes of the amplitude and phase of a vibration.

        A motion a q(t + s) has the force F[a q](t + s): whatever the memory, dF/da belongs to a
        change q, dF/dt to a change q_dot. Changes that are small and slow are sums of both.
        """
        if len(state.t) < 2:
            return 0.0, 0.0, 0.0
        force, larger = self.along(state)[0], self.along(state, 1 + _SMALL)[0]
        by_size = (larger - force) / _SMALL
        # Where it stayed after the last slip is a matter of the amplitude then, not of that now.
        by_size -= _mean_of_cycle(state.t, by_size, 2 * np.pi / state.rate)
        by_time, q_ddot = np.gradient(np.stack([force, state.q_dot]), state.t, axis=1)
        q, q_dot = state.q, state.q_dot
        swing = q_dot**2 - q * q_ddot
        swing = np.maximum(swing, _FLAT * (q_dot**2 + np.abs(q * q_ddot)) + 1e-300)
        by_q = (by_time * q_dot - by_size * q_ddot) / swing
        by_q_dot = (by_size * q_dot - by_time * q) / swing
        return strengths[0] * by_q, strengths[0] * by_q_dot, 0.0

    def changes(self, state: State, q: Array, q_dot: Array) -> Array:
        """What small changes (n, m) of the motion do to the force, (n, m)."""
        force, found = self.along(state)[0], np.empty_like(q)
        for column, d, v in zip(found.T, q.T, q_dot.T, strict=True):
            small = _SMALL * np.abs(state.q).max() / max(float(np.abs(d).max()), 1e-300)
            near = state._replace(q=state.q + small * d, q_dot=state.q_dot + small * v)
            column[:] = (self.along(near)[0] - force) / small
        return found

    def strength_unit(self, unit: str | None) -> str:
        return self.law.unit(unit)


@dataclass(frozen=True)
class SlidingEffect(MemoryEffect):
    """A joint that slips, and that a release may find ``relaxed``: with no force left in it."""

    relaxed: bool = field(default=False, kw_only=True)

    @property
    def variant(self) -> str:
        """Whether it was held, or slipped, before the release until it was relaxed."""
        return "relaxed at the release" if self.relaxed else ""

    def forms(self, scales: Scales) -> tuple[Effect, ...]:
        """Pulled to the release from rest, or relaxed there."""
        return (self, replace(self, relaxed=True))


@dataclass(frozen=True)
class MicroSlip(SlidingEffect):
    """A joint that slips little by little (Iwan), or all at once (Jenkins, scatter 0)."""

    slip: float = 1.0
    scatter: float = 0.0

    name, family = "micro_slip", "damping"
    label = "micro-slip of a joint: friction in series with a spring (Iwan, Jenkins)"
    advice = "a decay from a larger amplitude, and one with the joint tightened"
    resembles = ("hysteretic", "dry_friction", "amplitude_damping")
    law = SlippingJoint()

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        a = scales.amplitude
        slip = Parameter("slip", (0.4 * a, 0.1 * a, 0.2 * a, 0.8 * a), 0.01 * a, 2 * a, unit="q")
        return (slip, Parameter("scatter", (0.0, 0.7, 2.0), 0.0, 4.0))


@dataclass(frozen=True)
class SofteningLoop(SlidingEffect):
    """A spring that softens in a smooth loop."""

    slip: float = 1.0
    sharpness: float = 1.0
    loss: float = 0.5

    name, family = "bouc_wen", "damping"
    label = "a hysteretic spring that softens smoothly (Bouc-Wen)"
    advice = "a decay from a larger amplitude, where the spring gives way"
    resembles = ("micro_slip", "hysteretic", "dry_friction", "amplitude_damping")
    law = BoucWen()

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        a = scales.amplitude
        slips = (0.3 * a, 0.1 * a, 0.7 * a)
        return (
            Parameter("slip", slips, 0.02 * a, 2 * a, unit="q"),
            Parameter("sharpness", (1.5,), 0.7, 4.0, 0.5),
            Parameter("loss", (0.7,), 0.3, 1.4, 0.2),
        )


@dataclass(frozen=True)
class Backlash(SlidingEffect):
    """A joint with play that slips."""

    half: float = 1.0
    slip: float = 1.0

    name, family = "play", "damping"
    label = "play in a joint (backlash): friction in series with a spring met only beyond it"
    advice = "a decay from just below the play, and a static pull to and fro"
    resembles = ("two_sided_gap", "micro_slip")
    law = Play()

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        a = scales.amplitude
        half = Parameter("half", (0.2 * a, 0.05 * a, 0.5 * a), 0.01 * a, 0.95 * a, unit="q")
        return (half, Parameter("slip", (0.15 * a, 0.5 * a), 0.01 * a, 2 * a, unit="q"))


class FadingEffect(MemoryEffect):
    """A force that is linear in the motion so far."""

    law: ClassVar[FadingLaw]

    def slopes(self, state: State, strengths: Array) -> tuple[Any, Any, Any]:
        """Of vibrations that grow by a factor of e over the record.

        A force that lasts longer than a beat is no matter of the amplitude then: over that of a
        beat that has nearly gone out, it is without bound.
        """
        if len(state.t) < 2:
            return 0.0, 0.0, 0.0
        law: Any = self.remembering
        s = complex(1 / (state.t[-1] - state.t[0]), state.rate)
        force = law.transfer(s)
        by_q_dot = force.imag / s.imag
        return strengths[0] * (force.real - by_q_dot * s.real), strengths[0] * by_q_dot, 0.0

    def changes(self, state: State, q: Array, q_dot: Array) -> Array:
        law: Any = self.remembering
        real, imaginary = self._begun(state) @ [q[0], q_dot[0]]
        return np.asarray(law.changes(state.t, q, q_dot, real + 1j * imaginary))

    def _begun(self, state: State) -> Array:
        """What small changes of q and q_dot at the start of a motion do to what it remembers."""
        law: Any = self.remembering
        if self.started is not None:
            return np.zeros((2, 2))
        at = np.array([state.q[0], state.q_dot[0]])
        small = np.maximum(_SMALL * np.abs([state.q, state.q_dot]).max(axis=1), 1e-300)
        off = [
            np.subtract(*(law.begun(*(at + way * x), state.rate) for way in (1, -1)))
            for x in np.diag(small)
        ]
        return np.stack(off, axis=1) / (2 * small)

    def carried(self, state: State, strengths: Array) -> tuple[Array, Array, Array, Array]:
        """What is remembered at the start of steps of three points, as `Carried` of the kernel.

        That is z as it comes to the first point of a step, before q and q_dot there count.
        """
        law: Any = self.remembering
        n = len(state.t) // 3
        by_z, by_motion, z_on, motion_on = law.over(np.append(state.t[:3], state.t[0] + state.step))
        by_z, entered = strengths[0] * by_z[:3], motion_on[:, 3]
        by_motion = np.tile(strengths[0] * by_motion[:3, :3], (n, 1, 1, 1))
        motion_on = np.tile(motion_on[:, :3], (n, 1, 1, 1))
        first = np.tile(entered, (n, 1, 1))
        if state.memory is None:
            first[0] = self._begun(state)
        by_motion[:, :, 0] += by_z @ first
        motion_on[:, :, 0] += z_on @ first
        slopes = np.array(self.slopes(state, strengths)[:2])
        by_motion[:, range(3), range(3)] -= slopes
        return by_z, by_motion, z_on, motion_on


@dataclass(frozen=True)
class Viscoelastic(FadingEffect):
    """A Maxwell element."""

    relaxation: float = 1.0

    name, family = "maxwell", "damping"
    label = "a viscoelastic part: a spring and a damper in series (Maxwell element)"
    advice = "decays at another frequency, with a mass added"
    resembles = ("viscous", "linear_frequency", "hysteretic")
    law = MaxwellElement()

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        # Relaxing faster it is a damper, slower a spring.
        cycle = 1 / scales.omega
        starts = (cycle, 0.5 * cycle, 2 * cycle)
        return (Parameter("relaxation", starts, 0.25 * cycle, 4 * cycle, unit="s"),)


@dataclass(frozen=True)
class SmallMass(FadingEffect):
    """A small mass on a spring, near the frequency of the vibration."""

    frequency: float = 1.0
    damping_ratio: float = 0.02
    late: bool = False  # a record that begins after the release finds it anywhere

    name, family, n_shared = "tuned_mass", "inertia", 1
    label = "a small mass on a spring that vibrates along (tuned mass)"
    advice = "a sensor on what may vibrate along: cables, covers, brackets"
    resembles = ("second_mode", "maxwell", "added_mass")
    law = TunedMass()

    @property
    def per_record(self) -> bool:  # type: ignore[override]
        """Where it is at the start of a record differs from record to record."""
        return self.late

    @property
    def n_strengths(self) -> int:  # type: ignore[override]
        """The ratio of masses and, of a late record, both parts of its own free vibration."""
        return 3 if self.late else 1

    def forms(self, scales: Scales) -> tuple[Effect, ...]:
        """As a release leaves it, and as a later start of the record may find it."""
        return (self, replace(self, late=True))

    @property
    def started(self) -> Array | None:
        """Nothing: its own free vibration makes up for any start, whatever the motion is there."""
        return np.zeros(2) if self.late else None

    def forces(self, state: State) -> Array:
        """The law along the motion, and what its free vibration adds."""
        pulled = super().forces(state)
        if not self.late:
            return pulled
        law = TunedMass(self.frequency, self.damping_ratio)
        free = law.pole.imag * np.exp(law.pole * state.t)
        still = np.zeros(len(state.t))
        own = [law.force(still, still, np.stack([z.real, z.imag])) for z in (free, 1j * free)]
        return np.stack([*pulled, *own])

    def parameters(self, scales: Scales) -> tuple[Parameter, ...]:
        omega = scales.omega
        starts = tuple(omega * np.array([1.0, 0.97, 1.03, 0.94, 1.06, 0.9, 1.1, 0.85, 1.15]))
        return (
            Parameter("frequency", starts, 0.6 * omega, 1.6 * omega, unit="rad/s"),
            Parameter("damping_ratio", (0.02,), 0.001, 0.2),
        )
