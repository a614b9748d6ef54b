"""What a diagnosis of a user's own simulator found, in words, tables and files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from romsindy.diagnosis import words
from romsindy.diagnosis.next_test import Advice, MoreOfIt
from romsindy.diagnosis.on_simulator.candidates import PlaceOnStructure
from romsindy.diagnosis.on_simulator.seen import OnSimulator, ValueEffect
from romsindy.diagnosis.structure_report import StructureReport
from romsindy.simulator.force import LawForce
from romsindy.text import left_over, listed, percent


@dataclass(frozen=True, repr=False, kw_only=True)
class SimulatorReport(StructureReport):
    """What a user's own simulator lacks: a `StructureReport` with more.

    Attributes
    ----------
    seen : OnSimulator
        The simulator as it was, with all that it computed.
    missed : float
        What its equation of one coordinate leaves of it, rms over the largest amplitude: it was
        taken off.
    place : PlaceOnStructure or None
        Where what was found acts, where the simulator offers points and all sensors were asked.
    """

    seen: OnSimulator
    missed: float
    place: PlaceOnStructure | None = None

    @cached_property
    def force(self) -> LawForce | None:
        """What was added at the point of its force: a function of t, x and v; None where nothing.

        ``force.code("m")`` is the same in MATLAB, "py" in Python, "c" in C and "mo" in Modelica.
        """
        return self.seen.force(self.parts)

    @property
    def mass(self) -> float:
        """What was added at that point, kg."""
        return self.seen.mass(self.parts)

    @property
    def values(self) -> dict[str, float]:
        """Values of the simulator, those that were found changed."""
        return self.seen.values_with(self.parts)

    @property
    def recipe(self) -> str:
        """What makes the improved simulator: values, and the force in Python."""
        lines = [f"{name} = {value:.6g}" for name, value in self._changed.items()]
        if self.force is not None:
            lines.append(f"force(t, x, v) = {self.force}{self._there}")
        if self.mass:
            lines.append(f"mass = {self.mass:.5g} kg{self._there}")
        lines += [f"not in the simulator: {label}" for label in self.not_there]
        if self.reduced.refused:
            lines.append("the simulator as it was: nothing in the catalogue explains the records")
        if not lines or self.not_there:
            lines.append(f"equation: {self.reduced.model}")
        return "\n".join(lines)

    @property
    def point(self) -> str:
        """Where what was added acts; empty where nothing does, or no points are named."""
        return self.seen.at_point if self.seen.points and self.seen.acts(self.parts) else ""

    @property
    def _there(self) -> str:
        return self.point and f" at {self.point}"

    @property
    def _placed(self) -> dict[str, object] | None:
        """What JSON keeps of where it acts: what is exported acts there, however sure that is."""
        if self.place is not None:
            return self.place.content()
        return {"point": self.point} if self.point else None

    @property
    def _changed(self) -> dict[str, float]:
        """Values that were found changed."""
        names = {p.effect.value_name for p in self.parts if isinstance(p.effect, ValueEffect)}
        return {name: value for name, value in self.values.items() if name in names}

    @property
    def next_test(self) -> Advice | MoreOfIt | None:
        """The test that would best tell apart what these data do not; None where none is needed."""
        return self.reduced.next_test

    @property
    def sentence(self) -> str:
        """The finding in words, what was done to the simulator last."""
        name = self.seen.simulator.name
        lines = [*self.reduced.lines(self._left, self.next_test), self._asked]
        if self.trouble:
            lines.append(f"With this the simulator gave no motion: {self.trouble}.")
        added = [f"{k} = {v:.6g}" for k, v in self._changed.items()]
        if self.force is not None:
            added.append(f"the force {self.force}{self._there}")
        if self.mass:
            added.append(f"a mass of {self.mass:.4g} kg{self._there}")
        if self.place is not None:
            lines.append(f"Place: {self.place}.")
        elif self.point:
            few = len(self.seen.shape) == 1
            why = "sensors at several points would tell where" if few else "no other was found"
            lines.append(f"Place: it is taken to act at {self.point}; {why}.")
        lines += words.within(self.reduced.within)
        if added and self.sensor_errors:
            worst = max(self.sensor_errors, key=lambda e: e.after)
            lines.append(
                f"Added to {name}: {listed(added)}. Its own error in {worst.label} goes from"
                f" {worst.before:.3g} times the noise to {left_over(worst.part, worst.after)}."
            )
        if self.not_there and not self.trouble:
            takes = self.seen.scale is not None
            forces = "it takes forces of x and v, and not all of this is one"
            why = forces if takes else "it takes no force"
            if self.sensor_errors:
                why = "with that it comes no nearer to the records"
            lines.append(
                f"Not added to {name}: {listed(self.not_there)} ({why}); the equation of its"
                " coordinate stands for it."
            )
        return "\n".join(lines)

    @property
    def _asked(self) -> str:
        """What the simulator was asked for."""
        releases = [abs(a.release) for a in self.seen.simulator.computed]
        unit = self.reduced.nominal.unit or "[q]"
        least, most = (f"{x:.3g}" for x in (min(releases), max(releases)))
        reach = f"from {most}" if least == most else f"from {least} to {most}"
        return (
            f"Simulator: {len(self.seen.simulator.computed)} decays {reach}"
            f" {unit}; its equation of one coordinate leaves"
            f" {percent(self.missed)} of the amplitude, which was taken off."
        )

    def _content(self) -> dict[str, Any]:
        return {
            **super()._content(),
            "missed": self.missed,
            "values": self.values,
            "force": None if self.force is None else f"{self.force}",
            "mass": self.mass,
            "place": self._placed,
            "force_laws": None if self.force is None else self.force.content(),
            "releases": [list(pair) for pair in self.seen.released],
        }
