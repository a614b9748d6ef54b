"""What is said of the cycles of a decay where they are drawn."""

from __future__ import annotations

import numpy as np

from romsindy.record.backbone import Backbone
from romsindy.show.axes import Fact, with_unit


def of_cycles(b: Backbone, decay: int | None = None) -> list[Fact]:
    """Number, time, amplitude, frequency and damping ratio of every cycle of a decay.

    The decay has a number itself where there are several.
    """
    return [
        *([] if decay is None else [Fact("decay", np.full(len(b), float(decay)))]),
        Fact("cycle", np.arange(1.0, len(b) + 1)),
        Fact("time (s)", b.t),
        Fact(with_unit("amplitude", b.unit), b.amplitude, b.amplitude_std),
        Fact("frequency (Hz)", b.frequency / (2 * np.pi), b.frequency_std / (2 * np.pi)),
        Fact("damping ratio (%)", 100 * b.damping_ratio, 100 * b.damping_ratio_std, 4),
    ]
