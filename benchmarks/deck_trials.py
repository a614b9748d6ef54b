"""Blind trials of a deck against a beam of another code: what does the deck lack?

The deck is a cantilever of solids, reduced by CalculiX. The truth is a geometrically exact beam
with something hidden at its tip, in time by another integrator, with noise at two sensors: neither
mesh, nor elements, nor integration are shared.

    python benchmarks/deck_trials.py --first 400 --count 6
    python benchmarks/deck_trials.py --first 500 --count 6 --wrong   # told wrong, within tolerances
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from decks import STEEL, cantilever

import romsindy as rs
from romsindy.beam import CLAMPED, FREE, Section
from romsindy.effects.mounting import Load
from romsindy.physics.damping import Friction, PowerDamping
from romsindy.physics.stiffness import Stiffness
from romsindy.structure.simulator import Damping

_LENGTH, _WIDTH, _THICKNESS = 1.0, 0.02, 0.01
_RELEASES, _DURATION, _STEP = (0.1, 0.06), 5.0, 1e-3
_SNR = 40.0
_ALPHA = 0.4  # 1/s
_WITHIN = {"modulus": 0.03, "density": 0.02, "alpha": 0.2}  # relative standard deviations
# What may be hidden, its strengths from least to most, and names that are right.
_HIDDEN: dict[str, tuple[Any, float, float, set[str]]] = {
    "nothing": (None, 0.0, 0.0, set()),
    "damper": (PowerDamping(1), 0.1, 0.3, {"viscous"}),
    "drag": (PowerDamping(2), 0.2, 0.6, {"quadratic_drag"}),
    "friction": (Friction(creep=1e-3), 0.02, 0.06, {"dry_friction"}),
    "spring": (Stiffness(1), 20.0, 80.0, {"linear_frequency"}),
    "cubic spring": (Stiffness(3), 1e4, 4e4, {"cubic_stiffness"}),
}


class Hidden(NamedTuple):
    """What a trial hides."""

    kind: str
    strength: float
    values: dict[str, float]  # of the truth over those that are told


def hidden_of(seed: int, wrong: bool) -> Hidden:
    """What the trial of a seed hides, one kind after the other."""
    rng = np.random.default_rng(seed)
    kind = [*_HIDDEN][seed % len(_HIDDEN)]
    _, least, most, _ = _HIDDEN[kind]
    strength = float(np.exp(rng.uniform(np.log(least), np.log(most)))) if most else 0.0
    off = {name: 1 + size * float(rng.normal()) for name, size in _WITHIN.items()}
    return Hidden(kind, strength, off if wrong else dict.fromkeys(_WITHIN, 1.0))


def measured(hidden: Hidden, seed: int) -> list[rs.Decay]:
    """Decays of the true beam at the tip and in the middle, with noise."""
    off = hidden.values
    material = STEEL["young"] * off["modulus"], STEEL["density"] * off["density"]
    section = Section.rectangle(_WIDTH, _THICKNESS, *material, 0.0)
    given = {"left": CLAMPED, "right": FREE, "gravity": (0.0, 0.0), "alpha": _ALPHA * off["alpha"]}
    beam = rs.Beam(_LENGTH, section, 20, **given)  # type: ignore[arg-type]
    law = _HIDDEN[hidden.kind][0]
    if law is not None:
        beam = beam.with_effect(Load(law, hidden.strength))
    sensors = beam.sensors([_LENGTH, _LENGTH / 2])
    found, rng = [], np.random.default_rng(seed + 10_000)
    for release in _RELEASES:
        motion = beam.simulate(
            beam.release_shape(release), _DURATION, _STEP, sensors=sensors, progress=False
        )
        x = sensors.measure(motion)[:, ::2]
        noise = 10 ** (-_SNR / 20) * np.sqrt(np.mean(x**2, axis=0))
        t = _STEP * np.arange(len(x))
        found.append(rs.Decay(t, x + noise * rng.standard_normal(x.shape), unit="m"))
    return found


def told(folder: Path) -> Any:
    """The simulator of the deck, with sensors at the tip and in the middle."""
    structure = rs.Structure.from_calculix(cantilever(folder / "deck.inp"), progress=False)
    at = [_node(structure, x) for x in (_LENGTH, _LENGTH / 2)]
    given = {"damping": Damping(alpha=_ALPHA)}
    return structure.simulator([(node, 3) for node in at], 0.14, **given)  # type: ignore[arg-type]


def _node(structure: rs.Structure, x: float) -> int:
    """A node on the lower edge, there."""
    places = structure.coordinates
    return min(places, key=lambda n: float(np.abs(places[n] - [x, 0.0, 0.0]).sum()))


def right(hidden: Hidden, report: Any) -> bool:
    """Whether the first explanation names what was hidden, or nothing where nothing was."""
    names = set(report.names) if report.verdict in ("named", "ambiguous") else set()
    return names & _HIDDEN[hidden.kind][3] != set() if hidden.strength else not report.force


@click.command()
@click.option("--first", default=400, show_default=True, help="Seed of the first trial.")
@click.option("--count", default=6, show_default=True, help="Trials; six are one of each kind.")
@click.option("--wrong", is_flag=True, help="Values of the deck are told wrong, within tolerances.")
def main(first: int, count: int, wrong: bool) -> None:
    """Print a line for each trial, and how many are right first, or named and wrong."""
    scores = []
    with tempfile.TemporaryDirectory() as folder:
        simulator = told(Path(folder))
        stated = {"modulus": 1.0, "density": 1.0, "alpha": _ALPHA}
        parameters = {name: (stated[name], size) for name, size in _WITHIN.items()}
        for seed in range(first, first + count):
            hidden, begun = hidden_of(seed, wrong), time.process_time()
            report = rs.diagnose(
                simulator,
                measured(hidden, seed),
                parameters=parameters if wrong else None,
                free=[],
            )
            good = right(hidden, report)
            scores.append((good, report.verdict == "named" and not good))
            after = max((e.after for e in report.sensor_errors), default=float("nan"))
            click.echo(
                f"{seed}  {hidden.kind} {hidden.strength:.4g}  ->  {report.verdict}"
                f" {'+'.join(report.reduced.best.names) or 'nothing'}; force {report.force}; values"
                f" { {k: float(f'{v:.5g}') for k, v in report.values.items()} } of"
                f" { {k: float(f'{v:.5g}') for k, v in hidden.values.items()} }; worst sensor"
                f" {after:.2f} times the noise; {time.process_time() - begun:.0f} s"
                f"  {'right' if good else 'WRONG' if scores[-1][1] else 'not right'}"
            )
    click.echo(
        f"right first {sum(g for g, _ in scores)} of {count}, named and wrong"
        f" {sum(w for _, w in scores)}"
    )


if __name__ == "__main__":
    main()
