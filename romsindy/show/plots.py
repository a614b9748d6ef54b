"""Figures. Every function draws into an Axes (a new one if none is given) and returns it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from romsindy.fit.estimate import Estimate
from romsindy.fit.refine import Fit
from romsindy.orbits.curves import BackboneCurve, ForcedResponse, PeriodicOrbits
from romsindy.physics.model import ReducedModel
from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay
from romsindy.regression.estimator import HarmonicSINDy
from romsindy.selection.candidates import CHOSEN, EQUIVALENT
from romsindy.selection.select import Selection
from romsindy.show.axes import given_or_new, log_ratio
from romsindy.typing import Array

_SIGMAS_95 = 1.96
Models = Mapping[str, ReducedModel | Estimate]
# How the cycles of a measured decay look in every figure.
_CYCLES: dict[str, Any] = {"fmt": "o", "ms": 3, "lw": 0.7, "color": "0.25", "mfc": "white"}
_CYCLES |= {"label": "cycles of the decay", "zorder": 1}


def _curves(
    models: Models | None, amplitudes: Array, quantity: str, unit: float
) -> Iterator[tuple[Array, tuple[Array, Array] | None, dict[str, Any]]]:
    """Curve, 95 % band of an estimate, look of every model: a stiffness polynomial is dashed."""
    for i, (label, model) in enumerate((models or {}).items()):
        look = {"ls": "--" if "stiffness" in label else "-", "color": f"C{i}", "label": label}
        if isinstance(model, Estimate):
            band = model.band(amplitudes)
            middle = getattr(band, quantity) / unit
            reach = _SIGMAS_95 * getattr(band, f"{quantity}_std") / unit
            yield middle, (middle - reach, middle + reach), look
        else:
            curve = model.backbone if quantity == "frequency" else model.damping_ratio
            yield curve(amplitudes) / unit, None, look


def plot_decay(
    decay: Decay,
    backbone: Backbone | None = None,
    *,
    record: Decay | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Displacement against time, with the peaks of its backbone.

    Parameters
    ----------
    decay : Decay
        What is analysed; one channel.
    backbone : Backbone, optional
        Draws its peaks as an envelope.
    record : Decay, optional
        The whole record, drawn pale behind.
    """
    ax = given_or_new(ax)
    if record is not None:
        ax.plot(record.t, record.q, color="0.8", lw=0.6, label="record")
    ax.plot(decay.t, decay.q, color="C0", lw=0.6, label="free decay")
    if backbone is not None:
        ax.plot(backbone.t, backbone.positive_peak, color="C1", lw=1.2, label="peaks")
        ax.plot(backbone.t, backbone.negative_peak, color="C1", lw=1.2)
    ax.set(xlabel="time (s)", ylabel=f"q ({decay.unit or 'its own unit'})")
    ax.margins(x=0.01)
    ax.legend(loc="upper right", frameon=False)
    return ax


def plot_backbone(
    measured: Backbone | Fit,
    models: Models | None = None,
    *,
    ax: Axes | None = None,
) -> Axes:
    """Frequency against amplitude of every cycle, with the backbones of models over it.

    Parameters
    ----------
    measured : Backbone or Fit
        Points with their standard errors. A fit gives the cycles of its decays, and its own curve.
    models : mapping of str to ReducedModel or Estimate, optional
        Curves by label; an estimate, such as a fit, has its 95 % band.
    """
    ax = given_or_new(ax)
    backbones, models = _measured(measured, models)
    for backbone in backbones:
        ax.errorbar(
            backbone.frequency / (2 * np.pi),
            backbone.amplitude,
            xerr=backbone.frequency_std / (2 * np.pi),
            yerr=backbone.amplitude_std,
            **_CYCLES,
        )
    amplitudes = _span(backbones)
    for middle, band, look in _curves(models, amplitudes, "frequency", 2 * np.pi):
        if band:
            ax.fill_betweenx(amplitudes, *band, color=look["color"], alpha=0.25, lw=0)
        ax.plot(middle, amplitudes, **look)
    unit = backbones[0].unit or "unit of q"
    ax.set(xlabel="frequency (Hz)", ylabel=f"amplitude ({unit})", ylim=(0, None))
    # Single uncertain cycles must not squeeze the picture.
    sure = np.concatenate(
        [b.frequency[b.frequency_std < 0.01 * b.frequency] / (2 * np.pi) for b in backbones]
    )
    if len(sure) > 1:
        margin = 0.08 * max(np.ptp(sure), 1e-4 * sure.mean())
        ax.set_xlim(sure.min() - margin, sure.max() + margin)
    _legend(ax)
    return ax


def _measured(
    measured: Backbone | Fit, models: Models | None
) -> tuple[list[Backbone], Models | None]:
    if isinstance(measured, Backbone):
        return [measured], models
    if not isinstance(measured, Fit):
        raise ValueError(
            f"measured = {measured!r} holds no cycles: give a Backbone, and it among the models"
        )
    return [extract_backbone(d) for d in measured.decays], models or {"fitted model": measured}


