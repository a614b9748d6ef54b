"""Forces with a memory: what they are depends on the motion so far.

Each law has an inner state z, one number or several, that it carries along a sampled motion:

* a joint that slips, Bouc and Wen's model and play know no time: z depends on the way alone that q
  went from one turning point to the next [1];
* a Maxwell element and a tuned mass are linear: z fades with a pole of its own.

Neither needs steps of its own: along every stroke, and between two samples, z is known in closed
form.

[1] A. Visintin, "Differential Models of Hysteresis", 1994, chapters II and III.
"""

from __future__ import annotations

from abc import abstractmethod
from bisect import bisect_right
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.linalg.lapack import ztbtrs

from romsindy.physics.term import Scalars, Term, WeakForm
from romsindy.typing import Array

_SLIDERS = 16  # of a joint; their slips are told apart to 1/16 of the number of them
_TABLE = 2000  # points of the loop of Bouc and Wen, each half; between them it is linear
# A motion that begins at less than this part of its largest speed begins at rest; at twice as much
# it has vibrated for long.
_RELEASED = 0.1
_TURNING = 0.5  # one that begins within 30 degrees of where it turns was let go there


class Memory(NamedTuple):
    """Where a motion has come to, and the inner state (m,) there."""

    t: float
    q: float
    q_dot: float
    inner: Array


