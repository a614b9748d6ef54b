"""Print every number that fits by simulation promise, beside what was measured.

    python benchmarks/uncertainty.py [--data FOLDER] [--seeds 20] [--coverage 200] [--jobs 1]

Parts: the backbone of refined models, adequacy of right and wrong structures, coverage of the
95 % intervals, speed, and measured decays (where their folder is named).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np
from joblib import Parallel, delayed

import romsindy as rs
from romsindy.physics.example import EXAMPLE_MODEL

AMPLITUDES = np.linspace(0.1, 1.75, 60)
RIGHT = rs.ROMLibrary(inertia=(3, 4, 5), stiffness=(1, 2, 3, 4, 5), damping=("linear",))
WRONG = {
    "stiffness-only, order 5": rs.ROMLibrary((), (1, 2, 3, 4, 5), ("linear",)),
    "IC-ROM, order 3": rs.ROMLibrary((3,), (1, 2, 3), ("linear",)),
}

Row = tuple[str, str, str]  # what, measured, asked for


def regressed(library: rs.ROMLibrary, decay: rs.Decay) -> rs.ReducedModel:
    return rs.HarmonicSINDy(library).fit(decay).model_


def backbone_error(model: rs.ReducedModel) -> float:
    exact = EXAMPLE_MODEL.backbone(AMPLITUDES)
    return float(np.median(np.abs(model.backbone(AMPLITUDES) / exact - 1)))


def refined(seeds: Sequence[int]) -> Iterator[Row]:
    """Backbone and adequacy at 35 dB, from the regression's own result."""
    errors, before, ratios, rejected = [], [], [], 0
    wrong: dict[str, list[rs.Fit]] = {name: [] for name in WRONG}
    for seed in seeds:
        decay = rs.example_decay(snr_db=35, seed=seed)
        start = regressed(RIGHT, decay)
        fit = rs.refine(start, decay)
        errors.append(backbone_error(fit.model))
        before.append(backbone_error(start))
        ratios.append(fit.adequacy)
        rejected += not fit.verdict.explained
        for name, library in WRONG.items():
            wrong[name].append(rs.refine(regressed(library, decay), decay))
    n = len(seeds)
    yield f"median backbone error of regression, {n} seeds, worst", f"{max(before):.1e}", "-"
    yield "the same after refinement, worst seed", f"{max(errors):.1e}", "at most 5e-5"
    yield "the same, median seed", f"{np.median(errors):.1e}", "at most 2e-5"
    yield "adequacy, right structure", f"{min(ratios):.3f} to {max(ratios):.3f}", "0.97 to 1.03"
    yield "right structure called not explained", f"{rejected} of {n}", "1 in 100"
    for name, fits in wrong.items():
        ratio = min(f.adequacy for f in fits)
        unexplained = sum(not f.verdict.explained for f in fits)
        yield f"adequacy, {name}, least", f"{ratio:.2f}", "above 2"
        yield f"{name} called not explained", f"{unexplained} of {n}", "every seed"


def inside(seed: int, snr_db: float) -> dict[str, bool]:
    """Which coefficients lie in their 95 % interval, for one noise seed."""
    fit = rs.refine(EXAMPLE_MODEL, rs.example_decay(snr_db=snr_db, seed=seed))
    truth, found = EXAMPLE_MODEL.coefficients, fit.model.coefficients
    return {k: abs(found[k] - truth[k]) < 1.96 * s for k, s in fit.standard_errors.items()}


def coverage(seeds: Sequence[int], snr_db: float, jobs: int) -> Iterator[Row]:
    results = Parallel(n_jobs=jobs)(delayed(inside)(seed, snr_db) for seed in seeds)
    for name in results[0]:
        share = 100 * np.mean([r[name] for r in results])
        yield (
            f"coverage of {name}, {snr_db:g} dB, {len(seeds)} seeds",
            f"{share:.1f} %",
            "92 to 98 %",
        )


