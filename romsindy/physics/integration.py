"""Time integration of q_ddot = acceleration(q, q_dot), with and without dry friction.

One coordinate goes through plain floats, several through arrays: the first are ten times faster.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import ODEintWarning, ode, odeint, solve_ivp

from romsindy.physics.memory import MemoryLaw
from romsindy.typing import Array

# Of q and q_dot, floats or (R,) arrays; under inputs of their force, too.
Acceleration = Callable[..., Any]
Force = Callable[[float], Any]  # of time
# Accelerations that a motion may take: so many for each of its times, and for so many more. A cycle
# takes some 300 to ten digits: motion that takes more is faster than its times show.
_MOST, _AHEAD = 200, 1000
_MOMENT = 1e-13  # of the whole time: a stroke that short is none


class EscapeError(ValueError):
    """The motion leaves every bound, or becomes too fast to be followed.

    Examples
    --------
    >>> from romsindy import ReducedModel
    >>> softening = ReducedModel.from_coefficients({"omega^2": 1.0, "gamma_3": -1.0})
    >>> softening.simulate(1.1, 0.0, np.arange(0.0, 9.0, 0.1))  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    romsindy.physics.integration.EscapeError: the motion from q = 1.1, q_dot = 0 cannot be ...
    """


class _Course:
    """The acceleration along the motion that begins with a state at t[0].

    Near infinity steps shrink, or cycles get shorter, without end: it refuses to go there.
    """

    def __init__(self, acceleration: Acceleration, state: Array, t: Array) -> None:
        self.acceleration, self.end = acceleration, t[-1]
        self.place = self.start = (t[0], *state)
        self.left = _MOST * (_AHEAD + len(t))

    def __call__(self, t: float, q: Any, q_dot: Any, *force: Any) -> Any:
        q_ddot = self.acceleration(q, q_dot, *force)
        whole = math.isfinite(q_ddot) if isinstance(q_ddot, float) else np.isfinite(q_ddot).all()
        if not whole:
            raise self.escaped("goes to infinity")
        if self.left == 0:
            raise self.escaped("becomes too fast for these times")
        self.left, self.place = self.left - 1, (t, q, q_dot)
        return q_ddot

    def rates(self, t: float, y: Array, force: Force | None = None) -> tuple[float, float]:
        """q_dot and q_ddot of one coordinate, under a force or free."""
        q, q_dot = y.tolist()
        return q_dot, self(t, q, q_dot) if force is None else self(t, q, q_dot, force(t))

    def rates_of_several(self, t: float, y: Array, force: Force | None = None) -> Array:
        """The same of several coordinates, (2 R,)."""
        q, q_dot = y.reshape(2, -1)
        push = () if force is None else (force(t),)
        return np.concatenate([q_dot, self(t, q, q_dot, *push)])

    def escaped(self, how: str) -> EscapeError:
        """What is said of a motion that ends where it last was."""
        (_, *first), (t, *last) = self.start, self.place
        q0, q_dot0, q, q_dot = (
            ", ".join(f"{v:.4g}" for v in np.atleast_1d(x)) for x in (*first, *last)
        )
        return EscapeError(
            f"the motion from q = {q0}, q_dot = {q_dot0} cannot be followed to"
            f" {self.end:.6g} s: near t = {t:.6g} s, q = {q}, q_dot = {q_dot} it {how};"
            " start at a smaller amplitude, within that of the data behind the model"
        )


def integrate_smooth(
    acceleration: Acceleration, state: Array, t: Array, rtol: float, scale: float
) -> tuple[Array, Array]:
    """Motion (q, q_dot), (n,) or (n, R), without jumps of force at increasing times, by LSODA.

    ``state`` is (q, q_dot) at t[0], (2,) of one coordinate or (2, R) of several; the absolute
    tolerance is ``rtol * scale``.

    Raises an EscapeError if the motion cannot be followed to the last time.
    """
    followed = _Course(acceleration, state, t)
    own = followed.rates if state.ndim == 1 else followed.rates_of_several
    options = {"rtol": rtol, "atol": rtol * scale, "mxstep": followed.left, "tfirst": True}
    with warnings.catch_warnings(), np.errstate(over="ignore", invalid="ignore"):
        warnings.simplefilter("error", ODEintWarning)
        try:
            y = odeint(own, state.ravel(), t, **options)
        except ODEintWarning as warning:
            raise followed.escaped(f"stops ({warning})") from None
    q, q_dot = np.moveaxis(y.reshape(len(t), *state.shape), 1, 0)
    return q, q_dot


def integrate_steps(
    acceleration: Acceleration,
    state: Array,
    t: Array,
    steps: Iterable[tuple[float, Force]],
    rtol: float,
    scale: float,
) -> tuple[Array, Array]:
    """As `integrate_smooth`, under forces that are smooth in each step.

    ``steps`` are their ends, all of t[1:] among them, with the force as a function of time.
    """
    followed = _Course(acceleration, state, t)
    own = followed.rates if state.ndim == 1 else followed.rates_of_several
    y = _through(own, state.ravel(), t, steps, followed, rtol, rtol * scale)
    q, q_dot = np.moveaxis(y.reshape(len(t), *state.shape), 1, 0)
    return q, q_dot


def integrate_remembering(
    acceleration: Acceleration,
    memories: Mapping[MemoryLaw, float],
    state: Array,
    t: Array,
    steps: Iterable[tuple[float, Force]],
    rtol: float,
    scale: float,
    rate: float,
) -> tuple[Array, Array, Array]:
    """As `integrate_steps` of one coordinate, where forces remember; their sum comes third.

    Their inner states go along. What they are at first follows from the start and ``rate``, rad/s:
    see `MemoryLaw.begun`.
    """
    followed = _Course(acceleration, state, t)
    q0, q_dot0 = state.tolist()
    begun = [law.begun(q0, q_dot0, rate) for law in memories]
    ends = np.cumsum([len(inner) for inner in begun])[:-1]

    def pull(y: Array) -> float:
        pairs = zip(memories.items(), np.split(y[2:], ends), strict=True)
        return float(sum(value * law.force(y[0], y[1], z) for (law, value), z in pairs))

    def rates(now: float, y: Array, force: Callable[[float], float]) -> Array:
        q, q_dot = y[:2].tolist()
        pairs = zip(memories, np.split(y[2:], ends), strict=True)
        inner = [law.rates(q, q_dot, z) for law, z in pairs]
        return np.concatenate([[q_dot, followed(now, q, q_dot, force(now) - pull(y))], *inner])

    y = _through(rates, np.concatenate([state, *begun]), t, steps, followed, rtol, rtol * scale)
    return y[:, 0], y[:, 1], np.array([pull(row) for row in y])


def _through(
    rates: Callable[..., Any],
    start: Array,
    t: Array,
    steps: Iterable[tuple[float, Force]],
    followed: _Course,
    rtol: float,
    atol: float,
) -> Array:
    """States (n, m) at the times t, by DOP853 from step to step."""
    solver = ode(rates).set_integrator("dop853", rtol=rtol, atol=atol, nsteps=followed.left)
    solver.set_initial_value(start, t[0])
    ends, states = [t[0]], [start]
    with warnings.catch_warnings(), np.errstate(over="ignore", invalid="ignore"):
        warnings.simplefilter("ignore", UserWarning)  # of steps that become too small: see below
        for end, force in steps:
            solver.set_f_params(force)
            states.append(solver.integrate(end))
            ends.append(end)
            if not solver.successful():
                raise followed.escaped("goes to infinity")
    return np.array(states)[np.searchsorted(ends, t - (t[1] - t[0]) / 1e6)]


def integrate_strokes(
    acceleration: Acceleration, state: Array, t: Array, rtol: float, scale: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Motion with dry friction, stroke by stroke between reversals; it may come to rest.

    As `integrate_smooth`; the third array says where friction holds the mass.
    """
    followed = _Course(acceleration, state, t)
    creep, options = 1e-12 * scale, {"rtol": max(rtol, 1e-12), "atol": rtol * scale}
    y = np.tile([float(state[0]), 0.0], (len(t), 1))
    rests = np.ones(len(t), bool)
    start = t[0]
    while start < t[-1]:
        direction = float(np.sign(state[1])) or _breakaway(acceleration, state[0], creep)
        if direction == 0:
            break
        with np.errstate(over="ignore", invalid="ignore"):
            stroke = _stroke(followed, direction, (start, t[-1]), state, creep, options)
        if stroke.t[-1] - start < _MOMENT * (t[-1] - t[0]):
            break  # what all but holds it gave way in the last digit alone
        inside = (t >= start) & (t <= stroke.t[-1])
        if np.any(inside):  # a stroke may be over between two times
            y[inside] = stroke.sol(t[inside]).T
        rests[inside] = False
        start, state = stroke.t[-1], np.array([stroke.y[0, -1], 0.0])
        y[t > start] = state
    return y[:, 0], y[:, 1], rests


def _breakaway(acceleration: Acceleration, q: float, creep: float) -> float:
    # From rest the motion starts in the direction in which friction gives way, if any.
    if acceleration(q, creep) > 0:
        return 1.0
    return -1.0 if acceleration(q, -creep) < 0 else 0.0


def _stroke(  # type: ignore[no-untyped-def]
    followed: _Course,
    direction: float,
    span: tuple[float, float],
    state: Array,
    creep: float,
    options: dict[str, float],
):
    """One stroke, to the next reversal or the end, as `scipy.integrate.solve_ivp` gives it."""

    def rates(now: float, y: Array) -> tuple[float, float]:
        # Friction keeps its sign within the stroke, also in the stages that overshoot its end.
        q, q_dot = y.tolist()
        return q_dot, followed(now, q, direction * max(direction * q_dot, creep))

    def reversal(_: float, y: Array) -> float:
        return y[1]

    reversal.terminal, reversal.direction = True, -direction  # type: ignore[attr-defined]
    stroke = solve_ivp(rates, span, state, "DOP853", dense_output=True, events=reversal, **options)
    if stroke.status < 0:
        raise followed.escaped("goes to infinity")
    return stroke
