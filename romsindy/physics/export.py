"""Equations of motion of any number of coordinates for other programs: sympy, MATLAB, C.

Every law is written once, for numbers and arrays. Here a sympy expression goes through it in their
place, and sympy's printers write what comes out. Of one coordinate M(q) and the force are scalars;
of several they are written entry by entry, and the linear equations for q_ddot are solved where the
code runs.
"""

from __future__ import annotations

import operator
import re
import textwrap
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from romsindy.physics.coupling import Along, PolynomialTerm
from romsindy.physics.input import Input, input_in
from romsindy.physics.memory import MemoryLaw
from romsindy.physics.term import Term
from romsindy.physics.term import exact as exact_text
from romsindy.record.interpolation import Interpolation

Coordinates = tuple[str, ...]  # their names
ALONE: Coordinates = ("q",)


def sympy_module() -> Any:
    """Sympy, or a ValueError that says how to install it."""
    try:
        return import_module("sympy")
    except ImportError:
        raise ValueError(
            "to export a model needs sympy, which is not installed: python -m pip install"
            ' "romsindy[export]"'
        ) from None


def symbols(coordinates: Coordinates) -> tuple[list[Any], list[Any]]:
    """The real symbols of coordinates and of their velocities, such as q and q_dot."""
    make = sympy_module().Symbol
    q, q_dot = ([make(f"{x}{end}", real=True) for x in coordinates] for end in ("", "_dot"))
    return q, q_dot


def traced(term: Term, q: Any, q_dot: Any) -> tuple[Any, Any]:
    """What a law adds to M and to K + N q_dot^2 + D, as expressions of two others.

    Raises a ValueError if it does something that sympy has no word for.
    """
    q, q_dot = _Traced(q), _Traced(q_dot)
    inertia, force = _Traced(0), _Traced(0)
    try:
        if term.has("inertia"):
            inertia += term.inertia(q)
        if term.has("convection"):
            force += term.convection(q) * q_dot * q_dot
        if term.has("stiffness"):
            force += term.stiffness(q)
        if term.has("damping"):
            force += term.damping(q, q_dot)
    except (AttributeError, TypeError) as error:
        raise ValueError(
            f"the term {term.key!r} cannot be exported ({error}): write its law with"
            " arithmetic and functions that numpy and sympy share, such as abs, sign, maximum,"
            " tanh, or leave the term out"
        ) from error
    return inertia.expression, force.expression


def whole(number: Any) -> Any:
    """1 in the place of 1.0: x^1.0 and 1.0 x are no power and product to a reader."""
    return int(number) if float(number).is_integer() else number


def exact(expression: Any) -> Any:
    """The same, so that printers show every digit of its numbers."""
    sympy = sympy_module()
    return expression.xreplace({x: sympy.Float(x, 17) for x in expression.atoms(sympy.Float)})


def _power(base: Any, exponent: Any) -> Any:
    return base ** whole(exponent)


# What numpy does with operators, and names that are others in sympy.
_OPERATIONS: dict[str, Callable[..., Any]] = {
    "absolute": abs,
    "add": operator.add,
    "divide": operator.truediv,
    "multiply": operator.mul,
    "negative": operator.neg,
    "power": _power,
    "subtract": operator.sub,
}
_CALLED = {"maximum": "Max", "minimum": "Min"}
_LIKE: dict[Callable, int] = {np.ones_like: 1, np.zeros_like: 0}


class _Traced(NDArrayOperatorsMixin):
    """A sympy expression that numpy's operators and functions take for an array."""

    def __init__(self, expression: Any) -> None:
        self.expression = sympy_module().sympify(expression)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        name = ufunc.__name__
        function = _OPERATIONS.get(name) or getattr(sympy_module(), _CALLED.get(name, name), None)
        # An operator in place (+=) may as well make a new expression: Python gives it the name.
        if function is None or method != "__call__" or not {*options} <= {"out"}:
            raise TypeError(f"numpy.{name} has no counterpart in sympy")
        return _Traced(function(*map(_expression, inputs)))

    def __array_function__(self, function: Callable, _: Any, inputs: Any, options: Any) -> Any:
        if function not in _LIKE:
            raise TypeError(f"numpy.{function.__name__} has no counterpart in sympy")
        return _Traced(_LIKE[function])


def _expression(x: Any) -> Any:
    return x.expression if isinstance(x, _Traced) else sympy_module().sympify(x)


