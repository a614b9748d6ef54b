"""Values of a fit to driven records, weighed by the noises that are in them.

Least squares over a simulation take what is left for white. Where a force that nobody measured
moves the structure, or the noise of the sensor has a colour, generalised least squares tell the
values better, and theirs is the covariance that they have. The motion is then one that these forces
move as is most likely, so that a sensitive one does not go astray.

Noise of the sensor of an input looks the same as a force that was not measured. The gain that
follows the motion best is then too small, by the part of the power of the input that is noise [1]:
its error counts both.

[1] W. A. Fuller, "Measurement Error Models", Wiley 1987, section 1.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from romsindy.effects.drive import Drive
from romsindy.fit.collocation import TrajectoryError
from romsindy.fit.fitted import Fit, concluded
from romsindy.fit.forced.adequacy import ForcedAdequacy, examine_forced
from romsindy.fit.forced.independence import (
    Independence,
    examine_independence,
    judged,
    of_decays,
    settled,
    told,
)
from romsindy.fit.gauss_newton import Solution
from romsindy.fit.gauss_newton import fit as follow
from romsindy.fit.noises import Noises
from romsindy.fit.part import Part
from romsindy.fit.record import Prepared
from romsindy.fit.shooting import resimulated
from romsindy.typing import Array


def examined(fit: Fit) -> Fit:
    """The same with its verdict by what is left of its driven records, or of its decays.

    Where that is noise, the values and their errors are those that it weighs. Decays of which more
    is left keep their verdict: it says from which amplitude on.
    """
    driven = [(i, r) for i, r in enumerate(fit.records) if r.driven]
    pairs = driven or [*enumerate(fit.records)]
    if not driven and told(fit.verdict):
        return fit
    if not 0 < _size(fit, pairs).part < np.inf:
        return fit  # there is no motion, or nothing is left
    if driven:
        found = examine_independence(fit.start, fit.solution, pairs)
        first = judged(_size(fit, pairs), found, pairs)
        if first.structured:
            return replace(fit, verdict=first)
        moved = settled(fit.start, fit.solution, fit.records, _by_record(pairs, found))
    else:
        found, moved = of_decays(fit.start, fit.solution, fit.records)
        if found.chance < fit.verdict.false_alarm and not fit.verdict.explained:
            return fit
    if moved is not None:
        fit = _weighed(fit, moved, _by_record(pairs, found))
    return replace(fit, verdict=judged(_size(fit, pairs), found, pairs))


def _by_record(pairs: Sequence[tuple[int, Prepared]], found: Independence) -> dict[int, Noises]:
    return {i: own for (i, _), own in zip(pairs, found.noises, strict=True)}


def _size(fit: Fit, pairs: Sequence[tuple[int, Prepared]]) -> ForcedAdequacy:
    """How much is left."""
    if isinstance(fit.verdict, ForcedAdequacy):
        return fit.verdict
    records, left = zip(*((r, fit.residuals[i]) for i, r in pairs), strict=True)
    return examine_forced(records, left, fit.solution.n_values)


def _weighed(fit: Fit, moved: Solution, noises: Mapping[int, Noises]) -> Fit:
    """A fit with the values of one that forces move; as it is where that cannot be simulated."""
    parts = moved.parts
    found = follow(fit.start, parts, fit.records, moved.motions, fixed=True)
    if not found.converged:  # where motion is sensitive, it swings between two starts
        try:
            found = resimulated(fit.start, moved, fit.records)
        except TrajectoryError:
            return fit
    own = fit.model.terms[: len(fit.start.terms)]
    model = replace(fit.model, terms=own, values=fit.start.values)
    both = [_of_inputs(part, fit.records, noises) for part in parts]
    found = replace(found, covariance=moved.covariance + np.diag(np.concatenate(both) ** 2 / 2))
    return replace(concluded(model, fit.start, fit.records, found), notes=fit.notes)


def _of_inputs(part: Part, records: Sequence[Prepared], noises: Mapping[int, Noises]) -> Array:
    """By how much the values of a part change where forces are noise of the sensor of its input."""
    change = np.zeros(part.size)
    if not isinstance(part.effect, Drive):
        return change
    source, gain, noisy = part.effect.of.source, part.strengths.ravel(), []  # parts of its power
    weights = np.square(part.effect.directions)
    for i, noise in noises.items():
        measured = records[i].decay
        if source in measured.names:
            u = measured.u[:, measured.names.index(source)]
            power = measured.dt * float(np.var(u)) * np.maximum(gain**2, 1e-300)
            # Its noise moves all coordinates: no more than is found at the least of them.
            noisy.append(min(1.0, float(np.min(weights @ noise.force / power))))
    change[: len(gain)] = float(np.mean(noisy)) * np.abs(gain)
    return change
