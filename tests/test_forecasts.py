"""Bands of forecasts: the law of form errors, what records and levels differ by, and coverage."""

import numpy as np
import pytest

import romsindy as rs
from romsindy.fit.kernel.hypothesis import free_parts
from romsindy.fit.process_noise import KNOWN, Windows, grown, normal_draws, scatter
from romsindy.fit.records.arguments import prepared
from romsindy.physics.stiffness import Stiffness

OMEGA = 20.0
LINEAR = {"omega^2": OMEGA**2, "c_linear": 0.4}
T = np.arange(0, 12, 0.01)


def decay(values, seed, amplitude=1.0, noise=1e-3):
    clean = rs.ReducedModel.from_coefficients(values, unit="m").simulate(amplitude, 0.0, T)
    q = clean.q + noise * np.random.default_rng(seed).standard_normal(len(T))
    return rs.Decay(T, q, unit="m", stage="free")


def held(forecast, signal, first):
    inside = (forecast.low <= signal) & (signal <= forecast.high)
    return np.mean(inside[first:])


def windows_of(values, reach=np.inf):
    model = rs.ReducedModel.from_coefficients(values, unit="m")
    record = prepared(decay(values, 0), "m")[0]
    smooth, parts = free_parts(model, (), [record])
    return Windows.of(smooth, parts, 0, record, record.motion, reach), record


def test_a_departure_in_all_windows_is_another_frequency():
    """Of q = exp(-d t) cos(w t) the slope by w, w dq/dw = -w t exp(-d t) sin(w t)."""
    windows, record = windows_of(LINEAR)
    every = np.tile([1.0, 0.0], len(windows.jumps))
    change = windows.departed(0) @ np.linalg.solve(windows.roots, every)
    # t from the first sample that is used; the phase runs on from there.
    t = record.t + record.clock
    exact = -OMEGA * record.t * np.exp(-0.2 * t) * np.sin(OMEGA * t)
    # Windows of three cycles, the damping of 1 %, and the smoothed motion: a few per cent.
    assert np.abs(change - exact).max() < 0.04 * np.abs(exact).max()


def test_departures_grow_with_the_square_of_the_amplitude_beyond_the_data():
    assert np.array_equal(grown([0.5, 1.0, 2.0, 6.0], 2.0), [1.0, 1.0, 1.0, 9.0])
    within, beyond = (windows_of(LINEAR, reach)[0] for reach in (np.inf, 0.5))
    ratio = (
        np.linalg.norm(beyond.departed(0), axis=1)[30:]
        / np.linalg.norm(within.departed(0), axis=1)[30:]
    )
    assert np.all(ratio > 1) and 3.5 < ratio[0] < 4.0  # (1 / 0.5)^2 at the first window


def test_the_scatter_of_few_moves_holds_a_further_one():
    """Scales drawn from what is known, and moves from them: 95 % of the next ones are held."""
    rng, n, times = np.random.default_rng(0), 3, 4000
    sizes = 0.3 / np.sqrt(rng.chisquare(KNOWN, times) / KNOWN)
    moves = 5.0 + sizes[:, None] * rng.standard_normal((times, n + 1))
    bands = np.array([1.96 * scatter(m[:n], np.zeros(n), 0.3) for m in moves])
    inside = np.mean(np.abs(moves[:, n] - moves[:, :n].mean(axis=1)) < bands)
    # Three standard errors of a share of 95 % of 4000.
    assert inside == pytest.approx(0.95, abs=0.0105)


def test_draws_have_their_covariance_whatever_the_scales():
    covariance = np.array([[1e12, 9e2, 0.0], [9e2, 1e-6, 0.0], [0.0, 0.0, 0.0]])
    found = np.cov(normal_draws(covariance, np.random.default_rng(1)), rowvar=False)
    # Of 400 draws, four standard errors of a variance.
    np.testing.assert_allclose(found, covariance, rtol=0.3)
    assert np.all(found[2] == 0)


def test_the_band_of_a_decay_holds_the_errors_of_its_coefficients():
    """Against models drawn from the covariance, each simulated from the first samples."""
    values = LINEAR | {"gamma_3": 100.0}
    found = rs.identify(decay(values, 1, noise=0.02), terms=[Stiffness(3)])
    other = decay(values, 2, 0.8, noise=1e-5)
    forecast = found.forecast(other, 300)
    drawn = []
    for change in found.draws()[2][:24]:
        moved = [v + c for v, c in zip(found.model.values, change, strict=True)]
        model = rs.ReducedModel(found.model.terms, tuple(moved), "m")
        near = rs.Estimate(model, (), np.zeros((0, 0)), found.verdict, ())
        drawn.append(near.predict(other, 300))
    exact = 1.96 * np.std(drawn, axis=0)
    half = (forecast.high - forecast.low) / 2
    late = slice(600, None)
    # Of 24 draws a standard deviation is known to 15 %; departures add a little.
    assert np.mean(half[late]) == pytest.approx(np.mean(exact[late]), rel=0.35)


