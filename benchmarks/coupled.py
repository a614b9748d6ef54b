"""Systems of two coordinates, simulated by equations of their own: what is identified of them?

    python benchmarks/coupled.py --count 30 --seed 1000     # prints a row a system, then the counts
    python benchmarks/coupled.py --noise ar1        # or pink, hum, force, each at 35 dB or so
    python benchmarks/coupled.py --noise ar1 --lacking      # the right terms, and all but one

Each system is drawn by its seed: frequencies 1:1 (apart by more than three bandwidths), 1:2, 1:3 or
at no ratio; stiffness to the third power, a potential that couples, inertia of slaved modes, linear
damping, of random size; two sensors or one; three decays at 40 dB, one of which takes no part. The
simulator (scipy's DOP853) has its equations written down here, and shares nothing with the package.
A ratio is met where the frequencies of the true coordinates come within 1 % of it, at small
amplitudes or in the records.

Noises that are not white are those of decay_verdicts.py: each sample keeps 0.95 of the one before,
1/f noise, a hum, white forces that alone would keep each coordinate moving by 0.5 to 1.5 % of 1.
`--lacking` gives the right terms, then all but one, of systems that do not beat, and counts those
where that leaves at least 2 % of the response of decays without noise, the others fitted anew, and
twice what the noise leaves.
"""

import argparse
import time

import numpy as np
from decay_verdicts import NOISES, heard, intensity
from scipy.integrate import solve_ivp
from scipy.signal import hilbert

from romsindy import CoupledModel, Decay, identify, refine
from romsindy.fit.kernel.collocation import TrajectoryError

KINDS = {"1:1": (1.04, 1.10), "1:2": (1.992, 2.008), "1:3": (2.99, 3.01), "none": (2.3, 2.7)}
CYCLES, PER_CYCLE, STATE = 120, 20, 0.04  # of the slow coordinate, of the fast; part of a record
NOISE, INSIDE = 0.01, 4  # 40 dB; steps of the integration between samples under a force
RATIOS = [(p, q) for q in range(2, 8) for p in range(1, q) if p + q < 9 and np.gcd(p, q) == 1]
MET, MEAN, HEARD = 0.01, 10, 0.05  # of a ratio; cycles; of the largest amplitude


def drawn(seed):
    """Coefficients, mode shapes at the sensors, starts, and what kind it is."""
    rng = np.random.default_rng(seed)
    kind = list(KINDS)[seed % len(KINDS)]
    slow = 2 * np.pi * rng.uniform(5, 20)
    fast = slow * rng.uniform(*KINDS[kind])
    zeta = rng.uniform(0.002, 0.006, 2)
    # Terms that change the force at the largest displacement, 1, by some per cent.
    size = rng.uniform(0.02, 0.12, 6) * rng.choice([-1, 1], 6)
    values = {
        "omega^2 [q1]": slow**2,
        "omega^2 [q2]": fast**2,
        "c_linear [q1]": 2 * zeta[0] * slow,
        "c_linear [q2]": 2 * zeta[1] * fast,
        "gamma_3 [q1]": size[0] * slow**2,
        "gamma_3 [q2]": size[1] * fast**2,
        "V q1^2 q2": size[2] * slow**2,
        "V q1^3 q2": size[3] * slow**2 if kind == "1:3" else 0.0,
        "V q1^2 q2^2": size[4] * slow**2,
        "g(q1^2)^2": abs(size[5]) / 4,
    }
    shapes = rng.uniform(0.3, 1.0, (2, 2)) * [[1, 1], [1, -1]] if seed % 8 < 4 else np.ones((1, 2))
    starts = [scale * rng.uniform(0.5, 1.0, 2) for scale in (1.0, 0.6, 0.8)]
    return kind, values, shapes, starts, rng


def simulated(values, start, t, force=None):
    """Motion from rest, (n, 2); a force (m, 2) holds for each step of a fourth-order method."""
    k1, k2, c1, c2, a1, a2, v21, v31, v22, g = values.values()

    def rates(_, y, w1=0.0, w2=0.0):
        q1, q2, p1, p2 = y
        f1 = k1 * q1 + c1 * p1 + a1 * q1**3 + 2 * v21 * q1 * q2 + 3 * v31 * q1**2 * q2
        f1 += 2 * v22 * q1 * q2**2 + 4 * g * q1 * p1**2
        f2 = k2 * q2 + c2 * p2 + a2 * q2**3 + v21 * q1**2 + v31 * q1**3 + 2 * v22 * q1**2 * q2
        return [p1, p2, (w1 - f1) / (1 + 4 * g * q1**2), w2 - f2]

    if force is not None:
        return stepped(rates, [*map(float, start), 0.0, 0.0], t[1] - t[0], force)
    options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-11, "t_eval": t}
    return solve_ivp(rates, (0, t[-1]), [*start, 0.0, 0.0], **options).y[:2].T


