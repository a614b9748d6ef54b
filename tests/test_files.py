import numpy as np
import pytest
from oracles import viscous_decay
from scipy.io import savemat

from romsindy import Decay, load_decay, load_recording, save_decay
from romsindy.record.units import UNITS, parse_unit

T = np.arange(1000) * 0.01
Q = viscous_decay(T, 2 * np.pi * 1.1, 0.01, 0.02)


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def table(separator=",", header="", factor=1.0, decimal="."):
    rows = [f"{t:.6f}{separator}{q * factor:.9f}" for t, q in zip(T, Q, strict=True)]
    return (header + "\n" if header else "") + "\n".join(rows).replace(".", decimal) + "\n"


@pytest.mark.parametrize(
    ("text", "settings", "unit"),
    [
        (table(), {}, None),
        (table(";"), {"unit": "m"}, "m"),
        (table("\t", "t\tq"), {"unit": "m"}, "m"),
        (table(",", "time [s],q [mm]", 1000), {}, "m"),
        (table(",", "time (s), tip (mm)", 1000), {}, "m"),
        (table(";", "Zeit;Weg", decimal=","), {"unit": "m"}, "m"),
        (table(",", "# made by hand\n% t and q", 1000), {"unit": "mm"}, "m"),
        (table(" "), {"unit": "m"}, "m"),
        (table(",", "Run 7, beam\nt,q"), {"unit": "rad"}, "rad"),
        (table(",", "﻿t,q"), {}, None),
    ],
)
def test_text_files(tmp_path, text, settings, unit):
    decay = load_decay(write(tmp_path / "decay.csv", text), **settings)
    np.testing.assert_allclose(decay.t, T, atol=1e-9)
    np.testing.assert_allclose(decay.q, Q, atol=2e-9)  # nine digits were written
    assert decay.unit == unit


def test_milliseconds(tmp_path):
    text = "t [ms],q [m]\n" + "\n".join(
        f"{1000 * t:.3f},{q:.9f}" for t, q in zip(T, Q, strict=True)
    )
    np.testing.assert_allclose(load_decay(write(tmp_path / "d.csv", text)).t, T, atol=1e-9)


def test_velocity_and_acceleration_by_unit_header_or_argument(tmp_path):
    velocity = np.gradient(Q, T)
    np.savez(tmp_path / "v.npz", t=T, v=1000 * velocity)
    by_unit = load_decay(tmp_path / "v.npz", "mm/s")
    by_name = load_decay(tmp_path / "v.npz", quantity="velocity")
    assert by_unit.measured == "velocity" and by_unit.unit == "m"
    np.testing.assert_allclose(by_unit.q[50:-50], Q[50:-50], atol=2e-4 * 0.02 + 1e-4)
    np.testing.assert_allclose(by_name.q, 1000 * by_unit.q, rtol=1e-9)
    np.savez(tmp_path / "a.npz", time=T, acc=np.gradient(velocity, T) / 9.80665)
    acceleration = load_decay(tmp_path / "a.npz", "g")
    assert acceleration.measured == "acceleration"
    np.testing.assert_allclose(acceleration.q[50:-50], Q[50:-50], atol=1e-3)


def test_unit_says_which_column_was_measured(tmp_path):
    velocity = np.gradient(Q, T)
    np.savez(tmp_path / "both.npz", t=T, x=Q, v=velocity)
    assert load_decay(tmp_path / "both.npz", "m").measured == "displacement"
    decay = load_decay(tmp_path / "both.npz", "m/s")
    assert decay.measured == "velocity"
    np.testing.assert_array_equal(decay.q_dot, velocity)


