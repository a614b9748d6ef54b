"""One page for all results: what is left is drawn of each, and a new panel is a line in a list."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import romsindy as rs
from romsindy.physics.example import EXAMPLE_MODEL
from romsindy.record.noise import Noise
from romsindy.record.spectrum import Spectrum
from romsindy.show import panels
from romsindy.show.compared import Compared, draw_over_time, noise_density, spectrum_of
from romsindy.show.identified import Identified, tables
from romsindy.show.page import Picture

T = np.arange(0, 8, 0.01)
PAIR = {"omega^2 [q1]": 987.0, "c_linear [q1]": 0.6, "omega^2 [q2]": 6000.0}
PAIR |= {"c_linear [q2]": 1.0, "V q1^2 q2": 300.0}


def steady():
    w = np.linspace(0.8, 1.2, 20)
    model = rs.ReducedModel.from_coefficients({"omega^2": 1.1, "c_linear": 0.1})
    response = 3.0 / (1.0 - w**2 + 0.05j * w)
    return Identified("", found=rs.fit_steady(model, w, np.ones(20), response, std=1e-3))


def driven():
    """A linear oscillator under waves in phase with its input: the response in closed form."""
    w = 2 * np.pi * np.array([1.0, 2.5, 4.0, 5.5, 7.0])
    waves = np.exp(1j * np.multiply.outer(T, w))
    u = waves.real.sum(axis=1)
    y = (waves / (987.0 - w**2 + 0.8j * w)).real.sum(axis=1)
    y += 1e-5 * np.random.default_rng(2).standard_normal(len(T))
    vibration = rs.ForcedVibration(T, y, u, unit="m", inputs="force", input_unit="N")
    laws = {"omega^2": 987.0, "c_linear": 0.8, "gain [force]": 1.0}
    fit = rs.refine(rs.ReducedModel.from_coefficients(laws, "m"), [vibration])
    return Identified("", [vibration], fit)


def several():
    model = rs.CoupledModel.from_coefficients(PAIR, unit="m")
    q = model.simulate(np.array([0.8, 0.3]), np.zeros(2), T).q
    q = q + 1e-3 * np.random.default_rng(3).standard_normal(q.shape)
    decay = rs.Decay(T, q, unit="m", stage="free")
    fit = rs.refine(model, [decay])
    return Identified("", [decay], fit, channels=["left", "right"])


def several_of_one():
    """As `coordinates="auto"` leaves it where one coordinate is enough."""
    laws = {"omega^2 [q1]": 987.0, "c_linear [q1]": 0.6, "gamma_3 [q1]": 900.0}
    model = rs.CoupledModel.from_coefficients(laws, unit="m")
    q = model.simulate(np.array([0.8]), np.zeros(1), T).q.reshape(-1)
    decay = rs.Decay(T, q + 1e-3 * np.random.default_rng(4).standard_normal(len(T)), unit="m")
    return Identified("", [decay], rs.refine(model, [decay.free()]), channels=["tip"])


def one():
    decay = rs.example_decay(40.0, 3)
    return Identified("", [decay], rs.refine(EXAMPLE_MODEL, decay))


@pytest.mark.parametrize(
    "of", [steady, driven, pytest.param(several, marks=pytest.mark.slow), several_of_one, one]
)
def test_a_new_panel_is_on_the_pages_of_all_kinds_of_results(of, tmp_path, monkeypatch):
    def mine(result):
        yield Picture("mine", "Mine", result.model.equation(), lambda figure: figure.subplots())

    result = of()
    before = [p.name for p in panels.pictures(result)]
    monkeypatch.setattr(panels, "PANELS", (*panels.PANELS, mine))
    pictures = panels.pictures(result)
    assert ("Modes" in [t.title for t in tables(result)]) == (of in (several, several_of_one))
    assert [p.name for p in pictures] == [*before, "mine"] and "spectrum" in before
    panels.write_result(result, tmp_path / "page.html", pictures)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Spectrum of what is left" in page and page.count("data:image/png") == len(pictures)


def test_noise_is_as_dense_as_it_is():
    """White: std^2 over the frequencies up to half the sampling rate. Coloured: the same mean."""
    dt, rng = 0.01, np.random.default_rng(1)
    t, x = dt * np.arange(20_000), 0.2 * rng.standard_normal(20_000)
    white = Noise.white(0.2, dt)
    drawn = spectrum_of(Compared(t, x, {"simulated": x}, "displacement", "m", white))
    np.testing.assert_allclose(drawn.noise, 0.2 / np.sqrt(50))
    assert np.mean(drawn.left["simulated"] ** 2) == pytest.approx(0.2**2 / 50, rel=0.02)
    f = np.linspace(0, 50, 1001)
    coloured = Noise(1.0, Spectrum(np.array([0.0, 50.0]), np.array([2.0, 0.0])), dt, 0.0)
    assert np.trapezoid(noise_density(coloured, f) ** 2, f) == pytest.approx(1.0)


def test_measured_less_left_is_simulated_wherever_it_is_drawn():
    t = np.arange(0, 10, 0.01)
    y, left = np.sin(2 * np.pi * t) * np.exp(-0.1 * t), {"before": 0.1 * t, "after": 0.01 * t}
    inputs = {"force (N)": np.cos(t)}
    figure = Figure()
    shown = Compared(t, y, left, "displacement", "m", Noise.white(0.1, 0.01), inputs, 2 * np.pi)
    draw_over_time(shown, figure)
    force, response, before, after, closer = figure.axes
    np.testing.assert_array_equal(force.lines[0].get_ydata(), np.cos(t))
    for i, name in enumerate(left, 1):
        assert not response.lines[i].get_visible()
        np.testing.assert_allclose(response.lines[i].get_ydata(), y - left[name])
        np.testing.assert_allclose(closer.lines[i].get_ydata(), (y - left[name])[:1200])
    assert before.get_ylim() == after.get_ylim()
    assert {tuple(line.get_ydata()) for line in after.lines[1:]} == {(0.1, 0.1), (-0.1, -0.1)}
