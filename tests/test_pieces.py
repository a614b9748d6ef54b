"""Several coordinates fitted in pieces of their records, and sensors that show products.

The simulators here are equations written down by hand, integrated by scipy.
"""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from romsindy import CoupledModel, Decay, identify
from romsindy.fit.kernel.collocation import Trajectory
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import free_coefficients
from romsindy.fit.kernel.shooting import fit_pieces, lengths
from romsindy.fit.records.coupled import CurvedShape, coupled_records, free_shapes
from romsindy.fit.results.fitted import refined, small_vibrations
from romsindy.show.identified import Identified
from romsindy.show.panels import over_time

# Hardening: the first coordinate falls from 15 to 10 Hz, through a third of the second's 40 Hz.
TRUTH = {
    "omega^2 [q1]": (2 * np.pi * 10.0) ** 2,
    "omega^2 [q2]": (2 * np.pi * 40.0) ** 2,
    "c_linear [q1]": 0.8,
    "c_linear [q2]": 1.0,
    "gamma_3 [q1]": 8000.0,
    "V q1^3 q2": 4000.0,
}


def motion(t, start, noise_seed=None):
    """q and q_dot, (n, 2) each."""

    def rates(_, y):
        q1, q2, v1, v2 = y
        k1, k2, c1, c2, gamma, v = TRUTH.values()
        force_1 = k1 * q1 + c1 * v1 + gamma * q1**3 + 3 * v * q1**2 * q2
        return [v1, v2, -force_1, -(k2 * q2 + c2 * v2 + v * q1**3)]

    options = {"t_eval": t, "method": "DOP853", "rtol": 1e-10, "atol": 1e-12}
    y = solve_ivp(rates, (0, t[-1]), [*start, 0.0, 0.0], **options).y.T
    return y[:, :2], y[:, 2:]


def noisy(x, rng, decibel=40):
    return x + 10 ** (-decibel / 20) * x.std(axis=0) * rng.standard_normal(x.shape)


T = np.arange(0, 5, 1 / 600)


@pytest.fixture(scope="module")
def record():
    rng = np.random.default_rng(5)
    seen = motion(T, (0.8, 0.1))[0] @ np.array([[1.0, 0.4], [0.6, 1.0]])
    decay = Decay(T, noisy(seen, rng), unit="m", stage="free")
    return coupled_records([decay], np.array([10.0, 40.0]), 1e-6)[0]


@pytest.mark.parametrize("n", [1, 3, 7])
def test_pieces_hold_every_sample_once(record, n):
    pieces = record.pieces(n)
    channels = [p.signal.reshape(2, -1) for p in pieces]
    np.testing.assert_array_equal(np.concatenate(channels, axis=1).ravel(), record.signal)
    joined = Trajectory.joined(record.motion.grid, [p.motion for p in pieces])
    for name in ("q", "q_dot", "q_ddot"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(record.motion, name))
    # The clock goes on: a piece knows where in the record it lies.
    starts = [p.since for p in pieces]
    np.testing.assert_allclose(starts, [p.clock - record.clock for p in pieces], atol=1e-12)
    assert sum(len(p.decay.t) for p in pieces) == len(T)


def test_a_piece_where_nothing_rings_any_more_is_fitted_as_the_others(record):
    """Its motion starts from rest, and comes out as that of the whole record."""
    model = CoupledModel.from_coefficients(TRUTH, unit="m")
    parts = free_coefficients(model, list(TRUTH))
    first, last = record.pieces(2)
    m = last.motion
    silent = last.with_motion(Trajectory(m.grid, 0 * m.q, 0 * m.q_dot, 0 * m.q_ddot))
    found, known = (fit(model, parts, [first, p]) for p in (silent, last))
    assert silent.amplitude == 0.0 and found.converged and known.converged
    assert found.chi_squared == pytest.approx(known.chi_squared, rel=1e-6)


def test_one_piece_is_the_record(record):
    model = CoupledModel.from_coefficients(TRUTH, unit="m")
    parts = free_coefficients(model, list(TRUTH))
    whole, piece = fit(model, parts, [record]), fit_pieces(model, parts, [record], np.inf)
    assert whole.converged and piece.chi_squared == whole.chi_squared
    np.testing.assert_array_equal(piece.residuals[0], whole.residuals[0])


def test_a_rough_fit_ends_where_long_steps_lead_astray_and_short_ones_nowhere(record):
    """Inertia in the place of a stiffness: no more of its steps is worth what one takes."""
    wrong = {k: v for k, v in TRUTH.items() if "gamma" not in k and "V" not in k}
    model = CoupledModel.from_coefficients(wrong | {"g(q1^2)^2": 0.1}, unit="m")
    parts, pieces = free_coefficients(model, list(model.coefficients)), record.pieces(5)
    few, many = (fit(model, parts, pieces, rough=1e-3, iterations=n) for n in (8, 50))
    assert not many.converged and many.chi_squared == few.chi_squared
    # To the last digit it goes on, to and fro.
    few, many = (fit(model, parts, pieces, iterations=n) for n in (5, 16))
    assert not many.converged and many.chi_squared != few.chi_squared


@pytest.mark.study
@pytest.mark.slow
def test_a_report_of_pieces_says_so(record):
    """Tones and decays are told once; a simulation starts with each piece, and is told as one."""
    model = CoupledModel.from_coefficients(TRUTH, unit="m")
    whole, pieces = (
        refined(model, ("c_linear [q1]",), records, free_shapes([record]), settled=True)
        for records in ([record], record.pieces(3))
    )
    assert len(pieces.records) == 3
    one, three = small_vibrations(whole, whole.records), small_vibrations(pieces, pieces.records)
    for a, b in zip(one, three, strict=True):
        np.testing.assert_array_equal(a.measured_amplitude, b.measured_amplitude)
    said = [
        [*over_time(Identified("", [record.decay], fit, channels=["left", "right"]))][-1].caption
        for fit in (whole, pieces)
    ]
    assert "the decay from its start" in said[0] and "worst" not in said[0]
    assert "the piece from its start" in said[1] and "the worst of 3" in said[1]


