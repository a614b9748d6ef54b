"""Which further measurement would show more of what nothing explains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from romsindy.diagnosis.gap import Gap, Prediction
from romsindy.diagnosis.next_test import AGAIN, LARGER, LONGER, Experiment
from romsindy.text import Shown, two_digits

_GROWS = 1.25  # times as much in loud cycles as in quiet ones, or the other way


@dataclass(frozen=True)
class MoreOfIt:
    """The test to make next where nothing explains the data.

    Attributes
    ----------
    test : Experiment
    action : str
        What to do, in words.
    loud, quiet : float
        Rms of what is left over the noise, in cycles above and below half of the largest amplitude.
    half : str
        That amplitude, with its unit.
    """

    test: Experiment
    action: str
    loud: float
    quiet: float
    half: str
    odds: None = None  # between what was refused mean nothing
    rivals: tuple[str, ...] = ()

    @property
    def cost(self) -> float:
        """In repetitions of the largest release so far."""
        return self.test.cost

    @property
    def sentence(self) -> str:
        """The advice in words, to follow "Next: "."""
        aim = "whether it repeats" if self.test == AGAIN else "more of what is missing"
        sizes = f"{two_digits(self.loud)} times the noise above {self.half}"
        return (
            f"{self.action} would show {aim}: what is left is {sizes},"
            f" {two_digits(self.quiet)} times below."
        )


def more_of_it(gap: Gap, largest: float) -> MoreOfIt | None:
    """Whether larger amplitudes, longer records or the same again show more of what a gap leaves.

    ``largest`` is the largest amplitude so far. None where what is left has no loud and quiet part.
    """
    prediction = gap.predictions[gap.worst]
    found = _loud_and_quiet(prediction)
    if found is None:
        return None
    loud, quiet, half = found
    test = LARGER if loud > _GROWS * quiet else LONGER if quiet > _GROWS * loud else AGAIN
    shown: Shown = gap.shown
    action = test.words.format(amplitude=shown.told(abs(test.amplitude) * largest))
    return MoreOfIt(test, action, loud, quiet, shown.told(half))


def _loud_and_quiet(p: Prediction) -> tuple[float, float, float] | None:
    """What is left over the noise above and below half of the largest amplitude, and that half."""
    cycles = p.backbone(p.record.signal)
    if cycles is None:
        return None
    amplitude = np.interp(p.record.t, cycles.t, cycles.amplitude)
    misfit = p.misfit(p.after) / p.record.noise.std
    half = float(cycles.amplitude.max()) / 2
    parts = (misfit[amplitude > half], misfit[amplitude <= half])
    left = [x[~np.isnan(x)] for x in parts]
    if min(map(len, left)) == 0:
        return None
    loud, quiet = (float(np.sqrt(np.mean(x**2))) for x in left)
    return loud, quiet, half
