"""Is inertia asked for where a curved sensor makes the harmonics?

    python benchmarks/curved_sensor.py [--records 20] [--first 0] [--jobs 1]

Oscillators without inertia, with quadratic and cubic stiffness that hardens or softens, viscous
damping and damping that grows with the displacement, integrated by DOP853 and read by a sensor that
shows y = q + e q^2 + offset. None may be said to ask for inertia; as many with it, read by a
straight sensor, must be.
"""

from __future__ import annotations

from typing import NamedTuple

import click
import numpy as np
from joblib import Parallel, delayed
from scipy.integrate import solve_ivp

import romsindy as rs

LEAST, MOST = 0.005, 0.05  # curvature at the largest amplitude, as a part of that


class Trial(NamedTuple):
    """One record, and what was found."""

    curvature: float
    snr_db: float
    structure: str
    asked: bool
    explained: bool
    short: bool


def read_motion(seed: int, inertia: float = 0.0, cycles: float | None = None) -> rs.Decay:
    """A decay in m as the sensor shows it; with inertia h = ``inertia`` (q / q_max)^2, straight."""
    rng = np.random.default_rng(seed)
    quadratic, cubic = rng.uniform(-0.2, 0.2), rng.uniform(0.05, 0.5)
    cubic *= rng.choice([-0.6, 1.0])  # softening less, or there is no motion
    zeta, grows = rng.uniform(0.002, 0.01), rng.uniform(0, 2)
    e = curvature_of(seed) * (inertia == 0)
    offset, snr_db = rng.uniform(-0.02, 0.02), noise_of(seed)
    cycles, rate = cycles or rng.uniform(50, 120), rng.integers(25, 60)

    def motion(_: float, state: np.ndarray) -> list[float]:
        x, v = state
        force = x * (1 + quadratic * x + cubic * x * x) + 2 * zeta * (1 + grows * x * x) * v
        return [v, -(force + inertia * x * v * v) / (1 + inertia * x * x)]

    t = np.arange(int(cycles * rate)) * 2 * np.pi / rate
    x = solve_ivp(motion, (0, t[-1]), [1.0, 0.0], "DOP853", t, rtol=1e-10, atol=1e-12).y[0]
    noise = np.sqrt(np.mean(x**2)) * 10 ** (-snr_db / 20) * rng.standard_normal(len(t))
    size, omega = 10 ** rng.uniform(-4, -1), 2 * np.pi * rng.uniform(3, 40)
    return rs.Decay(t / omega, size * (x + e * x * x + offset + noise), unit="m")


def curvature_of(seed: int) -> float:
    """e q_max of a record: of either sign in turn, all sizes alike often."""
    part = np.random.default_rng([seed, 1]).random()
    return float((-1) ** seed * LEAST * (MOST / LEAST) ** part)


def noise_of(seed: int) -> float:
    """Signal to noise of a record, dB."""
    return float(np.random.default_rng([seed, 2]).uniform(35, 60))


def trial(seed: int, inertia: float = 0.0, cycles: float | None = None) -> Trial:
    """Identify one."""
    found = rs.identify(read_motion(seed, inertia, cycles))
    return Trial(
        curvature_of(seed) * (inertia == 0),
        noise_of(seed),
        found.structure.name,
        "do not ask for inertia" not in str(found),
        found.verdict.explained,
        found.short.follows,
    )


@click.command()
@click.option("--records", default=20, show_default=True)
@click.option("--first", default=0, show_default=True, help="First seed.")
@click.option("--jobs", default=1, show_default=True, help="Processes.")
def main(records: int, first: int, jobs: int) -> None:
    """Print what each record asks for, and how many ask for inertia."""
    for what, inertia, asked in (("curved sensor", 0.0, "0"), ("inertia", 0.2, f"{records}")):
        seeds = range(first, first + records)
        trials = Parallel(jobs)(delayed(trial)(seed, inertia) for seed in seeds)
        for t in trials:
            click.echo(f"  e {100 * t.curvature:+6.2f} %, {t.snr_db:.0f} dB: {t.structure}")
        several = [
            ("inertia asked for", sum(t.asked for t in trials), asked),
            ("explained", sum(t.explained for t in trials), "reported"),
            ("in short", sum(t.short for t in trials), "reported"),
        ]
        for name, count, wanted in several:
            click.echo(f"{f'{what}: {name}':64} {f'{count} of {records}':>28}    ({wanted})")


if __name__ == "__main__":
    main()
