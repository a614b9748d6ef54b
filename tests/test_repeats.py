"""One structure measured twice: what needs no effect is none, and values come before effects."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_diagnosis import LONG, MODEL, NOMINAL, OMEGA, decay

import romsindy as rs
from romsindy.diagnosis import diagnose
from romsindy.diagnosis.decay_search import DecaySearch, ProcessNoise
from romsindy.diagnosis.difference import Tolerance
from romsindy.diagnosis.evidence import allowed, nuisances
from romsindy.diagnosis.search import Options, unsure_parts, with_whole_exponent
from romsindy.diagnosis.workflow import other_values, without_effects
from romsindy.effects import CATALOGUE, AirDrag, Bias, CubicStiffness, Gain, Viscous
from romsindy.effects.outside import SensorNonlinearity
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record, scales

SMALL = [e for e in CATALOGUE if e.name in ("quadratic_drag", "dry_friction", "bias", "gain")]
# What the weakest effects of the trials change is ten times this.
STRICT = {"frequency": 1e-4, "damping": 1e-2, "signal": 2e-4}


def read(gain=1.0, offset=0.0, curvature=0.0):
    return lambda t, q: gain * (q + curvature * q * q) + offset


@cache
def again(frequency=1.0, damping=1.0, snr_db=35, start=0.9, **reading):
    """The second run: another start, offset, gain, curvature; values that have moved."""
    c = {"omega^2": frequency**2 * OMEGA**2, "c_linear": damping * frequency * 0.01 * OMEGA}
    return decay(start, changed=c, reading=read(**reading), duration=LONG, snr_db=snr_db, seed=5)


@pytest.mark.slow
def test_what_tests_repeat_to_is_none():
    """Each would be found: an offset of 2 % of the amplitude is seventy of its standard errors."""
    run = again(1.0003, 1.02, gain=1.005, offset=0.02, curvature=0.005)
    found = diagnose(MODEL, run, catalogue=SMALL)
    assert found.verdict == "none", found
    assert "nothing that matters" in found.sentence and "0.1 %, 5 % and 1 %" in found.sentence
    # The offset is as free as the start: what differs is what was put in.
    (d,) = found.differences
    assert_allclose(d.frequency, -0.0003, atol=2e-4)
    assert d.signal < 0.005


@pytest.mark.slow
@pytest.mark.parametrize(
    ("moved", "name", "words"),
    [
        ({"frequency": 1.005}, "linear_frequency", "linear stiffness 1.0"),
        ({"damping": 0.8}, "viscous", "damping proportional to speed 20"),
    ],
)
def test_a_value_that_moved_is_the_headline(moved, name, words):
    """(1.005^2 - 1) = 1.0 % of the stiffness; the damping to its error of 1 % of itself."""
    run = again(**moved, gain=0.995, offset=-0.02, start=0.8)
    found = diagnose(MODEL, run, catalogue=SMALL)
    assert found.verdict == "named" and found.best.names == (name,), found
    assert "lower than assumed" in found.sentence or "higher than assumed" in found.sentence
    assert found.effects[0].relative == pytest.approx(0.010025 if name[0] == "l" else -0.2, rel=0.1)
    assert words.split()[0] in found.sentence


def test_another_coefficient_is_a_value_of_the_model():
    """Cubic stiffness 20 % higher: 1.5 % of the frequency at the largest amplitude."""
    run = decay(0.9, changed={"gamma_3": 0.24 * OMEGA**2}, duration=LONG)
    found = diagnose(MODEL, run, catalogue=[AirDrag()])
    assert found.verdict == "named" and "the coefficient gamma_3" in found.sentence, found
    assert found.effects[0].relative == pytest.approx(0.2, abs=0.02)


def test_an_effect_within_the_default_is_named_and_small_but_not_within_a_stated_tolerance():
    """Drag that adds 4 % to the damping at the largest amplitude, at 60 dB."""
    force = lambda t, q, v: 0.00012 * abs(v) * v  # noqa: E731
    run = decay(0.9, force=force, duration=LONG, snr_db=60)
    found = diagnose(MODEL, run, catalogue=[AirDrag(), Viscous()])
    assert found.verdict == "named" and found.best.names == ("quadratic_drag",), found
    assert found.small and "It is small" in found.sentence
    stated = diagnose(MODEL, run, catalogue=[AirDrag(), Viscous()], tolerance={"damping": 0.05})
    assert stated.verdict == "none" and not stated.small


@pytest.mark.slow
def test_the_error_of_a_strength_is_the_same_in_every_unit():
    """Its exponent is held at 2: an error of it would be an error of a power of the unit."""
    force = lambda t, q, v: 0.002 * abs(v) * v  # noqa: E731
    run = decay(0.9, force=force, duration=LONG)
    found = []
    for unit in (1.0, 1e-4):
        size = {t.key: unit ** (t.dimension[0] - 1) for t in MODEL.terms}
        model = rs.ReducedModel.from_coefficients({k: NOMINAL[k] / size[k] for k in size})
        result = diagnose(model, rs.Decay(run.t, unit * run.q), catalogue=[AirDrag()])
        (drag,) = result.effects
        assert drag.values["exponent"] == 2 and drag.standard_errors["exponent"] == 0
        found.append([drag.values["strength"] * unit, drag.standard_errors["strength"] * unit])
    assert found[0][1] < 0.05 * found[0][0]
    assert_allclose(found[1], found[0], rtol=0.01)  # steps of the fit end elsewhere


@pytest.mark.slow
def test_a_gain_beyond_what_is_known_is_an_effect():
    found = diagnose(MODEL, again(gain=1.05, snr_db=60), catalogue=SMALL)
    assert found.best.names == ("gain",), found
    assert found.effects[0].values["strength"] == pytest.approx(0.05, abs=0.01)


def test_nuisances_stay_within_what_is_known():
    """A gain of 5 % and a curvature of 3 %: both are taken up to 1 %, the offset as it is."""
    records = [Record.loud(again(gain=1.05, offset=0.3, curvature=0.03), 2e-4)]
    parts = unsure_parts(MODEL, ("omega^2", "c_linear"), {}, scales(records), 1)
    options = Options((), 0.01, 1, 2e-4, 1, lambda _: None)
    search = DecaySearch(MODEL, records, parts, options, ProcessNoise())
    slack = replace(search, free=nuisances(records)).hypothesis([])
    _, found = without_effects(search, slack, search.hypothesis([]), ())
    values = {p.effect.name: float(p.strengths[0, 0]) for p in found.parts}
    reach = np.abs(records[0].signal).max()
    assert abs(values["gain"]) <= 0.01 and abs(values["sensor_nonlinearity"]) * reach <= 0.01
    assert values["bias"] == pytest.approx(0.3, abs=0.03)
    assert not {"gain", "bias", "sensor_nonlinearity"}.intersection(found.names)


def test_what_a_measurement_may_add():
    assert allowed(Bias(), 2.0) == np.inf and allowed(Gain(), 2.0) == 0.01
    # The square adds 1 % of the reading of 2 there: e 2^2 = 0.01 * 2.
    assert allowed(SensorNonlinearity(2), 2.0) == 0.005
    assert allowed(SensorNonlinearity(3), 2.0) == allowed(AirDrag(), 2.0) == 0.0
    (offset, *known) = nuisances([Record.loud(decay(1.0), 2e-4)])
    assert offset.most == np.inf and all(p.most == p.tolerance for p in known)


def test_every_other_coefficient_is_asked_under_the_name_of_its_effect():
    names = {v.variant: v.name for v in other_values(MODEL, CATALOGUE, ())}
    assert set(names) == set(NOMINAL) - {"omega^2", "c_linear"}
    assert names["gamma_3"] == "cubic_stiffness" and names["Upsilon_3"] == "nonlinear_inertia"
    assert "gamma_3" not in {v.variant for v in other_values(MODEL, CATALOGUE, {"gamma_3": 0.1})}


def test_an_exponent_is_held_at_the_next_whole_number():
    at = scales([Record.loud(decay(1.0), 2e-4)])
    part = Part.of(CubicStiffness(), at, 1, [2.96])
    held = with_whole_exponent(part)
    assert held.effect.value("exponent") == 3.0 and held.effect.term().unit("m") == "1/(m^2 s^2)"
    assert held.limits()[0][-1] == held.limits()[1][-1] == 3.0
    assert with_whole_exponent(held) is held
    assert with_whole_exponent(Part.of(Viscous(), at, 1)).size == 1


def test_the_default_is_what_tests_repeat_to():
    assert Tolerance() == Tolerance(1e-3, 5e-2, 1e-2, "default")
    assert replace(Tolerance(), source="stated") != Tolerance()
    assert isinstance(diagnose(MODEL, again(), tolerance=STRICT), rs.diagnosis.DiagnosisReport)


@pytest.mark.parametrize("measured", [False, True])
def test_a_fit_may_start_from_the_motion_that_a_sensor_with_a_wrong_gain_sees(measured):
    """Of 200 cycles the measured motion, 10 % too small, loses step by radians: it is lost."""
    slow = {"c_linear": 0.001 * OMEGA}
    run = decay(1.0, changed=slow, reading=read(gain=0.9), duration=40.0)
    record = Record.loud(run, 2e-4)
    m = record.motion
    true = replace(m, q=m.q / 0.9, q_dot=m.q_dot / 0.9, q_ddot=m.q_ddot / 0.9)
    options = Options((), 0.01, 2, 2e-4, 1, lambda _: None)
    model = rs.ReducedModel.from_coefficients(NOMINAL | slow)
    search = DecaySearch(model, [record], (), options, ProcessNoise())
    gain, friction = (Part.of(e, scales([record]), 1) for e in (Gain(), Viscous()))
    gain = replace(gain, strengths=np.array([[-0.1]]))
    if measured:
        assert not search.hypothesis([gain]).solution.converged
        return
    both = search.hypothesis([gain, friction], [true])
    _, alone = search.without_one(both)
    assert alone.names == ("gain",) and alone.solution.converged
    assert alone.effects[0].strengths == pytest.approx(-0.1, abs=0.002)
