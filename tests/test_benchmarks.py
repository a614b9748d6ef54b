"""The benchmarks' own functions: their measures against values by hand, and small runs of them."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

import romsindy as rs
from romsindy.fit.collocation import TrajectoryError
from romsindy.physics.example import EXAMPLE_MODEL
from romsindy.regression.projection import Rows

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"


@pytest.fixture
def benchmark(request):
    """A benchmark as a module."""
    sys.path.insert(0, str(BENCHMARKS))
    try:
        return importlib.import_module(request.param)
    finally:
        sys.path.pop(0)


def benchmark_of(name):
    return pytest.mark.parametrize("benchmark", [name], indirect=True)


@benchmark_of("continuation")
def test_small_benchmark_of_continuation(benchmark):
    rows = benchmark.duffing(repeats=1) | benchmark.icrom(repeats=1)
    for name, row in rows.items():
        assert row.error <= 1e-9 or not name.endswith(("by themselves", "21", "41")), name
    for peer in (benchmark.auto_07p(20, repeats=1), benchmark.pycont_lite(repeats=1)):
        assert peer is None or peer.error < 1e-3


@benchmark_of("identification")
def test_small_benchmark(benchmark):
    """The benchmark's own functions, on fewer seeds: every number asked for is reached."""
    tables = benchmark.oscillator([5]) | benchmark.extracted([0]) | benchmark.plain_sindy()
    for name, (number, asked) in tables.items():
        assert number <= asked, name


@benchmark_of("bands")
def test_a_band_that_is_known(benchmark):
    low, high = np.array([0.0, 0.0, 0.0]), np.array([1.0, 2.0, 3.0])
    truth = np.array([0.5, 2.5, -0.25])
    assert benchmark.holds(low, high, truth).tolist() == [True, False, False]
    # Widths 1, 2, 3; the truth is 0.5 and 0.25 outside, and a unit costs 2 / 0.05 = 40.
    expected = ((1 + 0) + (2 + 20) + (3 + 10)) / 3
    assert benchmark.interval_score(low, high, truth) == pytest.approx(expected)
    assert benchmark.half_width(1.0, 3.0, -4.0) == pytest.approx(25.0)


@benchmark_of("bands")
def test_quantiles_have_the_best_interval_score(benchmark):
    """For a standard normal truth the score of +-z is least at z = 1.96."""
    truth = np.random.default_rng(0).standard_normal(200_000)
    z = np.linspace(1.6, 2.4, 9)
    scores = [benchmark.interval_score(-x, x, truth) for x in z]
    # 200,000 draws tell neighbours 0.1 apart, whose scores differ by 0.2 %.
    assert abs(z[np.argmin(scores)] - 1.96) < 0.1


@benchmark_of("bands")
def test_bootstrap_over_cycles_gives_standard_errors(benchmark):
    """Rows with independent errors: the closed form s^2 (X'X)^-1 of least squares."""
    rng, cycles, noise = np.random.default_rng(1), 400, 0.1
    x = rng.standard_normal((3 * cycles, 2)) * [1.0, 5.0]
    y = x @ [2.0, -3.0] + noise * rng.standard_normal(len(x))
    cycle, harmonic = np.divmod(np.arange(len(x)), 3)
    rows = Rows(x, y, cycle, harmonic, np.ones(cycles), np.ones(len(x)))
    exact = noise * np.sqrt(np.diag(np.linalg.inv(x.T @ x)))
    found = benchmark.resampled(rows).std(axis=0)
    # 200 repetitions know a standard deviation to 5 %, 400 cycles to another 4 %.
    np.testing.assert_allclose(found, exact, rtol=0.2)


@benchmark_of("known_beams")
def test_truth_of_the_benchmark_from_a_polynomial(benchmark):
    """h = 2 q^2 + 3 q^3 + 5 q^4 has Upsilon_3 = 2; K/q = 7 + q has omega^2 = 7."""
    q = np.linspace(-1.1, 1.1, 41)
    decay = rs.Decay(np.arange(9.0), np.linspace(1.0, -0.5, 9))
    known = benchmark.KnownDecay(decay, q, 2 * q**2 + 3 * q**3 + 5 * q**4, 7 + q)
    # Cubic splines on 41 nodes follow q^4 to some 1e-5.
    assert known.coefficients == pytest.approx({"omega^2": 7.0, "Upsilon_3": 2.0}, abs=1e-3)
    assert known.points.min() == pytest.approx(-0.5) and len(known.points) == 9 + 18


@benchmark_of("known_beams")
def test_arrays_are_made_once(benchmark, tmp_path):
    made = []

    def make():
        made.append(1)
        return {"x": np.array([1.0, 2.0])}

    for _ in range(2):
        assert benchmark.cached(tmp_path / "new", "beam", make)["x"].tolist() == [1.0, 2.0]
    assert len(made) == 1


@benchmark_of("trials")
def test_a_trial_on_a_few_cycles(benchmark):
    """All rows of one noise come out, and its bands hold what an exact structure determines."""
    model = EXAMPLE_MODEL
    q = np.linspace(-2.0, 2.0, 81)
    away = np.where(q == 0, 1e-9, q)
    clean = rs.example_decay(periods=15, samples=40)
    known = benchmark.KnownDecay(clean, q, model.inertia(q) - 1, model.stiffness(away) / away)
    trial = benchmark.trial(known, 40.0, 3)
    assert min(trial.least_h) >= 0
    for name in ("h", "K/q", "omega^2", "Upsilon_3"):
        assert np.all(np.isfinite(trial.half_widths[name])), name
        # 95 % bands of one seed go together: half of the points is far below what chance leaves.
        assert np.mean(trial.holds[name]) > 0.5, name
    rows = list(benchmark.summary([trial], "oscillator", 40.0))
    assert len(rows) == 13
    assert not any("nan" in measured for _, measured, _ in rows)


@benchmark_of("trials")
def test_failed_identifications_are_counted(benchmark):
    def fails_at_two(seed):
        if seed == 2:
            raise TrajectoryError("lost")
        return seed

    found, row = benchmark.attempted(fails_at_two, range(4), 1, "this")
    assert found == [0, 1, 3] and row == ("this: identifications that fail", "1 of 4", "0")


@benchmark_of("defects")
def test_small_benchmark_of_defects(benchmark):
    """One decay: what was put on it is named, and the backbone holds as that without it does."""
    for name in ("one second of zeros", "spike", "hum of 60 Hz", "offset of 1000"):
        trial = benchmark.trial(101, name)
        assert trial.named and not trial.refusal, name
        # 95 % is expected of many decays; of one, a dozen neighbours go wrong together.
        assert trial.inside["frequency"] > 0.6 and trial.wider["frequency"] < 3, name


@benchmark_of("releases")
def test_random_releases_are_counted(benchmark):
    """Of a hundred 94 are counted right, nearly all that are not at 10 dB."""
    trials = [t for t in map(benchmark.trial, range(8)) if t.snr_db > 10]
    counts = [(t.found(), len(t.blows)) for t in trials]
    assert len(counts) >= 4
    assert sum(found == (blows, 0) for found, blows in counts) >= len(counts) - 1
