"""The command ``romsindy predict``."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from romsindy.commands.main import OVERWRITES
from romsindy.commands.options import (
    estimate_of,
    full_option,
    interactive_option,
    model_of,
    refuse_beside,
    span,
    text_of,
)
from romsindy.commands.outputs import (
    JSON,
    PAGE,
    Output,
    WritingCommand,
    default_page,
    told,
    write_json,
    write_text,
    writing,
)
from romsindy.fit.adequacy.verdicts import SteadyAdequacy
from romsindy.fit.process_noise import SIGMAS
from romsindy.fit.results.estimate import Band, Estimate, curves_near
from romsindy.fit.results.forced_band import ForcedBand
from romsindy.fit.steady.fit import SteadyEstimate
from romsindy.orbits.continuation import ContinuationError
from romsindy.orbits.curves import Fold, ForcedResponse, SteadyState, forced_response
from romsindy.orbits.sweeps import jumps
from romsindy.physics.equations import Equations, inputs_of
from romsindy.physics.term_sum import json_text
from romsindy.record.files.load import named
from romsindy.record.interpolation import is_base
from romsindy.record.recording import QUANTITIES
from romsindy.record.units import force_unit
from romsindy.show.page import Picture, write_page
from romsindy.show.panels import draw_bands, draw_response
from romsindy.text import TextTable, as_text, bar
from romsindy.typing import Array

_HERTZ = 2 * np.pi
_FIGURE = "romsindy predicted"
_MARK = "],low"  # in the header of a CSV
_FEW = 9  # frequencies, or amplitudes, that are printed without --full
_CURVE = 40  # amplitudes of a backbone
_LOW, _AROUND = 0.05, 0.1  # of the largest amplitude; of the frequencies of a backbone
_SMOOTH = 0.01  # of the largest velocity: below it dry friction is made smooth
_LOSSES = (0.01, 0.5)  # damping ratios of a linear resonance that is taken for the size of another
_ALIKE = 1.001  # of an end of a range: beyond, it is left
_ALONE = (
    "No band: the file holds an equation without errors, which identify --save and steady --save"
    " write as well."
)
_CAPTION = (
    "Solid where stable, dashed where not, dotted beyond the amplitudes of the data, with the 95 %"
    " band where there is one. At a fold a sweep jumps."
)
_QUICK = 0.05  # of the frequency: a jump so late is not near its fold
_TOO_QUICK = (
    "So quick a sweep does not follow the response: where it jumps is no more than a guess."
)
_AT_END = "That is at an end of the range: a wider --frequency shows more."
_UNTRACED = re.compile(
    r"start (there|at the other end), frequency=\([^)]*\)(, or go on beyond it)?"
)
_HEADINGS = {
    "What is foretold": "--force --frequency --sweep-rate --amplitude",
    "Output": "--full --report --interactive --json --csv --figure --overwrite",
}


def _force(_: click.Context, __: click.Parameter, value: str | None) -> Any:
    """A positive number, or one for each of several coordinates."""
    if value is None:
        return None
    try:
        forces = tuple(map(float, value.split(",")))
    except ValueError:
        forces = ()
    several = len(forces) > 1 and any(forces)
    if not (forces and np.all(np.isfinite(forces)) and (several or forces[0] > 0)):
        more = f"; {OVERWRITES}" if value.startswith("--") else ""
        raise click.BadParameter(
            f"{value!r} is no positive number, such as 0.2, nor one for each coordinate, such as"
            f" 0.2,0{more}"
        )
    return forces if len(forces) > 1 else forces[0]


class Foretold(NamedTuple):
    """What an equation does, as it is printed, drawn and written."""

    title: str
    columns: Mapping[str, Sequence[Any]]  # by name and unit; None where nothing is known
    few: Sequence[int]  # rows that are printed without --full
    sentences: Sequence[str]
    picture: Picture
    facts: Mapping[str, Any]  # more of them, for JSON

    def table(self, rows: Iterable[int] | None = None) -> TextTable:
        """All of it, or some rows, without columns of which nothing is known."""
        known = {n: x for n, x in self.columns.items() if any(v is not None for v in x)}
        every = range(len(self.columns[next(iter(known))])) if rows is None else rows
        body = [[_cell(name, values[i]) for name, values in known.items()] for i in every]
        return TextTable(self.title, [[*known], *body])

    def csv(self) -> str:
        """The same with all digits."""
        rows = zip(*self.columns.values(), strict=True)
        lines = [",".join("" if x is None else _text(x, 9) for x in row) for row in rows]
        return "\n".join([",".join(self.columns), *lines])


def _cell(name: str, value: Any) -> str:
    digits = 6 if name.startswith("frequency") or name.endswith("[Hz]") else 4
    return "-" if value is None else _text(value, digits)


def _text(value: Any, digits: int) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else f"{value:.{digits}g}"


@click.command(cls=WritingCommand, headings=_HEADINGS)
@click.argument(
    "file", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="FOUND"
)
@click.option(
    "--force",
    callback=_force,
    metavar="FORCE",
    help="Amplitude of a harmonic force, or of the acceleration of a base, in the unit of the test;"
    " per unit mass where that had none. Of several coordinates without an input one for each,"
    " such as 0.2,0.  [default: none: the backbone is foretold]",
)
@click.option(
    "--frequency",
    callback=span("20:30"),
    metavar="LOW:HIGH",
    help="Range of the response to --force, Hz.  [default: that of the test, or round the"
    " resonance]",
)
@click.option(
    "--sweep-rate",
    type=click.FloatRange(min=0, min_open=True),
    metavar="HZ/S",
    help="At which the frequency of --force rises, and falls: a sweep jumps late.  [default: slow"
    " sweeps]",
)
@click.option(
    "--amplitude",
    callback=span("0.001:0.01"),
    metavar="LOW:HIGH",
    help="Range of a backbone, in the unit of q.  [default: up to the largest of the data]",
)
@full_option
@click.option("--report", type=Output(PAGE), help="Name of the HTML page.")
@interactive_option
@click.option(
    "--json",
    "json_file",
    type=Output(JSON, allow_dash=True),
    help="Write the numbers to this file; - prints them, and words on the error stream.",
)
@click.option("--csv", "csv_file", type=Output(_MARK), help="Write the table.")
@click.option(
    "--figure",
    type=Output(_FIGURE, kinds=(".png", ".svg", ".pdf")),
    help="Write the figure to this PNG, SVG or PDF file.",
)
def predict(
    file: Path,
    force: float | tuple[float, ...] | None,
    frequency: tuple[float, float] | None,
    sweep_rate: float | None,
    amplitude: tuple[float, float] | None,
    full: bool,
    report: Path | None,
    interactive: bool,
    json_file: Path | None,
    csv_file: Path | None,
    figure: Path | None,
) -> None:
    """Foretell what the equation in FOUND does under a harmonic force, or its backbone.

    FOUND is what identify --save or steady --save wrote; of a model alone, as identify --model
    writes it, there are no bands. With --force come amplitude and phase at every frequency, with
    95 % bands, which responses are stable, and at which frequencies a sweep jumps. Without it come
    frequency and damping ratio of free vibrations against their amplitude.
    """
    for option, given in (("--frequency", frequency), ("--sweep-rate", sweep_rate)):
        if force is None and given is not None:
            raise click.UsageError(f"{option} is for the response to a --force: give both, or none")
    if force is not None:
        refuse_beside("force", "a backbone", {"amplitude": "the force says how large it is"})
    alone = str(json_file) == "-"
    page = report or default_page(f"{file.stem}_predicted.html")
    with named(f"{file}"), bar(None, "predicting"):
        found, model = _read(file)
        if force is None:
            foretold = _backbones(found, model, amplitude)
        else:
            foretold = _forced(found, model, force, frequency, sweep_rate)
    with writing(page):
        write_page(
            page,
            "report",
            "predict",
            title=f"{file.name}: {foretold.title[0].lower()}{foretold.title[1:]}",
            sentence="\n".join(foretold.sentences),
            equation_title="The equation",
            equation=model.equation(),
            formulas=model.formulas(),
            tables=[foretold.table()],
            pictures=[foretold.picture],
            interactive=interactive,
            notes_title="What is known of it",
            notes=[] if found is None else [str(found.verdict), *found.remarks()],
        )
    written = [told("Report", page)]
    if csv_file is not None:
        write_text(csv_file, foretold.csv())
        written.append(told("Table", csv_file))
    if figure is not None:
        with writing(figure):
            foretold.picture.write(figure)
        written.append(told("Figure", figure))
    if json_file is not None:
        content = {"file": str(file), **foretold.facts, "columns": foretold.columns}
        write_json(json_file, json_text(content | {"notes": foretold.sentences}))
    words = [as_text(foretold.table(None if full else foretold.few)), *foretold.sentences]
    click.echo("\n".join([*words, *written]), err=alone)


def _read(file: Path) -> tuple[Estimate | None, Equations]:
    """What is known of a model, and the model.

    Raises a ValueError if there is none in the file.
    """
    text = text_of(file)
    try:
        found = estimate_of(text)
        return found, model_of(text) if found is None else found.model
    except ValueError as error:
        raise ValueError(
            f"{error}; FOUND is what identify --save or steady --save wrote"
        ) from error


def _plain(value: Any) -> Any:
    """A number; None where there is none."""
    return value if isinstance(value, bool) else float(value) if np.isfinite(value) else None


def _some(count: int) -> list[int]:
    """Places among so many rows."""
    places: list[int] = np.linspace(0, count - 1, min(_FEW, count)).astype(int).tolist()
    return places


# -- under a harmonic force ------------------------------------------------------------------------


def _excitation(found: Estimate | None, model: Equations) -> tuple[str, str, str]:
    """What moves the structure, its unit, and what must be known of that."""
    if isinstance(found, SteadyEstimate):
        unit = found.test.unit
        what = "force" if unit is None or force_unit(unit) else "measured excitation"  # a base
        return what, unit or "(unit of the test)", ""
    for term in inputs_of(model):
        base = is_base(term.source)
        named_unit = term.input_unit or (f"{model.unit}/s^2" if base else "(unit of the input)")
        return "base acceleration" if base else "force", named_unit, ""
    turns = model.unit in ("rad", "deg")
    what = "moment per moment of inertia" if turns else "force per unit mass"
    remark = f"The file knows no mass: --force is a {what}, that of the mode."
    if found is not None and isinstance(found.verdict, SteadyAdequacy):
        remark = (
            f"The file knows no gain: --force is a {what}; written again by romsindy steady --save,"
            " it takes the force of the test."
        )
    return what, f"{model.unit or '[q]'}/s^2", remark


def _forced(
    found: Estimate | None,
    model: Equations,
    force: float | tuple[float, ...],
    asked: tuple[float, float] | None,
    sweep_rate: float | None,
) -> Foretold:
    """The response, with its band where it is known.

    Raises a ValueError if none is found in the range, or the forces are not for the model.
    """
    wanted = 1 if inputs_of(model) else model.n_coordinates
    if np.size(force) != wanted:
        remedy = "one" if wanted == 1 else "one for each coordinate, 0 where none acts"
        raise ValueError(f"--force has {np.size(force)} of {wanted} numbers: give {remedy}")
    what, unit, remark = _excitation(found, model)
    title = f"{what} of {', '.join(f'{f:g}' for f in np.atleast_1d(force))} {unit}"
    low, high = np.multiply(asked, _HERTZ).tolist() if asked else _usual(found, model)
    scale = _smoothing(model, float(np.max(np.abs(force))))
    response = _followed(found or model, force, (low, high), scale, title)
    band = response if isinstance(response, ForcedBand) else None
    orbits = response.response if isinstance(response, ForcedBand) else response
    inside = np.delete(orbits.frequency, orbits.folds)  # where two responses are one
    inside = inside[(inside > low) & (inside < high)]
    at = np.unique([low, high, *inside, *([] if band is None else band.peak[:1])])
    states = response.steady_states(at)
    top = max(states, key=lambda state: float(state.amplitude.max()))
    if band is not None and not model.numbered:
        low_most, high_most = np.atleast_1d(*band.peak_band)
        top = top._replace(low=low_most, high=high_most)
    folds = orbits.jumps if band is None else band.folds
    turns = [fold for fold in folds if low <= fold.frequency <= high]
    late = _late(model, response, folds, sweep_rate) if sweep_rate and turns else {}
    late = {fold: jump for fold, jump in late.items() if fold in turns}
    quick = any(abs(jump.frequency / fold.frequency - 1) > _QUICK for fold, jump in late.items())
    shown = "amplitude" if band is None else str(QUANTITIES[band.rate])
    unit_shown = response.unit or "unit of q"
    lines = [
        _largest(top, unit_shown),
        _AT_END if top.frequency in (low, high) else "",
        "A sweep jumps nowhere in this range." if sweep_rate and not turns else "",
        *([] if late else map(_jump, turns)),
        *(_jump(jump, f" at {sweep_rate:g} Hz/s") for jump in late.values()),
        _TOO_QUICK if quick else "",
        remark,
        f"Dry friction is made smooth below {scale:.3g} {model.unit or '[q]'}/s." if scale else "",
        _ALONE if found is None else "",
        *map(_note, (orbits.leaves, orbits.untraced) if band is None else band.notes),
    ]
    chosen = {*at[_some(len(at))].tolist(), top.frequency}
    draw = partial(draw_response, response, f"{title.split(' of ')[-1]},", (low, high))
    facts: dict[str, Any] = {"excitation": what, "size": force, "unit": unit}
    facts |= {"folds": [*map(_in_hertz, turns)]}
    facts |= (
        {"sweep_rate": sweep_rate, "jumps": [*map(_in_hertz, late.values())]} if sweep_rate else {}
    )
    return Foretold(
        f"Response to a {title}, {'half peak to peak' if band is None else 'first harmonic'}",
        _columns(states, shown, unit_shown, model),
        [i for i, state in enumerate(states) if state.frequency in chosen],
        [line for line in lines if line],
        Picture("predicted", "Response", _CAPTION, draw),
        facts,
    )


def _followed(
    source: Any,
    force: float | tuple[float, ...],
    span: tuple[float, float],
    scale: float | None,
    title: str,
) -> ForcedResponse | ForcedBand:
    """The response of a model, or that of an estimate with its band.

    Raises a ValueError if there is none.
    """
    try:
        with warnings.catch_warnings():  # what leaves the data is told by notes
            warnings.simplefilter("ignore", UserWarning)
            found: Any = forced_response(source, force, span, velocity_scale=scale)
    except ContinuationError as error:
        raise ValueError(
            f"no response to a {title} is found from {span[0] / _HERTZ:.5g} to"
            f" {span[1] / _HERTZ:.5g} Hz: give a smaller --force, or another --frequency"
        ) from error
    return found


def _usual(found: Estimate | None, model: Equations) -> tuple[float, float]:
    """Range of frequencies where none is asked for, rad/s: of the points, or round resonances."""
    if isinstance(found, SteadyEstimate):
        return float(found.test.frequencies[0]), float(found.test.frequencies[1])
    omega = model.linear_modes[0]
    if not model.numbered and model.amplitude_range is not None:
        omega = curves_near(model, np.linspace(*_data(model), _CURVE), 1)(model)[0]
    return (1 - _AROUND) * float(np.nanmin(omega)), (1 + _AROUND) * float(np.nanmax(omega))


def _smoothing(model: Equations, force: float) -> float | None:
    """Velocity below which forces that jump are made smooth; None where none does."""
    if all(term.smooth for term in model.terms):
        return None
    if model.amplitude_range is not None:
        return _SMOOTH * float(model.linear_modes[0].max()) * model.amplitude_range[1]
    loss = 2 * model.linear_modes[0] * np.clip(model.linear_damping_ratios, *_LOSSES)
    return _SMOOTH * force / float(loss.min())  # of a linear resonance


def _columns(
    states: Sequence[SteadyState], shown: str, unit: str, model: Equations
) -> dict[str, Sequence[Any]]:
    columns: dict[str, Sequence[Any]] = {"frequency [Hz]": [s.frequency / _HERTZ for s in states]}
    for i, q in enumerate(model.coordinates):
        end = f" {q}" if model.numbered else ""
        columns |= {
            f"{shown}{end} [{unit}]": [_plain(s.amplitude[i]) for s in states],
            f"low{end} [{unit}]": [_plain(s.low[i]) for s in states],
            f"high{end} [{unit}]": [_plain(s.high[i]) for s in states],
            f"phase{end} [deg]": [_plain(round(np.degrees(s.phase[i]), 2)) for s in states],
        }
    return columns | {"stable": [s.stable for s in states]}


def _between(low: float, high: float, digits: int) -> str:
    return "" if np.isnan(low) else f" ({low:.{digits}g} to {high:.{digits}g})"


def _largest(state: SteadyState, unit: str) -> str:
    ends = zip(state.amplitude, state.low, state.high, strict=True)
    size = " and ".join(f"{a:.4g} {unit}{_between(low, high, 4)}" for a, low, high in ends)
    return f"Largest: {size} at {state.frequency / _HERTZ:.6g} Hz."


def _late(
    model: Equations,
    response: ForcedResponse | ForcedBand,
    folds: Sequence[Fold],
    sweep_rate: float,
) -> dict[Fold, Fold]:
    """By fold, where sweeps at a rate, Hz/s, jump: up at some, down at the others."""
    found: dict[Fold, Fold] = {}
    for rate in (sweep_rate * _HERTZ, -sweep_rate * _HERTZ):
        if isinstance(response, ForcedBand):
            several = response.jumps(rate)
        else:
            w = response.frequency
            late = jumps(model, response, rate)
            several = tuple(Fold(float(w[x.fold]) + x.delay, rate > 0) for x in late)
        found |= dict(
            zip((fold for fold in folds if fold.rising == (rate > 0)), several, strict=True)
        )
    return found


def _in_hertz(fold: Fold) -> dict[str, Any]:
    angular = {n: _plain(getattr(fold, n) / _HERTZ) for n in ("frequency", "low", "high")}
    return fold._asdict() | angular


def _jump(fold: Fold, rate: str = "") -> str:
    known = _in_hertz(fold)
    ends = "" if known["low"] is None else _between(known["low"], known["high"], 6)
    way = "rising" if fold.rising else "falling"
    return f"A sweep of {way} frequency{rate} jumps at {known['frequency']:.6g} Hz{ends}."


def _note(note: str) -> str:
    return f"Note: {_UNTRACED.sub('give a wider --frequency', note)}." if note else ""


# -- without a force -------------------------------------------------------------------------------


def _data(model: Equations) -> tuple[float, float]:
    """Amplitudes of the data, from small ones on.

    Raises a ValueError if the model does not state them.
    """
    if model.amplitude_range is None:
        raise ValueError(
            "the file does not state the amplitudes of its data: give --amplitude, such as"
            " 0.001:0.01, or in the file amplitude_range"
        )
    least, most = model.amplitude_range
    return max(least, _LOW * most), most


def _backbones(
    found: Estimate | None, model: Equations, asked: tuple[float, float] | None
) -> Foretold:
    """Frequency and damping ratio of each mode against amplitude, with bands where they are known.

    Raises a ValueError if no mode has periodic motion there.
    """
    sizes = np.linspace(*(asked or _data(model)), _CURVE)
    bands: dict[int, Band] = {}
    lines = []
    for mode in range(1, model.n_coordinates + 1):
        try:
            bands[mode] = _band(found, model, sizes, mode)
        except ContinuationError as error:
            lines.append(f"Mode {mode} has no backbone: {error}.")
    unit = model.unit or "unit of q"
    rows = [(mode, band, i) for mode, band in bands.items() for i in range(_CURVE)]
    if not any(np.isfinite(band.frequency[i]) for _, band, i in rows):
        raise ValueError(
            f"the equation has no periodic motion from {sizes[0]:.4g} to {sizes[-1]:.4g} {unit}:"
            " give smaller ones, --amplitude"
        )
    columns: dict[str, Sequence[Any]] = {"mode": [m for m, *_ in rows]} if model.numbered else {}
    columns |= {f"amplitude [{unit}]": [float(b.amplitude[i]) for _, b, i in rows]}
    for name, label, unit_of_it, size in (
        ("frequency", "frequency", "Hz", _HERTZ),
        ("damping_ratio", "damping ratio", "%", 0.01),
    ):
        values = np.array([getattr(b, name)[i] for _, b, i in rows]) / size
        half = SIGMAS * np.array([getattr(b, f"{name}_std")[i] for _, b, i in rows]) / size
        columns |= {
            f"{label} [{unit_of_it}]": [*map(_plain, values)],
            f"low [{unit_of_it}]": [*map(_plain, values - half)],
            f"high [{unit_of_it}]": [*map(_plain, values + half)],
        }
    most = (model.amplitude_range or (0.0, np.inf))[1]
    if sizes[-1] > _ALIKE * most:
        lines.append(
            f"Beyond {most:.4g} {unit} nothing was measured: bands hold there if these terms do."
        )
    if any(np.isnan(b.frequency).any() for b in bands.values()):
        lines.append("Where there is no frequency the equation has no periodic motion.")
    lines += [_ALONE] if found is None else []
    caption = "Undamped free vibrations, and damping ratio, with 95 % bands where they are known."
    few, draw = _some(_CURVE), partial(draw_bands, bands)
    return Foretold(
        "Free vibrations against amplitude",
        columns,
        [i for i in range(len(rows)) if i % _CURVE in few],
        lines,
        Picture("predicted", "Backbone and damping", caption, draw, (6.4 * len(bands), 6.0)),
        {"unit": unit},
    )


def _band(found: Estimate | None, model: Equations, sizes: Array, mode: int) -> Band:
    if found is not None:
        return found.band(sizes, mode)
    (frequency, ratio), unknown = (
        curves_near(model, sizes, mode)(model),
        np.full(len(sizes), np.nan),
    )
    return Band(sizes, frequency, ratio, unknown, unknown, model.unit)
