"""Many records: which they are, what is kept of each, and what they say together."""

import json
import os
import re
import signal
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from scipy.stats import ttest_ind

from romsindy.commands import measurement
from romsindy.commands.measurement import Asked, Selection
from romsindy_batch.entries import Entry, entries_of
from romsindy_batch.pictures import pictures
from romsindy_batch.store import Store
from romsindy_batch.summary import (
    Batch,
    compared,
    numbers,
    outliers,
    told,
    trends,
)
from romsindy_batch.work import Job, done_on

AMPLITUDES = np.geomspace(1e-3, 2e-2, 12)


def found(frequency, damping_ratio, amplitudes=AMPLITUDES, std=1e-4):
    """What is stored of a record whose values do not depend on its amplitude."""
    n = len(amplitudes)
    curve = {
        "amplitude": amplitudes,
        "frequency": np.full(n, frequency),
        "frequency_std": np.full(n, std),
        "damping_ratio": np.full(n, damping_ratio),
        "damping_ratio_std": np.full(n, std),
    }
    return {"unit": "m", "explained": True, "curve": curve, "short": "q_ddot + q = 0"}


def batch_of(values, columns):
    entries = [Entry(f"r{i}", None, dict(c)) for i, c in enumerate(columns)]
    return Batch(entries, [found(f, z) for f, z in values])


# -- which records --------------------------------------------------------------------------------


