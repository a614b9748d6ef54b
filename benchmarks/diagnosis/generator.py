"""Blind trials: decays of oscillators in which an effect is hidden, to files, apart from the truth.

    python benchmarks/diagnosis/generator.py single FOLDER --seeds 0 3

writes FOLDER/single_<seed>_<number>.npz (what a diagnosis may see: nominal coefficients, three
clean decays) and FOLDER/truth/<the same name>.json (what it may not). Kinds: single (26 effects,
three strengths, one trial each per seed), null (10 per seed), outside (5 effects, three
strengths), pair (10 per seed, medium). Seeds below 1000 are for development; from 1000 on they were
kept for final runs.
"""

from __future__ import annotations

import argparse
import json
import zlib
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from laws import IN_CATALOGUE, OUTSIDE, Hidden, hidden
from scipy.integrate import solve_ivp

RATE, LENGTH, ZETA = 400.0, 20.0, 0.005
AMPLITUDES = (1.0, 0.6, 0.8)
STRENGTHS = ("weak", "medium", "strong")
PAIRABLE = tuple(n for n in IN_CATALOGUE if n not in ("viscous", "linear_frequency", "added_mass"))


def nominal(rng: np.random.Generator) -> dict[str, float]:
    """Coefficients of one oscillator that is excited to amplitudes of 1."""
    omega = 2 * np.pi * rng.uniform(4, 8)
    relative = {
        "gamma_2": rng.uniform(-0.1, 0.1),
        "gamma_3": rng.uniform(0.05, 0.3),
        "gamma_4": rng.uniform(-0.02, 0.02),
        "gamma_5": rng.uniform(-0.02, 0.04),
    }
    return {
        "omega^2": omega**2,
        **{k: v * omega**2 for k, v in relative.items()},
        "Upsilon_3": rng.uniform(0.0, 0.25),
        "Upsilon_4": rng.uniform(-0.03, 0.03),
        "Upsilon_5": rng.uniform(0.0, 0.05),
        "c_linear": 2 * ZETA * omega,
    }


def decay(c: dict[str, float], effects: list[Hidden], record: int) -> np.ndarray:
    """What the sensor shows, without noise; the mass is let go at rest."""
    amplitude = AMPLITUDES[record]
    for e in effects:
        e.phases["now"] = e.phases.get(record)
    t = np.arange(round(LENGTH * RATE)) / RATE
    w2, g2, g3, g4, g5 = (c[k] for k in ("omega^2", "gamma_2", "gamma_3", "gamma_4", "gamma_5"))
    u3, u4, u5, damping = (c[k] for k in ("Upsilon_3", "Upsilon_4", "Upsilon_5", "c_linear"))
    switches = [s for e in effects for s in e.switches]
    first = np.cumsum([0, *(len(e.switches) for e in effects)])
    n_states = np.cumsum([2, *(e.states for e in effects)])

    def rates(t, y, side):
        q, v = y[0], y[1]
        mass = 1 + q * q * (u3 + q * (2 * u4 + q * u5))
        slope = q * (2 * u3 + q * (6 * u4 + q * 4 * u5))
        force = q * (w2 + q * (g2 + q * (g3 + q * (g4 + q * g5)))) + damping * v
        inner = []
        for i, e in enumerate(effects):
            if e.mass is not None:
                mass += e.mass(q)
                slope += e.mass_slope(q)
            z = y[n_states[i] : n_states[i + 1]]
            if e.force is not None:
                own = side[first[i] : first[i + 1]]
                force += e.force(t, q, v, own, z) if e.states else e.force(t, q, v, own)
            if e.rates is not None:
                inner += e.rates(t, q, v, z)
        return [v, -(force + 0.5 * slope * v * v) / mass, *inner]

    y = np.zeros(n_states[-1])
    y[0] = amplitude
    for e, at in zip(effects, n_states, strict=False):
        if e.name == "tuned_mass":
            y[at] = amplitude
    q = _integrated(rates, y, t, switches)
    for e in effects:
        if e.reading is not None:
            q = e.reading(t, q)
    return q


