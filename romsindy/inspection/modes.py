"""Modes: the same vibration in all releases of a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from romsindy.record.vibrations import Stretch, Vibration
from romsindy.text import span

# Frequencies of one mode in two releases overlap when each range is widened by this part.
_SAME = 0.03


@dataclass(frozen=True, eq=False, repr=False)
class Mode:
    """One vibration of a structure, in every release in which it rings.

    Attributes
    ----------
    number : int
        From 1, by frequency.
    parts : tuple of Vibration or None
        One for each release; None where it does not stand out.
    share : float
        Of the energy of all that vibrates in all releases, its harmonics included: those of all
        modes add up to at most 1.
    """

    number: int
    parts: tuple[Vibration | None, ...]
    share: float

    def __repr__(self) -> str:
        (high, low), (loud, quiet) = self.frequency, self.damping_ratio
        return (
            f"<Mode {self.number}: {high:.5g} Hz loud, {low:.5g} Hz quiet,"
            f" damping {100 * loud:.2g} % loud, {100 * quiet:.2g} % quiet>"
        )

    @property
    def rings(self) -> list[Vibration]:
        """The vibrations, of the releases in which it stands out."""
        return [v for v in self.parts if v is not None]

    @property
    def mean_frequency(self) -> float:
        """Hz, weighted by the energy in the releases."""
        weights = [v.energy for v in self.rings]
        return float(np.average([v.mean_frequency for v in self.rings], weights=weights))

    @property
    def energy(self) -> float:
        """Integral of the displacement^2 over all releases."""
        return float(sum(v.energy for v in self.rings))

    @property
    def steady(self) -> bool:
        """Whether it does not decay while others do: mains hum, a motor, no mode."""
        return all(v.steady for v in self.rings)

    @property
    def harmonics(self) -> tuple[int, ...]:
        """Numbers of the harmonics that stand out."""
        return tuple(sorted({n for v in self.rings for n, _ in (*v.harmonics, *v.carried)}))

    @property
    def ends(self) -> tuple[Stretch, Stretch]:
        """Where its displacement is largest, and least, of all releases."""
        loud = max((v.loud for v in self.rings), key=attrgetter("amplitude"))
        return loud, min((v.quiet for v in self.rings), key=attrgetter("amplitude"))

    @property
    def amplitude(self) -> tuple[float, float]:
        """Largest and least amplitude of the displacement that was followed, unit of q."""
        return self._at_ends("amplitude")

    @property
    def frequency(self) -> tuple[float, float]:
        """Hz at these amplitudes."""
        return self._at_ends("frequency")

    @property
    def hertz(self) -> str:
        """The same in words: "77.57 to 44.74"."""
        return span(*self.frequency, 5)

    @property
    def damping_ratio(self) -> tuple[float, float]:
        """Damping ratio at these amplitudes; NaN where it is lost in scatter."""
        return self._at_ends("damping_ratio")

    def _at_ends(self, name: str) -> tuple[float, float]:
        loud, quiet = (float(getattr(end, name)) for end in self.ends)
        return loud, quiet


def modes_of(releases: Sequence[Sequence[Vibration]]) -> tuple[Mode, ...]:
    """The modes of the vibrations of several releases, by frequency."""
    found: list[list[Vibration | None]] = []
    for i, vibrations in enumerate(releases):
        free = [m for m in found if m[i] is None]
        for v in vibrations:
            same = [m for m in free if m[i] is None and any(_same(v, o) for o in m if o)]
            if not same:
                same = [[None] * len(releases)]
                found += same
            # Of several that overlap, that whose frequency is nearest.
            nearest = min(same, key=lambda m: _apart(v, m))
            nearest[i] = v
    found = [m for m in found if not all(v.faint for v in m if v)]
    ordered = sorted(found, key=lambda m: float(np.mean([v.mean_frequency for v in m if v])))
    whole = sum(vibrations[0].signal for vibrations in releases if vibrations)
    shares = [sum(v.share * v.signal for v in m if v) / whole for m in ordered]
    return tuple(
        Mode(n, tuple(m), s) for n, (m, s) in enumerate(zip(ordered, shares, strict=True), 1)
    )


def _same(one: Vibration, other: Vibration) -> bool:
    low = max(one.frequency.min(), other.frequency.min()) * (1 - _SAME)
    return bool(low < min(one.frequency.max(), other.frequency.max()) * (1 + _SAME))


def _apart(vibration: Vibration, parts: Sequence[Vibration | None]) -> float:
    return min((abs(vibration.mean_frequency - v.mean_frequency) for v in parts if v), default=0.0)