class MemoryLaw(Term):
    """A force with an inner state z.

    A subclass is a frozen dataclass. All take arrays over the samples (n,), times in s. Of a model
    it is a term that adds nothing where the state alone decides: its force is counted apart.
    """

    name: ClassVar[str]  # of its coefficient, whatever its shape
    dimension = (1.0, 0.0)

    @property
    def key(self) -> str:
        return self.name

    @classmethod
    def from_key(cls, key: str) -> None:
        """None: a name says nothing of the shape."""

    @abstractmethod
    def rule(self) -> str:
        """Text of the force without its coefficient, and how z moves."""

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        """The name, with the shape values."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]
        shape = [f"{n} = {v:.4g}" for n, v in values.items() if n != "relaxed"]
        words = [self.name, *shape, *(["relaxed"] if values.get("relaxed") else [])]
        if "\\" in q_dot:
            words = [rf"\text{{{w}}}".replace("_", r"\_") for w in words]
        return f"{words[0]}({q}; {', '.join(words[1:])})"

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        """Refused with a ValueError: the force is no function of the state."""
        raise ValueError(
            f"{self.key} remembers the motion, and is no column of a regression: give it to"
            " refine() or identify() among the terms"
        )

    @abstractmethod
    def rates(self, q: float, q_dot: float, inner: Array) -> Array:
        """Rates of the inner state (m,) at one moment."""

    @abstractmethod
    def begun(self, q: float, q_dot: float, rate: float) -> Array:
        """Inner state (m,) of a motion that begins there.

        At rest: pulled there slowly, and let go. Moving: as after a long vibration at ``rate``,
        rad/s.
        """

    @abstractmethod
    def carried(self, t: Array, q: Array, q_dot: Array, inner: Array) -> Array:
        """Inner states (m, n), from that of the first sample."""

    @abstractmethod
    def force(self, q: Array, q_dot: Array, inner: Array) -> Array:
        """Force for a unit of the coefficient, (n,)."""

    def along(
        self,
        t: Array,
        q: Array,
        q_dot: Array,
        rate: float,
        memory: Memory | None = None,
        start: Array | None = None,
    ) -> tuple[Array, Memory]:
        """Force along a motion (n,), and what is remembered at its end.

        The motion goes on from the ``memory`` of what was before; one that begins is a vibration of
        angular frequency ``rate``, rad/s, unless its inner state at the ``start`` (m,) is given.
        """
        if memory is None:
            start = self.begun(float(q[0]), float(q_dot[0]), rate) if start is None else start
            inner = self.carried(t, q, q_dot, start)
        else:
            x = np.column_stack([memory[:3], np.stack([t, q, q_dot])])
            inner = self.carried(x[0], x[1], x[2], memory.inner)[:, 1:]
        end = Memory(float(t[-1]), float(q[-1]), float(q_dot[-1]), inner[:, -1])
        return self.force(q, q_dot, inner), end


# -- the way that q went ------------------------------------------------------------------------


def _between(x: float, xs: list[float], ys: list[float]) -> float:
    """`numpy.interp` of one number."""
    if x >= xs[-1]:
        return ys[-1]
    i = bisect_right(xs, x) - 1
    if i < 0:
        return ys[0]
    return ys[i] + (ys[i + 1] - ys[i]) / (xs[i + 1] - xs[i]) * (x - xs[i])


@dataclass(frozen=True)
class SlidingLaw(MemoryLaw):
    """A law that knows no time: z follows q, alike upwards and downwards.

    A motion that begins at rest was pulled there from the middle, or was held, or slipped, until
    the joint was ``relaxed``: with no force left in it.
    """

    relaxed: bool = field(default=False, kw_only=True)

    @abstractmethod
    def moved(self, z: Array, way: Array | float) -> Array:
        """z after q has gone one way, up or down, by ``way``; both (m, n)."""

    @abstractmethod
    def _still(self) -> Array:
        """z of the law at rest in its middle, (m,)."""

    def _turned(self, z: Array, ways: list[float]) -> Array:
        """z (m, n + 1) before, between and after ways that q goes to and fro."""
        turns = [z[:, None]]
        for way in ways:
            turns.append(self.moved(turns[-1], way))
        return np.concatenate(turns, axis=1)

    def begun(self, q: float, q_dot: float, rate: float) -> Array:
        # To where it turned, and on from there; of a release noise says neither up nor down.
        peak, back = np.hypot(q, q_dot / rate), -q_dot / rate
        turn = float(np.copysign(peak, q if abs(back) < _TURNING * peak else back))
        middle = self._still()[:, None]
        there = middle if self.relaxed else self.moved(middle, turn)
        return self.moved(there, q - turn)[:, 0]

    def carried(self, t: Array, q: Array, q_dot: Array, inner: Array) -> Array:
        turn = np.flatnonzero(q_dot[:-1] * q_dot[1:] < 0)
        # Where q turns between two samples, by the parabola there.
        share = q_dot[turn] / (q_dot[turn] - q_dot[turn + 1])
        top = q[turn] + q_dot[turn] * share * (t[turn + 1] - t[turn]) / 2
        start = np.concatenate([q[:1], top])
        z = self._turned(inner, np.diff(start).tolist())
        stroke = np.searchsorted(turn, np.arange(len(q)))  # the turn comes after its sample
        return self.moved(z[:, stroke], q - start[stroke])


class SliderLaw(SlidingLaw):
    """Springs that q stretches, z, each in series with a slider."""

    @property
    @abstractmethod
    def slips(self) -> Array:
        """Most that each is stretched, (m, 1)."""

    def _still(self) -> Array:
        return np.zeros(len(self.slips))

    def moved(self, z: Array, way: Array | float) -> Array:
        return np.minimum(np.maximum(z + way, -self.slips), self.slips)

    def rates(self, q: float, q_dot: float, inner: Array) -> Array:
        dragged = np.abs(inner) * np.sign(inner * q_dot) >= self.slips[:, 0]
        return np.where(dragged, 0.0, q_dot)


@dataclass(frozen=True)
class SlippingJoint(SliderLaw):
    """Springs in parallel, each in series with a slider (Iwan [2]); one is a Jenkins element.

    Springs of equal stiffness, of 1 together, slip at distances up to ``slip``: (i / n)^scatter of
    it. With scatter 0 all slip at once; with 1 / (1 + chi) their density is a power chi of the
    distance, and the energy lost in a cycle grows with the power 3 + chi of the amplitude [3].

    [2] W. Iwan, J. Appl. Mech. 33 (1966) 893.  [3] D. Segalman, J. Appl. Mech. 72 (2005) 752.
    """

    slip: float = 1.0
    scatter: float = 0.0

    name = "slipping_joint"

    def rule(self) -> str:
        return "mean of z_i; z_i' = q_dot, |z_i| <= slip_i"

    @cached_property
    def slips(self) -> Array:
        middle = (np.arange(_SLIDERS) + 0.5) / _SLIDERS
        return (
            self.slip * middle[:, None] ** self.scatter if self.scatter else np.array([[self.slip]])
        )

    def force(self, q: Array, q_dot: Array, inner: Array) -> Array:
        return np.mean(inner, axis=0)


@dataclass(frozen=True)
class BoucWen(SlidingLaw):
    """z' = q_dot (1 - |z/slip|^n ((1 - loss) + loss sign(q_dot z))): a smooth loop [4].

    n, the ``sharpness``, says how suddenly the spring gives way.

    [4] Y. Wen, J. Eng. Mech. Div. ASCE 102 (1976) 249.
    """

    slip: float = 1.0
    sharpness: float = 1.0
    loss: float = 0.5

    name = "bouc_wen"

    def rule(self) -> str:
        return "z; z' = q_dot (1 - |z/slip|^n (1 - loss + loss sign(q_dot z)))"

    def _still(self) -> Array:
        return np.zeros(1)

    @cached_property
    def _table(self) -> tuple[Array, Array]:
        """Values of z/slip, and the way over slip on which a rising q brings it there from 0."""
        # Towards 1 the way grows without end: equal steps of artanh.
        below, above = np.linspace(-1.0, 0.0, _TABLE), np.tanh(np.linspace(0.0, 15.0, _TABLE))
        x = np.concatenate([below[:-1], above])
        middle = (x[1:] + x[:-1]) / 2
        rate = 1 - np.abs(middle) ** self.sharpness * np.where(middle > 0, 1.0, 1 - 2 * self.loss)
        way = np.concatenate([[0.0], np.cumsum(np.diff(x) / rate)])
        return x, way - way[_TABLE - 1]

    def moved(self, z: Array, way: Array | float) -> Array:
        at, ways = self._table
        up = np.where(np.less(way, 0), -self.slip, self.slip)
        return up * np.interp(np.interp(z / up, at, ways) + way / up, ways, at)

    def _turned(self, z: Array, ways: list[float]) -> Array:
        # One number after another: many times as fast without arrays.
        xs, ys = (x.tolist() for x in self._table)
        now = [float(z[0])]
        for way in ways:
            up = -self.slip if way < 0 else self.slip
            now.append(up * _between(_between(now[-1] / up, xs, ys) + way / up, ys, xs))
        return np.array([now])

    def rates(self, q: float, q_dot: float, inner: Array) -> Array:
        turned = (1 - self.loss) + self.loss * np.sign(q_dot * inner)
        return q_dot * (1 - np.abs(inner / self.slip) ** self.sharpness * turned)

    def force(self, q: Array, q_dot: Array, inner: Array) -> Array:
        return inner[0]


@dataclass(frozen=True)
class Play(SliderLaw):
    """A joint with play: friction in series with a spring that is met beyond ``half`` the play.

    z is the way since the last slip; a Jenkins element where there is no play.
    """

    half: float = 1.0
    slip: float = 1.0

    name = "play"

    def rule(self) -> str:
        return "sign(z) max(|z| - half, 0); z' = q_dot, |z| <= half + slip"

    @cached_property
    def slips(self) -> Array:
        return np.array([[self.half + self.slip]])

    def force(self, q: Array, q_dot: Array, inner: Array) -> Array:
        return inner[0] - np.clip(inner[0], -self.half, self.half)


# -- what fades ---------------------------------------------------------------------------------


class FadingLaw(MemoryLaw):
    """A linear law: z' = pole z + input, complex where it vibrates; ``inner`` holds both parts."""

    @property
    @abstractmethod
    def pole(self) -> complex:
        """1/s; its real part is negative."""

    @property
    @abstractmethod
    def gains(self) -> tuple[float, float]:
        """What q and q_dot count in the input."""

    @abstractmethod
    def rested(self, q: float) -> complex:
        """z where q has been at rest for long."""

    @abstractmethod
    def transfer(self, s: complex) -> complex:
        """Force over q of motions that go as exp(s t), s in 1/s."""

    def begun(self, q: float, q_dot: float, rate: float) -> Array:
        a = q - 1j * q_dot / rate
        by_q, by_q_dot = self.gains
        f = (by_q + 1j * rate * by_q_dot) * a
        z = (f / (1j * rate - self.pole) + np.conj(f) / (-1j * rate - self.pole)) / 2
        # From one to the other without a jump: a fit moves the start to and fro.
        moving = min(max(abs(a.imag) / (_RELEASED * max(abs(a), 1e-300)) - 1, 0.0), 1.0)
        z = moving * z + (1 - moving) * self.rested(q)
        return np.array([z.real, z.imag])

    def rates(self, q: float, q_dot: float, inner: Array) -> Array:
        by_q, by_q_dot = self.gains
        z = self.pole * complex(*inner) + by_q * q + by_q_dot * q_dot
        return np.array([z.real, z.imag])

    def carried(self, t: Array, q: Array, q_dot: Array, inner: Array) -> Array:
        z = self._carried(t, q[:, None], q_dot[:, None], np.array([complex(*inner)]))[:, 0]
        return np.stack([z.real, z.imag])

    def _carried(self, t: Array, q: Array, q_dot: Array, first: Array) -> Array:
        """z along some motions (n, m), from the ``first`` ones (m,)."""
        by_q, by_q_dot = self.gains
        d = np.diff(t)[:, None]
        # In the middle between two samples, by the cubic through q and q_dot there.
        q_mid = (q[1:] + q[:-1]) / 2 - d * np.diff(q_dot, axis=0) / 8
        v_mid = 1.5 * np.diff(q, axis=0) / d - (q_dot[1:] + q_dot[:-1]) / 4
        f, f_mid = by_q * q + by_q_dot * q_dot, by_q * q_mid + by_q_dot * v_mid
        fade, half = np.exp(self.pole * d), np.exp(self.pole * d / 2)
        # Simpson's rule; z[i + 1] = fade[i] z[i] + gain[i]
        gain = d / 6 * (fade * f[:-1] + 4 * half * f_mid + f[1:])
        band = np.stack([np.ones(len(q), complex), np.append(-fade[:, 0], 0.0)])
        z, _ = ztbtrs(band, np.concatenate([first[None], gain]), uplo="L", diag="U")  # it solves
        return np.asarray(z)

    def changes(self, t: Array, q: Array, q_dot: Array, first: Array) -> Array:
        """What small changes (n, m) of a motion do to its force, (n, m).

        Those of z at the start are the ``first`` (m,).
        """
        z = self._carried(t, q, q_dot, first)
        return self.force(q, q_dot, np.stack([z.real, z.imag]))

    def over(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """What both parts of z at the first of n times, and q and q_dot at all of them, do.

        To the force at these times, (n, 2) and (n, n, 2), and to z at the last, (2, 2) and
        (2, n, 2).
        """
        n = len(t)
        units = np.eye(2 * n).reshape(n, 2, 2 * n)
        q, q_dot = np.concatenate([np.zeros((2, n, 2)), units.swapaxes(0, 1)], axis=2)
        first = np.append([1.0, 1j], np.zeros(2 * n))
        force, end = self.changes(t, q, q_dot, first), self._carried(t, q, q_dot, first)[-1]
        z = np.stack([end.real, end.imag])
        return force[:, :2], force[:, 2:].reshape(n, n, 2), z[:, :2], z[:, 2:].reshape(2, n, 2)


@dataclass(frozen=True)
class MaxwellElement(FadingLaw):
    """A spring and a damper in series: z' = q_dot - z / relaxation (s)."""

    relaxation: float = 1.0

    name = "maxwell"
    gains = (0.0, 1.0)

    def rule(self) -> str:
        return "z; z' = q_dot - z/relaxation"

    @property
    def pole(self) -> complex:
        return complex(-1 / self.relaxation)

    def rested(self, q: float) -> complex:
        return 0j

    def transfer(self, s: complex) -> complex:
        return s / (s - self.pole)

    def force(self, q: Array, q_dot: Array, inner: Array) -> Array:
        return inner[0]


@dataclass(frozen=True)
class TunedMass(FadingLaw):
    """A small mass on a spring and a damper of its own; its coefficient is the ratio of masses.

    It vibrates at z: z'' + 2 zeta w (z' - q_dot) + w^2 (z - q) = 0, and pushes back with z''.
    """

    frequency: float = 1.0  # w, rad/s
    damping_ratio: float = 0.02  # zeta

    name = "tuned_mass"
    dimension = (1.0, -2.0)

    def rule(self) -> str:
        return "z''; z'' + 2 zeta w (z' - q_dot) + w^2 (z - q) = 0"

    @property
    def pole(self) -> complex:
        w, zeta = self.frequency, self.damping_ratio
        return w * complex(-zeta, np.sqrt(1 - zeta**2))

    @property
    def gains(self) -> tuple[float, float]:
        return self.frequency**2, 2 * self.damping_ratio * self.frequency

    def rested(self, q: float) -> complex:
        # The mass is at q too; the imaginary part of the state is its place times that of the pole.
        return q * complex(self.damping_ratio * self.frequency, self.pole.imag)

    def transfer(self, s: complex) -> complex:
        spring, damper = self.gains
        carried = spring + damper * s
        return s * s * carried / (s * s + carried)

    def force(self, q: Array, q_dot: Array, inner: Array) -> Array:
        damped = self.pole.imag
        place = inner[1] / damped
        speed = (self.pole.real * inner[1] + damped * inner[0]) / damped
        by_q, by_q_dot = self.gains
        return by_q * (q - place) + by_q_dot * (q_dot - speed)
