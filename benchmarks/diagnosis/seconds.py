"""Seconds of one diagnosis: of a reduced system, and of a beam in one process and in two.

    python benchmarks/diagnosis/seconds.py --count 3 --first 0 --cache FOLDER

Runs by itself, on an idle machine, one diagnosis after the other.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from beam_rows import beams
from rows import reduced


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=5)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cache", type=Path, default=Path("trials"))
    chosen = parser.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.count)
    alone, apart = beams("modal", "exact", 1), beams("modal", "exact", 2)
    rows = []
    for seed in seeds:
        results = (one(seed, chosen.cache) for one in (reduced("hidden"), alone, apart))
        rows.append([result["seconds"] for result in results])
        print(*(f"{x:.1f} s" for x in rows[-1]), flush=True)
    model, one, two = np.array(rows).T
    print(f"reduced: median {np.median(model):.1f} s, at most {model.max():.1f}; asked: 8")
    print(f"beam: median {np.median(one):.1f} s, at most {one.max():.1f}; asked: 60")
    print(f"two processes: {np.median(one / two):.2f} times as fast; asked: 1.5")


if __name__ == "__main__":
    main()
