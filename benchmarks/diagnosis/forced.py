"""Blind trials: swept sines that drive oscillators in which an effect is hidden.

    python benchmarks/diagnosis/forced.py --first 0 --count 60 --nulls 40 --list
    python benchmarks/diagnosis/forced.py --noise force           # or coloured, input
    python benchmarks/diagnosis/forced.py --count 0 --nulls 0 --far 20

A trial is drawn from its seed alone, and shares no class with romsindy: the oscillator and its laws
are those of oscillator.py, laws.py and outside.py, integrated by DOP853 (by RK4 where the input is
held); friction turns round within 0.2 % of the largest velocity. One sweep or two through the
resonance, up or down, 100 to 160 cycles, 20 samples a cycle of the linear frequency, white noise
40 dB below the response. In half of the trials, and where the input or the gain of the sensor is
wrong, the simulation knows the gain of the input; elsewhere it is fitted. Seeds below 50000 are for
development. Other noises: coloured, each sample keeps 0.95 of the one before, 35 dB; a force that
nobody measured, white up to half the sampling rate, 5 % of the force; noise of its sensor, 2 %;
these two beside the white one 20 dB lower. Far off are linear simulations of systems that have
cubic stiffness and dry friction.

Left out is what another value that is always fitted stands for, a constant force (the zero of the
sensor), and what belongs to decays: effects that remember, a second mode that rings down, hum.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import laws
import numpy as np
import outside
from hidden import Hidden, Setting
from joblib import Parallel, delayed
from marked import asked_of
from oscillator import Nominal
from scipy.integrate import solve_ivp
from scipy.signal import lfilter
from score import line, problems

import romsindy as rs

CHAIN = ("input_gain", "input_delay", "input_between_samples")
LAWS = tuple(n for n in laws.MAKERS if n != "constant_force")
OUTSIDE = ("drift", "sudden_change", "base_excitation", "gain", "saturation", "sensor_nonlinearity")
EFFECTS = (*LAWS, *OUTSIDE, *CHAIN)
_MAKERS = {**laws.MAKERS, **outside.MAKERS}
_KNOWN = (*CHAIN, "gain")  # seen where the gain of the input is known
_TURN = 2 * math.pi
_SAMPLES, _SNR_DB, _SUBSTEPS = 20, 40.0, 8
_CREEP = 2e-3
NOISES = ("white", "coloured", "force", "input")
ROWS = ("forced", "forced_null", "forced_far")
FAR = ("cubic_stiffness", "dry_friction")  # of which a linear simulation knows nothing
_COLOURED_DB, _UNKNOWN, _SENSED = 35.0, 0.05, 0.02
_FAR = 1e3  # amplitudes, from which nothing comes back
_CHANGED = {"medium": 0.03, "strong": 0.1}  # of the gain of the input


@dataclass(frozen=True)
class Sweep:
    """A sine whose frequency runs from one value to another; dimensionless."""

    size: float
    first: float
    last: float
    length: float

    def __call__(self, t: float) -> float:
        rate = (self.last - self.first) / (2 * self.length)
        ramp = min(t / _TURN, 1.0)  # of one cycle
        return self.size * ramp * ramp * (3 - 2 * ramp) * math.sin((self.first + rate * t) * t)


@dataclass(frozen=True)
class Trial:
    """What a diagnosis may see, and the truth."""

    model: rs.ReducedModel
    records: list[rs.ForcedVibration]
    truth: dict


def hidden_in(seed: int) -> str:
    """Name of the effect of one trial: all come in turn."""
    order = np.random.default_rng([11, seed // len(EFFECTS)]).permutation(len(EFFECTS))
    return EFFECTS[order[seed % len(EFFECTS)]]


class Escaped(Exception):
    """A motion that grows without end, as of a spring that softens: nobody records it."""


def trial_of(seed: int, row: str, noise: str = "white") -> Trial:
    """Draw one trial of a row, again where its motion escapes."""
    rng = np.random.default_rng([7, ROWS.index(row), seed])
    while True:
        try:
            return _drawn(rng, seed, row, noise)
        except Escaped:
            continue


def _drawn(rng: np.random.Generator, seed: int, row: str, noise: str) -> Trial:
    nominal = Nominal.drawn(rng)
    names = {"forced": (hidden_in(seed),), "forced_null": (), "forced_far": FAR}[row]
    if row == "forced_far":
        nominal = replace(nominal, g=(0.0,) * 4, u=(0.0,) * 3)
    name = names[0] if names else ""
    strength = str(rng.choice(["medium", "strong"]))
    known = name in _KNOWN or rng.random() < 0.5
    sweeps = _sweeps(nominal, rng)
    spans = [(0.0, s.length) for s in sweeps]
    setting = Setting(strength, nominal.zeta, spans, 1.0, rng)
    effects = [_MAKERS[n](n, setting) for n in names if n in _MAKERS]
    step = _TURN / _SAMPLES
    factor, late = 1.0, 0.0
    if name == "input_gain":
        factor = 1 + _CHANGED[strength] * float(rng.choice([-1, 1]))
    if name == "input_delay":
        late = float(rng.uniform(0.2, 2.0)) * step
    hertz = math.exp(rng.uniform(math.log(0.3), math.log(300.0)))
    size, gain = float(10 ** rng.uniform(-5, 0.5)), float(10 ** rng.uniform(-2, 2))
    omega = _TURN * hertz
    records = []
    for i, sweep in enumerate(sweeps):
        t = np.arange(0.0, sweep.length, step)
        own = np.random.default_rng([13, seed, i])
        unknown = sweep.size * math.sqrt(0.5) * _UNKNOWN * own.standard_normal(len(t) + 1)
        unknown *= noise == "force"
        if name == "input_between_samples":
            q = held(nominal, lambda now, s=sweep, u=unknown: s(now) + u[round(now / step)], t)
        else:
            push = lambda now, s=sweep, u=unknown: (  # noqa: E731
                factor * s(max(now - late, 0.0)) + between(u, now / step)
            )
            q = driven(nominal, effects, t, push)
        for e in effects:
            q = e.reading(t, q, i) if e.reading is not None else q
        q = q + shown(noise, rng.standard_normal(len(q))) * np.std(q)
        u = np.array([sweep(x) for x in t])
        u = u + (noise == "input") * _SENSED * np.std(u) * own.standard_normal(len(u))
        u *= size * omega**2 / gain
        records.append(rs.ForcedVibration(t / omega, size * q, u, unit="m", input_unit="N"))
    coefficients = nominal.coefficients(omega, size)
    if known:
        coefficients["gain [force]"] = gain
    model = rs.ReducedModel.from_coefficients(coefficients, unit="m")
    about = f"{'known' if known else 'fitted'} gain,"
    truth = {
        "effects": {n: {} for n in names} | {e.name: e.truth for e in effects},
        "strength": f"{strength if name else 'none'}, {about}",
        "noise": noise,
        "snr_db": _SNR_DB,
    }
    return Trial(model, records, truth)


def between(samples: np.ndarray, place: float) -> float:
    """A value between samples, on a line."""
    i = min(int(place), len(samples) - 2)
    return float(samples[i] + (place - i) * (samples[i + 1] - samples[i]))


def shown(noise: str, white: np.ndarray) -> np.ndarray:
    """Noise of the sensor over the rms of the response, from white values of variance 1."""
    if noise == "coloured":
        keeps, level = 0.95, 10 ** (-_COLOURED_DB / 20)
        return level * math.sqrt(1 - keeps**2) * lfilter([1.0], [1.0, -keeps], white)
    level = 10 ** (-_SNR_DB / 20)
    return white * (level if noise == "white" else 0.1 * level)


def _sweeps(nominal: Nominal, rng: np.random.Generator) -> list[Sweep]:
    """One or two, such that the simulation reaches an amplitude of 1 in the first."""
    length = _TURN * float(rng.uniform(100, 160))
    ends = [float(rng.uniform(0.5, 0.8)), float(rng.uniform(1.3, 1.6))]
    if rng.random() < 0.5:
        ends.reverse()
    size = 2 * nominal.zeta
    t = np.arange(0.0, length, _TURN / _SAMPLES)
    for _ in range(3):
        peak = float(np.abs(driven(nominal, [], t, Sweep(size, *ends, length))).max())
        size /= min(max(peak, 0.3), 3.0)
    first = Sweep(size, *ends, length)
    if rng.random() < 0.7:
        return [first]
    return [first, Sweep(size * float(rng.uniform(0.4, 0.8)), *ends[::-1], length)]


def driven(
    nominal: Nominal, effects: list[Hidden], t: np.ndarray, push: Callable[[float], float]
) -> np.ndarray:
    """Displacement at ``t`` from rest, under a smooth force."""

    def side(switch, now, q, v):
        x = switch(now, q, v)
        return math.tanh(x / _CREEP) if switch.__name__ == "velocity" else math.copysign(1.0, x)

    def rates(now, y):
        q, v = y
        mass, slope = nominal.mass(q)
        force = nominal.force(q, v) - push(now)
        for e in effects:
            if e.mass is not None:
                mass += e.mass(q)
                slope += e.mass_slope(q)
            if e.force is not None:
                force += e.force(now, q, v, [side(s, now, q, v) for s in e.switches], ())
        return [v, -(force + 0.5 * slope * v * v) / mass]

    options = {"rtol": 1e-8, "atol": 1e-10, "max_step": 0.4, "t_eval": t}
    found = solve_ivp(rates, (t[0], t[-1]), [0.0, 0.0], "DOP853", **options)
    if not found.success:
        raise Escaped
    return found.y[0]


def held(nominal: Nominal, push: Callable[[float], float], t: np.ndarray) -> np.ndarray:
    """Displacement at ``t`` from rest, under a force that is held from each sample to the next."""
    h = (t[1] - t[0]) / _SUBSTEPS
    q, v, found = 0.0, 0.0, []

    def acceleration(q, v, force):
        mass, slope = nominal.mass(q)
        return (force - nominal.force(q, v) - 0.5 * slope * v * v) / mass

    for now in t:
        found.append(q)
        force = push(now)
        for _ in range(_SUBSTEPS):
            a1 = acceleration(q, v, force)
            v2, a2 = v + h / 2 * a1, acceleration(q + h / 2 * v, v + h / 2 * a1, force)
            v3, a3 = v + h / 2 * a2, acceleration(q + h / 2 * v2, v + h / 2 * a2, force)
            v4, a4 = v + h * a3, acceleration(q + h * v3, v + h * a3, force)
            q += h / 6 * (v + 2 * v2 + 2 * v3 + v4)
            v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        if not abs(q) < _FAR:
            raise Escaped
    return np.array(found)


def one(seed: int, row: str, noise: str = "white") -> dict:
    """Diagnose one trial, and mark it."""
    trial = trial_of(seed, row, noise)
    result = asked_of(lambda: rs.diagnose(trial.model, trial.records), trial.truth)
    return {"trial": f"{row}_{seed}", "seed": seed, **result}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--count", type=int, default=60, help="systems with a hidden effect")
    parser.add_argument("--nulls", type=int, default=40, help="systems without")
    parser.add_argument("--far", type=int, default=0, help="linear models of systems with two")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--noise", choices=NOISES, default="white")
    parser.add_argument("--list", action="store_true", help="what was not right first")
    chosen = parser.parse_args()
    rows = zip(ROWS, (chosen.count, chosen.nulls, chosen.far), strict=True)
    for row, count in rows:
        if not count:
            continue
        seeds = range(chosen.first, chosen.first + count)
        results = Parallel(chosen.jobs)(delayed(one)(seed, row, chosen.noise) for seed in seeds)
        named = "right first in 90 %, named and wrong at most 2 %"
        print(line(row, results, '"none" in all' if row == "forced_null" else named), flush=True)
        for text in problems(results) if chosen.list else ():
            print(text, flush=True)


if __name__ == "__main__":
    main()
