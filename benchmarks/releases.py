"""How often the releases of a random record are counted right.

    python benchmarks/releases.py [--first SEED] [--count N]

One to four blows by half-sine forces, random in size, direction and time (8 to 30 cycles of the
slowest mode apart), set one to three oscillators ringing, linear or hardening, each blow on top of
what is left from those before. Displacement, velocity or acceleration is measured with noise of 60,
30, 20 or 10 dB. A blow is found where a release starts within a cycle and a half of it.
"""

from __future__ import annotations

import argparse
import itertools
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from romsindy.record.recording import QUANTITIES, Recording
from romsindy.record.releases import split_releases

NEAR = 1.5  # s, cycles of the slowest mode too: its frequency is 1 Hz


@dataclass(frozen=True)
class Trial:
    """A recording, and what is true of it: times of the blows in s, signal to noise in dB."""

    recording: Recording
    blows: np.ndarray
    snr_db: float

    def found(self) -> tuple[int, int]:
        """Blows that were found, and releases that no blow began."""
        starts = np.array([release.start for release in split_releases(self.recording)[0]])
        late = starts[:, None] - self.blows
        near = (late > 0) & (late < NEAR)
        return int(near.any(axis=0).sum()), int((~near.any(axis=1)).sum())


def trial(seed: int) -> Trial:
    """One random record."""
    rng = np.random.default_rng(seed)
    n_modes, n_blows = rng.integers(1, 4), rng.integers(1, 5)
    omega = 2 * np.pi * np.array([1.0, *(1 + rng.uniform(0.15, 5, n_modes - 1))])
    zeta = 10 ** rng.uniform(-2.7, -1.5, n_modes)
    hardening = rng.choice([0.0, 0.3])  # of the stiffness at q = 1, which a blow of 1 reaches
    shape = rng.uniform(0.3, 1, n_modes) * rng.choice([-1, 1], n_modes)
    blows = np.cumsum([rng.uniform(0.5, 5), *rng.uniform(8, 30, n_blows - 1)])
    size = 2 * np.pi * rng.uniform(0.6, 1.4, n_blows) * rng.choice([-1, 1], n_blows)
    width = rng.uniform(0.01, 0.15)
    t = np.arange(0, blows[-1] + rng.uniform(12, 30), 1 / rng.choice([60, 150, 400]))

    def rates(s, y, start, push):
        q, v = np.split(y, 2)
        force = push * np.sin(np.pi * (s - start) / width)
        return np.concatenate(
            [v, shape * force - 2 * zeta * omega * v - omega**2 * (q + hardening * q**3)]
        )

    pushes = dict(zip(blows, size * np.pi / (2 * width), strict=True))
    edges = np.sort([0.0, *blows, *(blows + width), t[-1] + 1])
    y, parts = np.zeros(2 * n_modes), []
    for a, b in itertools.pairwise(edges):
        arguments = (a, pushes.get(a, 0.0))
        inside = t[(t >= a) & (t < b)]
        motion = solve_ivp(rates, (a, b), y, "DOP853", [*inside, b], args=arguments, rtol=1e-8).y
        slopes = [rates(s, z, *arguments) for s, z in zip(inside, motion.T, strict=False)]
        parts += [(*np.split(z, 2), r[n_modes:]) for z, r in zip(motion.T, slopes, strict=False)]
        y = motion[:, -1]
    derivative, snr_db = int(rng.integers(0, 3)), float(rng.choice([60, 30, 20, 10]))
    x = np.array([part[derivative] for part in parts]) @ np.sign(shape)
    x = x + 10 ** (-snr_db / 20) * np.sqrt(np.mean(x**2)) * rng.standard_normal(len(t))
    return Trial(Recording(t, x, quantity=QUANTITIES[derivative]), blows, snr_db)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=100)
    options = parser.parse_args()
    tables = defaultdict(list)
    for seed in range(options.first, options.first + options.count):
        one = trial(seed)
        found, extra = one.found()
        tables[one.snr_db].append(
            (found == len(one.blows) and not extra, found, extra, len(one.blows))
        )
    print("noise      records  counted right  blows  found  other releases")
    for snr_db, rows in sorted(tables.items(), reverse=True):
        right, found, extra, blows = np.sum(rows, axis=0)
        print(f"{snr_db:3.0f} dB {len(rows):10d} {right:14d} {blows:6d} {found:6d} {extra:15d}")
    right = sum(row[0] for rows in tables.values() for row in rows)
    print(f"counted right: {right} of {options.count}")


if __name__ == "__main__":
    main()
