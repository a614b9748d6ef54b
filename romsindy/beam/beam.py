"""The beam: what it is made of, and the one place from which everything else is asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from romsindy.beam.assembly import Assembly
from romsindy.beam.modes import ModalBasis, solve_modes
from romsindy.beam.section import Section
from romsindy.beam.spring import Spring
from romsindy.beam.statics import Control, find_displaced, find_equilibrium
from romsindy.beam.validation import require_finite, require_position, require_positive
from romsindy.effects.load import MountedLaw, PointMass
from romsindy.effects.mounting import TowardsAnchor

if TYPE_CHECKING:
    from romsindy.beam.collocation import RadauIIA
    from romsindy.beam.motion import Motion
    from romsindy.beam.normal_modes import NormalMode
    from romsindy.beam.sensors import Sensor, SensorArray
    from romsindy.physics.model import ReducedModel


@dataclass(frozen=True)
class Support:
    """What holds one end of the beam.

    Parameters
    ----------
    fixed
        Whether u, w and theta are held.
    rotational_stiffness
        Spring [N m/rad] between the section and the ground.

    Raises
    ------
    ValueError
        For a negative stiffness.
    """

    fixed: tuple[bool, bool, bool] = (False, False, False)
    rotational_stiffness: float = 0.0

    def __post_init__(self) -> None:
        require_positive("rotational_stiffness", self.rotational_stiffness, zero_allowed=True)

    @classmethod
    def elastic(cls, rotational_stiffness: float) -> Support:
        """Make a clamp that gives way in rotation [N m/rad]."""
        return cls((True, True, False), rotational_stiffness)


FREE = Support()
PINNED = Support((True, True, False))
CLAMPED = Support((True, True, True))


@dataclass(frozen=True, eq=False)
class Shape:
    """A static state: nodal displacements and the load that holds them.

    Attributes
    ----------
    s
        Positions of the nodes on the undeformed axis [m], shape (n_nodes,).
    displacement
        (u, w, theta) [m, m, rad] from the straight rest, shape (n_nodes, 3).
    load
        The dead nodal load (fx, fy, moment) [N, N, N m] beside weight and effects.
    """

    s: np.ndarray
    displacement: np.ndarray
    load: np.ndarray

    @property
    def tip(self) -> np.ndarray:
        """(u, w, theta) of the right end."""
        return self.displacement[-1]

    def __repr__(self) -> str:
        u, w, theta = self.tip
        return (
            f"Shape(tip u = {u:.6g} m, w = {w:.6g} m, theta = {theta:.6g} rad,\n"
            f"      held by {np.linalg.norm(self.load[:, :2].sum(axis=0)):.6g} N)"
        )


@dataclass(frozen=True)
class Beam:
    """A planar, geometrically exact beam, straight at rest along x, with gravity and effects.

    Parameters
    ----------
    length
        Length [m].
    section
        Stiffness and inertia of the cross-section.
    elements
        Number of quadratic elements (two nodes each).
    left, right
        The supports.
    gravity
        Acceleration (gx, gy) [m/s^2].
    alpha
        Mass-proportional damping [1/s].
    eta
        Stiffness-proportional damping [s]; acts on strain rates.
    effects
        Point masses, springs and whatever `with_effect` has added.

    Raises
    ------
    ValueError
        For a length that is not positive, fewer than one element, negative damping,
        an effect off the beam, or a spring whose anchor is on its own point of the beam.
    """

    length: float
    section: Section
    elements: int = 150
    left: Support = CLAMPED
    right: Support = FREE
    gravity: tuple[float, float] = (0.0, -9.81)
    alpha: float = 0.0
    eta: float = 0.0
    effects: tuple[MountedLaw | PointMass, ...] = ()

    def __post_init__(self) -> None:
        require_positive("length", self.length)
        require_positive("alpha", self.alpha, zero_allowed=True)
        require_positive("eta", self.eta, zero_allowed=True)
        for value in self.gravity:
            require_finite("gravity", value)
        if int(self.elements) != self.elements or self.elements < 1:
            raise ValueError(f"elements must be a positive whole number, got {self.elements}")
        for effect in self.effects:
            at = getattr(effect, "at", None)
            position = self.length if at is None else at
            require_position(f"at of {type(effect).__name__}", position, self.length)
            mounting = getattr(effect, "mounting", None)
            if not isinstance(mounting, TowardsAnchor):
                continue
            if mounting.span(position, 0.0) < 1e-9 * self.length:
                raise ValueError(
                    f"anchor = {mounting.anchor} lies on the beam's own point at {position} m, so "
                    "the spring has no length and no direction; move the anchor away"
                )

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
        length, width, thickness
            Dimensions [m]; the beam bends in the thickness direction.
        young, poisson, density
            Material [Pa, -, kg/m^3].
        tip_mass
            Mass [kg] at the tip.
        spring_stiffness, spring_length, spring_pretension
            [N/m], [m], [N]; the natural
            length is spring_length - spring_pretension / spring_stiffness.
        gravity
            Acceleration [m/s^2], downwards.
        alpha, eta
            Rayleigh damping [1/s], [s].
        elements
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
        return effect.applied_to(self)

    @cached_property
    def assembly(self) -> Assembly:
        """The discretised beam."""
        return Assembly(self)

    # -- loads ---------------------------------------------------------------------------------

    def point_load(
        self, force: tuple[float, float] = (0.0, 0.0), moment: float = 0.0, at: float | None = None
    ) -> np.ndarray:
        """Return the nodal load of a dead force [N] and moment [N m] at a point (default: tip)."""
        if at is not None:
            require_position("at", at, self.length)
        load = np.zeros_like(self.assembly.weight)
        place = self.assembly.place(at)
        load[place.nodes] = np.multiply.outer(place.weights, (*force, moment))
        return load

    def line_load(self, force: tuple[float, float]) -> np.ndarray:
        """Return the nodal load of a uniform dead force per unit length [N/m]."""
        return np.multiply.outer(self.assembly.tributary, (*force, 0.0))

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
        if load is None:
            return self._rest_equilibrium
        return self.shape(find_equilibrium(self.assembly, load), load)

    @cached_property
    def _rest_equilibrium(self) -> Shape:
        return self.shape(find_equilibrium(self.assembly))

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
        tip_displacement
            Transverse displacement [m] of the right end from its equilibrium.
        mode
            Hold by the modal force f M phi of this mode (1, 2, ...), which leaves the other
            modes almost at rest; None holds by a transverse force at the point itself.
        at
            Point [m] that is displaced instead of the tip, for a beam whose right end is held.

        Raises
        ------
        ValueError
            For a mode that does not exist, or a displacement longer than the beam.
        NoEquilibriumError
            If the beam cannot be held there.
        """
        require_finite("tip_displacement", tip_displacement)
        rest = self.equilibrium()
        tip = self.point_load((0.0, 1.0), at=at)
        if not np.any(tip[~self.assembly.fixed]):
            raise ValueError(
                f"at = {at} is a point that is held; give a point between the supports"
            )
        height = float(np.vdot(tip, rest.displacement))
        goal = height + tip_displacement
        if abs(goal) >= self.length:
            raise ValueError(
                f"tip_displacement = {tip_displacement} m is beyond the reach of a beam of "
                f"{self.length} m whose tip rests at {height:.3g} m; ask for less"
            )
        pattern = tip if mode is None else self._modal_load(mode)
        x, factor = find_displaced(self.assembly, rest.displacement, pattern, Control(tip), goal)
        return self.shape(x, factor * pattern)

    def _modal_load(self, mode: int) -> np.ndarray:
        if mode < 1:
            raise ValueError(f"mode = {mode} does not exist; modes count from 1")
        return self.assembly.mass_times(self.modes(count=mode).shape(mode))

    # -- motion, reduced model, sensors --------------------------------------------------------

    def simulate(
        self,
        shape: Shape,
        duration: float,
        step: float = 1e-3,
        *,
        energy_tolerance: float = 1e-4,
        modes: ModalBasis | None = None,
        sensors: SensorArray | None = None,
        keep_field: bool = False,
        method: RadauIIA | None = None,
        progress: bool = True,
    ) -> Motion:
        """Let the beam go from rest in `shape` and follow its motion; see `transient.simulate`."""
        from romsindy.beam.transient import simulate

        return simulate(
            self,
            shape,
            duration,
            step,
            energy_tolerance=energy_tolerance,
            modes=modes,
            sensors=sensors,
            keep_field=keep_field,
            method=method,
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
        """Return periodic orbits of the undamped beam; see `orbits.find_normal_mode`."""
        from romsindy.beam.normal_modes import find_normal_mode

        return find_normal_mode(self, tip_displacements, mode, forces, progress=progress)

    def reduce(
        self, mode: int = 1, order: int = 5, amplitude: float = 0.024, cases: int = 41
    ) -> ReducedModel:
        """Return the single-mode reduced model from static cases; see `reduction.reduce`."""
        from romsindy.beam.reduction import reduce

        return reduce(self, mode, order, amplitude, cases)

    def sensors(self, sensors: Sequence[Sensor | float]) -> SensorArray:
        """Place sensors on the beam; see `sensors.SensorArray`."""
        from romsindy.beam.sensors import place_sensors

        return place_sensors(self, sensors)
