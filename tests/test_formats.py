"""Every kind of file against one reference; damaged and foreign files; SEP005; scale."""

import sys
from pathlib import Path

import numpy as np
import pytest

from romsindy import load_decay, load_recording
from romsindy.record.units import UNITS

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import files as benchmark
from file_dresses import DRESSES, RATE, T, X

sys.path.pop(0)


@pytest.mark.parametrize("name", DRESSES)
def test_every_dress_is_equal_to_the_reference(tmp_path, name):
    write, settings, tolerance = DRESSES[name]
    write(tmp_path / name)
    assert benchmark.difference(tmp_path / name, settings, tolerance) == "equal"


def test_damaged_files_are_read_or_refused_in_a_sentence(tmp_path):
    found = benchmark.bad(tmp_path, 3 * len(DRESSES), seed=1)
    results = {result for result, *_ in found}
    assert not [r for r in results if r.startswith(("TRACEBACK", "CRASH", "HANG", "refused "))]
    # The reference sees damage done: most files are not as they were.
    assert sum(n for (r, *_), n in found.items() if r == "refused") > len(DRESSES)


def write(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def rows(t=T, x=X, form="{:.6f},{:.9f}"):
    return "\n".join(form.format(a, b) for a, b in zip(t, x, strict=True)) + "\n"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("d.csv", b"\x89PNG\r\n\x1a\n" + bytes(50), "the content is a PNG image"),
        ("d.csv", b"PK\x03\x04" + bytes(50), "not a ZIP archive .* or a broken one"),
        ("d.csv", b"<!DOCTYPE html><html>", "the content is a web page"),
        ("d.txt", b"\x1f\x8b" + bytes(50), "packed by gzip"),
        ("d.csv", bytes(range(1, 256)) * 40, "no line starts with a number|no table of text"),
        ("d.csv", b"\0" * 4000, "no table of text"),
        ("d.npy", b"\x93NUMPY\x01\x00", "not a NPY file, or a broken one"),
        ("d.wav", b"RIFF\x10\x27\x00\x00WAVE", "damaged, 12 bytes in place of 10008"),
        ("d.mat", b"MATLAB 5.0 MAT-file".ljust(128), "not a MATLAB v5 file, or a broken one"),
        ("d.h5", b"\x89HDF\r\n\x1a\n" + bytes(100), "not a HDF5 file, or a broken one"),
        ("d.uff", "    -1\n    58\n", "cut off, for no line -1 ends it"),
        ("d.tdms", b"TDSm" + bytes(100), "not a TDMS file, or a broken one"),
        ("d.lvm", "LabVIEW Measurement\n***End_of_Header***\n", "not a LVM file"),
    ],
)
def test_foreign_and_broken_files_end_in_one_sentence(tmp_path, name, content, message):
    path = write(tmp_path / name, content)
    with pytest.raises(ValueError, match=message) as caught:
        load_recording(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("name", "module"),
    [
        ("binary.uff", "pyuff"),
        ("waveform.tdms", "nptdms"),
        ("numbers.xlsx", "openpyxl"),
        ("group.h5", "h5py"),
    ],
)
def test_a_missing_library_is_named_with_what_installs_it(tmp_path, name, module, monkeypatch):
    """The extra: pip finds romsindy installed, and adds what it lacks."""
    DRESSES[name][0](tmp_path / name)
    monkeypatch.setitem(sys.modules, module, None)
    remedy = r'python -m pip install "romsindy\[formats\]"$'
    with pytest.raises(ValueError, match=f"needs {module}, .*{remedy}"):
        load_recording(tmp_path / name)


def test_an_object_array_is_refused(tmp_path):
    np.save(tmp_path / "d.npy", np.array([X, None], dtype=object))
    with pytest.raises(ValueError, match=r"not a NPY file.*Python objects"):
        load_recording(tmp_path / "d.npy")


def test_what_names_and_units_say_of_the_quantity(tmp_path):
    np.savez(tmp_path / "d.npz", t=T, acc1=X, acc2=2 * X, disp=X, n=np.arange(len(T)), fs=RATE)
    recording = load_recording(tmp_path / "d.npz")
    assert recording.names == ("acc1", "acc2") and recording.quantity == "acceleration"
    assert recording.basis == "name 'acc1'" and recording.unit is None
    assert recording.notes == ("left out: disp, n",)
    one = load_recording(tmp_path / "d.npz", "mm", column="disp")
    np.testing.assert_allclose(one.x[:, 0], X * 1e-3, rtol=1e-15)
    assert (one.unit, one.basis, one.quantity) == ("m", "unit=mm", "displacement")
    plain = load_recording(write(tmp_path / "d.csv", rows()))
    assert plain.quantity == "displacement" and plain.basis.startswith("assumed")


