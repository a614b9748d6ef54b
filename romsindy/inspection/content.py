"""An inspection as plain numbers and words by name, for JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from romsindy.inspection.findings import Findings
from romsindy.inspection.modes import Mode


def content_of(found: Findings) -> dict[str, Any]:
    """All numbers by name, times in s, frequencies in Hz, the rest in SI units."""
    r = found.recording
    return {
        "file": r.source,
        "samples": len(r.t),
        "rate": 1 / r.dt,
        "start": float(r.t[0]),
        "end": float(r.t[-1]),
        "quantity": r.quantity,
        "unit": r.unit,
        "basis": r.basis,
        "notes": list(r.notes),
        "channel": found.channel,
        "channels": [asdict(n) for n in found.noise],
        "releases": [asdict(part) for part in found.releases],
        "discarded": [asdict(part) for part in found.discarded],
        "defects": [asdict(d) for d in found.defects],
        "modes": [_mode(found, m) for m in found.modes],
        "resonances": [
            {"lower": low.number, "higher": high.number, "p": s.p, "q": s.q, "ratio": s.ratio}
            | {"amplitude": s.amplitude}
            for low, high, s in found.resonances
        ],
    }


def _mode(found: Findings, mode: Mode) -> dict[str, Any]:
    names = ("frequency", "damping_ratio", "amplitude")
    ends = {name: dict(zip(("loud", "quiet"), getattr(mode, name), strict=True)) for name in names}
    parts = zip(found.releases, mode.parts, strict=True)
    return {
        "number": mode.number,
        "mean_frequency": mode.mean_frequency,
        **ends,
        "share": mode.share,
        "harmonics": list(mode.harmonics),
        "steady": mode.steady,
        "along": [
            {
                "release": i,
                "t": part.start + v.tone.t,
                "frequency": v.frequency,
                "amplitude": v.displacement,
            }
            for i, (part, v) in enumerate(parts, 1)
            if v is not None
        ],
    }
