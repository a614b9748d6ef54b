"""Equations of several coordinates for other programs: sympy, MATLAB, C.

As `romsindy.physics.export`, from which the laws and the printing come. Matrices are written entry
by entry, and the linear equations for q_ddot are solved where the code runs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from romsindy.physics.coupling import Along, PolynomialTerm
from romsindy.physics.export import (
    Pairs,
    comment,
    exact,
    named,
    sympy_module,
    traced,
    whole,
    wrapped,
)
from romsindy.physics.term import Term

_SOLVE = """\
    // Elimination as it stands: M(q) is symmetric and positive definite.
    for (int k = 0; k < {r}; k++)
        for (int i = k + 1; i < {r}; i++) {{
            const double ratio = inertia[i][k] / inertia[k][k];
            for (int j = k; j < {r}; j++)
                inertia[i][j] -= ratio * inertia[k][j];
            force[i] -= ratio * force[k];
        }}
    for (int i = {r} - 1; i >= 0; i--) {{
        for (int j = i + 1; j < {r}; j++)
            force[i] += inertia[i][j] * dy[{r} + j];
        dy[i] = y[{r} + i];
        dy[{r} + i] = -force[i] / inertia[i][i];
    }}
"""


def symbols(r: int) -> tuple[list[Any], list[Any]]:
    """The real symbols q1 ... qR and q1_dot ... qR_dot of `CoupledModel.to_sympy`."""
    make = sympy_module().Symbol
    q, q_dot = ([make(f"q{i + 1}{end}", real=True) for i in range(r)] for end in ("", "_dot"))
    return q, q_dot


def inertia_and_force(pairs: Pairs, r: int) -> tuple[Any, Any]:
    """M(q), R x R, and all forces beside M(q) q_ddot, R x 1, as matrices of sympy.

    Raises
    ------
    ValueError
        If a law does something that sympy has no word for, or sympy is not installed.
    """
    sympy = sympy_module()
    inertia, force = sympy.eye(r), sympy.zeros(r, 1)
    for term, value in pairs:
        added, push = _along(term, r) if isinstance(term, Along) else _polynomial(term, r)
        inertia, force = inertia + value * added, force + value * push
    return inertia, force


def _along(term: Along, r: int) -> tuple[Any, Any]:
    """Of a law on d = w^T q: h w w^T, and its force times w."""
    w = sympy_module().Matrix([*map(whole, term.weights), *(0,) * (r - len(term.weights))])
    d, d_dot = ((w.T * sympy_module().Matrix(x))[0] for x in symbols(r))
    h, push = traced(term.law, d, d_dot)
    return h * w * w.T, push * w


def _polynomial(term: Term, r: int) -> tuple[Any, Any]:
    sympy = sympy_module()
    (q, q_dot), inertia, force = symbols(r), sympy.zeros(r, r), sympy.zeros(r, 1)
    for m in term.monomials() if isinstance(term, PolynomialTerm) else ():
        factors = [q[i] ** p for i, p in enumerate(m.powers)] + [q_dot[j] for j in m.rates]
        product = sympy.Mul(whole(m.factor), *factors)
        if m.second is None:
            force[m.equation] += product
        else:
            inertia[m.equation, m.second] += product
    return inertia, force


def python_script(pairs: Pairs, title: str, r: int) -> str:
    """Python that makes the sympy matrices ``inertia`` and ``force``, numbers to the last digit."""
    sympy = sympy_module()
    both = [exact(x) for x in inertia_and_force(pairs, r)]
    kinds = (sympy.Function, sympy.Max, sympy.Min)
    functions = {f.func.__name__ for x in both for f in x.atoms(*kinds)}
    inertia, force = (wrapped(sympy.sstr(x.tolist())) for x in both)
    names = [x.name for several in symbols(r) for x in several]
    return (
        f"{comment('#', pairs, title, 'inertia * q_ddot + force = 0')}\n"
        f"from sympy import {', '.join(sorted({'Matrix', 'symbols', *functions}))}\n\n"
        f'{", ".join(names)} = symbols("{" ".join(names)}", real=True)\n'
        f"inertia = Matrix({inertia})\n"
        f"force = Matrix({force})"
    )


def matlab_function(pairs: Pairs, title: str, name: str, r: int) -> str:
    """Text of a function for ``ode45``, for a file ``name``.m."""
    inertia, force = (x.applyfunc(exact) for x in inertia_and_force(pairs, r))
    code = sympy_module().octave_code
    state = "; ".join(x.name for several in symbols(r) for x in several)
    use = f"[t, y] = ode45(@{named(name)}, [t0 t1], y0, odeset('RelTol', 1e-9));"
    lines = [
        f"function dy = {name}(t, y)",
        comment("%", pairs, title, f"dy/dt of y = [{state}]: {use}"),
        *(f"{x} = y({k + 1});" for k, x in _used(r, inertia, force)),
        f"inertia = zeros({r}, {r});",
        *_entries("inertia({}, {})", inertia, code, 1, " ..."),
        f"force = zeros({r}, 1);",
        *_entries("force({})", force, code, 1, " ..."),
        f"dy = [y({r + 1}:{2 * r}); -(inertia \\ force)];",
        "end",
    ]
    return "\n".join(lines)


def c_function(pairs: Pairs, title: str, name: str, r: int) -> str:
    """Text of a C99 function."""
    inertia, force = inertia_and_force(pairs, r)
    code = sympy_module().ccode
    state = ", ".join(x.name for several in symbols(r) for x in several)
    body = [
        *(f"const double {x} = y[{k}];" for k, x in _used(r, inertia, force)),
        f"double inertia[{r}][{r}], force[{r}];",
        *_entries("inertia[{}][{}]", inertia, code, 0),
        *_entries("force[{}]", force, code, 0),
        "(void)t;",
    ]
    lines = [
        comment("//", pairs, title, f"dy/dt of y = {{{state}}}; link with -lm."),
        "#include <math.h>\n",
        f"void {named(name)}(double t, const double y[{2 * r}], double dy[{2 * r}])\n{{",
        *(f"    {line}" for line in body),
        f"{_SOLVE.format(r=r)}}}",
    ]
    return "\n".join(lines)


def _entries(
    place: str, matrix: Any, code: Callable[[Any], str], first: int, joint: str = ""
) -> list[str]:
    """Assignments of the entries of a matrix, whose indices begin with ``first``."""
    rows, columns = matrix.shape
    return [
        f"{place.format(i + first, j + first)} = {wrapped(code(matrix[i, j]), joint)};"
        for i in range(rows)
        for j in range(columns)
    ]


def _used(r: int, *matrices: Any) -> list[tuple[int, Any]]:
    """Places in the state, from 0, and symbols, of those that matrices hold."""
    held = set().union(*(x.free_symbols for x in matrices))
    several = [x for both in symbols(r) for x in both]
    return [(k, x) for k, x in enumerate(several) if x in held]
