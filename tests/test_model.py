import pickle

import numpy as np
import pytest
from oracles import (
    duffing_frequency,
    icrom_acceleration,
    integrate,
    viscous_decay,
)

from romsindy import EscapeError, ReducedModel, SingularInertiaError
from romsindy.physics.example import EXAMPLE_MODEL

AMPLITUDES = np.geomspace(0.01, 2.9, 40)


def model(**coefficients):
    names = {"omega2": "omega^2"}
    return ReducedModel.from_coefficients({names.get(k, k): v for k, v in coefficients.items()})


def test_backbone_of_duffing_is_the_elliptic_integral():
    duffing = model(omega2=1.0, gamma_3=1.0)
    # 80 Gauss points give 12 digits (the reference's own remark).
    np.testing.assert_allclose(
        duffing.backbone(AMPLITUDES), duffing_frequency(1.0, 1.0, AMPLITUDES), rtol=1e-11
    )


def test_backbone_of_softening_duffing_and_nan_beyond_its_well():
    softening = model(omega2=1.0, gamma_3=-1.0)
    inside = np.linspace(0.05, 0.9, 10)
    exact = duffing_frequency(1.0, -1.0, inside)
    np.testing.assert_allclose(softening.backbone(inside), exact, rtol=1e-10)
    assert np.all(np.isnan(softening.backbone([1.01, 1.2, 5.0])))
    assert np.all(np.isnan(softening.damping_ratio([1.2])))


def test_backbone_of_bare_cantilever_matches_published_orbits():
    """Reference values of an order-5 IC-ROM of the bare cantilever, harmonic balance."""
    omega2 = 12.3623633683
    cantilever = model(
        omega2=omega2,
        gamma_3=40.44066345,
        Upsilon_3=4.59677250,
        gamma_5=147.96917,
        Upsilon_5=19.747053,
    )
    amplitude = np.array([0.0250019, 0.1001228, 0.1504273, 0.1672608, 0.2522176])
    ratio = np.array([1.00004858, 1.00080851, 1.00192230, 1.00243064, 1.00641656])
    # The table is given to 8 decimals and for the amplitudes of the normal mode.
    np.testing.assert_allclose(cantilever.backbone(amplitude) / omega2**0.5, ratio, atol=2e-8)


def test_backbone_of_an_asymmetric_model_is_what_integration_finds():
    """Independent: turning points and period of the undamped motion by solve_ivp."""

    def undamped(q, v):
        return icrom_acceleration(q, v) + 0.06 * v / (1 + 0.3 * q**2 + 0.1 * q**3 + 0.12 * q**4)

    t = np.linspace(0, 1.3, 130001)
    q, v = integrate(undamped, 1.5, 0.0, t)
    stops = np.flatnonzero(np.diff(np.sign(v[1:])) != 0) + 1
    period = t[stops[1]] + v[stops[1]] / (v[stops[1]] - v[stops[1] + 1]) * (t[1] - t[0])
    amplitude = (1.5 - q.min()) / 2
    np.testing.assert_allclose(
        EXAMPLE_MODEL.backbone([amplitude])[0], 2 * np.pi / period, rtol=1e-8
    )


def test_free_inertia_and_convection_equal_the_tied_pair():
    """q^2 q'' and q q'^2 with the same coefficient are the inertial compensation of order 3."""
    tied = model(omega2=36.0, gamma_3=9.0, Upsilon_3=0.3, c_linear=0.1)
    free = model(omega2=36.0, gamma_3=9.0, beta_1=0.3, beta_2=0.3, c_linear=0.1)
    a = np.linspace(0.1, 1.7, 20)
    # The integrating factor is interpolated by polynomials of degree 120.
    np.testing.assert_allclose(free.backbone(a), tied.backbone(a), rtol=1e-8)
    np.testing.assert_allclose(free.damping_ratio(a), tied.damping_ratio(a), rtol=1e-8)
    np.testing.assert_allclose(free.energy(a, 2 * a), tied.energy(a, 2 * a), rtol=1e-10)


def test_inertia_that_vanishes_just_beyond_the_motion():
    """A negative beta_1, as identified from a cantilever: M = 0 at q = 0.0255, amplitude 0.0215."""
    free = model(omega2=1518.0, gamma_3=-2.212e6, beta_1=-1537.0, beta_2=217.7)
    amplitudes = np.array([0.0035, 0.01, 0.0215, 0.026])
    frequency = free.backbone(amplitudes)
    assert np.isnan(frequency[-1])  # beyond
    t = np.linspace(0, 0.2, 20_001)
    for a, omega in zip(amplitudes[:3], frequency[:3], strict=True):
        q, _ = integrate(lambda q, v: float(free.acceleration(q, v)), a, 0.0, t)
        falling = np.flatnonzero((q[:-1] > 0) & (q[1:] <= 0))[0]
        quarter = np.interp(0.0, -q[falling : falling + 2], t[falling : falling + 2])
        assert np.pi / (2 * quarter) == pytest.approx(omega, rel=1e-6)  # chords of 1e-5 s


