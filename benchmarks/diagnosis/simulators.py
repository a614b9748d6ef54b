"""Blind trials: users' own simulators, and what a measurement has that they lack.

    python benchmarks/diagnosis/simulators.py --first 0 --count 40 --nulls 8 --list

A trial is drawn from its seed alone, and shares no class with romsindy. Kinds take turns: a
function with a force at its first sensor, one without, two masses in a chain that are let go from
under a static load (two sensors, both modes ring), and a program, Octave's ode45 with a file of
the force (left out where octave-cli is not installed). The nonlinear oscillators have a cubic
spring, damping ratios of 0.1 to 1 %, 0.5 to 40 Hz; what is hidden acts at the first sensor: dry
friction, a dashpot, drag, a stop, a cubic spring, a stiffer spring. Two records of 40 to 120 cycles
from two releases, one in three cut some time after its release, and a third that is held out; white
noise 40 dB below the response. Integrated by scipy's DOP853. Seeds below 50000 are for development.

Right first, in the set, named and wrong are counted as in run.py; and in how many of what can be
added the simulator itself, run again with it, comes down to 1.2 times the noise at every sensor of
the record that took no part.
"""

from __future__ import annotations

import argparse
import math
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from marked import asked_of
from scipy.integrate import solve_ivp
from score import line, problems

import romsindy as rs
from romsindy.simulator import Program

KINDS = ("force", "alone", "chain", "program")
HIDDEN = {
    "dry_friction": "dry_friction",
    "viscous": "viscous",
    "drag": "quadratic_drag",
    "stop": "stop",
    "cubic": "cubic_stiffness",
    "spring": "linear_frequency",
}
GOOD = 1.2  # times the noise
_SNR_DB, _PER_CYCLE = 40.0, 40
_OCTAVE = """\
args = argv();
release = str2double(args{1}); out = args{2};
duration = str2double(args{3}); step = str2double(args{4});
[folder, name] = fileparts(args{5});
addpath(folder);
rates = @(t, y) [y(2); (-DAMPING * y(2) - STIFFNESS * y(1) - CUBIC * y(1)^3 ...
                        + force(t, y(1), y(2))) / MASS];
t = (0:step:duration + step / 2)';
[~, y] = ode45(rates, t, [release; 0], odeset('RelTol', 1e-6, 'AbsTol', 1e-8 * abs(release)));
dlmwrite(out, [t, y(:, 1)], 'precision', 16);
"""


@dataclass(frozen=True)
class Structure:
    """An oscillator, or two masses in a chain of which the second one is seen first."""

    mass: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    cubic: float  # of the spring to the ground, N/m^3
    reach: float  # of the first sensor, m

    @classmethod
    def drawn(cls, rng: np.random.Generator, two: bool) -> Structure:
        rate = 2 * math.pi * math.exp(rng.uniform(math.log(0.5), math.log(40)))
        mass, reach = (
            math.exp(rng.uniform(-3, 1)),
            math.exp(rng.uniform(math.log(3e-4), math.log(0.05))),
        )
        ratio = math.exp(rng.uniform(math.log(1e-3), math.log(1e-2)))
        k = mass * rate**2
        cubic = k * rng.uniform(0.05, 0.4) / reach**2
        if not two:
            one = np.eye(1)
            return cls(mass * one, k * one, 2 * ratio * rate * mass * one, cubic, reach)
        masses = np.diag([0.6, 0.4]) * mass
        link = k * rng.uniform(3.0, 8.0)
        springs = np.array([[k + link, -link], [-link, link]])
        # Proportional to stiffness: the second mode is damped several times as much.
        return cls(masses, springs, 2 * ratio / rate * springs, cubic, reach)

    @property
    def rate(self) -> float:
        """Of the first mode, rad/s."""
        return float(np.sqrt(np.linalg.eigvals(np.linalg.solve(self.mass, self.stiffness)).min()))

    def motion(self, release: float, t: np.ndarray, force: Callable | None) -> np.ndarray:
        """Displacements (n, n_sensors), the last mass first."""
        n, inverse = len(self.mass), np.linalg.inv(self.mass)
        shape = np.linalg.solve(self.stiffness, np.eye(n)[-1])

        def rates(now, y):
            x, v = y[:n], y[n:]
            push = -self.stiffness @ x - self.damping @ v
            push[0] -= self.cubic * x[0] ** 3
            if force is not None:
                push[-1] += force(now, x[-1], v[-1])
            return np.concatenate([v, inverse @ push])

        start = np.concatenate([release * shape / shape[-1], np.zeros(n)])
        limits = 1e-9 * abs(release) * np.repeat([1.0, self.rate], n)
        done = solve_ivp(
            rates, (0, t[-1]), start, "DOP853", t, rtol=1e-8, atol=limits, max_step=0.5 / self.rate
        )
        return done.y[n - 1 :: -1].T if n > 1 else done.y[:1].T


