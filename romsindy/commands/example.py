"""The command ``romsindy example``."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np
from scipy.integrate import solve_ivp

from romsindy.beam.beam import load_beam
from romsindy.effects import AirDrag
from romsindy.orbits.curves import forced_response
from romsindy.physics.model import ReducedModel
from romsindy.record.files.save import whole
from romsindy.record.signals import with_noise
from romsindy.typing import Array

# A thin strip: its stiffness grows with displacement, and so does the inertia of what it drags
# along, so that its frequency falls. The second structure has no such inertia, but meets the air.
STRIP = ReducedModel.from_coefficients(
    {"omega^2": 2500.0, "gamma_3": 5e4, "Upsilon_3": 60.0, "c_linear": 0.4}, unit="m"
)
_MODEL = """\
{
  "coefficients": {"omega^2": 2500.0, "gamma_3": 50000.0, "c_linear": 0.4},
  "unit": "m"
}
"""
SIMULATION = ReducedModel.from_json(_MODEL)
DRAG = 1.0  # 1/m, which the simulation lacks
REAL = ReducedModel(
    (*SIMULATION.terms, AirDrag().term()), (*SIMULATION.values, DRAG), SIMULATION.unit
)
# On a shaker: linear damping, stiffness that grows, which its simulation lacks, and kg of the mode
# that the force moves.
SHAKEN = {"omega^2": 987.0, "c_linear": 0.8, "gamma_3": 2e4}
MASS = 0.5
_SHAKER_MODEL = """\
{
  "coefficients": {"omega^2": 987.0, "c_linear": 0.8, "gain [force]": 2.0},
  "unit": "m"
}
"""
# On a shaker, by steps of a sine: damping and drag, and stiffness that grows.
STEPPED = ReducedModel.from_coefficients(
    {"omega^2": 2500.0, "gamma_3": 2e6, "c_linear": 0.8, "c_quadratic": 2.0}, unit="m"
)
_PER_VOLT, _SPREAD = 0.4, 1e-3  # m/s^2 for a volt, m/s
DRAG_ALONG_BEAM = 0.018  # N s^2/m^3, which the beam of beam.toml lacks
Writer = Callable[[Path], object]
_T = np.arange(0, 12, 1 / 400)  # s
_SNR = 40.0  # dB
_COLUMNS = ("base", "middle", "tip")  # of the sensors on the beam
_BEAM = f"""\
# A steel cantilever with a pre-stretched tip spring, coarse so that it is fast.
# The arguments of romsindy.Beam.cantilever; what is not given has its default.
[beam]
length = 0.45       # m
width = 0.025       # m
thickness = 0.001   # m
elements = 6