Pairs = Sequence[tuple[Term, float]]
_WIDTH = 84
# Of MATLAB, beside those of C that sympy knows; and what the functions define or call.
_WORDS = {
    *("catch", "classdef", "elseif", "end", "function", "global", "otherwise", "parfor"),
    *("persistent", "spmd", "try", "main", "t", "y", "dy", "q", "q_dot", "inertia", "force"),
    *("forces", "base"),
}
_NUMBERED = re.compile(r"q\d+(_dot)?|(force|base)(_\d+)?(_power)?_\d+")
# Of MATLAB's interp1, for what inputs do between their samples.
_METHODS: dict[Interpolation, str] = {
    "band-limited": "spline",
    "linear": "linear",
    "hold": "previous",
}
_SOLVE = """\
    // Elimination as it stands: M(q) is symmetric and positive definite.
    for (int k = 0; k < {r}; k++)
        for (int i = k + 1; i < {r}; i++) {{
            const double ratio = inertia[i][k] / inertia[k][k];
            for (int j = k; j < {r}; j++)
                inertia[i][j] -= ratio * inertia[k][j];
            {force}[i] -= ratio * {force}[k];
        }}
    for (int i = {r} - 1; i >= 0; i--) {{
        for (int j = i + 1; j < {r}; j++)
            {force}[i] += inertia[i][j] * dy[{r} + j];
        dy[i] = y[{r} + i];
        dy[{r} + i] = -{force}[i] / inertia[i][i];
    }}"""
_JUMP = (
    "Dry friction jumps where q_dot changes its sign, and solvers take small steps there;"
    " romsindy's model.regularised(velocity_scale) has no jump."
)


def inertia_and_force(
    pairs: Pairs, coordinates: Coordinates, symbol: Callable[[Input], Any]
) -> tuple[Any, Any]:
    """M(q), R x R, and all forces beside M(q) q_ddot, R x 1, as matrices of sympy.

    Less what inputs push, each by its symbol.

    Raises a ValueError if a law does something that sympy has no word for, or sympy is not
    installed.
    """
    sympy, r = sympy_module(), len(coordinates)
    inertia, force = sympy.eye(r), sympy.zeros(r, 1)
    for term, value in pairs:
        if isinstance(term, MemoryLaw):
            raise ValueError(
                f"{term.key} remembers the motion, and an equation of q and q_dot cannot say so:"
                " save the model as JSON, or export its other terms alone"
            )
        if isinstance(term, PolynomialTerm):
            added, push = _polynomial(term, coordinates)
        else:
            added, push = _along(term, coordinates, symbol)
        inertia, force = inertia + value * added, force + value * push
    return inertia, force


def _along(term: Term, coordinates: Coordinates, symbol: Callable[[Input], Any]) -> tuple[Any, Any]:
    """Of a law on d = w^T q: h w w^T, and its force times w."""
    law, weights = (term.law, term.weights) if isinstance(term, Along) else (term, (1.0,))
    w = sympy_module().Matrix([*map(whole, weights), *(0,) * (len(coordinates) - len(weights))])
    d, d_dot = ((w.T * sympy_module().Matrix(x))[0] for x in symbols(coordinates))
    h, push = traced(law, d, d_dot)
    if isinstance(law, Input):
        push -= law.sign * symbol(law)
    return h * w * w.T, push * w


def _polynomial(term: PolynomialTerm, coordinates: Coordinates) -> tuple[Any, Any]:
    sympy, r = sympy_module(), len(coordinates)
    (q, q_dot), inertia, force = symbols(coordinates), sympy.zeros(r, r), sympy.zeros(r, 1)
    for m in term.monomials():
        factors = [q[i] ** p for i, p in enumerate(m.powers)] + [q_dot[j] for j in m.rates]
        product = sympy.Mul(whole(m.factor), *factors)
        if m.second is None:
            force[m.equation] += product
        else:
            inertia[m.equation, m.second] += product
    return inertia, force


def equations(pairs: Pairs, coordinates: Coordinates) -> tuple[Any, Any]:
    """`inertia_and_force`; inputs are functions of the real symbol t."""
    sympy = sympy_module()
    t = sympy.Symbol("t", real=True)
    return inertia_and_force(
        pairs,
        coordinates,
        lambda term: sympy.Function(term.name)(t - whole(term.delay)) ** term.power,
    )


def acceleration(pairs: Pairs) -> Any:
    """q_ddot of one coordinate as a sympy expression of `symbols`; inputs as in `equations`."""
    inertia, force = equations(pairs, ALONE)
    return -force[0] / inertia[0]


