"""What orbits need of a model, whether of one coordinate or of several.

Motions are (..., R) arrays, R coordinates on the last axis, also where R is 1.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from romsindy.physics.coupled import AnyModel, CoupledModel
from romsindy.physics.model import ReducedModel
from romsindy.typing import Array

_SINGULAR = 1e-3  # of the inertia, as in `ReducedModel.acceleration`


class Equations(ABC):
    """Equations of R coordinates whose forces do not jump."""

    n_coordinates: int

    @abstractmethod
    def linearise(self, q: Array, q_dot: Array, q_ddot: Array) -> tuple[Array, Array, Array, Array]:
        """Residual (..., R), its derivatives by q, q_dot and q_ddot (..., R, R)."""

    @abstractmethod
    def residual(self, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        """Left sides of the equations, (..., R)."""

    @abstractmethod
    def objection(self, q: Array) -> str:
        """Why no motion goes through all positions q, (n, R); empty if one may."""

    @abstractmethod
    def turning_objection(self, q: Array) -> str:
        """Why no motion turns back at both positions q, (2, R), the upper one first."""

    @abstractmethod
    def linear_modes(self) -> tuple[Array, Array]:
        """Angular frequencies (R,), rad/s, and modes, the columns (R, R), of small vibrations."""


class OneCoordinate(Equations):
    """A `ReducedModel` with its coordinate on a last axis."""

    n_coordinates = 1

    def __init__(self, model: ReducedModel) -> None:
        self._model = model

    def linearise(self, q: Array, q_dot: Array, q_ddot: Array) -> tuple[Array, Array, Array, Array]:
        found = self._model.linearise(q[..., 0], q_dot[..., 0], q_ddot[..., 0])
        force, by_q, by_q_dot, by_q_ddot = (x[..., None] for x in found)
        return force, by_q[..., None], by_q_dot[..., None], by_q_ddot[..., None]

    def residual(self, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        return self._model.residual(q, q_dot, q_ddot)

    def objection(self, q: Array) -> str:
        inertia = self._model.inertia(q)
        if np.min(inertia) > _SINGULAR:
            return ""
        at = float(q.flat[np.argmin(inertia)])
        return f"1 + h(q) = {np.min(inertia):.3g} is not positive at q = {at:.6g}"

    def turning_objection(self, q: Array) -> str:
        restoring = self._model.stiffness(q[:, 0]) * [1, -1]
        if np.min(restoring) > 0:
            return ""
        at = q[np.argmin(restoring), 0]
        return f"the restoring force is not positive at the turning point q = {at:.6g}"

    def linear_modes(self) -> tuple[Array, Array]:
        squared = float(self._model.linearise(*np.zeros((3, 1)))[1][0])
        if not squared > 0:
            raise ValueError(
                f"omega^2 = {squared:.6g} is not positive: orbits are followed around a stable"
                " q = 0; measure q from a stable position of rest"
            )
        return np.sqrt([squared]), np.ones((1, 1))


class SeveralCoordinates(Equations):
    """A `CoupledModel`."""

    def __init__(self, model: CoupledModel) -> None:
        self._model = model
        self.n_coordinates = model.n_coordinates

    def linearise(self, q: Array, q_dot: Array, q_ddot: Array) -> tuple[Array, Array, Array, Array]:
        return self._model.linearise(q, q_dot, q_ddot)

    def residual(self, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        return self._model.residual(q, q_dot, q_ddot)

    def objection(self, q: Array) -> str:
        least = np.linalg.eigvalsh(self._model.inertia(q))[:, 0]
        if np.min(least) > _SINGULAR:
            return ""
        at = np.round(q[np.argmin(least)], 6).tolist()
        return f"M(q) is not positive definite at q = {at}"

    def turning_objection(self, q: Array) -> str:
        return ""  # harmonics of several coordinates may turn one of them against its own force

    def linear_modes(self) -> tuple[Array, Array]:
        return self._model.linear_modes


def equations_of(model: AnyModel) -> Equations:
    """The equations of a model of either kind."""
    return SeveralCoordinates(model) if isinstance(model, CoupledModel) else OneCoordinate(model)
