"""What came of a file: numbers, tables, words; and what is printed and written of one or many."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, fields
from functools import partial
from itertools import starmap
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from joblib import Parallel, delayed

from romsindy.commands.main import INTERRUPTED, REFUSED
from romsindy.commands.options import full_option, grouped, interactive_option
from romsindy.commands.outputs import (
    JSON,
    PAGE,
    Output,
    apart,
    default_page,
    lose,
    stopped,
    told,
    write_json,
    writing,
)
from romsindy.fit.results.estimate import Band, Estimate
from romsindy.orbits.curves import BackboneCurve
from romsindy.physics.equations import Equations
from romsindy.physics.term_sum import json_text
from romsindy.show.identified import Identified, coefficients, few_tables, more_tables
from romsindy.show.page import Picture, write_overview
from romsindy.show.panels import pictures, write_result
from romsindy.text import aligned, as_options, as_text, bar, with_error

_LOW = 0.1  # of the largest amplitude of the data: there the linear frequency is read
_FEW = 8  # rows of a table that is printed without --full
_WORDS = {True: "yes", False: "no", None: "not refined"}
HEADER = ["file", "mode", "frequency [Hz]", "+-", "damping ratio [%]", "+-"]
HEADER += ["structure", "explained", "report"]


@dataclass(frozen=True)
class Refused:
    """A file of which nothing came, and why, in a sentence."""

    file: str
    sentence: str

    def content(self) -> dict[str, Any]:
        """As of a `Result`."""
        return {"file": self.file, "error": self.sentence}

    def rows(self) -> list[list[str]]:
        """As of a `Result`."""
        return [[self.file, *["-"] * (len(HEADER) - 3), "refused", "-"]]


class Small(NamedTuple):
    """A small vibration: Hz, and damping ratio, with standard errors, nan where not known."""

    mode: str
    frequency: float
    frequency_std: float
    damping_ratio: float
    damping_ratio_std: float

    @classmethod
    def of(cls, mode: str, band: Band) -> Small:
        """That at the first amplitude of a band."""
        turn, ratio, error = 2 * np.pi, band.damping_ratio[0], band.damping_ratio_std[0]
        hertz, off = float(band.frequency[0]) / turn, float(band.frequency_std[0]) / turn
        return cls(mode, hertz, off, float(ratio), float(error))

    def cells(self) -> list[str]:
        """Of the table."""
        ratio = _cells(100 * self.damping_ratio, 100 * self.damping_ratio_std)
        return [self.mode, *_cells(self.frequency, self.frequency_std), *ratio]


@dataclass(frozen=True, eq=False)
class Result:
    """What came of one file, however that was done."""

    file: str
    page: Path
    report: Identified
    pictures: Sequence[Picture]  # figures of its page
    # What else is known of the record, by name, frequencies in Hz, the rest in SI units
    facts: Mapping[str, Any]
    step: str  # what comes next

    @classmethod
    def written(
        cls,
        file: Path | None,
        page: Path,
        report: Identified,
        interactive: bool,
        more: Sequence[Picture] = (),
        *,
        facts: Mapping[str, Any],
        step: str,
    ) -> Result:
        """Draw a report on its page, with ``more`` figures."""
        figures = [*pictures(report), *more]
        command = str(click.get_current_context().info_name)
        drawn = bar(figures, "drawing")
        with writing(page):
            write_result(report, page, drawn, interactive=interactive, command=command)
        return cls(str(file or "example"), page, report, figures, facts, step)

    @property
    def found(self) -> Estimate | None:
        """All that was identified; None after regressions."""
        return self.report.found

    @property
    def model(self) -> Equations:
        """The equation that is printed."""
        return self.report.model

    @property
    def explained(self) -> bool | None:
        """Whether the equation leaves noise alone; None where that was not tested."""
        return None if self.found is None else bool(self.found.verdict.explained)

    def content(self) -> dict[str, Any]:
        """All numbers by name."""
        found = self.found
        errors = {} if found is None else found.standard_errors
        return {
            "file": self.file,
            **self.facts,
            **self._of_cycles(),
            **self._of_modes(),
            **self._of_inputs(),
            **self._of_points(),
            "unit": self.model.unit,
            "explained": self.explained,
            "verdict": self.report.trouble if found is None else str(found.verdict),
            "equation": self.model.equation(),
            "coefficients": {
                term.key: {
                    "value": value,
                    "standard_error": errors.get(term.key),
                    "unit": term.unit(self.model.unit),
                }
                for term, value in self.model.pairs
            },
            "notes": [*(() if found is None else found.notes), *self.report.notes()],
            "report": str(self.page),
        }

    def _of_cycles(self) -> dict[str, Any]:
        r = self.report
        if r.beside is None:
            return {}
        b, (small,) = r.beside.backbone, self.small
        per_cycle = {"amplitude": 1.0, "frequency": 2 * np.pi, "damping_ratio": 1.0}
        linear = {name: value for name, value in small._asdict().items() if name != "mode"}
        return {
            "linear": {"amplitude": _LOW * float(b.amplitude.max()), **linear},
            "structure": str(r.series.structure) if r.series else None,
            "damping": r.series.damping._asdict() if r.series and r.series.damping else None,
            "backbone": {
                name + end: getattr(b, name + end) / unit
                for name, unit in per_cycle.items()
                for end in ("", "_std")
            },
        }

    def _of_modes(self) -> dict[str, Any]:
        r = self.report
        if not r.modes or r.fit is None:
            return {}
        shapes = zip(r.channels, r.fit.mode_shapes.tolist(), strict=True)
        return {
            "channels": r.channels,
            "coordinates": len(r.modes),
            "modes": [vars(m) | {"backbone": _curve(r.backbones[m.number])} for m in r.modes],
            "mode_shapes": dict(shapes),
        }

    def _of_inputs(self) -> dict[str, Any]:
        r = self.report
        if not r.inputs():
            return {}
        left, held = np.concatenate([x for _, x in r.compared]), r.held_out
        return {
            "inputs": r.inputs(),
            "residual": None if r.piece else float(np.sqrt(np.mean(left**2))),
            "held_out": held and {"start": held.vibration.t[0], "error": held.error},
        }

    def _of_points(self) -> dict[str, Any]:
        steady = self.report.steady
        if steady is None:
            return {}
        errors, chain = steady.chain_errors, vars(steady.chain)
        return {
            "points": len(steady.points),
            "excitation": {
                name: {"value": value, "standard_error": errors.get(name)}
                for name, value in chain.items()
            },
            "force_unit": self.report.force_unit,
            "unexplained": steady.unexplained,
        }

    @property
    def small(self) -> list[Small]:
        """Its small vibrations, one for each mode."""
        r, nan = self.report, float("nan")
        if r.modes:
            names = Small._fields[1:]
            return [Small(str(m.number), *(getattr(m, name) for name in names)) for m in r.modes]
        number = str(self.facts.get("mode", "-"))
        if r.steady is not None:
            return [Small.of(number, r.steady.band([r.steady.points.amplitude.min()]))]
        if r.beside is None:
            return [
                Small(number, nan, nan, nan, nan) if r.band is None else Small.of(number, r.band)
            ]
        amplitude = [_LOW * float(r.beside.backbone.amplitude.max())]
        if r.found is not None:
            return [Small.of(number, r.found.band(amplitude))]
        model = r.beside.main.model
        frequency, ratio = model.backbone(amplitude)[0], model.damping_ratio(amplitude)[0]
        return [Small(number, float(frequency) / (2 * np.pi), nan, float(ratio), nan)]

    @property
    def structure(self) -> str:
        """Of the model, in a word."""
        r = self.report
        if r.series is not None:
            return str(r.series.structure)
        words = {f"{len(r.modes)} coordinates": r.modes, "driven": r.inputs(), "steady": r.steady}
        return ", ".join(word for word, there in words.items() if there) or "-"

    def rows(self) -> list[list[str]]:
        """Its rows in the table."""
        end = [self.structure, _WORDS[self.explained], str(self.page)]
        return [[self.file, *vibration.cells(), *end] for vibration in self.small]

    def in_brief(self, room: int) -> list[str]:
        """What was found, how sure, what is doubtful, what next: so many lines at most."""
        r, series, beside = self.report, self.report.series, self.report.beside
        lines = r.equations() if series is None else series.in_short()
        later = [lines.pop()] if series is not None and series.short.follows else []
        lines = ["Interrupted: not the last word.", *lines] if r.interrupted else lines
        table = coefficients(r) if r.found is not None and not r.modes else None
        if table is not None and len(table.rows) <= _FEW:  # a longer one leaves a verdict no room
            lines += aligned(table.rows, "  ").splitlines()
        lines += [] if series is None else [" ".join(series.ends())]
        findings = r.findings(alone=True)
        if r.found is not None and beside is not None:
            later.append(findings.pop())
        lines += [*findings, *([r.picked] if r.picked else [])]
        for few in few_tables(r):
            rows = as_text(few._replace(note="")).splitlines()
            lines, later = (lines, later + rows) if r.steady else (lines + rows, later)
        doubts = beside.impossible() if beside is not None and r.found is None else r.remarks()
        lines += [*doubts, *later]
        shown = lines[: room - 1]
        shown = shown[:-1] if shown[-1].endswith(":") else shown  # a title of nothing
        left = len(lines) - len(shown)
        more = f" {left} more lines with --full, and on the page." if left else ""
        return [*shown, f"Next: {self.step}{more}"]

    def full(self) -> str:
        """All of it, tables included."""
        r, whole = self.report, [repr(record) for record in self.report.measured]
        if r.beside is not None:
            pairs = zip(r.beside.decays, r.beside.backbones, strict=True)
            whole = [f"{decay!r}\n{backbone!r}" for decay, backbone in pairs]
        parts = [r.picked, *(whole or r.notes()), str(r.found or r.model)]
        more = [*map(as_text, more_tables(r)), *r.findings()[0 if r.found is None else 1 :]]
        return "\n\n".join(filter(None, [*parts, *more])) + "\n"


def _curve(curve: BackboneCurve | str) -> dict[str, Any] | str:
    if isinstance(curve, str):
        return curve
    return {"frequency": curve.frequency / (2 * np.pi), "amplitude": curve.amplitude}


def _cells(value: float, error: float) -> list[str]:
    return with_error(value, error) if np.isfinite(error) else [f"{value:.5g}", "-"]


Job = Callable[[Path | None, Path], Result]

_LINES = 12  # that are read at once; the tables are on the page
_FIGURE = "romsindy backbone"  # what the file says of itself
SAVE = click.option(
    "--save", type=Output(JSON), help="Write all that was identified, bands included, as JSON."
)
FIGURE = click.option(
    "--figure",
    type=Output(_FIGURE, kinds=(".png", ".svg", ".pdf")),
    help="Write the backbone figure to this PNG, SVG or PDF file.",
)
# The options that say what is printed and written of results.
answer_options = grouped(
    full_option,
    click.option(
        "--report", type=Output(PAGE), help="Name of the HTML report, or of the overview."
    ),
    interactive_option,
    click.option(
        "--json", "json_file", type=Output(JSON, allow_dash=True), help="Write a list of results."
    ),
    click.option("--model", type=Output(JSON), help="Write the equation as JSON."),
)


@dataclass(frozen=True)
class Telling:
    """What is printed and written of results; see `romsindy identify --help`."""

    full: bool
    report: Path | None
    interactive: bool
    json_file: Path | None
    model: Path | None
    jobs: int = 1
    figure: Path | None = None
    save: Path | None = None

    @classmethod
    def taken(cls, options: dict[str, Any]) -> Telling:
        """What options say of it, which are taken out of them."""
        return cls(**{f.name: options.pop(f.name) for f in fields(cls) if f.name in options})

    def give(self, job: Job, files: Sequence[Path], example: bool, ending: str) -> None:
        """Do a job for every file, or for the example, print what came of it, and write it.

        The job takes a file, or None for the example, and the page that it writes, whose name has
        this ending; it gives a result.

        Raises a UsageError if there is no file, or options are for one, and an Exit if something
        was refused or interrupted.
        """
        files = tuple(dict.fromkeys(files))
        if example == bool(files):
            raise click.UsageError("name one FILE, or ask for --example")
        if len(files) > 1:
            results, interrupted, tell = self._of_many(job, files, ending)
        else:
            file = files[0] if files else None
            page = self.report or default_page(f"{file.stem if file else 'example'}_{ending}.html")
            result = job(file, page)
            results, interrupted = [result], result.report.interrupted
            tell = partial(self._tell_one, result)
        if self.json_file is not None:
            write_json(self.json_file, json_text([r.content() for r in results]))
        tell()
        if interrupted or any(isinstance(r, Refused) for r in results):
            raise click.exceptions.Exit(INTERRUPTED if interrupted else REFUSED)

    def _of_many(
        self, job: Job, files: Sequence[Path], ending: str
    ) -> tuple[Sequence[Result | Refused], bool, Callable[[], None]]:
        if self.model or self.save or self.figure:
            raise click.UsageError("--model, --save and --figure hold one result: name one FILE")
        command = click.get_current_context().info_name
        overview = self.report or default_page(f"{command}_overview.html")
        alone = f"{command} this file by itself, with a --report of its own"
        pages = [default_page(name, alone) for name in _page_names(files, ending)]
        jobs = {str(f): partial(job, f, page) for f, page in zip(files, pages, strict=True)}
        results, interrupted = _all_of(jobs, self.jobs)
        return results, interrupted, partial(self._tell_all, results, overview)

    def _say(self, lines: Sequence[str]) -> None:
        # With JSON on the standard output, words go to the other one.
        click.echo("\n".join(lines), err=str(self.json_file) == "-")

    def _tell_one(self, result: Result) -> None:
        """Print a result, in short or in full, and write what was asked for beside its page."""
        written = [told("Report", result.page)]
        # Files come first: who reads a pipe may stop.
        if self.model is not None:
            write_json(self.model, result.model.to_json())
            written.append(told("Model", self.model))
        if self.save is not None and result.found is not None:
            write_json(self.save, result.found.to_json())
            written.append(told("Saved", self.save))
        if self.figure is not None:
            with writing(self.figure):
                next(p for p in result.pictures if p.name == "backbone").write(self.figure)
            written.append(told("Figure", self.figure))
        words = [result.full()] if self.full else result.in_brief(_LINES)
        self._say([*words, *written])
        if self.save is not None and result.found is None:
            click.echo(f"Error: {result.report.trouble}", err=True)
            raise click.exceptions.Exit(INTERRUPTED if result.report.interrupted else REFUSED)

    def _tell_all(self, results: Sequence[Result | Refused], overview: Path) -> None:
        """Print the table, and write the page of all files."""
        done = [r for r in results if not isinstance(r, Refused)]
        refused = [r.sentence for r in results if isinstance(r, Refused)]
        explained = sum(bool(r.explained) for r in done)
        sentence = f"Identified: {len(done)} files, {explained} of them explained to the noise."
        rows = [HEADER, *(row for r in results for row in r.rows())]
        beside = {r.file: r.report.beside for r in done}
        backbones = {file: b.backbone for file, b in beside.items() if b is not None}
        command = str(click.get_current_context().info_name)
        with writing(overview):
            write_overview(
                overview,
                sentence,
                rows,
                backbones,
                refused,
                interactive=self.interactive,
                command=command,
            )
        self._say([aligned(rows), "", *refused, sentence, told("Overview", overview)])


def _all_of(
    jobs: Mapping[str, Callable[[], Result]], processes: int
) -> tuple[list[Result | Refused], bool]:
    """Results of all files, and whether they were interrupted: what is done is kept."""
    done = starmap(_one, jobs.items()) if processes == 1 else _side_by_side(jobs, processes)
    results: list[Result | Refused] = []
    try:
        for result in bar(done, "files", len(jobs)):
            results.append(result)
            if stopped() or (isinstance(result, Result) and result.report.interrupted):
                return results, True
    except KeyboardInterrupt as error:
        file = [*jobs][len(results)]
        results.append(Refused(file, f"{file}: interrupted {error}"))
        return results, True
    return results, False


def _one(file: str, job: Callable[[], Result]) -> Result | Refused:
    try:
        return job()
    except (ValueError, OSError, RuntimeError) as error:
        return Refused(file, as_options(str(error)))


def _side_by_side(
    jobs: Mapping[str, Callable[[], Result]], processes: int
) -> Iterator[Result | Refused]:
    """Results in the order of the files, by so many processes."""
    command = str(click.get_current_context().info_name)
    tasks = (delayed(_apart)(command, file, job) for file, job in jobs.items())
    for result, lost in Parallel(processes, return_as="generator")(tasks):
        lose(lost)
        yield result


def _apart(
    command: str, file: str, job: Callable[[], Result]
) -> tuple[Result | Refused, dict[Path, str]]:
    """What comes of a file in another process, without bars, and which files were not written."""
    with apart(command) as lost, redirect_stderr(io.StringIO()):
        return _one(file, job), lost


def _page_names(files: Sequence[Path], ending: str) -> list[str]:
    """Names of the reports: the folder is a part of those that would be the same otherwise."""
    stems = Counter(f.stem for f in files)
    names = [f.stem if stems[f.stem] == 1 else "_".join(f.parts[-2:]) for f in files]
    return [f"{name}_{ending}.html" for name in names]
