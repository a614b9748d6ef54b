import numpy as np
import pytest

from romsindy import ContinuationError, Steps, continue_branch
from romsindy.orbits.continuation import _first_point, _System, correct, predict


def circle(u, p):
    return u**2 + p**2 - 1


def circle_jacobian(u, p):
    return np.array([[2 * u[0], 2 * p]])


def two_folds(u, p):
    return u**3 - 3 * u - p


@pytest.mark.parametrize("jacobian", [circle_jacobian, None])
@pytest.mark.parametrize("direction", [1, -1, (0.0, 1.0), (0.0, -1.0)])
def test_goes_round_the_circle(jacobian, direction):
    branch = continue_branch(
        circle, [1.0], 0.0, p_range=(-2, 2), jacobian=jacobian, direction=direction
    )
    assert branch.stop_reason == "the branch is closed"
    # Newton's last update is below 1e-8, so that its square is rounding.
    assert np.all(branch.residual <= 1e-14)
    np.testing.assert_allclose(np.hypot(branch.u[:, 0], branch.p), 1, rtol=1e-14)
    turned = np.unwrap(np.arctan2(branch.p, branch.u[:, 0]))
    assert np.all(np.diff(np.sign(np.sum(np.atleast_1d(direction))) * turned) > 0)
    np.testing.assert_allclose(abs(turned[-1] - turned[0]), 2 * np.pi, rtol=1e-12)
    sign = np.sign(np.sum(np.atleast_1d(direction)))
    # p is stationary at a fold: an error of 1e-8 along the curve is one of 1e-16 in p.
    np.testing.assert_allclose(branch.p[branch.folds], [sign, -sign], atol=1e-14)
    np.testing.assert_allclose(branch.tangent[branch.folds, 1], 0, atol=1e-9)


def test_scalar_equation_with_two_folds():
    branch = continue_branch(two_folds, [-3.0], -18.0, p_range=(-18, 18))
    # dp/du = 3 u^2 - 3 = 0 by hand.
    np.testing.assert_allclose(branch.p[branch.folds], [2, -2], atol=1e-12)
    np.testing.assert_allclose(branch.u[branch.folds, 0], [-1, 1], atol=1e-8)
    assert np.all(np.diff(branch.u[:, 0]) > 0)
    assert branch.p[-1] == 18 and branch.stop_reason == "p reached 18"
    np.testing.assert_allclose(branch.u[-1], 3, rtol=1e-14)


def test_degenerate_fold_at_the_cusp_of_the_cusp_catastrophe_is_none():
    """u^3 - a u = p has two folds for a > 0; at a = 0 they meet, and p goes on."""
    branch = continue_branch(lambda u, p: u**3 - p, [-1.0], -1.0, p_range=(-1, 1))
    assert len(branch.folds) == 0 and branch.stop_reason == "p reached 1"
    np.testing.assert_allclose(branch.u[:, 0], np.cbrt(branch.p), atol=1e-12)


def test_branch_stops_at_a_cusp_in_the_curve():
    """u^2 = p^3 has no tangent at the origin: nobody can tell where the branch goes on."""
    branch = continue_branch(lambda u, p: u**2 - p**3, [1.0], 1.0, p_range=(-2, 2), direction=-1)
    assert "near p = " in branch.stop_reason
    np.testing.assert_allclose([branch.u[-1, 0], branch.p[-1]], 0, atol=1e-3)


def test_branch_stops_where_the_equation_ends():
    branch = continue_branch(lambda u, p: u - np.sqrt(p), [1.0], 1.0, p_range=(-2, 2), direction=-1)
    assert "corrector does not converge" in branch.stop_reason
    np.testing.assert_allclose(branch.p[-1], 0, atol=1e-4)


def test_branch_stops_before_what_is_objected_to():
    branch = continue_branch(
        circle, [1.0], 0.0, p_range=(-2, 2), objection=lambda u, p: "too far" if p > 0.5 else ""
    )
    assert branch.stop_reason == "too far"
    # Steps are halved down to 1e-6 before the end is admitted.
    assert 0.5 - 1e-5 < branch.p[-1] <= 0.5


def test_branch_stops_at_the_first_point_that_is_enough():
    branch = continue_branch(
        circle, [1.0], 0.0, p_range=(-2, 2), until=lambda u, p: "enough" if p > 0.5 else ""
    )
    assert branch.stop_reason == "enough" and branch.p[-2] <= 0.5 < branch.p[-1]


def test_branch_that_sets_out_over_the_limit_is_one_point():
    branch = continue_branch(two_folds, [-3.0], -18.0, p_range=(-18, 18), direction=-1)
    assert len(branch) == 1 and branch.stop_reason == "p reached -18"


