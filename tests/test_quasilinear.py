"""Linear responses against differences of full integrations, and convergence to the motion."""

import numpy as np
import pytest
from oracles import equation_of

import romsindy as rs
from romsindy.fit.kernel.collocation import Grid, Trajectory, integrate
from romsindy.fit.kernel.linear_response import nodes, respond, sampled

MODEL = rs.ReducedModel.from_coefficients(
    {"omega^2": 36.0, "gamma_3": 9.0, "Upsilon_3": 0.3, "c_linear": 0.06}
)
T = np.linspace(0, 8, 801)
GRID = Grid.over(T, 2 * np.pi / 6, 40)


def moved(**changes):
    coefficients = MODEL.coefficients | changes
    return equation_of(rs.ReducedModel.from_coefficients(coefficients), ("gamma_3",))


def test_columns_are_derivatives_of_the_motion():
    equation = moved()
    motion = integrate(equation, (0.8, 0.1), GRID)
    response = respond(equation, motion, equation.by_parameter(*nodes(motion)))
    h = 1e-4
    ends = [integrate(moved(gamma_3=9 + s * h), (0.8, 0.1), GRID).q for s in (1, -1)]
    np.testing.assert_allclose(response.q[..., 1], (ends[0] - ends[1]) / (2 * h), atol=1e-8)
    ends = [integrate(equation, (0.8, 0.1 + s * h), GRID).q for s in (1, -1)]
    np.testing.assert_allclose(response.q[..., 3], (ends[0] - ends[1]) / (2 * h), atol=1e-7)
    # The motion satisfies its equation: column 0 has nothing to mend.
    assert np.abs(response.q[..., 0]).max() < 1e-10


def test_a_rough_motion_becomes_the_true_one_quadratically():
    """Newton: from an error of 1e-2 the corrections fall as 1e-4, 1e-8 (times a constant)."""
    equation = moved()
    truth = integrate(equation, (0.8, 0.0), GRID)
    wobble = 1e-2 * np.sin(5 * np.linspace(0, 8, len(truth.q)))[:, None]
    motion = Trajectory(GRID, truth.q + wobble, truth.q_dot, truth.q_ddot * 1.001)
    errors = []
    for _ in range(4):
        response = respond(equation, motion, np.zeros((0, 3 * GRID.n_steps, 1)))
        # The state at the start is put right as well: it is known here.
        start = np.array([1.0, *([0.8, 0.0] - motion.start)])
        motion = response.moved(start)
        errors.append(np.abs(motion.q - truth.q).max())
    assert errors[0] < 3e-2 and errors[3] < 1e-9
    assert errors[2] < 100 * errors[1] ** 2 + 1e-10


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_samples_inside_steps(derivative):
    """Cubic in q_dot inside a step: error of order h^4, 1e-5 here relative to the signal."""
    motion = integrate(moved(), (0.8, 0.0), GRID)
    exact = MODEL.simulate(0.8, 0.0, T, rtol=1e-12)
    signal = (exact.q, exact.q_dot, exact.q_ddot)[derivative]
    error = np.abs(sampled(motion, derivative)[:, 0] - signal).max() / np.abs(signal).max()
    assert error < (1e-8, 1e-7, 2e-4)[derivative] * 1e2
