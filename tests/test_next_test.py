"""The advised test is made by an independent integrator, and tells the rivals apart."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.beam import Beam
from romsindy.diagnosis import BeamReport
from romsindy.diagnosis.gap import Gap, Prediction
from romsindy.diagnosis.next_test import (
    AGAIN,
    EXPERIMENTS,
    LARGER,
    LONGER,
    Experiment,
    Extrapolation,
    more_of_it,
)
from romsindy.diagnosis.on_beam.all_sensors import Latitude
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.effects import (
    CubicStiffness,
    Gain,
    GrowingDamping,
    LinearFrequency,
    MoreMass,
    SpeedCubedDamping,
)
from romsindy.fit.records.record import Record
from romsindy.text import two_digits

OMEGA = 2 * np.pi * 5
NOMINAL = {"omega^2": OMEGA**2, "gamma_3": 0.2 * OMEGA**2, "c_linear": 0.01 * OMEGA}
MODEL = rs.ReducedModel.from_coefficients(NOMINAL, unit="rad")
CATALOGUE = (GrowingDamping(), SpeedCubedDamping(), CubicStiffness(), Gain())
NOISE = 0.012  # about 30 dB of the first record
HIGHER = Experiment("from {amplitude}", 1.0, amplitude=2.0)


def damping(q, v):
    return 0.5 * q * q * v


def cubic(q, v):
    return 4.0 * q**3


def nothing(q, v):
    return 0.0


def strange(q, v):
    return 3.0 * np.tanh(20 * q)


def decay(amplitude, force, seed, duration=12.0):
    def rates(t, y):
        q, v = y
        known = NOMINAL["omega^2"] * q + NOMINAL["gamma_3"] * q**3 + NOMINAL["c_linear"] * v
        return [v, -known - force(q, v)]

    t = np.arange(0, duration, 0.005)
    q = solve_ivp(rates, (0, duration), [amplitude, 0], "DOP853", t, rtol=1e-9, atol=1e-10).y[0]
    return rs.Decay(t, q + NOISE * np.random.default_rng(seed).standard_normal(len(t)), unit="rad")


def diagnosed(force, *more):
    learn = [decay(a, force, seed) for seed, a in enumerate((1.0, 0.6))]
    return rs.diagnose(MODEL, [*learn, *more], held_out=decay(0.8, force, 2), catalogue=CATALOGUE)


report = cache(diagnosed)  # several tests look at the same diagnosis


def rivals_of(found):
    return [Extrapolation.of(MODEL, h, found.records, 0) for h in found.rivals]


@pytest.mark.study
@pytest.mark.slow
def test_the_advised_test_names_what_was_ambiguous():
    # q^2 q_dot and q_dot^3 take the same energy from a harmonic motion: a third harmonic, below
    # the noise at these amplitudes, is all that tells them apart.
    before = report(damping)
    assert before.verdict == "ambiguous"
    assert set(before.equivalent) == {("amplitude_damping",), ("cubic_damping",)}
    advice = before.next_test
    assert advice.enough
    assert f"{advice.action} would separate" in advice.sentence
    test = advice.test
    more = [
        decay(test.amplitude, damping, 7 + i, 12.0 * test.duration) for i in range(test.repetitions)
    ]
    after = diagnosed(damping, *more)
    assert after.verdict == "named"
    assert after.best.names == ("amplitude_damping",)


@pytest.mark.slow
def test_what_no_test_can_tell_apart_is_said_so():
    # For a Duffing oscillator a gain g of the sensor is a cubic stiffness over g^2, at any release.
    found = report(lambda q, v: 15.0 * q**3)
    assert found.verdict == "ambiguous"
    assert found.equivalent == (("cubic_stiffness",), ("gain",))  # a value comes first
    assert not found.next_test.enough
    assert found.next_test.sentence.startswith("no test that was simulated would separate")
    assert "a calibration of the sensor" in found.next_test.sentence


@pytest.mark.slow
def test_a_test_in_which_values_do_the_same_tells_nothing():
    """A spring and a damper in series, at one frequency another stiffness and damping.

    By likelihood a larger amplitude, of a frequency a little higher, would tell; in practice the
    two are as one, and the values are told first however often that is made.
    """
    known = {"omega^2": OMEGA**2, "gamma_3": 0.1 * OMEGA**2, "c_linear": 0.01 * OMEGA}
    model, t = rs.ReducedModel.from_coefficients(known), np.arange(0, 16, 0.005)
    tau, k = 0.04, 0.002 * OMEGA**2

    def rates(t, y):
        force = known["omega^2"] * y[0] + known["gamma_3"] * y[0] ** 3 + known["c_linear"] * y[1]
        return [y[1], -force - k * y[2], y[1] - y[2] / tau]

    def released(amplitude, seed):
        q = solve_ivp(rates, (0, t[-1]), [amplitude, 0, 0], "DOP853", t, rtol=1e-9, atol=1e-10)
        return rs.Decay(t, q.y[0] + 0.01 * np.random.default_rng(seed).standard_normal(len(t)))

    found = rs.diagnose(model, [released(1.0, 1)], held_out=released(0.8, 2))
    assert found.verdict == "ambiguous" and ("maxwell",) in found.equivalent
    assert not found.next_test.enough
    assert "a mass added" in found.next_test.sentence and "1 : 1" not in found.next_test.sentence


@pytest.mark.slow
def test_the_cheapest_of_the_tests_that_tell_is_advised():
    tests = [AGAIN, replace(HIGHER, cost=2.0), replace(HIGHER, cost=3.0, amplitude=3.0)]
    assert report(damping).advised(tests).test == tests[1]
    dear = [AGAIN, replace(HIGHER, cost=4.0), tests[2]]
    assert report(damping).advised(dear).test == tests[2]


@pytest.mark.slow
def test_the_amplitude_is_stated_in_the_unit_of_the_data():
    assert report(damping).advised([HIGHER]).action == "from 2 rad"


def test_four_repetitions_tell_as_much_as_half_the_noise():
    found = report(damping)
    four, quiet = replace(HIGHER, repetitions=4), replace(HIGHER, noise=0.5)
    true, other = rivals_of(found)
    # Without structure, which no repetition removes.
    alone = replace(other.fitted, weighed=replace(other.fitted.weighed, gain=0.0))
    other = replace(other, fitted=alone)
    many, one = (true.shows(test, found.records[0], None) for test in (four, quiet))
    end = float(min(many.t[-1], one.t[-1]))  # the quieter is longer above its noise
    # Both are the same least-squares problem but for rounding.
    many, one = many.until(end), one.until(end)
    assert_allclose(other.misfit(many, four), other.misfit(one, quiet), rtol=1e-6)


def test_a_rival_follows_its_own_motion():
    found = report(damping)
    for rival in rivals_of(found):
        own = replace(rival, weaker=rival.parts).shows(HIGHER, found.records[0], None)
        # Of 2400 samples: what Newton's method leaves.
        assert rival.misfit(own, HIGHER) < 1e-6


@pytest.mark.slow
def test_no_test_is_advised_where_none_is_needed():
    assert report(nothing).next_test is None


@pytest.mark.slow
def test_all_tests_that_are_known_can_be_simulated():
    found = report(damping)
    assert all(found.advised([test]) is not None for test in EXPERIMENTS)


@pytest.mark.slow
def test_where_nothing_explains_the_data_the_test_shows_more_of_it():
    # A spring that yields at once is not looked for. Odds between what was refused mean nothing.
    found = report(strange)
    assert found.verdict == "unknown"
    advice = found.next_test
    assert advice.odds is None and not advice.rivals
    assert f"{advice.action} would show" in found.sentence


@pytest.mark.parametrize(("power", "test"), [(2, LARGER), (0, AGAIN), (-1, LONGER)])
def test_what_grows_with_the_amplitude_asks_for_a_larger_one(power, test):
    """A second harmonic that goes with a power of the amplitude is left, from 1 to 0.1 rad.

    It stays below the first, so that there are two crossings a cycle: 0.05 rad at most.
    """
    t = np.arange(0.0, 23.0, 0.02)
    amplitude = np.exp(-0.1 * t)
    measured = amplitude * np.cos(OMEGA * t)
    left = 0.005 * amplitude**power * np.cos(2 * OMEGA * t)
    noise = NOISE * np.random.default_rng(4).standard_normal(len(t))
    record = Record.of(rs.Decay(t, measured + noise, unit="rad"), 1e-6)
    whole = replace(record, signal=measured + left)
    gap = Gap((Prediction(whole, measured, measured),), False)
    advice = more_of_it(gap.loud_and_quiet, 1.0, gap.shown)
    assert advice.test == test
    loud = amplitude > 0.5
    sizes = (np.sqrt(np.mean(left[part] ** 2)) / record.noise.std for part in (loud, ~loud))
    assert_allclose(advice.left[:2], list(sizes), rtol=0.05)
    # The largest of cycles that are half a cycle old at the least.
    assert advice.half == "0.49 rad" or advice.half == "0.5 rad"
    assert f"{advice.action} would show" in advice.sentence


def test_a_measured_velocity_is_told_as_the_amplitude_of_its_displacement(tmp_path):
    """Half of OMEGA x 1 rad/s is 0.5 rad."""
    t = np.arange(0.0, 23.0, 0.02)
    amplitude = np.exp(-0.1 * t)
    speed = OMEGA * amplitude * np.cos(OMEGA * t)
    speed += NOISE * np.random.default_rng(4).standard_normal(len(t))
    np.savetxt(tmp_path / "v.csv", np.c_[t, speed], delimiter=",", header="t [s],v [rad/s]")
    record = Record.of(rs.load_decay(tmp_path / "v.csv").free(), 1e-6)
    left = 0.05 * np.exp(-0.2 * record.t) * np.cos(2 * OMEGA * record.t)
    whole = replace(record, signal=record.signal + left)
    half = Gap((Prediction(whole, record.signal, record.signal),), False).loud_and_quiet.half
    assert half == pytest.approx(0.5, rel=0.03)  # the largest cycle is half a cycle old


def test_of_a_beam_the_amplitude_is_that_of_the_sensor_that_moves_most():
    beam = Beam.cantilever()
    seen = InstrumentedBeam(beam, beam.sensors([0.2, 0.45]))
    slack = Latitude.of(seen, (), (0.0, 0.0), np.zeros(seen.shapes.shape))
    found = BeamReport(
        reduced=report(damping), faults=(), seen=seen, parts=(), sensor_errors=(), slack=slack
    )
    tip = beam.modes(count=1).shapes[0][-1, 1]  # m for a coordinate of 1
    advice = found.next_test
    assert advice.odds == report(damping).next_test.odds
    size = two_digits(1e3 * advice.test.amplitude * abs(tip))
    assert advice.action == f"a decay from {size} mm at y(0.45)"


def test_an_effect_that_comes_out_as_nothing_is_no_rival():
    # Added mass lowers a frequency; where it is higher, none is what fits best.
    learn = [decay(a, lambda q, v: 0.004 * OMEGA**2 * q, seed) for seed, a in enumerate((1.0, 0.6))]
    catalogue = (MoreMass(), LinearFrequency())
    assert rs.diagnose(MODEL, learn, catalogue=catalogue).equivalent == (("linear_frequency",),)
