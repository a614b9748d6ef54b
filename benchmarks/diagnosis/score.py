"""Score diagnoses against the truth: tables of right, in the set, confidently wrong.

python benchmarks/diagnosis/score.py FOLDER single --seed 0
"""

from __future__ import annotations

import argparse
import json
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np


def judged(folder: Path, path: Path) -> list[dict]:
    """Results with their truth and marks."""
    rows = []
    for line in path.read_text().splitlines():
        row = json.loads(line)
        truth = json.loads((folder / "truth" / f"{row['trial']}.json").read_text())
        names = set(truth["effects"])
        said = [set(x) for x in row["equivalent"]]
        row |= {
            "truth": truth,
            "hidden": names,
            "right": set(row["names"]) == names and row["verdict"] in ("named", "ambiguous"),
            "in_set": any(names == s for s in said) and row["verdict"] != "none",
            "wrong": row["verdict"] == "named" and set(row["names"]) != names,
            "found": len(names & (set(row["names"]) | set(row["moved"]))),
        }
        rows.append(row)
    return rows


def percent(rows: list[dict], mark: str) -> str:
    return f"{100 * np.mean([r[mark] for r in rows]):5.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("kind")
    parser.add_argument("--seed", default="0")
    parser.add_argument("--list", action="store_true", help="every trial that went wrong")
    chosen = parser.parse_args()
    for path in sorted(chosen.folder.glob(f"{chosen.kind}_{chosen.seed}_*.jsonl")):
        rows = judged(chosen.folder, path)
        seconds = np.mean([r["seconds"] for r in rows])
        print(f"== {path.stem}: {len(rows)} trials, {seconds:.2f} s each")
        groups = defaultdict(list)
        for row in rows:
            groups[row["truth"]["strength"]].append(row)
        for name, group in [*groups.items(), ("all", rows)]:
            sizes = np.mean([len(r["equivalent"]) for r in group])
            print(
                f"{name:8} n {len(group):4}  right {percent(group, 'right')}  in set"
                f" {percent(group, 'in_set')} (size {sizes:.2f})  wrong {percent(group, 'wrong')}"
                f"  {dict(Counter(r['verdict'] for r in group))}"
                f"  after/noise median {np.median([r['after'] for r in group]):.3f}"
            )
        if chosen.kind == "pair":
            both = np.mean([r["found"] == 2 for r in rows])
            some = np.mean([r["found"] >= 1 for r in rows])
            print(f"both named {100 * both:.0f} %, at least one {100 * some:.0f} %")
        if chosen.list:
            for r in rows:
                bad = (
                    not r["right"]
                    if chosen.kind in ("single", "pair")
                    else r["verdict"] in ("named",)
                )
                if bad:
                    print(
                        f"  {r['trial']} {sorted(r['hidden'])} {r['truth']['strength']}:"
                        f" {r['verdict']} {r['equivalent'][:4]} moved {r['moved']}"
                        f" adequacy {r['adequacy']:.3f} structure {r['structure']:.2f}"
                        f" p {r['p_value']:.0e} held out {r['before']:.3g} -> {r['after']:.3g}"
                    )


if __name__ == "__main__":
    main()
