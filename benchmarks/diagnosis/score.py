"""Score diagnoses against the truth: right, in the set, confidently wrong; parameters; confusion.

python benchmarks/diagnosis/score.py FOLDER single --seed 1000 [--list] [--figure FILE]
"""

from __future__ import annotations

import argparse
import json
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
from laws import IN_CATALOGUE

# Names in the truth and in a diagnosis for values that mean the same.
_SAME = {"coefficient": "strength", "bias": "strength", "shape": "gap"}


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


def deviations(rows: list[dict]) -> dict[str, list[tuple[float, float]]]:
    """Relative error, and error over standard error, of every value that has the same meaning."""
    found = defaultdict(list)
    for row in rows:
        if len(row["hidden"]) != 1 or not row["right"]:
            continue
        (name,) = row["hidden"]
        effect = next(e for e in row["effects"] if e["name"] == name)
        for key, true in row["truth"]["effects"][name].items():
            key = "exponent" if key == "exponent" else _SAME.get(key, key)
            said, error = effect["values"].get(key), effect["errors"].get(key)
            # Units of these differ: an effective exponent, a stiffness per record, a force scale.
            other = name in ("drift", "magnet", "added_mass", "gain", "stop", "sudden_change")
            if said is None or not error or (other and key == "strength") or not true:
                continue
            found[f"{name} {key}"].append((abs(said / true - 1), abs(said - true) / error))
    return found


def percent(rows: list[dict], mark: str) -> str:
    return f"{100 * np.mean([r[mark] for r in rows]):5.1f}"


def confusion(rows: list[dict]) -> tuple[list[str], np.ndarray]:
    """Headline against truth; the last two columns are "none" and everything else."""
    names = [*IN_CATALOGUE]
    columns = [*names, "none", "other"]
    table = np.zeros((len(names), len(columns)), int)
    for row in rows:
        if len(row["hidden"]) != 1:
            continue
        (name,) = row["hidden"]
        said = row["names"][0] if len(row["names"]) == 1 else "other"
        said = "none" if row["verdict"] == "none" else said
        table[names.index(name), columns.index(said if said in columns else "other")] += 1
    return columns, table


def draw_confusion(rows: list[dict], path: Path) -> None:
    import matplotlib.pyplot as plt

    columns, table = confusion(rows)
    figure, ax = plt.subplots(figsize=(9, 8), layout="constrained")
    ax.imshow(table, cmap="Blues")
    for i, j in np.argwhere(table):
        dark = table[i, j] > 0.6 * table.max()
        ax.text(j, i, table[i, j], ha="center", va="center", color="w" if dark else "k", size=7)
    label = [c.replace("_", " ") for c in columns]
    ax.set_xticks(range(len(columns)), label, rotation=90, size=8)
    ax.set_yticks(range(len(table)), label[: len(table)], size=8)
    ax.set(xlabel="named first", ylabel="hidden")
    figure.savefig(path, dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("kind")
    parser.add_argument("--seed", default="0")
    parser.add_argument("--list", action="store_true", help="every trial that went wrong")
    parser.add_argument("--figure", type=Path, help="confusion matrix of all noise levels")
    chosen = parser.parse_args()
    everything = []
    for path in sorted(chosen.folder.glob(f"{chosen.kind}_{chosen.seed}_*.jsonl")):
        rows = judged(chosen.folder, path)
        everything += rows
        seconds = np.median([r["seconds"] for r in rows])
        print(f"== {path.stem}: {len(rows)} trials, median {seconds:.2f} s each")
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
        values = deviations(rows)
        if values:
            sigmas = np.array([s for v in values.values() for _, s in v])
            print(f"two standard errors cover {100 * np.mean(sigmas < 2):.0f} % of {len(sigmas)}")
            medians = {k: f"{100 * np.median([e for e, _ in v]):.2g}" for k, v in values.items()}
            print("median error, %:", ", ".join(f"{k} {v}" for k, v in medians.items()))
        for r in rows if chosen.list else ():
            bad = not r["right"] if chosen.kind in ("single", "pair") else r["verdict"] == "named"
            if bad:
                print(
                    f"  {r['trial']} {sorted(r['hidden'])} {r['truth']['strength']}:"
                    f" {r['verdict']} {r['equivalent'][:4]} moved {r['moved']}"
                    f" adequacy {r['adequacy']:.3f} structure {r['structure']:.2f}"
                    f" p {r['p_value']:.0e} held out {r['before']:.3g} -> {r['after']:.3g}"
                )
    if chosen.figure is not None:
        draw_confusion(everything, chosen.figure)


if __name__ == "__main__":
    main()
