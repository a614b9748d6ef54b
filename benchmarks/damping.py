"""Damping of decays: its linear and quadratic part, and the limit cycle where it falls.

    python benchmarks/damping.py roll --first 500 --count 40 --jobs 2
    python benchmarks/damping.py flutter --first 500 --count 40 --jobs 2

roll: 3 to 20 cycles of a ship that rolls, half of the time with cubic stiffness, in waves: noise
with a colour of 0.7 to 0.97 from sample to sample, 0.5 to 2 % of the first amplitude. Counted is
how often 95 % intervals of both parts hold, beside those of the P-Q method as its scatter says and
widened until they would hold 95 % of these records.

flutter: a rig below its onset, with the damping q^2 q_dot or q_dot^3 that takes energy no more from
an amplitude on, cubic stiffness, 1 % noise. The decay starts at 60 to 90 % of that amplitude.
Counted is how often it lies in its band, and how wide that is.

Both are integrated by scipy's DOP853, which shares nothing with the package.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import lfilter
from seeds import parser_of, tried

from romsindy import Decay, identify

PER_CYCLE = 40


def motion(rate, start, t):
    """Displacements (n,) at times t (s) of a motion that starts at rest."""
    given = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-12 * start}
    return solve_ivp(rate, (0, t[-1]), [start, 0.0], t_eval=t, **given).y[0]


def roll(seed):
    """A decay in degrees, and its linear (1/s) and quadratic (1/deg) damping."""
    rng = np.random.default_rng(seed)
    frequency, start = 10 ** rng.uniform(-1.3, 0.5), rng.uniform(3, 20)
    omega = 2 * np.pi * frequency
    linear = 2 * rng.uniform(0.003, 0.03) * omega
    quadratic = rng.uniform(0.2, 1.5) * linear * 1.2 / (start * omega)
    cubic = rng.uniform(-0.3, 0.3) * omega**2 / start**2 if rng.random() < 0.5 else 0.0
    n = int((rng.integers(3, 21) + 0.5) * PER_CYCLE)
    t = np.arange(n) / (PER_CYCLE * frequency)

    def rate(_, state):
        q, v = state
        return [v, -(omega**2 * q + cubic * q**3 + linear * v + quadratic * abs(v) * v)]

    waves = lfilter([1], [1, -rng.uniform(0.7, 0.97)], rng.standard_normal(n + 200))[200:]
    waves *= rng.uniform(0.005, 0.02) * start / waves.std()
    return Decay(t, motion(rate, start, t) + waves, unit="deg", stage="free"), linear, quadratic


def flutter(seed):
    """A decay, and the amplitude from which on its motion grows."""
    rng = np.random.default_rng(seed)
    frequency, scale = rng.uniform(2, 20), 10 ** rng.uniform(-2.5, 0)
    omega = 2 * np.pi * frequency
    linear = 2 * rng.uniform(0.003, 0.02) * omega
    by_place = rng.random() < 0.5  # q^2 q_dot, or q_dot^3
    bent = 4 * linear / scale**2 / (1 if by_place else 3 * omega**2)
    cubic = rng.uniform(-0.1, 0.3) * omega**2 / scale**2

    def rate(_, state):
        q, v = state
        loss = linear * v - bent * (q * q * v if by_place else v**3)
        return [v, -(omega**2 * q + cubic * q**3 + loss)]

    def turns(_, state):
        return state[1]

    turns.direction = -1

    def next_peak(a):
        given = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-14 * scale, "events": turns}
        found = solve_ivp(rate, (0, 1.5 / frequency), [a, 0.0], **given)
        return found.y_events[0][found.t_events[0] > 0.3 / frequency][0][0]

    low, high = 0.3 * scale, 1.8 * scale
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if next_peak(middle) < middle else (low, middle)
    t = np.arange(PER_CYCLE * rng.integers(25, 80)) / (PER_CYCLE * frequency)
    q = motion(rate, rng.uniform(0.6, 0.9) * low, t)
    return Decay(t, q + 0.01 * q.std() * rng.standard_normal(len(t)), unit="m", stage="free"), low


def roll_trial(seed):
    """What is found of both parts, over what is true: fitted, and by P-Q; None if refused."""
    decay, *true = roll(seed)
    try:
        split = identify(decay).damping
    except ValueError:  # fewer than three cycles
        return seed, None
    if split is None:
        return seed, None
    fitted = np.array([split.linear, split.quadratic]) / np.reshape(true, (2, 1))
    read = np.array([split.linear_by_p_q, split.quadratic_by_p_q]) / np.reshape(true, (2, 1))
    return seed, (fitted, read)


def flutter_trial(seed):
    """The limit cycle that is foretold, and its band, over the true one; None where none is."""
    decay, true = flutter(seed)
    cycle = identify(decay).limit_cycle
    return seed, None if cycle is None else np.array(cycle) / true


def of_roll(results):
    """How often intervals hold, of how many; medians of widths, and of widened P-Q."""
    found = [both for _, both in results if both is not None]
    for seed, both in results:
        words = "none" if both is None else " ".join(f"{x:.3g}" for x in both[0].ravel())
        print(f"{seed}: linear and quadratic, with ends, over the true ones: {words}")
    fitted, read = (np.array(x) for x in zip(*found, strict=True))
    holds = (fitted[..., 1] <= 1) & (1 <= fitted[..., 2])
    half = (read[..., 2] - read[..., 1]) / 2
    off = np.abs(read[..., 0] - 1) / half
    wider = np.quantile(off, 0.95, axis=0)
    width = np.median(fitted[..., 2] - fitted[..., 1], axis=0)
    other = np.median(2 * half * wider, axis=0)
    for i, name in enumerate(("linear", "quadratic")):
        print(
            f"{name}: intervals hold in {holds[:, i].sum()} of {len(found)}, P-Q's in"
            f" {np.sum(off[:, i] <= 1)} ({len(results) - len(found)} records refused); median width"
            f" {100 * width[i]:.0f} % of the value, P-Q's made to hold 95 % {100 * other[i]:.0f} %"
        )
    return holds.sum(axis=0), len(found), width, other


def of_flutter(results):
    """How many are in their band, of how many, and the largest half-width."""
    for seed, cycle in results:
        words = "none" if cycle is None else "{:.3f} ({:.3f} to {:.3f})".format(*cycle)
        print(f"{seed}: limit cycle over the true one: {words}")
    found = [c for _, c in results if c is not None]
    inside = sum(bool(c[1] <= 1 <= c[2]) for c in found)
    widest = max((c[2] - c[1]) / 2 for c in found)
    print(f"of {len(results)}: in the band {inside}, half-width at most {100 * widest:.0f} %")
    return inside, len(results), widest


def main(arguments=None):
    parser = parser_of(__doc__, 40)
    parser.add_argument("kind", choices=["roll", "flutter"])
    given = parser.parse_args(arguments)
    trial, told = (roll_trial, of_roll) if given.kind == "roll" else (flutter_trial, of_flutter)
    return told([*tried(given, trial)])


if __name__ == "__main__":
    main()
