"""The comparison a user asks for first: a stiffness polynomial against the IC-ROM."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.linear_model import LinearRegression

from romsindy.physics.model import ReducedModel
from romsindy.record.backbone import Backbone
from romsindy.record.decay import Decay
from romsindy.regression.estimator import HarmonicSINDy
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

_NEGATIVE = 1e-9  # what rounding leaves of h = 0
_TOLD = 2.0  # standard errors from 0


@dataclass(frozen=True, eq=False)
class Judged:
    """One identified model beside the backbone that was read off the decay."""

    name: str
    model: ReducedModel
    # (n_cycles,), relative deviation of the model's backbone from the extracted one; nan for cycles
    # that do not judge it (see `Backbone.certain`), and where the model has no motion
    error: NDArray[np.float64]
    lost: int  # number of judging cycles at whose amplitude the model has no motion
    fixed: tuple[str, ...]  # names of the coefficients that were known
    standard_errors: Mapping[str, float]  # of coefficients by name; empty after a regression

    @property
    def rms_error(self) -> float:
        """Rms of the relative frequency error; nan if the model lacks part of the backbone."""
        return float(np.sqrt(np.nanmean(self.error**2))) if not self.lost else float("nan")

    @property
    def max_error(self) -> float:
        """Largest relative frequency error; nan if the model lacks part of the backbone."""
        return float(np.nanmax(np.abs(self.error))) if not self.lost else float("nan")


@dataclass(frozen=True, eq=False)
class Candidate(Judged):
    """A model that a regression has found."""

    estimator: HarmonicSINDy  # fitted


def judge(
    name: str,
    model: ReducedModel,
    backbone: Backbone,
    fixed: Iterable[str] = (),
    standard_errors: Mapping[str, float] | None = None,
) -> Judged:
    """Hold the backbone of a model against an extracted one."""
    return Judged(name, model, *_errors(model, backbone), tuple(fixed), standard_errors or {})


def regress(
    name: str,
    library: Any,
    decay: Decay | Sequence[Decay],
    backbone: Backbone,
    recipe: HarmonicSINDy = PAPER,
    fixed: Mapping[str, float] | None = None,
) -> Candidate:
    """Identify one model by regression and hold its backbone against the extracted one.

    Decays have derivatives; the ``recipe`` says how to regress, and is not changed; coefficients
    that are ``fixed`` are known. Errors are those of `HarmonicSINDy.fit`.
    """
    estimator = clone(recipe).set_params(library=library, fixed=dict(fixed or {})).fit(decay)
    model = estimator.model_
    return Candidate(name, model, *_errors(model, backbone), tuple(fixed or ()), {}, estimator)


def compare_models(
    decay: Decay | Sequence[Decay],
    backbone: Backbone,
    order: int = 5,
    damping: Sequence[str] = ("linear",),
    fixed: Mapping[str, float] | None = None,
    recipe: HarmonicSINDy = PAPER,
) -> Iterator[Candidate]:
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


def _errors(model: ReducedModel, backbone: Backbone) -> tuple[NDArray[np.float64], int]:
    """Error of a backbone, and at how many judging cycles the model has no motion."""
    error, judges = model.backbone(backbone.amplitude) / backbone.frequency - 1, backbone.certain
    return np.where(judges, error, np.nan), int(np.sum(np.isnan(error) & judges))


def negative_inertia(model: ReducedModel, low: float, high: float) -> float | None:
    """Least abs(q) between low and high (unit of q) at which h(q) < 0; None if h is not negative.

    h is the kinetic energy of what the vibration drags along, which is never negative.
    """
    q = np.linspace(low, high, 2001)
    negative = np.abs(q[model.inertia(q) - 1 < -_NEGATIVE])
    return float(negative.min()) if len(negative) else None


def negative_damping(judged: Judged) -> list[str]:
    """Names of damping coefficients below 0, such as "c_linear": forces that would supply energy.

    With errors, those that are not told from 0 are left out.
    """
    errors = judged.standard_errors
    values = judged.model.coefficients
    damping = {k: v for k, v in values.items() if k.startswith("c_")}
    return [k for k, v in damping.items() if v < -_TOLD * errors.get(k, 0.0) and v < 0]


def coefficient_table(
    candidates: Sequence[Judged], keys: Iterable[str] | None = None
) -> list[list[str]]:
    """Rows of text: coefficient, unit, value in each model; the first row is the header.

    ``keys`` says which coefficients; by default all that any of the models has.
    """
    units = {t.key: t.unit(c.model.unit) for c in candidates for t in c.model.terms}
    family = {"omega^2": 0, "gamma": 1, "Upsilon": 2, "c": 3}
    ordered = sorted(
        units if keys is None else keys,
        key=lambda k: (family.get(k.split("_")[0], 4), _by_number(k)),
    )
    rows = [["coefficient", "unit", *(c.name for c in candidates)]]
    rows += [[key, units[key], *(_cell(c, key) for c in candidates)] for key in ordered]
    rows.append(["backbone error, rms", "%", *(_percent(c.rms_error) for c in candidates)])
    rows.append(["backbone error, max", "%", *(_percent(c.max_error) for c in candidates)])
    return rows


def _by_number(key: str) -> list[str | float]:
    """Text and numbers of a key in turn: gamma_10 comes after gamma_2."""
    return [float(x) if i % 2 else x for i, x in enumerate(re.split(r"(\d+)", key))]


def _cell(candidate: Judged, key: str) -> str:
    """Value with its standard error, where there is one."""
    value = candidate.model.coefficients.get(key)
    if value is None:
        return "-"
    if key in candidate.fixed:
        return f"{value:.5g} (fixed)"
    error = candidate.standard_errors.get(key)
    return f"{value:.5g}" if error is None else f"{value:.5g} +- {error:.2g}"


def _percent(x: float) -> str:
    return "no motion" if np.isnan(x) else f"{100 * x:.3g}"
