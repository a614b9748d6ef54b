"""`romsindy example`: files that the README and docs use, and what they are to show."""

import numpy as np
import pytest
from click.testing import CliRunner

from romsindy import ReducedModel, diagnose, extract_backbone, load_decay
from romsindy.beam import load_beam
from romsindy.commands import example as example_module
from romsindy.commands.main import main

FILES = ["decay.csv", "run1.csv", "run2.csv", "model.json", "sim.csv"]
FILES += ["test.csv", "held_out.csv", "shaker.csv", "shaker.json", "stepped.csv"]
BEAM_FILES = ["beam.toml", "beam_test.csv"]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The folder, and what was printed."""
    folder = tmp_path_factory.mktemp("made") / "a folder"
    result = CliRunner().invoke(main, ["example", str(folder)])
    assert result.exit_code == 0, result.output
    return folder, result.output


def assert_told(folder, printed, files):
    """Every file is there and in the list, and what comes next uses no other."""
    assert sorted(p.name for p in folder.iterdir()) == sorted(files)
    for name in files:
        assert printed.count(f"{name} ") >= 1
    assert f"cd '{folder}'" in printed  # to be pasted, with its space
    used = {word for line in printed.partition("Next:")[2].splitlines() for word in line.split()}
    assert {w for w in used if "." in w and "/" not in w} <= {*files}


def test_every_file_is_written_and_told(written):
    assert_told(*written, FILES)


def test_records_are_those_of_the_equations(written):
    """Frequency of the cycles against that of the equation, which damping does not change."""
    folder, _ = written
    truths = {"decay.csv": example_module.STRIP, "test.csv": example_module.SIMULATION}
    for name, truth in truths.items():
        decay = load_decay(folder / name)
        assert decay.unit == "m" and decay.measured == "displacement"
        backbone = extract_backbone(decay.free())
        off = backbone.frequency / truth.backbone(backbone.amplitude) - 1
        # At 35 dB the median is 1.5e-4 at worst (benchmarks/identification.py); here it is 40 dB.
        assert np.median(np.abs(off)) < 3e-4
    simulated = load_decay(folder / "sim.csv")
    model = ReducedModel.from_json((folder / "model.json").read_text())
    again = model.simulate(0.08, 0.0, simulated.t)
    assert simulated.q == pytest.approx(again.q, abs=1e-9)  # nine digits are written


@pytest.mark.slow
def test_what_is_hidden_is_named(written):
    folder, _ = written
    model = ReducedModel.from_json((folder / "model.json").read_text())
    test, held_out = (load_decay(folder / name) for name in ("test.csv", "held_out.csv"))
    report = diagnose(model, [test], held_out=held_out)
    assert report.verdict == "named"
    (drag,) = report.effects
    assert drag.name == "quadratic_drag"
    # Its true strength, within four standard errors.
    error = drag.standard_errors["strength"]
    assert abs(drag.values["strength"] - example_module.DRAG) < 4 * error


def test_the_beam_and_its_sensors_belong_together(tmp_path):
    folder = tmp_path / "a beam"
    result = CliRunner().invoke(main, ["example", str(folder), "--beam"])
    assert_told(folder, result.output, BEAM_FILES)
    beam, sensors, columns = load_beam(folder / "beam.toml")
    measured = load_decay(folder / "beam_test.csv", column=columns)
    assert measured.q.shape[1] == len(sensors.sensors)
    # The release is a third of the length at the tip; noise is a hundredth of the rms.
    assert measured.q[0, -1] == pytest.approx(beam.length / 3, rel=0.02)


@pytest.mark.slow
def test_nothing_is_overwritten_unasked(tmp_path):
    """Refused before anything is written; files of other names stay in any case."""
    (tmp_path / "decay.csv").write_text("mine")
    (tmp_path / "other.csv").write_text("mine, too")
    run = CliRunner().invoke
    refused = run(main, ["example", str(tmp_path)])
    assert refused.exit_code == 2 and "already has decay.csv" in refused.output
    assert "--overwrite" in refused.output and not (tmp_path / "run1.csv").exists()
    assert (tmp_path / "decay.csv").read_text() == "mine"
    assert run(main, ["example", str(tmp_path), "--overwrite"]).exit_code == 0
    assert load_decay(tmp_path / "decay.csv").unit == "m"
    assert (tmp_path / "other.csv").read_text() == "mine, too"


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("")
    for name in ("file", "file/inside"):
        refused = CliRunner().invoke(main, ["example", str(tmp_path / name)])
        assert refused.exit_code == 2 and refused.output.startswith("Error: ")
        assert len(refused.output.splitlines()) == 1
