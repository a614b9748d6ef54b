"""The same recording in every kind and dress of file that romsindy reads."""

from __future__ import annotations

import datetime
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import openpyxl
import pyuff
from scipy.io import savemat, wavfile

# The reference: an acceleration in m/s^2, that comes to rest at no round number.
RATE = 1000.0
T = np.arange(600) / RATE
X = 0.037 + 12.3 * np.exp(-2.1 * T) * np.cos(2 * np.pi * 37.3 * T)

Writer = Callable[[Path], None]


def _rows(
    separator: str = ",", end: str = "", t: np.ndarray | None = None, x: np.ndarray = X
) -> list[str]:
    times = T if t is None else t
    return [f"{a:.6f}{separator}{b:.9f}{end}" for a, b in zip(times, x, strict=True)]


def _text(*above: str, rows: list[str], encoding: str = "utf-8", comma: bool = False) -> Writer:
    body = [row.replace(".", ",") for row in rows] if comma else rows

    def write(path: Path) -> None:
        path.write_bytes(("\n".join([*above, *body]) + "\n").encode(encoding))

    return write


def _stamps(form: str, decimal: str = ".") -> list[str]:
    start = datetime.datetime(2024, 5, 1, 23, 59, 59, 700_000)
    times = [start + datetime.timedelta(seconds=float(t)) for t in T]
    return [f"{s.strftime(form)}{decimal}{s.microsecond:06d}" for s in times]


def _stamped(form: str, separator: str, decimal: str = ".") -> list[str]:
    return [
        f"{s}{separator}" + f"{x:.9f}".replace(".", decimal)
        for s, x in zip(_stamps(form, decimal), X, strict=True)
    ]


_HEAD = "time [s],acc [m/s^2]"
_TEXTS: dict[str, Writer] = {
    "header.csv": _text(_HEAD, rows=_rows()),
    "units_row.csv": _text("Time,Acceleration", "s,m/s2", rows=_rows()),
    "brackets_row.txt": _text("Time\tAcceleration", "(s)\t(m/s²)", "", rows=_rows("\t")),
    "semicolon.csv": _text("Zeit [s];Beschleunigung [m/s²]", rows=_rows(";")),
    "decimal_comma.csv": _text("Zeit [s];Beschleunigung [m/s²]", rows=_rows(";"), comma=True),
    "comma_tab.txt": _text("t [s]\ta [m/s^2]", rows=_rows("\t"), comma=True),
    "comma_spaces.txt": _text("t [s]  a [m/s^2]", rows=_rows("   "), comma=True),
    "aligned.txt": _text(
        "   Time (s)   Acceleration (m/s^2)",
        rows=[f"{t:12.6f}{x:22.9f}" for t, x in zip(T, X, strict=True)],
    ),
    "milliseconds.csv": _text("time_ms,acc_g", rows=_rows(t=1000 * T, x=X / 9.80665)),
    "name_unit.csv": _text("time_s,a_m/s^2", rows=_rows()),
    "trailing.csv": _text(_HEAD, rows=_rows(end=",")),
    "trailing_header.csv": _text(_HEAD + ",", rows=_rows(end=",")),
    "trailing_names.csv": _text(_HEAD + ",,", rows=_rows()),
    "quoted.csv": _text(
        '"time [s]","acc [m/s^2]"', rows=[f'"{r}"' for r in _rows('","')]
    ),
    "spaces_in_cells.csv": _text("time [s] ,  acc [m/s^2]", rows=_rows(" ,  ")),
    "preamble.csv": _text(
        "Logger 7, serial 00123", "Start time,2024-05-01 12:00", "", _HEAD, rows=_rows()
    ),
    "comments.csv": _text("# made by a logger", "# t [s], acc [m/s^2]", rows=_rows()),
    "savetxt.txt": _text("# time[s] acc[m/s^2]", rows=_rows(" ")),
    "utf16.csv": _text("time [s],acc [m/s²]", rows=_rows(), encoding="utf-16"),
    "utf16_bare.csv": _text("time [s],acc [m/s²]", rows=_rows(), encoding="utf-16-le"),
    "latin1.csv": _text("Zeit [s];Größe acc [m/s²]", rows=_rows(";"), encoding="latin-1"),
    "bom.csv": _text(_HEAD, rows=_rows(), encoding="utf-8-sig"),
    "rate_above.csv": _text(
        "Sampling rate: 1000 Hz", "", "acc [m/s^2]", rows=[f"{x:.9f}" for x in X]
    ),
    "step_above.csv": _text("dt;0,001 s", "acc [m/s^2]", rows=[f"{x:.9f}" for x in X], comma=True),
    "iso.csv": _text("time,acc [m/s^2]", rows=_stamped("%Y-%m-%dT%H:%M:%S", ",")),
    "dotted.csv": _text("Datum;acc [m/s^2]", rows=_stamped("%d.%m.%Y %H:%M:%S", ";", ",")),
    "clock.csv": _text(
        "time,acc [m/s^2]",
        rows=[f"12:00:00.{i:03d},{x:.9f}" for i, x in enumerate(X)],
    ),
    "date_and_clock.txt": _text(
        "date time acc[m/s^2]", rows=_stamped("%Y-%m-%d %H:%M:%S", " ")
    ),
    "counter.csv": _text(
        "Sample,Time (s),Accel (m/s^2),Force (N)",
        rows=[f"{i},{row},{0.1 * i:.3f}" for i, row in enumerate(_rows())],
    ),
}  # fmt: skip


