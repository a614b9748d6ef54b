import base64
import importlib
import json
import platform
import re
import signal
import subprocess
import sys
import time

import click
import numpy as np
import pytest
from click.testing import CliRunner
from sklearn.linear_model import LinearRegression

from romsindy import (
    HarmonicProjection,
    HarmonicSINDy,
    Identification,
    ReducedModel,
    ROMLibrary,
    __version__,
    example_decay,
    extract_backbone,
    inspect,
    save_decay,
)
from romsindy.commands import main as main_module
from romsindy.commands import measurement
from romsindy.commands.identify import EXCLUDED
from romsindy.commands.main import main
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.physics.example import EXAMPLE_MODEL


def test_example_is_identified_beside_plain_regressions(run, tmp_path):
    result = run("identify", "--example", "--model", "model.json", "--save", "found.json",
                 "--figure", "backbone.png", "--full")  # fmt: skip
    assert result.exit_code == 0, result.output
    assert result.output.count("\nIC-ROM, ") == 1 and "IC-ROM, omega" not in result.output
    assert "inertia is determined" in result.output
    errors = re.findall(r"model misses the measured frequency by ([\d.]+) % rms", result.output)
    assert len(errors) == 3  # identified, plain IC-ROM, plain stiffness
    assert float(errors[0]) < 0.2 < float(errors[2])
    # Cycles that are lost in the noise judge no model, and no sentence counts them.
    certain = extract_backbone(example_decay(35.0, 0).free()).certain
    assert f"Over {np.count_nonzero(certain)} cycles" in result.output
    left_out = "whose own frequency is not known to 1 % are left out" in result.output
    assert left_out == (not certain.all())
    header = "coefficient +unit +identified +plain IC-ROM +plain stiffness\n"
    row = re.search(rf"{header} *omega\^2 +1/s\^2 +([\d.]+) \+- ([\d.e-]+) ", result.output)
    assert abs(float(row[1]) - 36) < 4 * float(row[2])
    page = (tmp_path / "example_report.html").read_text(encoding="utf-8")
    drawn = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert len(drawn) == 9 and "http" not in page.replace("http-equiv", "")
    assert all(base64.b64decode(p).startswith(b"\x89PNG") for p in drawn)
    assert "gamma_3" in page and "Spectrum of what is left" in page and __version__ in page
    model = ReducedModel.from_json((tmp_path / "model.json").read_text())
    assert model.coefficients["omega^2"] == pytest.approx(36, rel=2e-3)
    # What was saved is what was printed, to the last digit.
    found = Identification.load(tmp_path / "found.json")
    assert found.model == model and str(found) in result.output
    assert (tmp_path / "backbone.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_answer_comes_first(run, tmp_path):
    """Twelve lines, then files: what was found, how sure, what is wrong with it, what next."""
    decay = example_decay(40.0, 3).between(0, 60)
    table = np.column_stack([decay.t, decay.q])
    np.savetxt(tmp_path / "decay.csv", table, delimiter=",", header="t,q [m]", comments="")
    lines = run("identify", "decay.csv", "--save", "found.json").output.splitlines()
    assert len(lines) <= 12 + 2 and lines[0].startswith("In short: q_ddot + 3")
    words = ["  omega^2 ", ". Frequency and damping ratio: ", "The model explains"]
    words += ["Next: ", "Report: decay_report.html", "Saved: "]
    at = [next(i for i, line in enumerate(lines) if word in line) for word in words]
    assert at == sorted(at)
    found = Identification.load(tmp_path / "found.json")
    assert f"In short: {found.short.model.equation()}" in lines


@pytest.mark.slow
def test_same_seed_same_numbers(run):
    first, second = (run("regress", "--example", "--seed", 4, "--plain").output for _ in range(2))
    assert first == second != run("regress", "--example", "--seed", 5, "--plain").output


@pytest.mark.slow
def test_plain_is_the_regression_of_the_paper(run, tmp_path):
    """As by hand: least squares on harmonics 0 to 5 of the terms as they stand."""
    result = run("regress", "--example", "--plain", "--model", "model.json", "--full")
    assert result.exit_code == 0 and "stiffness, omega fixed" in result.output
    assert "+-" not in result.output and "Regressions have no error bars" in result.output
    decays = inspect(example_decay(35.0, 0)).decays()
    recipe = HarmonicSINDy(
        ROMLibrary((3, 4, 5), (1, 2, 3, 4, 5)),
        LinearRegression(),
        HarmonicProjection((0, 1, 2, 3, 4, 5), form="strong"),
        weighted=False,
    )
    expected = recipe.fit(decays).model_
    plain = ReducedModel.from_json((tmp_path / "model.json").read_text())
    assert plain.coefficients == pytest.approx(expected.coefficients, rel=1e-9)
    run("regress", "--example", "--model", "weighted.json")
    weighted = ReducedModel.from_json((tmp_path / "weighted.json").read_text())
    expected = HarmonicSINDy(recipe.library).fit(decays).model_
    assert weighted.coefficients == pytest.approx(expected.coefficients, rel=1e-9)


def test_an_inertia_that_no_structure_has_is_marked(run, tmp_path):
    """A regression finds what there is, and the sentence says what is wrong with it."""
    truth = {"omega^2": 36.0, "gamma_3": 9.0, "Upsilon_3": -0.05, "c_linear": 0.06}
    model = ReducedModel.from_coefficients(truth, unit="m")
    save_decay(model.simulate(1.5, 0.0, np.arange(0, 60, 0.02)), tmp_path / "decay.npz")
    result = run("regress", "decay.npz", "--plain", "--order", 3)
    assert re.search(
        r"IC-ROM: its inertia h\(q\) is negative within the data, first at", result.output
    )
    assert "stiffness: its inertia" not in result.output


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["regress", "--plain", "--weighted"], "are two regressions: ask for one"),
        (["regress", "--save", "x.json"], "--save is no option here, but of romsindy identify"),
        (["identify", "--select"], "--select is for records with inputs: say --input"),
        (["identify", "--order", "3"], "--order is for records with inputs: say --input"),
        (["identify", "--plain"], "--plain is no option here, but of romsindy regress"),
        (["identify", "--weighted"], "--weighted is no option here, but of romsindy regress"),
        (["identify", "--harmonics", "0-3"], "is no option here, but of romsindy regress"),
        (["identify", "--amplitude", "0", "1"], "but of romsindy predict, romsindy regress and"),
        (["identify", "--cutoff", "9"], "--cutoff is no option here, but of romsindy regress"),
    ],
)
def test_options_that_do_not_go_together(run, options, message):
    result = run(*options, "--example")
    assert result.exit_code == 2 and message in result.stderr