def speed() -> Iterator[Row]:
    """25 s at 1 kHz, 8 coefficients, 154 cycles as the paper's beam has."""
    scale = 38.5 / 6
    fast = {"omega^2": 36 * scale**2, "gamma_2": 2 * scale**2, "gamma_3": 9 * scale**2}
    slow = {"Upsilon_3": 0.3, "Upsilon_4": 0.05, "Upsilon_5": 0.12, "c_linear": 0.06 * scale}
    model = rs.ReducedModel.from_coefficients({**fast, "gamma_4": 0.0, **slow}, unit="m")
    clean = model.simulate(1.8, 0.0, np.arange(25_000) * 1e-3)
    decay = rs.add_noise(rs.Decay(clean.t, clean.q, unit="m"), 35, seed=0)
    rs.refine(model, decay)
    began = time.perf_counter()
    rs.refine(model, decay)
    yield "one refine, 25 s at 1 kHz, 8 coefficients", f"{time.perf_counter() - began:.2f} s", "2 s"


def clamped_beam(data: Path) -> Iterator[Row]:
    """Two runs of the same mode: which coefficient moved between them?"""
    archive = np.load(data / "cc_beam_bristol.npz")
    library = rs.ROMLibrary((3,), (1, 2, 3), ("linear", "quadratic"))
    fits = {}
    for run in ("mode1b", "mode1a"):
        decay = rs.Decay.from_velocity(archive[f"{run}_t"], archive[f"{run}_v"], unit="m")
        fits[run] = rs.refine(regressed(library, decay), decay)
        yield f"{run}: residual over noise", f"{fits[run].adequacy:.2f}", "reported"
        yield f"{run}: verdict", str(fits[run].verdict), "reported"
    errors = [f.standard_errors for f in fits.values()]
    for name in fits["mode1b"].free:
        a, b = (f.model.coefficients[name] for f in fits.values())
        spread = np.hypot(errors[0][name], errors[1][name])
        text = f"{a:.4g} +- {errors[0][name]:.2g}, {b:.4g} +- {errors[1][name]:.2g}"
        yield f"clamped beam, {name}", f"{text}: {abs(a - b) / spread:.1f} sigma", "omega^2 moved"


def pendulum(data: Path) -> Iterator[Row]:
    """Three releases together; they start where the README of the data says."""
    archive = np.load(data / "pendulum_free_swing.npz")
    decays = []
    for angle, start in ((45, 0.29), (90, 0.54), (135, 0.41)):
        theta = np.deg2rad(archive[f"release_{angle}deg_theta_deg"])
        t = np.arange(len(theta)) / float(archive["fs"])
        decays.append(rs.Decay(t, theta, unit="rad").free(start=start))
    library = rs.ROMLibrary((), (1, 3, 5, 7), ("linear", "coulomb"))
    start_model = rs.HarmonicSINDy(library).fit(decays).model_
    fit = rs.refine(start_model, decays, offset=True)
    rms = np.rad2deg(np.sqrt(np.mean(np.concatenate(fit.residuals) ** 2)))
    for name, asked in (("c_coulomb", 1.98), ("c_linear", 0.224)):
        value = f"{fit.model.coefficients[name]:.3f} +- {fit.standard_errors[name]:.3f}"
        yield f"pendulum, {name}", value, f"{asked:g} within 20 %"
    yield "pendulum, rms of three releases", f"{rms:.2f} degrees", "at most 0.7"


@click.command()
@click.option("--data", type=click.Path(path_type=Path, exists=True), help="Measured decays.")
@click.option("--seeds", default=20, show_default=True)
@click.option("--coverage", "n_coverage", default=200, show_default=True)
@click.option("--jobs", default=1, show_default=True)
def main(data: Path | None, seeds: int, n_coverage: int, jobs: int) -> None:
    """Print what is promised and what was measured."""
    parts = [refined(range(seeds)), speed()]
    parts += [coverage(range(1000, 1000 + n_coverage), db, jobs) for db in (40.0, 30.0)]
    if data is not None:
        parts += [clamped_beam(data), pendulum(data)]
    for part in parts:
        for what, measured, asked in part:
            click.echo(f"{what:56} {measured:>24}    ({asked})")


if __name__ == "__main__":
    main()