def test_records_that_disagree_widen_the_band_and_are_told():
    moves = (1.0, 1.002, 0.999)
    runs = [decay({**LINEAR, "omega^2": OMEGA**2 * m**2}, i) for i, m in enumerate(moves)]
    found = rs.identify(runs, terms=[])
    assert "the records disagree: from one to another the frequency moves by 0.15 %" in str(found)
    alike = rs.identify([decay(LINEAR, i) for i in range(3)], terms=[])
    assert "disagree" not in str(alike) and alike.verdict.frequency == 0
    # The seen scatter, 0.0015, with what tests repeat to, 0.00036, and for four degrees of freedom.
    std = np.sqrt((2 * 0.00036**2 + 2 * np.var(moves, ddof=1)) / 4 * 4 / 3) * 2.776 / 1.96
    assert found.verdict.frequency == pytest.approx(std, rel=0.03)
    other = decay({**LINEAR, "omega^2": OMEGA**2 * 0.998**2}, 9)
    assert held(found.forecast(other, 100), other.q, 100) > 0.9
    assert held(alike.forecast(other, 100), other.q, 100) < 0.5


def test_a_term_that_lacks_is_in_the_band_and_beyond_the_data_it_is_told(tmp_path):
    """Stiffness of the fifth power, 2 % at the largest amplitude; saved and loaded it is the same.

    A band that knows the errors of coefficients alone holds half of it.
    """
    values = LINEAR | {"gamma_3": 20.0, "gamma_5": 8.0}
    found = rs.identify(decay(values, 1), terms=[Stiffness(3)])
    assert found.verdict.departure > 1e-4
    other = decay(values, 2, 1.2)
    forecast = found.forecast(other, 60)
    assert held(forecast, other.q, 60) > 0.85
    assert forecast.notes[0].startswith("the motion reaches 1.21 m, and the data only 1:")
    assert found.forecast(decay(values, 3, 0.8), 60).notes == ()
    found.save(tmp_path / "fit.json")
    again = rs.Estimate.load(tmp_path / "fit.json").forecast(other, 60)
    np.testing.assert_allclose(again.low, forecast.low, atol=1e-9)


def stepped(off, seed, noise=0.3):
    """A linear oscillator by its closed form, the force of each level off by a part of it."""
    rng = np.random.default_rng(seed)
    n = len(off)
    w, level = np.tile(np.linspace(0.9, 1.1, 25), n), np.repeat(np.arange(1.0, n + 1), 25)
    x = level * (1 + np.repeat(off, 25)) / (1 - w**2 + 0.04j * w)
    x += noise * (rng.standard_normal(len(x)) + 1j * rng.standard_normal(len(x)))
    model = rs.ReducedModel.from_coefficients({"omega^2": 1.0, "c_linear": 0.05})
    return rs.fit_steady(model, w, level, x, std=noise, phase=0.0)


def test_levels_of_a_stepped_sine_that_scatter_are_found():
    """The force alone, by less than the points scatter: six tell it to 30 %, and widen it."""
    off = 0.006 * np.array([1.0, -1.2, 0.8, -0.9, 1.1, -0.8])
    stiffness, damping, force = stepped(off, 3).test.form[0]
    assert 0.5 * np.std(off) < force < 2.5 * np.std(off)
    # As parts of the force at resonance: a tenth of it.
    assert stiffness / 0.04 < force and damping / 0.04 < force


def test_the_band_of_a_further_level_grows_beyond_the_data():
    found = stepped(0.006 * np.array([1.0, -1.2, 0.8, -0.9, 1.1, -0.8]), 3)
    inside, outside = (found.forced_response(f, (0.9, 1.1)) for f in (6.0, 12.0))
    relative = [(b.high - b.low).max() / b.amplitude.max() for b in (inside, outside)]
    # The errors of the coefficients are small beside the force, which errs four times as much.
    assert 2.5 < relative[1] / relative[0] < 4.0
    assert not any("grows" in note for note in inside.notes)
    assert any("the band grows as the square" in note for note in outside.notes)
