"""How an effect shows in frequency and damping against amplitude: its fingerprint.

A harmonic motion q = a cos(omega t) of small damping does not change its shape within a cycle, so
only the first harmonic of a force f acts on its amplitude and phase in the mean [1]::

    omega(a) / omega_0 = 1 + s / (pi a omega_0^2) integral f cos / 2
    zeta(a) = zeta_0 - s / (pi a omega_0^2) integral f sin / 2

with the integrals over the angle of one cycle, f on the left side of the equation and s its
strength.

[1] N. M. Krylov, N. N. Bogoliubov, "Introduction to Non-linear Mechanics", 1947.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from romsindy.effects.base import Effect, Scales, State, TimedEffect
from romsindy.typing import Array

_SAMPLES = 1440  # of a cycle: kinks are found to 1 / 1440 of it
_LEAST = 0.1  # amplitude, as a part of the largest: friction damps without end towards none
_NOTHING = 1e-3  # of the force: what the sum over samples leaves of an integral that is 0


class Fingerprint(NamedTuple):
    """What a force adds to frequency and damping, (n,) each, scaled: the largest of all is 1.

    ``amplitude`` is in parts of the largest, ``frequency`` relative to the linear one,
    ``damping_ratio`` in the same scale.
    """

    amplitude: Array
    frequency: Array
    damping_ratio: Array


def fingerprint(effect: Effect, n: int = 60) -> Fingerprint | None:
    """Average the force of an effect over the cycles of harmonic motions.

    Parameters
    ----------
    effect : Effect
        With gaps, distances and exponents that a diagnosis tries first, for a largest amplitude of
        1 and a linear frequency of 1 rad/s.
    n : int
        Number of amplitudes, from a tenth of the largest to the largest.

    Returns
    -------
    Fingerprint or None
        None where there is none to first order: the effect is no force, knows the time, or shows
        in the mean and the even harmonics alone.
    """
    scales = Scales(amplitude=1.0, omega=1.0, duration=200 * np.pi, tones=(1.0,))
    first = {p.name: p.starts[0] for p in effect.parameters(scales)}
    amplitude = np.linspace(_LEAST, 1.0, n)
    averages = [averaged(effect.shaped(first), a) for a in amplitude]
    if isinstance(effect, TimedEffect) or None in averages:
        return None
    frequency, damping_ratio = np.array(averages).T
    largest = np.max(np.abs([frequency, damping_ratio]))
    if largest < _NOTHING:
        return None
    return Fingerprint(amplitude, frequency / largest, damping_ratio / largest)


def averaged(effect: Effect, a: float) -> tuple[float, float] | None:
    """Relative change of frequency, and damping ratio, at amplitude ``a`` for a strength of 1.

    The linear frequency is 1 rad/s; None for an effect that is no force.
    """
    # A motion that begins between a turn and the middle is taken to have gone on for long.
    step = 2 * np.pi / _SAMPLES
    t = np.pi / 4 + step * np.arange(2 * _SAMPLES)
    q = a * np.cos(t)
    forces = effect.forces(State(t, q, -a * np.sin(t), -q, step))
    if forces is None:
        return None
    last = slice(_SAMPLES, None)
    by_cos, by_sin = (float(np.mean(forces[0, last] * x[last]) / a) for x in (np.cos(t), np.sin(t)))
    return by_cos, -by_sin


def plot_fingerprint(found: Fingerprint, axes: Sequence[Axes]) -> None:
    """Draw frequency into the first of two axes and damping ratio into the second."""
    curves = (found.frequency, found.damping_ratio)
    for ax, y, name in zip(axes, curves, ("frequency", "damping ratio"), strict=True):
        ax.axhline(0.0, color="0.6", lw=0.8)
        ax.plot(found.amplitude, y, color="C0", lw=2)
        ax.set(xlim=(0, 1), ylim=(-1.1, 1.1), yticks=(-1, 0, 1))
        ax.set(title=name, xlabel="amplitude / largest")
    axes[0].set_ylabel("change")
