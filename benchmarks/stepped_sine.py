"""The next test, predicted: three levels of a stepped sine are learnt, the fourth is foretold.

    python benchmarks/stepped_sine.py ../shared/data/stepped_sine_beam_eth.npz --levels 0.1 0.45

A beam's first harmonic near 42.77 Hz at four levels of excitation, 40 frequencies each. Terms, gain
and phase come from the three other levels; the band is compared with the best of constant width,
chosen with the measured level known.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bands import LEVEL, holds, interval_score

import romsindy as rs
from romsindy.text import aligned
from romsindy.typing import Array


@dataclass(frozen=True)
class Sweeps:
    """Points of all levels: rad/s, V, complex V of a velocity, V."""

    frequency: Array
    excitation: Array
    response: Array
    std: Array

    @classmethod
    def read(cls, path: Path) -> Sweeps:
        with np.load(path) as data:
            return cls(
                2 * np.pi * data["frequency_hz"],
                data["excitation_V"],
                data["first_harmonic_V"],
                data["first_harmonic_std_V"],
            )


@dataclass(frozen=True)
class Prediction:
    """A level foretold: errors of amplitude (of the peak) and of resonance (Hz), and its band."""

    terms: tuple[str, ...]
    rms: float
    resonance: float
    held: float
    score: float
    constant: float


def predicted(sweeps: Sweeps, level: float) -> Prediction:
    """Learn from the other levels, foretell this one."""
    out = sweeps.excitation == level
    fit = rs.fit_steady(
        None,
        sweeps.frequency[~out],
        sweeps.excitation[~out],
        sweeps.response[~out],
        measured="velocity",
        std=sweeps.std[~out],
        slope=None,
    )
    omega, truth = sweeps.frequency[out], np.abs(sweeps.response[out])
    band = rs.forced_response(fit, level, (omega.min(), omega.max()))
    amplitude, low, high = band.at(omega)
    return Prediction(
        fit.solution.free,
        float(np.sqrt(np.mean((amplitude - truth) ** 2)) / truth.max()),
        (band.peak[0] - resonance(omega, truth)) / (2 * np.pi),
        float(np.mean(holds(low, high, truth))),
        interval_score(low, high, truth),
        best_constant(amplitude, truth),
    )


def resonance(omega: Array, amplitude: Array) -> float:
    """Frequency of the largest amplitude, by the parabola through the three largest points."""
    at = int(np.clip(np.argmax(amplitude), 1, len(omega) - 2))
    near = slice(at - 1, at + 2)
    curve = np.polynomial.Polynomial.fit(omega[near], amplitude[near], 2)
    return float(curve.deriv().roots()[0].real)


def best_constant(amplitude: Array, truth: Array) -> float:
    """Score of the best band of one half-width, which is one of the errors."""
    widths = np.abs(amplitude - truth)
    return min(interval_score(amplitude - w, amplitude + w, truth) for w in widths)


def table(sweeps: Sweeps, levels: list[float]) -> list[list[str]]:
    """Rows of text, one for each level that is foretold."""
    rows = [["level [V]", "rms [% of peak]", "resonance [Hz]", f"in {LEVEL:.0%} band", "score"]]
    rows[0] += ["best constant", "fitted"]
    for level in levels:
        p = predicted(sweeps, level)
        errors = [f"{level:g}", f"{100 * p.rms:.2f}", f"{p.resonance:+.4f}", f"{p.held:.0%}"]
        rows.append([*errors, f"{p.score:.4f}", f"{p.constant:.4f}", " ".join(p.terms)])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, help="stepped_sine_beam_eth.npz")
    parser.add_argument("--levels", type=float, nargs="*", help="to foretell, V; all by default")
    options = parser.parse_args()
    sweeps = Sweeps.read(options.file)
    print(aligned(table(sweeps, options.levels or np.unique(sweeps.excitation).tolist())))


if __name__ == "__main__":
    main()
