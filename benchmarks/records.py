"""Any real record: what is asked of measured and of long records, beside what was measured.

    python benchmarks/records.py [PART ...] --data FOLDER [--cache FOLDER] [--seed 0]

Parts: double_beam, brake_reuss, steel, pendulum, repeats (these need --data); tip_force, bars,
long.
Set OMP_NUM_THREADS=1. Defects, releases and files have trials of their own: defects.py,
releases.py, files.py.
"""

from __future__ import annotations

import itertools
import resource
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import click
import numpy as np
from known_beams import KnownDecay, cached
from uncertainty import Row

import romsindy as rs
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.record.recording import QUANTITIES, Recording
from romsindy.record.signals import with_noise

TURN = 2 * np.pi
NAMED = (80.5, 298.0, 846.0, 1527.0, 1766.0, 2765.0)  # Hz, of the Brake-Reuss beam
GROUPS = ((1, 3, 4), (5, 7, 8), (9, 11, 12))  # runs with the same place of impact, presumably
RUNS = {"21337": "test_21337_0kn", "21338": "test_21338_0kn"}


def velocity(t: np.ndarray, v: np.ndarray) -> Recording:
    """In m/s, as `--unit m/s` reads it."""
    return Recording(t, v, quantity="velocity", unit="m")


def at_amplitude(decay: rs.Decay, amplitude: float) -> tuple[float, float, float]:
    """Frequency in Hz, its standard error, and damping ratio of the cycle nearest to that size."""
    backbone = rs.extract_backbone(decay)
    k = int(np.argmin(np.abs(backbone.amplitude - amplitude)))
    frequency, std = backbone.frequency[k] / TURN, backbone.frequency_std[k] / TURN
    return float(frequency), float(std), float(backbone.damping_ratio[k])


def verdict(decay: rs.Decay) -> str:
    """Whether the data are explained, or why there is no identification."""
    try:
        return str(rs.identify(decay).verdict)
    except TrajectoryError as error:
        return f"regressions alone: {error}"


def double_beam(data: Path) -> Iterator[Row]:
    """Nine hammer decays, two modes that ring together."""
    file = np.load(data / "double_beam_train.npz")
    found = []
    for run, v in zip(file["run"], file["v"].T, strict=True):
        seen = rs.inspect(velocity(file["t"], v))
        modes = ", ".join(f"{m.mean_frequency:.2f}" for m in seen.modes)
        ratios = ", ".join(f"{r.p}:{r.q}" for _, _, r in seen.resonances)
        frequency, _, zeta = at_amplitude(seen.decays()[0], 2e-4)
        other = rs.extract_backbone(seen.decays(mode=2)[0]).frequency / TURN
        own = rs.extract_backbone(seen.decays()[0]).frequency / TURN
        found.append(frequency)
        text = (
            f"modes {modes} Hz, ratio {ratios or 'none'}; used mode {seen.dominant.number}:"
            f" {frequency:.3f} Hz, {100 * zeta:.4f} % at 0.2 mm, {own.min():.1f} to {own.max():.1f}"
            f" Hz; --mode 2 {np.median(other):.2f} Hz"
        )
        yield f"double beam, run {run}", text, "122.3-122.5 and 243, 1:2, no hop"
    spread = f"{np.ptp(found):.3f} Hz apart"
    yield "double beam, mode 1 at 0.2 mm over the runs", spread, "within 0.02 Hz"


def brake_reuss(data: Path) -> Iterator[Row]:
    """Six named vibrations, three accelerometers."""
    file = np.load(data / "brake_reuss_hammer.npz")
    for name in ("acc1", "acc2", "acc3"):
        recording = Recording(file["t"], file[name], quantity="acceleration", unit="m")
        seen = rs.inspect(recording)
        listed = np.array([m.mean_frequency for m in seen.modes])
        off = [100 * np.abs(listed / f - 1).min() for f in NAMED]
        yield f"Brake-Reuss {name}, six vibrations", f"at most {max(off):.2f} % off", "0.5 %"
        decay = seen.decays(mode=1)[0]
        backbone = rs.extract_backbone(decay)
        f, z, a = backbone.frequency / TURN, 100 * backbone.damping_ratio, backbone.amplitude
        places = [slice(-40, -10), *(slice(k, k + 5) for k in (40, 20, 5))]
        text = "; ".join(
            f"{np.median(f[at]):.3f} Hz, {np.median(z[at]):.3f} % at {a[at].mean():.2g} m"
            for at in places
        )
        yield f"Brake-Reuss {name}, mode 1", text, "80.6 -> 80.4 Hz, 0.137 -> 0.245 %"
        yield f"Brake-Reuss {name}, verdict", verdict(decay), "refined"


