"""How many coordinates are found where two modes ring, and is a second one under a force told?

    python benchmarks/modes_apart.py --count 20 --seed 1000   # a line a system, then the counts
    python benchmarks/modes_apart.py --row close

One decay that two sensors see, `coordinates="auto"`. `close`: modes 2 to 5 % apart, damping ratios
of at most a fifth of that, two to six beats, white noise at 40 dB. `coloured`: modes well apart,
noise that an autoregression of first order makes (0.95 from sample to sample), 35 dB. Both have
weak cubic stiffness of their own and a quartic potential that couples them, the second one weak
quadratic stiffness and a cubic potential as well, which make harmonics and combination tones; mode
shapes drawn at random, and a release from rest.

`driven`: a multisine moves two modes, 12 to 60 % apart, which one sensor shows, the second with 3
to 50 % of the first; white or coloured noise, 40 dB. One coordinate is asked for: is another mode
told, near its frequency? `alone`: the same with one mode; nothing is to be told.

The simulator (scipy's DOP853) and the noise are written down here, and share nothing with the
package.
"""

import argparse
import re
import time
from collections import Counter

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from romsindy import Decay, ForcedVibration, identify

ROWS = ("close", "coloured", "driven", "alone")
PER_CYCLE = (12, 60)  # samples, of the fast mode
NEAR = 0.2  # of the distance of the modes: a small vibration is found within that
LINES, SAMPLES = 60, 4000  # of a multisine
TOLD = re.compile(r"another mode rings near ([\d.]+) Hz")


def noisy(y, decibels, coloured, rng):
    """Channels (n, c) with noise, each of its own, by the rms."""
    noise = rng.standard_normal((len(y) + 200, y.shape[1]))
    if coloured:
        noise = lfilter([1.0], [1.0, -0.95], noise, axis=0)
    noise = noise[200:]
    return y + 10 ** (-decibels / 20) * y.std(axis=0) * noise / noise.std(axis=0)


def motion(frequencies, zeta, size, start, t, force=None):
    """From rest, (n, 2): quartic and cubic terms of a potential beside the linear modes.

    ``size`` holds the cubic forces, the quartic coupling, quadratic forces and the cubic coupling.
    """
    omega = 2 * np.pi * frequencies
    own, both = size[:2] * omega**2, size[2] * omega[0] ** 2
    square, product = size[3:5] * omega**2, size[5] * omega[0] ** 2

    def rates(s, y):
        q, p = y[:2], y[2:]
        pull = omega**2 * q + 2 * zeta * omega * p + own * q**3 + both * q * q[::-1] ** 2
        pull += square * q**2 + product * np.array([2 * q[0] * q[1], q[0] ** 2])
        return np.concatenate([p, (omega[0] ** 2 * force(s) if force else 0.0) - pull])

    options = {"method": "DOP853", "rtol": 1e-8, "atol": 1e-10, "t_eval": t}
    return solve_ivp(rates, (0, t[-1]), [*start, 0.0, 0.0], **options).y[:2].T


def decay_of(row, seed):
    """One decay, and the frequencies of its two modes, Hz."""
    rng = np.random.default_rng([ROWS.index(row), seed])
    slow, coloured = rng.uniform(5, 20), row == "coloured"
    if coloured:
        apart, zeta = rng.uniform(0.35, 2.5), rng.uniform(0.002, 0.008, 2)
        size = rng.uniform(0.01, 0.06, 6) * rng.choice([-1, 1], 6)
        seconds = rng.uniform(50, 250) / slow
    else:
        apart = rng.uniform(0.02, 0.05)
        zeta = apart * rng.uniform(0.03, 0.2, 2)
        # Of the linear force, at the largest amplitude: frequencies move by 3/8 of it.
        size = np.append(apart * rng.uniform(0.1, 0.6, 3) * rng.choice([-1, 1], 3), [0, 0, 0])
        seconds = rng.uniform(2, 6) / (apart * slow)
    frequencies = np.array([slow, slow * (1 + apart)])
    shapes = rng.uniform(0.3, 1.0, (2, 2)) * rng.choice([-1, 1], (2, 2))
    t = np.arange(0, seconds, 1 / frequencies[1] / rng.uniform(*PER_CYCLE))
    seen = motion(frequencies, zeta, size, rng.uniform(0.4, 1.0, 2), t) @ shapes.T
    seen = noisy(seen, 35 if coloured else 40, coloured, rng)
    return Decay(t, seen, unit="m", stage="free"), frequencies


