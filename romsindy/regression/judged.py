"""Models of one coordinate held against the cycles of the decays that they are about."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romsindy.physics.model import ReducedModel
from romsindy.record.backbone import CERTAIN, Backbone, joined
from romsindy.record.decay import Decay
from romsindy.text import TextTable, listed

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
    estimator: Any = None  # fitted `HarmonicSINDy`, of a model that a regression has found

    @property
    def rms_error(self) -> float:
        """Rms of the relative frequency error; nan if the model lacks part of the backbone."""
        return float(np.sqrt(np.nanmean(self.error**2))) if not self.lost else float("nan")

    @property
    def max_error(self) -> float:
        """Largest relative frequency error; nan if the model lacks part of the backbone."""
        return float(np.nanmax(np.abs(self.error))) if not self.lost else float("nan")


def judge(
    name: str,
    model: ReducedModel,
    backbone: Backbone,
    fixed: Iterable[str] = (),
    standard_errors: Mapping[str, float] | None = None,
) -> Judged:
    """Hold the backbone of a model against an extracted one."""
    return Judged(name, model, *errors_beside(model, backbone), tuple(fixed), standard_errors or {})


def errors_beside(model: ReducedModel, backbone: Backbone) -> tuple[NDArray[np.float64], int]:
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


@dataclass(frozen=True, eq=False)
class Beside:
    """Models beside what was read off decays."""

    decays: Sequence[Decay]  # what was analysed, with derivatives
    backbones: Sequence[Backbone]  # one for each
    # Columns of the table; the identified equation first, where there is one
    candidates: Sequence[Judged]
    main: Judged  # whose equation is printed
    # Names of the forces that were found, which regressions need not have
    forces: tuple[str, ...] = ()

    @cached_property
    def backbone(self) -> Backbone:
        """The cycles of all decays."""
        return joined(self.backbones)

    @property
    def regressions(self) -> list[Judged]:
        """Models that a regression has found."""
        return [c for c in self.candidates if c.estimator is not None]

    @property
    def shown(self) -> list[Judged]:
        """Models with estimated linear frequency, or all where it was given."""
        return [c for c in self.candidates if "fixed" not in c.name]

    def errors(self) -> str:
        """One sentence on how the models follow the backbone."""
        return self._over("; ".join(f"the {c.name} model {_off(c)}" for c in self.shown))

    def missed(self) -> str:
        """The same of the model alone whose equation is printed."""
        return self._over(f"it {_off(self.main)}")

    def _over(self, words: str) -> str:
        judges = int(np.sum(self.backbone.certain))
        if judges:
            return f"Over {judges} cycles {words}."
        return f"The frequency of no cycle is known to {100 * CERTAIN:g} %: none judges a model."

    def table(self) -> TextTable:
        """Coefficients and backbone errors: of series those that regressions have too."""
        keys = dict.fromkeys(k for c in self.regressions for k in c.model.coefficients)
        names = [*keys, *(f for f in self.forces if f not in keys)]
        rows = coefficient_table(self.candidates, names)
        return TextTable("Coefficients and backbone errors", rows, self._note())

    def _note(self) -> str:
        """How the errors in the table were taken, and which model cannot be."""
        unsure = int(np.sum(~self.backbone.certain))
        left_out = (
            f"; cycles whose own frequency is not known to {100 * CERTAIN:g} % are left out"
            f" ({unsure})"
        )
        text = (
            "Backbone error: frequency of the model's undamped motion against that of each cycle,"
            f" at its amplitude{left_out if unsure else ''}. Regressions have no error bars."
        )
        if self.main not in self.regressions:
            text += (
                " Those of the identified model include what the choice of structure leaves open;"
                " of its series, the table has the coefficients that the regressions have too."
            )
        return " ".join([text, *self.impossible()])

    def impossible(self) -> Iterator[str]:
        """What no structure does, and a model in the table has: a sentence for each."""
        low, high = min(d.q.min() for d in self.decays), max(d.q.max() for d in self.decays)
        for c in self.candidates:
            first = negative_inertia(c.model, low, high)
            if first is not None:
                yield (
                    f"{c.name}: its inertia h(q) is negative within the data, first at |q| ="
                    f" {first:.3g} {c.model.unit or '[q]'}: no motion of a structure does that."
                )
            negative = negative_damping(c)
            if negative:
                yield (
                    f"{c.name}: its {listed(negative)} is negative: a force that would supply"
                    " energy, which no damping does."
                )


def _off(candidate: Judged) -> str:
    if candidate.lost:
        return f"has no motion at {candidate.lost} of the measured amplitudes"
    return (
        f"misses the measured frequency by {100 * candidate.rms_error:.2g} % rms,"
        f" {100 * candidate.max_error:.2g} % at most"
    )
