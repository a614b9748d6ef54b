"""The beam: the one place from which everything about it is asked, and its file in TOML."""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np

from romsindy.beam.assembly import Assembly
from romsindy.beam.equilibrium import ModalBasis, Shape, find_equilibrium, hold, solve_modes
from romsindy.beam.excitation import BaseAcceleration, Excitation, InTime, PointForce
from romsindy.beam.integrator import RadauIIA
from romsindy.beam.motion import Motion, Sensor, SensorArray, place_sensors
from romsindy.beam.static_shapes import StaticCurve, follow_static_curve, reduce, reduce_modes
from romsindy.beam.structure import CLAMPED, FREE, PINNED, BeamStructure, Section, Spring, Support
from romsindy.beam.transient import NormalMode, find_normal_mode, simulate
from romsindy.effects.mounting import MountedLaw, PointMass
from romsindy.physics import validation as entries
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.model import ReducedModel
from romsindy.physics.validation import refuse_unknown, require_finite, require_positive


@dataclass(frozen=True)
class Beam(BeamStructure):
    """A planar, geometrically exact beam, straight at rest along x, with gravity and effects.

    The parameters are those of `BeamStructure`.

    Examples
    --------
    >>> beam = Beam.cantilever(elements=10)
    >>> (beam.modes(count=2).omega / (2 * np.pi)).round(2).tolist()  # Hz
    [6.13, 26.41]
    """

    @classmethod
    def cantilever(
        cls,
        length: float = 0.45,
        width: float = 0.025,
        thickness: float = 0.001,
        young: float = 210e9,
        poisson: float = 0.3,
        density: float = 7800.0,
        *,
        tip_mass: float = 0.0008,
        spring_stiffness: float = 24.4,
        spring_length: float = 0.097,
        spring_pretension: float = 1.51,
        gravity: float = 9.81,
        alpha: float = 0.37,
        eta: float = 1e-5,
        elements: int = 150,
    ) -> Beam:
        """Make the method paper's system: a horizontal cantilever with a pre-stretched tip spring.

        The spring runs from the tip along the undeformed axis to an anchor at length +
        spring_length; installed there it pulls with spring_pretension.  Zero `tip_mass` and
        `spring_stiffness` leave the bare cantilever.

        Parameters
        ----------
        length, width, thickness : float
            Dimensions, m; the beam bends in the thickness direction.
        young, poisson, density : float
            Young's modulus, Pa, Poisson's ratio, and density, kg/m^3.
        tip_mass : float
            Mass at the tip, kg.
        spring_stiffness, spring_length, spring_pretension : float
            Stiffness, N/m, installed length, m, and pull there, N; the natural length is
            spring_length - spring_pretension / spring_stiffness.
        gravity : float
            Acceleration, m/s^2, downwards.
        alpha, eta : float
            Rayleigh damping, 1/s and s.
        elements : int
            Number of quadratic elements.

        Raises
        ------
        ValueError
            For a value without physical meaning.

        Source: the paper's parameters as reconstructed from the numbers that it prints
        (doi 10.1007/s11071-023-08813-z).
        """
        effects: list[MountedLaw | PointMass] = []
        require_positive("tip_mass", tip_mass, zero_allowed=True)
        require_positive("spring_stiffness", spring_stiffness, zero_allowed=True)
        if tip_mass > 0.0:
            effects.append(PointMass(tip_mass))
        if spring_stiffness > 0.0:
            require_positive("length", length)
            natural = spring_length - spring_pretension / spring_stiffness
            if spring_length > 0.0 > natural:
                raise ValueError(
                    f"spring_pretension = {spring_pretension} N would need a negative natural "
                    f"length; keep it below {spring_length * spring_stiffness:.4g} N"
                )
            anchor = (length + spring_length, 0.0)
            effects.append(
                Spring(stiffness=spring_stiffness, anchor=anchor, natural_length=max(natural, 0.0))
            )
        return cls(
            length=length,
            section=Section.rectangle(width, thickness, young, density, poisson),
            elements=elements,
            gravity=(0.0, -gravity),
            alpha=alpha,
            eta=eta,
            effects=tuple(effects),
        )

    def with_effect(self, effect: Any) -> Beam:
        """Return this beam with one more physical effect; the beam itself stays as it is.

        Parameters
        ----------
        effect : Load, PointMass, Spring, or a change of `romsindy.beam.changes`
            ``effect.on_beam(strength)`` makes a load of an effect of `romsindy.effects`.

        Raises
        ------
        TypeError
            For anything else.
        """
        if not hasattr(effect, "applied_to"):
            raise TypeError(
                f"effect is a {type(effect).__name__}: give a load, such as"
                " AirDrag().on_beam(strength), a PointMass, a Spring or a change of the beam"
            )
        changed: Beam = effect.applied_to(self)
        return changed

    @cached_property
    def assembly(self) -> Assembly:
        """The discretised beam."""
        return Assembly(self)

    # -- loads ---------------------------------------------------------------------------------

    def point_load(
        self, force: tuple[float, float] = (0.0, 0.0), moment: float = 0.0, at: float | None = None
    ) -> np.ndarray:
        """Return the nodal load of a dead force (N) and moment (N m) at a point (default: tip)."""
        return self.assembly.point_load(force, moment, at)

    # -- statics and modes ---------------------------------------------------------------------

    def shape(self, displacement: np.ndarray, load: np.ndarray | None = None) -> Shape:
        """Wrap nodal displacements, (n_nodes, 3), as a `Shape` of this beam."""
        zero = np.zeros_like(self.assembly.weight)
        return Shape(self.assembly.s, displacement, zero if load is None else load)

    def equilibrium(self, load: np.ndarray | None = None) -> Shape:
        """Return the equilibrium under weight, effects and an optional dead nodal load.

        Raises
        ------
        NoEquilibriumError
            If none is found, however small the load step.
        """
        return self._rest if load is None else find_equilibrium(self.assembly, load)

    @cached_property
    def _rest(self) -> Shape:
        return find_equilibrium(self.assembly)

    def modes(self, equilibrium: Shape | None = None, count: int = 10) -> ModalBasis:
        """Return the lowest `count` mass-normalised modes about an equilibrium (default: own).

        Raises
        ------
        ValueError
            If the mesh has fewer modes than asked for.
        """
        return solve_modes(self.assembly, equilibrium or self.equilibrium(), count)

    def release_shape(
        self, tip_displacement: float, mode: int | None = None, at: float | None = None
    ) -> Shape:
        """Return the static shape from which the beam is let go.

        Parameters
        ----------
        tip_displacement : float
            Transverse displacement of the right end from its equilibrium, m.
        mode : int, optional
            Hold by the modal force f M phi of this mode (1, 2, ...), which leaves the other
            modes almost at rest. By default a transverse force at the point itself holds it.
        at : float, optional
            Point that is displaced instead of the tip, m, for a beam whose right end is held.

        Raises
        ------
        ValueError
            For a mode that does not exist, or a displacement longer than the beam.
        NoEquilibriumError
            If the beam cannot be held there.
        """
        require_finite("tip_displacement", tip_displacement)
        tip = self.point_load((0.0, 1.0), at=at)
        if not np.any(tip[~self.assembly.fixed]):
            raise ValueError(
                f"at = {at} is a point that is held; give a point between the supports"
            )
        rest = self.equilibrium()
        height = float(np.vdot(tip, rest.displacement))
        if abs(height + tip_displacement) >= self.length:
            raise ValueError(
                f"tip_displacement = {tip_displacement} m is beyond the reach of a beam of "
                f"{self.length} m whose tip rests at {height:.3g} m; ask for less"
            )
        if mode is not None and mode < 1:
            raise ValueError(f"mode = {mode} does not exist; modes count from 1")
        pattern = tip if mode is None else self.modes(count=mode).momenta[mode - 1]
        return hold(self.assembly, rest, pattern, tip, tip_displacement)

    def struck(
        self, impulse: float, at: float | None = None, modes: int = 10, shape: Shape | None = None
    ) -> np.ndarray:
        """Return the velocity (n_nodes, 3) after a hit, m/s and rad/s.

        Parameters
        ----------
        impulse : float
            Upwards, N s.
        at : float, optional
            Where, m; None is the right end.
        modes : int
            Modes that the hit sets in motion: a soft hammer excites few.
        shape : Shape, optional
            Where the beam is then (default: at its equilibrium).

        Raises
        ------
        ValueError
            For an impulse that is not finite, a place off the beam, or modes that do not exist.
        """
        require_finite("impulse", impulse)
        basis = self.modes(shape, modes)
        push = self.point_load((0.0, impulse), at=at)
        return np.tensordot(np.tensordot(basis.shapes, push, axes=2), basis.shapes, axes=1)

    # -- motion, reduced model, sensors --------------------------------------------------------

    def simulate(
        self,
        shape: Shape | None = None,
        duration: float | None = None,
        step: float = 1e-3,
        *,
        force: PointForce | InTime | Sequence[PointForce | InTime] | None = None,
        base: BaseAcceleration | InTime | None = None,
        energy_tolerance: float = 1e-4,
        modes: ModalBasis | None = None,
        sensors: SensorArray | None = None,
        keep_field: bool = False,
        method: RadauIIA | None = None,
        velocity: np.ndarray | None = None,
        progress: bool = True,
    ) -> Motion:
        """Let the beam go from `shape` and follow its motion, free or driven.

        The result is sampled every `step`; a sample interval is cut into 2, 4, ... time steps where
        the energy balance or Newton's method asks for it.

        Parameters
        ----------
        shape : Shape, optional
            Where it starts (default: its equilibrium).
        duration, step : float
            Time to follow; sampling interval and longest time step, s.
        force : PointForce, a history, or a sequence of these, optional
            What drives it, N. A history alone, a function of an array of times or samples
            (t, force), acts transversely at the right end.
        base : BaseAcceleration, or a history, optional
            Acceleration of its base, m/s^2, transverse if it is a history alone. All displacements
            are relative to the base.
        energy_tolerance : float
            How far kinetic + strain + potential + dissipated energy - work of the excitation may
            drift over the whole motion, relative to the energy at release (zero from rest) + the
            largest work so far.
        modes, sensors : ModalBasis, SensorArray, optional
            What to record (default: the first ten modes about the beam's own equilibrium).
        keep_field : bool
            Whether to keep every node's motion as well (20 kB per sample at 150 elements).
        method : RadauIIA, optional
            The collocation method (default: Radau IIA of order 5).
        velocity : (n_nodes, 3) array, optional
            Velocities at the start, m/s and rad/s, such as those of `struck` after a hit (default:
            rest).
        progress : bool
            Whether to show a progress bar, on a terminal.

        Raises
        ------
        ValueError
            For a duration, step or tolerance that is not positive, a shape or a velocity of another
            mesh, a velocity of what is held, or an excitation that is not finite all the time.
        StepTooLongError
            If Newton fails even in steps of step / 1024.

        Examples
        --------
        >>> beam = Beam.cantilever(elements=4)
        >>> motion = beam.simulate(duration=0.01, force=lambda t: 0.1 * np.sin(60 * t))
        >>> motion.force.shape
        (11,)
        """
        if not isinstance(shape, Shape | None):
            raise TypeError(f"shape is {shape!r}: give a Shape, or the time as duration={shape!r}")
        if duration is None:
            raise TypeError("duration is not given: say how long to follow, in s, as duration=10")
        return simulate(
            self.assembly,
            self.equilibrium(),
            shape or self.equilibrium(),
            duration,
            step,
            energy_tolerance=energy_tolerance,
            modes=modes,
            sensors=sensors,
            keep_field=keep_field,
            method=method,
            velocity=velocity,
            excitation=Excitation(self.assembly, force, base),
            progress=progress,
        )

    def normal_mode(
        self,
        tip_displacements: Sequence[float],
        mode: int = 1,
        forces: int = 5,
        *,
        progress: bool = True,
    ) -> NormalMode:
        """Return periodic orbits of the undamped beam; see `transient.find_normal_mode`."""
        return find_normal_mode(self, tip_displacements, mode, forces, progress=progress)

    def static_curve(self, mode: int = 1, amplitude: float = 0.024, cases: int = 41) -> StaticCurve:
        """Return the shapes under the force of one mode, in [-amplitude, amplitude] kg^0.5 m.

        Inertia, restoring force and material damping along them are exact, not fitted; see
        `static_shapes.follow_static_curve`.
        """
        return follow_static_curve(self.assembly, self.equilibrium(), mode, amplitude, cases)

    @overload
    def reduce(
        self, mode: int = 1, order: int = 5, amplitude: float = 0.024, cases: int | None = None
    ) -> ReducedModel: ...

    @overload
    def reduce(
        self,
        *,
        modes: Sequence[int],
        order: int = 5,
        amplitude: float | Sequence[float],
        cases: int | None = None,
        progress: bool = True,
    ) -> ReducedModel | CoupledModel: ...

    def reduce(
        self,
        mode: int = 1,
        order: int = 5,
        amplitude: float | Sequence[float] = 0.024,
        cases: int | None = None,
        *,
        modes: Sequence[int] | None = None,
        progress: bool = True,
    ) -> ReducedModel | CoupledModel:
        """Return the reduced model of one mode, or of several together, from static cases.

        The beam is held by modal forces, f_1 M phi_1 + f_2 M phi_2 + ..., at many coordinates
        r_i = phi_i^T M (x - x_eq). The forces are the derivatives of the potential V(r); what the
        other modes do meanwhile, g(r) = x - x_eq - phi_1 r_1 - phi_2 r_2 - ..., gives the inertia
        1 + J^T M J, J = dg/dr ([1]). Damping is left out.

        Parameters
        ----------
        mode : int
            The one mode, counted from 1.
        order : int
            Highest power in the forces, at least 3. The inertia goes to the power order - 1; for
            several modes g does, and a model of order 9 holds a thousand of its products.
        amplitude : float, or (R,) sequence of float for R modes
            Largest coordinates, kg^0.5 m: the half axes of the ellipsoid that holds the cases of
            several modes. A mode that follows another must have room there: a second mode may
            need a tenth of the first, and more to move by itself.
        cases : int, optional
            Number of static cases; 41 for one mode. Cases of several modes lie on shells, as many
            as a lattice of this size or little more: (2 order + 1)^R by default.
        modes : sequence of int, optional
            The modes of several coordinates, in their order, in the place of ``mode``.
        progress : bool
            Whether to show a progress bar for several modes, on a terminal.

        Returns
        -------
        ReducedModel or CoupledModel
            Of one coordinate in kg^0.5 m, or of several: omega^2, gamma_3 ... [q1] of each, powers
            such as V q1^2 q2 of the potential that they share, and products such as
            g(q1^2) g(q1 q2) of the shapes that follow them.

        Raises
        ------
        ValueError
            For an order below 3, too few cases, amplitudes that are not positive or not one for
            each mode, or modes that are given twice or do not exist.
        NoEquilibriumError
            If the beam cannot be held that far.
        KeyboardInterrupt
            At once: nothing is kept.

        Notes
        -----
        omega^2 are the modes'; all else is least squares over the cases, see `reduction`:
        best where the amplitudes are little larger than those of the motion.
        What is left out follows statically: modes that are slower, or in resonance, must be in.
        The model of several modes holds that of one, where the forces of all others are zero.

        [1] E. Nicolaidou, T. L. Hill, S. A. Neild, "Indirect reduced-order modelling: using
            nonlinear manifolds to conserve kinetic energy", Proc. R. Soc. A 476 (2020), doi
            10.1098/rspa.2020.0589.
        """
        numbers = (mode,) if modes is None else tuple(modes)
        amplitudes = np.atleast_1d(amplitude).tolist()
        if not numbers or len(amplitudes) != len(numbers):
            raise ValueError(
                f"amplitude = {amplitude} is no amplitude for each of the modes {numbers}: give"
                " modes, and as many amplitudes, such as modes=(1, 2), amplitude=(0.024, 0.006)"
            )
        request = self.assembly, self.equilibrium()
        if len(numbers) == 1:
            cases = 41 if cases is None else cases
            return reduce(*request, numbers[0], order, amplitudes[0], cases)
        return reduce_modes(*request, numbers, order, amplitudes, cases, progress=progress)

    def sensors(self, sensors: Sequence[Sensor | float]) -> SensorArray:
        """Place sensors on the beam; see `motion.place_sensors`."""
        return place_sensors(self.assembly, sensors)


