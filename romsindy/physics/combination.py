"""A weighted sum of terms with one common coefficient."""

from __future__ import annotations

from dataclasses import dataclass, replace

from romsindy.physics.term import Scalars, Term, WeakForm


@dataclass(frozen=True)
class Combination(Term):
    """Terms that a single cause changes together, such as the bending stiffness of a beam.

    Attributes
    ----------
    cause : str
        Its name is that of the coefficient.
    terms : tuple of Term
    weights : tuple of float
        Change of each coefficient for a unit of the cause.
    """

    cause: str
    terms: tuple[Term, ...]
    weights: tuple[float, ...]

    dimension = (1, -2)

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
        if not kept:
            return None
        return replace(self, terms=tuple(t for t, _ in kept), weights=tuple(w for _, w in kept))

    def regularised(self, velocity_scale: float) -> Combination:
        return replace(self, terms=tuple(t.regularised(velocity_scale) for t in self.terms))

    def _sum(self, part: str, *arguments: Scalars) -> Scalars:
        pairs = zip(self.terms, self.weights, strict=True)
        return sum(w * getattr(term, part)(*arguments) for term, w in pairs)

    def inertia(self, q: Scalars) -> Scalars:
        return self._sum("inertia", q)

    def convection(self, q: Scalars) -> Scalars:
        return self._sum("convection", q)

    def stiffness(self, q: Scalars) -> Scalars:
        return self._sum("stiffness", q)

    def potential(self, q: Scalars) -> Scalars:
        return self._sum("potential", q)

    def inertia_dq(self, q: Scalars) -> Scalars:
        return self._sum("inertia_dq", q)

    def convection_dq(self, q: Scalars) -> Scalars:
        return self._sum("convection_dq", q)

    def stiffness_dq(self, q: Scalars) -> Scalars:
        return self._sum("stiffness_dq", q)

    def damping(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return self._sum("damping", q, q_dot)

    def damping_dq(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return self._sum("damping_dq", q, q_dot)

    def damping_dq_dot(self, q: Scalars, q_dot: Scalars) -> Scalars:
        return self._sum("damping_dq_dot", q, q_dot)

    def weak(self, q: Scalars, q_dot: Scalars) -> WeakForm:
        forms = [(w, t.weak(q, q_dot)) for t, w in zip(self.terms, self.weights, strict=True)]
        columns = [[(w, f[i]) for w, f in forms if f[i] is not None] for i in range(4)]
        return WeakForm(*(sum(w * x for w, x in c) if c else None for c in columns))
