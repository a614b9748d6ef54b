"""Families: effects that do the same to one mode, so that one size tells all of them.

Whether it is the mass, the material or a point of a structure that damps, a vibration of one mode
loses the same part of its energy. Its equation about the equilibrium, m q_ddot + c q_dot + k q = 0,
tells the frequency sqrt(k / m) / (2 pi) and the damping ratio c / (2 sqrt(k m)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.found import titles, value_with_error
from romsindy.effects.choices import DAMPING, FAMILIES, FREQUENCY
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.part import Part, moved_parts
from romsindy.fit.records.record import Record
from romsindy.physics.model import ReducedModel
from romsindy.text import listed, with_error

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


def family_of(said: Sequence[tuple[str, ...]]) -> str | None:
    """The family of which all explanations, by their names, are members; None if of none."""
    for name, members in FAMILIES.items():
        if all(len(n) == 1 and n[0] in members for n in said):
            return name
    return None
