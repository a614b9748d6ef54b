"""`romsindy identify --coordinates`: two oscillators at 1 : 2, integrated by scipy."""

import base64
import json
import re

import click
import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.commands import measurement
from romsindy.commands.identify import identify
from romsindy.commands.main import main
from romsindy.commands.measurement import inspected
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.physics.coupled import CoupledModel

TRUTH = {
    "omega^2 [q1]": 3950.0, "c_linear [q1]": 0.6, "omega^2 [q2]": 16900.0, "c_linear [q2]": 1.0,
    "V q1^2 q2": 500.0, "gamma_3 [q1]": 900.0,
}  # fmt: skip
SHAPES = np.array([[1.0, 0.4], [0.5, 1.0]])
T = np.arange(0.0, 6.0, 1 / 300)
COLUMNS = ["--column", "left", "--column", "right"]


def motion(start):
    """q1 and q2, (n, 2), and their velocities."""

    def rates(_, s):
        q1, q2, v1, v2 = s
        first = 3950.0 * q1 + 0.6 * v1 + 1000.0 * q1 * q2 + 900.0 * q1**3
        return [v1, v2, -first, -(16900.0 * q2 + 1.0 * v2 + 500.0 * q1**2)]

    state = [*start, 0.0, 0.0]
    done = solve_ivp(rates, (0, 6), state, "DOP853", T, rtol=1e-10, atol=1e-12)
    return done.y[:2].T, done.y[2:].T


def write(path, start, seed, offset=0.0, header="t,left [m],right [m]", rate=False):
    """What two sensors see, at 40 dB."""
    x = motion(start)[int(rate)] @ SHAPES.T
    noise = 0.01 * x.std(axis=0) * np.random.default_rng(seed).standard_normal(x.shape)
    table = np.column_stack([T, x + noise + [0.0, offset]])
    np.savetxt(path, table, delimiter=",", header=header, comments="")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("decays")
    write(path / "hammer.csv", (0.8, 0.4), 1, offset=0.3)
    write(path / "again.csv", (0.4, 0.6), 2)
    return path


@pytest.mark.slow
def test_an_angle_beside_a_length(folder, tmp_path):
    """The second sensor turns, by 20 m: told in degrees it gives the same model at that lever."""
    x = np.genfromtxt(folder / "hammer.csv", delimiter=",", skip_header=1)
    turned = x * [1.0, 1.0, 180 / np.pi / 20]
    header = "t,left [m],right [deg]"
    np.savetxt(tmp_path / "a.csv", turned, delimiter=",", header=header, comments="")
    models = []
    for path, more in ((folder / "hammer.csv", []), (tmp_path / "a.csv", ["--lever", "20"])):
        save = tmp_path / f"{path.stem}.json"
        asked = ["--coordinates", "2", *COLUMNS, *more, "--save", str(save)]
        page = str(tmp_path / f"{path.stem}.html")
        done = CliRunner().invoke(main, ["identify", str(path), *asked, "--report", page])
        assert done.exit_code == 0, done.output
        models.append(rs.Estimate.from_json(save.read_text()).model.coefficients)
    assert "Angles are lengths at a lever arm of 20 m." in done.output
    assert models[0].keys() == models[1].keys()
    for name, value in models[0].items():  # the file has 18 digits, the search none to lose
        assert models[1][name] == pytest.approx(value, rel=1e-6), name


