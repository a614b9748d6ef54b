"""`romsindy identify --input`: a Duffing oscillator under inputs, integrated by scipy."""

import base64
import json
import re

import numpy as np
import pytest
from click.testing import CliRunner
from oracles import multisine
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.commands import measurement
from romsindy.commands.main import main
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.results import predict as predict_module

TRUTH = {"omega^2": 987.0, "c_linear": 0.8, "gamma_3": 2e4}
GAIN = 3.0  # m/(s^2 N), or the participation factor
DT = 0.01
T = DT * np.arange(2000)
KNOWN = ["--interpolation", "band-limited"]  # three times as fast
GRAVITY = 9.80665


def response(push, seed):
    """Displacement, m, at 40 dB."""

    def rates(t, y):
        q, v = y
        return [v, push(t) - 0.8 * v - 987.0 * q - 2e4 * q**3]

    done = solve_ivp(rates, (0, T[-1]), [0, 0], "DOP853", T, rtol=1e-8, atol=1e-10)
    q = done.y[0]
    return q + 0.01 * q.std() * np.random.default_rng(seed).standard_normal(len(q))


def write(path, **columns):
    """Columns under names that may hold a unit: ``force_N`` is "force [N]"."""
    names = [re.sub(r"__(.*)", r" [\1]", name) for name in columns]
    table = np.column_stack([T, *columns.values()])
    header = ",".join(["time [s]", *names])
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.10g")


@pytest.fixture(scope="module")
def pushed():
    """Samples of a force in N, and the displacement."""
    force = multisine(1)
    return force(T), response(lambda t: GAIN * force(t), 2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, pushed):
    path = tmp_path_factory.mktemp("forced")
    u, q = pushed
    write(path / "shaker.csv", displacement__mm=1e3 * q, force__kN=1e-3 * u)
    write(path / "plain.csv", x=q, y=u)
    write(path / "two.csv", q__m=q, force_left=u, force_right=np.roll(u, 7), base__g=u[::-1])
    write(path / "still.csv", q__m=q, force=0 * u)
    np.savez(path / "short.npz", t=T, q=q, force=u[:-100])
    lines = (path / "shaker.csv").read_text().splitlines()
    missing = [
        line if i < 1900 else f"{line.rsplit(',', 1)[0]},nan" for i, line in enumerate(lines)
    ]
    (path / "nan.csv").write_text("\n".join(missing) + "\n")
    return path


