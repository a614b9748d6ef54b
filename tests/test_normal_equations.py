"""Solutions of normal equations, against closed forms, whatever the scales."""

import numpy as np
import pytest

import romsindy as rs
from romsindy.fit.kernel.hypothesis import inverse, solved

RNG = np.random.default_rng(0)
SCALES = 10.0 ** np.array([0, 9, -9, 4])


def test_scales_do_not_matter():
    rows = RNG.normal(size=(50, 4))
    x = RNG.normal(size=4)
    scaled = rows * SCALES
    gram = scaled.T @ scaled
    assert solved(gram, scaled.T @ (rows @ x)) * SCALES == pytest.approx(x, rel=1e-9)
    covariance = np.linalg.inv(rows.T @ rows)  # of columns of like size: well-conditioned
    assert inverse(gram) * np.outer(SCALES, SCALES) == pytest.approx(covariance, rel=1e-9)


def test_what_is_not_told_apart_is_shared():
    """Two columns that are the same: of all solutions the smallest one, and no variance between."""
    rows = RNG.normal(size=(50, 3))[:, [0, 1, 2, 2]]
    gram = rows.T @ rows
    x = solved(gram, rows.T @ (rows @ [1.0, 2.0, 3.0, 5.0]))
    assert x == pytest.approx([1.0, 2.0, 4.0, 4.0], rel=1e-7)
    assert inverse(gram) @ [0.0, 0.0, 1.0, -1.0] == pytest.approx(np.zeros(4), abs=1e-9)
    several = solved(gram, np.column_stack([rows.T @ rows[:, 0], np.zeros(4)]))
    assert several == pytest.approx(np.eye(4)[:, :1] * [1.0, 0.0], abs=1e-7)


def test_nothing_is_solved_by_nothing():
    assert solved(np.zeros((0, 0)), np.zeros(0)).shape == (0,)
    assert np.all(solved(np.zeros((2, 2)), np.zeros(2)) == 0)


@pytest.mark.slow
def test_a_short_ordinary_record_is_identified():
    """A singular value decomposition of its normal equations does not converge."""
    terms = {"omega^2": 2500.0, "gamma_3": 5e4, "Upsilon_3": 60.0, "c_linear": 0.4}
    model = rs.ReducedModel.from_coefficients(terms, unit="m")
    decay = rs.add_noise(model.simulate(0.08, 0.0, np.arange(0, 5, 1 / 400)), 35, 1)
    found = rs.identify(decay)
    q = np.linspace(-0.07, 0.07, 5)
    h = found.inertia(q)
    assert found.verdict.explained and np.all((h.low <= 60 * q**2) & (60 * q**2 <= h.high))
