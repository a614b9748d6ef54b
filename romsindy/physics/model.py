"""The identified equation of motion: terms, coefficients, and what follows from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import ArrayLike
from scipy.optimize import elementwise

from romsindy.physics import export
from romsindy.physics.coupling import CoupledTerm
from romsindy.physics.equations import SINGULAR, Equations
from romsindy.physics.input import Input
from romsindy.physics.integration import integrate_strokes
from romsindy.physics.term import Term
from romsindy.physics.validation import require_finite
from romsindy.record.decay import Decay
from romsindy.typing import Array

# Gauss points over half a period: 80 give the period to 12 digits for polynomial models.
_GAUSS = np.polynomial.legendre.leggauss(80)
# The centre of an orbit is sought so far from 0, in amplitudes, one after the other: far outside of
# its data a polynomial of high order is not to be trusted.
_NEAR = (0.02, 0.1, 0.5)
_NEWTON, _SETTLED = 5, 1e-13  # steps within the nearest; the last of them, in amplitudes
# Parts of the equation that are functions of q alone.
_OF_Q = ("inertia", "convection", "stiffness")


@dataclass(frozen=True)
class ReducedModel(Equations):
    """Equation M(q) q_ddot + N(q) q_dot^2 + K(q) + D(q, q_dot) = 0 with known coefficients.

    Parameters
    ----------
    terms : tuple of Term
    values : tuple of float
        Coefficient of each term, in the unit of q and seconds.
    unit : str, optional
        Unit of q, such as "m"; None where it is not known.
    amplitude_range : (float, float), optional
        Least and largest amplitude of the data behind the model, in the unit of q.

    Examples
    --------
    >>> model = ReducedModel.from_coefficients({"omega^2": 36.0, "gamma_3": 9.0}, unit="m")
    >>> print(model)
    q_ddot + 36 q + 9 q^3 = 0    (q in m, t in s)
      omega^2                36  1/s^2           omega = 6 rad/s, 0.95493 Hz
      gamma_3                 9  1/(m^2 s^2)
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        coupled = [t.key for t in self.terms if isinstance(t, CoupledTerm)]
        if coupled:
            raise ValueError(
                f"the terms {coupled} are of several coordinates: use CoupledModel in the place of"
                " ReducedModel"
            )

    coordinates = ("q",)

    @property
    def pushes(self) -> list[tuple[Input, float | Array]]:
        """Inputs, each with its coefficient."""
        return [(term, value) for term, value in self.pairs if isinstance(term, Input)]

    n_coordinates = 1  # no field; shapes without an axis for it are the plain and the quick way

    @cached_property
    def _cache(self) -> dict[str, tuple[Array, list[tuple[float, Callable]]]]:
        return {}

    # -- the four functions of the equation ---------------------------------------------------

    def inertia(self, q: ArrayLike) -> Array:
        """M(q) = 1 + h(q), shape of q."""
        return 1.0 + self._total("inertia", q)

    def convection(self, q: ArrayLike) -> Array:
        """N(q), what multiplies q_dot^2, shape of q."""
        return self._total("convection", q)

    def stiffness(self, q: ArrayLike) -> Array:
        """K(q), restoring force per unit mass, shape of q."""
        return self._total("stiffness", q)

    def damping(self, q: ArrayLike, q_dot: ArrayLike) -> Array:
        """D(q, q_dot), damping force per unit mass, shape of q."""
        return self._total("damping", q, q_dot)

    def residual(self, q: ArrayLike, q_dot: ArrayLike, q_ddot: ArrayLike) -> Array:
        """Left side of the equation, shape of q: zero along a free motion."""
        q, q_dot, q_ddot = (np.asarray(x, float) for x in (q, q_dot, q_ddot))
        h, convection, stiffness = self._functions(q)[:3]
        residual = (1.0 + h) * q_ddot + convection * q_dot**2 + stiffness
        for term, c in self._damped:
            residual = residual + c * term.damping(q, q_dot)
        return np.asarray(residual)

    def linearise(self, q: Array, q_dot: Array, q_ddot: Array) -> tuple[Array, Array, Array, Array]:
        """Residual and its derivatives with respect to q, q_dot and q_ddot, shape of q each."""
        squared = q_dot * q_dot
        h, convection, stiffness, h_dq, convection_dq, stiffness_dq = self._functions(q)
        inertia = 1.0 + h
        residual = inertia * q_ddot + convection * squared + stiffness
        by_q = h_dq * q_ddot + convection_dq * squared + stiffness_dq
        by_q_dot = 2.0 * convection * q_dot
        for term, c in self._damped:
            residual += c * term.damping(q, q_dot)
            by_q += c * term.damping_dq(q, q_dot)
            by_q_dot += c * term.damping_dq_dot(q, q_dot)
        return residual, by_q, by_q_dot, inertia

    def residual_and_slopes(
        self, q: Array, q_dot: Array, q_ddot: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Residual (..., 1), its derivatives by q, q_dot and q_ddot (..., 1, 1) at (..., 1)."""
        residual, by_q, by_q_dot, inertia = self.linearise(q, q_dot, q_ddot)
        return residual, by_q[..., None], by_q_dot[..., None], inertia[..., None]

    @cached_property
    def _damped(self) -> list[tuple[Term, float]]:
        return [(term, value) for term, value in self.pairs if term.has("damping")]

    def _functions(self, q: Array) -> Array:
        """h, N, K and their derivatives, (6, *shape of q): all from one table of powers of q."""
        powers, others = self._expanded
        table = np.vander(q.ravel(), len(powers), increasing=True)
        found = (table @ powers).T.reshape(-1, *q.shape)
        for row, coefficient, function in others:
            found[row] += coefficient * function(q)
        return found

    @cached_property
    def _expanded(self) -> tuple[Array, list[tuple[int, float, Callable]]]:
        """Coefficients of the powers of q in `_functions`, (n, 6), and what is no power."""
        sums = [self._sums(part) for part in _OF_Q]
        rows = [row for row, _ in sums] + [polyder(row) if len(row) else row for row, _ in sums]
        powers = np.zeros((max(map(len, rows)), len(rows)))
        for column, row in zip(powers.T, rows, strict=True):
            column[: len(row)] = row
        others = []
        for i, part in enumerate(_OF_Q):
            for term, value in self.pairs:
                if term.has(part) and term.monomial(part) is None:
                    others.append((i, value, getattr(term, part)))
                    others.append((i + len(_OF_Q), value, getattr(term, f"{part}_dq")))
        return powers, others

    def _total(self, part: str, *arguments: ArrayLike) -> Array:
        arrays = np.broadcast_arrays(*(np.asarray(a, float) for a in arguments))
        powers, others = self._sums(part)
        # Many powers of q at once, by Horner's rule: an orbit asks for them thousands of times.
        total = polyval(arrays[0], powers) if len(powers) else np.zeros_like(arrays[0])
        for coefficient, function in others:
            total = total + coefficient * function(*arrays)
        return np.asarray(total)

    def _sums(self, part: str) -> tuple[Array, list[tuple[float, Callable]]]:
        """Coefficients of the powers of q in a part, and what is no power."""
        if part not in self._cache:
            powers: dict[int, float] = {}
            others = []
            for term, value in self.pairs:
                monomial = term.monomial(part)
                if monomial is not None:
                    powers[monomial[1]] = powers.get(monomial[1], 0.0) + value * monomial[0]
                elif term.has(part):
                    others.append((value, getattr(term, part)))
            row = [powers.get(i, 0.0) for i in range(max(powers, default=-1) + 1)]
            self._cache[part] = np.array(row), others
        return self._cache[part]

    def _parts(self, part: str) -> list[tuple[float, Callable]]:
        return [(value, getattr(term, part)) for term, value in self.pairs if term.has(part)]

    def acceleration(self, q: ArrayLike, q_dot: ArrayLike, push: Array | float = 0.0) -> Array:
        """q_ddot of the free motion, or under a force of inputs per unit mass, shape of q.

        Raises
        ------
        SingularInertiaError
            If 1 + h(q) <= 0 (or below 0.001) somewhere.
        """
        q, q_dot = np.asarray(q, float), np.asarray(q_dot, float)
        inertia = self.inertia(q)
        if np.any(inertia <= SINGULAR):
            self._refuse(q)
        force = self.stiffness(q) + self.convection(q) * q_dot**2 + self.damping(q, q_dot)
        return np.asarray((push - force) / inertia)

    def objection(self, q: ArrayLike) -> str:
        """Why no motion goes through all positions q, of any shape; empty if one may."""
        q, inertia = np.asarray(q, float), self.inertia(q)
        if np.min(inertia) > SINGULAR:
            return ""
        at = float(q.flat[int(np.argmin(inertia))])
        return f"1 + h(q) = {np.min(inertia):.3g} is not positive at q = {at:.6g}"

    # -- motion -------------------------------------------------------------------------------

    def _state(self, q0: Any, q_dot0: Any) -> Array:
        require_finite("q0", q0)
        require_finite("q_dot0", q_dot0)
        return np.array([q0, q_dot0], float)

    def _by_strokes(self, state: Array, t: Array, rtol: float, scale: float) -> Decay:
        if self.memories:
            return super()._by_strokes(state, t, rtol, scale)
        q, q_dot, rests = integrate_strokes(self._quick_acceleration(), state, t, rtol, scale)
        q_ddot = np.where(rests, 0.0, self.acceleration(q, q_dot))
        return Decay(t, q, q_dot, q_ddot, unit=self.unit)

    def _quick_acceleration(self) -> Callable[..., float]:
        mass_and_force = self.mass_and_force()

        def acceleration(q: float, q_dot: float, push: float = 0.0) -> float:
            mass, force = mass_and_force(q, q_dot)
            if mass <= SINGULAR:
                self._refuse(np.array(q))
            return (push - force) / mass

        return acceleration

    def mass_and_force(self) -> Callable[[float, float], tuple[float, float]]:
        """A function of q and q_dot, plain floats: M(q) and K + N q_dot^2 + D.

        An integrator calls it 1e5 times, and arrays of one cost ten times more.
        """
        inertia, convection = self._parts("inertia"), self._parts("convection")
        stiffness, damping = self._parts("stiffness"), self._parts("damping")

        def both(q: float, q_dot: float) -> tuple[float, float]:
            mass = 1.0
            for c, f in inertia:
                mass += c * f(q)
            force = 0.0
            for c, f in convection:
                force += c * f(q)
            force *= q_dot * q_dot
            for c, f in stiffness:
                force += c * f(q)
            for c, f in damping:
                force += c * f(q, q_dot)
            return mass, force

        return both

    # -- energy and backbone ------------------------------------------------------------------

    def energy(self, q: ArrayLike, q_dot: ArrayLike) -> Array:
        """First integral of the undamped motion, per unit mass, shape of q.

        Kinetic M q_dot^2/2 plus potential energy. Where convection is not half the derivative of
        inertia (`BeamTheoryLibrary`), the equation has an integrating factor that takes M's place.
        """
        q = np.asarray(q, float)
        factor, potential = self._energies(float(np.max(np.abs(q), initial=0.0)))
        return factor(q) * np.asarray(q_dot, float) ** 2 / 2 + potential(q)

    def _energies(self, reach: float) -> tuple[Callable, Callable]:
        """Integrating factor mu(q) and potential U(q) on |q| <= reach."""
        self.refuse_memory("an energy or a backbone")
        if all(term.conservative_inertia for term in self.terms):
            return self.inertia, lambda q: self._total("potential", q)
        # d(q_dot^2)/dq + 2 N/M q_dot^2 = -2 K/M  has the factor  mu = exp(int 2 N/M dq).
        low, high = -self._regular(-reach or -1.0), self._regular(reach or 1.0)

        def integral(f: Callable) -> Chebyshev:
            return Chebyshev.interpolate(f, 120, domain=[low, high]).integ(lbnd=0.0)

        log_factor = integral(lambda q: 2 * self.convection(q) / self.inertia(q))
        potential = integral(lambda q: np.exp(log_factor(q)) * self.stiffness(q) / self.inertia(q))

        def factor(q: Array) -> Array:
            inside = np.clip(q, low, high)
            return np.where(inside == q, np.exp(log_factor(inside)), np.nan)

        return factor, lambda q: potential(np.clip(q, low, high))

    def _regular(self, reach: float) -> float:
        """How far from 0 towards ``reach`` the inertia stays positive; polynomials end at poles."""
        q = np.linspace(0.0, reach, 2000)
        singular = np.flatnonzero(self.inertia(q) <= 0)
        return abs(reach) if not len(singular) else 0.98 * abs(float(q[singular[0]]))

    def backbone(self, amplitudes: ArrayLike) -> Array:
        """Angular frequency of the undamped model, by energy quadrature.

        T = 2 int sqrt(mu / (2 (E - U))) dq between the turning points, with q = c + a sin(theta).

        Parameters
        ----------
        amplitudes : (n,) array
            Half peak-to-peak amplitudes, positive, unit of q.

        Returns
        -------
        (n,) array
            rad/s; nan where the model has no periodic motion of that amplitude around q = 0.

        Raises
        ------
        ValueError
            If an amplitude is not positive.
        """
        return self._orbit(amplitudes).frequency

    def damping_ratio(self, amplitudes: ArrayLike) -> Array:
        """Damping ratio against amplitude, from the work of the damping over one undamped cycle.

        zeta = (energy lost in a cycle) / (2 pi a dE/da), which is c/(2 omega) for viscous damping.

        Parameters
        ----------
        amplitudes : (n,) array
            As those of `backbone`.

        Returns
        -------
        (n,) array
            Dimensionless; nan where `backbone` is nan.
        """
        return self._damping_ratio(self._orbit(amplitudes))

    def frequency_and_damping(self, amplitudes: ArrayLike) -> Array:
        """`backbone` and `damping_ratio`, (2, n): both from the same orbits."""
        orbit = self._orbit(amplitudes)
        return np.stack([orbit.frequency, self._damping_ratio(orbit)])

    def _damping_ratio(self, orbit: _Orbit) -> Array:
        force = self.damping(orbit.q, orbit.q_dot) - self.damping(orbit.q, -orbit.q_dot)
        weight = orbit.factor / self.inertia(orbit.q) * orbit.q_dot * orbit.dt
        loss = np.sum(weight * force, axis=-1)
        # dE/da from the two turning points, which must stay at equal potential.
        slope = [orbit.force(c) for c in (orbit.upper, orbit.lower)]
        growth = 2 / (1 / slope[0] - 1 / slope[1])
        return loss / (2 * np.pi * orbit.amplitude * growth)

    def relative_magnitude(self, amplitudes: ArrayLike) -> dict[str, Array]:
        """Rms of every term over an undamped cycle, relative to the rms of q_ddot ([1], fig. 11).

        Parameters
        ----------
        amplitudes : (n,) array
            As those of `backbone`.

        Returns
        -------
        dict
            Coefficient name to (n,) array, dimensionless.
        """
        return self._magnitudes(
            amplitudes,
            {
                term.key: lambda *motion, c=value, law=term.strong: c * law(*motion)
                for term, value in self.pairs
            },
        )

    def relative_magnitude_of_parts(self, amplitudes: ArrayLike) -> dict[str, Array]:
        """As `relative_magnitude`, of inertia beyond 1, of stiffness beyond omega^2, of damping.

        Terms of one part may cancel each other: what is drawn for each says little then.
        """
        linear = self.coefficients.get("omega^2", 0.0)
        return self._magnitudes(
            amplitudes,
            {
                "inertia": lambda q, v, a: (self.inertia(q) - 1) * a + self.convection(q) * v**2,
                "nonlinear stiffness": lambda q, v, a: self.stiffness(q) - linear * q,
                "damping": lambda q, v, a: self.damping(q, v),
            },
        )

    def _magnitudes(
        self, amplitudes: ArrayLike, forces: Mapping[str, Callable[..., Array]]
    ) -> dict[str, Array]:
        """Rms of forces over undamped cycles relative to that of q_ddot."""
        orbit = self._orbit(amplitudes)
        force = self.stiffness(orbit.q) + self.convection(orbit.q) * orbit.q_dot**2
        motion = (orbit.q, orbit.q_dot, -force / self.inertia(orbit.q))

        def rms(x: Array) -> Array:
            return np.sqrt(np.sum(x**2 * orbit.dt, axis=-1) / np.sum(orbit.dt, axis=-1))

        return {name: rms(f(*motion)) / rms(motion[-1]) for name, f in forces.items()}

    def _orbit(self, amplitudes: ArrayLike) -> _Orbit:
        a = np.atleast_1d(np.asarray(amplitudes, float))
        if a.ndim != 1 or not np.all(a > 0):
            raise ValueError(f"amplitudes must be positive and one-dimensional, got {amplitudes!r}")
        factor, potential = self._energies(1.5 * float(a.max(initial=0.0)))

        def imbalance(c: Array, a: Array) -> Array:
            return potential(c + a) - potential(c - a)

        def force(at: Array) -> Array:
            return factor(at) * self.stiffness(at) / self.inertia(at)

        c = _near_zero(imbalance, lambda c, a: force(c + a) - force(c - a), a)
        for part in _NEAR:
            left = np.isnan(c)
            if np.any(left):
                bracket = (-part * a[left], part * a[left])
                found = elementwise.find_root(imbalance, bracket, args=(a[left],))
                c[left] = np.where(found.success, found.x, np.nan)
        theta, w = (x * np.pi / 2 for x in _GAUSS)
        q = c[:, None] + a[:, None] * np.sin(theta)
        mu = factor(q)
        left = potential(c + a)[:, None] - potential(q)  # what is left for the kinetic energy
        closed = np.all((left > 0) & (mu > 0) & (self.inertia(q) > 0), axis=1, keepdims=True)
        q_dot = np.sqrt(np.where(closed, 2 * left / mu, np.nan))
        dt = w * a[:, None] * np.cos(theta) / q_dot
        return _Orbit(a, q, q_dot, dt, mu, c + a, c - a, force)

    # -- text ---------------------------------------------------------------------------------

    def _notes(self) -> dict[str, str]:
        squared = self.coefficients.get("omega^2", 0.0)
        if not squared > 0:
            return {}
        omega = np.sqrt(squared / float(self.inertia(0.0)))  # mass may have been added
        return {"omega^2": f"omega = {omega:.5g} rad/s, {omega / (2 * np.pi):.5g} Hz"}

    # -- other programs -----------------------------------------------------------------------

    def to_sympy(self) -> Any:
        """q_ddot as a sympy expression of the real symbols q and q_dot.

        Inputs are functions of the real symbol t, such as ``Function("force")(t - 0.002)``.

        Needs sympy: ``pip install "romsindy[export]"``.

        Returns
        -------
        sympy.Expr

        Raises
        ------
        ValueError
            If sympy is not installed, or a law of one's own has no counterpart in it.

        Examples
        --------
        >>> ReducedModel.from_coefficients({"omega^2": 36.0, "Upsilon_3": 0.5}).to_sympy()
        (-0.5*q*q_dot**2 - 36.0*q)/(0.5*q**2 + 1)
        """
        return export.acceleration(self.pairs)


@dataclass(frozen=True)
class _Orbit:
    """Half a period of undamped motions, from the lower to the upper turning point.

    Arrays of shape (n_amplitudes, n_gauss); ``dt`` holds the quadrature weights in time.
    """

    amplitude: Array
    q: Array
    q_dot: Array
    dt: Array
    factor: Array
    upper: Array
    lower: Array
    force: Callable[[Array], Array]

    @property
    def frequency(self) -> Array:
        """rad/s, (n_amplitudes,)."""
        return np.pi / np.sum(self.dt, axis=-1)


def _near_zero(
    f: Callable[[Array, Array], Array], slope: Callable[[Array, Array], Array], a: Array
) -> Array:
    """Roots of f(c, a) by Newton's method from c = 0; nan where it does not settle near there."""
    c = step = np.zeros_like(a)
    with np.errstate(all="ignore"):
        for _ in range(_NEWTON):
            step = f(c, a) / slope(c, a)
            c = c - step
    settled = (np.abs(step) <= _SETTLED * a) & (np.abs(c) < _NEAR[0] * a)
    return np.where(settled, c, np.nan)