@pytest.mark.parametrize("beta_2", [0.3, 0.1, -0.2])
def test_energy_is_conserved_without_damping(beta_2):
    free = model(omega2=36.0, gamma_2=2.0, gamma_3=9.0, beta_1=0.3, beta_2=beta_2)
    motion = free.simulate(1.5, 0.5, np.linspace(0, 20, 4001), rtol=1e-12)
    energy = free.energy(motion.q, motion.q_dot)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)


def test_damping_ratio_closed_forms():
    """Work of the damping over a cycle of a linear oscillator, by hand."""
    omega, a = 6.0, np.array([0.2, 1.0])
    ratio = {
        "c_linear": 1 / (2 * omega) * np.ones(2),
        "c_quadratic": 4 * a / (3 * np.pi),
        "c_coulomb": 2 / (np.pi * a * omega**2),
        "c_cubic": 3 * a**2 * omega / 8,
        "c_q^2 q_dot": a**2 / (8 * omega),
    }
    for key, expected in ratio.items():
        damped = ReducedModel.from_coefficients({"omega^2": omega**2, key: 1.0})
        # |q'| has a kink at the turning points only, where Gauss points do not lie.
        np.testing.assert_allclose(damped.damping_ratio(a), expected, rtol=1e-9)


@pytest.mark.parametrize(
    "extra", [{"gamma_2": 15.0}, {"beta_1": 0.4, "beta_2": -0.3}, {"Upsilon_4": 0.3}]
)
def test_damping_ratio_is_the_decrement_of_a_slow_decay(extra):
    """Independent of energies: integrate one cycle and see what becomes of its half peak to peak.

    Strong asymmetry, inertia without its partner, even inertia.
    """
    coefficients = {"omega^2": 36.0, "gamma_3": 9.0, "c_q^2 q_dot": 1e-3} | extra
    damped = ReducedModel.from_coefficients(coefficients)
    t = np.linspace(0, 3, 300_001)
    q, v = integrate(lambda q, v: float(damped.acceleration(q, v)), 0.9, 0.0, t)
    stops = np.flatnonzero((v[1:-1] > 0) != (v[2:] > 0)) + 1
    peaks = np.concatenate([[0.9], q[stops]])
    half = np.abs(np.diff(peaks)) / 2  # lower, upper, lower ... half a cycle apart
    decrement = np.log(half[0] / half[2])
    middle = damped.damping_ratio([half[1]])[0]
    assert decrement / (2 * np.pi) == pytest.approx(middle, rel=2e-3)


def test_relative_magnitude_counts_convection_in_the_acceleration():
    """Rms of every term over a period of the integrated motion."""
    model_ = ReducedModel.from_coefficients({"omega^2": 36.0, "gamma_3": 9.0, "Upsilon_3": 0.8})
    period = 2 * np.pi / model_.backbone([1.5])[0]
    motion = model_.simulate(1.5, 0.0, np.linspace(0, period, 20001), rtol=1e-12)
    q, v, a = motion.q[:-1], motion.q_dot[:-1], motion.q_ddot[:-1]
    expected = 0.8 * np.std(q**2 * a + q * v**2) / np.std(a)
    assert model_.relative_magnitude([1.5])["Upsilon_3"][0] == pytest.approx(expected, rel=1e-6)


def test_relative_magnitudes_of_duffing():
    """At small amplitude the linear term carries the acceleration; the cubic one is a^2 times."""
    shares = model(omega2=4.0, gamma_3=8.0).relative_magnitude([1e-3])
    np.testing.assert_allclose(shares["omega^2"], 1.0, rtol=1e-5)
    # rms cos^3 / rms cos = sqrt(5/8)
    np.testing.assert_allclose(shares["gamma_3"], 2e-6 * np.sqrt(5 / 8), rtol=1e-5)