def test_few_options_of_identify_exclude_each_other():
    """All of them stand in one table, and each is refused with what to do without it."""
    pairs = [(option, other) for option, _, others in EXCLUDED for other in others]
    assert len(pairs) <= 8 and len({*pairs}) == len(pairs)
    known = {o for p in main.get_command(None, "identify").params for o in p.opts}
    assert {f"--{name}" for pair in pairs for name in pair} <= known
    values = {"input": ["force"], "band": ["5", "9"], "example": [], "select": []}
    values |= {"damping": ["cubic"], "coordinates": ["2"]}
    for option, other in pairs:
        words = [w for name in (option, other) for w in (f"--{name}", *values.get(name, ["1"]))]
        force = ["--input", "force"] if option == "select" else []
        result = CliRunner().invoke(main, ["identify", "decay.csv", *words, *force])
        assert result.exit_code == 2 and f"leave it out beside --{option}" in result.stderr


def test_options_reach_the_identification(run, tmp_path, monkeypatch):
    """Known coefficients, the seed of the draws, and how straight the sensor is."""
    seen = []

    def refuse(decays, coordinates, **options):
        assert coordinates == 1
        seen.append((*decays, options))
        raise ValueError("seen")

    monkeypatch.setattr(measurement, "identify", refuse)
    save_decay(example_decay(40.0, 1), tmp_path / "decay.npz")
    result = run("identify", "decay.npz", "--fix", "omega^2=36", "--seed", 7,
                 "--curvature", 0.03)  # fmt: skip
    assert result.exit_code == 2 and "seen" in result.stderr
    ((_, options),) = seen
    assert options["fixed"] == {"omega^2": 36.0} and options["seed"] == 7
    assert options["curvature"] == 0.03


