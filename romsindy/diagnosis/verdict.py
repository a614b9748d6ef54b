"""The verdict of a diagnosis, by one rule.

What needs no effect is asked first: what the measurement itself may add, and other values of the
model. Where that leaves nothing beyond the tolerance it is the answer, "none" or "named" by
whether the change of the values matters; else an effect is, if it is sure and leaves nothing that
matters. An effect may be told although it is small only where no tolerance was stated, where the
model is the simulation and no reduction of it, and where it is beyond doubt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from romsindy.diagnosis.difference import DEFAULT, Difference, Tolerance
from romsindy.diagnosis.evidence import NO_FORM_ERROR, FormError, Hypothesis
from romsindy.diagnosis.gap import Gap, within
from romsindy.fit.adequacy.verdicts import Adequacy
from romsindy.fit.verdict import (
    CLOSED,
    EQUIVALENT,
    LEFT_OVER,
    MOSTLY_CLOSED,
    NAMED_ABOVE,
    PREDICTED,
    SAME_SIZE,
    SMALL_ABOVE,
)

Verdict = Literal["none", "named", "ambiguous", "unknown"]
Left = Literal["noise", "tolerance", "form", "little", "effect"]


@dataclass(frozen=True)
class Explanation:
    """A hypothesis with what it leaves and what it changes."""

    hypothesis: Hypothesis
    left: Adequacy  # of the records that it was fitted to
    gap: Gap  # before and after, on what took no part
    whole: Gap  # the same on whole records
    lacking: bool  # whether the model lacks something that it names: no value of the model

    @property
    def sureness(self) -> float:
        """Standard errors, as they are told, by which its least sure strength is off zero."""
        return self.hypothesis.sureness / self.hypothesis.growth(self.left.ratio)

    @property
    def closed(self) -> float:
        """Part of the squared gap that closes; on all if what took no part shows none."""
        return (self.gap if self.gap.before > PREDICTED else self.whole).closed

    @property
    def leaves_noise(self) -> bool:
        """Whether noise is left alone, of what was fitted and of what took no part."""
        return self.left.explained and self.gap.after <= PREDICTED

    def leaves(self, tolerance: Tolerance, form: FormError) -> Left:
        """What it leaves; see `left_over`."""
        whole = self.whole.differences_after
        return left_over(self.hypothesis, self.left, self.gap, whole, tolerance, form)

    def changes(self, tolerance: Tolerance) -> bool:
        """Whether what it changes of the simulation matters; its own motions have no noise."""
        return _matter(self.whole.changes, tolerance)

    def differs(self, other: Explanation, tolerance: Tolerance) -> bool:
        """Whether it differs from another one by more than a tolerance."""
        return _matter(self.whole.changes_from(other.whole), tolerance)


def _off_zero(found: Explanation, without: Hypothesis) -> float:
    """Standard errors that it is off zero, by what it gains; none if it is not sure by its own."""
    a, b = found.hypothesis, without.at(found.hypothesis.noise)
    return max(b.misfit - a.misfit, 0.0) ** 0.5 if found.sureness >= NAMED_ABOVE else 0.0


def _ahead(found: Explanation, plain: Explanation) -> float:
    """By how much it is likelier, by the noise of its own."""
    a = found.hypothesis
    return plain.hypothesis.at(a.noise).score - a.score


def _plainest(found: Explanation) -> tuple[int, bool, bool, float]:
    """The least of several says the fewest values; what leaves noise alone first, then linear ones.

    Of two alike it is the likelier.
    """
    h = found.hypothesis
    return len(h.said), not found.leaves_noise, bool(h.effects and h.moved), h.score


def _matter(changes: Sequence[Difference], tolerance: Tolerance) -> bool:
    """Whether motions without noise differ by more than a tolerance, as a whole or in a part."""
    return any(not c.within(tolerance) or c.exceeds(tolerance) for c in changes)


def left_over(
    best: Hypothesis,
    left: Adequacy,
    gap: Gap,
    whole: Sequence[Difference],
    tolerance: Tolerance,
    form: FormError,
) -> Left:
    """What a hypothesis leaves, of data that took no part and, ``whole``, of every record.

    "noise"; "tolerance": less than what does not matter; "form": as much as the model leaves of the
    record that it was identified from; "little": next to nothing of the gap, and less than the
    noise; "effect": more, a further effect.
    """
    if left.explained and gap.after <= PREDICTED:
        return "noise"
    alone = whole and not best.names
    told = gap.unseen or left.ratio <= PREDICTED
    # What took no part may be too quiet to show what is left where nothing is blamed.
    told = told and not (alone and any(d.exceeds(tolerance) for d in whole))
    if told and gap.after <= PREDICTED and gap.closed >= CLOSED:
        return "little"
    # Slow noise has a waveform in short stretches, and these may not reach where records differ:
    # where nothing is blamed whole records say it.
    if within(whole, tolerance) if alone else gap.leaves_within(tolerance):
        return "tolerance"
    known = form != NO_FORM_ERROR  # of a reference record, if there was one
    return "form" if known and best.needs <= form.times(SAME_SIZE) else "effect"


@dataclass(frozen=True)
class Answer:
    """A verdict, the explanation that it is about, what does as well, and whether it is small."""

    verdict: Verdict
    explanation: Explanation
    rival: Explanation | None = None
    small: bool = False


@dataclass(frozen=True)
class Rule:
    """What decides, with what it is decided by."""

    as_it_was: Gap  # of the simulation, on whole records
    # What the measurement may add, alone and with linear stiffness and damping
    nothing: Hypothesis
    linear: Hypothesis
    tolerance: Tolerance
    form: FormError  # of the model, as its reference record shows it
    exact: bool = True  # whether the model is the simulation: its reduction misses small things

    def answer(self, values: Sequence[Explanation], effect: Explanation | None) -> Answer:
        """Weigh what needs no effect, and the best effect, if any.

        Of what is enough the fewest values that moved are told, though more be likelier: no
        coefficient of a model is so well known that another value of it would gain nothing.
        """
        likeliest = min(values, key=lambda found: found.hypothesis.score)
        enough = [v for v in values if self._enough(v) and not self._refuted(v, effect)]
        plain = min(enough, key=_plainest, default=likeliest)
        sure = bool(enough and plain.hypothesis.names) and plain.sureness >= NAMED_ABOVE
        moved = sure and self._matters(plain)
        # Beside values that moved and are enough, several effects of a structure are no headline.
        several = [] if effect is None else effect.hypothesis.effects
        said = sum(p.effect.structural for p in several)
        plainer = effect is not None and not (moved and len(plain.hypothesis.said) < said)
        if effect is not None and plainer and self._beyond_doubt(effect, plain, values):
            small = not (self._surely_beyond or effect.changes(self.tolerance))
            if self.exact or not small:
                return Answer("named", effect, small=small)
        # One that is distinctly likelier says that more than a tolerance is left.
        seen_through = (
            effect is not None
            and self._likelier(effect, likeliest, EQUIVALENT)
            and effect.differs(plain, self.tolerance)
        )
        if enough and not seen_through:
            # What values leave may be small, and one effect as likely all the same.
            alike = effect is not None and plainer and self._likelier(effect, plain, -EQUIVALENT)
            # How far values of a structure may be off is known: that they do it is no proof.
            known = not self.exact and plain.leaves_noise and self._surely_beyond
            if not moved and not (alike and known):
                return Answer("none", plain)
            if effect is None or not alike:
                sole = plain.leaves_noise or plain.closed >= MOSTLY_CLOSED
                return Answer("named" if sole else "ambiguous", plain)
            better = effect.leaves_noise and not plain.leaves_noise
            first = better and self._likelier(effect, plain, 0.0)
            # A value beyond its tolerance is as unlikely as that says; none may have to move.
            beyond = bool(plain.hypothesis.beyond) or not moved
            first |= beyond and self._likelier(effect, plain, EQUIVALENT)
            return Answer("ambiguous", *((effect, plain) if first else (plain, effect)))
        if effect is not None and self._explains(effect):
            named: Verdict = "named" if effect.sureness >= NAMED_ABOVE else "ambiguous"
            return Answer(named if self._matters(effect) else "none", effect)
        nearest = plain if effect is None else effect
        more = nearest.leaves(self.tolerance, self.form) == "effect"
        return Answer("unknown" if self._surely_beyond or more else "none", nearest)

    @property
    def _surely_beyond(self) -> bool:
        return any(d.exceeds(self.tolerance) for d in self.as_it_was.differences_before)

    def _enough(self, plain: Explanation) -> bool:
        """Whether values and nuisances leave nothing beyond the tolerance."""
        if plain.leaves_noise:
            return True
        closed = plain.gap.closed >= MOSTLY_CLOSED or not plain.hypothesis.names
        return closed and plain.leaves(self.tolerance, self.form) != "effect"

    def _refuted(self, plain: Explanation, effect: Explanation | None) -> bool:
        """Whether other modes say that an effect is there, and no values in its place."""
        if effect is None or plain.hypothesis.misfit_elsewhere <= EQUIVALENT:
            return False
        a, b = effect.hypothesis, plain.hypothesis.at(effect.hypothesis.noise)
        return effect.lacking and a.score < b.score - EQUIVALENT

    def _likelier(self, effect: Explanation, plain: Explanation, by: float) -> bool:
        """Whether an effect explains, and is likelier than what needs none."""
        return self._explains(effect) and effect.lacking and _ahead(effect, plain) > by

    def _explains(self, effect: Explanation) -> bool:
        """Whether it closes some of the gap, and leaves nothing that matters."""
        leaves, gap = effect.leaves(self.tolerance, self.form), effect.gap
        much = gap.after > LEFT_OVER and not gap.leaves_within(self.tolerance)
        return leaves != "effect" and not much and effect.closed > 0

    def _matters(self, found: Explanation) -> bool:
        """Whether the simulation as it was is beyond the tolerance, by its cycles or by this."""
        if self._surely_beyond:
            return True
        sure = _off_zero(found, self.nothing) >= SMALL_ABOVE
        return sure and found.changes(self.tolerance)

    def _beyond_doubt(
        self, effect: Explanation, plain: Explanation, values: Sequence[Explanation]
    ) -> bool:
        """Whether an effect is there although what it explains does not matter.

        A coefficient that the model has is held against linear values alone, for others say the
        same, and told where the plain answer leaves more than noise.
        """
        owned = not effect.lacking
        others = [v for v in values if not (owned and v.hypothesis.effects)]
        return (
            self.tolerance.source == DEFAULT
            and effect.closed >= MOSTLY_CLOSED
            and effect.leaves_noise
            and _off_zero(effect, self.linear) >= SMALL_ABOVE
            and self._explains(effect)
            and min(_ahead(effect, v) for v in others) > 0
            and not (owned and plain.gap.after <= PREDICTED)
        )
