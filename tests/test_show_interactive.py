"""Interactive pages hold the numbers that were computed, look like static ones, and stand alone.

How they look, and that a pointer finds a cycle, was judged in a browser.
"""

import base64
import json
import re
import sys

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

import romsindy as rs
from romsindy.effects import AirDrag
from romsindy.physics.example import EXAMPLE_MODEL
from romsindy.show import compared, plots
from romsindy.show.axes import Fact, tell
from romsindy.show.interactive import curves, translated, words
from romsindy.show.page import Picture, write_overview
from romsindy_study.content import Chapter
from romsindy_study.pages import write_chapter, write_story


@pytest.fixture(scope="module")
def backbone():
    return rs.extract_backbone(rs.example_decay(35.0, 0))


def array(values):
    """An array as a page holds it: base64 with its type, or a list."""
    if not isinstance(values, dict):
        return np.array(values, float)
    shape = [int(n) for n in str(values.get("shape", "-1")).split(",")]
    return np.frombuffer(base64.b64decode(values["bdata"]), values["dtype"]).reshape(shape)


def traces_of(page, name):
    """Traces of one figure of a page."""
    start = re.search(rf'Plotly\.newPlot\(\s*"{name}",\s*', page).end()
    return json.JSONDecoder().raw_decode(page, start)[0]


def named(traces, name):
    (found,) = [t for t in traces if t.get("name") == name and "hovertemplate" in t]
    return found


def columns(trace):
    """What is shown under the pointer: quantity, unit and numbers by line."""
    _title, *lines = trace["hovertemplate"].removesuffix("<extra></extra>").split("<br>")
    data = array(trace["customdata"])
    parts = [re.split(r" ?(?=%\{)|(?<=\}) ?", line) for line in lines]
    numbers = [[int(i) for i in re.findall(r"customdata\[(\d+)\]", line)] for line in lines]
    return {
        (part[0], part[-1]): [data[:, i] for i in ours]
        for part, ours in zip(parts, numbers, strict=True)
    }


def test_under_the_pointer_are_the_numbers_of_the_cycles(backbone):
    figure = Figure()
    models = {"IC-ROM": EXAMPLE_MODEL}
    plots.plot_backbone(backbone, models, ax=figure.subplots())
    (drawn,) = translated(figure)
    cycles, model = (named(drawn.to_dict()["data"], n) for n in ("cycles of the decay", "IC-ROM"))
    hz = backbone.frequency / (2 * np.pi)
    np.testing.assert_array_equal(array(cycles["x"]), hz)
    np.testing.assert_array_equal(array(cycles["y"]), backbone.amplitude)
    shown = columns(cycles)
    expected = {
        ("cycle", ""): [np.arange(1, len(hz) + 1)],
        ("time", "s"): [backbone.t],
        ("amplitude", "m"): [backbone.amplitude, backbone.amplitude_std],
        ("frequency", "Hz"): [hz, backbone.frequency_std / (2 * np.pi)],
        ("damping ratio", "%"): [100 * backbone.damping_ratio, 100 * backbone.damping_ratio_std],
    }
    for key, arrays in expected.items():
        for own, other in zip(shown.pop(key), arrays, strict=True):
            np.testing.assert_array_equal(own, other)
    # Straight between the 200 points of the curve: off by a part in 1e5 of the frequency.
    error = 100 * (EXAMPLE_MODEL.backbone(backbone.amplitude) / backbone.frequency - 1)
    np.testing.assert_allclose(shown.pop(("IC-ROM off by", "%"))[0], error, atol=1e-3)
    assert not shown and "frequency %{x:.6~g} Hz" in model["hovertemplate"]


