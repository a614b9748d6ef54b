"""A shaker that is not ideal: its force lags behind the input, or is not proportional to it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import StateSpace, lsim
from test_forced import CUBIC, DAMPING, DT, GAIN, OMEGA, T, duffing, misses, multisine, noisy
from test_forced_simulation import DUFFING, linear
from test_interpolation import SAMPLES, WEIGHTS

import romsindy as rs
from romsindy.effects import AirDrag, CubicStiffness, Viscous
from romsindy.fit.kernel.linear_steps import NODES
from romsindy.physics.equations import gain_of
from romsindy.physics.input import Input
from romsindy.record.interpolation import interpolated, of_steps

PART = T[:1000]
CUBED = 2e-3  # of the input cubed: 10 % of the force, at an rms of 5.5
KNOWN = rs.ReducedModel.from_coefficients({**DUFFING, "gain [force]": GAIN}, "m")
DISTORTED = rs.ReducedModel.from_coefficients({**DUFFING, "gain [force]^3": GAIN * CUBED}, "m")
FEW = (AirDrag(), Viscous(), CubicStiffness())


def lagging(force, lag, t=PART):
    """The displacement under what is left of a force after a lag, by an equation of its own."""

    def rates(time, y):
        own = GAIN * y[2] - DAMPING * y[1] - OMEGA**2 * y[0] - CUBIC * y[0] ** 3
        return [y[1], own, (float(force(time)) - y[2]) / lag]

    options = {"t_eval": t, "method": "DOP853", "rtol": 1e-9, "atol": 1e-12, "max_step": DT}
    return solve_ivp(rates, (t[0], t[-1]), (0.0, 0.0, float(force(0.0))), **options).y[0]


def record(q, u, seed):
    return rs.ForcedVibration(PART, noisy(q, seed), u, unit="m", input_unit="N")


# -- the lag --------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", ["hold", "linear"])
@pytest.mark.parametrize("lag", [0.3, 4.0])
def test_what_is_left_after_a_lag_is_exact(way, lag):
    """At samples and between them, to rounding: scipy's response to lines, on a finer grid."""
    fine = 8
    t = np.arange(59 * fine + 1) / fine
    u = interpolated(SAMPLES, t, way)
    system = StateSpace([[-1 / lag]], [[1 / lag]], [[1.0]], [[0.0]])
    if way == "linear":
        expected = lsim(system, u, t, SAMPLES[:1])[1]
    else:  # of what is held, each value acts until the next
        expected = lsim(system, u, t, SAMPLES[:1], interp=False)[1]
    np.testing.assert_allclose(interpolated(SAMPLES, t, way, lag), expected, atol=1e-13)


@pytest.mark.parametrize("lag", [0.3, 4.0])
def test_waves_after_a_lag(lag):
    """A band-limited input has the transfer function, as far as the ends are not felt."""
    rng = np.random.default_rng(1)
    omega, phase = 2 * np.pi * rng.uniform(0, 0.4, 20), rng.uniform(0, 6, 20)
    place = rng.uniform(400, 1600, 50)
    waves = np.exp(1j * (np.outer(np.arange(2000), omega) + phase)).sum(axis=1).real
    response = np.exp(1j * (np.outer(place, omega) + phase)) @ (1 / (1 + 1j * omega * lag))
    found = interpolated(waves, place, "band-limited", lag)
    # Where the waves begin they jump by up to 20, and half of that over pi times the distance is
    # felt at the Nyquist frequency, where the response of the lag does so.
    np.testing.assert_allclose(found, response.real, atol=20 / 2 / (np.pi * 400))


@pytest.mark.parametrize("way", ["hold", "linear"])
def test_integrals_over_steps_feel_the_lag(way):
    """The integral of x is that of u, less the lag times its change."""
    for lag in (0.05, 0.5, 5.0):
        start = 2.3 + 1.7 * np.arange(10)
        values, plain = (
            of_steps(lambda x, n=n: interpolated(SAMPLES, x, way, n), start, 1.7, NODES, False)
            for n in (lag, 0.0)
        )
        changes = np.diff(
            [interpolated(SAMPLES, x, way, lag) for x in (start, start + 1.7)], axis=0
        )
        found, input_ = (1.7 * v @ WEIGHTS for v in (values, plain))
        # What fades within a twentieth of a sample is integrated to 1e-5.
        np.testing.assert_allclose(found, input_ - lag * changes[0], atol=2e-5)


@pytest.mark.parametrize("way", ["hold", "linear"])
def test_a_motion_after_a_lag_is_exact(way):
    """Against matrix exponentials of oscillator and lag together, as exact as without a lag."""
    lag, u = 0.3 * DT, multisine(1)[0][:400]
    a = np.zeros((5, 5))
    a[0, 1], a[1, :3], a[3, 4] = 1.0, [-(OMEGA**2), -DAMPING, GAIN], 1.0
    a[2, 2:4] = -1 / lag, 1 / lag
    step, states = expm(a * DT), [np.array([0.01, -0.3, u[0]])]
    slope = np.diff(u) / DT if way == "linear" else np.zeros(len(u) - 1)
    for value, rate in zip(u[:-1], slope, strict=True):
        states.append((step @ [*states[-1], value, rate])[:3])
    q = np.array(states)[:, 0]
    found = linear(Input("force", way, lag=lag)).simulate(0.01, -0.3, T[:400], u=u).y
    assert np.abs(found - q).max() < 1e-8 * np.abs(q).max()


def test_a_lag_needs_samples():
    with pytest.raises(ValueError, match=r"'gain \[force\]' has a lag of 0.02 s: give its samples"):
        linear(Input(lag=0.02)).simulate(0, 0, PART, u=np.sin)


