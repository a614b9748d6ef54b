"""The static curve of a beam in the coordinate that its sensors show.

Held by the modal force at many coordinates q, the beam takes shapes x(q). A force f(x, v) on the
beam does the work Q dq with Q(q, q_dot) = f(x(q), x'(q) q_dot) . x'(q): that is what the one
coordinate feels of it.
"""

from __future__ import annotations

from romsindy.beam import StaticCurve
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam

_CASES, _GRID, _MARGIN = 41, 121, 1.15


def seen_curve(seen: InstrumentedBeam, reach: float) -> StaticCurve:
    """Return the curve of the first mode over the coordinate that the sensors show.

    Parameters
    ----------
    seen : InstrumentedBeam
    reach : float
        Largest coordinate of interest, kg^0.5 m; the curve goes a little beyond.
    """
    own = seen.beam.static_curve(amplitude=_MARGIN * reach, cases=_CASES)
    return own.read_by(seen.seen, reach, _GRID)
