"""Fit a model by simulation: the simulated motion follows the measured one over the whole decay.

Regression takes noisy displacements as its regressors, and noise there biases what it finds. Here
all noise is on one side: that of the measurement. The fit starts from the measured motion, smoothed
(`romsindy.fit.kernel.gauss_newton`), so that the phase is never a cycle off, and ends with exact
motions (`romsindy.fit.kernel.shooting`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, cast

from romsindy.fit.forced.drives import inputs_in, regressed
from romsindy.fit.forced.refine import refined_forced
from romsindy.fit.kernel.part import LINEAR, Part
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.kernel.shooting import LOSSES
from romsindy.fit.records.arguments import (
    free_names,
    listed_records,
    prepared,
    ready,
    require_known,
    require_unit,
    several_decays,
    small_frequencies,
)
from romsindy.fit.records.coupled import coupled_records, free_offsets, free_shapes
from romsindy.fit.records.record import NUMERICS, Record
from romsindy.fit.results.fitted import Fit, examined, refined
from romsindy.fit.results.predict import form_of
from romsindy.physics.coupling import CoupledTerm
from romsindy.physics.equations import Equations
from romsindy.physics.input import Input
from romsindy.physics.model import ReducedModel
from romsindy.physics.term import Term
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.recording import Given


def refine(
    model: Equations,
    decays: Decay | ForcedVibration | Sequence[Decay | ForcedVibration],
    *,
    fixed: Collection[str] = (),
    offset: bool = False,
    loss: str = "linear",
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Fit the coefficients of a model by simulation.

    Parameters
    ----------
    model : ReducedModel or CoupledModel
        Structure and start, such as ``HarmonicSINDy().fit(decay).model_``. A model of several
        coordinates needs frequencies near those of the record; all else may start from 0.
    decays : Decay, ForcedVibration or sequence of them
        In the unit of the model; one channel each, or for several coordinates any number: what a
        channel shows of a coordinate is fitted, and is 1 where that moves it most. The free part
        is fitted, in the quantity that was measured: displacement, velocity or acceleration.
    fixed : names
        Coefficients that keep their value: any of ``model.coefficients``.
    offset : bool
        Fit a constant offset of the sensor too.
    loss : "linear" or "soft_l1"
        As in `scipy.optimize.least_squares`; "soft_l1" forgives outliers beyond three times the
        noise.
    progress : callable, optional
        Called with a line of text at every simulation.

    Returns
    -------
    Fit
        After an interrupt (Ctrl-C) during the simulations, what had been reached.

    Raises
    ------
    ValueError
        For unknown names in ``fixed``, another loss, other units, a decay given twice, or nothing
        to fit.
    TrajectoryError
        If no motion of the model follows the measured one.

    Examples
    --------
    >>> from romsindy import HarmonicSINDy, example_decay
    >>> decay = example_decay(40, periods=20, samples=30)
    >>> fit = refine(HarmonicSINDy().fit(decay).model_, decay)
    >>> f"{fit.model.coefficients['c_linear']:.3f} +- {fit.standard_errors['c_linear']:.4f} 1/s"
    '0.060 +- 0.0004 1/s'
    """
    if loss not in LOSSES:
        raise ValueError(f"loss = {loss!r} must be one of {LOSSES}")
    several = listed_records(decays)
    if Given.of(several).driven:
        return refined_forced(model, several, fixed, loss=loss, progress=progress)
    free = free_names(model, fixed)
    records, more = _seen(model, several_decays(several), offset)
    found = refined(model, free, records, more, loss=loss, progress=progress)
    if loss == "linear" and all(r.whole for r in records):
        found = examined(found)  # the rest may be a force that nobody measured
    if model.numbered:
        return found
    own = found.solution
    alone = cast(tuple[Record, ...], found.records)
    return found.with_form(form_of(cast(Any, found.start), own.parts, alone, own.motions))


def refine_terms(
    several: Sequence[Decay | ForcedVibration],
    terms: Sequence[Term],
    fixed: Mapping[str, float],
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Fit a model of one coordinate that has these terms beside the linear ones.

    Its values start from least squares on the smooth motions; ``fixed`` ones stay as they are.
    """
    if wrong := [t for t in terms if isinstance(t, CoupledTerm) or not isinstance(t, Term)]:
        raise ValueError(
            f"terms hold {wrong}: give names or laws of one coordinate, such as 'gamma_3'"
        )
    if inputs := [t.key for t in terms if isinstance(t, Input)]:
        raise ValueError(
            f"terms hold {inputs}: leave inputs out, they come with the records; one that was"
            " measured makes a record a ForcedVibration"
        )
    laws = tuple({t.key: t for t in (*LINEAR, *terms)}.values())
    require_known(fixed, [t.key for t in laws])
    records = ready(several)
    acting = inputs_in([r.decay for r in records if r.driven], "linear")
    found = regressed(laws, acting, records)[0].tolist()
    values = tuple(fixed.get(t.key, v) for t, v in zip(laws, found, strict=True))
    model = ReducedModel(laws, values, several[0].unit)
    return refine(model, several, fixed=tuple(fixed), progress=progress)


def _seen(
    model: Equations, decays: Sequence[Decay], offset: bool
) -> tuple[tuple[Prepared, ...], tuple[Part, ...]]:
    """Records, and what of their sensors is fitted: offsets, or mode shapes."""
    if not model.numbered:
        records = prepared(decays, model.unit)
        return records, (free_offsets(records),) if offset else ()
    if offset:
        raise ValueError(
            "offset = True is for models of one coordinate: subtract the mean of each channel"
        )
    require_unit(decays, model.unit)
    several = coupled_records([d.free() for d in decays], small_frequencies(model), NUMERICS)
    return several, free_shapes(several)
