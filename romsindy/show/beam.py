"""Figures of the beam: shapes, modes, modal motion.  Takes and returns Axes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib.axes import Axes

from romsindy.beam.equilibrium import ModalBasis, Shape
from romsindy.beam.motion import Motion
from romsindy.beam.transient import NormalMode
from romsindy.show.axes import given_or_new, labelled, look, with_unit
from romsindy.typing import Array

_MODAL = "kg^0.5 m"  # unit of a modal coordinate


def plot_shapes(shapes: Mapping[str, Shape], ax: Axes | None = None) -> Axes:
    """Draw the beam at rest (straight) and in named shapes, such as equilibrium and release."""
    ax = given_or_new(ax)
    for i, (label, shape) in enumerate(shapes.items()):
        if i == 0:
            ax.plot(shape.s, 0.0 * shape.s, color="0.7", lw=1.0, label="straight")
        x, y = shape.s + shape.displacement[:, 0], shape.displacement[:, 1]
        ax.plot(x, y, **look(i), label=label)
    ax.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    ax.legend()
    return ax


def plot_modes(basis: ModalBasis, count: int = 3, ax: Axes | None = None) -> Axes:
    """Draw the transverse part of ``count`` mode shapes along the beam (the paper's fig. 2)."""
    ax = given_or_new(ax)
    s = basis.equilibrium.s
    for mode in range(1, count + 1):
        omega = basis.omega[basis.index(mode)]
        label = f"mode {mode}: {omega / (2 * np.pi):.4g} Hz"
        ax.plot(s, basis.shape(mode)[:, 1], **look(mode - 1), label=label)
    ax.axhline(0.0, color="0.7", lw=0.8)
    ax.set(xlabel="s (m)", ylabel=with_unit("transverse mode shape", "kg^-1/2"))
    ax.legend()
    return ax


def plot_modal_responses(
    motion: Motion, count: int = 3, ax: Axes | None = None, *, scale: bool = False
) -> Axes:
    """Draw ``count`` modal coordinates against time (the paper's fig. 3, left).

    With ``scale`` each is divided by its largest value, as in `plot_coupling`.
    """
    ax = given_or_new(ax)
    for column, q, label in _scaled(motion, range(count), scale):
        ax.plot(motion.t, q, **look(column), label=label)
    ylabel = "$q_n$ / max" if scale else with_unit("q", _MODAL)
    ax.set(xlabel="time (s)", ylabel=ylabel)
    ax.legend()
    return ax


def plot_coupling(
    motion: Motion, count: int = 3, ax: Axes | None = None, *, scale: bool = True
) -> Axes:
    """Draw the coordinates q_2, q_3, ... against q_1 (the paper's fig. 3, right).

    A curve that is walked to and fro is a slave of mode 1; a filled area is a life of its own.

    Parameters
    ----------
    motion : Motion
    count : int
        Number of modes, the first included.
    ax : Axes, optional
    scale : bool
        Whether each curve is divided by its largest value, which the legend then names.
    """
    ax = given_or_new(ax)
    for column, q, label in _scaled(motion, range(1, count), scale):
        ax.plot(motion.coordinates.displacement[:, 0], q, color=f"C{column}", lw=0.8, label=label)
    ylabel = "$q_n$ / max" if scale else with_unit("$q_n$", _MODAL)
    ax.set(xlabel=with_unit("$q_1$", _MODAL), ylabel=ylabel)
    ax.legend()
    return ax


def _scaled(motion: Motion, columns: range, scale: bool) -> Iterator[tuple[int, Array, str]]:
    """Modal coordinates by their columns, over their largest values if asked, and labels."""
    motion.basis.index(columns.stop)
    for column in columns:
        q = motion.coordinates.displacement[:, column]
        largest = float(np.max(np.abs(q)))
        label = with_unit(f"$q_{{{column + 1}}}$, max {largest:.2g}", _MODAL)
        yield column, (q / largest if scale and largest > 0.0 else q), label


def plot_normal_mode(
    orbits: NormalMode, ax: Axes | None = None, *, label: str = "normal mode of the beam"
) -> Axes:
    """Mark the beam's own periodic orbits; given the axes of `plot_backbone`, on top of it."""
    ax = given_or_new(ax)
    hz = orbits.frequency / (2 * np.pi)
    # Above the curves that it judges.
    ax.plot(hz, orbits.amplitude, "kD", ms=5, zorder=4, label=label)
    # A figure of a backbone has limits of its own, which may cut marks off.
    (left, right), top = ax.get_xlim(), ax.get_ylim()[1]
    margin = 0.05 * np.ptp([left, right, *hz])
    ax.set_xlim(min(left, hz.min() - margin), max(right, hz.max() + margin))
    ax.set_ylim(0, max(top, 1.05 * orbits.amplitude.max()))
    return labelled(ax, "frequency (Hz)", with_unit("amplitude", _MODAL))
