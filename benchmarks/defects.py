"""Defects put on clean decays: are they noticed, and does the backbone hold after mending?

    python benchmarks/defects.py [--first 0] [--count 20]

The decays are simulated here, from equations of motion of their own: a pendulum with air drag, an
asymmetric Duffing oscillator, a bead on a curved wire. The truth is the backbone of the same decay
without noise and defect.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import click
import numpy as np
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.inspection.inspection import Inspection
from romsindy.record.defects import Defect
from romsindy.record.recording import Recording

SNR_DB = 40.0
NAMES = ("frequency", "amplitude", "damping_ratio")


def pendulum(q: float, v: float, rng_values: np.ndarray) -> float:
    a, b, _ = rng_values
    return -np.sin(q) - 0.02 * a * v - 0.03 * b * v * abs(v)


def duffing(q: float, v: float, rng_values: np.ndarray) -> float:
    a, b, c = rng_values
    return -q - 0.2 * b * q**2 - c * q**3 - 0.02 * a * v


def bead(q: float, v: float, rng_values: np.ndarray) -> float:
    """On the wire y = q^2/2 + b q^3/10 + c q^4/4 under gravity 1."""
    a, b, c = rng_values
    slope, bend = q + 0.3 * b * q**2 + c * q**3, 1 + 0.6 * b * q + 3 * c * q**2
    return -(slope * bend * v**2 + slope) / (1 + slope**2) - 0.02 * a * v


SYSTEMS: tuple[Callable[[float, float, np.ndarray], float], ...] = (pendulum, duffing, bead)


@dataclass(frozen=True)
class Known:
    """A decay without noise: times in s, displacement, and its frequency in Hz."""

    t: np.ndarray
    q: np.ndarray
    frequency: float

    @property
    def amplitude(self) -> float:
        return float(np.abs(self.q).max())


def known_decay(rng: np.random.Generator) -> Known:
    """One of the systems with random damping, nonlinearity, length and sampling rate."""
    system, values = SYSTEMS[rng.integers(3)], rng.uniform(0.3, 1.0, 3)
    frequency, start = 10 ** rng.uniform(0.5, 2), rng.uniform(0.3, 1.0)
    # At least 150 samples a second: slower ones cannot hear the mains.
    cycles, rate = rng.uniform(50, 120), rng.uniform(1, 6) * max(20, 150 / frequency)
    tau = 2 * np.pi * np.arange(int(cycles * rate)) / rate
    solved = solve_ivp(
        lambda _, y: [y[1], system(y[0], y[1], values)],
        (0, tau[-1]),
        [start, 0.0],
        "DOP853",
        tau,
        rtol=1e-10,
        atol=1e-12,
    )
    return Known(tau / (2 * np.pi * frequency), solved.y[0], frequency)


# -- defects: each returns the spoiled samples and the times [start, end] where that was -----------

Spoiled = tuple[np.ndarray, float, float]
Spoil = Callable[[Known, np.ndarray, np.random.Generator], Spoiled]


def zeros(known: Known, x: np.ndarray, rng: np.random.Generator) -> Spoiled:
    """One second of zeros, or a fifth of the record where that is shorter."""
    width = min(1.0, 0.2 * known.t[-1])
    start = rng.uniform(0.1, 0.6) * known.t[-1]
    inside = (known.t >= start) & (known.t < start + width)
    return np.where(inside, 0.0, x), start, start + width


def spike(known: Known, x: np.ndarray, rng: np.random.Generator) -> Spoiled:
    at, width = int(rng.uniform(0.05, 0.7) * len(x)), rng.integers(1, 4)
    y = x.copy()
    y[at : at + width] += rng.choice([-1, 1]) * rng.choice([3, 10]) * known.amplitude
    return y, known.t[at], known.t[at + width - 1]


def clipped_share(known: Known, x: np.ndarray, rng: np.random.Generator) -> Spoiled:
    limit = np.quantile(np.abs(x), 0.99)
    hit = np.flatnonzero(np.abs(x) > limit)
    return np.clip(x, -limit, limit), known.t[hit[0]], known.t[hit[-1]]


def clipped_peak(known: Known, x: np.ndarray, rng: np.random.Generator) -> Spoiled:
    limit = 0.99 * np.abs(x).max()
    hit = np.flatnonzero(np.abs(x) > limit)
    return np.clip(x, -limit, limit), known.t[hit[0]], known.t[hit[-1]]


def drifting(known: Known, x: np.ndarray, rng: np.random.Generator) -> Spoiled:
    tau = known.t / known.t[-1]
    shapes = (
        np.sin(2 * np.pi * (rng.uniform(0.5, 2) * tau + rng.random())),
        tau,
        np.exp(-tau / rng.uniform(0.1, 0.5)),
    )
    size = rng.uniform(0.1, 1.0) * known.amplitude
    return x + size * shapes[rng.integers(3)], known.t[0], known.t[-1]


def hum(mains: float) -> Spoil:
    def spoil(known: Known, x: np.ndarray, rng: np.random.Generator) -> Spoiled:
        size, y = 10 ** rng.uniform(-2, np.log10(0.3)) * known.amplitude, x.copy()
        f = mains + rng.uniform(-0.05, 0.05)
        for order, share in ((1, 1.0), (2, 0.3), (3, 0.5), (5, 0.2)):
            if order * f < 0.45 / (known.t[1] - known.t[0]):
                phase = 2 * np.pi * rng.random()
                y += size * share * np.cos(2 * np.pi * order * f * known.t + phase)
        return y, known.t[0], known.t[-1]

    return spoil


def pink(snr_db: float) -> Spoil:
    def spoil(known: Known, x: np.ndarray, rng: np.random.Generator) -> Spoiled:
        n = len(x)
        spectrum = np.fft.rfft(rng.standard_normal(n))
        noise = np.fft.irfft(spectrum / np.sqrt(np.maximum(np.arange(len(spectrum)), 1)), n)
        size = 10 ** (-snr_db / 20) * np.std(known.q) / np.std(noise)
        return x + size * noise, known.t[0], known.t[-1]

    return spoil


def shifted(known: Known, x: np.ndarray, rng: np.random.Generator) -> Spoiled:
    return x + 1000 * known.amplitude, known.t[0], known.t[-1]


def several(known: Known, x: np.ndarray, rng: np.random.Generator) -> Spoiled:
    for spoil in (shifted, drifting, hum(50.0)):
        x = spoil(known, x, rng)[0]
    return spike(known, x, rng)


DEFECTS: dict[str, tuple[str, Spoil]] = {
    "none": ("", lambda known, x, rng: (x, known.t[0], known.t[-1])),
    "one second of zeros": ("dropout", zeros),
    "spike": ("spikes", spike),
    "1 % clipped": ("clipping", clipped_share),
    "clipped 1 % below the peak": ("clipping", clipped_peak),
    "drift": ("drift", drifting),
    "hum of 50 Hz": ("mains", hum(50.0)),
    "hum of 60 Hz": ("mains", hum(60.0)),
    "pink noise at 20 dB": ("coloured noise", pink(20.0)),
    "pink noise at 10 dB": ("coloured noise", pink(10.0)),
    "offset of 1000": ("offset", shifted),
    "offset, drift, hum and a spike": ("spikes", several),
}


# -- one trial -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Trial:
    """Whether a defect was named, what else was; how well the backbone holds, or the refusal."""

    named: bool
    others: tuple[str, ...]
    inside: dict[str, float]  # share of cycles within two standard errors
    wider: dict[str, float]  # median of the standard errors over those of the clean record
    cycles: float  # number of cycles over that of the clean record
    refusal: str = ""


def trial(seed: int, name: str) -> Trial:
    rng = np.random.default_rng(seed)
    known = known_decay(rng)
    healthy = known.q + 10 ** (-SNR_DB / 20) * np.std(known.q) * rng.standard_normal(len(known.t))
    kind, spoil = DEFECTS[name]
    spoiled, start, end = spoil(known, healthy, rng)
    inspection = rs.inspect(Recording(known.t, spoiled, source="trial"))
    named = not kind or any(_is(d, kind, start, end, known) for d in inspection.defects)
    others = tuple(sorted({d.kind for d in inspection.defects} - {kind}))
    reference = backbone(rs.inspect(Recording(known.t, healthy)))
    try:
        found = backbone(inspection)
    except ValueError as error:
        return Trial(named, others, {}, {}, 0.0, str(error))
    truth = rs.extract_backbone(rs.Decay(known.t, known.q))
    inside, wider = {}, {}
    for what in NAMES:
        std = getattr(found, f"{what}_std")
        error = getattr(found, what) - np.interp(found.t, truth.t, getattr(truth, what))
        inside[what] = float(np.mean(np.abs(error) <= 2 * std))
        usual = np.interp(found.t, reference.t, getattr(reference, f"{what}_std"))
        wider[what] = float(np.median(std / usual))
    return Trial(named, others, inside, wider, len(found) / len(reference))


def backbone(inspection: Inspection) -> rs.Backbone:
    """Of the longest free decay of the dominant mode."""
    return rs.extract_backbone(max(inspection.decays(), key=lambda decay: decay.t[-1] - decay.t[0]))


def _is(defect: Defect, kind: str, start: float, end: float, known: Known) -> bool:
    """Whether a defect is of that kind and overlaps that time, give or take a cycle."""
    slack = 1 / known.frequency
    return defect.kind == kind and defect.start < end + slack and defect.end > start - slack


def row(name: str, trials: list[Trial]) -> str:
    """What the trials of one defect add up to."""
    held = [t for t in trials if not t.refusal]
    others = Counter(kind for t in trials for kind in t.others)
    inside = " ".join(f"{np.mean([t.inside[n] for t in held]):5.2f}" for n in NAMES)
    wider = " ".join(f"{np.median([t.wider[n] for t in held]):6.2f}" for n in NAMES)
    named = f"{sum(t.named for t in trials)}/{len(trials)}"
    told = ", ".join(f"{kind} {count}" for kind, count in others.items())
    cycles = np.mean([t.cycles for t in held])
    return (
        f"{name:31s}{named:>6s}{len(trials) - len(held):9d}  {inside}  {wider}{cycles:8.2f}  {told}"
    )


@click.command()
@click.option("--first", default=0, help="First seed.")
@click.option("--count", default=20, help="Number of decays.")
@click.option("--only", default="", help="Part of the name of a defect.")
def main(first: int, count: int, only: str) -> None:
    click.echo(f"{'':52s}share within 2 std   std / clean")
    click.echo(
        f"{'defect':31s} named  refused  {'f':>5s} {'A':>5s} {'zeta':>5s}"
        f"  {'f':>6s} {'A':>6s} {'zeta':>6s}  cycles  other kinds"
    )
    for name in DEFECTS:
        if only in name:
            click.echo(row(name, [trial(seed, name) for seed in range(first, first + count)]))


if __name__ == "__main__":
    main()
