"""What drives a beam: forces on it, and the acceleration of its base, as histories in time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from romsindy.beam.assembly import Assembly
from romsindy.beam.structure import TRANSVERSE
from romsindy.physics.validation import unit_vector

Function: TypeAlias = Callable[[np.ndarray], ArrayLike]
InTime: TypeAlias = Function | tuple[ArrayLike, ArrayLike]


class _Driver(ABC):
    """A history, and the nodal load of its unit."""

    history: InTime
    direction: tuple[float, float]
    name: ClassVar[str]

    def __post_init__(self) -> None:
        unit_vector(self.direction)
        self._function  # noqa: B018  a bad history is refused where it is given

    @abstractmethod
    def load(self, assembly: Assembly) -> np.ndarray:
        """Return the nodal load of a history of 1, (n_nodes, 3)."""

    @cached_property
    def _function(self) -> Function:
        if callable(self.history):
            return self.history
        if not isinstance(self.history, tuple | list) or len(self.history) != 2:
            remedy = "a function of time, such as lambda t: np.sin(60 * t), or samples (t, values)"
            if isinstance(self.history, _Driver):
                remedy = f"it as {self.history.name}="
            kind = type(self.history).__name__
            raise TypeError(f"{self.name} is a {kind}: give {remedy}")
        return partial(_between, _spline(self.name, *self.history))

    def values(self, t: np.ndarray) -> np.ndarray:
        """Return the history at the times t, (n,).

        Raises a TypeError for a function that does not take an array of times, and a ValueError for
        values that are not finite or not one for each time, or times without samples.
        """
        try:
            values = np.asarray(self._function(t), float)
        except (TypeError, ValueError) as error:
            raise TypeError(
                f"{self.name} cannot be asked at an array of times ({error}): write it with"
                " numpy's functions, such as np.sin and np.where"
            ) from error
        if values.shape not in ((), t.shape):
            raise ValueError(
                f"{self.name} has values of shape {values.shape} at {len(t)} times: give one"
                f" number for each, {t.shape}"
            )
        values = np.broadcast_to(values, t.shape)
        if not np.all(np.isfinite(values)):
            i = np.argmin(np.isfinite(values))
            raise ValueError(
                f"{self.name} is {values[i]} at t = {t[i]:g} s: give finite values from 0 to the"
                " end of the duration; samples must cover all of that"
            )
        return values


@dataclass(frozen=True, eq=False)
class PointForce(_Driver):
    """A force at a point of a beam that changes in time and keeps its direction.

    Parameters
    ----------
    history : callable, or pair of (n,) arrays
        Force, N, of an array of times, s; or samples (t, force), which a cubic spline joins.
    at : float, optional
        Position on the undeformed axis, m; None is the right end.
    direction : tuple of two float
        (x, y), of any length; (0, 1) is transverse, (1, 0) axial.

    Raises
    ------
    TypeError
        For a history that is neither function nor samples.
    ValueError
        For a direction of length zero, samples that are not finite or not as many as times, or
        times that do not increase.

    Examples
    --------
    >>> from romsindy import Beam
    >>> beam, shaker = Beam.cantilever(elements=4), PointForce(lambda t: np.sin(60 * t), at=0.2)
    >>> motion = beam.simulate(duration=0.05, force=shaker, sensors=beam.sensors([0.45]))
    >>> f"{1e3 * motion.sensors.displacement[-1, 0]:.1f} mm"
    '8.1 mm'
    """

    history: InTime
    at: float | None = None
    direction: tuple[float, float] = TRANSVERSE
    name = "force"

    def load(self, assembly: Assembly) -> np.ndarray:
        """Return the nodal load of 1 N, (n_nodes, 3).

        Raises
        ------
        ValueError
            For a point off the beam, or one that is held in this direction.
        """
        load = assembly.point_load(unit_vector(self.direction), at=self.at)
        load[assembly.fixed] = 0.0
        if not np.any(load):
            raise ValueError(
                f"force acts at = {assembly.place(self.at).s:g} m, where the beam is held in"
                f" direction {self.direction}: give PointForce(history, at=...) between supports"
            )
        return load


@dataclass(frozen=True, eq=False)
class BaseAcceleration(_Driver):
    """The acceleration of all that holds a beam: its supports and the anchors of its springs.

    The motion is then relative to the base, in whose frame the inertial force -rho A a(t) acts
    along the beam and -m a(t) on point masses.  All damping, that of air too, feels speeds
    relative to the base.

    Parameters
    ----------
    history : callable, or pair of (n,) arrays
        Acceleration, m/s^2, of an array of times, s; or samples (t, acceleration), which a cubic
        spline joins.
    direction : tuple of two float
        (x, y), of any length; (0, 1) is transverse, (1, 0) axial.

    Raises
    ------
    TypeError, ValueError
        As `PointForce` does.

    Examples
    --------
    >>> from romsindy import Beam
    >>> beam, table = Beam.cantilever(elements=4), BaseAcceleration(lambda t: 2 * np.sin(60 * t))
    >>> motion = beam.simulate(duration=0.05, base=table, sensors=beam.sensors([0.45]))
    >>> f"{1e3 * motion.sensors.displacement[-1, 0]:.1f} mm"
    '-1.9 mm'
    """

    history: InTime
    direction: tuple[float, float] = TRANSVERSE
    name = "base"

    def load(self, assembly: Assembly) -> np.ndarray:
        """Return the nodal load of 1 m/s^2, (n_nodes, 3)."""
        translation = np.broadcast_to([*unit_vector(self.direction), 0.0], assembly.fixed.shape)
        return np.where(assembly.fixed, 0.0, -assembly.mass_times(translation))


class Excitation:
    """All that drives a beam: the nodal load sum_k f_k(t) p_k, whatever the beam does.

    A force that is a history alone acts transversely at the right end, a base transversely. Raises
    what `PointForce` and its `load` do.
    """

    def __init__(
        self,
        assembly: Assembly,
        force: PointForce | InTime | Sequence[PointForce | InTime] | None = None,
        base: BaseAcceleration | InTime | None = None,
    ) -> None:
        self._forces = () if force is None else _as_forces(force)
        self._base = base if isinstance(base, BaseAcceleration | None) else BaseAcceleration(base)
        self._inputs = (*self._forces, *([self._base] if self._base else []))
        self._loads = np.zeros((len(self._inputs), assembly.n_nodes, 3))
        for i, given in enumerate(self._inputs):
            self._loads[i] = given.load(assembly)

    def load(self, t: np.ndarray) -> np.ndarray:
        """Return the nodal load at the times t, (n, n_nodes, 3), N and N m."""
        values = np.array([given.values(t) for given in self._inputs]).reshape(-1, len(t))
        return np.einsum("kt,knc->tnc", values, self._loads)

    def force(self, t: np.ndarray) -> np.ndarray | None:
        """Return the force at the times t, N: (n,) of one, (n, n_forces) of several, else None."""
        columns = [f.values(t) for f in self._forces]
        if len(columns) < 2:
            return columns[0] if columns else None
        return np.column_stack(columns)

    def base(self, t: np.ndarray) -> np.ndarray | None:
        """Return the acceleration of the base at the times t, (n,), m/s^2, if it moves."""
        return self._base.values(t) if self._base else None


def _as_forces(force: Any) -> tuple[PointForce, ...]:
    several = isinstance(force, Sequence) and any(
        isinstance(f, PointForce) or callable(f) for f in force
    )
    forces = force if several else [force]
    return tuple(f if isinstance(f, PointForce) else PointForce(f) for f in forces)


def _spline(name: str, times: ArrayLike, samples: ArrayLike) -> CubicSpline:
    t, values = np.asarray(times, float), np.asarray(samples, float)
    if t.ndim != 1 or len(t) < 2 or values.shape != t.shape:
        raise ValueError(
            f"{name} has times of shape {t.shape} and samples of shape {values.shape}: give as many"
            " of both, (n,), two at least"
        )
    if not (np.all(np.isfinite(t)) and np.all(np.isfinite(values))):
        raise ValueError(f"{name} has samples that are not finite: leave these out, with their t")
    if np.any(np.diff(t) <= 0.0):
        i = int(np.argmax(np.diff(t) <= 0.0))
        raise ValueError(
            f"{name} has times that do not increase, {t[i]:g} s and then {t[i + 1]:g} s: sort the"
            " samples and leave out what comes twice"
        )
    return CubicSpline(t, values)


def _between(spline: CubicSpline, t: np.ndarray) -> np.ndarray:
    """Return the spline at the times t, NaN beyond its samples."""
    start, end = spline.x[[0, -1]]
    inside = np.clip(t, start, end)
    # the end of the last step may be off by rounding
    reached = np.abs(inside - t) <= 1e-9 * (end - start)
    return np.where(reached, spline(inside), np.nan)