# -- the power ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_duffing_moves_under_a_cubed_force_as_in_another_integrator():
    """One column of u is for both; that other is good to 2e-9 here."""
    force = multisine(4)[1]
    q = duffing(lambda t: force(t) + CUBED * force(t) ** 3, T[:600], (0.1, 0.0))[0]
    found = DISTORTED.simulate(0.1, 0.0, T[:600], u=force, rtol=1e-12)
    assert found.names == ("force",)
    assert np.abs(found.y - q).max() < 1e-8 * np.abs(q).max()
    with pytest.raises(ValueError, match=r"u has 2 columns, and the model the inputs \['force'\]"):
        DISTORTED.simulate(0, 0, T[:9], u=np.ones((9, 2)))


@pytest.mark.slow
def test_a_model_with_a_distorted_force_is_fitted():
    force = multisine(5)[1]
    q = duffing(lambda t: force(t) + CUBED * force(t) ** 3, PART)[0]
    heard = record(q, force(PART), 6)
    start = {"omega^2": 0.98 * OMEGA**2, "c_linear": 1.0, "gamma_3": 0.0}
    start |= {"gain [force]": GAIN, "gain [force]^3": 0.0}
    fit = rs.refine(rs.ReducedModel.from_coefficients(start, "m"), heard)
    assert np.abs(misses(fit)).max() < 3.5
    cubed, error = fit.model.coefficients["gain [force]^3"], fit.standard_errors["gain [force]^3"]
    assert abs(cubed - GAIN * CUBED) < 3.5 * error < 0.03 * GAIN * CUBED
    assert {*fit.delays} == {"force", "force^3"}


# -- names ----------------------------------------------------------------------------------------


def test_an_input_says_what_acts():
    late = Input("force", delay=0.002, lag=0.01, power=3, input_unit="N")
    assert late.key == "gain [force]^3" and late.signal == "force^3"
    assert late.expression() == "(force(t - 0.002)/(1 + 0.01 d/dt))^3"
    assert Input(power=2).expression() == "force(t)^2"
    assert late.unit("m") == "m/(s^2 N^3)" and Input("base", power=3).unit("m") == "s^4/m^2"
    assert Input.from_key("gain [force 2]^3") == Input("force 2", power=3)
    assert Input.from_key("gain [force]^1") is None
    model = rs.ReducedModel((*KNOWN.terms, late), (*KNOWN.values, 2.0), "m")
    assert rs.ReducedModel.from_json(model.to_json()) == model
    assert model.equation().endswith("+ 2 (force(t - 0.002)/(1 + 0.01 d/dt))^3")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"lag": -0.1}, "lag = -0.1 must be a time in s"),
        ({"lag": float("nan")}, "lag = nan must be a time in s"),
        ({"power": 0}, "power = 0 must be a whole number"),
        ({"power": 1.5}, "power = 1.5 must be a whole number"),
    ],
)
def test_what_is_no_lag_and_no_power(wrong, message):
    with pytest.raises(ValueError, match=message):
        Input(**wrong)


def test_a_harmonic_force_is_that_of_the_input_itself():
    for changed in (Input(lag=0.01), Input(power=3)):
        with pytest.raises(ValueError, match="drop the input, and give the force per unit mass"):
            gain_of(linear(changed))
    with pytest.raises(ValueError, match=r"the inputs \['force', 'force\^3'\], and one can be"):
        gain_of(DISTORTED)


# -- diagnosis ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_lag_of_two_samples_is_named():
    u, force = multisine(7)
    measured = record(lagging(force, 2 * DT), u[: len(PART)], 120001)
    report = rs.diagnose(KNOWN, measured, catalogue=FEW)
    (found,) = report.effects
    assert report.verdict == "named" and found.name == "input_lag"
    assert found.values["lag"] == pytest.approx(2 * DT, abs=4 * found.standard_errors["lag"])
    assert found.values["strength"] == pytest.approx(GAIN, rel=0.01) and found.units["lag"] == "s"
    (term,) = (t for t in report.model.terms if isinstance(t, Input))
    assert term.lag == found.values["lag"]
    fit = rs.refine(report.model, measured)  # which keeps the lag
    assert fit.verdict.explained and np.abs(misses(fit)).max() < 3.5


@pytest.mark.slow
def test_a_lag_and_a_delay_that_the_record_does_not_tell_apart_are_ambiguous():
    """A tenth of a sample: of the force a lag takes (omega tau)^2 / 2 < 0.1 %, less than noise."""
    u, force = multisine(8, high=7.0)
    report = rs.diagnose(
        KNOWN, record(lagging(force, 0.1 * DT), u[: len(PART)], 120002), catalogue=FEW
    )
    assert report.verdict == "ambiguous"
    assert {("input_lag",), ("input_delay",)} <= {*report.equivalent}


@pytest.mark.slow
def test_a_force_with_a_part_that_is_cubed_is_named():
    u, force = multisine(9)
    q = duffing(lambda t: force(t) + CUBED * force(t) ** 3, PART)[0]
    report = rs.diagnose(KNOWN, record(q, u[: len(PART)], 120003), catalogue=FEW)
    (found,) = report.effects
    assert report.verdict == "named" and found.name == "input_distortion"
    assert found.variant == "gain [force]^3" and found.units["strength"] == "m/(s^2 [input]^3)"
    error = found.standard_errors["strength"]
    assert found.values["strength"] == pytest.approx(GAIN * CUBED, abs=4 * error)


@pytest.mark.slow
def test_an_ideal_shaker_is_no_alarm():
    u, force = multisine(10)
    report = rs.diagnose(KNOWN, record(duffing(force, PART)[0], u[: len(PART)], 120004))
    assert report.verdict == "none"
