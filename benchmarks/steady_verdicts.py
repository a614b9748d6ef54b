"""Is a right model of steady states explained, whatever its noise, and is a wrong one noticed?

    python benchmarks/steady_verdicts.py --count 20 --jobs 2    # so many systems
    python benchmarks/steady_verdicts.py --first 300 --list

Two or three levels of a stepped sine through the resonance, 25 frequencies each, of an oscillator
with cubic stiffness (even seeds) or cubic stiffness and drag (odd ones). The noise is that of the
response, 35 to 50 dB below the largest, with its spread given or not, or with amplitudes alone; a
force that is off by 1 % at every point; or the noise of the response drifting from point to point
(each keeps 0.8 of the one before). The right terms are given. Then cubic stiffness, drag or dry
friction is there that the model has not, of such a size that it leaves 2 to 8 % of the force. The
motion from rest is integrated by Runge and Kutta's method until it is steady, and its first
harmonic read off; this shares nothing with the package.
"""

import warnings
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from seeds import parser_of

from romsindy import ReducedModel, fit_steady

NOISES = ("spread given", "no spread", "amplitudes", "force", "drifting")
MISSING = ("gamma_3", "c_quadratic", "c_coulomb")
POINTS, CYCLES, STEPS, READ = 25, 500, 80, 10  # of a level; of the motion; in a cycle; read off
STEADY = 1e-5  # change of the first harmonic from the cycles before to those that are read off
KEEPS, OFF = 0.8, 0.01
CREEP = 2e-3  # of the largest velocity, within which friction turns round
SIZES = (0.02, 0.08)  # of what is missing, as a part of the force


class Row(NamedTuple):
    """What came out of one system under one noise."""

    seed: int
    noise: str
    missing: str
    explained: bool
    held: int
    values: int
    text: str


def steady(omega, force, law):
    """First harmonic of the steady displacement, (n,), under force cos(omega t)."""
    h, q, v = 2 * np.pi / omega / STEPS, np.zeros(len(omega)), np.zeros(len(omega))
    total = CYCLES * STEPS
    read = [np.zeros(len(omega), complex) for _ in range(2)]

    def pull(phase, q, v):
        return force * np.cos(phase) - law(q, v)

    for i in range(total):
        now = 2 * np.pi * i / STEPS
        left = total - i
        if left <= 2 * READ * STEPS:
            read[left <= READ * STEPS] += q * np.exp(-1j * now) * 2 / (READ * STEPS)
        mid, end = now + np.pi / STEPS, now + 2 * np.pi / STEPS
        a = pull(now, q, v)
        b = pull(mid, q + h / 2 * v, v + h / 2 * a)
        c = pull(mid, q + h / 2 * v + h * h / 4 * a, v + h / 2 * b)
        d = pull(end, q + h * v + h * h / 2 * b, v + h * c)
        q, v = q + h * v + h * h / 6 * (a + b + c), v + h / 6 * (a + 2 * b + 2 * c + d)
    settled = np.abs(read[1] - read[0]) < STEADY * np.abs(read[1])
    return read[1], settled


