"""Blind trials on beams that Exudyn simulates; each is made once and stored.

    python benchmarks/diagnosis/exudyn_trials.py modal --count 20 --first 0 --cache FOLDER

FOLDER/<kind>_<seed>.npz holds the readings of three releases (two to learn from, one held out), and
what a diagnosis is told: the beam and the sensors as they are but for what is hidden ("exact"), and
wrong within stated tolerances ("wrong"). truth/<kind>_<seed>.json holds the rest. Kinds are those
of `KINDS`, and each with "_null" hides nothing; several take turns, one a seed. Exudyn has three
times the elements of the beam that is diagnosed. Needs `pip install "romsindy[exudyn]"`.
"""

from __future__ import annotations

import argparse
import json
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from beam_truth import BeamTruth, Spring
from exudyn_forces import LINEAR_DAMPING, MOUNTED, NAMES, OF_A_SPRING, Mode, with_hidden
from noises import COLOURS, noises

import romsindy as rs
from romsindy.beam import CLAMPED, FREE, PINNED, Beam, Section
from romsindy.beam.structure import Spring as OwnSpring
from romsindy.effects import PointMass

ELEMENTS, FINER = 12, 3
_ATTEMPTS = 5  # at a beam that Exudyn can hold and move


@dataclass(frozen=True)
class Kind:
    """How the beams of a kind are let go and held."""

    release: str
    supports: tuple[str, ...] = ("cantilever",)
    hidden: tuple[str, ...] = tuple(NAMES)

    def pace(self, supports: str) -> tuple[float, float, int]:
        """Step, s, length of a record, s, and steps between samples.

        The integrator delays the first mode by (omega h)^2 / 12, less than 4e-5; forces at
        points and a hit ring the second as well, so that they take shorter steps.
        """
        if supports != "cantilever":
            return 1.25e-4, 2.0, 12
        return (5e-4, 6.0, 8) if self.release == "modal" else (2.5e-4, 4.0, 16)


KINDS = {
    "modal": Kind("modal", ("cantilever", "cantilever", "cantilever", "pinned")),
    "tip": Kind("tip"),
    "hit": Kind("hit"),
    "clamped": Kind("modal", ("clamped",)),
    "tip_damping": Kind("tip", hidden=LINEAR_DAMPING),
    "modal_damping": Kind("modal", hidden=LINEAR_DAMPING),
    "tip_mounted": Kind("tip", hidden=MOUNTED),
    "modal_mounted": Kind("modal", hidden=MOUNTED),
    "hit_mounted": Kind("hit", hidden=MOUNTED),
    "bent_mounted": Kind("bent", hidden=MOUNTED),
}
# Relative standard deviations of what a diagnosis is told wrongly; positions in m.
TOLERANCES = {
    "length": 0.001,
    "thickness": 0.004,
    "density": 0.005,
    "modulus": 0.01,
    "mass_damping": 0.1,
    "material_damping": 0.1,
    "point_masses": 0.02,
    "spring_stiffness": 0.02,
    "pre_tension": 0.02,
    "anchor_x": 0.0005,
    "sensor_positions": 0.001,
}
_FIELDS = {
    "length": "length",
    "thickness": "thickness",
    "density": "density",
    "modulus": "young",
    "mass_damping": "alpha",
    "material_damping": "eta",
    "point_masses": "tip_mass",
}


@dataclass(frozen=True)
class BeamTrial:
    """What a diagnosis may see: readings, (n_samples, n_sensors) each, and what it is told."""

    dt: float
    readings: list[np.ndarray]
    told: dict  # "exact" and "wrong": beam, sensors; "tolerances"

    def beam(self, which: str) -> Beam:
        """The simulation, "exact" but for what is hidden, or "wrong"."""
        return beam_of(self.told[which]["beam"])

    def positions(self, which: str) -> list[float]:
        """Where it is told that the sensors are, m."""
        return self.told[which]["sensors"]

    def decays(self) -> list[rs.Decay]:
        """The records."""
        return [rs.Decay(self.dt * np.arange(len(y)), y, unit="m") for y in self.readings]


