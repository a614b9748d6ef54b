"""Fits of a given model to forced vibrations, alone or together with decays."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from romsindy.fit.fitted import Fit
from romsindy.fit.forced.between_samples import rated, ways
from romsindy.fit.forced.drives import free_drives, inputs_in, refuse_displacement, regressed
from romsindy.fit.forced.independence import examined
from romsindy.fit.forced.pieces import Driven, forced_among
from romsindy.fit.measured import free_names, ready, require_unit
from romsindy.physics.coupled import AnyModel, CoupledModel
from romsindy.physics.equations import inputs_of, without_inputs
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration


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
    if isinstance(model, CoupledModel):
        raise ValueError(
            f"the model has {model.n_coordinates} coordinates: forced vibrations are fitted with"
            " one coordinate; use a ReducedModel"
        )
    require_unit(several, model.unit)
    own, free_model = inputs_of(model), without_inputs(model)
    known = sorted({*fixed} & {term.key for term in own})
    if known:
        raise ValueError(
            f"fixed names {known}, and gains of inputs are always fitted: leave them out, and scale"
            " the mass instead"
        )
    names, records = free_names(free_model, fixed), ready(several)
    forced = forced_among(records)
    fits: list[Fit] = []
    for way in (own[0].interpolation,) if own else ways([r.decay for r in forced]):
        inputs = own or inputs_in([r.decay for r in forced], way)
        gains = [model.coefficients[term.key] for term in own]
        gains = gains or regressed(free_model.terms, inputs, forced)[1].tolist()
        refuse_displacement(inputs, gains)
        problem = Driven(names, records, loss, progress)
        fits.append(problem.fit(free_model, free_drives(inputs, gains, forced)))
    return examined(decided(fits))


def decided(fits: Sequence[Fit]) -> Fit:
    """The best of fits that differ in what inputs do between their samples, with a note on it.

    Where the records cannot tell, the errors cover what the others say: the covariance of the
    average over all, by their likelihoods (J. Hoeting and others, Statistical Science 14, 1999).
    """
    if len(fits) == 1:
        return fits[0]
    names = [inputs_of(fit.model)[0].interpolation for fit in fits]
    rivals = rated(dict(zip(names, (fit.residuals for fit in fits), strict=True)))
    best = fits[names.index(rivals.best)]
    values = [np.array([fit.model.coefficients[n] for n in best.free]) for fit in fits]
    off = np.array(values) - values[fits.index(best)]
    weights = np.array([rivals.weights.get(name, 0.0) for name in names])
    spread = (weights * off.T) @ off
    return replace(best, covariance=best.covariance + spread, notes=(str(rivals), *best.notes))
