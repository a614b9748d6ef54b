"""Frequency and damping of the modes of several coordinates, with standard errors."""

from __future__ import annotations

import numpy as np
import pytest
import test_coupled_orbits as by_hand
from test_estimate import BY_HAND

import romsindy as rs
from romsindy.fit.adequacy.verdicts import Adequacy

FIRST = {"omega^2": 36.0, "gamma_2": -3.0, "gamma_3": 9.0, "Upsilon_3": 0.4, "c_coulomb": 0.02}
SECOND = {"omega^2": 150.0, "gamma_3": 20.0, "c_linear": 0.3, "c_quadratic": 0.2}


def on(coordinate, coefficients):
    return {f"{name} [q{coordinate}]": value for name, value in coefficients.items()}


def estimate(model, free, covariance):
    return rs.Estimate(model, tuple(free), covariance, Adequacy(**BY_HAND["verdict"]), ())


def correlated(values, part=0.01, seed=0):
    """Covariance of errors that are a part of the values."""
    mixed = np.random.default_rng(seed).normal(size=(len(values), len(values)))
    found, size = mixed @ mixed.T, part * np.abs(values)
    own = np.sqrt(np.diag(found))
    return found / np.outer(own, own) * np.outer(size, size)


@pytest.mark.parametrize("mode", [1, 2])
def test_uncoupled_modes_have_the_bands_of_one_coordinate(mode):
    own = (FIRST, SECOND)[mode - 1]
    both = rs.CoupledModel.from_coefficients({**on(1, FIRST), **on(2, SECOND)}, unit="m")
    single = rs.ReducedModel.from_coefficients(own, unit="m")
    covariance = correlated(single.values)
    amplitudes = np.linspace(0.05, 0.8, 7)
    alone = estimate(single, own, covariance).band(amplitudes)
    found = estimate(both, on(mode, own), covariance).band(amplitudes, mode)
    # Harmonics leave 1e-8 of the force, squared in the frequency; all kinks are at turning points.
    np.testing.assert_allclose(found.frequency, alone.frequency, rtol=1e-6)
    np.testing.assert_allclose(found.damping_ratio, alone.damping_ratio, rtol=1e-6)
    # Ours are to first order in the coefficients, theirs differences over a tenth of an error.
    np.testing.assert_allclose(found.frequency_std, alone.frequency_std, rtol=1e-2)
    np.testing.assert_allclose(found.damping_ratio_std, alone.damping_ratio_std, rtol=1e-2)
    assert found.unit == "m"


# -- through an interaction, against shooting -----------------------------------------------------

DAMPING = {"c_linear [q1]": 0.02, "c_linear [q2]": 0.05, "C_12": 0.004, "C_22 q1^2": 0.03}
DAMPED = rs.CoupledModel.from_coefficients({**by_hand.TONGUE.coefficients, **DAMPING}, unit="m")
FREE = ("gamma_3 [q1]", "c_linear [q1]")
COVARIANCE = np.array([[4e-4, 2e-6], [2e-6, 1e-6]])


@pytest.fixture(scope="module")
def tongue():
    return rs.backbone_curve(by_hand.TONGUE, (0.01, 1.0))


def energy(x, y):
    quartic = by_hand.CUBIC * x**4 / 4 + by_hand.CROSS * x**3 * y + by_hand.SHARED * x**2 * y**2
    return x**2 / 2 + 5 * y**2 + quartic


def shot_curves(start, period, c1):
    """Frequency and damping ratio of the orbit with q1 = start[0] where it turns.

    Forces are odd in q, and so q1 turns at -start[0]: that is half of peak to peak.
    """
    a, step = start[0], 1e-4  # central differences: the error is step^2
    ends = [by_hand.shot(np.multiply(start, [1 + s, 1, 1, 1]), period, 0) for s in (step, -step)]
    growth = np.subtract(*(energy(*state[:2]) for state, _ in ends)) / (2 * step * a)
    state, period = by_hand.shot(start, period, 0)
    motion = by_hand.flown([state], period, samples=401)[:-1, 0]
    x, _, v, w = motion.T
    power = c1 * v**2 + 0.05 * w**2 + 2 * 0.004 * v * w + 0.03 * x**2 * w**2
    return np.array([2 * np.pi / period, np.mean(power) * period / (2 * np.pi * a * growth)])