def test_a_unit_that_is_not_one_of_motion_is_told(tmp_path):
    recording = load_recording(write(tmp_path / "d.csv", "t [s],laser [V]\n" + rows()))
    assert recording.unit is None and "'laser [V]', a unit that is not known" in recording.basis
    mixed = "t [s],hammer [N],a [g]\n" + rows(form="{0:.4f},{1:.3f},{1:.3f}")
    assert load_recording(write(tmp_path / "m.csv", mixed)).names == ("a",)


def test_samples_that_are_missing_stay_missing(tmp_path):
    x = X.copy()
    x[[5, 6, 300]] = np.nan, np.inf, np.nan
    path = write(tmp_path / "d.csv", "t [s],q [m]\n" + rows(x=x))
    recording = load_recording(path)
    assert np.flatnonzero(np.isnan(recording.x[:, 0])).tolist() == [5, 6, 300]
    with pytest.raises(ValueError, match=r"has 3 values .* at 0.005 s in row 6 of the data: cut"):
        load_decay(path)
    # The remedy of that message: 0.1 looked at the samples before it cut them off.
    assert load_decay(path, start=0.31).t[0] == pytest.approx(0.31, abs=1e-9)
    t = T.copy()
    t[11] = np.nan
    with pytest.raises(
        ValueError, match=r"the time has 1 value that is .* first in row 12 of the data"
    ):
        load_recording(write(tmp_path / "t.csv", "t,q\n" + rows(t=t)))


def test_times_that_are_too_coarse_are_refused_with_the_rate(tmp_path):
    path = write(tmp_path / "d.csv", "t [s],a [g]\n" + rows(t=np.floor(T * 100) / 100))
    message = r"repeats at sample 1 .* 540 of 600 times repeat the one before.* rate=, about 1015"
    with pytest.raises(ValueError, match=message):
        load_recording(path)
    recording = load_recording(path, rate=RATE)
    np.testing.assert_allclose(recording.t, T, atol=1e-12)
    assert recording.names == ("a",) and recording.notes == ("times from rate=1000",)


def test_gaps_in_time_stay(tmp_path):
    text = rows().splitlines()
    recording = load_recording(write(tmp_path / "d.csv", "\n".join(text[:200] + text[300:])))
    assert [p.stop - p.start for p in recording.pieces] == [200, 300]


def test_several_clocks(tmp_path):
    twice = "X_Value,acc [g],X_Value,acc [g]\n" + rows(form="{0:.4f},{1:.5f},{0:.4f},{1:.5f}")
    with pytest.raises(ValueError, match=r"no time column among \['X_Value', 'acc'"):
        load_recording(write(tmp_path / "x.csv", twice))
    twice = twice.replace("X_Value", "time")
    recording = load_recording(write(tmp_path / "d.csv", twice))
    assert recording.names == ("acc", "acc (2)")
    other = twice.replace("X_Value", "time").replace("0.0010,", "0.0012,", 1)
    with pytest.raises(ValueError, match=r"more than one time column among \['time', 'time \(2\)'"):
        load_recording(write(tmp_path / "o.csv", other))


def test_channels_with_times_of_their_own(tmp_path):
    """Those that most channels share; the others by name."""
    one = [{"data": X, "name": f"a{i}", "fs": RATE, "unit_str": "g"} for i in (1, 2)]
    slow = {"data": X[:100], "name": "a3", "fs": 100.0, "unit_str": "g"}
    recording = load_recording([slow, *one])
    assert recording.names == ("a1", "a2") and recording.notes == ("left out: a3",)
    assert load_recording([slow, *one], column="a3").dt == pytest.approx(0.01)
    with pytest.raises(ValueError, match=r"columns \['a3'\] have other times than"):
        load_recording([slow, *one], column=["a1", "a3"])


def test_sep005():
    one = {"data": X.tolist(), "name": "acc", "unit_str": "m/s²", "fs": RATE, "quantity": "a"}
    recording = load_recording(one)
    np.testing.assert_array_equal(recording.x[:, 0], X)
    np.testing.assert_allclose(recording.t, T, atol=1e-15)
    assert (recording.quantity, recording.unit) == ("acceleration", "m")
    rows_of_channels = one | {"data": np.stack([X, 2 * X]), "time": T + 3.0}
    both = load_recording(rows_of_channels)
    assert both.names == ("acc[0]", "acc[1]") and both.t[0] == 3.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fs": 0.0}, "fs = 0.0: give samples per second"),
        ({"fs": None}, "fs = None: give samples per second"),
        ({"data": ["a"] * 9}, "data must be an array of real numbers"),
        ({"data": X * 1j}, "data must be an array of real numbers: it is complex"),
        ({"time": [1.0]}, r"600 samples, but time has shape \(1,\)"),
    ],
)
def test_bad_sep005(change, message):
    one = {"data": X, "name": "acc", "unit_str": "g", "fs": RATE} | change
    with pytest.raises(ValueError, match=message):
        load_recording(one)
    with pytest.raises(ValueError, match=r"has no \['data', 'name'\]"):
        load_recording({"unit_str": "g"})


