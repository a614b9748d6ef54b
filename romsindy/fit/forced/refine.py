"""Fits of a given model to forced vibrations, alone or together with decays."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from romsindy.fit.coupled_record import free_shapes
from romsindy.fit.coupled_terms import linear_model
from romsindy.fit.fitted import Fit
from romsindy.fit.forced.adequacy import ForcedAdequacy
from romsindy.fit.forced.between_samples import Rivals, rated, ways
from romsindy.fit.forced.drives import drives_of, inputs_in, refuse_displacement, regressed
from romsindy.fit.forced.modes import Modes, modes_near
from romsindy.fit.forced.pieces import Driven, beside_the_whole
from romsindy.fit.forced.weighed import examined
from romsindy.fit.measured import (
    driven_among,
    free_names,
    ready,
    ready_along,
    require_unit,
    small_frequencies,
)
from romsindy.fit.part import Part
from romsindy.fit.record import Prepared
from romsindy.physics.coupled import AnyModel, CoupledModel
from romsindy.physics.equations import inputs_of, with_inputs, without_inputs
from romsindy.physics.input import Input, input_in
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.interpolation import Interpolation
from romsindy.record.ringing import require_channels


def refined_forced(
    model: AnyModel,
    several: Sequence[ForcedVibration | Decay],
    fixed: Collection[str] = (),
    *,
    loss: str = "linear",
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """`romsindy.refine` where inputs drive the motion, in some records at least.

    A model without inputs is given those of the records. Where nothing says what they do between
    their samples, each way is tried.
    """
    require_unit(several, model.unit)
    own = {t.key: i for t in model.terms if (i := input_in(t)) is not None}
    free_model, known = without_inputs(model), sorted({*fixed} & {*own})
    if known:
        raise ValueError(
            f"fixed names {known}, and gains of inputs are always fitted: leave them out, and scale"
            " the mass instead"
        )
    names = free_names(free_model, fixed)
    look = Look.near(free_model, several)
    if own:
        return decided([look.fit(names, model, loss, progress)], look.records)
    fits: list[Fit] = []
    for way in ways(look.measured):
        inputs = inputs_in(look.measured, way)
        driven = with_inputs(free_model, inputs, look.gains(free_model.terms, inputs))
        fits.append(look.fit(names, driven, loss, progress))
    return decided(fits, look.records)


class Look(NamedTuple):
    """A first look at records, some of them driven.

    ``shapes`` are what channels show of several coordinates, as parts that are fitted, ``modes``
    the linear modes that the inputs move.
    """

    records: tuple[Prepared, ...]
    shapes: tuple[Part, ...] = ()
    modes: Modes | None = None

    @classmethod
    def of(cls, several: Sequence[ForcedVibration | Decay], modes: Modes | None) -> Look:
        """For one coordinate, or those of some modes."""
        if modes is None:
            return cls(ready(several))
        free = [v if isinstance(v, ForcedVibration) else v.free() for v in several]
        records = ready_along(free, modes)
        return cls(records, free_shapes(records), modes)

    @classmethod
    def near(cls, model: AnyModel, several: Sequence[ForcedVibration | Decay]) -> Look:
        """For a model without inputs, with frequencies near those of the records."""
        if not model.numbered:
            return cls.of(several, None)
        require_channels(several, several[0].n_channels)
        omega = 2 * np.pi * small_frequencies(model)
        modes = modes_near(driven_among(several), omega, model.linear_damping_ratios)
        return cls.of(several, modes)

    @property
    def driven(self) -> list[Prepared]:
        """Those with inputs."""
        return [r for r in self.records if r.driven]

    @property
    def measured(self) -> list[ForcedVibration]:
        """What was measured of these."""
        return [r.decay for r in self.driven]

    def gains(self, terms: Sequence[Term], inputs: Sequence[Input]) -> list:
        """Of inputs beside some terms, from which a fit may start."""
        if self.modes is not None:
            return [self.modes.gains[term.source] for term in inputs]
        return regressed(terms, inputs, self.driven)[1].tolist()

    def model(
        self, terms: tuple[Term, ...], inputs: Sequence[Input], fixed: Mapping[str, float]
    ) -> AnyModel:
        """Terms and inputs with values from which a fit may start; ``fixed`` ones are known."""
        unit = self.records[0].decay.unit
        if self.modes is None:
            found, gains = regressed(terms, inputs, self.driven, fixed)
            model = ReducedModel(terms, tuple(found.tolist()), unit)
            return with_inputs(model, inputs, gains.tolist())
        linear = linear_model(self.modes.omega, self.modes.ratios, unit)
        values = linear.coefficients | dict(fixed)
        at = tuple(values.get(t.key, 0.0) for t in terms)
        return with_inputs(CoupledModel(terms, at, unit), inputs, self.gains(terms, inputs))

    def fit(
        self,
        names: tuple[str, ...],
        model: AnyModel,
        loss: str = "linear",
        progress: Callable[[str], None] | None = None,
    ) -> Fit:
        """Coefficients of these names, from a model with its inputs on."""
        pairs = zip(model.terms, model.values, strict=True)
        acting = [(i, gain) for t, gain in pairs if (i := input_in(t)) is not None]
        refuse_displacement(*zip(*acting, strict=True))
        beside = (*drives_of(model, self.driven), *self.shapes)
        problem = Driven(names, self.records, loss, progress)
        return problem.fit(without_inputs(model), beside)


def decided(fits: Sequence[Fit], records: Sequence[Prepared]) -> Fit:
    """The best of fits that differ in what inputs do between their samples, with its verdict.

    Where the records cannot tell, the errors cover what the others say: the covariance of the
    average over all, by their likelihoods (J. Hoeting and others, Statistical Science 14, 1999).
    """
    if len(fits) == 1:
        return beside_the_whole(examined(fits[0]), records)
    names = [inputs_of(fit.model)[0].interpolation for fit in fits]
    left = [
        [e for r, x in zip(fit.records, fit.residuals, strict=True) for e in r.by_channel(x)]
        for fit in fits
    ]
    rivals = rated(dict(zip(names, left, strict=True)))
    rivals, best = _examined(dict(zip(names, fits, strict=True)), rivals)
    values = [np.array([fit.model.coefficients[n] for n in best.free]) for fit in fits]
    off = np.array(values) - values[names.index(rivals.best)]
    weights = np.array([rivals.weights.get(name, 0.0) for name in names])
    spread = (weights * off.T) @ off
    best = beside_the_whole(best, records)
    return replace(best, covariance=best.covariance + spread, notes=(str(rivals), *best.notes))


def _examined(fits: Mapping[Interpolation, Fit], rivals: Rivals) -> tuple[Rivals, Fit]:
    """The likeliest way that leaves noise, with its verdict; the likeliest of all where none does.

    A way that smooths the noise of the sensor of an input leaves less of it without being right.
    """
    for way in rivals.tried:
        fit = examined(fits[way])
        if not (isinstance(fit.verdict, ForcedAdequacy) and fit.verdict.structured):
            return (rivals if way == rivals.best else rivals.only(way)), fit
    return rivals, examined(fits[rivals.best])