def test_magnitudes_of_parts_are_those_of_their_only_terms():
    values = {"omega^2": 36.0, "gamma_3": 9.0, "Upsilon_3": 0.3, "c_linear": 0.06}
    model_ = ReducedModel.from_coefficients(values)
    terms, parts = (f([0.5, 1.5]) for f in (model_.relative_magnitude,
                                            model_.relative_magnitude_of_parts))  # fmt: skip
    for part, term in (("inertia", "Upsilon_3"), ("nonlinear stiffness", "gamma_3"),
                       ("damping", "c_linear")):  # fmt: skip
        np.testing.assert_allclose(parts[part], terms[term], rtol=1e-12)
    linear = model(omega2=4.0, gamma_3=0.0, c_linear=0.1).relative_magnitude_of_parts([2.0])
    # rms of c q_dot over that of omega^2 q
    np.testing.assert_allclose(linear["damping"], 0.1 / 2.0, rtol=1e-9)
    assert linear["inertia"] == linear["nonlinear stiffness"] == 0


def test_simulate_against_independent_integration():
    t = np.linspace(0, 40, 4001)
    motion = EXAMPLE_MODEL.simulate(1.8, 0.3, t)
    q, v = integrate(icrom_acceleration, 1.8, 0.3, t)
    # 40 cycles at a local tolerance of 1e-10.
    np.testing.assert_allclose(motion.q, q, atol=5e-8)
    np.testing.assert_allclose(motion.q_dot, v, atol=5e-7)
    np.testing.assert_allclose(motion.q_ddot, icrom_acceleration(q, v), atol=5e-6)


def test_residual_vanishes_along_a_motion_and_undamped_keeps_the_rest():
    motion = EXAMPLE_MODEL.simulate(1.8, 0.3, np.linspace(0, 3, 301))
    residual = EXAMPLE_MODEL.residual(motion.q, motion.q_dot, motion.q_ddot)
    # q_ddot is of the order of 60.
    np.testing.assert_allclose(residual, 0, atol=1e-12)
    undamped = EXAMPLE_MODEL.undamped()
    loss = EXAMPLE_MODEL.damping(motion.q, motion.q_dot)
    np.testing.assert_allclose(
        undamped.residual(motion.q, motion.q_dot, motion.q_ddot), -loss, atol=1e-12
    )
    assert undamped.unit == "m" and set(EXAMPLE_MODEL.coefficients) - set(
        undamped.coefficients
    ) == {"c_linear"}


def test_simulate_linear_oscillator_exactly():
    t = np.linspace(0, 30, 3001)
    q = model(omega2=36.0, c_linear=2 * 0.01 * 6).simulate(0.7, 0.0, t).q
    np.testing.assert_allclose(q, viscous_decay(t, 6.0, 0.01, 0.7), atol=1e-8)


def test_dry_friction_loses_a_fixed_amplitude_and_sticks():
    """Each half cycle costs 2 c / omega^2; it rests once the spring cannot overcome friction."""
    c, omega2, q0 = 1.0, 36.0, 1.5
    half = np.pi / np.sqrt(omega2)
    t = np.arange(60) * half
    motion = model(omega2=omega2, c_coulomb=c).simulate(q0, 0.0, t)
    levels = q0 - 2 * c / omega2 * np.arange(60)
    moves = levels[:-1] > c / omega2
    n = int(np.count_nonzero(moves))
    expected = levels[: n + 1] * (-1.0) ** np.arange(n + 1)
    np.testing.assert_allclose(motion.q[: n + 1], expected, atol=1e-8)
    assert np.all(motion.q[n + 1 :] == motion.q[n + 1])
    assert np.all(motion.q_ddot[n + 2 :] == 0)
    assert abs(motion.q[-1]) <= c / omega2 + 1e-9


def test_motion_where_inertia_vanishes_is_refused():
    singular = model(omega2=36.0, gamma_3=-100.0, Upsilon_3=-1.0)
    with pytest.raises(SingularInertiaError, match=r"1 \+ h\(q\) = .* is not positive at q = "):
        singular.simulate(0.5, 5.0, np.linspace(0, 10, 1001))
    with pytest.raises(SingularInertiaError, match="smaller amplitudes"):
        singular.acceleration(1.5, 0.0)
    assert np.isnan(singular.backbone([1.2])[0])


def test_json_pickle_and_text_round_trip():
    limited = ReducedModel.from_coefficients(EXAMPLE_MODEL.coefficients, "m", (0.01, 1.7))
    assert ReducedModel.from_json(limited.to_json()) == limited
    assert pickle.loads(pickle.dumps(limited)) == limited
    text = str(limited)
    assert "+ 0.3 (q^2 q_ddot + q q_dot^2)" in text
    assert "gamma_3" in text and "1/(m^2 s^2)" in text and "omega = 6 rad/s" in text
    assert r"0.05 \, (2 q^3 \ddot{q} + 3 q^2 \dot{q}^2)" in limited.latex()


