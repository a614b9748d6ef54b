"""How a measured beam started, read from its sensors: held, hit, or in the middle of a swing.

A beam that is pulled at a point or hit moves in all its modes, one that is held by a modal force
almost in one. What the higher modes do in the first cycle tells which forces held and pushed it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from romsindy.beam import Beam
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.fit.verdict import MOVING
from romsindy.record.spectrum import noise_std
from romsindy.typing import Array

_HIGHER = 4  # modes beside the first whose part in the release is looked for
_AXIAL = 0.5  # share of the kinetic energy above which a mode is no bending mode
_RESOLVED = 0.8  # of the largest frequency that the sampling shows
_STEP = 0.02  # amplitude of a higher mode, relative to the first, for differences
_ROUNDS = 2  # the motion is nearly linear in the higher modes


class ReleaseLoad(NamedTuple):
    """Nodal loads, (n_nodes, 3) and of any size, that held a beam and that pushed it.

    None stands for the modal force of its first mode.
    """

    load: Array | None = None
    push: Array | None = None


def read_release(
    seen: InstrumentedBeam,
    beam: Beam,
    start: tuple[float, float],
    measured: Array,
    dt: float,
    derivative: int = 0,
) -> ReleaseLoad:
    """Find the loads that held a beam until it was let go, and that pushed it.

    Each is a sum of modal forces. Beside their ratios an error of the amplitude, one of the
    frequency and, for a beam that moves, one of the time are fitted, so that what the beam lacks is
    not taken for a part of the release.

    Parameters
    ----------
    seen : InstrumentedBeam
    beam : Beam
        With all effects that are known by now.
    start : (float, float)
        Coordinate and its rate at the first sample, kg^0.5 m and s.
    measured : (n, n_sensors) array
        What the sensors read from there on, m and s.
    dt : float
        Sampling interval, s.
    derivative : 0, 1 or 2
        Whether that is displacement, velocity or acceleration.
    """
    (q, q_dot), (forces, omega) = start, _modal_forces(beam, dt)
    n = min(int(2 * np.pi / omega / dt) + 1, len(measured))
    # Without noise there is nothing to weigh, and nothing to divide by.
    least = 1e-9 * float(np.abs(measured).max())
    noise = np.maximum([noise_std(y) for y in measured.T], least)
    t = dt * np.arange(n)[:, None]
    parts = np.array([q * omega, q_dot]) / np.hypot(q * omega, q_dot)
    unknown = np.repeat(np.abs(parts) > MOVING, len(forces) - 1)

    def simulated(ratios: Array) -> Array:
        held, pushed = _loads(forces, ratios)
        motion = seen.motion(beam, q, (n - 0.5) * dt, dt, held, q_dot=q_dot, push=pushed)
        return motion[derivative]

    ratios = np.zeros(len(unknown))
    for _ in range(_ROUNDS if len(ratios) else 0):
        here = simulated(ratios)
        steps = _STEP * np.eye(len(ratios))[unknown]
        changes = [(simulated(ratios + step) - here) / _STEP for step in steps]
        rate = np.gradient(here, dt, axis=0)
        columns = [*changes, here, t * rate, *([rate] if unknown[-1] else [])]
        matrix = np.stack([(c / noise).ravel() for c in columns], axis=1)
        matrix /= (scale := np.linalg.norm(matrix, axis=0))
        found, *_ = np.linalg.lstsq(matrix, ((measured[:n] - here) / noise).ravel(), rcond=None)
        ratios[unknown] += (found / scale)[: len(steps)]
    return ReleaseLoad(*_loads(forces, ratios))


def _loads(forces: Array, ratios: Array) -> Iterator[Array]:
    """Sums of modal forces: what holds, what pushes."""
    for own in np.split(ratios, 2):
        yield np.asarray(forces[0] + np.tensordot(own, forces[1:], axes=1))


def _modal_forces(beam: Beam, dt: float) -> tuple[Array, float]:
    """Forces of the first bending modes that the sampling shows, and the frequency of the first.

    Each bends the beam by the same modal displacement.
    """
    free = int(np.count_nonzero(~beam.assembly.fixed))
    basis = beam.modes(count=min(2 * _HIGHER + 2, free - 2))
    bending = np.flatnonzero(basis.axial < _AXIAL)[: 1 + _HIGHER]
    seen = [m for m in bending if basis.omega[m] * dt < _RESOLVED * np.pi]
    forces = basis.momenta[seen] * basis.omega[seen, None, None] ** 2
    return forces, float(basis.omega[bending[0]])
