"""Dry friction beside cubic stiffness, in driven records and in one of two coupled modes.

    python benchmarks/dry_friction.py --count 20 --jobs 2     # so many driven, and so many coupled

Driven: a stepped sine (even seeds) or a multisine (odd ones), the force measured. Coupled: two
decays of two modes, with friction in one of them. 40 dB. The motion is integrated here from one
stop to the next (scipy's DOP853), friction holds what stops until the other forces exceed it; this
shares nothing with the package. Printed: whether friction is found, which terms are false, whether
the viscous damping lies in its 95 % interval, and the same of the friction.
"""

import numpy as np
from joblib import Parallel, delayed
from scipy.integrate import solve_ivp
from seeds import parser_of

from romsindy import Decay, ForcedVibration, identify

DECIBELS = 40
PER_CYCLE = 20  # samples in a cycle of the fastest mode
STEPS, HELD, TONES = 24, 16, 40  # of a stepped sine, cycles of each; tones of a multisine
CYCLES = 100  # of the slow mode in a decay


def strokes(force, friction, state, t):
    """Displacements (n, R) at times t (s) of unit masses under ``force(t, q, v)``, an array (R,).

    ``friction`` (R,) opposes the velocity of each mass and holds it at rest. Only the one with
    friction stops; at most one has it.
    """
    k, r = int(np.argmax(friction)), len(friction)
    limit = friction[k]
    found, now, y = np.empty((len(t), r)), t[0], np.array(state, float)
    done, released = 0, False
    while done < len(t):
        if abs(y[r + k]) < 1e-13:
            push = force(now, y[:r], y[r:])[k]
            direction = np.sign(push) if released or abs(push) > limit else 0.0
        else:
            direction = np.sign(y[r + k])

        def rate(s, x, d=direction):
            a = np.array(force(s, x[:r], x[r:]))
            a[k] = a[k] - limit * d if d else 0.0
            v = x[r:].copy()
            if not d:
                v[k] = 0.0
            return np.concatenate([v, a])

        def ends(s, x, d=direction, begin=now):
            if d:
                return x[r + k] * d + 1e-14 * (s <= begin)
            return limit - abs(force(s, x[:r], x[r:])[k])

        ends.terminal, ends.direction = True, -1
        solved = solve_ivp(
            rate, (now, t[-1]), y, "DOP853", rtol=1e-9, atol=1e-12, events=ends, dense_output=True
        )
        if solved.status < 0:
            raise OverflowError("the motion escapes: the spring softens too much")
        last = int(np.searchsorted(t, solved.t[-1], side="right"))
        if last > done:
            found[done:last] = solved.sol(t[done:last])[:r].T
        done, now, y = last, solved.t[-1], solved.y[:, -1].copy()
        released = not direction
        y[r + k] = 0.0
    return found


