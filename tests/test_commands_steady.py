"""`romsindy steady`: equations from tables of steady states, against shooting and closed forms."""

from __future__ import annotations

import json
import re
from functools import partial

import numpy as np
import pytest
import steady_oracle as oracle
from click.testing import CliRunner

import romsindy as rs
from romsindy.commands.main import main
from romsindy.commands.steady import SteadyTable

# A resonance at 5 Hz whose stiffness grows; q in m.
K, G, C = (2 * np.pi * 5) ** 2, 4e6, 1.2
TRUE = {"omega^2": K, "gamma_3": G, "c_linear": C}
GAIN = 2.0  # m/s^2 for a newton
HEADER = "frequency [Hz],force [N],displacement [mm],displacement phase [deg]"


@pytest.fixture
def run(run):
    return partial(run, "steady")


def write(path, header, *columns):
    np.savetxt(path, np.column_stack(columns), "%.12g", ",", header=header, comments="")


@pytest.fixture(scope="module")
def duffing():
    """Two levels by shooting, in rad/s, N and m: both folds and the unstable orbits are in it."""
    parts = []
    for force in (0.03, 0.06):
        # In units of the resonance and of 5 mm, in which the oracle works.
        scale, size = np.sqrt(K), 5e-3
        f, c, g = GAIN * force / (K * size), C / scale, G * size**2 / K
        top = f / c
        w, q, _ = oracle.curve(np.linspace(0.2, 0.85, 8) * top, f, c, 1.0, g, (0.6, 1.9))
        parts.append((w * scale, np.full(len(w), force), q * size))
    return [np.concatenate(x) for x in zip(*parts, strict=True)]


@pytest.fixture(scope="module")
def linear():
    """In closed form: frequency in Hz, force, and complex displacement in m."""
    hz = np.linspace(4.5, 5.5, 24)
    w = 2 * np.pi * hz
    return hz, np.full(24, 0.3), 0.3 * GAIN / (K - w**2 + 1j * C * w)


def test_a_duffing_oscillator_is_recovered(run, duffing, tmp_path):
    w, force, q = duffing
    polar = 1e3 * np.abs(q), np.degrees(np.angle(q))
    write(tmp_path / "points.csv", HEADER, w / (2 * np.pi), force, *polar)
    written = ["--json", "all.json", "--model", "model.json", "--save", "fit.json"]
    result = run("points.csv", "--term", "gamma_3", *written)
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert len(lines) <= 12 + 4 and "spread was not given" in result.output
    (content,) = json.loads((tmp_path / "all.json").read_text())
    found = {name: entry["value"] for name, entry in content["coefficients"].items()}
    # Steps of the oracle and harmonics that are left out: parts in a million.
    assert found == pytest.approx(TRUE, rel=1e-5)
    assert content["excitation"]["gain"]["value"] == pytest.approx(GAIN, rel=1e-5)
    model = rs.ReducedModel.from_json((tmp_path / "model.json").read_text())
    assert model.unit == "m" and rs.Estimate.load(tmp_path / "fit.json").model == model
    page = (tmp_path / "points_steady.html").read_text(encoding="utf-8")
    assert page.count("data:image/png") == 5 and "no curve at" not in page


@pytest.mark.parametrize(
    ("rate", "name", "factor"),
    [(0, "response [um]", 1e6), (1, "velocity_amplitude [mm/s]", 1e3), (2, "a [g]", 1 / 9.80665)],
)
def test_names_and_units_say_what_was_measured(run, linear, tmp_path, rate, name, factor):
    hz, force, q = linear
    x = factor * q * (2j * np.pi * hz) ** rate
    name = name.replace("a [", "acceleration [")
    phase = name.partition("[")[0].replace("_amplitude", "") + "phase [rad]"
    header = f"Frequency [rad/s],force [kN],force phase [deg],{name},{phase}"
    turned = np.angle(x * np.exp(1j * 0.4))
    columns = 2 * np.pi * hz, force / 1e3, np.full(24, np.degrees(0.4)), np.abs(x), turned
    write(tmp_path / "points.csv", header, *columns)
    result = run("points.csv", "--term", "c_linear", "--phase", 0, "--model", "model.json")
    assert result.exit_code == 0, result.output
    model = rs.ReducedModel.from_json((tmp_path / "model.json").read_text())
    assert model.coefficients == pytest.approx({"omega^2": K, "c_linear": C}, rel=1e-7)


