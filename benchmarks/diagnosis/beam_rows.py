"""Rows of beams that Exudyn simulated: the diagnosis is told them exactly, or within tolerances."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from exudyn_trials import TOLERANCES, beam_trial
from marked import asked_of

import romsindy as rs
from romsindy.beam.motion import Sensor

# Blamed on the simulation, and no effect: what has a tolerance, and what stands for several.
PARAMETERS = {*TOLERANCES, "bending_stiffness", "axial_stiffness", "width", "anchor_y"}
PARAMETERS |= {f"tolerances_{i + 1}" for i in range(len(TOLERANCES))}
_NEAR, _NARROW = 0.05, 0.2  # of the length
_TOLD = 1.96  # standard errors to either side of a value
# What the strength of a force is called in a truth; that of a magnet is of another law.
_STRENGTHS = ("damping", "force", "stiffness", "mass")


def beams(kind: str, which: str, jobs: int = 1) -> Callable[[int, Path], dict]:
    """Trials of one kind of `exudyn_trials.KINDS`, told "exact" or "wrong"."""

    def one(seed: int, folder: Path) -> dict:
        trial, truth = beam_trial(kind, seed, folder)
        beam = trial.beam(which)
        sensors = beam.sensors([Sensor(x) for x in trial.positions(which)])
        tolerances = trial.told["tolerances"] if which == "wrong" else None

        told: dict = {"found_at": None, "interval": None, "strength": None}

        def diagnosis():
            *training, held_out = trial.decays()
            report = rs.diagnose(
                beam,
                training,
                sensors=sensors,
                held_out=held_out,
                tolerances=tolerances,
                n_jobs=jobs,
            )
            if report.place is not None:
                told["found_at"] = report.place.at if report.place.told else None
                told["interval"] = [report.place.low, report.place.high]
                told["strength"] = _strength(report)
            return report

        excused = PARAMETERS if which == "wrong" else ()
        result = asked_of(diagnosis, truth, excused)
        result["about"] = f"{kind} {truth['beam']['supports']} {truth['noise']}"
        hidden = next(iter(truth["effects"].values()), {})
        true = next((hidden[k] for k in _STRENGTHS if k in hidden and truth["place"]), None)
        where = {"place": truth["place"], "length": truth["beam"]["length"]}
        return result | told | where | {"true_strength": true}

    return one


def _strength(report) -> list[float]:
    """Between what the strength is told to lie: at a place, or at the ends of where that may be."""
    if not report.place.told:
        return sorted(report.place.strengths)
    (effect,) = report.effects
    value, error = (of["strength"] for of in (effect.values, effect.standard_errors))
    return [value - _TOLD * error, value + _TOLD * error]


def any_of(kinds: Sequence[str], which: str = "exact") -> Callable[[int, Path], dict]:
    """Trials of several kinds in turn, told "exact" or "wrong"."""

    def one(seed: int, folder: Path) -> dict:
        return beams(kinds[seed % len(kinds)], which)(seed, folder)

    return one


def place_line(results: Sequence[dict]) -> str:
    """Places and strengths of forces that were told right: how often, how near, how sure."""
    there = [r for r in results if r["right"] and r.get("place") is not None]
    given = [r for r in there if r.get("found_at") is not None]
    near = [r for r in given if abs(r["found_at"] - r["place"]) < _NEAR * r["length"]]
    sure = [r for r in there if r.get("interval")]
    held = [r for r in sure if _within(r["place"], r["interval"])]
    narrow = [r for r in sure if np.ptp(r["interval"]) <= _NARROW * r["length"]]
    strong = [r for r in sure if r.get("strength") and r.get("true_strength")]
    right = [r for r in strong if _within(r["true_strength"], r["strength"])]
    return (
        f"{'place of a force':22} given in {len(given)} of {len(there)}, within 5 % of the length"
        f" in {len(near)} of {len(given)}\n{'':22} within its interval in {len(held)} of"
        f" {len(sure)}, which is at most a fifth of the length in {len(narrow)}; strength in"
        f" {len(right)} of {len(strong)}\n{'':22} asked: 90 %, a fifth in 70 %; strength 90 %"
    )


def _within(x: float, interval: Sequence[float]) -> bool:
    low, high = interval
    return low <= x <= high