def beam_of(said: dict) -> Beam:
    """A beam of this package with the values of a truth."""
    left, right = {
        "cantilever": (CLAMPED, FREE),
        "clamped": (CLAMPED, CLAMPED),
        "pinned": (PINNED, PINNED),
    }[said["supports"]]
    effects = []
    if said["tip_mass"] > 0:
        effects.append(PointMass(said["tip_mass"]))
    if said["spring"] is not None:
        k, length, tension = (said["spring"][n] for n in ("stiffness", "length", "tension"))
        anchor = (said["length"] + length, 0.0)
        effects.append(OwnSpring(None, k, anchor, length - tension / k))
    section = Section.rectangle(said["width"], said["thickness"], said["young"], said["density"])
    return Beam(
        said["length"],
        section,
        ELEMENTS,
        left=left,
        right=right,
        alpha=said["alpha"],
        eta=said["eta"],
        effects=tuple(effects),
    )


# -- drawing -------------------------------------------------------------------------------------


def nominal(supports: str, rng: np.random.Generator):
    """A thin steel or aluminium strip of random size, with or without mass and spring."""
    steel = rng.random() < 0.7
    young, density = (210e9, 7800.0) if steel else (70e9, 2700.0)
    sizes = rng.uniform([0.4, 0.02, 0.0009], [0.5, 0.03, 0.0012])
    young, density = young * rng.uniform(0.97, 1.03), density * rng.uniform(0.98, 1.02)
    damping = rng.uniform([0.2, 0.5e-5], [0.5, 2e-5])
    if supports != "cantilever":
        damping[0] *= 3  # it turns three to five times as fast
    plain = BeamTruth(supports, *map(float, sizes), young, density, *map(float, damping))
    if supports != "cantilever":
        return plain
    mass = float(rng.uniform(0, 0.0015))
    if rng.random() < 0.25:
        return replace(plain, tip_mass=mass)
    stiff = rng.uniform([20, 0.085, 1.2], [28, 0.11, 1.7]) * (1.0 if steel else [0.4, 1, 0.4])
    return replace(plain, tip_mass=mass, spring=Spring(*map(float, stiff)))


def told_wrong(truth, sensors: Sequence[float], rng: np.random.Generator) -> tuple[dict, dict]:
    """Beam, sensors and tolerances as a diagnosis is told them; errors of at most two sigma."""
    values, known = {}, {}

    def error(name: str) -> float:
        known[name] = TOLERANCES[name]
        return TOLERANCES[name] * float(np.clip(rng.standard_normal(), -2, 2))

    for name, field in _FIELDS.items():
        if getattr(truth, field) > 0:
            values[field] = getattr(truth, field) * (1 + error(name))
    if truth.spring is not None:
        values["spring"] = _other_spring(truth, values["length"], error)
    places = [float(x + error("sensor_positions")) for x in sensors]
    length = values["length"]
    said = asdict(replace(truth, **values))
    # a sensor at the tip is put at the tip
    places = [
        length if x == truth.length else min(p, length)
        for x, p in zip(sensors, places, strict=True)
    ]
    return {"beam": said, "sensors": places}, known


def _other_spring(truth, length: float, error: Callable[[str], float]):
    """The spring as told: its stiffness, natural length and anchor are a little off."""
    s = truth.spring
    natural = s.length - s.tension / s.stiffness * (1 + error("pre_tension"))
    stiffness = s.stiffness * (1 + error("spring_stiffness"))
    installed = truth.length + s.length + error("anchor_x") - length
    return replace(
        s, stiffness=stiffness, length=installed, tension=stiffness * (installed - natural)
    )