def _span(backbones: Sequence[Backbone]) -> Array:
    amplitudes = np.concatenate([b.amplitude for b in backbones])
    return np.linspace(amplitudes.min(), amplitudes.max(), 200)


def _legend(ax: Axes) -> None:
    handles, labels = ax.get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))  # several decays share one label
    ax.legend(named.values(), named.keys(), loc="best", frameon=False)


def plot_damping(
    measured: Backbone | Fit,
    models: Models | None = None,
    *,
    ax: Axes | None = None,
) -> Axes:
    """Damping ratio against amplitude, with the curves of models over it (see `plot_backbone`)."""
    ax = given_or_new(ax)
    backbones, models = _measured(measured, models)
    for backbone in backbones:
        ax.errorbar(
            backbone.amplitude,
            100 * backbone.damping_ratio,
            yerr=100 * backbone.damping_ratio_std,
            **_CYCLES,
        )
    amplitudes = _span(backbones)
    for middle, band, look in _curves(models, amplitudes, "damping_ratio", 0.01):
        if band:
            ax.fill_between(amplitudes, *band, color=look["color"], alpha=0.25, lw=0)
        ax.plot(amplitudes, middle, **look)
    ratios = np.concatenate([b.damping_ratio for b in backbones])
    spread = np.quantile(ratios, [0.05, 0.95]) * 100
    ax.set_ylim(min(0, spread[0]), 1.5 * spread[1])
    ax.set(xlabel=f"amplitude ({backbones[0].unit or 'unit of q'})", ylabel="damping ratio (%)")
    _legend(ax)
    return ax


def plot_misfit(fit: Estimate, *, ax: Axes | None = None) -> Axes:
    """What a fit leaves at each harmonic of the motion, against amplitude.

    Rms of the residual over the noise at the same frequencies, in windows of eight cycles; near 1
    nothing is missing.
    """
    ax = given_or_new(ax)
    verdict = fit.verdict
    order = np.argsort(verdict.amplitude)
    for k, column in enumerate(verdict.misfit.T):
        if np.isfinite(column).any():
            label = "mean position" if k == 0 else f"harmonic {k}"
            ax.plot(verdict.amplitude[order], column[order], "o-", ms=3, lw=0.8, label=label)
    ax.axhline(1, color="0.4", lw=0.8, ls=":")
    ax.set(xlabel=f"amplitude ({verdict.unit or 'unit of q'})", ylabel="residual over noise")
    log_ratio(ax)
    ax.legend(loc="best", frameon=False, ncols=2)
    return ax


def plot_relative_magnitude(
    model: ReducedModel, amplitudes: ArrayLike, *, ax: Axes | None = None
) -> Axes:
    """Rms of every term relative to the acceleration, against amplitude (the paper's fig. 11)."""
    ax = given_or_new(ax)
    amplitudes = np.asarray(amplitudes, float)
    shares = model.relative_magnitude(amplitudes)
    for i, (key, share) in enumerate(shares.items()):
        style = "-" if i < 10 else "--"
        ax.plot(amplitudes, share, style, color=f"C{i % 10}", label=_symbol(key))
    ax.set(
        xlabel=f"amplitude ({model.unit or 'unit of q'})",
        ylabel="rms of term / rms of acceleration",
        yscale="log",
        ylim=(1e-5, 3),
    )
    ax.legend(loc="lower right", frameon=False, ncols=3, fontsize="small")
    return ax


def plot_residual(estimators: Mapping[str, HarmonicSINDy], *, ax: Axes | None = None) -> Axes:
    """Rms residual of the regression in every harmonic, relative to the rms target.

    White noise in the displacement leaves bars that grow with the square of the harmonic, as the
    second derivative does; a harmonic that stands out from this shows a missing term.
    """
    ax = given_or_new(ax)
    width = 0.8 / len(estimators)
    for i, (label, estimator) in enumerate(estimators.items()):
        rows = estimator.rows_
        residual = rows.target - rows.theta @ estimator.coef_
        harmonics = np.unique(rows.harmonic)
        rms = [np.sqrt(np.mean(residual[rows.harmonic == h] ** 2)) for h in harmonics]
        position = np.arange(len(harmonics)) + (i - (len(estimators) - 1) / 2) * width
        scale = np.sqrt(np.mean(rows.target**2))
        ax.bar(position, np.array(rms) / scale, width, color=f"C{i}", label=label)
        ax.set_xticks(np.arange(len(harmonics)), [str(h) for h in harmonics])
    ax.set(xlabel="harmonic", ylabel="rms residual / rms target")
    log_ratio(ax)
    ax.legend(loc="best", frameon=False)
    return ax


