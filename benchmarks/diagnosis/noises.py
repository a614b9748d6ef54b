"""Noise as sensors and amplifiers make it: seven kinds, each of a ratio to the signal in dB."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import butter, lfilter, sosfilt, sosfilt_zi

Samples = np.ndarray
MAINS = (50.0, 60.0)  # Hz


def _white(n: int, rng: np.random.Generator) -> Samples:
    return rng.standard_normal(n)


def _ar1(n: int, rng: np.random.Generator) -> Samples:
    return lfilter([1.0], [1.0, -0.9], rng.standard_normal(n + 200))[200:]


def _band(n: int, rng: np.random.Generator) -> Samples:
    """Nothing beyond 0.3 to 0.7 of the Nyquist frequency, nor below a fiftieth of it."""
    spectrum = np.fft.rfft(rng.standard_normal(n))
    place = np.linspace(0, 1, len(spectrum))
    low = rng.uniform(0, 0.02) if rng.random() < 0.5 else -1.0
    spectrum[(place > rng.uniform(0.3, 0.7)) | (place < low)] = 0
    return np.fft.irfft(spectrum, n)


def _causal(n: int, rng: np.random.Generator) -> Samples:
    """Through the filter before a converter, which has a stop band."""
    sos = butter(int(rng.integers(4, 9)), rng.uniform(0.3, 0.8), output="sos")
    return sosfilt(sos, rng.standard_normal(n + 500))[500:]


def _unit(x: Samples) -> Samples:
    return x / np.sqrt(np.mean(x**2))


def _hum(n: int, rng: np.random.Generator, cycles: float) -> Samples:
    """The mains, ``cycles`` of it in the record, with up to four harmonics below Nyquist."""
    t = np.arange(n) / n
    line = np.zeros(n)
    for k in range(1, int(rng.integers(2, 6))):
        if k * cycles < 0.45 * n:
            size = 1.0 if k == 1 else rng.uniform(0.1, 0.7)
            line += size * np.cos(2 * np.pi * k * cycles * t + rng.uniform(0, 2 * np.pi))
    return rng.uniform(0.7, 3) * _unit(line) + _white(n, rng)


def _drift(n: int, rng: np.random.Generator) -> Samples:
    """An offset that wanders, or swings slower than the record is long."""
    if rng.random() < 0.5:
        slow = np.cumsum(rng.standard_normal(n))
        slow -= slow[0]
    else:
        turns = rng.uniform(0.3, 1.5)
        slow = np.sin(2 * np.pi * turns * np.arange(n) / n + rng.uniform(0, 2 * np.pi))
    return rng.uniform(0.7, 4) * _unit(slow) + _white(n, rng)


COLOURS: dict[str, Callable[[int, np.random.Generator], Samples]] = {
    "white": _white,
    "ar1": _ar1,
    "causal": _causal,
    "band": _band,
}
KINDS = (*COLOURS, "hum", "drift", "mixed")


def noises(
    kind: str, signals: list[Samples], mains: list[float], snr_db: float, rng: np.random.Generator
) -> list[Samples]:
    """Noise for every record of a trial.

    Parameters
    ----------
    kind : one of `KINDS`
        "hum" and "drift" come on top of white noise, "mixed" differs from record to record in
        colour and, by up to 10 dB, in level.
    signals : list of (n,) arrays
        Clean.
    mains : list of float
        Periods of the mains in every record.
    snr_db : float
        Of the (white) noise, rms over rms, dB.
    rng : Generator
    """
    # a sensor has one level, whatever it is shown
    level = 10 ** (-snr_db / 20) * np.sqrt(np.mean(np.concatenate(signals) ** 2))
    found = []
    for x, cycles in zip(signals, mains, strict=True):
        n = len(x)
        if kind == "hum":
            noise = _hum(n, rng, cycles)
        elif kind == "drift":
            noise = _drift(n, rng)
        elif kind == "mixed":
            colour = COLOURS[str(rng.choice(list(COLOURS)))]
            noise = 10 ** rng.uniform(-0.25, 0.25) * _unit(colour(n, rng))
        else:
            noise = _unit(COLOURS[kind](n, rng))
        found.append(level * noise)
    return found


def filtered(x: Samples, samples: float, rng: np.random.Generator) -> Samples:
    """A signal, held at its first value before, through a causal filter with a stop band.

    Of ``samples`` in a cycle; eight harmonics of the vibration pass.
    """
    least = min(8 * 2 / samples, 0.8)
    sos = butter(int(rng.integers(4, 9)), max(rng.uniform(0.3, 0.8), least), output="sos")
    return sosfilt(sos, x, zi=sosfilt_zi(sos) * x[0])[0]
