"""Two modes under one measured force: how many coordinates, and what the rest of the record shows.

    python benchmarks/driven_modes.py --first 60 --count 30 --jobs 2

Two modes with cubic stiffness, half of the time coupled, are driven by noise, a multisine or a
sweep over both, in turn by seed; two sensors show both, or one does for two seeds in five. 1 %
noise. The motion is integrated by scipy's DOP853, which shares nothing with the package. The number
of coordinates is "auto". Printed: coordinates, the error with which the last fifth of the record,
not fitted, is predicted from the state of its first fiftieth, over the noise, how many of the
linear and cubic values lie in their 95 % intervals, and, with two sensors, how many amplitudes of
both coordinates under a harmonic force near both resonances, as scipy brings it to rest in time,
lie in the bands that are foretold.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from seeds import parser_of, tried

from romsindy import ForcedVibration, identify

KINDS = ("noise", "multisine", "sweep")
SOLVER = {"method": "DOP853", "rtol": 1e-8, "atol": 1e-10}
NOISE, SAMPLES, PART = 0.01, 8192, 0.8
# Of a harmonic force: largest linear amplitude, frequencies over each resonance, by how much they
# differ from it, and time constants until it is steady.
LARGEST, NEAR, WIDE, LONG = 0.3, 7, 0.06, 12.0


def driven(seed):
    """A record, its noise in each channel, and the coefficients."""
    rng = np.random.default_rng(seed)
    slow = 2 * np.pi * rng.uniform(3, 15)
    omega = slow * np.array([1, rng.uniform(1.6, 3.2)])
    zeta = rng.uniform(0.005, 0.02, 2)
    sensors = 1 + int(rng.random() < 0.6)
    cubic = rng.uniform(0.03, 0.2, 2) * omega**2
    mixed = rng.uniform(0.02, 0.1) * rng.choice([-1, 1]) * slow**2 * (rng.random() < 0.5)
    part = np.array([1.0, rng.uniform(0.4, 1.2) * rng.choice([-1, 1])])
    dt = 2 * np.pi / omega[1] / 14
    t = dt * np.arange(SAMPLES)
    low, high, whole = 0.5 * omega[0], 1.5 * omega[1], SAMPLES * dt
    if KINDS[seed % 3] == "sweep":

        def force(s):
            return np.sin(low * s + (high - low) * s * s / (2 * whole))

    else:
        lines = np.arange(int(low * whole / 2 / np.pi), int(high * whole / 2 / np.pi) + 1)
        noisy = KINDS[seed % 3] == "noise"
        lines = lines if noisy else rng.choice(lines, 60, replace=False)
        size = rng.standard_normal(len(lines)) if noisy else np.ones(len(lines))
        fine = np.linspace(0, whole, 8 * SAMPLES + 1)
        turns = 2 * np.pi / whole * np.outer(fine, lines) + rng.uniform(0, 2 * np.pi, len(lines))
        values = np.sin(turns) @ size
        force = CubicSpline(fine, values / values.std())

    def pull(a, v):
        coupling = 2 * mixed * np.array([a[0] * a[1] ** 2, a[0] ** 2 * a[1]])
        stiff, damped = omega**2 * a.T, 2 * zeta * omega * v.T
        return (stiff + damped + cubic * a.T**3).T + coupling

    def motion(gain):
        def rate(s, state):
            a, v = state[:2], state[2:]
            return np.concatenate([v, gain * slow**2 * part * force(s) - pull(a, v)])

        return solve_ivp(rate, (0, t[-1]), np.zeros(4), t_eval=t, **SOLVER).y[:2].T

    def steady(w, size):
        """First harmonics of both under size cos(w t), (n, 2), as they settle from rest."""
        turns = 2 * np.pi * np.arange(256) / 256
        settled = 2 * np.pi * np.ceil(LONG / (zeta * omega).min() * w.max() / (2 * np.pi))

        def rate(phase, state):  # all frequencies at once, each by its own time
            a, v = state.reshape(2, 2, -1)
            push = size * gain * slow**2 * np.outer(part, np.cos(phase) + 0 * w)
            return np.concatenate([v / w, (push - pull(a, v)) / w]).ravel()

        span = (0, settled + turns[-1])
        rest = np.zeros(4 * len(w))
        a = solve_ivp(rate, span, rest, t_eval=settled + turns, **SOLVER).y[: 2 * len(w)]
        return np.abs(a @ np.exp(-1j * turns)).reshape(2, -1).T / len(turns) * 2

    gain = 0.02
    for _ in range(4):
        q = motion(gain)
        gain *= 0.3 / q[:, 0].std()
    shapes = np.array([[1.0, rng.uniform(0.3, 0.9)], [rng.uniform(0.3, 0.9), -1.0]])[:sensors]
    y = motion(gain) @ shapes.T
    noise = NOISE * y.std(axis=0)
    y = y + noise * rng.standard_normal(y.shape)
    truth = {f"omega^2 [q{i + 1}]": omega[i] ** 2 for i in range(2)}
    truth |= {f"c_linear [q{i + 1}]": 2 * zeta[i] * omega[i] for i in range(2)}
    truth |= {f"gamma_3 [q{i + 1}]": cubic[i] for i in range(2)} if sensors == 2 else {}
    w = np.outer(omega, np.linspace(1 - WIDE, 1 + WIDE, NEAR)).ravel()
    size = LARGEST / np.max(np.abs(gain * slow**2 * part) / (2 * zeta * omega**2))
    harmonic = (w, size, steady(w, size)) if sensors == 2 else None
    return ForcedVibration(t, y, force(t), unit="m", inputs="force"), noise, truth, harmonic


def held(fit, harmonic):
    """Which amplitudes, (n, 2), lie in the band of a response that is foretold there."""
    w, size, amplitude = harmonic
    band = fit.forced_response(size, (0.99 * w.min(), 1.01 * w.max()))
    return [
        any(s.low[i] <= a <= s.high[i] for s in band.steady_states(at))
        for at, both in zip(w, amplitude, strict=True)
        for i, a in enumerate(both)
    ]


def trial(seed):
    """Coordinates, the error of the prediction over the noise, which intervals and bands hold."""
    record, noise, truth, harmonic = driven(seed)
    last = record.t[-1] * PART
    fit = identify(record.between(end=last), "auto")
    rest = record.between(start=last)
    found = fit.predict(rest, samples=len(rest.t) // 50)
    off = (rest.y - found).reshape(len(rest.t), -1) / noise
    holds = []
    for name in {*truth} & {*fit.model.coefficients}:
        low, high = fit.interval(name)
        holds.append(bool(low <= truth[name] <= high))
    count = fit.model.n_coordinates
    bands = held(fit, harmonic) if harmonic and count == 2 else []
    return seed, record.n_channels, count, float(np.sqrt(np.mean(off**2))), holds, bands


def main(arguments=None):
    given = parser_of(__doc__, 30).parse_args(arguments)
    two = predicted = 0
    every, amplitudes = [], []
    for seed, channels, count, error, holds, bands in tried(given, trial):
        two, predicted = two + (count == 2), predicted + (error <= 1.3)
        every, amplitudes = every + holds, amplitudes + bands
        print(
            f"{seed} {KINDS[seed % 3]}, {channels} sensors: {count} coordinates; held out"
            f" {error:.2f} times the noise; intervals {sum(holds)} of {len(holds)}; amplitudes"
            f" {sum(bands)} of {len(bands)}",
            flush=True,
        )
    print(
        f"of {given.count}: two coordinates {two}; held out at most 1.3 times the noise"
        f" {predicted}; intervals hold {100 * np.mean(every):.0f} % of {len(every)}; bands"
        f" {100 * np.mean(amplitudes or np.nan):.0f} % of {len(amplitudes)} amplitudes"
    )
    return two, predicted, float(np.mean(every))


if __name__ == "__main__":
    main()
