"""Sweeps of frequency up and down, by amplitude alone: where does a level that is not given jump?

    python benchmarks/sweeps.py --first 0 --count 20

Oscillators with cubic stiffness, hardening or softening, for some with a quintic or a quadratic
term; linear damping, for some dry friction or drag as well. The frequency of the force rises and
falls at a steady rate, 0.3 to 2 times (damping ratio x frequency)^2 in Hz/s. The equation is
integrated in time by Runge-Kutta steps of order 4. A lock-in gives the amplitude, with 1 % noise,
which is not told: 150 to 300 rows a sweep. Two levels of force are given, up and down, and the
rate. A third, between them or beyond, is foretold: where a sweep of that rate jumps, up and down.
True is where the amplitude, without noise, changes fastest.

Printed: terms, by how much the jumps are missed in per cent of the frequency, the widths of their
bands, and whether both are within 0.3 %. "fold" is the same where no delay is counted.
"""

import argparse
import time
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from numba import njit

from romsindy import fit_steady

STEPS, CYCLES = 64, 4  # of a cycle, and cycles that a lock-in takes together
NOISE, CLOSE = 0.01, 0.003
LEVELS, UNSEEN = (0.6, 1.0), (0.8, 1.25)
BETWEEN = 50  # of the length of a sweep: a jump and its swinging are shorter
BEYOND = 1.6  # a sweep of the third level goes so much further, for its jumps to lie in it


@njit(cache=True, fastmath=True)
def lock_in(law, force, first, last, rate, out):
    """Angular frequency and amplitude of every few cycles of a sweep into out, (n, 2); n."""
    k, k2, k3, k5, c, d, friction = law

    def acceleration(q, v, phase):
        spring = q * (k + q * (k2 + q * (k3 + k5 * q * q)))
        return force * np.cos(phase) - c * v - d * abs(v) * v - np.sign(v) * friction - spring

    phase = q = v = 0.0
    w = first
    for n in range(len(out)):
        cos = sin = 0.0
        start = w
        for _ in range(STEPS * CYCLES):
            h = 2 * np.pi / (STEPS * w)
            middle, end = phase + h * (w + rate * h / 4) / 2, phase + h * (w + rate * h / 2)
            cos, sin = cos + q * np.cos(phase), sin + q * np.sin(phase)
            a1 = acceleration(q, v, phase)
            v2 = v + h / 2 * a1
            a2 = acceleration(q + h / 2 * v, v2, middle)
            v3 = v + h / 2 * a2
            a3 = acceleration(q + h / 2 * v2, v3, middle)
            v4 = v + h * a3
            a4 = acceleration(q + h * v3, v4, end)
            q += h / 6 * (v + 2 * v2 + 2 * v3 + v4)
            v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            w, phase = w + rate * h, end
        out[n] = (start + w) / 2, 2 * np.hypot(cos, sin) / (STEPS * CYCLES)
        if (w - last) * rate > 0:
            return n + 1
    return len(out)


class Structure:
    """Per unit mass, in rad/s; ``size`` is the amplitude at resonance of the largest level."""

    def __init__(self, seed):
        self.rng = rng = np.random.default_rng(seed)
        hz, ratio, self.size = (
            rng.uniform(8, 40),
            rng.uniform(0.004, 0.01),
            10 ** rng.uniform(-4, -2),
        )
        w, hardens = 2 * np.pi * hz, rng.random() < 0.6
        shift = min(ratio * rng.uniform(8, 16), 0.16 if hardens else 0.07) * (1 if hardens else -1)
        self.form = str(rng.choice(["cubic", "cubic", "quintic", "quadratic"]))
        self.loss = str(rng.choice(["linear", "linear", "friction", "drag"]))
        fifth = rng.uniform(0.15, 0.4) if self.form == "quintic" else 0.0
        second = rng.uniform(0.1, 0.2) * w**2 / self.size if self.form == "quadratic" else 0.0
        third = 8 / 3 * shift * (1 - fifth) * (w / self.size) ** 2 + 10 / 9 * second**2 / w**2
        c, top = 2 * ratio * w, w * (1 + shift) * self.size
        drag = rng.uniform(0.3, 0.8) * c / top if self.loss == "drag" else 0.0
        self.force = top * (c + 8 / (3 * np.pi) * drag * top)
        share = rng.uniform(0.05, 0.2) if self.loss == "friction" else 0.0
        law = w**2, second, third, 16 / 5 * shift * fifth * w**2 / self.size**4, c, drag
        self.law = (*law, np.pi / 4 * share * self.force)
        self.force *= 1 + share
        self.rate = 2 * np.pi * rng.uniform(0.3, 2.0) * (ratio * hz) ** 2
        low, high = min(1.5 * shift, 0) - 10 * ratio, max(1.5 * shift, 0) + 10 * ratio
        self.range = w * (1 + low), w * (1 + high)
        self.wide = w * (1 + BEYOND * low), w * (1 + BEYOND * high)
        self.rows, self.unseen = int(rng.integers(150, 300)), float(rng.choice(UNSEEN))

    def sweep(self, level, up, ends):
        """Frequency and amplitude of every few cycles."""
        low, high = ends
        ends, rate = ((low, high), self.rate) if up else ((high, low), -self.rate)
        cycles = high * (high - low) / self.rate / (2 * np.pi)
        out = np.empty((int(cycles / CYCLES) + 2, 2))
        return out[: lock_in(self.law, level * self.force, *ends, rate, out)].T

    def table(self):
        """Rows of a laboratory: frequency, force, amplitude."""
        sweeps = []
        for level in LEVELS:
            for forth in (1, -1):
                w, a = self.sweep(level, forth > 0, self.range)
                at = np.linspace(*self.range, self.rows + 2)[1:-1][::forth]
                read = np.interp(at, w[::forth], a[::forth])
                noise = 1 + NOISE * self.rng.standard_normal(len(at))
                sweeps.append((at, np.full(len(at), level * self.force), read * noise))
        return np.concatenate(sweeps, axis=1)

    def jump(self, level, up):
        """Where the amplitude changes fastest, in the sense of the jump."""
        w, a = self.sweep(level, up, self.wide)
        near = len(w) // BETWEEN
        at = near + int(np.argmax(np.abs(np.diff(a))[near:]))
        before = at - near // 2  # beyond the swinging that follows a jump
        moved = a[before : at + near] - a[before]
        sense = np.sign(moved[np.argmax(np.abs(moved))])
        at = before + int(np.argmax(sense * np.diff(moved)))
        return float(w[at : at + 2].mean())


