"""A weighted sum of terms with one common coefficient."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from romsindy.physics.term import Scalars, Term, WeakForm


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
