"""Vibrations of several coordinates that ring near a ratio of small whole numbers.

Read off the tones of the records, never put in: no fit asks for a ratio.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from romsindy.fit.kernel.prepared import Prepared, one_a_decay
from romsindy.physics.equations import Equations
from romsindy.record.vibrations import Resonance, resonances_of
from romsindy.text import quantity


def resonances_in(records: Sequence[Prepared]) -> tuple[Resonance, ...]:
    """Pairs of modes, counted from 0 by frequency, where they come nearest to p : q in any record.

    Empty for records of one coordinate.
    """
    several = one_a_decay(records)
    if not several:
        return ()
    by_frequency = np.argsort([np.median(tone.frequency) for tone in several[0].tones])
    nearest: dict[tuple[int, int, int, int], Resonance] = {}
    for record in several:
        for r in resonances_of([record.tones[i] for i in by_frequency], record.derivative):
            pair = (r.lower, r.higher, r.p, r.q)
            nearest[pair] = min(nearest.get(pair, r), r, key=lambda x: x.off)
    return tuple(nearest[pair] for pair in sorted(nearest))


def resonance_notes(model: Equations, records: Sequence[Prepared]) -> list[str]:
    """A sentence for each of them."""
    return [
        f"modes {r.lower + 1} and {r.higher + 1} ring at {r.p}:{r.q} (ratio {r.ratio:.4g} at"
        f" {quantity(r.amplitude, model.unit or '[q]')})"
        f"{'' if _couples(model, r) else ', but no term of the model couples them'}"
        for r in resonances_in(records)
    ]


def _couples(model: Equations, resonance: Resonance) -> bool:
    """Whether the equation of one coordinate holds the other, in a motion of both."""
    main = np.argmax(np.abs(model.linear_modes[1]), axis=0)
    i, j = main[resonance.lower], main[resonance.higher]
    moving = np.ones(model.n_coordinates)
    return any(
        slope[i, j] or slope[j, i]
        for slope in model.residual_and_slopes(moving, moving, moving)[1:]
    )
