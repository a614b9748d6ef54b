"""Panels that pages share: each asks the result whether it has something to show."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from romsindy.fit.curve import Curve
from romsindy.fit.estimate import Estimate
from romsindy.physics.model import ReducedModel
from romsindy.show.function_plots import plot_inertia, plot_stiffness
from romsindy.show.page import Picture

_INCHES = 3.4  # height of one coordinate of several
_LOOK = 21  # values of q by which a function is known to change
_CHANGES = 1e-9  # more than rounding

Models = Mapping[str, ReducedModel]


# Name, how it is drawn, and what it is.
_FUNCTIONS: tuple[tuple[str, Callable[..., Axes], str], ...] = (
    (
        "inertia",
        plot_inertia,
        "M(q) = 1 + h(q) with its 95 % band. h is the kinetic energy of what the vibration drags"
        " along and is never negative; a regression does not know that.",
    ),
    ("stiffness", plot_stiffness, "Restoring force over displacement with its 95 % band."),
)


def functions(found: Estimate, beside: Models | None = None) -> list[Picture]:
    """Inertia and stiffness along every coordinate, where the equation has them change with it.

    Parameters
    ----------
    found : Estimate
    beside : mapping of str to ReducedModel, optional
        Other models of one coordinate, by label.
    """
    coordinates = range(1, found.model.n_coordinates + 1)
    panels = []
    for name, plot, caption in _FUNCTIONS:
        changing = [k for k in coordinates if _changes(found, name, k)]
        draw = partial(_draw, found, plot, changing, beside)
        if changing == [1] == [*coordinates]:
            panels.append(Picture(name, name.capitalize(), caption, draw))
        elif changing:
            caption += " Along each coordinate, with the others at rest."
            size = (6.4, _INCHES * len(changing))
            panels.append(Picture(name, name.capitalize(), caption, draw, size))
    return panels


def _changes(found: Estimate, name: str, coordinate: int) -> bool:
    """Whether a function, or what is known of it, changes over the range of the data."""
    reach = found.reach_of(coordinate)
    if not np.isfinite(reach).all():
        return False
    curve: Curve = getattr(found, name)(np.linspace(*reach, _LOOK), coordinate)
    values = np.array([curve.value, curve.low, curve.high])
    return bool(np.ptp(values, axis=1).max() > _CHANGES * np.abs(values).max())


def _draw(
    found: Estimate,
    plot: Callable[..., Axes],
    coordinates: Sequence[int],
    beside: Models | None,
    figure: Figure,
) -> None:
    axes = figure.subplots(len(coordinates), squeeze=False)[:, 0]
    for ax, k in zip(axes, coordinates, strict=True):
        plot(found, beside, coordinate=k, ax=ax)
