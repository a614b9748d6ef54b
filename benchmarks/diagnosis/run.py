"""Run blind trials and print the table: each row beside what is asked of it.

    python benchmarks/diagnosis/run.py hidden weak --count 20 --first 0 --jobs 2 --cache FOLDER

Trials are made once and stored in the folder, and so are the results, line by line in
FOLDER/<row>.jsonl: a run that was interrupted goes on where it stopped, and one with --again
diagnoses the stored trials afresh. --list shows what was not right. Seeds below 50000 are for
development. Rows of beams need the extra "exudyn"; "repeats" looks for measured files (see
measured.py) in FOLDER/measured.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from beam_rows import place_line
from joblib import Parallel, delayed
from rows import ROWS
from score import line, problems

_PLACED = (
    "beam_exact",
    "beam_others",
    "beam_damping_tip",
    "beam_mounted_exact",
)  # rows whose forces have a place


def results_of(name: str, seeds: list[int], folder: Path, jobs: int, again: bool) -> list[dict]:
    """Results of one row, those that are missing added to its file."""
    path = folder / f"{name}.jsonl"
    known = [] if again or not path.is_file() else map(json.loads, path.read_text().splitlines())
    found = {r["seed"]: r for r in known}
    missing = [seed for seed in seeds if seed not in found]
    made = Parallel(jobs, return_as="generator_unordered")(
        delayed(_one)(name, seed, folder) for seed in missing
    )
    with open(path, "w" if again else "a") as file:
        for result in made:
            found[result["seed"]] = result
            file.write(json.dumps(result) + "\n")
            file.flush()
    return [found[seed] for seed in seeds]


def _one(name: str, seed: int, folder: Path) -> dict:
    return {"trial": f"{name}_{seed}", "seed": seed, **ROWS[name].one(seed, folder)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", nargs="*", default=list(ROWS), metavar="ROW", help=", ".join(ROWS))
    parser.add_argument("--count", type=int, help="trials of each row (those that are asked for)")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--cache", type=Path, default=Path("trials"))
    parser.add_argument("--again", action="store_true", help="diagnose the stored trials afresh")
    parser.add_argument("--list", action="store_true", help="what was not right first")
    chosen = parser.parse_args()
    unknown = [name for name in chosen.rows if name not in ROWS]
    if unknown:
        parser.error(f"no row called {unknown}; there are {list(ROWS)}")
    chosen.cache.mkdir(parents=True, exist_ok=True)
    placed: list[dict] = []
    for name in chosen.rows:
        count = chosen.count or ROWS[name].count
        seeds = list(range(chosen.first, chosen.first + count))
        results = results_of(name, seeds, chosen.cache, chosen.jobs, chosen.again)
        print(line(name, results, ROWS[name].asked), flush=True)
        placed += results if name in _PLACED else []
        for text in problems(results) if chosen.list else ():
            print(text, flush=True)
    if placed:
        print(place_line(placed))


if __name__ == "__main__":
    main()
