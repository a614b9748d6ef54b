"""Does a model explain steady states, and is the force that it leaves small?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from romsindy.fit.adequacy import Adequacy
from romsindy.fit.verdict import BARELY, EXPLAINED, SAME_SIGNAL, WIDEST_SIGNAL
from romsindy.text import percent


@dataclass(frozen=True, eq=False)
class SteadyAdequacy(Adequacy):
    """Whether a model explains steady states; of `Adequacy`, what goes by windows is empty.

    Attributes
    ----------
    ratio : float
        Rms of what is left over what the noise of the response makes of it; nan where that noise is
        not known.
    p_value : float
        Probability that what does not know motion and force goes with them as much (F test); nan
        where points are too few.
    structure : float
        Power of what is left over that without what goes with motion or force.
    part : float
        Rms of the force that is left at the points as measured, as a part of the force.
    unknown : float
        The same without what the noise of the response makes of it.
    missing : float
        What goes with motion or force, as a part of the force.
    like : str
        The term, or the value of the excitation, that alone tells most of that.
    """

    unknown: float = 0.0
    missing: float = 0.0
    like: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("unknown", "missing"):  # a file may say "NaN"
            object.__setattr__(self, name, float(getattr(self, name)))

    @property
    def structured(self) -> bool:
        """Whether more than noise goes with motion or force, and it matters."""
        return self.p_value < self.false_alarm and self.missing > BARELY

    @property
    def explained(self) -> bool:
        """Whether what is left goes with neither motion nor force, and is not another motion.

        Where points are too few to try that, whether the noise of the response makes as much.
        """
        if np.isnan(self.p_value):
            return self.ratio <= EXPLAINED
        return not self.structured and self.unknown <= WIDEST_SIGNAL

    @property
    def beyond_noise(self) -> float:
        """What is left of the force beyond the noise of the response."""
        return self.unknown

    @property
    def good(self) -> bool:
        """Whether what is missing is as little as tests of good repeatability differ by."""
        return not np.isnan(self.p_value) and max(self.missing, self.unknown) <= SAME_SIGNAL

    def __str__(self) -> str:
        size = f"it leaves {percent(self.part)} of the force"
        if np.isfinite(self.ratio):
            size += f", {self.ratio:.3g} times what the noise of the response makes"
        if self.structured:
            size += (
                f", and {percent(self.missing)} of the force goes with the motion or the"
                f" excitation, most like {self.like} (p = {self.p_value:.1g})"
            )
        elif np.isnan(self.p_value):
            size += "; the points are too few to try what goes with motion or excitation"
        elif not self.explained:
            size += ", too much to tell noise from what is missing"
        if self.explained:
            reach = f"up to the largest amplitude of {self.limit:.3g} {self.unit or '[q]'}"
            return f"The model explains the steady states, {reach}: {size}."
        found = "is good for practice, and something small is missing"
        return f"The model {found if self.good else 'does not explain the steady states'}: {size}."
