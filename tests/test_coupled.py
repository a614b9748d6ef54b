"""Models of several coordinates, against Lagrange's equations and models of one coordinate."""

import itertools
import pickle

import numpy as np
import pytest
import sympy

from romsindy import CoupledModel, EscapeError, ReducedModel, SingularInertiaError
from romsindy.effects.choices import KINDS, candidates
from romsindy.fit.coupled.identify import state_before
from romsindy.physics.coupling import Along, MixedDamping, MixedStiffness, SlavedInertia
from romsindy.physics.damping import PowerDamping
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term_sum import term_from_key

FIRST = {"omega^2": 36.0, "gamma_2": -3.0, "gamma_3": 9.0, "Upsilon_3": 0.4, "c_linear": 0.05}
SECOND = {"omega^2": 150.0, "gamma_3": 20.0, "c_quadratic": 0.2, "c_q^2 q_dot": 0.3}
COUPLING = {
    "V q1^2 q2": 5.0,
    "V q1^2 q2^2": -2.0,
    "g(q1^2)^2": 0.11,
    "g(q1^2) g(q1 q2)": 0.07,
    "g(q1 q2)^2": 0.23,
    "g(q1 q2) g(q2^2)": -0.05,
    "g(q2^2)^2": 0.3,
    "C_12": 0.02,
    "C_22 q1^2": 0.4,
    "c_linear [q1 - 0.5 q2]": 0.03,
}


def on(coordinate, coefficients):
    return {f"{name} [q{coordinate}]": value for name, value in coefficients.items()}


UNCOUPLED = CoupledModel.from_coefficients({**on(1, FIRST), **on(2, SECOND)}, unit="m")
COUPLED = CoupledModel.from_coefficients({**UNCOUPLED.coefficients, **COUPLING}, unit="m")


def motion(seed, *shape):
    return 0.4 * np.random.default_rng(seed).normal(size=(3, *shape, 2))


def test_uncoupled_coordinates_are_models_of_one():
    q, q_dot, q_ddot = motion(1, 50)
    found = UNCOUPLED.linearise(q, q_dot, q_ddot)
    for i, coefficients in enumerate((FIRST, SECOND)):
        single = ReducedModel.from_coefficients(coefficients)
        alone = single.linearise(q[:, i], q_dot[:, i], q_ddot[:, i])
        np.testing.assert_array_equal(found[0][:, i], alone[0])
        for ours, theirs in zip(found[1:], alone[1:], strict=True):
            np.testing.assert_array_equal(ours[:, i, i], theirs)
            np.testing.assert_array_equal(ours[:, i, 1 - i], 0.0)
    # Two integrations with their own steps: each is good to some 1e3 times its tolerance.
    t = np.arange(0, 10, 0.01)
    both = UNCOUPLED.simulate([0.5, 0.2], [0.0, 1.0], t, rtol=1e-12)
    for i, (c, q0, v0) in enumerate(((FIRST, 0.5, 0.0), (SECOND, 0.2, 1.0))):
        alone = ReducedModel.from_coefficients(c).simulate(q0, v0, t, rtol=1e-12)
        np.testing.assert_allclose(both.q[:, i], alone.q, atol=1e-9)
        np.testing.assert_allclose(both.q_ddot[:, i], alone.q_ddot, atol=1e-7)


def test_the_state_before_is_where_the_motion_came_from():
    """Through every kind of damping there is; with two integrations at 1e-10."""
    start = np.array([0.5, 0.2, 0.0, 1.0])
    seen = COUPLED.simulate(start[:2], start[2:], np.linspace(0, 5.0, 500))
    end = np.concatenate([seen.q[-1], seen.q_dot[-1]])
    np.testing.assert_allclose(state_before(COUPLED, end, 5.0), start, atol=1e-6)
    np.testing.assert_array_equal(state_before(COUPLED, end, 0.0), end)


