"""Fits of a given model to forced vibrations, alone or together with decays."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from romsindy.fit.fitted import Fit, refined
from romsindy.fit.forced.between_samples import plainest, ways
from romsindy.fit.forced.drives import (
    free_drives,
    inputs_in,
    inputs_of,
    refuse_displacement,
    regressed,
    without_inputs,
)
from romsindy.fit.forced.record import ForcedRecord
from romsindy.fit.measured import free_names, free_offsets, ready, require_unit
from romsindy.fit.record import Record
from romsindy.physics.coupled import AnyModel, CoupledModel
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
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
        fits.append(driven(free_model, names, inputs, gains, records, loss=loss, progress=progress))
    return decided(fits)


def forced_among(records: Sequence[Record | ForcedRecord]) -> list[ForcedRecord]:
    """Those with inputs."""
    return [r for r in records if isinstance(r, ForcedRecord)]


def driven(
    model: ReducedModel,
    names: tuple[str, ...],
    inputs: Sequence[Input],
    gains: Sequence[float],
    records: Sequence[Record | ForcedRecord],
    *,
    loss: str = "linear",
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Coefficients, gains and delays of inputs, and offsets, fitted from these values on."""
    drives = free_drives(inputs, gains, forced_among(records))
    more = (*drives, free_offsets(records))
    return refined(model, names, records, more, loss=loss, progress=progress)


def decided(fits: Sequence[Fit]) -> Fit:
    """The best of fits that differ in what inputs do between their samples, and what is said of it.

    Raises
    ------
    ValueError
        If an input can be no acceleration of a base.
    """
    fit, *others = fits
    if others:
        by_way = {inputs_of(f.model)[0].interpolation: f for f in fits}
        best, told = plainest({way: f.residuals for way, f in by_way.items()})
        fit = replace(by_way[best], notes=(told, *by_way[best].notes))
    refuse_displacement(fit.model)
    return fit
