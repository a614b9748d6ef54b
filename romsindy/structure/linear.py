"""A structure of finite elements about its rest: mass, linear modes, and where its freedoms are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import eigvalsh
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import eigsh, splu

from romsindy.structure.deck import DeckError
from romsindy.typing import Array

# Of the largest stiffness over mass: below the first a mode is no vibration, the other is a shift
# without which a structure that nothing supports would divide by zero.
_RIGID, _SHIFT = 1e-13, 1e-12
_SYMMETRIC = 1e-8  # of the largest mass
_AS_LARGE = 0.99  # of the largest movement: as large, but for rounding
_SLIGHT = 1e-5  # of the largest eigenvalue of the mass: so negative is rounding


class Units(NamedTuple):
    """SI units in one of a model: m, kg."""

    length: float = 1.0
    mass: float = 1.0

    @property
    def force(self) -> float:
        """N in a unit of force; times are in s."""
        return self.length * self.mass


class Matrices(NamedTuple):
    """Stiffness and mass of the free freedoms, and which these are."""

    stiffness: Any  # (n, n) csc_array; None where modes were kept, which alone ask for it
    mass: csc_array
    nodes: Array  # (n,), numbers
    directions: Array  # (n,), 1 to 3


class HeldCases(NamedTuple):
    """Static cases: shapes that multiples of one load hold."""

    factors: Array  # (m,)
    shapes: Array  # (m, n), displacements of the free freedoms; nan where nothing holds

    @property
    def reached(self) -> HeldCases:
        """Those that have a shape."""
        there = np.all(np.isfinite(self.shapes), axis=1)
        return HeldCases(self.factors[there], self.shapes[there])


@dataclass(frozen=True, eq=False)
class LinearMode:
    """A linear mode of a structure: x = phi q with phi^T M phi = 1."""

    number: int
    omega2: float
    shape: Array  # (n,), phi, positive where it is largest
    mass: csc_array  # (n, n)

    @cached_property
    def momentum(self) -> Array:
        """M phi, (n,)."""
        return np.asarray(self.mass @ self.shape)

    @cached_property
    def loudest(self) -> int:
        """The freedom that moves most."""
        return int(np.argmax(np.abs(self.shape)))


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A structure about its rest."""

    name: str
    mass: csc_array  # (n, n), of the free freedoms
    omega: Array  # (k,), of the modes, rad/s
    shapes: Array  # (k, n), mass-normalised
    nodes: Array  # (n,), number of the node of each freedom
    directions: Array  # (n,), 1 to 3
    coordinates: Mapping[int, Array]  # (3,) by number of the node
    notes: tuple[str, ...] = ()
    faces: Sequence[tuple[int, ...]] = field(default=(), repr=False)  # nodes of outer faces
    node_of: Callable[[str], int] = field(default=lambda name: _number_of(name), repr=False)

    def __repr__(self) -> str:
        hz = ", ".join(f"{w / (2 * np.pi):.4g}" for w in self.omega[:5])
        return (
            f"{type(self).__name__}({self.name!r}, {len(self.nodes)} free degrees of freedom,"
            f" frequencies {hz} ... Hz)"
        )

    def mode(self, number: int) -> LinearMode:
        """A linear mode, counted from 1.

        Raises a ValueError for a mode that is not known, or is a motion without stiffness.
        """
        if not 1 <= number <= len(self.omega):
            raise ValueError(
                f"mode = {number} is not known of {self.name}, which has {len(self.omega)}; modes"
                " count from 1"
            )
        if not self.omega[number - 1] > 0:
            raise ValueError(
                f"mode = {number} of {self.name} is rigid: nothing brings it back to its rest; give"
                " supports, or take a higher mode"
            )
        row = number - 1
        return LinearMode(number, float(self.omega[row] ** 2), self.shapes[row], self.mass)

    def gives(self, row: int, rows: Sequence[int], beside: Sequence[int]) -> Array:
        """What a unit of force at a freedom moves others by at rest, beside some modes, by number.

        Residual flexibility, of all other modes that are known.
        """
        others = np.setdiff1d(np.flatnonzero(self.omega), np.asarray(beside) - 1)
        shapes = self.shapes[others]
        return np.asarray((shapes[:, row] / self.omega[others] ** 2) @ shapes[:, rows])

    def counts(self, row: int, mass: float, kept: Sequence[int]) -> Array:
        """How many times as much a mass at a freedom counts in some modes, by number, alone.

        They have the frequencies then that they have with all others that are known, by the
        residues of the secular equation of a change of rank one [1].

        [1] G. H. Golub, "Some modified matrix eigenvalue problems", SIAM Rev. 15 (1973), sec. 5.
        """
        known = np.flatnonzero(self.omega)
        square, phi = self.omega[known] ** 2, self.shapes[known, row]
        turned = self.omega[known] * phi
        with_it = eigvalsh(np.diag(square) - np.outer(turned, turned) / (1 / mass + phi @ phi))
        at = np.searchsorted(known, np.asarray(kept) - 1)
        square, found, phi = square[at], with_it[np.argsort(np.argsort(square))][at], phi[at]
        with np.errstate(divide="ignore", invalid="ignore"):
            apart = (found - square[:, None]) / (square - square[:, None])
            np.fill_diagonal(apart, 1 - found / square)
            times = np.prod(apart, axis=1) * np.prod(square / found) / (mass * phi**2)
        return np.where(np.isfinite(times) & (times > 0), times, 1.0) ** 0.5

    def freedom(self, node: int | str, direction: int) -> int:
        """Row of a node's displacement in a direction (1 to 3) among the free freedoms.

        Raises a ValueError where the node is not there, or is held in that direction.
        """
        number = self.node_of(str(node))
        rows = np.flatnonzero((self.nodes == number) & (self.directions == direction))
        if not len(rows):
            free = self.directions[self.nodes == number]
            has = f"free in {sorted(map(int, free))}" if len(free) else "held, or not there"
            raise ValueError(
                f"node {node} of {self.name} is not free in direction {direction}: it is {has}; its"
                " directions are 1, 2 and 3"
            )
        return int(rows[0])


