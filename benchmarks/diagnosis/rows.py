"""The rows of the table: what each hides, how it is diagnosed, and what is asked of it."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from generator import trial_of, truth_of
from memory import OUTSIDE
from noises import KINDS
from score import Said, marks, of_a_stranger

import romsindy as rs
from romsindy.diagnosis.simulated import model_of_simulation
from romsindy.physics.example import EXAMPLE_MODEL


@dataclass(frozen=True)
class Row:
    """One row: ``one(seed, folder)`` runs a trial, and returns what is marked."""

    name: str
    count: int
    asked: str
    one: Callable[[int, Path], dict]


def told(report: Any, seconds: float, truth: dict) -> dict:
    """What is kept of a report, with its marks."""
    said = Said.of(report)
    excused = ("mains_hum",) if truth["noise"] == "hum" else ()
    hidden = list(truth["effects"])
    return {
        "verdict": said.verdict,
        "names": said.names,
        "equivalent": said.equivalent,
        "moved": said.moved,
        "before": report.gap.before,
        "after": report.gap.after,
        "sentence": report.sentence,
        "seconds": seconds,
        "hidden": hidden,
        "about": f"{truth['strength']} {truth['noise']} {truth.get('snr_db', 0):.0f} dB",
        **(
            of_a_stranger(said) if hidden and hidden[0] in OUTSIDE else marks(said, hidden, excused)
        ),
    }


def asked_of(diagnosis: Callable[[], Any], truth: dict) -> dict:
    """Time a diagnosis and mark it; one that is refused is marked as unknown."""
    start = time.perf_counter()
    try:
        report = diagnosis()
    except Exception as error:
        nothing = {"verdict": "failed", "names": [], "equivalent": [], "moved": []}
        failed = {"right": False, "in_set": False, "wrong": False, "before": np.nan}
        where = traceback.extract_tb(error.__traceback__)[-1]
        return {
            **nothing,
            **failed,
            "after": np.nan,
            "sentence": "",
            "seconds": time.perf_counter() - start,
            "hidden": list(truth["effects"]),
            "about": f"{truth['strength']} {truth['noise']}",
            "error": f"{type(error).__name__} in {where.name}: {error}",
        }
    return told(report, time.perf_counter() - start, truth)


def reduced(kind: str) -> Callable[[int, Path], dict]:
    """Trials of one kind of the generator."""

    def one(seed: int, folder: Path) -> dict:
        trial, truth = trial_of(kind, seed, folder), truth_of(kind, seed, folder)

        def diagnosis():
            decays = trial.decays()
            held_out = decays.pop() if trial.held_out else None
            return rs.diagnose(trial.model, decays, held_out=held_out)

        return asked_of(diagnosis, truth)

    return one


NOTHING = {"effects": {}, "strength": "none", "noise": "white"}


def against_itself(seed: int, folder: Path) -> dict:
    """A measured file beside its own model."""
    kind = f"null_{KINDS[seed % len(KINDS)]}"
    trial, truth = trial_of(kind, seed, folder), truth_of(kind, seed, folder)

    def diagnosis():
        decay = trial.decays()[0]
        known = model_of_simulation(decay)
        return rs.diagnose(
            known.model, decay, tolerances=known.tolerances, floor=known.floor, reference=decay
        )

    return asked_of(diagnosis, truth)


def other_seed(seed: int, folder: Path) -> dict:
    """The model that plain regression finds in one noise, beside another."""
    first, second = (rs.example_decay(35.0, 2 * seed + i) for i in (0, 1))

    def diagnosis():
        model = rs.HarmonicSINDy().fit(first.conditioned()).model_
        return rs.diagnose(model, second, reference=first)

    return asked_of(diagnosis, NOTHING)


def exact_example(seed: int, folder: Path) -> dict:
    """The model of the example oscillator itself, beside its decay."""
    return asked_of(lambda: rs.diagnose(EXAMPLE_MODEL, rs.example_decay(35.0, seed)), NOTHING)


ROWS = {
    row.name: row
    for row in (
        *(
            Row(
                f"null_{kind}",
                40,
                '"none", or the hum itself'
                if kind == "hum"
                else '"none" in 235 of the 240, named 0',
                reduced(f"null_{kind}"),
            )
            for kind in KINDS
        ),
        Row("hidden", 200, "92 / 97 / at most 1 %, 1.3 names in a set", reduced("hidden")),
        Row("weak", 50, "65 / 88 / at most 4 %, 1.3 names in a set", reduced("weak")),
        Row("itself", 50, '"none" in all', against_itself),
        Row("example", 50, '"none" in all', other_seed),
        Row(
            "outside", 30, '"unknown" or "ambiguous" in 25, named in at most 1', reduced("outside")
        ),
    )
}
