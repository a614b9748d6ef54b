"""Model-form error: what an equation leaves although nothing is missing but a better equation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from romsindy.diagnosis.worth import Solved
from romsindy.effects import LinearFrequency, Viscous
from romsindy.fit.adequacy import examine_white
from romsindy.fit.gauss_newton import Solution, fit, moved_parts
from romsindy.fit.part import Part, prior_cost
from romsindy.fit.process_noise import Departures, Marginal
from romsindy.fit.record import Record, scales
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.typing import Array


@dataclass(frozen=True)
class FormError:
    """How far the motion of a model may be from a measured one.

    Attributes
    ----------
    jump : float
        Process noise: so much the frequency, relatively, and the damping ratio are off from one
        window of a few cycles to another.
    structure : float
        Rms of what repeats with the vibration beside that, such as wrong harmonics, in the largest
        amplitude of a record.
    """

    jump: float = 0.0
    structure: float = 0.0

    def joined(self, other: FormError) -> FormError:
        """The larger of both, one by one."""
        return FormError(max(self.jump, other.jump), max(self.structure, other.structure))

    def times(self, factor: float) -> FormError:
        """So many times as large."""
        return FormError(factor * self.jump, factor * self.structure)

    def __le__(self, other: FormError) -> bool:
        """Whether it is within another one."""
        return self.joined(other) == other

    @classmethod
    def of(cls, model: ReducedModel, reference: Decay, floor: float) -> FormError:
        """What a model needs on the record that it was identified from.

        Parameters
        ----------
        model : ReducedModel
        reference : Decay
        floor : float
            Least noise, as a part of the largest amplitude.

        Raises
        ------
        ValueError
            If the model has no motion near the record.
        """
        records = [Record.loud(reference, floor)]
        parts = [Part.of(e, scales(records), 1) for e in (LinearFrequency(), Viscous())]
        weighed = Weighed.of(model, fit(model, parts, records), records)
        if weighed is None:
            raise ValueError(
                "the model has no motion near its reference: give the record that it was"
                " identified from, in the same unit"
            )
        return weighed.needed


NO_FORM_ERROR = FormError()


@dataclass(frozen=True)
class Weighed:
    """What a fit says of its values at any form error, and what form error it needs.

    Attributes
    ----------
    marginal : Marginal
    needed : FormError
    gain : float
        Power at the harmonics that a structure of one amplitude has, over that of noise.
    n_functions : int
        That what repeats with the vibration is made of.
    """

    marginal: Marginal
    needed: FormError
    gain: float
    n_functions: int

    @classmethod
    def of(
        cls, model: ReducedModel, solution: Solution, records: Sequence[Record]
    ) -> Weighed | None:
        """Weigh a fit; None where it has no motion."""
        if not solution.finite:
            return None
        free = Departures.of(model, solution.parts, records, solution.motions)
        if free is None:
            return None
        left = examine_white(records, free.left, solution.n_values)
        power = sum(r.count * (np.abs(r.signal).max() / r.noise.std) ** 2 for r in records)
        gain = power / max(left.n_functions, 1)
        structure = float(np.sqrt(max(left.structure - 1, 0.0) / gain))
        return cls(free.marginal, FormError(free.jump, structure), gain, left.n_functions)

    def excess(self, form: FormError) -> float:
        """Power at the harmonics over that of noise: 1 where nothing is wrong."""
        return 1 + self.gain * form.structure**2

    def solved(self, solution: Solution, form: FormError) -> Solved:
        """The fit at a form error: values, misfit and covariance."""
        jump, excess, n = form.jump, self.excess(form), len(solution.covariance)
        system, step = self.marginal.solve(jump, excess)
        if jump:
            parts = moved_parts(self.marginal.parts, step[:n])
            misfit = self.marginal.cost(jump, excess)
        else:
            parts, known = solution.parts, prior_cost(solution.parts)
            misfit = (solution.chi_squared - known) / excess + known
        return Solved(system, misfit, parts, _given(system.covariance()[:n, :n], parts))


def _given(covariance: Array, parts: Sequence[Part]) -> Array:
    """Covariance of the values of parts where shape values that are held are known."""
    held: list[bool] = []
    for part in parts:
        held += [False] * part.strengths.size + [p.low == p.high for p in part.parameters]
    if not any(held):
        return covariance
    cross = covariance[:, held]
    known = covariance - cross @ np.linalg.pinv(cross[held], hermitian=True) @ cross.T
    known[held] = known[:, held] = 0.0
    return known
