"""Orbits of several coordinates, against one coordinate, closed forms and shooting by hand."""

import re

import numpy as np
import pytest
from oracles import differences
from scipy.integrate import solve_ivp

from romsindy import CoupledModel, ReducedModel, backbone_curve, forced_response
from romsindy.orbits.harmonic_balance import (
    ForcedFamily,
    FreeFamily,
    HarmonicBalance,
    Sweep,
    monodromy,
)
from romsindy.show.plots import plot_branch, plot_forced_response

FIRST = {"omega^2": 36.0, "gamma_2": -3.0, "gamma_3": 9.0, "Upsilon_3": 0.4, "c_linear": 0.1}
SECOND = {"omega^2": 150.0, "gamma_3": 20.0, "c_linear": 0.3, "c_cubic": 0.01}


def on(coordinate, coefficients):
    return {f"{name} [q{coordinate}]": value for name, value in coefficients.items()}


UNCOUPLED = CoupledModel.from_coefficients({**on(1, FIRST), **on(2, SECOND)}, unit="m")


# -- one coordinate after the other -----------------------------------------------------------


@pytest.mark.parametrize(("mode", "coefficients"), [(1, FIRST), (2, SECOND)])
@pytest.mark.parametrize("method", ["conservative", "phase resonance"])
def test_uncoupled_modes_are_models_of_one_coordinate(mode, coefficients, method):
    single = ReducedModel.from_coefficients(coefficients)
    wanted = {"amplitude": (0.01, 0.8), "method": method, "n_points": 20}
    curve = backbone_curve(UNCOUPLED, mode=mode, **wanted)
    own = curve.amplitude[:, mode - 1]
    assert curve.amplitude.shape == (len(curve), 2)
    assert curve.coefficients.shape[2] == 2 and curve.motion(3, 50)[1].shape == (50, 2)
    np.testing.assert_array_less(curve.amplitude[:, 2 - mode], 1e-12)
    np.testing.assert_allclose(own[[0, -1]], (0.01, 0.8), rtol=1e-4)  # damped: a little asymmetric
    assert curve.stop_reason == "amplitude reached 0.8 m"
    if method == "conservative":
        # Both have harmonics enough for 1e-8 of the force, which is less in the frequency.
        np.testing.assert_allclose(curve.frequency, single.backbone(own), rtol=1e-9)
    else:
        alone = backbone_curve(single, **wanted)
        np.testing.assert_allclose(own[-1], alone.amplitude[-1], rtol=1e-9)
        np.testing.assert_allclose(curve.frequency[-1], alone.frequency[-1], rtol=1e-9)
        np.testing.assert_allclose(
            curve.negative_damping[-1], alone.negative_damping[-1], rtol=1e-8
        )


@pytest.mark.parametrize(("number", "coefficients"), [(1, FIRST), (2, SECOND)])
def test_uncoupled_responses_are_those_of_one_coordinate(number, coefficients):
    force, rate = 0.8, np.sqrt(coefficients["omega^2"])
    path = (0.9 * rate, 1.1 * rate)
    single = ReducedModel.from_coefficients(coefficients)
    alone = forced_response(single, force, path, 9, n_points=60)
    forces = np.where(np.arange(2) == number - 1, force, 0.0)
    both = forced_response(UNCOUPLED, forces, path, 9, n_points=60)
    own = both.amplitude[:, number - 1]
    # The first orbit and the last, and the fold, which is found to 1e-10 of a step.
    np.testing.assert_allclose(both.frequency[both.folds], alone.frequency[alone.folds], rtol=1e-9)
    for i in (0, -1):
        np.testing.assert_allclose(own[i], alone.amplitude[i], rtol=1e-9)
        distance = np.abs(both.multipliers[i, :, None] - alone.multipliers[i])
        np.testing.assert_allclose(np.min(distance, axis=0), 0.0, atol=1e-9)
    np.testing.assert_array_equal(both.force, forces)
    assert [b.kind for b in both.bifurcations] == [b.kind for b in alone.bifurcations]


# -- a tongue, against shooting ---------------------------------------------------------------