def test_equations_are_those_of_lagrange():
    """Potential and kinetic energy written down by hand, and derived by sympy."""
    t = sympy.symbols("t")
    q = [sympy.Function(f"q{i}")(t) for i in (1, 2)]
    v = [x.diff(t) for x in q]
    names = list(COUPLING)
    g = {name: COUPLING[name] for name in names if name.startswith("g")}
    rates = {"q1^2": sympy.diff(q[0] ** 2, t), "q1 q2": sympy.diff(q[0] * q[1], t)}
    rates["q2^2"] = sympy.diff(q[1] ** 2, t)
    slaved = (
        g["g(q1^2)^2"] * rates["q1^2"] ** 2 / 2
        + g["g(q1 q2)^2"] * rates["q1 q2"] ** 2 / 2
        + g["g(q2^2)^2"] * rates["q2^2"] ** 2 / 2
        + g["g(q1^2) g(q1 q2)"] * rates["q1^2"] * rates["q1 q2"]
        + g["g(q1 q2) g(q2^2)"] * rates["q1 q2"] * rates["q2^2"]
    )
    kinetic = (v[0] ** 2 * (1 + 0.4 * q[0] ** 2) + v[1] ** 2) / 2 + slaved
    potential = (
        36 * q[0] ** 2 / 2
        - q[0] ** 3
        + 9 * q[0] ** 4 / 4
        + 150 * q[1] ** 2 / 2
        + 5 * q[1] ** 4
        + 5 * q[0] ** 2 * q[1]
        - 2 * q[0] ** 2 * q[1] ** 2
    )
    along = v[0] - v[1] / 2
    damping = [
        0.05 * v[0] + 0.02 * v[1] + 0.03 * along,
        0.2 * sympy.Abs(v[1]) * v[1]
        + 0.3 * q[1] ** 2 * v[1]
        + 0.02 * v[0]
        + 0.4 * q[0] ** 2 * v[1]
        - 0.015 * along,
    ]
    lagrangian = kinetic - potential
    state = sympy.symbols("x1 x2 y1 y2 z1 z2", real=True)
    at = dict(
        zip([x.diff(t, 2) for x in q] + v + q, [*state[4:], *state[2:4], *state[:2]], strict=True)
    )
    equations = [
        (lagrangian.diff(b).diff(t) - lagrangian.diff(a) + d).subs(at)
        for a, b, d in zip(q, v, damping, strict=True)
    ]
    theirs = sympy.lambdify(state, equations)
    signals = motion(2, 40)
    expected = np.array(theirs(*(x[:, i] for x in signals for i in (0, 1)))).T
    found = COUPLED.residual(*signals)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_a_fast_mode_that_is_dragged_along_makes_six_products_of_inertia():
    """g = a q1^2 + b q1 q2 + c q2^2 has the energy (dg/dt)^2/2, and is pulled by its d^2g/dt^2."""
    a, b, c = 0.3, -0.4, 0.2
    shapes, values = ((2,), (1, 1), (0, 2)), (a, b, c)
    pairs = list(itertools.combinations_with_replacement(range(3), 2))
    terms = [SlavedInertia(shapes[i], shapes[j]) for i, j in pairs]
    assert {*terms} == {t for t in candidates(2, KINDS[0]) if isinstance(t, SlavedInertia)}
    unit = Along.coordinate(Stiffness(1), 2)
    model = CoupledModel((unit, *terms), (0.0, *(values[i] * values[j] for i, j in pairs)))
    q, q_dot, q_ddot = motion(7, 40)
    bent = np.array([[2 * a, b], [b, 2 * c]])  # of g = q . bent q / 2
    slope = q @ bent
    g_ddot = np.sum(slope * q_ddot + (q_dot @ bent) * q_dot, axis=1)
    expected = q_ddot + slope * g_ddot[:, None]
    np.testing.assert_allclose(model.residual(q, q_dot, q_ddot), expected, atol=1e-14)
    energy = (np.sum(q_dot**2, axis=1) + np.sum(slope * q_dot, axis=1) ** 2) / 2
    np.testing.assert_allclose(model.energy(q, q_dot), energy, atol=1e-14)


