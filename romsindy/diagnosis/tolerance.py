"""Differences between simulation and measurement that do not matter."""

from __future__ import annotations

from dataclasses import dataclass, replace

from romsindy.fit.verdict import SAME_DAMPING, SAME_FREQUENCY, SAME_SIGNAL

KINDS = ("frequency", "damping", "signal")
DEFAULT = "default"


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
        Where it comes from: "default", or "stated", "repeats", "reference", joined by "and".
    """

    frequency: float = SAME_FREQUENCY
    damping: float = SAME_DAMPING
    signal: float = SAME_SIGNAL
    source: str = DEFAULT

    def __post_init__(self) -> None:
        for name in KINDS:
            value = getattr(self, name)
            if not _is_size(value):
                raise ValueError(
                    f"tolerance of {name} = {value!r} must be a relative size that is not negative,"
                    " such as 0.001"
                )

    def or_more(self, other: Tolerance) -> Tolerance:
        """The larger of each, with the sources of both unless one is but the default."""
        larger = {k: max(getattr(self, k), getattr(other, k)) for k in KINDS}
        known = [x for x in dict.fromkeys((self.source, other.source)) if x != DEFAULT]
        return replace(self, **larger, source=" and ".join(known) or DEFAULT)


def _is_size(value: object) -> bool:
    return isinstance(value, (int, float)) and 0 <= value < float("inf")
