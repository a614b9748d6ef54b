"""Figures of identified functions with their 95 % bands, as in `plots`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from romsindy.fit.functions.identification import Identification
from romsindy.fit.results.estimate import Estimate
from romsindy.physics.model import ReducedModel
from romsindy.show.axes import given_or_new, look, with_unit
from romsindy.typing import Array

_POINTS, _AMPLITUDES = 201, 25
_DRAWS = 40  # percentiles of a band to a fifth of its width
_LEAST = 0.02  # amplitude that is drawn, as a part of the largest


def plot_inertia(
    found: Estimate,
    models: Mapping[str, ReducedModel] | None = None,
    *,
    coordinate: int = 1,
    color: str = "C0",
    label: str = "identified",
    ax: Axes | None = None,
) -> Axes:
    """M(q) = 1 + h(q) over the range of the data, with its 95 % band; M of other models beside.

    Parameters
    ----------
    found : Identification, Fit or Estimate
    models : mapping of str to ReducedModel, optional
        Curves by label, of one coordinate.
    coordinate : int
        Of several, from 1.
    color, label : str
        Of the identified function.
    """
    ax = given_or_new(ax)
    q = _range(found, coordinate)
    h = found.inertia(q, coordinate)
    _draw(ax, q, (1 + h.value, 1 + h.low, 1 + h.high), {"color": color}, label)
    _beside(ax, q, models, lambda model: model.inertia(q))
    return _labelled(ax, found, "inertia  $M(q) = 1 + h(q)$", coordinate)


def plot_stiffness(
    found: Estimate,
    models: Mapping[str, ReducedModel] | None = None,
    *,
    coordinate: int = 1,
    color: str = "C0",
    label: str = "identified",
    ax: Axes | None = None,
) -> Axes:
    """K(q)/q over the range of the data, with its 95 % band; arguments as of `plot_inertia`."""
    ax = given_or_new(ax)
    q = _range(found, coordinate)
    q = q[q != 0]  # K(0)/0 is no number; its neighbours show where it tends to
    k = found.stiffness(q, coordinate)
    _draw(ax, q, (k.value, k.low, k.high), {"color": color}, label)
    _beside(ax, q, models, lambda model: model.stiffness(q) / q)
    return _labelled(ax, found, "stiffness  $K(q)/q$  (1/s$^2$)", coordinate)


def plot_parts(found: Identification, *, ax: Axes | None = None) -> Axes:
    """Rms of inertia, nonlinear stiffness and damping over that of q_ddot, with 95 % bands.

    Against amplitude, over cycles of the undamped motion
    (`ReducedModel.relative_magnitude_of_parts`).
    """
    ax = given_or_new(ax)
    largest = min(map(abs, found.reach))
    amplitudes = np.geomspace(_LEAST * largest, largest, _AMPLITUDES)
    asked = found.structure.sizes.inertia > 0
    samples = found.samples if asked else found.widest
    some = samples[:: max(len(samples) // _DRAWS, 1)]
    models = [ReducedModel(found.terms, tuple(values), found.model.unit) for values in some]
    drawn = [model.relative_magnitude_of_parts(amplitudes) for model in models]
    for i, part in enumerate(drawn[0]):
        values = np.array([magnitudes[part] for magnitudes in drawn])
        low, middle, high = np.nanpercentile(values, (2.5, 50, 97.5), axis=0)
        if part == "inertia" and not asked:  # an upper limit is all there is
            low, middle, part = 0 * low, high, "inertia at most"
        _draw(ax, amplitudes, (middle, low, high), look(i), part)
    _labelled(ax, found, "rms of part / rms of acceleration")
    label = with_unit("amplitude", found.model.unit)
    ax.set(xlabel=label, yscale="log", ylim=(1e-5, 3))
    return ax


def _range(found: Estimate, coordinate: int) -> Array:
    return np.linspace(*found.reach_of(coordinate), _POINTS)


def _draw(
    ax: Axes, x: Array, curves: tuple[Array, Array, Array], style: dict[str, Any], label: str
) -> None:
    """A curve and its band: middle, low, high."""
    middle, low, high = curves
    ax.fill_between(x, low, high, color=style["color"], alpha=0.25, lw=0)
    ax.plot(x, middle, **style, label=label)


def _beside(
    ax: Axes,
    q: Array,
    models: Mapping[str, ReducedModel] | None,
    function: Callable[[ReducedModel], Array],
) -> None:
    """Functions of other models, in the looks that they have beside a backbone."""
    for i, (label, model) in enumerate((models or {}).items(), 1):
        ax.plot(q, function(model), **look(i), lw=1.2, label=label)


def _labelled(ax: Axes, found: Estimate, ylabel: str, coordinate: int = 1) -> Axes:
    name = "q" if found.model.n_coordinates == 1 else f"$q_{coordinate}$"
    ax.set(xlabel=with_unit(name, found.model.unit), ylabel=ylabel)
    ax.legend(loc="best", frameon=False)
    return ax
