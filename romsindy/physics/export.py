"""Equations of motion for other programs: sympy, MATLAB, C.

Every law is written once, for numbers and arrays. Here a sympy expression goes through it in their
place, and sympy's printers write what comes out.
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

from romsindy.physics.input import Input
from romsindy.physics.term import Term
from romsindy.physics.term import exact as exact_text
from romsindy.record.interpolation import Interpolation

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
_JUMP = (
    "Dry friction jumps where q_dot changes its sign, and solvers take small steps there;"
    " romsindy's model.regularised(velocity_scale) has no jump."
)


def symbols() -> tuple[Any, Any]:
    """The real symbols q and q_dot of `to_sympy`."""
    q, q_dot = sympy_module().symbols("q q_dot", real=True)
    return q, q_dot


def inertia_and_force(pairs: Pairs, symbol: Callable[[Input], Any]) -> tuple[Any, Any]:
    """M(q) and K(q) + N(q) q_dot^2 + D(q, q_dot) as sympy expressions.

    Less what inputs push, each by its symbol.

    Raises
    ------
    ValueError
        If a law does something that sympy has no word for, or sympy is not installed.
    """
    q, q_dot = symbols()
    inertia, force = sympy_module().sympify(1), sympy_module().sympify(0)
    for term, value in pairs:
        added, push = traced(term, q, q_dot)
        inertia, force = inertia + value * added, force + value * push
        if isinstance(term, Input):
            force -= term.sign * value * symbol(term)
    return inertia, force


def acceleration(pairs: Pairs) -> Any:
    """q_ddot as a sympy expression of `symbols`; inputs are functions of the real symbol t."""
    sympy = sympy_module()
    t = sympy.Symbol("t", real=True)
    inertia, force = inertia_and_force(
        pairs, lambda term: sympy.Function(term.name)(t - whole(term.delay)) ** term.power
    )
    return -force / inertia


def python_script(pairs: Pairs, title: str) -> str:
    """Python that makes the sympy expression ``q_ddot``, every number to its last digit."""
    sympy = sympy_module()
    q_ddot, names = acceleration(pairs), list(_sources(pairs))
    functions = {f.func.__name__ for f in q_ddot.atoms(sympy.Function, sympy.Max, sympy.Min)}
    imports = {"symbols", *functions, *(["Function"] if names else [])} - {*names}
    inputs = ['t = symbols("t", real=True)\n'] if names else []
    inputs += [f'{name} = Function("{name}")\n' for name in names]
    code = sympy.sstr(exact(q_ddot))
    return (
        f"{comment('#', pairs, title)}\n"
        f"from sympy import {', '.join(sorted(imports))}\n\n"
        'q, q_dot = symbols("q q_dot", real=True)\n'
        f"{''.join(inputs)}"
        f"q_ddot = (\n        {wrapped(code)}\n)"
    )


def matlab_function(pairs: Pairs, title: str, name: str) -> str:
    """Text of a function for ``ode45``, for a file ``name``.m; inputs are functions of time."""
    sympy, inputs, sum_name = sympy_module(), _sources(pairs), _sum_name(pairs)
    both = inertia_and_force(
        pairs, lambda term: sympy.Symbol(term.called(term.delay)) ** term.power
    )
    inertia, force = (sympy.octave_code(exact(x)) for x in both)
    call = f"[t, y] = ode45({_handle([*inputs.values()], named(name))}, [t0 t1], [q0; q_dot0]"
    use = f"dy/dt of y = [q; q_dot]: {call}, odeset('RelTol', 1e-9));"
    samples = ["tu and u are the times and the samples of the input."] if inputs else []
    return (
        f"function dy = {name}({', '.join(['t', 'y', *inputs])})\n"
        f"{comment('%', pairs, title, use, *samples)}\n"
        "q = y(1);\n"
        "q_dot = y(2);\n"
        f"inertia = {wrapped(inertia, ' ...')};\n"
        f"{sum_name} = {wrapped(force, ' ...')};\n"
        f"dy = [q_dot; -{sum_name} / inertia];\n"
        "end"
    )


def c_function(pairs: Pairs, title: str, name: str) -> str:
    """Text of a C99 function; inputs are values."""
    sympy, inputs, sum_name = sympy_module(), _inputs(pairs), _sum_name(pairs)
    both = inertia_and_force(pairs, lambda term: sympy.Symbol(_value(term)))
    inertia, force = map(sympy.ccode, both)
    values = [
        f"The argument {_value(term)} is {term.raised(term.called(term.delay))}." for term in inputs
    ]
    arguments = ["const double y[2]", *(f"double {_value(term)}" for term in inputs)]
    arguments.append("double dy[2]")
    return (
        f"{comment('//', pairs, title, 'dy/dt of y = {q, q_dot}; link with -lm.', *values)}\n"
        "#include <math.h>\n\n"
        f"void {named(name)}(double t, {', '.join(arguments)})\n"
        "{\n"
        "    const double q = y[0], q_dot = y[1];\n"
        f"    const double inertia = {wrapped(inertia)};\n"
        f"    const double {sum_name} = {wrapped(force)};\n"
        "    (void)t;\n"
        "    dy[0] = q_dot;\n"
        f"    dy[1] = -{sum_name} / inertia;\n"
        "}"
    )


def _inputs(pairs: Pairs) -> list[Input]:
    return [term for term, _ in pairs if isinstance(term, Input)]


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


# -- what a model of several coordinates shares (`romsindy.physics.coupled_export`) ---------------


def exact(expression: Any) -> Any:
    """The same, so that printers show every digit of its numbers."""
    sympy = sympy_module()
    return expression.xreplace({x: sympy.Float(x, 17) for x in expression.atoms(sympy.Float)})


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


# -- laws with sympy in the place of numbers ------------------------------------------------------


def sympy_module() -> Any:
    """Sympy, or a ValueError that says how to install it."""
    try:
        return import_module("sympy")
    except ImportError:
        raise ValueError(
            "to export a model needs sympy, which is not installed: python -m pip install"
            ' "romsindy[export]"'
        ) from None


def traced(term: Term, q: Any, q_dot: Any) -> tuple[Any, Any]:
    """What a law adds to M and to K + N q_dot^2 + D, as expressions of two others.

    Raises
    ------
    ValueError
        If it does something that sympy has no word for.
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
_NAMES = {"maximum": "Max", "minimum": "Min"}
_LIKE: dict[Callable, int] = {np.ones_like: 1, np.zeros_like: 0}


class _Traced(NDArrayOperatorsMixin):
    """A sympy expression that numpy's operators and functions take for an array."""

    def __init__(self, expression: Any) -> None:
        self.expression = sympy_module().sympify(expression)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        name = ufunc.__name__
        function = _OPERATIONS.get(name) or getattr(sympy_module(), _NAMES.get(name, name), None)
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