def hidden_force(name: str, s: Structure, rng: np.random.Generator) -> Callable:
    """What is hidden, N: it changes the frequency by some per mille, or the damping by a part."""
    rate, reach = s.rate, s.reach
    k = 1 / np.linalg.inv(s.stiffness)[-1, -1]  # of the first sensor
    ratio = float(s.damping[-1, -1] / s.stiffness[-1, -1]) * rate / 2 if len(s.mass) > 1 else 0.0
    ratio = ratio or float(s.damping[0, 0] / (2 * rate * s.mass[0, 0]))
    size = rng.uniform(0.3, 1.0)
    if name == "dry_friction":
        level, turn = size * ratio * k * reach, 1e-3 * rate * reach
        return lambda t, x, v: -level * math.tanh(v / turn)
    if name == "viscous":
        c = 2 * size * ratio * k / rate
        return lambda t, x, v: -c * v
    if name == "drag":
        c = 3 * size * ratio * k / rate**2 / reach
        return lambda t, x, v: -c * abs(v) * v
    if name == "stop":
        gap, stop = rng.uniform(0.4, 0.7) * reach, size * 0.4 * k
        return lambda t, x, v: -stop * max(x - gap, 0.0)
    if name == "cubic":
        c = 0.05 * size * k / reach**2
        return lambda t, x, v: -c * x**3
    more = 0.02 * size * k
    return lambda t, x, v: -more * x


def trial(seed: int, null: bool, kinds: tuple[str, ...], folder: Path) -> dict:
    """One simulator beside three records: marks, and the error of the simulator itself."""
    rng = np.random.default_rng([83, seed])
    kind, name = kinds[seed % len(kinds)], list(HIDDEN)[(seed // len(kinds)) % len(HIDDEN)]
    s = Structure.drawn(rng, kind == "chain")
    force = None if null else hidden_force(name, s, rng)
    period = 2 * math.pi / s.rate
    step = period / _PER_CYCLE
    records = []
    for part in (1.0, rng.uniform(0.5, 0.8), rng.uniform(0.6, 0.95)):
        t = step * np.arange(round(rng.uniform(40, 120) * _PER_CYCLE))
        first = 0 if rng.random() > 1 / 3 else round(rng.uniform(0, 2) * _PER_CYCLE)
        x = s.motion(part * s.reach, t, force)[first:]
        noise = 10 ** (-_SNR_DB / 20) * np.std(x, axis=0) * rng.standard_normal(x.shape)
        records.append(rs.Decay(t[first:] - t[first], x + noise, unit="m"))

    def with_force(release, t, force=None):
        return s.motion(release, t, force)

    def alone(release, t):
        return s.motion(release, t, None)

    simulator = {"alone": alone, "program": None}.get(kind, with_force)
    if simulator is None:
        simulator = _program(s, folder / f"trial_{seed}")
    kept = {}

    def diagnosis():
        kept["report"] = rs.diagnose(simulator, records[:2], held_out=records[2])
        return kept["report"]

    truth = {"effects": {} if null else {HIDDEN[name]: {}}, "strength": kind, "noise": "40 dB"}
    result = {"trial": f"{seed}", **asked_of(diagnosis, truth)}
    errors = kept["report"].sensor_errors if kept else ()
    return result | {"own": max((e.after for e in errors), default=math.nan)}


def _program(s: Structure, folder: Path) -> Program:
    folder.mkdir(parents=True)
    code = _OCTAVE
    for word, value in (("DAMPING", s.damping), ("STIFFNESS", s.stiffness), ("MASS", s.mass)):
        code = code.replace(word, repr(float(value[0, 0])))
    model = folder / "model.m"
    model.write_text(code.replace("CUBIC", repr(float(s.cubic))))
    command = f"octave-cli --norc {model} {{release}} {{out}} {{duration}} {{step}} {{force.m}}"
    return Program(command, folder / "runs")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--nulls", type=int, default=8)
    parser.add_argument("--list", action="store_true", help="tell each trial as it ends")
    chosen = parser.parse_args()
    kinds = KINDS if shutil.which("octave-cli") else KINDS[:-1]
    print("kinds:", *kinds)
    with tempfile.TemporaryDirectory() as folder:
        for null, count in ((False, chosen.count), (True, chosen.nulls)):
            results = []
            for seed in range(chosen.first, chosen.first + count):
                results.append(trial(seed, null, kinds, Path(folder) / str(null)))
                if chosen.list:
                    told = results[-1]
                    names = " | ".join("+".join(n) for n in told["equivalent"][:3])
                    hidden = "+".join(told["hidden"]) or "nothing"
                    print(
                        f"{told['trial']} {told['about']} {hidden}: {told['verdict']} {names}"
                        f" own {told['own']:.3g} {told['seconds']:.0f} s"
                        f" {told.get('error', '')}",
                        flush=True,
                    )
            asked = "right first 88 %" if not null else '"none" in all'
            print(line("null" if null else "simulators", results, asked))
            print(*problems(results), sep="\n")
            own = [r["own"] for r in results if np.isfinite(r["own"])]
            good = sum(x <= GOOD for x in own)
            print(f"simulator itself at most {GOOD} times the noise: {good} of {len(own)}")


if __name__ == "__main__":
    main()
