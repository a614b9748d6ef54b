"""The equations of motion of several coordinates, and what follows from them.

    M(q) q_ddot + G(q)[q_dot, q_dot] + dV/dq + D(q, q_dot) = 0,    M(0) = 1 on every coordinate

Laws along one direction make a `ReducedModel` of that direction; the equations are the sum of these
and of the polynomials that couple coordinates (`romsindy.physics.coupling`). Arrays have R
coordinates on their last axis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from romsindy.physics import export
from romsindy.physics.coupling import Along, CoupledTerm, MixedStiffness, PolynomialTerm, Powers
from romsindy.physics.damping import PowerDamping
from romsindy.physics.equations import SINGULAR, Equations
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Term, law_called, type_name
from romsindy.physics.term_sum import read_json, refuse_many
from romsindy.physics.validation import require_finite
from romsindy.typing import Array


@dataclass(frozen=True)
class CoupledModel(Equations):
    """Equations of R coordinates with known coefficients.

    Parameters
    ----------
    terms : tuple of CoupledTerm
        `Along`, `MixedStiffness`, `SlavedInertia` and `MixedDamping`.
    values, unit, amplitude_range
        As in `ReducedModel`; all coordinates have the same unit.

    Raises
    ------
    ValueError
        If a term is one of a single coordinate without saying of which.

    Examples
    --------
    >>> model = CoupledModel.from_coefficients(
    ...     {"omega^2 [q1]": 36.0, "omega^2 [q2]": 144.0, "V q1^2 q2": 5.0, "c_linear [q2]": 0.1},
    ...     unit="m",
    ... )
    >>> print(model)
    q1_ddot + 36 q1 + 10 q1 q2 = 0
    q2_ddot + 144 q2 + 5 q1^2 + 0.1 q2_dot = 0    (q in m, t in s)
      omega^2 [q1]            36  1/s^2           mode 1: 6 rad/s, 0.95493 Hz
      omega^2 [q2]           144  1/s^2           mode 2: 12 rad/s, 1.9099 Hz
      V q1^2 q2                5  1/(m s^2)
      c_linear [q2]          0.1  1/s
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        plain = [t.key for t in self.terms if not isinstance(t, CoupledTerm)]
        if plain:
            raise ValueError(
                f"the terms {plain} do not say which coordinate they act on: write"
                f" {f'{plain[0]} [q1]'!r}, or use ReducedModel for a single coordinate"
            )
        if not self.terms:
            raise ValueError("terms is empty: give at least one")

    @cached_property
    def n_coordinates(self) -> int:
        return max(t.n_coordinates for t in self.terms if isinstance(t, CoupledTerm))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Their names: q1 ... qR."""
        return tuple(f"q{i + 1}" for i in range(self.n_coordinates))

    @property
    def pushes(self) -> list[tuple[Input, float | Array]]:
        """Inputs, each with its coefficients on the coordinates, (R,)."""
        return [
            (term.law, value * self._padded(term.weights))
            for term, value in self.pairs
            if isinstance(term, Along) and isinstance(term.law, Input)
        ]

    def _padded(self, weights: Sequence[float]) -> Array:
        return np.array([*weights, *(0.0,) * (self.n_coordinates - len(weights))])

    # -- the functions of the equations -------------------------------------------------------

    @cached_property
    def _directions(self) -> list[tuple[Array, ReducedModel]]:
        """Weights (R,) and what acts along them; each coordinate comes with its unit mass."""
        r = self.n_coordinates
        groups: dict[tuple[float, ...], dict] = {tuple(row.tolist()): {} for row in np.eye(r)}
        for term, value in self.pairs:
            if isinstance(term, Along):
                groups.setdefault(tuple(self._padded(term.weights).tolist()), {})[term.law] = value
        return [
            (np.array(w), ReducedModel(tuple(laws), tuple(laws.values()), self.unit))
            for w, laws in groups.items()
        ]

    @cached_property
    def _polynomials(self) -> _Polynomials:
        return _Polynomials.of(self.pairs, self.n_coordinates)

    def linearise(self, q: Array, q_dot: Array, q_ddot: Array) -> tuple[Array, Array, Array, Array]:
        """Residual (..., R), its derivatives by q, q_dot and q_ddot (..., R, R) at (..., R)."""
        residual, by_q, by_q_dot, by_q_ddot = self._polynomials.linearise(q, q_dot, q_ddot)
        for w, model in self._directions:
            d, d_dot, d_ddot = q @ w, q_dot @ w, q_ddot @ w
            force, *slopes = model.linearise(d, d_dot, d_ddot)
            if not _is_coordinate(w):  # unit masses belong to the coordinates alone
                force, slopes[2] = force - d_ddot, slopes[2] - 1.0
            both = w[:, None] * w
            residual += force[..., None] * w
            by_q += slopes[0][..., None, None] * both
            by_q_dot += slopes[1][..., None, None] * both
            by_q_ddot += slopes[2][..., None, None] * both
        return residual, by_q, by_q_dot, by_q_ddot

    residual_and_slopes = linearise

    def residual(self, q: ArrayLike, q_dot: ArrayLike, q_ddot: ArrayLike) -> Array:
        q, q_dot, q_ddot = self._motion(q, q_dot, q_ddot)
        residual = self._polynomials.residual(q, q_dot, q_ddot)
        for w, model in self._directions:
            d, d_dot, d_ddot = q @ w, q_dot @ w, q_ddot @ w
            force = model.residual(d, d_dot, d_ddot)
            if not _is_coordinate(w):  # unit masses belong to the coordinates alone
                force = force - d_ddot
            residual += force[..., None] * w
        return residual

    def inertia(self, q: ArrayLike) -> Array:
        """M(q), (..., R, R)."""
        (q,) = self._motion(q)
        return self.linearise(q, np.zeros_like(q), np.zeros_like(q))[3]

    def stiffness(self, q: ArrayLike) -> Array:
        """dV/dq, restoring forces per unit mass, (..., R)."""
        (q,) = self._motion(q)
        along = [m.stiffness(q @ w)[..., None] * w for w, m in self._directions]
        return np.asarray(self._polynomials.stiffness(q) + sum(along))

    def damping(self, q: ArrayLike, q_dot: ArrayLike) -> Array:
        """D(q, q_dot), damping forces per unit mass, (..., R)."""
        q, q_dot = self._motion(q, q_dot)
        along = [m.damping(q @ w, q_dot @ w)[..., None] * w for w, m in self._directions]
        return np.asarray(self._polynomials.damping(q, q_dot) + sum(along))

    def acceleration(self, q: ArrayLike, q_dot: ArrayLike, push: Array | float = 0.0) -> Array:
        """q_ddot of the free motion, or under forces of inputs per unit mass, (..., R).

        Raises
        ------
        SingularInertiaError
            If M(q) is not positive definite somewhere.
        """
        q, q_dot = self._motion(q, q_dot)
        force, _, _, inertia = self.linearise(q, q_dot, np.zeros_like(q))
        if np.any(np.linalg.eigvalsh(inertia)[..., 0] <= SINGULAR):
            self._refuse(q.reshape(-1, self.n_coordinates))
        return np.linalg.solve(inertia, (push - force)[..., None])[..., 0]

    def objection(self, q: Array) -> str:
        least = np.linalg.eigvalsh(self.inertia(q))[:, 0]
        if np.min(least) > SINGULAR:
            return ""
        at = np.round(q[int(np.argmin(least))], 6).tolist()
        return f"M(q) is not positive definite at q = {at}"

    def _motion(self, *signals: ArrayLike) -> tuple[Array, ...]:
        arrays = np.broadcast_arrays(*(np.asarray(x, float) for x in signals))
        if arrays[0].ndim == 0 or arrays[0].shape[-1] != self.n_coordinates:
            raise ValueError(
                f"q has the shape {arrays[0].shape}: its last axis must hold the"
                f" {self.n_coordinates} coordinates of the model"
            )
        return tuple(arrays)

    # -- motion and energy --------------------------------------------------------------------

    def _state(self, q0: Any, q_dot0: Any) -> Array:
        q, q_dot = self._motion(q0, q_dot0)
        if q.shape != (self.n_coordinates,):
            raise ValueError(f"q0 has the shape {q.shape}: give {self.n_coordinates} values")
        require_finite("q0", *q)
        require_finite("q_dot0", *q_dot)
        return np.stack([q, q_dot])

    def _quick_acceleration(self) -> Callable[..., Array]:
        # Laws along a direction take plain floats.
        polynomials, along = self._polynomials, []
        for w, model in self._directions:
            if model.terms:
                along.append((w, w[:, None] * w, model.mass_and_force()))

        def acceleration(q: Array, q_dot: Array, push: Array | float = 0.0) -> Array:
            mass, force = polynomials.mass_and_force(q, q_dot)
            mass = mass + np.eye(len(q))
            for w, both, law in along:
                h, pull = law(float(q @ w), float(q_dot @ w))
                mass += (h - 1.0) * both
                force = force + pull * w
            try:
                np.linalg.cholesky(mass - SINGULAR * np.eye(len(q)))
            except np.linalg.LinAlgError:
                self._refuse(q[None])
            return np.linalg.solve(mass, push - force)

        return acceleration

    def energy(self, q: ArrayLike, q_dot: ArrayLike) -> Array:
        """q_dot^T M(q) q_dot / 2 + V(q), per unit mass, (...): constant without damping."""
        q, q_dot = self._motion(q, q_dot)
        kinetic = np.einsum("...i,...ij,...j->...", q_dot, self.inertia(q), q_dot) / 2
        return kinetic + self.potential(q)

    def potential(self, q: ArrayLike) -> Array:
        """V(q), per unit mass, (...)."""
        (q,) = self._motion(q)
        along = (m.energy(q @ w, np.zeros(q.shape[:-1])) for w, m in self._directions)
        return np.asarray(self._polynomials.potential(q) + sum(along))

    def _notes(self) -> dict[str, str]:
        """Frequencies of modes behind the stiffness of the coordinates that they move most."""
        try:
            omega, modes = self.linear_modes
        except ValueError:
            return {}
        notes = {}
        for number, (rate, mode) in enumerate(zip(omega, modes.T, strict=True), 1):
            key = f"omega^2 [q{int(np.argmax(np.abs(mode))) + 1}]"
            notes[key] = f"mode {number}: {rate:.5g} rad/s, {rate / (2 * np.pi):.5g} Hz"
        return notes

    # -- other programs -----------------------------------------------------------------------

    def to_sympy(self) -> tuple[Any, Any]:
        """M(q), (R, R), and all other forces, (R, 1): M q_ddot + force = 0.

        Matrices of sympy, of the real symbols q1 ... qR, q1_dot ... qR_dot; raises as
        `ReducedModel.to_sympy`.

        Examples
        --------
        >>> inertia, force = CoupledModel.from_coefficients(
        ...     {"omega^2 [q1]": 36.0, "omega^2 [q2]": 144.0, "V q1^2 q2": 5.0, "g(q1 q2)^2": 0.5}
        ... ).to_sympy()
        >>> inertia
        Matrix([
        [0.5*q2**2 + 1,     0.5*q1*q2],
        [    0.5*q1*q2, 0.5*q1**2 + 1]])
        """
        return export.equations(self.pairs, self.coordinates)


def model_from_json(text: str) -> Equations:
    """The model of one coordinate or of several that ``to_json`` wrote.

    Raises
    ------
    ValueError
        As those of `ReducedModel.from_json`.
    """
    content = read_json(text)
    found = content if isinstance(content, dict) else {}
    terms, names = found.get("terms"), found.get("coefficients")
    listed = terms if isinstance(terms, list) else ()  # what is neither is refused below
    types = {str(term.get("type")) for term in listed if isinstance(term, dict)}
    coupled = {type_name(kind) for kind in Term.kinds.values() if issubclass(kind, CoupledTerm)}
    named = names if isinstance(names, dict) else ()
    refuse_many(named)
    several = types & coupled or any(isinstance(law_called(n), CoupledTerm) for n in named)
    return (CoupledModel if several else ReducedModel).from_json(text)


def _is_coordinate(w: Array) -> bool:
    return bool(np.count_nonzero(w) == 1 and np.max(w) == 1.0)


class _Products(NamedTuple):
    """What multiplies some velocities, and perhaps an acceleration, in one equation.

    ``values`` (n,) are coefficients of the products of powers.
    """

    equation: int
    rates: tuple[int, ...]
    second: int | None
    values: Array

    def signal(self, q_dot: Array, q_ddot: Array) -> Array | float:
        """Velocities times acceleration, of (R, ...) states."""
        last = 1.0 if self.second is None else q_ddot[self.second]
        return math.prod((q_dot[j] for j in self.rates), start=last)


class _Polynomials(NamedTuple):
    """All polynomial terms as coefficients of one table of n products of powers."""

    powers: Array  # (n, R)
    v: Array  # (n,), of the potential
    # (n, R), (n, R, R), (n, R, R), (n, R, R, R), of dV/dq; of what multiplies q_dot, q_ddot, and
    # two velocities, in each equation
    k: Array
    c: Array
    m: Array
    g: Array

    @classmethod
    def of(cls, pairs: list, r: int) -> _Polynomials:
        rows: dict[Powers, int] = {}
        entries: dict[str, list[tuple[tuple[int, ...], float]]] = {x: [] for x in "vkcmg"}

        def row(powers: Powers) -> int:
            return rows.setdefault((*powers, *(0,) * (r - len(powers))), len(rows))

        for term, value in pairs:
            if isinstance(term, MixedStiffness):
                entries["v"].append(((row(term.powers),), value))
            for m in term.monomials() if isinstance(term, PolynomialTerm) else ():
                part = "m" if m.second is not None else "kcg"[len(m.rates)]
                last = () if m.second is None else (m.second,)
                place = (row(m.powers), m.equation, *m.rates, *last)
                entries[part].append((place, value * m.factor))
        n = len(rows)
        axes = {"v": 0, "k": 1, "c": 2, "m": 2, "g": 3}
        arrays = {part: np.zeros((n, *(r,) * count)) for part, count in axes.items()}
        for part, found in entries.items():
            for place, value in found:
                arrays[part][place] += value
        arrays["g"] = (arrays["g"] + arrays["g"].swapaxes(2, 3)) / 2
        return cls(np.array(list(rows), int).reshape(n, r), **arrays)

    def table(self, q: Array) -> Array:
        """Products of powers, (..., n)."""
        return np.prod(q[..., None, :] ** self.powers, axis=-1)

    def factors(self, q: Array, powers: Array) -> Array:
        """Powers of the coordinates, (R, n, ...), of many states: multiplied, not raised."""
        steps = [np.ones_like(q)]
        for _ in range(int(np.max(powers, initial=0))):
            steps.append(steps[-1] * q)
        found = np.stack(steps)
        return np.stack([found[p, ..., i] for i, p in enumerate(powers.T)])

    def slopes(self, q: Array, factors: Array) -> Array:
        """Derivatives of the products by each coordinate, (R, n, ...)."""
        found = self.factors(q, np.maximum(self.powers - 1, 0))
        for i, slope in enumerate(found):
            slope *= self.powers[:, i].reshape(-1, *(1,) * (slope.ndim - 1))
            for other in (*factors[:i], *factors[i + 1 :]):
                slope *= other
        return found

    def potential(self, q: Array) -> Array:
        return self.table(q) @ self.v

    def stiffness(self, q: Array) -> Array:
        return self.table(q) @ self.k

    def damping(self, q: Array, q_dot: Array) -> Array:
        return np.einsum("...n,nij,...j->...i", self.table(q), self.c, q_dot)

    def mass_and_force(self, q: Array, q_dot: Array) -> tuple[Array, Array]:
        """M (R, R) and all forces (R,) at one state."""
        table = self.table(q)
        turning = np.tensordot(table, self.g, 1) @ q_dot + np.tensordot(table, self.c, 1)
        return np.tensordot(table, self.m, 1), table @ self.k + turning @ q_dot

    @property
    def columns(self) -> list[_Products]:
        """Those that are not zero, of which there are few."""
        found = []
        for part in (self.k, self.c, self.m, self.g):
            for place in np.argwhere(np.any(part, axis=0)):
                i, *others = place.tolist()
                rates, second = ((), others[0]) if part is self.m else (tuple(others), None)
                found.append(_Products(i, rates, second, part[(slice(None), *place)]))
        return found

    def residual(self, q: Array, q_dot: Array, q_ddot: Array) -> Array:
        """As `CoupledModel.residual`."""
        residual, products = np.zeros(q.shape), np.prod(self.factors(q, self.powers), axis=0)
        v, a = np.moveaxis(q_dot, -1, 0), np.moveaxis(q_ddot, -1, 0)
        for column in self.columns:
            value = np.tensordot(column.values, products, 1)
            residual[..., column.equation] += value * column.signal(v, a)
        return residual

    def linearise(self, q: Array, q_dot: Array, q_ddot: Array) -> tuple[Array, Array, Array, Array]:
        """As `CoupledModel.linearise`."""
        shape, r = q.shape, q.shape[-1]
        x, v, a = (y.reshape(-1, r).T.copy() for y in (q, q_dot, q_ddot))  # long loops, states last
        columns, factors = self.columns, self.factors(x.T, self.powers)
        coefficients = np.reshape([c.values for c in columns], (len(columns), len(self.powers)))
        values = coefficients @ np.prod(factors, axis=0)
        slopes = coefficients @ self.slopes(x.T, factors)
        residual = np.zeros_like(x)
        by_q, by_v, by_a = np.zeros((3, r, *x.shape))
        for column, value, slope in zip(columns, values, slopes.swapaxes(0, 1), strict=True):
            i, rates, second, _ = column
            signal = column.signal(v, a)
            residual[i] += value * signal
            by_q[i] += slope * signal
            for place, j in enumerate(rates):
                others = (*rates[:place], *rates[place + 1 :])
                by_v[i, j] += value * column._replace(rates=others).signal(v, a)
            if second is not None:
                by_a[i, second] += value
        by_q, by_v, by_a = (y.transpose(2, 0, 1).reshape(*shape, r) for y in (by_q, by_v, by_a))
        return residual.T.reshape(shape), by_q, by_v, by_a


def linear_terms(n_coordinates: int) -> tuple[Along, ...]:
    """Stiffness and damping of every coordinate by itself."""
    laws = (Stiffness(1), PowerDamping(1))
    return tuple(Along.coordinate(law, i + 1) for i in range(n_coordinates) for law in laws)


def linear_model(omega: Array, ratios: Array, unit: str | None) -> CoupledModel:
    """Small vibrations by angular frequencies and damping ratios, which do not grow."""
    pairs = zip(omega, ratios, strict=True)
    values = [float(v) for w, z in pairs for v in (w**2, 2 * max(z, 0.0) * w)]
    return CoupledModel(linear_terms(len(omega)), tuple(values), unit)
