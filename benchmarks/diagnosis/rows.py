"""The rows of the table: what each hides, how it is diagnosed, and what is asked of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from beam_rows import any_of, beams
from generator import trial_of, truth_of
from marked import asked_of
from measured import REPEATS, against_repeat
from noises import KINDS
from repeats import MOVED, pair_of

import romsindy as rs
from romsindy.diagnosis.simulated import model_of_simulation


@dataclass(frozen=True)
class Row:
    """One row: ``one(seed, folder)`` runs a trial, and returns what is marked."""

    name: str
    count: int
    asked: str
    one: Callable[[int, Path], dict]


# What sensors of the trials could tell: far below what tests repeat to.
FINE = {"frequency": 1e-4, "damping": 1e-2, "signal": 2e-4}


def reduced(kind: str, tolerance: dict[str, float] | None = None) -> Callable[[int, Path], dict]:
    """Trials of one kind of the generator, with the default tolerance or a stated one."""

    def one(seed: int, folder: Path) -> dict:
        trial, truth = trial_of(kind, seed, folder), truth_of(kind, seed, folder)

        def diagnosis():
            decays = trial.decays()
            held_out = decays.pop() if trial.held_out else None
            return rs.diagnose(trial.model, decays, held_out=held_out, tolerance=tolerance)

        return asked_of(diagnosis, truth)

    return one


NOTHING = {"effects": {}, "strength": "none", "noise": "white"}


def against_itself(seed: int, folder: Path) -> dict:
    """A measured file beside its own model."""
    kind = f"null_{KINDS[seed % len(KINDS)]}"
    trial, truth = trial_of(kind, seed, folder), truth_of(kind, seed, folder)

    def diagnosis():
        decay = trial.decays()[0]
        known = model_of_simulation([decay])
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


def repeated(seed: int, folder: Path) -> dict:
    """A measured run beside another of the same test; the data lie in the folder's "measured"."""
    name = list(REPEATS)[seed % len(REPEATS)]
    result = asked_of(lambda: against_repeat(name, folder / "measured")(), NOTHING)
    return result | {"about": name}


def twice(kind: str) -> Callable[[int, Path], dict]:
    """One structure measured twice, the model identified from the first run."""

    def one(seed: int, folder: Path) -> dict:
        first, second = pair_of(kind, seed)
        model = rs.identify(first)
        truth = {"effects": MOVED[kind], "strength": kind, "noise": "35 dB"}
        return asked_of(lambda: rs.diagnose(model, second), truth)

    return one


def _null(kind: str) -> Row:
    asked = '"none" in 235 of the 240, named 0'
    asked = '"none", or the hum itself' if kind == "hum" else asked
    return Row(f"null_{kind}", 40, asked, reduced(f"null_{kind}"))


def _nulls(kinds: Sequence[str]) -> list[str]:
    return [f"{kind}_null" for kind in kinds]


_NO_EFFECT = "a parameter or none; an effect named in at most 1 of the 80"
_OTHERS = ("tip", "hit", "clamped")
MOUNTED_BEAMS = ("tip_mounted", "modal_mounted", "hit_mounted", "bent_mounted")
ROWS = {
    row.name: row
    for row in (
        *map(_null, KINDS),
        Row("hidden", 200, "92 / 97 / at most 1 %, 1.3 names in a set", reduced("hidden")),
        Row("weak", 50, 'right, or "none"; named and wrong at most 4 %', reduced("weak")),
        Row("weak_fine", 50, "65 / 88 / at most 4 %, 1.3 names in a set", reduced("weak", FINE)),
        Row("two", 40, "both in the set in 85 %; at most 120 s", reduced("two")),
        Row("itself", 50, '"none" in all', against_itself),
        Row("example", 50, '"none" in all', other_seed),
        Row("repeats", len(REPEATS), '"none" in all', repeated),
        Row("again", 40, '"none" in 38, none named', twice("again")),
        Row(
            "shifted",
            40,
            "linear stiffness the headline; with damped, in 57 of 60",
            twice("shifted"),
        ),
        Row("damped", 20, "damping the headline", twice("damped")),
        Row("outside", 30, '"unknown" or "ambiguous" in 25, named in 1', reduced("outside")),
        Row("beam_exact", 60, "92 / 97 / 1 %, 1.3 names in a set", beams("modal", "exact")),
        Row("beam_wrong", 60, "80 / 93 / 2 %, 1.8 names in a set", beams("modal", "wrong")),
        Row("beam_null_exact", 40, _NO_EFFECT, beams("modal_null", "exact")),
        Row("beam_null_wrong", 40, _NO_EFFECT, beams("modal_null", "wrong")),
        Row("beam_others", 60, "51 / 57 / at most 1 of 60", any_of(_OTHERS)),
        Row("beam_damping_tip", 20, "80 % right, 1 of 40 wrong", beams("tip_damping", "exact")),
        Row("beam_damping_modal", 20, "family told in 95 %", beams("modal_damping", "exact")),
        Row("beam_mounted_exact", 60, "88 / 94 / 1 %", any_of(MOUNTED_BEAMS)),
        Row("beam_mounted_wrong", 60, "80 / 90 / 2 %", any_of(MOUNTED_BEAMS, "wrong")),
        Row("beam_mounted_null_exact", 40, "none named; 39", any_of(_nulls(MOUNTED_BEAMS))),
        Row(
            "beam_mounted_null_wrong", 40, "none named; 38", any_of(_nulls(MOUNTED_BEAMS), "wrong")
        ),
        Row("beam_others_null", 30, "no effect named", any_of(_nulls(_OTHERS))),
    )
}
