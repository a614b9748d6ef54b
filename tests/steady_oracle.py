"""Forced Duffing oscillators, in air or not, by shooting: nothing of the package takes part.

q_ddot + c q_dot + d q_dot |q_dot| + k q + g q^3 = f cos(w t), with the motion and its derivatives
integrated by Runge-Kutta steps of order 4 over one period, and Newton's method for the start.
Curves are followed in the amplitude of their start, so that folds and unstable orbits come as any
others.
"""

from __future__ import annotations

import numpy as np

STEPS = 200


def period(start, w, f, c, k, g, d=0.0):
    """Motion (STEPS + 1, 2) over one period, and derivatives of its end by the start, (2, 2)."""
    h = 2 * np.pi / w / STEPS

    def rate(t, y):
        q, v = y[:2]
        slope = -k - 3 * g * q * q
        return np.array(
            [
                v,
                f * np.cos(w * t) - (c + d * abs(v)) * v - k * q - g * q**3,
                *y[4:],
                *(slope * y[2:4] - (c + 2 * d * abs(v)) * y[4:]),
            ]
        )

    y = np.array([*start, 1.0, 0.0, 0.0, 1.0])
    path = [y]
    for n in range(STEPS):
        t = n * h
        a = rate(t, y)
        b = rate(t + h / 2, y + h / 2 * a)
        m = rate(t + h / 2, y + h / 2 * b)
        e = rate(t + h, y + h * m)
        y = y + h / 6 * (a + 2 * b + 2 * m + e)
        path.append(y)
    path = np.array(path)
    return path[:, :2], path[-1, 2:].reshape(2, 2)


def steady(w, f, c, k, g, guess, d=0.0):
    """Complex first harmonic of the periodic motion near a guess, and its multipliers, or None."""
    start = np.array([guess.real, -w * guess.imag])
    for _ in range(12):
        motion, end = period(start, w, f, c, k, g, d)
        off = motion[-1] - motion[0]
        start = start - np.linalg.solve(end - np.eye(2), off)
        if np.max(np.abs(off)) < 1e-10:
            break
    else:
        return None
    phase = 2 * np.pi * np.arange(STEPS) / STEPS
    harmonic = 2 / STEPS * np.sum(motion[:-1, 0] * np.exp(-1j * phase))
    return harmonic, np.linalg.eigvals(end)


def first_guess(a, f, c, k, g):
    """Frequencies and harmonics of amplitude a by one harmonic: below and above resonance."""
    stiffness = k + 3 / 4 * g * a * a
    # (stiffness - w^2)^2 + (c w)^2 = (f / a)^2 is quadratic in w^2.
    b, d = stiffness - c * c / 2, stiffness**2 - (f / a) ** 2
    if b * b < d:
        return []
    squares = [b - np.sqrt(b * b - d), b + np.sqrt(b * b - d)]
    return [
        (w, f / complex(stiffness - w * w, c * w)) for w in (np.sqrt(s) for s in squares if s > 0)
    ]


def curve(amplitudes, f, c, k, g, within, d=0.0):
    """Points of a response curve: w, complex harmonic, whether stable; folds and all."""
    found = []
    for a in amplitudes:
        like = c + 8 / (3 * np.pi) * d * a * np.sqrt(k)  # by the work of a cycle
        for w, guess in first_guess(a, f, like, k, g):
            if within[0] < w < within[1]:
                orbit = steady(w, f, c, k, g, guess, d)
                if orbit is not None:  # next to a fold one harmonic is no good guess
                    found.append((w, orbit[0], np.max(np.abs(orbit[1])) < 1))
    w, q, stable = zip(*found, strict=True)
    return np.array(w), np.array(q), np.array(stable)
