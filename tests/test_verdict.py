"""The numbers that decide verdicts stand for what they claim."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

import romsindy as rs
from romsindy.fit import verdict
from romsindy.fit.adequacy.verdicts import examine
from romsindy.fit.records.record import Record

T = np.arange(0, 40, 0.01)
CLEAN = rs.ReducedModel.from_coefficients(
    {"omega^2": 36.0, "gamma_3": 9.0, "c_linear": 0.06}
).simulate(1.5, 0.0, T)
STD = 0.01  # 40 dB at the start
LINE = 0.02 * np.sin(2 * np.pi * 7.77 * T)


def white(rng: np.random.Generator) -> np.ndarray:
    return STD * rng.standard_normal(len(T))


def red(rng: np.random.Generator) -> np.ndarray:
    return lfilter([1.0], [1.0, -0.9], white(rng))


def pink(rng: np.random.Generator) -> np.ndarray:
    f = np.maximum(np.fft.rfftfreq(len(T)), 1 / len(T))
    return np.fft.irfft(np.fft.rfft(white(rng)) / np.sqrt(f), len(T))


def hum(rng: np.random.Generator) -> np.ndarray:
    return white(rng) + LINE


def recorded(noise: np.ndarray) -> Record:
    return Record.of(rs.Decay(T, CLEAN.q + noise), 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [white, red])
def test_false_alarms_come_as_often_as_stated(kind):
    """Of 400 residuals that are noise, within what a binomial law allows in 999 of 1000 tests."""
    rng = np.random.default_rng(0)
    record, n = recorded(kind(rng)), 400
    tests = [examine([record], [kind(rng)], 0) for _ in range(n)]
    alarms = sum(t.p_value < verdict.FALSE_ALARM for t in tests)
    assert alarms <= binom.isf(1e-3, n, verdict.FALSE_ALARM)
    assert sum(t.structured for t in tests) <= alarms


@pytest.mark.parametrize(
    ("size", "answer", "said"),
    [
        (1e-4, "good for practice", "leaves 0.5 % of the response, 50 times the noise"),
        (1e-3, "not explained", "leaves 5 % of the response, 50 times the noise"),
    ],
)
def test_what_is_left_is_weighed_by_the_response_as_well(size, answer, said):
    """Half a per cent of the motion, or five, of a record whose noise is 50 times less."""
    rms = float(np.sqrt(np.mean(CLEAN.q**2)))
    noise = size * rms * np.random.default_rng(3).standard_normal(len(T))
    found = examine([recorded(noise)], [50 * size * CLEAN.q], 4)
    assert found.answer == answer and found.part == pytest.approx(50 * size, rel=1e-3)
    # The noise of a record is known to 4 %.
    said, times = said.split(", ")
    assert said in str(found) and found.ratio == pytest.approx(float(times.split()[0]), rel=0.05)


@pytest.mark.parametrize(("kind", "share"), [(white, 1.0), (hum, 1.0), (red, 0.7), (pink, 0.7)])
def test_level_of_noise_is_known_within_what_explained_allows(kind, share):
    """Rms of the true noise, whitened by the estimate: the model that explains all but noise.

    Noise slower than a quarter of the vibration hides behind the smooth motion: where it is the
    loudest, the level is underestimated in some records.
    """
    rng = np.random.default_rng(1)
    sizes = []
    for _ in range(12):
        noise = kind(rng)
        record = recorded(noise)
        line = LINE if kind is hum else 0.0  # counted beside the noise
        sizes.append(np.sqrt(np.mean(record.whitened(noise - line) ** 2)))
        assert len(record.noise.lines) == (kind is hum)
    right = np.abs(np.log(sizes)) < np.log(verdict.EXPLAINED)
    assert np.mean(right) >= share and max(sizes) < 1.3


def test_a_line_is_found_with_its_frequency_and_size():
    (line,) = recorded(hum(np.random.default_rng(2))).noise.lines
    # One line of the spectrum is 1/40 Hz wide; its power is known to the noise in four lines.
    assert line.frequency == pytest.approx(7.77, abs=0.03)
    assert line.rms == pytest.approx(0.02 / np.sqrt(2), rel=0.05)


def test_noise_that_is_drawn_is_like_the_noise_that_was_found():
    rng = np.random.default_rng(3)
    noise = recorded(red(rng)).noise
    drawn = [noise.draw(len(T), 0.01, rng) for _ in range(20)]
    # Level known to a tenth (below 20 cycles of memory each), correlation of neighbours to 0.05.
    assert np.std(drawn) == pytest.approx(STD / np.sqrt(1 - 0.81), rel=0.25)
    assert np.corrcoef(drawn[0][1:], drawn[0][:-1])[0, 1] == pytest.approx(0.9, abs=0.05)


def test_probabilities_and_decibels_are_those_of_the_comments():
    assert np.exp(verdict.EQUIVALENT / 2) == pytest.approx(33, rel=0.01)
    assert np.sqrt(verdict.AS_ONE) == 2
    decibels = {"QUIET": -40, "FLOOR": -74, "ABOVE_NOISE": 6}
    for name, level in decibels.items():
        assert 20 * np.log10(getattr(verdict, name)) == pytest.approx(level, abs=0.1)
    # A cycle at a damping ratio of 3.5 % leaves 80 %.
    assert np.exp(-2 * np.pi * 0.0355) == pytest.approx(verdict.RELEASED, abs=1e-3)
    # The signs are at +1 and -1; the error is half of REVERSED at most.
    assert (2 - verdict.REVERSED) / (verdict.REVERSED / 2) > 11
    # Misfit of 30 % in power beside noise.
    assert np.sqrt(verdict.STRUCTURE) == pytest.approx(1.14, abs=0.005)
    assert verdict.EXPLAINED < verdict.PREDICTED


def test_every_number_of_the_table_decides_something():
    """Each is imported where it decides, and stands nowhere else under its name."""
    root = Path(rs.__file__).parent
    imported: set[str] = set()
    for path in root.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module == "romsindy.fit.verdict":
                imported |= {alias.name for alias in node.names}
    assert imported == {name for name in vars(verdict) if name.isupper()}
