"""Files of the study: CSV, PNG, SVG and one self-contained HTML page."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from romsindy.record.files.save import whole
from romsindy.show.page import Image, Picture, write_page
from romsindy_study.content import Chapter, Check, Table


@dataclass(frozen=True)
class Written:
    """A chapter with its images, by name."""

    chapter: Chapter
    images: dict[str, Image]


def write_chapter(chapter: Chapter, folder: Path, interactive: bool = False) -> Written:
    """Write every table as CSV and every picture as PNG and SVG into the folder."""
    for table in chapter.tables:
        table.write_csv(folder)
    images = {p.name: _write_picture(p, folder, interactive) for p in chapter.pictures}
    return Written(chapter, images)


def _write_picture(picture: Picture, folder: Path, interactive: bool) -> Image:
    figure = picture.figure()
    image = picture.image(figure, interactive, dpi=110)
    path = folder / f"{picture.name}.png"
    with whole(path) as new:
        new.write_bytes(base64.b64decode(image.png))
    figure.set_layout_engine("none")  # as laid out, once
    with whole(path.with_suffix(".svg")) as new:
        figure.savefig(new)
    return image


def checks_table(checks: Sequence[Check]) -> Table:
    """What the method is expected to reach, and what it reached."""
    return Table(
        "checks",
        "Expected and measured",
        "Whether a number is as expected is decided here, not in the text.",
        ["what", "measured", "unit", "expected", "verdict"],
        [
            [c.what, c.measured, c.unit, c.expected, "pass" if c.passed else "FAIL"]
            for c in checks
        ],
    )  # fmt: skip


def write_story(
    written: Sequence[Written],
    checks: Sequence[Check],
    folder: Path,
    settings: str,
    interactive: bool = False,
) -> None:
    """Write report.html about the chapters that there are, and checks.csv."""
    table = checks_table(checks)
    table.write_csv(folder)
    write_page(
        folder / "report.html",
        "study",
        "study",
        title="From a decay to an equation of motion: the study of the default beam",
        checks=table,
        written=written,
        settings=settings,
        interactive=interactive,
    )
