"""Motion of the beam from a shape at which it starts, free or driven."""

from __future__ import annotations

import sys
import time

import numpy as np

from romsindy.beam import kernel
from romsindy.beam.assembly import Assembly
from romsindy.beam.excitation import Excitation
from romsindy.beam.integrator import Integrator
from romsindy.beam.modes import ModalBasis, solve_modes
from romsindy.beam.motion import Cost, Motion, StepTooLongError
from romsindy.beam.radau import RadauIIA
from romsindy.beam.recorder import Recorder
from romsindy.beam.sensors import SensorArray
from romsindy.beam.statics import Shape
from romsindy.beam.stepper import FINEST, Budget, Stepper
from romsindy.physics.validation import require_positive
from romsindy.text import bar, on_terminal

DEFAULT_STEP = 1e-3
DEFAULT_ENERGY_TOLERANCE = 1e-4
_DEFAULT_MODES = 10


def simulate(
    assembly: Assembly,
    equilibrium: Shape,
    shape: Shape,
    duration: float,
    step: float = DEFAULT_STEP,
    *,
    energy_tolerance: float = DEFAULT_ENERGY_TOLERANCE,
    modes: ModalBasis | None = None,
    sensors: SensorArray | None = None,
    keep_field: bool = False,
    method: RadauIIA | None = None,
    velocity: np.ndarray | None = None,
    excitation: Excitation | None = None,
    progress: bool = True,
) -> Motion:
    """Let the beam go from `shape` and follow its motion, free or driven.

    The result is sampled every `step`; a sample interval is cut into 2, 4, ... time steps where
    the energy balance or Newton's method asks for it.  The first acceleration leaves out the
    axial waves that the release starts if they are too fast for the sampling.

    Parameters
    ----------
    assembly, equilibrium, shape : Assembly, Shape, Shape
        The beam, where it rests (energies are counted from there) and where it is let go.
    duration, step : float
        Time to follow; sampling interval and longest time step, s.
    energy_tolerance : float
        How far kinetic + strain + potential + dissipated energy - work of the excitation may drift
        over the whole motion, relative to the energy at release (zero from rest) + the largest
        work so far.
    modes, sensors : ModalBasis, SensorArray, optional
        What to record (default: the first ten modes about the beam's own equilibrium).
    keep_field : bool
        Whether to keep every node's motion as well (20 kB per sample at 150 elements).
    method : RadauIIA, optional
        The collocation method (default: Radau IIA of order 5).
    velocity : (n_nodes, 3) array, optional
        Velocities at the start, m/s and rad/s (default: rest).
    excitation : Excitation, optional
        What drives it (default: nothing).
    progress : bool
        Whether to show a progress bar, on a terminal.

    Raises
    ------
    ValueError
        For a duration, step or tolerance that is not positive, a shape or a velocity of another
        mesh, a velocity of what is held, or an excitation that is not finite all the time.
    StepTooLongError
        If Newton fails even in steps of step / 1024.
    """
    _check(assembly, shape, duration, step, energy_tolerance)
    v = _checked_velocity(assembly, velocity)
    if progress and on_terminal() and not kernel.is_compiled():
        print("compiling the beam kernels (first run only, some 10 s)", file=sys.stderr)
    rest, start = equilibrium.displacement, shape.displacement
    rest_energy = (0.0, assembly.strain(rest), assembly.potential(rest))
    method = method or RadauIIA()
    excitation = excitation or Excitation(assembly)
    integrator = Integrator(assembly, method, excitation)
    released = assembly.strain(start) + assembly.potential(start) + assembly.kinetic(v)
    at_rest = sum(rest_energy)
    rounding = 1e-14 * (abs(released) + abs(at_rest))
    budget = Budget(energy_tolerance, abs(released - at_rest), duration, rounding)
    stepper = Stepper(integrator, assembly, integrator.start(start, v), budget, method.order)
    first = excitation.load(np.zeros(1))[0]
    acceleration = assembly.smooth_acceleration(start, v, first, stiffening=step)
    free = int(np.count_nonzero(~assembly.fixed))
    basis = modes or solve_modes(assembly, equilibrium, min(_DEFAULT_MODES, free - 2))
    n_samples = int(np.floor(duration / step * (1 + 1e-12))) + 1
    recorder = Recorder(basis, sensors, step * np.arange(n_samples), excitation, keep_field)
    began = time.perf_counter()

    def motion(stop_reason: str) -> Motion:
        cost = Cost(stepper.steps, integrator.iterations, time.perf_counter() - began)
        return recorder.motion(cost, rest_energy, stop_reason)

    recorder.add(start, v, acceleration, stepper.energies, 0.0, 0.0)
    try:
        samples = range(n_samples - 1)
        for i in bar(samples, "simulate", unit="step") if progress else samples:
            if not stepper.advance(i * step, step):
                raise StepTooLongError(
                    f"Newton's method did not converge at t = {i * step:.6g} s with step = "
                    f"{step:.6g} s, not even cut to {step / 2**FINEST:.3g} s; try step = "
                    f"{0.1 * step:.3g} s (the motion up to there is in this error's `motion`)",
                    motion(f"step too long at {i * step:.6g} s"),
                    0.1 * step,
                )
            state = stepper.state
            recorder.add(
                state.x,
                state.v,
                state.stages[-1],
                stepper.energies,
                stepper.dissipated,
                stepper.work,
            )
    except KeyboardInterrupt:
        return motion(f"interrupted at {(recorder.count - 1) * step:.6g} s of {duration:.6g} s")
    return motion("completed")


def _checked_velocity(assembly: Assembly, velocity: np.ndarray | None) -> np.ndarray:
    if velocity is None:
        return np.zeros((assembly.n_nodes, 3))
    v = np.array(velocity, float)
    if v.shape != (assembly.n_nodes, 3) or not np.all(np.isfinite(v)):
        raise ValueError(
            f"velocity has shape {v.shape}: give finite values (u, w, theta) of every node,"
            f" ({assembly.n_nodes}, 3), such as beam.struck(0.001)"
        )
    if np.any(v[assembly.fixed]):
        raise ValueError("velocity moves what is held: set it to zero where the supports are")
    return v


def _check(
    assembly: Assembly, shape: Shape, duration: float, step: float, energy_tolerance: float
) -> None:
    require_positive("duration", duration)
    require_positive("step", step)
    require_positive("energy_tolerance", energy_tolerance)
    if step > duration:
        raise ValueError(f"step = {step} s is longer than duration = {duration} s; shorten it")
    if shape.displacement.shape != (assembly.n_nodes, 3):
        raise ValueError(
            f"shape has {len(shape.displacement)} nodes, the beam has {assembly.n_nodes}; "
            "release a shape of the same mesh"
        )
