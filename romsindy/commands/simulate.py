"""The command ``romsindy simulate``."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from romsindy.beam.beam import Beam
from romsindy.beam.motion import Motion, SensorArray, StepTooLongError
from romsindy.commands.outputs import Output, WritingCommand, told, writing
from romsindy.record.files.save import whole

_UNIT = "kg^0.5 m"
_MARK = f"t [s],q [{_UNIT}],"  # how a CSV begins; an NPZ holds it too


_HEADINGS = {
    "Motion": "--duration --step --tip-displacement --release-mode --mode",
    "Beam": "--elements --length --width --thickness --young --density --tip-mass --gravity",
    "Spring at the tip": "--spring-stiffness --spring-length --spring-pretension",
    "Damping": "--undamped --alpha --eta",
    "Sensors": "--sensor --snr --seed",
    "Output": "--full --quiet --overwrite",
}


@click.command(cls=WritingCommand, headings=_HEADINGS)
@click.argument("output", type=Output(_MARK))
@click.option("--duration", default=25.0, show_default=True, help="Time to follow, s.")
@click.option("--step", default=1e-3, show_default=True, help="Sampling interval, s.")
@click.option(
    "--tip-displacement", type=float, help="Tip displacement at release, m [default: length / 3]."
)
@click.option(
    "--release-mode",
    type=int,
    help="Hold by the modal force of this mode instead of a tip force; other modes stay calm.",
)
@click.option("--mode", default=1, show_default=True, help="Mode whose coordinate is written.")
@click.option("--undamped", is_flag=True, help="Leave out all damping (alpha = eta = 0).")
@click.option("--elements", default=150, show_default=True, help="Number of quadratic elements.")
@click.option("--length", default=0.45, show_default=True, help="Length, m.")
@click.option("--width", default=0.025, show_default=True, help="Width, m.")
@click.option("--thickness", default=0.001, show_default=True, help="Thickness, m.")
@click.option("--young", default=210e9, show_default=True, help="Young's modulus, Pa.")
@click.option("--density", default=7800.0, show_default=True, help="Density, kg/m^3.")
@click.option("--tip-mass", default=0.0008, show_default=True, help="Tip mass, kg; 0 for none.")
@click.option(
    "--spring-stiffness", default=24.4, show_default=True, help="Tip spring, N/m; 0 for none."
)
@click.option(
    "--spring-length", default=0.097, show_default=True, help="Installed length of the spring, m."
)
@click.option("--spring-pretension", default=1.51, show_default=True, help="Its pull, N.")
@click.option("--gravity", default=9.81, show_default=True, help="Downwards, m/s^2.")
@click.option("--alpha", default=0.37, show_default=True, help="Mass-proportional damping, 1/s.")
@click.option("--eta", default=1e-5, show_default=True, help="Stiffness-proportional damping, s.")
@click.option(
    "--sensor",
    "sensors",
    multiple=True,
    type=float,
    help="Position of a sensor, m (transverse and axial); may be repeated.",
)
@click.option("--snr", type=float, help="Noise on the sensors, signal-to-noise ratio in dB.")
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of the noise."
)
@click.option("--full", is_flag=True, help="Also write all modes and the energy (npz only).")
@click.option("--quiet", is_flag=True, help="No progress bar, no summary.")
def simulate(
    output: Path,
    duration: float,
    step: float,
    tip_displacement: float | None,
    release_mode: int | None,
    mode: int,
    undamped: bool,
    alpha: float,
    eta: float,
    sensors: tuple[float, ...],
    snr: float | None,
    seed: int,
    full: bool,
    quiet: bool,
    **parameters: float,
) -> None:
    """Simulate the free decay of the beam and write it to OUTPUT.

    OUTPUT is a .csv or an .npz file. Its columns are t, q, q_dot, q_ddot of one mode and the
    displacement of every sensor. A run that is interrupted, or that fails on the way, writes what
    it has.
    """
    if output.suffix not in (".csv", ".npz"):
        raise click.BadParameter(f"{output}: name a .csv or an .npz file", param_hint="OUTPUT")
    if snr is not None and not sensors:
        raise click.UsageError("--snr is noise on sensors: place them with --sensor")
    if full and output.suffix != ".npz":
        raise click.UsageError(f"--full needs room for arrays: name an .npz file, not {output}")
    damping = {"alpha": 0.0, "eta": 0.0} if undamped else {"alpha": alpha, "eta": eta}
    beam = Beam.cantilever(**parameters, **damping)  # type: ignore[arg-type]
    array = beam.sensors(sensors) if sensors else None
    tip = beam.length / 3.0 if tip_displacement is None else tip_displacement
    shape = beam.release_shape(tip, mode=release_mode)
    modes = beam.modes(count=max(10, mode))
    modes.index(mode)
    failure = None
    try:
        motion = beam.simulate(
            shape, duration, step, modes=modes, sensors=array, progress=not quiet
        )
    except StepTooLongError as error:
        failure, motion = error, error.motion
    with writing(output):
        write_motion(motion, output, mode, array, snr, seed, full=full)
    if not quiet:
        click.echo(f"{motion!r}\n" + told("Written", output))
    if failure is not None:
        raise failure
    if motion.stop_reason != "completed":
        raise KeyboardInterrupt(f"after {motion.t[-1]:.4g} s of {duration:.4g} s")


def write_motion(
    motion: Motion,
    path: Path,
    mode: int = 1,
    sensors: SensorArray | None = None,
    snr_db: float | None = None,
    seed: int = 0,
    *,
    full: bool = False,
) -> None:
    """Write time, one modal coordinate with its derivatives, and the sensors, to CSV or NPZ.

    An NPZ file also holds the stop reason and, if `full`, the coordinates of all modes and the
    total energy; without those and without sensors `load_decay` reads it as it is.
    """
    column = motion.basis.index(mode)
    h = motion.coordinates
    signals = {"q": h.displacement, "q_dot": h.velocity, "q_ddot": h.acceleration}
    table = {name: values[:, column] for name, values in signals.items()}
    readings = (
        np.empty((len(motion.t), 0)) if sensors is None else sensors.measure(motion, snr_db, seed)
    )
    labels = [] if sensors is None else sensors.labels
    if path.suffix == ".npz":
        extra: dict[str, object] = {"made_by": np.bytes_(_MARK), "unit": _UNIT}
        extra["stop_reason"] = motion.stop_reason
        if labels:
            extra |= {"sensors": readings, "sensor_labels": np.array(labels, dtype=str)}
        if full:
            extra |= {"modal": h.displacement, "energy": motion.energy.total}
        with whole(path) as new:
            np.savez(new, **extra, t=motion.t, **table)  # type: ignore[arg-type]
        return
    units = {"q": _UNIT, "q_dot": f"{_UNIT}/s", "q_ddot": f"{_UNIT}/s^2"}
    header = ["t [s]", *(f"{name} [{units[name]}]" for name in table)]
    header += [f"{label} [m]" for label in labels]
    values = np.column_stack([motion.t, *table.values(), readings])
    with whole(path) as new:
        np.savetxt(new, values, delimiter=",", header=",".join(header), comments="", fmt="%.12g")