@pytest.mark.slow
def test_a_page_from_the_command_stands_alone(run, tmp_path):
    """The numbers are those of the JSON, plotly is in it once, and nothing is fetched or sent."""
    result = run("regress", "--example", "--plain", "--interactive", "--json", "all.json")
    assert result.exit_code == 0, result.output
    page = (tmp_path / "example_regression.html").read_text(encoding="utf-8")
    told = json.loads((tmp_path / "all.json").read_text())[0]["backbone"]
    for name in ("backbone", "damping"):
        shown = columns(named(traces_of(page, f"{name}-1"), "cycles of the decay"))
        for key, quantity, scale in (
            (("amplitude", "m"), "amplitude", 1),
            (("frequency", "Hz"), "frequency", 1),
            (("damping ratio", "%"), "damping_ratio", 100),
        ):
            value, std = shown[key]
            np.testing.assert_allclose(value, scale * np.array(told[quantity]), rtol=1e-15)
            np.testing.assert_allclose(std, scale * np.array(told[f"{quantity}_std"]), rtol=1e-15)
    program = re.findall(r"<script>(/\*\*?\s*\* plotly\.js v.*?)</script>", page, re.S)
    assert len(program) == 1
    rest = page.replace(program[0], "")
    assert "http" not in rest and "//" not in rest and "plotly.js v" not in rest
    assert {*re.findall(r'(?:src|href)="(.)', rest)} == {"#"}
    # Of the buttons of plotly one uploads what is shown; those that are there are named.
    buttons = re.findall(r'"modeBarButtons": (\[\[.*?\]\])', rest)
    assert len(buttons) == rest.count("Plotly.newPlot(") == 5
    known = ["toImage", "zoom2d", "pan2d", "autoScale2d", "resetScale2d"]
    assert all(json.loads(b) == [known] for b in buttons)


@pytest.mark.slow
def test_pages_are_static_unless_asked_otherwise(run, tmp_path):
    run("regress", "--example")
    page = (tmp_path / "example_regression.html").read_text(encoding="utf-8")
    assert "<script" not in page and page.count("data:image/png") == 5


@pytest.mark.parametrize("command", ["identify", "inspect"])
def test_without_plotly_a_command_says_what_to_install_before_any_work(
    run, tmp_path, monkeypatch, command
):
    monkeypatch.setitem(sys.modules, "plotly", None)
    rs.save_decay(rs.example_decay(), tmp_path / "decay.npz")
    result = run(command, "decay.npz", "--interactive")
    assert result.exit_code == 2 and not list(tmp_path.glob("*.html"))
    assert result.stderr == (
        "Error: interactive figures need plotly, which is not installed:"
        ' python -m pip install "romsindy[interactive]"\n'
    )


@pytest.mark.slow
def test_a_method_without_plotly_says_what_to_install(tmp_path, monkeypatch):
    seen = rs.inspect(rs.example_decay(35.0, 0))
    monkeypatch.setitem(sys.modules, "plotly", None)
    with pytest.raises(ValueError, match=r'pip install "romsindy\[interactive\]"$'):
        seen.to_html(tmp_path / "page.html", interactive=True)
    assert not (tmp_path / "page.html").exists()


@pytest.mark.slow
def test_an_inspection_shows_level_and_amplitude_of_the_ridge(tmp_path):
    seen = rs.inspect(rs.example_decay(35.0, 0))
    seen.to_html(tmp_path / "page.html", interactive=True)
    traces = traces_of((tmp_path / "page.html").read_text(encoding="utf-8"), "record-1")
    (level,) = [t for t in traces if t["type"] == "heatmap"]
    n, m = array(level["z"]).shape
    assert (len(array(level["y"])), len(array(level["x"]))) == (n + 1, m + 1)  # edges of cells
    assert "level %{z:.3~g} dB re 1 m" in level["hovertemplate"]
    shown, ridge = columns(named(traces, "mode 1")), seen.modes[0].parts[0].tone
    np.testing.assert_array_equal(shown["amplitude", "m"][0], ridge.amplitude)
    np.testing.assert_array_equal(shown["frequency", "Hz"][0], ridge.frequency)