@pytest.fixture(scope="module")
def identified(folder):
    """What the command printed, and its result."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        files = ["--json", "out.json", "--model", "model.json", "--save", "fit.json"]
        options = [
            "--input",
            "force",
            "--select",
            "--held-out",
            "0.2",
            "--figure",
            "band.png",
            "--full",
        ]
        result = CliRunner().invoke(main, ["identify", "shaker.csv", *options, *files])
    assert result.exit_code == 0, result.output
    return result.output, json.loads((folder / "out.json").read_text())[0]


def near(found, name, value):
    """Within four standard errors."""
    return abs(found[name]["value"] - value) < 4 * found[name]["standard_error"]


def test_the_equation_is_found_with_its_errors(identified):
    printed, result = identified
    found, force = result["coefficients"], result["inputs"]["force"]
    assert {*found} == {*TRUTH, "gain [force]"} and result["explained"]
    assert all(near(found, name, value) for name, value in TRUTH.items())
    assert near(found, "gain [force]", GAIN)
    assert force["unit"] == "N" and force["interpolation"] == "band-limited"
    assert abs(force["delay"]) < 4 * force["delay_std"] < 1e-3 * DT * 40
    assert force["delay_in_samples"] == pytest.approx(force["delay"] / DT)
    assert "m/(s^2 N)" in printed and "input is band-limited, not linear or held" in printed


def test_what_is_held_out_is_predicted_to_its_noise(identified, pushed):
    printed, result = identified
    noise = 0.01 * pushed[1].std()
    assert result["held_out"]["start"] == pytest.approx(16.0)
    # Of 350 samples, four standard errors of their rms; the state adds a little.
    assert result["held_out"]["error"] == pytest.approx(noise, rel=0.2)
    assert re.search(r"The last 3.99 s \(400 samples\) took no part in the fit: .* um rms", printed)


def test_what_is_printed_and_written(identified, folder):
    printed, result = identified
    assert "columns: displacement 'displacement', force 'force'" in printed
    assert re.search(r"^  input +gain .* between samples$", printed, re.M)
    page = (folder / result["report"]).read_text(encoding="utf-8")
    drawn = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert len(drawn) == 5 and all(base64.b64decode(p).startswith(b"\x89PNG") for p in drawn)
    for words in (
        "Backbone and damping",
        "Over time",
        "cycles round",
        "Spectrum of what",
        "Inputs",
    ):
        assert words in page
    assert "took no part" in page and "<math" in page and "gain [force]" in page
    assert (folder / "band.png").read_bytes().startswith(b"\x89PNG")
    model = rs.ReducedModel.from_json((folder / "model.json").read_text())
    assert model == rs.Estimate.load(folder / "fit.json").model


def test_the_band_of_the_page_is_that_of_the_truth(identified, folder):
    """Backbone of the Duffing oscillator to second order: omega (1 + 3 gamma a^2 / (8 omega^2))."""
    a = 0.01
    band = rs.Estimate.load(folder / "fit.json").band([a])
    omega = np.sqrt(987.0) * (1 + 3 * 2e4 * a**2 / (8 * 987.0))
    assert band.frequency[0] == pytest.approx(omega, rel=1e-4)


def test_without_select_the_model_is_what_is_asked_for(run):
    options = ["--order", 3, "--damping", "linear", "--damping", "quadratic", *KNOWN]
    result = run("identify", "shaker.csv", "--input", "force", *options, "--json", "-")
    assert result.exit_code == 0, result.output
    (found,) = json.loads(result.stdout)
    wanted = {*TRUTH, "gamma_2", "c_quadratic", "gain [force]"}
    assert {*found["coefficients"]} == wanted and found["held_out"] is None
    assert all(near(found["coefficients"], n, v) for n, v in TRUTH.items())


def test_a_base_in_g_and_a_part_of_the_record(run, folder):
    """q'' + ... = - Gamma a; from 5 s on, the initial state is another one."""
    a = multisine(3)
    q = response(lambda t: -GAIN * a(t), 4)
    write(folder / "table.csv", q__m=q, sensor=a(T) / GRAVITY)
    options = ["--input", "base", "--column", "q", "--unit-input", "g", "--start", 5, "--order", 3]
    result = run("identify", "table.csv", *options, *KNOWN, "--json", "-")
    assert result.exit_code == 0, result.output
    (found,) = json.loads(result.stdout)
    assert near(found["coefficients"], "Gamma [base]", GAIN)
    assert found["coefficients"]["Gamma [base]"]["unit"] == "1"
    assert found["inputs"]["base"]["unit"] == "m/s^2"
    assert "1500 samples" in " ".join(found["notes"])


@pytest.mark.slow
def test_two_inputs_of_one_kind(run, folder):
    left, right = multisine(5), multisine(6)
    q = response(lambda t: GAIN * left(t) - 0.5 * right(t), 7)
    write(folder / "pair.csv", q__m=q, left__N=left(T), right__N=right(T))
    options = ["--input", "force", "--input", "force", "--order", 3, *KNOWN]
    result = run("identify", "pair.csv", *options, "--json", "-")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)[0]["coefficients"]
    assert near(found, "gain [force]", GAIN) and near(found, "gain [force 2]", -0.5)


def test_several_files_and_one_that_is_refused(run, folder):
    options = ["--input", "force", "--order", 3, *KNOWN]
    result = run("identify", "shaker.csv", "still.csv", *options)
    assert result.exit_code == 2
    row = re.search(
        r"^shaker.csv +- +(\S+) .* driven +yes +shaker_report.html", result.output, re.M
    )
    assert float(row[1]) == pytest.approx(np.sqrt(987.0) / (2 * np.pi), rel=1e-3)
    assert "still.csv: the input 'force' is zero" in result.output
    assert "Identified: 1 files, 1 of them explained" in result.output
    assert "2 records" in (folder / "identify_overview.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("file", "options", "message"),
    [
        ("shaker.csv", ["--mode", "1"], "--mode is for free decays: leave it out beside --input"),
        ("shaker.csv", ["--band", "5", "9"], "--band is for free decays"),
        ("shaker.csv", ["--coordinates", "2"], "coordinates = 2, but what the inputs move"),
        ("shaker.csv", ["--release", "1"], "--release is for free decays"),
        ("shaker.csv", ["--fix", "omega3=9"], "shaker.csv: fixed names ['omega3'], but"),
        ("shaker.csv", ["--curvature", "0.1"], "--curvature is for free decays"),
        ("shaker.csv", ["--select", "--damping", "cubic"], "leave it out beside --select"),
        ("shaker.csv", ["--held-out", "2"], "Invalid value for '--held-out': 2.0 is not in"),
        ("shaker.csv", ["--held-out", "0.01"], "--held-out 0.01 of 2000 samples are 20"),
        ("shaker.csv", ["--input-column", "f"], "--input-column f is none of ['time', 'displacem"),
        ("shaker.csv", ["--input", "base"], "which column is the input 'base' is not clear among"),
        ("shaker.csv", ["--unit-input", "kg"], "--unit-input kg is no unit of a force: use N, kN"),
        ("shaker.csv", ["--unit-input", "mm"], "--unit-input mm is no unit of a force"),
        ("plain.csv", [], "is not clear among ['x', 'y']: choose with --input-column"),
        ("two.csv", [], "not clear among ['q', 'force_left', 'force_right', 'base']"),
        ("two.csv", ["--input-column", "force_left", "--column", "q", "--column", "base"],
         "two.csv: unit 'g' is one of acceleration, but"),
        ("shaker.csv", ["--unit-input", "N", "--unit-input", "V"], "must be one unit, or one for"),
        ("shaker.csv", ["--order", "0"], "shaker.csv: order = 0 must be a whole number, 1 or more"),
        (
            "two.csv",
            ["--input-column", "force_left", "--input-column", "force_right"],
            "are 2 columns for the 1 inputs ['force']: name one for each",
        ),
        ("shaker.csv", ["--input-column", "force", "--column", "force"], "name each column once"),
        ("still.csv", [], "still.csv: the input 'force' is zero: it drives no vibration"),
        ("short.npz", [], "'force' has 1900 samples, and 'q' 2000: response and input need one"),
        ("nan.csv", [], "column 'force' has 101 values that are NaN or infinite, the first at"),
        ("none.csv", [], "none.csv: no such file"),
    ],
)  # fmt: skip
def test_what_cannot_be(run, file, options, message):
    result = run("identify", file, "--input", "force", *options)
    assert result.exit_code == 2
    assert message in result.stderr and len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("option", "value"),
    [("input-column", "f"), ("unit-input", "N"), ("interpolation", "hold"), ("held-out", "0.2")],
)
def test_options_of_inputs_need_one(run, option, value):
    result = run("identify", "shaker.csv", f"--{option}", value)
    assert result.exit_code == 2
    assert f"--{option} is for records with inputs: say --input force" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_an_example_has_no_input(run):
    result = run("identify", "--example", "--input", "force")
    assert result.exit_code == 2 and "--example is for free decays" in result.stderr


def test_a_base_displacement_is_refused(run, folder):
    """Its second derivative is what drives; said by its unit, or found by its sign and size."""
    rng = np.random.default_rng(9)
    omega, phase = 2 * np.pi * rng.uniform(1.0, 12.0, 60), rng.uniform(0, 2 * np.pi, 60)
    x = -np.sum(np.cos(np.multiply.outer(T, omega) + phase) / omega**2, axis=1)
    q = response(lambda t: -GAIN * np.cos(omega * t + phase).sum(), 8)
    write(folder / "moved.csv", q__m=q, base=x)
    refused = run("identify", "moved.csv", "--input", "base", *KNOWN)
    assert refused.exit_code == 2 and "it looks like the displacement of the base" in refused.stderr
    refused = run("identify", "moved.csv", "--input", "base", "--unit-input", "mm")
    assert "--unit-input mm is no unit of the acceleration of a base: use m/s^2" in refused.stderr


@pytest.mark.slow
@pytest.mark.parametrize("options", [["--select"], ["--order", 3]])
def test_known_coefficients_stay_as_they_are(run, options):
    """The others stay within four standard errors of the truth."""
    known = ["--input", "force", *options, "--fix", f"omega^2={TRUTH['omega^2']}"]
    result = run("identify", "shaker.csv", *known, "--json", "-")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)[0]["coefficients"]
    assert found["omega^2"]["value"] == TRUTH["omega^2"]
    assert found["omega^2"]["standard_error"] is None
    assert near(found, "c_linear", TRUTH["c_linear"]) and near(found, "gain [force]", GAIN)


def test_a_model_without_a_motion_is_told_with_a_remedy(run, folder, monkeypatch):
    def lost(*_, **__):
        raise TrajectoryError("it leads far away")

    monkeypatch.setattr(measurement, "identify", lost)
    refused = run("identify", "shaker.csv", "--input", "force")
    assert refused.exit_code == 2
    assert "shaker.csv: it leads far away; a lower --order, or --select" in refused.stderr


def test_a_prediction_that_leaves_is_told(run, monkeypatch):
    def lost(*_, **__):
        raise TrajectoryError("it leads far away")

    monkeypatch.setattr(predict_module, "integrate", lost)
    options = ["--input", "force", "--order", 3, *KNOWN, "--held-out", 0.2]
    result = run("identify", "shaker.csv", *options, "--report", "lost.html")
    assert result.exit_code == 0, result.output
    assert "no motion that long from their first 50 samples" in result.output


def test_columns_of_inputs(folder, pushed):
    """By name, by unit, as what is left; each in SI units."""
    u, q = pushed
    both = rs.load_forced(folder / "two.csv", ["base", "force", "force 2"], column="q")
    assert both.units == ("m/s^2", None, None) and both.unit == "m"
    np.testing.assert_allclose(both.u[:, 0], GRAVITY * u[::-1], rtol=1e-8)
    np.testing.assert_allclose(both.u[:, 2], np.roll(u, 7), rtol=1e-8)
    kilo = rs.load_forced(folder / "shaker.csv")
    assert kilo.units == ("N",)
    np.testing.assert_allclose(kilo.u[:, 0], u, rtol=1e-8)
    left = rs.load_forced(folder / "plain.csv", "base", column="x", input_unit="V")
    assert left.units == ("V",) and "base 'y'" in left.notes[0]
    np.testing.assert_allclose(left.y, q, rtol=1e-8)
    write(folder / "acc.csv", q__mm=1e3 * q, a__g=u)
    table = rs.load_forced(folder / "acc.csv", "base")
    assert table.units == ("m/s^2",) and table.measured == "displacement"
    named = rs.load_forced(folder / "plain.csv", input_column="x", interpolation="hold")
    assert named.interpolation == "hold" and "displacement 'y'" in named.notes[0]


def test_inspect_names_a_force(run):
    """No modes of the drive, and the command that takes it."""
    printed = run("inspect", "shaker.csv").stdout
    # Sixty tones on 220 lines of the spectrum are as good as random.
    assert "driven by the force in column 'force': random from 1" in printed
    assert re.findall(r"^  romsindy (.*)$", printed, re.M) == [
        "identify shaker.csv --input force --select"
    ]
    assert (
        "Modes" not in printed and "Releases" not in run("inspect", "shaker.csv", "--full").stdout
    )


def test_an_end_without_samples_is_cut_off(folder):
    assert len(rs.load_forced(folder / "nan.csv", end=18.9).t) == 1891


def test_units_of_columns_that_differ():
    t = DT * np.arange(50)
    u = np.column_stack([np.sin(t), np.cos(t)])
    names = ("force", "base")
    record = rs.ForcedVibration(t, u[:, 0], u, inputs=names, input_unit=("N", "m/s^2"))
    assert record.units == ("N", "m/s^2")
    with pytest.raises(ValueError, match="must be one unit, or one for each"):
        rs.ForcedVibration(t, u[:, 0], u, inputs=names, input_unit=("N",))
