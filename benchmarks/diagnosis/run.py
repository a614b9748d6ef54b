"""Blind diagnosis of trials written by generator.py, scored against the truth afterwards.

    python benchmarks/diagnosis/run.py FOLDER single --seeds 0 1 --noise 40 30 --jobs 2

Every line of FOLDER/<kind>_<noise>.jsonl is one diagnosis; `score.py` reads them.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

import romsindy as rs
from romsindy.diagnosis import diagnose


def records(path: Path, snr: str, seed: int) -> tuple[rs.ReducedModel, list[rs.Decay]]:
    """The nominal model and three decays with white noise."""
    content = np.load(path)
    model = rs.ReducedModel.from_coefficients(json.loads(str(content["coefficients"])))
    t = np.arange(content["q"].shape[1]) / float(content["rate"])
    clean = [rs.Decay(t, q) for q in content["q"]]
    if snr == "clean":
        return model, clean
    return model, [rs.add_noise(d, float(snr), seed + i) for i, d in enumerate(clean)]


def one(path: Path, snr: str, levels: dict) -> dict:
    """Diagnose one trial; nothing here has seen the truth."""
    seed = 1000 * int(path.stem.split("_")[-1]) + (0 if snr == "clean" else int(snr))
    model, decays = records(path, snr, seed)
    start = time.perf_counter()
    report = diagnose(model, decays[:2], held_out=decays[2], **levels)
    return {
        "trial": path.stem,
        "noise": snr,
        "verdict": report.verdict,
        "names": list(report.best.names),
        "moved": list(report.best.moved),
        "equivalent": [list(names) for names in report.equivalent],
        "scores": [
            float(h.score - report.best.score) for h in report.rivals
        ],
        "effects": [
            {"name": e.name, "values": e.values, "errors": e.standard_errors}
            for e in report.effects
        ],
        "adequacy": report.remainder.ratio,
        "structure": report.remainder.structure,
        "p_value": report.remainder.p_value,
        "before": report.gap.before,
        "after": report.gap.after,
        "seconds": time.perf_counter() - start,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("kind", choices=("single", "null", "outside", "pair"))
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 1), metavar=("FROM", "TO"))
    parser.add_argument("--noise", nargs="+", default=["clean", "40", "30"])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--exact", action="store_true", help="the nominal model is exact (L0)")
    parser.add_argument("--every", type=int, default=1, help="only every n-th trial")
    chosen = parser.parse_args()
    levels = {"free": ()} if chosen.exact else {}
    paths = sorted(
        p
        for seed in range(*chosen.seeds)
        for p in chosen.folder.glob(f"{chosen.kind}_{seed}_*.npz")
    )[:: chosen.every]
    for snr in chosen.noise:
        results = Parallel(chosen.jobs, return_as="generator")(
            delayed(one)(p, snr, levels) for p in paths
        )
        name = f"{chosen.kind}_{chosen.seeds[0]}_{snr}{'_exact' if chosen.exact else ''}.jsonl"
        with open(chosen.folder / name, "w") as file:
            for result in results:
                file.write(json.dumps(result) + "\n")
                file.flush()


if __name__ == "__main__":
    main()
