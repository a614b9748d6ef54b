"""The inputs of a model, and the model without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from romsindy.physics.coupling import Along
from romsindy.physics.equations import Equations
from romsindy.physics.forcing import input_in
from romsindy.physics.input import Input
from romsindy.physics.term_sum import TermSum

Model = TypeVar("Model", bound=TermSum)


def inputs_of(model: TermSum) -> tuple[Input, ...]:
    """The inputs among the terms of a model."""
    return tuple(i for i in map(input_in, model.terms) if i is not None)


def without_inputs(model: Model) -> Model:
    """The free model."""
    pairs = zip(model.terms, model.values, strict=True)
    kept = {term: value for term, value in pairs if input_in(term) is None}
    return replace(model, terms=tuple(kept), values=tuple(kept.values()))


def with_inputs(model: Any, inputs: Sequence[Input], gains: Sequence[Any]) -> Any:
    """A model that inputs drive, with the gains of each: a number, or one for each coordinate."""
    several = [
        [Along.coordinate(term, i + 1) for i in range(model.n_coordinates)]
        if model.numbered
        else [term]
        for term in inputs
    ]
    terms = (*model.terms, *(term for own in several for term in own))
    return replace(model, terms=terms, values=(*model.values, *np.ravel(gains).tolist()))


def gain_of(model: Equations) -> Any:
    """Force per unit mass for an input of 1, a number or (R,) of several coordinates; or else 1.

    Raises
    ------
    ValueError
        If the model has several inputs, or one that lags or acts with a power.
    """
    inputs = list(dict.fromkeys(inputs_of(model)))
    if len(inputs) > 1:
        names = [term.signal for term in inputs]
        raise ValueError(f"the model has the inputs {names}, and one can be harmonic: drop others")
    changed = [term for term in inputs if term.lag or term.power > 1]
    if changed:
        raise ValueError(
            f"the model is driven by {changed[0].expression()}, which is not as large as"
            f" {changed[0].source!r} itself: drop the input, and give the force per unit mass"
        )
    return sum(gain for _, gain in model.pushes) if inputs else 1.0
