"""How a measured beam was held before it was let go, read from its sensors.

A beam that is pulled at a point and let go moves in all its modes, one that is held by a modal
force almost in one. What the higher modes do in the first cycle tells which forces held it.
"""

from __future__ import annotations

import numpy as np

from romsindy.beam import Beam
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.record.signals import noise_std
from romsindy.typing import Array

_HIGHER = 3  # modes beside the first whose part in the release is looked for
_AXIAL = 0.5  # share of the kinetic energy above which a mode is no bending mode
_RESOLVED = 0.8  # of the largest frequency that the sampling shows
_STEP = 0.02  # static amplitude of a higher mode, relative to the first, for differences
_ROUNDS = 2  # the motion is nearly linear in the higher modes


def load_at_release(
    seen: InstrumentedBeam, beam: Beam, q: float, measured: Array, dt: float
) -> Array:
    """Find the load, (n_nodes, 3) and of any size, that held a beam until it was let go.

    The load is a sum of modal forces. Beside their ratios an error of the amplitude and one of the
    frequency are fitted, so that what the beam lacks is not taken for a part of the release.

    Parameters
    ----------
    seen : InstrumentedBeam
    beam : Beam
        With all effects that are known by now.
    q, dt : float
        Coordinate at the release, kg^0.5 m; sampling interval, s.
    measured : (n, n_sensors) array
        Displacements from the release on, m.

    Returns
    -------
    (n_nodes, 3) array
        Nodal load, of any size.
    """
    forces, period = _modal_forces(beam, dt)
    n = min(int(period / dt) + 1, len(measured))
    # Without noise there is nothing to weigh, and nothing to divide by.
    least = 1e-9 * float(np.abs(measured).max())
    noise = np.maximum([noise_std(y) for y in measured.T], least)
    t = dt * np.arange(n)[:, None]

    def simulated(ratios: Array) -> Array:
        load = forces[0] + np.tensordot(ratios, forces[1:], axes=1)
        return seen.readings(beam, q, (n - 0.5) * dt, dt, load)

    ratios = np.zeros(len(forces) - 1)
    for _ in range(_ROUNDS if len(ratios) else 0):
        here = simulated(ratios)
        changes = [(simulated(ratios + e) - here) / _STEP for e in _STEP * np.eye(len(ratios))]
        columns = [*changes, here, t * np.gradient(here, dt, axis=0)]
        matrix = np.stack([(c / noise).ravel() for c in columns], axis=1)
        matrix /= (scale := np.linalg.norm(matrix, axis=0))
        found, *_ = np.linalg.lstsq(matrix, ((measured[:n] - here) / noise).ravel(), rcond=None)
        ratios = ratios + (found / scale)[: len(ratios)]
    return np.asarray(forces[0] + np.tensordot(ratios, forces[1:], axes=1))


def _modal_forces(beam: Beam, dt: float) -> tuple[Array, float]:
    """Forces of the first bending modes that the sampling shows, and the period of the first.

    Each bends the beam by the same modal displacement.
    """
    free = int(np.count_nonzero(~beam.assembly.fixed))
    basis = beam.modes(count=min(2 * _HIGHER + 2, free - 2))
    bending = np.flatnonzero(basis.axial < _AXIAL)[: 1 + _HIGHER]
    seen = [m for m in bending if basis.omega[m] * dt < _RESOLVED * np.pi]
    forces = basis.momenta[seen] * basis.omega[seen, None, None] ** 2
    return forces, 2 * np.pi / float(basis.omega[bending[0]])
