"""A diagnosis that is timed and marked, as a row that can be stored."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Collection
from typing import Any

from memory import OUTSIDE
from score import Said, marks, of_a_stranger


def asked_of(
    diagnosis: Callable[[], Any], truth: dict, excused: Collection[str] = ()
) -> dict[str, Any]:
    """Time a diagnosis and mark it; one that ends in an error is neither right nor wrong.

    Parameters
    ----------
    diagnosis : () -> report
    truth : dict
        "effects", "strength", "noise", "snr_db".
    excused : names
        That may be said as well: parameters that are wrong within their tolerances.
    """
    hidden = list(truth["effects"])
    known = {
        "hidden": hidden,
        "about": f"{truth['strength']} {truth['noise']} {truth.get('snr_db', 0):.0f} dB",
    }
    excused = {*excused, "mains_hum"} if truth["noise"] == "hum" else set(excused)
    start = time.perf_counter()
    try:
        report = diagnosis()
        said = Said.of(report)
        error = ""
    except Exception as e:  # a failure of one trial is counted, and the others go on
        report, said = None, Said("failed", (), ())
        error = f"{type(e).__name__} in {traceback.extract_tb(e.__traceback__)[-1].name}: {e}"
    judged = (
        of_a_stranger(said) if hidden and hidden[0] in OUTSIDE else marks(said, hidden, excused)
    )
    return {
        **known,
        **vars(said),
        **judged,
        "seconds": time.perf_counter() - start,
        "error": error,
        "before": report.gap.before if report else 0.0,
        "after": report.gap.after if report else 0.0,
        "sentence": report.sentence if report else "",
        "values": report.effects[0].values if report and report.effects else {},
    }
