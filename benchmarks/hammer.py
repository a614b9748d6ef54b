"""Hits of a hammer: force and decay explained together, and the mass within its interval.

    python benchmarks/hammer.py --first 1 --count 20 --jobs 2

An oscillator with cubic stiffness, hardening or softening, and half of the time quadratic damping,
is hit once to three times; the pulse is a half sine, a raised cosine, Gaussian, or as two spheres
meet, 5 to 40 samples long. Its displacement or acceleration is measured with noise of 1 % of its
rms, the force with 0.2 % of its peak. The motion is integrated here (scipy's DOP853); this shares
nothing with the package. Printed: what is false or missing among the terms, and how far the mass is
off, beside its standard error; at last how many records are explained, and masses within their 95 %
intervals.
"""

import numpy as np
from scipy.integrate import solve_ivp
from seeds import parser_of, tried

from romsindy import ForcedVibration, identify

PULSES = {  # of unit area, from 0 to 1
    "half sine": lambda x: np.pi / 2 * np.sin(np.pi * x),
    "raised cosine": lambda x: 2 * np.sin(np.pi * x) ** 2,
    "Gaussian": lambda x: np.exp(-0.5 * ((x - 0.5) / 0.12) ** 2) / (0.12 * np.sqrt(2 * np.pi)),
    "spheres": lambda x: np.sin(np.pi * x) ** 1.5 / 0.556418,
}


def hit(seed):
    """A record, the mass and the names of its coefficients."""
    rng = np.random.default_rng(seed)
    frequency = rng.uniform(3, 40)  # Hz
    omega, zeta = 2 * np.pi * frequency, rng.uniform(0.003, 0.02)
    mass, size = 10 ** rng.uniform(-1, 1.5), 10 ** rng.uniform(-3, -1)  # kg, m
    cubic = rng.uniform(0.05, 0.4) * rng.choice([1, 1, -0.5]) * omega**2 / size**2
    per_cycle, cycles = int(rng.integers(60, 200)), int(rng.integers(30, 70))
    t = np.arange(per_cycle * cycles) / (per_cycle * frequency)
    width = rng.uniform(0.06, 0.2) / frequency
    pulse = [*PULSES.values()][seed % len(PULSES)]
    count = int(rng.choice([1, 1, 2, 3]))
    begin = [(rng.uniform(0.5, 2) + i * cycles / count) / frequency for i in range(count)]
    impulse = mass * omega * size * np.array([1.0, *rng.uniform(0.4, 0.9, count - 1)])
    drag = rng.uniform(0.2, 1) * 2 * zeta / size if rng.random() < 0.5 else 0.0

    def force(s):
        x = (np.subtract.outer(s, begin)) / width
        return np.where((x > 0) & (x < 1), pulse(np.clip(x, 0, 1)), 0.0) @ impulse / width

    def rate(s, state):
        q, v = state
        pull = omega**2 * q + cubic * q**3 + 2 * zeta * omega * v + drag * np.abs(v) * v
        return np.array([v, force(s) / mass - pull])

    given = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-12 * size, "max_step": width / 4}
    states = solve_ivp(rate, (0, t[-1]), [0.0, 0.0], t_eval=t, **given).y
    measured = rng.choice(["displacement", "acceleration"])
    y = states[0] if measured == "displacement" else rate(t, states)[1]
    y = y + 0.01 * y.std() * rng.standard_normal(len(t))
    u = force(t)
    u = u + 0.002 * u.max() * rng.standard_normal(len(t))
    truth = {"omega^2", "c_linear", "gamma_3", "gain [force]"} | (
        {"c_quadratic"} if drag else set()
    )
    return ForcedVibration(t, y, u, unit="m", measured=measured), mass, truth


def trial(seed):
    """What is found: whether it is explained, terms that are false or missing, and the mass."""
    record, mass, truth = hit(seed)
    fit = identify(record)
    low, high = fit.interval("gain [force]")
    found = {*fit.model.coefficients}
    off = fit.model.coefficients["gain [force]"] * mass - 1
    holds = bool(low <= 1 / mass <= high)
    error = (high - low) * mass / 3.92
    return (
        seed,
        fit.verdict.explained,
        sorted(found - truth),
        sorted(truth - found),
        off,
        error,
        holds,
    )


def main(arguments=None):
    given = parser_of(__doc__, 20, first=1).parse_args(arguments)
    explained = exact = inside = 0
    for seed, good, false, missing, off, error, holds in tried(given, trial):
        explained, inside = explained + good, inside + holds
        exact += not (false or missing)
        print(
            f"{seed}: {'explained' if good else 'not explained'}; false {', '.join(false) or '-'};"
            f" missing {', '.join(missing) or '-'}; 1/mass {100 * off:+.2f} +- {100 * error:.2f} %"
            f"{'' if holds else ', outside'}",
            flush=True,
        )
    print(f"of {given.count}: explained {explained}, terms exact {exact}, mass inside {inside}")
    return explained, exact, inside


if __name__ == "__main__":
    main()
