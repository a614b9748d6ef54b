"""How many coordinates are found where two modes ring, in one decay that two sensors see?

    python benchmarks/modes_apart.py --count 20 --seed 1000   # a row a system, then both counts

Two rows. `close`: modes 2 to 5 % apart, damping ratios of at most a fifth of that, two to six
beats, white noise at 40 dB. `coloured`: modes well apart, noise that an autoregression of first
order makes (0.95 from sample to sample), 35 dB. Both have weak cubic stiffness of their own and a
quartic potential that couples them, mode shapes drawn at random, and a release from rest. The
simulator (scipy's DOP853) and the noise are written down here, and share nothing with the package.
"""

import argparse
import time
from collections import Counter

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from romsindy import Decay, identify

ROWS = ("close", "coloured")
PER_CYCLE = (12, 60)  # samples, of the fast mode
NEAR = 0.2  # of the distance of the modes: a small vibration is found within that


def drawn(row, seed):
    """Frequencies in Hz, damping ratios, sizes of nonlinear forces, and seconds of the record."""
    rng = np.random.default_rng([ROWS.index(row), seed])
    slow = rng.uniform(5, 20)
    if row == "close":
        apart = rng.uniform(0.02, 0.05)
        zeta = apart * rng.uniform(0.03, 0.2, 2)
        # Of the linear force, at the largest amplitude: frequencies move by 3/8 of it.
        size = np.append(apart * rng.uniform(0.1, 0.6, 3) * rng.choice([-1, 1], 3), [0, 0, 0])
        seconds = rng.uniform(2, 6) / (apart * slow)
    else:
        apart = rng.uniform(0.35, 2.5)
        zeta = rng.uniform(0.002, 0.008, 2)
        size = rng.uniform(0.01, 0.06, 6) * rng.choice([-1, 1], 6)
        seconds = rng.uniform(50, 250) / slow
    return np.array([slow, slow * (1 + apart)]), zeta, size, seconds, rng


def motion(frequencies, zeta, size, start, t):
    """From rest, (n, 2): a potential of quartic and cubic terms beside the linear modes."""
    omega = 2 * np.pi * frequencies
    own, both = size[:2] * omega**2, size[2] * omega[0] ** 2
    square, product = size[3:5] * omega**2, size[5] * omega[0] ** 2

    def rates(_, y):
        q, p = y[:2], y[2:]
        force = omega**2 * q + 2 * zeta * omega * p + own * q**3 + both * q * q[::-1] ** 2
        force += square * q**2 + product * np.array([2 * q[0] * q[1], q[0] ** 2])
        return np.concatenate([p, -force])

    options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-11, "t_eval": t}
    return solve_ivp(rates, (0, t[-1]), [*start, 0.0, 0.0], **options).y[:2].T


def decay_of(row, seed):
    """One decay, and the frequencies of its two modes."""
    frequencies, zeta, size, seconds, rng = drawn(row, seed)
    shapes = rng.uniform(0.3, 1.0, (2, 2)) * rng.choice([-1, 1], (2, 2))
    t = np.arange(0, seconds, 1 / frequencies[1] / rng.uniform(*PER_CYCLE))
    seen = motion(frequencies, zeta, size, rng.uniform(0.4, 1.0, 2), t) @ shapes.T
    noise = rng.standard_normal((len(t) + 200, 2))
    level = 10 ** (-40 / 20)
    if row == "coloured":
        noise, level = lfilter([1.0], [1.0, -0.95], noise, axis=0), 10 ** (-35 / 20)
    noise = noise[200:]
    seen += level * seen.std(axis=0) * noise / noise.std(axis=0)
    return Decay(t, seen, unit="m", stage="free"), frequencies


def trial(row, seed):
    """How many coordinates were found, whether they are the two modes, and seconds of processor."""
    decay, true = decay_of(row, seed)
    begin = time.process_time()
    fit = identify(decay, coordinates="auto")
    seconds = time.process_time() - begin
    found = fit.model.linear_modes[0] / (2 * np.pi)
    near = len(found) == 2 and np.all(np.abs(found - true) < NEAR * np.diff(true))
    return {
        "count": len(found),
        "near": bool(near),
        "explained": fit.verdict.explained,
        "residual": fit.adequacy,
        "seconds": seconds,
    }


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=20, help="systems of each row")
    parser.add_argument("--seed", type=int, default=1000, help="of the first")
    parser.add_argument("--row", choices=ROWS, action="append", help="both where none is given")
    given = parser.parse_args(arguments)
    for row in given.row or ROWS:
        found = []
        for seed in range(given.seed, given.seed + given.count):
            frequencies, _, _, seconds, _ = drawn(row, seed)
            name = f"{row} {seed}: {100 * (frequencies[1] / frequencies[0] - 1):.1f} % apart,"
            name += f" {seconds * frequencies[0]:.0f} cycles"
            try:
                result = trial(row, seed)
            except (ValueError, RuntimeError) as trouble:
                print(f"{name}: {type(trouble).__name__}: {trouble}", flush=True)
                continue
            found.append(result)
            print(
                f"{name}: {result['count']} coordinates{'' if result['near'] else ', others'},"
                f" {'' if result['explained'] else 'not '}explained ({result['residual']:.3f}),"
                f" {result['seconds']:.0f} s",
                flush=True,
            )
        counts = Counter(min(r["count"], 3) for r in found)
        print(
            f"{row}: of {given.count} systems one coordinate in {counts[1]}, two in {counts[2]}"
            f" ({sum(r['near'] for r in found)} the modes), more in {counts[3]}, none in"
            f" {given.count - len(found)}; explained {sum(r['explained'] for r in found)};"
            f" {max((r['seconds'] for r in found), default=np.nan):.0f} s at most",
            flush=True,
        )


if __name__ == "__main__":
    main()
