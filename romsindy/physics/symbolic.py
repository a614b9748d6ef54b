"""Laws with sympy in the place of numbers and arrays: what an exporter writes down."""

from __future__ import annotations

import operator
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from romsindy.physics.term import Term

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
