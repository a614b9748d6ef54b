"""Does another vibration take part, where what one coordinate explains of records is in doubt?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from romsindy.diagnosis.gap import Gap, Prediction, name_of
from romsindy.diagnosis.interaction import Interaction, interaction_of
from romsindy.diagnosis.interaction_report import InteractionReport
from romsindy.diagnosis.prediction import predict
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.search import Options
from romsindy.diagnosis.words import not_followed, rings_along
from romsindy.effects import CATALOGUE, look_alikes
from romsindy.fit.record import Record
from romsindy.fit.verdict import LEFT_OVER
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.signals import rest_level
from romsindy.record.vibrations import Vibration, find_vibrations

# The same mode in two records: its small frequencies differ by less, as a ratio.
_SAME = 1.2
# So many other vibrations are tried, the loudest first: a faint one may be a combination of two.
_MOST = 2

_Heard = tuple[Vibration, list[Vibration]]  # that of the model, and those beside it


class _Ringing(NamedTuple):
    """The vibration of a model and another one, and the numbers of the records that hold both."""

    own: Vibration
    other: Vibration
    numbers: tuple[int, ...]


def with_other_mode(
    report: DiagnosisReport, options: Options
) -> DiagnosisReport | InteractionReport:
    """The report; or what another mode explains, where what one coordinate explains is in doubt."""
    unknown = report.verdict == "unknown"
    if report.interrupted or not (unknown or _in_doubt(report)):
        return report
    open_ = unknown or report.gap.after > LEFT_OVER
    model, notes = report.nominal if open_ else report.model, []
    for ringing in _ringing(report.records)[:_MOST]:
        decays = [_at_rest(report.records[i].decay) for i in ringing.numbers]
        own, other, _ = ringing
        found = interaction_of(model, decays, own, other, options.floor, options.progress)
        if found is None:
            notes.append(not_followed(other))
            continue
        if found.takes_part and found.fit is not None:
            gap = _gap(report.nominal, report.records, ringing.numbers, found)
            return InteractionReport.of(report, found, found.fit, gap)
        notes.append(rings_along(found))
    return replace(report, notes=tuple(notes)) if unknown else report


def _in_doubt(report: DiagnosisReport) -> bool:
    """Whether what stands for another vibration explains the records beside other effects alone.

    Or whether it leaves much, although that is tolerated: a mode in resonance comes and goes.
    """
    names = {part.effect.name for part in report.best.effects}
    beside = {"second_mode"} | look_alikes("second_mode", CATALOGUE)
    found = report.verdict in ("named", "ambiguous")
    much = len(names) > 1 or report.gap.after > LEFT_OVER
    return found and much and bool(names & beside)


def _ringing(records: Sequence[Record]) -> list[_Ringing]:
    """What rings beside the vibration of the model, the loudest first."""
    heard = [_heard(record) for record in records]
    pairs = [(own, other) for own, others in filter(None, heard) for other in others]
    found: list[_Ringing] = []
    for own, other in sorted(pairs, key=lambda pair: -pair[1].share):
        if not any(_same(other, known.other) for known in found):
            numbers = (i for i, of in enumerate(heard) if of and _holds(of, own, other))
            found.append(_Ringing(own, other, tuple(numbers)))
    return found


def _holds(heard: _Heard, own: Vibration, other: Vibration) -> bool:
    """Whether what was heard of a record has both vibrations."""
    return _same(own, heard[0]) and any(_same(other, v) for v in heard[1])


def _heard(record: Record) -> _Heard | None:
    """The vibration of the model, and those that decay beside it."""
    decay = _at_rest(record.decay)
    every = find_vibrations(decay.signal, decay.dt, decay.derivative)
    found = [v for v in every if not (v.steady or v.faint)]
    if not found:
        return None
    hz = record.rate / (2 * np.pi)
    own = min(found, key=lambda v: abs(np.log(v.mean_frequency / hz)))
    return own, [v for v in found if v is not own]


def _same(a: Vibration, b: Vibration) -> bool:
    return 1 / _SAME < a.small_frequency / b.small_frequency < _SAME


def _at_rest(decay: Decay) -> Decay:
    """Free of an offset, as all that rings is looked for."""
    if decay.measured != "displacement":
        return replace(decay, stage="free")
    return replace(decay, q=decay.q - rest_level(decay.q, decay.dt), stage="free")


def _gap(
    model: ReducedModel, records: Sequence[Record], numbers: Sequence[int], found: Interaction
) -> Gap:
    """Before and after, on the records in which both ring: nothing of them was held out."""
    predictions = []
    for i, left in zip(numbers, found.longest.residuals, strict=True):
        whole = replace(records[i], part=None)
        before = predict(model, (), whole, name_of(i)).before
        predictions.append(Prediction(whole, before, whole.signal - left, name_of(i)))
    return Gap(tuple(predictions), unseen=False)
