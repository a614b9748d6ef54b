"""How well the right terms are found: ``python benchmarks/selection.py``, an hour on one core.

``oscillators`` and ``beam`` name a part, ``--seeds`` and ``--beam-seeds`` say how many noises,
``--jobs`` how many at once. Set OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed
from scipy.interpolate import CubicSpline

import romsindy as rs
from romsindy.physics.example import EXAMPLE_MODEL, add_noise
from romsindy.record.signals import with_noise
from romsindy.selection.candidates import describe

AMPLITUDES = np.linspace(0.1, 1.7, 60)


def random_oscillator(seed: int) -> rs.ReducedModel:
    """IC-ROM of order 5 in all terms, coefficients of the size of the example's, up to 2 m."""
    rng = np.random.default_rng(seed)
    q = np.linspace(-2, 2, 401)
    while True:
        model = rs.ReducedModel.from_coefficients(
            {
                "omega^2": 36.0,
                "gamma_2": rng.uniform(-4, 4),
                "gamma_3": rng.uniform(4, 14),
                "gamma_4": rng.uniform(-1.5, 1.5),
                "gamma_5": rng.uniform(-1.5, 1.5),
                "Upsilon_3": rng.uniform(0.1, 0.5),
                "Upsilon_4": rng.uniform(-0.1, 0.1),
                "Upsilon_5": rng.uniform(0.05, 0.2),
                "c_linear": rng.uniform(0.04, 0.08),
            },
            unit="m",
        )
        if np.all(np.diff(model.stiffness(q)) > 0) and np.all(model.inertia(q) > 0.5):
            return model


@dataclass(frozen=True)
class Trial:
    """What was found for one oscillator and one noise."""

    chosen: str
    exact: bool
    held: bool
    subset: bool
    equivalent: int
    adequacy: float
    explained: bool
    error: float
    seconds: float


def trial(truth: rs.ReducedModel, snr_db: float, seed: int) -> Trial:
    """Select from orders 3, 5, 7, 9 of inertia and stiffness and the dampings."""
    t = rs.example_decay().t
    decay = add_noise(truth.simulate(1.8, 0.0, t, rtol=1e-12), snr_db, seed)
    start = time.perf_counter()
    choice = rs.select_model(decay)
    seconds = time.perf_counter() - start
    right = set(truth.coefficients)
    found = set(choice.chosen.keys)
    held = any(right <= set(c.keys) for c in (choice.chosen, *choice.equivalent))
    error = choice.model.backbone(AMPLITUDES) / truth.backbone(AMPLITUDES) - 1
    return Trial(
        describe(sorted(found)),
        found == right,
        held,
        found < right,
        len(choice.equivalent),
        choice.fit.adequacy,
        choice.fit.verdict.explained,
        float(np.median(np.abs(error))),
        seconds,
    )


def oscillators(seeds: Sequence[int], jobs: int) -> None:
    """True order 5 hidden among orders 3 to 9 and the dampings, 30 to 40 dB."""
    levels = (30.0, 35.0, 40.0)
    for name, models in (
        ("random oscillators, all terms to order 5", [random_oscillator(s) for s in seeds]),
        ("example oscillator", [EXAMPLE_MODEL for _ in seeds]),
    ):
        tasks = [delayed(trial)(m, levels[s % 3], s) for m, s in zip(models, seeds, strict=True)]
        trials = Parallel(jobs)(tasks)
        _print_trials(name, seeds, trials)


def _print_trials(name: str, seeds: Sequence[int], trials: Sequence[Trial]) -> None:
    n = len(trials)
    print(f"\n{name}: {n} seeds, 30, 35, 40 dB in turn")
    for seed, t in zip(seeds, trials, strict=True):
        if not t.held or not t.explained:
            print(f"  seed {seed}: held {t.held}, explained {t.explained}, chosen {t.chosen}")
    show("true structure chosen, or not told apart and held", count(t.held for t in trials))
    show("true structure chosen exactly", count(t.exact for t in trials))
    show("part of the true structure chosen", count(t.subset for t in trials))
    show("chosen model explains the data", count(t.explained for t in trials))
    show("structures not told apart", median_worst([t.equivalent for t in trials]))
    show("backbone error of the chosen model", median_worst([t.error for t in trials]))
    show("time, s", median_worst([t.seconds for t in trials]), "20")