class Trial(NamedTuple):
    """What is found of one structure, of the jumps up and down in per cent."""

    seed: int
    level: float
    terms: str
    off: list
    width: list
    inside: list
    at_fold: list
    seconds: float


def trial(seed):
    one = Structure(seed)
    table, began = one.table(), time.perf_counter()
    fit = fit_steady(None, *table, unit="m", sweep_rate=one.rate)
    band = fit.forced_response(one.unseen * one.force, one.wide)
    seconds = time.perf_counter() - began
    off, width, inside, at_fold = [], [], [], []
    for up in (True, False):
        true, found = one.jump(one.unseen, up), band.jumps(one.rate if up else -one.rate)
        if not found:
            inside.append(False)
            for x in (off, width, at_fold):
                x.append(np.inf)
            continue
        jump = min(found, key=lambda j: abs(j.frequency - true))
        fold = min(band.folds, key=lambda f: abs(f.frequency - true))
        off.append(100 * (jump.frequency / true - 1))
        width.append(100 * (jump.high - jump.low) / true / 2)
        inside.append(bool(jump.low <= true <= jump.high))
        at_fold.append(100 * (fold.frequency / true - 1))
    known = {
        "gamma_3": "cubic",
        "gamma_5": "quintic",
        "c_coulomb": "friction",
        "c_quadratic": "drag",
    }
    found = [known.get(n, n) for n in fit.model.coefficients if n not in ("omega^2", "c_linear")]
    told = f"{one.form}, {one.loss}, level {one.unseen:g}; found {', '.join(found)}"
    return Trial(seed, one.unseen, told, off, width, inside, at_fold, seconds)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--count", type=int, default=20, help="structures")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    given = parser.parse_args(arguments)
    tasks = [delayed(trial)(seed) for seed in range(given.first, given.first + given.count)]
    trials = []
    for one in Parallel(given.jobs, return_as="generator")(tasks):
        trials.append(one)
        ways = [
            f"{way} {off:+.3f} +- {width:.3f} (fold {fold:+.3f})"
            for way, off, width, fold in zip(
                ("up", "down"), one.off, one.width, one.at_fold, strict=True
            )
        ]
        print(f"{one.seed} {one.terms}: {', '.join(ways)}; {one.seconds:.0f} s", flush=True)
    for what, some in (
        ("between", [t for t in trials if t.level < 1]),
        ("beyond", [t for t in trials if t.level > 1]),
        ("of all", trials),
    ):
        if not some:
            continue
        close, late = (
            sum(max(map(abs, x)) < 100 * CLOSE for x in several)
            for several in ([t.off for t in some], [t.at_fold for t in some])
        )
        inside, off = [x for t in some for x in t.inside], np.abs([t.off for t in some])
        print(
            f"{what} {len(some)}: both jumps within {100 * CLOSE:g} % {close}, without the delay"
            f" {late}; in their bands {sum(inside)} of {len(inside)}; median {np.median(off):.3f} %"
        )
    return close, late, sum(inside)


if __name__ == "__main__":
    main()
