"""Time integration of q_ddot = acceleration(q, q_dot), with and without dry friction."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import ODEintWarning, odeint, solve_ivp

from romsindy.typing import Array

Acceleration = Callable[[float, float], float]


def integrate_smooth(
    acceleration: Acceleration, state: Array, t: Array, rtol: float, scale: float
) -> tuple[Array, Array]:
    """Motion (q, q_dot) without jumps of force at increasing times, by LSODA.

    ``state`` is (q, q_dot) at t[0]; the absolute tolerance is ``rtol * scale``.

    Raises
    ------
    RuntimeError
        If the last time is not reached.
    """

    def rates(y: Array, _: float) -> tuple[float, float]:
        q, q_dot = y.tolist()
        return q_dot, acceleration(q, q_dot)

    with warnings.catch_warnings():
        warnings.simplefilter("error", ODEintWarning)
        try:
            y = odeint(rates, state, t, rtol=rtol, atol=rtol * scale, mxstep=100_000)
        except ODEintWarning as warning:
            raise RuntimeError(f"simulate did not reach t = {t[-1]:.6g} s: {warning}") from None
    return y[:, 0], y[:, 1]


def integrate_strokes(
    acceleration: Acceleration, state: Array, t: Array, rtol: float, scale: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Motion with dry friction, stroke by stroke between reversals; it may come to rest.

    As `integrate_smooth`; the third array says where friction holds the mass.
    """
    creep, options = 1e-12 * scale, {"rtol": max(rtol, 1e-12), "atol": rtol * scale}
    y = np.tile([float(state[0]), 0.0], (len(t), 1))
    rests = np.ones(len(t), bool)
    start = t[0]
    while start < t[-1]:
        direction = float(np.sign(state[1])) or _breakaway(acceleration, state[0], creep)
        if direction == 0:
            break
        stroke = _stroke(acceleration, direction, (start, t[-1]), state, creep, options)
        inside = (t >= start) & (t <= stroke.t[-1])
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
    acceleration: Acceleration,
    direction: float,
    span: tuple[float, float],
    state: Array,
    creep: float,
    options: dict[str, float],
):
    """One stroke, to the next reversal or the end, as `scipy.integrate.solve_ivp` gives it."""

    def rates(_: float, y: Array) -> tuple[float, float]:
        # Friction keeps its sign within the stroke, also in the stages that overshoot its end.
        q, q_dot = y.tolist()
        return q_dot, acceleration(q, direction * max(direction * q_dot, creep))

    def reversal(_: float, y: Array) -> float:
        return y[1]

    reversal.terminal, reversal.direction = True, -direction  # type: ignore[attr-defined]
    stroke = solve_ivp(rates, span, state, "DOP853", dense_output=True, events=reversal, **options)
    if stroke.status < 0:
        raise RuntimeError(f"simulate stopped at t = {stroke.t[-1]:.6g} s: {stroke.message}")
    return stroke