def count(flags: Iterable[bool]) -> str:
    values = list(flags)
    return f"{sum(values)} of {len(values)}"


def median_worst(values: Sequence[float]) -> str:
    return f"median {np.median(values):.3g}, largest {max(values):.3g}"


def show(what: str, found: str, asked: str = "") -> None:
    line = f"  {what:<56} {found:<32} {f'asked: {asked}' if asked else ''}"
    print(line.rstrip(), flush=True)


@dataclass(frozen=True)
class Experiment:
    """What was found for one noise on the sensors and the mode shapes of the beam."""

    chosen: str
    linear: float  # relative error of omega_1
    linear_std: float
    backbone: float  # relative error, rms over amplitudes
    scaled: float  # the same against q itself, which noisy mode shapes scale
    covered: float  # part of the amplitudes where the band of the choice holds the truth
    covered_fit: float  # the same for the band of the chosen model alone
    adequacy: float
    explained: bool
    equivalent: int
    seconds: float


@dataclass(frozen=True)
class Records:
    """Sensors of the beam without noise."""

    t: np.ndarray
    displacement: np.ndarray
    shapes: np.ndarray
    omega: float


def beam_records(elements: int) -> Records:
    """Default beam, released from a third of its length by a modal force; 25 s, five points."""
    beam = rs.Beam.cantilever(elements=elements)
    sensors = beam.sensors([0.03, 0.135, 0.24, 0.345, 0.45])
    motion = beam.simulate(beam.release_shape(0.15, mode=1), 25.0, sensors=sensors, progress=False)
    return Records(
        motion.t,
        sensors.measure(motion),
        sensors.mode_shapes(motion.basis, 3),
        float(motion.basis.omega[0]),
    )


def experiment(records: Records, seed: int) -> Experiment:
    """Identify mode 1 from noisy sensors and noisy mode shapes.

    The true backbone is extracted from the noise-free displacements, seen through the same mode
    shapes. The model's is extracted alike from its simulated decay: what extraction and damping do
    to a frequency then cancels.
    """
    decay, row = measured(records, seed)
    start = time.perf_counter()
    choice = rs.select_model(decay)
    seconds = time.perf_counter() - start
    own = decayed(choice.model, choice.fit.states[0], choice.fit.decays[0].t)
    amplitude, true = known(extracted(records.t, records.displacement @ row), own)
    off = own(amplitude) / true - 1
    # Against q itself, at its own amplitude.
    pure = np.linalg.pinv(records.shapes)[0]
    pure_amplitude, pure_true = known(extracted(records.t, records.displacement @ pure), own)
    band, band_fit = choice.band(amplitude), choice.fit.band(amplitude)
    omega = choice.model.coefficients["omega^2"] ** 0.5
    return Experiment(
        choice.chosen.name,
        omega / records.omega - 1,
        float(choice.band(1e-3 * amplitude.max()).frequency_std[0] / omega),
        float(np.sqrt(np.mean(off**2))),
        float(np.sqrt(np.mean((own(pure_amplitude) / pure_true - 1) ** 2))),
        float(np.mean(np.abs(off) * true <= 1.96 * band.frequency_std)),
        float(np.mean(np.abs(off) * true <= 1.96 * band_fit.frequency_std)),
        choice.fit.adequacy,
        choice.fit.verdict.explained,
        len(choice.equivalent),
        seconds,
    )


def measured(records: Records, seed: int) -> tuple[rs.Decay, np.ndarray]:
    """Mode 1 at 35 dB on displacements and shapes, and the row of the shapes that reads it."""
    row = np.linalg.pinv(with_noise(records.shapes, 35.0, 2 * seed + 1))[0]
    q = with_noise(records.displacement, 35.0, 2 * seed) @ row
    return rs.Decay(records.t, q, unit="kg^0.5 m"), row