def drawn(kind: str, seed: int, attempt: int = 0) -> tuple[BeamTrial, dict]:
    """One trial and its truth; another of the same seed and effect for each further attempt."""
    from exudyn_beam import ExudynBeam  # an extra: rows that are stored do without

    nothing = kind.endswith("_null")
    how = KINDS[kind.removesuffix("_null")]
    rng = np.random.default_rng([zlib.crc32(kind.encode()), seed, *range(1, attempt + 1)])
    supports = how.supports[int(rng.integers(len(how.supports)))]
    plain = nominal(supports, rng)
    length, elements = plain.length, FINER * ELEMENTS
    cantilever = supports == "cantilever"
    first = ExudynBeam(plain, elements, still=True)
    rest = first.static()
    omega, shape, _ = first.mode(rest)
    # largest release: about a fifth of a cantilever, or the thickness of the others
    reach = {"cantilever": length, "clamped": 5 * plain.thickness, "pinned": 2 * plain.thickness}
    top = rng.uniform(0.16, 0.28) * reach[supports]
    point = length if cantilever else 0.5 * length
    transverse = shape[1::3]
    q = top / abs(float(np.interp(point, first.x, transverse)))
    bend = float((shape[5] - shape[2]) / (first.x[1] - first.x[0]))
    mode = Mode(omega, first.x, transverse, rest[1::3], bend, q)
    hidden = "nothing" if nothing else _chosen(kind, seed, plain)
    truth, values = with_hidden(hidden, plain, mode, rng)
    sensors = _sensors(length, cantilever, rng)
    readings, dt = _measured(truth, elements, how, top, point, sensors, omega, rng)
    readings = _spoilt(hidden, readings, rng)
    colour = "white" if rng.random() < 0.6 else str(rng.choice(list(COLOURS)))
    snr_db = float(rng.uniform(30, 40))
    noisy = [_noisy(y, colour, snr_db, rng) for y in readings]
    exact = {"beam": asdict(plain), "sensors": sensors}
    wrong, tolerances = told_wrong(plain, sensors, rng)
    told = {"exact": exact, "wrong": wrong, "tolerances": tolerances}
    said = {
        "effects": {} if nothing else {_called(hidden, supports): values},
        "strength": "none" if nothing else "medium",
        "noise": colour,
        "snr_db": snr_db,
        "beam": asdict(truth),
        "place": values.get("place"),
    }
    return BeamTrial(dt, noisy, told), said


