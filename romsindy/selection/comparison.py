"""The comparison a user asks for first: a stiffness polynomial against the IC-ROM."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from romsindy.fit.collocation import TrajectoryError
from romsindy.fit.refine import Fit, refine
from romsindy.fit.verdict import CERTAIN
from romsindy.physics.model import ReducedModel
from romsindy.record.backbone import Backbone
from romsindy.record.decay import Decay
from romsindy.regression.estimator import HarmonicSINDy
from romsindy.regression.library import ROMLibrary
from romsindy.regression.projection import HarmonicProjection


@dataclass(frozen=True, eq=False)
class Candidate:
    """One identified model beside the backbone that was read off the decay.

    Attributes
    ----------
    name : str
    estimator : HarmonicSINDy
        Fitted by regression.
    fit : Fit or None
        The same model refined by simulation; None where that was not asked for, or did not help.
    failure : str
        Why it did not help, empty if it did.
    error : (n_cycles,) array
        Relative deviation of the model's backbone from the extracted one; nan for cycles that do
        not judge it (see `judging`), and where the model has no motion.
    lost : int
        Number of judging cycles at whose amplitude the model has no motion.
    """

    name: str
    estimator: HarmonicSINDy
    fit: Fit | None
    failure: str
    error: NDArray[np.float64]
    lost: int

    @property
    def model(self) -> ReducedModel:
        """The identified equation: refined where that went well, else from the regression."""
        return self.fit.model if self.fit else self.estimator.model_

    @property
    def rms_error(self) -> float:
        """Rms of the relative frequency error; nan if the model lacks part of the backbone."""
        return float(np.sqrt(np.nanmean(self.error**2))) if not self.lost else float("nan")

    @property
    def max_error(self) -> float:
        """Largest relative frequency error; nan if the model lacks part of the backbone."""
        return float(np.nanmax(np.abs(self.error))) if not self.lost else float("nan")


def compare_models(
    decay: Decay,
    backbone: Backbone,
    order: int = 5,
    damping: Sequence[str] = ("linear",),
    fixed: Mapping[str, float] | None = None,
    projection: HarmonicProjection | None = None,
    measured: Decay | None = None,
) -> Iterator[Candidate]:
    """Identify a stiffness polynomial and an IC-ROM, linear frequency estimated and fixed.

    Parameters
    ----------
    decay : Decay
        With derivatives, so that all models see the same signals.
    backbone : Backbone
        Read off the same decay.
    order : int
        Highest order of stiffness and inertia, at least 3.
    damping : sequence of str
        Kinds of damping in all models.
    fixed : mapping, optional
        Known coefficients. The fixed linear frequency is its "omega^2", or else the one that
        the backbone tends to at small amplitude.
    projection : HarmonicProjection, optional
        Harmonics and amplitudes to learn from.
    measured : Decay, optional
        The free decay as it was measured, before any filter: every model is refined on it by
        simulation (see `romsindy.fit.refine`).

    Yields
    ------
    Candidate
        "stiffness", "stiffness, omega fixed", "IC-ROM", "IC-ROM, omega fixed".

    Raises
    ------
    ValueError
        If the order is below 3; and as `HarmonicSINDy.fit`.
    """
    if order < 3:
        raise ValueError(f"order = {order!r} must be at least 3, the lowest with inertia terms")
    fixed = dict(fixed or {})
    omega2 = fixed.pop("omega^2", backbone.linear_frequency() ** 2)
    for name, inertia in (("stiffness", ()), ("IC-ROM", tuple(range(3, order + 1)))):
        library = ROMLibrary(inertia, tuple(range(1, order + 1)), tuple(damping))
        known = {k: v for k, v in fixed.items() if inertia or not k.startswith("Upsilon")}
        for suffix, values in (("", known), (", omega fixed", known | {"omega^2": omega2})):
            estimator = HarmonicSINDy(library, projection=projection, fixed=values).fit(decay)
            plain = judge(name + suffix, estimator, backbone)
            yield plain if measured is None else _refined(plain, measured, backbone)


def judge(name: str, estimator: HarmonicSINDy, backbone: Backbone) -> Candidate:
    """Hold the backbone of a fitted model against an extracted one."""
    return Candidate(name, estimator, None, "", *_errors(estimator.model_, backbone))


def _refined(plain: Candidate, measured: Decay, backbone: Backbone) -> Candidate:
    try:
        fit = refine(plain.model, measured, fixed=tuple(plain.estimator.fixed or {}))
    except TrajectoryError as trouble:  # a model can fit accelerations and yet have no motion
        return replace(plain, failure=str(trouble))
    error, lost = _errors(fit.model, backbone)
    refined = replace(plain, fit=fit, error=error, lost=lost)
    worse = refined.lost > plain.lost or refined.rms_error > plain.rms_error
    if worse and not fit.verdict.explained:
        failure = (
            f"its structure is wrong (residual {fit.adequacy:.2g} times the noise), and following"
            " the motion over the whole decay leads away from the measured backbone"
        )
        return replace(plain, failure=failure)
    return refined


def judging(backbone: Backbone) -> NDArray[np.bool_]:
    """Cycles that judge a model: those whose own frequency is known well enough."""
    return np.asarray(backbone.frequency_std < CERTAIN * backbone.frequency)


def _errors(model: ReducedModel, backbone: Backbone) -> tuple[NDArray[np.float64], int]:
    """Error of a backbone, and at how many judging cycles the model has no motion."""
    judges = judging(backbone)
    error = model.backbone(backbone.amplitude) / backbone.frequency - 1
    return np.where(judges, error, np.nan), int(np.sum(np.isnan(error) & judges))


def coefficient_table(candidates: Sequence[Candidate]) -> list[list[str]]:
    """Rows of text: coefficient, unit, value in each model; the first row is the header."""
    keys: dict[str, str] = {}
    for candidate in candidates:
        for term in candidate.model.terms:
            keys.setdefault(term.key, term.unit(candidate.model.unit))
    family = {"omega^2": 0, "gamma": 1, "Upsilon": 2, "c": 3}
    ordered = sorted(keys, key=lambda k: (family.get(k.split("_")[0], 4), _by_number(k)))
    rows = [["coefficient", "unit", *(c.name for c in candidates)]]
    rows += [[key, keys[key], *(_cell(c, key) for c in candidates)] for key in ordered]
    if any(c.fit for c in candidates):
        ratios = [f"{c.fit.adequacy:.3g}" if c.fit else "-" for c in candidates]
        rows.append(["residual over noise", "1", *ratios])
    rows.append(["backbone error, rms", "%", *(_percent(c.rms_error) for c in candidates)])
    rows.append(["backbone error, max", "%", *(_percent(c.max_error) for c in candidates)])
    return rows


def _by_number(key: str) -> list[str | float]:
    """Text and numbers of a key in turn: gamma_10 comes after gamma_2."""
    return [float(x) if i % 2 else x for i, x in enumerate(re.split(r"(\d+)", key))]


def _cell(candidate: Candidate, key: str) -> str:
    """Value with its standard error, where there is one."""
    value = candidate.model.coefficients.get(key)
    if value is None:
        return "-"
    if key in (candidate.estimator.fixed or {}):
        return f"{value:.5g} (fixed)"
    if candidate.fit is None:
        return f"{value:.5g}"
    return f"{value:.5g} +- {candidate.fit.standard_errors[key]:.2g}"


def _percent(x: float) -> str:
    return "no motion" if np.isnan(x) else f"{100 * x:.3g}"
