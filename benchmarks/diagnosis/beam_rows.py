"""Rows of beams that Exudyn simulated: the diagnosis is told them exactly, or within tolerances."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from exudyn_trials import TOLERANCES, beam_trial
from marked import asked_of

import romsindy as rs
from romsindy.beam.motion import Sensor

# Blamed on the simulation, and no effect: what has a tolerance, and what stands for several.
PARAMETERS = {*TOLERANCES, "bending_stiffness", "axial_stiffness", "width", "anchor_y"}
PARAMETERS |= {f"tolerances_{i + 1}" for i in range(len(TOLERANCES))}
_NEAR = 0.05  # of the length


def beams(kind: str, which: str, jobs: int = 1) -> Callable[[int, Path], dict]:
    """Trials of one kind of `exudyn_trials.KINDS`, told "exact" or "wrong"."""

    def one(seed: int, folder: Path) -> dict:
        trial, truth = beam_trial(kind, seed, folder)
        beam = trial.beam(which)
        sensors = beam.sensors([Sensor(x) for x in trial.positions(which)])
        tolerances = trial.told["tolerances"] if which == "wrong" else None

        told: dict[str, float | None] = {"found_at": None}

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
            if report.place is not None and report.place.told:
                told["found_at"] = report.place.at
            return report

        excused = PARAMETERS if which == "wrong" else ()
        result = asked_of(diagnosis, truth, excused)
        result["about"] = f"{kind} {truth['beam']['supports']} {truth['noise']}"
        return result | told | {"place": truth["place"], "length": truth["beam"]["length"]}

    return one


def any_of(kinds: Sequence[str]) -> Callable[[int, Path], dict]:
    """Trials of several kinds in turn, told exactly."""

    def one(seed: int, folder: Path) -> dict:
        return beams(kinds[seed % len(kinds)], "exact")(seed, folder)

    return one


def place_line(results: Sequence[dict]) -> str:
    """How often a force that was named right has its place, and how near."""
    there = [r for r in results if r["right"] and r.get("place") is not None]
    given = [r for r in there if r.get("found_at") is not None]
    near = [r for r in given if abs(r["found_at"] - r["place"]) < _NEAR * r["length"]]
    return (
        f"{'place of a force':22} given in {len(given)} of {len(there)}, within 5 % of the length"
        f" in {len(near)} of {len(given)}\n{'':22} asked: given in 80 %, of these near in 90 %"
    )