def plot_selection(selection: Selection, *, ax: Axes | None = None) -> Axes:
    """Held-out error of every structure against its number of coefficients.

    The error is squared error over noise of held-out cycles, beyond that of the best, with one
    standard error to either side: a structure whose bar reaches zero predicts as well as the best.
    """
    ax = given_or_new(ax)
    looks: dict[str, dict[str, Any]] = {
        CHOSEN: {"color": "C3", "ms": 9, "fmt": "*", "zorder": 3, "label": CHOSEN},
        EQUIVALENT: {"color": "C0", "ms": 4, "fmt": "o", "zorder": 2, "label": EQUIVALENT},
        "": {"color": "0.6", "ms": 4, "fmt": "o", "mfc": "white", "zorder": 1, "label": "worse"},
    }
    for verdict, look in looks.items():
        some = [c for c in selection.path if (c.verdict if c.verdict in looks else "") == verdict]
        if some:
            count = [len(c.keys) for c in some]
            error = [c.excess_std for c in some]
            ax.errorbar(count, [c.excess for c in some], yerr=error, lw=0.8, **look)
    ax.axhline(0, color="0.25", lw=0.8)
    ax.set_yscale("symlog", linthresh=10)
    ax.set_ylim(bottom=-30)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ylabel = "squared error of held-out cycles\nover noise, beyond the best"
    ax.set(xlabel="number of coefficients", ylabel=ylabel)
    ax.legend(loc="best", frameon=False)
    return ax


def plot_branch(
    branch: BackboneCurve, *, label: str = "backbone curve", ax: Axes | None = None
) -> Axes:
    """Amplitude of free periodic orbits against their frequency; folds marked."""
    ax = _orbit_axes(branch, ax)
    ax.plot(branch.frequency / (2 * np.pi), branch.amplitude, color="0.25", lw=1, label=label)
    _mark(ax, branch, branch.folds, "fold")
    ax.legend(loc="best", frameon=False)
    return ax


def plot_forced_response(
    response: ForcedResponse, *, label: str = "", color: str = "C0", ax: Axes | None = None
) -> Axes:
    """Amplitude of forced orbits against frequency: stable solid, unstable dashed.

    Bifurcations are marked by kind.

    Parameters
    ----------
    response : ForcedResponse
    label : str
        Goes before "stable" and "unstable" in the legend.
    color : str
        Of the curve.
    """
    ax = _orbit_axes(response, ax)
    hz = response.frequency / (2 * np.pi)
    # A stretch ends on the first point of the next one, so that the curve has no gaps.
    changes = np.flatnonzero(np.diff(response.stable)) + 1
    named: set[str] = set()
    for low, high in zip([0, *changes], [*(changes + 1), len(hz)], strict=True):
        name, style = ("stable", "-") if response.stable[low] else ("unstable", "--")
        text = None if name in named else f"{label} {name}".strip()
        stretch = slice(low, high)
        ax.plot(hz[stretch], response.amplitude[stretch], style, color=color, lw=1.2, label=text)
        named.add(name)
    for kind in dict.fromkeys(b.kind for b in response.bifurcations):
        _mark(ax, response, [b.index for b in response.bifurcations if b.kind == kind], kind)
    ax.legend(loc="best", frameon=False)
    return ax


_MARKERS = {"fold": "o", "branch point": "s", "period doubling": "^", "Neimark-Sacker": "D"}


def _orbit_axes(orbits: PeriodicOrbits, ax: Axes | None) -> Axes:
    ax = given_or_new(ax)
    ax.set(xlabel="frequency (Hz)", ylabel=f"amplitude ({orbits.unit or 'unit of q'})")
    return ax


def _mark(ax: Axes, orbits: PeriodicOrbits, points: ArrayLike, kind: str) -> None:
    points = np.asarray(points, int)
    if len(points):
        label = None if kind in ax.get_legend_handles_labels()[1] else kind
        look: dict[str, Any] = {"color": "C3", "mfc": "white", "ms": 5, "label": label}
        hz = orbits.frequency[points] / (2 * np.pi)
        ax.plot(hz, orbits.amplitude[points], _MARKERS[kind], **look)


def _symbol(key: str) -> str:
    """Coefficient name as a formula: "Upsilon_3" becomes a Greek letter with its index."""
    if key == "omega^2":
        return r"$\omega^2$"
    name, _, index = key.partition("_")
    greek = {"gamma": r"\gamma", "Upsilon": r"\Upsilon", "beta": r"\beta", "c": "c", "mu": r"\mu"}
    if name not in greek:  # a stop or a magnet: its name says more than a letter
        return key
    if "^" in index:
        return f"${greek[name]}$ ({index})"
    subscript = index if index.isdigit() else rf"\mathrm{{{index.replace(' ', '~')}}}"
    return f"${greek[name]}_{{{subscript}}}$" if index else f"${greek[name]}$"
