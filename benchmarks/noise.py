"""Is the noise of a record known as it is? What is left of the true motion, made white.

    python benchmarks/noise.py [--count 25] [KIND ...]

Decays of asymmetric oscillators (scipy) with known noise of a ratio in dB. Where the noise is
estimated well, the whitened noise has rms 1 at all frequencies (columns: power over that of white
noise at orders of the fundamental), neither an offset nor a mean that follows the square of the
amplitude is found in it (chi-square of one value: 6.6 once in a hundred), and the model that left
it is said to explain the record.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
from scipy.fft import dct
from scipy.integrate import solve_ivp
from scipy.signal import butter, lfilter, sosfilt

import romsindy as rs
from romsindy.fit.adequacy.verdicts import examine
from romsindy.fit.records.record import Record

RATE, LENGTH, SETTLE = 300.0, 20.0, 3000
# Orders of the fundamental: drift, beside it, at harmonics, between them, above the smooth motion.
BANDS = {
    "<0.4": lambda f: f < 0.4,
    "0.5": lambda f: np.abs(f - 0.5) < 0.1,
    "1": lambda f: np.abs(f - 1) < 0.15,
    "2, 3": lambda f: np.minimum(np.abs(f - 2), np.abs(f - 3)) < 0.15,
    "between": lambda f: (np.abs(f % 1 - 0.5) < 0.2) & (f > 1) & (f < 6),
    ">7": lambda f: f > 7,
}


def white(n: int, f0: float, rng: np.random.Generator) -> np.ndarray:
    return rng.standard_normal(n)


def ar1(n: int, f0: float, rng: np.random.Generator) -> np.ndarray:
    return lfilter([1.0], [1.0, -0.9], rng.standard_normal(n + SETTLE))[SETTLE:]


def causal(n: int, f0: float, rng: np.random.Generator) -> np.ndarray:
    """Through a low-pass filter of order 2 to 6 at 1.5 to 10 fundamentals."""
    edge = min(rng.uniform(1.5, 10) * f0 * 2 / RATE, 0.9)
    sos = butter(int(rng.integers(2, 7)), edge, output="sos")
    return sosfilt(sos, rng.standard_normal(n + SETTLE))[SETTLE:]


def band(n: int, f0: float, rng: np.random.Generator) -> np.ndarray:
    """From 0.3 to 8 fundamentals to 1.3 to 4 times that."""
    low = rng.uniform(0.3, 8) * f0
    edges = np.minimum([low, low * rng.uniform(1.3, 4)], 0.47 * RATE) * 2 / RATE
    sos = butter(4, edges, "band", output="sos")
    return sosfilt(sos, rng.standard_normal(n + SETTLE))[SETTLE:]


def pink(n: int, f0: float, rng: np.random.Generator) -> np.ndarray:
    f = np.maximum(np.fft.rfftfreq(4 * n), 1 / (4 * n))
    return np.fft.irfft(np.fft.rfft(rng.standard_normal(4 * n)) / np.sqrt(f), 4 * n)[:n]


def walk(n: int, f0: float, rng: np.random.Generator) -> np.ndarray:
    """White, and a random walk one to five times as large."""
    steps = np.cumsum(rng.standard_normal(n))
    return rng.standard_normal(n) + rng.uniform(1, 5) * steps / np.std(steps)


def swing(n: int, f0: float, rng: np.random.Generator) -> np.ndarray:
    """White, and an offset that swings, from 0.3 turns a record to 0.15 of the fundamental."""
    turns = np.exp(rng.uniform(np.log(0.3), np.log(0.15 * f0 * n / RATE)))
    phase = 2 * np.pi * (turns * np.arange(n) / n + rng.random())
    return rng.standard_normal(n) + rng.uniform(1, 6) * np.sin(phase)


KINDS: dict[str, Callable] = {k.__name__: k for k in (white, ar1, causal, band, pink, walk, swing)}


def clean(rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """A decay from 1, and its frequency."""
    omega, zeta = 2 * np.pi * rng.uniform(4, 8), rng.uniform(0.003, 0.008)
    g2, g3 = rng.uniform(-0.15, 0.15), rng.uniform(0.05, 0.3)

    def rates(t, y):
        q = y[0]
        return [y[1], -(omega**2) * q * (1 + q * (g2 + q * g3)) - 2 * zeta * omega * y[1]]

    t = np.arange(0, LENGTH, 1 / RATE)
    return solve_ivp(rates, (0, t[-1]), [1.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-9).y[0], omega


def trial(kind: str, snr_db: float, seed: int) -> list[float]:
    """Rms, powers in the bands, chi-square of two means, and whether the truth is explained."""
    rng = np.random.default_rng([sorted(KINDS).index(kind), int(snr_db), seed])
    q, omega = clean(rng)
    noise = KINDS[kind](len(q), omega / (2 * np.pi), rng)
    noise *= 10 ** (-snr_db / 20) * np.std(q) / np.sqrt(np.mean(noise**2))
    t = np.arange(len(q)) / RATE
    record = Record.loud(rs.Decay(t, q + noise), 1e-6)
    first = round(record.clock * RATE)
    true = noise[first : first + len(record.signal)]
    left = record.whitened(true)
    n = len(left)
    power, order = dct(left, norm="ortho") ** 2, np.arange(n) / (2 * n) * RATE * 2 * np.pi / omega
    envelope = np.abs(record.spline.amplitudes(record.t)[:, 1])
    means = [record.whitened(x) for x in (np.ones(n), envelope**2)]
    return [
        np.sqrt(left @ left / record.count),
        *(np.mean(power[inside(order)]) for inside in BANDS.values()),
        *((x @ left) ** 2 / (x @ x) for x in means),
        examine([record], [true], 0).explained,
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", default=list(KINDS), metavar="KIND")
    parser.add_argument("--count", type=int, default=25)
    chosen = parser.parse_args()
    heads = "".join(f"{name:>8}" for name in BANDS)
    print(f"{'noise':<8}{'dB':>4}{'rms':>7}{'least':>7}{'most':>7}{heads}{'offset':>8}{'a^2':>8}")
    for kind in chosen.kinds:
        for snr_db in (20, 30, 40):
            found = np.array([trial(kind, snr_db, s) for s in range(chosen.count)])
            rms, powers = found[:, 0], np.median(found[:, 1 : 1 + len(BANDS)], axis=0)
            means = np.quantile(found[:, -3:-1], 0.95, axis=0)
            said = int(np.sum(found[:, -1]))
            print(
                f"{kind:<8}{snr_db:>4}{np.median(rms):>7.3f}{rms.min():>7.2f}{rms.max():>7.2f}"
                + "".join(f"{p:>8.2f}" for p in powers)
                + "".join(f"{m:>8.1f}" for m in means)
                + f"   explained {said} of {len(found)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