def driven(seed, n=6000):
    """A record, ``n`` samples of a multisine, and its coefficients."""
    rng = np.random.default_rng(seed)
    omega, zeta = 2 * np.pi * rng.uniform(2, 40), rng.uniform(0.005, 0.02)
    size = 10 ** rng.uniform(-3, 0)
    dt = 2 * np.pi / omega / PER_CYCLE
    # Friction damps as much as 0.2 to 1 of the viscous damping at that response.
    share = rng.uniform(0.2, 1.0)
    friction = share * np.pi / 4 * 2 * zeta * omega**2 * size
    gain = (1 + share) * 2 * zeta * omega**2 * size
    cubic = rng.uniform(0.05, 0.3) * rng.choice([-1, 1]) * omega**2 / size**2
    truth = {
        "omega^2": omega**2,
        "c_linear": 2 * zeta * omega,
        "gamma_3": cubic,
        "c_coulomb": friction,
    }
    if seed % 2 == 0:
        ratio = np.linspace(0.85, 1.15, STEPS)[:: rng.choice([-1, 1])]
        n = STEPS * HELD * PER_CYCLE
        t = dt * np.arange(n)
        rate = omega * ratio[np.minimum(np.arange(n) // (HELD * PER_CYCLE), STEPS - 1)]
        phase = np.concatenate([[0.0], np.cumsum(rate[:-1] * dt)])
        u = np.cos(phase)

        def at(s):
            i = min(int(s / dt), n - 1)
            return np.cos(phase[i] + rate[i] * (s - t[i]))

    else:
        t = dt * np.arange(n)
        tone = omega * rng.uniform(0.5, 1.6, TONES)
        turn = rng.uniform(0, 2 * np.pi, TONES)

        def at(s):
            return 3.0 * np.sqrt(2 / TONES) * np.sum(np.cos(tone * s + turn))

        u = np.array([at(s) for s in t])

    def motion(cubic):
        def force(s, q, v):
            q, v = q[0], v[0]
            pull = omega**2 * q + 2 * zeta * omega * v + cubic * q**3
            return np.array([gain * at(s) - pull])

        return strokes(force, np.array([friction]), [0.0, 0.0], t)[:, 0]

    try:
        q = motion(cubic)
    except OverflowError:  # it hardens instead
        truth["gamma_3"] = abs(cubic)
        q = motion(abs(cubic))
    y = q + 10 ** (-DECIBELS / 20) * q.std() * rng.standard_normal(n)
    return ForcedVibration(t, y, u, unit="m", inputs="force"), truth


def coupled(seed):
    """Two decays of two modes, and their coefficients, with friction in one mode."""
    rng = np.random.default_rng(seed)
    slow = 2 * np.pi * rng.uniform(3, 20)
    omega = slow * np.array([1.0, rng.choice([1.5, 2.3, 2.6, 3.4]) * rng.uniform(0.97, 1.03)])
    zeta = rng.uniform(0.002, 0.005, 2)
    stiff = rng.uniform(0.03, 0.15, 2) * rng.choice([-1, 1], 2) * omega**2
    mixed = rng.uniform(0.02, 0.08) * rng.choice([-1, 1]) * slow**2
    k = int(rng.integers(2))
    friction = np.zeros(2)
    # It damps as much as 0.2 to 0.6 of the viscous damping at half the largest amplitude: a mode
    # that it stops within fifty cycles is not heard as one.
    friction[k] = rng.uniform(0.2, 0.6) * np.pi / 4 * 2 * zeta[k] * omega[k] ** 2 * 0.5
    t = np.arange(0, CYCLES * 2 * np.pi / slow, 2 * np.pi / omega[1] / PER_CYCLE)

    def force(s, q, v):
        a, b = q
        coupling = np.array([2 * mixed * a * b**2, 2 * mixed * a**2 * b])
        return -(omega**2 * q + 2 * zeta * omega * v + stiff * q**3 + coupling)

    found = []
    shapes = np.array([[1.0, rng.uniform(0.3, 0.8)], [rng.uniform(0.3, 0.8), -1.0]])
    for scale in (1.0, 0.6):
        start = scale * rng.uniform(0.7, 1.0, 2)
        y = strokes(force, friction, [*start, 0.0, 0.0], t) @ shapes.T
        y += 10 ** (-DECIBELS / 20) * y.std(axis=0) * rng.standard_normal(y.shape)
        found.append(Decay(t, y, unit="m", stage="free"))
    truth = {"V q1^2 q2^2": mixed, f"c_coulomb [q{k + 1}]": friction[k]}
    for i in range(2):
        name = f"[q{i + 1}]"
        truth |= {f"omega^2 {name}": omega[i] ** 2, f"c_linear {name}": 2 * zeta[i] * omega[i]}
        truth[f"gamma_3 {name}"] = stiff[i]
    return found, truth


def trial(kind, seed):
    """What is found: terms that are missing and false, and which intervals hold."""
    record, truth = (driven if kind == "driven" else coupled)(seed)
    fit = identify(record, 1 if kind == "driven" else 2)
    found = fit.model.coefficients
    false = {n for n in found if "[force]" not in n and n not in truth}
    holds = {}
    for name in truth:
        if name in found and name.startswith("c_"):
            low, high = fit.interval(name)
            holds[name] = bool(low <= truth[name] <= high)
    return kind, seed, sorted({*truth} - {*found}), sorted(false), holds, fit


def main(arguments=None):
    parser = parser_of(__doc__, 20, "of each kind")
    parser.add_argument("--kinds", nargs="+", default=["driven", "coupled"])
    given = parser.parse_args(arguments)
    tasks = [
        delayed(trial)(kind, seed)
        for kind in given.kinds
        for seed in range(given.first, given.first + given.count)
    ]
    friction = clean = linear = dry = 0
    for kind, seed, missing, false, holds, _ in Parallel(given.jobs, return_as="generator")(tasks):
        there = not any(name.startswith("c_coulomb") for name in missing)
        viscous = [holds[n] for n in holds if n.startswith("c_linear")]
        friction, clean, linear = friction + there, clean + (not false), linear + all(viscous)
        dry += any(h for n, h in holds.items() if n.startswith("c_coulomb"))
        print(
            f"{kind} {seed}: missing {', '.join(missing) or 'nothing'}; false"
            f" {', '.join(false) or 'nothing'}; outside"
            f" {', '.join(n for n, h in holds.items() if not h) or 'nothing'}",
            flush=True,
        )
    print(
        f"of {len(tasks)}: friction found in {friction}, no false term in {clean}, c_linear in its"
        f" interval in {linear}, friction in its interval in {dry}"
    )
    return friction, clean, linear


if __name__ == "__main__":
    main()
