import numpy as np
import pytest

from romsindy import Decay, HarmonicProjection, ROMLibrary
from romsindy.physics.example import EXAMPLE_MODEL
from romsindy.physics.stiffness import Stiffness
from romsindy.regression.projection import HarmonicRows, _quadrature

TERMS = ROMLibrary().terms


@pytest.mark.parametrize("order", [2, 4, 6])
def test_quadrature_converges_at_its_order(order):
    """int_0^1 exp(sin 3x), halving the step: the error falls by 2^(order + 1) at least."""

    def integral(n, order):
        x = np.linspace(0, 1, n)
        return _quadrature(n, order) @ np.exp(np.sin(3 * x)) / (n - 1)

    exact = integral(1001, 8)
    errors = [abs(integral(n, order) - exact) for n in (121, 241)]
    assert np.log2(errors[0] / errors[1]) > order + 0.9


def test_projection_of_harmonics_gives_their_amplitudes():
    """q = 0.9 sin + 0.2 sin 3: 2/T int q exp(-i h w t) is -i b_h, and the mean is 0."""
    n = 100
    phase = 2 * np.pi * np.arange(8 * n) / n + 1e-3
    q = 0.9 * np.sin(phase) + 0.2 * np.sin(3 * phase)
    rows = HarmonicProjection((0, 1, 2, 3)).project(np.stack([q, 0 * q], axis=1), q)
    by = {(h, part): [] for h in range(4) for part in range(2)}
    seen = set()
    for value, cycle, h in zip(rows.theta[:, 0], rows.cycle, rows.harmonic, strict=True):
        part = int((cycle, h) in seen)
        seen.add((cycle, h))
        by[h, part].append(value)
    np.testing.assert_allclose(by[0, 0], 0, atol=1e-12)
    np.testing.assert_allclose(np.hypot(by[1, 0], by[1, 1]), 0.9, rtol=1e-12)
    np.testing.assert_allclose(np.hypot(by[3, 0], by[3, 1]), 0.2, rtol=1e-12)
    np.testing.assert_allclose(np.hypot(by[2, 0], by[2, 1]), 0, atol=1e-12)
    assert by[0, 1] == []  # the mean has no imaginary part


@pytest.mark.parametrize("harmonics", [(0, 1, 2, 3), (1, 3, 5)])
def test_both_forms_satisfy_the_equation_of_motion(clean, harmonics):
    """Projection is linear, so the true coefficients solve every row of either form."""
    truth = np.array([EXAMPLE_MODEL.coefficients.get(t.key, 0.0) for t in TERMS])
    # Sums are exact; integration by parts is as good as quadrature of eighth order at 80 samples.
    for form, tolerance in (("strong", 1e-12), ("weak", 3e-6)):
        rows = HarmonicProjection(harmonics, form).rows(TERMS, clean)
        assert len(rows.target) == (2 * len(harmonics) - (0 in harmonics)) * len(rows.amplitude)
        residual = rows.theta @ truth - rows.target
        assert np.abs(residual).max() < tolerance * np.abs(rows.target).max()


def test_weak_form_needs_no_acceleration(clean):
    half = Decay(clean.t, clean.q, clean.q_dot)
    weak = HarmonicProjection().rows(TERMS, half)
    np.testing.assert_array_equal(weak.theta, HarmonicProjection().rows(TERMS, clean).theta)
    with pytest.raises(ValueError, match="strong form needs derivatives"):
        HarmonicProjection(form="strong").rows(TERMS, half)
    with pytest.raises(ValueError, match="weak form needs derivatives"):
        HarmonicProjection().rows(TERMS, Decay(clean.t, clean.q))


def test_amplitude_range(clean):
    rows = HarmonicProjection(amplitude=(0.2, 1.0)).rows(TERMS, clean)
    assert 0.2 <= rows.amplitude.min() and rows.amplitude.max() <= 1.0
    with pytest.raises(ValueError, match=r"amplitude = \(5.0, 6.0\) holds no cycle: .* from 0.02"):
        HarmonicProjection(amplitude=(5.0, 6.0)).rows(TERMS, clean)


def test_rows_of_several_records_are_numbered_through(clean):
    one = HarmonicProjection((1,)).rows(TERMS[:2], clean)
    both = HarmonicRows.stacked([one, one])
    assert both.cycle.max() + 1 == len(both.amplitude) == 2 * len(one.amplitude)
    assert both.theta.shape == (2 * len(one.target), 2)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"harmonics": ()}, "must be whole numbers"),
        ({"harmonics": (1.5,)}, "must be whole numbers"),
        ({"harmonics": (-1, 0)}, "must be whole numbers"),
        ({"harmonics": (1, 1)}, "names one twice"),
        ({"form": "medium"}, "must be 'weak' or 'strong'"),
        ({"amplitude": (2.0, 1.0)}, r"must be \(low, high\)"),
        ({"harmonics": (0, 60)}, "need more than the .* samples of the shortest cycle"),
    ],
)
def test_settings_are_checked(clean, settings, message):
    with pytest.raises(ValueError, match=message):
        HarmonicProjection(**settings).rows((Stiffness(1),), clean)
