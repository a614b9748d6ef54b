"""Structures of an equation, from a linear oscillator up, and the simplest that the data allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from romsindy.fit.functions.series import Series, Sizes
from romsindy.fit.verdict import EQUIVALENT
from romsindy.physics.validation import made, several, whole

# So many polynomials resolve features down to a tenth of the range; the prior decides how many
# count. The inertia is smoother than the stiffness, of which it is a sum of squared slopes.
RICHEST = Sizes(stiffness=17, inertia=11, damping=8)
_STIFFNESS = {True: "stiffness polynomial", False: "linear"}


@dataclass(frozen=True)
class Structure:
    """Which functions an equation has, and what the data say of it."""

    sizes: Sizes
    forces: tuple[str, ...] = ()  # names of further damping forces
    log_evidence: float = 0.0  # over that of the best structure, 0 or less

    @classmethod
    def from_content(cls, name: str, value: Any) -> Structure:
        """Read what `dataclasses.asdict` wrote, after JSON, from where messages say it stands."""
        return made(cls, name, value, {"Sizes": _sizes})

    @property
    def name(self) -> str:
        """ "linear", "stiffness polynomial" or "IC-ROM"."""
        return "IC-ROM" if self.sizes.inertia else _STIFFNESS[self.sizes.stiffness > 1]

    @property
    def damping(self) -> str:
        """What its damping is."""
        follows = " that follows the inertia" if self.sizes.inertia else ""
        kind = "damping a function of q" if self.sizes.damping else f"linear damping{follows}"
        return ", ".join([kind, *self.forces])

    @property
    def equivalent(self) -> bool:
        """Whether the data cannot tell it from the best."""
        return -2 * self.log_evidence <= EQUIVALENT

    def __str__(self) -> str:
        return f"{self.name}, {self.damping}"


def _sizes(name: str, value: Any) -> Sizes:
    sizes = several(whole)(name, value)
    if len(sizes) != 3 or min(sizes) < 0:
        raise ValueError(f"{name} = {list(sizes)!r:.60} must be three numbers of at least 0")
    return Sizes(*sizes)


def simpler(series: Series) -> list[Series]:
    """The same equation with fewer functions, from all but the whole down to a linear one."""
    whole = series.sizes
    sizes = [
        Sizes(stiffness, inertia, damping)
        for stiffness, inertia in ((whole.stiffness, whole.inertia), (whole.stiffness, 0), (1, 0))
        for damping in (whole.damping, 0)
    ]
    return [series.narrowed(s) for s in sizes[1:]]


def contains(more: Sizes, less: Sizes) -> bool:
    """Whether one structure has all functions of another."""
    return all(a >= b for a, b in zip(more, less, strict=True))


def compared(structures: Sequence[Structure]) -> tuple[Structure, ...]:
    """The same with their evidence over that of the best."""
    best = max(s.log_evidence for s in structures)
    return tuple(replace(s, log_evidence=s.log_evidence - best) for s in structures)
