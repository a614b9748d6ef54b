"""`romsindy inspect`, and `romsindy identify` on records that hold more than one decay."""

from __future__ import annotations

import itertools
import json
import re
import shlex

import numpy as np
import pytest

from romsindy.commands import measurement
from romsindy.physics.model import ReducedModel
from romsindy.text import aligned, as_options, quantity, with_band, with_error

RATE = 250.0  # Hz
MODEL = ReducedModel.from_coefficients(
    {"omega^2": (2 * np.pi * 5) ** 2, "gamma_3": 80.0, "c_linear": 0.6}, unit="m"
)


def duffing(start, seed, duration=12.0):
    """Free decay of an oscillator of 5 Hz that hardens, in m, 50 dB over the noise."""
    t = np.arange(0, duration, 1 / RATE)
    noise = np.random.default_rng(seed).standard_normal(len(t))
    return t, MODEL.simulate(start, 0.0, t).q + 1e-3 * start * noise


def write(path, t, header, *columns):
    table = np.column_stack([t, *columns])
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")


@pytest.fixture
def record(tmp_path):
    """Two releases in a row, a second mode in both, in a file in mm."""
    t, first = duffing(1.0, 0)
    second = duffing(0.7, 1)[1]
    tone = np.exp(-2.5 * t) * np.cos(2 * np.pi * 23.7 * t)
    x = np.concatenate([first + 0.2 * tone, second + 0.15 * tone])
    t = np.arange(len(x)) / RATE
    write(tmp_path / "test.csv", t, "t [s],tip [mm]", 1000 * x)
    return tmp_path / "test.csv"


def test_inspect_says_what_is_in_the_file_and_what_comes_next(run, record, tmp_path):
    result = run("inspect", "test.csv", "--end", 23)
    assert result.exit_code == 0, result.output
    assert "displacement in m (header 'tip [mm]')" in result.output
    releases = re.findall(r"^ +([12]) +[\d.]+ +[\d.]+ +\d+ ", result.output, re.M)
    assert releases == ["1", "2"]
    assert re.search(r"^ +2 +23\.[67]", result.output, re.M)
    assert re.search(r"releases 1 and 2\. Left out: mode 2 at 23\.[67]", result.output)
    commands = re.findall(r"^  (romsindy identify .*)$", result.output, re.M)
    base = "romsindy identify test.csv --end 23"
    assert commands == [base, f"{base} --mode 2", f"{base} --release 1"]
    page = (tmp_path / "test_inspection.html").read_text(encoding="utf-8")
    assert f"{base} --mode 2" in page and page.count("data:image/png;base64,") == 1
    assert result.stderr == ""  # a progress bar is silent where there is no terminal


def test_json_alone_on_the_standard_output(run, record, tmp_path):
    result = run("inspect", "test.csv", "--json", "-")
    content = json.loads(result.stdout)
    assert len(content["releases"]) == 2 and len(content["modes"]) == 2
    assert not (tmp_path / "test_inspection.html").exists()
    run("inspect", "test.csv", "--json", "numbers.json", "--report", "page.html")
    made = {"made_by": "romsindy inspect --json"}
    assert json.loads((tmp_path / "numbers.json").read_text()) == made | content
    assert (tmp_path / "page.html").is_file()


@pytest.mark.slow
def test_the_command_that_comes_next_works(run, record, tmp_path):
    """Mode and releases as they were printed; coefficients within four errors of the truth."""
    printed = run("inspect", "test.csv").output
    command = re.findall(r"^  (romsindy identify .*)$", printed, re.M)[0]
    result = run(*shlex.split(command)[1:], "--full", "--json", "found.json")
    assert result.exit_code == 0, result.output
    assert result.output.startswith("Used: mode 1 at 5.")
    assert re.search(r"releases 1 and 2\. Left out: mode 2 at 23\.[67]", result.output)
    assert result.output.count("<Decay:") == 2
    ((found),) = json.loads((tmp_path / "found.json").read_text())
    assert found["mode"] == 1 and found["releases"] == [1, 2] and found["explained"] is True
    for name in ("omega^2", "c_linear"):
        got = found["coefficients"][name]
        assert abs(got["value"] - MODEL.coefficients[name]) < 4 * got["standard_error"]
    linear = found["linear"]
    assert abs(linear["damping_ratio"] - 0.3 / (2 * np.pi * 5)) < 4 * linear["damping_ratio_std"]
    page = (tmp_path / "test_report.html").read_text(encoding="utf-8")
    assert "The record" in page and re.search(r"mode 2 at 23\.[67]", page)


