"""Compiled loops over quadratic, planar, geometrically exact beam elements.  Notation as in [1]:

    eps   = (1 + u') cos(theta) + w' sin(theta) - 1        axial strain
    gamma = w' cos(theta) - (1 + u') sin(theta)            shear strain
    kappa = theta'                                         curvature

with N = EA eps, Q = GA gamma, M = EI kappa.  Strains are integrated with two Gauss points (reduced,
so that a thin beam does not lock).

Arrays: nodal fields (n_nodes, 3), element matrices (n_elements, 9, 9).  Element e owns the nodes
2e, 2e + 1, 2e + 2, so that a chain of element matrices can be eliminated front by front and is
never assembled.  numba keeps the compiled code beside this file (`cache=True`).  Loops stand where
numpy would have slices: numba compiles them several times as fast.

[1] J. C. Simo, L. Vu-Quoc, "On the dynamics of flexible beams under large overall motions - the
    plane case", J. Appl. Mech. 53 (1986) 849-854, doi 10.1115/1.3171870.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from romsindy.structure.kernel import compiled

_XI = 1.0 / np.sqrt(3.0)
# shape functions and slopes (d/dxi) at the two strain points
_N = np.array([[0.5 * x * (x - 1), 1 - x * x, 0.5 * x * (x + 1)] for x in (-_XI, _XI)])
_DN = np.array([[x - 0.5, -2 * x, x + 0.5] for x in (-_XI, _XI)])


@compiled
def at_strain_point(field, a, g, scale):  # type: ignore[no-untyped-def]
    """Return the slopes of u, w, theta, and theta, of the element whose first node is a."""
    du = dw = dth = th = 0.0
    for i in range(3):
        dn = _DN[g, i] * scale
        du += dn * field[a + i, 0]
        dw += dn * field[a + i, 1]
        dth += dn * field[a + i, 2]
        th += _N[g, i] * field[a + i, 2]
    return du, dw, dth, th


@compiled
def strains(du, dw, th):  # type: ignore[no-untyped-def]
    """Return eps, gamma and cos(theta), sin(theta).

    The half angle gives cos(theta) - 1 without the 1: a small strain would drown in its rounding,
    and the stiff axial direction turns that into an acceleration.
    """
    half = np.sin(0.5 * th)
    c, s = 1.0 - 2.0 * half * half, 2.0 * half * np.cos(0.5 * th)
    return du * c + dw * s - 2.0 * half * half, dw * c - du * s - s, c, s


@compiled
def add_internal_force(x, v, length, EA, GA, EI, eta, out):  # type: ignore[no-untyped-def]
    """Add the internal force of every element to `out`, (n_nodes, 3); return the damping power."""
    n_elements = (x.shape[0] - 1) // 2
    scale, weight = 2.0 / length, 0.5 * length
    power = 0.0
    for e in range(n_elements):
        a = 2 * e
        for g in range(2):
            du, dw, dth, th = at_strain_point(x, a, g, scale)
            dvu, dvw, dvt, vt = at_strain_point(v, a, g, scale)
            eps, gamma, c, s = strains(du, dw, th)
            eps_dot = c * dvu + s * dvw + gamma * vt
            gamma_dot = c * dvw - s * dvu - (1.0 + eps) * vt
            N = EA * (eps + eta * eps_dot)
            Q = GA * (gamma + eta * gamma_dot)
            M = EI * (dth + eta * dvt)
            rate = EA * eps_dot * eps_dot + GA * gamma_dot * gamma_dot + EI * dvt * dvt
            power += weight * eta * rate
            fu, fw = weight * (N * c - Q * s), weight * (N * s + Q * c)
            ft = weight * (N * gamma - Q * (1.0 + eps))
            for i in range(3):
                dn = _DN[g, i] * scale
                out[a + i, 0] += dn * fu
                out[a + i, 1] += dn * fw
                out[a + i, 2] += _N[g, i] * ft + dn * weight * M
    return power


@compiled
def strain_energy(x, length, EA, GA, EI):  # type: ignore[no-untyped-def]
    """Return the stored energy [J]."""
    scale = 2.0 / length
    energy = 0.0
    for e in range((x.shape[0] - 1) // 2):
        for g in range(2):
            du, dw, dth, th = at_strain_point(x, 2 * e, g, scale)
            eps, gamma, _, _ = strains(du, dw, th)
            energy += EA * eps * eps + GA * gamma * gamma + EI * dth * dth
    return 0.25 * length * energy


@compiled
def tangent(x, length, EA, GA, EI):  # type: ignore[no-untyped-def]
    """Return (G, D), (n_elements, 9, 9): geometric and material part of the tangent stiffness."""
    n_elements = (x.shape[0] - 1) // 2
    G = np.zeros((n_elements, 9, 9))
    D = np.zeros((n_elements, 9, 9))
    scale, weight = 2.0 / length, 0.5 * length
    for e in range(n_elements):
        for g in range(2):
            du, dw, _, th = at_strain_point(x, 2 * e, g, scale)
            eps, gamma, c, s = strains(du, dw, th)
            stretch = 1.0 + eps
            N, Q = weight * EA * eps, weight * GA * gamma
            wA, wG, wI = weight * EA, weight * GA, weight * EI
            # material part in the basis (u', w', theta, theta')
            uu, uw, ww = wA * c * c + wG * s * s, (wA - wG) * c * s, wA * s * s + wG * c * c
            ut = wA * c * gamma + wG * s * stretch
            wt = wA * s * gamma - wG * c * stretch
            tt = wA * gamma * gamma + wG * stretch * stretch
            gut, gwt = -N * s - Q * c, N * c - Q * s
            gtt = -N * stretch - Q * gamma
            for i in range(3):
                di, ni = _DN[g, i] * scale, _N[g, i]
                for j in range(3):
                    dj, nj = _DN[g, j] * scale, _N[g, j]
                    p, q = 3 * i, 3 * j
                    D[e, p, q] += di * dj * uu
                    D[e, p, q + 1] += di * dj * uw
                    D[e, p + 1, q] += di * dj * uw
                    D[e, p + 1, q + 1] += di * dj * ww
                    D[e, p, q + 2] += di * nj * ut
                    D[e, p + 2, q] += ni * dj * ut
                    D[e, p + 1, q + 2] += di * nj * wt
                    D[e, p + 2, q + 1] += ni * dj * wt
                    D[e, p + 2, q + 2] += ni * nj * tt + di * dj * wI
                    G[e, p, q + 2] += di * nj * gut
                    G[e, p + 2, q] += ni * dj * gut
                    G[e, p + 1, q + 2] += di * nj * gwt
                    G[e, p + 2, q + 1] += ni * dj * gwt
                    G[e, p + 2, q + 2] += ni * nj * gtt
    return G, D


@compiled
def add_product(matrices, field, out):  # type: ignore[no-untyped-def]
    """Add (sum of element matrices) @ field to `out`; field and out are (n_nodes, 3)."""
    flat, result = field.reshape(-1), out.reshape(-1)
    for e in range(matrices.shape[0]):
        a = 6 * e
        for i in range(9):
            total = 0.0
            for j in range(9):
                total += matrices[e, i, j] * flat[a + j]
            result[a + i] += total


@compiled
def factorise(matrices, fixed):  # type: ignore[no-untyped-def]
    """Eliminate the chain of element matrices front by front, in place (real or complex).

    Of each element's nine unknowns the first six are eliminated (all nine of the last element);
    the 3 x 3 rest is handed to the next.  No pivoting: the matrices are stiffness-like, and a
    vanishing pivot shows as a non-finite solution.  `fixed` is (n_nodes, 3); a fixed freedom gets
    the row and column of the identity.
    """
    n_elements = matrices.shape[0]
    for e in range(n_elements):
        S = matrices[e]
        if e > 0:
            for i in range(3):
                for j in range(3):
                    S[i, j] += matrices[e - 1, 6 + i, 6 + j]
        for i in range(9):
            if fixed[2 * e + i // 3, i % 3]:
                for j in range(9):
                    S[i, j] = 0.0
                    S[j, i] = 0.0
                S[i, i] = 1.0
        for k in range(9 if e == n_elements - 1 else 6):
            pivot = 1.0 / S[k, k]
            S[k, k] = pivot
            for i in range(k + 1, 9):
                factor = S[i, k] * pivot
                S[i, k] = factor
                for j in range(k + 1, 9):
                    S[i, j] -= factor * S[k, j]


@compiled
def solve(factors, b):  # type: ignore[no-untyped-def]
    """Solve with the factors of `factorise`, in place; b is (3 * n_nodes,), real or complex."""
    n_elements = factors.shape[0]
    for e in range(n_elements):
        a = 6 * e
        for k in range(9 if e == n_elements - 1 else 6):
            value = b[a + k]
            for i in range(k + 1, 9):
                b[a + i] -= factors[e, i, k] * value
    for e in range(n_elements - 1, -1, -1):
        a = 6 * e
        for k in range(8 if e == n_elements - 1 else 5, -1, -1):
            value = b[a + k]
            for j in range(k + 1, 9):
                value -= factors[e, k, j] * b[a + j]
            b[a + k] = value * factors[e, k, k]


@compiled
def stage_residuals(X, V, a, mass, alpha, weight, length, EA, GA, EI, eta):  # type: ignore[no-untyped-def]
    """Return R_i = M (a_i + alpha v_i) + internal force - weight of every stage i."""
    R, inertial = np.empty_like(X), np.empty_like(weight)
    for i in range(X.shape[0]):
        for n in range(weight.shape[0]):
            for c in range(3):
                R[i, n, c] = -weight[n, c]
                inertial[n, c] = a[i, n, c] + alpha * V[i, n, c]
        add_internal_force(X[i], V[i], length, EA, GA, EI, eta, R[i])
        add_product(mass, inertial, R[i])
    return R


@compiled
def stage_powers(X, V, mass, alpha, length, EA, GA, EI, eta):  # type: ignore[no-untyped-def]
    """Return the power [W] that Rayleigh damping takes at every stage."""
    powers = np.zeros(X.shape[0])
    for i in range(X.shape[0]):
        out = np.zeros_like(X[i])
        powers[i] = add_internal_force(X[i], V[i], length, EA, GA, EI, eta, out)
        if alpha > 0.0:
            momentum = np.zeros_like(X[i])
            add_product(mass, V[i], momentum)
            total = 0.0
            for n in range(momentum.shape[0]):
                for c in range(3):
                    total += momentum[n, c] * V[i, n, c]
            powers[i] += alpha * total
    return powers


@compiled
def factorise_shifted(mass, C, K, z, fixed, out):  # type: ignore[no-untyped-def]
    """Write the factors of M + z_k C + z_k^2 K for every z_k into out[k]; real or complex."""
    for k in range(out.shape[0]):
        for e in range(mass.shape[0]):
            for i in range(9):
                for j in range(9):
                    out[k, e, i, j] = mass[e, i, j] + z[k] * C[e, i, j] + z[k] * z[k] * K[e, i, j]
        factorise(out[k], fixed)


@compiled
def turn(field, angle, sign):  # type: ignore[no-untyped-def]
    """Turn the (x, y) parts of a nodal field by sign * angle, node by node, in place."""
    for n in range(field.shape[0]):
        c, s = np.cos(angle[n]), sign * np.sin(angle[n])
        fx, fy = field[n, 0], field[n, 1]
        field[n, 0], field[n, 1] = c * fx - s * fy, s * fx + c * fy


@compiled
def newton_update(  # type: ignore[no-untyped-def]
    R, X, V, a, theta, h, A, to_acceleration, real_part, complex_part
):
    """Improve stages X, V, a in place from their residuals R; return (max |da|, max |a|) [m/s^2].

    `real_part` and `complex_part` each hold (eigenvalues, columns of T, rows of T^-1, factors).
    The factors belong to the tangent at a reference state with section angles `theta`.  Residuals
    are turned back to that state node by node and increments turned forth: the stiff axial
    direction of the tangent then follows the beam, and the iteration converges three times as
    fast (a rotation by delta spoils a fixed tangent by delta^2 h^2 omega_axial^2).
    """
    angle, dX = np.empty(X.shape[:2]), np.zeros_like(X)
    for i in range(X.shape[0]):
        for n in range(X.shape[1]):
            angle[i, n] = X[i, n, 2] - theta[n]
    for i in range(len(X)):
        turn(R[i], angle[i], -1.0)
    flat, dflat = R.reshape(len(X), -1), dX.reshape(len(X), -1)
    add_part(flat, h, real_part, 1.0, dflat)
    add_part(flat, h, complex_part, 2.0, dflat)  # twice the real part: the conjugate is left out
    for i in range(len(X)):
        turn(dX[i], angle[i], 1.0)
    return apply_increments(dX, X, V, a, h, A, to_acceleration)


@compiled
def add_part(residuals, h, part, share, out):  # type: ignore[no-untyped-def]
    """Add what some eigenvalues say of the increments, times `share`; all flat, one row a stage."""
    values, columns, rows, factors = part
    stages, size = residuals.shape
    for k in range(len(values)):
        b = np.zeros(size, dtype=values.dtype)
        for i in range(stages):
            weight = -((h * values[k]) ** 2) * rows[k, i]
            for n in range(size):
                b[n] += weight * residuals[i, n]
        solve(factors[k], b)
        for i in range(stages):
            for n in range(size):
                out[i, n] += share * (columns[i, k] * b[n]).real


@compiled
def apply_increments(dX, X, V, a, h, A, to_acceleration):  # type: ignore[no-untyped-def]
    """Add displacement increments to the stages, and the velocities and accelerations of these."""
    stages, n_nodes = X.shape[0], X.shape[1]
    change = largest = 0.0
    da = np.zeros(stages)
    for n in range(n_nodes):
        for c in range(3):
            for i in range(stages):
                da[i] = 0.0
                for j in range(stages):
                    da[i] += to_acceleration[i, j] * dX[j, n, c]
                da[i] /= h * h
            for i in range(stages):
                X[i, n, c] += dX[i, n, c]
                a[i, n, c] += da[i]
                for j in range(stages):
                    V[i, n, c] += h * A[i, j] * da[j]
                if c < 2:
                    change = max(change, abs(da[i]))
                    largest = max(largest, abs(a[i, n, c]))
                    if not np.isfinite(da[i]):
                        return np.inf, np.inf
    return change, largest


def warning() -> str:
    """What makes the first run slow, or every one; nothing where the compiled code is at hand."""
    if not hasattr(newton_update, "stats"):
        return "numba cannot be imported: beams are simulated some 300 times as slowly"
    cache = Path(newton_update.stats.cache_path or ".")
    if newton_update.signatures or any(cache.glob("kernel.newton_update*.nbi")):
        return ""
    return "compiling the beam kernels (first run only, some 10 s)"
