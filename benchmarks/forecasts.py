"""Do bands of forecasts hold what is measured then, and are they worth more than one width?

    python benchmarks/forecasts.py --count 40              # seeds 0 to 39
    python benchmarks/forecasts.py --first 1000 --jobs 2

Half of the records are decays: another run is foretold from its first two cycles, at .6 to 1.4
times the amplitude that was identified, by terms that are given (from one run, or from three
between which the structure moved, as it does before the fourth) or by functions. The other half are
stepped sines: of four levels the largest is foretold. A tenth lacks a small term. Motions are those
of scipy's solve_ivp. Points are measured ones, noise and all. The score is that of `bands`, the
lower the better, beside that of the best constant width: of its own record, known afterwards, and
of all records of a kind, as a part of their largest response.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from bands import LEVEL, holds, interval_score
from joblib import Parallel, delayed
from scipy.integrate import solve_ivp
from scipy.signal import lfilter
from seeds import parser_of

import romsindy as rs
from romsindy.text import aligned
from romsindy.typing import Array

KINDS = ("decay, terms", "decay, three runs", "decay, functions", "stepped sine")
PER_CYCLE, STATE = 30, 60  # samples
LEVELS, POINTS = np.array([0.3, 0.6, 1.0, 1.3]), 30
SETTLED, STARTS = 160, 4  # cycles, and phases from which a stepped sine starts
WIDTHS = np.geomspace(1e-5, 1.0, 200)  # constant ones that are tried, as parts of the peak

Laws = dict[str, float]
FORCES: dict[str, Callable[[Array, Array], Array]] = {
    "omega^2": lambda q, v: q,
    "gamma_2": lambda q, v: q**2,
    "gamma_3": lambda q, v: q**3,
    "gamma_5": lambda q, v: q**5,
    "c_linear": lambda q, v: v,
    "c_quadratic": lambda q, v: np.abs(v) * v,
}


class Row(NamedTuple):
    """A record foretold: its points and their band, as parts of the peak."""

    seed: int
    kind: str
    lacking: str
    truth: Array
    value: Array
    low: Array
    high: Array
    notes: tuple[str, ...]

    @property
    def held(self) -> float:
        return float(np.mean(holds(self.low, self.high, self.truth)))

    @property
    def score(self) -> float:
        return interval_score(self.low, self.high, self.truth)

    def constant(self, width: float) -> float:
        """Score of a band of one half-width."""
        return interval_score(self.value - width, self.value + width, self.truth)

    @property
    def best(self) -> float:
        """That of the best one, known afterwards."""
        return min(map(self.constant, WIDTHS))


def force(laws: Laws, q: Array, v: Array) -> Array:
    """What pulls back and slows down, per unit mass."""
    return np.asarray(sum(value * FORCES[name](q, v) for name, value in laws.items()))


def oscillator(rng: np.random.Generator, amplitude: float, lacking: str) -> Laws:
    """Laws of an oscillator that moves so far, with the small term that a model will lack."""
    omega = 2 * np.pi * rng.uniform(2.0, 20.0)
    zeta = rng.uniform(0.003, 0.012)
    laws = {"omega^2": omega**2, "c_linear": 2 * zeta * omega}
    bend = rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.15)
    laws["gamma_3"] = bend * omega**2 / amplitude**2
    if rng.random() < 0.5:
        laws["c_quadratic"] = rng.uniform(0.2, 1.0) * 2 * zeta / amplitude
    if lacking == "gamma_5":
        laws["gamma_5"] = rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.03) * omega**2
        laws["gamma_5"] /= amplitude**4
    elif lacking == "c_quadratic":
        laws["c_quadratic"] = rng.uniform(0.1, 0.3) * 2 * zeta / amplitude
    return laws


def moved(laws: Laws, rng: np.random.Generator, frequency: float, damping: float) -> Laws:
    """The same structure on another day."""
    stiff, lossy = (1 + s * rng.standard_normal() for s in (2 * frequency, damping))
    return {n: value * (lossy if n.startswith("c") else stiff) for n, value in laws.items()}


def ringing(laws: Laws, amplitude: float, rng: np.random.Generator, noise: float) -> rs.Decay:
    """A free decay until a twentieth is left of it, with white or coloured noise."""
    omega = np.sqrt(laws["omega^2"])
    cycles = min(np.log(20) / (np.pi * laws["c_linear"] / omega), 150)
    t = np.arange(round(PER_CYCLE * cycles)) * 2 * np.pi / omega / PER_CYCLE
    found = solve_ivp(
        lambda s, y: [y[1], -force(laws, y[0], y[1])],
        (0.0, t[-1]),
        [amplitude, 0.0],
        method="DOP853",
        t_eval=t,
        rtol=1e-9,
        atol=1e-11 * amplitude,
    )
    memory = 0.9 if rng.random() < 0.3 else 0.0
    drawn = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], rng.standard_normal(len(t) + 200))
    return rs.Decay(t, found.y[0] + noise * amplitude * drawn[200:], unit="m")


def named(names: Sequence[str]) -> list:
    """Terms beside the linear ones."""
    return [t for t in rs.ReducedModel.from_coefficients(dict.fromkeys(names, 1.0)).terms]


def decay_foretold(seed: int, kind: str, lacking: str) -> Row:
    """Identify one run, or three, and foretell another one."""
    rng = np.random.default_rng([seed, 7])
    amplitude, noise = 10 ** rng.uniform(-3, -1), 10 ** rng.uniform(-2.75, -1.75)
    laws = oscillator(rng, amplitude, lacking)
    change = (10 ** rng.uniform(-4, -3), 10 ** rng.uniform(-2.3, -1.3))
    runs = 3 if kind == "decay, three runs" else 1
    change = change if runs > 1 else (0.0, 0.0)
    sizes = amplitude * np.append(rng.uniform(0.8, 1.0, runs), rng.uniform(0.6, 1.4))
    *several, other = (ringing(moved(laws, rng, *change), a, rng, noise) for a in sizes)
    terms = None
    if kind != "decay, functions":
        terms = named([n for n in laws if n not in ("omega^2", "c_linear", lacking)])
    forecast = rs.identify(several, terms=terms).forecast(other, STATE)
    peak = np.abs(other.q).max()
    points = [x[STATE:] / peak for x in (other.q, forecast.value, forecast.low, forecast.high)]
    return Row(seed, kind, lacking, *points, forecast.notes)


def steady(laws: Laws, omega: Array, size: Array) -> Array:
    """First harmonic of the largest steady motion under size cos(omega t), (n,) complex.

    All points at once, each in the time of its own phase, from rest and from large motions.
    """
    reach = size / (laws["c_linear"] * omega)
    phase = np.arange(STARTS) * 2 * np.pi / STARTS
    start = np.concatenate([np.zeros((2, 1)), np.stack([np.cos(phase), np.sin(phase)])], axis=1)
    y = (start[:, :, None] * reach).reshape(2, -1)
    w, f = np.tile(omega, STARTS + 1), np.tile(size, STARTS + 1)

    def slope(s: float, y: Array) -> Array:
        q, v = y.reshape(2, -1)
        return np.concatenate([v, (f * np.cos(s) - force(laws, q, w * v)) / w**2])

    end = 2 * np.pi * SETTLED
    last = end + np.linspace(0, 2 * np.pi, 65)
    found = solve_ivp(
        slope, (0, last[-1]), y.ravel(), method="DOP853", t_eval=last, rtol=1e-7, atol=1e-12
    )
    q = found.y.reshape(2, -1, len(last))[0, :, :-1]
    first = (q @ np.exp(-1j * last[:-1]) / 32).reshape(STARTS + 1, -1)
    return first[np.argmax(np.abs(first), axis=0), np.arange(len(omega))]


def sine_foretold(seed: int, lacking: str) -> Row:
    """Learn from three levels of a stepped sine, and foretell a larger one."""
    rng = np.random.default_rng([seed, 8])
    amplitude = 10 ** rng.uniform(-3, -1)
    laws = oscillator(rng, amplitude, lacking)
    laws["gamma_3"] /= 4  # the curve bends, and folds at the largest levels at most
    laws["c_linear"] *= 3
    omega, zeta = np.sqrt(laws["omega^2"]), laws["c_linear"] / 2 / np.sqrt(laws["omega^2"])
    bent = 1 + 3 / 8 * laws["gamma_3"] * amplitude**2 / omega**2 * np.array([0, 1.5])
    grid = omega * np.linspace(bent.min() - 4 * zeta, bent.max() + 4 * zeta, POINTS)
    w, level = np.tile(grid, len(LEVELS)), np.repeat(LEVELS, POINTS)
    # The shaker gives each level almost, and each point almost.
    given = 1 + 0.003 * np.repeat(rng.standard_normal(len(LEVELS)), POINTS)
    given = given + 0.002 * rng.standard_normal(len(w))
    x = steady(laws, w, 2 * zeta * omega**2 * amplitude * level * given)
    noise = 10 ** rng.uniform(-3.3, -2.3) * amplitude
    x = x + noise * (rng.standard_normal(len(x)) + 1j * rng.standard_normal(len(x)))
    names = [n for n in laws if n != lacking]
    model = rs.ReducedModel.from_coefficients({n: laws[n] for n in names}, unit="m")
    learnt = level < LEVELS[-1]
    fit = rs.fit_steady(model, w[learnt], level[learnt], x[learnt], std=noise)
    band = fit.forced_response(LEVELS[-1], (grid[0], grid[-1]))
    truth = np.abs(x[~learnt])
    points = [a / truth.max() for a in (truth, *band.at(grid))]
    return Row(seed, KINDS[-1], lacking, *points, band.notes)


def trial(number: int, seed: int) -> Row:
    """The record of a place in the list."""
    warnings.simplefilter("ignore")
    if number % 2:
        return sine_foretold(seed, "gamma_5" if number % 20 == 7 else "")
    kind = KINDS[1] if number % 4 else KINDS[0] if number % 8 == 0 else KINDS[2]
    lacking = {8: "c_quadratic", 16: "gamma_5"}.get(number % 40, "")
    return decay_foretold(seed, kind, lacking)


def common_width(rows: Sequence[Row]) -> float:
    """The best constant half-width for all records, as a part of their peaks."""
    return float(min(WIDTHS, key=lambda w: np.mean([r.constant(w) for r in rows])))


def table(rows: Sequence[Row]) -> list[list[str]]:
    """A line for each kind, and one for all."""
    lines = [["kind", "records", f"in {LEVEL:.0%} band", "score", "own best constant", "better in"]]
    lines[0] += ["common constant", "better in"]
    groups = {k: [r for r in rows if r.kind == k] for k in KINDS}
    commons = {k: common_width(g) for k, g in groups.items() if g}
    for name, group in [*groups.items(), ("a term lacks", [r for r in rows if r.lacking])]:
        if group:
            lines.append(line(name, group, commons))
    return [*lines, line("all", rows, commons)]


def line(name: str, rows: Sequence[Row], commons: dict[str, float]) -> list[str]:
    """Scores in per cent of the peak."""
    scores = np.array([[r.score, r.best, r.constant(commons[r.kind])] for r in rows])
    own, best, common = 100 * scores.mean(axis=0)
    wins = np.sum(scores[:, :1] < scores[:, 1:], axis=0)
    held = np.mean([r.held for r in rows])
    cells = [name, str(len(rows)), f"{held:.1%}", f"{own:.3g}", f"{best:.3g}", str(wins[0])]
    return [*cells, f"{common:.3g}", str(wins[1])]


def main() -> None:
    options = parser_of(__doc__, 40).parse_args()
    rows = Parallel(options.jobs)(
        delayed(trial)(i, options.first + i) for i in range(options.count)
    )
    for r in rows:
        worst = f"{r.score / r.best:.2f} of the best constant"
        print(f"{r.seed:6}  {r.kind:18} {r.lacking:12} {r.held:6.1%} held, score {worst}")
    print(aligned(table(rows)))


if __name__ == "__main__":
    main()