def _integrated(rates, y, t, switches) -> np.ndarray:
    options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-10}
    if not switches:
        return solve_ivp(lambda s, y: rates(s, y, ()), (0, t[-1]), y, t_eval=t, **options).y[0]
    q = np.full(len(t), y[0])
    now = 0.0
    side = [_sign(s(now, y[0], y[1])) for s in switches]
    side = [
        _sign(-y[0]) if s.__name__ == "_velocity" and x == 0 else x or 1
        for s, x in zip(switches, side, strict=True)
    ]
    while now < t[-1]:
        events = []
        for s, x in zip(switches, side, strict=True):

            def event(now, y, s=s):
                return s(now, y[0], y[1])

            event.terminal, event.direction = True, -x
            events.append(event)
        end = t[-1]
        piece = solve_ivp(
            lambda s, y, side=tuple(side): rates(s, y, side),
            (now, end),
            y,
            events=events,
            dense_output=True,
            max_step=0.05,
            **options,
        )
        inside = (t >= now) & (t <= piece.t[-1])
        if np.any(inside):
            q[inside] = piece.sol(t[inside])[0]
        now, y = piece.t[-1], piece.y[:, -1].copy()
        q[t > now] = y[0]
        if piece.status != 1:
            break
        for i, found in enumerate(piece.t_events):
            if len(found):
                side[i] = -side[i]
                if switches[i].__name__ == "_velocity":
                    y[1] = 0.0
                    if _held(rates, now, y, side, i):
                        return q
        now += 1e-12
    return q


def _held(rates, now, y, side, i) -> bool:
    """Whether friction holds the mass: it would be pushed back either way."""
    forward, backward = list(side), list(side)
    forward[i], backward[i] = 1, -1
    return rates(now, y, forward)[1] <= 0 <= rates(now, y, backward)[1]


def _sign(x: float) -> int:
    return int(np.sign(x))


def trials(kind: str, seed: int) -> list[tuple[list[str], str]]:
    """Names of the hidden effects and their strength, for every trial of a seed."""
    if kind == "single":
        return [([n], s) for n in IN_CATALOGUE for s in STRENGTHS]
    if kind == "outside":
        return [([n], s) for n in OUTSIDE for s in STRENGTHS]
    if kind == "null":
        return [([], "none")] * 10
    rng = np.random.default_rng([seed, 77])
    return [(list(rng.choice(PAIRABLE, 2, replace=False)), "medium") for _ in range(10)]


def write_trial(kind: str, seed: int, number: int, folder: Path) -> str:
    name = f"{kind}_{seed}_{number:03d}"
    if (folder / f"{name}.npz").is_file():
        return name
    names, strength = trials(kind, seed)[number]
    rng = np.random.default_rng([zlib.crc32(kind.encode()), seed, number])
    coefficients = nominal(rng)
    omega = np.sqrt(coefficients["omega^2"])
    effects = [hidden(n, strength, omega, rng) for n in names]
    q = np.stack([decay(coefficients, effects, record) for record in range(3)])
    truth = {"effects": {e.name: e.truth for e in effects}, "strength": strength}
    (folder / "truth" / f"{name}.json").write_text(json.dumps(truth))
    np.savez(folder / f"{name}.npz", q=q, rate=RATE, coefficients=json.dumps(coefficients))
    return name


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=("single", "null", "outside", "pair"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 1), metavar=("FROM", "TO"))
    parser.add_argument("--jobs", type=int, default=2)
    chosen = parser.parse_args()
    (chosen.folder / "truth").mkdir(parents=True, exist_ok=True)
    work = [
        delayed(write_trial)(chosen.kind, seed, i, chosen.folder)
        for seed in range(*chosen.seeds)
        for i in range(len(trials(chosen.kind, seed)))
    ]
    done = Parallel(chosen.jobs, verbose=1)(work)
    print(f"{len(done)} trials in {chosen.folder}")


if __name__ == "__main__":
    main()
