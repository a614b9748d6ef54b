"""Which terms steady states need: chosen by what each gains on levels of force left out."""

from __future__ import annotations

import numpy as np

from romsindy.effects.choices import sought
from romsindy.fit.choice import Gram, Linearised, Trials
from romsindy.fit.steady.balance import CHAIN, linearised
from romsindy.fit.steady.points import SteadyPoints
from romsindy.fit.steady.solve import SteadySolution, solve
from romsindy.physics.damping import PowerDamping
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.typing import Array, Indices

_ALWAYS = Stiffness(1)
_LINEAR = PowerDamping(1)
_LAWS = tuple(sorted((_LINEAR, *sought("steady")), key=lambda law: law.has("damping")))
_ROUNDS = 5  # of a choice about the orbits of the model that was chosen last
_BLOCKS = 5


def choose(
    points: SteadyPoints,
    unit: str | None,
    gain: float | None,
    slope: float | None,
    phase: float | None,
) -> tuple[ReducedModel, float | None]:
    """Terms to fit, and the slope of the chain: None where it is to be fitted.

    Every level of force is left out in turn; where there are fewer than three, every fifth of the
    points by amplitude.
    """
    chosen = {_LINEAR.key}
    for _ in range(_ROUNDS):
        terms = [_ALWAYS, *(law for law in _LAWS if law.key in chosen)]
        start = (float(np.median(points.frequency) ** 2), *np.zeros(len(terms) - 1))
        model = ReducedModel(tuple(terms), start, unit)
        now = 0.0 if slope is None and "slope" not in chosen else slope
        found = solve(points, model, tuple(model.coefficients), gain, now, phase)
        every = every_choice(points, found, slope is None)
        best = {every.name(g) for g in every.trials.chosen(every.present)}
        if best == chosen:
            break
        chosen = best
    return model, now


def every_choice(
    points: SteadyPoints, found: SteadySolution, with_slope: bool, covariance: Array | None = None
) -> Linearised:
    """All candidates, with the slope of the chain or without, about the orbits of a solution.

    Parts of the points are left out in turn. With the ``covariance`` of what was fitted all are one
    part, and misfits count as much as makes the errors by them those of that, in the mean [1].

    [1] F. Pauli, W. Racugno, L. Ventura, Statistica Sinica 21 (2011) 149: the magnitude adjustment.
    """
    laws = (_ALWAYS, *_LAWS)
    values = dict.fromkeys((law.key for law in laws), 0.0) | found.model.coefficients
    rich = ReducedModel(laws, tuple(values.values()))
    chain = [n for n in CHAIN if n in found.free or (n == "slope" and with_slope)]
    names, known = (*values, *chain), values | vars(found.chain)
    rows = linearised(points, rich, tuple(values), found.chain, found.c)
    a, b = rows.whitened(found.floor)
    table = np.column_stack([a[:, [(*values, *CHAIN).index(n) for n in names]], -b])
    part, counted = _parts(points), 1.0
    if covariance is not None:
        part = np.zeros_like(part)
        counted = len(covariance) / np.trace(np.linalg.solve(found.covariance, covariance))
    part = np.repeat(part, rows.misfit.shape[1])
    at = np.array([known[n] for n in names])
    grams = [Gram.of(np.sqrt(counted) * table[part == i], at) for i in np.unique(part)]
    groups = [i for i, n in enumerate(names) if n not in (_ALWAYS.key, "gain", "phase")]
    always = [i for i in range(len(names)) if i not in groups]
    trials = Trials.of(grams, always, [[i] for i in groups], dict(enumerate(_LAWS)), {})
    present = [g for g, i in enumerate(groups) if names[i] in found.free]
    return Linearised(trials, (), laws, present, tuple(chain))


def _parts(points: SteadyPoints) -> Indices:
    """With which part of the data each point is left out, (n,)."""
    number: Indices = points.level
    if number.max() < 2:
        number = np.argsort(np.argsort(points.amplitude)) * _BLOCKS // len(points)
    return number