@pytest.mark.slow
def test_a_diagnosis_shows_motions_where_one_can_zoom(tmp_path):
    """Before and after in time, and the cycles of both; the plane of the phase stays an image."""
    real = rs.ReducedModel.from_coefficients(
        {"omega^2": 2500.0, "c_linear": 0.4, "c_quadratic": 1.0}, unit="m"
    )
    model = rs.ReducedModel(real.terms[:2], real.values[:2], "m")
    decay = rs.add_noise(real.simulate(0.08, 0.0, np.arange(0, 4, 0.005)), 40, 3)
    report = rs.diagnose(model, decay, catalogue=(AirDrag(),))
    report.to_html(tmp_path / "page.html", interactive=True)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.count("<img alt=") == 1 and page.count('<div class="curves"') == 5
    traces, gap = traces_of(page, "gap-1"), report.gap.predictions[report.gap.worst]
    for name in ("before", "after"):
        y = array(named(traces, name)["y"])
        taken = np.isfinite(y)
        np.testing.assert_allclose(y[taken], getattr(gap, name)[taken], atol=1e-15)
        assert taken.mean() > 0.2  # the stretches that took no part
    cycles = columns(named(traces_of(page, "amplitude-1")[:3], "measured"))
    read = gap.backbone(gap.record.signal)
    np.testing.assert_array_equal(cycles["time", "s"][0], read.t)
    before, after = (columns(named(traces_of(page, "time-1"), n)) for n in ("before", "after"))
    assert np.nanmax(after["error over noise", ""]) < np.nanmax(before["error over noise", ""])
    # Amplitude and frequency of a cycle are between those of the cycles to either side.
    hz = read.frequency / (2 * np.pi)
    for key, values in ((("amplitude", "m"), read.amplitude), (("frequency", "Hz"), hz)):
        known = np.isfinite(after[key][0])
        place = np.searchsorted(read.t, after["time", "s"][0][known])
        low, high = np.sort([values[place - 1], values[place]], axis=0)
        shown = after[key][0][known]
        assert np.all((low - 1e-12 <= shown) & (shown <= high + 1e-12)) and known.mean() > 0.5


def test_cycles_of_several_files_keep_their_numbers(backbone, tmp_path):
    write_overview(tmp_path / "all.html", "", [["file", "report"], ["a.csv", "-"]],
                   {"a.csv": backbone}, interactive=True)  # fmt: skip
    page = (tmp_path / "all.html").read_text(encoding="utf-8")
    for column in ("backbones-1", "backbones-2"):
        shown = columns(named(traces_of(page, column), "a.csv"))
        numbers = shown["cycle", ""][0]
        np.testing.assert_array_equal(numbers, np.flatnonzero(backbone.certain) + 1)


def test_the_page_of_the_study_has_both(tmp_path):
    """Files of a picture are written as always; in the page are curves where that can be."""

    def line(figure):
        figure.subplots().plot([0, 1], [0, 1])

    def cloud(figure):
        figure.subplots().scatter([0, 1], [0, 1])

    pictures = [Picture(draw.__name__, "Title", "Caption.", draw) for draw in (line, cloud)]
    written = write_chapter(Chapter("Chapter", "Text.", [], pictures), tmp_path, interactive=True)
    write_story([written], [], tmp_path, "settings", interactive=True)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("<img alt=") == page.count('<div class="curves"') == 1
    assert len(traces_of(page, "line-1")) == 1
    files = {f"{p.name}.{kind}" for p in pictures for kind in ("png", "svg")}
    assert files <= {f.name for f in tmp_path.iterdir()}


def test_cycles_of_several_decays_have_its_number(backbone):
    figure = Figure()
    plots.plot_damping([backbone, backbone], ax=figure.subplots())
    data = translated(figure)[0].to_dict()["data"]
    cycles = [columns(t) for t in data if "customdata" in t]
    for i, shown in enumerate(cycles, 1):
        assert np.all(shown["decay", ""][0] == i)
        np.testing.assert_array_equal(shown["time", "s"][0], backbone.t)
    assert len(cycles) == 2 and [t.get("showlegend") for t in data].count(True) == 1
    with pytest.raises(ValueError, match="holds no cycles"):
        plots.plot_damping([])


# -- what becomes of a figure ------------------------------------------------------------------


def drawn(draw, *shape, **options):
    """The only column of a figure, as plotly has it."""
    figure = Figure()
    draw(figure.subplots(*shape, **options))
    (column,) = translated(figure)
    return column.to_dict()


