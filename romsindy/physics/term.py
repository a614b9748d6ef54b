"""What an equation of motion is made of: the contract of a term.

Every model of this package is a sum of terms, each with its coefficient::

    M(q) q_ddot + N(q) q_dot^2 + K(q) + D(q, q_dot) = 0,      M(0) = 1

A `Term` says what it adds to inertia M, convection N, stiffness K and damping D. From these four
follow the strong form, energies, simulation, and the load on a beam; the weak form is stated beside
them.

Notation as in [1], eqs. (8), (14)-(17).

[1] M. W. Ahmadi, T. L. Hill, J. Z. Jiang, S. A. Neild, "Reduced-order modelling-inspired system
    identification of geometrically nonlinear structures", Nonlinear Dynamics (2023),
    doi:10.1007/s11071-023-08813-z.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from inspect import isabstract
from typing import Any, ClassVar, NamedTuple

import numpy as np

# A model may have so much: beyond it a file is damaged, and arrays of powers fill the memory.
MOST_TERMS, MOST_ORDER, MOST_COORDINATES = 1000, 100, 20

# In names of coefficients: a number, and the sides of a stop.
NUMBER = r"(-?[\d.]+(?:e[+-]?\d+)?)"
SIDES = {"above": 1, "below": -1}

Scalars = Any  # float or array: every method of a term takes both


class WeakForm(NamedTuple):
    """A term written as d^2(second)/dt^2 + d(first)/dt + zeroth; None stands for zero.

    ``second_rate`` is d(second)/dt, which the boundary terms of the integration by parts need.
    """

    second: Scalars = None
    second_rate: Scalars = None
    first: Scalars = None
    zeroth: Scalars = None


def type_name(kind: type) -> str:
    """Name of a type of law in files; a law from elsewhere carries its module."""
    own = kind.__module__.startswith("romsindy.")
    return kind.__name__ if own else f"{kind.__module__}.{kind.__qualname__}"


class Term(ABC):
    """One law of the equation of motion. Subclass it, state what it adds, and everything uses it.

    A subclass is a frozen dataclass whose fields are what shapes the law: an exponent, a gap. It
    overrides those of `inertia`, `convection`, `stiffness` (with `potential`) and `damping` that
    are not zero, and their derivatives ``*_dq`` and ``*_dq_dot``. All take floats or arrays, in the
    unit of q and seconds.
    """

    kinds: ClassVar[dict[str, type[Term]]] = {}  # every law there is, by the name of its type

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        Term.kinds[type_name(cls)] = cls

    @property
    @abstractmethod
    def key(self) -> str:
        """Name of the coefficient, such as ``"Upsilon_3"``; numbers in it are exact."""

    @property
    @abstractmethod
    def dimension(self) -> tuple[float, float]:
        """Powers of (unit of q, second) that the term carries without its coefficient."""

    @abstractmethod
    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        """Text of the term without its coefficient."""

    @classmethod
    def from_key(cls, key: str) -> Term | None:
        """The law whose coefficient has this name, or None if it is none of this type."""
        if isabstract(cls) or (
            is_dataclass(cls) and any(f.default is MISSING for f in fields(cls))
        ):
            return None
        term = cls()
        return term if term.key == key else None

    def inertia(self, q: Scalars) -> Scalars:
        """What multiplies q_ddot."""
        return 0.0

    def convection(self, q: Scalars) -> Scalars:
        """What multiplies q_dot^2."""
        return 0.0

    def stiffness(self, q: Scalars) -> Scalars:
        """Force that depends on q alone."""
        return 0.0

    def potential(self, q: Scalars) -> Scalars:
        """Integral of the stiffness force from 0 to q."""
        return 0.0

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        """Force that depends on the velocity and does work."""
        return 0.0

    def inertia_dq(self, q: Scalars) -> Scalars:
        """Derivative of `inertia`."""
        return 0.0

    def convection_dq(self, q: Scalars) -> Scalars:
        """Derivative of `convection`."""
        return 0.0

    def stiffness_dq(self, q: Scalars) -> Scalars:
        """Derivative of `stiffness`."""
        return 0.0

    def damping_dq(self, q: Scalars, q_dot: Scalars) -> Scalars:
        """Derivative of `damping` with respect to q."""
        return 0.0

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        """Derivative of `damping` with respect to q_dot."""
        return 0.0

    def monomial(self, part: str) -> tuple[float, int] | None:
        """Factor and power where a part, such as "potential", is a power of q alone."""
        return None

    @property
    def preload(self) -> float:
        """Force at rest that a reduced model does not see, since q counts from equilibrium."""
        return 0.0

    def strong(self, q: Scalars, q_dot: Scalars, q_ddot: Scalars) -> Scalars:
        """Value of the term, shape of q."""
        return (
            self.inertia(q) * q_ddot
            + self.convection(q) * q_dot * q_dot
            + self.stiffness(q)
            + self.damping(q, q_dot)
        )

    @abstractmethod
    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        """Integrate the term by parts: no acceleration is needed."""

    @property
    def conservative_inertia(self) -> bool:
        """Whether convection is half the derivative of inertia, so that energy is M q_dot^2/2."""
        return True

    @property
    def smooth(self) -> bool:
        """False where the force jumps, as dry friction does when the motion reverses."""
        return True

    def has(self, part: str) -> bool:
        """Whether the term adds to a part, such as ``"damping"``: most add to one or two."""
        return getattr(type(self), part) is not getattr(Term, part)

    @property
    def least(self) -> float:
        """What its coefficient exceeds by physics; -inf where it may have either sign."""
        return float("-inf")

    def undamped(self) -> Term | None:
        """The term without its damping; None if nothing is left."""
        return None if self.has("damping") else self

    def regularised(self, velocity_scale: float) -> Term:
        """Smooth term in place of one that jumps, equal to it well above ``velocity_scale``."""
        return self

    def unit(self, unit: str | None) -> str:
        """Unit of the coefficient when q is measured in ``unit`` (None: not known)."""
        length, time = self.dimension
        return unit_text({unit or "[q]": 1 - length, "s": -2 - time})


def law_called(key: str) -> Term | None:
    """The law whose coefficient has this name, or None if there is none.

    Raises a ValueError if it is of more coordinates than a model may have.
    """
    numbers = re.findall(r"q(\d+)", key)
    if any(len(n) > 4 or int(n) > MOST_COORDINATES for n in numbers):
        raise ValueError(
            f"{key!r:.60} is beyond q{MOST_COORDINATES}, the last of a model: leave it out"
        )
    found = (kind.from_key(key) for kind in list(Term.kinds.values()))
    return next((term for term in found if term is not None), None)


class ForceLaw(Term):
    """A force of q and q_dot without inertia; its weak form is itself."""

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        """The force has no derivatives to integrate by parts."""
        return WeakForm(zeroth=self.stiffness(q) + self.damping(q, q_dot))


def side_name(side: int) -> str:
    """ "above" or "below"."""
    return "above" if side > 0 else "below"


def unit_text(powers: Mapping[str, float]) -> str:
    """Text of a product of powers of units, such as "N s/m"."""
    rounded = {unit: round(p, 2) for unit, p in powers.items()}  # an exponent that was fitted
    above = [power_text(unit, p) for unit, p in rounded.items() if p > 0]
    below = [power_text(unit, -p) for unit, p in rounded.items() if p < 0]
    if not below:
        return " ".join(above) or "1"
    text = " ".join(below)
    return f"{' '.join(above) or '1'}/{f'({text})' if len(below) > 1 else text}"


def power_text(name: str, power: float) -> str:
    """Text of name^power; products in brackets, and nothing where the power is 0."""
    if power == 0:
        return ""
    base = f"({name})" if " " in name and not name.startswith("(") else name
    return base if power == 1 else f"{base}^{power:.4g}"


def exact(number: float) -> str:
    """Shortest text that reads back as the same number."""
    short = f"{number:g}"
    return short if float(short) == number else repr(float(number))


def power_of(q: Scalars, power: float) -> Scalars:
    """q^power for whole powers, |q|^power sign(q) for others."""
    if power == 1:
        return q
    if power != int(power):
        return np.abs(q) ** power * np.sign(q)
    # Repeated products: several times faster than ** on arrays, and exact for floats alike.
    result = q if power else np.ones_like(q) if isinstance(q, np.ndarray) else 1.0
    for _ in range(int(power) - 1):
        result = result * q
    return result


def power_slope(q: Scalars, power: float) -> Scalars:
    """Derivative of `power_of`."""
    if power != int(power):
        return power * np.abs(q) ** (power - 1)
    return power * power_of(q, max(power - 1, 0))


def size_slope(q: Scalars, power: float) -> Scalars:
    """Derivative of |q|^power with respect to q; 0 at 0, where powers below 1 have none."""
    return power * np.maximum(np.abs(q), np.finfo(float).tiny) ** (power - 1) * np.sign(q)


def _sum_of(part: str) -> Callable[..., Scalars]:
    """The method of a combination that adds up this method of its terms."""

    def total(self: Combination, *arguments: Scalars) -> Scalars:
        pairs = zip(self.terms, self.weights, strict=True)
        return sum(w * getattr(term, part)(*arguments) for term, w in pairs)

    return total


@dataclass(frozen=True)
class Combination(Term):
    """Terms that a single cause changes together, such as the bending stiffness of a beam.

    The coefficient is named after the cause; a weight is the change of a term's coefficient for a
    unit of the cause.
    """

    cause: str
    terms: tuple[Term, ...]
    weights: tuple[float, ...]

    dimension = (1, -2)

    def __post_init__(self) -> None:
        if len(self.terms) != len(self.weights):
            raise ValueError(
                f"{len(self.weights)} weights for {len(self.terms)} terms: give one for each"
            )

    @property
    def key(self) -> str:
        return self.cause

    def expression(self, q: str = "q", q_dot: str = "q_dot", q_ddot: str = "q_ddot") -> str:
        pairs = zip(self.terms, self.weights, strict=True)
        return f"({' + '.join(f'{w:.4g} {t.expression(q, q_dot, q_ddot)}' for t, w in pairs)})"

    def has(self, part: str) -> bool:
        return any(term.has(part) for term in self.terms)

    @property
    def conservative_inertia(self) -> bool:
        return all(term.conservative_inertia for term in self.terms)

    @property
    def smooth(self) -> bool:
        return all(term.smooth for term in self.terms)

    def undamped(self) -> Combination | None:
        pairs = [(t.undamped(), w) for t, w in zip(self.terms, self.weights, strict=True)]
        kept = [(t, w) for t, w in pairs if t is not None]
        terms, weights = zip(*kept, strict=True) if kept else ((), ())
        return replace(self, terms=terms, weights=weights) if kept else None

    def regularised(self, velocity_scale: float) -> Combination:
        return replace(self, terms=tuple(t.regularised(velocity_scale) for t in self.terms))

    inertia = _sum_of("inertia")
    convection = _sum_of("convection")
    stiffness = _sum_of("stiffness")
    potential = _sum_of("potential")
    damping = _sum_of("damping")
    inertia_dq = _sum_of("inertia_dq")
    convection_dq = _sum_of("convection_dq")
    stiffness_dq = _sum_of("stiffness_dq")
    damping_dq = _sum_of("damping_dq")
    damping_dq_dot = _sum_of("damping_dq_dot")

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        forms = [(w, t.weak(q, q_dot)) for t, w in zip(self.terms, self.weights, strict=True)]
        columns = [[(w, f[i]) for w, f in forms if f[i] is not None] for i in range(4)]
        return WeakForm(*(sum(w * x for w, x in c) if c else None for c in columns))
