import math
import re

import numpy as np
import pytest
from oracles import ORDER_5, ORDER_9, differences, duffing_frequency
from scipy.integrate import odeint, solve_ivp

from romsindy import ContinuationError, ReducedModel, backbone_curve, forced_response
from romsindy.orbits.harmonic_balance import (
    ForcedFamily,
    FreeFamily,
    HarmonicBalance,
    Sweep,
    floquet_multipliers,
)
from romsindy.physics.example import EXAMPLE_MODEL

DUFFING = {"omega^2": 1.0, "gamma_3": 1.0}
CASES = {
    "duffing": (DUFFING, (0.01, 2.9)),
    "order 5": (ORDER_5, (1e-4, 0.022)),
    "order 9": (ORDER_9, (1e-4, 0.022)),
    "example": (EXAMPLE_MODEL.undamped().coefficients, (1e-3, 1.8)),
    "beam theory": ({"omega^2": 36.0, "gamma_3": 9.0, "beta_1": 0.3, "beta_2": 0.1}, (0.01, 1.5)),
}


def model(coefficients):
    return ReducedModel.from_coefficients(coefficients)


def exact(coefficients, amplitude):
    if coefficients is DUFFING:
        return duffing_frequency(1.0, 1.0, amplitude)
    return model(coefficients).backbone(amplitude)


def integrated(equation, q0, v0, t, force=0.0, omega=1.0, mu=0.0):
    """q and q_dot of the model under force cos(omega t) + mu q_dot, by LSODA."""

    def rates(y, s):
        outer = force * np.cos(omega * s) + mu * y[1]
        return y[1], equation.acceleration(*y) + outer / equation.inertia(y[0])

    return odeint(rates, [q0, v0], t, rtol=1e-11, atol=1e-13, mxstep=10000).T


def state(orbits, index):
    """q and q_dot at t = 0."""
    c, k = orbits.coefficients[index], np.arange(orbits.coefficients.shape[1])
    return np.sum(c.real), np.sum(-k * orbits.frequency[index] * c.imag)


# -- backbone curves --------------------------------------------------------------------------


@pytest.mark.parametrize("name", CASES)
def test_backbone_curve_is_exact_with_harmonics_chosen_by_itself(name):
    coefficients, amplitude = CASES[name]
    curve = backbone_curve(model(coefficients), amplitude)
    np.testing.assert_allclose(curve.amplitude[[0, -1]], amplitude, rtol=1e-12)
    # Issue 4 asks for 1e-9; the energy quadrature of the beam-theory model is good to 1e-8.
    rtol = 1e-8 if name == "beam theory" else 1e-9
    np.testing.assert_allclose(curve.frequency, exact(coefficients, curve.amplitude), rtol=rtol)
    assert np.all(np.diff(curve.amplitude) > 0) and len(curve.folds) == 0
    assert np.all(curve.residual <= 1e-8)
    assert curve.stop_reason.startswith("amplitude reached")


@pytest.mark.parametrize("name", ["duffing", "order 5", "order 9"])
@pytest.mark.parametrize("n_harmonics", [3, 5, 11, 21, 41])
def test_backbone_curve_starts_and_ends_with_any_number_of_harmonics(name, n_harmonics):
    coefficients, amplitude = CASES[name]
    curve = backbone_curve(model(coefficients), amplitude, n_harmonics)
    assert curve.coefficients.shape == (len(curve), n_harmonics + 1)
    np.testing.assert_allclose(curve.amplitude[[0, -1]], amplitude, rtol=1e-12)
    # No force is negative damping: the phase is free, and mu only singles one out.
    np.testing.assert_allclose(curve.negative_damping, 0, atol=1e-12 * curve.frequency[0])
    error = np.abs(curve.frequency / exact(coefficients, curve.amplitude) - 1)
    # A force left over in harmonic k is missing in q as 1/k^2 of it; factor k for more of them.
    assert np.all(error <= curve.residual / (n_harmonics + 1) + 1e-11)


def test_backbone_curve_reaches_any_first_amplitude_from_the_linear_mode():
    curve = backbone_curve(model(DUFFING), (2.5, 2.9), n_harmonics=21)
    np.testing.assert_allclose(
        curve.frequency, duffing_frequency(1, 1, curve.amplitude), rtol=1e-12
    )