[sensors]
positions = [0.2, 0.32, 0.45]   # m along the beam
columns = {list(_COLUMNS)}   # of the measured files
""".replace("'", '"')


def _decay(model: ReducedModel, millimetres: float, seed: int | None) -> Writer:
    """A writer of the free decay from an amplitude, with noise if there is a seed for it."""

    def write(path: Path) -> None:
        q = model.simulate(millimetres / 1000, 0.0, _T).q
        noisy = q if seed is None else with_noise(q, _SNR, seed)
        _write_columns(path, _T, {"displacement": noisy})

    return write


def _shaker(path: Path) -> None:
    """A structure under a force of random phases, at rest at first."""
    t, rng = np.arange(0, 30, 0.01), np.random.default_rng(6)
    frequency, phase = rng.uniform(1, 12, 60), rng.uniform(0, 2 * np.pi, 60)

    def force(time: Array) -> Array:
        waves = np.cos(2 * np.pi * np.multiply.outer(time, frequency) + phase)
        return 0.8 * waves.sum(axis=-1)

    def rates(time: Array, state: Array) -> list[Array]:
        q, v = state
        k = SHAKEN
        own = k["c_linear"] * v + k["omega^2"] * q + k["gamma_3"] * q**3
        return [v, force(time) / MASS - own]

    done = solve_ivp(rates, (0, 30), [0, 0], "DOP853", t, rtol=1e-9, atol=1e-12, max_step=0.01)
    table = np.column_stack([t, with_noise(done.y[0], _SNR, 7), force(t)])
    _save(path, "time [s],displacement [m],force [N]", table)


def _stepped(path: Path) -> None:
    """Steady states of a stepped sine at three levels, as a laser sees the velocity."""
    rows, rng = [], np.random.default_rng(8)
    for level in (0.25, 0.5, 1.0):  # V
        orbits = forced_response(STEPPED, _PER_VOLT * level, frequency=(48.0, 53.0), n_points=100)
        w = orbits.frequency[::2]
        noise = _SPREAD * (rng.standard_normal(len(w)) + 1j * rng.standard_normal(len(w)))
        v = 1j * w * orbits.coefficients[::2, 1] + noise
        size = np.full((2, len(w)), [[level], [_SPREAD]])
        rows.append([w / (2 * np.pi), size[0], np.abs(v), np.degrees(np.angle(v)), size[1]])
    header = "frequency [Hz],force [V],velocity [m/s],velocity phase [deg],spread [m/s]"
    _save(path, header, np.concatenate(rows, axis=1).T)


def _beam_decay(path: Path) -> None:
    """The decay of the beam in beam.toml with drag, measured by its sensors."""
    beam, sensors, columns = load_beam(path.with_name("beam.toml"))
    real = beam.with_effect(AirDrag().on_beam(DRAG_ALONG_BEAM))
    shape = real.release_shape(tip_displacement=beam.length / 3, mode=1)
    motion = real.simulate(shape, duration=6.0, step=4e-3, sensors=sensors, progress=False)
    readings = sensors.measure(motion, _SNR, seed=5)
    _write_columns(path, motion.t, dict(zip(columns, readings.T, strict=True)))


def _write_columns(path: Path, t: Array, signals: dict[str, Array]) -> None:
    header = ",".join(["time [s]", *(f"{name} [m]" for name in signals)])
    _save(path, header, np.column_stack([t, *signals.values()]))


def _save(path: Path, header: str, table: Array) -> None:
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")


def _text(text: str) -> Writer:
    return lambda path: path.write_text(text, encoding="utf-8")


# Name, content and writer.
_FILES: tuple[tuple[str, str, Writer], ...] = (
    ("decay.csv", "free decay of a thin strip: time in s, displacement in m", _decay(STRIP, 80, 0)),
    ("run1.csv", "the same strip, released from 70 mm", _decay(STRIP, 70, 1)),
    ("run2.csv", "and from 60 mm", _decay(STRIP, 60, 2)),
    ("model.json", "simulation of another structure: an equation", _text(_MODEL)),
    ("sim.csv", "the same simulation: its free decay", _decay(SIMULATION, 80, None)),
    ("test.csv", "that structure measured: the simulation lacks an effect", _decay(REAL, 80, 3)),
    ("held_out.csv", "measured once more, to judge by", _decay(REAL, 70, 4)),
    ("shaker.csv", "another structure on a shaker: its displacement, and the force", _shaker),
    ("shaker.json", "simulation of it: an equation that lacks an effect", _text(_SHAKER_MODEL)),
    ("stepped.csv", "a beam on a shaker, by steps of a sine at three levels", _stepped),
)
# The decay of a beam takes longer than all of those; beam.toml comes first, which it is made with.
_BEAM_FILES: tuple[tuple[str, str, Writer], ...] = (
    ("beam.toml", "simulation of a beam, and its three sensors", _text(_BEAM)),
    ("beam_test.csv", "that beam measured: the simulation lacks an effect", _beam_decay),
)
_NEXT = (
    "romsindy inspect decay.csv",
    "romsindy identify decay.csv",
    "romsindy identify run1.csv run2.csv",
    "romsindy identify shaker.csv --input force --select",
    "romsindy steady stepped.csv",
    "romsindy diagnose --measured test.csv --held-out held_out.csv --model model.json",
    "romsindy diagnose --measured shaker.csv --input force --model shaker.json",
)
_BEAM_NEXT = ("romsindy diagnose --measured beam_test.csv --beam beam.toml",)


@click.command()
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path), metavar="DIR")
@click.option("--beam", is_flag=True, help="Write a beam and its decay instead, in some 10 s more.")
@click.option("--overwrite", is_flag=True, help="Overwrite files of these names.")
def example(folder: Path, beam: bool, overwrite: bool) -> None:
    """Write the files that README and docs use to DIR.

    Records are simulated on the spot and have 40 dB of noise: they show how romsindy is used, not
    how good it is. What two of the simulations lack is drag in air. Prints which file is what, and
    which commands come next.
    """
    files, following = (_BEAM_FILES, _BEAM_NEXT) if beam else (_FILES, _NEXT)
    there = [name for name, *_ in files if (folder / name).exists()]
    if there and not overwrite:
        raise click.UsageError(
            f"{folder} already has {', '.join(there)}: name another folder, or overwrite with"
            " --overwrite"
        )
    folder.mkdir(parents=True, exist_ok=True)
    for name, what, write in files:
        with whole(folder / name) as new:
            write(new)
        click.echo(f"{name:<14} {what}")
    inside = shlex.quote(str(folder))
    click.echo("\n".join(["\nNext:", f"  cd {inside}", *(f"  {line}" for line in following)]))
