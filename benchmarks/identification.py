"""Every number of the identification: print them with ``python benchmarks/identification.py``.

``--forms`` compares the weak and the strong form over noise levels, ``--data FOLDER`` names the
folder of measured decays. Seeds are fixed: the same command gives the same numbers, but for times.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pysindy as ps
from scipy.special import ellipk
from sklearn.linear_model import LinearRegression
from timing import fastest

import romsindy as rs
from romsindy.physics.example import EXAMPLE_MODEL

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
# A straight beam between clamps is symmetric: odd terms alone.
ODD = rs.ROMLibrary(inertia=(3, 5), stiffness=(1, 3, 5))
AMPLITUDES = np.geomspace(0.05, 1.7, 100)


def backbone_error(model: rs.ReducedModel) -> float:
    """Median relative error against the exact backbone of the example oscillator."""
    exact = EXAMPLE_MODEL.backbone(AMPLITUDES)
    return float(np.nanmedian(np.abs(model.backbone(AMPLITUDES) / exact - 1)))


def identified(decay: rs.Decay, **settings: object) -> rs.ReducedModel:
    return rs.HarmonicSINDy(**settings).fit(decay).model_


def bare(decay: rs.Decay) -> rs.Decay:
    return rs.Decay(decay.t, decay.q, unit=decay.unit)


def oscillator(seeds: Sequence[int] = range(10)) -> dict[str, tuple[float, float]]:
    """Median backbone error of the identified model: name to (measured, asked for)."""
    clean = rs.example_decay()
    noisy = [rs.example_decay(35.0, seed) for seed in seeds]
    return {
        "clean, q q_dot q_ddot given": (backbone_error(identified(clean)), 1e-6),
        "clean, displacement alone": (backbone_error(identified(bare(clean))), 2e-5),
        "35 dB, worst seed": (max(backbone_error(identified(d)) for d in noisy), 6e-4),
    }


def other_recipes(seeds: Sequence[int] = range(10)) -> dict[str, float]:
    """Worst backbone error at 35 dB of other settings on the same decays."""
    noisy = [rs.example_decay(35.0, seed) for seed in seeds]
    plain = {"optimizer": LinearRegression(), "weighted": False}
    recipes = {
        "stiffness polynomial": {"library": rs.ROMLibrary(inertia=())},
        "stiffness polynomial, harmonics 0-5, unweighted (the paper)": plain
        | {"library": rs.ROMLibrary(inertia=()), "projection": rs.HarmonicProjection(range(6))},
        "IC-ROM, harmonics 0-5, unweighted (the paper)": plain
        | {"projection": rs.HarmonicProjection(range(6))},
        "IC-ROM, harmonics 0-3, unweighted": plain,
        "IC-ROM, low-pass at six times the fundamental": {"differentiation": rs.Butterworth(5.7)},
        "IC-ROM, Savitzky-Golay 31/5": {"differentiation": rs.SavitzkyGolay()},
    }
    return {
        name: max(backbone_error(identified(d, **settings)) for d in noisy)
        for name, settings in recipes.items()
    }


def forms(seeds: Sequence[int] = range(10)) -> dict[tuple[float, str, str], float]:
    """Median over seeds of the backbone error by noise level, form and filter."""
    filters = {"Butterworth": rs.Butterworth(), "Savitzky-Golay": rs.SavitzkyGolay()}
    table = {}
    for snr in (30.0, 35.0, 40.0, 50.0, 60.0):
        noisy = [rs.example_decay(snr, seed) for seed in seeds]
        for label, method in filters.items():
            for form in ("weak", "strong"):
                settings = {
                    "projection": rs.HarmonicProjection(form=form),
                    "differentiation": method,
                }
                errors = [backbone_error(identified(d, **settings)) for d in noisy]
                table[snr, form, label] = float(np.median(errors))
    return table


def extracted(seeds: Sequence[int] = range(10)) -> dict[str, tuple[float, float]]:
    """Error of the backbone that is read off the decay."""

    def errors(decay: rs.Decay) -> np.ndarray:
        b = rs.extract_backbone(decay)
        inside = (b.amplitude > AMPLITUDES[0]) & (b.amplitude < AMPLITUDES[-1])
        return np.abs(b.frequency / EXAMPLE_MODEL.backbone(b.amplitude) - 1)[inside]

    clean = errors(bare(rs.example_decay()))
    noisy = max(float(np.median(errors(rs.example_decay(35.0, s)))) for s in seeds)
    return {
        "extracted, clean, max": (float(clean.max()), 2e-4),
        "extracted, 35 dB, median, worst seed": (noisy, 1e-3),
    }


def plain_sindy() -> dict[str, tuple[float, float]]:
    """Largest relative coefficient error of plain PySINDy with our library, time domain."""
    model = ps.SINDy(
        feature_library=rs.ROMLibrary(stiffness=(1, 2, 3)),
        optimizer=rs.ScaledOptimizer(ps.STLSQ(threshold=1e-4, alpha=1e-12)),
    )
    decay = rs.example_decay()
    model.fit(t=decay.t, **rs.implicit_data(decay))
    keys = [term.key for term in rs.ROMLibrary(stiffness=(1, 2, 3)).terms]
    truth = np.array([EXAMPLE_MODEL.coefficients[key] for key in keys])
    error = np.abs(model.coefficients()[0] / truth - 1).max()
    return {"plain ps.SINDy + ROMLibrary, worst coefficient": (float(error), 1e-3)}


def clamped_beam(folder: Path) -> dict[str, tuple[float, str]]:
    """The measured clamped-clamped beam: odd terms, low-pass at 300 Hz, the same for both runs."""
    file = folder / "cc_beam_bristol.npz"
    results: dict[str, tuple[float, str]] = {}
    for run in ("mode1b", "mode1a"):
        decay = rs.load_decay(file, "m/s", column=f"{run}_v", time=f"{run}_t")
        backbone = rs.extract_backbone(decay)
        model = identified(decay, library=ODD, differentiation=rs.Butterworth(300.0))
        error = model.backbone(backbone.amplitude) / backbone.frequency - 1
        hz = backbone.frequency / (2 * np.pi)
        results |= {
            f"{run}: first frequency, Hz": (hz[0], "about 100" if run == "mode1b" else "-"),
            f"{run}: last frequency, Hz": (hz[-1], "46.8" if run == "mode1b" else "-"),
            f"{run}: f0 of the model, Hz": (
                model.coefficients["omega^2"] ** 0.5 / (2 * np.pi),
                "46.0 to 47.0" if run == "mode1b" else "-",
            ),
            f"{run}: model against extracted, rms %": (
                100 * float(np.sqrt(np.mean(error**2))), "at most 1",
            ),
            f"{run}: the same, first five cycles left out, rms %": (
                100 * float(np.sqrt(np.mean(error[5:] ** 2))),
                "-",
            ),
        }  # fmt: skip
    decay = rs.load_decay(file, "m/s", column="mode3_v", time="mode3_t")
    backbone = rs.extract_backbone(decay)
    sure = backbone.frequency_std < 0.01 * backbone.frequency
    hz = backbone.frequency[sure] / (2 * np.pi)
    results["mode3: cycles known to 1 %"] = (float(sure.sum()), "-")
    results["mode3: first frequency, Hz"] = (hz[0], "-")
    results["mode3: median of the last 50, Hz"] = (float(np.median(hz[-50:])), "-")
    return results


def pendulum_decays(folder: Path) -> list[rs.Decay]:
    file = folder / "pendulum_free_swing.npz"
    return [
        rs.load_decay(file, "deg", column=f"release_{a}deg_theta_deg", rate=1000.0)
        for a in (45, 90, 135)
    ]


def pendulum(folder: Path) -> dict[str, tuple[float, str]]:
    """Three releases fitted together with an odd stiffness polynomial and two dampings."""
    library = rs.ROMLibrary((), (1, 3, 5), ("linear", "coulomb"))
    model = rs.HarmonicSINDy(library).fit(pendulum_decays(folder)).model_
    angles = np.deg2rad(np.linspace(5, 90, 86))
    exact = np.pi * 2 * np.pi * 1.745 / (2 * ellipk(np.sin(angles / 2) ** 2))
    f0 = model.coefficients["omega^2"] ** 0.5 / (2 * np.pi)
    error = float(np.max(np.abs(model.backbone(angles) / exact - 1)))
    return {
        "pendulum: linear frequency off 1.745 Hz, %": (100 * (f0 / 1.745 - 1), "0.5"),
        "pendulum: backbone to 90 degrees, max %": (100 * error, "1"),
        "pendulum: dry friction, rad/s^2": (model.coefficients["c_coulomb"], "-"),
        "pendulum: viscous damping, 1/s": (model.coefficients["c_linear"], "-"),
    }


def speed() -> dict[str, tuple[float, str]]:
    """Times, ours and plain PySINDy's side by side."""
    decay = rs.example_decay(periods=150, samples=333)
    library = rs.ROMLibrary((3, 4, 5), (1, 2, 3, 4, 5), ("linear", "quadratic"))
    x = np.stack([decay.q, decay.q_dot, decay.q_ddot], axis=1)

    def plain() -> None:
        optimizer = ps.STLSQ(threshold=1e-4, alpha=1e-12)
        ps.SINDy(feature_library=library, optimizer=optimizer).fit(
            t=decay.t, **rs.implicit_data(decay)
        )

    estimator = rs.HarmonicSINDy(library)
    ours, theirs = fastest(lambda: estimator.fit(x, decay.t)), fastest(plain)
    w2 = (2 * np.pi * 6) ** 2
    model = rs.ReducedModel.from_coefficients(
        {"omega^2": w2, "gamma_3": 0.1 * w2, "Upsilon_3": 0.3, "Upsilon_5": 0.1, "c_linear": 0.06}
    )
    t = np.arange(40001) / 1000
    off = np.abs(model.simulate(1.0, 0.0, t).q - model.simulate(1.0, 0.0, t, rtol=1e-13).q).max()
    return {
        f"fit of {len(decay.t)} samples, {len(library.terms)} terms, s": (ours, "-"),
        "plain ps.SINDy on the same columns, s": (theirs, "-"),
        "ratio": (ours / theirs, "2"),
        "simulate 40 s at 6 Hz, s": (fastest(lambda: model.simulate(1.0, 0.0, t)), "0.3"),
        "  its error": (float(off), "1e-6"),
    }


def _print(title: str, table: dict) -> None:
    print(f"\n{title}")
    for name, value in table.items():
        number, asked = value if isinstance(value, tuple) else (value, "-")
        print(f"  {name:<62} {number:>11.4g}   asked: {asked}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--forms", action="store_true", help="weak against strong form, and stop")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of measured decays")
    options = parser.parse_args()
    if options.forms:
        print("Median over 10 seeds of the median backbone error")
        for (snr, form, method), error in forms().items():
            print(f"  {snr:.0f} dB  {method:<15} {form:<7} {error:.2e}")
        return
    _print("Synthetic oscillator, model's median backbone error", oscillator())
    _print("Other recipes at 35 dB, worst of 10 seeds", other_recipes())
    _print("Extracted backbone", extracted())
    _print("Plain PySINDy", plain_sindy())
    if options.data.is_dir():
        _print("Clamped-clamped beam", clamped_beam(options.data))
        _print("Pendulum", pendulum(options.data))
    else:
        print(f"\nno measured decays: {options.data} is not a folder; name one with --data")
    _print("Speed", speed())


if __name__ == "__main__":
    main()
