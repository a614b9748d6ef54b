"""What a sensor gave: channels sampled together, before any analysis."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from romsindy.record.drive import Drive
from romsindy.record.sampling import as_floats, as_seconds, part_between
from romsindy.typing import Array

Quantity = Literal["displacement", "velocity", "acceleration"]
QUANTITIES: tuple[Quantity, ...] = ("displacement", "velocity", "acceleration")

# Of the usual step: a longer one is a gap.
GAP = 1.5


def unit_of(quantity: Quantity, unit: str | None) -> str:
    """Unit of a quantity where q has a unit."""
    return (unit or "[q]") + ("", "/s", "/s^2")[QUANTITIES.index(quantity)]


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """Channels sampled together, as they were measured.

    Unlike a `Decay` it may hold anything: the blow, several releases, gaps in time, samples that
    are missing (NaN), several vibrations at once. `romsindy.inspect` says what is in it.

    Parameters
    ----------
    t : (n,) array
        Time in s, increasing; it may have gaps.
    x : (n,) or (n, m) array
        What the sensors gave, in SI units; NaN, or masked, where a sample is missing. Kept as
        (n, m).
    names : sequence of str, optional
        Of the m channels; "1", "2", ... by default.
    quantity : "displacement", "velocity" or "acceleration"
        What all channels measured.
    unit : str, optional
        SI unit of the displacement q, such as "m" or "rad"; None where it is not known. A velocity
        is in unit/s, an acceleration in unit/s^2.
    basis : str
        What quantity and unit rest on, for the reader: "header 'v [mm/s]'", "--unit m/s".
    source : str
        Name of the file, for messages.
    notes : tuple of str
        What was done to the record, for the reader.
    drives : tuple of Drive
        Inputs that were measured with it.

    Raises
    ------
    ValueError
        For time that is not finite or does not increase, and shapes that do not fit.
    """

    t: Array
    x: Array
    names: Sequence[str] = ()
    quantity: Quantity = "displacement"
    unit: str | None = None
    basis: str = ""
    source: str = ""
    notes: tuple[str, ...] = ()
    drives: tuple[Drive, ...] = ()

    def __post_init__(self) -> None:
        t, x = as_seconds("t", self.t), as_floats("x", self.x)
        x = x[:, None] if x.ndim == 1 else x
        if t.ndim != 1 or len(t) < 8:
            raise ValueError(
                f"t must be one-dimensional with at least 8 samples, got shape {t.shape}: give more"
                " of the record"
            )
        if x.ndim != 2 or len(x) != len(t) or x.shape[1] == 0:
            raise ValueError(f"x must have shape ({len(t)},) or ({len(t)}, m), got {x.shape}")
        if self.quantity not in QUANTITIES:
            raise ValueError(f"quantity = {self.quantity!r} must be one of {QUANTITIES}")
        steps = np.diff(t)
        bad = np.flatnonzero(~(steps > 0))
        if len(bad):
            i = int(bad[0])
            raise ValueError(
                f"t must increase, but after sample {i + 1} it goes from {t[i]:.9g} to"
                f" {t[i + 1]:.9g} s: sort the samples or remove the repeated ones"
            )
        names = tuple(self.names) or tuple(str(i + 1) for i in range(x.shape[1]))
        if len(names) != x.shape[1]:
            raise ValueError(f"names = {names} are not the names of {x.shape[1]} channels")
        for name, value in {"t": t, "x": x, "names": names}.items():
            object.__setattr__(self, name, value)

    @property
    def dt(self) -> float:
        """Usual sampling interval, s."""
        usual = float(np.median(np.diff(self.t)))
        mean = float(self.t[-1] - self.t[0]) / (len(self.t) - 1)
        # Digits of times are rounded: the mean is exact, but counts gaps.
        return mean if abs(mean - usual) < 0.01 * usual else usual

    @property
    def signal_unit(self) -> str:
        """Unit of the samples."""
        return unit_of(self.quantity, self.unit)

    @property
    def driven(self) -> bool:
        """Whether a measured input drives it all along: it is no free decay."""
        return any(drive.lasting for drive in self.drives)

    @cached_property
    def pieces(self) -> list[slice]:
        """Samples between gaps in time."""
        ends = np.flatnonzero(np.diff(self.t) > GAP * self.dt) + 1
        edges = [0, *ends.tolist(), len(self.t)]
        return [slice(a, b) for a, b in itertools.pairwise(edges)]

    def channel(self, *names: str) -> Recording:
        """These channels alone.

        Raises
        ------
        ValueError
            If there is no channel of that name.
        """
        for name in names:
            if name not in self.names:
                raise ValueError(
                    f"{self.source or 'the record'} has no channel {name!r}, but {self.names}"
                )
        columns = [list(self.names).index(name) for name in names]
        return replace(self, x=self.x[:, columns], names=names)

    def between(self, start: float | None = None, end: float | None = None) -> Recording:
        """The part with start <= t <= end, in s; None leaves an end as it is.

        Raises
        ------
        ValueError
            If fewer than eight samples are left.
        """
        part = part_between(self.t, start, end)
        return replace(self, t=self.t[part], x=self.x[part])

    def __repr__(self) -> str:
        size = f"{len(self.t)} samples at {1 / self.dt:.6g} Hz, {self.t[-1] - self.t[0]:.4g} s"
        channels = f"channels {', '.join(self.names)}"
        return f"<Recording: {size}, {self.quantity} in {self.signal_unit}, {channels}>"
