"""Collocation against closed forms, an independent integrator and finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles import equation_of
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

import romsindy as rs
from romsindy.fit.kernel.collocation import Grid, TrajectoryError, integrate
from romsindy.fit.kernel.equation import ExtendedEquation
from romsindy.fit.kernel.linear_response import sensitivity
from romsindy.physics.example import EXAMPLE_MODEL


def equation(**coefficients: float) -> ExtendedEquation:
    model = rs.ReducedModel.from_coefficients(coefficients)
    return equation_of(model, tuple(coefficients))


def linear(t: np.ndarray, squared: float, c: float, q0: float, v0: float) -> np.ndarray:
    damped = np.sqrt(squared - c * c / 4)
    return np.exp(-c * t / 2) * (
        q0 * np.cos(damped * t) + (v0 + c * q0 / 2) / damped * np.sin(damped * t)
    )


@pytest.mark.parametrize("dt", [0.0011, 0.02, 0.11])  # several samples a step, one, and a part
def test_linear_oscillator_and_its_derivatives(dt: float) -> None:
    squared, c, state = 36.0, 0.3, (1.0, -2.0)
    t = 0.7 + np.arange(0, 12, dt)
    eq = equation(**{"omega^2": squared, "c_linear": c})
    motion = integrate(eq, state, Grid.over(t, 2 * np.pi / 6))
    # Order six at 40 steps a cycle: (2 pi/40)^6 / 1e5 per radian, 72 rad.
    np.testing.assert_allclose(
        motion.samples(eq)[:, 0], linear(t - 0.7, squared, c, *state), atol=1e-8, rtol=0
    )
    derivatives = sensitivity(eq, motion)[:, 0]
    point = np.array([squared, c, *state])
    for i in range(4):
        step = np.zeros(4)
        step[i] = 1e-4 * max(abs(point[i]), 1)
        exact = (linear(t - 0.7, *(point + step)) - linear(t - 0.7, *(point - step))) / (
            2 * step[i]
        )
        # Central differences of the closed form: relative error (72 rad * 5e-5)^2 / 6 at most.
        np.testing.assert_allclose(derivatives[:, i], exact, atol=3e-6 * np.abs(exact).max())


def duffing_error(steps: int) -> float:
    a, b, q0 = 36.0, 40.0, 1.0
    t = np.linspace(0, 8, 801)
    eq = equation(**{"omega^2": a, "gamma_3": b})
    rate, m = np.sqrt(a + b * q0**2), b * q0**2 / (2 * (a + b * q0**2))
    period = 4 * ellipk(m) / rate
    motion = integrate(eq, (q0, 0.0), Grid.over(t, period, steps))
    return float(np.abs(motion.samples(eq)[:, 0] - q0 * ellipj(rate * t, m)[1]).max())


def test_duffing_against_elliptic_function_converges_with_order_six() -> None:
    coarse, fine = duffing_error(24), duffing_error(48)
    assert fine < 1e-6
    assert np.log2(coarse / fine) > 5.5  # steps are whole numbers of samples, so not just halved


def test_inertia_and_every_derivative_against_an_adaptive_integrator() -> None:
    model = EXAMPLE_MODEL
    t = np.linspace(0, 20, 4001)
    reference = model.simulate(1.5, 0.0, t, rtol=1e-13)
    eq = equation_of(model, ())
    motion = integrate(eq, (1.5, 0.0), Grid.over(t, 2 * np.pi / 6, 120))
    for derivative, values in enumerate((reference.q, reference.q_dot, reference.q_ddot)):
        error = np.abs(motion.samples(eq, derivative)[:, 0] - values).max() / np.abs(values).max()
        assert error < [1e-8, 1e-6, 1e-5][derivative]


def test_sensitivity_matches_finite_differences_for_every_coefficient() -> None:
    model = EXAMPLE_MODEL
    names = tuple(model.coefficients)
    t = np.linspace(0, 10, 501)
    grid = Grid.over(t, 2 * np.pi / 7)

    def moved(values: np.ndarray, derivative: int) -> np.ndarray:
        eq = equation_of(replace(model, values=tuple(values)), names)
        return integrate(eq, (1.2, 0.5), grid).samples(eq, derivative)[:, 0]

    eq = equation_of(model, names)
    motion = integrate(eq, (1.2, 0.5), grid)
    values = np.array(model.values)
    for derivative in range(3):
        exact = sensitivity(eq, motion, derivative)[:, 0]
        for i in range(len(names)):
            step = np.zeros(len(names))
            step[i] = 1e-4 * values[i]
            difference = moved(values + step, derivative) - moved(values - step, derivative)
            difference /= 2 * step[i]
            scale = np.abs(difference).max()
            # Central differences with relative steps of 1e-4, Newton converged to 1e-11.
            np.testing.assert_allclose(exact[:, i], difference, atol=2e-5 * scale)


def test_warm_start_gives_the_same_motion() -> None:
    model = EXAMPLE_MODEL
    t = np.linspace(0, 20, 2001)
    grid = Grid.over(t, 1.0)
    eq = equation_of(model, ())
    cold = integrate(eq, (1.5, 0.0), grid)
    near = integrate(eq, (1.49, 0.1), grid.until(9.0))
    warm = integrate(eq, (1.5, 0.0), grid, near)
    np.testing.assert_allclose(warm.q, cold.q, atol=1e-9)


def test_part_of_a_grid_ends_at_its_time() -> None:
    t = np.linspace(2, 22, 2001)
    grid = Grid.over(t, 1.0)
    part = grid.until(9.0)
    assert len(part.sample_step) == np.sum(t <= 9.0 + 1e-9)
    assert part.start + part.n_steps * part.step >= 9.0 - 1e-9


@pytest.mark.parametrize(
    "coefficients", [{"omega^2": 4.0, "Upsilon_3": -1.0}, {"omega^2": 4.0, "gamma_3": -5.0}]
)
def test_motion_that_has_no_continuation_is_refused(coefficients: dict[str, float]) -> None:
    """Inertia vanishes at q = 1; the softening spring lets go beyond q = 0.9."""
    eq = equation(**coefficients)
    with pytest.raises(TrajectoryError, match=r"beyond t = .*diverges"):
        integrate(eq, (0.8, 2.5), Grid.over(np.linspace(0, 30, 3001), 3.0))


def test_motion_up_to_where_it_is_lost_is_kept() -> None:
    """Negative damping drives a softening spring over its top; Runge and Kutta follow it there."""
    eq = equation(**{"omega^2": 4.0, "gamma_3": -5.0, "c_linear": -0.1})
    with pytest.raises(TrajectoryError) as error:
        integrate(eq, (0.3, 0.0), Grid.over(np.linspace(0, 60, 6001), 3.0))
    done = error.value.motion
    t = done.grid.step * np.arange(len(done.q))
    truth = solve_ivp(
        lambda t, y: [y[1], 0.1 * y[1] - 4 * y[0] + 5 * y[0] ** 3],
        (0, t[-1]), (0.3, 0.0), "DOP853", rtol=1e-11, atol=1e-12, dense_output=True,
    )  # fmt: skip
    oscillates = t < t[-1] - 3.0  # the last cycle goes over the top, where errors grow
    assert oscillates.sum() > 100
    # Steps of a fortieth of a cycle, order six, over ten cycles.
    np.testing.assert_allclose(done.q[oscillates, 0], truth.sol(t[oscillates])[0], atol=1e-6)
