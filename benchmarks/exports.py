"""Exported equations in other programs against `ReducedModel.simulate`.

    python benchmarks/exports.py

The free motion over some 20 cycles: the largest difference over the amplitude. The issue asks for
at most 1e-8 of smooth laws. C needs ``cc``, Octave ``octave-cli``.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.physics.damping import Friction, PowerDamping
from romsindy.physics.example import EXAMPLE_MODEL
from romsindy.physics.stiffness import MagnetForce, Stiffness

START, TIMES = (1.1, 0.0), np.linspace(0, 20, 2001)
SMOOTH = {
    "IC-ROM of order 5": EXAMPLE_MODEL,
    "magnet and friction with creep": rs.ReducedModel(
        (Stiffness(1), Stiffness(5), MagnetForce(2.3), PowerDamping(1), Friction(creep=0.5)),
        (30.1, 1 / 7, 0.3, 0.05, 0.01),
        "m",
    ),
}
_STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O2", "-shared", "-fPIC")
_OCTAVE = """
[t, y] = ode45(@rhs, linspace({0}, {1}, {2}), [{3}; {4}], odeset('RelTol', 1e-12, 'AbsTol', 1e-13));
printf('%.17g\\n', y(:, 1));
"""


def compiled(model: rs.ReducedModel | rs.CoupledModel, folder: Path) -> Callable[..., list[float]]:
    """dy/dt of t, y and the values of inputs, by the compiled function."""
    source, library = folder / "rhs.c", folder / "rhs.so"
    source.write_text(model.to_c())
    subprocess.run(["cc", *_STRICT, "-o", library, source, "-lm"], check=True)
    function, state = ctypes.CDLL(str(library)).rhs, ctypes.c_double * (2 * model.n_coordinates)

    def rates(t: float, y: np.ndarray, *inputs: float) -> list[float]:
        dy = state()
        function(ctypes.c_double(t), state(*y), *map(ctypes.c_double, inputs), dy)
        return list(dy)

    return rates


def moved_in_c(model: rs.ReducedModel, folder: Path) -> np.ndarray:
    """q at `TIMES`: the compiled function in scipy's DOP853."""
    tight = {"rtol": 1e-12, "atol": 1e-13}
    rates = compiled(model, folder)
    return solve_ivp(rates, TIMES[[0, -1]], START, "DOP853", TIMES, **tight).y[0]


def moved_in_octave(model: rs.ReducedModel, folder: Path) -> np.ndarray:
    """q at `TIMES`: the function in Octave's ode45."""
    (folder / "rhs.m").write_text(model.to_matlab())
    script = _OCTAVE.format(TIMES[0], TIMES[-1], len(TIMES), *START)
    command = ["octave-cli", "--quiet", "--eval", script]
    done = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    return np.array(done.stdout.split(), float)


def error(model: rs.ReducedModel, moved: np.ndarray) -> float:
    """Largest difference from `simulate`, over the amplitude."""
    # Integrators are good to about 1e3 times their rtol.
    same = model.simulate(*START, TIMES, rtol=1e-13).q
    return float(np.max(np.abs(moved - same))) / START[0]


def main() -> None:
    identified = rs.identify(rs.example_decay(snr_db=35, seed=0)).model
    models = SMOOTH | {f"identified, {len(identified.terms)} terms": identified}
    for program, name, move in (("cc", "C", moved_in_c), ("octave-cli", "Octave", moved_in_octave)):
        for title, model in models.items():
            if shutil.which(program) is None:
                print(f"{name:<8} {title:<32} {program} is not installed")
                continue
            with tempfile.TemporaryDirectory() as folder:
                print(f"{name:<8} {title:<32} {error(model, move(model, Path(folder))):.1e}")


if __name__ == "__main__":
    main()