def test_what_is_known_is_kept_and_lags_are_turned(run, linear, tmp_path):
    hz, force, q = linear
    header = f"{HEADER},spread [mm]"
    columns = hz, force, 1e3 * np.abs(q), -np.degrees(np.angle(q)), np.full(24, 1e-3)
    write(tmp_path / "points.csv", header, *columns)
    known = ["--fix", f"omega^2={K}", "--gain", GAIN, "--term", "c_linear"]
    refused = run("points.csv", *known)
    assert refused.exit_code == 2 and "points.csv: response leads the force" in refused.stderr
    assert "say --lag" in refused.stderr
    result = run("points.csv", *known, "--lag", "--json", "-")
    (content,) = json.loads(result.stdout)
    assert content["coefficients"]["omega^2"] == {
        "value": K, "standard_error": None, "unit": "1/s^2"
    }  # fmt: skip
    assert content["coefficients"]["c_linear"]["value"] == pytest.approx(C, rel=1e-7)
    assert content["excitation"]["gain"] == {"value": GAIN, "standard_error": None}


def test_higher_harmonics_are_columns_of_their_own(run, tmp_path):
    model = rs.ReducedModel.from_coefficients(TRUE, unit="m")
    orbits = rs.forced_response(model, 0.12, (29.0, 34.0), n_harmonics=9, n_points=20)
    q, hz = orbits.coefficients[:, 1:4], orbits.frequency / (2 * np.pi)
    names = [f"displacement{n}{end}" for n in ("", " 2", " 3") for end in (" [m]", " phase [rad]")]
    columns = [part for h in q.T for part in (np.abs(h), np.angle(h))]
    header = ",".join(["frequency [Hz]", "force [N]", *names])
    write(tmp_path / "points.csv", header, hz, np.full(len(hz), 0.06), *columns)
    result = run("points.csv", "--term", "gamma_3", "--model", "model.json")
    assert result.exit_code == 0, result.output
    found = rs.ReducedModel.from_json((tmp_path / "model.json").read_text())
    assert found.coefficients == pytest.approx(TRUE, rel=1e-5)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("frequency [Hz],force [N],strain [um],phase [deg]", "the column 'strain' is not underst"),
        ("frequency [Hz],torque,displacement [mm],displacement phase [deg]", "column 'torque'"),
        ("frequency [Hz],force [N],spread [mm],force phase [deg]", "no column of the response"),
        ("frequency,force [N],displacement [mm],displacement phase [deg]", "give [Hz] or [rad/s]"),
        ("frequency [Hz],force [N],displacement [mm],displacement phase", "give [deg] or [rad]"),
        ("frequency [Hz],force [N],displacement [mm],displacement 3 [mm]", "'displacement 2'"),
        ("frequency [Hz],force [N],displacement [mm],velocity [m/s]", "are two responses"),
        ("frequency [Hz],force [N],displacement [mm],displacement [m]", "hold the same"),
        ("frequency [Hz],force [N],displacement [m/s],force phase [deg]", "is one of velocity"),
        ("frequency [Hz],force [N],response,response phase [deg]", "or give --quantity"),
        ("frequency [Hz],force [N],displacement [mm],frequency phase [deg]", "phase' is not under"),
        ("frequency [Hz],force [N],displacement [mm],spread 2 [mm]", "'spread 2' is not underst"),
        (
            "frequency [Hz],force [N],displacement [mm],displacement 2 [mm]",
            "amplitudes are not neg",
        ),
        ("force phase [deg],force [N],displacement [mm],spread [mm]", "no column 'frequency'"),
    ],
)
def test_what_a_table_lacks_is_said(run, linear, tmp_path, header, words):
    hz, force, q = linear
    write(tmp_path / "points.csv", header, hz, force, 1e3 * np.abs(q), np.degrees(np.angle(q)))
    quantity = ["--quantity", "displacement"] if "m/s],f" in header else []
    result = run("points.csv", *quantity)
    assert result.exit_code == 2 and words in result.stderr, result.stderr
    assert result.stderr.startswith("Error: points.csv: ") and result.stderr.count("\n") == 1


def test_a_table_without_points_is_named_once(run, tmp_path):
    (tmp_path / "none.csv").write_text(HEADER + "\n")
    result = run("none.csv")
    assert result.exit_code == 2 and result.stderr.count("none.csv") == 1
    assert "no line starts with a number" in result.stderr
    assert "with a time or frequency and what was measured" in result.stderr


@pytest.mark.slow
def test_a_slope_that_is_not_needed_is_told(run, duffing, tmp_path):
    """Also where nothing else of the chain is fitted."""
    w, force, q = duffing
    rng = np.random.default_rng(4)
    q = q + 1e-5 * (rng.standard_normal(len(q)) + 1j * rng.standard_normal(len(q)))
    polar = 1e3 * np.abs(q), np.degrees(np.angle(q))
    write(tmp_path / "points.csv", HEADER, w / (2 * np.pi), force, *polar)
    known = ["--gain", GAIN, "--phase", 0]
    result = run("points.csv", "--slope", "fit", *known)
    assert result.exit_code == 0 and "a slope of the gain was looked for, and" in result.output
    assert "a slope of the gain" not in run("points.csv", *known).output


