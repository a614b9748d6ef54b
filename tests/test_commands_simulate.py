"""The command writes what a simulation gives, also when it is cut short."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

from romsindy.beam import Beam, transient
from romsindy.commands.main import main
from romsindy.record.files import load_decay

SMALL = "--elements 10 --duration 0.05 --tip-displacement 0.05 --release-mode 1".split()


def invoke(*arguments):
    return CliRunner().invoke(main, ["simulate", *SMALL, *map(str, arguments)])


def load(path) -> dict[str, np.ndarray]:
    with np.load(path) as content:
        return dict(content)


@pytest.fixture(scope="module")
def motion():
    beam = Beam.cantilever(elements=10)
    sensors = beam.sensors([0.2, 0.45])
    return beam.simulate(beam.release_shape(0.05, mode=1), 0.05, sensors=sensors, progress=False)


def test_npz(tmp_path, motion):
    path = tmp_path / "decay.npz"
    result = invoke(path, "--sensor", 0.2, "--sensor", 0.45, "--mode", 2)
    assert result.exit_code == 0, result.output
    assert "energy drift" in result.output
    data = load(path)
    assert_allclose(data["q"], motion.coordinates.displacement[:, 1], atol=1e-12)
    assert_allclose(data["sensors"], motion.sensors.displacement, atol=1e-12)
    assert list(data["sensor_labels"]) == ["y(0.2)", "x(0.2)", "y(0.45)", "x(0.45)"]
    assert str(data["stop_reason"]) == "completed"


def test_csv(tmp_path, motion):
    path = tmp_path / "decay.csv"
    result = invoke(path, "--sensor", 0.45, "--quiet")
    assert result.exit_code == 0 and result.output == ""
    header = path.read_text().splitlines()[0]
    assert header == (
        "t [s],q [kg^0.5 m],q_dot [kg^0.5 m/s],q_ddot [kg^0.5 m/s^2],y(0.45) [m],x(0.45) [m]"
    )
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    assert table.shape == (51, 6)
    assert_allclose(table[:, 3], motion.coordinates.acceleration[:, 0], rtol=1e-9)  # 12 digits


@pytest.mark.parametrize("name", ["decay.csv", "decay.npz"])
def test_the_file_is_a_decay_for_the_rest_of_the_project(tmp_path, motion, name):
    assert invoke(tmp_path / name, "--quiet").exit_code == 0
    decay = load_decay(tmp_path / name)
    own = motion.basis.project(motion)
    assert decay.unit == own.unit
    assert_allclose(decay.q_ddot, own.q_ddot, rtol=1e-9)  # 12 digits in the text


def test_undamped(tmp_path):
    path = tmp_path / "free.npz"
    assert invoke(path, "--undamped", "--full", "--quiet").exit_code == 0
    energy = load(path)["energy"]
    assert_allclose(energy, energy[0], rtol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["decay.txt"], "name a .csv or an .npz file"),
        (["nowhere/decay.csv"], "there is no folder nowhere"),
        (["."], ". is a folder: name a file"),
        (["decay.csv", "--snr", "40"], "place them with --sensor"),
        (["decay.csv", "--full"], "--full needs room for arrays: name an .npz file"),
        (["decay.csv", "--seed", "-1"], "-1 is not in the range x>=0"),
        (["decay.csv", "--length", "-1"], "length must be positive"),
        (["decay.csv", "--sensor", "2"], "off the beam"),
        (["decay.csv", "--spring-length", "0", "--spring-pretension", "0"], "move the anchor"),
        (["decay.csv", "--tip-displacement", "2"], "beyond the reach"),
        (["decay.csv", "--mode", "0"], "mode = 0"),
    ],
)
def test_bad_input_is_one_line(arguments, message):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert message in result.stderr and result.stderr.count("\n") == 1


def test_interrupted_run_is_written(tmp_path, monkeypatch):
    def interrupt(self, t, sample):
        raise KeyboardInterrupt

    monkeypatch.setattr(transient.Stepper, "advance", interrupt)
    path = tmp_path / "part.npz"
    result = invoke(path)
    assert result.exit_code == 130
    assert str(load(path)["stop_reason"]).startswith("interrupted")


def test_failed_run_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(transient.Stepper, "advance", lambda self, t, sample: t < 0.0095)
    path = tmp_path / "part.csv"
    result = invoke(path)
    assert result.exit_code == 2 and "try step" in result.output
    assert len(np.loadtxt(path, delimiter=",", skiprows=1)) == 11


def test_help_names_the_options():
    assert "--release-mode" in CliRunner().invoke(main, ["simulate", "--help"]).output


def without_numba(folder, *words):
    """Run a command in a new interpreter that finds no numba."""
    code = (
        "import sys; sys.modules['numba'] = None;"
        f" from romsindy.commands.main import main; main({[*map(str, words)]!r})"
    )
    return subprocess.run(
        [sys.executable, "-c", code], cwd=folder, check=True, capture_output=True, text=True
    )


def test_without_numba_a_beam_is_the_same(tmp_path):
    """Compiled or interpreted, the loops do the same sums: alike to rounding."""
    words = ["--elements", 2, "--duration", 0.01]
    done = CliRunner().invoke(main, ["simulate", str(tmp_path / "a.csv"), *map(str, words)])
    assert done.exit_code == 0, done.output
    without_numba(tmp_path, "simulate", "b.csv", *words)
    a, b = (load_decay(tmp_path / name) for name in ("a.csv", "b.csv"))
    assert_allclose(a.q, b.q, rtol=1e-6, atol=1e-9)


@pytest.mark.study
@pytest.mark.slow
def test_without_numba_records_are_read_identified_and_diagnosed(tmp_path):
    t = np.arange(0, 6, 1 / 150)
    q = 0.02 * np.exp(-0.3 * t) * np.cos(40 * t) + 1e-5 * np.random.default_rng(0).normal(size=900)
    np.savetxt(
        tmp_path / "a.csv", np.column_stack([t, q]), delimiter=",", header="t,x [m]", comments=""
    )
    assert "mode 1" in without_numba(tmp_path, "inspect", "a.csv").stdout
    found = without_numba(tmp_path, "identify", "a.csv", "--model", "m.json").stdout
    assert "explains the data" in found
    said = without_numba(tmp_path, "diagnose", "--measured", "a.csv", "--model", "m.json").stdout
    assert said.startswith("none")