def test_json_that_holds_no_model_is_refused():
    with pytest.raises(ValueError, match="holds no model"):
        ReducedModel.from_json("[1, 2]")
    with pytest.raises(ValueError, match=r"cannot be read from line 1, column 1 on\): mend it"):
        ReducedModel.from_json("no json")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"terms": [{"type": "Stiffness", "degree": 1}]}', r"terms\[0\] has no 'value'"),
        ('{"terms": [3]}', r"terms\[0\] = 3 must be a table"),
        ('{"terms": null}', "terms = null must be a list"),
        ('{"coefficients": ["omega^2"]}', r"coefficients = \[\.\.\.\] must be a table"),
        ('{"coefficients": {"omega^2": null}}', r"omega\^2 = null must be a finite number"),
        ('{"coefficients": {"omega^2": 36}, "amplitude_range": [1]}', r"= \[1\] must be .* two"),
        ('{"coefficients": {"omega^2": 36}, "amplitude_range": 1}', "range = 1 must be a list"),
    ],
)
def test_json_of_half_a_model_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        ReducedModel.from_json(text)


@pytest.mark.parametrize("amplitudes", [[0.0, 1.0], [-1.0], [[1.0]]])
def test_amplitudes_are_checked(amplitudes):
    with pytest.raises(ValueError, match="amplitudes must be positive"):
        EXAMPLE_MODEL.backbone(amplitudes)


def test_coefficients_are_checked():
    for wrong in ("stiff", None, [1.0], True):
        with pytest.raises(ValueError, match=r"must be numbers, got {'omega\^2': "):
            ReducedModel.from_coefficients({"omega^2": wrong})
    with pytest.raises(ValueError, match="must be finite"):
        model(omega2=np.nan)
    with pytest.raises(ValueError, match="2 values for 1 terms"):
        ReducedModel(EXAMPLE_MODEL.terms[:1], (1.0, 2.0))
    with pytest.raises(ValueError, match="appear twice"):
        ReducedModel(EXAMPLE_MODEL.terms[:1] * 2, (1.0, 2.0))


def test_printed_natural_frequency_counts_added_mass():
    """Of (1 + mu) q'' + omega^2 q = 0: sqrt(omega^2 / (1 + mu))."""
    model = ReducedModel.from_coefficients({"omega^2": 36.0, "mu": 0.44})
    assert "omega = 5 rad/s, 0.79577 Hz" in str(model)


@pytest.mark.parametrize(
    ("law", "start"),
    [
        ({"gamma_3": -9.0}, 2.5),  # over the hill of a softening spring, at 2
        ({"gamma_3": -9.0, "c_coulomb": 0.05}, 2.5),
        ({"c_quadratic": -1.0}, 1.0),  # fed by what should damp
        ({"gamma_5": 1.0}, 1e80),
    ],
)
def test_a_motion_to_infinity_is_refused(law, start):
    motion = ReducedModel.from_coefficients({"omega^2": 36.0, **law}, unit="m")
    with pytest.raises(EscapeError, match=r"cannot be followed to 9\.99 s: near t = .*infinity;"):
        motion.simulate(start, 0.0, np.arange(0, 10, 0.01))


def test_a_motion_faster_than_its_times_is_refused():
    """It grows on a hardening spring: its cycles get shorter without end."""
    fed = model(omega2=36.0, c_linear=-6.0, gamma_5=2.0)
    with pytest.raises(EscapeError, match=r"becomes too fast for these times; start at a smaller"):
        fed.simulate(1.6, 0.0, np.arange(0, 25, 0.1))


def test_strokes_shorter_than_a_step_and_rest_of_an_overdamped_mass():
    """It creeps towards where friction, 0.022/36, holds it, and turns there within one step."""
    overdamped = model(omega2=36.0, c_linear=19.5, c_coulomb=0.022)
    decay = overdamped.simulate(1.0, 0.0, np.arange(0, 25, 0.01))
    assert decay.q[-1] == pytest.approx(0.022 / 36, rel=1e-6) and decay.q_dot[-1] == 0


@pytest.mark.parametrize(
    ("start", "t", "message"),
    [
        ((np.nan, 0.0), np.arange(0, 1, 0.1), "q0 must be a finite number"),
        ((1.0, np.inf), np.arange(0, 1, 0.1), "q_dot0 must be a finite number"),
        ((1.0, 0.0), 5.0, "t must be one-dimensional"),
        ((1.0, 0.0), np.arange(1, 0, -0.1), "t must increase"),
    ],
)
def test_start_and_times_are_checked(start, t, message):
    with pytest.raises(ValueError, match=message):
        EXAMPLE_MODEL.simulate(*start, t)