def test_derivatives_are_those_of_differences():
    signals = list(motion(3, 20))
    found = COUPLED.linearise(*signals)[1:]
    step = 1e-6
    for slopes, which in zip(found, range(3), strict=True):
        for j in range(2):
            ends = []
            for side in (1, -1):
                moved = [x.copy() for x in signals]
                moved[which][:, j] += side * step
                ends.append(COUPLED.residual(*moved))
            # Differences of size 1e-6: their error is about 1e-10 of the largest value, 100.
            np.testing.assert_allclose(slopes[..., j], (ends[0] - ends[1]) / (2 * step), atol=1e-7)


def test_forces_are_reciprocal_and_inertia_is_positive():
    q, _, _ = motion(4, 30)
    zero = np.zeros_like(q)
    _, slope, _, inertia = COUPLED.undamped().linearise(q, zero, zero)
    # One coefficient stands in both equations: equal but for the order of sums.
    np.testing.assert_allclose(slope, slope.swapaxes(1, 2), rtol=1e-14, atol=1e-13)
    np.testing.assert_array_equal(inertia, inertia.swapaxes(1, 2))
    np.testing.assert_array_equal(inertia, COUPLED.inertia(q))
    assert np.linalg.eigvalsh(inertia).min() > 0.9


@pytest.mark.slow
def test_energy_is_constant_without_damping_and_falls_by_the_work_of_damping():
    t = np.arange(0, 20, 0.002)
    free = COUPLED.undamped().simulate([0.5, 0.2], [0.0, 0.3], t, rtol=1e-12)
    energy = COUPLED.energy(free.q, free.q_dot)
    assert np.ptp(energy) < 1e-9 * energy[0]
    lossy = COUPLED.simulate([0.5, 0.2], [0.0, 0.3], t, rtol=1e-12)
    power = np.sum(COUPLED.damping(lossy.q, lossy.q_dot) * lossy.q_dot, axis=1)
    lost = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(t))])
    energy = COUPLED.energy(lossy.q, lossy.q_dot)
    # The trapezoid rule at 250 samples a cycle: 1e-4 of what is lost.
    np.testing.assert_allclose(energy + lost, energy[0], atol=1e-4 * lost[-1])


def test_linear_modes_are_those_of_two_masses_on_three_springs():
    # Unit masses, unit springs to either wall and between: omega^2 = 1 and 3.
    keys = {"omega^2 [q1]": 1.0, "omega^2 [q2]": 1.0, "omega^2 [q1 - q2]": 1.0}
    omega, modes = CoupledModel.from_coefficients(keys).linear_modes
    np.testing.assert_allclose(omega**2, [1.0, 3.0], rtol=1e-14)
    np.testing.assert_allclose(modes, np.array([[1, 1], [1, -1]]) / np.sqrt(2), atol=1e-14)


@pytest.mark.parametrize("key", list(COUPLED.coefficients))
def test_names_and_json_give_the_term_back(key):
    term = term_from_key(key)
    assert term.key == key
    again = CoupledModel.from_json(COUPLED.to_json())
    assert again == COUPLED and pickle.loads(pickle.dumps(COUPLED)) == COUPLED


def test_text():
    model = CoupledModel.from_coefficients(
        {
            "omega^2 [q1]": 36.0,
            "omega^2 [q2]": 144.0,
            "V q1^2 q2": 5.0,
            "g(q1 q2)^2": 2.0,
            "c_linear [q1 - 0.5 q2]": 0.25,
        },
        unit="mm",
        amplitude_range=(0.1, 2.0),
    )
    assert str(model) == (
        "q1_ddot + 36 q1 + 10 q1 q2"
        " + 2 (q2^2 q1_ddot + q1 q2 q2_ddot + 2 q2 q1_dot q2_dot)"
        " + 0.25 (q1_dot - 0.5 q2_dot) = 0\n"
        "q2_ddot + 144 q2 + 5 q1^2"
        " + 2 (q1 q2 q1_ddot + q1^2 q2_ddot + 2 q1 q1_dot q2_dot)"
        " - 0.125 (q1_dot - 0.5 q2_dot) = 0    (q in mm, t in s)\n"
        "  omega^2 [q1]                     36  1/s^2           mode 1: 6 rad/s, 0.95493 Hz\n"
        "  omega^2 [q2]                    144  1/s^2           mode 2: 12 rad/s, 1.9099 Hz\n"
        "  V q1^2 q2                         5  1/(mm s^2)\n"
        "  g(q1 q2)^2                        2  1/mm^2\n"
        "  c_linear [q1 - 0.5 q2]         0.25  1/s\n"
        "  from amplitudes 0.1 to 2 mm"
    )
    first, second = model.latex().split(" \\\\\n")
    assert first.startswith(r"\ddot{q}_1 + 36 \, q_1 + 10 \, q_1 q_2") and "&= 0" in first
    assert r"- 0.125 \, (\dot{q}_1 - 0.5 \dot{q}_2)" in second