def python_script(pairs: Pairs, title: str, coordinates: Coordinates) -> str:
    """Python that makes sympy expressions, every number to its last digit.

    Of one coordinate ``q_ddot``, of several the matrices ``inertia`` and ``force``.
    """
    sympy, inputs = sympy_module(), list(_sources(pairs))
    alone = coordinates == ALONE
    if alone:
        made = {"q_ddot": exact(acceleration(pairs))}
    else:
        both = map(exact, equations(pairs, coordinates))
        made = dict(zip(("inertia", "force"), both, strict=True))
    kinds = (sympy.Function, sympy.Max, sympy.Min)
    functions = {f.func.__name__ for x in made.values() for f in x.atoms(*kinds)}
    imports = {"symbols", *functions, *(["Function"] if inputs else [])} - {*inputs}
    names = _state(coordinates)
    lines = [
        comment("#", pairs, title, *(["inertia * q_ddot + force = 0"] if not alone else [])),
        f"from sympy import {', '.join(sorted(imports | (set() if alone else {'Matrix'})))}\n",
        f'{", ".join(names)} = symbols("{" ".join(names)}", real=True)',
        *(['t = symbols("t", real=True)'] if inputs else []),
        *(f'{name} = Function("{name}")' for name in inputs),
    ]
    for name, x in made.items():
        code = wrapped(sympy.sstr(x if alone else x.tolist()))
        lines.append(f"{name} = (\n        {code}\n)" if alone else f"{name} = Matrix({code})")
    return "\n".join(lines)


def matlab_function(pairs: Pairs, title: str, name: str, coordinates: Coordinates) -> str:
    """Text of a function for ``ode45``, for a file ``name``.m; inputs are functions of time."""
    sympy, inputs = sympy_module(), _sources(pairs)
    both = inertia_and_force(
        pairs, coordinates, lambda term: sympy.Symbol(term.called(term.delay)) ** term.power
    )
    inertia, force = (x.applyfunc(exact) for x in both)
    alone = coordinates == ALONE
    start = "[q0; q_dot0]" if alone else "y0"
    call = f"[t, y] = ode45({_handle([*inputs.values()], named(name))}, [t0 t1], {start}"
    use = f"dy/dt of y = [{'; '.join(_state(coordinates))}]: {call}, odeset('RelTol', 1e-9));"
    samples = ["tu and u are the times and the samples of the input."] if inputs else []
    body = _matlab_of_one if alone else _matlab_of_several
    lines = [
        f"function dy = {name}({', '.join(['t', 'y', *inputs])})",
        comment("%", pairs, title, use, *samples),
        *body(inertia, force, _sum_name(pairs), coordinates),
        "end",
    ]
    return "\n".join(lines)


def _matlab_of_one(inertia: Any, force: Any, name: str, _: Coordinates) -> list[str]:
    code = sympy_module().octave_code
    return [
        "q = y(1);",
        "q_dot = y(2);",
        f"inertia = {wrapped(code(inertia[0]), ' ...')};",
        f"{name} = {wrapped(code(force[0]), ' ...')};",
        f"dy = [q_dot; -{name} / inertia];",
    ]


def _matlab_of_several(inertia: Any, force: Any, name: str, coordinates: Coordinates) -> list[str]:
    r, code = len(coordinates), sympy_module().octave_code
    return [
        *(f"{x} = y({k + 1});" for k, x in _used(coordinates, inertia, force)),
        f"inertia = zeros({r}, {r});",
        *_entries("inertia({}, {})", inertia, code, 1, " ..."),
        f"{name} = zeros({r}, 1);",
        *_entries(f"{name}({{}})", force, code, 1, " ..."),
        f"dy = [y({r + 1}:{2 * r}); -(inertia \\ {name})];",
    ]


def c_function(pairs: Pairs, title: str, name: str, coordinates: Coordinates) -> str:
    """Text of a C99 function; inputs are values."""
    sympy, inputs, n = sympy_module(), _inputs(pairs), 2 * len(coordinates)
    both = inertia_and_force(pairs, coordinates, lambda term: sympy.Symbol(_value(term)))
    values = [
        f"The argument {_value(term)} is {term.raised(term.called(term.delay))}." for term in inputs
    ]
    arguments = [f"const double y[{n}]", *(f"double {_value(term)}" for term in inputs)]
    use = f"dy/dt of y = {{{', '.join(_state(coordinates))}}}; link with -lm."
    body = _c_of_one if coordinates == ALONE else _c_of_several
    lines = [
        comment("//", pairs, title, use, *values),
        "#include <math.h>\n",
        f"void {named(name)}(double t, {', '.join(arguments)}, double dy[{n}])\n{{",
        *body(*both, _sum_name(pairs), coordinates),
        "}",
    ]
    return "\n".join(lines)


