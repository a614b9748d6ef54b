"""Many records: how much sooner by two processes, and by a cluster of two workers.

    python benchmarks/batch.py [--count 40] [--first 0] [--rounds 3]

Records are free decays of hardening oscillators of 5 to 20 Hz, 10 s at 400 Hz, 40 dB over the
noise, each with a seed of its own. One process, two processes and a cluster of two workers on this
machine identify all of them, one after the other in every round, by `romsindy batch` as a user
types it; the ratios are of medians of the rounds. The cluster is started before.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from distributed import LocalCluster

import romsindy as rs

_T = np.arange(0, 10, 1 / 400)  # s


def write_records(folder: Path, count: int, first: int) -> None:
    """Decays with seeds from ``first`` on, as CSV."""
    for seed in range(first, first + count):
        rng = np.random.default_rng(seed)
        omega = 2 * np.pi * rng.uniform(5, 20)
        terms = {
            "omega^2": omega**2,
            "gamma_3": 30 * omega**2 * rng.uniform(0.3, 1),  # m^-2 s^-2: some per cent at 0.05 m
            "c_linear": 2 * omega * rng.uniform(2e-3, 6e-3),
        }
        model = rs.ReducedModel.from_coefficients(terms, unit="m")
        decay = rs.add_noise(model.simulate(rng.uniform(0.04, 0.06), 0.0, _T), 40, seed)
        rs.save_decay(decay, folder / f"run{seed:05}.csv")


def seconds(records: Path, *options: str) -> float:
    """How long `romsindy batch` takes of all records, s.

    Raises a RuntimeError if a record was not identified.
    """
    with tempfile.TemporaryDirectory() as folder:
        words = ["batch", str(records), "--out", f"{folder}/out", *options]
        begin = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "romsindy", *words], capture_output=True, text=True
        )
        took = time.perf_counter() - begin
    if done.returncode:
        raise RuntimeError(f"romsindy {' '.join(words)} ended with {done.stdout}{done.stderr}")
    return took


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        records = Path(folder)
        write_records(records, asked.count, asked.first)
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
            ways = {
                "one process": [],
                "two processes": ["--jobs", "2"],
                "a cluster of two workers": ["--dask", cluster.scheduler_address],
            }
            took: dict[str, list[float]] = {name: [] for name in ways}
            for i in range(asked.rounds):
                for name, options in ways.items():
                    took[name].append(seconds(records, *options))
                    print(f"round {i + 1}, {name:<26} {took[name][-1]:7.1f} s", flush=True)
    one, two, cluster_of_two = (statistics.median(times) for times in took.values())
    print(f"{asked.count} records: two processes are {one / two:.2f} times as fast as one")
    print(f"a cluster of two workers is {two / cluster_of_two:.2f} times as fast as two processes")


if __name__ == "__main__":
    main()
