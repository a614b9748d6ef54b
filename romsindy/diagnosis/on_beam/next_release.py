"""Which release of a beam would tell apart what its first mode does not: one that rings others.

Rivals that are linear do the same to the first mode, and no amplitude of it tells them apart. Each
says a frequency and a damping of every mode about the equilibrium. How well a record shows these of
a mode that rings with an amplitude A and dies as exp(-r t) in white noise is closed form [1]: with
w = A^2 / (2 sigma^2 dt) and J_n = integral of t^n exp(-2 r t) over the record, the variance of its
frequency, and of r, is 1 / (w (J_2 - J_1^2 / J_0)).

[1] S. Kay, Fundamentals of Statistical Signal Processing: Estimation Theory (1993), ch. 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from romsindy.beam.beam import Beam
from romsindy.beam.structure import FREE
from romsindy.diagnosis.evidence import Hypothesis, weights
from romsindy.diagnosis.found import titles
from romsindy.diagnosis.next_test import MOST_ODDS, Advice
from romsindy.diagnosis.on_beam.all_sensors import Latitude
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam, ModesAtRest
from romsindy.diagnosis.on_beam.within_tolerances import beam_with
from romsindy.fit.records.record import Record
from romsindy.typing import Array


@dataclass(frozen=True)
class ReleaseWay:
    """A way to let a beam go that could be chosen: pulled, or struck, at a part of its length."""

    words: str
    at: float
    struck: bool = False
    cost: float = 1.0

    def amplitudes(self, beam: Beam, omega: Array, shapes: Array) -> Array:
        """Of the modes, over that of the first."""
        at = self.at * beam.length
        load = beam.point_load((0.0, 1.0), at=at)
        moved = np.tensordot(shapes, load, axes=load.ndim) / omega ** (1 if self.struck else 2)
        return np.asarray(moved / moved[0])


WAYS = (
    ReleaseWay("a release from a pull at the end that is free", 1.0),
    ReleaseWay("a release from a pull in the middle", 0.5),
    ReleaseWay("a release from a pull at 0.7 of the length", 0.7),
    ReleaseWay("a hit in the middle", 0.5, struck=True),
    ReleaseWay("a hit at 0.7 of the length", 0.7, struck=True),
    ReleaseWay("a hit at the end that is free", 1.0, struck=True),
)


def next_release(
    seen: InstrumentedBeam,
    rivals: Sequence[Hypothesis],
    record: Record,
    noise: Array,
    slack: Latitude,
) -> Advice:
    """The release that would best tell rivals apart, as large as the ``record`` and as long.

    ``noise`` (n_sensors,) are the standard deviations of the sensors, m.
    """
    count = seen.shapes.shape[1]
    modes = [ModesAtRest.of(beam_with(seen.beam, h.parts), count) for h in rivals]
    prior = weights(rivals)
    releases = [r for r in WAYS if seen.beam.right == FREE or r.at < 1]
    shown = [
        _told(seen, modes, _amplitudes(seen, r, record), record, noise, slack) for r in releases
    ]
    sure = [float(prior @ _posterior(prior, x)) for x in shown]
    best = int(np.argmax(sure))
    odds = min(sure[best] / max(1 - sure[best], 1 / MOST_ODDS), MOST_ODDS)
    names = tuple(titles(h) for h in rivals)
    own = [p.effect.advice for h in rivals for p in h.effects]
    test = releases[best]
    return Advice(test, test.words, odds, names, tuple(dict.fromkeys(own)))


def _amplitudes(seen: InstrumentedBeam, release: ReleaseWay, record: Record) -> Array:
    """Of the modes, kg^0.5 m, where the first is as large as in a record."""
    count = seen.shapes.shape[1]
    basis = seen.beam.modes(count=count)
    return record.amplitude * release.amplitudes(seen.beam, basis.omega, basis.shapes)


def _told(
    seen: InstrumentedBeam,
    modes: Sequence[ModesAtRest],
    amplitudes: Array,
    record: Record,
    noise: Array,
    slack: Latitude,
) -> Array:
    """Chi-square of each rival, were another the truth, (n, n), by modes beside the first."""
    n = len(modes)
    found = np.zeros((n, n))
    ratio = np.abs(amplitudes) * np.linalg.norm(seen.shapes / noise[:, None], axis=0)
    duration, dt = float(record.t[-1]), record.decay.dt
    for i, true in enumerate(modes):
        variance = [variance_of(a, r, duration, dt) for a, r in zip(ratio, true.rates, strict=True)]
        own = np.array(variance)[1:]
        for j, other in enumerate(modes):
            turned = (other.omega - true.omega)[1:] ** 2
            died = (other.rates - true.rates)[1:] ** 2
            by_frequency = turned / (own + (slack.frequencies * true.omega[1:]) ** 2)
            found[i, j] = np.sum(by_frequency + died / (own + slack.rates**2))
    return found


def variance_of(ratio: float, rate: float, duration: float, dt: float) -> float:
    """Of the frequency, and of the rate, (rad/s)^2, of a mode that dies in white noise.

    The ``ratio`` is that of its amplitude to the noise, ``rate`` (1/s) that at which it dies.
    """
    t = np.linspace(0.0, duration, max(int(duration / dt), 2))
    w = np.exp(-2 * rate * t) * (t[1] - t[0])
    j = [float(np.sum(t**n * w)) for n in range(3)]
    known = ratio**2 / (2 * dt) * (j[2] - j[1] ** 2 / j[0])
    return 1 / known if known > 0 else np.inf


def _posterior(prior: Array, chi_squared: Array) -> Array:
    """Probability of each rival that is expected were it the truth, (n,)."""
    against = prior[None, :] / prior[:, None] * np.exp(-0.5 * chi_squared)
    return np.asarray(1 / np.sum(against, axis=1))
