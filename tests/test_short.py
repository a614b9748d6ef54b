"""The few terms that follow functions: against equations that have few, and none."""

import numpy as np
import pytest

import romsindy as rs
from romsindy.fit.functions.identification import shortened

FEW = {"omega^2": 40.0, "gamma_3": 60.0, "Upsilon_3": 2.0, "c_linear": 0.1, "delta_2": 0.3}
REACH = (-0.5, 0.45)


def model(coefficients):
    return rs.ReducedModel.from_coefficients(coefficients, unit="m")


def shaken(coefficients, n=20, part=1e-4, seed=0):
    """Equations near one: every coefficient by a part of itself."""
    rng = np.random.default_rng(seed)
    return [
        model({k: v * (1 + part * rng.standard_normal()) for k, v in coefficients.items()})
        for _ in range(n)
    ]


def test_an_equation_of_few_terms_is_its_own_short_one():
    """Errors of 1e-4 in each draw; the linearised fit of a draw is as good as their square."""
    some = FEW | {"gamma_2": 0.0, "gamma_4": 0.0, "gamma_5": 0.0}
    short = shortened(model(some), shaken(some), REACH, {})
    assert short.follows and set(short.model.coefficients) == set(FEW)
    assert short.frequency.off < 1e-8 and short.damping.off < 1e-8
    assert short.amplitude == pytest.approx(0.95 * 0.45)
    drawn = shaken(some)
    for name, value in FEW.items():
        assert short.model.coefficients[name] == pytest.approx(value, rel=1e-6)
        ends = np.percentile([m.coefficients[name] for m in drawn], (2.5, 97.5))
        assert short.bands[name] == pytest.approx(ends, abs=0.2 * np.ptp(ends))


def test_amplitudes_without_motion_take_no_part():
    """K(q) = 0 at q = sqrt(40 / 300) = 0.365: nothing swings beyond."""
    some = {"omega^2": 40.0, "gamma_3": -300.0, "c_linear": 0.1}
    short = shortened(model(some), shaken(some), REACH, {})
    assert short.follows and set(short.model.coefficients) == set(some)
    assert 0.3 < short.amplitude < np.sqrt(40 / 300)


def test_coefficients_that_go_together_are_not_dropped_one_by_one():
    """+-1e5 q^5 and q^7 cancel on the range: what is left is a spring with a cube."""
    many = FEW | {"gamma_5": 400.0, "gamma_7": -2000.0, "gamma_9": 1000.0}
    short = shortened(model(many), shaken(many), REACH, {})
    a = np.linspace(0.05, 0.95, 30) * 0.45
    exact, own = model(many).backbone(a), short.model.backbone(a)
    assert short.follows and len(short.model.terms) <= 8
    assert np.abs(own - exact).max() < 0.11 * np.ptp(exact)  # and as much between the places


def test_what_no_few_terms_follow_is_not_given_in_short():
    """A dip in the middle of the range, as of a joint: cos(40 q^2) as a series."""
    series = {f"gamma_{4 * i + 1}": 8 * (-1) ** i * 40.0 ** (2 * i) / f for i, f in FACTORIALS}
    waves = {"omega^2": 40.0, "gamma_2": 0.0, "gamma_3": 0.0, "c_linear": 0.1} | series
    short = shortened(model(waves), shaken(waves, part=1e-6), REACH, {})
    assert not short.follows and short.frequency.off > 0.1 * short.frequency.change
    assert short.model.coefficients == {"omega^2": 40.0, "c_linear": 0.1}
    assert short.bands["omega^2"][0] < 40 < short.bands["omega^2"][1]


FACTORIALS = [(i, float(np.prod(np.arange(1, 2 * i + 1)))) for i in range(1, 12)]


def test_a_change_that_is_not_known_is_followed_to_its_error():
    """Draws scatter by 1e-3; the cube changes the frequency by less."""
    flat = {"omega^2": 40.0, "gamma_2": 0.0, "gamma_3": 0.02, "c_linear": 0.1}
    short = shortened(model(flat), shaken(flat, part=1e-3), REACH, {})
    assert short.follows and set(short.model.coefficients) == {"omega^2", "c_linear"}


def test_known_coefficients_stay():
    some = FEW | {"gamma_2": 0.0}
    short = shortened(model(some), shaken(some), REACH, {"omega^2": 40.0})
    assert short.model.coefficients["omega^2"] == 40.0 and "omega^2" not in short.bands


def test_the_unit_of_q_changes_nothing():
    """Micrometres read in m: q^4 of the inertia is 1e-24 beside its 1."""
    some = FEW | {"gamma_2": 0.0, "gamma_5": 0.0, "Upsilon_4": 0.0, "Upsilon_5": 0.0}
    micro = 1e-6

    def small(m):
        size = [micro ** (term.dimension[0] - 1) for term in m.terms]
        return rs.ReducedModel(m.terms, tuple(np.divide(m.values, size)), "m")

    few = shortened(model(some), shaken(some), REACH, {})
    same = shortened(small(model(some)), [*map(small, shaken(some))], np.multiply(micro, REACH), {})
    assert few.follows and same.follows
    assert same.model.coefficients == pytest.approx(small(few.model).coefficients, rel=1e-6)
