"""Is a right model of a driven record explained, whatever its noise, and is a wrong one noticed?

    python benchmarks/driven_verdicts.py --count 20 --jobs 2      # so many records of each noise
    python benchmarks/driven_verdicts.py --first 300 --noise force --list

A Duffing oscillator (even seeds) or one with inertia (odd ones), under a sweep, a multisine or a
random force, 240 cycles and more. The noise is white or coloured noise of the sensor (each sample
keeps 0.95 of the one before), 35 dB; a force that nobody measured, white, 5 % of the one that was;
or noise of the sensor of the force, 2 %. The right terms are given. Then the same is recorded with
a cubic spring, dry friction or a second mode, which the terms do not have; each of such a size that
it leaves 2 to 4 % of the response where nothing is noisy, and twice what the noise of a force
moves. The motion is integrated here by Runge and Kutta's method, and shares nothing with the
package.
"""

import warnings
from functools import partial
from typing import NamedTuple

import numpy as np
from forced_vibrations import KINDS, excitation
from scipy.signal import lfilter
from seeds import parser_of, step, tried

from romsindy import ForcedVibration, ReducedModel, refine
from romsindy.fit.kernel.collocation import TrajectoryError

NOISES = ("white", "coloured", "force", "input")
MISSING = ("gamma_3", "c_coulomb", "second mode")
N, INSIDE = 4800, 12  # samples, and steps of the integration between two of them
DECIBELS, UNKNOWN, SENSED = 35, 0.05, 0.02
CREEP = 2e-3  # of the largest velocity, within which friction turns round
LIKE = {  # the force as the verdict calls it; in a band of one mode some look alike
    "gamma_3": ("q^3", "|q| q", "q q_dot^2", "q^5", "q^2"),
    "c_coulomb": ("the sign of q_dot", "|q_dot| q_dot", "q^2 q_dot", "q_dot^3"),
}


class Structure(NamedTuple):
    """Coefficients of the model, what it has not, the force at half steps, and the time step."""

    truth: dict
    missing: str
    strength: float
    push: np.ndarray
    dt: float


class Row(NamedTuple):
    """What came out of one seed."""

    noise: str
    seed: int
    kind: str
    explained: bool
    held: int
    values: int
    missing: str
    leaves: float
    noticed: bool
    like: str
    part: float


def motion(s, strength=0.0, unknown=None):
    """Displacement at the samples from rest, with what is missing in this strength."""
    k, c, k3, inertia = (
        s.truth.get(n, 0.0) for n in ("omega^2", "c_linear", "gamma_3", "Upsilon_3")
    )
    omega, h = np.sqrt(k), s.dt / INSIDE
    cubic = k3 + strength * (s.missing == "gamma_3")
    friction = strength * (s.missing == "c_coulomb")
    gain = strength * (s.missing == "second mode")
    creep = CREEP * omega  # displacements are about 1
    apart, narrow = 1.3 * omega, 0.02 * 1.3 * omega
    push = s.push if unknown is None else s.push + unknown
    q, v, p, w = 0.0, 0.0, 0.0, 0.0
    found = [0.0]

    def rate(f, q, v):
        dry = friction * min(max(v / creep, -1.0), 1.0)
        pull = c * v + k * q + cubic * q**3 + dry + inertia * q * v * v
        return (f - pull) / (1 + inertia * q * q)

    def other(f, p, w):
        return gain * f - narrow * w - apart**2 * p

    for i, (first, middle, last) in enumerate(push.tolist()):
        q, v = step(rate, h, q, v, first, middle, last)
        if gain:
            p, w = step(other, h, p, w, first, middle, last)
        if (i + 1) % INSIDE == 0:
            found.append(q + p)
    return np.array(found)


