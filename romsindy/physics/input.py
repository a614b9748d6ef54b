"""A measured input in the equation of motion: a force, or the acceleration of the base."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from romsindy.physics.coupling import Along
from romsindy.physics.term import Scalars, Term, WeakForm, exact, power_of, unit_text
from romsindy.record.interpolation import (
    INTERPOLATIONS,
    Interpolation,
    interpolated,
    is_base,
    require_input,
)
from romsindy.record.recording import checked_signal, uniform_times
from romsindy.typing import Array

# Name of the coefficient: what stands on the right is the gain times a force, or minus the
# participation factor times an acceleration of the base.
_GAIN, _PARTICIPATION = "gain", "Gamma"
_KEY = re.compile(rf"(?:{_GAIN}|{_PARTICIPATION}) \[([^\[\]]+)\](?:\^([1-9]\d*))?")


@dataclass(frozen=True)
class Input(Term):
    """What an input adds: nothing to the free motion, and its samples, late, to the right side.

    Of a shaker that is not ideal, what is left of them after a lag acts, or a power of them as
    well, which is a term of its own.

    Parameters
    ----------
    source : str
        "force" or "base"; of several of a kind "force 2", ...
    interpolation : "band-limited", "linear" or "hold"
        What it does between its samples.
    delay : float
        By which it acts later than it was measured, s.
    input_unit : str, optional
        Of its samples.
    lag : float
        Time constant of a first-order lag, s: of the input u, x acts, lag x' + x = u.
    power : int
        With which it acts: u^power, or x^power.

    Raises
    ------
    ValueError
        For another source, another way between samples, a lag below 0 or a power below 1.
    """

    source: str = "force"
    interpolation: Interpolation = "band-limited"
    delay: float = 0.0
    input_unit: str | None = None
    lag: float = 0.0
    power: int = 1

    def __post_init__(self) -> None:
        require_input(self.source)
        if self.interpolation not in INTERPOLATIONS:
            raise ValueError(
                f"interpolation = {self.interpolation!r} must be one of {INTERPOLATIONS}"
            )
        if not 0 <= self.lag < math.inf:
            raise ValueError(f"lag = {self.lag!r} must be a time in s, 0 where there is none")
        if not (isinstance(self.power, int) and self.power >= 1):
            raise ValueError(f"power = {self.power!r} must be a whole number, 1 or more")

    @property
    def key(self) -> str:
        return self.raised(f"{_PARTICIPATION if is_base(self.source) else _GAIN} [{self.source}]")

    @property
    def signal(self) -> str:
        """What acts of the source: "force", or "force^3"."""
        return self.raised(self.source)

    @property
    def dimension(self) -> tuple[float, float]:
        return 0.0, 0.0

    @property
    def sign(self) -> int:
        """With which it stands on the right side: a base that goes up leaves the mass behind."""
        return -1 if is_base(self.source) else 1

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        text = self.called(float(f"{self.delay:.4g}"))
        return self.raised(f"({text}/(1 + {self.lag:.4g} d/dt))" if self.lag else text)

    @property
    def name(self) -> str:
        """The source as a name in code."""
        return self.source.replace(" ", "_")

    def called(self, delay: float) -> str:
        """Text of the input as a function of time, late by a delay (s)."""
        late = f" {'-' if delay > 0 else '+'} {exact(abs(delay))}" if delay else ""
        return f"{self.name}(t{late})"

    @classmethod
    def from_key(cls, key: str) -> Input | None:
        match = _KEY.fullmatch(key)
        term = cls(match[1], power=int(match[2] or 1)) if match else None
        return term if term is not None and term.key == key else None

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        """Nothing: the free motion has no input."""
        return WeakForm()

    def unit(self, unit: str | None) -> str:
        """Unit of the coefficient when q is measured in ``unit``; that of its delay is s."""
        length = unit or "[q]"
        if is_base(self.source) and self.input_unit in (None, f"{unit}/s^2"):
            return unit_text({length: 1 - self.power, "s": -2 * (1 - self.power)})
        powers = {length: 1.0, "s": -2.0}
        powers[self.input_unit or "[input]"] = powers.get(self.input_unit or "", 0.0) - self.power
        return unit_text(powers)

    def at(self, u: Array, place: Array, dt: float) -> Array:
        """What acts, were there no delay, at places counted in samples (n,), ``dt`` (s) apart."""
        return power_of(interpolated(u, place, self.interpolation, self.lag / dt), self.power)

    def raised(self, text: str) -> str:
        """Text of something, with the power."""
        return text if self.power == 1 else f"{text}^{self.power}"


Excitation = ArrayLike | Callable[[float], ArrayLike]
Push = Callable[[float], Any]

# Within a step samples become a polynomial through so many places: up to the Nyquist frequency it
# misses a sine by 2 (pi / 4)^12 / 12! = 2e-10 of it. What fades with a lag of a twentieth of a
# sample moves an oscillator right to 1e-6, with one of a fiftieth to 1e-4.
_PLACES = np.cos(np.pi * (np.arange(12) + 0.5) / 12)
_POLYNOMIAL = np.linalg.inv(np.vander(_PLACES)).T


def input_in(term: Term) -> Input | None:
    """The input that a term is, or that it lets act along a direction; None if it is none."""
    law = term.law if isinstance(term, Along) else term
    return law if isinstance(law, Input) else None


class Forcing:
    """What inputs do to a model over uniform times.

    Parameters
    ----------
    inputs : sequence of (Input, float or (R,) array)
        With their coefficients, a number or one for each coordinate; of k sources.
    u : (n,) or (n, k) array, or callable
        Samples at the times, or a function of time that gives a number, or k of them.
    t : (n,) array

    Raises
    ------
    ValueError
        For no inputs, times that jitter, samples that do not fit, or a function of time where an
        input has a lag.
    """

    def __init__(
        self, inputs: Sequence[tuple[Input, float | Array]], u: Excitation, t: Array
    ) -> None:
        if not inputs:
            raise ValueError(
                "u is given, and the model has no input: add one to its coefficients, such as"
                " 'gain [force]', or leave u out"
            )
        self.inputs, self.function = inputs, u if callable(u) else None
        self.sources = list(dict.fromkeys(term.source for term, _ in inputs))
        lagging = [term for term, _ in inputs if term.lag]
        if callable(u) and lagging:
            raise ValueError(
                f"u is a function of time, and {lagging[0].key!r} has a lag of"
                f" {lagging[0].lag:g} s: give its samples at the times t"
            )
        self.t, jitter = uniform_times(t)
        if jitter:
            raise ValueError(f"{jitter.split(':')[0]}: under inputs it must be, as numpy.arange")
        samples = [self._called(now) for now in self.t] if callable(u) else u
        self.u = checked_signal("u", samples, len(t)).reshape(len(t), -1)
        if self.u.shape[1] != len(self.sources):
            raise ValueError(
                f"u has {self.u.shape[1]} columns, and the model the inputs {self.sources}: give"
                " one column for each"
            )

    def __call__(self, times: Array) -> Array:
        """The force, (m,) or (m, R), at times (m,); where it jumps, that after the jump."""
        found = np.zeros((len(times), *np.shape(self.inputs[0][1])))
        for term, value in self.inputs:
            found += np.multiply.outer(self._acting(term, times - term.delay), term.sign * value)
        return found

    def steps(self) -> Iterator[tuple[float, Push]]:
        """The end of each step, and the force in it; samples neither jump nor bend there."""
        edges = self._edges()
        if self.function is not None:
            yield from ((end, lambda now: self(np.array([now]))[0]) for end in edges[1:])
            return
        middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
        places = middle[:, None] + half[:, None] * _PLACES
        force = self(places.ravel())
        force = force.reshape(*places.shape, *force.shape[1:])
        rows = np.moveaxis(np.tensordot(force, _POLYNOMIAL, (1, 0)), -1, 1)
        plain = rows.tolist() if rows.ndim == 2 else rows  # floats are ten times faster
        for end, m, h, row in zip(edges[1:], middle, half, plain, strict=True):
            yield end, _polynomial(m, h, row)

    @property
    def interpolation(self) -> Interpolation | None:
        """Of all samples, where they have one."""
        ways = {term.interpolation for term, _ in self.inputs}
        return ways.pop() if len(ways) == 1 and self.function is None else None

    def _edges(self) -> Array:
        """Times of samples, and those at which samples act."""
        acting = [self.t + term.delay for term, _ in self.inputs]
        edges = np.unique(np.concatenate([self.t, *acting]).clip(self.t[0], self.t[-1]))
        return edges[np.diff(edges, prepend=-np.inf) > 1e-9 * (self.t[1] - self.t[0])]

    def _acting(self, term: Input, times: Array) -> Array:
        column = self.sources.index(term.source)
        if self.function is not None:
            return np.array([self._called(now)[column] for now in times]) ** term.power
        dt = self.t[1] - self.t[0]
        return term.at(self.u[:, column], (times - self.t[0]) / dt, dt)

    def _called(self, now: float) -> Array:
        assert self.function is not None
        return np.atleast_1d(np.asarray(self.function(float(now)), float))


def _polynomial(middle: float, half: float, row: Sequence[Any]) -> Push:
    """Powers of the place in a step, from -1 to 1, the highest first."""

    def push(now: float) -> Any:
        place, found = (now - middle) / half, 0.0
        for c in row:
            found = found * place + c
        return found

    return push
