"""Every number of continuation and periodic orbits: ``python benchmarks/continuation.py``.

AUTO-07p (Debian package ``auto-07p``, with gfortran) and PyCont-Lite (PyPI ``pycont-lite``) run
beside ours where they are installed. Times are the shortest of several runs.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.integrate import odeint, solve_ivp

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from oracles import ORDER_5, ORDER_9, duffing_frequency
from timing import fastest

import romsindy as rs
from romsindy.orbits.curves import BackboneCurve, ForcedResponse
from romsindy.physics.export import auto_function

AUTO_DIR = Path(os.environ.get("AUTO_DIR", "/usr/lib/auto-07p"))
LOW, HIGH = 0.01, 2.9
DUFFING = rs.ReducedModel.from_coefficients({"omega^2": 1.0, "gamma_3": 1.0})
exact_duffing = partial(duffing_frequency, 1.0, 1.0)
HARMONICS = (None, 3, 5, 11, 21, 41)
FORCED = {"omega^2": 1.0, "gamma_3": 1.0, "c_linear": 0.02}
FORCE = 0.1
# Mode 1 hardens, meets mode 2 at three times its frequency, and goes through a tongue there.
TONGUE = rs.CoupledModel.from_coefficients(
    {
        "omega^2 [q1]": 1.0,
        "omega^2 [q2]": 10.0,
        "gamma_3 [q1]": 1.0,
        "V q1^3 q2": 0.1,
        "V q1^2 q2^2": 1.5,
        "g(q1^2)^2": 0.05,
        "g(q1 q2)^2": 0.1,
    }
)


class Row(NamedTuple):
    """A branch: how many points, in how many seconds, how far from the exact frequency."""

    points: int
    seconds: float
    error: float
    residual: float = np.nan
    note: str = ""


def ours(
    model: rs.ReducedModel,
    amplitude: tuple[float, float],
    n_harmonics: int | None,
    exact: Callable,
    repeats: int = 5,
) -> Row:
    curve = rs.backbone_curve(model, amplitude, n_harmonics)
    error = np.max(np.abs(curve.frequency / exact(curve.amplitude) - 1))
    seconds = fastest(lambda: rs.backbone_curve(model, amplitude, n_harmonics), repeats)
    highest = curve.coefficients.shape[1] - 1
    note = f"{highest} harmonics, {curve.stop_reason}"
    return Row(len(curve), seconds, float(error), float(curve.residual.max()), note)


def duffing(repeats: int = 5) -> dict[str, Row]:
    """Duffing, amplitude 0.01 to 2.9, against the elliptic integral."""
    return {
        f"ours, harmonics {n or 'by themselves'}": ours(
            DUFFING, (LOW, HIGH), n, exact_duffing, repeats
        )
        for n in HARMONICS
    }


def icrom(repeats: int = 5) -> dict[str, Row]:
    """IC-ROMs of orders to 5 and to 9, asymmetric, against energy quadrature."""
    rows = {}
    for order, coefficients in ((5, ORDER_5), (9, ORDER_9)):
        model = rs.ReducedModel.from_coefficients(coefficients)
        for n in HARMONICS:
            name = f"order {order}, harmonics {n or 'by themselves'}"
            rows[name] = ours(model, (1e-4, 0.022), n, model.backbone, repeats)
    return rows


# -- AUTO-07p ---------------------------------------------------------------------------------

_COMMON = (
    "NDIM=2, ILP=0, NCOL=4, IAD=3, ISW=1, IPLT=0, NBC=0, NINT=0, MXBF=0, IID=0, ITMX=9, ITNW=5,"
    " NWTN=3, JAC=0, EPSL=1e-9, EPSU=1e-9, EPSS=1e-6, IADS=1, DSMIN=1e-5\n"
)
# A rest that loses stability by negative damping; the orbits that grow out of it are conservative.
_REST = "IPS=1, IRS=0, ICP=[1], NTST=20, ISP=2, NMX=20, NPR=20, DS=0.02, DSMAX=0.05, RL1=0.1\n"
_ORBITS = "IPS=2, IRS=2, ICP=[1,11], NTST={}, ISP=0, NMX=2000, NPR=5000, DS=0.01, DSMAX=0.1, A1=8\n"


def auto_07p(intervals: int, repeats: int = 5) -> Row | None:
    """AUTO on the Duffing backbone, without the time to compile; None where it is absent."""
    compiler, objects = shutil.which("gfortran"), sorted(AUTO_DIR.glob("lib/*.o"))
    if compiler is None or not objects:
        return None
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)

        def run(constants: str) -> None:
            (here / "fort.2").write_text(_COMMON + constants)
            subprocess.run([here / "duffing"], cwd=here, check=True, capture_output=True)

        (here / "duffing.f90").write_text(auto_function(DUFFING.pairs, "", DUFFING.coordinates))
        command = [compiler, "-O2", "-fopenmp", "duffing.f90", *objects, "-o", "duffing"]
        subprocess.run(command, cwd=here, check=True, capture_output=True)
        run(_REST)
        shutil.copy(here / "fort.8", here / "fort.3")
        seconds = fastest(lambda: run(_ORBITS.format(intervals)), repeats)
        rows = [line.split() for line in (here / "fort.7").read_text().splitlines()]
    values = np.array([row[5:] for row in rows if row[0] == "-2"], float)  # points of branch 2
    amplitude, period = values[:, 1], values[:, 3]
    inside = (amplitude >= LOW) & (amplitude <= HIGH)
    error = np.abs(2 * np.pi / period[inside] / exact_duffing(amplitude[inside]) - 1)
    note = f"{intervals} x 4 collocation points, amplitude read off the mesh"
    share = np.count_nonzero(inside) / len(amplitude)
    return Row(int(np.count_nonzero(inside)), seconds * share, float(error.max()), note=note)


# -- PyCont-Lite ------------------------------------------------------------------------------


def pycont_lite(n_harmonics: int = 15, repeats: int = 2) -> Row | None:
    """PyCont-Lite on our own harmonic balance by odd cosines; None where it is absent."""
    try:
        import pycont
    except ImportError:
        return None
    k = np.arange(1, n_harmonics + 1, 2)
    phase = np.pi * (np.arange(4 * n_harmonics) + 0.5) / (4 * n_harmonics)
    cosines = np.cos(np.outer(phase, k))

    def balance(u: np.ndarray, amplitude: float) -> np.ndarray:
        shape, omega = u[:-1], u[-1]
        q = amplitude * (cosines @ shape)
        force = q + q**3 - omega**2 * amplitude * (cosines @ (k**2 * shape))
        projected = 2 / len(phase) * (cosines.T @ force) / amplitude
        return np.append(projected, shape.sum() - 1)

    def run():  # type: ignore[no-untyped-def]
        settings = {
            "param_max": HIGH,
            "initial_directions": "increase_p",
            "bifurcation_detection": False,
            "analyze_stability": False,
            "tolerance": 1e-10,
        }
        start = np.append(np.eye(len(k))[0], 1.0)
        return pycont.arclengthContinuation(
            balance, start, LOW, 1e-4, 0.1, 0.01, 400, settings, "off"
        )

    branch = run().branches[0]
    # Its first point is the guess as given, uncorrected.
    amplitude, omega = np.asarray(branch.p_path)[1:], np.asarray(branch.u_path)[1:, -1]
    error = np.abs(omega / exact_duffing(amplitude) - 1).max()
    note = f"{n_harmonics} harmonics, our equations, amplitude to {amplitude.max():.3g}"
    return Row(len(amplitude), fastest(run, repeats), float(error), note=note)


# -- forced response --------------------------------------------------------------------------


def forced() -> dict[str, float]:
    """Duffing, zeta 1 %: folds and stability against integration in time by hand."""
    model = rs.ReducedModel.from_coefficients(FORCED)
    start = time.perf_counter()
    response = rs.forced_response(model, FORCE, (0.5, 2.6))
    seconds = time.perf_counter() - start
    sampled = np.linspace(0, len(response) - 1, 40).astype(int)
    agree = [
        (_largest_multiplier(*_state(response, i), response.frequency[i]) <= 1)
        == response.stable[i]
        for i in sampled
    ]
    upper, lower = response.folds
    return {
        "orbits": len(response),
        "orbits per second": len(response) / seconds,
        "folds": len(response.folds),
        "frequency of the upper fold, rad/s": response.frequency[upper],
        "  where integrated motions jump, less that": _jump(response, upper, 1)
        - response.frequency[upper],
        "frequency of the lower fold, rad/s": response.frequency[lower],
        "  where integrated motions jump, less this": _jump(response, lower, -1)
        - response.frequency[lower],
        "stability as integration of the variation finds it, of 40": sum(agree),
        "largest force left over": response.residual.max(),
    }


def _state(response: ForcedResponse, index: int) -> tuple[float, float]:
    c = response.coefficients[index]
    return c.real.sum(), float(np.sum(-np.arange(len(c)) * response.frequency[index] * c.imag))


def _largest_multiplier(q: float, v: float, omega: float) -> float:
    def rates(t: float, y: np.ndarray) -> list[float]:
        q, v, a, b, c, d = y
        stiff = -1 - 3 * q * q
        force = FORCE * np.cos(omega * t)
        return [
            v, -0.02 * v - q - q**3 + force, c, d, stiff * a - 0.02 * c, stiff * b - 0.02 * d
        ]  # fmt: skip

    period = (0, 2 * np.pi / omega)
    y = solve_ivp(rates, period, [q, v, 1, 0, 0, 1], "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    return float(np.abs(np.linalg.eigvals(y[2:].reshape(2, 2))).max())


def _jump(response: ForcedResponse, fold: int, side: int) -> float:
    """Frequency at which motions that start on the fold's orbit leave it, to 1e-4, by bisection."""
    amplitude, start = response.amplitude[fold], _state(response, fold)
    kept, left = response.frequency[fold] * np.array([1 - 5e-3 * side, 1 + 5e-3 * side])
    while abs(left - kept) > 1e-4:
        omega = (kept + left) / 2
        if abs(_settled(omega, *start) / amplitude - 1) < 0.3:
            kept = omega
        else:
            left = omega
    return float((kept + left) / 2)


