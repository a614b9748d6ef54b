"""Blind trials of places: what is missing on a structure of arrays, and at which node?

The structure is a plane chain of masses with springs that stretch and springs that bend, clamped
at both ends, stiffer over a third. Its modes and static cases go to romsindy as arrays; the truth
is the whole chain in time (all its freedoms, no modes) with something hidden at a node that is
drawn, with noise at three sensors.

    python benchmarks/structure_trials.py --first 700 --count 12
    python benchmarks/structure_trials.py --first 800 --count 12 --wrong   # told wrong
    python benchmarks/structure_trials.py --first 900 --count 6 --colour 0.9  # noise with a memory
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import click
import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.signal import lfilter

import romsindy as rs
from romsindy.structure.simulator import Damping
from romsindy.typing import Array

_N, _LENGTH = 15, 0.6  # free masses; m
_MASS, _STRETCH, _BEND = 0.02, 2e4, 1.2  # kg, N, N m^2
_STIFFER = slice(3, 8), 3.0  # joints that bend less, and how much less
_ALPHA = 0.5  # 1/s
_SENSORS = (8, 4, 12)  # nodes, counted from 1; let go at the first
_RELEASES, _DURATION, _RATE, _SNR = (6e-3, 3.5e-3), 4.0, 1500.0, 40.0
_ITERATIONS = 30
_WITHIN = {"modulus": 0.03, "density": 0.02, "alpha": 0.2}
# Strengths from least to most, and names that are right.
_HIDDEN: dict[str, tuple[float, float, set[str]]] = {
    "nothing": (0.0, 0.0, set()),
    "damper": (0.1, 0.3, {"viscous"}),
    "drag": (1.0, 3.0, {"quadratic_drag"}),
    "cubic spring": (5e6, 2e7, {"cubic_stiffness"}),
    "spring": (20.0, 60.0, {"linear_frequency"}),
    "mass": (4e-3, 1.2e-2, {"added_mass"}),
}


class Chain(NamedTuple):
    """The structure, its values over those that are told."""

    modulus: float = 1.0
    density: float = 1.0
    alpha: float = 1.0

    @property
    def mass(self) -> Array:
        """Of each freedom, along and across in turn, (2 n,), kg."""
        return np.full(2 * _N, self.density * _MASS)

    def pull(self, x: Array) -> Array:
        """Forces that hold displacements (2 n,), N."""
        piece = _LENGTH / (_N + 1)
        places = np.zeros((_N + 4, 2))
        places[:, 0] = piece * np.arange(-1, _N + 3)
        places[2:-2] += x.reshape(_N, 2)
        d = np.diff(places, axis=0)
        size = np.linalg.norm(d, axis=1)
        pulled = np.zeros_like(places)
        tension = _STRETCH * (size / piece - 1)
        along = (tension / size)[:, None] * d
        pulled[:-1] -= along
        pulled[1:] += along
        # The angle between two pieces, and what turns with it.
        angle = np.arctan2(d[:, 1], d[:, 0])
        stiffness = np.full(len(angle) - 1, _BEND / piece)
        stiffness[1:][_STIFFER[0]] *= _STIFFER[1]
        moment = stiffness * np.diff(angle)
        turned = np.stack([-d[:, 1], d[:, 0]], axis=1) / size[:, None] ** 2
        for sign, pieces in ((-1, turned[:-1]), (1, turned[1:])):
            push = sign * moment[:, None] * pieces
            first = 0 if sign < 0 else 1
            pulled[first : first + len(push)] -= push
            pulled[first + 1 : first + 1 + len(push)] += push
        return self.modulus * pulled[2:-2].ravel()


class Hidden(NamedTuple):
    """What a trial hides, and at which node."""

    kind: str
    node: int
    strength: float
    values: dict[str, float]


def hidden_of(seed: int, wrong: bool) -> Hidden:
    """What the trial of a seed hides, one kind after the other."""
    rng = np.random.default_rng(seed)
    kind = [*_HIDDEN][seed % len(_HIDDEN)]
    least, most, _ = _HIDDEN[kind]
    strength = float(np.exp(rng.uniform(np.log(least), np.log(most)))) if most else 0.0
    node = int(rng.integers(4, _N - 2))
    off = {name: 1 + size * float(rng.normal()) for name, size in _WITHIN.items()}
    return Hidden(kind, node, strength, off if wrong else dict.fromkeys(_WITHIN, 1.0))


def measured(hidden: Hidden, seed: int, colour: float = 0.0) -> list[rs.Decay]:
    """Decays of the whole chain, let go from where a force holds the first sensor.

    Samples of the noise follow the one before by ``colour``.
    """
    chain, row = Chain(**hidden.values), 2 * (hidden.node - 1) + 1
    mass, c, s = chain.mass, _ALPHA * chain.alpha, hidden.strength
    if hidden.kind == "mass":
        mass[row - 1 : row + 1] += s
    own = c * mass  # what is added is damped as all mass is

    def added(x: Array, v: Array) -> float:
        laws = {
            "damper": -s * v[row],
            "drag": -s * v[row] * abs(v[row]),
            "spring": -s * x[row],
            "cubic spring": -s * x[row] ** 3,
        }
        return float(laws.get(hidden.kind, 0.0))

    def forces(x: Array, v: Array) -> Array:
        total = -chain.pull(x) - own * v
        total[row] += added(x, v)
        return np.asarray(total)

    def moved(_: float, y: Array) -> Array:
        x, v = y[: 2 * _N], y[2 * _N :]
        return np.concatenate([v, forces(x, v) / mass])

    first = 2 * (_SENSORS[0] - 1) + 1
    t, rng, found = np.arange(0, _DURATION, 1 / _RATE), np.random.default_rng(seed + 10_000), []
    for release in _RELEASES:
        held = _held(lambda x: -forces(x, 0 * x), first, release)
        y = np.concatenate([held, 0 * held])
        done = solve_ivp(moved, (0, t[-1]), y, "DOP853", t, rtol=1e-7, atol=1e-9)
        x = done.y[[2 * (n - 1) + 1 for n in _SENSORS]].T
        size = 10 ** (-_SNR / 20) * np.sqrt(np.mean(x**2, axis=0))
        noise = lfilter(
            [np.sqrt(1 - colour**2)], [1, -colour], rng.standard_normal(x.shape), axis=0
        )
        found.append(rs.Decay(t, x + size * noise, unit="m"))
    return found


def _still(left: Callable[[Array], Array], x: Array) -> Array:
    """Where nothing is left of forces, by Newton from a guess."""
    step = 1e-9 * np.eye(len(x))
    for _ in range(_ITERATIONS):
        slopes = np.array([(left(x + e) - left(x - e)) / 2e-9 for e in step]).T
        x = x - np.linalg.solve(slopes, left(x))
        if np.abs(left(x)).max() < 1e-8:
            return x
    raise ValueError(f"forces of {np.abs(left(x)).max():.2g} N are left")


def _held(pull: Callable[[Array], Array], row: int, release: float) -> Array:
    """Where a force at one freedom holds it displaced by so much."""
    shape = np.zeros(2 * _N)
    shape[1::2] = np.sin(np.pi * np.arange(1, _N + 1) / (_N + 1)) ** 2
    x, parts = 1e-3 * release * shape / shape[row], np.linspace(0, 1, 9)[1:]
    free = np.arange(2 * _N) != row
    for part in parts:
        x = x * part * release / x[row]

        def left(z: Array, part: float = part) -> Array:
            return np.where(free, pull(z), 1e4 * (z[row] - part * release) * ~free)

        x = _still(left, x)
    return x


def _tangent(chain: Chain, x: Array) -> Array:
    """Stiffness about displacements, by differences."""
    small = 1e-7 * np.eye(2 * _N)
    found = np.array([(chain.pull(x + e) - chain.pull(x - e)) / 2e-7 for e in small])
    return (found + found.T) / 2


def told() -> Any:
    """The simulator of the chain, from its arrays."""
    chain = Chain()
    omega2, shapes = eigh(_tangent(chain, np.zeros(2 * _N)), np.diag(chain.mass))
    shape, size = shapes[:, 0], 9e-3 / np.abs(shapes[1::2, 0]).max()
    q = size * np.array([x for x in np.linspace(-1, 1, 17) if x])
    factors = omega2[0] * q * (1 + 3 * (q / size) ** 2)
    held = np.zeros((len(factors), 2 * _N))
    for side in (np.flatnonzero(q < 0)[::-1], np.flatnonzero(q > 0)):
        x, before = 0 * shape, None
        for i in side:
            f = factors[i]
            guess = f / omega2[0] * shape if before is None else x * (f / before) ** 0.5
            x = _still(lambda x, f=f: chain.pull(x) - f * chain.mass * shape, guess)
            held[i], before = x, f
    piece = _LENGTH / (_N + 1)
    structure = rs.Structure.from_arrays(
        np.diag(chain.mass),
        shapes.T[:12],
        np.sqrt(omega2[:12]),
        {1: (factors, held)},
        np.repeat(np.arange(1, _N + 1), 2),
        np.tile([1, 3], _N),
        {i: (piece * i, 0.0, 0.0) for i in range(1, _N + 1)},
        tangents={1: [_tangent(chain, x) for x in held]},
    )
    given = {"damping": Damping(alpha=_ALPHA)}
    return structure.simulator([(n, 3) for n in _SENSORS], **given)  # type: ignore[arg-type]


def right(hidden: Hidden, report: Any) -> bool:
    """Whether the first explanation names what was hidden, or nothing where nothing was."""
    names = set(report.names) if report.verdict in ("named", "ambiguous") else set()
    if not hidden.strength:
        return report.force is None and not report.mass
    return names & _HIDDEN[hidden.kind][2] != set()


def holds(hidden: Hidden, report: Any) -> bool | None:
    """Whether the interval of the place holds the node; None where none is told."""
    place = report.place
    if place is None or not hidden.strength:
        return None
    return bool(place.low[0] - 1e-9 <= _LENGTH / (_N + 1) * hidden.node <= place.high[0] + 1e-9)


@click.command()
@click.option("--first", default=700, show_default=True, help="Seed of the first trial.")
@click.option("--count", default=6, show_default=True, help="Trials; six are one of each kind.")
@click.option("--wrong", is_flag=True, help="Values are told wrong, within tolerances.")
@click.option("--colour", default=0.0, help="Of the noise: 0 is white.")
def main(first: int, count: int, wrong: bool, colour: float) -> None:
    """Print a line for each trial, and how many are right first, or named and wrong."""
    simulator, scores, places = told(), [], []
    stated = {"modulus": 1.0, "density": 1.0, "alpha": _ALPHA}
    told_of = [*_WITHIN] if wrong else ["modulus", "density"]
    parameters = {name: (stated[name], _WITHIN[name] if wrong else None) for name in told_of}
    for seed in range(first, first + count):
        hidden, begun = hidden_of(seed, wrong), time.process_time()
        records = measured(hidden, seed, colour)
        report = rs.diagnose(simulator, records, parameters=parameters, free=[])
        good, there = right(hidden, report), holds(hidden, report)
        scores.append((good, report.verdict == "named" and not good))
        places += [] if there is None else [there]
        errors = [e.after for e in report.sensor_errors]
        worst = f"{max(errors):.2f} times the noise" if errors else "not simulated"
        click.echo(
            f"{seed}  {hidden.kind} {hidden.strength:.4g} at node {hidden.node}  ->"
            f"  {report.verdict} {'+'.join(report.reduced.best.names) or 'nothing'};"
            f" {report.recipe.splitlines()[0] if report.recipe else ''}; place {report.place};"
            f" worst sensor {worst}; {time.process_time() - begun:.0f} s"
            f"  {'right' if good else 'WRONG' if scores[-1][1] else 'not right'}"
            f"{'' if there is None else ', place within' if there else ', place not within'}"
        )
    click.echo(
        f"right first {sum(g for g, _ in scores)} of {count}, named and wrong"
        f" {sum(w for _, w in scores)}; place within its interval {sum(places)} of {len(places)}"
    )


if __name__ == "__main__":
    main()
