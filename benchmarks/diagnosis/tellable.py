"""What of beams told wrong can any method tell from values within their tolerances?

    python benchmarks/diagnosis/tellable.py --first 90000 --count 60 --cache trials

The trials are those of `beam_mounted_wrong` that hide something linear. It changes the frequencies
and the rates of decay of the first modes, and so do values within tolerances, with the covariance S
to first order. Measured are these to 1e-5 of the first frequency, 1e-4 of the second and by its
square of the others, and to 0.2 and 2 % of the rates, which is better than any record here. The
squared distance d' S^-1 d of the change d is twice the logarithm of the odds against values alone
at the most: below 7 these are not 33 : 1, and values that moved are as good an answer.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from beam_truth import BeamTruth, Spring
from exudyn_trials import beam_of, beam_trial, told_wrong
from rows import MOUNTED_BEAMS

from romsindy.beam import Beam
from romsindy.beam.changes import ClampCompliance
from romsindy.beam.motion import Sensor
from romsindy.diagnosis.on_beam.instrumented import ModesAtRest
from romsindy.effects import PointMass

MODES = 3
LINEAR = ("clamp_compliance", "added_mass", "spring_stiffness", "viscous")
NAMED = 2 * np.log(33)
_FREQUENCIES, _RATES = (1e-5, 1e-4), (0.002, 0.02)  # of the first mode, of the others


@dataclass
class OneOff:
    """In place of random numbers: zeros, but for a one after so many."""

    after: int

    def standard_normal(self) -> float:
        """The next."""
        self.after -= 1
        return float(self.after == -1)


def at_rest(beam: Beam, viscous: Sequence[dict] = ()) -> np.ndarray:
    """Logarithms of the frequencies, and rates, of the first modes, with dampers at points."""
    found = ModesAtRest.of(beam, MODES)
    rates = found.rates.copy()
    for damper in viscous:
        places = [damper["at"], *(beam.length * np.linspace(0.3, 0.9, MODES - 1))]
        at = beam.sensors([Sensor(min(x, beam.length)) for x in places])
        rates += (
            damper["values"]["damping"] * at.mode_shapes(beam.modes(count=MODES), MODES)[0] ** 2 / 2
        )
    return np.concatenate([np.log(found.omega), rates])


def hidden(truth: dict) -> np.ndarray:
    """The same of what the beam really is."""
    beam = beam_of(truth)
    if truth["compliance"]:
        beam = beam.with_effect(ClampCompliance(truth["compliance"]))
    for force in (f for f in truth["forces"] if f["kind"] == "mass"):
        beam = beam.with_effect(PointMass(force["values"]["mass"], at=force["at"]))
    return at_rest(beam, [f for f in truth["forces"] if f["kind"] == "damper"])


def distances(exact: dict, truth: dict, count: int) -> list[float]:
    """Squared distances of what is hidden from an exact beam, by one mode, and by all."""
    plain = BeamTruth(**exact | {"spring": exact["spring"] and Spring(**exact["spring"])})
    base = at_rest(beam_of(exact))
    told = (told_wrong(plain, [], OneOff(k))[0]["beam"] for k in range(count))
    slopes = np.array([at_rest(beam_of(said)) - base for said in told]).T
    shift = hidden(truth) - base
    of_squares = np.exp(2 * (base[:MODES] - base[1]))
    frequencies = np.append(_FREQUENCIES[0], _FREQUENCIES[1] * of_squares[1:])
    rates = base[MODES:] * np.append(_RATES[0], np.full(MODES - 1, _RATES[1]))
    covariance = slopes @ slopes.T + np.diag(np.append(frequencies, rates) ** 2)
    heard = ([0, MODES], [*range(2 * MODES)])
    return [float(shift[i] @ np.linalg.solve(covariance[np.ix_(i, i)], shift[i])) for i in heard]


def main() -> None:
    """Print a line for every trial, and how many can be told."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--cache", type=Path, default=Path("trials"))
    chosen = parser.parse_args()
    found: dict[str, list[list[float]]] = {}
    for seed in range(chosen.first, chosen.first + chosen.count):
        kind = MOUNTED_BEAMS[seed % len(MOUNTED_BEAMS)]
        trial, truth = beam_trial(kind, seed, chosen.cache)
        name = next(iter(truth["effects"]))
        if name not in LINEAR:
            continue
        of_both = distances(
            trial.told["exact"]["beam"], truth["beam"], len(trial.told["tolerances"])
        )
        one, all_of_them = of_both
        print(f"{kind}_{seed} {name:18} one mode {one:8.1f}, {MODES} modes {all_of_them:8.1f}")
        found.setdefault(name, []).append(of_both)
    for name, rows in found.items():
        one, three = np.sum(np.array(rows) > NAMED, axis=0)
        print(f"{name:18} n {len(rows):3}, beyond 33 : 1 by one mode {one}, by {MODES} {three}")


if __name__ == "__main__":
    main()
