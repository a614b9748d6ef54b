"""How well the right terms are found: ``python benchmarks/selection.py``.

``oscillators`` and ``beam`` name a part, ``--seeds`` says how many, ``--jobs`` how many at once.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed

import romsindy as rs
from romsindy.contenders import describe
from romsindy.synthetic import EXAMPLE_MODEL, add_noise

AMPLITUDES = np.linspace(0.1, 1.7, 60)
DAMPING = ("quadratic", "coulomb", "q^2 q_dot")


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
    print(f"  true structure chosen or not told apart and held   {sum(t.held for t in trials)}/{n}")
    print(f"  true structure chosen exactly                      {sum(t.exact for t in trials)}/{n}")
    print(f"  part of the true structure chosen                  {sum(t.subset for t in trials)}/{n}")
    print(f"  chosen model explains the data                     {sum(t.explained for t in trials)}/{n}")
    print(f"  structures not told apart, median and most         {np.median([t.equivalent for t in trials]):.0f}, {max(t.equivalent for t in trials)}")
    print(f"  backbone error of the chosen model, median, worst  {np.median([t.error for t in trials]):.1e}, {max(t.error for t in trials):.1e}")
    print(f"  time, median, longest, s                           {np.median([t.seconds for t in trials]):.1f}, {max(t.seconds for t in trials):.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["oscillators", "beam"])
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    if "oscillators" in options.parts:
        oscillators(range(options.seeds), options.jobs)


if __name__ == "__main__":
    main()