def test_amplitudes_choose_the_cycles_of_a_regression(run, tmp_path):
    save_decay(example_decay(40.0, 1), tmp_path / "decay.npz")
    run("regress", "decay.npz", "--amplitude", 0.5, 1.5, "--json", "all.json")
    (found,) = json.loads((tmp_path / "all.json").read_text())
    sizes = found["backbone"]["amplitude"]
    # A cycle to either side may be cut or kept: each is 4 % smaller than the one before.
    assert max(sizes) == pytest.approx(1.5, rel=0.05) and min(sizes) == pytest.approx(0.5, rel=0.1)


def test_file_with_options(run, tmp_path):
    decay = example_decay(40.0, 1)
    table = np.stack([decay.t, 1000 * decay.q], axis=1)
    np.savetxt(tmp_path / "decay.csv", table, delimiter=";", header="t;q", comments="")
    result = run("regress", "decay.csv", "--unit", "mm", "--order", 3, "--fix", "omega^2=36",
                 "--harmonics", "0,1,2,3,4", "--damping", "linear", "--damping", "quadratic",
                 "--report", "page.html", "--amplitude", 0.1, 1.5, "--cutoff", 8,
                 "--full")  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "36 (fixed)" in result.output and "c_quadratic" in result.output
    assert "Upsilon_4" not in result.output and "cutoff=8.0" in result.output
    assert (tmp_path / "page.html").is_file()


def test_one_cycle_is_too_little(run):
    """Cycles at 35 dB fall by 4 % each: less than three are within 5 %."""
    result = run("regress", "--example", "--amplitude", 1.0, 1.05)
    assert result.exit_code == 2 and "fewer than 3: those of the decay have" in result.stderr


def test_amplitudes_without_a_cycle(run):
    result = run("regress", "--example", "--amplitude", 100, 200)
    assert result.exit_code == 2 and "amplitude = (100.0, 200.0) holds no cycle" in result.stderr


@pytest.mark.slow
def test_measured_velocity(run, measured):
    result = run("regress", measured / "cc_beam_bristol.npz", "--unit", "m/s", "--cutoff", 300,
                 "--weighted", "--column", "mode1b_v", "--time", "mode1b_t", "--full")  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "measured velocity" in result.output
    # Another mode rings along near 400 Hz, and is told.
    line = next(x for x in result.output.splitlines() if x.startswith("Used: "))
    used, left_out = line.split("Left out: ")
    assert "mode 1" in used and "mode 2 at 40" in left_out


@pytest.mark.study
@pytest.mark.slow
def test_a_record_of_several_modes_is_identified_by_one(run, measured):
    """Run a of the clamped beam: its second mode rings along, and no longer spoils the first."""
    options = ["--column", "mode1a_v", "--time", "mode1a_t", "--unit", "m/s"]
    result = run("identify", measured / "cc_beam_bristol.npz", *options)
    assert result.exit_code == 0, result.output
    assert re.search(r"Used: mode 1 at 73.*Left out: .*mode \d at 40", result.output)
    assert "Frequency and damping" in result.output and "Regressions alone" not in result.output


@pytest.mark.slow
def test_where_no_motion_follows_the_regressions_are_left(run, monkeypatch):
    def refuse(*_, **__):
        raise TrajectoryError("no motion follows the record")

    monkeypatch.setattr(measurement, "identify", refuse)
    result = run("identify", "--example")
    assert result.exit_code == 0, result.output
    assert "Regressions alone, without functions and bands: no motion" in result.output
    refused = run("identify", "--example", "--save", "found.json")
    assert refused.exit_code == 2 and "Regressions alone" in refused.output


