"""The force of measured inputs on one coordinate or several, step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from romsindy.physics.coupling import Along
from romsindy.physics.input import Input
from romsindy.physics.term import Term
from romsindy.record.interpolation import Interpolation
from romsindy.record.sampling import checked_signal, uniform_times
from romsindy.typing import Array

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
