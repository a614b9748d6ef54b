"""A program as a simulator: numbers and files in, a file out, a folder for each run."""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from romsindy.record.files.load import load_recording
from romsindy.simulator.simulator import SimulatorError
from romsindy.typing import Array

_PLACE = re.compile(r"\{([A-Za-z_][\w.]*)\}")
_OWN = ("release", "out", "times", "duration", "step")
_TOLD = 600  # last characters of what a program prints
_RUN = "run_{:03d}"


@dataclass(frozen=True, eq=False)
class Program:
    """A program that simulates a free decay after a release.

    Parameters
    ----------
    command : str
        What is run, without a shell, such as ``octave-cli model.m {release} {out}``. In the place
        of ``{release}`` comes the release, of ``{out}`` the name of the file that the program
        writes: times in the first column (s), then the displacement of each sensor; any format and
        any steps that `load_recording` reads. ``{out.mat}`` asks for a file of that kind. Of use
        beside: ``{duration}`` and ``{step}`` (s), ``{times}`` (a file with the times that are
        wanted), ``{force.m}``, ``{force.py}`` or ``{force.c}`` (a file with a force to add, a
        function of t, x and v), and the names of parameters.
    folder : str or Path
        Where runs are kept, each in a folder of its own.
    time_limit : float
        Of one run, s.

    Raises
    ------
    ValueError
        For a command without ``{release}`` or ``{out}``.
    """

    command: str
    folder: str | Path = "simulations"
    time_limit: float = 600.0

    def __post_init__(self) -> None:
        for needed, found in (
            ("{release}", "release" in self._places),
            ("{out}", bool(self._outputs)),
        ):
            if not found:
                raise ValueError(
                    f"simulator = {self.command!r} has no {needed}: write it where the program"
                    f" takes it, such as 'octave-cli model.m {{release}} {{out}}'"
                )
        if not self.time_limit > 0:
            raise ValueError(f"time_limit = {self.time_limit!r} must be positive (s)")

    @property
    def __name__(self) -> str:
        return shlex.split(self.command)[0]

    @cached_property
    def _places(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(_PLACE.findall(self.command)))

    @property
    def _outputs(self) -> list[str]:
        return [p for p in self._places if p.split(".")[0] == "out"]

    @property
    def _forces(self) -> list[str]:
        return [p for p in self._places if p.startswith("force.")]

    @property
    def takes_force(self) -> bool:
        """Whether it reads a force."""
        return bool(self._forces)

    @property
    def takes_values(self) -> tuple[str, ...]:
        """Values that it takes."""
        known = {*_OWN, *self._outputs, *self._forces}
        return tuple(p for p in self._places if p not in known)

    def simulate(self, release: float, t: Array, force: Any = None, **values: float) -> Array:
        """Displacements (n, n_sensors) at the times t (n,), s, by one run of the program.

        Raises a SimulatorError if it fails, does not end, or writes no such file.
        """
        folder = self._next_folder()
        out = folder / f"out{Path(self._outputs[0]).suffix or '.csv'}"
        filled: dict[str, str] = {
            "release": repr(float(release)),
            self._outputs[0]: str(out),
            "duration": repr(float(t[-1])),
            "step": repr(float(t[1] - t[0])),
            **{name: repr(float(value)) for name, value in values.items()},
        }
        if "times" in self._places:
            filled["times"] = str(folder / "times.csv")
            np.savetxt(filled["times"], t)
        code = getattr(force, "code", None) or _nothing  # in the language of an ending
        for name in self._forces:
            filled[name] = str(folder / name)
            Path(filled[name]).write_text(code(Path(name).suffix[1:]), encoding="utf-8")
        missing = [p for p in self._places if p not in filled]
        if missing:
            raise SimulatorError(
                f"simulator {self.command!r}: nothing is known for {{{missing[0]}}}; name it among"
                " the parameters, with its value"
            )
        self._run(filled, folder)
        return self._read(out, t, folder)

    def _next_folder(self) -> Path:
        """A new folder for a run; earlier ones stay."""
        root = Path(self.folder)
        n = 1
        while (root / _RUN.format(n)).exists():
            n += 1
        found = root / _RUN.format(n)
        found.mkdir(parents=True)
        return found.resolve()

    def _run(self, filled: Mapping[str, str], folder: Path) -> None:
        arguments = [_PLACE.sub(lambda m: filled[m[1]], word) for word in shlex.split(self.command)]
        (folder / "command.txt").write_text(shlex.join(arguments) + "\n", encoding="utf-8")
        release = float(filled["release"])
        asked = f"simulator {self.command!r}, release = {release:.6g} (folder {folder}):"
        try:
            done = subprocess.run(
                arguments,
                check=False,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=self.time_limit,
                stdin=subprocess.DEVNULL,
            )
        except FileNotFoundError as error:
            raise SimulatorError(
                f"{asked} there is no program {arguments[0]!r}: install it, or give its whole path"
            ) from error
        except OSError as error:
            raise SimulatorError(f"{asked} it does not start ({error})") from error
        except subprocess.TimeoutExpired as error:
            raise SimulatorError(
                f"{asked} it did not end within {self.time_limit:g} s: make it faster, or raise the"
                " time limit"
            ) from error
        printed = f"{done.stdout}\n{done.stderr}".strip()
        (folder / "printed.txt").write_text(printed + "\n", encoding="utf-8")
        if done.returncode:
            said = f" and said:\n{printed[-_TOLD:]}" if printed else " and said nothing"
            raise SimulatorError(f"{asked} it ended with {done.returncode}{said}")

    def _read(self, out: Path, t: Array, folder: Path) -> Array:
        asked = f"simulator {self.command!r} (folder {folder}):"
        if not out.is_file():
            raise SimulatorError(
                f"{asked} it wrote no file {out.name}: write times and displacements to the name"
                " in the place of {out}"
            )
        try:
            table = load_recording(out)
        except ValueError as error:
            raise SimulatorError(f"{asked} what it wrote cannot be read: {error}") from error
        came = table.t - (table.t[0] if abs(table.t[0]) < t[1] - t[0] else 0.0)
        if came[0] > 0 or came[-1] < t[-1] - (t[1] - t[0]):
            raise SimulatorError(
                f"{asked} it wrote times from {came[0]:.4g} to {came[-1]:.4g} s, and 0 to"
                f" {t[-1]:.4g} s were asked ({{duration}} stands for the last)"
            )
        x = table.x
        if len(came) == len(t) and np.allclose(came, t, atol=1e-6 * (t[1] - t[0]), rtol=0):
            return x
        return np.asarray(make_interp_spline(came, x, k=5)(np.minimum(t, came[-1])))


def _nothing(language: str) -> str:
    from romsindy.simulator.force import NO_FORCE

    return NO_FORCE.code(language)