def test_matlab_and_npz(tmp_path):
    savemat(tmp_path / "d.mat", {"t": T[:, None], "x": Q[:, None], "info": "a beam"})
    np.testing.assert_array_equal(load_decay(tmp_path / "d.mat", "m").q, Q)
    savemat(tmp_path / "two.mat", {"t": T, "x": np.stack([Q, 2 * Q], axis=1)})
    both = load_decay(tmp_path / "two.mat", "m", column=["x[0]", "x[1]"])
    np.testing.assert_array_equal(both.q, np.stack([Q, 2 * Q], axis=1))
    np.savez(tmp_path / "bare.npz", x=Q)
    np.testing.assert_allclose(
        load_decay(tmp_path / "bare.npz", "deg", rate=100.0).t, T, atol=1e-12
    )


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_save_and_load_again(tmp_path, suffix, clean):
    path = tmp_path / f"decay{suffix}"
    save_decay(clean, path)
    again = load_decay(path)
    for name in ("t", "q", "q_dot", "q_ddot"):
        np.testing.assert_allclose(
            getattr(again, name), getattr(clean, name), rtol=1e-14, atol=1e-300
        )
    assert again.unit == "m" and again.complete
    with pytest.raises(ValueError, match=r"name a .csv or an .npz file"):
        save_decay(clean, tmp_path / "decay.xlsx")


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
@pytest.mark.parametrize("unit", ["m", None])
def test_every_field_comes_back(tmp_path, suffix, unit):
    velocity, path = np.gradient(Q, T), tmp_path / f"decay{suffix}"
    for decay in (
        Decay.from_velocity(T, velocity, unit),
        Decay.from_acceleration(T, np.gradient(velocity, T), unit).free(),
        Decay(T, Q, unit=unit).conditioned(),
    ):
        save_decay(decay, path)
        again = load_decay(path)
        for name in ("unit", "measured", "stage", "notes"):
            assert getattr(again, name) == getattr(decay, name)
        for name in ("t", "q", "q_dot", "q_ddot"):
            np.testing.assert_array_equal(getattr(again, name), getattr(decay, name))


def test_several_channels_come_back(tmp_path):
    both = Decay.from_velocity(T, np.stack([Q, 2 * Q], axis=1), "m")
    save_decay(both, tmp_path / "both.npz")
    again = load_decay(tmp_path / "both.npz")
    np.testing.assert_array_equal(again.q_dot, both.q_dot)
    assert again.measured == "velocity"


def test_part_of_a_record(tmp_path):
    decay = load_decay(write(tmp_path / "d.csv", table()), start=2.0, end=7.0)
    assert (decay.t[0], decay.t[-1]) == (2.0, 7.0)


def test_a_column_without_a_number_is_not_what_was_measured(tmp_path):
    rows = table(",", "t,q,dead").replace("\n", ",nan\n").replace("dead,nan", "dead")
    recording = load_recording(write(tmp_path / "d.csv", rows))
    assert recording.names == ("q",) and "left out: dead" in recording.notes
    with pytest.raises(ValueError, match=r"columns \['dead'\] hold no number: choose another"):
        load_recording(tmp_path / "d.csv", column="dead")


def corrupted(line, text):
    lines = table(",", "t,q").splitlines()
    lines[line - 1] = text
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "settings", "message"),
    [
        ("", {}, "the file is empty"),
        ("\n\n", {}, "no lines of data"),
        ("t,q\n", {}, "no line starts with a number"),
        (corrupted(12, "0.1,broken"), {}, r"line 12, column 'q': 'broken' is not a number; mend"),
        (corrupted(12, "0.1,"), {}, r"line 12, column 'q': the cell is empty"),
        (corrupted(12, "0.1"), {}, r"line 12: 1 columns where 2 are usual"),
        (
            corrupted(12, "0.1,nan"),
            {},
            r"column 'q' has 1 value that is NaN .* row 11 of the data",
        ),
        (corrupted(12, "0.02,0.1"), {}, r"t must increase, but it decreases at sample 10"),
        (corrupted(12, "0.09,0.1"), {}, r"t must increase, but it repeats at sample 10"),
        ("\n".join(f"{q}" for q in Q), {}, r"has 1 column; add the times, or .* rate="),
        ("t,x,y\n0,1,2\n1,2,3\n", {}, r"2 columns could be the measured one, \['x', 'y'\]: choose"),
        ("a,b\n0,1\n1,2\n", {}, r"no time column among \['a', 'b'\]; name it with time="),
        (table(), {"column": "q"}, r"column = 'q' is none of \['2'\]"),
        (table(), {"time": "zeit"}, r"time = 'zeit' is none of"),
        (table(), {"rate": -1.0}, r"rate = -1.0 must be a positive number"),
        (table(), {"unit": "furlong"}, r"unit 'furlong' is not known: use m, cm, mm"),
        (table(), {"unit": "mm", "quantity": "velocity"}, r"unit 'mm' is one of displacement, but"),
        (table(), {"end": np.nan}, "end=nan is no time: give seconds, or leave it out"),
        (table(), {"start": -np.inf}, "start=-inf is no time"),
        (table(), {"start": 99.0}, r"start = 99.0, end = None leave 0 samples"),
    ],
)
def test_bad_files_are_named(tmp_path, text, settings, message):
    with pytest.raises(ValueError, match=message):
        load_decay(write(tmp_path / "decay.csv", text), **settings)


