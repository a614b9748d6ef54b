"""Closed forms and published values for the beam; none was produced by this project.

Static, modal and backbone tables: exact elastica computations, L = rho A = EI = 1 unless stated.
TIP_LOAD agrees with K. Mattiasson, IJNME 17 (1981) 145-153, table 1; BATISTA is M. Batista, IJSS 87
(2016) 153-166; GERADIN is M. Geradin, A. Cardona, Flexible Multibody Dynamics (2001).
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

# P L^2 / EI: (w/L, shortening/L, tip rotation)
TIP_LOAD = {
    0.1: (0.0332953192682, 0.000665399963048, 0.0499542557548),
    0.5: (0.162143575658, 0.0159189624708, 0.244533647133),
    1.0: (0.301720773800, 0.0564332362834, 0.461351949712),
    2.0: (0.493457480397, 0.160641720825, 0.781749831557),
    5.0: (0.713791523612, 0.387628360724, 1.21536811761),
    10.0: (0.81060902488, 0.554995597754, 1.4302855388),
}
# q L^3 / EI: (w/L, shortening/L, tip rotation)
UNIFORM_LOAD = {
    1.0: (0.1234714020, 0.0087536047, 0.1651155605),
    4.0: (0.4251592842, 0.1098892533, 0.5885923721),
    10.0: (0.7001997155, 0.3436462388, 1.0526431172),
}
# GA: (x - 1, y) of the tip for F = EI = 10, L = 1, EA infinite
BATISTA = {
    500.0: (-0.061315658, 0.317813874),
    50.0: (-0.103284917, 0.465413303),
    10.0: (-0.252136606, 1.167095878),
}
# L = 5, tip dead load 600e3, EA, GA, EI below: (x, y, rotation) of the tip
GERADIN_SECTION = (4.8e8, 3.231e8, 9.346e6)
GERADIN_TIP = (4.403530, -2.159692, 0.672006)

BETA_CLAMPED_FREE = (1.875104068712, 4.694091132974, 7.854757438238)
BETA_CLAMPED_CLAMPED = (4.730040744863, 7.853204624096, 10.995607838002)

# mode: (omega^2, gamma_3, Upsilon_3); mode 1 also (gamma_5, Upsilon_5)
SINGLE_MODE = {
    1: (12.3623633683, 40.44066345, 4.59677250),
    2: (485.5188185134, 13418.09939, 144.7255655),
    3: (3806.5462663915, 264365.4937, 999.8275169),
}
GAMMA_5, UPSILON_5 = 147.96917, 19.747053

# load f phi_1: (q, w_tip/L, u_tip/L, x'Mx' - 1, f/q)
FINITE_AMPLITUDE = {
    0.1: (0.008087337, 0.016174464, -0.000152003, 0.000300737, 12.365009024),
    1.0: (0.079225688, 0.158251457, -0.014669776, 0.029650888, 12.622168657),
    2.0: (0.149798780, 0.298209240, -0.053245254, 0.114084174, 13.351243569),
    4.4: (0.269016601, 0.529217450, -0.180785929, 0.477910535, 16.355867937),
}

# max w_tip/L: Omega/omega_1 - 1 of the nonlinear normal mode
BACKBONE = {
    0.1: 1.9448e-4,
    0.2: 7.8594e-4,
    0.3: 1.80018e-3,
    0.4: 3.28729e-3,
    0.5: 5.33726e-3,
}

# the dimensional example: L = 0.3 m, 25 x 1 mm, E = 205 GPa, rho = 7800 kg/m^3
EXAMPLE = {
    "omega": 57.8159,
    "gamma_3": 2.07689e6,
    "Upsilon_3": 873.081,
    "gamma_5": 1.44334e9,
    "Upsilon_5": 7.1237e5,
    "axial": 26842.83,
}


def axial_root(mass_ratio: float, spring_ratio: float, count: int = 2) -> list[float]:
    """Return the roots of b cot b = mu b^2 - kappa: axial modes with tip mass and tip spring."""

    def f(b: float) -> float:
        return b * np.cos(b) - (mass_ratio * b**2 - spring_ratio) * np.sin(b)

    grid = np.linspace(0.1, 3.2 * (count + 1), 400)
    signs = np.sign([f(b) for b in grid])
    where = np.flatnonzero(signs[1:] != signs[:-1])[:count]
    return [brentq(f, grid[i], grid[i + 1], xtol=1e-14) for i in where]


def elastic_clamp_root(stiffness: float) -> float:
    """Return the first beta L of a beam on a rotational spring k L / EI at one end, free else."""

    def f(b: float) -> float:
        c, s, ch, sh = np.cos(b), np.sin(b), np.cosh(b), np.sinh(b)
        return stiffness * (1 + c * ch) - b * (s * ch - c * sh)

    return brentq(f, 0.1, 1.8751040687, xtol=1e-14)


def frequency(t: np.ndarray, q: np.ndarray) -> float:
    """Return the mean angular frequency between the first and the last upward crossing of zero."""
    crossings = CubicSpline(t, q).roots(extrapolate=False)
    upward = crossings[np.flatnonzero(CubicSpline(t, q)(crossings, 1) > 0)]
    return 2.0 * np.pi * (len(upward) - 1) / (upward[-1] - upward[0])