def _npz(**arrays: Any) -> Writer:
    return lambda path: np.savez(path, **arrays)


def _mat(**arrays: Any) -> Writer:
    return lambda path: savemat(path, arrays)


def _cell() -> np.ndarray:
    cell = np.empty(2, object)
    cell[0], cell[1] = "first run", {"acc": X}
    return cell


def _wav(dtype: str) -> Writer:
    """Full scale is 16 m/s^2, which no WAV file says."""

    def write(path: Path) -> None:
        full = 1.0 if dtype.startswith("f") else 2.0 ** (8 * np.dtype(dtype).itemsize - 1)
        wavfile.write(path, int(RATE), np.asarray(X / 16 * full).astype(dtype))

    return write


def _uff(binary: int, even: bool = True) -> Writer:
    def write(path: Path) -> None:
        function = pyuff.prepare_58(
            binary=binary, func_type=1, rsp_node=7, rsp_dir=3, ref_node=0, ref_dir=0,
            abscissa_spacing=int(even), abscissa_min=0.0, abscissa_inc=1 / RATE, num_pts=len(X),
            abscissa_spec_data_type=17, ordinate_spec_data_type=12,
            ordinate_axis_units_lab="m/s^2", data=X, x=T, ord_data_type=4,
            id1="run", id2="NONE", id3="NONE", id4="NONE", id5="NONE",
            rsp_ent_name="NONE", ref_ent_name="NONE", orddenom_spec_data_type=0,
            z_axis_spec_data_type=0, ver_num=0, load_case_id=0, z_axis_value=0.0,
            **{f"{axis}_{kind}_unit_exp": 0 for kind in ("len", "force", "temp")
               for axis in ("abscissa", "ordinate", "orddenom", "z_axis")},
        )  # fmt: skip
        path.unlink(missing_ok=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)  # pyuff leaves the file open
            pyuff.UFF(str(path)).write_sets(function, "add")  # "overwrite" loses binary samples

    return write


def _uff_55(path: Path) -> None:
    """Transient data at two nodes, one dataset for every instant, as the manual has the records."""
    with path.open("w") as file:
        for i, (t, x) in enumerate(zip(T, X, strict=True)):
            file.write(f"{-1:6d}\n{55:6d}\n" + "NONE\n" * 5)
            file.write("".join(f"{n:10d}" for n in (1, 4, 2, 12, 2, 3)) + "\n")
            file.write("".join(f"{n:10d}" for n in (2, 1, 1, i + 1)) + "\n")
            file.write(f"{t:13.5e}\n")
            file.write(f"{7:10d}\n{x:13.5e}{0:13.5e}{0:13.5e}\n{-1:6d}\n")


def _tdms(path: Path) -> None:
    properties = {"wf_increment": 1 / RATE, "wf_start_offset": 0.0, "unit_string": "m/s^2"}
    channel = nptdms.ChannelObject("test", "acc", X, properties)
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([channel])


def _lvm(columns: str = "One", comma: bool = False) -> Writer:
    def write(path: Path) -> None:
        top = {
            "LabVIEW Measurement": "", "Writer_Version": "2", "Reader_Version": "2",
            "Separator": "Tab", "Decimal_Separator": "," if comma else ".", "Multi_Headings": "Yes",
            "X_Columns": columns, "Time_Pref": "Relative", "Date": "2024/05/01",
            "Time": "12:00:00,5" if comma else "12:00:00.5", "***End_of_Header***": "",
        }  # fmt: skip
        lines = ["\t".join(pair) for pair in top.items()]
        for part in np.split(np.arange(len(T)), 2):
            lines += _lvm_part(part, columns)
        text = "\n".join(lines) + "\n"
        path.write_text(text.replace(".", ",").replace("***,", "***.") if comma else text)

    return write


def _lvm_part(part: np.ndarray, columns: str) -> list[str]:
    start = f"12:00:00.{500_000 + round(1e6 * T[part[0]]):06d}"
    header = {
        "Channels": "1", "Samples": str(len(part)), "Date": "2024/05/01", "Time": start,
        "Y_Unit_Label": "m/s^2", "X_Dimension": "Time", "X0": "0.0E+0", "Delta_X": "0.001",
        "***End_of_Header***": "", "X_Value": "Acceleration\tComment",
    }  # fmt: skip
    lines = ["", *("\t".join(pair) for pair in header.items())]
    times = [""] * len(part) if columns == "No" else [f"{t:.6f}" for t in T[: len(part)]]
    return lines + [f"{t}\t{X[i]:.9f}" for t, i in zip(times, part, strict=True)]


