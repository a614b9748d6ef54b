"""The command ``romsindy identify``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import click

from romsindy.commands.analysis import USUAL_DAMPING, USUAL_ORDER, Settings, analysed
from romsindy.commands.coupled import (
    Coordinates,
    CoupledResult,
    coordinates_of,
    identified_together,
    refuse_others,
)
from romsindy.commands.forced import Driven, ForcedResult, forced_options, identified_driven
from romsindy.commands.main import INTERRUPTED, REFUSED
from romsindy.commands.options import (
    FILE,
    INPUTS,
    READING,
    full_option,
    interactive_option,
    read,
    reading_options,
)
from romsindy.commands.outputs import (
    JSON,
    PAGE,
    Output,
    WritingCommand,
    default_page,
    stopped,
    write_json,
    writing,
)
from romsindy.commands.results import Refusal, Result
from romsindy.commands.telling import AnyResult, tell_all, tell_one
from romsindy.fit.verdict import CURVATURE
from romsindy.inspection.inspect import inspect
from romsindy.inspection.inspection import Inspection
from romsindy.inspection.page import picture
from romsindy.inspection.tables import picked
from romsindy.physics.damping import DAMPING
from romsindy.physics.example import example_decay
from romsindy.physics.serial import json_text
from romsindy.record.recording import Recording
from romsindy.show.identification_page import pictures, write_identification
from romsindy.text import as_options, bar

_FIGURE = "romsindy backbone"  # what the file says of itself
_ALONE = "identify this file by itself, with a --report of its own"


def _coefficients(
    _: click.Context, __: click.Parameter, values: tuple[str, ...]
) -> dict[str, float]:
    fixed = {}
    for value in values:
        name, _sep, number = value.partition("=")
        try:
            fixed[name.strip()] = float(number)
        except ValueError:
            raise click.BadParameter(
                f"{value!r} is not NAME=NUMBER, such as omega^2=1482.2"
            ) from None
    return fixed


def _harmonics(_: click.Context, __: click.Parameter, value: str | None) -> tuple[int, ...] | None:
    if value is None:
        return None
    low, dash, high = value.partition("-")
    try:
        chosen = range(int(low), int(high) + 1) if dash else map(int, value.split(","))
        harmonics = tuple(chosen)
    except ValueError:
        harmonics = ()
    if not harmonics:
        raise click.BadParameter(
            f"{value!r} is neither a range such as 0-3 nor a list such as 1,2,3"
        )
    return harmonics


_HEADINGS = {
    "Reading": f"{READING} --example",
    "What is looked for": "--mode --band --release --coordinates --fix --curvature --seed",
    "Measured inputs": f"{INPUTS} --select --held-out",
    "Regressions": "--plain --weighted --order --damping --harmonics --amplitude --cutoff",
    "Output": "--full --report --interactive --json --model --save --figure --force",
}


@click.command(cls=WritingCommand, headings=_HEADINGS)
@click.argument("files", nargs=-1, type=FILE, metavar="FILES...")
@click.option("--example", is_flag=True, help="Use a decay made on the spot instead of a file.")
@click.option(
    "--seed",
    default=0,
    show_default=True,
    help="Seed of the draws behind the bands, and of the example's noise.",
)
@reading_options
@forced_options
@click.option("--mode", type=int, help="Number of the mode, see inspect.  [default: moves most]")
@click.option("--band", nargs=2, type=float, help="Lowest and highest frequency of the mode, Hz.")
@click.option(
    "--coordinates",
    callback=coordinates_of,
    metavar="auto|N",
    help="Model so many vibrations together, or as many as the data need.  [default: 1]",
)
@click.option("--release", type=int, help="Number of the release, see inspect.  [default: all]")
@click.option(
    "--order",
    default=USUAL_ORDER,
    show_default=True,
    help="Highest order of stiffness and inertia in regressions and with --input; the"
    " identification of decays finds its own.",
)
@click.option(
    "--damping",
    multiple=True,
    default=USUAL_DAMPING,
    show_default=True,
    type=click.Choice(list(DAMPING)),
    help="Kind of damping in regressions and with --input; may be repeated.",
)
@click.option(
    "--fix",
    multiple=True,
    callback=_coefficients,
    metavar="NAME=VALUE",
    help="Known coefficient in SI units; may be repeated. Regressions with fixed linear"
    " frequency take omega^2 from here, or else from the measured backbone.",
)
@click.option(
    "--harmonics",
    callback=_harmonics,
    help="Harmonics of each cycle in regressions.  [default: 0-5, weighted 0-3]",
)
@click.option(
    "--amplitude",
    nargs=2,
    type=float,
    help="Least and largest amplitude of the cycles that are used.",
)
@click.option(
    "--cutoff",
    type=float,
    help="Cut-off of the low-pass before regressions, Hz.  [default: ten times the fundamental]",
)
@click.option(
    "--plain",
    is_flag=True,
    help="The regression of the method's paper instead: two models, linear frequency estimated and"
    " fixed, no error bars.",
)
@click.option(
    "--weighted",
    is_flag=True,
    help="As --plain, with rows weighted by the noise expected in them.",
)
@click.option(
    "--curvature",
    default=CURVATURE,
    show_default=True,
    help="How far the sensor may be off a straight line at the largest amplitude, as a part of it"
    " (one standard deviation); 0 of one that is straight.",
)
@full_option
@click.option("--report", type=Output(PAGE), help="Name of the HTML report, or of the overview.")
@interactive_option
@click.option(
    "--json", "json_file", type=Output(JSON, allow_dash=True), help="Write a list of results."
)
@click.option("--model", type=Output(JSON), help="Write the equation as JSON.")
@click.option(
    "--save", type=Output(JSON), help="Write all that was identified, bands included, as JSON."
)
@click.option(
    "--figure",
    type=Output(_FIGURE, kinds=(".png", ".svg", ".pdf")),
    help="Write the backbone figure to this PNG, SVG or PDF file.",
)
def identify(
    files: tuple[Path, ...],
    example: bool,
    mode: int | None,
    band: tuple[float, float] | None,
    coordinates: Coordinates | None,
    release: int | None,
    report: Path | None,
    interactive: bool,
    full: bool,
    json_file: Path | None,
    model: Path | None,
    save: Path | None,
    figure: Path | None,
    **options: Any,
) -> None:
    """Identify equations of motion from the free or driven vibrations in FILES.

    Of a free decay the mode that moves most is isolated, in all releases in which it rings, and its
    equation is printed in short, with 95 % bands, how sure it is and what is wrong with it. With
    --input the whole record is fitted. Functions with bands, coefficients beside those of plain
    regressions and figures are on one HTML page, the tables also printed with --full; of many files
    a table, one page for all, and one for each. An interruption (Ctrl-C) keeps what is done.
    """
    settings = Settings(**{f.name: options.pop(f.name) for f in fields(Settings)})
    driven = Driven(**{f.name: options.pop(f.name) for f in fields(Driven)})
    driven.refuse()
    files = tuple(dict.fromkeys(files))
    many = len(files) > 1
    if example == bool(files):
        raise click.UsageError("name one FILE, or ask for --example")
    if coordinates is not None:
        refuse_others()
    if settings.plain and settings.weighted:
        raise click.UsageError("--plain and --weighted are two regressions: ask for one")
    if save is not None and (settings.plain or settings.weighted):
        raise click.UsageError("--save needs the bands, which no regression has: use --model")
    if many and (model or save or figure):
        raise click.UsageError("--model, --save and --figure hold one result: name one FILE")
    one: Callable[..., AnyResult] = partial(_identified, choice=(mode, band, release))
    if coordinates is not None:
        one = partial(_together, coordinates=coordinates, release=release)
    if driven.inputs:
        one = partial(_driven, driven=driven)
    identified = partial(one, options=options, settings=settings, interactive=interactive)
    # With JSON on the standard output, words go to the other one.
    say = partial(click.echo, err=str(json_file) == "-")
    if many:
        overview = report or default_page("identify_overview.html")
        pages = [default_page(name, _ALONE) for name in _page_names(files)]
        jobs = {str(f): partial(identified, f, page) for f, page in zip(files, pages, strict=True)}
        results, interrupted = _all_of(jobs)
        tell = partial(tell_all, results, overview, interactive, say)
    else:
        file = files[0] if files else None
        page = report or default_page(f"{file.stem if file else 'example'}_report.html")
        result = identified(file, page)
        results, interrupted = [result], result.interrupted
        tell = partial(tell_one, result, say, model, save, figure, full)
    if json_file is not None:
        write_json(json_file, json_text([r.content() for r in results]))
    tell()
    if interrupted or any(isinstance(r, Refusal) for r in results):
        raise click.exceptions.Exit(INTERRUPTED if interrupted else REFUSED)


def _identified(
    file: Path | None,
    page: Path,
    options: Mapping[str, Any],
    choice: tuple[int | None, tuple[float, float] | None, int | None],
    settings: Settings,
    interactive: bool,
) -> Result:
    """Identify one file, or the example, and write its page."""
    title, found = _inspected(file, options, settings.seed)
    try:
        mode = found.mode(*choice[:2])
        releases = found.rings_in(mode, choice[2])
    except ValueError as error:
        # What is wrong with samples is no news for a choice that does not exist.
        raise _of(file, error, found.warnings if choice == (None, None, None) else ()) from error
    try:
        decays = found.decays(mode.number, release=choice[2])
        report = analysed(title, decays, settings, picked(found, mode, releases))
    except ValueError as error:
        raise _of(file, error, found.warnings) from error
    except KeyboardInterrupt as error:
        reached = picked(found, mode, releases).rstrip(".")
        raise KeyboardInterrupt(f"{error}, after the inspection. {reached}") from None
    figures = pictures(report)
    if len(found.modes) > 1 or len(found.releases) > 1:
        figures.append(picture(found))
    with writing(page):
        write_identification(report, page, bar(figures, "drawing"), interactive=interactive)
    numbers = tuple(i + 1 for i in releases)
    return Result(str(file or "example"), report, found, mode, numbers, page)


def _together(
    file: Path | None,
    page: Path,
    options: Mapping[str, Any],
    coordinates: Coordinates,
    release: int | None,
    settings: Settings,
    interactive: bool,
) -> CoupledResult:
    """The same with several coordinates."""
    title, found = _inspected(file, options, settings.seed)
    names = (str(file or "example"), title)
    try:
        return identified_together(names, found, coordinates, release, page, interactive)
    except ValueError as error:
        raise _of(file, error, found.warnings if release is None else ()) from error


def _driven(
    file: Path,
    page: Path,
    options: Mapping[str, Any],
    driven: Driven,
    settings: Settings,
    interactive: bool,
) -> ForcedResult:
    """The same of a record with inputs."""
    vibration = driven.load(file, options)
    model = settings.order, settings.damping
    try:
        return identified_driven(file, vibration, driven, model, page, interactive)
    except ValueError as error:
        raise _of(file, error, ()) from error


def _inspected(file: Path | None, options: Mapping[str, Any], seed: int) -> tuple[str, Inspection]:
    """Title of a file, or of the example, and what is in it."""
    title = f"Free decay {file.name}" if file else "Example: synthetic decay, 35 dB"
    with bar(None, "inspecting") as steps:
        record = _chosen(file, options) if file else example_decay(35.0, seed)
        return title, inspect(record, progress=steps.set_postfix_str)


def _of(file: Path | None, error: ValueError, warnings: Sequence[str]) -> ValueError:
    """The same error with the name of the file, and what is wrong with its samples."""
    sentence = str(error).removeprefix(f"{file}: ")
    return ValueError("; ".join([f"{file or 'example'}: {sentence}", *warnings]))


def _chosen(file: Path, options: Mapping[str, Any]) -> Recording:
    """What is in a file, where it is clear which column is meant."""
    recording = read(file, options)
    names = list(recording.names)
    if len(names) > 1 and not options["column"]:
        raise ValueError(
            f"{file}: {len(names)} columns could be the measured one, {names}: choose with column="
        )
    return recording


def _all_of(jobs: Mapping[str, Callable[[], AnyResult]]) -> tuple[list[AnyResult | Refusal], bool]:
    """Results of all files, and whether they were interrupted: what is done is kept."""
    results: list[AnyResult | Refusal] = []
    for file, job in bar(jobs.items(), "files"):
        try:
            result = job()
        except (ValueError, OSError, RuntimeError) as error:
            results.append(Refusal(file, as_options(str(error))))
        except KeyboardInterrupt as error:
            results.append(Refusal(file, f"{file}: interrupted {error}"))
            return results, True
        else:
            results.append(result)
            if result.interrupted or stopped():
                return results, True
    return results, False


def _page_names(files: Sequence[Path]) -> list[str]:
    """Names of the reports: the folder is a part of those that would be the same otherwise."""
    stems = Counter(f.stem for f in files)
    names = [f.stem if stems[f.stem] == 1 else "_".join(f.parts[-2:]) for f in files]
    return [f"{name}_report.html" for name in names]
