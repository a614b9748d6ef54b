"""Points of steady states: phase resonance, held response, and a branch with its unstable part.

    python benchmarks/steady_points.py --first 300 --count 40 --jobs 2

An oscillator with cubic stiffness, hardening or softening, and for two in five quadratic damping.
Seeds in turn: phase resonance with three harmonics, at 24 amplitudes (gain known); three amplitudes
of the response that a control holds; three levels of force with the whole branch, unstable part
included, as by control-based continuation. 1 % noise, known; the force of one level is told 2 %
wrong. Orbits are those of a balance of five harmonics, solved here by scipy.

Printed: terms that are false or missing, intervals that hold, and of a level of 0.8 of the largest
force, which was not measured, how many points of the branch lie in the band, and the folds.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, fsolve
from seeds import parser_of, tried

from romsindy import fit_steady

HARMONICS, PHASES = 5, 2 * np.pi * np.arange(64) / 64
KINDS = ("phase resonance", "held response", "branch")
NOISE, WRONG = 0.01, 1.02
LEFT = 1e-8  # of the balance, over the largest linear force


class Oscillator:
    """Per unit mass; ``size`` is its largest amplitude."""

    def __init__(self, rng):
        self.rate, ratio = 2 * np.pi * rng.uniform(5, 50), rng.uniform(0.003, 0.015)
        self.size, self.linear = 10 ** rng.uniform(-4, -2), 2 * ratio * self.rate
        bent = rng.uniform(0.03, 0.15) * rng.choice([1, 1, -0.6])
        self.cubic = bent * self.rate**2 / self.size**2
        drag = rng.uniform(0.3, 1) * self.linear / (self.rate * self.size)
        self.drag = drag if rng.random() < 0.4 else 0.0
        self.truth = {"omega^2": self.rate**2, "c_linear": self.linear, "gamma_3": self.cubic}
        self.truth |= {"c_quadratic": self.drag} if self.drag else {}
        self.range = 0.8 * self.rate, 1.25 * self.rate

    def orbit(self, amplitude, w):
        """Harmonics of q, the first of this amplitude and phase 0, and that of the force."""
        k = np.arange(HARMONICS + 1)
        turns = np.exp(1j * np.outer(PHASES, k))

        def harmonics(x):
            return np.array([x[0], amplitude, *(x[1:HARMONICS] + 1j * x[HARMONICS:])])

        def left(c):
            q, v = (turns @ c).real, (turns @ (1j * k * w * c)).real
            pull = self.rate**2 * q + self.cubic * q**3 + self.linear * v
            each = np.fft.fft(pull + self.drag * np.abs(v) * v)[: HARMONICS + 1] / len(PHASES)
            return np.array([each[0].real, *(2 * each[1:])]) - (k * w) ** 2 * c

        def others(x):
            rest = left(harmonics(x))
            rest = np.array([rest[0].real, *rest[2:].real, *rest[2:].imag])
            return rest / (self.rate**2 * self.size)

        # To rounding, at which its own test of progress ends: what is left is looked at instead.
        x, *_ = fsolve(others, np.zeros(2 * HARMONICS - 1), full_output=True)
        if np.abs(others(x)).max() > LEFT:
            raise ArithmeticError(f"no orbit of amplitude {amplitude:g} at {w:g} rad/s")
        c = harmonics(x)
        return c[1:], left(c)[1]

    def force(self, amplitude, w):
        return abs(self.orbit(amplitude, w)[1])

    def resonance(self, amplitude):
        """Frequency at which the force leads by a quarter of a cycle."""
        return brentq(lambda w: self.orbit(amplitude, w)[1].real, *self.range)

    def branch(self, force, parts):
        """Points of a curve of constant force, in order along it, at parts of its peak."""
        peak = brentq(
            lambda a: self.force(a, self.resonance(a)) - force, 1e-3 * self.size, 1.2 * self.size
        )
        sides = [], []
        for a in peak * parts:
            top = self.resonance(a)
            ends = [self.force(a, w) - force for w in (self.range[0], top, self.range[1])]
            if ends[0] > 0 > ends[1] and ends[2] > 0:
                for side, end in zip(sides, self.range, strict=True):
                    w = brentq(lambda x, a=a: self.force(a, x) - force, *sorted((top, end)))
                    side.append((a, w))
        return np.array([*sides[0], *sides[1][::-1]])


def measured(seed):
    """An oscillator, the kind of its points, and what was measured of them."""
    rng = np.random.default_rng(seed)
    one, kind = Oscillator(rng), KINDS[seed % len(KINDS)]
    if kind == "phase resonance":
        amplitudes = one.size * np.linspace(0.15, 1, 24)
        places = np.array([(a, one.resonance(a)) for a in amplitudes])
        level = np.arange(24)
    elif kind == "held response":
        near = 1 + np.linspace(-3, 3, 14) * one.linear / (2 * one.rate)
        held = one.size * np.array([0.3, 0.6, 1.0])
        places = np.array([(a, w) for a in held for w in one.resonance(a) * near])
        level = np.repeat([0, 1, 2], 14)
    else:
        largest = one.force(one.size, one.resonance(one.size))
        parts = np.array([*np.linspace(0.25, 0.97, 17), 0.985, 0.995, 0.9995])
        branches = [one.branch(part * largest, parts) for part in (0.25, 0.55, 1.0)]
        places = np.concatenate(branches)
        level = np.repeat([0, 1, 2], [len(b) for b in branches])
    found = [one.orbit(*place) for place in places]
    force = np.array([f for _, f in found])
    kept = 3 if kind == "phase resonance" else 1
    order = np.arange(1, kept + 1)
    response = np.array([c[:kept] for c, _ in found])
    response = response * np.exp(-1j * np.angle(force)[:, None] * order)  # against the force
    told = np.abs(force) * np.where(level == rng.choice(np.unique(level)), WRONG, 1.0)
    spread = NOISE / np.sqrt(2) * np.broadcast_to(places[:, :1], response.shape)
    noise = rng.standard_normal((2, *response.shape))
    return one, kind, places[:, 1], told, response + spread * (noise[0] + 1j * noise[1]), spread


class Trial(NamedTuple):
    """What is found of one oscillator."""

    seed: int
    kind: str
    false: list
    missing: list
    holds: list  # intervals of the true coefficients
    inside: list  # points of the branch that was not measured
    folds: list  # of it: whether each is in its interval


def trial(seed):
    one, kind, w, force, response, spread = measured(seed)
    known = {"gain": 1.0, "phase": 0.0} if kind == "phase resonance" else {}
    fit = fit_steady(None, w, force, response, std=spread, unit="m", **known)
    found = {*fit.model.coefficients}
    ends = {n: fit.interval(n) for n in found & {*one.truth}}
    holds = [bool(low <= one.truth[n] <= high) for n, (low, high) in ends.items()]
    level = 0.8 * one.force(one.size, one.resonance(one.size))
    parts = np.array([*np.linspace(0.1, 0.97, 80), *np.linspace(0.972, 0.9999, 30)])
    curve = one.branch(level, parts)
    on = curve[:, 1]
    band = fit.forced_response(level, (0.98 * on.min(), 1.02 * on.max()))
    each = [band.at(on, branch) for branch in ("upper", "lower")]
    inside = np.any([(b.low <= curve[:, 0]) & (curve[:, 0] <= b.high) for b in each], axis=0)
    turns = np.flatnonzero(np.diff(on)[1:] * np.diff(on)[:-1] < 0) + 1
    folds = [any(f.low <= on[i] <= f.high for f in band.folds) for i in turns]
    false, missing = sorted(found - {*one.truth}), sorted({*one.truth} - found)
    return Trial(seed, kind, false, missing, holds, inside.tolist(), folds)


def main(arguments=None):
    given = parser_of(__doc__, 40, "oscillators").parse_args(arguments)
    found = []
    for one in tried(given, trial):
        found.append(one)
        print(
            f"{one.seed} {one.kind}: false {', '.join(one.false) or '-'}; missing"
            f" {', '.join(one.missing) or '-'}; intervals {sum(one.holds)} of {len(one.holds)};"
            f" branch {sum(one.inside)} of {len(one.inside)}; folds {sum(one.folds)} of"
            f" {len(one.folds)}",
            flush=True,
        )
    right = sum(not (t.false or t.missing) for t in found)
    holds, inside, folds = (
        np.concatenate([np.array(getattr(t, name), bool) for t in found])
        for name in ("holds", "inside", "folds")
    )
    print(
        f"of {len(found)}: terms right {right}; intervals hold {100 * holds.mean():.0f} % of"
        f" {len(holds)}; branch in its band {100 * inside.mean():.0f} % of {len(inside)} points;"
        f" folds {folds.sum()} of {len(folds)}"
    )
    return right, float(holds.mean()), float(inside.mean()), (int(folds.sum()), len(folds))


if __name__ == "__main__":
    main()
