"""What a user's own simulator is asked, and what came: free decays after a release.

A release is one number: the displacement of the first sensor from its equilibrium, in the unit of
the records, from which the structure is let go at rest. The simulator answers with displacements of
all sensors from the equilibrium at given times. How it bends the structure until it is let go, and
what else it simulates, is its own affair.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.interpolate import make_interp_spline

from romsindy.simulator.force import Force
from romsindy.typing import Array

T = TypeVar("T")

_FINE = 60  # samples per cycle that are asked for, at least: what lies between is a spline
_SPLINE = 5
_ENDLESS = 1e12  # times a release: no motion that ends
_OTHER_SCALE = 2.0  # times the release: beyond it the first sensor cannot have been let go there
_SAME = 1e-3  # of the largest displacement: what two equal questions may differ by
_ASKED_TWICE = 200  # samples of the question that is asked twice


class SimulatorError(ValueError):
    """A simulator that gave no motion: what was asked, what came, and what to do."""


class Question(NamedTuple):
    """What a simulator is asked."""

    release: float
    t: Array  # (n,), s, of equal steps from 0
    force: Force | None = None
    values: Mapping[str, float] = MappingProxyType({})  # that are not its own
    point: str | None = None  # where the force and the mass are, of its `points`


@dataclass(frozen=True)
class SimulatedDecay:
    """One simulated decay."""

    release: float  # what was asked, unit of the records
    values: Mapping[str, float]  # that were asked for, where they are not its own
    forced: bool  # whether a force was added
    t: Array  # (n,), s, from the release on
    displacements: Array  # (n, n_sensors)
    point: str | None = None  # where the force and the mass were, if not at its own

    def at(self, t: Array, derivative: int = 0) -> Array:
        """Displacements, or their derivatives, at times within (s), (m, n_sensors)."""
        return np.asarray(self._spline(t, nu=derivative))

    @cached_property
    def _spline(self) -> Any:
        return make_interp_spline(self.t, self.displacements, k=_SPLINE)


@dataclass(frozen=True, eq=False)
class Simulator:
    """A simulator of free decays, and all that it has computed.

    Parameters
    ----------
    simulate : callable
        ``simulate(release, t)`` gives displacements (n,) or (n, n_sensors) at the times t (n,), s,
        of equal steps from 0; ``simulate(release, t, force)`` where a force can be added at a
        point: a function of time, and of displacement and velocity of that point. Values that
        ``parameters`` of `diagnose` name are keywords.
    name : str
        What messages call it.
    computed : list of SimulatedDecay
        It grows, and is kept whatever fails: a question is asked once.
    """

    simulate: Callable[..., Any]
    name: str
    computed: list[SimulatedDecay] = field(default_factory=list)

    @classmethod
    def of(cls, given: Any) -> Simulator:
        """The simulator that a function, or an object with a method ``simulate``, stands for.

        Raises a ValueError for arguments that it cannot be asked with.
        """
        if isinstance(given, Simulator):
            return given
        simulate = given if inspect.isroutine(given) else getattr(given, "simulate", given)
        name = getattr(given, "__name__", "") or type(given).__name__
        found = cls(simulate, name)
        known = found._arguments
        if known is not None and len(known) < 2:
            raise ValueError(
                f"the simulator {name} takes {_listed(known)}: give a function"
                " simulate(release, t), or simulate(release, t, force)"
            )
        return found

    @cached_property
    def _arguments(self) -> tuple[str, ...] | None:
        """Names of what it takes; None where Python does not know."""
        try:
            return tuple(inspect.signature(self.simulate).parameters)
        except (TypeError, ValueError):
            return None

    @property
    def takes_force(self) -> bool:
        """Whether a force can be added."""
        return bool(self._own("takes_force", "force" in (self._arguments or ())))

    @property
    def takes_mass(self) -> bool:
        """Whether a mass can be added at its point, kg: a keyword ``mass``."""
        return bool(self._own("takes_mass", False))

    @property
    def points(self) -> Mapping[str, Array]:
        """Names of points at which a force can be added, and where they are, (3,); often none."""
        return dict(self._own("points", {}))

    @property
    def steps(self) -> Mapping[str, float]:
        """By how much a value may change that is zero, by name."""
        return dict(self._own("steps", {}))

    @property
    def mode_frequencies(self) -> tuple[float, ...]:
        """Of its modes, those that do not ring in it as well, rad/s."""
        known = np.atleast_1d(np.asarray(self._own("mode_frequencies", ()), dtype=float))
        if not np.all(np.isfinite(known) & (known > 0)):
            raise ValueError(f"mode_frequencies of {self.name} = {known} must be positive, rad/s")
        return tuple(known.tolist())

    def right_at(self, values: Mapping[str, float]) -> Simulator | None:
        """The same, where it can be made exact at some values; often it is already."""
        own = self._own("right_at", None)
        try:
            found = None if own is None else own(values)
        except ValueError:  # nothing can be asked at these values: it stays what it is
            return None
        return None if found is None else Simulator.of(found)

    def _own(self, name: str, usual: Any) -> Any:
        """What the object has whose method is asked."""
        return getattr(getattr(self.simulate, "__self__", None), name, usual)

    def check_values(self, names: Sequence[str]) -> None:
        """Raise a ValueError for a value that it does not take."""
        known = self._own("takes_values", None)
        if known is None and (self._arguments is None or self._takes_any):
            return
        own = (k for k in self._arguments or () if k not in ("release", "t", "force", "point"))
        free = list(own if known is None else known)
        for name in names:
            if name not in free:
                raise ValueError(
                    f"parameters name {name!r}, and the simulator {self.name} takes"
                    f" {_listed(free)} beside release and t: give it a value of that name"
                )

    @property
    def _takes_any(self) -> bool:
        try:
            known = inspect.signature(self.simulate).parameters.values()
        except (TypeError, ValueError):
            return True
        return any(p.kind is p.VAR_KEYWORD for p in known)

    def decay(
        self, release: float, t: Array, n_sensors: int, values: Mapping[str, float] | None = None
    ) -> SimulatedDecay:
        """What the simulator gives for a release, at times t (n,).

        Raises a SimulatorError where it gives nothing, other than displacements of ``n_sensors``
        sensors, or another release.
        """
        (answer,) = self.decays([Question(release, t, None, values or {})], n_sensors)
        return whole(answer)

    def decays(
        self, asked: Sequence[Question], n_sensors: int
    ) -> list[SimulatedDecay | SimulatorError]:
        """What it gives for each question, or why nothing; side by side where it can."""
        found: dict[int, SimulatedDecay | SimulatorError] = {
            i: known for i, q in enumerate(asked) if (known := self._known(q)) is not None
        }
        new = [i for i in range(len(asked)) if i not in found]
        for i, x in zip(new, self._motions([asked[i] for i in new]), strict=True):
            q = asked[i]
            try:
                moved = self._checked(q, x, n_sensors)
            except SimulatorError as error:
                found[i] = error
                continue
            forced = q.force is not None
            answer = SimulatedDecay(q.release, dict(q.values), forced, q.t, moved, q.point)
            self.computed.append(answer)
            found[i] = answer
        return [found[i] for i in range(len(asked))]

    def _known(self, q: Question) -> SimulatedDecay | None:
        """An answer that was given: a longer one holds a shorter one."""
        if q.force is not None:
            return None
        for known in self.computed:
            asked = known.release, known.values, known.forced, known.point
            same = asked == (q.release, q.values, False, q.point)
            if same and len(known.t) >= len(q.t) and np.array_equal(known.t[: len(q.t)], q.t):
                return replace(known, t=q.t, displacements=known.displacements[: len(q.t)])
        return None

    def _motions(self, asked: Sequence[Question]) -> Iterator[Any]:
        """What the simulator returns for each question, or the error that it raises."""
        together = self._own("together", None)
        if together is not None:
            yield from together(asked)
            return
        for q in asked:
            beside = {"force": q.force, "point": q.point}
            known = {**q.values, **{name: x for name, x in beside.items() if x is not None}}
            try:
                yield self.simulate(q.release, q.t.copy(), **known)
            except Exception as error:  # whatever a user's own code raises is told
                yield error

    def _checked(self, q: Question, given: Any, n_sensors: int) -> Array:
        """Displacements (n, n_sensors) that were given for a question."""
        asked = self._question(q.release, q.t, q.values)
        if isinstance(given, SimulatorError):
            raise given
        if isinstance(given, Exception):
            raise SimulatorError(
                f"{asked} it raised {type(given).__name__}: {given}. Call it so yourself to see"
                " where; what was computed before is kept"
            ) from given
        try:
            x = np.asarray(given, float)
        except (TypeError, ValueError) as error:
            raise SimulatorError(
                f"{asked} it gave a {type(given).__name__}, which is no array of numbers ({error}):"
                " return displacements (n, n_sensors)"
            ) from error
        x = x[:, None] if x.ndim == 1 else x
        if x.shape != (len(q.t), n_sensors):
            raise SimulatorError(
                f"{asked} it gave an array of shape {np.shape(given)}: return one row for each of"
                f" the {len(q.t)} times, and one column for each of the {n_sensors} channels of the"
                " records"
            )
        astray = ~np.all(np.abs(x) < _ENDLESS * abs(q.release), axis=1)
        if np.any(astray):
            first = float(q.t[int(np.argmax(astray))])
            raise SimulatorError(
                f"{asked} it gave NaN or infinity, or nearly, from {first:.4g} s on: take smaller"
                " steps in it, or a tighter tolerance of its solver"
            )
        self._check_release(asked, q.release, x)
        return x

    def _check_release(self, asked: str, release: float, x: Array) -> None:
        """Refuse a motion that does not begin at its release."""
        first, largest = float(x[0, 0]), float(np.abs(x[:, 0]).max())
        if largest == 0:
            raise SimulatorError(f"{asked} nothing moves: let the structure go from the release")
        ratio = first / release
        if 1 / _OTHER_SCALE < ratio < _OTHER_SCALE:
            return
        if 1 / _OTHER_SCALE < -ratio < _OTHER_SCALE:
            raise SimulatorError(
                f"{asked} the first sensor begins at {first:.4g}: of the other sign; turn the sign"
                " of what it gives, or of the records"
            )
        raise SimulatorError(
            f"{asked} the first sensor begins at {first:.4g}, {abs(ratio):.3g} times the release"
            f" (largest {largest:.4g}): a release is the displacement of the first sensor at t ="
            " 0, from the equilibrium and in the unit of the records; check units (mm and m) and"
            " the order of the channels"
        )

    def _question(self, release: float, t: Array, values: Mapping[str, float]) -> str:
        """What was asked, as messages begin."""
        own = "".join(f", {name} = {value:.6g}" for name, value in values.items())
        return (
            f"simulator {self.name}, release = {release:.6g}{own}, t = 0 to {t[-1]:.6g} s in"
            f" {len(t)} times:"
        )

    def check_again(
        self, release: float, t: Array, n_sensors: int, values: Mapping[str, float]
    ) -> None:
        """Ask the beginning of a decay a second time.

        Raises a SimulatorError if another motion comes.
        """
        part = t[:_ASKED_TWICE]
        first = self.decay(release, t, n_sensors, values=values).displacements[: len(part)]
        question = Question(release, part, None, values)
        (again,) = (self._checked(question, x, n_sensors) for x in self._motions([question]))
        apart = float(np.abs(first - again).max())
        if apart > _SAME * float(np.abs(first).max()):
            raise SimulatorError(
                f"{self._question(release, part, values)} asked twice, the answers are {apart:.3g}"
                " apart: a simulator must give the same each time; take noise and random numbers"
                " out of it, or fix their seed"
            )


def whole(answer: T | Exception) -> T:
    """What was simulated; raises the error that came in its place."""
    if isinstance(answer, Exception):
        raise answer
    return answer


def times(duration: float, step: float, frequency: float) -> Array:
    """Times (n,) of equal steps from 0 beyond a duration (s), fine enough for a spline.

    ``step`` (s) is that of the records, ``frequency`` (rad/s) that of the vibration.
    """
    parts = max(int(np.ceil(step * _FINE * frequency / (2 * np.pi))), 1)
    n = int(np.ceil(duration * parts / step)) + _SPLINE + 1
    return step / parts * np.arange(n)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "nothing"
