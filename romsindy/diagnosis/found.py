"""Effects that were found, with their values as numbers and as words.

Families: effects that do the same to one mode, so that one size tells all of them.

Whether it is the mass, the material or a point of a structure that damps, a vibration of one mode
loses the same part of its energy. Its equation about the equilibrium, m q_ddot + c q_dot + k q = 0,
tells the frequency sqrt(k / m) / (2 pi) and the damping ratio c / (2 sqrt(k m)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from romsindy.diagnosis.evidence import Hypothesis, weights
from romsindy.effects import LinearFrequency, Viscous
from romsindy.effects.choices import DAMPING, FAMILIES, FREQUENCY, family_of
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.part import Coefficient, Part, moved_parts
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import NAMED_ABOVE
from romsindy.physics.equations import Equations
from romsindy.physics.model import ReducedModel
from romsindy.text import listed, with_error
from romsindy.typing import Array

_STRENGTH = "strength"
_VALUES = {"linear_frequency": "linear stiffness", "viscous": "damping proportional to speed"}


@dataclass(frozen=True)
class FoundEffect:
    """One effect with its values.

    Attributes
    ----------
    name, label, family : str
    variant : str
        What tells apart effects of the same name: "above" or "below", the side of a stop or a
        magnet where q is larger or smaller, or the name of a coefficient; empty where there is but
        one.
    values, standard_errors : dict of str to float
        Strength and shape values by name, in the unit of q and seconds, frequencies in Hz.
    weight : float
        Posterior probability among the hypotheses compared.
    advice : str
        What would separate it from its rivals.
    units : dict of str to str
        Of the values; empty where one has none.
    relative, relative_error : float or None
        Change of a value of the simulation, as a part of it; None for an effect.
    assumed, tolerance : float or None
        What the simulation has for a value, and the standard deviation to which that was known.
    """

    name: str
    label: str
    family: str
    variant: str
    values: dict[str, float]
    standard_errors: dict[str, float]
    weight: float
    advice: str
    units: dict[str, str]
    relative: float | None = None
    relative_error: float | None = None
    assumed: float | None = None
    tolerance: float | None = None

    def __str__(self) -> str:
        if self.relative is not None and self.relative_error is not None:
            change = value_with_error(100 * abs(self.relative), 100 * self.relative_error)
            way = "higher" if self.relative > 0 else "lower"
            own = self.name if self.family == "value" else f"the coefficient {self.variant}"
            what = _VALUES.get(self.name, own)
            return f"{what} {change} % {way} than assumed ({self._value(_STRENGTH)})"
        texts = [self._value(k) if k == _STRENGTH else f"{k} {self._value(k)}" for k in self.values]
        return ", ".join([self.title, *texts])

    @property
    def sure(self) -> bool:
        """Whether one of its values is surely not zero."""
        return any(abs(v) > NAMED_ABOVE * self.standard_errors[k] for k, v in self.values.items())

    @property
    def within(self) -> str:
        """A value that moved within its tolerance, in words."""
        unit, error = self.units[_STRENGTH], self.standard_errors[_STRENGTH]
        if self.assumed is None:
            return f"{self} (tolerance {self.tolerance:.3g} {unit}".rstrip() + ")"
        name = _VALUES.get(self.name, self.variant or self.name.replace("_", " "))
        value = f"{value_with_error(self.assumed + self.values[_STRENGTH], error)} {unit}".rstrip()
        return f"{name} is {value} (assumed {self.assumed:.6g} +- {self.tolerance:.3g})"

    @property
    def title(self) -> str:
        """The label, with the variant if there is one."""
        return f"{self.label} [{self.variant}]" if self.variant else self.label

    def _value(self, name: str) -> str:
        text = value_with_error(self.values[name], self.standard_errors[name])
        return f"{text} {self.units[name]}".rstrip()


def effects_of(
    hypothesis: Hypothesis,
    rivals: Sequence[Hypothesis],
    ratio: float,
    model: Equations,
    which: Sequence[int] | None = None,
) -> tuple[FoundEffect, ...]:
    """Some parts of a hypothesis; by default what it says is missing, `Hypothesis.blamed`.

    ``ratio`` is what is left over the noise, ``model`` the simulation.
    """
    which = hypothesis.blamed if which is None else which
    return tuple(_effect(hypothesis, i, rivals, ratio, model) for i in which)


def of_the_measurement(
    hypothesis: Hypothesis, ratio: float, model: Equations
) -> tuple[FoundEffect, ...]:
    """What the measurement surely adds, of what it may add without being wrong."""
    told = effects_of(hypothesis, [hypothesis], ratio, model, hypothesis.of_measurement)
    return tuple(e for e in told if e.sure)


def titles(hypothesis: Hypothesis) -> str:
    """Labels of what a hypothesis says is missing."""
    effects = [hypothesis.parts[i].effect for i in hypothesis.blamed]
    named = dict.fromkeys(f"{e.label} [{e.variant}]" if e.variant else e.label for e in effects)
    if named:
        return " and ".join(named)
    known = any(p.tolerance and p.effect.structural for p in hypothesis.parts[: hypothesis.n_free])
    return "values within their tolerances" if known else "nothing"


def _effect(
    hypothesis: Hypothesis, index: int, rivals: Sequence[Hypothesis], ratio: float, model: Equations
) -> FoundEffect:
    part, where = hypothesis.parts[index], hypothesis.solution.slices()[index]
    std = hypothesis.growth(ratio) * np.sqrt(np.diag(hypothesis.covariance[where, where]))
    # Where a mass was at the start of a record says nothing about the mass.
    k, shared = part.strengths.size, part.effect.n_shared
    shown = [*range(shared or k), *range(k, part.size)]
    names = [_STRENGTH] * shared + _value_names(part)[shared and k :]
    shares = zip(rivals, weights(rivals), strict=True)
    weight = sum(share for h, share in shares if part.effect.name in h.names)
    units, scale = _units(part, model.unit)
    values, std = part.values / scale, std / scale
    return FoundEffect(
        part.effect.name,
        part.effect.label,
        part.effect.family,
        part.effect.variant,
        dict(zip(names, values[shown].tolist(), strict=True)),
        dict(zip(names, std[shown].tolist(), strict=True)),
        float(weight),
        part.effect.advice,
        dict(zip(names, [units[i] for i in shown], strict=True)),
        *_relative(part, std, model),
    )


def _relative(part: Part, std: Array, model: Equations) -> tuple[float | None, ...]:
    """Change of a value of the model as a part of it, its error, what it was, its tolerance."""
    is_value = isinstance(part.effect, (Coefficient, LinearFrequency, Viscous))
    law = part.effect.term()
    now = model.coefficients.get(law.key, 0.0) if is_value and law is not None else 0.0
    own = getattr(part.effect, "assumed", now or None), part.tolerance
    if part.effect.family == "value":
        now = own[0] or 0.0
    size = abs(now)  # of a negative one, too, more is higher
    changes = (float(part.strengths[0, 0]) / size, float(std[0]) / size) if now else (None, None)
    return *changes, *own


def value_with_error(value: float, error: float) -> str:
    """A value to the digits that its error leaves, and the error."""
    if not error > 0:
        return f"{value:.4g}"
    digits = max(int(np.floor(np.log10(max(abs(value), 1e-300) / error))) + 2, 2)
    told, spread = float(f"{value:.{min(digits, 8)}g}"), float(f"{error:.2g}")
    return f"{told:.10g} +- {spread:g}"


def _units(part: Part, of_q: str | None) -> tuple[list[str], Array]:
    """Units in which values are told, and their sizes in those of q and seconds."""
    own, k = part.effect.strength_unit(of_q), part.strengths.size
    known = {"q": (of_q or "", 1.0), "rad/s": ("Hz", 2 * np.pi)}
    pairs = [("" if own == "1" else own, 1.0)] * k
    pairs += [known.get(p.unit, (p.unit, 1.0)) for p in part.parameters]
    return [unit for unit, _ in pairs], np.array([size for _, size in pairs])


def _value_names(part: Part) -> list[str]:
    k = part.effect.n_strengths
    pairs = [f"{('cosine', 'sine')[i % 2]} {i // 2 + 1}" for i in range(k)]
    kinds = [_STRENGTH] if k == 1 else ["cosine", "sine"] if k == 2 else pairs
    sets = len(part.strengths)
    names = [f"{n}, record {i + 1}" if sets > 1 else n for i in range(sets) for n in kinds]
    return names + [p.name for p in part.parameters]


_SMALL = 1e-3  # of the amplitude of a record: what is cubic is a part in a million
_SAMPLES = 256  # of a turn


@dataclass(frozen=True)
class EffectFamily:
    """What the data do not tell apart, and what all of it does to the mode."""

    name: str  # "linear damping" or "linear frequency"
    assumed: float  # damping ratio, or frequency in Hz, of small vibrations, of the simulation
    found: float  # the same with what is likeliest
    error: float  # standard error of that: the least of all members
    # In the order in which an engineer tries them
    rivals: tuple[Hypothesis, ...] = field(repr=False)

    @classmethod
    def of(
        cls, rivals: Sequence[Hypothesis], model: ReducedModel, record: Record, growth: float
    ) -> EffectFamily | None:
        """The family of rivals, the likeliest first; None where they are not of one.

        ``growth`` is how much larger errors are than the noise alone makes them.
        """
        name = family_of([h.names for h in rivals])
        if len(rivals) < 2 or name is None or not model.coefficients.get("omega^2", 0.0) > 0:
            return None

        def of_parts(parts: Sequence[Part]) -> float:
            return small_vibration(model, parts, record)[name == DAMPING]

        def error(h: Hypothesis) -> float:
            index = h.solution.slices()[h.blamed[0]].start
            change = np.zeros(len(h.covariance))
            change[index] = growth * float(h.covariance[index, index]) ** 0.5
            return abs(of_parts(moved_parts(h.parts, change)) - of_parts(h.parts))

        # The strength of what acts at a point has the error of its place, which the mode has not.
        least = min(map(error, rivals))
        tried = sorted(rivals, key=lambda h: FAMILIES[name].index(h.names[0]))
        return cls(name, of_parts(()), of_parts(rivals[0].parts), least, tuple(tried))

    @property
    def size(self) -> float:
        """Change as a part of what was assumed; infinite of none."""
        return self.found / self.assumed - 1 if self.assumed else np.inf

    @cached_property
    def members(self) -> tuple[str, ...]:
        """Names, in the order of the rivals."""
        return tuple(dict.fromkeys(h.names[0] for h in self.rivals))

    def in_words(self, odds: str = "") -> str:
        """One answer with one size, ``odds`` beside it, what it may be, and what would tell."""
        change = self.found - self.assumed
        now, then = (with_error(x, abs(change))[0] for x in (self.found, self.assumed))
        both = f"damping ratio {now} instead of {then}"
        if self.name == FREQUENCY:
            both = f"{now} instead of {then} Hz"
        way = "higher" if change > 0 else "lower"
        size = self.name
        if self.assumed:
            share = value_with_error(*(100 * abs(x) / self.assumed for x in (change, self.error)))
            size = f"{self.name} {share} % {way} than assumed"
        of = listed(list(dict.fromkeys(map(titles, self.rivals))), "or")
        both = "; ".join(filter(None, (both, odds)))
        # A density and a stiffness may go with all modes alike, not so kinds of damping.
        tells = "; a mode that rings beside the first would tell them apart"
        return f"{size} ({both}): {of}{tells if self.name == DAMPING else ''}"


def small_vibration(
    model: ReducedModel, parts: Sequence[Part], record: Record
) -> tuple[float, float]:
    """Frequency, Hz, and damping ratio of a model with some parts, small about the equilibrium.

    Damping that takes a fixed part of the energy counts for what it takes of a cycle.
    """
    known = model.coefficients
    stiffness, damping = known.get("omega^2", 0.0), known.get("c_linear", 0.0)
    mass = 1.0 + known.get("mu", 0.0)
    equation, rate = equation_of(model, (), 0, record), float(np.sqrt(stiffness / mass))
    turn = 2 * np.pi * np.arange(_SAMPLES)[:, None] / _SAMPLES
    cos, sin = _SMALL * record.amplitude * np.cos(turn), _SMALL * record.amplitude * np.sin(turn)
    own, power = (turn / rate, cos, -rate * sin), float(np.sum(cos**2))
    for part in parts:
        pulls = [equation.forces(part.effect, *own, x) for x in (0 * cos, -(rate**2) * cos)]
        still, moving = (0 * cos if f is None else np.tensordot(part.own(0), f, 1) for f in pulls)
        stiffness += float(np.sum(still * cos)) / power
        damping -= float(np.sum(still * sin)) / (power * rate)
        mass -= float(np.sum((moving - still) * cos)) / (power * rate**2)
    omega = float(np.sqrt(stiffness / mass))
    return omega / (2 * np.pi), damping / (2 * mass * omega)
