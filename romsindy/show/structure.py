"""Figures and page of a structure that was reduced to the equation of one mode."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from romsindy.show.axes import given_or_new, labelled, with_unit
from romsindy.show.page import Picture, write_page
from romsindy.structure.linear import LinearModel
from romsindy.structure.reduction import Reduction
from romsindy.typing import Array

_SEEN = 0.1  # of the size of a structure: so far it is drawn to move
_POINTS = 40  # of a backbone
_LEAST = 1e-3  # of an amplitude, where a backbone begins


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
