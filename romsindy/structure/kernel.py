"""Compiled loops over motions of structures: their functions of q, and a stage of a step in time.

Functions are named by `in_time.RungTables`; of their vectors x' is 0, x'' is 1, then psi, psi' and
psi'' of k modes that ring. Products of vectors are the lower triangle of their matrix.
"""

from __future__ import annotations

from typing import Any

import numpy as np

try:
    from numba import njit
except ImportError:  # it has no wheels for every machine
    njit = None  # type: ignore[assignment]


def compiled(loop: Any) -> Any:
    """Compile a loop at its first call, and keep the code; without numba it is interpreted."""
    return loop if njit is None else njit(cache=True, error_model="numpy")(loop)


@compiled
def polynomials(x, terms):  # type: ignore[no-untyped-def]
    """Chebyshev polynomials of x."""
    terms[0], terms[1] = 1.0, x
    for i in range(2, len(terms)):
        terms[i] = 2.0 * x * terms[i - 1] - terms[i - 2]


@compiled
def look(  # type: ignore[no-untyped-def]
    y, centre, half, first, curves, points, terms, values, there, along, moved, speed
):
    """Functions at states y (l, 2 m); displacement and velocity of the points of forces, (l,).

    A force does work ``along`` (l, m). Motions of one structure stand together, the ``first`` of
    each by number.
    """
    m = y.shape[1] // 2
    k = m - 1
    for i in range(len(y)):
        polynomials((y[i, 0] - centre[i]) / half[i], terms[i])
        np.dot(terms[i], points[i], there[i])
    for u in range(len(curves)):
        own = slice(first[u], first[u + 1])
        np.dot(terms[own], curves[u], values[own])
    for i in range(len(y)):
        v = there[i]
        moved[i], along[i, 0] = v[0], v[1]
        for j in range(k):
            moved[i] += v[3 + j] * y[i, 1 + j]
            along[i, 0] += v[3 + k + j] * y[i, 1 + j]
            along[i, 1 + j] = v[3 + j]
        speed[i] = 0.0
        for j in range(m):
            speed[i] += along[i, j] * y[i, m + j]


@compiled
def _product(v, p, a, b):  # type: ignore[no-untyped-def]
    """Of two vectors, with the mass of what moves: what is added acts on the last of p."""
    if a < b:
        a, b = b, a
    return v[a * (a + 1) // 2 + b] + p[-1] * p[1 + a] * p[1 + b]


@compiled
def accelerate(  # type: ignore[no-untyped-def]
    y, values, there, along, push, omega2, rates, alpha, stiffer, mass, out, massless
):
    """Accelerations (l, m) beside those of linear modes; a mass that is not positive is told."""
    m = y.shape[1] // 2
    k = m - 1
    products = (2 + 3 * k) * (3 + 3 * k) // 2
    for i in range(len(y)):
        v, p, r, q_dot, rung = values[i, :products], there[i], y[i, 1:m], y[i, m], y[i, m + 1 :]
        rest = values[i, products:]  # K, s', W, W'
        own = rates[i] - alpha[i]
        f = out[i]
        # The vector along which q moves it is x' + sum r psi'; what bends beside accelerations is
        # q_dot^2 x'' + sum 2 q_dot r_dot psi' + q_dot^2 r psi''.
        for row in range(m):
            momentum, turning = _moved(v, p, 1 + row if row else 0, r, q_dot, rung)
            if row == 0:
                for j in range(k):
                    one, other = _moved(v, p, 2 + k + j, r, q_dot, rung)
                    momentum += r[j] * one
                    turning += r[j] * other
            mass[row, 0] = mass[0, row] = momentum
            f[row] = -turning
            for column in range(1, row + 1):
                mass[row, column] = mass[column, row] = _product(v, p, 1 + row, 1 + column)
        force = rest[0]
        for a in range(k):
            bent = 0.0
            for b in range(k):
                bent += rest[1 + k + a * k + b] * r[b]
                force += 0.5 * r[a] * rest[1 + k + k * k + a * k + b] * r[b]
            modal = own[1 + a] * (rest[1 + a] * q_dot + rung[a])
            f[0] -= rest[1 + a] * modal
            f[1 + a] -= stiffer[i] * bent + modal
        f[0] -= stiffer[i] * force + own[0] * q_dot
        for a in range(m):
            f[a] += push[i] * along[i, a]
            for b in range(m):
                f[a] -= alpha[i] * mass[a, b] * y[i, m + b]
        massless[i] = massless[i] or not _solve(mass, f)
        for a in range(m):
            f[a] += omega2[i, a] * y[i, a] + rates[i, a] * y[i, m + a]


@compiled
def _moved(v, p, a, r, q_dot, rung):  # type: ignore[no-untyped-def]
    """Products of a vector with that along which q moves, and with what bends."""
    k = len(r)
    momentum = _product(v, p, a, 0)
    turning = q_dot * q_dot * _product(v, p, a, 1)
    for j in range(k):
        by = _product(v, p, a, 2 + k + j)
        momentum += r[j] * by
        turning += 2.0 * q_dot * rung[j] * by
        turning += q_dot * q_dot * r[j] * _product(v, p, a, 2 + 2 * k + j)
    return momentum, turning


@compiled
def _solve(a, x):  # type: ignore[no-untyped-def]
    """Solve a x = b in place by Cholesky; whether a is positive definite."""
    n = len(x)
    for i in range(n):
        for j in range(i + 1):
            for p in range(j):
                a[i, j] -= a[i, p] * a[j, p]
            if j < i:
                a[i, j] /= a[j, j]
            elif not a[i, i] > 0.0:
                x[:] = 0.0
                return False
            else:
                a[i, i] = np.sqrt(a[i, i])
    for i in range(n):
        for j in range(i):
            x[i] -= a[i, j] * x[j]
        x[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] -= a[j, i] * x[j]
        x[i] /= a[i, i]
    return True


@compiled
def step(y, by, half, out):  # type: ignore[no-untyped-def]
    """States y (l, 2 m) pushed ``by`` (l, m), a change of rates, and then half a step later.

    ``half`` (l, m, 4) has the displacement and the rate of a linear mode after that time, by
    those before.
    """
    m = y.shape[1] // 2
    for i in range(len(y)):
        for j in range(m):
            x, v, h = y[i, j], y[i, m + j] + by[i, j], half[i, j]
            out[i, j] = h[0] * x + h[1] * v
            out[i, m + j] = h[2] * x + h[3] * v
