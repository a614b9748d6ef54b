"""What a diagnosis found, in words, tables and files."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from romsindy.diagnosis.evidence import Hypothesis, weights
from romsindy.diagnosis.form import NO_FORM_ERROR
from romsindy.diagnosis.gap import Gap
from romsindy.diagnosis.next_test import EXPERIMENTS, Advice, Experiment, next_test
from romsindy.effects.base import Scales
from romsindy.fit.adequacy import Adequacy
from romsindy.fit.part import Part
from romsindy.fit.record import Record
from romsindy.fit.verdict import EXPLAINED, PREDICTED
from romsindy.physics.model import ReducedModel
from romsindy.physics.serial import json_text
from romsindy.text import TextTable

if TYPE_CHECKING:
    from romsindy.show.page import Picture

Verdict = Literal["none", "named", "ambiguous", "unknown"]


def verdict_of(best: Hypothesis, rivals: Sequence[Hypothesis], left: Adequacy, gap: Gap) -> Verdict:
    """Weigh the best hypothesis, its rivals, and what it leaves.

    Stiffness and damping that move together may have one cause that is in no catalogue: a
    viscoelastic support, a small mass that vibrates along.
    """
    if not left.explained or gap.after > PREDICTED:
        return "unknown"
    if not best.names:
        return "none"
    if len(rivals) > 1 or len(best.moved) > 1:
        return "ambiguous"
    return "named"


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
        Strength and shape values by name, in the unit of q and seconds.
    weight : float
        Posterior probability among the hypotheses compared.
    advice : str
        What would separate it from its rivals.
    units : dict of str to str
        Of the values; empty where one has none.
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

    def __str__(self) -> str:
        text = ", ".join(f"{k} {self._value(k)}" for k in self.values)
        weight = f"; posterior {self.weight:.2f}" if self.weight > 0 else ""
        return f"{self.title} ({text}{weight})"

    @property
    def title(self) -> str:
        """The label, with the variant if there is one."""
        return f"{self.label} [{self.variant}]" if self.variant else self.label

    def _value(self, name: str) -> str:
        text = _pm(self.values[name], self.standard_errors[name])
        return f"{text} {self.units[name]}".rstrip()


def _pm(value: float, error: float) -> str:
    if not error > 0:
        return f"{value:.4g}"
    digits = max(int(np.floor(np.log10(max(abs(value), 1e-300) / error))) + 2, 2)
    return f"{value:.{min(digits, 8)}g} +- {error:.2g}"


@dataclass(frozen=True)
class DiagnosisReport:
    """What a simulation lacks.

    Attributes
    ----------
    verdict : "none", "named", "ambiguous" or "unknown"
        No gap; one explanation that closes it; several that do; none that does.
    nominal, model : ReducedModel
        Before, and with the effects added that are terms of the equation.
    best : Hypothesis
    rivals : tuple of Hypothesis
        What the data do not tell apart from the best, itself first.
    compared : tuple of Hypothesis
        All that were fitted, the best first.
    base : Hypothesis
        Only what the simulation is unsure of, fitted.
    remainder : Adequacy
        What the best leaves of the records it was fitted to.
    gap : Gap
        Before and after, on what took no part.
    records : tuple of Record
    scales : Scales
    interrupted : bool
        Whether the search was stopped before its end: what it had compared is all there is.
    """

    verdict: Verdict
    nominal: ReducedModel
    model: ReducedModel
    best: Hypothesis
    rivals: tuple[Hypothesis, ...]
    compared: tuple[Hypothesis, ...]
    base: Hypothesis
    remainder: Adequacy
    gap: Gap
    records: tuple[Record, ...]
    scales: Scales
    interrupted: bool = False

    @cached_property
    def effects(self) -> tuple[FoundEffect, ...]:
        """Effects of the best hypothesis; values that moved where nothing else is needed."""
        return self._found(self.best)

    @property
    def moved(self) -> tuple[FoundEffect, ...]:
        """Values that the simulation was unsure of and that moved, beside the effects."""
        if not self.best.effects:
            return ()
        return tuple(self._effect(self.best, i) for i in _moved(self.best))

    @property
    def equivalent(self) -> tuple[tuple[str, ...], ...]:
        """Names of the explanations that the data do not tell apart, best first."""
        return tuple(h.names for h in self.rivals if h.names)

    @cached_property
    def next_test(self) -> Advice | None:
        """The test that would best tell apart what these data do not; None where none is needed."""
        return self.advised()

    def advised(self, tests: Sequence[Experiment] = EXPERIMENTS) -> Advice | None:
        """The same, of the tests that can be made.

        Where nothing explains the data, what came nearest is to be told apart.
        """
        given = (self.nominal, self.records, tests)
        if self.verdict == "ambiguous":
            return next_test(self.rivals, *given)
        if self.verdict == "unknown":
            nearest = {self.best.names: self.best}
            for h in self.compared:
                if h.names and len(h.effects) <= max(len(self.best.effects), 1):
                    nearest.setdefault(h.names, h)
            return next_test(list(nearest.values()), *given, explained=False)
        return None

    def _found(self, hypothesis: Hypothesis) -> tuple[FoundEffect, ...]:
        effects = range(hypothesis.n_free, len(hypothesis.solution.parts))
        return tuple(self._effect(hypothesis, i) for i in effects or _moved(hypothesis))

    def _effect(self, hypothesis: Hypothesis, index: int) -> FoundEffect:
        solution = hypothesis.solution
        part, where = hypothesis.parts[index], solution.slices()[index]
        # Where the residual is above the noise, the errors grow with it.
        grow = max(self.remainder.ratio, 1.0) if hypothesis.form == NO_FORM_ERROR else 1.0
        std = grow * np.sqrt(np.diag(hypothesis.covariance[where, where]))
        names = _value_names(part)
        shares = zip(self.rivals, weights(self.rivals), strict=True)
        weight = sum(share for h, share in shares if part.effect.name in h.names)
        return FoundEffect(
            part.effect.name,
            part.effect.label,
            part.effect.family,
            part.effect.variant,
            dict(zip(names, part.values.tolist(), strict=True)),
            dict(zip(names, std.tolist(), strict=True)),
            float(weight),
            part.effect.advice,
            dict(zip(names, _units(part, self.nominal.unit), strict=True)),
        )

    # -- words ---------------------------------------------------------------------------------

    @property
    def sentence(self) -> str:
        """The finding in one or two sentences."""
        if self.interrupted:
            return f"Interrupted when {len(self.compared)} were compared. {self._finding}"
        return self._finding

    @property
    def _finding(self) -> str:
        before, after = self.gap.before, self.gap.after
        where = "what was held out" if self.gap.unseen else "the records themselves"
        change = "falls" if after < before else "goes"
        gap = f"the error on {where} {change} from {before:.3g} to {after:.3g} times the noise"
        if self.verdict == "none":
            return (
                "The simulation lacks nothing that these data can show: what it leaves is"
                f" {self.remainder.ratio:.3g} times the noise, {after:.3g} times on {where}."
            )
        found = " and ".join(map(str, self.effects))
        also = "".join(f" Fitted beside it: {e}." for e in self.moved)
        if self.verdict == "unknown":
            near = f" The nearest is {found}, but it does not close the gap: {gap}." * bool(found)
            return f"Nothing in the catalogue explains the gap: {self._character}.{near}{also}"
        if len(self.rivals) == 1 and len(self.best.moved) > 1:
            return (
                f"The simulation lacks {found}: with it, {gap}. Linear stiffness and damping moved"
                " together: one cause may stand behind both, such as a viscoelastic support or a"
                " small mass that vibrates along; decays at another frequency would tell."
            )
        if self.verdict == "named":
            return f"The simulation lacks {found}: with it, {gap}.{also}"
        each = (" and ".join(e.title for e in self._found(h)) for h in self.rivals[1:])
        others = ", or ".join(each)
        advice = self._found(self.rivals[0])[0].advice
        return (
            f"The simulation lacks {found}, or {others}; these data do not tell them apart."
            f" With the first, {gap}. To separate them: {advice}.{also}"
        )

    @property
    def _character(self) -> str:
        left = self.remainder
        parts = []
        if left.ratio > EXPLAINED:
            parts.append(f"the residual is {left.ratio:.3g} times the noise")
        if left.structured:
            parts.append(f"it repeats with the vibration ({left.structure:.3g} times by chance)")
        if self.gap.after > PREDICTED:
            parts.append(f"the error to be predicted stays at {self.gap.after:.3g} times the noise")
        return ", ".join(parts) or "the residual is not noise"

    def __repr__(self) -> str:
        return f"<DiagnosisReport: {self.verdict}: {self.sentence}>"

    # -- tables and files ------------------------------------------------------------------------

    def table(self) -> list[list[str]]:
        """Rows of text: every explanation that the data allow, with its values."""
        head = "explanation,variant,value,estimate,standard error,unit,posterior"
        rows = [head.split(",")]
        for h, share in zip(self.rivals, weights(self.rivals), strict=True):
            for effect in self._found(h):
                for key, value in effect.values.items():
                    error = effect.standard_errors[key]
                    numbers = [f"{value:.6g}", f"{error:.2g}", effect.units[key], f"{share:.3f}"]
                    rows.append([effect.name, effect.variant, key, *numbers])
        return rows

    def to_json(self) -> str:
        """Verdict, effects, explanations and gap as JSON text."""
        content = {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "effects": [vars(e) for e in self.effects],
            "moved": [vars(e) for e in self.moved],
            "equivalent": [list(names) for names in self.equivalent],
            "adequacy": self.remainder.ratio,
            "structure": self.remainder.structure,
            "gap": {"before": self.gap.before, "after": self.gap.after},
            "model": json.loads(self.model.to_json()),
        }
        return json_text(content)

    def to_csv(self, path: str | Path) -> None:
        """Write the table of explanations."""
        with open(path, "w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(self.table())

    def to_html(self, path: str | Path) -> None:
        """Write one self-contained page with figures."""
        from romsindy.show.page import write_page  # draws: only where a page is asked for

        write_page(path, "report", pictures=self.pictures().values(), **self.page())

    def pictures(self) -> dict[str, Picture]:
        """Pictures by name; ``draw(figure)`` draws one, its caption is what its numbers say.

        "gap", "amplitude", "phase", "harmonic", "time" and "record".
        """
        from romsindy.diagnosis.pictures import pictures

        parts = self.best.parts
        return {p.name: p for p in pictures(self.nominal, parts, self.records, self.gap)}

    def page(self) -> dict[str, Any]:
        """What the page shows beside the pictures."""
        parts = self.best.parts
        terms = {p.effect.name for p in parts if p.effect.term() is not None}
        outside = ", ".join(e.label for e in self.effects if e.name not in terms)
        note = "Not a term of the equation of motion, so not in it: "
        return {
            "title": "What the simulation lacks",
            "verdict": self.verdict,
            "sentence": self.sentence,
            "equation_title": "The simulation with it added",
            "equation": str(self.model),
            "equation_note": f"{note}{outside}." if outside else "",
            "tables": [
                TextTable("The gap, before and after", self.gap.table()),
                TextTable("Explanations that the data allow", self.table()),
            ],
            "notes": [repr(r.decay).splitlines()[0].strip("<>") for r in self.records],
        }


def _moved(hypothesis: Hypothesis) -> list[int]:
    """Which of its unsure parts moved."""
    parts = hypothesis.solution.parts[: hypothesis.n_free]
    return [i for i, p in enumerate(parts) if p.effect.name in hypothesis.moved]


def _units(part: Part, of_q: str | None) -> list[str]:
    own = part.effect.strength_unit(of_q)
    shapes = [(of_q or "") if p.unit == "q" else p.unit for p in part.parameters]
    return ["" if own == "1" else own] * part.strengths.size + shapes


def _value_names(part: Part) -> list[str]:
    k = part.effect.n_strengths
    kinds = ["strength"] if k == 1 else ["cosine", "sine"] if k == 2 else list(map(str, range(k)))
    sets = len(part.strengths)
    names = [f"{n} {i + 1}" if sets > 1 else n for i in range(sets) for n in kinds]
    return names + [p.name for p in part.parameters]