@pytest.mark.parametrize("before", [pytest.param(8, marks=pytest.mark.slow), 12])
def test_bands_in_an_interaction_are_those_of_shooting(tongue, before, monkeypatch):
    """Of q1 and q2 before the fold, where q2 moves at three times the frequency."""
    at = tongue.folds[0] - before
    start, period = by_hand.starts(tongue)[at], 2 * np.pi / tongue.frequency[at]
    assert abs(start[1]) > 0.005 * start[0]
    band = estimate(DAMPED, FREE, COVARIANCE).band([start[0]])
    expected = shot_curves(start, period, 0.02)
    # Integration to 1e-12; the energy by differences of 1e-4, of a curve that bends.
    np.testing.assert_allclose(band.frequency, expected[0], rtol=1e-8)
    np.testing.assert_allclose(band.damping_ratio, expected[1], rtol=1e-5)
    step = 0.001
    by_c = (shot_curves(start, period, 0.021) - shot_curves(start, period, 0.019)) / 0.002
    ends = []
    for side in (step, -step):
        monkeypatch.setattr(by_hand, "CUBIC", 1.0 + side)
        ends.append(shot_curves(start, period, 0.02))
    slopes = np.array([(ends[0] - ends[1]) / (2 * step), by_c])
    errors = np.sqrt(np.einsum("pc,pq,qc->c", slopes, COVARIANCE, slopes))
    # Differences over other steps than the band's, of curves that bend.
    np.testing.assert_allclose(
        [band.frequency_std[0], band.damping_ratio_std[0]], errors, rtol=0.01
    )


@pytest.mark.slow
def test_beyond_a_fold_there_is_nothing(tongue):
    (fold,) = tongue.folds
    own, rate = tongue.amplitude[: fold + 1, 0], tongue.frequency[: fold + 1]
    highest = own[fold]
    amplitudes = np.array([0.9, 0.5 * highest, 1.01 * highest, 0.99 * highest])
    band = estimate(DAMPED, FREE, COVARIANCE).band(amplitudes)
    nothing = [True, False, True, False]
    for found in (band.frequency, band.damping_ratio, band.frequency_std, band.damping_ratio_std):
        np.testing.assert_array_equal(np.isnan(found), nothing)
    # Straight lines between the orbits of a curve.
    near = np.interp(amplitudes[[1, 3]], own, rate)
    np.testing.assert_allclose(band.frequency[[1, 3]], near, rtol=1e-4)


@pytest.mark.parametrize(
    ("amplitudes", "mode", "message"),
    [
        ([0.1], 3, "mode = 3 is none of the modes 1 to 2"),
        ([0.1, -0.1], 1, "amplitudes must be positive"),
        ([], 1, "amplitudes must be positive"),
    ],
)
def test_what_has_no_band(amplitudes, mode, message):
    with pytest.raises(ValueError, match=message):
        estimate(DAMPED, FREE, COVARIANCE).band(amplitudes, mode)


def test_other_models_without_bands():
    single = rs.ReducedModel.from_coefficients(SECOND, unit="m")
    with pytest.raises(ValueError, match="mode = 2 is none of a model of one coordinate: give 1"):
        estimate(single, (), np.zeros((0, 0))).band([0.1], mode=2)
    pair = {"omega^2 [q1]": 1.0, "omega^2 [q2]": 5.0, "beta_2 [q1]": 0.1}
    model = rs.CoupledModel.from_coefficients(pair)
    with pytest.raises(ValueError, match=r"inertia of \['beta_2 \[q1\]'\] has no kinetic energy"):
        estimate(model, (), np.zeros((0, 0))).band([0.1])


def test_damping_alone_leaves_the_frequency_sure():
    band = estimate(DAMPED, FREE[1:], COVARIANCE[1:, 1:]).band([0.1, 0.2])
    np.testing.assert_array_equal(band.frequency_std, 0.0)
    assert np.all(band.damping_ratio_std > 0)