def _abaqus(path: Path) -> None:
    """An XY report, with the row at the end of a step twice, and a name on two lines."""
    rows = [f"{a:>24.7E}{b:>24.7E}" for a, b in zip(T, X, strict=True)]
    rows.insert(300, rows[300])
    head = [f"{'X':>24}{'A:A2 PI: BEA':>24}", f"{'M-1 N: 21':>48}", ""]
    path.write_text("\n".join(["", *head, *rows, "", f"{'Minimum':>24}{X.min():>24.7E}", ""]))


def _xlsx(start: datetime.datetime | None = None) -> Writer:
    def write(path: Path) -> None:
        book = openpyxl.Workbook()
        sheet = book.active
        sheet.append(["Test of a beam"])
        sheet.append(["time" if start else "time [s]", "acc [m/s^2]"])
        for t, x in zip(T, X, strict=True):
            stamp = start and start + datetime.timedelta(seconds=float(t))
            sheet.append([stamp or float(t), float(x)])
        book.create_sheet("notes").append(["none"])
        book.save(path)

    return write


def _h5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        group = file.create_group("run1")
        group.attrs["fs"] = RATE
        group.create_dataset("acc", data=X, compression="gzip").attrs["unit"] = "m/s^2"


def _mat73(path: Path) -> None:
    """As MATLAB writes s.t, s.acc and a cell: transposed, with references."""
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("#refs#/a", data=X[None])
        file.create_dataset("s/t", data=T[None])
        cell = file.create_dataset("acc", (1, 1), dtype=h5py.ref_dtype)
        cell[0, 0] = file["#refs#/a"].ref
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        unit = np.frombuffer("m/s^2".encode("utf-16-le"), np.uint16)
        file.create_dataset("unit", data=unit[:, None]).attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(508) + b"\x00\x02IM")


_RECORDS = np.rec.fromarrays([T, X], names="time, acc")
_WAV = {"unit": "m/s^2", "scale": 16.0}
_UNIT = {"unit": "m/s^2"}
_SIMULINK = {"time": T, "signals": {"values": X, "dimensions": 1, "label": "acc"}}
# Name of the file: writer, arguments that its reader needs, largest error relative to the largest
# sample (text of nine decimals, single precision, 16 bits).
DRESSES: dict[str, tuple[Writer, dict[str, Any], float]] = {
    **{name: (writer, {}, 5e-10) for name, writer in _TEXTS.items()},
    "table.npy": (lambda path: np.save(path, np.stack([T, X], axis=1)), _UNIT, 0.0),
    "transposed.npy": (lambda path: np.save(path, np.stack([T, X])), _UNIT, 0.0),
    "records.npy": (lambda path: np.save(path, _RECORDS), _UNIT, 0.0),
    "named.npz": (_npz(t=T, acc=X, unit="m/s^2"), {}, 0.0),
    "rate.npz": (_npz(acc=X, fs=RATE), _UNIT, 0.0),
    "step.npz": (_npz(a=X, dt=1 / RATE), _UNIT, 0.0),
    "matrix.npz": (_npz(data=np.stack([T, X], axis=1)), _UNIT, 0.0),
    "column.mat": (_mat(t=T[:, None], acc=X[:, None], unit="m/s^2"), {}, 0.0),
    "struct.mat": (_mat(s={"data": {"acc": X, "time": T}, "info": "x"}), _UNIT, 0.0),
    "cell.mat": (_mat(runs=_cell(), Fs=RATE), _UNIT, 0.0),
    "tout.mat": (_mat(tout=T[:, None], yout=X[:, None]), _UNIT, 0.0),
    "simulink.mat": (_mat(yout=_SIMULINK), _UNIT, 0.0),
    "timeseries.mat": (_mat(ts={"Name": "acc", "Time": T, "Data": X}), _UNIT, 0.0),
    "v73.mat": (_mat73, {}, 0.0),
    "group.h5": (_h5, {}, 0.0),
    "int16.wav": (_wav("i2"), _WAV, 5e-5),
    "int32.wav": (_wav("i4"), _WAV, 1e-9),
    "float.wav": (_wav("f4"), _WAV, 1e-7),
    "ascii.uff": (_uff(0), {}, 1e-11),
    "uneven.uff": (_uff(0, even=False), {}, 1e-11),
    "binary.uff": (_uff(1), {}, 0.0),
    "transient.unv": (_uff_55, _UNIT, 1e-5),
    "waveform.tdms": (_tdms, {}, 0.0),
    "report.rpt": (_abaqus, _UNIT, 5e-8),
    "one.lvm": (_lvm(), {}, 2e-10),
    "no_x.lvm": (_lvm("No"), {}, 2e-10),
    "comma.lvm": (_lvm(comma=True), {}, 2e-10),
    "numbers.xlsx": (_xlsx(), {}, 1e-15),
    "stamps.xlsx": (_xlsx(datetime.datetime(2024, 5, 1, 12)), {}, 1e-15),
}