# omega_2 = sqrt(10) is a little above 3 omega_1: q1 hardens, and meets q2 at 1:3.
CUBIC, CROSS, SHARED = 1.0, 0.1, 1.5  # gamma_3 [q1], V q1^3 q2, V q1^2 q2^2
OWN_MASS, MIXED_MASS = 0.05, 0.1  # g(q1^2)^2, g(q1 q2)^2
TONGUE = CoupledModel.from_coefficients(
    {
        "omega^2 [q1]": 1.0,
        "omega^2 [q2]": 10.0,
        "gamma_3 [q1]": CUBIC,
        "V q1^3 q2": CROSS,
        "V q1^2 q2^2": SHARED,
        "g(q1^2)^2": OWN_MASS,
        "g(q1 q2)^2": MIXED_MASS,
    }
)


def accelerations(x, y, v, w):
    """q1_ddot and q2_ddot from Lagrange's equations, written down by hand.

    T = (v^2 + w^2 + OWN_MASS (2 x v)^2 + MIXED_MASS (v y + x w)^2) / 2.
    """
    m11 = 1 + 4 * OWN_MASS * x**2 + MIXED_MASS * y**2
    m12 = MIXED_MASS * x * y
    m22 = 1 + MIXED_MASS * x**2
    f1 = x + CUBIC * x**3 + 3 * CROSS * x**2 * y + 2 * SHARED * x * y**2
    f2 = 10 * y + CROSS * x**3 + 2 * SHARED * x**2 * y
    f1 = f1 + 4 * OWN_MASS * x * v**2 + 2 * MIXED_MASS * y * v * w
    f2 = f2 + 2 * MIXED_MASS * x * v * w
    determinant = m11 * m22 - m12**2
    return (m12 * f2 - m22 * f1) / determinant, (m12 * f1 - m11 * f2) / determinant


def flown(states, period, damping=(0.0, 0.0), force=(0.0, 0.0), omega=0.0, samples=2):
    """Motions (samples, n, 4) = (q1, q2, q1_dot, q2_dot) from states (n, 4); forces on mass 1."""

    def rates(t, flat):
        x, y, v, w = flat.reshape(-1, 4).T
        m11 = 1 + 4 * OWN_MASS * x**2 + MIXED_MASS * y**2
        m12, m22 = MIXED_MASS * x * y, 1 + MIXED_MASS * x**2
        a, b = accelerations(x, y, v, w)
        outer = [
            f * np.cos(omega * t) - c * u for f, c, u in zip(force, damping, (v, w), strict=True)
        ]
        determinant = m11 * m22 - m12**2
        a = a + (m22 * outer[0] - m12 * outer[1]) / determinant
        b = b + (m11 * outer[1] - m12 * outer[0]) / determinant
        return np.stack([v, w, a, b], axis=1).ravel()

    t = np.linspace(0, period, samples)
    y = solve_ivp(rates, (0, period), np.ravel(states), "DOP853", t, rtol=1e-12, atol=1e-13).y
    return y.T.reshape(samples, -1, 4)


STEP = 1e-5  # of central differences: their error is STEP^2 + 1e-12 / STEP
OFFSETS = STEP * np.concatenate([np.eye(4), -np.eye(4)])


def propagator(state, period, **driven):
    """The end of a motion (4,), and its derivatives by the start, (4, 4)."""
    ends = flown(np.concatenate([[state], state + OFFSETS]), period, **driven)[-1]
    return ends[0], (ends[1:5] - ends[5:]).T / (2 * STEP)


def shot(state, period, held):
    """State (4,) and period of the orbit nearby with the same state[held] and no q1_dot.

    Closure has one equation more than unknowns, as energy is constant: least squares, by Newton.
    """
    state = np.array(state, float)
    for _ in range(6):
        end, by_state = propagator(state, period)
        rate = np.array([*end[2:], *accelerations(*end)])
        matrix = np.zeros((6, 5))
        matrix[:4, :4], matrix[:4, 4] = by_state - np.eye(4), rate
        matrix[4, held] = matrix[5, 2] = 1.0
        update = np.linalg.lstsq(matrix, -np.array([*(end - state), 0.0, state[2]]), rcond=1e-9)[0]
        state, period = state + update[:4], period + update[4]
        if np.max(np.abs(update)) < 1e-10:
            return state, period
    raise AssertionError(f"no orbit was found near {state}")


