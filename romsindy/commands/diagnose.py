"""The command ``romsindy diagnose``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from romsindy.commands.main import INTERRUPTED
from romsindy.commands.options import Output, bar
from romsindy.diagnosis import BeamReport
from romsindy.diagnosis import diagnose as run_diagnosis
from romsindy.diagnosis.on_beam import load_beam
from romsindy.diagnosis.simulated import model_of_simulation
from romsindy.physics.model import ReducedModel
from romsindy.record.files import load_decay
from romsindy.text import aligned

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command()
@click.option(
    "--measured", "measured", multiple=True, required=True, type=_FILE, help="Decay; repeatable."
)
@click.option("--simulated", type=_FILE, help="The simulation as a decay in a file.")
@click.option("--model", "model_file", type=_FILE, help="The simulation as a model (JSON).")
@click.option("--beam", "beam_file", type=_FILE, help="The simulation as a beam (TOML).")
@click.option("--held-out", type=_FILE, help="Decay to judge by, which takes no part otherwise.")
@click.option("--unit", help='Unit of the measured column: "mm", "m/s", "g", "deg", ...')
@click.option("--column", help="Name of the measured column.")
@click.option("--start", type=float, help="Use measured records from this time on, s.")
@click.option("--end", type=float, help="Use measured records up to this time, s.")
@click.option(
    "--free",
    multiple=True,
    type=click.Choice(["omega^2", "c_linear", "nothing"]),
    help="What the simulation is unsure of; repeatable."
    " [default: omega^2 and c_linear of a model, nothing of a beam]",
)
@click.option("--floor", type=float, help="Disagreement that does not matter, per amplitude.")
@click.option("--jobs", default=1, show_default=True, help="Processes; -1 uses all cores.")
@click.option("--report", type=Output(), help="Name of the HTML report.")
@click.option("--json", "json_file", type=Output(), help="Write the result.")
@click.option("--csv", "csv_file", type=Output(), help="Write the table.")
def diagnose(
    measured: tuple[Path, ...],
    simulated: Path | None,
    model_file: Path | None,
    beam_file: Path | None,
    held_out: Path | None,
    unit: str | None,
    column: str | None,
    start: float | None,
    end: float | None,
    free: tuple[str, ...],
    floor: float | None,
    jobs: int,
    report: Path | None,
    json_file: Path | None,
    csv_file: Path | None,
) -> None:
    """Name what a simulation lacks, from measured free decays.

    The simulation is a model (--model), a simulated decay (--simulated), or a beam (--beam) with
    one measured column per sensor; of a beam, omega^2 and c_linear stand for the bending stiffness
    and the damping in proportion to mass. An interruption (Ctrl-C) keeps what was compared.
    """
    if sum(f is not None for f in (simulated, model_file, beam_file)) != 1:
        raise click.UsageError("name one of --simulated, --model and --beam")
    page = report or Output.of(f"{measured[0].stem}_diagnosis.html")
    simulation, columns = _simulation(simulated, model_file, beam_file, unit, column)
    decays = [load_decay(f, unit, column=columns, start=start, end=end) for f in measured]
    test = None if held_out is None else load_decay(held_out, unit, column=columns)
    # What was not given stays as the simulation has it; 0 and nothing are given values.
    unsure = [name for name in free if name != "nothing"] if free else None
    asked = {"free": unsure, "floor": floor}
    with bar(None, "candidates") as steps:

        def progress(candidate: str) -> None:
            steps.set_postfix_str(candidate)
            steps.update()

        result = run_diagnosis(
            **simulation | {k: v for k, v in asked.items() if v is not None},
            measured=decays,
            held_out=test,
            n_jobs=jobs,
            progress=progress,
        )
    click.echo(f"{result.verdict}: {result.sentence}\n")
    of_sensors = [result.sensor_table()] if isinstance(result, BeamReport) else []
    for rows in (result.gap.table(), *of_sensors, result.table()):
        click.echo(f"{aligned(rows)}\n")
    result.to_html(page)
    click.echo(f"Report: {page}")
    if json_file is not None:
        json_file.write_text(result.to_json() + "\n", encoding="utf-8")
    if csv_file is not None:
        result.to_csv(csv_file)
    if result.interrupted:
        raise click.exceptions.Exit(INTERRUPTED)


def _simulation(
    simulated: Path | None,
    model_file: Path | None,
    beam_file: Path | None,
    unit: str | None,
    column: str | None,
) -> tuple[dict[str, Any], str | list[str] | None]:
    """Arguments of the diagnosis that stand for the simulation, and the columns to measure."""
    if beam_file is not None:
        beam, sensors, columns = load_beam(beam_file)
        return {"model": beam, "sensors": sensors}, columns
    if simulated is not None:
        return model_of_simulation(load_decay(simulated, unit))._asdict(), column
    text = model_file.read_text(encoding="utf-8")  # type: ignore[union-attr]
    return {"model": ReducedModel.from_json(text)}, column
