"""Kinetic energy of what is dragged along, which is a sum of squares: never negative."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from romsindy.fit.collocation import Trajectory
from romsindy.fit.linear_response import nodes
from romsindy.physics.term import Term
from romsindy.typing import Array

_PLACES = 400  # of a motion, at which kinetic energy is looked at


def dragged(terms: Sequence[Term], motions: Sequence[Trajectory]) -> dict[int, Array]:
    """Kinetic energy that a coefficient of 1 adds where the motions went, (n,), by place of a term.

    At unit velocities in some directions. Only of terms whose inertia vanishes at rest: it is that
    of fast modes which follow, a sum of squares. Masses at rest may differ either way.
    """
    q = np.concatenate([nodes(m)[1] for m in motions])
    q = q[:: max(len(q) // _PLACES, 1)]
    v = np.random.default_rng(0).standard_normal(q.shape)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    energies = {i: np.sum(v * _force(term, q, v), axis=1) / 2 for i, term in enumerate(terms)}
    rest = np.zeros_like(q[:1])
    at_rest = {i: bool(np.any(_force(term, rest, v[:1]))) for i, term in enumerate(terms)}
    return {i: e for i, e in energies.items() if np.any(e) and not at_rest[i]}


def _force(term: Term, q: Array, q_ddot: Array) -> Array:
    """Inertia of a term times accelerations, (n, R), from rest."""
    rest = np.zeros_like(q)
    return np.asarray(term.strong(q, rest, q_ddot) - term.strong(q, rest, rest))