def test_orbits_are_motions_of_the_model():
    """Asymmetric: mean and even harmonics. Independent: integration over one period."""
    undamped = EXAMPLE_MODEL.undamped()
    curve = backbone_curve(undamped, (0.01, 1.8))
    for index in (0, len(curve) // 2, -1):
        t, q = curve.motion(index)
        np.testing.assert_allclose(
            integrated(undamped, q[0], 0.0, t)[0], q, atol=2e-8 * curve.amplitude[index]
        )
    mean = curve.coefficients[:, 0].real
    # Second-order perturbation: q_0 = -(gamma_2 - ...) a^2 / (2 omega^2), inertia aside.
    np.testing.assert_allclose(mean[0], -2.0 * curve.amplitude[0] ** 2 / 72, rtol=1e-3)


def test_backbone_curve_ends_with_the_well_and_with_the_inertia():
    softening = model({"omega^2": 1.0, "gamma_3": -1.0})
    curve = backbone_curve(softening, (0.01, 1.5))
    assert "restoring force is not positive at the turning point" in curve.stop_reason
    np.testing.assert_allclose(curve.amplitude[-1], 1.0, atol=1e-4)
    inside = curve.amplitude < 0.95
    np.testing.assert_allclose(
        curve.frequency[inside], duffing_frequency(1, -1, curve.amplitude[inside]), rtol=1e-9
    )
    singular = model({"omega^2": 36.0, "gamma_3": -10.0, "Upsilon_3": -1.0})
    curve = backbone_curve(singular, (0.01, 1.5), n_harmonics=21)
    assert "1 + h(q) = " in curve.stop_reason and 0.99 < curve.amplitude[-1] < 1
    with pytest.raises(ContinuationError, match=r"no orbit of amplitude 1\.2 is reached"):
        backbone_curve(softening, (1.2, 1.5))


def test_backbone_curve_ends_at_the_orbit_through_another_position_of_rest():
    """K = q (q + 1) (q + 2) / 2: the potential (q^2 + 2 q)^2 / 8 is 1/8 at q = -1, sqrt(2) - 1."""
    double_well = model({"omega^2": 1.0, "gamma_2": 1.5, "gamma_3": 0.5})
    curve = backbone_curve(double_well, (0.01, 3.0))
    assert curve.stop_reason.startswith("50 harmonics leave more than 1% of the force")
    np.testing.assert_allclose(curve.amplitude[-1], np.sqrt(0.5), rtol=1e-3)
    coarse = backbone_curve(double_well, (0.01, 3.0), n_harmonics=2)
    assert coarse.stop_reason.startswith("the frequency falls to zero")
    fast = curve.frequency > 0.25  # slower ones are beyond the 80 points of the quadrature
    np.testing.assert_allclose(
        curve.frequency[fast], double_well.backbone(curve.amplitude[fast]), rtol=1e-8
    )


def test_phase_resonance_with_viscous_damping_is_the_conservative_backbone():
    damped = model(DUFFING | {"c_linear": 0.05})
    curve = backbone_curve(damped, (0.1, 2.0), method="phase resonance")
    np.testing.assert_allclose(curve.negative_damping, 0.05, rtol=1e-9)
    np.testing.assert_allclose(curve.frequency, duffing_frequency(1, 1, curve.amplitude), rtol=1e-9)


@pytest.mark.parametrize(
    "damping", [{"c_quadratic": 0.05}, {"c_cubic": 0.02}, {"c_q^2 q_dot": 0.05}]
)
def test_phase_resonance_balances_the_loss(damping):
    """The orbit closes when integrated with its negative damping."""
    damped = model(EXAMPLE_MODEL.coefficients | damping)
    curve = backbone_curve(damped, (0.1, 1.0), method="phase resonance", n_points=20)
    t, q = curve.motion(-1)
    motion = integrated(damped, q[0], 0.0, t, mu=curve.negative_damping[-1])[0]
    # |q_dot| q_dot has kinks, whose harmonics fall with the third power only.
    np.testing.assert_allclose(motion, q, atol=1e-5 if "c_quadratic" in damping else 1e-7)


def test_free_orbits_of_one_coordinate_are_as_stable_as_the_loss_grows():
    """Liouville: the multiplier beside 1 is exp of the integral of mu - dD/dq_dot."""
    curve = backbone_curve(model(DUFFING), (0.1, 2.0), n_points=10)
    np.testing.assert_array_equal(curve.multipliers, np.ones((len(curve), 2)))
    assert np.all(curve.stable) and curve.bifurcations == ()
    damped = model(DUFFING | {"c_cubic": 0.02})
    curve = backbone_curve(damped, (0.1, 2.0), method="phase resonance", n_points=10)
    t, q = curve.motion(-1, 2001)
    q_dot = np.gradient(q, t, edge_order=2)
    net = curve.negative_damping[-1] - 3 * 0.02 * q_dot**2
    expected = np.exp(np.sum((net[1:] + net[:-1]) / 2) * (t[1] - t[0]))
    # Differences of 2000 samples a period are good to (3 * 2 pi / 2000)^2 / 6.
    np.testing.assert_allclose(curve.multipliers[-1], [expected, 1.0], rtol=1e-4)


def test_phase_resonance_with_dry_friction():
    """A linear oscillator: 4 c / (pi a omega) does the work of the friction c."""
    c, scale = 0.05, 0.02
    rubbing = model({"omega^2": 1.0, "c_coulomb": c})
    curve = backbone_curve(rubbing, (0.5, 2.0), method="phase resonance", velocity_scale=scale)
    expected = 4 * c / (np.pi * curve.amplitude * curve.frequency)
    # The loss falls short by the square of scale / velocity (pi^2/24 of it, twice).
    np.testing.assert_allclose(curve.negative_damping, expected, rtol=(scale / 0.5) ** 2)
    with pytest.raises(ValueError, match=r"the force sign\(q_dot\) jumps: give velocity_scale"):
        backbone_curve(rubbing, (0.5, 2.0), method="phase resonance")


# -- forced responses -------------------------------------------------------------------------


def test_linear_response_and_multipliers_are_the_closed_form():
    c, omega2, force = 0.1, 4.0, 0.3
    response = forced_response(model({"omega^2": omega2, "c_linear": c}), force, (1.0, 3.0))
    w = response.frequency
    gain = force / (omega2 - w**2 + 1j * c * w)
    np.testing.assert_allclose(response.coefficients[:, 1], gain, rtol=1e-12)
    np.testing.assert_allclose(response.amplitude, np.abs(gain), rtol=1e-12)
    eigenvalue = -c / 2 + 1j * np.sqrt(omega2 - c**2 / 4)
    multiplier = np.exp(2 * np.pi * eigenvalue / w)
    # Magnus steps are exact for constant coefficients.
    np.testing.assert_allclose(np.abs(response.multipliers[:, 0]), np.abs(multiplier), rtol=1e-12)
    np.testing.assert_allclose(
        np.sum(response.multipliers, axis=1), 2 * multiplier.real, atol=1e-10
    )
    assert np.all(response.stable) and response.bifurcations == ()


def monodromy(equation, q0, v0, omega, force):
    """Multipliers by integration of the variational equation, DOP853."""

    def rates(t, y):
        q, v = y[:2]
        a = equation.acceleration(q, v) + force * np.cos(omega * t) / equation.inertia(q)
        _, by_q, by_v, by_a = equation.linearise(q, v, a)
        lower = -(by_q * y[2:4] + by_v * y[4:6]) / by_a
        return [v, a, *y[4:6], *lower]

    y = solve_ivp(
        rates, (0, 2 * np.pi / omega), [q0, v0, 1, 0, 0, 1], "DOP853", rtol=1e-11, atol=1e-12
    ).y[:, -1]
    return np.linalg.eigvals(y[2:].reshape(2, 2))


HARDENING = model(DUFFING | {"c_linear": 0.02})  # zeta = 1 %
FORCE = 0.05


@pytest.fixture(scope="module")
def hardening():
    return forced_response(HARDENING, FORCE, (0.5, 2.5))


def test_duffing_response_has_two_folds_and_an_unstable_part_between(hardening):
    upper, lower = hardening.folds
    assert [(b.kind, b.index) for b in hardening.bifurcations] == [("fold", upper), ("fold", lower)]
    assert hardening.frequency[upper] > 1.2 * hardening.frequency[lower]
    assert np.all(hardening.stable[:upper]) and np.all(hardening.stable[lower + 1 :])
    assert not np.any(hardening.stable[upper + 1 : lower])
    # One multiplier is 1 at a fold; the other is then the contraction, exp(-c T).
    contraction = np.exp(-0.02 * 2 * np.pi / hardening.frequency[hardening.folds])
    np.testing.assert_allclose(hardening.multipliers[hardening.folds, 0], 1, atol=1e-6)
    np.testing.assert_allclose(hardening.multipliers[hardening.folds, 1], contraction, rtol=1e-6)


def test_a_response_says_where_it_is_largest_and_where_it_jumps(hardening):
    """In Hz, in the order of the branch; the part between the folds is unstable."""
    response = hardening
    lines = str(response).splitlines()
    points = {line.split()[0]: line.split()[1:] for line in lines[2:-1]}
    assert [line.split()[0] for line in lines[2:-1]].count("fold") == 2
    peak = int(np.argmax(response.amplitude))
    assert float(points["largest"][0]) == pytest.approx(
        response.frequency[peak] / (2 * np.pi), rel=1e-4
    )
    assert float(points["largest"][1]) == pytest.approx(response.amplitude.max(), rel=1e-3)
    jumps = sorted(response.frequency[b.index] / (2 * np.pi) for b in response.bifurcations)
    told = [float(x) for x in re.findall(r"[\d.]+", lines[-1])[:2]]
    assert told == pytest.approx(jumps, rel=1e-3)


def test_upper_fold_lies_near_the_backbone(hardening):
    """At phase resonance the force on harmonic 1 does the work that viscous damping takes."""
    curve = backbone_curve(HARDENING, (0.1, 3.0))
    k, size = np.arange(curve.coefficients.shape[1]), np.abs(curve.coefficients)
    force = 0.02 * curve.frequency * np.sum((k * size) ** 2, axis=1) / size[:, 1]
    resonance = np.interp(FORCE, force, curve.frequency)
    # The fold is off by zeta^2, the interpolation by 1e-3.
    np.testing.assert_allclose(hardening.frequency[hardening.folds[0]], resonance, rtol=2e-3)


def test_response_is_what_integration_finds(hardening):
    upper, lower = hardening.folds
    for index in (5, upper // 2, upper - 5, (upper + lower) // 2, lower + 5, len(hardening) - 1):
        omega, (q0, v0) = hardening.frequency[index], state(hardening, index)
        t, q = hardening.motion(index)
        motion = integrated(HARDENING, q0, v0, t, FORCE, omega)
        np.testing.assert_allclose(motion[0], q, atol=1e-7)
        independent = monodromy(HARDENING, q0, v0, omega, FORCE)
        np.testing.assert_allclose(
            np.sort_complex(hardening.multipliers[index]), np.sort_complex(independent), atol=2e-6
        )


def settled_amplitude(omega, q0, v0, periods=300):
    """Half of peak to peak of the last period, by LSODA; the equation is written out by hand."""
    t = 2 * np.pi / omega * np.append(np.arange(periods), periods + np.linspace(0, 1, 257))

    def rates(y, s):
        q, v = y.tolist()
        return v, -0.02 * v - q - q * q * q + FORCE * math.cos(omega * s)

    q = odeint(rates, [q0, v0], t, rtol=1e-9, atol=1e-10, mxstep=10000)[-257:, 0]
    return (q.max() - q.min()) / 2


@pytest.mark.parametrize("fold", [0, 1])
def test_integration_jumps_beyond_the_folds_and_not_before(hardening, fold):
    index = hardening.folds[fold]
    inside = hardening.frequency[index] * (0.998 if fold == 0 else 1.002)
    stable = np.arange(index) if fold == 0 else np.arange(index + 1, len(hardening))
    near = stable[np.argmin(np.abs(hardening.frequency[stable] - inside))]
    q0, v0 = state(hardening, near)
    stays = settled_amplitude(hardening.frequency[near], 1.001 * q0, v0)
    # 256 samples find the peak to (pi / 256)^2 / 2; transients have gone, exp(-0.01 * 300 * 3.8).
    np.testing.assert_allclose(stays, hardening.amplitude[near], rtol=1e-4)
    outside = hardening.frequency[index] * (1.002 if fold == 0 else 0.998)
    jumped = settled_amplitude(outside, *state(hardening, index))
    assert abs(jumped / hardening.amplitude[index] - 1) > 0.3


def test_unstable_orbits_are_left_and_stable_ones_are_kept(hardening):
    upper, lower = hardening.folds
    middle = (upper + lower) // 2
    omega = hardening.frequency[middle]
    q0, v0 = state(hardening, middle)
    ends = [settled_amplitude(omega, q0 + kick, v0) for kick in (-1e-3, 1e-3)]
    stable = [
        np.interp(omega, hardening.frequency[part], hardening.amplitude[part])
        for part in (slice(None, upper), slice(lower + 1, None))
    ]
    # The two kicks lead to the two stable orbits at this frequency, here interpolated linearly.
    np.testing.assert_allclose(sorted(ends), sorted(stable), rtol=5e-3)


def test_falling_frequency_gives_the_same_response(hardening):
    back = forced_response(HARDENING, FORCE, (2.5, 0.5))
    np.testing.assert_allclose(
        back.frequency[back.folds], hardening.frequency[hardening.folds][::-1], rtol=1e-9
    )


def test_asymmetric_response_is_what_integration_finds():
    response = forced_response(EXAMPLE_MODEL, 0.3, (5.0, 7.0))
    for index in (10, int(np.argmax(response.amplitude)), -10):
        t, q = response.motion(index)
        motion = integrated(
            EXAMPLE_MODEL, *state(response, index), t, 0.3, response.frequency[index]
        )
        np.testing.assert_allclose(motion[0], q, atol=1e-6)
    assert np.all(response.residual <= 1e-8)


def test_branch_that_folds_back_to_its_first_frequency_says_so():
    response = forced_response(EXAMPLE_MODEL, 1.0, (5.0, 7.0))
    assert response.stop_reason == "frequency reached 5 rad/s" and len(response.folds) % 2 == 1


def test_start_in_an_undamped_resonance_is_refused():
    with pytest.raises(
        ContinuationError, match=r"no response was found at .* 0\.05 near 0\.5 rad/s: give"
    ):
        forced_response(model(DUFFING), 0.05, (0.5, 1.5))  # 2 * 0.5 is the linear frequency


@pytest.mark.parametrize(
    ("coefficients", "force", "frequency", "kind", "crossed"),
    [
        # The escape equation: Thompson (1989), Proc. R. Soc. A 421, 195.
        (
            {"omega^2": 1.0, "gamma_2": -1.0, "c_linear": 0.1},
            0.1,
            (1.2, 0.7),
            "period doubling",
            -1,
        ),
        # A symmetric Duffing oscillator, driven hard, gives up its symmetry.
        (DUFFING | {"c_linear": 0.2}, 5.0, (0.8, 1.5), "branch point", 1),
    ],
)
def test_bifurcations_are_where_integrated_multipliers_cross(
    coefficients, force, frequency, kind, crossed
):
    equation = model(coefficients)
    response = forced_response(equation, force, frequency)
    found = [b.index for b in response.bifurcations if b.kind == kind]
    assert found
    for index in found:
        largest = [
            (
                monodromy(equation, *state(response, i), response.frequency[i], force) * crossed
            ).real.max()
            for i in (index - 1, index)
        ]
        assert min(largest) < 1 < max(largest)


# -- the equations behind ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["free", "forced"])
def test_jacobians_are_differences(kind):
    damped = model(EXAMPLE_MODEL.coefficients | {"c_quadratic": 0.1, "c_q^2 q_dot": 0.2})
    balance = HarmonicBalance(damped, 4)
    random = np.random.default_rng(0)
    if kind == "free":
        family = FreeFamily(balance, 6.0, 1.5)
        u = np.append(0.1 * random.normal(size=9), [1.1, 0.02])
        u[1] = 1.0
    else:
        family = ForcedFamily(balance, Sweep((5.0, 7.0), (0.5, 0.9)), 0.4)
        u = random.normal(size=9)
    slopes = differences(lambda z: family.residual(z[:-1], z[-1]), np.append(u, 0.7))
    # The quadrature of the kinks of |q_dot| q_dot is differentiated exactly but for its corners.
    np.testing.assert_allclose(family.jacobian(u, 0.7), slopes, atol=1e-6)


def test_orbits_side_by_side_are_those_one_by_one():
    """What is kept of one question is no answer to another of the same numbers."""
    balance = HarmonicBalance(model(EXAMPLE_MODEL.coefficients), 4)
    c = np.random.default_rng(1).normal(size=(1, 9, 1))
    together, alone = balance.linearise(c, np.array([6.0])), balance.linearise(c[0], 6.0)
    for several, one in zip(together, alone, strict=True):
        assert several.shape == (1, *one.shape)
        np.testing.assert_allclose(several[0], one, rtol=1e-12)
    other = balance.residual(c[0], 7.0)
    np.testing.assert_allclose(other, balance.linearise(c[0], 7.0)[0], rtol=1e-12)
    assert np.abs(other - alone[0]).max() > 1.0


def test_magnus_steps_are_of_fourth_order(monkeypatch):
    curve = backbone_curve(EXAMPLE_MODEL.undamped(), (1.0, 1.5), n_harmonics=11)
    c = np.zeros((1, 23))
    c[0, 0], c[0, 1::2] = curve.coefficients[-1, 0].real, curve.coefficients[-1, 1:].real
    traces = []
    for steps in (64, 128, 1024):
        monkeypatch.setattr("romsindy.orbits.harmonic_balance._FEWEST_STEPS", steps)
        monkeypatch.setattr("romsindy.orbits.harmonic_balance._STEPS_PER_HARMONIC", 1)
        multipliers = floquet_multipliers(EXAMPLE_MODEL, c, curve.frequency[-1:])
        traces.append(np.sum(multipliers).real)
    errors = np.abs(np.array(traces[:2]) - traces[2])
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 4, atol=0.3)


def test_bad_input_is_refused():
    duffing = model(DUFFING)
    for amplitude in [(0.0, 1.0), (2.0, 1.0), (1.0, np.inf)]:
        with pytest.raises(ValueError, match="must be two increasing positive numbers"):
            backbone_curve(duffing, amplitude)
    with pytest.raises(ValueError, match="method 'nnm' is not known"):
        backbone_curve(duffing, (0.1, 1.0), method="nnm")
    with pytest.raises(ValueError, match="n_harmonics = 0 must be a positive whole number"):
        backbone_curve(duffing, (0.1, 1.0), 0)
    with pytest.raises(ValueError, match="measure q from a stable position of rest"):
        backbone_curve(model({"omega^2": -1.0, "gamma_3": 1.0}), (0.1, 1.0))
    with pytest.raises(ValueError, match="must be two different positive numbers"):
        forced_response(duffing, 0.1, (1.0, 1.0))
    for frequency in (75, None, (1.0, 2.0, 3.0)):
        with pytest.raises(ValueError, match=r"frequency = .* must be two .* \(from, to\)"):
            forced_response(duffing, 0.1, frequency)
    with pytest.raises(ValueError, match="must be of numbers alone"):
        forced_response(duffing, 0.1, ("a", 2.0))
    with pytest.raises(ContinuationError, match=r"no response .* of 1e\+09 near 1 rad/s: give a"):
        forced_response(duffing, 1e9, (1.0, 2.0))
    for force in (0, np.nan, np.inf, None):
        with pytest.raises(ValueError, match=f"force = {force} must be a finite positive number"):
            forced_response(duffing, force, (1.0, 2.0))
    with pytest.raises(ValueError, match="force = 'x' must be of numbers"):
        forced_response(duffing, "x", (1.0, 2.0))
    with pytest.raises(ValueError, match="n_points = 1 must be at least 2"):
        forced_response(duffing, 0.1, (1.0, 2.0), n_points=1)


def test_a_response_that_was_not_followed_is_told():
    """A Duffing spring between its folds: three responses, from either end one is found."""
    duffing = model({"omega^2": 1.0, "gamma_3": 1.0, "c_linear": 0.02})
    whole = forced_response(duffing, force=0.02, frequency=(0.8, 1.6))
    up, down = (whole.frequency[b.index] for b in whole.bifurcations)
    between = (up + down) / 2
    assert whole.untraced == "" and "Stable everywhere" not in str(whole)
    rising = forced_response(duffing, force=0.02, frequency=(0.8, between))
    assert np.all(rising.stable) and "another response" in rising.untraced
    assert "Stable where it was followed. At" in str(rising)
    falling = forced_response(duffing, force=0.02, frequency=(between, 0.8))
    assert falling.frequency[-1] == pytest.approx(between)
    hertz = falling.frequency.min() / (2 * np.pi)
    assert f"nothing was followed from {hertz:.5g} to {0.8 / 2 / np.pi:.5g} Hz" in falling.untraced
    below = forced_response(duffing, force=0.02, frequency=(0.5, 0.8))
    assert below.untraced == "" and "Stable everywhere." in str(below)