def _c_of_one(inertia: Any, force: Any, name: str, _: Coordinates) -> list[str]:
    code = sympy_module().ccode
    return [
        "    const double q = y[0], q_dot = y[1];",
        f"    const double inertia = {wrapped(code(inertia[0]))};",
        f"    const double {name} = {wrapped(code(force[0]))};",
        "    (void)t;",
        "    dy[0] = q_dot;",
        f"    dy[1] = -{name} / inertia;",
    ]


def _c_of_several(inertia: Any, force: Any, name: str, coordinates: Coordinates) -> list[str]:
    r, code = len(force), sympy_module().ccode
    body = [
        *(f"const double {x} = y[{k}];" for k, x in _used(coordinates, inertia, force)),
        f"double inertia[{r}][{r}], {name}[{r}];",
        *_entries("inertia[{}][{}]", inertia, code, 0),
        *_entries(f"{name}[{{}}]", force, code, 0),
        "(void)t;",
    ]
    return [*(f"    {line}" for line in body), _SOLVE.format(r=r, force=name)]


_AUTO = """subroutine func(ndim, u, icp, par, ijac, f, dfdu, dfdp)
  implicit none
  integer, intent(in) :: ndim, icp(*), ijac
  double precision, intent(in) :: u(ndim), par(*)
  double precision, intent(out) :: f(ndim)
  double precision, intent(inout) :: dfdu(ndim, ndim), dfdp(ndim, *)
  double precision :: q, q_dot, inertia, force
  q = u(1)
  q_dot = u(2)
  inertia = {inertia}
  force = {force}
  f(1) = q_dot
  f(2) = -force/inertia + par(1)*q_dot
end subroutine
subroutine stpnt(ndim, u, par, t)
  implicit none
  integer, intent(in) :: ndim
  double precision, intent(inout) :: u(ndim), par(*)
  double precision, intent(in) :: t
  u = 0
  par(1) = {start}
end subroutine
subroutine bcnd
end subroutine
subroutine icnd
end subroutine
subroutine fopt
end subroutine
subroutine pvls
end subroutine"""
_AUTO_USE = (
    "PAR(1) is a negative damping that makes up for the losses: with it the rest loses stability in"
    " a Hopf bifurcation, from which the branch of periodic orbits, the backbone, grows.",
    "The rest: NDIM=2, IPS=1, ISP=2, ICP=[1], NMX=200, NPR=200, DS={ds}, DSMAX={most}, RL1={end}",
    "Then from its point HB: IPS=2, ICP=[1, 11], NTST=50, NCOL=4, ISP=0; PAR(11) is the period, s.",
)


def auto_function(pairs: Pairs, title: str, coordinates: Coordinates) -> str:
    """Text of the equations file of AUTO-07p, in Fortran 90, for one coordinate without inputs.

    Raises a ValueError if there are several coordinates, inputs, or a force that jumps.
    """
    if coordinates != ALONE:
        raise ValueError("AUTO is written for one coordinate: several are for MATLAB, C or sympy")
    if names := list(_sources(pairs)):
        raise ValueError(
            f"the model is driven by {', '.join(names)}, which AUTO does not know: export the model"
            " without inputs"
        )
    if jumps := [term.key for term, _ in pairs if not term.smooth]:
        raise ValueError(
            f"{jumps[0]} jumps, and AUTO follows smooth motions: give model.regularised("
            "velocity_scale)"
        )
    values = {term.key: value for term, value in pairs}
    omega, linear = np.sqrt(values.get("omega^2", 1.0)), values.get("c_linear", 0.0)
    step = 0.01 * float(omega)
    code = sympy_module().fcode
    written = {"source_format": "free", "standard": 2003}
    both = inertia_and_force(pairs, coordinates, lambda term: None)
    # A line of Fortran has 132 characters; sympy counts those of the expression alone.
    inertia, force = (code(x[0], **written).replace("\n", "\n    ") for x in both)
    ends = {"ds": f"{step:.3g}", "most": f"{step:.3g}", "end": f"{linear + 10 * step:.4g}"}
    use = [line.format(**ends) for line in _AUTO_USE]
    start = f"{linear - 10 * step:.15e}".replace("e", "d")
    text = _AUTO.format(inertia=inertia, force=force, start=start)
    return f"{comment('!', pairs, title, *use)}\n{text}"


FREEDOMS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
_ADDED = {
    "AddBLin": "Additional linear damping [N/(m/s), N/(rad/s), N-m/(m/s), N-m/(rad/s)]",
    "AddBQuad": "Additional quadratic drag [N/(m/s)^2, N/(rad/s)^2, N-m/(m/s)^2, N-m/(rad/s)^2]",
}


