"""The command ``romsindy reduce``."""

from __future__ import annotations

from pathlib import Path

import click

from romsindy.commands.options import interactive_option, jobs_option
from romsindy.commands.outputs import (
    JSON,
    PAGE,
    Output,
    WritingCommand,
    default_page,
    keep_inputs,
    told,
    write_json,
    writing,
)
from romsindy.structure.cases import MARK
from romsindy.structure.deck import Deck
from romsindy.structure.deck_file import sensor_of, unit_names
from romsindy.structure.structure import KINDS, Structure, load_structure
from romsindy.text import as_text

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
_UNITS = "m,kg,s"
_MODES, _HIGHER = 20, 10  # that are computed, and above the one that is kept: those that follow
_HEADINGS = {
    "What is reduced": "--mode --range --sensor --damping-ratio --units --order",
    "CalculiX": "--ccx --store --folder --jobs",
    "Output": "--save --report --interactive --quiet --overwrite",
}


def _sensor(_: click.Context, __: click.Parameter, value: str | None) -> tuple[str, int] | None:
    return None if value is None else sensor_of("--sensor", value)


def _units(_: click.Context, __: click.Parameter, value: str) -> tuple[str, str]:
    return unit_names("--units", value)


@click.command(cls=WritingCommand, headings=_HEADINGS)
@click.argument("deck", type=_FILE)
@click.option("--mode", default=1, show_default=True, help="The mode that is kept, from 1.")
@click.option(
    "--range",
    "reach",
    type=float,
    help="How far the node that moves most is moved, in either direction, in the deck's unit of"
    " length.",
)
@click.option(
    "--sensor",
    callback=_sensor,
    metavar="NODE:DIRECTION",
    help="The coordinate is what the mode moves there, such as 412:3.  [default: the modal one]",
)
@click.option(
    "--damping-ratio",
    default=0.0,
    show_default=True,
    help="Of small vibrations; a deck states none.",
)
@click.option(
    "--units",
    default=_UNITS,
    callback=_units,
    show_default=True,
    help="Length, mass and time of the deck, such as mm,t,s.",
)
@click.option(
    "--order",
    type=int,
    help="Highest power of the restoring force.  [default: the lowest that follows]",
)
@click.option("--ccx", default="ccx", show_default=True, help="The program of CalculiX.")
@click.option(
    "--store",
    type=Output(MARK, kinds=(".npz",)),
    help="NPZ file that keeps static cases, which are not computed again.  [default: the name of"
    " the deck with .cases.npz]",
)
@click.option(
    "--folder",
    type=click.Path(file_okay=False, path_type=Path),
    help="Keep all files of CalculiX here.",
)
@jobs_option
@click.option("--save", type=Output(JSON), help="Write the equation as JSON.")
@click.option("--report", type=Output(PAGE), help="Name of the HTML report.")
@interactive_option
@click.option("--quiet", is_flag=True, help="No progress bar, no tables.")
def reduce(
    deck: Path,
    mode: int,
    reach: float | None,
    sensor: tuple[str, int] | None,
    damping_ratio: float,
    units: tuple[str, str],
    order: int | None,
    ccx: str,
    store: Path | None,
    folder: Path | None,
    jobs: int,
    save: Path | None,
    report: Path | None,
    interactive: bool,
    quiet: bool,
) -> None:
    """Reduce the finite-element model in DECK to the equation of one mode.

    DECK is a deck of CalculiX (.inp), whose program holds it in static cases, or a file of arrays
    from any other program (.npz, .mat, .h5). The equation has what the other modes do that follow:
    their stiffness and their inertia.
    """
    page = report or default_page(f"{deck.stem}.html")
    if deck.suffix.lower() in KINDS:
        structure = load_structure(deck)
    elif reach is None:
        raise click.UsageError(
            "--range is missing: say how far the node that moves most is moved, in the deck's unit"
            " of length, such as one or two thicknesses"
        )
    else:
        keep_inputs(Deck.load(deck).files)
        if store is None:
            store = Path(f"{deck.stem}.cases.npz")
            keep_inputs({"what is kept of the deck": store})
        structure = Structure.from_calculix(
            deck,
            ccx=ccx,
            folder=folder,
            store=store,
            n_jobs=jobs,
            modes=max(_MODES, mode + _HIGHER),
            progress=not quiet,
        )
    found = structure.reduce(
        mode, reach, order, sensor=sensor, damping_ratio=damping_ratio, units=units
    )
    if save is not None:
        write_json(save, found.model.to_json())
    with writing(page):
        from romsindy.show.structure import write_reduction_page  # figures are for the end

        write_reduction_page(page, found, interactive=interactive)
    click.echo(str(found))
    if not quiet:
        click.echo("\n".join(["", str(found.model), *map(as_text, found.tables)]))
    for note in found.notes:
        click.echo(f"Note: {note}", err=True)
    if save is not None:
        click.echo(told("Equation", save))
    click.echo(told("Report", page))