def multisine(noise, duration=30.0):
    """Times, response of an oscillator of 5 Hz and its input, tones of random phase: exact."""
    t, rng = np.arange(0, duration, 1 / RATE), np.random.default_rng(3)
    f = np.arange(2.0, 9.0, 0.1)
    tones = np.exp(1j * (2 * np.pi * f * t[:, None] + rng.uniform(0, 2 * np.pi, len(f))))
    s, pole = 2j * np.pi * f, -0.3 + 1j * np.sqrt((2 * np.pi * 5) ** 2 - 0.09)
    steady = 1 / ((s - pole) * (s - np.conj(pole)))
    q, v = ((tones @ (steady * s**k)).real for k in (0, 1))
    # What makes it begin at rest: a free decay.
    free = ((v[0] - np.conj(pole) * q[0]) / pole.imag / 1j * np.exp(pole * t)).real
    x = q - free
    return t, x + noise * x.std() * rng.standard_normal(len(t)), tones.sum(axis=1).real


@pytest.mark.slow
@pytest.mark.parametrize("header", ["t,a,b", "t,b,a", "t [s],x [m],ch2 [V]"])
def test_an_input_without_a_name_is_no_free_decay(run, tmp_path, header):
    """It was told as one, or nothing said how to name the input. The command finds both."""
    t, x, u = multisine(0.01, 12.0)
    swapped = header == "t,b,a"  # what is sampled first may be the input
    write(tmp_path / "d.csv", t, header, *((u, x) if swapped else (x, u)))
    said = run("inspect", "d.csv").output
    assert "it is forced or not a free decay: if a column is the input" in said
    names = {"t,a,b": ("a", "b"), "t,b,a": ("a", "b")}.get(header, ("x", "ch2"))
    step = f"romsindy identify d.csv --column {names[0]} --input-column {names[1]} --input force"
    (line,) = (x for x in said.splitlines() if step in x)
    chosen = run("inspect", "d.csv", "--column", names[0])
    assert line in chosen.output
    found = run(*shlex.split(line)[1:])
    rows = dict(x.split()[:2] for x in found.output.splitlines() if x.startswith("  "))
    assert float(rows["omega^2"]) == pytest.approx((2 * np.pi * 5) ** 2, rel=1e-3)
    assert float(rows["c_linear"]) == pytest.approx(0.6, rel=0.02)


def test_a_response_alone_is_no_free_decay(run, tmp_path):
    t, x, _ = multisine(0.01)
    write(tmp_path / "d.csv", t, "t [s],x [m]", x)
    said = run("inspect", "d.csv").output
    assert "it is forced or not a free decay: choose another channel" in said
    assert "romsindy identify" not in said


@pytest.mark.slow
def test_one_mode_and_one_release_by_choice(run, record, tmp_path):
    for choice in (["--mode", 2], ["--band", 20, 28]):
        result = run("regress", "test.csv", *choice, "--release", 2, "--json", "-")
        (found,) = json.loads(result.stdout)
        assert found["mode"] == 2 and found["releases"] == [2]
        # The damped frequency is 1.4e-4 below; the noise is a part of 150 of this mode.
        assert np.median(found["backbone"]["frequency"]) == pytest.approx(23.7, rel=2e-3)
        assert "Used: mode 2" in result.stderr
    refused = run("identify", "test.csv", "--mode", 7)
    assert refused.exit_code == 2 and "test.csv: mode = 7 is none of the modes" in refused.stderr