def test_undamped_and_regularised():
    rubbing = CoupledModel.from_coefficients(
        {"omega^2 [q1]": 1.0, "omega^2 [q2]": 4.0, "c_coulomb [q2]": 0.1, "C_12": 0.2}
    )
    assert list(rubbing.undamped().coefficients) == ["omega^2 [q1]", "omega^2 [q2]"]
    with pytest.raises(ValueError, match=r"c_coulomb \[q2\] jumps: give model.regularised"):
        rubbing.simulate([1.0, 0.0], [0.0, 0.0], np.arange(0, 1, 0.1))
    smooth = rubbing.regularised(0.01)
    force = smooth.damping([0.0, 0.0], [0.0, 0.005])
    np.testing.assert_allclose(force, [0.2 * 0.005, 0.1 * np.tanh(0.5)], rtol=1e-14)


def test_what_cannot_be():
    with pytest.raises(ValueError, match=r"\['omega\^2'\] do not say which coordinate"):
        CoupledModel.from_coefficients({"omega^2": 1.0})
    with pytest.raises(ValueError, match="of several coordinates: use CoupledModel"):
        ReducedModel.from_coefficients({"omega^2 [q1]": 1.0})
    with pytest.raises(ValueError, match=r"'V_q1' is not known.* with \[q1\] behind it"):
        CoupledModel.from_coefficients({"V_q1": 1.0})
    with pytest.raises(ValueError, match="weights are all zero"):
        Along(Stiffness(1), (0.0, 0.0))
    with pytest.raises(ValueError, match="has a direction already"):
        Along(Along.coordinate(Stiffness(1), 1), (1.0,))
    with pytest.raises(ValueError, match="sum of at least 2"):
        MixedStiffness((1,))
    with pytest.raises(ValueError, match="whole numbers"):
        SlavedInertia((1.5, 1), (2,))
    with pytest.raises(ValueError, match="row = 0"):
        MixedDamping(0, 1)
    with pytest.raises(ValueError, match="last axis must hold the 2 coordinates"):
        COUPLED.stiffness([1.0, 2.0, 3.0])
    unstable = CoupledModel.from_coefficients({"omega^2 [q1]": -1.0, "gamma_3 [q1]": -1.0})
    with pytest.raises(ValueError, match="measure q from a stable position"):
        unstable.linear_modes  # noqa: B018
    with pytest.raises(EscapeError, match="from q = 1, q_dot = 0 cannot be followed"):
        unstable.simulate([1.0], [0.0], np.arange(0, 20, 0.1))
    singular = CoupledModel.from_coefficients({"omega^2 [q1]": 1.0, "Upsilon_3 [q1]": -1.0})
    with pytest.raises(SingularInertiaError, match=r"not positive definite at q = \[1.2\]"):
        singular.acceleration([1.2], [0.0])


def test_a_damper_between_two_coordinates_does_nothing_when_they_move_together():
    between = CoupledModel((Along(PowerDamping(2), (1.0, -1.0)),), (3.0,))
    np.testing.assert_allclose(between.damping([0.1, 0.1], [2.0, 2.0]), 0.0, atol=1e-15)
    np.testing.assert_allclose(between.damping([0.1, 0.1], [2.0, 0.0]), [12.0, -12.0])
