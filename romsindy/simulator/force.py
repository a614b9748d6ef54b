"""What a simulator lacks as a force for it: a function, and the same law as code."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from romsindy.physics.export import exact, sympy_module, traced
from romsindy.physics.term import Term, law_called
from romsindy.physics.validation import finite, several, table, text
from romsindy.text import listed
from romsindy.typing import Array

# Of t (s), displacement and velocity of the point at which it acts.
Force = Callable[[float, float, float], float]

LANGUAGES = {"py": "Python", "m": "MATLAB", "c": "C", "mo": "Modelica"}
_MATTERS = 2e-3  # of the largest of the laws, in text
_FRAMES = {
    "py": "import math\n\n\ndef force(t, x, v):\n    return {}\n",
    "m": "function f = force(t, x, v)\nf = {};\nend\n",
    "c": (
        "#include <math.h>\n\ndouble force(double t, double x, double v)\n{{\n    return {};\n}}\n"
    ),
    "mo": (
        "function force\n  input Real t;\n  input Real x;\n  input Real v;\n  output Real f;\n"
        "algorithm\n  f := {};\nend force;\n"
    ),
}


@dataclass(frozen=True)
class LawForce:
    """Laws of the coordinate q of an equation as a force on a point: f(t, x, v).

    The point moves by x = ``per_q`` q, and a force of 1 on it accelerates q by ``per_q`` over the
    modal ``mass``; all laws with their coefficients stand on the left side of the equation. It is
    for displacements and velocities of the point up to ``reach``.
    """

    laws: tuple[tuple[Term, float], ...]
    mass: float
    per_q: float = 1.0
    reach: tuple[float, float] = (1.0, 1.0)

    def __call__(self, t: float, x: float, v: float) -> float:
        """The force at a displacement and a velocity of the point."""
        q, q_dot = float(x) / self.per_q, float(v) / self.per_q
        total = sum(c * law.strong(q, q_dot, 0.0) for law, c in self.laws)
        return -self.mass / self.per_q * float(total)

    def __str__(self) -> str:
        """The force as text, of x and v, without what is too small to matter within ``reach``."""
        q, q_dot = (n if self.per_q == 1 else f"({n}/{self.per_q:.4g})" for n in "xv")
        at, rate = (x / self.per_q for x in self.reach)
        sizes = [abs(c * law.strong(at, rate, 0.0)) for law, c in self.laws]
        terms = [
            f"{-self.mass / self.per_q * c:.5g} {law.expression(q, q_dot, '')}"
            for (law, c), size in zip(self.laws, sizes, strict=True)
            if size >= _MATTERS * max(sizes)
        ]
        return " + ".join(terms).replace("+ -", "- ") or "0"

    def content(self) -> dict[str, Any]:
        """What JSON keeps of it."""
        laws = [[law.key, c] for law, c in self.laws]
        return {"laws": laws, "mass": self.mass, "per_q": self.per_q, "reach": [*self.reach]}

    @classmethod
    def of_content(cls, name: str, value: Any) -> LawForce:
        """The force that JSON keeps; raises a ValueError for anything else."""
        found = table(name, value, ("laws", "mass", "per_q", "reach"))
        laws = []
        for key, c in found["laws"]:
            law = law_called(text(f"{name}.laws", key))
            if law is None:
                raise ValueError(f"{name}.laws has {key!r}, which is no law that is known")
            laws.append((law, float(finite(f"{name}.laws {key}", c))))
        x, v = several(finite)(f"{name}.reach", found["reach"])
        return cls(tuple(laws), found["mass"], found["per_q"], (x, v))

    def expression(self) -> Any:
        """The force as an expression of sympy, of the symbols x and v."""
        sympy = sympy_module()
        x, v = (sympy.Symbol(n, real=True) for n in "xv")
        total = sympy.Integer(0)
        for law, c in self.laws:
            total += c * traced(law, x / self.per_q, v / self.per_q)[1]
        return exact(sympy.simplify(-self.mass / self.per_q * total))

    def code(self, language: str) -> str:
        """The function ``force`` of t, x and v in "py", "m", "c" or "mo" (Modelica).

        Raises a ValueError for another language, if sympy is not installed, or for a law of one's
        own that sympy has no word for.
        """
        if language not in LANGUAGES:
            raise ValueError(f"language = {language!r} must be one of {listed([*LANGUAGES])}")
        sympy = sympy_module()
        printers: dict[str, Callable[[Any], str]] = {
            "py": sympy.pycode,
            "m": sympy.octave_code,
            "c": sympy.ccode,
            "mo": _modelica,
        }
        return _FRAMES[language].format(printers[language](self.expression()))


NO_FORCE = LawForce((), 1.0)


def acting(forces: Sequence[Force | None]) -> Callable[[float, Array, Array], Array] | None:
    """Forces at points of their own, as one function of time, displacements and velocities (k,).

    Those of the same laws are asked at once. None where none acts.
    """
    alike: dict[tuple[Term, ...], list[int]] = defaultdict(list)
    alone: list[tuple[int, Force]] = []
    for i, force in enumerate(forces):
        if isinstance(force, LawForce):
            alike[tuple(law for law, _ in force.laws)].append(i)
        elif force is not None:
            alone.append((i, force))
    several = []
    for laws, numbers in alike.items():
        own = [f for i in numbers if isinstance(f := forces[i], LawForce)]
        strengths = np.array([[c for _, c in f.laws] for f in own]).T
        several.append((laws, numbers, *np.array([(f.per_q, f.mass) for f in own]).T, strengths))

    def at(t: float, x: Array, v: Array) -> Array:
        found = np.zeros(len(forces))
        for laws, numbers, per_q, mass, strengths in several:
            q, q_dot = x[numbers] / per_q, v[numbers] / per_q
            total = np.zeros(len(q))
            for law, c in zip(laws, strengths, strict=True):
                total += c * law.strong(q, q_dot, 0.0)
            found[numbers] = -mass / per_q * total
        for i, force in alone:
            found[i] = force(t, float(x[i]), float(v[i]))
        return found

    return at if several or alone else None


def _modelica(expression: Any) -> str:
    """Modelica writes as sympy does, but for powers and names of functions."""
    text = str(sympy_module().sstr(expression))
    for own, theirs in (("**", "^"), ("Max", "max"), ("Min", "min"), ("Abs", "abs")):
        text = text.replace(own, theirs)
    return text