def steel(data: Path) -> Iterator[Row]:
    """The hit is in the record and clips."""
    file = np.load(data / "cantilever_steel_accelerometers.npz")
    for i in range(2):
        recording = Recording(file["t"], file["acc"][:, i], quantity="acceleration", unit="m")
        seen = rs.inspect(recording)
        decay = seen.decays()[0]
        backbone = rs.extract_backbone(decay)
        f = backbone.frequency / TURN
        ends = [np.abs(x).max() for x in np.array_split(decay.q, 10)]
        text = (
            f"modes {', '.join(f'{m.mean_frequency:.2f}' for m in seen.modes)} Hz;"
            f" {np.median(f[3:10]):.3f} -> {np.median(f[len(f) // 2 :]):.3f} Hz; largest q"
            f" {np.argmax(ends) + 1}. tenth"
        )
        yield f"steel cantilever, accelerometer {i + 1}", text, "7.83 -> 7.90 Hz within 0.02"


def pendulum(data: Path) -> Iterator[Row]:
    """Three releases joined in all six orders, with and without gaps."""
    file = np.load(data / "pendulum_free_swing.npz")
    angle = {a: np.deg2rad(file[f"release_{a}deg_theta_deg"]) for a in (45, 90, 135)}
    fs = float(file["fs"])
    alone = {a: rs.inspect(_joined([x], fs, 0.0)).decays() for a, x in angle.items()}
    for gap in (0.0, 3.0):
        counts, off = [], []
        for order in itertools.permutations(angle):
            seen = rs.inspect(_joined([angle[a] for a in order], fs, gap))
            counts.append(len(seen.releases))
            for a, decay in zip(order, seen.decays(), strict=False):
                off.append(_difference(decay, alone[a][0]))
        text = f"{counts} releases; frequency {100 * max(off):.2g} % off that of the files at most"
        yield f"pendulum, six orders, gaps of {gap:g} s", text, "3 each, equal within errors"


def _joined(parts: list[np.ndarray], fs: float, gap: float) -> Recording:
    start, t = 0.0, []
    for x in parts:
        t.append(start + np.arange(len(x)) / fs)
        start = t[-1][-1] + 1 / fs + gap
    return Recording(np.concatenate(t), np.concatenate(parts), unit="rad")


def _difference(one: rs.Decay, other: rs.Decay) -> float:
    """Largest relative difference of two backbones over the amplitudes that both have."""
    a, b = rs.extract_backbone(one), rs.extract_backbone(other)
    inside = (a.amplitude > b.amplitude.min()) & (a.amplitude < b.amplitude.max())
    there = np.interp(a.amplitude[inside], b.amplitude[::-1], b.frequency[::-1])
    return float(np.abs(a.frequency[inside] / there - 1).max(initial=0.0))


def repeats(data: Path) -> Iterator[Row]:
    """Do 95 % intervals of repeated runs overlap?"""
    file, ship = (np.load(data / f) for f in ("double_beam_train.npz", "kvlcc2_roll_decay.npz"))
    records = {
        str(run): velocity(file["t"], v) for run, v in zip(file["run"], file["v"].T, strict=True)
    }
    records |= {n: Recording(ship[f"{k}_t"], ship[f"{k}_phi"], unit="rad") for n, k in RUNS.items()}
    intervals = {}
    for name, recording in records.items():
        found = rs.identify(rs.inspect(recording).decays())
        squared, damping = (np.array(found.interval(k)) for k in ("omega^2", "c_linear"))
        frequency = np.sqrt(squared) / TURN
        zeta = damping / (2 * TURN * frequency.mean())
        intervals[name] = frequency, zeta
        halves = [100 * np.ptp(x) / 2 / x.mean() for x in (frequency, zeta)]
        text = (
            f"{frequency[0]:.4f} to {frequency[1]:.4f} Hz ({halves[0]:.3f} %),"
            f" {100 * zeta[0]:.4f} to {100 * zeta[1]:.4f} % ({halves[1]:.0f} %); {found.structure}"
        )
        yield f"run {name}, linear frequency and damping", text, "0.05 %, 10 %"
    pairs = [p for g in (*GROUPS, tuple(RUNS)) for p in itertools.combinations(map(str, g), 2)]
    for i, name in enumerate(("frequency", "damping")):
        both = [_overlap(intervals[a][i], intervals[b][i]) for a, b in pairs]
        yield f"repeat runs, intervals of {name} overlap", f"{sum(both)} of {len(both)}", "90 %"


