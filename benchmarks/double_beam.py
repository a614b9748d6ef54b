"""Two beams joined side by side: each hammer decay predicted by a model of the others.

    python benchmarks/double_beam.py            # leave one run out, nine times
    python benchmarks/double_beam.py --runs 2   # the first two of them
    python benchmarks/double_beam.py --sets 6 --seed 0   # random sets of three, left out together

The error is the mean distance of 94-sample windows of prediction and measurement over the largest
norm of a measured window; the state comes from the first 94 samples (S. Jain, G. Haller and others,
SSMLearn, resonant double beam: 3.65 % with poles, delays and ratio given by hand, on other runs).
Nothing is given here: `romsindy.identify` finds the coordinates and the terms.
"""

import argparse
import time
import warnings
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from romsindy import Decay, identify

DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "double_beam_train.npz"
WINDOW = 94


def trajectory_error(predicted, measured):
    """Normalised mean trajectory error."""
    size = np.lib.stride_tricks.sliding_window_view
    distance = np.linalg.norm(size(predicted - measured, WINDOW), axis=1)
    return float(distance.mean() / np.linalg.norm(size(measured, WINDOW), axis=1).max())


def decays(path=DATA):
    """The runs, as decays from the measured velocity."""
    data = np.load(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # jitter of the clock, resampled
        found = [Decay.from_velocity(data["t"], v - v.mean(), unit="m") for v in data["v"].T]
    return data["run"], found


def left_out(numbers, several):
    """Errors of some runs by a model of the others, the model, and the core seconds of its fit."""
    start = time.process_time()
    fit = identify([d for i, d in enumerate(several) if i not in numbers], "auto")
    seconds = time.process_time() - start
    errors = [trajectory_error(fit.predict(several[i], WINDOW), several[i].signal) for i in numbers]
    return errors, fit.model, seconds


def drawn(sets, seed, count):
    """Random sets of three of so many runs."""
    rng = np.random.default_rng(seed)
    return [sorted(rng.choice(count, 3, replace=False).tolist()) for _ in range(sets)]


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=9, help="how many are left out in turn")
    parser.add_argument("--sets", type=int, help="so many random sets of three in their place")
    parser.add_argument("--seed", type=int, default=0, help="of the sets")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    given = parser.parse_args(arguments)
    names, several = decays()
    out = drawn(given.sets, given.seed, len(several)) if given.sets else None
    out = out or [[i] for i in range(given.runs)]
    tasks = (delayed(left_out)(numbers, several) for numbers in out)
    every = []
    for numbers, found in zip(out, Parallel(given.jobs, return_as="generator")(tasks), strict=True):
        errors, model, seconds = found
        every += errors
        each = ", ".join(
            f"{names[i]} {100 * e:.2f} %" for i, e in zip(numbers, errors, strict=True)
        )
        print(f"run {each}   {seconds:.0f} s   {', '.join(model.coefficients)}", flush=True)
    print(f"mean {100 * np.mean(every):.2f} %, largest {100 * max(every):.2f} %")


if __name__ == "__main__":
    main()
