"""Blind trials: decays of oscillators in which an effect is hidden.

A trial is drawn from its kind and seed alone, and shares neither classes nor priors with romsindy:
the nominal oscillator, the place and exponents of the hidden effect, time scale (0.3 to 300 Hz),
amplitude, sampling, length, number of records, their clocks, what the sensor measures, and its
noise are drawn at random. What a diagnosis may see goes into <name>.npz, what it may not into
truth/<name>.json.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import laws
import memory
import numpy as np
import outside
import strangers
from hidden import Hidden, Setting
from noises import KINDS, MAINS, filtered, noises
from oscillator import Nominal, motion

import romsindy as rs

MAKERS = {**laws.MAKERS, **memory.MAKERS, **outside.MAKERS, **strangers.MAKERS}
IN_CATALOGUE = tuple(
    n for n in (*laws.MAKERS, *memory.MAKERS, *outside.MAKERS) if n != "bias"
)  # the zero of a displacement is removed before anything is compared
# Of two that are hidden each is of another group: they do not stand for one another.
GROUPS = (
    ("viscous", "quadratic_drag", "cubic_damping", "dry_friction", "hysteretic"),
    ("linear_frequency", "cubic_stiffness", "quadratic_stiffness", "bilinear", "stop", "magnet"),
    ("base_excitation", "mains_hum", "second_mode", "tuned_mass"),
)
QUANTITIES = ("displacement", "velocity", "acceleration")
_TURN = 2 * np.pi


@dataclass(frozen=True)
class Trial:
    """What a diagnosis may see.

    Attributes
    ----------
    coefficients : dict of str to float
        Of the simulation, SI units.
    times, signals : list of (n,) arrays
        One of each a record, s and m, m/s or m/s^2.
    measured : "displacement", "velocity" or "acceleration"
    held_out : bool
        Whether the last record takes no part.
    """

    coefficients: dict[str, float]
    times: list[np.ndarray]
    signals: list[np.ndarray]
    measured: str
    held_out: bool

    @property
    def model(self) -> rs.ReducedModel:
        """The simulation."""
        return rs.ReducedModel.from_coefficients(self.coefficients, unit="m")

    def decays(self) -> list[rs.Decay]:
        """The records as a user makes them."""
        make = {
            "displacement": rs.Decay,
            "velocity": rs.Decay.from_velocity,
            "acceleration": rs.Decay.from_acceleration,
        }[self.measured]
        return [make(t, x, unit="m") for t, x in zip(self.times, self.signals, strict=True)]

    def save(self, path: Path) -> None:
        """Write what a diagnosis may see."""
        said = {"coefficients": self.coefficients, "measured": self.measured}
        said |= {"held_out": self.held_out}
        arrays = {f"t{i}": t for i, t in enumerate(self.times)}
        arrays |= {f"x{i}": x for i, x in enumerate(self.signals)}
        np.savez(path, said=json.dumps(said), **arrays)

    @classmethod
    def load(cls, path: Path) -> Trial:
        """Read what `save` wrote."""
        with np.load(path) as content:
            said = json.loads(str(content["said"]))
            n = len(content.files) // 2
            times, signals = ([content[f"{k}{i}"] for i in range(n)] for k in "tx")
        return cls(times=times, signals=signals, **said)


@dataclass(frozen=True)
class Test:
    """How the decays are made and measured, dimensionless but for ``hertz`` and ``size``."""

    hertz: float  # the linear frequency
    size: float  # the largest release, m
    samples: float  # in each cycle
    releases: tuple[float, ...]
    skipped: tuple[int, ...]  # samples before each record begins
    spans: tuple[tuple[float, float], ...]  # of the releases, rad
    own_clocks: bool
    measured: str
    held_out: bool
    snr_db: float

    @classmethod
    def drawn(cls, rng: np.random.Generator, zeta: float, hum: bool) -> Test:
        """Draw a test that holds some cycles of a decay of this damping ratio."""
        low, high = (3.0, 15.0) if hum else (0.3, 300.0)
        hertz = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        # the mains must lie below the Nyquist frequency
        samples = rng.uniform(max(24.0, 2.6 * 60 / hertz if hum else 0.0), 110.0)
        count = int(rng.choice([1, 2, 3], p=[0.2, 0.3, 0.5]))
        sizes = [1.0, rng.uniform(0.45, 0.75), rng.uniform(0.7, 0.9)][:count]
        releases = tuple(float(s * rng.choice([-1, 1])) for s in sizes)
        cycles = np.clip(rng.uniform(1.8, 4.5) / (_TURN * zeta), 20, 160)
        lengths = [_TURN * float(cycles * rng.uniform(0.85, 1.15)) for _ in releases]
        own_clocks = bool(rng.random() < 0.5)
        spans, now = [], 0.0
        for length in lengths:
            spans.append((now, now + length))
            now = 0.0 if own_clocks else now + length * (1 + rng.uniform(0.1, 1.5))
        aside = rng.random() < 0.3
        skipped = tuple(int(aside * rng.uniform(0, 3) * samples) for _ in releases)
        measured = str(rng.choice(QUANTITIES, p=[0.6, 0.2, 0.2]))
        held_out = count == 3 or (count == 2 and rng.random() < 0.5)
        snr_db = float(rng.choice([30.0, 40.0]))
        size = float(10 ** rng.uniform(-5, 0.5))
        return cls(
            hertz, size, samples, releases, skipped, tuple(spans), own_clocks, measured,
            held_out, snr_db,
        )  # fmt: skip


def simulated(
    nominal: Nominal, effects: list[Hidden], test: Test, filter_rng: np.random.Generator | None
) -> list[np.ndarray]:
    """What the sensor shows of every release, dimensionless and without noise."""
    found = []
    for record, ((start, end), q_0) in enumerate(zip(test.spans, test.releases, strict=True)):
        t = start + np.arange(0, end - start, _TURN / test.samples)
        x = motion(nominal, effects, t, q_0)[QUANTITIES.index(test.measured)]
        for e in effects:
            if e.reading is not None:
                x = e.reading(t, x, record)
        if filter_rng is not None:
            x = filtered(x, test.samples, filter_rng)
        found.append(x[test.skipped[record] :])
    return found


@dataclass(frozen=True)
class Case:
    """A trial with all that is hidden, from which further records can be made."""

    trial: Trial
    truth: dict
    nominal: Nominal
    effects: list[Hidden]
    test: Test
    mains: float  # Hz over that of the oscillator
    level: float  # rms of the clean records, dimensionless

    def further(
        self, amplitude: float, duration: float, noise: float, wait: float, rng: np.random.Generator
    ) -> rs.Decay:
        """One more record: the largest release with amplitude, length and noise changed.

        It begins so many lengths of that record after the last one.
        """
        largest = max(range(len(self.test.releases)), key=lambda i: abs(self.test.releases[i]))
        begin, end = self.test.spans[largest]
        length = end - begin
        start = 0.0 if self.test.own_clocks else self.test.spans[-1][1] + wait * length
        made = replace(
            self.test,
            releases=(amplitude * self.test.releases[largest],),
            spans=((start, start + duration * length),),
            skipped=(0,),
        )
        kind = self.truth["noise"]
        (clean,) = simulated(self.nominal, self.effects, made, rng if kind == "causal" else None)
        louder = 20 * np.log10(np.sqrt(np.mean(clean**2)) / (noise * self.level))
        cycles = [len(clean) / made.samples * self.mains]
        (spoilt,) = noises(kind, [clean], cycles, made.snr_db + louder, rng)
        return measured(self.nominal, made, [clean + spoilt]).decays()[0]


def case_of(kind: str, names: list[str], strength: str, noise: str, seed: int) -> Case:
    """Draw one trial and what it hides."""
    rng = np.random.default_rng([zlib.crc32(kind.encode()), seed])
    nominal = Nominal.drawn(rng)
    hum = noise == "hum" or "mains_hum" in names
    test = Test.drawn(rng, nominal.zeta, hum)
    if any(n in outside.OF_A_DISPLACEMENT for n in names):
        test = replace(test, measured="displacement")
    mains = (float(rng.choice(MAINS)) + rng.uniform(-0.1, 0.1)) / test.hertz
    setting = Setting(strength, nominal.zeta, list(test.spans), mains, rng)
    effects = [MAKERS[n](n, setting) for n in names]
    clean = simulated(nominal, effects, test, rng if noise == "causal" else None)
    cycles = [len(x) / test.samples * mains for x in clean]
    spoilt = noises(noise, clean, cycles, test.snr_db, rng)
    trial = measured(nominal, test, [x + n for x, n in zip(clean, spoilt, strict=True)])
    truth = {
        "effects": {e.name: e.truth for e in effects},
        "strength": strength,
        "noise": noise,
        "snr_db": test.snr_db,
        "zeta": nominal.zeta,
        "hertz": test.hertz,
    }
    level = float(np.sqrt(np.mean(np.concatenate(clean) ** 2)))
    return Case(trial, truth, nominal, effects, test, mains, level)


def measured(nominal: Nominal, test: Test, signals: list[np.ndarray]) -> Trial:
    """Dimensionless signals with the units and times of a test."""
    omega = _TURN * test.hertz
    unit = test.size * omega ** QUANTITIES.index(test.measured)
    step = 1 / (test.hertz * test.samples)
    starts = [s / omega + k * step for (s, _), k in zip(test.spans, test.skipped, strict=True)]
    return Trial(
        nominal.coefficients(omega, test.size),
        [s + step * np.arange(len(x)) for s, x in zip(starts, signals, strict=True)],
        [unit * x for x in signals],
        test.measured,
        test.held_out,
    )


def drawn(kind: str, names: list[str], strength: str, noise: str, seed: int) -> tuple[Trial, dict]:
    """One trial and its truth."""
    case = case_of(kind, names, strength, noise, seed)
    return case.trial, case.truth


def chosen(kind: str, seed: int) -> tuple[list[str], str, str]:
    """Names of the hidden effects, their strength, and the noise, of one trial of a kind.

    Kinds: "hidden" (medium and strong), "weak", "two" (effects), "null_<noise>", "outside". Every
    effect comes in turn, so that a few trials hold different ones.
    """
    rng = np.random.default_rng([zlib.crc32(kind.encode()), seed, 1])
    if kind.startswith("null_"):
        return [], "none", kind.removeprefix("null_")
    noise = str(rng.choice(KINDS))
    if kind == "outside":
        name = list(strangers.MAKERS)[seed % len(strangers.MAKERS)]
        return [name], str(rng.choice(["medium", "strong"])), noise
    if kind == "two":
        groups = rng.permutation(len(GROUPS))[:2]
        both = [str(rng.choice(GROUPS[g])) for g in groups]
        quiet = "white" if "mains_hum" in both and noise == "hum" else noise
        return both, str(rng.choice(["medium", "strong"])), quiet
    order = np.random.default_rng(seed // len(IN_CATALOGUE)).permutation(len(IN_CATALOGUE))
    name = IN_CATALOGUE[order[seed % len(IN_CATALOGUE)]]
    if name == "mains_hum" and noise == "hum":
        noise = "white"
    strength = "weak" if kind == "weak" else str(rng.choice(["medium", "strong"]))
    return [name], strength, noise


def trial_of(kind: str, seed: int, folder: Path) -> Trial:
    """Return a trial, made and stored with its truth if it is not there."""
    path = folder / f"{kind}_{seed}.npz"
    if not path.is_file():
        trial, truth = drawn(kind, *chosen(kind, seed), seed)
        (folder / "truth").mkdir(parents=True, exist_ok=True)
        truth_of(kind, seed, folder, truth)
        trial.save(path)
    return Trial.load(path)


def truth_of(kind: str, seed: int, folder: Path, truth: dict | None = None) -> dict:
    """Read what a trial hides; write it where it is given."""
    path = folder / "truth" / f"{kind}_{seed}.json"
    if truth is not None:
        path.write_text(json.dumps(truth))
    return json.loads(path.read_text())
