"""A planar beam in Exudyn, with connectors of its own, held, let go or hit: an independent witness.

It shares nothing with `romsindy.beam` but the geometry and the field's section forces: other code,
mesh, integrator (generalised alpha), damping, friction and force elements. Needs the extra
"exudyn".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import exudyn as exu
import numpy as np
from beam_truth import BeamTruth, Force
from exudyn import itemInterface as item
from exudyn.solver import ComputeLinearizedSystem
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import eigh

GRAVITY = 9.81


class _Slider(NamedTuple):
    """A friction element: where its memory is, and the coordinate that it holds."""

    memory: int
    coordinate: int


class ExudynBeam:
    """The beam as a multibody system; ``elements`` of three nodes each.

    One that is ``still`` is for statics: without dry friction, and held by loads on all nodes. One
    that moves can be struck at a single node.
    """

    def __init__(
        self, truth: BeamTruth, elements: int, still: bool = False, struck: int | None = None
    ) -> None:
        self.truth = truth
        self.sliders: list[_Slider] = []
        self.n_data = 0
        self.mbs = exu.SystemContainer().AddSystem()
        self.x = _nodes(truth.length, elements, [f.at for f in truth.forces])
        self.ground = self._ground()
        self.nodes = [
            self.mbs.AddNode(item.NodeRigidBody2D(referenceCoordinates=[x, 0.0, 0.0]))
            for x in self.x
        ]
        self._elements()
        self._supports()
        self._spring_and_mass()
        for force in (f for f in truth.forces if not (still and f.kind == "friction")):
            _CONNECTORS[force.kind](self, force)
        loaded = range(3 * len(self.nodes)) if still else [] if struck is None else [3 * struck + 1]
        self.loads = [self._load(i) for i in loaded]
        self.readers = [self._reader(node) for node in self.nodes]
        self.mbs.Assemble()
        self.settings = _settings()

    # -- parts -----------------------------------------------------------------------------------

    def marker(self, node: int, coordinate: int) -> int:
        """A coordinate (x, y, angle) of a node, that connectors act on."""
        marker = item.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate)
        return self.mbs.AddMarker(marker)

    def at(self, place: float) -> int:
        """The node at a place."""
        return self.nodes[int(np.argmin(np.abs(self.x - place)))]

    def memory(self) -> int:
        """A node that keeps the state of a friction element."""
        self.n_data += 3
        data = item.NodeGenericData(numberOfDataCoordinates=3, initialCoordinates=[0.0, 0.0, 0.0])
        return self.mbs.AddNode(data)

    def fixed_point(self, x: float, y: float) -> int:
        """A point of the ground."""
        node = self.mbs.AddNode(item.NodePointGround(referenceCoordinates=[x, y, 0.0]))
        return self.mbs.AddMarker(item.MarkerNodePosition(nodeNumber=node))

    def point(self, place: float) -> int:
        """The marker of a point of the beam."""
        return self.mbs.AddMarker(item.MarkerNodePosition(nodeNumber=self.at(place)))

    def add_mass(self, node: int, mass: float) -> None:
        """A heavy point mass."""
        body = item.ObjectRigidBody2D(nodeNumber=node, mass=mass, inertia=0.0)
        self._weigh(self.mbs.AddObject(body))

    def _ground(self) -> int:
        return self.marker(self.mbs.AddNode(item.NodePointGround()), 0)

    def _weigh(self, body: int) -> None:
        marker = self.mbs.AddMarker(item.MarkerBodyMass(bodyNumber=body))
        pull = [0.0, -GRAVITY, 0.0]
        self.mbs.AddLoad(item.LoadMassProportional(markerNumber=marker, loadVector=pull))

    def _load(self, i: int) -> int:
        marker = self.marker(self.nodes[i // 3], i % 3)
        return self.mbs.AddLoad(item.LoadCoordinate(markerNumber=marker, load=0.0))

    def _reader(self, node: int) -> int:
        return self.mbs.AddSensor(
            item.SensorNode(
                nodeNumber=node,
                storeInternal=True,
                outputVariableType=exu.OutputVariableType.Coordinates,
            )
        )

    def _elements(self) -> None:
        t = self.truth
        area, inertia = t.width * t.thickness, t.width * t.thickness**3 / 12
        shear = 5 / 6 * t.young * area / (2 * (1 + t.poisson))
        for i in range(0, len(self.nodes) - 1, 2):
            length = self.x[i + 2] - self.x[i]
            body = item.ObjectBeamGeometricallyExact2D(
                nodeNumbers=self.nodes[i : i + 3],
                length=length,
                massPerLength=t.density * area,
                crossSectionInertia=t.density * inertia,
                bendingStiffness=t.young * inertia,
                axialStiffness=t.young * area,
                shearStiffness=shear,
                bendingDamping=t.eta * t.young * inertia,
                axialDamping=t.eta * t.young * area,
                shearDamping=t.eta * shear,
            )
            self._weigh(self.mbs.AddObject(body))
            self._external_damping(i, length, t.density * np.array([area, area, inertia]))

    def _external_damping(self, i: int, length: float, density: np.ndarray) -> None:
        """Damping alpha M of one element, which has no mass itself."""
        shape = np.array([[4, 2, -1], [2, 16, 2], [-1, 2, 4]]) * length / 30
        damping = self.truth.alpha * np.kron(shape, np.diag(density))
        zero = np.zeros((9, 9))
        self.mbs.AddObject(
            item.ObjectGenericODE2(
                nodeNumbers=self.nodes[i : i + 3],
                massMatrix=zero,
                stiffnessMatrix=zero,
                dampingMatrix=damping,
            )
        )

    def _supports(self) -> None:
        ends = (
            [self.nodes[0]]
            if self.truth.supports == "cantilever"
            else self.nodes[:: len(self.x) - 1]
        )
        turns = self.truth.supports == "pinned"
        for node in ends:
            soft = self.truth.compliance > 0 and node == self.nodes[0]
            for coordinate in range(2 if turns or soft else 3):
                held = [self.ground, self.marker(node, coordinate)]
                self.mbs.AddObject(item.ObjectConnectorCoordinate(markerNumbers=held))
            if soft and not turns:
                self._connect(node, 2, stiffness=1 / self.truth.compliance)

    def _connect(self, node: int, coordinate: int, **values: Any) -> None:
        markers = [self.ground, self.marker(node, coordinate)]
        spring = item.ObjectConnectorCoordinateSpringDamper(markerNumbers=markers, **values)
        self.mbs.AddObject(spring)

    def _spring_and_mass(self) -> None:
        t = self.truth
        if t.tip_mass > 0:
            self.add_mass(self.nodes[-1], t.tip_mass)
            for coordinate in (0, 1):  # alpha M holds for this mass as well
                self._connect(self.nodes[-1], coordinate, damping=t.alpha * t.tip_mass)
        if t.spring is not None:
            s = t.spring
            self.mbs.AddObject(
                item.ObjectConnectorSpringDamper(
                    markerNumbers=[
                        self.point(t.length),
                        self.fixed_point(t.length + s.length, 0.0),
                    ],
                    stiffness=s.stiffness,
                    referenceLength=s.length - s.tension / s.stiffness,
                )
            )

    # -- statics ---------------------------------------------------------------------------------

    def static(self, load: np.ndarray | None = None, start: np.ndarray | None = None) -> np.ndarray:
        """Coordinates (3 per node) under a dead nodal load beside the weight."""
        self._apply(load)
        if start is not None:
            self._initial(start)
        self.mbs.SolveStatic(self.settings)
        return self.mbs.systemData.GetODE2Coordinates()

    def held_at(
        self, pattern: np.ndarray, node: int, height: float, rest: np.ndarray
    ) -> np.ndarray:
        """Coordinates under a load along a pattern that lifts a node from its rest by a height."""
        y = 3 * node + 1
        flexibility = self.static(1e-6 * pattern, rest)[y] - rest[y]
        factor, state = 0.0, rest
        for share in np.linspace(0.2, 1, 5):  # in steps: a beam stiffens
            target = rest[y] + share * height
            factor += 0.2 * height / flexibility * 1e-6
            before = None
            for _ in range(12):
                state = self.static(factor * pattern, state)
                error = state[y] - target
                if abs(error) < 1e-7 * abs(height):
                    break
                slope = flexibility / 1e-6
                if before is not None and factor != before[0]:
                    slope = (error - before[1]) / (factor - before[0])
                before = factor, error
                factor -= error / slope
        return state

    def mode(self, rest: np.ndarray, number: int = 1) -> tuple[float, np.ndarray, np.ndarray]:
        """Frequency, rad/s, shape and modal force M phi about the rest."""
        self._apply(None)
        self._initial(rest)
        mass, stiffness, _ = ComputeLinearizedSystem(self.mbs, self.settings)
        free = self._free()
        squares, shapes = eigh(
            stiffness[np.ix_(free, free)],
            mass[np.ix_(free, free)],
            subset_by_index=[number - 1, number - 1],
        )
        shape = np.zeros(len(mass))
        shape[free] = shapes[:, 0]
        return math.sqrt(squares[0]), shape, mass @ shape

    def _free(self) -> np.ndarray:
        t, n = self.truth, 3 * len(self.nodes)
        held = [0, 1] + ([2] if t.supports != "pinned" and t.compliance == 0 else [])
        if t.supports != "cantilever":
            held += [n - 3, n - 2] + ([n - 1] if t.supports == "clamped" else [])
        return np.setdiff1d(np.arange(n), held)

    def _apply(self, load: np.ndarray | None) -> None:
        values = np.zeros(len(self.loads)) if load is None else load
        for number, value in zip(self.loads, values, strict=True):
            self.mbs.SetLoadParameter(number, "load", float(value))

    def _initial(self, q: np.ndarray, q_dot: np.ndarray | None = None) -> None:
        initial = exu.ConfigurationType.Initial
        data = self.mbs.systemData
        data.SetODE2Coordinates(q, initial)
        data.SetODE2Coordinates_t(np.zeros_like(q) if q_dot is None else q_dot, initial)

    def _stick(self, start: np.ndarray) -> None:
        """Let bristles begin where the beam is let go."""
        initial = exu.ConfigurationType.Initial
        data = self.mbs.systemData.GetDataCoordinates(initial)
        for slider in self.sliders:
            data[slider.memory + 1] = start[slider.coordinate]
        self.mbs.systemData.SetDataCoordinates(data, initial)

    # -- motion ----------------------------------------------------------------------------------

    def motion(
        self,
        start: np.ndarray,
        duration: float,
        step: float,
        every: int,
        blow: Callable[[float], float] | None = None,
    ) -> np.ndarray:
        """All coordinates, (n_samples, n), every few steps, let go at rest from ``start``.

        ``blow(t)`` is the transverse force on the node that is struck, N.
        """
        self._apply(None)
        self._initial(start)
        self._stick(start)
        if blow is not None:

            def strike(mbs: Any, t: float) -> bool:
                mbs.SetLoadParameter(self.loads[0], "load", blow(t))
                return True

            self.mbs.SetPreStepUserFunction(strike)
        time = self.settings.timeIntegration
        time.numberOfSteps, time.endTime = round(duration / step), duration
        # every step: longer periods are rounded now and then
        self.settings.solution.sensors.writePeriod = step
        self.mbs.SolveDynamic(self.settings)
        self.mbs.SetPreStepUserFunction(0)
        columns = [self.mbs.GetSensorStoredData(s)[::every, 1:4] for s in self.readers]
        return np.concatenate(columns, axis=1)

    def read(self, motion: np.ndarray, rest: np.ndarray, places: Sequence[float]) -> np.ndarray:
        """Transverse displacements from the rest, (n_samples, n_places), m."""
        moved = (motion - rest).reshape(len(motion), -1, 3)
        slope = np.sin(motion.reshape(len(motion), -1, 3)[..., 2])
        slope = slope - np.sin(rest.reshape(-1, 3)[:, 2])
        return CubicHermiteSpline(self.x, moved[..., 1], slope, axis=1)(places)


def _nodes(length: float, elements: int, places: Sequence[float]) -> np.ndarray:
    """Ends and middles of the elements, an end at every place."""
    ends = np.linspace(0, length, elements + 1)
    for place in places:
        ends[int(np.argmin(np.abs(ends - place)))] = place
    nodes = np.empty(2 * elements + 1)
    nodes[::2] = ends
    nodes[1::2] = 0.5 * (ends[1:] + ends[:-1])
    return nodes


def _settings() -> Any:
    settings = exu.SimulationSettings()
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    static, time = settings.staticSolver, settings.timeIntegration
    static.newton.residualMode = 1  # forces: their scale is near zero
    static.newton.relativeTolerance = static.newton.absoluteTolerance = 1e-9
    static.numberOfLoadSteps = 1
    static.verboseMode = time.verboseMode = 0
    time.generalizedAlpha.spectralRadius = 0.9
    # the residual stops falling near 3e-7 N, by the rounding of EA
    time.newton.relativeTolerance = time.newton.absoluteTolerance = 1e-5
    return settings


# -- connectors ----------------------------------------------------------------------------------


def _damper(beam: ExudynBeam, force: Force) -> None:
    beam._connect(beam.at(force.at), 1, damping=force.values["damping"])


def _friction(beam: ExudynBeam, force: Force) -> None:
    """A bristle, much stiffer than the beam, that slides at its force."""
    node = beam.at(force.at)
    bristle = item.ObjectConnectorCoordinateSpringDamperExt(
        markerNumbers=[beam.ground, beam.marker(node, 1)],
        nodeNumber=beam.memory(),
        dynamicFrictionForce=force.values["force"],
        stickingStiffness=1e4,
    )
    beam.mbs.AddObject(bristle)
    beam.sliders.append(_Slider(beam.n_data - 3, 3 * beam.nodes.index(node) + 1))


def _stops(beam: ExudynBeam, force: Force) -> None:
    """Stiff beyond ``low`` or ``high``, m from the straight axis."""
    v = force.values
    beam.mbs.AddObject(
        item.ObjectConnectorCoordinateSpringDamperExt(
            markerNumbers=[beam.ground, beam.marker(beam.at(force.at), 1)],
            nodeNumber=beam.memory(),
            limitStopsUpper=v["high"],
            limitStopsLower=v["low"],
            limitStopsStiffness=v["stiffness"],
            useLimitStops=True,
        )
    )


def _cubic(beam: ExudynBeam, force: Force) -> None:
    k = force.values["stiffness"]

    def pull(mbs, t, number, u, v, stiffness, damping, offset):
        return k * u**3

    beam._connect(beam.at(force.at), 1, springForceUserFunction=pull)


def _magnet(beam: ExudynBeam, force: Force) -> None:
    """A pole above or below the place that attracts with a power of the distance."""
    strength, exponent = force.values["strength"], force.values["exponent"]

    def pull(mbs, t, number, stretch, speed, k, d, f):
        return strength / (stretch + 1.0) ** exponent

    beam.mbs.AddObject(
        item.ObjectConnectorSpringDamper(
            markerNumbers=[
                beam.point(force.at),
                beam.fixed_point(force.at, force.values["height"]),
            ],
            referenceLength=1.0,
            springForceUserFunction=pull,
        )
    )


def _mass(beam: ExudynBeam, force: Force) -> None:
    beam.add_mass(beam.at(force.at), force.values["mass"])


def _drag(beam: ExudynBeam, force: Force) -> None:
    """Drag c |v| v per length across the beam, along all of it."""
    c = force.values["coefficient"]
    lengths = np.gradient(beam.x)
    lengths[[0, -1]] *= 0.5
    n = 3 * len(beam.nodes)
    zero = np.zeros((n, n))

    def pull(mbs, t, number, q, q_dot):
        moved = np.zeros(n)
        moved[1::3] = -c * lengths * np.abs(q_dot[1::3]) * q_dot[1::3]  # on the right-hand side
        return moved

    beam.mbs.AddObject(
        item.ObjectGenericODE2(
            nodeNumbers=beam.nodes,
            massMatrix=zero,
            stiffnessMatrix=zero,
            dampingMatrix=zero,
            forceUserFunction=pull,
            jacobianUserFunction=lambda mbs, t, number, q, q_dot, a, b: np.zeros((n, n)),
        )
    )


_CONNECTORS: dict[str, Callable[[ExudynBeam, Force], None]] = {
    "damper": _damper,
    "friction": _friction,
    "stop": _stops,
    "cubic": _cubic,
    "magnet": _magnet,
    "mass": _mass,
    "drag": _drag,
}
