"""Identify all records of a folder, or of a table with a column "file", one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any
from urllib.parse import quote

import click
import numpy as np
from markupsafe import Markup, escape

from romsindy.commands.main import INTERRUPTED, REFUSED
from romsindy.commands.measurement import Asked, Selection, mode_options
from romsindy.commands.options import (
    READING,
    fix_option,
    interactive_option,
    jobs_option,
    reading_options,
)
from romsindy.commands.outputs import WritingCommand, claim_folder, told, writing
from romsindy.show.page import write_page
from romsindy.text import TextTable, bar, counted, listed, quantity, with_error
from romsindy_batch.entries import Entries, Entry, entries_of
from romsindy_batch.pictures import pictures
from romsindy_batch.store import Store
from romsindy_batch.summary import KINDS, WORDS, Batch, Trend, compared, outliers, trends
from romsindy_batch.summary import told as of_groups
from romsindy_batch.tables import write_tables
from romsindy_batch.work import Job, done, done_on

_PAGE, _RESULTS, _PAGES = "index.html", "results.jsonl", "pages"
_MOST = 4  # sentences of a kind that are printed; all are on the page
_HEADINGS = {
    "Which records": "--out --pages --jobs --dask",
    "Reading": READING,
    "What is looked for": "--mode --band --release --fix --curvature --seed",
    "The summary": "--amplitude --compare --interactive --overwrite",
}


@click.command(cls=WritingCommand, headings=_HEADINGS)
@click.argument("source", type=click.Path(exists=True, path_type=Path), metavar="FOLDER|TABLE")
@click.option(
    "--out",
    default="batch",
    show_default=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the page, the table and what was found of each record.",
)
@click.option("--pages", is_flag=True, help="Write a page for each record, too: some MB each.")
@jobs_option
@click.option("--dask", metavar="ADDRESS", help="Scheduler of a dask cluster that sees the files.")
@reading_options
@mode_options
@fix_option("Known coefficient in SI units, of all records; may be repeated.")
@click.option(
    "--curvature", type=float, help="How far the sensor may be off a straight line: see identify."
)
@click.option("--seed", default=0, show_default=True, help="Seed of the draws behind the bands.")
@click.option(
    "--amplitude",
    multiple=True,
    type=click.FloatRange(0, min_open=True),
    help="Compare records at this amplitude, in m or rad; may be repeated.  [default: three that"
    " most records reach]",
)
@click.option(
    "--compare",
    nargs=3,
    metavar="COLUMN A B",
    help="Compare records of which the table says A in a column with those of B.",
)
@interactive_option
def batch(
    source: Path,
    out: Path,
    pages: bool,
    jobs: int,
    dask: str | None,
    mode: int | None,
    band: tuple[float, float] | None,
    release: int | None,
    amplitude: tuple[float, ...],
    compare: tuple[str, str, str] | None,
    interactive: bool,
    **options: Any,
) -> None:
    """Identify all records of a folder, or of a table with a column "file", one after the other.

    Of each the mode that moves most is identified, as romsindy identify does. A table with
    frequency and damping ratio at common amplitudes is written as CSV (XLSX and Parquet where what
    writes them is installed), and a page with all curves, trends over the columns of numbers and
    dates of the table, and outliers. What is refused is in the table with its reason, and stops
    nothing. The same command goes on where it was interrupted (Ctrl-C), and does again only what
    has changed.
    """
    asked = Asked(**{f.name: options.pop(f.name) for f in fields(Asked) if f.name in options})
    entries = entries_of(source, out)
    _check(entries, source, out, compare)
    job = Job(options, Selection(mode, band, release), asked, out / _PAGES if pages else None)
    claim_folder(out, _PAGE)
    (out / _PAGES if pages else out).mkdir(parents=True, exist_ok=True)
    store = Store(out / _RESULTS)
    summary = _Summary(entries, store, job, amplitude, compare, out, interactive)
    summary.write_page()  # the folder is ours from here on
    left = [e for e in entries.records if store.of(e, job.settings) is None]
    if len(left) < len(entries.records):
        known = len(entries.records) - len(left)
        _say(f"{known} of {len(entries.records)} records are known from before")
    made = done_on(dask, job, left, jobs, _say) if dask else done(job, left, jobs)
    interrupted = False
    try:
        for entry, found in bar(made, "records", len(left)):
            _keep(store, entry, job, found)
    except KeyboardInterrupt:
        interrupted = True
    refused = summary.tell(interrupted)
    if interrupted or refused:
        raise click.exceptions.Exit(INTERRUPTED if interrupted else REFUSED)


def _check(entries: Entries, source: Path, out: Path, compare: tuple[str, str, str] | None) -> None:
    """Refuse what would fail after all of the work, or replace an input."""
    for path in (source, *(e.file for e in entries.records)):
        if out.resolve() in path.resolve().parents:
            raise click.UsageError(
                f"--out {out} holds the input {path}: no output replaces an input; name another"
                " folder"
            )
    if compare is None:
        return
    column, *names = compare
    told = [e.values.get(column) for e in entries.records]
    few = [f"{name}: {told.count(name)}" for name in names if told.count(name) < 2]
    if few:
        columns = ", ".join(entries.columns) or "none"
        raise click.UsageError(
            f"--compare {' '.join(compare)}: two groups need two records each, and there are"
            f" {listed(few)}; columns of the table are {columns}"
        )


def _keep(store: Store, entry: Entry, job: Job, found: Mapping[str, Any]) -> None:
    """Keep what was found of a record; where there is no room nothing more is begun."""
    try:
        store.add(entry, job.settings, found)
    except OSError as error:
        raise click.UsageError(
            f"{store.path} cannot be written ({error.strerror}): make room; what is done is kept,"
            " and the same command goes on from there"
        ) from error


def _say(line: str) -> None:
    click.echo(f"Note: {line}", err=True)


class _Summary:
    """What is printed and written of all that is known."""

    def __init__(
        self,
        entries: Entries,
        store: Store,
        job: Job,
        amplitudes: Sequence[float],
        groups: tuple[str, str, str] | None,
        out: Path,
        interactive: bool,
    ) -> None:
        self.entries, self.store, self.job, self.out = entries, store, job, out
        self.amplitudes, self.groups, self.interactive = amplitudes, groups, interactive

    def batch(self) -> Batch:
        """What is known now."""
        known = [(e, self.store.of(e, self.job.settings)) for e in self.entries.records]
        there = [(e, found) for e, found in known if found is not None]
        return Batch([e for e, _ in there], [f for _, f in there], self.amplitudes)

    def sentences(self, batch: Batch, lines: Sequence[Trend], far: dict[int, str]) -> list[str]:
        """The answer: how many, how large, what changes, what is odd."""
        n, asked = len(batch.entries), len(self.entries.records)
        refused = sum("error" in f for f in batch.found)
        explained = sum(bool(f.get("explained")) for f in batch.found)
        first = f"{n - refused} of {counted(asked, 'record', 'records')} identified, {explained} of"
        first += " them explained to the noise"
        first += f"; {refused} refused, the page says why" if refused else ""
        first += f"; {asked - n} not yet done" if n < asked else ""
        found = [f"{first}."]
        if len(batch.amplitudes) and n > refused:
            size, middles = quantity(batch.middle, batch.unit), list(_middles(batch))
            found.append(f"At {size}: {listed(middles)}." if middles else f"None reaches {size}.")
        found += [_capital(t.sentence(KINDS[t.kind])) for t in lines]
        found += [f"Outlier: {batch.entries[i].name}, in {what}." for i, what in far.items()]
        if self.groups is not None and n > refused:
            column, *pair = self.groups
            names = (pair[0], pair[1])
            found.append(
                _capital(of_groups(compared(batch, column, names), column, names, batch.unit))
            )
        return [*found, *([self.entries.left_out] if self.entries.left_out else [])]

    def write_page(self) -> list[str]:
        """Write the page, and return what it says first."""
        batch = self.batch()
        lines, far = list(trends(batch)), outliers(batch)
        sentences = self.sentences(batch, lines, far)
        title = (
            f"Records, at {quantity(batch.middle, batch.unit)}" if any(batch.curves) else "Records"
        )
        table = self._table(batch)
        page = self.out / _PAGE
        with writing(page):
            write_page(
                page,
                "report",
                "batch",
                title=f"{len(self.entries.records)} records",
                sentence="\n".join(sentences),
                tables=[TextTable(title, table)] if batch.entries else [],
                pictures=pictures(batch, lines, far),
                interactive=self.interactive,
                notes_title="Refused",
                notes=[f"{f['file']}: {f['error']}" for f in batch.found if "error" in f],
            )
        return sentences

    def tell(self, interrupted: bool) -> int:
        """Print the answer, write page and tables, and return how many records were refused."""
        sentences = self.write_page()
        batch = self.batch()
        written: list[Path] = []
        if batch.entries:
            with writing(self.out / "table.csv"):
                written = write_tables(batch.rows(), self.out)
        short = sentences[: 2 + 2 * _MOST]
        more = len(sentences) - len(short)
        short += [f"{more} more sentences are on the page."] if more > 0 else []
        short += ["Interrupted: the same command goes on from here."] if interrupted else []
        short += [told("Table", path) for path in written]
        click.echo("\n".join([*short, told("Report", self.out / _PAGE)]))
        return sum("error" in f for f in batch.found)

    def _table(self, batch: Batch) -> list[list[str]]:
        """What the page shows of each record."""
        columns, there = self.entries.columns, any(batch.curves)
        at = [batch.at(batch.middle, kind) if there else None for kind in KINDS]
        rows = [["file", *columns, "explained", *(f"{WORDS[k]} [{u}]" for k, u in KINDS.items())]]
        for i, (entry, found) in enumerate(zip(batch.entries, batch.found, strict=True)):
            word = "refused" if "error" in found else "yes" if found["explained"] else "no"
            known = [entry.values.get(column, "-") for column in columns]
            cells = [
                "-"
                if x is None or np.isnan(x.value[i])
                else " +- ".join(with_error(x.value[i], x.std[i]))
                for x in at
            ]
            rows.append([self._link(entry, entry.name), *known, word, *cells])
        return rows

    def _link(self, entry: Entry, name: str) -> str:
        page = self.job.page(entry)
        if page is None or not page.is_file():
            return name
        return Markup(f'<a href="{_PAGES}/{quote(page.name)}">{escape(name)}</a>')


def _middles(batch: Batch) -> Iterator[str]:
    """Median of each quantity, with the range that holds 95 % of the records."""
    for kind, unit in KINDS.items():
        values = batch.at(batch.middle, kind).value
        if not np.any(np.isfinite(values)):
            continue
        low, middle, high = np.nanpercentile(values, [2.5, 50, 97.5])
        yield f"{WORDS[kind]} {middle:.5g} {unit} ({low:.5g} to {high:.5g})"


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]