def test_looks_and_limits_are_those_of_the_figure():
    def draw(axes):
        above, below = axes
        above.plot([0, 1], [1, 10], "--s", color="C3", mfc="white", label="one")
        above.fill_between([0, 1], [0, 5], [2, 20], color="C3", alpha=0.25)
        above.set(ylabel="amplitude (m)", yscale="log", ylim=(0.5, 50), xlim=(0, 2))
        below.plot([0, 1], [0, 1], ":", color="C3", label="one")
        below.axvline(0.5, color="k")
        below.set(xlabel="time (s)", ylabel="$\\omega_1$ (1/s$^2$)")

    page = drawn(draw, 2, sharex=True)
    band, line, below = page["data"]
    rgb = ", ".join(f"{255 * c:.0f}" for c in to_rgba("C3")[:3])
    assert band["fillcolor"] == f"rgba({rgb}, 0.25)" and band["legendgroup"] == "one"
    assert np.nanmin(array(band["y"])) > 0  # nothing below a logarithmic axis
    assert line["line"]["color"] == below["line"]["color"] == f"rgba({rgb}, 1)"
    assert (line["line"]["dash"], below["line"]["dash"]) == ("dash", "dot")
    assert (line["mode"], below["mode"]) == ("lines+markers", "lines")
    assert line["marker"]["symbol"] == "square"
    assert [t["showlegend"] for t in page["data"]] == [False, True, False]  # one name once
    layout = page["layout"]
    np.testing.assert_allclose(layout["yaxis"]["range"], np.log10([0.5, 50]))
    assert layout["yaxis"]["type"] == "log" and layout["xaxis2"]["matches"] == "x"
    assert list(layout["xaxis"]["range"]) == list(layout["xaxis2"]["range"]) == [0, 2]
    assert layout["yaxis"]["domain"][0] > layout["yaxis2"]["domain"][1]
    title = layout["yaxis2"]["title"]["text"]  # may be wrapped
    assert title.replace("<br>", " ") == "ω<sub>1</sub> (1/s<sup>2</sup>)"
    # The label of the axis below, which both share.
    assert line["hovertemplate"].startswith("<b>one</b><br>time %{x:.6~g} s<br>amplitude %{y")
    (across,) = layout["shapes"]
    assert (across["xref"], across["yref"], across["x0"]) == ("x2", "y2 domain", 0.5)


def test_bars_have_their_values_and_places():
    figure = Figure()
    before, after = np.array([8.0, 5.0]), np.array([0.9, 2.0])
    compared.draw_errors(["record 1", "record 2"], before, after, figure)
    (page,) = translated(figure)
    for trace, values in zip(page.to_dict()["data"], (before, after), strict=True):
        np.testing.assert_allclose(array(trace["base"]) + array(trace["y"]), values)
        np.testing.assert_allclose(array(trace["customdata"])[:, 0], values)
        assert list(trace["hovertext"]) == ["record 1", "record 2"]
    assert [note.text for note in page.layout.annotations] == ["8", "5", "0.9", "2"]


def test_a_hidden_curve_is_shown_and_facts_go_with_their_curve():
    def draw(ax):
        (line,) = ax.plot([1, 2], [3, 4], visible=False, label="hidden")
        tell(line, Fact("mass (kg)", np.array([5.0, 6.0]), np.array([0.1, 0.2]), 3))

    (trace,) = drawn(draw)["data"]
    assert trace["name"] == "hidden" and "visible" not in trace
    assert "mass %{customdata[0]:.3~g} ± %{customdata[1]:.2~g} kg" in trace["hovertemplate"]
    np.testing.assert_array_equal(array(trace["customdata"]), [[5, 0.1], [6, 0.2]])


def test_columns_stand_by_themselves_and_what_has_no_counterpart_stays_an_image():
    figure = Figure()
    left, right = figure.subplots(1, 2, sharey=True)
    left.plot([0, 1], [0, 1])
    left.set_ylabel("amplitude (m)")
    assert len(translated(figure)) == 2
    assert translated(figure)[1].layout.yaxis.title.text == "amplitude (m)"
    right.scatter([0, 1], [0, 1])
    assert translated(figure) == [] and curves(figure, "name") == ""
    figure = Figure()
    edges, angle = np.linspace(0, 1, 3), np.linspace(0, 6, 5)
    compared.draw_plane(edges, angle, np.ones((2, 4)), figure)
    assert translated(figure) == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("amplitude (kg$^{1/2}$ m)", "amplitude (kg<sup>1/2</sup> m)"),
        (r"$\Upsilon_{3}$", "Υ<sub>3</sub>"),
        (r"$c_{\mathrm{a~b}}$", "c<sub>a b</sub>"),
        ("a_b (c) 5 %", "a_b (c) 5 %"),
    ],
)
def test_formulas_in_labels(text, expected):
    assert words(text) == expected