@pytest.mark.study
@pytest.mark.slow
def test_many_files_one_table_one_page(run, tmp_path):
    """One of them cannot be read: its sentence is in the table, and the others are done."""
    for i in (1, 2):
        write(tmp_path / f"run{i}.csv", *duffing(1.0, i)[:1], "t [s],q [m]", duffing(1.0, i)[1])
    (tmp_path / "broken.csv").write_text("")
    result = run("identify", "run1.csv", "broken.csv", "run2.csv", "--json", "all.json")
    assert result.exit_code == 2
    rows = result.output.splitlines()
    assert re.match(r"run1\.csv +1 +5\.0\d+ +[\d.e-]+ +0\.9\d+ .* yes +run1_report\.html$", rows[1])
    assert re.match(r"broken\.csv .* refused", rows[2]) and rows[3].startswith("run2.csv")
    assert "broken.csv: the file is empty" in result.output
    assert "Identified: 2 files, 2 of them explained to the noise." in result.output
    content = json.loads((tmp_path / "all.json").read_text())
    assert [c["file"] for c in content] == ["run1.csv", "broken.csv", "run2.csv"]
    assert content[1].pop("made_by") == "romsindy identify --json"
    assert content[1] == {"file": "broken.csv", "error": "broken.csv: the file is empty"}
    first, last = content[0]["linear"], content[2]["linear"]
    error = np.hypot(first["frequency_std"], last["frequency_std"])
    assert abs(first["frequency"] - last["frequency"]) < 4 * error
    page = (tmp_path / "identify_overview.html").read_text(encoding="utf-8")
    assert '<a href="run1_report.html">' in page and "the file is empty" in page
    assert (tmp_path / "run1_report.html").is_file() and (tmp_path / "run2_report.html").is_file()


@pytest.mark.slow
def test_two_processes_say_and_write_the_same(run, tmp_path):
    """A file that cannot be read and a page that cannot be written are told as by one process."""
    for i in (1, 2):
        write(tmp_path / f"run{i}.csv", *duffing(1.0, i)[:1], "t [s],q [m]", duffing(1.0, i)[1])
    (tmp_path / "broken.csv").write_text("")
    (tmp_path / "run2_regression.html").symlink_to("/dev/full")
    results, pages = [], []
    for jobs in (1, 2):
        results.append(run("regress", "run1.csv", "broken.csv", "run2.csv", "--jobs", jobs))
        pages.append((tmp_path / "run1_regression.html").read_text(encoding="utf-8"))
        (tmp_path / "run1_regression.html").unlink()
    one, two = results
    assert one.exit_code == two.exit_code == 2
    assert one.stdout == two.stdout and "broken.csv: the file is empty" in two.stdout
    assert pages[0] == pages[1]
    for result in results:
        assert "run2_regression.html was not written: No space left on device" in result.stderr


def test_no_processes_are_refused(run):
    refused = run("regress", "run1.csv", "--jobs", 0)
    assert refused.exit_code == 2 and "0 must be a number of processes" in refused.stderr


@pytest.mark.slow
def test_an_interrupt_keeps_what_is_done(run, tmp_path, monkeypatch):
    """Of the file that was being identified the regressions, and the files before it."""
    for i in (1, 2, 3):
        write(tmp_path / f"run{i}.csv", *duffing(1.0, i)[:1], "t [s],q [m]", duffing(1.0, i)[1])
    fit, calls = measurement.identify, []

    def interrupted(*arguments, **options):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return fit(*arguments, **options)

    monkeypatch.setattr(measurement, "identify", interrupted)
    result = run("identify", "run1.csv", "run2.csv", "run3.csv", "--json", "all.json")
    assert result.exit_code == 130 and len(calls) == 2
    first, second = json.loads((tmp_path / "all.json").read_text())
    assert first["explained"] is True and second["explained"] is None
    assert "interrupted" in second["verdict"] and "run2.csv" in result.output
    assert (tmp_path / "run2_report.html").is_file()
    assert (tmp_path / "identify_overview.html").is_file()