def test_a_folder_is_all_records_in_it_and_below(tmp_path):
    for name in ("a.csv", "b/a.CSV", "notes.docx", ".hidden.csv", "out/old.csv", "b/x.mat"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("x")
    entries = entries_of(tmp_path, tmp_path / "out")
    assert [e.name for e in entries.records] == ["a.csv", "b/a.CSV", "b/x.mat"]
    assert entries.left_out == "Left out, for they are no records: 1 .docx." and not entries.columns


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_a_table_names_files_from_its_own_folder_on(tmp_path, delimiter):
    rows = [
        ["file", "temperature", "specimen"],
        ["sub/a.csv", "21.5", "A, left"],
        ["b.csv", "", "B"],
    ]
    quoted = [[f'"{cell}"' for cell in row] for row in rows]
    (tmp_path / "list.csv").write_text("\n".join(map(delimiter.join, quoted)), encoding="utf-8-sig")
    first, second = entries_of(tmp_path / "list.csv", tmp_path / "out").records
    assert first == Entry(
        "sub/a.csv", tmp_path / "sub/a.csv", {"temperature": "21.5", "specimen": "A, left"}
    )
    assert second.values == {"temperature": "", "specimen": "B"}


def test_a_sheet_is_a_table(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    import datetime

    book = openpyxl.Workbook()
    book.active.append(["file", "date", "temperature"])
    book.active.append(["a.csv", datetime.datetime(2026, 3, 1), 21.5])
    book.save(tmp_path / "list.xlsx")
    (record,) = entries_of(tmp_path / "list.xlsx", tmp_path / "out").records
    assert record.values == {"date": "2026-03-01", "temperature": "21.5"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,t\na.csv,1\n", "no column is called 'file', there are name, t"),
        ("file\na.csv\na.csv\n", "names a.csv twice"),
        ("file\n", "names no record"),
        ("t,file\n1,a.csv\n2\n", "row 3 names no file"),
        ("\n", "is empty: write a header"),
    ],
)
def test_a_table_that_cannot_be_one_is_refused(tmp_path, text, message):
    (tmp_path / "list.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        entries_of(tmp_path / "list.csv", tmp_path / "out")


def test_a_folder_without_records_is_refused(tmp_path):
    (tmp_path / "a.docx").write_text("x")
    with pytest.raises(ValueError, match=r"holds no record: name a folder with .*\.csv"):
        entries_of(tmp_path, tmp_path / "out")


# -- what is kept ---------------------------------------------------------------------------------


def test_a_line_that_broke_off_is_none_and_the_next_begins_there(tmp_path):
    """As of a process that was killed, or a disk that was full."""
    files = [tmp_path / f"{i}.csv" for i in range(3)]
    for file in files:
        file.write_text("x")
    a, b, c = (Entry(file.name, file) for file in files)
    store = Store(tmp_path / "results.jsonl")
    store.add(a, "s", {"x": np.array([1.0, np.nan])})
    store.add(b, "s", {"x": 2})
    whole = store.path.read_bytes()
    store.path.write_bytes(whole[:-5])
    again = Store(store.path)
    assert again.of(a, "s") == {"x": [1.0, "NaN"]} and again.of(b, "s") is None
    again.add(c, "s", {"x": 3})
    assert Store(store.path).of(c, "s") == {"x": 3}
    assert [json.loads(line)["name"] for line in store.path.read_text().splitlines()] == [
        "0.csv",
        "2.csv",
    ]


def test_what_changed_is_done_again(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("x")
    entry, store = Entry("a.csv", file), Store(tmp_path / "results.jsonl")
    store.add(entry, "s", {"x": 1})
    assert store.of(entry, "s") == {"x": 1} and store.of(entry, "other options") is None
    os.utime(file, ns=(0, 1))
    assert store.of(entry, "s") is None


# -- what they say together -----------------------------------------------------------------------


def test_a_trend_is_found_with_its_error_and_outliers_do_not_move_it():
    """A line of known slope and scatter, one record far off; the error is that of the slope."""
    slopes, errors = [], []
    x = np.repeat(np.linspace(10, 30, 10), 2)
    for seed in range(60):
        y = 9 - 0.01 * x + 0.003 * np.random.default_rng(seed).normal(size=20)
        y[7] += 0.1
        columns = [{"temperature": f"{t:.3f}"} for t in x]
        line, _ = trends(batch_of(zip(y, np.full(20, 0.5), strict=True), columns))
        assert line.outliers == (7,)
        slopes.append(line.line[0])
        errors.append(np.sqrt(line.covariance[0, 0]))
    # The mean of 60 is known to 13 % of its error, the error itself to 9 %; 3.5 of each.
    assert np.mean(slopes) == pytest.approx(-0.01, abs=3.5 * np.std(slopes) / np.sqrt(60))
    assert np.mean(errors) / np.std(slopes) == pytest.approx(1, abs=0.35)


@pytest.mark.parametrize("count", [8, 30, 200])
def test_nothing_is_far_off_by_chance(count):
    """One batch in 100 has an outlier in its frequency: of 100, more than 5 once in 2000."""
    same, alarms = np.full(count, 0.5), 0
    for seed in range(100):
        y = 9 + 0.01 * np.random.default_rng(seed).normal(size=count)
        alarms += bool(outliers(batch_of(zip(y, same, strict=True), [{}] * count)))
    assert alarms <= 5
    y[4] += 1.0
    assert outliers(batch_of(zip(y, same, strict=True), [{}] * count)) == {4: "frequency"}


def test_what_is_far_off_its_repeats_is_an_outlier_though_others_differ_more():
    rng = np.random.default_rng(1)
    y = np.repeat([8.0, 9.0, 10.0], 5) + 0.002 * rng.normal(size=15)
    y[7] += 0.1
    columns = [{"specimen": name} for name in np.repeat(["A", "B", "C"], 5)]
    assert outliers(batch_of([(f, 0.5) for f in y], columns)) == {7: "frequency"}


def test_columns_are_numbers_dates_or_words():
    x, dates = numbers(["1", "", "2.5"])
    assert not dates
    np.testing.assert_equal(x, [1, np.nan, 2.5])
    x, dates = numbers(["2026-03-02", "2026-03-01T12:00", ""])
    assert dates
    np.testing.assert_equal(x, [0.5, 0, np.nan])
    assert numbers(["2026-03-02", "2026-03-02T12:00+01:00"]) is None
    assert numbers(["A", "1"]) is None and numbers(["1", "1"]) is None


def test_two_groups_are_held_against_each_other_as_by_welch():
    rng = np.random.default_rng(3)
    a, b = rng.normal(9, 0.02, 7), rng.normal(9.1, 0.05, 9)
    columns = [{"specimen": "A"}] * 7 + [{"specimen": "B"}] * 9
    batch = batch_of([(f, 0.5) for f in (*a, *b)], columns)
    first = next(c for c in compared(batch, "specimen", ("A", "B")) if c.kind == "frequency")
    oracle = ttest_ind(b, a, equal_var=False).confidence_interval(0.95)
    ends = 100 * np.array(oracle) / a.mean()
    assert (first.low, first.high) == pytest.approx(tuple(ends), rel=1e-6)
    assert first.change == pytest.approx(100 * (b.mean() / a.mean() - 1)) and first.counts == (7, 9)
    assert compared(batch, "specimen", ("A", "C")) == []
    assert told([], "specimen", ("A", "C"), "m").endswith("no amplitude is reached by two of each.")


def test_common_amplitudes_are_those_that_all_reach_or_most():
    wide, narrow, high = np.array([1e-3, 1e-1]), np.array([2e-3, 2e-2]), np.array([0.5, 1.0])
    entries = [Entry(f"r{i}", None) for i in range(6)]
    two = Batch(entries[:2], [found(9, 0.5, a) for a in (wide, narrow)])
    # Of sixty amplitudes, the ones within: 2 mm to 20 mm, one step of 8 % off at either end.
    assert two.amplitudes[[0, -1]] == pytest.approx([2e-3, 2e-2], rel=0.09)
    most = Batch(entries, [found(9, 0.5, a) for a in (wide, narrow, narrow, narrow, narrow, high)])
    assert most.amplitudes[[0, -1]] == pytest.approx([2e-3, 2e-2], rel=0.13)
    assert np.isnan(most.at(1e-2, "frequency").value[-1])
    assert Batch(entries, [], (0.01,)).amplitudes == [0.01]


def test_the_table_has_numbers_and_what_was_refused():
    entries = [Entry("a", None, {"t": "1"}), Entry("b", None, {"t": "2"})]
    batch = Batch(entries, [found(9, 0.5), {"file": "b", "error": "b: no mode"}], (0.01,))
    good, bad = batch.rows()
    assert good["frequency at 0.01 m [Hz]"] == 9 and good["frequency at 0.01 m [Hz] +-"] == 1e-4
    assert bad["refused"] == "b: no mode" and bad["frequency at 0.01 m [Hz]"] is None
    assert pictures(Batch([entries[1]], [batch.found[1]]), [], {}) == []


# -- the command ----------------------------------------------------------------------------------


def write(path, frequency, seed):
    """A linear decay of 30 cycles in closed form, 50 dB."""
    t = np.arange(0, 5, 1 / 120)
    x = np.exp(-0.25 * t) * np.cos(2 * np.pi * frequency * t)
    x += 3e-3 / np.sqrt(8) * np.random.default_rng(seed).normal(size=len(t))
    table = np.column_stack([t, 10 * x])
    np.savetxt(path, table, delimiter=",", header="t [s],x [mm]", comments="", fmt="%.6f")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("batch")
    rows = ["file,temperature"]
    for i, frequency in enumerate((6.0, 6.06)):
        write(folder / f"r{i}.csv", frequency, i)
        rows.append(f"r{i}.csv,{20 + i}")
    (folder / "bad.csv").write_text("hello\n")
    (folder / "list.csv").write_text("\n".join([*rows, "bad.csv,22", "missing.csv,23"]))
    return folder


@pytest.fixture
def run(run):
    return partial(run, "batch")


def test_what_is_refused_is_told_and_kept(run, folder):
    """Of two files that are no records the table says why; the same command asks neither again."""
    (folder / "bad_list.csv").write_text("file,temperature\nbad.csv,22\nmissing.csv,23\n")
    result = run("bad_list.csv", "--out", "refused")
    assert result.exit_code == 2 and "0 of 2 records identified" in result.output
    page = (folder / "refused" / "index.html").read_text()
    assert "missing.csv is not there: mend its name in the table" in page and "bad.csv" in page
    table = (folder / "refused" / "table.csv").read_text().splitlines()
    assert len(table) == 3 and table[0].startswith("file,temperature,explained")
    assert "2 of 2 records are known from before" in run("bad_list.csv", "--out", "refused").output


def test_a_record_in_work_is_done_again_after_an_interruption(run, folder, monkeypatch):
    """Where the fit is interrupted there are regressions alone: they are no result to be kept."""

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as stopped:
        stopped.setattr(measurement, "identify", interrupted)
        result = run("list.csv", "--out", "stopped")
    assert result.exit_code == 130
    kept = folder / "stopped" / "results.jsonl"
    assert not kept.exists() or not kept.read_text()


@pytest.mark.study
@pytest.mark.slow
def test_one_bad_file_stops_nothing_and_nothing_is_done_twice(run, folder):
    result = run("list.csv", "--out", "out", "--pages")
    assert result.exit_code == 2 and "2 of 4 records identified" in result.output
    lines = (folder / "out" / "results.jsonl").read_text().splitlines()
    first = json.loads(lines[0])["found"]
    # 50 dB over 30 cycles: the frequency to some parts in 100,000.
    assert np.allclose(first["curve"]["frequency"], 6.0, rtol=1e-3)
    page = (folder / "out" / "index.html").read_text()
    assert "missing.csv is not there: mend its name in the table" in page
    assert '<a href="pages/r0.csv.html">r0.csv</a>' in page and "bad.csv" in page
    assert (folder / "out" / "pages" / "r0.csv.html").is_file()
    table = (folder / "out" / "table.csv").read_text().splitlines()
    assert len(table) == 5 and table[0].startswith("file,temperature,explained,frequency at ")
    # Killed after the first: the same command does what is left, and keeps what was known.
    (folder / "out" / "results.jsonl").write_text(lines[0] + "\n")
    again = run("list.csv", "--out", "out", "--pages")
    assert "1 of 4 records are known from before" in again.output
    assert (folder / "out" / "results.jsonl").read_text().splitlines()[0] == lines[0]
    once_more = run("list.csv", "--out", "out", "--pages")
    assert "4 of 4 records are known from before" in once_more.output
    assert len((folder / "out" / "results.jsonl").read_text().splitlines()) == 4


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["r0.csv"], "r0.csv: no column is called 'file'"),
        (["list.csv", "--out", "mine"], "the folder mine holds files"),
        (["list.csv", "--amplitude", "-1"], "--amplitude"),
        (["nowhere"], "nowhere"),
        (["list.csv", "--compare", "specimen", "A", "B"], "columns of the table are temperature"),
        (["list.csv", "--out", ".", "--overwrite"], "no output replaces an input"),
    ],
)
def test_what_cannot_be_a_batch_is_refused(run, folder, words, message):
    (folder / "mine").mkdir(exist_ok=True)
    (folder / "mine" / "thesis.txt").write_text("x")
    result = run(*words)
    assert result.exit_code == 2 and message in result.output