def heave_and_pitch(path, unit, turn):
    np.savez(path, t=T, **{"heave [m]": Q, f"pitch [{unit}]": 4 * turn * Q})
    return path


def test_angles_beside_lengths_count_at_a_lever_arm(tmp_path):
    """By default both vibrate alike: here at a quarter of a metre."""
    both = {"column": ["heave", "pitch"]}
    for unit, turn in (("rad", 1.0), ("deg", 180 / np.pi), ("mrad", 1e3)):
        decay = load_decay(heave_and_pitch(tmp_path / "a.npz", unit, turn), **both)
        np.testing.assert_allclose(decay.signal, np.stack([Q, Q], axis=1), atol=1e-12)
        assert decay.unit == "m" and "lever arm of 0.25 m" in decay.notes[0]
    read = load_recording(tmp_path / "a.npz", **both, lever=2)
    np.testing.assert_allclose(read.x[:, 1], 8 * Q, atol=1e-12)
    assert read.lever == 2 and read.names == ("heave", "pitch")
    alone = load_recording(tmp_path / "a.npz", column="pitch")
    assert alone.unit == "rad" and alone.lever is None


@pytest.mark.parametrize(
    ("column", "lever", "message"),
    [
        (["heave", "pitch"], 0, r"lever = 0 must be positive and finite"),
        (["heave", "pitch"], "2 m", r"lever = '2 m' must be a number"),
        (["heave"], 2, r"lever = 2 is for columns of lengths and of angles together"),
        (["heave", "force"], None, r"\['heave', 'force'\] are not in one unit"),
        (["still", "pitch"], None, r"lever = 0 must be positive"),
    ],
)
def test_levers_that_are_none(tmp_path, column, lever, message):
    names = ("heave [m]", "pitch [rad]", "force [kg^0.5 m]", "still [m]")
    values = dict(zip(names, (Q, Q, Q, 0 * Q), strict=True))
    np.savez(tmp_path / "a.npz", t=T, **values)
    with pytest.raises(ValueError, match=message):
        load_decay(tmp_path / "a.npz", column=column, lever=lever)


def test_gap_in_a_file(tmp_path):
    lines = table().splitlines()
    with pytest.raises(ValueError, match=r"t has a gap of 1.01 s after 2.99 s"):
        load_decay(write(tmp_path / "d.csv", "\n".join(lines[:300] + lines[400:])))