def bad(name):
    """Files that cannot be used."""
    t = np.arange(600) * 0.01
    swing = np.exp(-0.05 * t) * np.sin(2 * np.pi * t)
    columns = {
        "nan": [t, np.where(t > 3, np.nan, swing)],
        "decreasing": [t[::-1], swing],
        "repeated": [np.round(t, 1), swing],
        "gap": [(t + (t > 2))[:450], swing[:450]],  # two cycles, and two and a half
        "constant": [t, 0 * t + 1],
        "short": [t[:250], swing[:250]],
        "one": [swing],
        "two": [t, swing, swing],
        "growing": [t, swing[::-1]],
        "good": [t, swing],
    }[name]
    return "\n".join(",".join(f"{x:.9g}" for x in row) for row in np.stack(columns, axis=1))


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("nan", [], "channel 2, from 3.01 to 5.99 s: 299 samples are missing"),
        ("decreasing", [], "no time column"),
        ("repeated", ["--time", "1"], "t must increase, but it repeats at sample"),
        ("gap", [], "no samples from 2 to 3.01 s"),
        ("constant", [], "nothing vibrates in this record"),
        ("short", [], "fewer than three cycles"),
        ("one", [], "has 1 column"),
        ("two", [], "2 columns could be the measured one, ['2', '3']: choose with --column"),
        ("growing", [], "is forced or not a free decay"),
        ("good", ["--fix", "omega3=1"], "coefficient name 'omega3' is not known"),
        ("good", ["--fix", "gamma_3=1"], "the unit of q is not known: load the decay with --unit"),
        ("good", ["--fix", "omega^2=39.5e6"], "contradicts the data"),
        ("good", ["--fix", "omega^2"], "is not NAME=NUMBER"),
        (
            "good",
            ["--figure", "backbone.doc"],
            "backbone.doc: its name must end in .png or .svg or .pdf",
        ),
        ("good", ["--unit", "yard"], "unit 'yard' is not known"),
        ("good", ["--fix", "omega^2=-36"], "fixed omega^2 = -36 must not be negative"),
        ("good", ["--start", "50"], "leave 0 samples"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(run, tmp_path, name, options, message):
    (tmp_path / "decay.csv").write_text(bad(name))
    refused_in_one_line(run("identify", "decay.csv", *options), message)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--harmonics", "0..3"], "neither a range such as 0-3 nor a list"),
        (["--harmonics", "5-2"], "neither a range such as 0-3 nor a list"),
        (["--order", "2"], "order = 2 must be at least 3"),
        (["--cutoff", "-5"], "must be a positive frequency"),
        (["--cutoff", "0.5"], "cutoff = 0.5 Hz would take away the vibration itself"),
        (["--damping", "magic"], "'magic' is not one of"),
    ],
)
def test_what_no_regression_can_do_is_refused(run, tmp_path, options, message):
    (tmp_path / "decay.csv").write_text(bad("good"))
    refused_in_one_line(run("regress", "decay.csv", *options), message)


def refused_in_one_line(result, message):
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
    assert "Traceback" not in result.output
    errors = [line for line in result.output.splitlines() if line.startswith("Error: ")]
    assert len(errors) == 1 and result.stderr.splitlines()[-1] == errors[0]


def test_text_in_a_number_column_empty_and_missing_files(run, tmp_path):
    lines = bad("good").splitlines()
    (tmp_path / "text.csv").write_text("\n".join([*lines[:40], "0.4,oops", *lines[41:]]))
    (tmp_path / "empty.csv").write_text("")
    for file, message in (
        ("text.csv", "line 41, column 2: 'oops' is not a number"),
        ("empty.csv", "the file is empty"),
        ("nowhere.csv", "no such file"),
    ):
        result = run("identify", file)
        assert result.exit_code == 2 and message in result.output


@pytest.mark.slow
def test_millimetres_get_a_hint(run, tmp_path):
    decay = example_decay(40.0, 1)
    table = np.stack([decay.t, 1000 * decay.q], axis=1)
    np.savetxt(tmp_path / "decay.csv", table, delimiter=",", header="t,q", comments="")
    result = run("regress", "decay.csv", "--unit", "m", "--fix", "omega^2=36")
    assert "if it is in millimetres, load it with --unit mm" in result.output
    wrong = run("identify", "decay.csv", "--unit", "m", "--fix", "gamma_3=9")
    assert wrong.exit_code == 2 and "1000 means millimetres" in wrong.output


def test_neither_or_both_of_file_and_example(run):
    for arguments in ([], ["x.csv", "--example"]):
        result = run("identify", *arguments)
        assert result.exit_code == 2 and "name one FILE, or ask for --example" in result.output


def test_saved_decays_are_read_back(run, tmp_path):
    save_decay(example_decay(), tmp_path / "clean.npz")
    result = run("regress", "clean.npz")
    assert result.exit_code == 0, result.output
    assert "IC-ROM model misses the measured frequency by 0.001" in result.output