@pytest.fixture(scope="module")
def tongue():
    return backbone_curve(TONGUE, (0.01, 1.0))


def starts(orbits):
    """States at phase 0, (n, 4)."""
    c, k = orbits.coefficients, np.arange(orbits.coefficients.shape[1])
    rate = -orbits.frequency[:, None] * np.einsum("k,nkr->nr", k, c.imag)
    return np.concatenate([np.sum(c.real, axis=1), rate], axis=1)


def test_the_curve_goes_through_a_tongue(tongue):
    first, second = tongue.amplitude.T
    (fold,) = tongue.folds
    (crossing,) = tongue.crossings
    assert tongue.stop_reason == "amplitude reached 1 [q]" and fold < crossing
    # Up to the fold mostly mode 1, in the tongue only q2, and then mode 1 again, faster.
    assert first[fold] == np.max(first[:crossing]) and second[fold] < 0.2 * first[fold]
    assert first[crossing] < 0.1 * second[crossing]
    third = tongue.coefficients[:, 3, 1].real
    side = np.sign(third)
    assert side[fold] == -1 and np.all(side[crossing:] == 1)  # in phase, then against it
    np.testing.assert_allclose(first[-1], 1.0, rtol=1e-2)
    assert second[-1] < 0.02 and tongue.frequency[-1] > 1.2
    np.testing.assert_allclose(tongue.negative_damping, 0.0, atol=1e-12)
    assert np.all(tongue.residual <= 1e-8)


def largest(motion):
    """Largest values over a period, by a parabola through three samples (n, 2)."""
    values = motion[:-1]  # the last is the first one again
    top, each = np.argmax(values, axis=0), np.arange(2)
    before, at, after = (values[(top + k) % len(values), each] for k in (-1, 0, 1))
    return at + (after - before) ** 2 / (8 * (2 * at - before - after))