def stepped(rates, y, dt, force):
    """By Runge and Kutta's method in plain numbers."""
    step, found = dt / INSIDE, [y[:2]]
    for i, w in enumerate(force.tolist()):
        a = rates(0, y, *w)
        b = rates(0, [x + step / 2 * r for x, r in zip(y, a, strict=True)], *w)
        c = rates(0, [x + step / 2 * r for x, r in zip(y, b, strict=True)], *w)
        d = rates(0, [x + step * r for x, r in zip(y, c, strict=True)], *w)
        slopes = zip(y, a, b, c, d, strict=True)
        y = [x + step / 6 * (k + 2 * m + 2 * n + o) for x, k, m, n, o in slopes]
        if (i + 1) % INSIDE == 0:
            found.append(y[:2])
    return np.array(found)


def as_shown(values, shapes, main):
    """The coefficients of coordinates that are scaled to 1 in their main sensors.

    Masses are those beside that of the first; a power q1^a q2^b is divided by its scales.
    """
    first, second = np.abs(shapes[main, range(2)])
    found = {"mu [q2]": first**2 / second**2 - 1}
    powers = {"V q1^2 q2": (2, 1), "V q1^3 q2": (3, 1), "V q1^2 q2^2": (2, 2)}
    for name, value in values.items():
        a, b = powers.get(name, (0, 2) if "[q2]" in name else (2, 0))
        if name.startswith("gamma_3"):
            a, b = 2 * a, 2 * b
        if name == "g(q1^2)^2":
            a = 4
        found[name] = value * first**2 / (first**a * second**b)
    signs = np.sign(shapes[main, range(2)])
    for name, (a, b) in powers.items():
        found[name] *= signs[0] ** a * signs[1] ** b
    return {k: v for k, v in found.items() if v}


def sampled(values):
    """Times of the samples."""
    slow, fast = np.sqrt(values["omega^2 [q1]"]), np.sqrt(values["omega^2 [q2]"])
    return np.arange(0, CYCLES * 2 * np.pi / slow, 2 * np.pi / fast / PER_CYCLE)