def fidelity(
    records: Records,
    row: np.ndarray,
    model: rs.ReducedModel,
    band: Callable[[np.ndarray], rs.Band],
) -> list[float]:
    """|omega_1| off, backbone off (rms), share of it that the band holds, width of the band.

    All relative; the true backbone is seen through the same mode shapes, as in `experiment`.
    """
    q = records.displacement @ row
    own = decayed(model, np.array([q[0], 0.0]), records.t)
    amplitude, true = known(extracted(records.t, q), own)
    off, std = own(amplitude) / true - 1, band(amplitude).frequency_std / true
    linear = model.coefficients["omega^2"] ** 0.5 / records.omega - 1
    held = np.mean(np.abs(off) <= 1.96 * std)
    return [float(x) for x in (abs(linear), np.sqrt(np.mean(off**2)), held, std.mean())]


def decayed(model: rs.ReducedModel, start: np.ndarray, t: np.ndarray) -> CubicSpline:
    """Backbone of a model, extracted from its own decay."""
    simulated = model.simulate(*start, t)
    return extracted(simulated.t, simulated.q)


def extracted(t: np.ndarray, q: np.ndarray) -> CubicSpline:
    """Frequency (rad/s) over amplitude, read off a clean decay."""
    backbone = rs.extract_backbone(rs.Decay(t, q))
    order = np.argsort(backbone.amplitude)
    return CubicSpline(backbone.amplitude[order], backbone.frequency[order], extrapolate=False)


def known(truth: CubicSpline, model: CubicSpline) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes and frequencies of the true cycles that the model's decay covers."""
    inside = (truth.x >= model.x[0]) & (truth.x <= model.x[-1])
    return truth.x[inside], truth(truth.x[inside])


def beam(seeds: Sequence[int], jobs: int, elements: int) -> None:
    """Simulated experiment of the default beam: 5 points, 35 dB on displacements and shapes."""
    records = beam_records(elements)
    found = Parallel(jobs, verbose=1)(delayed(experiment)(records, s) for s in seeds)
    n = len(found)
    linear = np.array([e.linear for e in found])
    std = np.array([e.linear_std for e in found])
    print(f"\ndefault beam, {elements} elements, simulated experiment at 35 dB, {n} seeds")
    off = 100 * np.abs(linear)
    show("omega_1 off, %", f"mean {off.mean():.2g}, largest {off.max():.2g}", "mean 0.1")
    backbone, scaled = (
        median_worst([100 * getattr(e, name) for e in found]) for name in ("backbone", "scaled")
    )
    show("backbone off, rms, %", backbone, "0.2")
    show("the same against q without noise on the shapes, %", scaled)
    covered = [float(np.mean([getattr(e, k) for e in found])) for k in ("covered", "covered_fit")]
    show("95 % band holds the true backbone, of all amplitudes", f"{covered[0]:.1%}", "90 %")
    show("band of the chosen model alone", f"{covered[1]:.1%}")
    show("95 % interval holds omega_1", count(np.abs(linear) <= 1.96 * std), "90 %")
    show("residual over noise", median_worst([e.adequacy for e in found]))
    show("explained to the noise", count(e.explained for e in found))
    show("structures not told apart", median_worst([e.equivalent for e in found]))
    show("time, s", median_worst([e.seconds for e in found]), "20")
    for name, times in Counter(e.chosen for e in found).most_common(6):
        print(f"    {times:3d} times  {name}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["oscillators", "beam"])
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first", type=int, default=0, help="first seed of the oscillators")
    parser.add_argument("--beam-seeds", type=int, default=100)
    parser.add_argument("--elements", type=int, default=150)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    if "beam" in options.parts:
        beam(range(options.beam_seeds), options.jobs, options.elements)
    if "oscillators" in options.parts:
        oscillators(range(options.first, options.first + options.seeds), options.jobs)


if __name__ == "__main__":
    main()