def test_pieces_about_double_until_they_are_whole(record):
    *several, last = lengths([record])
    assert last == np.inf
    cycles = record.t[-1] * min(np.median(tone.frequency) for tone in record.tones)
    growth = [b / a for a, b in itertools.pairwise([*several, cycles])]
    # A whole number of equal factors, as near to doubling as can be.
    np.testing.assert_allclose(growth, (cycles / several[0]) ** (1 / len(several)), rtol=1e-9)
    assert 2**0.5 <= growth[0] <= 2**1.5


@pytest.mark.slow
def test_an_interaction_that_is_passed_through_is_found():
    """One velocity channel; the measured motion at the start has no harmonics and no phase lock."""
    rng, decays = np.random.default_rng(8), []
    for start in ((0.9, 0.05), (0.6, 0.1)):
        v = motion(T, start)[1].sum(axis=1)
        decays.append(Decay.from_velocity(T, noisy(v, rng), unit="m"))
    fit = identify(decays, 2)
    found, error = fit.model.coefficients, fit.standard_errors
    assert {"gamma_3 [q1]", "V q1^3 q2"} <= {*found}
    off = [(found[k] - v) / error[k] for k, v in TRUTH.items()]
    # Six values: one in 2000 such fits has one beyond four standard errors.
    assert np.abs(off).max() < 4
    assert fit.adequacy == pytest.approx(1.0, abs=0.1)  # noise is known to some per cent


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_what_a_sensor_shows_of_a_product(derivative):
    """q1^2 q2 of two waves, differentiated by hand: products of cosines are sums of them."""
    t = np.linspace(0, 3, 50)
    a, b = 2.0, 3.3
    rates = np.array([b, 2 * a + b, 2 * a - b])
    sizes = np.array([0.5, 0.25, 0.25])  # cos^2(a t) cos(b t)
    wave = [np.cos, lambda x: -np.sin(x), lambda x: -np.cos(x)]

    def of(rate, order):
        return rate**order * wave[order](rate * t)

    orders = [np.stack([of(a, k), of(b, k)], axis=1) for k in range(derivative + 1)]
    x, effect = np.concatenate(orders, axis=1), CurvedShape(0, (2, 1))
    true = sum(s * of(r, derivative) for s, r in zip(sizes, rates, strict=True))
    np.testing.assert_allclose(effect.readings(t, x)[0], true, atol=1e-12)
    slopes, step = effect.shown_slopes(x), 1e-6
    for i in range(x.shape[1]):
        near = [x + s * step * np.eye(x.shape[1])[i] for s in (1, -1)]
        up, down = (effect.readings(t, y)[0] for y in near)
        np.testing.assert_allclose(slopes[:, i], (up - down) / (2 * step), atol=1e-7)


@pytest.fixture(scope="module")
def curved():
    """Four sensors of two coordinates; two of them show q1^2, one q1^3 as well."""
    rng, decays = np.random.default_rng(6), []
    shapes = np.array([[1.0, 0.4, 0.3, 0.7], [0.3, 1.0, -0.8, 0.2]])
    for start in ((0.8, 0.1), (0.5, 0.2), (0.7, 0.15)):
        q = motion(T, start)[0]
        seen = q @ shapes
        seen[:, 2] += 0.2 * q[:, 0] ** 2
        seen[:, 3] += 0.1 * q[:, 0] ** 2 - 0.3 * q[:, 0] ** 3
        decays.append(Decay(T, noisy(seen, rng), unit="m", stage="free"))
    return decays, identify(decays[:2], "auto")


@pytest.mark.slow
def test_sensors_that_show_products_are_seen_through(curved):
    decays, fit = curved
    parts = {p.effect.variant: p.strengths[0, 0] for p in fit.solution.parts}
    # Noise of 1 % in 6000 samples; products are a tenth of what is seen.
    assert parts["channel 3, q1^2"] == pytest.approx(0.2, abs=0.01)
    assert parts["channel 4, q1^2"] == pytest.approx(0.1, abs=0.01)
    assert parts["channel 4, q1^3"] == pytest.approx(-0.3, abs=0.03)
    assert fit.adequacy == pytest.approx(1.0, abs=0.1)
    np.testing.assert_array_equal(fit.curved_shapes["q1^3"][3], parts["channel 4, q1^3"])
    assert "sensors show products of coordinates as well: q1^2, q1^3" in str(fit)
    missed = fit.predict(decays[2], 200) - decays[2].q
    # Noise is 1 % of the standard deviation; the state comes from 200 samples.
    assert np.all(missed.std(axis=0) < 0.02 * decays[2].q.std(axis=0))


@pytest.mark.slow
def test_an_interrupt_keeps_what_was_found(curved):
    decays, _ = curved
    rounds = []

    def stop(line):
        rounds.append(line)
        if sum(text.startswith("terms") for text in rounds) == 2:
            raise KeyboardInterrupt

    fit = identify(decays[0], 2, progress=stop)
    assert any(note.startswith("interrupted") for note in fit.notes)
    assert fit.model.n_coordinates == 2 and fit.solution.interrupted
    rounds[:] = ["terms"]
    with pytest.raises(KeyboardInterrupt):  # at the first choice nothing has been found
        identify(decays[0], 2, progress=stop)
