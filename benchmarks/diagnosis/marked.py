"""A diagnosis that is timed and marked, as a row that can be stored."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Collection
from typing import Any

import strangers
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
        found = _read(diagnosis())
    except Exception as e:  # a failure of one trial is counted, and the others go on
        where = traceback.extract_tb(e.__traceback__)[-1].name
        found = {"said": Said("failed", (), ()), "error": f"{type(e).__name__} in {where}: {e}"}
    said = found.pop("said")
    stranger = hidden and hidden[0] in strangers.MAKERS
    judged = of_a_stranger(said) if stranger else marks(said, hidden, excused)
    return {**known, **vars(said), **judged, "seconds": time.perf_counter() - start, **found}


def _read(report: Any) -> dict[str, Any]:
    """What is kept of a report."""
    return {
        "said": Said.of(report),
        "before": report.gap.before,
        "after": report.gap.after,
        "sentence": report.sentence,
        "values": report.effects[0].values if report.effects else {},
    }
