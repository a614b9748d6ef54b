"""Terms that a forced vibration of one coordinate needs: chosen by what each gains where left out.

One long record is cut into stretches, each of which is left out in turn (`romsindy.fit.selection`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from romsindy.effects.choices import sought
from romsindy.fit.coefficient import Coefficient
from romsindy.fit.collocation import Trajectory
from romsindy.fit.dragged import dragged
from romsindy.fit.equation import equation_of
from romsindy.fit.fitted import Fit
from romsindy.fit.friction import free_parts
from romsindy.fit.gauss_newton import linear_table
from romsindy.fit.noises import TwoNoises, found_noises
from romsindy.fit.normal_equations import solved
from romsindy.fit.selection import Gram, Linearised, Trials
from romsindy.physics.damping import PowerDamping
from romsindy.physics.equations import without_inputs
from romsindy.physics.inertia import Inertia
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term
from romsindy.typing import Array

LINEAR: tuple[Term, ...] = (Stiffness(1), PowerDamping(1))
_STRETCHES = 8  # in all, each left out in turn


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

    Inputs and offsets are fitted beside any choice, as initial states are. What the fit holds fixed
    stays. Stretches are ``left_out`` in turn, or all data are one part.
    """
    model = without_inputs(fit.single_model)
    more = [p for p in fit.solution.parts if not isinstance(p.effect, Coefficient)]
    known = model.coefficients
    others = tuple(t for t in several if t.key not in known)
    wide = replace(
        model, terms=(*model.terms, *others), values=(*model.values, *np.zeros(len(others)))
    )
    always = [t for t in LINEAR if t.key in fit.free]
    terms = tuple({t.key: t for t in (*always, *several)}.values())
    at = np.array([wide.coefficients[t.key] for t in terms])
    wide, own = free_parts(wide, [t.key for t in terms], fit.records)
    parts = (*own, *more)
    tables = [
        linear_table(wide, parts, i, record, motion)[1]
        for i, (record, motion) in enumerate(zip(fit.records, motions, strict=True))
    ]
    present = np.array([t.key in known for t in terms])
    total, grams = sum(map(len, tables)), []
    for i, (rows, record, motion) in enumerate(zip(tables, fit.records, motions, strict=True)):
        equation = equation_of(wide, parts, i, record)
        noises = TwoNoises.along(equation, parts, i, record, motion)
        pieces = max(round(_STRETCHES * len(rows) / total), 2)
        grams += _stretches(rows, at, present, pieces, noises)
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
    return Linearised(trials, (), terms, [g for g, law in groups.items() if law.key in known])


def _stretches(
    rows: Array, at: Array, present: NDArray[np.bool_], pieces: int, noises: TwoNoises
) -> list[Gram]:
    """A record in stretches; values beside the coefficients are fitted to all of it first.

    Rows are derivatives by all values and the initial state, and the misfit. All is weighed by the
    noises in that which the terms that are ``present`` leave: what others would tell of it is noise
    until they do. Every stretch has a state of its own.
    """
    m, states = len(at), noises.shown.shape[1] - noises.moves.shape[0]
    fitted = np.append(np.flatnonzero(present), np.arange(m, rows.shape[1] - states - 1))
    left = _left(rows[:, fitted], rows[:, -1])
    found = found_noises(noises, left)
    # Over the noise of the sensor alone: what moves as a force may be a missing term of the model.
    beyond = max(float(np.mean(left**2)) / found.shown**2, 1.0)
    misfit = rows[:, -1] + rows[:, :m] @ at
    wanted, beside = np.column_stack([rows[:, :m], misfit]), rows[:, m : -states - 1]
    products = noises.table(np.column_stack([wanted, beside])).products(found)
    wanted = wanted - beside @ solved(products[m + 1 :, m + 1 :], products[m + 1 :, : m + 1])
    edges = np.linspace(0, len(rows), pieces + 1).round().astype(int)
    grams = []
    for first, last in pairwise(edges):
        own = noises.between(first, last).table(wanted[first:last]).products(found)
        own *= beyond
        grams.append(Gram(own[:m, :m], own[:m, m], float(own[m, m]), int(last - first)))
    return grams


def _left(table: Array, misfit: Array) -> Array:
    """What a fit of some columns leaves of a misfit."""
    table = table / np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    return misfit - table @ np.linalg.lstsq(table, misfit, rcond=None)[0]
