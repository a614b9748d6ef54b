"""The comparison a user asks for first: a stiffness polynomial against the IC-ROM."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from sklearn.base import clone
from sklearn.linear_model import LinearRegression

from romsindy.record.backbone import Backbone
from romsindy.record.decay import Decay
from romsindy.regression.estimator import HarmonicSINDy
from romsindy.regression.judged import Judged, errors_beside
from romsindy.regression.library import ROMLibrary
from romsindy.regression.projection import HarmonicProjection

# Regression as in the paper: terms projected as they stand on harmonics 0 to 5, least squares.
PAPER = HarmonicSINDy(
    optimizer=LinearRegression(),
    projection=HarmonicProjection(tuple(range(6)), form="strong"),
    weighted=False,
)
# This package's own: weak form, harmonics 0 to 3, rows weighted by the noise expected in them.
WEIGHTED = HarmonicSINDy(projection=HarmonicProjection())


def regress(
    name: str,
    library: Any,
    decay: Decay | Sequence[Decay],
    backbone: Backbone,
    recipe: HarmonicSINDy = PAPER,
    fixed: Mapping[str, float] | None = None,
) -> Judged:
    """Identify one model by regression and hold its backbone against the extracted one.

    Decays have derivatives; the ``recipe`` says how to regress, and is not changed; coefficients
    that are ``fixed`` are known. Errors are those of `HarmonicSINDy.fit`.
    """
    estimator = clone(recipe).set_params(library=library, fixed=dict(fixed or {})).fit(decay)
    model = estimator.model_
    return Judged(name, model, *errors_beside(model, backbone), tuple(fixed or ()), {}, estimator)


def compare_models(
    decay: Decay | Sequence[Decay],
    backbone: Backbone,
    order: int = 5,
    damping: Sequence[str] = ("linear",),
    fixed: Mapping[str, float] | None = None,
    recipe: HarmonicSINDy = PAPER,
) -> Iterator[Judged]:
    """Identify a stiffness polynomial and an IC-ROM, linear frequency estimated and fixed.

    The decays have derivatives, so that all models see the same signals, and the backbone was read
    off them. Stiffness and inertia go to the ``order``, at least 3; all models have these kinds of
    ``damping``. A fixed linear frequency is the "omega^2" of ``fixed``, or else the one that the
    backbone tends to at small amplitude. The ``recipe`` is `PAPER` or `WEIGHTED`, with other
    harmonics or amplitudes where asked for.

    Raises a ValueError if the order is below 3; and as `HarmonicSINDy.fit`.
    """
    if order < 3:
        raise ValueError(f"order = {order!r} must be at least 3, the lowest with inertia terms")
    fixed = dict(fixed or {})
    omega2 = fixed.pop("omega^2", backbone.linear_frequency() ** 2)
    for name, inertia in (("stiffness", ()), ("IC-ROM", tuple(range(3, order + 1)))):
        library = ROMLibrary(inertia, tuple(range(1, order + 1)), tuple(damping))
        known = {k: v for k, v in fixed.items() if inertia or not k.startswith("Upsilon")}
        for suffix, values in (("", known), (", omega fixed", known | {"omega^2": omega2})):
            yield regress(name + suffix, library, decay, backbone, recipe, values)
