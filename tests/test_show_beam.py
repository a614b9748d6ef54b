"""Figures of the beam show the data that they were given."""

from __future__ import annotations

import matplotlib
import numpy as np
import pytest

matplotlib.use("Agg")

from matplotlib import pyplot as plt
from numpy.testing import assert_allclose

from romsindy.beam import Beam
from romsindy.show.structure import (
    plot_coupling,
    plot_modal_responses,
    plot_modes,
    plot_normal_mode,
    plot_shapes,
)


@pytest.fixture(scope="module")
def beam():
    return Beam.cantilever(elements=10, alpha=0.0, eta=0.0)


@pytest.fixture(scope="module")
def motion(beam):
    return beam.simulate(beam.release_shape(0.1, mode=1), 0.2, progress=False)


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def test_shapes_end_at_their_tips(beam):
    released = beam.release_shape(0.1)
    ax = plot_shapes({"equilibrium": beam.equilibrium(), "released": released})
    x, y = ax.lines[-1].get_data()
    assert_allclose([x[-1], y[-1]], [0.45 + released.tip[0], released.tip[1]])
    labels = [t.get_text() for t in ax.get_legend().get_texts()]
    assert labels == ["straight", "equilibrium", "released"]


def test_modes_cross_zero_one_time_more_each(beam):
    ax = plot_modes(beam.modes(count=3))
    for mode in range(3):
        w = ax.lines[mode].get_ydata()[1:]
        assert np.count_nonzero(np.diff(np.sign(w))) == mode


def test_modal_responses_and_coupling(motion):
    fig, axes = plt.subplots(1, 2)
    assert plot_modal_responses(motion, 2, ax=axes[0]) is axes[0]
    plot_coupling(motion, 3, ax=axes[1])
    q = motion.coordinates.displacement
    assert_allclose(axes[0].lines[1].get_ydata(), q[:, 1])
    assert_allclose(np.abs(axes[1].lines[0].get_ydata()).max(), 1.0)
    plot_coupling(motion, 2, ax=axes[0], scale=False)
    assert_allclose(axes[0].lines[-1].get_ydata(), q[:, 1])
    fig.canvas.draw()


def test_modes_that_are_not_there(motion):
    with pytest.raises(ValueError, match="mode = 11"):
        plot_modal_responses(motion, 11)


@pytest.mark.slow
def test_normal_mode_goes_on_the_axes_of_a_backbone(beam):
    orbits = beam.normal_mode([0.02], progress=False)
    ax = plt.figure().add_subplot()
    ax.plot([6.1, 6.2], [0.0, 0.01], label="a backbone")
    ax.set(xlim=(6.1, 6.11), ylim=(0, 1e-4))
    assert plot_normal_mode(orbits, ax) is ax
    marks = ax.lines[1]
    assert_allclose(marks.get_xdata(), orbits.frequency / (2 * np.pi))
    assert_allclose(marks.get_ydata(), orbits.amplitude)
    assert ax.get_legend().get_texts()[0].get_text() == "a backbone"
    low, high = ax.viewLim.get_points()
    assert np.all(low < [orbits.frequency[0] / (2 * np.pi), orbits.amplitude[0]])
    assert np.all(high > [orbits.frequency[0] / (2 * np.pi), orbits.amplitude[0]])
