"""A model to be fitted, and its free terms as parts.

Forces that jump are made smooth there; those that remember are parts with what shapes them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpocon, dpotrf, dpotrs
from scipy.signal import lfilter

from romsindy.effects.base import Effect, Scales
from romsindy.effects.memory import MemoryEffect, SmallMass
from romsindy.fit.kernel.part import Model, Part, free_coefficients, priors
from romsindy.fit.kernel.prepared import Prepared
from romsindy.physics.memory import MemoryLaw
from romsindy.physics.term import Term
from romsindy.physics.term_sum import TermSum
from romsindy.record.prediction import autoregression, coloured_product
from romsindy.typing import Array, Indices


def free_parts(
    model: Model, names: Sequence[str], records: Sequence[Prepared]
) -> tuple[Model, tuple[Part, ...]]:
    """A model to fit, and its free coefficients as parts.

    All of a free force that jumps is in its part, and none in the model. Forces that remember are
    in parts, too.
    """
    memories = memory_parts(model, records)
    remembering = {law.key for law in model.memories}
    names = [name for name in names if name not in remembering]
    apart = {t.key for t in model.terms if not t.smooth} & {*names}
    values = model.coefficients
    outside = apart | remembering
    inside = tuple(0.0 if name in outside else value for name, value in values.items())
    left = replace(model, values=inside)
    parts = free_coefficients(left, names)
    free = (
        replace(p, strengths=np.full((1, 1), values[name])) if name in apart else p
        for name, p in zip(names, parts, strict=True)
    )
    return left, (*free, *memories)


def memory_parts(model: TermSum, records: Sequence[Prepared]) -> tuple[Part, ...]:
    """The forces of a model that remember, from their values there.

    Raises a ValueError if a shape value is so far from what the records can show that no fit finds
    it.
    """
    if not model.memories:
        return ()
    longest = max(records, key=lambda r: float(r.t[-1]))
    scales = Scales(max(r.amplitude for r in records), longest.rate, float(longest.t[-1]))
    return tuple(_part(law, c, scales, len(records)) for law, c in model.memories.items())


def _part(law: MemoryLaw, strength: float, scales: Scales, n_records: int) -> Part:
    effect = MemoryEffect.of_law(law)
    if isinstance(effect, SmallMass):  # it may vibrate where a record begins
        effect = replace(effect, late=True)
    shapes = effect.parameters(scales)
    for p in shapes:
        if not p.low <= effect.value(p.name) <= p.high:
            raise ValueError(
                f"{law.key} starts from {p.name} = {effect.value(p.name):.4g}, and of these records"
                f" a fit finds values from {p.low:.4g} to {p.high:.4g}: start between them"
            )
    part = Part.of(effect, scales, n_records, [effect.value(p.name) for p in shapes])
    strengths = part.strengths.copy()
    strengths[:, 0] = max(strength, 0.0)
    return replace(part, strengths=strengths)


def laws_in(effect: Effect) -> tuple[Term | MemoryLaw, ...]:
    """The terms that an effect is in a model, with a memory or without, one for each strength."""
    return (effect.remembering,) if isinstance(effect, MemoryEffect) else effect.laws()


def with_memories(model: Model, parts: Sequence[Part]) -> Model:
    """The model with the forces of parts that remember in the place of those it has."""
    found = {p.effect.remembering: p for p in parts if isinstance(p.effect, MemoryEffect)}
    by_key = {law.key: (law, float(p.strengths[0, 0])) for law, p in found.items()}
    return model.with_terms(by_key.get(t.key, (t, v)) for t, v in model.pairs)


_RANK = 1e-13  # of scaled equations: directions below it are not told apart
_FIRM = 1e-10  # reciprocal condition of scaled equations that are solved without looking for such
_ACTIVE = 5  # rounds in which values may reach their limits


class NormalEquations:
    """Normal equations of all records: values of the parts, the state of each record, and more.

    A state holds q and q_dot at the start, two values of each coordinate. What comes last are
    strengths of candidates, which are zero so far.
    """

    def __init__(
        self, n_values: int, n_records: int, n_more: int = 0, n_coordinates: int = 1
    ) -> None:
        self.n_states = 2 * n_coordinates
        self.size = n_values + self.n_states * n_records + n_more
        self.n_values = n_values
        self.matrix = np.zeros((self.size, self.size))
        self.right = np.zeros(self.size)
        self.known = np.zeros(self.size)  # of the diagonal, what was known beforehand
        self.power = 0.0

    def add(self, where: Indices, rows: Array) -> None:
        """Rows of one record: derivatives by the values at these places, then the misfit."""
        self.add_products(where, rows.T @ rows)

    def add_products(self, where: Indices, gram: Array) -> None:
        """Products of such rows, weighed by any covariance."""
        self.power += gram[-1, -1]
        self.right[where] += gram[-1, :-1]
        self.matrix[np.ix_(where, where)] += gram[:-1, :-1]

    def coloured(self, tables: Sequence[tuple[Indices, Array]]) -> Array:
        """Covariance of all values, for the colour that the residuals really have.

        Where a residual is not white the covariance is the sandwich (J'J)^-1 J' S J (J'J)^-1, with
        S that of an autoregression. ``tables`` have the rows of each record, as in `add`.
        """
        middle = np.diag(self.known)  # what is known beforehand is no colour
        for where, rows in tables:
            jacobian, residual = rows[:, :-1], rows[:, -1]
            a = autoregression(residual)
            driven = lfilter(a, [1.0], residual)
            freedom = max(len(residual) - self.size / len(tables), 1.0)
            variance = float(driven @ driven) / freedom
            middle[np.ix_(where, where)] += coloured_product(a, jacobian, jacobian) * variance
        inverse = self.covariance()
        return inverse @ middle @ inverse

    def states_of(self, record: int) -> Indices:
        """Places of q and q_dot at the start of a record."""
        return self.n_values + self.n_states * record + np.arange(self.n_states)

    def add_priors(self, parts: Sequence[Part]) -> None:
        """What is known beforehand."""
        for at, off, spread in priors(parts):
            self.power += (off / spread) ** 2
            self.right[at] += off / spread**2
            self.matrix[at, at] += 1 / spread**2
            self.known[at] += 1 / spread**2

    @property
    def finite(self) -> bool:
        """Whether the motions stayed within reach of numbers."""
        return bool(np.all(np.isfinite(self.matrix)) and np.all(np.isfinite(self.right)))

    def bounded_step(
        self, held: NDArray[np.bool_], low: Array, high: Array, damping: float = 0.0
    ) -> Array:
        """Least-squares change of all values; values at a limit stay there, and some are held.

        ``low`` and ``high`` are the least and largest changes of the values of the parts. With
        ``damping``, added to the diagonal as a part of it, values that make up for one another
        change little (Levenberg and Marquardt).
        """
        fixed = np.zeros(self.size)
        free = np.ones(self.size, bool)
        free[: len(held)] = ~held
        least, most = np.full((2, self.size), np.inf)
        least = -least
        least[: len(low)], most[: len(high)] = low, high
        step = self._step(free, fixed, damping)
        for _ in range(_ACTIVE):
            beyond = free & ((step < least) | (step > most))
            if not np.any(beyond):
                break
            fixed[beyond] = np.clip(step, least, most)[beyond]
            free &= ~beyond
            step = self._step(free, fixed, damping)
        return step

    def _step(self, free: NDArray[np.bool_], fixed: Array, damping: float) -> Array:
        a = self.matrix[np.ix_(free, free)]
        a[np.diag_indices(len(a))] *= 1 + damping
        b = self.right[free] - self.matrix[np.ix_(free, ~free)] @ fixed[~free]
        step = fixed.copy()
        step[free] = solved(a, b)
        return step

    def by_some(self, columns: Indices) -> tuple[Array, float]:
        """Least-squares change of some values alone, and by how much it lowers the misfit."""
        a, b = self.matrix[np.ix_(columns, columns)], self.right[columns]
        x = solved(a, b)
        return x, float(2 * x @ b - x @ a @ x)

    def chi_squared(self, step: Array) -> float:
        """What the linear problem leaves after a step."""
        return float(self.power - 2 * step @ self.right + step @ self.matrix @ step)

    def covariance(self) -> Array:
        """Inverse of the normal matrix: the curvature of the misfit."""
        return inverse(self.matrix)


def _scale(a: Array) -> Array:
    """What makes the diagonal of a normal matrix 1; 0 where nothing, or only rounding, is there."""
    power = np.diag(a)
    return np.where(power > 1e-300, 1 / np.sqrt(np.maximum(power, 1e-300)), 0.0)


def _told_apart(a: Array) -> tuple[Array, Array]:
    """Axes of a symmetric matrix, (n, k), and its sizes along them, those of rounding aside.

    That converges always; a singular value decomposition does not.
    """
    sizes, axes = np.linalg.eigh(a)
    large = np.abs(sizes) > _RANK * np.max(np.abs(sizes), initial=0.0)
    return axes[:, large], sizes[large]


def inverse(a: Array) -> Array:
    """Of a normal matrix, whatever its scales; 0 in directions that are not told apart."""
    scale = _scale(a)
    axes, sizes = _told_apart(a * scale * scale[:, None])
    return (axes / sizes) @ axes.T * scale * scale[:, None]


def solved(a: Array, b: Array) -> Array:
    """Least-squares solution of normal equations, (n,) or (n, m), whatever their scales."""
    if not a.size:
        return np.zeros_like(b)
    scale = _scale(a)
    wide = scale if b.ndim == 1 else scale[:, None]
    scaled = a * scale * scale[:, None]
    factor, failed = dpotrf(scaled)
    if not failed and dpocon(factor, np.linalg.norm(scaled, 1))[0] > _FIRM:
        return dpotrs(factor, b * wide)[0] * wide
    axes, sizes = _told_apart(scaled)
    return (axes / sizes) @ (axes.T @ (b * wide)) * wide
