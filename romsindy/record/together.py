"""Several channels as one: the weighted sum in which a vibration stands out best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from romsindy.record.noise_level import noise_std
from romsindy.record.ridges import Ridge
from romsindy.record.smoothing import HarmonicSpline
from romsindy.typing import Array

_CYCLES = 12.0  # between knots: wide, so that other vibrations do not count
# Amplitudes of one vibration in two channels have a ratio that is constant and real: so much of
# their product must agree, and so much of it must be in phase. Else they are of different things.
_COHERENT, _IN_PHASE = 0.98, 0.95


@dataclass(frozen=True, eq=False)
class Together:
    """Channels combined for one vibration.

    Attributes
    ----------
    x : (n,) array
        The weighted sum, scaled to what the vibration is in the main channel.
    shape : (m,) array
        Amplitude of the vibration in each channel over that in the main one; 0 where it was left
        out because it does not go with the main one.
    """

    x: Array
    shape: Array


def together(t: Array, x: Array, main: int, tone: Ridge) -> Together:
    """Weigh channels by the shape of a vibration and by their noise.

    Parameters
    ----------
    t : (n,) array
        Times from the start of the release, s.
    x : (n, m) array
        Channels.
    main : int
        The channel in which the tone was followed.
    tone : Ridge

    Returns
    -------
    Together
    """
    inside = tone.inside(t)
    z = [_amplitude(t[inside], channel[inside], tone) for channel in x.T]
    own = float(np.vdot(z[main], z[main]).real)
    shape = np.zeros(len(z))
    for i, other in enumerate(z):
        product, size = np.vdot(z[main], other), float(np.vdot(other, other).real)
        coherent = abs(product) ** 2 > _COHERENT * own * size
        if coherent and abs(product.real) > _IN_PHASE * abs(product):
            shape[i] = product.real / own
    weight = shape / np.array([noise_std(channel) for channel in x.T]) ** 2
    return Together(x @ (weight / (weight @ shape)), shape)


def _amplitude(t: Array, x: Array, tone: Ridge) -> Array:
    """Complex amplitude of a tone in a signal, along its phase."""
    return HarmonicSpline.along(tone.phase, t, x, _CYCLES, 1).amplitudes(t)[:, 1]
