"""The verdict: does what was found close the gap, and what is left of it?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.form import NO_FORM_ERROR, FormError
from romsindy.diagnosis.gap import Gap
from romsindy.diagnosis.tolerance import Tolerance
from romsindy.fit.adequacy import Adequacy
from romsindy.fit.verdict import PREDICTED, SAME_SIZE

Verdict = Literal["none", "named", "ambiguous", "unknown"]
Left = Literal["noise", "tolerance", "form", "effect"]


def left_over(
    best: Hypothesis, remainder: Adequacy, gap: Gap, tolerance: Tolerance, form: FormError
) -> Left:
    """What is left: noise, what does not matter, the form of the model, or more than that."""
    if remainder.explained and gap.after <= PREDICTED:
        return "noise"
    if not any(d.exceeds(tolerance) for d in gap.differences_after):
        return "tolerance"
    needed = NO_FORM_ERROR if best.weighed is None else best.weighed.needed
    alike = needed.jump <= SAME_SIZE * form.jump and needed.structure <= SAME_SIZE * form.structure
    return "form" if alike else "effect"


def verdict_of(
    best: Hypothesis,
    rivals: Sequence[Hypothesis],
    remainder: Adequacy,
    gap: Gap,
    tolerance: Tolerance,
    form: FormError,
) -> Verdict:
    """Weigh the best hypothesis, its rivals, and what it leaves.

    Something is named only where what is left is noise, does not matter, or is of the size by
    which the model misses the record that it was identified from. Stiffness and damping that move
    together may have one cause that is in no catalogue: a viscoelastic support, say.
    """
    if left_over(best, remainder, gap, tolerance, form) == "effect":
        return "unknown"
    if not best.names or not gap.improves(tolerance):
        return "none"
    if len(rivals) > 1 or len(best.moved) > 1:
        return "ambiguous"
    return "named"
