"""Blind trials on a finite-element beam: physical effects hidden in it, five noisy sensors.

    python benchmarks/diagnosis/structure.py --seeds 0 2 --jobs 2 [--free] [--release tip]
        [--supports clamped]

Every seed hides each effect once in a beam of random nominal values, with a random strength and 30
to 40 dB; two decays of 20 s to learn from, one held out. A diagnosis sees the nominal beam and
the readings; names are compared afterwards. Prints the headline right, the truth in the reported
set, the wrong pairs and the held-out error over the noise (median). ``--free``: the linear
frequency and damping of the beam are unsure. ``--release tip``: a force at the tip (at mid-span
of a clamped beam) holds the beam before it is let go, not the force of its first mode.
``--supports clamped``: both ends are clamped, effects act at mid-span, and the beam has neither a
spring nor a tip mass.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace

import numpy as np
from joblib import Parallel, delayed

import romsindy as rs
from romsindy.beam import CLAMPED, FREE, Beam, Section, SensorArray, Shape
from romsindy.beam.changes import ClampCompliance, ExtraTension
from romsindy.beam.sensors import Sensor
from romsindy.beam.spring import find_spring
from romsindy.effects import (
    AirDrag,
    AtPoint,
    CubicStiffness,
    Damper,
    DryFriction,
    Load,
    PointMass,
    SpringFriction,
    Stop,
    TowardsAnchor,
    TwoSidedGap,
)
from romsindy.physics.stiffness import MagnetForce
from romsindy.record.signals import with_noise

# Largest coordinates of the three records, kg^0.5 m; a clamped beam stiffens early.
AMPLITUDES = {"cantilever": (0.017, 0.011, 0.014), "clamped": (2e-4, 1.3e-4, 1.65e-4)}
PLACES = {
    "cantilever": (0.27, 0.45, 0.62, 0.8, 1.0),
    "clamped": (0.15, 0.3, 0.5, 0.7, 0.85),
}
STEPS = {"cantilever": 4e-3, "clamped": 2e-3}  # s
DURATIONS = {"cantilever": 20.0, "clamped": 10.0}  # s


def nominal(rng: np.random.Generator, supports: str) -> Beam:
    """A beam near the default one, or one of its section with both ends clamped."""
    near = rng.uniform(0.9, 1.1, 5)
    length, thickness = 0.45 * near[0] ** 0.5, 0.001 * near[1] ** 0.5
    if supports == "clamped":
        section = Section.rectangle(0.025, thickness, 210e9, 7800.0)
        return Beam(length, section, 20, right=CLAMPED, alpha=0.37, eta=1e-5)
    return Beam.cantilever(
        length=length,
        thickness=thickness,
        tip_mass=0.0008 * near[2],
        spring_stiffness=24.4 * near[3],
        spring_pretension=1.51 * near[4],
        elements=20,
    )


def hidden(name: str, beam: Beam, rng: np.random.Generator, reach: float) -> Beam:
    """The beam with an effect of random strength.

    ``reach`` is about the amplitude, in m, of the point where effects act at the largest release.
    """
    size, side = rng.uniform(0.7, 1.5), float(rng.choice([-1.0, 1.0]))
    at = None if beam.right == FREE else beam.length / 2
    rest = float(np.vdot(beam.point_load((0.0, 1.0), at=at), beam.equilibrium().displacement))
    if name == "bending_stiffness":
        section = replace(beam.section, EI=beam.section.EI * (1 + 0.02 * size * side))
        return replace(beam, section=section)
    if name == "spring_stiffness":
        spring = find_spring(beam)
        new = replace(spring, stiffness=spring.stiffness * (1 + 0.05 * size * side))
        return replace(beam, effects=tuple(new if e is spring else e for e in beam.effects))
    if name == "mass_damping":
        return replace(beam, alpha=beam.alpha + 0.1 * size)
    if name == "material_damping":
        return replace(beam, eta=beam.eta + 8e-5 * size)
    gap = rng.uniform(0.4, 0.7) * reach
    here, at_rest = AtPoint(at), AtPoint(at, datum=rest)
    # N/m, of contacts: a few per cent of the beam's own at that point
    stiffness = (0.5 if at is None else 200.0) * size
    pole = (beam.length, rest + side * 1.5 * reach)
    effect = {
        # 1/2 density of air, drag coefficient 1.2, width 25 mm
        "quadratic_drag": lambda: AirDrag().on_beam(0.5 * 1.2 * 0.025 * 1.2 * size),
        "viscous": lambda: Damper().on_beam(2e-3 * size, here),
        "dry_friction": lambda: DryFriction().on_beam(5e-4 * size, here),
        "added_mass": lambda: PointMass(3e-4 * size, at),
        "pre_tension": lambda: ExtraTension(tension=0.03 * size * side),
        "clamp_compliance": lambda: ClampCompliance(compliance=5e-3 * size),
        "cubic_stiffness": lambda: CubicStiffness().on_beam(100.0 * size * side),
        "stop": lambda: Stop(int(side), side * gap).on_beam(stiffness, at_rest),
        "two_sided_gap": lambda: TwoSidedGap(gap).on_beam(stiffness, at_rest),
        # two dipoles, 1e-6 N m^4
        "magnet": lambda: Load(
            MagnetForce(0.1, -1, 4.0), 1e-6 * size / 0.1**4, TowardsAnchor(pole, length=0.1)
        ),
        "spring_friction": lambda: SpringFriction().on_beam(0.02 * size),
    }[name]()
    return beam.with_effect(effect)


EFFECTS = (
    "none",
    "viscous",
    "mass_damping",
    "material_damping",
    "quadratic_drag",
    "dry_friction",
    "spring_friction",
    "bending_stiffness",
    "added_mass",
    "spring_stiffness",
    "pre_tension",
    "clamp_compliance",
    "cubic_stiffness",
    "stop",
    "two_sided_gap",
    "magnet",
    "sensor_gain",
    "sensor_offset",
    "sensor_saturation",
)


# A beam with both ends clamped has no spring, and moves too little for these.
OF_A_CANTILEVER = (
    "spring_friction",
    "spring_stiffness",
    "pre_tension",
    "cubic_stiffness",
    "magnet",
    "quadratic_drag",
)


def spoilt(name: str, readings: list[np.ndarray], rng: np.random.Generator) -> list[np.ndarray]:
    """Readings of which one channel is faulty."""
    channel = int(rng.integers(readings[0].shape[1]))
    size, side = rng.uniform(0.7, 1.5), rng.choice([-1.0, 1.0])
    top = max(np.abs(y[:, channel]).max() for y in readings)
    bad = []
    for y in readings:
        y = y.copy()
        if name == "sensor_gain":
            y[:, channel] *= 1 + 0.05 * size * side
        elif name == "sensor_offset":
            y[:, channel] += 0.03 * size * side * top
        elif name == "sensor_saturation":
            limit = (1 - 0.12 * size) * top
            y[:, channel] = np.clip(y[:, channel], -limit, limit)
        bad.append(y)
    return bad


def trial(
    name: str, seed: int, duration: float | None, free: bool, supports: str, release: str
) -> dict:
    """Hide an effect, diagnose, and compare."""
    rng = np.random.default_rng([seed, EFFECTS.index(name)])
    beam = nominal(rng, supports)
    sensors = beam.sensors([Sensor(place * beam.length) for place in PLACES[supports]])
    at = None if supports == "cantilever" else beam.length / 2
    moved = float(np.vdot(beam.point_load((0.0, 1.0), at=at), beam.modes(count=1).shapes[0]))
    heights = [q * moved for q in AMPLITUDES[supports]]
    of_truth = name != "none" and not name.startswith("sensor_")
    truth = hidden(name, beam, rng, heights[0]) if of_truth else beam
    snr = rng.uniform(30, 40)
    step, duration = STEPS[supports], duration or DURATIONS[supports]
    mode = 1 if release == "mode" else None
    shapes = [truth.release_shape(h, mode, at) for h in heights]
    clean = [_readings(truth, shape, sensors, duration, step) for shape in shapes]
    noisy = [with_noise(y, snr, 3 * seed + i) for i, y in enumerate(clean)]
    decays = [rs.Decay(step * np.arange(len(y)), y, unit="m") for y in spoilt(name, noisy, rng)]
    start = time.perf_counter()
    report = rs.diagnose(
        beam,
        decays[:2],
        sensors=sensors,
        held_out=decays[2],
        free=("omega^2", "c_linear") if free else (),
    )
    faults = tuple(f"sensor_{f.kind}" for f in report.faults)
    return {
        "hidden": name,
        "seed": seed,
        "verdict": report.verdict,
        "said": "+".join(report.names),
        "set": ["+".join((*faults, *names)) for names in report.equivalent] or ["+".join(faults)],
        "before": report.gap.before,
        "after": report.gap.after,
        "sensors": [float(np.median(e)) for e in _per_sensor(report)],
        "seconds": time.perf_counter() - start,
    }


def _readings(
    beam: Beam, shape: Shape, sensors: SensorArray, duration: float, step: float
) -> np.ndarray:
    motion = beam.simulate(shape, duration, step, sensors=sensors, progress=False)
    return sensors.measure(motion)


def _per_sensor(report) -> list[list[float]]:
    """Errors over noise of the beam itself on the held-out record, before and after."""
    return [[e.before for e in report.sensor_errors], [e.after for e in report.sensor_errors]]


def judge(row: dict) -> dict:
    """Add the marks to a result."""
    truth = "" if row["hidden"] == "none" else row["hidden"]
    right = row["said"] == truth and (row["verdict"] != "unknown" or not truth)
    return row | {"right": right, "in_set": right or truth in row["set"]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 1), metavar=("FROM", "TO"))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--duration", type=float, help="of every decay, s")
    parser.add_argument("--supports", choices=list(AMPLITUDES), default="cantilever")
    parser.add_argument("--release", choices=("mode", "tip"), default="mode")
    parser.add_argument("--effects", nargs="+", default=EFFECTS, choices=EFFECTS)
    parser.add_argument("--free", action="store_true", help="frequency and damping are unsure")
    chosen = parser.parse_args()
    work = [
        delayed(trial)(name, seed, chosen.duration, chosen.free, chosen.supports, chosen.release)
        for seed in range(*chosen.seeds)
        for name in chosen.effects
        if chosen.supports == "cantilever" or name not in OF_A_CANTILEVER
    ]
    rows = []
    for result in Parallel(chosen.jobs, return_as="generator_unordered")(work):
        rows.append(judge(result))
        mark = "right" if rows[-1]["right"] else "in set" if rows[-1]["in_set"] else "WRONG"
        r = rows[-1]
        print(
            f"{r['hidden']:18} {r['seed']:3} {mark:7} {r['verdict']:10} {r['said'] or 'nothing'}"
            f"  {r['before']:.3g} -> {r['after']:.3g}, sensors {r['sensors'][1]:.3g}"
            f"  {r['seconds']:.0f} s",
            flush=True,
        )
    show(rows)


def show(rows: list[dict]) -> None:
    """Print the summary."""
    n = len(rows)
    wrong = Counter((r["hidden"], r["said"] or "nothing") for r in rows if not r["right"])
    print(f"\n{n} trials: headline right {sum(r['right'] for r in rows)} of {n},", end=" ")
    print(f"truth in the set {sum(r['in_set'] for r in rows)} of {n}")
    confident = sum(r["verdict"] == "named" and not r["right"] for r in rows)
    print(f"named and wrong {confident} of {n}")
    for (truth, said), count in sorted(wrong.items()):
        print(f"  {truth} was called {said}: {count}")
    after = [r["after"] for r in rows if r["right"]]
    if after:
        print(f"held-out error over noise where right: median {np.median(after):.3g}")
    sensors = [r["sensors"] for r in rows if r["right"]]
    if sensors:
        before, then = np.median(np.array(sensors), axis=0)
        print(f"the beam itself, median sensor: {before:.3g} -> {then:.3g} times the noise")
    print(f"median time of a diagnosis {np.median([r['seconds'] for r in rows]):.0f} s")


if __name__ == "__main__":
    main()