def test_branch_point_is_passed_straight_on():
    """(u - p) (u + p - 1) = 0: two lines that cross at p = 1/2."""
    branch = continue_branch(
        lambda u, p: (u - p) * (u + p - 1), [-1.03], -1.03, p_range=(-2, 2), steps=Steps(most=0.07)
    )
    assert branch.stop_reason == "p reached 2"
    np.testing.assert_allclose(branch.u[:, 0], branch.p, atol=1e-12)


def test_predictor_misses_by_half_the_curvature():
    system = _System(circle, circle_jacobian, None, None, 1e-8)
    start = _first_point(system, np.array([0.6, 0.8]), 1.0)
    steps = np.array([0.04, 0.02, 0.01])
    missed = [np.linalg.norm(predict(start, s)) - 1 for s in steps]
    np.testing.assert_allclose(missed, steps**2 / 2, rtol=1e-3)


def test_corrector_converges_quadratically():
    """Halving the step quarters the first error and, after one update, takes 1/16 of it."""
    start = _first_point(
        _System(circle, circle_jacobian, None, None, 1e-8), np.array([0.6, 0.8]), 1.0
    )
    errors = []
    for step in (0.2, 0.1, 0.05):
        once = _System(circle, circle_jacobian, None, None, 1.0)  # any first update will do
        point = correct(once, predict(start, step), start.tangent)
        assert point.iterations == 1
        errors.append(abs(np.linalg.norm(point.z) - 1))
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(order, 4, atol=0.15)


def test_steps_stay_in_their_bounds():
    steps = Steps(first=0.01, most=0.05, turn=0.1)
    branch = continue_branch(two_folds, [-3.0], -18.0, p_range=(-18, 18), steps=steps)
    z = np.column_stack([branch.u, branch.p])
    lengths = np.linalg.norm(np.diff(z, axis=0), axis=1)
    # Corrections at right angles lengthen a step by at most 1 / cos(turn).
    assert np.all(lengths <= steps.most / np.cos(steps.turn))
    cosines = np.sum(branch.tangent[1:] * branch.tangent[:-1], axis=1)
    assert np.all(np.arccos(np.clip(cosines, -1, 1)) <= steps.turn + 1e-7)


@pytest.mark.parametrize(("gap", "crossing"), [(1e-4, None), (1e-4, 1e-3), (0.0, 1e-3)])
def test_branches_that_come_near_are_not_mistaken_for_one(gap, crossing):
    """u p = gap: two hyperbolas, 2 sqrt(2 gap) = 0.028 apart, or two lines that cross."""
    steps = Steps(first=0.1, crossing=crossing)
    branch = continue_branch(
        lambda u, p: u * p - gap,
        [-gap / 2],
        -2.0,
        p_range=(-2, 2),
        steps=steps,
        until=lambda u, p: "u is large" if abs(u[0]) > 1 else "",
    )
    apart = gap > 0 and crossing is not None
    assert branch.stop_reason == ("u is large" if apart else "p reached 2")
    assert np.all(branch.p < 0) == apart


def test_interruption_keeps_what_was_computed():
    calls = iter(range(100))

    def impatient(u, p):
        if next(calls) == 60:
            raise KeyboardInterrupt
        return circle(u, p)

    branch = continue_branch(impatient, [1.0], 0.0, p_range=(-2, 2), jacobian=circle_jacobian)
    assert branch.stop_reason == "interrupted from the keyboard"
    assert len(branch) > 5 and np.all(branch.residual < 1e-14)


def test_length_is_limited():
    branch = continue_branch(circle, [1.0], 0.0, p_range=(-2, 2), steps=Steps(max_points=7))
    assert len(branch) == 7 and branch.stop_reason == "max_points = 7 reached"


def test_bad_input_is_refused():
    with pytest.raises(ValueError, match="u must be one-dimensional and finite"):
        continue_branch(circle, [[1.0]], 0.0, p_range=(-2, 2))
    with pytest.raises(ValueError, match=r"p = 3\.0 lies outside p_range = \(-2, 2\)"):
        continue_branch(circle, [1.0], 3.0, p_range=(-2, 2))
    with pytest.raises(ContinuationError, match="give a guess nearer to a solution"):
        continue_branch(circle, [1.0], 1.5, p_range=(-2, 2))
    with pytest.raises(ValueError, match="0 < least <= first <= most"):
        Steps(first=1.0)
    with pytest.raises(ValueError, match="must be positive"):
        Steps(turn=0.0)
    with pytest.raises(ValueError, match="crossing = 1e-09 must be at least least = 1e-06"):
        Steps(crossing=1e-9)