class Compliance(NamedTuple):
    """What loads M phi of some modes do where a structure is held along one of them."""

    at: Array  # (m,), its coordinates
    shapes: Array  # (m, k, n), K_T^-1 M phi of modes, that one the first


def compliance(tangent: csc_array, mass: csc_array, shapes: Array) -> Array:
    """K_T^-1 M phi of modes (k, n), a row for each, by a tangent stiffness K_T."""
    return np.asarray(splu(csc_array(tangent)).solve(np.asarray(mass @ shapes.T)).T)


class Basis(NamedTuple):
    """The lowest modes of a structure."""

    known: Matrices
    omega: Array  # (k,), rad/s
    shapes: Array  # (k, n), mass-normalised


def _number_of(name: str) -> int:
    """A node by its number; raises a ValueError for a name, of which arrays have none."""
    if not name.isdigit():
        raise ValueError(f"node {name!r} is no number: a structure of arrays has no sets of nodes")
    return int(name)


def linear_modes(name: str, known: Matrices, count: int) -> Basis:
    """The lowest modes, as many as there are."""
    n = known.mass.shape[0]
    count = min(count, n - 2)
    if count < 1:
        raise DeckError(f"{name}: {n} free degrees of freedom are too few to be reduced: give 3")
    least = _least_eigenvalue(known.mass)
    if least < -_SLIGHT:
        raise DeckError(
            f"{name}: the mass is not positive: an eigenvalue is {least:.2g} of the largest; use"
            " solids, masses and springs"
        )
    stiffness = known.stiffness
    scale = float(np.max(stiffness.diagonal() / known.mass.diagonal()))
    start = np.random.default_rng(0).standard_normal(known.mass.shape[0])  # the same at each call
    found = eigsh(stiffness, count, known.mass, sigma=-_SHIFT * scale, which="LM", v0=start)
    order = np.argsort(found[0])
    omega2 = np.where(found[0] > _RIGID * scale, found[0], 0.0)[order]
    return Basis(known, np.sqrt(omega2), np.array([upright(x) for x in found[1].T[order]]))


def _least_eigenvalue(mass: csc_array) -> float:
    """Least eigenvalue over a bound of the largest: zero where elements are integrated coarsely."""
    bound = 2 * float(abs(mass).sum(axis=0).max())  # twice: of equal masses something is left
    turned = diags_array(np.full(mass.shape[0], bound)) - mass
    return 2 - 2 * float(eigsh(turned, 1, which="LA", tol=_SLIGHT / 20)[0][0]) / bound


def upright(shape: Array) -> Array:
    """A shape that is positive where it is largest: a mode has no sign of its own.

    Of freedoms that move nearly as much, on either side of a structure, it is the first.
    """
    size = np.abs(shape)
    return np.asarray(shape * np.sign(shape[np.argmax(size > _AS_LARGE * size.max())]))


def check_arrays(
    mass: csc_array, shapes: Array, omega: Array, nodes: Array, directions: Array
) -> None:
    n = mass.shape[0]
    sizes = {
        "mass": (mass.shape, (n, n)),
        "shapes": (shapes.shape, (len(omega), n)),
        "nodes": (nodes.shape, (n,)),
        "directions": (directions.shape, (n,)),
    }
    for name, (came, wanted) in sizes.items():
        if came != wanted:
            raise ValueError(f"{name} has the shape {came}: {wanted} fits the other arrays")
    if abs(mass - mass.T).max() > _SYMMETRIC * abs(mass).max():
        raise ValueError("mass is not symmetric: give both halves of the matrix")
    norms = np.sum((shapes @ mass) * shapes, axis=1)
    if not np.all(norms > 0):
        raise ValueError(
            f"mass is not positive along shapes[{int(np.argmin(norms))}]: give the mass of the free"
            " freedoms, and shapes that move"
        )