def openfast_damping(
    linear: float, quadratic: float, inertia: float, freedom: str, *remarks: str
) -> str:
    """Lines of HydroDyn's input file of OpenFAST: AddBLin and AddBQuad of one degree of freedom.

    ``linear`` in 1/s and ``quadratic`` in 1/m or 1/rad are those of q_ddot + linear q_dot +
    quadratic |q_dot| q_dot + ... = 0; ``inertia`` is the mass in kg, or the moment of inertia in
    kg m^2, with added mass.
    """
    place = FREEDOMS.index(freedom)
    lines = [f"! {part}" for line in remarks for part in _split(line)]
    for (name, words), value in zip(_ADDED.items(), (linear, quadratic), strict=True):
        table = np.zeros((6, 6))
        table[place, place] = inertia * value
        rows = ["".join(f"{x:16.8E}" for x in row) for row in table]
        lines += [f"{rows[0]}   {name} - {words}", *rows[1:]]
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


def _used(coordinates: Coordinates, *matrices: Any) -> list[tuple[int, Any]]:
    """Places in the state, from 0, and symbols, of those that matrices hold."""
    held = set().union(*(x.free_symbols for x in matrices))
    several = [x for both in symbols(coordinates) for x in both]
    return [(k, x) for k, x in enumerate(several) if x in held]


def _state(coordinates: Coordinates) -> list[str]:
    """Names of the coordinates, then of their velocities."""
    return [x.name for several in symbols(coordinates) for x in several]


def _inputs(pairs: Pairs) -> list[Input]:
    """Each once: one may push several coordinates."""
    return list(dict.fromkeys(i for i in (input_in(term) for term, _ in pairs) if i is not None))


def _sources(pairs: Pairs) -> dict[str, Input]:
    """The inputs by name, each once: powers of one have its name."""
    found: dict[str, Input] = {}
    for term in _inputs(pairs):
        found.setdefault(term.name, term)
    return found


def _value(term: Input) -> str:
    """Name of the value of an input, or of its power, which may come at another time."""
    return term.name if term.power == 1 else f"{term.name}_power_{term.power}"


def _sum_name(pairs: Pairs) -> str:
    """Name of the sum of all forces: an input may have the name "force"."""
    return "forces" if _inputs(pairs) else "force"


def _method(term: Input) -> str:
    """Of MATLAB's interp1: what was held does not jump after a lag."""
    return _METHODS["linear" if term.lag and term.interpolation == "hold" else term.interpolation]


def _handle(inputs: Sequence[Input], name: str) -> str:
    """MATLAB's handle of the function, with inputs interpolated."""
    if not inputs:
        return f"@{name}"
    columns = ["u"] if len(inputs) == 1 else [f"u(:, {i + 1})" for i in range(len(inputs))]
    functions = [
        f"@(s) interp1(tu, {u}, s, '{_method(term)}', 'extrap')"
        for u, term in zip(columns, inputs, strict=True)
    ]
    return f"@(t, y) {name}(t, y, {', '.join(functions)})"


# -- text -----------------------------------------------------------------------------------------


def comment(sign: str, pairs: Pairs, title: str, *use: str) -> str:
    """Lines of a comment: what the model says, how the code is used, and what jumps in it."""
    jumps = any(not term.smooth for term, _ in pairs)
    lags = [
        f"In the place of {term.name} stands x, {exact_text(term.lag)} dx/dt + x = {term.name}: its"
        " samples are to go through this lag first."
        for term in _inputs(pairs)
        if term.lag
    ]
    lines = [*title.splitlines(), *use, *lags, _JUMP if jumps else ""]
    return "\n".join(f"{sign} {part}" for line in lines for part in _split(line))


def wrapped(code: str, joint: str = "") -> str:
    """Code on several lines, each but the last with the joint that its language asks for."""
    return f"{joint}\n        ".join(_split(code))


def _split(line: str) -> list[str]:
    return textwrap.wrap(line, _WIDTH, break_long_words=False, break_on_hyphens=False)


def named(name: str) -> str:
    """The name of a function, if C and MATLAB take it, or else a ValueError."""
    if name in {*import_module("sympy.printing.c").reserved_words, *_WORDS} or _NUMBERED.fullmatch(
        name
    ):
        raise ValueError(f"name={name!r} is a word of C or MATLAB: take another, such as 'rhs'")
    if not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII):
        raise ValueError(
            f"name={name!r} names no function: begin with a letter, and go on with letters, digits"
            " and underscores"
        )
    return name