if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

T = TypeVar("T")

# Speed of sound along a beam, m/s: soft rubber, and four times as fast as in steel.
_SLOWEST, _FASTEST = 20.0, 2e4
_ANY_BEAM = ("length", "elements", "alpha", "eta", "gravity")
_OTHER_BEAMS = ("left", "right", "masses", "springs")
_SUPPORTS = {"clamped": CLAMPED, "pinned": PINNED, "free": FREE}
_SECTIONS: dict[str, Callable[..., Section]] = {"rectangle": Section.rectangle, "section": Section}


def load_beam(path: str | Path) -> tuple[Beam, SensorArray, list[str]]:
    """Read a beam, its sensors and the columns that they are measured in from a TOML file.

    The table ``[beam]`` holds arguments of `Beam.cantilever`. For any other beam, a table
    ``[beam.rectangle]`` (`Section.rectangle`) or ``[beam.section]`` (`Section`) says what it is
    made of; ``[beam]`` then holds ``length``, ``elements``, ``alpha``, ``eta``, ``gravity``
    (downwards, m/s^2), and ``left`` and ``right``: "clamped", "pinned", "free" or the stiffness of
    a clamp that gives way, N m/rad. ``[[beam.masses]]`` and ``[[beam.springs]]`` hold arguments of
    `PointMass` and `Spring`. The table ``[sensors]`` holds a list ``positions``, m, of transverse
    sensors and a list ``columns`` of names in the measured files.

    Raises
    ------
    ValueError
        For a file that is no TOML, an argument that is unknown, missing or no number, no
        positions, or a beam that cannot be.
    """
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is no TOML: it is no text in UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path} is no TOML: {error}") from error
    try:
        refuse_unknown("a file of a beam", content, ("beam", "sensors"))
        beam = _beam(entries.table("[beam]", content.get("beam", {})))
        if "section" not in content.get("beam", {}):  # whose stiffness is what it is called
            _require_si(beam.section)
        sensors, columns = _sensors(entries.table("[sensors]", content.get("sensors", {})))
        return beam, beam.sensors(sensors), columns
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _beam(values: dict[str, Any]) -> Beam:
    sections = [name for name in _SECTIONS if name in values]
    if not sections:
        for name in (n for n in values if n in _OTHER_BEAMS):
            raise ValueError(
                f"[beam] {name} is of a beam with [beam.rectangle] or [beam.section]: add one of"
                f" these, or leave {name} out"
            )
        return _made(Beam.cantilever, values, "[beam]")
    if len(sections) > 1:
        raise ValueError("[beam.rectangle] and [beam.section] are two sections: give one")
    refuse_unknown("[beam]", values, (*_ANY_BEAM, *_OTHER_BEAMS, *_SECTIONS))
    own = dict(values)
    own["section"] = _made(_SECTIONS[sections[0]], own.pop(sections[0]), f"[beam.{sections[0]}]")
    laws = {"masses": PointMass, "springs": Spring}
    own["effects"] = tuple(
        _made(law, value, f"[[beam.{name}]]")
        for name, law in laws.items()
        for value in entries.items(f"[[beam.{name}]]", own.pop(name, []))
    )
    gravity = own.get("gravity", 9.81)
    own |= {end: _support(own[end], end) for end in ("left", "right") if end in own}
    if not isinstance(gravity, list):
        own["gravity"] = (0.0, -entries.finite("[beam] gravity", gravity))
    return _made(Beam, own, "[beam]")


