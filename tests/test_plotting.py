"""Figures show what they should; how they look was judged by eye."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from romsindy import HarmonicSINDy, example_decay, extract_backbone, plotting
from romsindy.synthetic import EXAMPLE_MODEL


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def backbone():
    return extract_backbone(example_decay(35.0, 0))


def test_backbone_with_models(backbone):
    ax = plotting.plot_backbone(backbone, {"IC-ROM": EXAMPLE_MODEL})
    assert ax.get_xlabel() == "frequency (Hz)" and ax.get_ylabel() == "amplitude (m)"
    hz, amplitude = ax.lines[-1].get_data()
    np.testing.assert_allclose(2 * np.pi * hz, EXAMPLE_MODEL.backbone(amplitude))
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["IC-ROM", "cycles of the decay"]
    low, high = ax.get_xlim()
    assert 0.88 < low < 0.9 and 0.955 < high < 0.97  # uncertain cycles do not squeeze it


def test_decay_damping_magnitudes_and_residuals(backbone):
    decay = example_decay(35.0, 0)
    free = decay.free()
    ax = plotting.plot_decay(free, backbone, record=decay)
    assert ax.get_xlabel() == "time (s)" and ax.get_ylabel() == "q (m)" and len(ax.lines) == 4
    ax = plotting.plot_damping(backbone, {"IC-ROM": EXAMPLE_MODEL})
    assert ax.get_ylabel() == "damping ratio (%)"
    ax = plotting.plot_relative_magnitude(EXAMPLE_MODEL, [0.1, 1.0])
    assert ax.get_yscale() == "log" and len(ax.lines) == len(EXAMPLE_MODEL.terms)
    estimator = HarmonicSINDy().fit(decay)
    ax = plotting.plot_residual({"IC-ROM": estimator})
    assert len(ax.patches) == 4 and ax.get_xlabel() == "harmonic"
    assert all(bar.get_height() > 0 for bar in ax.patches)


def test_given_axes_are_used(backbone):
    _, ax = plt.subplots()
    assert plotting.plot_backbone(backbone, ax=ax) is ax
