"""What a simulation lacks against forced vibrations, made by a simulator of its own."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.diagnosis import ForcedReport
from romsindy.effects import CATALOGUE, AirDrag, CubicStiffness, MoreMass, Viscous
from romsindy.physics.input import Input

OMEGA, DAMPING, CUBIC, GAIN = 2 * np.pi * 5.0, 0.8, 3e4, 2.0
DT = 0.01
T = DT * np.arange(2500)
KNOWN = {"omega^2": OMEGA**2, "c_linear": DAMPING, "gamma_3": CUBIC, "gain [force]": GAIN}
FEW = (AirDrag(), Viscous(), CubicStiffness(), MoreMass())


def sweep(t):
    """3 to 7 Hz over 25 s, N."""
    return 2.0 * np.sin(2 * np.pi * (3.0 + 2.0 * t / T[-1]) * t)


def record(seed, more=lambda q, v: 0.0, gain=GAIN, mass=1.0, late=0.0):
    """A swept sine, 40 dB, with a force (m/s^2) on the left side that the simulation lacks."""

    def rates(t, y):
        q, v = y
        push = gain * sweep(t - late) - more(q, v)
        return [v, (push - DAMPING * v - OMEGA**2 * q - CUBIC * q**3) / mass]

    options = {"t_eval": T, "method": "DOP853", "rtol": 1e-9, "atol": 1e-12, "max_step": DT}
    q = solve_ivp(rates, (0.0, T[-1]), (0.0, 0.0), **options).y[0]
    noise = 0.01 * q.std() * np.random.default_rng(seed).standard_normal(len(q))
    return rs.ForcedVibration(T, q + noise, sweep(T), unit="m", input_unit="N")


def model(**changed):
    return rs.ReducedModel.from_coefficients({**KNOWN, **changed}, unit="m")


def without_gain():
    known = {k: v for k, v in KNOWN.items() if k != "gain [force]"}
    return rs.ReducedModel.from_coefficients(known, unit="m")


@pytest.fixture(scope="module")
def right():
    return record(1)


def test_nothing_is_missing(right):
    report = rs.diagnose(model(), right)
    assert isinstance(report, ForcedReport) and report.verdict == "none"
    assert report.model == report.nominal and not report.effects
    assert "They agree" in report.sentence and "1 % of the response, as noise" in report.sentence


def test_drag_is_named_with_its_strength():
    report = rs.diagnose(model(), record(2, lambda q, v: 2.0 * v * abs(v)))
    (drag,) = report.effects
    assert report.verdict == "named" and drag.name == "quadratic_drag"
    assert abs(drag.values["strength"] - 2.0) < 4 * drag.standard_errors["strength"] < 1.0
    assert drag.units["strength"] == "1/m"
    assert report.gap.before > 5 * report.gap.after and report.gap.closed > 0.99
    assert report.gap.after == pytest.approx(0.01, rel=0.05)
    # The input is as it was.
    assert report.model.coefficients["gain [force]"] == GAIN
    assert "named" in json.loads(report.to_json())["verdict"]
    for picture in report.pictures().values():
        assert picture.figure().axes


@pytest.mark.slow
def test_the_gain_of_the_input_is_wrong(right):
    report = rs.diagnose(model(**{"gain [force]": 1.9}), right)
    (gain,) = report.effects
    assert report.verdict == "named" and gain.name == "input_gain"
    assert gain.values["strength"] == pytest.approx(0.1, abs=4 * gain.standard_errors["strength"])
    assert report.model.coefficients["gain [force]"] == pytest.approx(GAIN, rel=0.005)


def test_the_chain_is_late():
    report = rs.diagnose(model(), record(3, late=0.004), catalogue=FEW)
    (late,) = report.effects
    assert late.name == "input_delay" and report.verdict == "named"
    assert late.values["delay"] == pytest.approx(0.004, abs=4 * late.standard_errors["delay"])


def test_an_input_that_is_not_held_has_no_strength_and_is_named(right):
    """Held inputs are late by half a sample, 9 degrees at 5 Hz: an effect without any value."""
    terms = [Input("force", "hold", 0.0, "N") if isinstance(t, Input) else t for t in model().terms]
    held = rs.ReducedModel(tuple(terms), model().values, "m")
    report = rs.diagnose(held, right, catalogue=FEW)
    assert report.verdict == "named" and report.best.names == ("input_between_samples",)
    (found,) = report.effects
    assert found.values == {} and found.relative is None
    assert "an input that is not what was assumed between its samples" in report.sentence


def test_an_input_that_the_model_does_not_have_is_fitted():
    """Half as much force again is no alarm, and the report says why."""
    report = rs.diagnose(without_gain(), record(4, gain=1.5 * GAIN), catalogue=FEW)
    assert report.verdict == "none"
    assert any("gain and delay are fitted" in note for note in report.notes)


@pytest.mark.slow
def test_a_mass_is_told_from_stiffness_by_a_known_gain():
    """Where the gain is fitted, and all is linear, stiffness and damping may be others as well."""
    heavy = record(5, mass=1.01)
    assert rs.diagnose(model(), heavy, catalogue=FEW).best.names == ("added_mass",)
    linear = {"omega^2": OMEGA**2, "c_linear": DAMPING}
    options = {"t_eval": T, "method": "DOP853", "rtol": 1e-9, "atol": 1e-12, "max_step": DT}

    def rates(t, y):
        return [y[1], (GAIN * sweep(t) - DAMPING * y[1] - OMEGA**2 * y[0]) / 1.002]

    q = solve_ivp(rates, (0.0, T[-1]), (0.0, 0.0), **options).y[0]
    q += 0.01 * q.std() * np.random.default_rng(6).standard_normal(len(q))
    measured = rs.ForcedVibration(T, q, sweep(T), unit="m")
    report = rs.diagnose(rs.ReducedModel.from_coefficients(linear, "m"), measured, catalogue=FEW)
    assert report.verdict == "ambiguous"
    assert report.equivalent == (("added_mass",), ("linear_frequency", "viscous"))
    assert "Next: at no level that was simulated" in report.sentence


def test_what_does_not_go_with_inputs_is_refused(right):
    decay = rs.Decay(T, right.y, unit="m")
    with pytest.raises(ValueError, match=r"held_out = \.\.\. does not go with forced"):
        rs.diagnose(model(), right, held_out=decay)
    with pytest.raises(ValueError, match="one kind at a time"):
        rs.diagnose(model(), [right, decay])
    with pytest.raises(ValueError, match="driven by 'base', and record 0 has"):
        other = {"omega^2": OMEGA**2, "Gamma [base]": 1.0}
        rs.diagnose(rs.ReducedModel.from_coefficients(other, "m"), right)
    with pytest.raises(ValueError, match="record 0 is noise"):
        noise = np.random.default_rng(7).standard_normal(len(T))
        rs.diagnose(model(), rs.ForcedVibration(T, noise, right.u, unit="m"), catalogue=CATALOGUE)
