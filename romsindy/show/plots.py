"""Figures. Every function draws into an Axes (a new one if none is given) and returns it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from romsindy.fit.adequacy.verdicts import ForcedAdequacy
from romsindy.fit.functions.identification import Identification
from romsindy.fit.kernel.prepared import Prepared, one_a_decay
from romsindy.fit.process_noise import SIGMAS
from romsindy.fit.results.estimate import Band, Estimate, curves_near
from romsindy.fit.results.fitted import Fit
from romsindy.fit.results.forced_band import ForcedBand
from romsindy.orbits.curves import BackboneCurve, ForcedResponse, PeriodicOrbits, linear_mode
from romsindy.physics.equations import Equations
from romsindy.physics.model import ReducedModel
from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay
from romsindy.regression.estimator import HarmonicSINDy
from romsindy.regression.projection import HarmonicRows
from romsindy.show.axes import (
    Fact,
    given_or_new,
    labelled,
    legend_once,
    log_ratio,
    look,
    of_cycles,
    tell,
    with_unit,
)
from romsindy.text import listed
from romsindy.typing import Array

_FEWER = 4  # amplitudes, where orbits are followed for each
_DOTS = "os^Dv<>"
_ALONG = 200  # amplitudes of a curve


def _curves(
    models: Models | None, amplitudes: Array, quantity: str, unit: float, mode: int
) -> Iterator[Curve]:
    """Amplitudes, curve, 95 % band if any, and look of every model."""
    for i, (label, model) in enumerate((models or {}).items()):
        style = look(i) | {"label": label}
        if isinstance(model, Estimate):
            several = model.model.n_coordinates > 1
            model = model.band(amplitudes[:: -_FEWER if several else 1], mode)
        if isinstance(model, Band):
            band = model
            middle = getattr(band, quantity) / unit
            reach = SIGMAS * getattr(band, f"{quantity}_std") / unit
            yield band.amplitude, middle, (middle - reach, middle + reach), style
        else:
            frequency, damping = curves_near(model, amplitudes, mode)(model)
            curve = frequency if quantity == "frequency" else damping
            yield amplitudes, curve / unit, None, style


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
        for peak, label in ((backbone.positive_peak, "peaks"), (backbone.negative_peak, None)):
            (line,) = ax.plot(backbone.t, peak, color="C1", lw=1.2, label=label)
            tell(line, *of_cycles(backbone))
    ax.margins(x=0.01)
    return labelled(ax, "time (s)", with_unit("q", decay.unit), loc="upper right")


def plot_backbone(
    measured: Backbone | Sequence[Backbone] | Fit,
    models: Models | None = None,
    *,
    mode: int = 1,
    ax: Axes | None = None,
) -> Axes:
    """Frequency against amplitude of every cycle, with the backbones of models over it.

    Parameters
    ----------
    measured : Backbone, sequence of Backbone or Fit
        Points with their standard errors. A fit gives the cycles of its decays, and its own curve;
        one of several coordinates gives the tone of a mode, which others that ring may shift.
    models : mapping of str to ReducedModel, CoupledModel, Estimate or Band, optional
        Curves by label; what has errors has its 95 % band.
    mode : int
        Of models of several coordinates, by frequency, from 1.
    """
    ax = given_or_new(ax)
    backbones = _draw_cycles(ax, measured, models, "frequency", 2 * np.pi, mode, upright=True)
    label = with_unit("amplitude", backbones[0].unit)
    ax.set(xlabel="frequency (Hz)", ylabel=label, ylim=(0, None))
    # Single uncertain cycles must not squeeze the picture.
    sure = np.concatenate([b.frequency[b.certain] / (2 * np.pi) for b in backbones])
    if len(sure) > 1:
        margin = 0.08 * max(np.ptp(sure), 1e-4 * sure.mean())
        ax.set_xlim(sure.min() - margin, sure.max() + margin)
    legend_once(ax)
    return ax


def _draw_cycles(
    ax: Axes,
    measured: Backbone | Sequence[Backbone] | Fit,
    models: Models | None,
    quantity: str,
    unit: float,
    mode: int,
    upright: bool = False,
) -> Sequence[Backbone]:
    """Every cycle with its errors, and the curves of models; ``upright``, amplitude goes up."""
    points = points_of(measured, mode)
    backbones, models = backbones_of(measured, models, mode)
    sizes = np.concatenate([b.amplitude for b in backbones])
    along = np.linspace(sizes.min(), sizes.max(), _ALONG)
    curves = list(_curves(models, along, quantity, unit, mode))
    for number, b in numbered(backbones):
        read, std = (getattr(b, quantity + end) / unit for end in ("", "_std"))
        x, y = (read, b.amplitude) if upright else (b.amplitude, read)
        errors = (b.amplitude_std, std) if upright else (std, None)
        cycles = ax.errorbar(x, y, *errors, **points)
        tell(cycles.lines[0], *of_cycles(b, number), *misses(b.amplitude, read, curves))
    fill = ax.fill_betweenx if upright else ax.fill_between
    for amplitudes, middle, band, style in curves:
        if band:
            fill(amplitudes, *band, color=style["color"], alpha=0.25, lw=0)
        ax.plot(*((middle, amplitudes) if upright else (amplitudes, middle)), **style)
    return backbones


def plot_damping(
    measured: Backbone | Sequence[Backbone] | Fit,
    models: Models | None = None,
    *,
    mode: int = 1,
    ax: Axes | None = None,
) -> Axes:
    """Damping ratio against amplitude, with the curves of models over it (see `plot_backbone`)."""
    ax = given_or_new(ax)
    backbones = _draw_cycles(ax, measured, models, "damping_ratio", 0.01, mode)
    ax.locator_params(axis="x", nbins=6)  # amplitudes such as 0.0025 are wide
    ratios = np.concatenate([b.damping_ratio for b in backbones])
    spread = np.quantile(ratios, [0.05, 0.95]) * 100
    ax.set_ylim(min(0, spread[0]), 1.5 * spread[1])
    ax.set(xlabel=with_unit("amplitude", backbones[0].unit), ylabel="damping ratio (%)")
    legend_once(ax)
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
            style = look(k) | {"marker": _DOTS[k % len(_DOTS)], "ms": 4, "lw": 0.8}
            ax.plot(verdict.amplitude[order], column[order], **style, label=label)
    ax.axhline(1, color="0.4", lw=0.8, ls=":")
    log_ratio(ax)
    return labelled(ax, with_unit("amplitude", verdict.unit), "residual over noise", ncols=2)


def plot_levels(verdict: ForcedAdequacy, *, ax: Axes | None = None) -> Axes:
    """What a fit leaves of driven records against their response, both rms, and the sensor's noise.

    Noise of the sensor is the same at all levels; what grows with the response is no such noise.
    """
    ax = given_or_new(ax)
    response, left = verdict.levels.T
    ax.plot(response, left, **look(0) | {"marker": "o", "ms": 4, "lw": 0.8}, label="what is left")
    if verdict.sensor:
        noise = verdict.sensor * verdict.left / verdict.part
        ax.axhline(noise, color="0.4", lw=0.8, ls=":", label="noise of the sensor")
    log_ratio(ax, "x")
    names = ("response, rms", "left of it, rms")
    return labelled(ax, *(with_unit(name, verdict.measured_unit) for name in names))


def plot_relative_magnitude(
    model: ReducedModel, amplitudes: ArrayLike, *, ax: Axes | None = None
) -> Axes:
    """Rms of every term relative to the acceleration, against amplitude (the paper's fig. 11).

    The legend begins with the term that is largest at the largest amplitude.
    """
    ax = given_or_new(ax)
    amplitudes = np.asarray(amplitudes, float)
    shares = model.relative_magnitude(amplitudes)
    for i, (key, share) in enumerate(shares.items()):
        ax.plot(amplitudes, share, **look(i), label=_symbol(key))
    ax.set(
        xlabel=with_unit("amplitude", model.unit),
        ylabel="rms of term / rms of acceleration",
        yscale="log",
        ylim=(1e-5, 3),
    )
    # From the largest on, as the curves end.
    ends = np.array([share[np.argmax(amplitudes)] for share in shares.values()])
    sorted_lines = [ax.lines[i] for i in np.argsort(-ends)]
    ax.legend(handles=sorted_lines, loc="lower right", frameon=False, ncols=3, fontsize="small")
    return ax


def plot_residual(estimators: Mapping[str, HarmonicSINDy], *, ax: Axes | None = None) -> Axes:
    """Rms residual of the regression in every harmonic, relative to the rms target.

    White noise in the displacement leaves bars that grow with the square of the harmonic, as the
    second derivative does; a harmonic that stands out from this shows a missing term.

    Raises
    ------
    ValueError
        For a regression of several coordinates, whose rows are windows without harmonics.
    """
    several = [label for label, e in estimators.items() if not isinstance(e.rows_, HarmonicRows)]
    if several:
        raise ValueError(
            f"estimators has {several} of several coordinates, whose rows have no harmonics: see"
            " refine(estimator.model_, decays).residuals"
        )
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
    return labelled(ax, "harmonic", "rms residual / rms target")


def plot_branch(
    branch: BackboneCurve, *, label: str = "backbone curve", ax: Axes | None = None
) -> Axes:
    """Amplitude of free periodic orbits against their frequency; folds marked.

    Of several coordinates each has a line: its colour and dashes, named behind the label.
    """
    ax = _orbit_axes(branch, ax)
    lines = branch.amplitude.reshape(len(branch), -1).T
    for i, amplitude in enumerate(lines):
        style: dict[str, Any] = {"color": "0.25", "label": label}
        if len(lines) > 1:
            style = {"color": f"C{i}", "ls": ("-", "--", ":")[i % 3], "label": f"{label}, q{i + 1}"}
        ax.plot(branch.frequency / (2 * np.pi), amplitude, lw=1, **style)
    folds = np.asarray(branch.folds, int)
    _mark(ax, branch.frequency[folds], lines[:, folds], "fold")
    ax.legend(loc="best", frameon=False)
    return ax


def plot_forced_response(
    response: ForcedResponse | ForcedBand,
    *,
    label: str = "",
    color: str = "C0",
    ax: Axes | None = None,
) -> Axes:
    """Amplitude of forced orbits against frequency: stable solid, unstable dashed.

    Of a `ForcedBand`, the first harmonic of what is measured, with its 95 % band.

    Dotted is what lies beyond the amplitudes of the data behind the model, stable or not.

    Bifurcations are marked by kind. Of several coordinates each has a line of its own colour, named
    behind the label.

    Parameters
    ----------
    response : ForcedResponse or ForcedBand
    label : str
        Goes before "stable" and "unstable" in the legend; the force if it is not given.
    color : str
        Of the curve, or of that of the first coordinate: the others are "C1", "C2", ...
    """
    if not isinstance(response, ForcedResponse | ForcedBand):
        raise ValueError(
            f"response is a {type(response).__name__}: give one ForcedResponse or ForcedBand, and"
            " draw others into the same axes, ax=..."
        )
    ax = _orbit_axes(response, ax)
    if isinstance(response, ForcedBand):
        ax.set_ylabel(with_unit("amplitude of the first harmonic", response.unit))
        orbits, amplitudes = response.response, response.along
    else:
        orbits, amplitudes = response, response.amplitude
    force = listed([f"{f:.3g}" for f in np.atleast_1d(orbits.force)])
    label = label or f"{force} {orbits.unit or '[q]'}/s$^2$,"
    lines = amplitudes.reshape(len(orbits), -1).T
    colors = [color, *(f"C{i}" for i in range(1, len(lines)))]
    if isinstance(response, ForcedBand):
        _forced_band(ax, response, colors)
    for i, (amplitude, own_color) in enumerate(zip(lines, colors, strict=True)):
        own = f"{label} q{i + 1}" if len(lines) > 1 else label
        _stretches(ax, orbits, amplitude, own, own_color)
    for kind in dict.fromkeys(b.kind for b in orbits.bifurcations):
        where = [b.index for b in orbits.bifurcations if b.kind == kind]
        _mark(ax, orbits.frequency[where], lines[:, where], kind)
    ax.legend(loc="best", frameon=False)
    return ax


def _forced_band(ax: Axes, band: ForcedBand, colors: Sequence[str]) -> None:
    """The bands of the larger and of the smaller response of each coordinate, if there are two."""
    hz, n = band.frequency / (2 * np.pi), len(band.frequency)
    upper, lower = (
        [x.reshape(n, -1).T for x in band.at(band.frequency, branch)]
        for branch in ("upper", "lower")
    )
    for i, color in enumerate(colors):
        look: dict[str, Any] = {"color": color, "alpha": 0.25, "lw": 0}
        ax.fill_between(hz, upper[1][i], upper[2][i], label=None if i else "95 %", **look)
        two = lower[0][i] != upper[0][i]
        ax.fill_between(hz, lower[1][i], lower[2][i], where=two, **look)


def _stretches(
    ax: Axes, response: ForcedResponse, amplitude: Array, label: str, color: str
) -> None:
    """The stable and unstable stretches of one coordinate, each kind named once."""
    hz, named = response.frequency / (2 * np.pi), set[str]()
    # A stretch ends on the first point of the next one, so that the curve has no gaps.
    stable = response.stable_at(np.arange(len(response)))
    kinds = np.where(response.beyond, 2, np.where(stable, 0, 1))
    changes = np.flatnonzero(np.diff(kinds)) + 1
    for low, high in zip([0, *changes], [*(changes + 1), len(hz)], strict=True):
        name, style = _KINDS[kinds[low]]
        text = None if name in named else f"{label} {name}".strip()
        stretch = slice(low, high)
        ax.plot(hz[stretch], amplitude[stretch], style, color=color, lw=1.2, label=text)
        named.add(name)


_KINDS = (("stable", "-"), ("unstable", "--"), ("beyond the data", ":"))
_MARKERS = {"fold": "o", "branch point": "s", "period doubling": "^", "Neimark-Sacker": "D"}


def _orbit_axes(orbits: PeriodicOrbits | ForcedBand, ax: Axes | None) -> Axes:
    ax = given_or_new(ax)
    ax.set(xlabel="frequency (Hz)", ylabel=with_unit("amplitude", orbits.unit))
    return ax


def _mark(ax: Axes, omega: Array, lines: Array, kind: str) -> None:
    """Mark orbits at some frequencies (n,) on the lines (n_coordinates, n)."""
    if len(omega):
        label = None if kind in ax.get_legend_handles_labels()[1] else kind
        look: dict[str, Any] = {"color": "C3", "mfc": "white", "ms": 5, "label": label}
        ax.plot(np.tile(omega / (2 * np.pi), len(lines)), lines.ravel(), _MARKERS[kind], **look)


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


# -- cycles of measured decays, and curves of models beside them -----------------------------------


Models = Mapping[str, Equations | Estimate | Band]
# Amplitudes, curve, its band if any, and its look.
Curve = tuple[Array, Array, tuple[Array, Array] | None, dict[str, Any]]


def backbones_of(
    measured: Backbone | Sequence[Backbone] | Fit, models: Models | None, mode: int = 1
) -> tuple[Sequence[Backbone], Models | None]:
    """What was measured, a backbone for each decay, and the models beside it.

    Of a fit of several coordinates, the backbones are those of the tone of a mode.

    Raises a ValueError if there are no cycles in it, or no such mode.
    """
    if isinstance(measured, Backbone):
        return [measured], models
    if measured and isinstance(measured, (list, tuple)):
        return measured, models
    if not isinstance(measured, Fit):
        raise ValueError(
            f"measured = {measured!r} holds no cycles: give a Backbone, and it among the models"
        )
    name = "fitted model"
    if measured.model.numbered:
        name += f", mode {mode} alone"
        coordinate = int(np.argmax(np.abs(linear_mode(measured.model.undamped(), mode)[1])))
        found = [_of_tone(r, coordinate) for r in one_a_decay(measured.records)]
    else:
        found = [extract_backbone(d) for d in measured.decays]
    return found, models or {name: measured}


def points_of(measured: Backbone | Sequence[Backbone] | Fit, mode: int) -> dict[str, Any]:
    """How the cycles of a measured decay look in every figure, and what they are called."""
    look: dict[str, Any] = {"fmt": "o", "ms": 3, "lw": 0.7, "color": "0.25", "mfc": "white"}
    several = isinstance(measured, Fit) and measured.model.n_coordinates > 1
    label = f"mode {mode} while others ring" if several else "cycles of the decay"
    return look | {"label": label, "zorder": 1}


def _of_tone(record: Prepared, coordinate: int) -> Backbone:
    """The tone of a coordinate at the windows where it was followed; its errors are not known."""
    tone = record.tones[coordinate]
    omega = 2 * np.pi * tone.frequency
    amplitude, unknown = tone.amplitude / omega**record.derivative, np.full(len(omega), np.nan)
    fall = -np.gradient(np.log(amplitude), tone.t)
    return Backbone(
        t=tone.t,
        amplitude=amplitude,
        frequency=omega,
        damping_ratio=fall / np.hypot(fall, omega),
        positive_peak=amplitude,
        negative_peak=-amplitude,
        amplitude_std=unknown,
        frequency_std=unknown,
        damping_ratio_std=unknown,
        unit=record.decay.unit,
    )


def numbered(backbones: Sequence[Backbone]) -> Iterator[tuple[int | None, Backbone]]:
    """Backbones with the numbers of their decays, where there are several."""
    for i, backbone in enumerate(backbones, 1):
        yield (i if len(backbones) > 1 else None), backbone


def misses(amplitude: Array, measured: Array, curves: Sequence[Curve]) -> Iterator[Fact]:
    """How far curves are off what was measured of cycles at their amplitudes."""
    for amplitudes, middle, _, style in curves:
        order = np.argsort(amplitudes)
        said = np.interp(amplitude, amplitudes[order], middle[order], np.nan, np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):  # of no damping, nothing is a part
            off = 100 * (said / measured - 1)
        yield Fact(f"{style['label']} off by (%)", off, digits=3)


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
    ax.set(xlabel=with_unit("amplitude", found.model.unit), yscale="log", ylim=(1e-5, 3))
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
    return labelled(ax, with_unit(name, found.model.unit), ylabel)