@pytest.mark.parametrize("path", [None, 3, b"x", 2.5])
def test_what_is_no_path(path):
    with pytest.raises(ValueError, match=r"must be the name of a file"):
        load_recording(path)


def test_calendar_times_count_from_the_first_sample(tmp_path):
    """A float of today's date in s keeps 2e-7 s; the number of ms is an integer."""
    np.savez(tmp_path / "d.npz", timestamp=1_714_600_000_000 + np.arange(600), a=X)
    recording = load_recording(tmp_path / "d.npz", "g")
    np.testing.assert_allclose(recording.t, T, atol=1e-12)


def test_a_header_that_does_not_fit_is_refused(tmp_path):
    path = write(tmp_path / "d.csv", "t,q\n" + rows().replace(".", ","))
    with pytest.raises(ValueError, match=r"line 2: commas part the cells and the numbers"):
        load_recording(path)
    path = write(tmp_path / "e.csv", "t;q\n" + rows(form="{0:.4f};{1:.4f};{1:.4f}"))
    with pytest.raises(ValueError, match=r"line 1: names 2 columns, but the rows below have 3"):
        load_recording(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda line: line[:-4], r"line 301: '0.299000,.*' has other digits than the lines around"),
        (lambda line: line[:5] + line[7:], r"line 301: .* has other digits"),
        (lambda line: line.replace(",", ";"), r"line 301: 1 columns where 2 are usual"),
        (lambda line: line.replace(".", "o", 1), r"line 301, column 'time': '0o299000' is not a n"),
        (lambda line: line.replace("0.29", "0.19"), r"t must increase, but it decreases at samp"),
    ],
)
def test_a_row_that_lost_digits_is_refused(tmp_path, change, message):
    lines = ("time [s],a [g]\n" + rows()).splitlines()
    lines[300] = change(lines[300])
    with pytest.raises(ValueError, match=message):
        load_recording(write(tmp_path / "d.csv", "\n".join(lines) + "\n"))


def test_a_last_row_that_is_cut_off_is_left_out(tmp_path):
    text = rows()[:-4]
    recording = load_recording(write(tmp_path / "d.csv", text))
    assert len(recording.t) == len(T) - 1 and "is cut off: left out" in recording.notes[0]
    # Whole without a line break at its end, and with digits that vary: nothing is cut off.
    for form in ("{:.6f},{:.9f}", "{:.6f},{!r}"):
        text = rows(x=X.tolist(), form=form).rstrip()
        assert len(load_recording(write(tmp_path / "w.csv", text)).t) == len(T)


@pytest.mark.parametrize(
    ("above", "unit"),
    [
        ("Elapsed time [s]; Tip acceleration [mm/s²]", "mm/s^2"),
        ("Time;Acceleration\n[s];[m/s²]", "m/s^2"),
        ("Time;Acceleration\nsec;G", "g"),
        ("Test 5\nChannel 1;Channel 2\n\nt;acc\ns;m s^-2\n", "m/s^2"),
    ],
)
def test_headers(tmp_path, above, unit):
    text = above + "\n" + rows(form="{:.6f};{:.9f}")
    recording = load_recording(write(tmp_path / "d.csv", text))
    np.testing.assert_allclose(recording.x[:, 0], X * UNITS[unit].factor, atol=1e-8)
    assert recording.quantity == "acceleration" and recording.dt == pytest.approx(1 / RATE)


@pytest.mark.parametrize("above", ["acc [m/s^2]\n", "t [s];a [m/s^2];b [m/s^2]\n"])
def test_units_of_another_number_of_columns_are_not_forgotten(tmp_path, above):
    """Without them an acceleration would pass for a displacement."""
    with pytest.raises(ValueError, match=r"line 1: names . columns, but the rows below have 2"):
        load_recording(write(tmp_path / "d.csv", above + rows(form="{:.6f};{:.9f}")))


def test_days_that_are_ambiguous_are_refused(tmp_path):
    stamps = [f"04/05/2024 23:59:59.{i:03d}" for i in range(1000)][-300:]
    text = "\n".join(f"{s},{x:.6f}" for s, x in zip(stamps, X, strict=False))
    assert load_recording(write(tmp_path / "d.csv", "time,a [g]\n" + text)).dt == pytest.approx(
        1e-3
    )
    text += "\n05/05/2024 00:00:00.000,0.500000\n"
    with pytest.raises(ValueError, match=r"line 302: .*day/month or month/day"):
        load_recording(write(tmp_path / "d.csv", "time,a [g]\n" + text))


