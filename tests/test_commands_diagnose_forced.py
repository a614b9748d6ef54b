"""`romsindy diagnose --input`: what a simulation lacks, from files with their inputs."""

import json
from functools import partial

import numpy as np
import pytest
from test_commands_forced import DT, GAIN, TRUTH, multisine, response, write

import romsindy as rs

PART = ["--input", "force", "--end", 5]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two records, and simulations that have the force, the gain of another, or the base."""
    path = tmp_path_factory.mktemp("driven")
    for seed, name in ((1, "first.csv"), (3, "second.csv")):
        force = multisine(seed)
        q = response(lambda t, f=force: GAIN * f(t), seed + 1)
        write(path / name, displacement__mm=1e3 * q, force__kN=1e-3 * force(DT * np.arange(len(q))))
    for name, key in (("model", "gain [force]"), ("base", "Gamma [base]")):
        model = rs.ReducedModel.from_coefficients({**TRUTH, key: GAIN}, "m")
        (path / f"{name}.json").write_text(model.to_json())
    weak = rs.ReducedModel.from_coefficients({**TRUTH, "gain [force]": 0.9 * GAIN}, "m")
    (path / "weak.json").write_text(weak.to_json())
    (path / "beam.toml").write_text("")
    return path


@pytest.fixture
def run(run):
    return partial(run, "diagnose")


@pytest.mark.slow
def test_a_wrong_gain_is_named(run, folder):
    """From two files in mm and kN; the strength is what the gain lacks, within four errors."""
    files = ["--report", "page.html", "--json", "out.json", "--csv", "out.csv"]
    both = ["--measured", "first.csv", "--measured", "second.csv", "--model", "weak.json"]
    result = run(*both, *PART, *files, "--free", "nothing", "--floor", 1e-3, "--full")
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0] == "named" and lines[1].startswith("They differ: the simulation leaves ")
    assert lines[2].startswith("Missing: another gain of the input than assumed [gain [force]], ")
    assert any(line.startswith("rms left, % of the response") for line in lines)
    assert lines[-1] == "Report: page.html"
    found = json.loads((folder / "out.json").read_text())
    (gain,) = found["effects"]
    assert abs(gain["values"]["strength"] - 0.1 * GAIN) < 4 * gain["standard_errors"]["strength"]
    assert found["model"]["terms"][-1]["name"] == "gain [force]"
    page = (folder / "page.html").read_text(encoding="utf-8")
    assert "The records and what is missed" in page
    assert "input_gain,gain [force],strength," in (folder / "out.csv").read_text(encoding="utf-8")


@pytest.mark.slow
def test_held_out_tolerance_and_repeats(run):
    """A gain that is 10 % low: beyond the tolerance of the frequency, and on the other file too."""
    given = ["--measured", "first.csv", "--model", "weak.json", "--floor", 1e-3]
    more = ["--held-out", "second.csv", "--tolerance", "0.002", "--free", "nothing"]
    result = run(*given, *PART, *more, "--full")
    assert result.exit_code == 0 and result.stdout.startswith("named"), result.output
    assert "on the record that took no part (tolerance: 0.2 %, 5 % and 1 %)." in result.stdout
    assert "Missing: another gain of the input than assumed" in result.stdout
    assert "on the record that took no part before after" in " ".join(result.stdout.split())
    alone = run(*given, *PART, "--repeats", "first.csv")
    assert alone.exit_code == 2 and "--repeats holds 1 record: give two or more" in alone.stderr


@pytest.mark.parametrize(
    ("option", "value", "remedy"),
    [
        ("simulated", "first.csv", "give the equation, --model"),
        ("beam", "beam.toml", "in Python, beam.reduce(...) makes a model"),
        ("reference", "second.csv", "--repeats, is asked instead"),
        ("mode", 1, "cut it with --start and --end"),
        ("release", 1, "cut it with --start and --end"),
        ("whole", None, "the whole record is taken"),
    ],
)
def test_options_of_decays_are_refused(run, option, value, remedy):
    words = [f"--{option}", *([] if value is None else [value])]
    result = run("--measured", "first.csv", "--input", "force", "--model", "model.json", *words)
    assert result.exit_code == 2 and len(result.stderr.splitlines()) == 1
    assert f"--{option} is for free decays: leave it out beside --input" in result.stderr
    assert remedy in result.stderr and "), or leave out --input" in result.stderr


def test_a_driven_model_and_no_input_is_told(run):
    """The record is no decay, whatever is said of it as one."""
    result = run("--measured", "first.csv", "--model", "model.json", "--end", 0.1)
    assert result.exit_code == 2
    note, refusal = result.stderr.splitlines()
    assert note.startswith("Note: the model has 'gain [force]', and records are taken for free")
    assert note.endswith("say --input force") and refusal.startswith("Error: ")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--input-column", "force"], "--input-column is for records with inputs: say --input"),
        (["--unit-input", "N"], "--unit-input is for records with inputs: say --input force or"),
        (["--interpolation", "hold"], "--interpolation is for records with inputs"),
        (["--input", "base"], "first.csv: which column is the input 'base' is not clear among"),
        (["--input", "force", "--model", "base.json"], "driven by 'base', and first.csv has"),
        (["--input", "force", "--unit-input", "mm"], "--unit-input mm is no unit of a force"),
        (["--input", "force", "--tolerances", "c_cubic=0.1"], "--tolerances name 'c_cubic', but"),
    ],
)
def test_what_cannot_be(run, words, message):
    given = words if "--model" in words else [*words, "--model", "model.json"]
    result = run("--measured", "first.csv", *given)
    assert result.exit_code == 2 and len(result.stderr.splitlines()) == 1
    assert message in result.stderr
