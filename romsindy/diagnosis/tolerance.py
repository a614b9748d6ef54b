"""Differences between simulation and measurement that do not matter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from romsindy.fit.verdict import (
    SAME_DAMPING,
    SAME_FREQUENCY,
    SAME_SIGNAL,
    WIDEST_DAMPING,
    WIDEST_FREQUENCY,
    WIDEST_SIGNAL,
)
from romsindy.typing import Array

KINDS = ("frequency", "damping", "signal")
WIDEST = dict(zip(KINDS, (WIDEST_FREQUENCY, WIDEST_DAMPING, WIDEST_SIGNAL), strict=True))
DEFAULT = "default"
_LEAST = 1e-3  # of the largest amplitude: below, nothing has any weight
_POINTS = 20


@dataclass(frozen=True)
class Tolerance:
    """How large a difference does not matter.

    Attributes
    ----------
    frequency : float
        Of the frequency at equal amplitude, relative.
    damping : float
        Of the damping ratio at equal amplitude, relative.
    signal : float
        Of the waveform: rms as a part of the largest amplitude.
    source : str
        Where it comes from: "default", or "stated", "repeats", "reference", "bands", joined by
        "and".
    sources : mapping of str to str
        Where each comes from by itself, where that is not the same for all.
    undetermined : tuple of (str, str, float)
        Kind, source and size of what was too wide, for records that do not determine it.
    bands : mapping of str to (2, n) array
        Of "frequency" and "damping": amplitudes, and what a model itself is known to there; see
        `over`.
    """

    frequency: float = SAME_FREQUENCY
    damping: float = SAME_DAMPING
    signal: float = SAME_SIGNAL
    source: str = DEFAULT
    sources: Mapping[str, str] = field(default_factory=dict, compare=False)
    undetermined: tuple[tuple[str, str, float], ...] = field(default=(), compare=False)
    bands: Mapping[str, Array] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        for name in KINDS:
            value = getattr(self, name)
            if not _is_size(value):
                raise ValueError(
                    f"tolerance of {name} = {value!r} must be a relative size that is not negative,"
                    " such as 0.001"
                )

    @property
    def stated(self) -> bool:
        """Whether a user said it."""
        return "stated" in self.source.split(" and ")

    def source_of(self, kind: str) -> str:
        """Where the tolerance of "frequency", "damping" or "signal" comes from."""
        return self.sources.get(kind, self.source)

    def or_more(self, other: Tolerance) -> Tolerance:
        """The larger of each, with the sources of both unless one is but the default."""
        larger = {k: self if getattr(self, k) >= getattr(other, k) else other for k in KINDS}
        known = [x for x in dict.fromkeys((self.source, other.source)) if x != DEFAULT]
        return Tolerance(
            **{k: getattr(of, k) for k, of in larger.items()},
            source=" and ".join(known) or DEFAULT,
            sources={k: of.source_of(k) for k, of in larger.items()},
            undetermined=(*self.undetermined, *other.undetermined),
            bands={**self.bands, **other.bands},
        )

    def over(self, low: float, high: float) -> Tolerance:
        """The same for cycles of these amplitudes: more where a model is known less well.

        Louder cycles tell more about a frequency or a damping, in proportion to their power.
        """
        if not self.bands:
            return self
        ends = np.geomspace(max(low, _LEAST * high), high, _POINTS)
        a = np.sqrt(ends[1:] * ends[:-1])
        sizes = dict.fromkeys(KINDS, 0.0)
        for kind, (amplitude, size) in self.bands.items():
            sizes[kind] = float(np.average(np.interp(a, amplitude, size), weights=a**2))
        return replace(self, bands={}).or_more(Tolerance.read_off(sizes, "bands"))

    @classmethod
    def read_off(cls, sizes: Mapping[str, float], source: str) -> Tolerance:
        """What records differ by, no wider than those make it that determine what they tell."""
        narrow = {k: min(size, WIDEST[k]) for k, size in sizes.items()}
        wide = tuple((k, source, size) for k, size in sizes.items() if size > WIDEST[k])
        by_default = {k: DEFAULT for k, *_ in wide}
        return cls(**narrow, source=source, sources=by_default, undetermined=wide, bands={})


def _is_size(value: object) -> bool:
    return isinstance(value, (int, float)) and 0 <= value < float("inf")