def _require_si(section: Section) -> None:
    speed = math.sqrt(section.EA / section.mass)
    if not _SLOWEST < speed < _FASTEST:
        raise ValueError(
            f"[beam] sound would travel at {speed:.3g} m/s along the beam, which is no material:"
            " give SI units (m, N/m^2, kg/m^3), not mm, MPa and t/mm^3"
        )


def _support(value: object, end: str) -> Support:
    if isinstance(value, str) and value in _SUPPORTS:
        return _SUPPORTS[value]
    if isinstance(value, float | int) and not isinstance(value, bool):
        return Support.elastic(float(value))
    raise ValueError(
        f"[beam] {end} = {value!r}: give one of {list(_SUPPORTS)}, or a stiffness in N m/rad"
    )


def _sensors(values: dict[str, Any]) -> tuple[list[Sensor], list[str]]:
    refuse_unknown("[sensors]", values, ("positions", "columns"))
    places, columns = values.get("positions", []), values.get("columns", [])
    lists = isinstance(places, list) and isinstance(columns, list)
    if not lists or not places or len(columns) != len(places):
        raise ValueError(
            f"[sensors] has positions = {places} and columns = {columns}: give positions = [...],"
            " in m, and as many columns = [...], names in the measured files"
        )
    names = entries.several(entries.text)("[sensors] columns", columns)
    for name in names:
        if names.count(name) > 1:
            raise ValueError(
                f"[sensors] columns has {name!r} twice: give every position a column of its own"
            )
    at = entries.several(entries.finite)("[sensors] positions", places)
    return [Sensor(x) for x in at], list(names)


def _made(make: Callable[..., T], value: Any, table: str) -> T:
    """Call a constructor with the values of a table; lists stand for tuples."""
    parameters = inspect.signature(make).parameters
    needed = [name for name, p in parameters.items() if p.default is p.empty]
    refuse_unknown(table, entries.table(table, value), list(parameters))
    values = entries.table(table, value, needed)
    readers = {n: _READERS.get(str(parameters[n].annotation)) for n in values}
    # What has no reader was made before.
    return make(**{n: r(f"{table} {n}", values[n]) if r else values[n] for n, r in readers.items()})


def _pair(name: str, value: Any) -> Any:
    if isinstance(value, tuple):
        return value
    pair = entries.several(entries.finite)(name, value)
    if len(pair) != 2:
        raise ValueError(f"{name} = {list(pair)!r:.60} must be two numbers, along and across")
    return pair


_READERS: dict[str, entries.Reader] = {
    **dict.fromkeys(("float", "int", "float | None"), entries.finite),
    "tuple[float, float]": _pair,
}
