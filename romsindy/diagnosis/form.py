"""Model-form error: what an equation leaves although nothing is missing but a better equation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from romsindy.effects import LinearFrequency, Viscous
from romsindy.fit.adequacy import examine_white
from romsindy.fit.gauss_newton import Solution, fit
from romsindy.fit.part import Part
from romsindy.fit.process_noise import Departures, Marginal
from romsindy.fit.record import Record, scales
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay


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
