"""Names of inputs, and what a sampled one does: it is held, goes straight, or is band-limited.

A converter holds its output until the next sample; a line from sample to sample is the least that
is assumed of a measured input; one that went through an anti-aliasing filter is band-limited. Where
the input drives a motion, the difference is seen (J. Schoukens, R. Pintelon, H. Van hamme,
"Identification of linear dynamic systems using piecewise constant excitations", Automatica 30,
1994).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import next_fast_len
from scipy.signal import lfilter
from scipy.special import i0

from romsindy.typing import Array

Interpolation = Literal["band-limited", "linear", "hold"]
INTERPOLATIONS: tuple[Interpolation, ...] = ("band-limited", "linear", "hold")

_INPUT = re.compile(r"(force|base)( \d+)?")
# Samples to either side in the interpolation of a band-limited input, and the shape of its window
# (J. Kaiser): 170 dB up to 0.4 of the sampling rate.
_REACH, _KAISER = 32, 17.5
# Gauss points of a piece between two samples, and their weights: parabolas times lines to the 13th,
# and what fades with a lag of a twentieth of a sample to 1e-5 of a sample.
_GAUSS = np.polynomial.legendre.leggauss(8)
_PIECE = ((_GAUSS[0] + 1) / 2, _GAUSS[1] / 2)
_SHARED = 10  # places for one fraction of a sample, at least, for a filter over all samples


def require_input(name: str) -> None:
    """Refuse what is no name of an input."""
    if not _INPUT.fullmatch(name):
        raise ValueError(
            f"input {name!r} is not known: use 'force' or 'base', and of several of a kind"
            " 'force 2', ..."
        )


def is_base(name: str) -> bool:
    """Whether an input is the acceleration of the base."""
    return name.startswith("base")


def interpolated(u: Array, place: Array, interpolation: Interpolation, lag: float = 0.0) -> Array:
    """Values at places, counted in samples, of an input (n,); beyond its ends as there.

    Nothing beyond the ends is looked at: where a band-limited input would need it, value and slope
    go on (odd reflection). With a ``lag``, counted in samples, those of x, lag x' + x = u, which is
    u at the first sample.
    """
    if lag and interpolation == "band-limited":
        return interpolated(_through_spectrum(u, lag), place, interpolation)
    if lag:
        return _after_lag(u, place, lag, held=interpolation == "hold")
    if interpolation == "hold":
        return u[np.clip(np.floor(place + 1e-9).astype(int), 0, len(u) - 1)]
    if interpolation == "linear":
        return np.interp(place, np.arange(len(u)), u)
    return _band_limited(u, np.clip(place, 0, len(u) - 1))


def _after_lag(u: Array, place: Array, lag: float, held: bool) -> Array:
    """What is left after a lag of an input that is held, or goes straight: exact everywhere.

    From each sample on it fades towards the input, less the lag times its slope.
    """
    slope = np.zeros(len(u)) if held else np.diff(u, append=u[-1])
    goal, fade = u - lag * slope, np.exp(-1 / lag)
    drive = slope + (1 - fade) * goal
    later = lfilter([1.0], [1.0, -fade], drive[:-1], zi=[fade * u[0]])[0]
    off = np.concatenate([u[:1], later]) - goal
    first = np.clip(np.floor(place + 1e-9).astype(int), 0, len(u) - 1)
    since = np.maximum(place - first, 0.0)
    return goal[first] + slope[first] * since + off[first] * np.exp(-since / lag)


def _through_spectrum(u: Array, lag: float) -> Array:
    """Samples of what is left after a lag of a band-limited input, which is band-limited as well.

    Beyond the end it falls to its first value, so that its period begins at rest.
    """
    rest = np.pad(u - u[0], (0, len(u)), "linear_ramp")
    size = next_fast_len(2 * len(rest), real=True)
    response = 1 / (1 + 2j * np.pi * lag * np.fft.rfftfreq(size))
    return u[0] + np.fft.irfft(np.fft.rfft(rest, size) * response, size)[: len(u)]


def _band_limited(u: Array, place: Array) -> Array:
    """By sinc functions under a Kaiser window."""
    margin = min(_REACH, len(u) - 1)
    wide = np.pad(u, margin, mode="reflect", reflect_type="odd")
    wide = np.pad(wide, _REACH - margin, mode="edge")
    first = np.minimum(np.floor(place).astype(int), len(u) - 2)
    # Times on a grid share few fractions of a sample: one filter serves all that have the same.
    fractions, kind = np.unique(np.round(place - first, 9), return_inverse=True)
    if len(fractions) > len(place) / _SHARED:
        windows = sliding_window_view(wide, 2 * _REACH)[first + 1]
        return np.einsum("ij,ij->i", windows, _kernel(place - first))
    out = np.empty(len(place))
    for i, kernel in enumerate(_kernel(fractions)):
        rows = kind == i
        out[rows] = np.correlate(wide, kernel)[first[rows] + 1]
    return out


def _kernel(fraction: Array) -> Array:
    """Weights of the samples about places between two of them, (n, 2 reach)."""
    x = fraction[:, None] - np.arange(1 - _REACH, _REACH + 1)
    return np.sinc(x) * i0(_KAISER * np.sqrt(1 - (x / _REACH) ** 2)) / i0(_KAISER)


def of_steps(
    values: Callable[[Array], Array], start: Array, length: float, nodes: Array, smooth: bool
) -> Array:
    """What stands for an input at the Gauss points of steps of time, (n_steps, 3).

    With these values quadrature gives the exact integrals of the input times any parabola over a
    step, wherever it jumps or bends within: so does the motion that it drives. ``values`` takes
    places counted in samples; steps ``start`` (n_steps,) there and have a ``length``; ``nodes``
    (3,) are the Gauss points of a step of length one. A ``smooth`` input neither jumps nor bends at
    its samples: then its values are as good.
    """
    if smooth:
        return values((start[:, None] + length * nodes).ravel()).reshape(-1, 3)
    ends = np.floor(start + 1e-9)[:, None] + np.arange(1, int(np.ceil(length - 1e-9)) + 1)
    edges = np.clip(ends, start[:, None], start[:, None] + length)
    edges = np.concatenate([start[:, None], edges, start[:, None] + length], axis=1)
    widths = np.diff(edges, axis=1)
    weights = np.polynomial.legendre.leggauss(3)[1] / 2
    lagrange = np.linalg.inv(np.vander(nodes, 3, increasing=True))
    found = np.zeros((len(start), 3))
    for left, width in zip(edges[:, :-1].T, widths.T, strict=True):
        for node, weight in zip(*_PIECE, strict=True):
            place = left + width * node
            parabolas = np.vander((place - start) / length, 3, increasing=True) @ lagrange
            value = values(np.where(width > 1e-9, place, left))  # of no width: wherever
            found += parabolas * (weight * width / length * value)[:, None]
    return found / weights