def _overlap(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(one[0] <= other[1] and other[0] <= one[1])


def tip_force(cache: Path | None, seed: int) -> Iterator[Row]:
    """The default beam let go from a force at its tip: modes 2 and 3 ring along."""
    rows = cached(cache, "tip_force", _tip_force)
    known = KnownDecay(
        rs.Decay(rows["t"], rows["q"], unit="kg^0.5 m"), rows["held"], rows["h"], rows["stiffness"]
    )
    for snr in (None, 45.0):
        x = rows["q"] if snr is None else with_noise(rows["q"], snr, seed)
        seen = rs.inspect(Recording(rows["t"], x, unit="kg^0.5 m"))
        found = rs.identify(seen.decays())
        q = known.amplitude * np.array([-0.75, -0.5, -0.25, 0.25, 0.5, 0.75])
        off = 100 * (found.inertia(q).value / known.curves(q)[0] - 1)
        text = ", ".join(f"{x:+.1f}" for x in off) + " %"
        noise = "no noise" if snr is None else f"{snr:g} dB"
        yield f"tip force, {noise}, h at -0.75 ... 0.75 q_max", text, "within 8 %"


def _tip_force() -> dict[str, np.ndarray]:
    beam = rs.Beam.cantilever()
    modes = beam.modes(count=10)
    motion = beam.simulate(beam.release_shape(beam.length / 3), 25.0, modes=modes, progress=False)
    decay = modes.project(motion, mode=1)
    curve = beam.static_curve(1, 1.02 * float(np.abs(decay.q).max()), 61)
    still = curve.q == 0
    ratio = np.where(still, curve.omega2, curve.force / np.where(still, 1.0, curve.q))
    return {
        "t": decay.t,
        "q": decay.q,
        "held": curve.q,
        "h": curve.inertia - 1,
        "stiffness": ratio,
    }


def bars(seed: int, seeds: int = 6) -> Iterator[Row]:
    """Error bars of backbones of a linear vibration, whose motion is known in closed form."""
    t, w, zeta = np.arange(0, 5, 1 / 600), TURN * 20, 0.004
    pole = w * (-zeta + 1j * np.sqrt(1 - zeta**2))
    rate = np.sqrt(1 - zeta**2) * w
    for k, quantity in enumerate(QUANTITIES):
        clean = np.real(pole**k * np.exp(pole * t + 1j))
        for snr in (30.0, 50.0):
            off = []
            for i in range(seeds):
                noisy = with_noise(clean, snr, seed + i)
                seen = rs.inspect(Recording(t, noisy, quantity=quantity, unit="m"))
                b = rs.extract_backbone(seen.decays()[0])
                size = np.exp(-zeta * w * b.t)
                loud = size * w**k > 3 * np.std(clean) * 10 ** (-snr / 20)
                errors = (
                    (b.frequency - rate) / b.frequency_std,
                    (b.damping_ratio - zeta) / b.damping_ratio_std,
                )
                off.append(np.abs(np.array(errors)[:, loud]))
            inside = 100 * np.mean(np.concatenate(off, axis=1) < 2, axis=1)
            size = np.median(np.concatenate(off, axis=1), axis=1) / 0.674
            text = (
                f"{inside[0]:.0f} % of frequencies, {inside[1]:.0f} % of damping ratios within two"
                f" standard errors; errors {size[0]:.2f} and {size[1]:.2f} times them"
            )
            yield f"bars of a measured {quantity}, {snr:g} dB", text, "95 %, 1"


def long(seed: int, seconds: float = 100.0, rate: float = 50e3) -> Iterator[Row]:
    """Two modes in white noise: five million samples by default."""
    n = int(seconds * rate)
    t = np.arange(n) / rate
    x = np.exp(-0.15 * t) * np.cos(TURN * (12 * t + 3 * (1 - np.exp(-0.3 * t)) / 0.3))
    x += 0.2 * np.exp(-1.5 * t) * np.cos(TURN * 77 * t)
    x += 1e-3 * np.random.default_rng(seed).standard_normal(n)
    start = time.perf_counter()
    seen = rs.inspect(Recording(t, x, unit="m"))
    looked = time.perf_counter() - start
    found = rs.identify(seen.decays())
    whole = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    modes = ", ".join(f"{m.mean_frequency:.3f}" for m in seen.modes)
    text = f"{looked:.0f} s to inspect, {whole:.0f} s with identify, {peak:.2f} GB; {modes} Hz"
    yield f"{n / 1e6:g} million samples", text, "60 s, 1.5 GB"
    low, high = np.sqrt(found.interval("omega^2")) / TURN
    yield "their linear frequency", f"{low:.5f} to {high:.5f} Hz", "12"


MEASURED: dict[str, Callable[[Path], Iterator[Row]]] = {
    f.__name__: f for f in (double_beam, brake_reuss, steel, pendulum, repeats)
}


@click.command()
@click.argument("parts", nargs=-1)
@click.option("--data", type=click.Path(exists=True, path_type=Path), help="Measured records.")
@click.option("--cache", type=click.Path(path_type=Path), help="Keeps the simulated beam.")
@click.option("--seed", default=0, show_default=True)
def main(parts: tuple[str, ...], data: Path | None, cache: Path | None, seed: int) -> None:
    """Print every row: what, measured, asked."""
    made: dict[str, Callable[[], Iterator[Row]]] = {
        "tip_force": partial(tip_force, cache, seed),
        "bars": partial(bars, seed),
        "long": partial(long, seed),
    }
    if data is not None:
        made |= {name: partial(part, data) for name, part in MEASURED.items()}
    for part in parts or made:
        if part not in made:
            raise click.UsageError(f"part {part!r} is none of {', '.join(made)} (--data given?)")
        for what, measured, asked in made[part]():
            click.echo(f"{what:<52} {measured:<60} (asked: {asked})")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main()
