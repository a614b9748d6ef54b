"""Diagnoses of measured decays: ship roll, pendulum, clamped beam.

    python benchmarks/diagnosis/measured.py ../shared/data

The folder holds kvlcc2_roll_decay.npz, pendulum_free_swing.npz and cc_beam_bristol.npz.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

import romsindy as rs
from romsindy.diagnosis.simulated import model_of_simulation
from romsindy.fit.refine import refine


def ship(folder: Path, run: str, start: float) -> tuple[rs.diagnosis.DiagnosisReport, float, float]:
    """Simulated roll decay against a measured run: report, envelope error before and after, deg.

    The envelope errors are those of the logarithmic decay cycle by cycle, over the amplitudes
    that simulation and measurement share.
    """
    content = np.load(folder / "kvlcc2_roll_decay.npz")
    name = "sim_fnpf_inviscid_0kn"
    simulated = rs.Decay(content[f"{name}_t"], content[f"{name}_phi"], unit="rad")
    name = f"test_{run}_0kn"
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="t is not uniform")
        test = rs.Decay(content[f"{name}_t"], content[f"{name}_phi"], unit="rad")
    test = test.between(start).free()
    known = model_of_simulation([simulated])
    report = rs.diagnose(known.model, test, tolerances=known.tolerances, floor=known.floor)
    backbone = rs.extract_backbone(test)
    low, high = known.model.amplitude_range
    shared = (backbone.amplitude > low) & (backbone.amplitude < high)
    errors = [
        np.rad2deg(_envelope_error(model, backbone, shared))
        for model in (known.model, report.model)
    ]
    return report, errors[0], errors[1]


def _envelope_error(model: rs.ReducedModel, backbone: rs.Backbone, shared: np.ndarray) -> float:
    """Rms difference of the envelopes, the model started at the first shared amplitude."""
    t, a = backbone.t[shared], backbone.amplitude[shared]
    grid = np.linspace(0, a.max() * 1.2, 200)[1:]
    zeta, omega = model.damping_ratio(grid), model.backbone(grid)
    said = [a[0]]
    for step in np.diff(t):
        rate = np.interp(said[-1], grid, zeta * omega)
        half = said[-1] * (1 - 0.5 * step * rate)
        said.append(said[-1] - step * half * np.interp(half, grid, zeta * omega))
    return float(np.sqrt(np.mean((np.array(said) - a) ** 2)))


def pendulum(folder: Path) -> tuple[rs.diagnosis.DiagnosisReport, float, float]:
    """Viscous model against three releases: report, rms error before and after, deg."""
    content = np.load(folder / "pendulum_free_swing.npz")
    swings = []
    for angle, start in ((45, 0.29), (90, 0.54), (135, 0.41)):
        q = np.deg2rad(content[f"release_{angle}deg_theta_deg"])
        swings.append(rs.Decay(np.arange(len(q)) / 1000, q, unit="rad").between(start))
    q = np.linspace(0, 2.6, 400)
    powers = np.arange(1, 12, 2)
    sine = np.linalg.lstsq(q[:, None] ** powers, np.sin(q), rcond=None)[0]
    names = ["omega^2", *(f"gamma_{p}" for p in powers[1:])]
    stiffness = dict(zip(names, sine * (2 * np.pi * 1.745) ** 2, strict=True))
    model = rs.ReducedModel.from_coefficients(stiffness | {"c_linear": 0.9}, unit="rad")
    report = rs.diagnose(model, swings, floor=0.01)
    fits = (report.base.solution.residuals, report.best.solution.residuals)
    before, after = (float(np.rad2deg(np.sqrt(np.mean(np.concatenate(r) ** 2)))) for r in fits)
    return report, before, after


def clamped_beam(folder: Path) -> tuple[rs.diagnosis.DiagnosisReport, float, float]:
    """Model of run b against run a: report, linear frequency before and after, Hz.

    Both without their first 0.6 s, in which the frequency falls from 100 to 65 Hz.
    """
    content = np.load(folder / "cc_beam_bristol.npz")
    runs = {}
    for run, skipped in (("a", 0.6), ("b", 0.85)):
        t, v = content[f"mode1{run}_t"], content[f"mode1{run}_v"]
        decay = rs.Decay.from_velocity(t, v, unit="m").free()
        runs[run] = decay.between(decay.t[0] + skipped)
    library = rs.ROMLibrary(inertia=(), stiffness=(1, 3, 5), damping=("linear", "quadratic"))
    model = refine(rs.HarmonicSINDy(library).fit(runs["b"]).model_, runs["b"]).model
    report = rs.diagnose(model, runs["a"], floor=0.01, max_effects=1)
    shift = report.base.solution.parts[0].strengths[0, 0]
    squares = model.coefficients["omega^2"] + np.array([0.0, shift])
    before, after = np.sqrt(squares) / (2 * np.pi)
    return report, float(before), float(after)


def beam_in_resonance(folder: Path) -> rs.diagnosis.DiagnosisReport:
    """Model of one mode against run b of the clamped beam, whose third mode takes part (1:5)."""
    file = folder / "cc_beam_bristol.npz"
    run = rs.load_decay(file, "m/s", column="mode1b_v", time="mode1b_t").free()
    known = {"omega^2": 8.3e4, "gamma_3": 2.2e11, "c_linear": 1.4}
    return rs.diagnose(rs.ReducedModel.from_coefficients(known, unit="m"), run)


def _ship_runs(folder: Path) -> list[rs.Decay]:
    content = np.load(folder / "kvlcc2_roll_decay.npz")
    runs = []
    for run, start in (("21338", 9.5), ("21337", 26.5)):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="t is not uniform")
            t, phi = (content[f"test_{run}_0kn_{k}"] for k in ("t", "phi"))
            runs.append(rs.Decay(t, phi, unit="rad").between(start).free())
    return runs


def _swing(folder: Path, angle: int, start: float) -> rs.Decay:
    content = np.load(folder / "pendulum_free_swing.npz")
    q = np.deg2rad(content[f"release_{angle}deg_theta_deg"])
    return rs.Decay(np.arange(len(q)) / 1000, q, unit="rad").between(start)


def _impacts(folder: Path, runs: tuple[int, ...]) -> list[rs.Decay]:
    """Hammer decays of the double beam, their first mode alone."""
    content = np.load(folder / "double_beam_train.npz")
    columns = [int(np.flatnonzero(content["run"] == r)[0]) for r in runs]
    v = sosfiltfilt(butter(4, [60, 180], "bandpass", fs=5120, output="sos"), content["v"], axis=0)
    return [rs.Decay.from_velocity(content["t"], v[:, c], unit="m") for c in columns]


# What stands for the simulation, what is measured, and further repeats of the same test.
REPEATS = {
    "ship 21338 and 21337": lambda f: _ship_runs(f),
    "ship 21337 and 21338": lambda f: _ship_runs(f)[::-1],
    **{
        f"pendulum {angle} degrees and itself": lambda f, a=angle, s=start: [_swing(f, a, s)] * 2
        for angle, start in ((45, 0.29), (90, 0.54), (135, 0.41))
    },
    **{
        f"double beam, runs {a}, {b}": lambda f, runs=(a, b, *rest): _impacts(f, runs)
        for a, b, *rest in ((1, 3, 4), (3, 4, 1), (5, 7, 8), (7, 8, 5), (9, 11, 12), (11, 12, 9))
    },
}


def against_repeat(name: str, folder: Path) -> Callable[[], rs.diagnosis.DiagnosisReport]:
    """Diagnosis of a run beside the model of another; of three, the spread of two is known.

    The first mode of the double beam is identified; the others are taken for a simulated file.
    """
    first, second, *third = REPEATS[name](folder)
    if third:
        known = rs.identify(first)
        return lambda: rs.diagnose(known, second, repeats=[first, *third])
    simulated = model_of_simulation([first])
    return lambda: rs.diagnose(
        simulated.model,
        second,
        tolerances=simulated.tolerances,
        floor=simulated.floor,
        reference=first,
    )


def main(folder: Path) -> None:
    for run, start in (("21338", 9.5), ("21337", 26.5)):
        report, before, after = ship(folder, run, start)
        print(f"ship, run {run}: envelope error {before:.3g} -> {after:.3g} degrees\n{report}\n")
    report, before, after = pendulum(folder)
    print(f"pendulum: rms {before:.3g} -> {after:.3g} degrees\n{report}\n")
    report, before, after = clamped_beam(folder)
    print(f"clamped beam: linear frequency {before:.4g} -> {after:.4g} Hz\n{report}\n")
    print(f"clamped beam, one mode: {beam_in_resonance(folder)}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
