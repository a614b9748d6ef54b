"""Terms that forced vibrations need: chosen by what each gains on stretches that are left out.

One long record is cut into stretches, each of which is left out in turn (`romsindy.fit.selection`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from romsindy.effects.choices import sought
from romsindy.fit.coefficient import LINEAR, Coefficient
from romsindy.fit.collocation import Trajectory
from romsindy.fit.coupled_terms import linear_terms
from romsindy.fit.dragged import dragged
from romsindy.fit.fitted import Fit
from romsindy.fit.friction import free_parts
from romsindy.fit.gauss_newton import linear_table
from romsindy.fit.selection import Gram, Linearised, Trials
from romsindy.physics.coupled import AnyModel
from romsindy.physics.equations import without_inputs
from romsindy.physics.inertia import Inertia
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.record.prediction import innovation
from romsindy.typing import Array

_STRETCHES = 8  # in all, each left out in turn


def linear_of(model: AnyModel) -> tuple[Term, ...]:
    """Stiffness and damping that always take part."""
    return linear_terms(model.n_coordinates) if model.numbered else LINEAR


def stiffness_to(order: int) -> list[Term]:
    """Powers of the displacement from the second to this one.

    Raises
    ------
    ValueError
        If the order is below 1.
    """
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)) or order < 1:
        raise ValueError(f"order = {order!r} must be a whole number, 1 or more")
    return [Stiffness(m) for m in range(2, order + 1)]


def candidates(order: int) -> tuple[Term, ...]:
    """Stiffness and inertia up to an order, and damping."""
    stiffness = stiffness_to(order)
    inertia = [Inertia(k) for k in range(3, order + 1)]
    return (*stiffness, *sought("driven"), *inertia)


def needed_terms(
    fit: Fit, motions: Sequence[Trajectory], several: Sequence[Term]
) -> tuple[Term, ...]:
    """Those of several terms that are needed beside the linear ones, about motions near a fit."""
    found = linearised(fit, motions, several)
    chosen = {found.name(g) for g in found.trials.chosen([])}
    return tuple(t for t in several if t.key in chosen)


def linearised(
    fit: Fit, motions: Sequence[Trajectory], several: Sequence[Term], *, left_out: bool = True
) -> Linearised:
    """All of several terms beside the linear ones, about motions near the records of a fit.

    Inputs, mode shapes and offsets are fitted beside any choice, as initial states are. What the
    fit holds fixed stays. Stretches are ``left_out`` in turn, or all data are one part.
    """
    model = without_inputs(fit.model)
    more = [p for p in fit.solution.parts if not isinstance(p.effect, Coefficient)]
    present = model.coefficients
    others = tuple(t for t in several if t.key not in present)
    wide = replace(
        model, terms=(*model.terms, *others), values=(*model.values, *np.zeros(len(others)))
    )
    always = [t for t in linear_of(model) if t.key in fit.free]
    terms = tuple({t.key: t for t in (*always, *several)}.values())
    at = np.array([wide.coefficients[t.key] for t in terms])
    wide, own = free_parts(wide, [t.key for t in terms], fit.records)
    parts = (*own, *more)
    tables = [
        record.by_channel(linear_table(wide, parts, i, record, motion)[1])
        for i, (record, motion) in enumerate(zip(fit.records, motions, strict=True))
    ]
    total, grams = sum(table.shape[1] for table in tables), []
    for table in tables:
        pieces = max(round(_STRETCHES * table.shape[1] / total), 2)
        driven = np.concatenate([innovation(left)[0] for left in _left(table)])
        rows = table.swapaxes(0, 1).reshape(-1, table.shape[2])  # all channels of a time together
        grams += _stretches(rows / float(np.sqrt(np.mean(driven**2))), at, pieces)
    groups = dict(enumerate(terms[len(always) :]))
    least = {g: law.least for g, law in groups.items() if law.least > -np.inf}
    damping = [g for g, law in groups.items() if law.has("damping")]
    trials = Trials(
        grams if left_out else [Gram.sum(grams)],
        range(len(always)),
        [[len(always) + g] for g in groups],
        least,
        damping,
        dragged(list(groups.values()), motions),
    )
    return Linearised(trials, (), terms, [g for g, law in groups.items() if law.key in present])


def _left(table: Array) -> Array:
    """What a fit of all candidates leaves of the misfit in the last column, (c, n) of (c, n, m)."""
    rows = table.reshape(-1, table.shape[2])
    scaled = rows[:, :-1] / np.maximum(np.linalg.norm(rows[:, :-1], axis=0), 1e-300)
    left = rows[:, -1] - scaled @ np.linalg.lstsq(scaled, rows[:, -1], rcond=None)[0]
    return left.reshape(table.shape[:2])


def _stretches(rows: Array, at: Array, pieces: int) -> list[Gram]:
    """A record in stretches; values beside the coefficients are fitted to all of it first."""
    m = len(at)
    nuisance = rows[:, m:-1]
    scale = np.maximum(np.linalg.norm(nuisance, axis=0), 1e-300)
    basis = np.linalg.svd(nuisance / scale, full_matrices=False)[0]
    clean = np.column_stack([rows[:, :m], rows[:, -1]])
    clean = clean - basis @ (basis.T @ clean)
    return [Gram.of(part, at) for part in np.array_split(clean, pieces)]