@pytest.mark.slow
def test_orbits_in_the_tongue_are_those_of_shooting(tongue):
    (fold,), (crossing,) = tongue.folds, tongue.crossings
    states, frequency = starts(tongue), tongue.frequency
    sampled = [5, fold - 5, fold + 2, (fold + crossing) // 2, crossing - 8, crossing + 18]
    sampled += [crossing + 26, len(tongue) - 5]
    for i in sampled:
        held = int(np.argmax(np.abs(states[i + 1] - states[i - 1])[:2]))
        nearby = states[i] * (1 + 1e-4 * (np.arange(4) != held))
        state, period = shot(nearby, 2 * np.pi / frequency[i] * (1 + 1e-5), held)
        # Harmonics leave 1e-8 of the force, and less in q; integration and shooting add 1e-11.
        np.testing.assert_allclose(2 * np.pi / period, frequency[i], rtol=1e-9)
        motion = flown(state, period, samples=2001)[:, 0, :2]
        amplitude = (largest(motion) + largest(-motion)) / 2
        # A parabola through samples of q2, 667 a cycle, is good to their distance^4: 1e-8.
        np.testing.assert_allclose(amplitude, tongue.amplitude[i], rtol=1e-6)
        _, q = tongue.motion(i, 2001)
        np.testing.assert_allclose(motion, q, atol=1e-9 * tongue.amplitude[i].max())


def test_multipliers_are_those_of_integrated_deviations(tongue):
    (fold,), (crossing,) = tongue.folds, tongue.crossings
    for i in (5, fold, crossing - 8, crossing + 18, crossing + 26, len(tongue) - 1):
        own = propagator(starts(tongue)[i], 2 * np.pi / tongue.frequency[i])[1]
        found = np.linalg.eigvals(own)
        assert tongue.multipliers.shape == (len(tongue), 4)
        np.testing.assert_array_equal(tongue.multipliers[i, 2:], 1.0)
        # Their sum, as the double 1 among the integrated ones is good to the root of 1e-7 only.
        np.testing.assert_allclose(np.sum(tongue.multipliers[i]), np.sum(found), atol=1e-5)
        np.testing.assert_allclose(np.prod(tongue.multipliers[i]), 1.0, atol=1e-6)
        c = tongue.coefficients[i : i + 1]
        series = np.zeros((1, 2 * c.shape[1] - 1, 2))
        series[:, 0], series[:, 1::2], series[:, 2::2] = c.real[:, 0], c.real[:, 1:], -c.imag[:, 1:]
        (ours,) = monodromy(TONGUE, series, tongue.frequency[i : i + 1])
        scale = np.repeat([1.0, tongue.frequency[i]], 2)  # of velocities, from those by the phase
        np.testing.assert_allclose(ours * scale[:, None] / scale, own, atol=1e-5)


def test_stability_changes_where_the_energy_turns_back(tongue):
    """Orbits of three times the period meet those of mode 2 as unstable ones, from both sides."""
    (crossing,) = tongue.crossings
    kinds = [(b.kind, b.index) for b in tongue.bifurcations]
    assert [kind for kind, _ in kinds] == ["fold", "fold"]
    (_, low), (_, high) = kinds
    assert low < crossing < high
    assert np.all(tongue.stable[:low]) and np.all(tongue.stable[high + 1 :])
    assert not np.any(tongue.stable[low + 1 : high])
    states = starts(tongue)
    energy = TONGUE.energy(states[:, :2], states[:, 2:])
    for turn, rises in ((low, False), (high, True)):
        np.testing.assert_array_equal(np.diff(energy[turn - 3 : turn]) > 0, not rises)
        np.testing.assert_array_equal(np.diff(energy[turn + 1 : turn + 4]) > 0, rises)


def test_an_even_resonance_ends_on_the_other_mode():
    """q1 cos(t) and q2 cos(2 t): half a period later, the same orbits again."""
    model = CoupledModel.from_coefficients(
        {
            "omega^2 [q1]": 1.0,
            "omega^2 [q2]": 4.3,
            "gamma_3 [q1]": 1.0,
            "V q1^2 q2": 0.1,
            "V q1^2 q2^2": 1.5,
        }
    )
    curve = backbone_curve(model, (0.01, 1.0), n_points=40)
    assert "of an even multiple of its frequency" in curve.stop_reason
    assert len(curve.folds) == 1
    assert curve.amplitude[-1, 0] < 0.1 * curve.amplitude[-1, 1]
    # The orbits of q2 alone are linear.
    np.testing.assert_allclose(2 * curve.frequency[-1], np.sqrt(4.3), rtol=1e-3)


def test_a_branch_that_goes_over_to_another_mode_says_so():
    # q2 is linear: in the tongue its amplitude has no bound, while q1 stays where 3 omega is right.
    model = CoupledModel.from_coefficients(
        {"omega^2 [q1]": 1.0, "omega^2 [q2]": 10.0, "gamma_3 [q1]": 1.0, "V q1^3 q2": 0.03}
    )
    curve = backbone_curve(model, (0.01, 0.45), n_harmonics=9)
    assert curve.stop_reason.startswith("q2 moves 3 times as far as the last amplitude")


# -- linear and driven motion -----------------------------------------------------------------


def test_two_equal_masses_move_together_or_against_each_other():
    """Springs q + q^3 to either wall: together as one alone; between them, one more spring."""
    model = CoupledModel.from_coefficients(
        {**on(1, {"omega^2": 1.0, "gamma_3": 1.0}), **on(2, {"omega^2": 1.0, "gamma_3": 1.0})}
        | {"omega^2 [q1 - q2]": 0.5, "gamma_3 [q1 - q2]": 0.2}
    )
    together, against = (
        backbone_curve(model, (0.01, 1.0), mode=mode, n_points=15) for mode in (1, 2)
    )
    alone = ReducedModel.from_coefficients({"omega^2": 1.0, "gamma_3": 1.0})
    # Against each other q1 - q2 = 2 q1, so that the spring between adds 2 * 0.5 and 8 * 0.2.
    stiffer = ReducedModel.from_coefficients({"omega^2": 2.0, "gamma_3": 2.6})
    for curve, single in ((together, alone), (against, stiffer)):
        np.testing.assert_allclose(curve.amplitude[:, 0], curve.amplitude[:, 1], rtol=1e-9)
        expected = single.backbone(curve.amplitude[:, 0])
        np.testing.assert_allclose(curve.frequency, expected, rtol=1e-9)


def test_linear_response_is_the_closed_form():
    model = CoupledModel.from_coefficients(
        {
            "omega^2 [q1]": 1.0,
            "omega^2 [q2]": 4.0,
            "omega^2 [q1 - q2]": 0.3,
            "c_linear [q1]": 0.05,
            "C_12": 0.02,
            "c_linear [q2]": 0.1,
        }
    )
    force = np.array([0.3, -0.2])
    response = forced_response(model, force, (0.8, 2.5), n_points=60)
    stiffness = np.array([[1.3, -0.3], [-0.3, 4.3]])
    damping = np.array([[0.05, 0.02], [0.02, 0.1]])
    w = response.frequency[:, None, None]
    dynamic = stiffness - w**2 * np.eye(2) + 1j * w * damping
    gain = np.linalg.solve(dynamic, np.broadcast_to(force[:, None], (len(w), 2, 1)))[..., 0]
    # Linear equations are solved to rounding, and the closed form is exact.
    np.testing.assert_allclose(response.coefficients[:, 1], gain, rtol=1e-9)
    np.testing.assert_allclose(response.amplitude, np.abs(gain), rtol=1e-9)
    assert np.all(response.stable)
    lines = str(response).splitlines()
    assert "a force of 0.3 and -0.2" in lines[0] and "amplitude q2 [[q]]" in lines[1]
    # The same through an input, which pushes both.
    gains = {"gain [force] [q1]": 3.0, "gain [force] [q2]": -2.0}
    driven = CoupledModel.from_coefficients({**model.coefficients, **gains})
    same = forced_response(driven, 0.1, (0.8, 2.5), n_points=60)
    np.testing.assert_allclose(same.coefficients, response.coefficients, rtol=1e-9, atol=1e-12)
    with pytest.raises(ValueError, match=r"force = .* has the shape \(2,\): give a number"):
        forced_response(driven, force, (0.8, 2.5))


@pytest.mark.slow
def test_driven_orbits_and_multipliers_are_what_integration_finds():
    damping = (0.03, 0.06)
    driven = CoupledModel.from_coefficients(
        TONGUE.coefficients | {"c_linear [q1]": damping[0], "c_linear [q2]": damping[1]}
    )
    response = forced_response(driven, [0.02, 0.01], (0.8, 1.25), n_points=80)
    assert len(response.folds) >= 2 and response.multipliers.shape == (len(response), 4)
    states = starts(response)
    for i in np.linspace(3, len(response) - 3, 5).astype(int):
        omega = response.frequency[i]
        drive = {"damping": damping, "force": (0.02, 0.01), "omega": omega}
        period = 2 * np.pi / omega
        _, q = response.motion(i, 101)
        motion = flown(states[i], period, samples=101, **drive)[:, 0, :2]
        # Harmonics leave 1e-8 of the force; unstable orbits make the most of it.
        np.testing.assert_allclose(motion, q, atol=1e-6)
        found = np.linalg.eigvals(propagator(states[i], period, **drive)[1])
        distance = np.abs(found[:, None] - response.multipliers[i])
        # Magnus steps of a 256th of the period, in which q2 moves thrice, are good to 1e-6.
        np.testing.assert_allclose(np.min(distance, axis=0), 0.0, atol=1e-5)


def test_damping_in_proportion_changes_no_normal_mode(tongue):
    """c q_dot on both coordinates is balanced by mu = c, in the tongue too."""
    damped = CoupledModel.from_coefficients({**TONGUE.coefficients, "C_11": 0.05, "C_22": 0.05})
    curve = backbone_curve(damped, (0.01, 1.0), method="phase resonance")
    # Newton's last update squared; mu has the unit of omega_1 = 1.
    np.testing.assert_allclose(curve.negative_damping, 0.05, atol=1e-9)
    for fold, other in zip(curve.folds, tongue.folds, strict=True):
        np.testing.assert_allclose(curve.frequency[fold], tongue.frequency[other], rtol=1e-7)


# -- the equations behind ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["from rest", "through zero", "forced"])
def test_jacobians_are_differences(kind):
    damped = CoupledModel.from_coefficients(
        {**TONGUE.coefficients, "V q1^2 q2": 0.3, "C_12 q1": 0.2, "c_quadratic [q2]": 0.1}
    )
    balance = HarmonicBalance(damped, 3)
    u = 0.3 * np.random.default_rng(0).normal(size=14)
    if kind == "forced":
        family = ForcedFamily(balance, Sweep((0.9, 1.2), ([0.1, 0.2], [0.3, 0.1])), 0.4)
    else:
        family = FreeFamily(balance, 1.1, 1.5, 1, from_rest=kind == "from rest")
        u = np.append(u, [1.1, 0.02])
    slopes = differences(lambda z: family.residual(z[:-1], z[-1]), np.append(u, 0.7))
    # Differences of size 1e-6, and the corners of |q_dot| q_dot.
    np.testing.assert_allclose(family.jacobian(u, 0.7), slopes, atol=1e-6)


def test_bad_input_is_refused():
    single = ReducedModel.from_coefficients(FIRST)
    with pytest.raises(ValueError, match="mode = 2 is none of a model of one coordinate: give 1"):
        backbone_curve(single, (0.1, 1.0), mode=2)
    for mode in (0, 3, 1.5, True):
        with pytest.raises(ValueError, match=rf"mode = {mode} is none of the modes 1 to 2"):
            backbone_curve(UNCOUPLED, (0.1, 1.0), mode=mode)
    with pytest.raises(ValueError, match="must be two increasing positive numbers"):
        backbone_curve(UNCOUPLED, (1.0, 0.1))
    with pytest.raises(ValueError, match=r"force = 0.1 has the shape \(\): give 2 numbers, one"):
        forced_response(UNCOUPLED, 0.1, (1.0, 2.0))
    with pytest.raises(ValueError, match=r"has the shape \(3,\): give 2 numbers"):
        forced_response(UNCOUPLED, [0.1, 0.2, 0.3], (1.0, 2.0))
    with pytest.raises(ValueError, match=re.escape("has the shape (2,): give a number")):
        forced_response(single, [0.1, 0.2], (1.0, 2.0))
    for force in ([0.0, 0.0], [np.nan, 1.0]):
        with pytest.raises(ValueError, match="must be finite, and not all of it zero"):
            forced_response(UNCOUPLED, force, (1.0, 2.0))
    unstable = CoupledModel.from_coefficients({"omega^2 [q1]": 1.0, "omega^2 [q2]": -1.0})
    with pytest.raises(ValueError, match="measure q from a stable position of rest"):
        backbone_curve(unstable, (0.1, 1.0))
    rubbing = CoupledModel.from_coefficients({**UNCOUPLED.coefficients, "c_coulomb [q2]": 0.1})
    with pytest.raises(ValueError, match="jumps: give velocity_scale"):
        backbone_curve(rubbing, (0.1, 1.0), method="phase resonance")


def test_a_line_for_each_coordinate():
    """What is drawn is what the curve holds; each line and the folds are named once."""
    curve = backbone_curve(
        CoupledModel.from_coefficients(
            {"omega^2 [q1]": 1.0, "omega^2 [q2]": 7.0, "V q1^2 q2": 0.1}
        ),
        amplitude=(0.01, 0.3),
        n_points=10,
    )
    ax = plot_branch(curve)
    assert ax.get_legend_handles_labels()[1] == ["backbone curve, q1", "backbone curve, q2"]
    for line, amplitude in zip(ax.lines, curve.amplitude.T, strict=True):
        np.testing.assert_array_equal(line.get_ydata(), amplitude)


def test_a_forced_line_for_each_coordinate():
    """What is drawn is what the response holds, stable and unstable; names stand once."""
    model = CoupledModel.from_coefficients(
        {"omega^2 [q1]": 36.0, "omega^2 [q2]": 150.0, "gamma_3 [q1]": 40.0, "V q1^2 q2": 5.0}
        | {"c_linear [q1]": 0.1, "c_linear [q2]": 0.3}
    )
    response = forced_response(model, force=[0.3, 0.1], frequency=(5.0, 8.0), n_points=80)
    ax = plot_forced_response(response)
    force = r"0.3 and 0.1 [q]/s$^2$,"
    names = [f"{force} q{i} {how}" for i in (1, 2) for how in ("stable", "unstable")]
    assert ax.get_legend_handles_labels()[1] == [*names, "fold"]
    for i, amplitude in enumerate(response.amplitude.T):
        own = [line for line in ax.lines if line.get_color() == f"C{i}"]
        drawn = np.concatenate([line.get_ydata() for line in own])
        assert {*amplitude} == {*drawn}
