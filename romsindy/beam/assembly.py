"""The discretised beam: forces, tangents, mass and energy of all elements and effects.

The beam is straight at rest along x. Nodal fields are (n_nodes, 3) with (u, w, theta) per node:
axial and transverse displacement [m] and rotation [rad] of the section. Matrices are kept per
element, (n_elements, 9, 9); see `kernel.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from romsindy.beam import kernel
from romsindy.beam.structure import BeamStructure, Section
from romsindy.effects.mounting import MountedLaw, Point, PointMass, Vector
from romsindy.physics.validation import require_position


def shape_functions(xi: float) -> np.ndarray:
    """Return the three quadratic shape functions at xi in [-1, 1]."""
    return np.array([0.5 * xi * (xi - 1.0), 1.0 - xi * xi, 0.5 * xi * (xi + 1.0)])


def element_mass(length: float, section: Section) -> np.ndarray:
    """Return the consistent mass matrix, shape (9, 9); constant, since the motion is planar.

    Integrated with three Gauss points, which is exact.
    """
    density = np.diag([section.mass, section.mass, section.rotary_inertia])
    M = np.zeros((9, 9))
    for xi, weight in zip(*np.polynomial.legendre.leggauss(3), strict=True):
        N = shape_functions(xi)
        M += 0.5 * length * weight * np.kron(np.outer(N, N), density)
    return M


class BeamPoint:
    """A point of the beam as a row of shape functions over the three nodes of one element."""

    def __init__(self, position: float, length: float, n_elements: int) -> None:
        self.s = position
        self.element = min(int(position / length * n_elements), n_elements - 1)
        xi = 2.0 * (position / length * n_elements - self.element) - 1.0
        self.nodes = slice(2 * self.element, 2 * self.element + 3)
        self.weights = shape_functions(xi)
        self.spread = np.kron(self.weights, np.eye(3))  # (3, 9): point <- element
        nearest = int(np.argmax(self.weights))
        # most points sit on a node; reading that alone is what keeps effects cheap
        on_node = abs(self.weights[nearest] - 1.0) < 1e-9
        self._node = 2 * self.element + nearest if on_node else None

    def of(self, field: np.ndarray) -> np.ndarray:
        """Return the value at the point of a nodal field (..., n_nodes, 3)."""
        if self._node is not None:
            return field[..., self._node, :]
        return self.weights @ field[..., self.nodes, :]

    def points(self, X: np.ndarray, V: np.ndarray) -> list[Point]:
        """Return where the point is and how it moves in several states, (n_states, n_nodes, 3)."""
        # Plain floats: laws take one point at a time several times as fast as short arrays.
        return [
            Point(self.s, self.s + u, w, theta, *rates)
            for (u, w, theta), rates in zip(self.of(X).tolist(), self.of(V).tolist(), strict=True)
        ]

    def point(self, x: np.ndarray, v: np.ndarray) -> Point:
        """Return the same in one state, (n_nodes, 3)."""
        return self.points(x[None], v[None])[0]

    def subtract(self, forces: Sequence[Vector], out: np.ndarray) -> None:
        """Subtract forces at the point, one for each state, from nodal fields."""
        if self._node is not None:
            out[:, self._node] -= forces
        else:
            out[:, self.nodes] -= self.weights[:, None] * np.array(forces)[:, None]


def _force_of(loads: Sequence[MountedLaw], point: Point) -> Vector:
    """Return the force of several loads at one point."""
    fx, fy, moment = loads[0].force(point)
    for load in loads[1:]:
        more = load.force(point)
        fx, fy, moment = fx + more[0], fy + more[1], moment + more[2]
    return fx, fy, moment


class Assembly:
    """Everything that statics, modes and the transient need to know of a beam."""

    def __init__(self, structure: BeamStructure) -> None:
        self.n_elements = structure.elements
        self.n_nodes = 2 * structure.elements + 1
        self.s = np.linspace(0.0, structure.length, self.n_nodes)
        self.structure = structure
        self._length = structure.length / structure.elements
        section = structure.section
        self._stiffness = (self._length, section.EA, section.GA, section.EI)
        self.alpha, self.eta = float(structure.alpha), float(structure.eta)  # an int compiles again
        self._rest = np.zeros((self.n_nodes, 3))
        # Simpson weights: exact for the consistent load of a quadratic element
        self.tributary = np.zeros(self.n_nodes)
        for i, share in enumerate((1.0, 4.0, 1.0)):
            stop = self.n_nodes - 2 + i
            self.tributary[i:stop:2] += share / 6.0 * self._length
        loads = [e for e in structure.effects if isinstance(e, MountedLaw)]
        # Loads at the same place share its motion.
        places = dict.fromkeys(e.at for e in loads if not e.distributed)
        self._point_loads = [
            (self.place(at), [e for e in loads if not e.distributed and e.at == at])
            for at in places
        ]
        self._line_loads = [e for e in loads if e.distributed]
        self._dissipates = any(e.dissipates for e in loads)
        self.mass = self._mass_matrices()
        self._alpha_mass = structure.alpha * self.mass
        self.fixed, self._ground = self._supports()
        self._free = np.where(self.fixed, 0.0, 1.0)  # a product is faster than a mask
        self.weight = self.mass_times(np.broadcast_to([*structure.gravity, 0.0], self._rest.shape))

    def place(self, at: float | None) -> BeamPoint:
        """Return the place at a position on the axis, m; None is the right end."""
        length = self.structure.length
        return BeamPoint(length if at is None else at, length, self.n_elements)

    def point_load(
        self, force: tuple[float, float] = (0.0, 0.0), moment: float = 0.0, at: float | None = None
    ) -> np.ndarray:
        """Return the nodal load of a dead force (N) and moment (N m) at a point (default: tip).

        A load is what does work on a displacement, so a unit load also reads the displacement.
        """
        if at is not None:
            require_position("at", at, self.structure.length)
        load = np.zeros_like(self._rest)
        place = self.place(at)
        load[place.nodes] = np.multiply.outer(place.weights, (*force, moment))
        return load

    def _mass_matrices(self) -> np.ndarray:
        element = element_mass(self._length, self.structure.section)
        M = np.repeat(element[None], self.n_elements, axis=0)
        for effect in self.structure.effects:
            if isinstance(effect, PointMass):
                place = self.place(effect.at)
                inertia = np.diag([effect.mass, effect.mass, effect.rotary_inertia])
                M[place.element] += place.spread.T @ inertia @ place.spread
        return M

    def _supports(self) -> tuple[np.ndarray, np.ndarray]:
        """Return which freedoms are fixed and the rotational springs (left, right) [N m/rad]."""
        fixed = np.zeros((self.n_nodes, 3), dtype=bool)
        ends = self.structure.left, self.structure.right
        fixed[[0, -1]] = [end.fixed for end in ends]
        return fixed, np.array([end.rotational_stiffness for end in ends])

    def mass_times(self, field: np.ndarray) -> np.ndarray:
        """Return M field."""
        out = np.zeros_like(self._rest)
        kernel.add_product(self.mass, np.ascontiguousarray(field), out)
        return out

    def _points(self, x: np.ndarray, v: np.ndarray) -> Point:
        return Point(self.s, self.s + x[:, 0], x[:, 1], x[:, 2], v[:, 0], v[:, 1], v[:, 2])

    def _add_loads(self, X: np.ndarray, V: np.ndarray, out: np.ndarray) -> None:
        """Subtract the force of every load in several states from `out`, (n_states, n_nodes, 3)."""
        for place, loads in self._point_loads:
            place.subtract([_force_of(loads, point) for point in place.points(X, V)], out)
        for line in self._line_loads:
            for x, v, field in zip(X, V, out, strict=True):
                for i, density in enumerate(line.force(self._points(x, v))):
                    field[:, i] -= self.tributary * density

    def _load_power(self, x: np.ndarray, v: np.ndarray) -> float:
        """Return what the loads dissipate [W]."""
        power = 0.0
        for place, loads in self._point_loads:
            point = place.point(x, v)
            power += sum(float(load.power(point)) for load in loads if load.dissipates)
        for line in self._line_loads:
            power += float(self.tributary @ line.power(self._points(x, v)))
        return power

    def residual(self, x: np.ndarray, v: np.ndarray | None = None) -> tuple[np.ndarray, float]:
        """Return (r, power): M x_ddot + r = 0 in free motion, and the power dissipated [W].

        r holds internal and damping forces, effects and weight; fixed freedoms are zero.
        """
        rate = self._rest if v is None else v
        out = -self.weight
        power = kernel.add_internal_force(x, rate, *self._stiffness, self.eta, out)
        if v is not None and self.alpha:
            drag = self.alpha * self.mass_times(v)
            out += drag
            power += float(np.vdot(drag, v))
        out[0, 2] += self._ground[0] * x[0, 2]
        out[-1, 2] += self._ground[1] * x[-1, 2]
        self._add_loads(x[None], rate[None], out[None])
        power += self._load_power(x, rate) if self._dissipates else 0.0
        out[self.fixed] = 0.0
        return out, power

    def stage_residuals(self, X: np.ndarray, V: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a_i + r(x_i, v_i) of several states at once, (n_states, n_nodes, 3)."""
        R = kernel.stage_residuals(
            X, V, a, self.mass, self.alpha, self.weight, *self._stiffness, self.eta
        )
        R[:, 0, 2] += self._ground[0] * X[:, 0, 2]
        R[:, -1, 2] += self._ground[1] * X[:, -1, 2]
        self._add_loads(X, V, R)
        R *= self._free
        return R

    def rounding(self, X: np.ndarray) -> float:
        """Return the acceleration [m/s^2] up to which rounding the displacements X is felt.

        Slopes are differences of displacements within an element: strains are in doubt by
        epsilon |X| / h, with h the length of an element, and EA / (mass h) makes that an
        acceleration.
        """
        length, EA, *_ = self._stiffness
        doubt = np.finfo(float).eps * float(np.abs(X[..., :2]).max()) / length
        return doubt * EA / (self.structure.section.mass * length)

    def stage_powers(self, X: np.ndarray, V: np.ndarray) -> np.ndarray:
        """Return the power dissipated [W] in several states."""
        powers = kernel.stage_powers(X, V, self.mass, self.alpha, *self._stiffness, self.eta)
        if self._dissipates:
            powers += [self._load_power(x, v) for x, v in zip(X, V, strict=True)]
        return powers

    def smooth_acceleration(
        self, x: np.ndarray, v: np.ndarray, load: np.ndarray, stiffening: float
    ) -> np.ndarray:
        """Return the acceleration in x with velocity v, without short axial and shear waves.

        Solve (M + stiffening^2 D) a = load - r, where D is the axial and shear stiffness alone.  A
        force that is suddenly taken away, or put on, starts waves; those much faster than
        `stiffening` [s] have died when the next sample is taken, and the motion that remains starts
        with this acceleration: that of a beam which neither stretches nor shears.
        """
        length, EA, GA, _ = self._stiffness
        _, D = kernel.tangent(x, length, EA, GA, 0.0)
        factors = factorise(self.mass + stiffening**2 * D, self.fixed)
        residual, _ = self.residual(x, v)
        return solve(factors, load - residual)

    def tangents(self, x: np.ndarray, v: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return (K, C), (n_elements, 9, 9): derivatives of the residual to x and to v.

        K leaves out how the material damping force turns with the section: a term of size
        eta * strain rate that a Newton iteration does not miss.
        """
        K, C = kernel.tangent(x, *self._stiffness)
        K += C
        C *= self.eta
        if self.alpha:
            C += self._alpha_mass
        self._add_supports_and_loads(x, self._rest if v is None else v, K, C)
        return K, C

    def _add_supports_and_loads(
        self, x: np.ndarray, v: np.ndarray, K: np.ndarray, C: np.ndarray
    ) -> None:
        K[0, 2, 2] += self._ground[0]
        K[-1, 8, 8] += self._ground[1]
        for place, loads in self._point_loads:
            point = place.point(x, v)
            for load in loads:
                K[place.element] += place.spread.T @ np.array(load.tangent(point)) @ place.spread
                if load.dissipates:
                    rows: Any = load.damping_tangent(point)
                    C[place.element] += place.spread.T @ np.array(rows) @ place.spread
        for line in self._line_loads:
            points = self._points(x, v)
            for matrices, block in ((K, line.tangent(points)), (C, line.damping_tangent(points))):
                self._add_blocks(matrices, block)

    def modal_stiffness(self, x: np.ndarray, phi: np.ndarray) -> float:
        """Return phi^T K phi at x, summed from squared strains.

        K itself holds EA beside EI; in a product with it the bending of a very thin beam would
        drown in rounding.
        """
        rest, _ = kernel.tangent(x, *self._stiffness)
        self._add_supports_and_loads(x, self._rest, rest, np.zeros_like(rest))
        product = np.zeros_like(self._rest)
        kernel.add_product(rest, phi, product)
        return self.material_stiffness(x, phi) + float(np.vdot(phi, product))

    def material_stiffness(self, x: np.ndarray, v: np.ndarray) -> float:
        """Return v^T D v of the material alone at x: the integral of e'^T C e' for strain rates."""
        # with eta = 1 that is the damping power of the velocity v
        scratch = np.zeros_like(self._rest)
        return float(kernel.add_internal_force(x, v, *self._stiffness, 1.0, scratch))

    def _add_blocks(self, matrices: np.ndarray, rows: object) -> None:
        """Add a 3 x 3 block per node (given as rows of arrays) to the element matrices."""
        blocks = np.array([[np.broadcast_to(c, self.s.shape) for c in r] for r in rows])  # type: ignore[attr-defined]
        blocks = np.moveaxis(blocks, -1, 0) * self.tributary[:, None, None]
        matrices[:, :3, :3] += blocks[:-1:2]
        matrices[:, 3:6, 3:6] += blocks[1::2]
        matrices[-1, 6:, 6:] += blocks[-1]

    def kinetic(self, v: np.ndarray) -> float:
        """Return the kinetic energy [J]."""
        return 0.5 * float(np.vdot(v, self.mass_times(v)))

    def strain(self, x: np.ndarray) -> float:
        """Return the strain energy of beam and elastic clamps [J]."""
        ends = 0.5 * float(self._ground @ x[[0, -1], 2] ** 2)
        return float(kernel.strain_energy(x, *self._stiffness)) + ends

    def potential(self, x: np.ndarray) -> float:
        """Return the potential energy of gravity and of the effects that store energy [J]."""
        energy = -float(np.vdot(self.weight, x))
        for place, loads in self._point_loads:
            point = place.point(x, self._rest)
            energy += float(sum(load.potential(point) for load in loads))
        for line in self._line_loads:
            density = line.potential(self._points(x, self._rest))
            energy += float(np.sum(self.tributary * density))
        return energy


def factorise(matrices: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Return the factors of a chain of element matrices, which are overwritten."""
    kernel.factorise(matrices, fixed)
    return matrices


def solve(factors: np.ndarray, rhs: np.ndarray) -> np.ndarray:
    """Return the nodal field (n_nodes, 3) that solves the factorised system."""
    out = rhs.astype(factors.dtype).reshape(-1)
    kernel.solve(factors, out)
    return out.reshape(-1, 3)
