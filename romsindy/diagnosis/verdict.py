"""The verdict of a diagnosis: does it matter, is it explained, by what, and what is left?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.form import FormError
from romsindy.diagnosis.gap import Gap
from romsindy.diagnosis.tolerance import DEFAULT, Tolerance
from romsindy.fit.adequacy import Adequacy
from romsindy.fit.verdict import CLOSED, PREDICTED, SAME_SIZE

Verdict = Literal["none", "named", "ambiguous", "unknown"]
Left = Literal["noise", "tolerance", "form", "little", "effect"]


def left_over(
    best: Hypothesis, left: Adequacy, gap: Gap, tolerance: Tolerance, form: FormError
) -> Left:
    """What the best hypothesis leaves.

    "noise"; "tolerance": less than what was said not to matter; "form": as much as the model leaves
    of the record that it was identified from; "little": next to nothing of the gap, and less than
    the noise; "effect": more, a further effect.
    """
    if left.explained and gap.after <= PREDICTED:
        return "noise"
    told = gap.unseen or left.ratio <= PREDICTED
    if told and gap.after <= PREDICTED and gap.closed >= CLOSED:
        return "little"
    # By default next to nothing is tolerated, less than a difference at equal amplitude can show.
    stated = tolerance.source != DEFAULT
    if stated and not any(d.exceeds(tolerance) for d in gap.differences_after):
        return "tolerance"
    return "form" if best.needs <= form.times(SAME_SIZE) else "effect"


def verdict_of(
    best: Hypothesis,
    rivals: Sequence[Hypothesis],
    left: Adequacy,
    gap: Gap,
    tolerance: Tolerance,
    form: FormError,
    matters: bool,
    improves: bool,
) -> Verdict:
    """Weigh the best hypothesis, its rivals, and what it leaves.

    Parameters
    ----------
    best : Hypothesis
    rivals : sequence of Hypothesis
        What the data do not tell apart from the best, itself first.
    left : Adequacy
        What the best leaves of the records it was fitted to.
    gap : Gap
        Before and after, on what took no part.
    tolerance : Tolerance
        Differences that do not matter.
    form : FormError
        Of the model, as its reference record shows it.
    matters : bool
        Whether the simulation as it was is surely beyond the tolerance in any record.
    improves : bool
        Whether it is materially better with the best.

    Returns
    -------
    "none", "named", "ambiguous" or "unknown"
        Stiffness and damping that move together may have one cause that is in no catalogue: a
        viscoelastic support, a small mass that vibrates along.
    """
    if left_over(best, left, gap, tolerance, form) == "effect":
        return "unknown" if matters else "none"
    if not best.names:
        return "none"
    if not improves:
        return "unknown" if matters else "none"
    return "ambiguous" if len(rivals) > 1 or len(best.moved) > 1 else "named"
