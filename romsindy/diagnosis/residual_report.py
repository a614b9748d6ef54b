"""A diagnosis by what is left: of driven records, and of several coordinates."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np
from scipy.signal import welch

from romsindy.diagnosis import words
from romsindy.diagnosis.difference import DEFAULT, Tolerance
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.gap import UNSEEN, ResidualGap, beyond_noise, noise_std
from romsindy.diagnosis.held_out import followed, left_of
from romsindy.diagnosis.report import Explained, closing
from romsindy.diagnosis.residual_search import ResidualSearch, driven_instead
from romsindy.diagnosis.search import Finding
from romsindy.diagnosis.verdict import Left, Verdict
from romsindy.fit.adequacy.verdicts import Adequacy, ForcedAdequacy
from romsindy.fit.kernel.collocation import Trajectory, TrajectoryError, integrate
from romsindy.fit.kernel.equation import equation_of
from romsindy.fit.kernel.part import extended
from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.records.driven import ForcedRecord, Sampled
from romsindy.fit.verdict import AS_GOOD, CLOSED, NAMED_ABOVE, PREDICTED
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.model import ReducedModel
from romsindy.record.noise import Noise
from romsindy.text import left_over, percent, quantity, two_digits
from romsindy.typing import Array

if TYPE_CHECKING:
    from romsindy.show.page import Picture


LEVELS = (0.5, 2.0, 4.0)  # of the inputs so far
_BAND = 0.25, 0.75  # of the power of the difference lies below each end


@dataclass(frozen=True)
class InputLevel:
    """A record repeated with stronger or weaker inputs, and by how much two rivals differ then."""

    level: float  # of the inputs, as a multiple of those so far
    record: int
    apart: float  # rms of the difference over the noise of the record
    part: float  # the same as a part of that of the response at this level
    band: tuple[float, float]  # Hz, between which half of the power of the difference lies
    samples: int  # of the record

    @property
    def enough(self) -> bool:
        """Whether chi-square is beyond that at which two predictions are as good."""
        return self.samples * self.apart**2 > AS_GOOD


def most_apart(
    model: ReducedModel, rivals: Sequence[Hypothesis], records: Sequence[ForcedRecord]
) -> InputLevel | None:
    """The record and the level at which two rivals, as they were fitted, differ most.

    None where neither has a motion at other levels.
    """
    found = []
    for level in LEVELS:
        for i, record in enumerate(records):
            try:
                signals = [_shown(model, h, record, i, level) for h in rivals]
            except TrajectoryError:
                continue
            difference = signals[0] - signals[1]
            size, band = float(np.std(difference)), _band(difference, record.decay.dt)
            sizes = size / record.noise.std, size / float(np.std(signals[0]))
            found.append(InputLevel(level, i, *sizes, band, len(difference)))
    return max(found, key=lambda f: f.apart, default=None)


def _shown(
    model: ReducedModel, hypothesis: Hypothesis, record: ForcedRecord, number: int, level: float
) -> Array:
    """What a hypothesis says of a record with inputs at another level, (n,)."""
    inputs = {k: Sampled(level * s.u, s.dt, s.grid) for k, s in record.inputs.items()}
    parts, driven = hypothesis.parts, replace(record, inputs=inputs)
    equation = equation_of(driven_instead(model, parts), parts, number, driven)
    m = hypothesis.solution.motions[number]
    guess = Trajectory(m.grid, level * m.q, level * m.q_dot, level * m.q_ddot)
    motion = integrate(equation, level * m.start, m.grid, guess)
    return record.read(hypothesis.parts, number, motion.samples(equation, record.derivative)).shown


def _band(x: Array, dt: float) -> tuple[float, float]:
    frequency, power = welch(x, 1 / dt, nperseg=max(len(x) // 8, 8))
    share = np.cumsum(power) / max(float(np.sum(power)), 1e-300)
    low, high = (float(frequency[np.searchsorted(share, end)]) for end in _BAND)
    return low, high


@dataclass(frozen=True, kw_only=True, repr=False)
class ResidualReport(Explained):
    """What a simulation lacks, by what it leaves of the records.

    Attributes
    ----------
    verdict, nominal, model, best, rivals, compared, scales, added, interrupted, notes
        As those of a `DiagnosisReport`.
    base : Hypothesis
        The simulation as it was.
    gap : ResidualGap
        Before and after, on what was held out, or else on the records that were fitted.
    tolerance : Tolerance
        What does not matter; where it is the default, what is noise.
    remainder : Adequacy
        Whether what is left is noise.
    records : tuple of ForcedRecord or CoupledRecord
    """

    gap: ResidualGap
    tolerance: Tolerance
    records: tuple[Any, ...]

    @property
    def left(self) -> Left:
        """Noise, what does not matter, next to nothing of the gap, or a further effect."""
        if self.remainder.explained:
            return "noise"
        if self.verdict == "unknown":
            return "effect"
        within = beyond_noise(self.gap.records, self.gap.residuals_after) <= self.tolerance.signal
        return "tolerance" if self.tolerance.source != DEFAULT and within else "little"

    # -- words ---------------------------------------------------------------------------------

    @property
    def sentence(self) -> str:
        lines = [
            *self._interrupted,
            self._difference,
            f"Missing: {self._missing}",
            f"Left: {self._left}",
            *(f"Note: {note}" for note in (*words.undetermined(self.tolerance), *self.notes)),
            *self._next,
        ]
        return "\n".join(lines)

    @property
    def _difference(self) -> str:
        if not np.isfinite(self.gap.rms_before):
            return "They differ: the simulation has no motion that follows the records."
        size = quantity(self.gap.rms_before, self.gap.unit)
        share = percent(self.gap.before)
        differ = "They agree" if self.verdict == "none" else "They differ"
        line = f"{differ}: the simulation leaves {size} rms, {share} of the response"
        on = f" on {UNSEEN}" if self.gap.where == UNSEEN else ""
        asked = self.tolerance.source != DEFAULT
        known = f" ({words.tolerated(self.tolerance)})" if asked else ""
        return f"{line}{on}{known}."

    def _closing(self, closes: str) -> str:
        share = percent(self.gap.closed)
        if round(100 * self.gap.closed, 1) == 100:
            share = "all"
        return f"{closes} {share} of the squared gap on {self.gap.where}."

    @property
    def _left(self) -> str:
        size = quantity(self.gap.rms_after, self.gap.unit)
        share = f"{size} rms, {percent(self.gap.after)} of the response"
        if self.remainder.explained:
            return f"{share}, as noise."
        if self.left == "tolerance":
            return f"{share}, which does not matter."
        return f"{share}; {self._more_than_noise}."

    @property
    @abstractmethod
    def _more_than_noise(self) -> str:
        """What shows that what is left is no noise."""

    @property
    def _next(self) -> list[str]:
        """What would confirm the one that is left, or tell apart the first two of several.

        Where nothing explains the records, what shows whether that is a property of the structure.
        """
        if self.verdict == "unknown":
            return [
                f"Next: the same {self._test} again would show whether it repeats, and one of half"
                " the size whether it grows with the amplitude."
            ]
        if self.verdict == "named" and self.effects:
            return [f"Next: {words.confirming(self.effects)}"]
        if self.verdict != "ambiguous":
            return []
        advice = {e.advice: None for h in self.rivals for e in self._found(h)}
        beside = f"what may tell them apart is {', or '.join(advice)}."
        level = self.level
        if level is None:
            return [f"Next: {beside}"]
        low, high = level.band
        where = f"record {level.record + 1} with inputs {level.level:g} times as large"
        how_far = f"{left_over(level.part, level.apart)}, most between {low:.3g} and {high:.3g} Hz"
        if not level.enough:
            return [
                f"Next: at no level that was simulated they differ enough (at most {how_far},"
                f" in {where}); {beside}"
            ]
        return [f"Next: in {where} the first two, as they were fitted, differ by {how_far}."]

    _test: ClassVar[str]  # what made a record

    @property
    def level(self) -> InputLevel | None:
        """That of the inputs at which the first two rivals differ most; None where none is."""
        return None

    # -- tables and files ------------------------------------------------------------------------

    def _content(self) -> dict[str, Any]:
        return {
            **super()._content(),
            **self._explanations(),
            "structure": self.remainder.structure,
            "gap": closing(self.gap, "rms_before", "rms_after"),
            "left": self.left,
            "notes": list(self.notes),
        }

    def pictures(self) -> dict[str, Picture]:
        """Pictures by name: "time" and "spectrum", of the record of which most is left."""
        from romsindy.show import compared as show  # draws: only where a picture is asked
        from romsindy.show.page import Picture

        worst = int(np.argmax([np.std(e) for e in self.gap.residuals_after]))
        record, n = self.gap.records[worst], len(self.gap.records[worst].t)
        found = self.gap.residuals_before[worst], self.gap.residuals_after[worst]
        every = np.reshape([record.signal, *found], (3, -1, n))
        channel = int(np.argmax(np.std(every[2], axis=1)))
        signal, before, after = every[:, channel]
        before = np.where(np.isfinite(before), before, np.nan)  # nan where there is no motion
        both = f"{percent(self.gap.before)} of the response before, "
        both += f"{percent(self.gap.after)} after"
        of = "Of the held-out record" if self.gap.where == UNSEEN else f"Of record {worst + 1}"
        of += f", channel {channel + 1}" if every.shape[1] > 1 else ""
        missed = {"before": before, "after": after}
        given = show.Compared(record.t, signal, missed, record.decay.measured, self.gap.unit)
        noisy = replace(given, noise=Noise.white(noise_std(record), record.decay.dt))
        time = Picture(
            "time",
            "The records and what is missed",
            f"{of}; of all records {both}.",
            partial(show.draw_over_time, given),
        )
        spectrum = Picture(
            "spectrum",
            "At which frequencies it is missed",
            f"{of}, and the noise where the spectrum is quietest.",
            partial(show.draw_spectra, {"": show.spectrum_of(noisy)}),
        )
        return {p.name: p for p in (time, spectrum)}


@dataclass(frozen=True, kw_only=True, repr=False)
class ForcedReport(ResidualReport):
    """What a model lacks against driven records: a `ResidualReport` of them."""

    nominal: ReducedModel
    model: ReducedModel
    _test = "input"

    @property
    def _more_than_noise(self) -> str:
        left = self.remainder
        assert isinstance(left, ForcedAdequacy)  # of driven records
        if not np.isfinite(left.ratio):
            return "no motion of the model follows the records"
        return left.gone if left.structured else f"it would be {left.noise}"

    @cached_property
    def level(self) -> InputLevel | None:
        """At which the first two rivals differ most; None where there is but one."""
        if len(self.rivals) < 2:
            return None
        return most_apart(self.nominal, self.rivals[:2], self.records)


@dataclass(frozen=True, kw_only=True, repr=False)
class CoupledDiagnosis(ResidualReport):
    """What a model of several coordinates lacks, against decays in which they ring.

    Effects have the coordinate in their names: "dry_friction [q2]". No test is simulated: what may
    tell explanations apart is said by the effects themselves.
    """

    nominal: CoupledModel
    model: CoupledModel
    _test = "release"

    @property
    def _more_than_noise(self) -> str:
        return f"{two_digits(self.remainder.ratio)} times the noise: more than noise repeats"


Kind = TypeVar("Kind", bound=ResidualReport)


def report_of(
    search: ResidualSearch,
    found: Finding,
    test: Prepared | None,
    notes: Sequence[str],
    kind: type[Kind],
) -> Kind:
    """What a search found, by what it leaves of the records, or of one that took no part."""
    best, tolerance = found.rivals[0], search.options.tolerance
    added = best.parts if best.names else ()
    gap, tells = _gap(search, found, test), [search.remainder(best)]
    if test is not None:
        tells.append(search.examined([test], followed(search.model, best.parts, test)))
    kept = tolerance.source != DEFAULT and all(
        beyond_noise(*some) <= tolerance.signal
        for some in ((gap.records, gap.residuals_after), (search.records, best.solution.residuals))
    )
    return kind(
        verdict=_verdict(found, gap, tells, kept),
        nominal=search.model,
        model=extended(driven_instead(search.model, best.parts), added) if added else search.model,
        best=best,
        rivals=tuple(found.rivals),
        compared=tuple(found.compared),
        base=found.base,
        remainder=tells[-1],
        gap=gap,
        tolerance=tolerance,
        records=tuple(search.records),
        scales=search.scales,
        added=added,
        interrupted=found.interrupted,
        notes=tuple(notes),
    )


def _gap(search: ResidualSearch, found: Finding, test: Prepared | None) -> ResidualGap:
    """Before and after, on what took no part, or else on what was fitted."""
    best, base = found.rivals[0], found.base
    if test is None:
        return ResidualGap.of(search.records, base.solution.residuals, best.solution.residuals)
    before, after = ([left_of(search.model, h.parts, test)] for h in (base, best))
    return ResidualGap.of([test], before, after, UNSEEN)


def _verdict(found: Finding, gap: ResidualGap, tells: Sequence[Adequacy], kept: bool) -> Verdict:
    """One word; ``kept`` says that what is left is within a tolerance."""
    best = found.rivals[0]
    explained = all(left.explained for left in tells)
    little = gap.closed >= CLOSED and all(left.ratio <= PREDICTED for left in tells)
    if not (explained or little or kept):
        return "unknown"
    if not best.names:
        return "none"
    several = len(found.rivals) > 1 or len(best.moved) > 1 or best.pliable or found.interrupted
    return "ambiguous" if several or best.sureness < NAMED_ABOVE else "named"
