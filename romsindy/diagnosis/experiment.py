"""Tests that could be made next, what they cost, and the advice to make one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from romsindy.fit.verdict import EQUIVALENT


@dataclass(frozen=True)
class Experiment:
    """A test that could be made: the largest release so far with something changed.

    Attributes
    ----------
    words : str
        What to do; "{amplitude}" stands for the amplitude of the release.
    cost : float
        In repetitions of that release.
    amplitude : float
        Of the release over the largest so far; negative for one to the other side.
    duration, noise : float
        Of the record and of its noise over those of the largest.
    repetitions : int
    wait : float
        From the end of the last record so far on, in lengths of the largest, where all records
        share one clock.
    """

    words: str
    cost: float
    amplitude: float = 1.0
    duration: float = 1.0
    noise: float = 1.0
    repetitions: int = 1
    wait: float = 1.0

    def action(self, largest: float, unit: str | None) -> str:
        """What to do, in words, where the largest release so far had this amplitude."""
        size = f"{abs(self.amplitude) * largest:.2g} {unit or ''}".rstrip()
        return self.words.format(amplitude=size)


EXPERIMENTS = (
    Experiment("the same release again", 1.0),
    Experiment("a release to the other side", 1.0, amplitude=-1.0),
    Experiment("a decay from {amplitude}", 1.0, amplitude=0.5),
    Experiment("a decay from {amplitude}", 1.0, amplitude=1.5),
    Experiment("the same release twice more", 2.0, repetitions=2),
    Experiment("a record twice as long", 2.0, duration=2.0),
    Experiment("the same release after ten times the length of a record", 2.0, wait=10.0),
    Experiment("a decay from {amplitude}", 2.0, amplitude=2.0),
    Experiment("the same release four times more", 4.0, repetitions=4),
    Experiment("the same release with a sensor of a third of the noise", 4.0, noise=1 / 3),
    Experiment("a decay from {amplitude}", 4.0, amplitude=3.0),
)


@dataclass(frozen=True)
class Advice:
    """The test to make next.

    Attributes
    ----------
    test : Experiment
    action : str
        What to do, in words.
    odds : float
        Expected of the right rival against the next, once the test is made: they come out higher
        in three of four cases, whichever is right. No more than 1000 are promised.
    rivals : tuple of str
        What it is to tell apart, the best first.
    explained : bool
        Whether they explain the data so far.
    otherwise : tuple of str
        What the effects themselves advise, for where no simulated test tells enough.
    """

    test: Experiment
    action: str
    odds: float
    rivals: tuple[str, ...]
    explained: bool
    otherwise: tuple[str, ...] = ()

    @property
    def cost(self) -> float:
        """In repetitions of the largest release so far."""
        return self.test.cost

    @property
    def enough(self) -> bool:
        """Whether the rivals are expected to be told apart."""
        return bool(2 * np.log(self.odds) >= EQUIVALENT)

    @property
    def sentence(self) -> str:
        """The advice in words, to follow "Next: "."""
        *others, last = self.rivals
        expected = f"(expected odds {float(f'{self.odds:.2g}'):g} : 1)"
        if self.explained:
            aim = f"separate {', '.join(others)} {'and' if len(others) > 1 else 'from'} {last}"
        else:
            aim = f"show whether what is missing is nearer to {', '.join(others)} or {last}"
        if self.enough:
            return f"{self.action} would {aim} {expected}."
        best = f"the best of them is {self.action} {expected}"
        beside = f"; what may: {', or '.join(self.otherwise)}" if self.otherwise else ""
        return f"no test that was simulated would {aim}; {best}{beside}."