@pytest.fixture(scope="module")
def identified(folder):
    """What the command printed, and its list of results."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        files = ["--json", "out.json", "--model", "model.json", "--save", "fit.json"]
        options = [*COLUMNS, "--coordinates", "auto", *files, "--figure", "backbone.png", "--full"]
        result = CliRunner().invoke(main, ["identify", "hammer.csv", *options])
    assert result.exit_code == 0, result.output
    return result.output, json.loads((folder / "out.json").read_text())


def test_two_coordinates_are_found_with_their_errors(identified):
    printed, (result,) = identified
    assert result["coordinates"] == 2 and result["explained"]
    assert {*result["coefficients"]} == {*TRUTH}
    for name, value in TRUTH.items():
        found = result["coefficients"][name]
        assert abs(found["value"] - value) < 4 * found["standard_error"], name
        row = re.search(rf"^  {re.escape(name)} +(\S+) \+- (\S+) ", printed, re.M)
        # As printed: six digits.
        assert abs(float(row[1]) - value) < 4 * float(row[2]) + 1e-5 * value, name
    shapes = [result["mode_shapes"][name] for name in ("left", "right")]
    # One channel of 1800 samples at 40 dB: 0.01 sqrt(2 / 1800) of the weaker coordinate, and less.
    np.testing.assert_allclose(shapes, SHAPES, atol=5e-3)


def test_modes_are_those_of_small_vibrations(identified):
    """omega^2 and c of uncoupled small motions: sqrt(omega^2) / 2 pi, and c / (2 omega)."""
    _, (result,) = identified
    for mode, omega_squared, c in zip(result["modes"], (3950, 16900), (0.6, 1.0), strict=True):
        omega = np.sqrt(omega_squared)
        assert abs(mode["frequency"] - omega / (2 * np.pi)) < 4 * mode["frequency_std"]
        assert abs(mode["damping_ratio"] - c / (2 * omega)) < 4 * mode["damping_ratio_std"]
        assert mode["backbone"]["frequency"][0] == pytest.approx(mode["frequency"], rel=1e-3)


def test_what_is_printed_and_written(identified, folder):
    printed, (result,) = identified
    assert "Used: channels left and right, release 1, with all that rings: 10." in printed
    assert "2 channels" in printed and "The model explains the data to their noise" in printed
    assert re.search(r"^  mode +frequency \[Hz\]", printed, re.M)
    rows = re.findall(r"^  (?:left|right) +(\S+) +(\S+)$", printed, re.M)
    np.testing.assert_allclose(np.array(rows, float), SHAPES, atol=5e-3)
    page = (folder / result["report"]).read_text(encoding="utf-8")
    drawn = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert len(drawn) == 6  # backbones, stiffness, two channels, what is left, the record
    assert all(base64.b64decode(p).startswith(b"\x89PNG") for p in drawn)
    for words in ("Over time: left", "Over time: right", "V q1^2 q2", "Mode shapes", "q2_ddot"):
        assert words in page
    assert (folder / "backbone.png").read_bytes().startswith(b"\x89PNG")
    model = CoupledModel.from_json((folder / "model.json").read_text())
    saved = rs.Estimate.load(folder / "fit.json")
    assert saved.model == model and str(saved) in printed
    assert model.coefficients == {n: c["value"] for n, c in result["coefficients"].items()}


def test_the_errors_of_modes_are_those_of_their_coefficients(identified, folder):
    """d sqrt(x) = dx / (2 sqrt(x)), where small vibrations are uncoupled."""
    del identified  # which saved the file
    saved = rs.Estimate.load(folder / "fit.json")
    read = saved.errors_of(lambda model: model.linear_modes[0])
    omega = np.sqrt([saved.model.coefficients[f"omega^2 [q{i}]"] for i in (1, 2)])
    errors = [saved.standard_errors[f"omega^2 [q{i}]"] for i in (1, 2)]
    np.testing.assert_allclose(read, errors / (2 * omega), rtol=1e-4)


def test_damping_ratios_of_modes_are_those_of_the_eigenvalues():
    """Masses that differ and damping that couples, against the matrix of states."""
    model = CoupledModel.from_coefficients(
        {"omega^2 [q1]": 40.0, "omega^2 [q2]": 500.0, "mu [q2]": 1.5, "c_linear [q1]": 0.02}
        | {"c_linear [q2]": 0.05, "C_12": 0.01, "gamma_3 [q1]": 3.0}
    )
    mass, damping = np.diag([1.0, 2.5]), np.array([[0.02, 0.01], [0.01, 0.05]])
    upper = np.hstack([np.zeros((2, 2)), np.eye(2)])
    lower = -np.linalg.solve(mass, np.hstack([np.diag([40.0, 500.0]), damping]))
    values = np.linalg.eigvals(np.vstack([upper, lower]))
    values = sorted(values[values.imag > 0], key=np.imag)
    exact = [-value.real / abs(value) for value in values]
    # Of the second order in the damping ratio.
    np.testing.assert_allclose(model.linear_damping_ratios, exact, rtol=1e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--mode", "1"], "--mode is for one coordinate: leave it out beside --coordinates"),
        (["--band", "5", "15"], "--band is for one coordinate"),
        (["--order", "5"], "--order is for records with inputs"),
        (["--damping", "linear"], "--damping is for records with inputs"),
        (["--fix", "omega^2=36"], "hammer.csv: fixed names ['omega^2'], but"),
        (["--curvature", "0.1"], "hammer.csv: curvature = 0.1 must be left out for several"),
        (["--coordinates", "x"], "'x' is neither auto nor a whole number of at least 1"),
        (["--coordinates", "0"], "'0' is neither auto nor a whole number of at least 1"),
        (["--coordinates", "7"], "hammer.csv: --coordinates 7: "),
        (["--release", "3"], "hammer.csv: release = 3 is none of the releases, 1 to 1"),
    ],
)  # fmt: skip
def test_what_does_not_go_together(run, options, message):
    result = run("identify", "hammer.csv", *COLUMNS, "--coordinates", 2, *options)
    assert result.exit_code == 2
    assert message in result.stderr and len(result.stderr.splitlines()) == 1


def test_all_columns_are_taken_together_where_none_is_named(folder):
    """Of one coordinate it must be said which: any of them could be meant."""
    reading = dict.fromkeys(["unit", "quantity", "column", "lever", "time", "rate", "start", "end"])
    _, found = inspected(folder / "hammer.csv", reading, 0, together=True)
    assert [*found.together] == ["left", "right"]
    with pytest.raises(ValueError, match="choose with column="):
        inspected(folder / "hammer.csv", reading, 0)


def test_one_coordinate_is_the_command_as_it_is():
    """Said or not said, the option gives the command the same."""
    (option,) = (p for p in identify.params if p.name == "coordinates")
    with click.Context(identify) as context:
        said = [option.process_value(context, value) for value in ("1", None)]
    assert said == [None, None]


@pytest.mark.slow
def test_known_coefficients_stay_as_they_are(run, folder):
    """The others stay within four standard errors of the truth."""
    known = ["--fix", "omega^2 [q1]=3950", "--fix", "c_linear [q2] = 1.0"]
    result = run("identify", "hammer.csv", *COLUMNS, "--coordinates", 2, *known, "--json", "-")
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)[0]["coefficients"]
    for name, value in (("omega^2 [q1]", 3950.0), ("c_linear [q2]", 1.0)):
        assert found[name]["value"] == value and found[name]["standard_error"] is None
    free = found["omega^2 [q2]"]
    assert abs(free["value"] - 16900.0) < 4 * free["standard_error"]


def test_a_motion_that_is_not_found_is_refused_with_a_remedy(run, monkeypatch):
    def refuse(*_, **__):
        raise TrajectoryError("no motion of the model is near the measured one")

    monkeypatch.setattr(measurement, "identify", refuse)
    result = run("identify", "hammer.csv", *COLUMNS, "--coordinates", 2)
    assert result.exit_code == 2
    assert "hammer.csv: --coordinates 2: no motion of the model" in result.stderr
    assert "fewer coordinates, more channels (--column) or another --release" in result.stderr


@pytest.mark.slow
def test_several_files_and_an_interrupt_that_keeps_what_is_done(run, folder, monkeypatch):
    found, identify = [], measurement.identify

    def once(*arguments, **options):
        if found:
            raise KeyboardInterrupt
        found.append(identify(*arguments, **options))
        return found[0]

    monkeypatch.setattr(measurement, "identify", once)
    result = run("identify", "again.csv", "hammer.csv", *COLUMNS, "--coordinates", 2)
    assert result.exit_code == 130
    rows = re.findall(r"^again.csv +(\d) +(\S+) .*2 coordinates +yes", result.output, re.M)
    assert [(number, round(float(hz), 1)) for number, hz in rows] == [("1", 10.0), ("2", 20.7)]
    assert "Identified: 1 files, 1 of them explained" in result.output
    overview = (folder / "identify_overview.html").read_text(encoding="utf-8")
    assert 'href="again_report.html"' in overview and (folder / "again_report.html").is_file()


def test_whole_decays_hold_every_channel_as_measured(tmp_path):
    """A velocity comes with its displacement."""
    write(tmp_path / "v.csv", (0.8, 0.4), 3, header="t,left [m/s],right [m/s]", rate=True)
    found = rs.inspect(tmp_path / "v.csv", column=["left", "right"])
    (decay,) = found.whole_decays()
    seen = motion((0.8, 0.4))
    assert decay.n_channels == 2 and decay.measured == "velocity" and decay.stage == "free"
    inside = np.searchsorted(T, decay.t - 1e-9)
    for name, exact in (("q_dot", seen[1] @ SHAPES.T), ("q", seen[0] @ SHAPES.T)):
        x, exact = getattr(decay, name), exact[inside]
        # A velocity knows no mean, and q2 is pushed aside by q1^2 at the start.
        off = (x - exact).std(axis=0) / exact.std(axis=0)
        assert np.all(off < 0.02 if name == "q_dot" else off < 0.1)
    with pytest.raises(ValueError, match="release = 2 is none of the releases, 1 to 1"):
        found.whole_decays(release=2)


def ringing(t, *frequencies):
    """Vibrations in closed form, as one sensor sees them, with noise."""
    waves = [np.exp(-0.3 * t) * np.cos(2 * np.pi * f * t) for f in frequencies]
    return sum(waves), 1e-3 * np.random.default_rng(len(frequencies)).standard_normal(len(t))


def test_releases_in_which_enough_modes_ring():
    """Two modes ring in the first, one in the second."""
    t = np.arange(0.0, 6.0, 1 / 500)
    x = np.concatenate([sum(ringing(t, 7.0, 16.0)), sum(ringing(t, 7.0))])
    found = rs.inspect(rs.Recording(np.concatenate([t, t + 7.0]), x, unit="m"))
    assert len(found.releases) == 2
    assert found.rings_together() == found.rings_together(modes=2) == [0]
    assert found.rings_together(modes=1) == [0, 1] and found.rings_together(release=2) == [1]
    (second,) = found.whole_decays(release=2)
    assert second.t[0] == pytest.approx(7.0, abs=0.2)


def test_many_samples_a_cycle_are_decimated():
    t = np.arange(0.0, 6.0, 1 / 5000)
    exact, noise = ringing(t, 7.0, 16.0)
    (decay,) = rs.inspect(rs.Recording(t, exact + noise, unit="m")).whole_decays()
    assert 15 <= 1 / (decay.dt * 16.0) <= 40
    # Less of the noise is left than there was; at the ends nothing is spoiled.
    off = np.abs(decay.q - np.interp(decay.t, t, exact))
    assert off.max() < 4e-3 and off.std() < 1e-3


@pytest.mark.slow
def test_an_interrupt_within_a_file_keeps_what_was_found(run, folder, monkeypatch):
    """Ctrl-C in the second round of terms: a page, a note, and the exit code of an interrupt."""
    whole, rounds = measurement.identify, []

    def interrupted(decays, coordinates, progress, **options):
        def stop(line):
            rounds.append(line)
            if sum(text.startswith("terms") for text in rounds) == 2:
                raise KeyboardInterrupt

        return whole(decays, coordinates, progress=stop, **options)

    monkeypatch.setattr(measurement, "identify", interrupted)
    result = run(
        "identify", "hammer.csv", *COLUMNS, "--coordinates", 2, "--report", "part.html", "--full"
    )
    assert result.exit_code == 130
    assert "interrupted: the best of what had been tried" in result.output
    assert "interrupted" in (folder / "part.html").read_text(encoding="utf-8")
