"""Differences between simulation and measurement that do not matter."""

from __future__ import annotations

from dataclasses import dataclass, fields

from romsindy.fit.verdict import SAME_DAMPING, SAME_FREQUENCY, SAME_SIGNAL

KINDS = ("frequency", "damping", "signal")


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
        Where it comes from: "default", "stated", "repeats" or "reference".
    """

    frequency: float = SAME_FREQUENCY
    damping: float = SAME_DAMPING
    signal: float = SAME_SIGNAL
    source: str = "default"

    def __post_init__(self) -> None:
        for name in KINDS:
            value = getattr(self, name)
            if not _is_size(value):
                raise ValueError(
                    f"tolerance of {name} = {value!r} must be a relative size that is not negative,"
                    " such as 0.001"
                )

    def or_more(self, other: Tolerance) -> Tolerance:
        """The larger of each, with the source of the other."""
        larger = {k: max(getattr(self, k), getattr(other, k)) for k in KINDS}
        return Tolerance(**larger, source=other.source)

    def __str__(self) -> str:
        values = ", ".join(
            f"{100 * getattr(self, f.name):.2g} % in {f.name}"
            for f in fields(self)
            if f.name != "source"
        )
        return f"{values} ({self.source})"


def _is_size(value: object) -> bool:
    return isinstance(value, (int, float)) and 0 <= value < float("inf")