def _settled(omega: float, q: float, v: float, periods: int = 600) -> float:
    t = 2 * np.pi / omega * np.append(np.arange(periods), periods + np.linspace(0, 1, 65))

    def rates(y: np.ndarray, s: float) -> tuple[float, float]:
        q, v = y.tolist()
        return v, -0.02 * v - q - q * q * q + FORCE * np.cos(omega * s)

    last = odeint(rates, [q, v], t, rtol=1e-9, atol=1e-10, mxstep=10000)[-65:, 0]
    return float(np.ptp(last) / 2)


# -- two coordinates --------------------------------------------------------------------------


def tongue(repeats: int = 5) -> dict[str, float]:
    """Two modes at 1:3, amplitude 0.01 to 1, with orbits integrated over one period."""
    curve = rs.backbone_curve(TONGUE, (LOW, 1.0))
    seconds = fastest(lambda: rs.backbone_curve(TONGUE, (LOW, 1.0)), repeats)
    sampled = np.linspace(0, len(curve) - 1, 20).astype(int)
    return {
        "orbits": len(curve),
        "orbits per second": len(curve) / seconds,
        "harmonics": curve.coefficients.shape[1] - 1,
        "folds": len(curve.folds),
        "crossings of mode 2": len(curve.crossings),
        "unstable orbits": np.count_nonzero(~curve.stable),
        "how far integrated orbits are off, of their amplitude": max(
            _integrated(curve, i) for i in sampled
        ),
        "largest force left over": curve.residual.max(),
    }


