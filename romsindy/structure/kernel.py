"""Compiled loops over motions of structures: their functions of q, and a stage of a step in time.

Functions are named by `ringing.RungTables`; of their vectors x' is 0, x'' is 1, then psi, psi' and
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
    y, values, there, along, push, omega2, rates, alpha, stiffer, out, mass, massless
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
def stage(number, h, y, kept, known, given, here, pushes, inertia):  # type: ignore[no-untyped-def]
    """One of the four stages of a step h from states y, (l, 2 m), and a look at where it leads.

    Linear modes go by ``half``, (l, m, 4): displacement and rate after h / 2, by those before. The
    functions of `look`, ``here``, are those at ``z`` before and after.
    """
    half, z, middle, first, both, out = kept
    _, values, there, along, _, _ = here
    accelerate(z, values, there, along, pushes, *known, out, *inertia)
    m = out.shape[1]
    for i in range(len(y)):
        for j in range(m):
            f, t = out[i, j], half[i, j]
            x, v = y[i, j], y[i, m + j]
            if number == 0:
                first[i, j] = f
                middle[i, j], middle[i, m + j] = _later(x, v, t)
                z[i, j], z[i, m + j] = _later(x, v + 0.5 * h * f, t)
            elif number == 1:
                both[i, j] = f
                z[i, j], z[i, m + j] = middle[i, j], middle[i, m + j] + 0.5 * h * f
            elif number == 2:
                both[i, j] += f
                z[i, j], z[i, m + j] = _later(middle[i, j], middle[i, m + j] + h * f, t)
            else:
                x, v = _later(x, v + h / 6.0 * first[i, j], t)
                x, v = _later(x, v + h / 3.0 * both[i, j], t)
                y[i, j] = z[i, j] = x
                y[i, m + j] = z[i, m + j] = v + h / 6.0 * f
    look(z, *given, *here)


@compiled
def _later(x, v, t):  # type: ignore[no-untyped-def]
    """Displacement and rate of a linear mode."""
    return t[0] * x + t[1] * v, t[2] * x + t[3] * v


@compiled
def check(at, ends, y, z, reach, given, here, gone, inertia):  # type: ignore[no-untyped-def]
    """Let motions rest that are at their ends, ``gone`` from what is known, or without a mass."""
    (centre, half, _, _, _), (_, massless) = given, inertia
    for i in range(len(y)):
        ended = at >= ends[i]
        gone[i] = gone[i] or not (ended or abs(y[i, 0] - centre[i]) < reach * half[i])
        if ended or gone[i] or massless[i]:
            y[i] = z[i] = 0.0
    look(z, *given, *here)


@compiled
def run(states, ends, parts, h, reach, y, kept, known, given, here, pushes, gone, inertia):  # type: ignore[no-untyped-def]
    """States of motions on which no force acts, ``parts`` steps of h apart: (l, n, 2 m + 1)."""
    for i in range(states.shape[1]):
        check(i, ends, y, kept[1], reach, given, here, gone, inertia)
        states[:, i, :-1] = y
        for _ in range(parts if i + 1 < states.shape[1] else 0):
            for number in range(4):
                stage(number, h, y, kept, known, given, here, pushes, inertia)
