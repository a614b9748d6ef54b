"""What is done of each record, here or on other processes, and by how many."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from joblib import Parallel, delayed

from romsindy.commands.measurement import Analysis, Asked, Selection, analysed, identified
from romsindy.commands.results import Result
from romsindy.show.identified import Identified
from romsindy.show.panels import pictures, write_result
from romsindy.text import as_options
from romsindy_batch.entries import Entry

_CURVE = 24  # points of a stored curve


@dataclass(frozen=True)
class Job:
    """How every record is read and identified; ``pages``, if any, is the folder of their pages."""

    reading: Mapping[str, Any]
    choice: Selection
    asked: Asked
    pages: Path | None = None

    @property
    def settings(self) -> str:
        """All that the numbers depend on beside the file, as text."""
        reading = {k: v for k, v in self.reading.items() if v is not None}
        return repr((reading, tuple(self.choice), vars(self.asked), self.pages is not None))

    def page(self, entry: Entry) -> Path | None:
        """The page of a record, by its name: no two have the same."""
        return None if self.pages is None else self.pages / f"{quote(entry.name, safe='')}.html"

    def __call__(self, entry: Entry) -> tuple[Entry, dict[str, Any]]:
        """A record and what is found of it, by name; why it is refused under "error"."""
        # Of many at once no bar is shown.
        with redirect_stderr(io.StringIO()):
            try:
                return entry, self._found(entry)
            except (ValueError, OSError, RuntimeError, ArithmeticError) as error:
                return entry, {"file": entry.name, "error": as_options(str(error))}

    def _found(self, entry: Entry) -> dict[str, Any]:
        if not entry.file.is_file():
            raise ValueError(f"{entry.file} is not there: mend its name in the table")

        analyse: Analysis = partial(identified, asked=self.asked)
        given = (self.reading, self.choice, analyse, self.asked.seed)
        report, more, facts, step = analysed(entry.file, *given)
        if report.interrupted:  # what is half done is done again
            raise KeyboardInterrupt
        page = self.page(entry)
        if page is not None:
            drawn = [*pictures(report), *more]
            write_result(report, page, drawn, interactive=False, command="batch")
        content = Result(entry.name, page or Path("-"), report, [], facts, step).content()
        series = report.series
        short = series.short.model.equation() if series and series.short.follows else None
        return content | {"curve": _curve(report), "short": short}


def _curve(report: Identified) -> dict[str, Any] | None:
    """Frequency, Hz, and damping ratio, %, with standard errors over the amplitudes of a record."""
    if report.series is None or report.beside is None:
        return None
    seen = report.beside.backbone.amplitude
    band = report.series.band(np.geomspace(seen.min(), seen.max(), _CURVE))
    return {
        "amplitude": band.amplitude,
        "frequency": band.frequency / (2 * np.pi),
        "frequency_std": band.frequency_std / (2 * np.pi),
        "damping_ratio": 100 * band.damping_ratio,
        "damping_ratio_std": 100 * band.damping_ratio_std,
    }


def done(job: Job, entries: Sequence[Entry], jobs: int) -> Iterator[tuple[Entry, dict[str, Any]]]:
    """Records with what is found of each as it comes, on so many processes; -1 takes all cores."""
    tasks = (delayed(job)(entry) for entry in entries)
    yield from Parallel(jobs, return_as="generator_unordered")(tasks)


def done_on(
    address: str, job: Job, entries: Sequence[Entry], jobs: int, say: Callable[[str], object]
) -> Iterator[tuple[Entry, dict[str, Any]]]:
    """The same on the workers of a dask cluster; the rest is done here where that goes away.

    Raises a ValueError if dask is not installed, or no cluster answers there.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise ValueError(f'--dask {address}: run pip install "romsindy[dask]" first') from error
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise ValueError(
            f"--dask {address}: no cluster answers there ({error}); start dask scheduler and dask"
            " worker first, or leave --dask out and use --jobs"
        ) from error
    left = {entry.name: entry for entry in entries}
    try:
        with client:
            futures = client.map(job, entries, pure=False)
            for _, (entry, found) in as_completed(futures, with_results=True):
                del left[entry.name]
                yield entry, found
    except Exception as error:  # dask raises many; what is no fault of the cluster comes again here
        say(f"the cluster at {address} went away ({type(error).__name__}): the rest is done here")
    yield from done(job, list(left.values()), jobs)