def _chosen(kind: str, seed: int, plain) -> str:
    """What is hidden: every effect in turn, one of a spring where there is one."""
    known = [n for n in KINDS[kind].hidden if (plain.supports, n) != ("pinned", "compliance")]
    if plain.spring is None:
        known = [n for n in known if n not in OF_A_SPRING]
    if plain.supports != "cantilever":
        known = [n for n in known if n not in ("cubic", "magnet", "drag", "gap")]
    order = np.random.default_rng([zlib.crc32(kind.encode()), seed // len(known)])
    return known[order.permutation(len(known))[seed % len(known)]]


def _called(hidden: str, supports: str) -> str:
    """What a diagnosis calls it: a beam that can stretch has a modulus beside its stiffness."""
    stretches = hidden == "modulus" and supports != "cantilever"
    return "modulus" if stretches else NAMES[hidden]


def _sensors(length: float, cantilever: bool, rng: np.random.Generator) -> list[float]:
    """Four to six, spread along the beam."""
    count = int(rng.integers(4, 7))
    ends = (0.25, 1.0) if cantilever else (0.15, 0.85)
    places = np.linspace(*ends, count) + np.append(rng.uniform(-0.04, 0.04, count - 1), 0.0)
    return [float(length * p) for p in places]


def _measured(truth, elements, how, top, point, sensors, omega, rng):
    """Readings of three releases, and the time between samples."""
    from exudyn_beam import ExudynBeam

    beam, moving = (ExudynBeam(truth, elements, still) for still in (True, False))
    rest = beam.static()
    node = int(np.argmin(np.abs(beam.x - point)))
    step, duration, every = how.pace(truth.supports)
    _, shape, modal = beam.mode(rest)
    pattern = modal
    if how.release in ("tip", "bent"):
        pattern = np.zeros_like(modal)
        pattern[3 * node + 1] = 1.0
    if how.release == "bent":  # at a second point as well, to either side
        second = int(np.argmin(np.abs(beam.x - rng.uniform(0.4, 0.7) * truth.length)))
        pattern[3 * second + 1] = rng.uniform(-1.5, 1.5)
    found = []
    for share in (1.0, rng.uniform(0.55, 0.7), rng.uniform(0.75, 0.9)):
        height = share * top * rng.choice([-1.0, 1.0])
        if how.release == "hit":
            struck = int(np.argmin(np.abs(beam.x - rng.uniform(0.5, 1) * truth.length)))
            blow, length = _blow(height, shape[1::3], struck, node, omega, rng)
            moving = ExudynBeam(truth, elements, struck=struck)
            motion = moving.motion(rest, duration, step, every, blow)
            motion = motion[int(length / (every * step)) + 1 :]
        else:
            start = beam.held_at(pattern, node, height, rest)
            motion = moving.motion(start, duration, step, every)
        found.append(moving.read(motion, rest, sensors))
    # the integrator's period error of the first mode is taken off the time base
    return found, every * step * (1 - (omega * step) ** 2 / 12)


def _blow(height, shape, struck, node, omega, rng):
    """Half a sine of some milliseconds that throws the first mode to a height; its length."""
    length = float(rng.uniform(0.006, 0.02))
    impulse = abs(height / shape[node]) * omega / shape[struck] * np.sign(height)
    peak = impulse * np.pi / (2 * length)
    return lambda t: float(peak * np.sin(np.pi * t / length)) if t < length else 0.0, length


def _spoilt(hidden, readings, rng):
    """Readings of which one channel is faulty, if that is what is hidden."""
    channel = int(rng.integers(readings[0].shape[1]))
    size, side = rng.uniform(0.7, 1.5), float(rng.choice([-1.0, 1.0]))
    top = max(np.abs(y[:, channel]).max() for y in readings)
    faults = {
        "sensor_gain": lambda x: x * (1 + 0.05 * size * side),
        "sensor_offset": lambda x: x + 0.03 * size * side * top,
        "sensor_saturation": lambda x: np.clip(
            x, -(1 - 0.12 * size) * top, (1 - 0.12 * size) * top
        ),
    }
    bad = [y.copy() for y in readings]
    for y in bad if hidden in faults else ():
        y[:, channel] = faults[hidden](y[:, channel])
    return bad


def _noisy(y, colour, snr_db, rng):
    columns = [x + noises(colour, [x], [1.0], snr_db + rng.uniform(-3, 3), rng)[0] for x in y.T]
    return np.stack(columns, axis=1)


# -- files ---------------------------------------------------------------------------------------


def beam_trial(kind: str, seed: int, folder: Path) -> tuple[BeamTrial, dict]:
    """A trial and its truth, made and stored if it is not there."""
    path, hidden = folder / f"{kind}_{seed}.npz", folder / "truth" / f"{kind}_{seed}.json"
    if not path.is_file():
        trial, truth = _made(kind, seed)
        hidden.parent.mkdir(parents=True, exist_ok=True)
        hidden.write_text(json.dumps(truth))
        arrays = {f"y{i}": y for i, y in enumerate(trial.readings)}
        np.savez(path, told=json.dumps(trial.told), dt=trial.dt, **arrays)
    with np.load(path) as content:
        readings = [content[f"y{i}"] for i in range(len(content.files) - 2)]
        told, dt = json.loads(str(content["told"])), float(content["dt"])
    return BeamTrial(dt, readings, told), json.loads(hidden.read_text())


def _made(kind: str, seed: int) -> tuple[BeamTrial, dict]:
    """The first attempt that Exudyn finishes: some bent shapes its statics cannot hold."""
    from exudyn import ExudynError

    for attempt in range(_ATTEMPTS - 1):
        try:
            return drawn(kind, seed, attempt)
        except ExudynError as error:
            print(f"{kind} {seed}: drawn again, since Exudyn says: {error}", flush=True)
    return drawn(kind, seed, _ATTEMPTS - 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    kinds = [*KINDS, *(f"{kind}_null" for kind in KINDS)]
    parser.add_argument("kinds", nargs="+", choices=kinds)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cache", type=Path, default=Path("trials"))
    chosen = parser.parse_args()
    for seed in range(chosen.first, chosen.first + chosen.count):
        kind = chosen.kinds[seed % len(chosen.kinds)]
        beam_trial(kind, seed, chosen.cache)
        print(kind, seed, flush=True)


if __name__ == "__main__":
    main()