@pytest.mark.parametrize(("unit", "factor"), [("min", 60.0), ("ms", 1e-3), ("h", 3600.0)])
def test_times_in_other_units(tmp_path, unit, factor):
    text = f"time [{unit}],q [m]\n" + rows(t=T / factor, form="{:.12f},{:.9f}")
    recording = load_recording(write(tmp_path / "d.csv", text))
    np.testing.assert_allclose(recording.t, T, atol=1e-8)
    with pytest.raises(ValueError, match=r"column 'time' is in 'weeks', which is no unit of time"):
        load_recording(write(tmp_path / "w.csv", text.replace(f"[{unit}]", "[weeks]")))


def test_records_side_by_side_in_one_file(tmp_path):
    """Each signal with the times whose name begins as its own does."""
    np.savez(tmp_path / "d.npz", run1_t=T, run1_v=X, run2_t=2 * T + 1, run2_v=2 * X)
    recording = load_recording(tmp_path / "d.npz", column="run2_v")
    np.testing.assert_array_equal(recording.t, 2 * T + 1)
    np.testing.assert_array_equal(recording.x[:, 0], 2 * X)
    with pytest.raises(ValueError, match=r"more than one time column among \['run1_t', 'run2_t'\]"):
        load_recording(tmp_path / "d.npz")


def test_what_counts_samples_is_no_time(tmp_path):
    counted = "\n".join(f"{i},{x:.6f}" for i, x in enumerate(X))
    with pytest.raises(ValueError, match=r"no time column among \['1', '2'\]; .* give rate="):
        load_recording(write(tmp_path / "d.csv", counted))
    recording = load_recording(tmp_path / "d.csv", rate=RATE)
    assert recording.names == ("2",) and recording.dt == pytest.approx(1 / RATE)
    # As pandas writes its index.
    indexed = ",time,acc\n" + "\n".join(
        f"{i},{t:.4f},{x:.6f}" for i, (t, x) in enumerate(zip(T, X, strict=True))
    )
    assert load_recording(write(tmp_path / "p.csv", indexed)).names == ("acc",)


def test_exponents_of_fortran(tmp_path):
    text = rows(form="  {:.9E}  {:.9E}").replace("E", "D")
    recording = load_recording(write(tmp_path / "d.dat", text))
    np.testing.assert_allclose(recording.x[:, 0], X, rtol=1e-9)


@pytest.mark.parametrize(
    "above",
    ["millis,a", "time_ms,a", "t [ms],a", "Zeit (ms),a", "time,a\nms,g", "time,a\n(ms),(g)"],
)
def test_times_in_milliseconds(tmp_path, above):
    recording = load_recording(write(tmp_path / "d.csv", f"{above}\n" + rows(t=1000 * T)))
    np.testing.assert_allclose(recording.t, T, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "byte", "value", "message"),
    [
        ("cell.mat", 360, 0, "an element of type 0 and 4800 bytes"),
        ("column.mat", 145, 0x0F, "an array of class 6, .* 4 parts"),
        ("cell.mat", 163, 0x72, r"an array of class 1, shape \(1912602625, 2\)"),
    ],
)
def test_broken_matlab_files_do_not_reach_scipy(tmp_path, name, byte, value, message):
    """Its reader follows a null pointer for the first two, and asks for 28 GB for the last."""
    DRESSES[name][0](tmp_path / name)
    content = bytearray((tmp_path / name).read_bytes())
    content[byte] = value
    with pytest.raises(ValueError, match=message):
        load_recording(write(tmp_path / name, bytes(content)))


@pytest.mark.parametrize("setting", [{"rate": "fast"}, {"start": "0"}, {"end": [1.0]}])
def test_what_is_no_number(tmp_path, setting):
    path = write(tmp_path / "d.csv", rows())
    for load in (load_recording, load_decay):
        with pytest.raises(ValueError, match=r"= .* must be a number"):
            load(path, **setting)


def test_derivatives_beside_a_displacement_are_not_left_out(tmp_path):
    velocity, acceleration = np.gradient(X, T), np.gradient(np.gradient(X, T), T)
    np.savez(tmp_path / "d.npz", t=T, q=X, q_dot=velocity, q_ddot=acceleration)
    decay = load_decay(tmp_path / "d.npz", "mm", start=0.1)
    np.testing.assert_array_equal(decay.q_dot, 1e-3 * velocity[100:])
    assert decay.complete and decay.notes == ()
    assert load_recording(tmp_path / "d.npz").notes == ("left out: q_dot, q_ddot",)