def test_what_comes_next_helps_where_the_points_are_not_explained(run, duffing, tmp_path):
    """Without gamma_3 a linear oscillator is left, which no level follows."""
    w, force, q = duffing
    polar = 1e3 * np.abs(q), np.degrees(np.angle(q)), np.full(len(w), 1e-3)
    write(tmp_path / "points.csv", f"{HEADER},spread [mm]", w / (2 * np.pi), force, *polar)
    right, wrong = (run("points.csv", "--term", t).output for t in ("gamma_3", "c_quadratic"))
    assert "Next: --save keeps the fit" in right
    assert re.search("Next: leave out points .*another --term; --slope fit lets", wrong)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--slope", "steep"], "'steep' is neither a number nor fit"),
        (
            ["--slope", "fit"],
            "force has one amplitude, which tells no slope of the gain: give --slope 0",
        ),
        (["--sweep-rate", "0"], "'--sweep-rate'"),
        (["--sweep-rate", "1"], "response is complex, and sweeps are known by their amplitude"),
        (["--term", "gamma"], "coefficient name 'gamma' is not known"),
        (["--figure", "f.png"], "--figure is no option here, but of romsindy identify"),
    ],
)
def test_options_that_cannot_be(run, linear, tmp_path, options, words):
    hz, force, q = linear
    write(tmp_path / "points.csv", HEADER, hz, force, 1e3 * np.abs(q), np.degrees(np.angle(q)))
    result = run("points.csv", *options)
    assert result.exit_code == 2 and words in result.stderr


def test_at_resonance_the_gain_is_asked_for(run, tmp_path):
    """Force and velocity in phase: the ratio of gain and damping alone is seen, and the answer
    with a known gain is that of the closed form."""
    force = np.linspace(0.1, 0.8, 8)
    size = GAIN * force / (C * np.sqrt(K))
    hz = np.full(8, np.sqrt(K) / (2 * np.pi))
    write(tmp_path / "points.csv", HEADER, hz, force, 1e3 * size, np.full(8, -90.0))
    refused = run("points.csv", "--term", "c_linear")
    assert refused.exit_code == 2 and "give --gain and --phase, or add points" in refused.stderr
    known = ["--term", "c_linear", "--gain", GAIN, "--phase", 0, "--model", "model.json"]
    result = run("points.csv", *known)
    assert result.exit_code == 0, result.output
    model = rs.ReducedModel.from_json((tmp_path / "model.json").read_text())
    assert model.coefficients == pytest.approx({"omega^2": K, "c_linear": C}, rel=1e-7)
    assert "no curve" not in result.output  # without levels there are points alone


def test_units_may_end_a_name(linear, tmp_path):
    """Names of MATLAB hold no brackets."""
    hz, force, x = linear
    polar = 1e3 * np.abs(x), np.degrees(np.angle(x))
    write(tmp_path / "said.csv", HEADER, hz, force, *polar)
    names = "frequency_Hz,force_N,displacement_mm,displacement_phase_deg"
    write(tmp_path / "joined.csv", names, hz, force, *polar)
    said, joined = (SteadyTable.read(tmp_path / f"{name}.csv") for name in ("said", "joined"))
    for field in ("frequency", "force", "response"):
        np.testing.assert_array_equal(getattr(said, field), getattr(joined, field))
    assert (joined.unit, joined.force_unit, joined.quantity) == ("m", "N", "displacement")
    # Where no word says of what, it is the response.
    write(tmp_path / "bare.csv", "frequency_Hz,force_V,amplitude_mm,phase_deg", hz, force, *polar)
    bare = SteadyTable.read(tmp_path / "bare.csv")
    np.testing.assert_array_equal(bare.response, said.response)
    assert (bare.force_unit, bare.quantity) == ("V", "displacement")
    write(tmp_path / "odd.csv", "frequency_Hz,force_N,colour_mm", hz, force, polar[0])
    with pytest.raises(ValueError, match="the column 'colour_mm' is not understood"):
        SteadyTable.read(tmp_path / "odd.csv")


def test_a_table_of_steady_states_that_is_inspected_is_sent_here(linear, tmp_path):
    hz, force, x = linear
    write(tmp_path / "points.csv", HEADER, hz, force, np.abs(x), np.angle(x))
    refused = CliRunner().invoke(main, ["inspect", str(tmp_path / "points.csv")])
    assert refused.exit_code == 2 and "is read by romsindy steady" in refused.stderr