def drawn(seed, missing):
    """Coefficients of the model, and points: rad/s, force, first harmonics under two forces."""
    rng = np.random.default_rng(seed)
    omega, zeta = 2 * np.pi * rng.uniform(2, 40), rng.uniform(0.004, 0.012)
    linear, size = 2 * zeta * omega, 10 ** rng.uniform(-4, 0)
    levels = np.array([0.25, 0.5, 1.0])[3 - rng.integers(2, 4) :]
    truth = {
        "omega^2": omega**2,
        "gamma_3": rng.choice([-1, 1]) * rng.uniform(0.3, 1) * 4 * zeta * omega**2 / size**2,
        "c_linear": linear,
    }
    drag = rng.uniform(0.1, 0.4) * linear / (omega * size)
    if seed % 2:
        truth["c_quadratic"] = drag
    push = 1.3 * linear * omega * size  # of the largest level
    more = dict.fromkeys(MISSING, 0.0)
    if missing:
        part = rng.uniform(*SIZES)
        whole = {"gamma_3": size**3 / 4, "c_quadratic": (omega * size) ** 2 / 5, "c_coulomb": 1.0}
        more[missing] = part * push / whole[missing] + truth.pop(missing, 0.0)
    value = {**dict.fromkeys(MISSING, 0.0), **truth}
    total = {n: value[n] + more[n] for n in MISSING}
    creep = CREEP * omega * size

    def law(q, v):
        return (
            omega**2 * q
            + linear * v
            + total["gamma_3"] * q**3
            + total["c_quadratic"] * np.abs(v) * v
            + total["c_coulomb"] * np.tanh(v / creep)
        )

    w = np.tile(omega * np.linspace(1 - 4 * zeta, 1 + 4 * zeta, POINTS), len(levels))
    volt = np.repeat(levels, POINTS)
    off = 1 + OFF * noise_of(len(w), rng)  # of the force, in size and phase
    loads = np.append(np.ones(len(w)), np.abs(off))
    q, settled = steady(np.tile(w, 2), push * np.tile(volt, 2) * loads, law)
    q, settled = q.reshape(2, -1), settled.reshape(2, -1).all(axis=0)
    q[1] *= off / np.abs(off)
    return truth, w[settled], volt[settled], q[:, settled], rng


def noise_of(n, rng):
    """Complex noise of unit power."""
    return (rng.standard_normal((n, 2)) @ [1, 1j]) / np.sqrt(2)


def noisy(q, noise, rng):
    """What is measured of steady states, under the force and one that is off, and its spread."""
    q, under_another = q
    if noise == "force":
        return under_another, None
    z = noise_of(len(q), rng)
    std = np.abs(q).max() * 10 ** (-rng.uniform(35, 50) / 20)
    if noise == "drifting":
        for i in range(1, len(z)):
            z[i] = KEEPS * z[i - 1] + np.sqrt(1 - KEEPS**2) * z[i]
    q = q + std * z
    spread = std / np.sqrt(2) if noise in ("spread given", "drifting") else None
    return (np.abs(q) if noise == "amplitudes" else q), spread


def trial(seed, missing=""):
    """A row for every noise of a system."""
    truth, w, volt, q, rng = drawn(seed, missing)
    rows = []
    for noise in NOISES:
        y, spread = noisy(q, noise, rng)
        start = {n: 0.0 for n in truth} | {"omega^2": truth["omega^2"], "c_linear": 0.01 * w[0]}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                fit = fit_steady(ReducedModel.from_coefficients(start), w, volt, y, std=spread)
            except ValueError as error:
                rows.append(Row(seed, noise, missing, False, 0, 0, f"refused: {error}"))
                continue
        held = [fit.interval(n)[0] <= v <= fit.interval(n)[1] for n, v in truth.items()]
        verdict = fit.verdict
        rows.append(
            Row(seed, noise, missing, verdict.explained, sum(held), len(held), str(verdict))
        )
    return rows


def report(rows):
    """Counts, a line for each noise."""
    lines = []
    for noise in NOISES:
        mine = [r for r in rows if r.noise == noise]
        right, wrong = ([r for r in mine if bool(r.missing) == x] for x in (False, True))
        values = sum(r.values for r in right)
        lines.append(
            f"{noise}: right terms explained in {sum(r.explained for r in right)} of {len(right)},"
            f" {100 * sum(r.held for r in right) / max(values, 1):.0f} % of {values} in their 95 %"
            f" intervals; a missing one noticed in {sum(not r.explained for r in wrong)} of"
            f" {len(wrong)}"
        )
    return lines


def main(arguments=None):
    parser = parser_of(__doc__, 20, "systems, right and wrong each")
    parser.add_argument("--list", action="store_true", help="print every verdict")
    given = parser.parse_args(arguments)
    seeds = range(given.first, given.first + given.count)
    tasks = [delayed(trial)(s) for s in seeds]
    tasks += [delayed(trial)(s, MISSING[s % len(MISSING)]) for s in seeds]
    rows = []
    for some in Parallel(given.jobs, return_as="generator")(tasks):
        rows += some
        if given.list:
            for r in some:
                print(r.seed, r.noise, f"without {r.missing}" * bool(r.missing), r.text, flush=True)
    print(*report(rows), sep="\n")


if __name__ == "__main__":
    main()