@pytest.mark.parametrize(
    "arguments",
    [
        ["--bogus"],
        ["bogus"],
        ["identify", "--bogus"],
        ["identify", "--order", "two"],
        ["simulate"],
        ["simulate", "decay.csv", "--elements", "-3"],
        ["study", "--seeds", "1"],
        ["diagnose"],
        ["diagnose", "--measured", "nowhere.csv"],
        ["diagnose", "--measured", "no_text.json", "--model", "no_text.json"],
        ["diagnose", "--measured", "no_text.json", "--beam", "no_text.json"],
        ["export", "no_text.json", "--to", "c"],
        ["export", "nowhere.json", "--to", "c"],
        ["export", ".", "--to", "c"],
    ],
)
def test_every_command_refuses_in_one_line(run, tmp_path, arguments):
    (tmp_path / "no_text.json").write_bytes(bytes(range(128, 256)))
    result = run(*arguments)
    assert result.exit_code == 2 and result.stdout == ""
    assert "Errno" not in result.stderr and "codec" not in result.stderr
    assert all(name in result.stderr for name in arguments[1:] if "no_text" in name)
    assert re.fullmatch(r"Error: .*\n", result.stderr)


def test_an_option_of_another_command_is_not_mistaken_for_one_of_a_like_name(run):
    refused = run("inspect", "decay.csv", "--mode", 1).stderr
    assert "--mode is no option here, but of romsindy diagnose, romsindy identify" in refused
    assert "Did you mean '--measured'" in run("diagnose", "--measurd", "decay.csv").stderr


@pytest.mark.slow
def test_a_unit_of_no_motion_has_a_remedy(run, tmp_path):
    """What the message advises works."""
    save_decay(EXAMPLE_MODEL.simulate(1.8, 0.0, np.arange(0, 25, 0.02)), tmp_path / "decay.csv")
    refused = run("inspect", "decay.csv", "--unit", "volts")
    assert refused.exit_code == 2 and "unit 'volts'" in refused.stderr
    assert "such as V, multiply" in refused.stderr and "leave out --unit to" in refused.stderr
    assert run("inspect", "decay.csv").exit_code == 0