def structure(seed):
    """A structure whose linear response is about 1 at its largest, and its samples of the force."""
    rng = np.random.default_rng([5, seed])
    omega, zeta = 2 * np.pi * rng.uniform(1, 50), rng.uniform(0.005, 0.02)
    per_cycle = rng.uniform(12, 20)
    dt = 2 * np.pi / omega / per_cycle
    truth = {"omega^2": omega**2, "c_linear": 2 * zeta * omega}
    force = excitation(KINDS[seed % 3], rng, per_cycle)
    inside = np.arange((N - 1) * INSIDE) / INSIDE
    at = [inside, inside + 0.5 / INSIDE, inside + 1 / INSIDE]
    push = np.stack([force(t) for t in at], axis=1)
    linear = Structure(truth, "", 0.0, push, dt)
    gain = 1 / np.abs(motion(linear)).max()
    missing = MISSING[seed // 3 % 3]
    if seed % 2 == 0 and missing != "gamma_3":
        truth["gamma_3"] = rng.uniform(0.1, 0.5) * omega**2
    if seed % 2:
        truth["Upsilon_3"] = rng.uniform(0.1, 0.5)
    strength = {"gamma_3": omega**2, "c_coulomb": 2 * zeta * omega**2, "second mode": 1.0}
    return Structure(truth, missing, 0.1 * strength[missing], gain * push, dt)


def recorded(s, noise, rng, strength):
    """A noisy record, and the rms of what an unknown force moves, over that of the response."""
    clean = motion(s, strength)
    u = np.concatenate([s.push[::INSIDE, 0], s.push[-1:, 2]])
    size, moved = u.std(), 0.0
    q, shown = clean, u
    if noise == "force":  # as strong between the samples as at them
        unknown = np.repeat(rng.standard_normal((N - 1) * INSIDE), 3).reshape(-1, 3)
        q = motion(s, strength, UNKNOWN * size * np.sqrt(INSIDE) * unknown)
        moved = np.std(q - clean) / clean.std()
    unit = rng.standard_normal(N)
    if noise == "coloured":
        unit = lfilter([np.sqrt(1 - 0.95**2)], [1, -0.95], unit)
    level = 10 ** (-DECIBELS / 20) * (0.1 if noise in ("force", "input") else 1.0)
    if noise == "input":
        shown = u + SENSED * size * rng.standard_normal(N)
    return record(s, q + level * q.std() * unit, shown), moved


def record(s, y, u):
    return ForcedVibration(s.dt * np.arange(N), y, u, unit="m", interpolation="band-limited")


def fitted(s, measured):
    """The model without what is missing, from near the truth; None where it has no motion."""
    start = {n: v * (1.03 if n == "omega^2" else 1.0) for n, v in s.truth.items()}
    try:
        return refine(ReducedModel.from_coefficients(start, unit="m"), measured)
    except TrajectoryError:
        return None


def told(s, moved):
    """The strength at which what is missing leaves 2 to 4 % of the response, and what it leaves."""
    u = np.concatenate([s.push[::INSIDE, 0], s.push[-1:, 2]])
    strength, least, low, high = s.strength, max(0.02, 2 * moved), 0.0, np.inf
    for _ in range(12):
        y = motion(s, strength)
        fit = fitted(s, record(s, y, u))
        left = np.inf if fit is None else np.std(np.concatenate(fit.residuals)) / y.std()
        if least <= left <= 2 * least:
            break
        low, high = (low, strength) if left > least else (strength, high)
        strength *= min(max(1.4 * least / left, 0.2), 5.0)
        if not low < strength < high:
            strength = np.sqrt(low * high)
    return strength, left


def trial(noise, seed):
    """The right model of one record, and the same of one of which it lacks something."""
    warnings.simplefilter("ignore")
    s, rng = structure(seed), np.random.default_rng([6, NOISES.index(noise), seed])
    moved = recorded(s, noise, np.random.default_rng(seed), 0.0)[1]
    strength, leaves = told(s, moved)
    wrong = fitted(s, recorded(s, noise, rng, strength)[0])
    noticed = wrong is None or not wrong.verdict.explained
    if s.missing == "gamma_3":
        s = s._replace(truth=s.truth | {"gamma_3": strength}, missing="")
    right = fitted(s, recorded(s, noise, rng, 0.0)[0])
    errors = right.standard_errors if right else {}
    values = {n: v for n, v in (s.truth | {"gain [force]": 1.0}).items() if n in errors}
    held = sum(abs(right.model.coefficients[n] - v) < 2 * errors[n] for n, v in values.items())
    return Row(
        noise,
        seed,
        KINDS[seed % 3],
        right is not None and right.verdict.explained,
        held,
        len(values),
        s.missing or "gamma_3",
        leaves,
        noticed,
        wrong.verdict.like if wrong else "no motion",
        wrong.verdict.part if wrong else np.inf,
    )


def line(noise, rows):
    """What came out of the records with one noise."""
    n, held, values = len(rows), sum(r.held for r in rows), sum(r.values for r in rows)
    noticed = [r for r in rows if r.noticed]
    known = [r for r in noticed if r.missing in LIKE and r.like != "no motion"]
    named = sum(r.like in LIKE[r.missing] for r in known)
    return (
        f"{noise:9}  right model explained {sum(r.explained for r in rows)} of {n},"
        f" two standard errors hold {100 * held / values:.0f} % of {values};"
        f"  something missing: noticed {len(noticed)}, the force named {named} of {len(known)}"
    )


def main(arguments=None):
    parser = parser_of(__doc__, 20)
    parser.add_argument("--noise", choices=NOISES)
    parser.add_argument("--list", action="store_true", help="one line for each")
    options = parser.parse_args(arguments)
    for noise in [options.noise] if options.noise else NOISES:
        rows = []
        for r in tried(options, partial(trial, noise)):
            rows.append(r)
            if options.list or not r.explained or not r.noticed:
                print(
                    f"{noise:9}  {r.seed:6} {r.kind:9}  explained: {r.explained},"
                    f" {r.held} of {r.values};  without {r.missing} ({100 * r.leaves:.1f} %):"
                    f" {r.noticed}, {r.like}, {100 * r.part:.2g} % left",
                    flush=True,
                )
        print(line(noise, rows), flush=True)


if __name__ == "__main__":
    main()
