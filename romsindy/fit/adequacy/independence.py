"""Does what a model leaves of a driven record go with the motion, or with its inputs?

Noise need not be white: that of a sensor has a colour, and a force that nobody measured moves a
structure as a missing effect does. But noise knows neither the motion nor the input. Forces that
are functions of both, none of them in the model, are tried together on what is left, weighed by the
noises found in it (`romsindy.fit.kernel.noises`): an F test of generalised least squares, in the
spirit of [1]. Of several coordinates each has such forces, and what may couple them is tried as
well.

[1] S. Billings, W. Voon, Int. J. Control 44 (1986) 803: correlation tests of nonlinear models.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError
from scipy.special import fdtrc

from romsindy.effects.choices import couplings
from romsindy.effects.memory import MemoryEffect
from romsindy.fit.adequacy.verdicts import (
    CYCLES,
    LEAST_LEVELS,
    MOST_LEVELS,
    NOT_TRIED,
    Adequacy,
    ForcedAdequacy,
    examine,
)
from romsindy.fit.kernel.collocation import Trajectory
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.gauss_newton import linear_table
from romsindy.fit.kernel.hypothesis import NormalEquations
from romsindy.fit.kernel.linear_response import Response, nodes, respond, sampled
from romsindy.fit.kernel.linear_steps import Equation
from romsindy.fit.kernel.noises import Noises, NoiseTable, TwoNoises, found_noises, steady
from romsindy.fit.kernel.part import Part, Solution, columns_of, limits, moved_parts
from romsindy.fit.kernel.prepared import Prepared, chi_squared_of, part_of
from romsindy.fit.verdict import EXPLAINED, FADES, FALSE_ALARM
from romsindy.physics.equations import Equations
from romsindy.physics.input import input_in
from romsindy.typing import Array, Indices

_RANK = 1e-7  # of scaled products: columns below it are told by others


class Together(NamedTuple):
    """What columns that are tried tell, beside those that were fitted."""

    # Probability that noise alone goes with them as much: F tests of all of them together, and of
    # the one that tells most, by Bonferroni's inequality
    p_value: float
    most: int  # which of those tried tells most alone
    values: Array  # by which all columns, fitted and tried, tell most
    # Chi-square of what is left over its freedom, where it would be 1 without what they tell
    excess: float


def tell_together(products: Array, n_fitted: int, n: int) -> Together:
    """Of n rows in which noise is white, by their products.

    ``products``, (m + 1, m + 1), are those of the fitted columns, which come first, of the columns
    that are tried, and of what is left, which is the last one.
    """
    fitted, tried = np.arange(n_fitted), np.arange(n_fitted, len(products) - 1)
    every, power = np.concatenate([fitted, tried]), products[-1, -1]
    alone, rank = _explained(products, fitted)
    both, full = _explained(products, every)
    new, freedom, left = full - rank, n - full, power - both
    gain = (both - alone) / new / (left / freedom) if left > 0 else 0.0
    singles = [_explained(products, np.append(fitted, k))[0] - alone for k in tried]
    rest = max(power - alone - max(singles), 0.0) / (n - rank - 1)
    best = fdtrc(1, n - rank - 1, max(singles) / rest) if rest > 0 else 1.0
    vectors, sizes = _directions(products, every)
    return Together(
        p_value=min(2 * float(min(fdtrc(new, freedom, gain), len(tried) * best)), 1.0),
        most=int(np.argmax(singles)),
        values=vectors @ (vectors.T @ products[every, -1] / sizes),
        excess=float((power - alone) / (n - rank) / (left / freedom)) if left > 0 else 1.0,
    )


def _explained(products: Array, some: Indices) -> tuple[float, int]:
    """How much of the last column some others tell, and how many of them differ."""
    vectors, sizes = _directions(products, some)
    told = vectors.T @ products[some, -1]
    return float(np.sum(told**2 / sizes)), len(sizes)


def _directions(products: Array, some: Indices) -> tuple[Array, Array]:
    """Directions that are told apart, among columns of unit size, and their powers."""
    own = products[np.ix_(some, some)]
    power = np.diag(own)
    scale = np.where(power > 0, 1 / np.sqrt(np.where(power > 0, power, 1.0)), 0.0)
    sizes, vectors = np.linalg.eigh(own * scale * scale[:, None])
    told = sizes > _RANK * sizes[-1]
    return scale[:, None] * vectors[:, told], sizes[told]


# Powers of a coordinate and of its velocity that are tried: all of second and third order, and
# those of fifth order that differ from them in their harmonics.
_POWERS = [(2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3), (5, 0), (4, 1), (0, 5)]
SLIDES = 0.02  # of the largest velocity, above which a friction force is nearly all there
_LATE = (-0.25, 0.25)  # cycles by which an input may act later
_LOUDER = 3.0  # than what is heard, which is told to a factor of two
# Of generalised least squares; by a step, what is left of chi-square is settled where it changes by
# the second, and the motion goes astray where it grows by the third as a factor.
_STEPS, _SETTLED, _FAR = 8, 0.05, 10.0


@dataclass(frozen=True)
class Independence:
    """What goes with motion or input in that which a fit leaves, and what is noise."""

    p_value: float  # probability that noise alone goes with them as much
    missing: float  # rms of what goes with them, measured unit
    like: str  # the force that alone tells most of it
    noises: tuple[Noises, ...]  # of each record
    # Probability that a force which is noise differs as much between quarters of a decay
    steady: float
    excess: float  # chi-square of what is left, as in `Together`

    @property
    def fades(self) -> bool:
        """Whether a force fades with a decay: that is no noise, it goes with the motion."""
        return self.steady < FADES

    @property
    def chance(self) -> float:
        """Probability that noise alone does what tells most against it."""
        return self.steady if self.fades else self.p_value


def examine_driven(
    model: Equations,
    solution: Solution,
    records: Sequence[Prepared],
    false_alarm: float = FALSE_ALARM,
) -> ForcedAdequacy:
    """What a hypothesis leaves of driven records."""
    verdict = examine_forced(records, solution.residuals, solution.n_values, false_alarm)
    if not 0 < verdict.part < np.inf:
        return verdict
    return judged(verdict, where_moved(model, solution, records)[0], [*enumerate(records)])


def judged(
    verdict: ForcedAdequacy, found: Independence, pairs: Sequence[tuple[int, Prepared]]
) -> ForcedAdequacy:
    """A verdict with what was found in that which is left."""
    heard = verdict.left / verdict.part  # rms of the response
    counts = [len(r.signal) for _, r in pairs]
    shown = [np.mean(n.shown**2) for n in found.noises]
    sensor = float(np.sqrt(np.average(shown, weights=counts)))
    force = np.sqrt(max(verdict.left**2 - sensor**2, 0.0)) / heard
    return replace(
        verdict,
        ratio=np.sqrt(found.excess),
        structure=found.excess,
        p_value=found.chance,
        # No more than is left: of what no weight is on, anything may go with them.
        missing=max(min(found.missing, verdict.left) / heard, force * found.fades),
        like=found.like,
        sensor=sensor / heard,
        force=force,
        colour=np.average([np.mean(n.colour) for n in found.noises], weights=counts),
    )


def examine_independence(
    model: Equations,
    solution: Solution,
    records: Sequence[tuple[int, Prepared]],
    noises: Mapping[int, Noises] | None = None,
) -> Independence:
    """Of a fit to records, given with their numbers among all of it, as the ``noises`` are.

    Those of other numbers are found.
    """
    tables = [Tried.of(model, solution, i, record, (noises or {}).get(i)) for i, record in records]
    return independence(tables, sum(part.size for part in solution.parts))


def where_moved(
    model: Equations, solution: Solution, records: Sequence[Prepared]
) -> tuple[Independence, Solution | None]:
    """What goes with motion or input in that which a fit leaves, and the noises in it.

    It is looked for about the motions that forces move which nobody measured, those of the second
    if there is one: about a simulation that they led far off, what they do would go with it.
    """
    tables = by_value_of(model, solution, records)
    noises = {i: found_noises(table.noises, table.left) for i, table in enumerate(tables)}
    moved = settled(model, solution, records, noises)
    found = noises if moved is None else {}
    return examine_independence(model, moved or solution, [*enumerate(records)], found), moved


def of_decays(
    model: Equations, solution: Solution, records: Sequence[Prepared]
) -> tuple[Independence, Solution | None]:
    """What goes with the motion of decays, as `where_moved`; too loud a noise does as well."""
    found, moved = where_moved(model, solution, records)
    if any(_louder(n, record) for n, record in zip(found.noises, records, strict=True)):
        found = replace(found, p_value=0.0)
    return found, moved


def _louder(found: Noises, record: Prepared) -> bool:
    """Whether the noise of a sensor is louder than what is heard of it where the record rings.

    Then it stands for something else, such as a mode that the model has not.
    """
    turn = np.exp(-2j * np.pi * record.frequencies * record.decay.dt)
    there = found.sensor[:, None] / np.abs(1 - found.colour[:, None] * turn)
    heard = np.array([noise.std for noise in record.noises])[:, None]
    return bool(np.any(np.all(there > _LOUDER * heard, axis=1)))


def examine_decays(
    model: Equations,
    solution: Solution,
    records: Sequence[Prepared],
    false_alarm: float = FALSE_ALARM,
) -> Adequacy:
    """What a hypothesis leaves of decays, by the noise that was heard, or that is found in it."""
    heard = examine(records, solution.residuals, solution.n_values, false_alarm)
    if told(heard, records) or not 0 < heard.part < np.inf:
        return heard
    return by_noises(heard, solution, records, of_decays(model, solution, records)[0])


def by_noises(
    heard: Adequacy, solution: Solution, records: Sequence[Prepared], found: Independence
) -> Adequacy:
    """The verdict by the noises that are found.

    Where more than noise is left that which was heard says from which amplitude on. Decays without
    noise tell the least of terms: there is no misfit that does not matter.
    """
    if misses(heard, found):
        return heard
    size = examine_forced(records, solution.residuals, solution.n_values, heard.false_alarm)
    return judged(size, found, [*enumerate(records)])


def misses(heard: Adequacy, found: Independence) -> bool:
    """Whether more is left than noise, by its level and whatever its colour."""
    return found.chance < heard.false_alarm and not heard.explained


def told(heard: Adequacy, records: Sequence[Prepared]) -> bool:
    """Whether the level of the noise of decays explains them: it is that where they ring.

    Where much less is left, noise has a colour, and its level may hide what is missing; but for a
    level that is no noise, and does not matter.
    """
    given = all(2 * noise.floor**2 > noise.std**2 for r in records for noise in r.noises)
    return heard.explained and (given or heard.ratio * EXPLAINED > 1)


def independence(tables: Sequence[Tried], n_values: int) -> Independence:
    """Of records to which so many values were fitted."""
    products = np.sum([table.products for table in tables], axis=0)
    found = tell_together(products, n_values, sum(table.freedom for table in tables))
    power = sum(float(np.sum((table.columns @ found.values) ** 2)) for table in tables)
    samples = sum(len(table.columns) for table in tables)
    return Independence(
        p_value=found.p_value,
        missing=float(np.sqrt(power / samples)),
        like=tables[0].names[found.most],
        noises=tuple(table.noises for table in tables),
        steady=min(1.0, len(tables) * min(table.steady for table in tables)),
        excess=found.excess,
    )


@dataclass(frozen=True)
class Tried:
    """Of one record: weighed products of what was fitted, of forces, and of what is left."""

    names: tuple[str, ...]
    columns: Array  # (n, m), derivatives of the samples by all fitted values and forces
    products: Array  # (m + 1, m + 1)
    noises: Noises
    steady: float  # of a decay, as in `Independence`
    freedom: int

    @classmethod
    def of(
        cls,
        model: Equations,
        solution: Solution,
        i: int,
        record: Prepared,
        noises: Noises | None = None,
    ) -> Tried:
        """Of a fit; noises are found in what it leaves unless they are given."""
        parts, motion = solution.parts, solution.motions[i]
        fitted = linear_table(model, parts, i, record, motion)[1][:, : -len(motion.start) - 1]
        wide = np.zeros((len(fitted), sum(p.size for p in parts)))
        wide[:, columns_of(parts, i)] = fitted * record.white[:, None]  # they come over white noise
        equation = equation_of(model, parts, i, record)
        forces = _forces(model, parts, record, motion)
        left = solution.residuals[i]
        return cls.along(equation, parts, i, record, motion, wide, left, forces, noises)

    @classmethod
    def along(
        cls,
        equation: Equation,
        parts: Sequence[Part],
        number: int,
        record: Prepared,
        motion: Trajectory,
        fitted: Array,
        left: Array,
        forces: Iterable[Force],
        noises: Noises | None = None,
    ) -> Tried:
        """Of what is left, (c n,), along a motion; ``fitted`` (c n, m): derivatives by values."""
        two = TwoNoises.along(equation, parts, number, record, motion)
        noises, forces = noises or found_noises(two, left), list(forces)
        response = respond(equation, motion, np.array([f.values for f in forces]))
        states = len(motion.start)
        x = record.in_orders(parts, response.samples)[..., 1:-states]
        reading = record.shown(parts, number, partial(sampled, motion))
        columns = np.column_stack([fitted, reading.by_motion(x)])
        products = two.table(np.column_stack([columns, left])).weighed(noises).products
        names = tuple(f.name for f in forces)
        alike = 1.0 if record.driven else steady(two, left, noises)
        return cls(names, columns, products, noises, alike, len(left) - states)


class Force(NamedTuple):
    """A force that is tried."""

    name: str
    values: Array  # at the Gauss points, in every equation: (3 n_steps, R)


def _forces(
    model: Equations, parts: Sequence[Part], record: Prepared, motion: Trajectory
) -> Iterator[Force]:
    """Functions of the motion and of the inputs, of about unit size."""
    t, *states = nodes(motion)
    unit = np.eye(model.n_coordinates)
    for i, name in enumerate(model.coordinates):
        alone = forces_alone(motion, name, i)
        on = f" on {name}" if model.numbered else ""
        late = _late(model, parts, record, t, 1 / float(record.frequencies[i]))
        for what, values in (*alone, *((what + on, values) for what, values in late)):
            yield Force(what, values[:, None] * unit[i])
    if model.numbered:
        for law in couplings(model.n_coordinates):
            values = law.strong(*states)
            yield Force(law.key, values / max(float(np.abs(values).max()), 1e-300))


def forces_alone(motion: Trajectory, name: str, at: int = 0) -> Iterator[tuple[str, Array]]:
    """Functions of one coordinate at the Gauss points, (3 n_steps,)."""
    _, *states, _ = nodes(motion)
    ends = zip(states, (motion.q, motion.q_dot), strict=True)
    q, v = (x[:, at] / np.abs(end[:, at]).max() for x, end in ends)
    for i, j in _POWERS:
        powers = [(name, i), (f"{name}_dot", j)]
        yield " ".join(f"{x}^{k}" if k > 1 else x for x, k in powers if k), q**i * v**j
    yield f"the sign of {name}_dot", np.tanh(v / SLIDES)
    yield f"|{name}_dot| {name}_dot", np.abs(v) * v
    yield f"|{name}| {name}", np.abs(q) * q


# Powers of an input are not tried: the largest values of a sine that is measured with noise are
# those that noise made larger, and a cube goes with that.
def _late(
    model: Equations, parts: Sequence[Part], record: Prepared, t: Array, cycle: float
) -> Iterator[tuple[str, Array]]:
    """Inputs that act a quarter of a cycle, in s, sooner or later."""
    laws = (*model.terms, *(law for part in parts for law in part.effect.laws()))
    for term in dict.fromkeys(i for law in laws if (i := input_in(law)) is not None):
        for cycles in _LATE:
            other = replace(term, delay=term.delay + cycles * cycle)
            late = "later" if cycles > 0 else "sooner"
            name = f"{term.signal} a quarter of a cycle {late}"
            values = np.zeros_like(t)
            if term.source in record.inputs:
                values = record.inputs[term.source].at(t, other)
            yield name, values / max(float(np.abs(values).max()), 1e-300)


def examine_forced(
    records: Sequence[Prepared],
    residuals: Sequence[Array],
    n_values: int,
    false_alarm: float = FALSE_ALARM,
) -> ForcedAdequacy:
    """How much residuals (n,) are; what they are is not tried, see `independence`."""
    n = sum(map(len, residuals))
    power = sum(float(e @ e) for e in residuals)
    return ForcedAdequacy(
        ratio=float(np.sqrt(chi_squared_of(records, residuals) / max(n - n_values, 1))),
        limit=max(r.amplitude for r in records),
        unit=records[0].decay.unit,
        false_alarm=false_alarm,
        left=float(np.sqrt(power / n)),
        part=part_of(records, residuals),
        measured_unit=records[0].decay.signal_unit,
        levels=_levels(records, residuals),
        **NOT_TRIED,
    )


def _levels(records: Sequence[Prepared], residuals: Sequence[Array]) -> Array:
    """Rms of the response and of what is left, (k, 2), from quiet to loud."""
    windows = []
    for record, left in zip(records, residuals, strict=True):
        size = round(CYCLES / (float(record.frequencies.min()) * record.decay.dt))
        both = np.stack([record.signal - record.signal.mean(), left]).reshape(2, -1, len(record.t))
        whole = len(record.t) // size
        parts = both[..., : whole * size].reshape(2, both.shape[1], whole, size)
        windows.append(np.mean(parts**2, axis=(1, 3)).T)
    power = np.concatenate(windows)
    count = min(MOST_LEVELS, len(power) // 2)
    if count < LEAST_LEVELS:
        return np.zeros((0, 2))
    ordered = power[np.argsort(power[:, 0])]
    return np.sqrt([part.mean(axis=0) for part in np.array_split(ordered, count)])


# -- what forces that nobody measured move ---------------------------------------------------------


def by_values(
    model: Equations,
    parts: tuple[Part, ...],
    i: int,
    record: Prepared,
    motion: Trajectory,
    left: Array | None = None,
) -> tuple[Response, NoiseTable]:
    """Response of a motion in record i to all values, and its samples, to be weighed by noises.

    Columns are the derivatives by the values that act there, and ``left`` (c n,): by default what
    the motion leaves where it leads.
    """
    response, rows = linear_table(model, parts, i, record, motion)
    rows *= record.white[:, None]  # they come over white noise
    last = rows[:, -1] if left is None else left
    two = TwoNoises.along(equation_of(model, parts, i, record), parts, i, record, motion)
    columns = rows[:, : len(columns_of(parts, i))]
    return response, two.table(np.column_stack([columns, last]))


def by_value_of(
    model: Equations, solution: Solution, records: Sequence[Prepared]
) -> list[NoiseTable]:
    """The samples of a fit to all records, with what it leaves."""
    several = enumerate(zip(records, solution.motions, solution.residuals, strict=True))
    return [by_values(model, solution.parts, i, *each)[1] for i, each in several]


def settled(
    model: Equations, solution: Solution, records: Sequence[Prepared], noises: Mapping[int, Noises]
) -> Solution | None:
    """The same by generalised least squares; ``noises`` are those of records, by their number.

    Steps of Gauss and Newton about the most likely motions, which the forces move; residuals are
    those of the motions without them. None where the steps do not settle or have no motion, and
    where forces remember.
    """
    parts, motions, last = solution.parts, solution.motions, np.inf
    if any(isinstance(p.effect, MemoryEffect) for p in parts):  # it would remember what they move
        return None
    for _ in range(_STEPS):
        try:
            with np.errstate(all="ignore"):
                step = _Step.about(model, records, parts, motions, noises)
        except LinAlgError:  # beyond what numbers hold
            return None
        if not step.left < _FAR * last:
            return None
        parts, motions = step.parts, step.motions
        if abs(last - step.left) < _SETTLED:
            return Solution(parts, motions, step.residuals, step.left, step.covariance, True)
        last = step.left
    return None


class _Step(NamedTuple):
    """Where a step leads, the covariance of the values, the chi-square that it leaves, and what the
    motion leaves without forces."""

    parts: tuple[Part, ...]
    motions: tuple[Trajectory, ...]
    covariance: Array
    left: float
    residuals: tuple[Array, ...]

    @classmethod
    def about(
        cls,
        model: Equations,
        records: Sequence[Prepared],
        parts: tuple[Part, ...],
        motions: Sequence[Trajectory],
        noises: Mapping[int, Noises],
    ) -> _Step:
        n_values = sum(p.size for p in parts)
        system = NormalEquations(n_values, len(motions), n_coordinates=model.n_coordinates)
        ways, left = [], []
        for i, (record, motion) in enumerate(zip(records, motions, strict=True)):
            where = columns_of(parts, i)
            if i in noises:
                response, table = by_values(model, parts, i, record, motion)
                if not all(np.isfinite(rows).all() for rows in table.channels):
                    raise LinAlgError("the motion goes astray")
                system.add_products(where, table.weighed(noises[i]).products)
                ways.append(partial(_driven, response, where, table, noises[i]))
                left.append(table.left)
            else:
                response, rows = linear_table(model, parts, i, record, motion)
                where = np.append(where, system.states_of(i))
                system.add(where, rows)
                ways.append(partial(_free, response, where))
                left.append(rows[:, -1] * record.white)
        system.add_priors(parts)
        if not system.finite:
            raise LinAlgError("the motion goes astray")
        step = system.bounded_step(np.zeros(n_values, bool), *limits(parts))
        return cls(
            moved_parts(parts, step[:n_values]),
            tuple(way(step) for way in ways),
            system.covariance()[:n_values, :n_values],
            system.chi_squared(step),
            tuple(left),
        )


def _free(response: Response, where: Indices, step: Array) -> Trajectory:
    return response.moved(np.concatenate([[1.0], step[where]]))


def _driven(
    response: Response, where: Indices, table: NoiseTable, noises: Noises, step: Array
) -> Trajectory:
    """With what forces that were not measured move."""
    states = table.states(noises) @ np.append(-step[where], 1.0)
    at_start = np.zeros(2 * response.q.shape[1])
    motion = response.moved(np.concatenate([[1.0], step[where], at_start]))
    return table.noises.moved(motion, states)
