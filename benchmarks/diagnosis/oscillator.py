"""Decays of oscillators with hidden effects by `solve_ivp`, dimensionless as in hidden.py."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hidden import Hidden
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class Nominal:
    """The oscillator that the simulation assumes; its linear frequency is 1.

    (1 + U_3 q^2 + 2 U_4 q^3 + U_5 q^4) q'' + (...)'/2 q'^2 + q + sum g_m q^m + 2 zeta q' = 0.
    """

    zeta: float
    g: tuple[float, float, float, float]  # of q^2 to q^5
    u: tuple[float, float, float]  # Upsilon_3 to Upsilon_5

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Nominal:
        """Hardening or softening, symmetric or not, with damping ratios of 0.1 to 3 per cent."""
        symmetric = 0.0 if rng.random() < 0.25 else 1.0
        g = rng.uniform([-0.15, -0.1, -0.03, -0.02], [0.15, 0.4, 0.03, 0.06])
        u = rng.uniform([0.0, -0.05, 0.0], [0.4, 0.05, 0.1])
        even = symmetric * g[0], symmetric * g[2], symmetric * u[1]
        zeta = float(np.exp(rng.uniform(np.log(0.001), np.log(0.03))))
        return cls(zeta, (even[0], g[1], even[1], g[3]), (u[0], even[2], u[2]))

    def coefficients(self, omega: float, amplitude: float) -> dict[str, float]:
        """With units: ``omega`` in rad/s, ``amplitude`` of the largest release."""
        g = {f"gamma_{m}": x * omega**2 / amplitude ** (m - 1) for m, x in enumerate(self.g, 2)}
        u = {f"Upsilon_{m}": x / amplitude ** (m - 1) for m, x in enumerate(self.u, 3)}
        known = {k: v for k, v in {**g, **u}.items() if v}
        return {"omega^2": omega**2, **known, "c_linear": 2 * self.zeta * omega}

    def mass(self, q: float) -> tuple[float, float]:
        """Inertia and its derivative."""
        u3, u4, u5 = self.u
        return 1 + q * q * (u3 + q * (2 * u4 + q * u5)), q * (2 * u3 + q * (6 * u4 + q * 4 * u5))

    def force(self, q: float, v: float) -> float:
        """Restoring and damping force."""
        g2, g3, g4, g5 = self.g
        return q * (1 + q * (g2 + q * (g3 + q * (g4 + q * g5)))) + 2 * self.zeta * v


def motion(
    nominal: Nominal, effects: list[Hidden], t: np.ndarray, q_0: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement, velocity and acceleration at ``t``, let go at rest at q_0 at the first."""
    switches = [s for e in effects for s in e.switches]
    first = np.cumsum([0, *(len(e.switches) for e in effects)])
    inner = [e.start(q_0) for e in effects]
    at = np.cumsum([2, *map(len, inner)])

    def rates(now, y, side):
        q, v = y[0], y[1]
        mass, slope = nominal.mass(q)
        force = nominal.force(q, v)
        states: list[float] = []
        couple = None
        for i, e in enumerate(effects):
            z = y[at[i] : at[i + 1]]
            if e.mass is not None:
                mass += e.mass(q)
                slope += e.mass_slope(q)
            if e.force is not None:
                force += e.force(now, q, v, side[first[i] : first[i + 1]], z)
            if e.rates is not None:
                states += e.rates(now, q, v, z)
            if e.couple is not None:
                couple = e.couple, z
        force += 0.5 * slope * v * v
        if couple is None:
            return [v, -force / mass, *states]
        a, own = couple[0](q, v, force, mass, couple[1])
        return [v, a, *states, *own]

    y = np.array([q_0, 0.0, *(x for z in inner for x in z)])
    memory = any(inner)
    options = {"rtol": 1e-7 if memory else 1e-9, "atol": 1e-9 if memory else 1e-10}
    options["max_step"] = min([0.3 if switches else np.inf, *(e.longest for e in effects)])
    return _integrated(rates, y, t, switches, options)


def _integrated(rates, y, t, switches, options):
    """Piece by piece from switch to switch; friction may hold the mass for good."""
    out = np.zeros((3, len(t)))
    now = t[0]
    side = [_sign(s(now, y[0], y[1])) for s in switches]
    side = [
        _sign(-y[0]) if s.__name__ == "velocity" and x == 0 else x or 1
        for s, x in zip(switches, side, strict=True)
    ]
    while now < t[-1]:
        piece = solve_ivp(
            lambda s, y, side=tuple(side): rates(s, y, side),
            (now, t[-1]),
            y,
            "DOP853",
            events=[_event(s, x) for s, x in zip(switches, side, strict=True)],
            dense_output=True,
            **options,
        )
        inside = np.flatnonzero((t >= now) & (t <= piece.t[-1]))
        if len(inside):
            states = piece.sol(t[inside])
            out[:2, inside] = states[:2]
            pairs = zip(t[inside], states.T, strict=True)
            out[2, inside] = [rates(s, y, tuple(side))[1] for s, y in pairs]
        now, y = piece.t[-1], piece.y[:, -1].copy()
        if piece.status != 1:
            break
        for i, found in enumerate(piece.t_events):
            if len(found):
                side[i] = -side[i]
                if switches[i].__name__ == "velocity":
                    y[1] = 0.0
                    if _held(rates, now, y, side, i):
                        out[:, t > now] = np.array([[y[0]], [0.0], [0.0]])
                        return out
        now += 1e-12
    return out


def _event(switch, side):
    def event(now, y):
        return switch(now, y[0], y[1])

    event.terminal, event.direction = True, -side
    return event


def _held(rates, now, y, side, i) -> bool:
    """Whether friction holds the mass: it would be pushed back either way."""
    forward, backward = list(side), list(side)
    forward[i], backward[i] = 1, -1
    return rates(now, y, forward)[1] <= 0 <= rates(now, y, backward)[1]


def _sign(x: float) -> int:
    return int(np.sign(x))
