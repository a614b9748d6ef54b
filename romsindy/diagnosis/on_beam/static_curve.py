"""The curve of shapes that a beam passes through in its first mode, and forces along it.

Held by the modal force at many coordinates q, the beam takes shapes x(q). A force f(x, v) on the
beam does the work Q dq with Q(q, q_dot) = f(x(q), x'(q) q_dot) . x'(q): that is what the one
coordinate feels of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from romsindy.beam import Beam
from romsindy.beam.reduction import solve_static_cases
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.typing import Array

_CASES, _GRID, _MARGIN = 41, 121, 1.15


@dataclass(frozen=True, eq=False)
class StaticCurve:
    """Shapes of a beam along its first mode.

    Attributes
    ----------
    beam : Beam
    reach : float
        Largest coordinate of interest, kg^0.5 m.
    omega2 : float
        Of the mode, 1/s^2.
    q : (n,) array
        Coordinates, from below -reach to beyond reach.
    shapes : (n, n_nodes, 3) array
        Displacements from the straight rest.
    tangents : (n, n_nodes, 3) array
        Derivatives with respect to q.
    """

    beam: Beam
    reach: float
    omega2: float
    q: Array
    shapes: Array
    tangents: Array

    @classmethod
    def of(cls, seen: InstrumentedBeam, reach: float) -> StaticCurve:
        """The curve of a beam, in the coordinate that its sensors show."""
        cases = solve_static_cases(seen.beam, 1, _MARGIN * reach, _CASES)
        rest = cases.basis.equilibrium.displacement
        fields = np.concatenate([rest[None], cases.displacement])
        q = seen.seen(fields - rest)
        order = np.argsort(q)
        spline = CubicSpline(q[order], fields[order])
        grid = np.linspace(q.min(), q.max(), _GRID)
        omega2 = float(cases.basis.omega[0] ** 2)
        return cls(seen.beam, reach, omega2, grid, spline(grid), spline(grid, 1))

    @property
    def rest(self) -> Array:
        """Equilibrium displacement, (n_nodes, 3)."""
        return self.beam.equilibrium().displacement

    def resistance(self, effect: Any, rate: float) -> CubicSpline:
        """What an effect adds to the left side of the equation of motion, over q, at one q_dot."""
        changed, own = self.beam.with_effect(effect).assembly, self.beam.assembly
        work = [
            np.vdot(v, changed.residual(x, rate * v)[0] - own.residual(x, rate * v)[0])
            for x, v in zip(self.shapes, self.tangents, strict=True)
        ]
        return CubicSpline(self.q, work)
