"""Two modes that drag one fast mode along: what is identified of their kinetic coupling?

    python benchmarks/kinetic_coupling.py --count 20 --jobs 2

A fast mode follows two slow ones as g = a q1^2 + b q1 q2 + c q2^2, as the stretching of a beam
follows its bending: it adds (dg/dt)^2/2 to the kinetic energy, which is six products of inertia.
Cubic stiffness, quartic potentials that couple, linear damping; three decays of two sensors at
40 dB. The simulator (scipy's DOP853) solves Lagrange's equations with g itself, and shares nothing
with the package. Printed: terms that are missing and false, and the share of the true ones that lie
in their 95 % intervals.
"""

import numpy as np
from scipy.integrate import solve_ivp
from seeds import parser_of, tried

from romsindy import Decay, identify

DECIBELS = 40
CYCLES, PER_CYCLE = 120, 20  # of the slow mode in a decay; samples in a cycle of the fast one
STARTS = (1.0, 0.7, 0.85)


def drawn(seed):
    """Laws of a system and what is drawn of its measurement, and the generator.

    Frequencies and damping ratios (2,), cubic stiffness (2,), the potentials of q1^3 q2, q1^2 q2^2
    and q1 q2^3, and (a, b, c) of the fast mode; mode shapes at two sensors.
    """
    rng = np.random.default_rng(seed)
    slow = 2 * np.pi * rng.uniform(3, 20)
    ratio = rng.choice([1.4, 1.7, 2.3, 2.6]) * rng.uniform(0.97, 1.03)
    system = {
        "omega": slow * np.array([1.0, ratio]),
        "zeta": rng.uniform(0.002, 0.006, 2),
        "cubic": rng.uniform(0.03, 0.15, 2) * slow**2 * np.array([1.0, ratio**2]),
        "quartic": rng.uniform(0.02, 0.08, 3) * rng.choice([-1, 1], 3) * slow**2,
        # At q = 1 the mass of a mode grows by 4 a^2, by up to a third.
        "fast": rng.uniform(0.12, 0.28, 3) * np.array([1.0, *rng.choice([-1, 1], 2)]),
    }
    shapes = np.array([[1.0, rng.uniform(0.3, 0.8)], [-rng.uniform(0.3, 0.8), 1.0]])
    return system, shapes, rng


def simulated(system, start, t):
    """Motion from rest, (n, 2)."""
    omega, zeta, cubic, quartic, (a, b, c) = system.values()
    bent = np.array([[2 * a, b], [b, 2 * c]])  # g = q . bent q / 2
    v31, v22, v13 = quartic

    def rates(_, y):
        q, v = y[:2], y[2:]
        force = omega**2 * q + 2 * zeta * omega * v + cubic * q**3
        force[0] += 3 * v31 * q[0] ** 2 * q[1] + 2 * v22 * q[0] * q[1] ** 2 + v13 * q[1] ** 3
        force[1] += v31 * q[0] ** 3 + 2 * v22 * q[0] ** 2 * q[1] + 3 * v13 * q[0] * q[1] ** 2
        # The fast mode is pulled by its own acceleration, slope . q'' + v . bent v.
        slope = bent @ q
        force += slope * (v @ bent @ v)
        return np.concatenate([v, slope * (slope @ force) / (1 + slope @ slope) - force])

    options = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-11, "t_eval": t}
    return solve_ivp(rates, (0, t[-1]), [*start, 0.0, 0.0], **options).y[:2].T


def coefficients(system):
    """As romsindy names them."""
    omega, zeta, cubic, quartic, fast = system.values()
    names = ("V q1^3 q2", "V q1^2 q2^2", "V q1 q2^3")
    truth = dict(zip(names, quartic.tolist(), strict=True))
    for i in range(2):
        law = {"omega^2": omega[i] ** 2, "c_linear": 2 * zeta[i] * omega[i], "gamma_3": cubic[i]}
        truth |= {f"{name} [q{i + 1}]": value for name, value in law.items()}
    shapes = ("q1^2", "q1 q2", "q2^2")
    for i, (x, at) in enumerate(zip(shapes, fast, strict=True)):
        truth[f"g({x})^2"] = at**2
        truth |= {
            f"g({x}) g({y})": at * other
            for y, other in zip(shapes[i + 1 :], fast[i + 1 :], strict=True)
        }
    return truth


def decays_of(seed):
    """Three decays, and the coefficients behind them."""
    system, shapes, rng = drawn(seed)
    slow, fast = system["omega"]
    t, found = np.arange(0, CYCLES * 2 * np.pi / slow, 2 * np.pi / fast / PER_CYCLE), []
    for scale in STARTS:
        y = simulated(system, scale * rng.uniform(0.6, 1.0, 2), t) @ shapes.T
        y += 10 ** (-DECIBELS / 20) * y.std(axis=0) * rng.standard_normal(y.shape)
        found.append(Decay(t, y, unit="m", stage="free"))
    return found, coefficients(system)


def trial(seed):
    """Terms that are missing and false, and which intervals hold."""
    decays, truth = decays_of(seed)
    fit = identify(decays, 2)
    found = fit.model.coefficients
    holds = {}
    for name in {*truth} & {*found}:
        low, high = fit.interval(name)
        holds[name] = bool(low <= truth[name] <= high)
    return seed, sorted({*truth} - {*found}), sorted({*found} - {*truth}), holds, fit


def is_damping(name):
    """Whether a coefficient is one of damping."""
    return name.startswith(("c_", "C_"))


def main(arguments=None):
    given = parser_of(__doc__, 20, "systems").parse_args(arguments)
    inside, clean = [], 0
    for seed, missing, false, holds, fit in tried(given, trial):
        inside += holds.values()
        clean += not any(map(is_damping, false))
        print(
            f"{seed}: missing {', '.join(missing) or 'nothing'}; false"
            f" {', '.join(false) or 'nothing'}; outside"
            f" {', '.join(n for n, h in holds.items() if not h) or 'nothing'} of {len(holds)};"
            f" residual {fit.adequacy:.3f}",
            flush=True,
        )
    print(
        f"{100 * np.mean(inside):.0f} % of {len(inside)} coefficients in their intervals; no false"
        f" damping term in {clean} of {given.count}"
    )
    return inside, clean


if __name__ == "__main__":
    main()
