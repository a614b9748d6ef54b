"""What a command prints and writes of one file, or of many: the answer, and the files beside it."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, fields
from functools import partial
from itertools import starmap
from pathlib import Path
from typing import Any

import click
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
from romsindy.commands.results import HEADER, Refused, Result
from romsindy.physics.term_sum import json_text
from romsindy.show.page import write_overview
from romsindy.text import aligned, as_options, bar

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
            raise click.ClickException(result.report.trouble)

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
