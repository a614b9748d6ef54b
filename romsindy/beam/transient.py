"""Motion of the beam from a shape at which it starts, free or driven; its nonlinear normal modes.

Let go at rest, an undamped beam that moves periodically comes to rest again after half a period,
and goes back the same way. So a periodic orbit is a static shape from which all modes stop at the
same instant. The shape is held by the modal forces of a few bending modes; how these compare is
found so that the modes stop together (M. Peeters, R. Viguie, G. Serandour, G. Kerschen, J.-C.
Golinval, Mech. Syst. Signal Process. 23 (2009) 195, with half a period instead of a whole one).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq, root

from romsindy.beam import kernel
from romsindy.beam.assembly import Assembly
from romsindy.beam.equilibrium import ModalBasis, Shape, find_equilibrium, hold, solve_modes
from romsindy.beam.excitation import Excitation
from romsindy.beam.integrator import FINEST, Budget, Integrator, RadauIIA, Stepper
from romsindy.beam.motion import Cost, Motion, Recorder, SensorArray, StepTooLongError
from romsindy.beam.structure import BeamStructure
from romsindy.physics.validation import require_finite, require_positive
from romsindy.text import bar, on_terminal

_DEFAULT_MODES = 10


def simulate(
    assembly: Assembly,
    equilibrium: Shape,
    shape: Shape,
    duration: float,
    step: float = 1e-3,
    *,
    energy_tolerance: float = 1e-4,
    modes: ModalBasis | None = None,
    sensors: SensorArray | None = None,
    keep_field: bool = False,
    method: RadauIIA | None = None,
    velocity: np.ndarray | None = None,
    excitation: Excitation | None = None,
    progress: bool = True,
) -> Motion:
    """Let the beam go from `shape` and follow its motion, free or driven.

    Energies are counted from the ``equilibrium``. The first acceleration leaves out the axial waves
    that the release starts if they are too fast for the sampling. Other arguments, and errors, are
    those of `Beam.simulate`; nothing drives it without an ``excitation``.
    """
    _check(assembly, shape, duration, step, energy_tolerance)
    v = _checked_velocity(assembly, velocity)
    if progress and on_terminal() and (slow := kernel.warning()):
        print(slow, file=sys.stderr)
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
            works = stepper.energies, stepper.dissipated, stepper.work
            recorder.add(state.x, state.v, state.stages[-1], *works)
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


# In a period of the linear mode; the highest of five bending modes needs them.
_STEPS = 480
_CONVERGED = 1e-6


@dataclass(frozen=True, eq=False)
class NormalMode:
    """Periodic orbits of the undamped beam that grow out of one linear mode.

    Attributes
    ----------
    amplitude : (n,) array
        Half peak to peak of the modal coordinate q, kg^0.5 m.
    frequency : (n,) array
        Angular frequency, rad/s.
    tip_displacement : (n,) array
        Of the starting shape from equilibrium, m.
    linear_frequency : float
        Of the mode on the same mesh, rad/s.
    unrest : (n,) array
        Largest velocity left in the other modes half a period later, relative to the largest
        velocity of the mode.
    shapes : tuple of Shape
        The shapes at rest, from which `Beam.simulate` follows the orbit.
    stop_reason : str
        "completed", or why it ended early.
    """

    amplitude: np.ndarray
    frequency: np.ndarray
    tip_displacement: np.ndarray
    linear_frequency: float
    unrest: np.ndarray
    shapes: tuple[Shape, ...]
    stop_reason: str

    def __repr__(self) -> str:
        shift = self.frequency / self.linear_frequency - 1
        return (
            f"NormalMode({len(self.frequency)} orbits, omega = {self.linear_frequency:.6g} rad/s, "
            f"shift {shift[0]:.3g} to {shift[-1]:.3g})"
        )


def find_normal_mode(
    structure: BeamStructure,
    tip_displacements: Sequence[float],
    mode: int = 1,
    forces: int = 5,
    *,
    progress: bool = True,
) -> NormalMode:
    """Find periodic orbits of the beam, without its Rayleigh damping.

    Parameters
    ----------
    structure : BeamStructure
        The beam; effects that dissipate have no such orbits.
    tip_displacements : sequence of float
        Transverse displacement of the tip from equilibrium at one turning point, m; best in the
        order of size, since each orbit starts from the one before.
    mode, forces : int
        The linear mode that the orbits grow out of: 1, 2, ...; how many modal forces of bending
        modes hold the shape.
    progress : bool
        Whether to show a progress bar, on a terminal.

    Raises
    ------
    ValueError
        For an empty list, a displacement of zero, too few forces, or effects that dissipate.
    RuntimeError
        If the modes do not come to rest together, as near an internal resonance.
    KeyboardInterrupt
        Before the first orbit; later, what has been found is returned.
    """
    _check_tips(tip_displacements, mode, forces)
    calm = Assembly(replace(structure, alpha=0.0, eta=0.0))
    shooting = _Shooting(calm, mode, forces)
    ratios = np.zeros(forces - 1)
    orbits = []
    stop_reason = "completed"
    try:
        tips = tip_displacements
        for tip in bar(tips, "normal mode", unit="orbit") if progress else tips:
            orbit, ratios = _solve(shooting, ratios, tip)
            orbits.append(orbit)
    except KeyboardInterrupt:
        if not orbits:
            raise
        stop_reason = f"interrupted after {len(orbits)} of {len(tip_displacements)} orbits"
    return NormalMode(
        np.array([o.amplitude for o in orbits]),
        np.array([o.frequency for o in orbits]),
        np.array(tip_displacements[: len(orbits)], float),
        float(shooting.basis.omega[shooting.modes[0]]),
        np.array([np.max(np.abs(o.unrest)) for o in orbits]),
        tuple(o.shape for o in orbits),
        stop_reason,
    )


def _check_tips(tip_displacements: Sequence[float], mode: int, forces: int) -> None:
    if len(tip_displacements) == 0:
        raise ValueError("tip_displacements is empty: give at least one [m]")
    for tip in tip_displacements:
        require_finite("tip_displacements", tip)
        if tip == 0.0:
            raise ValueError("tip_displacements holds 0, where there is no motion; leave it out")
    if forces < max(mode, 2):
        raise ValueError(f"forces = {forces} must be at least {max(mode, 2)} for mode {mode}")


def _solve(shooting: _Shooting, ratios: np.ndarray, tip: float) -> tuple[_HalfPeriod, np.ndarray]:
    """Return the orbit, found from the ratios of the orbit before, and its own ratios."""
    try:
        ratios = root(lambda trial: shooting.follow(trial, tip).unrest, ratios, tol=1e-9).x
        orbit = shooting.follow(ratios, tip)
    except RuntimeError as trouble:  # a trial shape that cannot be held or followed
        raise _none_found(tip, str(trouble)) from trouble
    left = float(np.max(np.abs(orbit.unrest)))
    if not left < _CONVERGED:
        raise _none_found(tip, f"other modes keep {left:.1e} of the velocity")
    return orbit, ratios


def _none_found(tip: float, why: str) -> RuntimeError:
    return RuntimeError(
        f"no periodic orbit found at a tip displacement of {tip:.4g} m: go there in smaller steps "
        "of tip_displacements, or stay below. Where a higher mode comes to a whole multiple of "
        f"the frequency (internal resonance) the family turns away. The search ended with: {why}"
    )


@dataclass(frozen=True)
class _HalfPeriod:
    amplitude: float
    frequency: float
    unrest: np.ndarray
    shape: Shape


class _Shooting:
    """From the ratios of modal forces to how much the modes still move half a period later."""

    def __init__(self, assembly: Assembly, mode: int, forces: int) -> None:
        self.assembly = assembly
        rest = find_equilibrium(assembly)
        # Axial modes lie among the bending ones in short beams.
        count = min(2 * forces + 2, int(np.count_nonzero(~assembly.fixed)) - 2)
        basis = solve_modes(assembly, rest, count)
        bending = np.flatnonzero(basis.axial < 0.5)[:forces]
        if len(bending) < forces:
            raise ValueError(f"forces = {forces}, but the mesh has {len(bending)} bending modes")
        first = bending[mode - 1]
        self.modes = [first, *(m for m in bending if m != first)]
        self.basis = basis
        self.period = 2 * np.pi / float(basis.omega[first])

    def follow(self, ratios: np.ndarray, tip: float) -> _HalfPeriod:
        """Let the shape go and follow it until the mode turns."""
        shape, rest = self._held(ratios, tip), self.basis.equilibrium
        times = (0.8 * self.period, self.period / _STEPS)
        motion = simulate(self.assembly, rest, shape, *times, modes=self.basis, progress=False)
        if motion.stop_reason != "completed":  # `simulate` keeps what it has, and hands it back
            raise KeyboardInterrupt
        lost = motion.energy.dissipated[-1] / np.ptp(motion.energy.kinetic)
        if lost > 1e-8:
            raise ValueError(
                f"effects of the beam dissipate {lost:.1e} of the energy in half a period, so it"
                " has no periodic orbits; ask a beam without them"
            )
        q, q_dot, q_ddot = motion.coordinates
        mode, *others = self.modes
        velocity = CubicHermiteSpline(motion.t, q_dot, q_ddot)
        turn = _turning_time(motion.t, q_dot[:, mode], velocity, mode)
        swing = CubicHermiteSpline(motion.t, q, q_dot)(turn) - q[0]
        unrest = velocity(turn)[others] / np.max(np.abs(q_dot[:, mode]))
        return _HalfPeriod(float(abs(swing[mode])) / 2, np.pi / turn, unrest, shape)

    def _held(self, ratios: np.ndarray, tip: float) -> Shape:
        momenta = self.basis.momenta[self.modes]
        pattern = momenta[0] + np.tensordot(ratios, momenta[1:], axes=1)
        reading = self.assembly.point_load((0.0, 1.0))
        return hold(self.assembly, self.basis.equilibrium, pattern, reading, tip)


def _turning_time(
    t: np.ndarray, velocity: np.ndarray, spline: CubicHermiteSpline, mode: int
) -> float:
    early = len(t) // 4
    change = np.flatnonzero(np.sign(velocity[early:-1]) != np.sign(velocity[early + 1 :]))
    if not len(change):
        raise RuntimeError(f"the mode does not turn within {t[-1]:.4g} s: ask for less amplitude")
    at = early + int(change[0])
    return float(brentq(lambda s: spline(s)[mode], t[at], t[at + 1], xtol=1e-15, rtol=1e-14))