def driven_of(row, seed):
    """One record under a multisine, and the frequencies of its two modes, Hz."""
    rng = np.random.default_rng([ROWS.index("driven"), seed])
    own, ratio = rng.uniform(5, 20), rng.uniform(1.12, 1.6)
    frequencies = own * np.array([1.0, rng.choice([ratio, 1 / ratio])])
    zeta = rng.uniform(0.004, 0.02, 2)
    t = np.arange(SAMPLES) / own / rng.uniform(12, 25)
    lines, phases = rng.uniform(0.5 * own, 1.9 * own, LINES), rng.uniform(0, 2 * np.pi, LINES)

    def force(s):
        return np.sqrt(2 / LINES) * np.cos(2 * np.pi * np.multiply.outer(s, lines) + phases).sum(-1)

    linear = motion(frequencies, zeta, np.zeros(6), [0, 0], t, force)
    cubic = rng.choice([1, -0.1]) * rng.uniform(0.02, 0.3)
    size = np.array([cubic, 0, rng.uniform(0, 0.05), 0, 0, 0]) / np.abs(linear).max() ** 2
    if row == "alone":
        size[2] = 0
    q = motion(frequencies, zeta, size, [0, 0], t, force)
    part = 10 ** rng.uniform(np.log10(0.03), np.log10(0.5)) / q[:, 1].std() * q[:, 0].std()
    seen = q @ [[1.0], [part if row == "driven" else 0.0]]
    seen = noisy(seen, 40, rng.integers(2), rng)[:, 0]
    record = ForcedVibration(
        t, seen, force(t), unit="m", inputs="force", interpolation="band-limited"
    )
    return record, frequencies


def trial(row, seed):
    """What was found: the number of coordinates, or what was told, and seconds of processor."""
    told = row in ("driven", "alone")
    record, true = (driven_of if told else decay_of)(row, seed)
    begin = time.process_time()
    fit = identify(record, coordinates=1 if told else "auto")
    seconds = time.process_time() - begin
    if told:
        other = [float(m[1]) for note in fit.notes if (m := TOLD.search(note))]
        count = 1 + len(other)
        near = bool(other) and abs(other[0] - true[1]) < NEAR * abs(true[1] - true[0])
    else:
        found = fit.model.linear_modes[0] / (2 * np.pi)
        count = len(found)
        near = count == 2 and bool(np.all(np.abs(found - true) < NEAR * np.diff(true)))
    explained = fit.verdict.explained
    return {"count": count, "near": near, "explained": explained, "seconds": seconds}


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=20, help="systems of each row")
    parser.add_argument("--seed", type=int, default=1000, help="of the first")
    parser.add_argument("--row", choices=ROWS, action="append", help="all where none is given")
    given = parser.parse_args(arguments)
    for row in given.row or ROWS:
        found = []
        for seed in range(given.seed, given.seed + given.count):
            try:
                result = trial(row, seed)
            except (ValueError, RuntimeError, ArithmeticError) as trouble:
                print(f"{row} {seed}: {type(trouble).__name__}: {trouble}", flush=True)
                continue
            found.append(result)
            print(
                f"{row} {seed}: {result['count']}{' the modes' if result['near'] else ''},"
                f" {'' if result['explained'] else 'not '}explained, {result['seconds']:.0f} s",
                flush=True,
            )
        counts = Counter(min(r["count"], 3) for r in found)
        print(
            f"{row}: of {given.count} systems one mode in {counts[1]}, two in {counts[2]}"
            f" ({sum(r['near'] for r in found)} at their frequencies), more in {counts[3]}, none in"
            f" {given.count - len(found)}; explained {sum(r['explained'] for r in found)};"
            f" {max((r['seconds'] for r in found), default=np.nan):.0f} s at most",
            flush=True,
        )


if __name__ == "__main__":
    main()
