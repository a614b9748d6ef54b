"""Synthetic forced vibrations: do errors cover, and is what the input does between samples named?

    python benchmarks/forced_vibrations.py                        # 200 records
    python benchmarks/forced_vibrations.py --first 300 --count 20 # other seeds
    python benchmarks/forced_vibrations.py --select               # terms are chosen by the data

Sweep, multisine or random force or base motion, held or band-limited; 30 to 50 dB. The motion is
integrated here by Runge and Kutta's method in plain numbers, and shares nothing with the package.
"""

from typing import NamedTuple

import numpy as np
from seeds import parser_of, step, tried

from romsindy import ForcedVibration, ReducedModel, identify, refine

N, INSIDE = 4000, 12  # samples, and steps of the integration between two of them
KINDS = ("sweep", "multisine", "random")


class System(NamedTuple):
    """One structure, its excitation, and the record of it."""

    seed: int
    kind: str
    source: str
    way: str
    decibels: float
    truth: dict
    record: ForcedVibration
    noise: float


def excitation(kind, rng, per_cycle):
    """A force of rms 1 as a function of time in samples; cycles last ``per_cycle`` of them."""
    low, high = rng.uniform(0.3, 0.7) / per_cycle, rng.uniform(1.4, 2.2) / per_cycle
    if kind == "sweep":
        slope = (high - low) / N
        return lambda t: np.sqrt(2) * np.cos(2 * np.pi * (low * t + slope * t**2 / 2))
    count = {"multisine": 60, "random": 600}[kind]
    frequency = rng.uniform(low, high, count)
    size = np.ones(count) if kind == "multisine" else np.abs(rng.standard_normal(count))
    phase = rng.uniform(0, 2 * np.pi, count)
    size /= np.sqrt(np.sum(size**2) / 2)

    def force(t):
        t = np.atleast_1d(t)
        parts = np.array_split(t, max(len(t) // 4000, 1))
        waves = [np.cos(2 * np.pi * np.outer(p, frequency) + phase) @ size for p in parts]
        return np.concatenate(waves)

    return force


def motion(truth, push, dt):
    """Displacement at the samples from rest; ``push`` holds the force at half steps."""
    c, k, k2, k3, quadratic = (
        truth.get(n, 0.0) for n in ("c_linear", "omega^2", "gamma_2", "gamma_3", "c_quadratic")
    )
    h, q, v = dt / INSIDE, 0.0, 0.0
    found = [0.0]

    def rate(f, q, v):
        return f - c * v - quadratic * abs(v) * v - q * (k + q * (k2 + q * k3))

    for i, (first, middle, last) in enumerate(push.tolist()):
        q, v = step(rate, h, q, v, first, middle, last)
        if (i + 1) % INSIDE == 0:
            found.append(q)
    return np.array(found)


def system(seed):
    """A structure and its record by a seed."""
    rng = np.random.default_rng(seed)
    kind, source = KINDS[seed % 3], ("force", "base")[rng.integers(2)]
    way, decibels = ("band-limited", "hold")[rng.integers(2)], float(rng.uniform(30, 50))
    omega, zeta = 2 * np.pi * rng.uniform(1, 50), rng.uniform(0.004, 0.03)
    per_cycle, gain = rng.uniform(8, 25), rng.uniform(0.5, 3.0)
    dt = 2 * np.pi / omega / per_cycle
    force = excitation(kind, rng, per_cycle)
    # Of the size that the response has in a linear structure, 1 up to its square root.
    truth = {"omega^2": omega**2, "c_linear": 2 * zeta * omega}
    t, inside = np.arange(N), np.arange((N - 1) * INSIDE) / INSIDE
    at = [inside, inside + 0.5 / INSIDE, inside + 1 / INSIDE]
    u = force(t)
    values = [u[np.floor(inside).astype(int)]] * 3 if way == "hold" else list(map(force, at))
    push = gain * np.stack(values, axis=1)
    size = np.abs(motion(truth, push, dt)).max()
    law = rng.integers(4)
    if law in (0, 1):
        truth["gamma_3"] = rng.uniform(0.1, 0.6) * omega**2 / size**2
    if law == 1:
        truth["gamma_2"] = rng.uniform(0.1, 0.3) * omega**2 / size
    if law == 2:
        truth["c_quadratic"] = rng.uniform(0.3, 1.0) * zeta / size
    if law == 3:
        truth["gamma_3"] = rng.uniform(0.1, 0.4) * omega**2 / size**2
        truth["c_quadratic"] = rng.uniform(0.3, 1.0) * zeta / size
    q = motion(truth, push, dt)
    name = {"force": "gain [force]", "base": "Gamma [base]"}[source]
    truth[name] = gain if source == "force" else -gain
    std = 10 ** (-decibels / 20) * q.std()
    record = ForcedVibration(dt * t, q + std * rng.standard_normal(N), u, unit="m", inputs=source)
    return System(seed, kind, source, way, decibels, truth, record, std)


def told(s):
    """Sigmas between held and band-limited, for the noise that was added and the right terms.

    No method that has to find the noise and the terms can tell more.
    """
    power, laws = {}, {n: v for n, v in s.truth.items() if "[" not in n}
    for way in ("band-limited", "hold"):
        record = ForcedVibration(
            s.record.t, s.record.y, s.record.u, unit="m", inputs=s.source, interpolation=way
        )
        fit = refine(ReducedModel.from_coefficients(laws, unit="m"), record)
        power[way] = sum(np.sum(e**2) for e in fit.residuals) / s.noise**2
    right = power.pop(s.way)
    return np.sqrt(max(power.popitem()[1] - right, 0.0))


def trial(seed, select):
    """Errors over standard errors by coefficient, the name of the way, and whether it is sure."""
    s = system(seed)
    if select:
        fit = identify(s.record)
    else:
        start = {
            n: v * (1.03 if n == "omega^2" else 0.0) for n, v in s.truth.items() if "[" not in n
        }
        fit = refine(ReducedModel.from_coefficients(start | {"c_linear": 0.0}, unit="m"), s.record)
    found, error = fit.model.coefficients, fit.standard_errors
    off = {n: (found[n] - s.truth.get(n, 0.0)) / error[n] for n in fit.free}
    note = next(n for n in fit.notes if n.startswith("between its samples"))
    exact = set(found) == set(s.truth)
    return s, off, note, exact, fit.verdict.explained


def main(arguments=None):
    parser = parser_of(__doc__, 200)
    parser.add_argument("--select", action="store_true", help="choose the terms")
    parser.add_argument("--list", action="store_true", help="one line for each")
    given = parser.parse_args(arguments)
    covered, total, right, wrong, explained, same, open_ = 0, 0, 0, 0, 0, 0, []
    for s, off, note, exact, fine in tried(given, trial, given.select):
        inside = sum(abs(x) < 2 for x in off.values())
        covered, total = covered + inside, total + len(off)
        said = "held" if s.way == "hold" else "band-limited"
        named = "is " in note
        right += named and f"is {said}" in note
        wrong += named and f"is {said}" not in note
        if not named:
            open_.append(told(s))
        explained, same = explained + fine, same + exact
        if given.list:
            worst = max(off, key=lambda n: abs(off[n]))
            print(
                f"{s.seed:5d} {s.kind:9s} {s.source:5s} {said:12s} {s.decibels:3.0f} dB"
                f"  {inside}/{len(off)}  {worst} {off[worst]:+.1f}  {exact!s:5s} {fine!s:5s}"
                f" {note[29:60]}",
                flush=True,
            )
    print(f"two standard errors cover {100 * covered / total:.1f} % of {total} coefficients")
    print(f"between samples: named right {right}, cannot tell {len(open_)}, named wrong {wrong}")
    sigmas = ", ".join(f"{sum(x > at for x in open_)} by more than {at}" for at in (2, 3, 4, 5))
    print(f"of those that cannot be told, with noise and terms known, in standard errors: {sigmas}")
    print(f"structure exact {same} of {given.count}, explained {explained}")
    return covered / total


if __name__ == "__main__":
    main()