def test_a_choice_that_is_not_there_is_all_that_is_told(run, tmp_path):
    """The record drifts, which is no news for it."""
    t = np.arange(0, 25, 0.02)
    q = EXAMPLE_MODEL.simulate(1.8, 0.0, t).q + 0.05 * t
    np.savetxt(tmp_path / "decay.csv", np.column_stack([t, q]), header="t q")
    assert "the level drifts" in run("inspect", "decay.csv").output
    for choice in (["--mode", 9], ["--mode", 0], ["--band", 90, 99], ["--release", 5]):
        refused = run("identify", "decay.csv", *choice)
        assert refused.exit_code == 2 and "drift" not in refused.stderr
        assert f"{choice[0][2:]} = {choice[1]}" in refused.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "files"),
    [
        (["inspect", "decay.csv", "--json", "x.json"], ["x.json", "decay_inspection.html"]),
        (["regress", "decay.csv", "--model", "x.json"], ["x.json"]),
    ],
)
def test_who_reads_a_pipe_may_stop(tmp_path, command, files):
    """As `romsindy ... | head` does: no message, and the files are written."""
    save_decay(EXAMPLE_MODEL.simulate(1.8, 0.0, np.arange(0, 25, 0.02)), tmp_path / "decay.csv")
    with subprocess.Popen(
        [sys.executable, "-m", "romsindy", *command],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as running:  # fmt: skip
        running.stdout.close()
        assert running.stderr.read() == b""
    assert all((tmp_path / name).stat().st_size for name in files)


def test_an_internal_error_is_no_refusal(run, monkeypatch):
    """It ends with exit code 1 and keeps its traceback."""

    def broken(*_):
        raise KeyError("a bug")

    monkeypatch.setattr(measurement, "example_decay", broken)
    result = run("identify", "--example")
    assert result.exit_code == 1 and isinstance(result.exception, KeyError)


def test_help_imports_no_command(run):
    """Neither the numbers nor the figures: help is printed at once."""
    code = (
        "import sys; from romsindy.commands.main import main;"
        " main(['--help'], standalone_mode=False);"
        " sys.exit(bool({'numpy', 'matplotlib', 'romsindy_study.command'} & {*sys.modules}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    # Each line of help is the first of the command's own.
    listed = dict(re.findall(r"^  (\w+)  +(.+)$", done.stdout.partition("Commands:")[2], re.M))
    for name, line in listed.items():
        assert line in " ".join(run(name, "--help").output.split())
    assert run().output == run("--help").output


@pytest.fixture
def others(tmp_path, monkeypatch):
    """Commands of two more packages that are installed: of one the import fails."""
    entries = "[romsindy.commands]\ngood = other_good:good\nidentify = other_good:good\n"
    entries += "number = other_good:number\nbad = other_bad:bad\ngone = other_gone:gone\n"
    code = "import click\nnumber = 3\n@click.command()\ndef good():\n    click.echo('it runs')\n"
    (tmp_path / "other_good.py").write_text('"""Say that it runs.\n\nAnd more."""\n' + code)
    (tmp_path / "other_bad.py").write_text('"""Is never run."""\nimport no_such_package\n')
    about = tmp_path / "other-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: other\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(entries)
    monkeypatch.syspath_prepend(tmp_path)
    main_module._added.cache_clear()
    yield
    main_module._added.cache_clear()


def test_any_package_adds_a_command(run, others):
    """By an entry point; one that fails says why and stops no other command."""
    assert run("good").output == "it runs\n"
    listed = dict(re.findall(r"^  (\w+)  +(.+)$", run("--help").output, re.M))
    assert listed["good"] == "Say that it runs."
    assert listed["gone"].startswith("cannot be imported: ")
    assert "other" not in run("identify", "--help").output  # a name of ours stays ours
    for name, why in {
        "bad": "cannot be imported: ModuleNotFoundError: No module named 'no_such_package'",
        "gone": "cannot be imported: ModuleNotFoundError: No module named 'other_gone'",
        "number": "is no click.Command: other_good:number is of type int",
    }.items():
        result = run(name, "file.csv", "--option", "3")
        assert result.exit_code == 2
        sentence = f"the command {name} of the package other {why}"
        assert sentence in result.output and len(result.output.splitlines()) == 1
        assert name in run(name, "--help").output
    # Where an option is looked for in all commands, those that fail are looked through, too.
    assert "but of romsindy identify" in run("export", "--coordinates", "2").output


@pytest.mark.slow
def test_no_progress_in_a_pipe(tmp_path):
    """A log is no terminal: neither bars nor lines of status."""
    (tmp_path / "model.json").write_text(EXAMPLE_MODEL.to_json())
    save_decay(EXAMPLE_MODEL.simulate(1.8, 0.0, np.arange(0, 25, 0.02)), tmp_path / "decay.csv")
    commands = [
        ["regress", "--example"],
        ["inspect", "decay.csv"],
        ["diagnose", "--measured", "decay.csv", "--model", "model.json"],
        ["simulate", "beam.npz", "--duration", "0.01", "--elements", "10"],
    ]
    code = "import sys, json; from romsindy.commands.main import main\n"
    code += "for words in json.loads(sys.argv[1]): main(words, standalone_mode=False)"
    done = subprocess.run(
        [sys.executable, "-c", code, json.dumps(commands)],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stderr == "" and "\r" not in done.stdout
    made = {"example_regression.html", "decay_inspection.html", "decay_diagnosis.html", "beam.npz"}
    assert made <= {path.name for path in tmp_path.iterdir()}


def test_python_m_romsindy_prints_versions_for_a_bug_report():
    module = [sys.executable, "-m", "romsindy"]
    printed = subprocess.run(module, capture_output=True, text=True, check=True).stdout
    rows = dict(line.split(maxsplit=1) for line in printed.splitlines())
    assert rows["romsindy"] == __version__ and rows["numpy"] == np.__version__
    assert rows["Python"] == platform.python_version()
    assert {*rows} >= {"pysindy", "scipy", "scikit-learn", "numba", "platform"}
    helped = subprocess.run([*module, "--help"], capture_output=True, text=True, check=True).stdout
    assert "Commands:" in helped and "python -m romsindy prints versions" in helped


def test_version_and_help(run):
    assert run("--version").output == f"romsindy, version {__version__}\n"
    assert "--example" in run("identify", "--help").output


@pytest.mark.slow
def test_where_the_fit_breaks_down_the_quieter_part_is_identified(run, monkeypatch):
    """Whatever the linear algebra says, in words, beside what stands."""
    reaches = []

    def fit(decays, coordinates, **settings):
        reaches.append(max(float(np.abs(d.q).max()) for d in decays))
        if len(reaches) == 1:
            raise np.linalg.LinAlgError("Eigenvalues did not converge")
        return real(decays, coordinates, **settings)

    real = measurement.identify
    monkeypatch.setattr(measurement, "identify", fit)
    result = run("identify", "--example", "--json", "-")
    assert result.exit_code == 0, result.output
    assert reaches[1] <= 0.51 * reaches[0]
    content = json.loads(result.stdout)[0]
    assert content["structure"] is not None
    notes = " ".join(content["notes"])
    assert "part below 50 % of its largest amplitude" in notes
    assert "no equation of one coordinate follows the motion (Eigenvalues" in notes


@pytest.mark.slow
def test_a_regression_that_cannot_be_made_leaves_the_identification(run, monkeypatch):
    def refuse(*_):
        raise ValueError("too few samples a cycle")

    monkeypatch.setattr(measurement, "compare_models", refuse)
    result = run("identify", "--example", "--full", "--save", "found.json")
    assert result.exit_code == 0 and "no regression beside the identification" in result.output
    assert Identification.load("found.json").structures
    monkeypatch.setattr(measurement, "identify", refuse)
    result = run("regress", "--example")
    assert result.exit_code == 2 and "too few samples a cycle" in result.stderr


@pytest.mark.parametrize(
    ("module", "name", "words"),
    [
        (measurement, "inspect", "Interrupted while inspecting"),
        (measurement, "extract_backbone", "Interrupted while reading the cycles, after the"),
        (
            measurement,
            "compare_models",
            "Interrupted while making the regressions, after the",
        ),
    ],
)
def test_an_early_interrupt_says_what_was_reached(run, tmp_path, monkeypatch, module, name, words):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, name, stop)
    result = run("identify", "--example")
    assert result.exit_code == 130 and words in result.stderr
    assert ("Used: mode 1 at" in result.stderr) == (name != "inspect")
    assert not [*tmp_path.iterdir()]
    save_decay(example_decay(), tmp_path / "a.npz")
    save_decay(example_decay(), tmp_path / "b.npz")
    result = run("identify", "a.npz", "b.npz")
    assert result.exit_code == 130 and "a.npz: interrupted while" in result.stdout


def test_an_interrupt_that_python_drops_comes_again(run, monkeypatch):
    """One that comes while an object is collected is printed as ignored, and no more."""

    class Collected:
        def __del__(self):
            raise KeyboardInterrupt

    def stop(*_, **__):
        Collected()  # is collected at once
        for _ in range(300):  # C code is not interrupted: what follows it is
            time.sleep(0.1)

    monkeypatch.setattr(measurement, "inspect", stop)
    heard = signal.signal(signal.SIGINT, signal.default_int_handler)  # also in the background
    result = run("identify", "--example")
    signal.signal(signal.SIGINT, heard)
    assert result.exit_code == 130 and "Interrupted while inspecting" in result.stderr


@pytest.mark.parametrize(
    "name", ["identify", "regress", "steady", "diagnose", "simulate", "export"]
)
def test_help_has_every_option_once_under_a_heading(name):
    command = getattr(importlib.import_module(f"romsindy.commands.{name}"), name)
    text = CliRunner().invoke(main, [name, "--help"]).output
    heads = re.findall(r"^([A-Z][a-z ]+):$", text, re.M)
    assert heads == [*command.headings, "Other"]
    rows = re.findall(r"^  (?:-[a-z], )?(--[a-z-]+)", text, re.M)
    options = [p.opts[0] for p in command.params if isinstance(p, click.Option)]
    assert sorted(rows) == sorted([*options, "--help"])
    # What has no heading stands under "Other": give a new option one.
    others = re.findall(r"^  (?:-h, )?(--[a-z-]+)", text[text.index("\nOther:\n") :], re.M)
    assert set(others) <= {"--jobs", "--help"}
