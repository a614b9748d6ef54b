"""The fingerprint of an effect: what it does to frequency and damping ratio against amplitude."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes

from romsindy.effects.fingerprint import Fingerprint


def plot_fingerprint(found: Fingerprint, axes: Sequence[Axes]) -> None:
    """Draw frequency into the first of two axes and damping ratio into the second."""
    curves = (found.frequency, found.damping_ratio)
    for ax, y, name in zip(axes, curves, ("frequency", "damping ratio"), strict=True):
        ax.axhline(0.0, color="0.6", lw=0.8)
        ax.plot(found.amplitude, y, color="C0", lw=2)
        ax.set(xlim=(0, 1), ylim=(-1.1, 1.1), yticks=(-1, 0, 1))
        ax.set(title=name, xlabel="amplitude / largest")
    axes[0].set_ylabel("change")