def test_an_interrupt_between_files_keeps_them(run, tmp_path, monkeypatch):
    for i in (1, 2):
        write(tmp_path / f"run{i}.csv", *duffing(1.0, i)[:1], "t [s],q [m]", duffing(1.0, i)[1])
    read = measurement.load_recording

    def interrupted(file, **options):
        if file.stem == "run2":
            raise KeyboardInterrupt
        return read(file, **options)

    monkeypatch.setattr(measurement, "load_recording", interrupted)
    result = run("regress", "run1.csv", "run2.csv")
    assert result.exit_code == 130 and "Identified: 1 files" in result.output
    assert (tmp_path / "regress_overview.html").is_file()


@pytest.mark.parametrize("command", ["inspect", "identify"])
@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("nowhere/page.html", "there is no folder nowhere"),
        ("folder", "folder is a folder: name a file"),
        ("file.txt/page.html", "there is no folder file.txt"),
    ],
)
@pytest.mark.parametrize("option", ["--report", "--json"])
def test_unwritable_places_are_refused_before_the_work(
    run, tmp_path, command, target, message, option
):
    """There is not even a record to be read."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "file.txt").write_text("")
    result = run(command, "no_such_file.csv", option, target)
    assert result.exit_code == 2 and message in result.stderr and option in result.stderr


def test_the_usual_name_of_the_page_may_be_taken(run, record, tmp_path):
    for command, name in (("inspect", "test_inspection.html"), ("identify", "test_report.html")):
        (tmp_path / name).mkdir()
        result = run(command, "test.csv")
        assert result.exit_code == 2 and f"{name} is a folder" in result.stderr


@pytest.mark.slow
def test_several_channels(run, tmp_path):
    """`inspect` looks at the liveliest; `identify` asks which; both together, or one, work."""
    t, q = duffing(1.0, 3)
    write(tmp_path / "two.csv", t, "t [s],base [m],left tip [m]", 0.1 * q, q)
    assert "modes are looked for here" in run("inspect", "two.csv", "--full").output
    printed = run("inspect", "two.csv").output
    assert "in channels base and left tip" in printed
    commands = re.findall(r"^  romsindy (identify .*)$", printed, re.M)
    assert commands[0] == "identify two.csv --column base --column 'left tip'"
    assert commands[-2:] == [f"identify two.csv --column {c}" for c in ("base", "'left tip'")]
    refused = run("identify", "two.csv")
    assert refused.exit_code == 2 and "choose with --column" in refused.stderr
    assert "['base', 'left tip']" in refused.stderr
    result = run("regress", *shlex.split(commands[0])[1:], "--full")
    assert result.exit_code == 0 and "in channels base and left tip" in result.output
    assert "channels base (+0.1) and left tip (+1) together" in result.output


@pytest.mark.slow
@pytest.mark.parametrize(
    ("header", "name", "options", "share", "count"),
    [
        ("t [s],tip y [m],tip x [m]", "beam.csv", [], 0.3, 3),
        ("t [s],tip y [m],tip x [m]", "beam.csv", [], 0.0, 2),
        ("t [s],tip y [m],tip x [m],temperature [K]", "beam.csv", ["tip x", "tip y"], -0.3, 3),
        ("t [s],tip y [mm],tip x [m]", "beam.csv", ["tip y"], 0.3, 1),
        ("t,a,a", "my beam.csv", [], 0.3, 3),
        ('t [s],-x [m],$y\'s "q" [m]', "./-beam.csv", [], 0.3, 3),
    ],
)
def test_every_command_that_is_proposed_runs(run, tmp_path, header, name, options, share, count):
    """Each reads the columns that it names, whatever they and the file are called.

    Two columns are proposed together only where the second has a share in the first's motion:
    what moves with its square, twice as fast, is proposed alone.
    """
    t, q = duffing(1.0, 3, 6.0)
    second = share * q - 0.1 * q**2 + 1e-3 * np.random.default_rng(4).standard_normal(len(t))
    more = [20 + 0.01 * t] if "temperature" in header else []
    write(tmp_path / name, t, header, q, second, *more)
    chosen = [word for column in options for word in ("--column", column)]
    printed = run("inspect", name, *chosen, "--start", 0).output
    commands = re.findall(r"^  romsindy (identify .*)$", printed, re.M)
    assert len({*commands}) == len(commands) == count
    for command in commands:
        words = shlex.split(command)
        result = run("regress", *words[1:])  # reads alike, and is fast
        assert result.exit_code == 0, f"{command}: {result.stderr}"
        columns = [b for a, b in itertools.pairwise(words) if a == "--column"]
        assert f"in channel{'s' * (len(columns) > 1)} {' and '.join(columns)}" in result.output


def test_one_result_for_outputs_of_one_result(run):
    result = run("identify", "a.csv", "b.csv", "--save", "found.json")
    assert result.exit_code == 2 and "hold one result: name one FILE" in result.stderr


def test_negative_damping_is_not_printed_without_a_word(run, tmp_path):
    """Dry friction, regressed with viscous damping and drag: the drag comes out negative."""
    truth = {"omega^2": 900.0, "c_coulomb": 4.0, "c_linear": 0.05}
    model = ReducedModel.from_coefficients(truth, unit="m")
    t = np.arange(0, 5, 0.004)
    write(tmp_path / "dry.csv", t, "t [s],q [m]", model.simulate(0.1, 0.0, t).q)
    result = run("regress", "dry.csv", "--plain", "--order", 3,
                 "--damping", "linear", "--damping", "quadratic", "--full")  # fmt: skip
    assert result.exit_code == 0, result.output
    assert re.search(r"^ *c_quadratic +1/m +-\d", result.output, re.M)
    assert re.search(r"IC-ROM: its c_quadratic is negative: a force that would supply energy",
                     result.output)  # fmt: skip


@pytest.mark.parametrize(
    ("sentence", "expected"),
    [
        ("cut it with start=1.25.", "cut it with --start 1.25."),
        ("cut it with start= and end=, or so", "cut it with --start and --end, or so"),
        ("load it with unit='mm'", "load it with --unit mm"),
        ("choose with column='left tip'", "choose with --column 'left tip'"),
        ("choose with column=", "choose with --column"),
        ("give rate=, which may be 99.8", "give --rate, which may be 99.8"),
        ("(unit=m/s^2)", "(--unit m/s^2)"),
        ("by channel='b'; or fixed=", "by --column b; or --fix"),
        ("mode = 3 is none", "mode = 3 is none"),
        ("the cutoff.start=3 and x_end=4 stay", "the cutoff.start=3 and x_end=4 stay"),
    ],
)
def test_arguments_become_options(sentence, expected):
    assert as_options(sentence) == expected


def test_numbers_and_tables_as_text():
    rows = [["name", "x [m]", ""], ["a", "1 to 2", "words"], ["long name", "-", "more"]]
    assert aligned(rows).splitlines() == [
        "name        x [m]",
        "a          1 to 2  words",
        "long name       -  more",
    ]
    assert with_error(36.00123, 0.0123) == ["36.001", "0.012"]
    # A quarter of a band is its standard error: two digits of that, however many the number has.
    assert with_band(36.00123, 35.9, 36.1) == ["36.001", "35.900 to 36.100"]
    large = with_band(657803836738.0, 657262067055.0, 687172700036.0)
    assert large == ["6.58e+11", "6.57e+11 to 6.87e+11"]
    sizes = [quantity(v, "m") for v in (3.3e-4, 0.02, 1.5, 2e-8, 0.0)]
    assert sizes == ["330 um", "20 mm", "1.5 m", "20 nm", "0 m"]
    assert quantity(1e-3, "[q]") == "0.001 [q]" and quantity(-2e-3, "rad") == "-2 mrad"
