"""One structure measured twice, by an oscillator and noise that share nothing with the package.

The simulation is what `rs.identify` makes of the first run, bands included, as `identify --save`
writes it. The second has another start, offset and gain, and its structure has moved by as much as
tests repeat to: nothing is to be named. Or it has moved by more: then the value that moved is the
headline.
"""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np
from noises import noises
from oscillator import Nominal, motion

import romsindy as rs

SNR_DB = 35.0
_TURN = 2 * np.pi
# Relative changes of frequency and damping ratio from the first run to the second.
AGAIN = {"again": (0.0003, 0.02), "shifted": (0.005, 0.02), "damped": (0.0003, 0.20)}
MOVED = {"again": [], "shifted": ["linear_frequency"], "damped": ["viscous"]}


def pair_of(kind: str, seed: int) -> tuple[rs.Decay, rs.Decay]:
    """Two runs of one structure; of a seed, they differ between the kinds in what moved alone."""
    rng = np.random.default_rng([zlib.crc32(b"repeats"), seed])
    nominal = Nominal.drawn(rng)
    hertz = float(np.exp(rng.uniform(np.log(0.3), np.log(300.0))))
    size = float(10 ** rng.uniform(-5, 0.5))
    samples = rng.uniform(24.0, 110.0)
    cycles = np.clip(rng.uniform(1.8, 4.5) / (_TURN * nominal.zeta), 20, 160)
    signs = rng.choice([-1.0, 1.0], 5)
    start, offset = rng.uniform(0.8, 0.98), rng.uniform(-0.02, 0.02)
    colours = rng.choice(["white", "ar1"], 2)
    faster, damped = AGAIN[kind]
    moved = _moved(nominal, 1 + signs[0] * faster, 1 + signs[1] * damped)
    readings = ((nominal, 1.0, 0.0, 1.0), (moved, signs[2] * start, offset, 1 + signs[3] * 0.005))
    runs = []
    for (structure, q_0, zero, gain), colour in zip(readings, colours, strict=True):
        t = np.arange(0, _TURN * cycles * rng.uniform(0.9, 1.1), _TURN / samples)
        q = motion(structure, [], t, q_0)[0]
        (noise,) = noises(str(colour), [q], [0.0], SNR_DB, rng)
        measured = zero + gain * (q + noise)
        runs.append(rs.Decay(t / (_TURN * hertz), size * measured, unit="m"))
    return runs[0], runs[1]


def _moved(nominal: Nominal, frequency: float, damping: float) -> _Moved:
    return _Moved(
        **vars(replace(nominal, zeta=nominal.zeta * frequency * damping)), by=frequency**2
    )


class _Moved(Nominal):
    """Another linear stiffness; its frequency is not 1."""

    by: float

    def __init__(self, zeta: float, g: tuple, u: tuple, by: float) -> None:
        super().__init__(zeta, g, u)
        object.__setattr__(self, "by", by)

    def force(self, q: float, v: float) -> float:
        """Restoring and damping force."""
        return super().force(q, v) + (self.by - 1) * q