def _integrated(curve: BackboneCurve, index: int) -> float:
    t, q = curve.motion(index)
    motion = TONGUE.simulate(q[0], [0.0, 0.0], t, rtol=1e-12)
    return float(np.abs(motion.q - q).max() / curve.amplitude[index].max())


def _print(title: str, rows: dict[str, Row | None]) -> None:
    print(f"\n{title}")
    print(f"  {'':<34}{'points':>7}{'points/s':>10}{'frequency':>12}{'force left':>12}")
    for name, row in rows.items():
        if row is None:
            print(f"  {name:<34}   not installed")
            continue
        rate = row.points / row.seconds
        print(
            f"  {name:<34}{row.points:>7}{rate:>10.0f}{row.error:>12.1e}{row.residual:>12.1e}"
            f"  {row.note}"
        )


def main() -> None:
    print("frequency: largest relative error of any point, asked for: 1e-9, and 1000 points/s")
    print("force left: largest force that the harmonics leave in the equation, relative")
    peers = {f"AUTO-07p, {n} intervals": auto_07p(n) for n in (20, 50)}
    _print("Duffing", duffing() | peers | {"PyCont-Lite": pycont_lite()})
    _print("IC-ROM, asymmetric", icrom())
    for title, numbers in (
        ("Forced Duffing, zeta 1 %", forced()),
        ("Two modes at 1:3, asked for: 100 orbits per second", tongue()),
    ):
        print(f"\n{title}")
        for name, value in numbers.items():
            print(f"  {name:<60} {value:>11.5g}")


if __name__ == "__main__":
    main()
