"""Backbones read off decays whose cycles are known: are their error bars honest?

Random decays (viscous damping, drag, friction, damping that grows with amplitude), sampled and
noisy as measured ones are, in displacement, velocity or acceleration. The truth is read off the
motion without noise: its own solver finds crossings and turning points, and splines through them
follow the cycles. Nothing is shared with the method.

    python benchmarks/backbone.py                       # the row of the table
    python benchmarks/backbone.py --seed 7 --each       # every decay by itself
    python benchmarks/backbone.py --figure drag.png     # one fast decay against the truth
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

import romsindy as rs

LAWS = ("viscous", "drag", "friction", "amplitude")
QUANTITIES = ("displacement", "velocity", "acceleration")
FIRST = 3  # cycles that count as the first ones
LEAST = 8  # cycles above the noise
ABOVE = 4.0  # times the noise, in amplitude
_STEP = 1e-3  # from a turning point, of unit frequency: its cube does not matter


@dataclass(frozen=True)
class Truth:
    """Cycles of the motion without noise: middle, angular frequency, damping ratio, amplitude."""

    t: np.ndarray
    frequency: np.ndarray
    damping_ratio: np.ndarray
    amplitude: np.ndarray


@dataclass(frozen=True)
class KnownDecay:
    """One decay without noise, as its sensor would give it, and the noise it is to have."""

    name: str
    t: np.ndarray
    signal: np.ndarray
    quantity: str
    snr_db: float
    truth: Truth

    def noisy(self, rng: np.random.Generator) -> rs.Decay:
        """With white noise of this ratio of the rms values."""
        std = 10 ** (-self.snr_db / 20) * np.sqrt(np.mean(self.signal**2))
        x = self.signal + std * rng.standard_normal(len(self.t))
        make = {"velocity": rs.Decay.from_velocity, "acceleration": rs.Decay.from_acceleration}
        if self.quantity in make:
            return make[self.quantity](self.t, x, "m")
        return rs.Decay(self.t, x, unit="m")


@dataclass(frozen=True)
class Oscillator:
    """q'' + q + square q^2 + cube q^3 + friction + damping = 0: unit frequency and amplitude.

    The damping ratios at unit amplitude are those of the equivalent viscous damping (L. Jacobsen,
    Trans. ASME 52 (1930), 169): the same work in a cycle.
    """

    viscous: float = 0.0
    drag: float = 0.0
    friction: float = 0.0
    amplitude: float = 0.0
    square: float = 0.0
    cube: float = 0.0

    @property
    def ratio(self) -> float:
        """Damping ratio at unit amplitude."""
        return self.viscous + self.drag + self.friction + self.amplitude

    def acceleration(self, q: Any, v: Any, way: float) -> Any:
        """q'' while the friction acts against velocities of the sign ``way``."""
        held = q + self.square * q**2 + self.cube * q**3
        damped = 2 * self.viscous + 8 * self.amplitude * q**2 + 0.75 * np.pi * self.drag * abs(v)
        return -held - damped * v - 0.5 * np.pi * self.friction * way

    def swings(self, start: float, end: float) -> list:
        """Solutions from one turning point to the next, until ``end`` or rest."""
        t, q, parts = 0.0, start, []
        while t < end:
            way = -float(np.sign(q))
            pull = self.acceleration(q, 0.0, way)
            if pull * way <= 0:  # the spring is weaker than the friction
                break

            def rate(_: float, y: np.ndarray, way: float = way) -> list:
                return [y[1], self.acceleration(y[0], y[1], way)]

            def turns(_: float, y: np.ndarray) -> float:
                return y[1]

            def crosses(_: float, y: np.ndarray) -> float:
                return y[0]

            turns.terminal, turns.direction = True, -way
            # The first step leaves the turning point, where the velocity is zero too.
            first = [q + pull * _STEP**2 / 2, pull * _STEP]
            part = solve_ivp(
                rate, (t + _STEP, t + 10), first, method="DOP853", events=(turns, crosses),
                rtol=1e-10, atol=1e-13, dense_output=True,
            )  # fmt: skip
            parts.append((t, way, part))
            t, q = float(part.t_events[0][0]), float(part.y_events[0][0][0])
        return parts


def known(law: str, quantity: str, rng: np.random.Generator) -> KnownDecay:
    """A random decay of one law: 0.1 to 6 % at its first cycle, 8 to 150 cycles, 30 to 60 dB."""
    while True:
        ratio = float(np.exp(rng.uniform(np.log(1e-3), np.log(6e-2))))
        cycles = float(np.exp(rng.uniform(np.log(8), np.log(150))))
        snr_db, rate = (
            float(rng.uniform(30, 60)),
            float(np.exp(rng.uniform(np.log(16), np.log(90)))),
        )
        viscous = 0.0 if law in ("viscous", "friction") else ratio * float(rng.uniform(0, 0.25))
        # A velocity does not tell where an asymmetric vibration has its middle.
        square = float(rng.uniform(-0.15, 0.15)) * (quantity == "displacement")
        cube = float(rng.uniform(-0.15, 0.5))
        damping = {"viscous": viscous} | {law: ratio - viscous}
        shape = Oscillator(**damping, square=square, cube=cube)
        hertz, size = float(np.exp(rng.uniform(0, 4))), float(10 ** rng.uniform(-4, 0))
        name = f"{law} {100 * ratio:.2f} %, {cycles:.0f} cycles, {snr_db:.0f} dB, {quantity}"
        side = int(rng.integers(2))
        found = decayed(name, shape, quantity, cycles, snr_db, rate, hertz, size, side)
        if found is not None:
            return found


def decayed(
    name: str, shape: Oscillator, quantity: str, cycles: float, snr_db: float,
    rate: float = 40.0, hertz: float = 5.0, size: float = 0.01, side: int = 0,
) -> KnownDecay | None:  # fmt: skip
    """One decay, ``rate`` samples a cycle; None where too few cycles stand out of the noise."""
    end = 2 * np.pi * (cycles + 1)
    parts = shape.swings(1 + 2 * np.pi * shape.ratio, end + 4 * np.pi)
    if len(parts) < 2 * LEAST + 4:
        return None
    start = parts[2 + side][0]  # splines through the truth know the cycle that came before
    t = np.arange(start, end, 2 * np.pi / rate)
    q, v, a = _sampled(shape, parts, t)
    unit = 2 * np.pi * hertz
    signal = size * {"displacement": q, "velocity": unit * v, "acceleration": unit**2 * a}[quantity]
    truth = _truth(parts, start, unit, size)
    noise = 10 ** (-snr_db / 20) * np.sqrt(np.mean(signal**2))
    scale = unit ** QUANTITIES.index(quantity)
    loud = (truth.amplitude * scale > ABOVE * noise) & (truth.t < (t[-1] - start) / unit)
    if np.count_nonzero(loud) < LEAST:
        return None
    return KnownDecay(name, (t - start) / unit, signal, quantity, snr_db, truth)


def _sampled(shape: Oscillator, parts: list, t: np.ndarray) -> tuple[np.ndarray, ...]:
    """Motion, velocity and acceleration at times t; at rest after the last swing."""
    q, v, a = np.full(len(t), parts[-1][2].y[0, -1]), np.zeros(len(t)), np.zeros(len(t))
    for begin, way, part in parts:
        inside = (t >= begin) & (t < part.t[-1])
        if np.any(inside):
            q[inside], v[inside] = part.sol(np.maximum(t[inside], begin + _STEP))
            a[inside] = shape.acceleration(q[inside], v[inside], way)
    return q, v, a


def _truth(parts: list, start: float, unit: float, size: float) -> Truth:
    """Cycles between up-crossings after the start, from what a spline through the events says."""
    up, down = (
        np.array([p.t_events[1][0] for _, w, p in parts if w == way and len(p.t_events[1])])
        for way in (1, -1)
    )
    high, low = (
        np.array([p.y_events[0][0][0] for _, w, p in parts if w == way and len(p.t_events[1])])
        for way in (1, -1)
    )
    down, low = (x[len(down) - np.sum(down > up[0]) :] for x in (down, low))
    n = min(len(up) - 1, len(down), len(low))
    number, middle = np.arange(n + 1), np.arange(n) + 0.5
    rise = make_interp_spline(number, up[: n + 1], 5)
    fall = make_interp_spline(middle, down[:n], 5)
    period = (rise(middle, 1) + fall(middle, 1)) / 2
    top = make_interp_spline(number[:n] + 0.25, np.log(high[:n]), 5)
    bottom = make_interp_spline(number[:n] + 0.75, np.log(-low[:n]), 5)
    decrement = -make_interp_spline(middle, np.log(high[:n] - low[:n]), 5)(middle, 1)
    amplitude = (np.exp(top(middle)) + np.exp(bottom(middle))) / 2
    used = up[:n] > start
    found = (
        (rise(middle) - start) / unit,
        2 * np.pi / period * unit,
        decrement / np.hypot(2 * np.pi, decrement),
        amplitude * size,
    )
    return Truth(*(x[used] for x in found))


@dataclass(frozen=True)
class Score:
    """Of one decay and several draws: errors over their standard errors, and bias at the start.

    Attributes
    ----------
    frequency, damping : (n,) arrays
        Error over standard error of the cycles of all draws.
    bias, bias_std : (FIRST,) arrays
        Mean over the draws of the relative error of the damping ratio, and its standard error.
    lost : int
        Draws that gave no backbone, or cycles that are none of the truth's.
    """

    frequency: np.ndarray
    damping: np.ndarray
    bias: np.ndarray
    bias_std: np.ndarray
    lost: int


def score(case: KnownDecay, draws: int, seed: int) -> Score:
    """Read so many noisy draws of one decay."""
    frequency, damping, first, lost = [], [], [], 0
    for i in range(draws):
        noisy = case.noisy(np.random.default_rng([seed, i]))
        b, true = rs.extract_backbone(noisy), case.truth
        k = np.argmin(np.abs(b.t[:, None] - true.t), axis=1)
        same = np.abs(b.t - true.t[k]) < 0.4 * 2 * np.pi / true.frequency[k]
        lost += int(np.sum(~same))
        k, at = k[same], np.flatnonzero(same)
        frequency.append((b.frequency[at] - true.frequency[k]) / b.frequency_std[at])
        damping.append((b.damping_ratio[at] - true.damping_ratio[k]) / b.damping_ratio_std[at])
        relative = np.full(FIRST, np.nan)
        early = k < FIRST
        relative[k[early]] = b.damping_ratio[at[early]] / true.damping_ratio[k[early]] - 1
        first.append(relative)
    known_ones = np.sum(np.isfinite(first), axis=0)
    enough = np.where(known_ones > 1, known_ones, np.nan)
    return Score(
        np.concatenate(frequency), np.concatenate(damping),
        np.nanmean(np.where(known_ones > 1, first, np.nan)[:, known_ones > 1], axis=0),
        (np.nanstd(first, axis=0, ddof=1) / np.sqrt(enough))[known_ones > 1], lost,
    )  # fmt: skip


def trials(seed: int, decays: int) -> list[KnownDecay]:
    """Laws and quantities in turn."""
    rng = np.random.default_rng(seed)
    return [
        known(LAWS[i % len(LAWS)], QUANTITIES[i // len(LAWS) % len(QUANTITIES)], rng)
        for i in range(decays)
    ]


def within(errors: np.ndarray) -> float:
    """Per cent within two standard errors."""
    return 100 * float(np.mean(np.abs(errors) < 2))


def told(scores: list[Score]) -> str:
    """One row: what is inside two standard errors, and the bias at the first cycles."""
    frequency, damping = (np.concatenate([getattr(s, n) for s in scores]) for n in
                          ("frequency", "damping"))  # fmt: skip
    bias, std = (np.concatenate([getattr(s, n) for s in scores]) for n in ("bias", "bias_std"))
    sure = 100 * np.maximum(np.abs(bias) - 2 * std, 0)
    return (
        f"{within(frequency):.1f} % of frequencies, {within(damping):.1f} % of damping ratios of"
        f" {len(frequency)} cycles within two standard errors; damping of the first {FIRST} cycles"
        f" {100 * np.mean(bias):+.2f} % off in the mean, {100 * np.median(np.abs(bias)):.2f} % in"
        f" the median, {sure.max():.2f} % at most for sure, {100 * np.mean(sure > 2):.0f} % of them"
        f" over 2 %; {sum(s.lost for s in scores)} cycles lost"
    )


def figure(path: Path) -> None:
    """Damping of a fast decay by drag: one draw of noise, and the truth."""
    from matplotlib.figure import Figure

    shape = Oscillator(drag=0.048, cube=0.2)
    case = decayed("drag", shape, "displacement", 60, 40.0)
    assert case is not None
    b = rs.extract_backbone(case.noisy(np.random.default_rng(0)))
    axes = Figure(figsize=(10, 4)).subplots(1, 2)
    for ax, name in zip(axes, ("damping_ratio", "frequency"), strict=True):
        ax.errorbar(b.t, getattr(b, name), 2 * getattr(b, f"{name}_std"), fmt="o", mfc="none", ms=4)
        ax.plot(case.truth.t, getattr(case.truth, name), "k-")
        ax.set(xlabel="t [s]", ylabel=name, xlim=(0, 1.05 * b.t[-1]))
    axes[0].figure.savefig(path, dpi=110)


@click.command()
@click.option("--seed", default=0, show_default=True)
@click.option("--decays", default=60, show_default=True)
@click.option("--draws", default=20, show_default=True)
@click.option("--each", is_flag=True, help="Every decay by itself.")
@click.option("--figure", "picture", type=click.Path(path_type=Path), help="Draw one fast decay.")
def main(seed: int, decays: int, draws: int, each: bool, picture: Path | None) -> None:
    """Print what lies within two standard errors, over all and by law and quantity."""
    if picture is not None:
        figure(picture)
        return
    cases = trials(seed, decays)
    scores = [score(case, draws, seed) for case in cases]
    if each:
        for case, one in zip(cases, scores, strict=True):
            click.echo(f"{case.name}: {told([one])}")
    for group in (*LAWS, *QUANTITIES):
        some = [s for c, s in zip(cases, scores, strict=True) if group in c.name]
        if some:
            click.echo(f"{group:<13}{told(some)}")
    click.echo(f"{'all':<13}{told(scores)}")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main()