def test_missing_and_foreign_files(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.csv: no such file"):
        load_decay(tmp_path / "nothing.csv")
    with pytest.raises(ValueError, match="is a directory: name a file in it"):
        load_decay(tmp_path)
    with pytest.raises(ValueError, match=r"unknown kind of file '.docx'"):
        load_decay(write(tmp_path / "d.docx", "x"))
    with pytest.raises(ValueError, match=r"not a MATLAB v5 file"):
        load_decay(write(tmp_path / "d.mat", "this is no matlab file " * 20))


def test_units_convert_to_si():
    assert parse_unit("mm/s^2").factor == pytest.approx(1e-3)
    assert parse_unit("deg").factor == pytest.approx(np.pi / 180)
    assert parse_unit("g").factor == 9.80665
    assert {u.quantity for u in UNITS.values()} == {"displacement", "velocity", "acceleration"}


def test_an_empty_cell_refuses_only_the_column_that_it_is_in(tmp_path):
    """In a column beside the measured one nothing is lost, in time or signal a sample is."""
    rows = [f"{t:.6f},{q:.9f},{20 + i % 7:.3f}" for i, (t, q) in enumerate(zip(T, Q, strict=True))]
    for at in (3, 640, len(rows) - 1):  # above and below the lines that show the layout
        holed = [*rows[:at], rows[at].rsplit(",", 1)[0] + ",", *rows[at + 1 :]]
        path = write(tmp_path / f"beside{at}.csv", "\n".join(["t,x [m],temp [C]", *holed]) + "\n")
        np.testing.assert_allclose(load_decay(path, column="x").q, Q, atol=1e-9)
        assert load_recording(path).names == ("x",)
    most = [r if i % 5 else r.rsplit(",", 1)[0] + "," for i, r in enumerate(rows)]  # a slow channel
    path = write(tmp_path / "slow.csv", "\n".join(["t,x [m],temp [C]", *most]))
    np.testing.assert_allclose(load_decay(path, column="x").q, Q, atol=1e-9)
    cells = rows[20].split(",")
    holed = [*rows[:20], f"{cells[0]},,{cells[2]}", *rows[21:]]
    path = write(tmp_path / "own.csv", "\n".join(["t,x [m],temp [C]", *holed]))
    with pytest.raises(ValueError, match="line 22, column 'x': the cell is empty; mend"):
        load_decay(path, column="x")
    recording = load_recording(path, column="x")  # may have gaps, and says which
    assert np.flatnonzero(np.isnan(recording.x)).tolist() == [20]
    assert any("line 22, column 'x'" in note for note in recording.notes)
    assert len(load_decay(path, column="x", start=1.0).t)
    holed = [*rows[:20], f",{cells[1]},{cells[2]}", *rows[21:]]
    path = write(tmp_path / "clock.csv", "\n".join(["t,x [m],temp [C]", *holed]))
    with pytest.raises(ValueError, match=r"the time has 1 value .* row 21"):
        load_decay(path, column="x")
    np.testing.assert_allclose(load_decay(path, column="x", rate=1 / T[1]).q, Q, atol=1e-9)


def test_signals_of_simulink_have_their_labels(tmp_path):
    signals = np.zeros(2, dtype=[("values", "O"), ("label", "O")])
    signals[0], signals[1] = (Q[:, None], "tip"), (2 * Q[:, None], "")
    savemat(tmp_path / "out.mat", {"yout": {"time": T[:, None], "signals": signals}})
    np.testing.assert_array_equal(load_decay(tmp_path / "out.mat", "m", column="tip").q, Q)
    other = load_decay(tmp_path / "out.mat", "m", column="yout.signals[1].values")
    np.testing.assert_array_equal(other.q, 2 * Q)
    # Without times of its own ("structure" instead of "structure with time").
    without = {"tout": T, "yout": {"time": np.zeros((0, 0)), "signals": {"values": Q}}}
    savemat(tmp_path / "bare.mat", without)
    np.testing.assert_array_equal(load_decay(tmp_path / "bare.mat", "m").t, T)


def test_reports_of_abaqus(tmp_path):
    """Several tables, each with its own times; no value at a time is a missing sample."""
    one = [f"{t:>20.7E}{q:>20.7E}" for t, q in zip(T, Q, strict=True)]
    one[5] = one[5][:20] + f"{'NoValue':>20}"
    two = [f"{2 * t:>20.7E}{q:>20.7E}{3 * q:>20.7E}" for t, q in zip(T, Q, strict=True)]
    head = [f"{'X':>20}{'U2':>20}", ""], [f"{'X':>20}{'V2':>20}{'W2':>20}", ""]
    text = "\n".join(["", *head[0], *one, "", "", *head[1], *two, ""])
    path = write(tmp_path / "two.rpt", text)
    first, second = (load_recording(path, "m", column=name) for name in ("U2", "W2"))
    assert np.flatnonzero(np.isnan(first.x)).tolist() == [5]
    np.testing.assert_allclose(first.t, T, rtol=1e-7)
    np.testing.assert_allclose(second.t, 2 * T, rtol=1e-7)
    np.testing.assert_allclose(second.x[:, 0], 3 * Q, rtol=1e-6)
    other = write(tmp_path / "other.rpt", table(",", "t,q"))  # of another program
    np.testing.assert_allclose(load_decay(other).q, Q, atol=1e-8)
