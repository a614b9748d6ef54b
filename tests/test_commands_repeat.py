"""The command ``romsindy repeat``, and what a diagnosis makes of it."""

import json

import numpy as np
import pytest

MODEL = {"coefficients": {"omega^2": 1600.0, "c_linear": 0.4}, "unit": "m"}


def write(path, omega, damping, seed):
    """A linear decay in closed form: 50 cycles, 60 dB."""
    t = np.arange(0, 8, 1 / 150)
    x = 0.02 * np.exp(-damping / 2 * t) * np.cos(np.sqrt(omega**2 - damping**2 / 4) * t)
    x += 1e-5 * np.random.default_rng(seed).normal(size=len(t))
    table = np.column_stack([t, x])
    np.savetxt(path, table, delimiter=",", header="t [s],x [m]", comments="", fmt="%.9f")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Runs whose frequency differs by 0.3 % at most, and whose damping by 12 %."""
    folder = tmp_path_factory.mktemp("repeat")
    for i in range(3):
        write(folder / f"run{i}.csv", 40 * (1 + 1.5e-3 * i), 0.4 * (1 + 0.06 * i), i)
    (folder / "model.json").write_text(json.dumps(MODEL))
    return folder


RUNS = ["run0.csv", "run1.csv", "run2.csv"]


def test_what_runs_differ_by_is_what_was_put_in(run, folder):
    result = run("repeat", *RUNS, "--save", "repeat.json")
    assert result.exit_code == 0 and len(result.output.splitlines()) <= 12, result.output
    assert "Least alike: run0.csv and run2.csv." in result.output
    content = json.loads((folder / "repeat.json").read_text())
    pair = next(p for p in content["pairs"] if p["runs"] == ["run0.csv", "run2.csv"])
    # 60 dB over 50 cycles: frequency to some 1e-6, damping to half a per cent.
    assert abs(pair["frequency"]) == pytest.approx(3e-3, rel=0.02)
    assert abs(pair["damping"]) == pytest.approx(1 - 1.003 / 1.12, abs=0.01)
    # What is tolerated: the largest that is surely there, with its error.
    assert 3e-3 < content["tolerance"]["frequency"] < 3.2e-3
    assert content["tolerance"]["source"] == "repeats"
    page = (folder / "run0_repeat.html").read_text()
    assert page.count("data:image/png") == 1 and "run0.csv, run2.csv" in page


@pytest.mark.study
@pytest.mark.slow
def test_a_diagnosis_takes_it_in_the_place_of_the_runs(run):
    """The run that differs most from the model is within what runs differ by."""
    run("repeat", *RUNS, "--save", "repeat.json")
    asked = ["diagnose", "--measured", "run2.csv", "--model", "model.json"]
    kept = run(*asked, "--repeats", "repeat.json").output
    records = run(*asked, *(word for name in RUNS for word in ("--repeats", name))).output
    assert kept == records and kept.startswith("none") and "repeat runs differ by" in kept
    assert not run(*asked).output.startswith("none")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["repeat", "run0.csv"], "give two or more of the same test"),
        (["repeat", "run0.csv", "run0.csv"], "give two or more of the same test"),
        (["diagnose", "--repeats", "model.json"], "has no 'tolerance'"),
        (
            ["diagnose", "--repeats", "repeat.json", "--tolerance", "0.01"],
            "leave out any other",
        ),
        (["diagnose", "--repeats", "repeat.json", "--repeats", "run0.csv"], "leave out any other"),
    ],
)
def test_what_is_no_repeat_is_refused(run, folder, words, message):
    if "repeat.json" in words and not (folder / "repeat.json").exists():
        run("repeat", *RUNS, "--save", "repeat.json")
    more = ["--measured", "run2.csv", "--model", "model.json"] if words[0] == "diagnose" else []
    result = run(*words, *more)
    assert result.exit_code == 2 and message in result.output
