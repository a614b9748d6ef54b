"""Figures show what they should; how they look was judged by eye."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from fingerprint import fingerprint, plot_fingerprint

from romsindy import (
    CoupledModel,
    Estimate,
    HarmonicSINDy,
    Identification,
    ReducedModel,
    backbone_curve,
    example_decay,
    extract_backbone,
    forced_response,
)
from romsindy.effects import AirDrag
from romsindy.fit.adequacy.verdicts import Adequacy
from romsindy.fit.functions.series import ModelStructure, Sizes
from romsindy.physics.example import EXAMPLE_MODEL
from romsindy.physics.stiffness import MagnetForce
from romsindy.show import plots
from romsindy.show.identified import Identified
from romsindy.show.panels import functions


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def backbone():
    return extract_backbone(example_decay(35.0, 0))


def test_backbone_with_models(backbone):
    ax = plots.plot_backbone(backbone, {"IC-ROM": EXAMPLE_MODEL})
    assert ax.get_xlabel() == "frequency (Hz)" and ax.get_ylabel() == "amplitude (m)"
    hz, amplitude = ax.lines[-1].get_data()
    np.testing.assert_allclose(2 * np.pi * hz, EXAMPLE_MODEL.backbone(amplitude))
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["IC-ROM", "cycles of the decay"]
    low, high = ax.get_xlim()
    assert 0.88 < low < 0.9 and 0.955 < high < 0.97  # uncertain cycles do not squeeze it


def test_an_estimate_from_a_file_has_its_band(backbone):
    """Frequency of a linear oscillator: its error is that of omega^2 over 2 omega."""
    model = ReducedModel.from_coefficients({"omega^2": 36.0}, "m")
    verdict = Adequacy(1.0, 0.5, 1.0, False, np.array([1.0]), np.ones((1, 6)), 1.0, "m")
    text = Estimate(model, ("omega^2",), np.array([[0.12**2]]), verdict, ()).to_json()
    estimate = Estimate.from_json(text)
    ax = plots.plot_backbone(backbone, {"saved": estimate})
    edges = ax.collections[-1].get_paths()[0].vertices[:, 0]
    # Differences over a tenth of a standard error: (0.1 * 0.12 / 36)^2 off.
    np.testing.assert_allclose(np.ptp(edges), 2 * 1.96 * 0.01 / (2 * np.pi), rtol=1e-6)
    assert len(plots.plot_misfit(estimate).lines) == 7
    with pytest.raises(ValueError, match="holds no cycles: give a Backbone"):
        plots.plot_damping(estimate)


def test_functions_are_drawn_of_the_coordinates_along_which_they_change():
    """Stiffness and its band in closed form, of the first of two; inertia is constant."""
    names = ("omega^2 [q1]", "gamma_3 [q1]", "omega^2 [q2]", "V q1^2 q2")
    model = CoupledModel.from_coefficients(dict(zip(names, (36, 9, 400, 5), strict=True)), "m")
    model = replace(model, amplitude_range=(0.1, 2.0))
    verdict = Adequacy(1.0, 0.5, 1.0, False, np.array([1.0]), np.ones((1, 6)), 1.0, "m")
    found = Estimate(model, ("gamma_3 [q1]",), np.array([[0.2**2]]), verdict, ())
    (picture,) = functions(Identified("", found=found))
    assert picture.name == "stiffness" and "with the others at rest" in picture.caption
    (ax,) = picture.figure().axes
    q, secant = ax.lines[0].get_data()
    np.testing.assert_allclose(secant, 36 + 9 * q**2)
    edges = ax.collections[0].get_paths()[0].vertices
    assert edges[:, 1].max() == pytest.approx(36 + (9 + 1.96 * 0.2) * 4)
    assert ax.get_xlabel() == "$q_1$ (m)" and (q[0], q[-1]) == (-2.0, 2.0)
    known = (np.eye(1), verdict, ())
    linear = replace(ReducedModel.from_coefficients({"omega^2": 36.0}), amplitude_range=(0.1, 2))
    assert not [*functions(Identified("", found=Estimate(linear, ("omega^2",), *known)))]
    # Without a range of the data there is none to draw over.
    unknown = replace(model, amplitude_range=None)
    assert not [*functions(Identified("", found=Estimate(unknown, ("omega^2 [q1]",), *known)))]


def identification(inertia: int) -> Identification:
    """The example, Upsilon_3 alone uncertain: 101 draws, evenly from 0.2 to 0.4."""
    names, truth = list(EXAMPLE_MODEL.coefficients), np.array(EXAMPLE_MODEL.values)
    samples = np.tile(truth, (101, 1))
    samples[:, names.index("Upsilon_3")] = np.linspace(0.2, 0.4, 101)
    verdict = Adequacy(1.0, 0.5, 1.0, False, np.array([1.0]), np.ones((1, 6)), 1.0, "m")
    structure = ModelStructure(Sizes(4, inertia, 0))
    return Identification(
        EXAMPLE_MODEL, tuple(names), np.cov(samples, rowvar=False), verdict, (), (structure,),
        structure, EXAMPLE_MODEL.terms, samples, samples, (-1.5, 1.6),
    )  # fmt: skip


def band(ax, i=0):
    """Abscissa, lower and upper edge of a filled band."""
    vertices = ax.collections[i].get_paths()[0].vertices
    x = np.unique(vertices[:, 0])
    edges = [vertices[vertices[:, 0] == at, 1] for at in x]
    return x, np.array([e.min() for e in edges]), np.array([e.max() for e in edges])


def test_functions_with_their_bands_beside_a_regression():
    found = identification(3)
    ax = plots.plot_inertia(found, {"plain IC-ROM": EXAMPLE_MODEL})
    q, low, high = band(ax)
    assert q[0] == -1.5 and q[-1] == 1.6 and ax.get_xlabel() == "q (m)"
    # 96 of 101 draws span 95 of the 100 steps of 0.002.
    np.testing.assert_allclose(high - low, 0.19 * q**2, atol=1e-12)
    identified, plain = ax.lines
    np.testing.assert_allclose(identified.get_ydata(), EXAMPLE_MODEL.inertia(q), rtol=1e-12)
    np.testing.assert_allclose(plain.get_ydata(), identified.get_ydata(), rtol=1e-12)
    ax = plots.plot_stiffness(found, {"plain stiffness": EXAMPLE_MODEL})
    q, low, high = band(ax)
    np.testing.assert_allclose(low, 36 + 2 * q + 9 * q**2, rtol=1e-12)
    np.testing.assert_allclose(high, low, rtol=1e-12)
    assert ax.lines[1].get_linestyle() == "--"


def test_parts_with_their_bands_or_an_upper_limit():
    ax = plots.plot_parts(identification(3))
    assert [line.get_label() for line in ax.lines] == ["inertia", "nonlinear stiffness", "damping"]
    amplitude, low, high = band(ax)
    assert amplitude[-1] == pytest.approx(1.5) and np.all(low > 0)
    # At small amplitude h is Upsilon_3 q^2: a band of +-32 % about its middle.
    np.testing.assert_allclose(high[0] / low[0], 0.395 / 0.205, rtol=0.03)
    ax = plots.plot_parts(identification(0))
    assert ax.lines[0].get_label() == "inertia at most" and np.all(band(ax)[1] == 0)


@pytest.mark.slow
def test_decay_damping_magnitudes_and_residuals(backbone):
    decay = example_decay(35.0, 0)
    free = decay.free()
    ax = plots.plot_decay(free, backbone, record=decay)
    assert ax.get_xlabel() == "time (s)" and ax.get_ylabel() == "q (m)" and len(ax.lines) == 4
    ax = plots.plot_damping(backbone, {"IC-ROM": EXAMPLE_MODEL})
    assert ax.get_ylabel() == "damping ratio (%)"
    ax = plots.plot_relative_magnitude(EXAMPLE_MODEL, [0.1, 1.0])
    assert ax.get_yscale() == "log" and len(ax.lines) == len(EXAMPLE_MODEL.terms)
    estimator = HarmonicSINDy().fit(decay)
    ax = plots.plot_residual({"IC-ROM": estimator})
    assert len(ax.patches) == 4 and ax.get_xlabel() == "harmonic"
    assert all(bar.get_height() > 0 for bar in ax.patches)


def test_magnitudes_of_every_kind_of_term():
    """Stops, magnets and a constant force are drawn too, under a name of their own."""
    values = {"omega^2": 36.0, "gamma_3": 9.0, "k_above 0.5": 1.0, "k_gap 0.3": 1.0}
    others = {"f_constant": 0.1, "mu": 0.1, "c_|q_dot|^2": 0.1, "gamma_|q|^2.5": 1.0}
    magnet = MagnetForce(3.0, 1, 2.0).key
    model = ReducedModel.from_coefficients(values | others | {magnet: 0.1})
    ax = plots.plot_relative_magnitude(model, [0.1, 1.0])
    labels = [line.get_label() for line in ax.lines]
    assert len({*labels}) == 9 and labels[2:5] == ["k_above 0.5", "k_gap 0.3", "f_constant"]
    assert all(np.all(line.get_ydata() > 0) for line in ax.lines if "k_" not in line.get_label())


def test_forced_response_with_backbone_curve():
    damped = ReducedModel.from_coefficients({"omega^2": 1.0, "gamma_3": 1.0, "c_linear": 0.02})
    response = forced_response(damped, 0.05, (0.5, 2.0))
    curve = backbone_curve(damped, (0.01, 1.5))
    ax = plots.plot_forced_response(response)
    low, unstable, high, folds = ax.lines
    assert [line.get_linestyle() for line in ax.lines[:3]] == ["-", "--", "-"]
    np.testing.assert_array_equal(folds.get_ydata(), response.amplitude[response.folds])
    # The three stretches are the whole curve, joined.
    assert low.get_xydata()[-1].tolist() == unstable.get_xydata()[0].tolist()
    assert unstable.get_xydata()[-1].tolist() == high.get_xydata()[0].tolist()
    assert plots.plot_branch(curve, ax=ax) is ax
    np.testing.assert_allclose(2 * np.pi * ax.lines[-1].get_xdata(), curve.frequency)
    plots.plot_forced_response(response, label="again", ax=ax)
    with pytest.raises(ValueError, match="response is a list: give one"):
        plots.plot_forced_response([response, response])
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert texts.count("fold") == 1 and "again unstable" in texts
    assert ax.get_xlabel() == "frequency (Hz)" and ax.get_ylabel() == "amplitude (unit of q)"


def test_given_axes_are_used(backbone):
    _, ax = plt.subplots()
    assert plots.plot_backbone(backbone, ax=ax) is ax


def test_fingerprint_of_drag():
    _, axes = plt.subplots(1, 2)
    plot_fingerprint(fingerprint(AirDrag()), axes)
    a, damping_ratio = axes[1].lines[-1].get_data()
    np.testing.assert_allclose(damping_ratio, a, rtol=1e-5)  # kinks of |q_dot| between samples
    assert np.ptp(axes[0].lines[-1].get_ydata()) < 1e-9
    assert [ax.get_title() for ax in axes] == ["frequency", "damping ratio"]