def met(values, starts):
    """Ratios p : q, as (p, q), that the two frequencies come near."""
    found = [np.sqrt(values["omega^2 [q2]"] / values["omega^2 [q1]"])]
    n = int(MEAN * PER_CYCLE * found[0])  # samples of ten slow cycles
    for start in starts:
        z = hilbert(simulated(values, start, sampled(values)), axis=0)
        turned = np.unwrap(np.angle(z), axis=0)
        turned = turned[n:] - turned[:-n]
        size = np.abs(z)[n // 2 :][: len(turned)]
        heard = np.all(size > HEARD * size.max(axis=0), axis=1)
        found.extend((turned[:, 1] / turned[:, 0])[heard])
    return {(p, q) for p, q in RATIOS if np.abs(np.array(found) * p / q - 1).min() < MET}


def decays_of(seed, noise="white"):
    """Kind, true coefficients and mode shapes, decays to be fitted and one that is held out."""
    kind, values, shapes, starts, rng = drawn(seed)
    t, found = sampled(values), []
    omega = np.sqrt([values["omega^2 [q1]"], values["omega^2 [q2]"]])
    zeta = np.array([values["c_linear [q1]"], values["c_linear [q2]"]]) / (2 * omega)
    push = intensity(omega, zeta, rng) * np.sqrt(INSIDE / t[1]) if noise == "force" else None
    for start in starts:
        force = None
        if push is not None:
            force = push * rng.standard_normal(((len(t) - 1) * INSIDE, 2))
        y = simulated(values, start, t, force) @ shapes.T
        if noise == "white":
            y += NOISE * y.std(axis=0) * rng.standard_normal(y.shape)
        else:
            y = np.stack([heard(x, t, noise, omega[0], rng) for x in y.T], axis=1)
        found.append(Decay(t, y if y.shape[1] > 1 else y[:, 0], unit="m", stage="free"))
    return kind, values, shapes, found[:-1], found[-1]


def without(seed, noise):
    """Whether the right terms explain the decays, and all but one do not; None of terms that hide.

    Intervals that hold are counted for the right terms.
    """
    kind, values, shapes, decays, _ = decays_of(seed, noise)
    if kind == "1:1":
        return None
    rng = np.random.default_rng([seed, 1])
    shown = as_shown(values, shapes, np.argmax(np.abs(shapes), axis=0))
    name = rng.choice([n for n in shown if n.startswith(("gamma", "V", "g("))])
    less = {n: v for n, v in shown.items() if n != name}
    t = sampled(values)
    clean = [simulated(values, start, t) @ shapes.T for start in drawn(seed)[3][:-1]]
    free = [Decay(t, y if y.shape[1] > 1 else y[:, 0], unit="m", stage="free") for y in clean]
    pairs = zip(decays, free, strict=True)
    noises = np.std([d.signal - f.signal for d, f in pairs]) / np.std(clean)
    fit = fitted(less, free)
    left = np.std(np.concatenate(fit.residuals)) / np.std(clean) if fit else 1.0
    if left < max(0.02, 2 * noises):
        return None
    right, wrong = fitted(shown, decays), fitted(less, decays)
    found, errors = (right.model.coefficients, right.standard_errors) if right else ({}, {})
    return {
        "name": name,
        "left": left,
        "explained": bool(right and right.verdict.explained),
        "noticed": not (wrong and wrong.verdict.explained),
        "scaled": [(found[k] - shown[k]) / errors[k] for k in errors],
    }


def fitted(values, decays):
    """A fit of these terms; None where they have no motion."""
    try:
        return refine(CoupledModel.from_coefficients(values, unit="m"), decays)
    except (TrajectoryError, ValueError):
        return None


def trial(seed, noise="white"):
    """One row: kind, what was found, held-out error, residual over noise, errors over theirs."""
    kind, values, shapes, fitted, other = decays_of(seed, noise)
    true_ratios = met(values, drawn(seed)[3][:-1])
    start = time.perf_counter()
    fit = identify(fitted, "auto")
    seconds = time.perf_counter() - start
    predicted = fit.predict(other, int(STATE * len(other.t)))
    missed = predicted - other.signal
    error = float(np.sqrt(np.mean(missed**2)) / np.abs(other.signal).max())
    found, errors = fit.model.coefficients, fit.standard_errors
    main = np.argmax(fit.mode_shapes == 1.0, axis=0)
    if len(main) == 2:  # what a coordinate is scaled by is the fit's choice
        values = as_shown(values, shapes, main)
    scaled = [(found[k] - v) / errors[k] for k, v in values.items() if k in found]
    wrong = sorted({*values} ^ {*found})
    return {
        "seed": seed,
        "kind": kind,
        "modes": fit.model.n_coordinates,
        "error": error,
        "residual": fit.adequacy,
        "explained": fit.verdict.explained,
        "scaled": scaled,
        "wrong": wrong,
        "met": true_ratios,
        "named": {(r.p, r.q) for r in fit.resonances},
        "seconds": seconds,
    }


def text(ratios):
    """Such as "1:2"."""
    return " ".join(f"{p}:{q}" for p, q in sorted(ratios)) or "none"


def lacking(seeds, noise):
    """Print what came out of systems that lack a term."""
    rows = []
    for seed in seeds:
        row = without(seed, noise)
        if row is None:
            continue
        rows.append(row)
        print(
            f"{seed}: {'' if row['explained'] else 'not '}explained, without {row['name']}, which"
            f" leaves {100 * row['left']:.1f} %, {'' if row['noticed'] else 'not '}noticed",
            flush=True,
        )
    inside = np.abs(np.concatenate([row["scaled"] for row in rows] or [[np.inf]])) < 1.96
    print(
        f"{noise}: right terms explained {sum(row['explained'] for row in rows)} of {len(rows)},"
        f" {100 * np.mean(inside):.0f} % of {len(inside)} coefficients in their 95 % intervals; a"
        f" term less noticed {sum(row['noticed'] for row in rows)}"
    )


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1000, help="of the first system")
    parser.add_argument("--noise", choices=("white", *NOISES), default="white")
    parser.add_argument("--lacking", action="store_true")
    given = parser.parse_args(arguments)
    if given.lacking:
        return lacking(range(given.seed, given.seed + given.count), given.noise)
    rows = []
    for seed in range(given.seed, given.seed + given.count):
        try:
            row = trial(seed, given.noise)
        except (ValueError, RuntimeError) as trouble:
            print(f"{seed}: {type(trouble).__name__}: {trouble}", flush=True)
            continue
        rows.append(row)
        inside = np.mean(np.abs(row["scaled"] or [np.inf]) < 1.96)
        print(
            f"{seed} {row['kind']:>4}: {row['modes']} modes, error {100 * row['error']:.2f} %,"
            f" residual {row['residual']:.3f}, {'' if row['explained'] else 'not '}explained,"
            f" {100 * inside:.0f} % inside, {row['seconds']:.0f} s,"
            f" ratios {text(row['met'])}, named {text(row['named'])},"
            f" terms off: {', '.join(row['wrong']) or 'none'}",
            flush=True,
        )
    if not rows:
        return
    near = [row for row in rows if row["met"]]
    named, invented = (
        sum(bool(row["named"] & row["met"]) for row in near),
        sum(bool(row["named"] - row["met"]) for row in rows),
    )
    two = sum(row["modes"] == 2 for row in rows)
    noise_alone = sum(0.97 <= row["residual"] <= 1.05 for row in rows)
    exact = [row for row in rows if not row["wrong"]]
    inside, of_exact = (
        np.abs(np.concatenate([row["scaled"] for row in some] or [[np.inf]])) < 1.96
        for some in (rows, exact)
    )
    print(
        f"{two} of {given.count} with two modes; held-out error"
        f" {100 * np.mean([r['error'] for r in rows]):.2f} % in the mean; residual 0.97 to 1.05"
        f" times the noise in {noise_alone}; explained {sum(row['explained'] for row in rows)};"
        f" {100 * inside.mean():.0f} % of {len(inside)} coefficients in their 95 % intervals;"
        f" structure exact in {len(exact)}, there {100 * np.mean(of_exact):.0f} %;"
        f" of {len(near)} that come near a ratio it is named in {named}, and invented in {invented}"
    )


if __name__ == "__main__":
    main()