@pytest.mark.study
@pytest.mark.slow
def test_a_cluster_finds_the_same_and_its_end_stops_nothing(folder):
    """It goes away when the first of two records is done; the second is done here."""
    distributed = pytest.importorskip("distributed")
    reading = dict.fromkeys(["unit", "quantity", "column", "lever", "time", "rate", "start", "end"])
    job = Job(reading, Selection(), Asked(0, {}, None))
    entries = [Entry(f"r{i}.csv", folder / f"r{i}.csv") for i in range(2)]
    here = {e.name: f["equation"] for e, f in map(job, entries)}
    said, there = [], {}
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as c:
        for entry, found in done_on(c.scheduler_address, job, entries, 1, said.append):
            there[entry.name] = found["equation"]
            c.close()
    assert there == here and len(said) == 1 and "the rest is done here" in said[0]
    with pytest.raises(ValueError, match="no cluster answers there"):
        list(done_on("tcp://127.0.0.1:9", job, entries, 1, said.append))


def little_room():
    """For this process no file may be longer than 6 kB: as where a disk fills."""
    import resource

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (6000, 6000))


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="only POSIX limits the size of files")
def test_a_disk_that_fills_costs_nothing_that_is_done(tmp_path):
    """What was written stays readable, and the same command goes on from there."""
    (tmp_path / "in").mkdir()
    for i in range(40):
        (tmp_path / "in" / f"r{i:02}.csv").write_text("nothing")
    words = [sys.executable, "-m", "romsindy", "batch", "in", "--out", "out"]
    look = {"cwd": tmp_path, "capture_output": True, "text": True}
    full = subprocess.run(words, preexec_fn=little_room, **look)
    assert (
        full.returncode == 2 and "results.jsonl cannot be written (File too large)" in full.stderr
    )
    again = subprocess.run(words, **look)
    known = int(re.search(r"(\d+) of 40 records are known from before", again.stderr)[1])
    assert 5 < known < 40 and again.returncode == 2  # all are refused, which was said
    lines = (tmp_path / "out" / "results.jsonl").read_text().splitlines()
    assert sorted(json.loads(line)["name"] for line in lines) == [f"r{i:02}.csv" for i in range(40)]
