"""What an input does between its samples, and what stands for it in a step of time."""

import itertools
from functools import partial

import numpy as np
import pytest

from romsindy.fit.kernel.linear_steps import NODES
from romsindy.record.interpolation import interpolated, of_steps

RNG = np.random.default_rng(8)
SAMPLES = RNG.standard_normal(60)
WEIGHTS = np.polynomial.legendre.leggauss(3)[1] / 2


def test_band_limited_samples_give_the_wave():
    """Waves up to 0.4 of the rate: the window stops 150 dB, away from the ends."""
    frequency, phase = RNG.uniform(0, 0.4, 20), RNG.uniform(0, 6, 20)

    def wave(x):
        return np.cos(2 * np.pi * np.outer(x, frequency) + phase).sum(axis=1)

    place = RNG.uniform(40, 160, 50)
    found = interpolated(wave(np.arange(200.0)), place, "band-limited")
    np.testing.assert_allclose(found, wave(place), atol=2e-6)  # of amplitudes that sum to 20


@pytest.mark.parametrize("way", ["band-limited", "linear", "hold"])
def test_samples_are_kept(way):
    np.testing.assert_allclose(interpolated(SAMPLES, np.arange(60.0), way), SAMPLES, atol=1e-12)


@pytest.mark.parametrize("way", ["linear", "hold"])
@pytest.mark.parametrize("length", [0.5, 1.0, 3.0])
def test_integrals_over_steps_are_exact(way, length):
    """Of the input times 1, t and t^2, against a sum that splits at every sample."""
    start = 2.3 + length * np.arange(10)
    driven = partial(interpolated, SAMPLES, interpolation=way)
    values = of_steps(driven, start, length, NODES, smooth=False)
    for k in range(3):
        found = length * np.sum(WEIGHTS * values * NODES**k, axis=1)
        for first, value in zip(start, found, strict=True):
            inside = np.arange(np.ceil(first), first + length)
            edges = np.unique([first, *inside, first + length])
            exact = 0.0
            for a, b in itertools.pairwise(edges):
                x = a + (b - a) * NODES
                u = SAMPLES[int(a)] if way == "hold" else np.interp(x, range(60), SAMPLES)
                exact += (b - a) * np.sum(WEIGHTS * u * ((x - first) / length) ** k)
            assert value == pytest.approx(exact, abs=1e-12)


def test_beyond_the_ends_nothing_is_looked_at():
    for way in ("band-limited", "linear", "hold"):
        ends = interpolated(SAMPLES, np.array([-3.0, 63.0]), way)
        np.testing.assert_allclose(ends, SAMPLES[[0, -1]], atol=1e-12)
