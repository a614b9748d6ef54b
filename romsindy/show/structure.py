"""Figures of structures: a beam and its motion; what was reduced to an equation, and its page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from romsindy.beam.equilibrium import ModalBasis, Shape
from romsindy.beam.motion import Motion
from romsindy.beam.transient import NormalMode
from romsindy.show.axes import given_or_new, labelled, look, with_unit
from romsindy.show.page import Picture, write_page
from romsindy.structure.linear import LinearModel
from romsindy.structure.reduction import Reduction
from romsindy.typing import Array

_MODAL = "kg^0.5 m"  # unit of a modal coordinate
_SEEN = 0.1  # of the size of a structure: so far it is drawn to move
_POINTS = 40  # of a backbone
_LEAST = 1e-3  # of an amplitude, where a backbone begins


# -- a beam ---------------------------------------------------------------------------------------


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
        label = f"mode {mode}: {basis.omega[basis.index(mode)] / (2 * np.pi):.4g} Hz"
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


# -- a reduction ----------------------------------------------------------------------------------


def plot_deformed(structure: LinearModel, moved: Array, ax: Axes, *, enlarged: float = 1.0) -> Axes:
    """Draw the outer faces, or the nodes, with displacements (n,) of the free freedoms.

    ``ax`` has three dimensions; colours are the length of the displacement.
    """
    numbers, places = _places(structure)
    shift = np.zeros_like(places)
    row_of = {number: i for i, number in enumerate(numbers)}
    rows = np.array([row_of[int(n)] for n in structure.nodes])
    shift[rows, structure.directions - 1] = moved
    drawn, size = places + enlarged * shift, np.linalg.norm(shift, axis=1)
    if structure.faces:
        corners = [[row_of[n] for n in face] for face in structure.faces]
        colours = np.array([size[c].mean() for c in corners])
        faces = Poly3DCollection([drawn[c] for c in corners], cmap="viridis", lw=0.1, ec="0.3")
        faces.set_array(colours)
        ax.add_collection3d(faces)  # type: ignore[attr-defined]
    else:
        ax.scatter(*drawn.T, c=size, s=4, cmap="viridis")  # type: ignore[misc]
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    room = np.maximum(high - low, 0.02 * np.max(high - low))
    ax.set(xlim=(low[0], low[0] + room[0]), ylim=(low[1], low[1] + room[1]))
    ax.set_zlim(low[2], low[2] + room[2])  # type: ignore[attr-defined]
    ax.set_box_aspect(room)
    ax.set_axis_off()
    return ax


def plot_held(reduction: Reduction, ax: Axes | None = None, *, inertia: bool = False) -> Axes:
    """K(q)/q, or 1 + h(q), of the static cases and of the equation."""
    ax, curve = given_or_new(ax), reduction.curve
    q, per_q = curve.q[curve.q != 0], reduction.per_q
    at = curve.at
    if inertia:
        dots, line = curve.inertia_at(at), reduction.model.inertia(per_q * q)
        label = "inertia  $1 + h(q)$"
    else:
        dots, line = curve.cases.factors / at, reduction.model.stiffness(per_q * q) / (per_q * q)
        label = "stiffness  $K(q)/q$  (1/s$^2$)"
    ax.plot(per_q * q, line, label="equation")
    ax.plot(per_q * at, dots, "ko", ms=4, label="static cases")
    return labelled(ax, with_unit("q", reduction.model.unit), label)


def plot_reduced_backbone(reduction: Reduction, ax: Axes | None = None) -> Axes:
    """Frequency of the undamped motion against amplitude, over the range that was held."""
    ax, reach = given_or_new(ax), reduction.reach
    amplitudes = np.linspace(_LEAST * reach, reach, _POINTS)
    ax.plot(reduction.frequencies(amplitudes) / (2 * np.pi), amplitudes)
    ax.set(xlabel="frequency (Hz)", ylabel=with_unit("amplitude", reduction.model.unit))
    ax.set_ylim(0, None)
    return ax


def write_reduction_page(path: Path, reduction: Reduction, *, interactive: bool = False) -> None:
    """Write the page of a reduction.

    Raises a ValueError if it is to be interactive and plotly is not installed.
    """
    first, *rest = str(reduction).splitlines()
    write_page(
        path,
        "report",
        "reduce",
        pictures=_pictures(reduction),
        interactive=interactive,
        title=f"Structure {Path(reduction.structure.name).name}",
        sentence=reduction.enough,
        equation=str(reduction.model),
        equation_title="Equation of motion",
        formulas=[],
        tables=reduction.tables,
        notes_title="What was done",
        notes=[first, *rest[:-1], *reduction.notes],
    )


def _pictures(reduction: Reduction) -> Iterator[Picture]:
    if reduction.structure.coordinates:
        yield Picture(
            "shapes",
            "Shapes",
            f"Held at both ends of the range, where {reduction.place} moves by"
            f" {_ends(reduction)} {reduction.length}; displacements are drawn"
            f" {_enlarged(reduction):.3g} times as large.",
            lambda figure: _draw_shapes(reduction, figure),
            (9.0, 4.2),
        )
    yield Picture(
        "stiffness",
        "Stiffness",
        "Dots are static cases, whose load gives K exactly; the line is the equation.",
        lambda figure: plot_held(reduction, figure.subplots()),
    )
    yield Picture(
        "inertia",
        "Inertia",
        "What follows the mode moves mass along: 1 + h(q).",
        lambda figure: plot_held(reduction, figure.subplots(), inertia=True),
    )
    yield Picture(
        "backbone",
        "Backbone",
        "Frequency of the undamped motion against amplitude, half of peak to peak.",
        lambda figure: plot_reduced_backbone(reduction, figure.subplots()),
    )


def _ends(reduction: Reduction) -> str:
    return " and ".join(f"{x:.4g}" for x in reduction.moved)


def _draw_shapes(reduction: Reduction, figure: Figure) -> None:
    ends = reduction.curve.shapes_at(np.array(reduction.curve.range))
    for i, moved in enumerate(ends, 1):
        ax = figure.add_subplot(1, 2, i, projection="3d")
        plot_deformed(reduction.structure, moved, ax, enlarged=_enlarged(reduction))


def _enlarged(reduction: Reduction) -> float:
    """Times that displacements are drawn: to be seen, and none where they are seen anyway."""
    _, places = _places(reduction.structure)
    size = float(np.max(np.ptp(places, axis=0)))
    return max(1.0, _SEEN * size / max(map(abs, reduction.moved)))


def _places(structure: LinearModel) -> tuple[Sequence[int], Array]:
    """Numbers of the nodes, and where they are, (n_nodes, 3)."""
    return [*structure.coordinates], np.array([*structure.coordinates.values()])
