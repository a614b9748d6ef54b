"""The page of what was identified: a list of panels, each of which asks the result what it has.

A panel is a function of the result that gives its pictures, none where it does not apply. A new one
is such a function and a line in `PANELS`: pages of all kinds of results then have it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from romsindy.fit.adequacy.verdicts import ForcedAdequacy
from romsindy.fit.process_noise import SIGMAS
from romsindy.fit.results.estimate import Band, Curve, Estimate
from romsindy.fit.results.fitted import SmallVibration
from romsindy.fit.results.forced_band import ForcedBand
from romsindy.fit.steady.fit import SteadyFit
from romsindy.orbits.curves import BackboneCurve, ForcedResponse
from romsindy.physics.model import ReducedModel
from romsindy.record.recording import unit_of
from romsindy.regression.judged import Beside
from romsindy.show import plots
from romsindy.show.axes import labelled, legend_once, with_unit
from romsindy.show.compared import (
    Compared,
    Density,
    draw_over_time,
    draw_spectra,
    held_out_of,
    spectrum_of,
)
from romsindy.show.identified import Identified, levels_of, tables
from romsindy.show.page import Picture, write_page
from romsindy.show.plots import (
    plot_branch,
    plot_forced_response,
    plot_inertia,
    plot_parts,
    plot_stiffness,
)

_INCHES = 3.4  # height of one coordinate of several
_ROW = 1.5  # the same of a row over time
_LOOK = 21  # values of q by which a function is known to change
_CHANGES = 1e-9  # more than rounding
_CURVE, _SHARES = 60, 150  # points of a band against amplitude, and of shares of terms
_GRID, _LINES = 120, 8  # points each way of a force surface, and lines
_BEYOND = 1.2  # what was measured, a force surface goes

Panel = Callable[[Identified], Iterable[Picture]]


def _picture(name: str, title: str, caption: str, plot: Callable[..., object]) -> Picture:
    return Picture(name, title, caption, lambda figure: plot(ax=figure.subplots()))


# -- what was measured beside the models -----------------------------------------------------------


def decays(result: Identified) -> Iterator[Picture]:
    """Decays with the peaks of their cycles."""
    if result.beside is not None:
        caption = "The free decay that was analysed, with the peaks of its cycles."
        yield _picture("decay", "Decay", caption, partial(_plot_decays, result.beside))


def _plot_decays(beside: Beside, ax: Axes) -> None:
    for decay, backbone in zip(beside.decays, beside.backbones, strict=True):
        plots.plot_decay(decay, backbone, ax=ax)
        # One legend for all of them.
        handles, labels = ax.get_legend_handles_labels()
        ax.legend(handles[:2], labels[:2], loc="upper right", frameon=False)


def cycles(result: Identified) -> Iterator[Picture]:
    """Frequency and damping of every cycle, with the models over them."""
    beside = result.beside
    if beside is None:
        return
    b = beside.backbone
    models: dict[str, Any] = {c.name: c.model for c in beside.shown}
    if result.found is not None:
        amplitudes = np.linspace(b.amplitude.min(), b.amplitude.max(), _CURVE)
        models[beside.main.name] = result.found.band(amplitudes)
    yield _picture(
        "backbone",
        "Backbone",
        "Each circle is a cycle with its standard error; curves are the undamped models, the"
        " identified one with its 95 % band.",
        partial(plots.plot_backbone, beside.backbones, models),
    )
    yield _picture(
        "damping",
        "Damping",
        "Damping ratio of each cycle, and what the models dissipate.",
        partial(plots.plot_damping, beside.backbones, models),
    )


def modes(result: Identified) -> Iterator[Picture]:
    """The backbone of each mode of several coordinates."""
    if not result.modes:
        return
    told = [
        f"Mode {number}: {b if isinstance(b, str) else b.stop_reason}."
        for number, b in result.backbones.items()
    ]
    caption = (
        "Undamped periodic motion of each mode, as the equations have it; a line for each"
        " coordinate."
    )
    if result.fit is not None and result.fit.decays:
        caption += " Dots: the vibration in the decays, which the other coordinates move, too."
    size = (6.4, _INCHES * len(result.modes))
    draw = partial(draw_modes, result.modes, result.backbones, result.model.unit)
    yield Picture("backbone", "Backbones", " ".join([caption, *told]), draw, size)


def band(result: Identified) -> Iterator[Picture]:
    """Backbone and damping of the equation alone, where no cycles show them."""
    if result.band is None:
        return
    caption = "Undamped motion and damping ratio of the equation without inputs, with 95 % bands."
    if not np.isfinite(result.band.frequency).all():
        caption += " They end where the equation has no periodic motion."
    draw = partial(draw_band, result.band)
    yield Picture("backbone", "Backbone and damping", caption, draw, (6.4, 6.0))


def response(result: Identified) -> Iterator[Picture]:
    """Steady states with the response to every level of force."""
    if result.steady is not None:
        yield Picture(
            "response",
            "Response",
            "Dots are the steady states that were measured, lines the equation at each level of"
            " force, with the 95 % band of a further point; dashed where unstable.",
            partial(draw_levels, result.steady, result.levels, result.force_unit),
        )


def surface(result: Identified) -> Iterator[Picture]:
    """The force that every amplitude needs at every frequency."""
    if result.steady is not None:
        yield Picture(
            "surface",
            "Force surface",
            "Lines along which the equation needs the same force, and the steady states that were"
            " measured, in the colour of theirs. Where a line turns back, a sweep of the frequency"
            " jumps.",
            partial(draw_surface, result.steady, result.force_unit),
        )


# -- the equation ----------------------------------------------------------------------------------

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


def functions(result: Identified) -> Iterator[Picture]:
    """Inertia and stiffness along every coordinate, where the equation has them change with it."""
    found, beside = result.found, result.beside
    if found is None:
        return
    others = {c.name: c.model for c in beside.shown if c is not beside.main} if beside else {}
    coordinates = range(1, found.model.n_coordinates + 1)
    for name, plot, caption in _FUNCTIONS:
        changing = [k for k in coordinates if _changes(found, name, k)]
        draw = partial(_draw_function, found, plot, changing, others)
        if changing == [1] == [*coordinates]:
            yield Picture(name, name.capitalize(), caption, draw)
        elif changing:
            caption += " Along each coordinate, with the others at rest."
            yield Picture(name, name.capitalize(), caption, draw, (6.4, _INCHES * len(changing)))


def _changes(found: Estimate, name: str, coordinate: int) -> bool:
    """Whether a function, or what is known of it, changes over the range of the data."""
    reach = found.reach_of(coordinate)
    if not np.isfinite(reach).all():
        return False
    curve: Curve = getattr(found, name)(np.linspace(*reach, _LOOK), coordinate)
    values = np.array([curve.value, curve.low, curve.high])
    return bool(np.ptp(values, axis=1).max() > _CHANGES * np.abs(values).max())


def _draw_function(
    found: Estimate,
    plot: Callable[..., Axes],
    coordinates: Sequence[int],
    beside: Mapping[str, ReducedModel],
    figure: Figure,
) -> None:
    axes = figure.subplots(len(coordinates), squeeze=False)[:, 0]
    for ax, k in zip(axes, coordinates, strict=True):
        plot(found, beside, coordinate=k, ax=ax)


def parts(result: Identified) -> Iterator[Picture]:
    """Which parts of the equation matter: of functions with bands, or of the terms of a model."""
    title = "Relative magnitude of the terms"
    if result.series is not None:
        yield _picture(
            "parts",
            title,
            "Inertia beyond 1, stiffness beyond omega^2 and damping over a cycle, with 95 % bands:"
            " which of them matter.",
            partial(plot_parts, result.series),
        )
    elif result.beside is not None:
        b, main = result.beside.backbone, result.beside.main
        amplitudes = np.linspace(b.amplitude.min(), b.amplitude.max(), _SHARES)
        yield _picture(
            "relative_magnitude",
            title,
            f"Terms of the {main.name} over a cycle: which of them matter.",
            partial(plots.plot_relative_magnitude, main.model, amplitudes),
        )


# -- what is left ----------------------------------------------------------------------------------


def harmonics(result: Identified) -> Iterator[Picture]:
    """What is left at the harmonics of the motion, where that was looked at."""
    if result.series is not None:
        yield _picture(
            "misfit",
            "What the equation leaves",
            "Residual at the harmonics of the motion over the noise, in windows of eight cycles:"
            " near 1 nothing is missing; single points scatter by chance.",
            partial(plots.plot_misfit, result.series),
        )
    elif result.beside is not None:
        estimators = {
            c.name: c.estimator for c in result.beside.regressions if c in result.beside.shown
        }
        yield _picture(
            "residual",
            "Residual by harmonic",
            "What the regression leaves. Noise grows with the harmonic squared; what stands out"
            " from that is a missing term.",
            partial(plots.plot_residual, estimators),
        )


def levels(result: Identified) -> Iterator[Picture]:
    """What is left of driven records where they are quiet and where they are loud."""
    verdict = None if result.fit is None else result.fit.verdict
    if isinstance(verdict, ForcedAdequacy) and np.isfinite(verdict.growth[0]):
        yield _picture(
            "levels",
            "What is left, against the response",
            "In stretches of eight cycles, those alike together. Noise of a sensor is the same at"
            " all levels; what grows with the response goes with the motion, or with its input.",
            partial(plots.plot_levels, verdict),
        )


def force_left(result: Identified) -> Iterator[Picture]:
    """What is left of the force at steady states."""
    if result.steady is not None:
        yield Picture(
            "misfit",
            "Force left over",
            "What the equation leaves of the force at every point, as a part of it: points that"
            " stand off their neighbours had not settled.",
            partial(draw_force_left, result.steady),
        )


def over_time(result: Identified) -> Iterator[Picture]:
    """Every channel, measured and simulated, and what a simulation leaves of it."""
    held = result.held_out
    rest = [] if held is None else held_out_of(held.vibration, held.missed)
    for i, (name, channel) in enumerate(_named(result).items(), 1):
        caption = (
            f"{'Input, response, and' if channel.inputs else 'Measured, and'}"
            f" {result.what_is_left()}; dotted: one standard deviation of the noise. Below: some"
            " cycles round the largest, measured and simulated."
            f"{' Orange: what was held out, and predicted.' if held else ''}"
        )
        yield Picture(
            f"channel_{i}" if name else "motion",
            f"Over time: {name}" if name else "Over time",
            caption,
            partial(draw_over_time, channel, held_out=rest[i - 1] if rest else None),
            (6.4, 0.6 + _ROW * channel.rows),
        )


def spectrum(result: Identified) -> Iterator[Picture]:
    """What is left beside the noise, at every frequency."""
    spectra = {name: spectrum_of(channel) for name, channel in _named(result).items()}
    caption = (
        "Of what was measured and of what is left of it, beside the noise. What the equation lacks"
        " stands out of it, and so does what a force that was not measured moves."
    )
    if result.steady is not None:
        spectra = {"": _of_points(result)}
        caption += " Large near folds, where a small force moves the response far."
    if spectra:
        size = (6.4, 1.0 + _INCHES * len(spectra))
        yield Picture(
            "spectrum", "Spectrum of what is left", caption, partial(draw_spectra, spectra), size
        )


def _named(result: Identified) -> dict[str, Compared]:
    """Channels by name; one alone needs none."""
    if len(result.followed) == 1:
        return {"": result.followed[0]}
    numbered = [f"channel {i + 1}" for i in range(len(result.followed))]
    return dict(zip(result.channels or numbered, result.followed, strict=True))


def _of_points(result: Identified) -> Density:
    """Of steady states, their response and what is left of it at their frequencies."""
    assert result.steady is not None
    fit, points = result.steady, result.steady.points
    order = np.argsort(points.frequency)
    rate = points.frequency**points.rate
    # Of a complex number, whose real and imaginary part have this noise each.
    noise = np.sqrt(1.0 + points.phased) * points.std[:, 0] * rate
    return Density(
        points.frequency[order] / (2 * np.pi),
        (points.amplitude * rate)[order],
        {"simulated": np.abs(fit.residuals)[order]},
        noise[order],
        with_unit(points.measured, unit_of(points.measured, fit.model.unit)),
        {"ls": "", "marker": "o", "ms": 3},
    )


# -- the page --------------------------------------------------------------------------------------

PANELS: tuple[Panel, ...] = (
    decays,
    cycles,
    modes,
    band,
    response,
    surface,
    functions,
    parts,
    harmonics,
    levels,
    force_left,
    over_time,
    spectrum,
)


def pictures(result: Identified) -> list[Picture]:
    """The figures of a result."""
    return [picture for panel in PANELS for picture in panel(result)]


def write_result(
    result: Identified,
    path: str | Path,
    figures: Iterable[Picture],
    *,
    interactive: bool = False,
    command: str = "identify",
) -> None:
    """Write the page with figures, those of `pictures` and others; a ``command`` makes it."""
    several = result.model.numbered
    write_page(
        path,
        "report",
        command,
        title=result.title,
        sentence="\n".join([*result.findings(), *(() if result.series else result.remarks())]),
        equation_title=f"The equation{'s' if several else ''} of motion",
        **_equation(result),
        tables=tables(result),
        pictures=figures,
        interactive=interactive,
        notes=[*([result.picked] if result.picked else []), *result.notes()],
    )


def _equation(result: Identified) -> dict[str, Any]:
    """The equation in letters and as a formula, and the verdict on it."""
    found, beside = result.found, result.beside
    if found is None:
        main = beside and beside.main.model
        return {"equation": str(main), "formulas": main.formulas() if main else ()}
    words: dict[str, Any] = {
        "equation": "\n".join(result.equations()),
        "formulas": result.model.formulas(),
    }
    if result.series is not None:
        s = result.series
        words["formulas"] = s.short.model.formulas()
        words["equation"] = "\n".join(s.opening()[:2])  # the short one is the formula
        words["equation_note"] = " ".join([f"Of the short equation: {s.off()}.", *result.remarks()])
    return words | {"verdict": found.verdict.answer}


# -- what an equation does: backbones of modes, bands, levels of force -----------------------------


def draw_modes(
    modes: Sequence[SmallVibration],
    backbones: Mapping[int, BackboneCurve | str],
    unit: str | None,
    figure: Figure,
) -> None:
    """Axes for each mode: its backbone, if there is one, over what was measured."""
    rows = figure.subplots(len(modes), 1, squeeze=False)[:, 0]
    for ax, mode in zip(rows, modes, strict=True):
        ax.set_title(f"mode {mode.number}", loc="left", fontsize="medium")
        rings = np.isfinite(mode.measured_frequency)
        if np.any(rings):
            seen = mode.measured_frequency[rings], mode.measured_amplitude[rings]
            ax.plot(*seen, ".", ms=3, color="0.7", label=f"q{mode.coordinate} in the decays")
            ax.legend(frameon=False)
        ax.set(xlabel="frequency (Hz)", ylabel=with_unit("amplitude", unit))
        backbone = backbones[mode.number]
        if isinstance(backbone, BackboneCurve):
            plot_branch(backbone, label="backbone", ax=ax)


def draw_band(band: Band, figure: Figure) -> None:
    """Frequency, and damping ratio, against amplitude."""
    above, below = figure.subplots(2, 1, sharex=True)
    hertz, percent = 2 * np.pi, 0.01
    for ax, values, std in (
        (above, band.frequency / hertz, band.frequency_std / hertz),
        (below, band.damping_ratio / percent, band.damping_ratio_std / percent),
    ):
        reach = SIGMAS * std
        ends = values - reach, values + reach
        ax.fill_between(band.amplitude, *ends, color="C0", alpha=0.25, lw=0)
        ax.plot(band.amplitude, values, color="C0")
        ax.margins(x=0.01)
        ax.ticklabel_format(axis="y", useOffset=False)
    above.set(ylabel="frequency (Hz)")
    below.set(ylabel="damping ratio (%)", xlabel=with_unit("amplitude", band.unit))


def draw_bands(bands: Mapping[int, Band], figure: Figure) -> None:
    """The same of several modes, by their numbers, side by side."""
    several = len(bands) > 1
    parts: Any = figure.subfigures(1, len(bands)) if several else [figure]
    for part, (mode, band) in zip(parts, bands.items(), strict=True):
        draw_band(band, part)
        if several:
            part.suptitle(f"mode {mode}")


def draw_response(
    response: ForcedResponse | ForcedBand, label: str, span: tuple[float, float], figure: Figure
) -> None:
    """The response in a range of frequencies, rad/s, under what a label says."""
    ax = plot_forced_response(response, label=label, ax=figure.subplots())
    ax.set_xlim(*(omega / (2 * np.pi) for omega in span))


def draw_levels(
    fit: SteadyFit, curves: Mapping[float, ForcedBand | str], unit: str | None, figure: Figure
) -> None:
    """Steady states, and the response to each level of force, whose unit is given."""
    ax: Axes = figure.subplots()
    points = fit.points
    for i, (force, band) in enumerate(curves.items()):
        if isinstance(band, ForcedBand):
            plot_forced_response(band, label=f"{force:.4g} {unit or ''},", color=f"C{i}", ax=ax)
    size = points.amplitude * points.frequency**points.rate
    hz = points.frequency / (2 * np.pi)
    ax.plot(hz, size, ".", color="0.2", ms=4, zorder=3, label="measured")
    ax.set(xlabel="frequency (Hz)")
    ax.set_ylabel(with_unit(points.measured, unit_of(points.measured, fit.model.unit)))
    legend_once(ax, fontsize="small")  # the band and a fold


def draw_surface(fit: SteadyFit, unit: str | None, figure: Figure) -> None:
    """Lines of equal force over frequency and amplitude, with the steady states."""
    ax: Axes = figure.subplots()
    points, forces = fit.points, np.abs(fit.points.force)
    size = points.amplitude * points.frequency**points.rate
    w = np.linspace(points.frequency.min(), points.frequency.max(), _GRID)
    a = np.linspace(1 / _GRID, 1.0, _GRID) * _BEYOND * size.max()
    force = fit.force_surface(w, a[:, None])
    shades: dict[str, Any] = {"cmap": "viridis", "vmin": 0.0, "vmax": _BEYOND * forces.max()}
    even = np.linspace(0.0, _BEYOND * forces.max(), _LINES + 2)[1:-1]
    lines = ax.contour(w / (2 * np.pi), a, force, even, **shades)
    ax.clabel(lines, fmt=lambda x: f"{x:.2g} {unit or ''}".rstrip(), colors="0.2", fontsize="small")
    hz = points.frequency / (2 * np.pi)
    ax.scatter(hz, size, 12, forces, edgecolors="0.2", linewidths=0.3, zorder=3, **shades)
    ax.set(xlabel="frequency (Hz)")
    ax.set_ylabel(with_unit(points.measured, unit_of(points.measured, fit.model.unit)))


def draw_force_left(fit: SteadyFit, figure: Figure) -> None:
    """Force that is left over at every steady state, in per cent, by level."""
    ax: Axes = figure.subplots()
    hz = fit.points.frequency / (2 * np.pi)
    for force, mine in levels_of(fit):
        left = 100 * np.abs(fit.misfit[mine])
        ax.plot(hz[mine], left, ".-", lw=0.7, ms=4, label=f"{force:.4g}")
    ax.set_ylim(0, None)
    labelled(ax, "frequency (Hz)", "force left over (%)", title="force")
