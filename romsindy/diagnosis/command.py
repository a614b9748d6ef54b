"""The command `romsindy diagnose`."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from tqdm import tqdm

from romsindy.diagnosis.simulated import SimulationModel, model_of_simulation
from romsindy.diagnosis.workflow import diagnose as run_diagnosis
from romsindy.files import load_decay
from romsindy.model import ReducedModel

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command()
@click.option(
    "--measured", "measured", multiple=True, required=True, type=_FILE, help="Decay; repeatable."
)
@click.option("--simulated", type=_FILE, help="The simulation as a decay in a file.")
@click.option("--model", "model_file", type=_FILE, help="The simulation as a model (JSON).")
@click.option("--held-out", type=_FILE, help="Decay to judge by, which takes no part otherwise.")
@click.option("--unit", help='Unit of the measured column: "mm", "m/s", "g", "deg", ...')
@click.option("--column", help="Name of the measured column.")
@click.option("--start", type=float, help="Use measured records from this time on, s.")
@click.option("--end", type=float, help="Use measured records up to this time, s.")
@click.option(
    "--free",
    multiple=True,
    default=("omega^2", "c_linear"),
    show_default=True,
    type=click.Choice(["omega^2", "c_linear"]),
    help="What the simulation is unsure of; repeatable.",
)
@click.option("--exact", is_flag=True, help="The simulation is sure of everything.")
@click.option("--floor", type=float, help="Disagreement that does not matter, per amplitude.")
@click.option("--jobs", default=1, show_default=True, help="Processes; -1 uses all cores.")
@click.option("--report", type=click.Path(path_type=Path), help="Name of the HTML report.")
@click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write the result.")
@click.option("--csv", "csv_file", type=click.Path(path_type=Path), help="Write the table.")
def diagnose(
    measured: tuple[Path, ...],
    simulated: Path | None,
    model_file: Path | None,
    held_out: Path | None,
    unit: str | None,
    column: str | None,
    start: float | None,
    end: float | None,
    free: tuple[str, ...],
    exact: bool,
    floor: float | None,
    jobs: int,
    report: Path | None,
    json_file: Path | None,
    csv_file: Path | None,
) -> None:
    """Name what a simulation lacks, from measured free decays.

    The simulation is a model (--model) or a simulated decay (--simulated).
    """
    if (simulated is None) == (model_file is None):
        raise click.UsageError("name one of --simulated and --model")
    decays = [load_decay(f, unit, column=column, start=start, end=end) for f in measured]
    test = None if held_out is None else load_decay(held_out, unit, column=column)
    if simulated is not None:
        known = model_of_simulation(load_decay(simulated, unit))
    else:
        text = model_file.read_text(encoding="utf-8")  # type: ignore[union-attr]
        known = SimulationModel(ReducedModel.from_json(text), {}, 2e-4)
    with tqdm(desc="candidates", leave=False, disable=not sys.stderr.isatty()) as bar:

        def progress(candidate: str) -> None:
            bar.set_postfix_str(candidate)
            bar.update()

        result = run_diagnosis(
            known.model,
            decays,
            held_out=test,
            free=() if exact else free,
            tolerances=known.tolerances,
            floor=floor or known.floor,
            n_jobs=jobs,
            progress=progress,
        )
    click.echo(f"{result.verdict}: {result.sentence}\n")
    for row in [*result.gap.table(), [], *result.table()]:
        click.echo("  ".join(cell.ljust(22) for cell in row).rstrip())
    page = report or Path(f"{measured[0].stem}_diagnosis.html")
    result.to_html(page)
    click.echo(f"\nReport: {page}")
    if json_file is not None:
        json_file.write_text(result.to_json() + "\n", encoding="utf-8")
    if csv_file is not None:
        result.to_csv(csv_file)
