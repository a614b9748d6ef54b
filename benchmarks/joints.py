"""Joints in which several modes ring: does the report say that they hold for this mixture alone?

    python benchmarks/joints.py --count 10
    python benchmarks/joints.py --file ../shared/data/brake_reuss_hammer.npz

A chain of four masses, or one mass, on springs; one of these is a lapped joint, a spring beside
eight sliders (Jenkins' elements, the forces up to which they stick spread evenly: an Iwan joint). A
short pulse hits the last mass. One accelerometer, 50 dB; the mode that moves most is read off and
identified, as `romsindy identify` does. The motion is integrated here in 60 steps of a cycle of the
fastest mode by the symplectic rule of Euler, which shares nothing with the package.
"""

import numpy as np
from seeds import parser_of, tried

import romsindy as rs

DECIBELS, SLIDERS = 50, 8
CYCLES, STEPS, EVERY = 150, 60, 4  # of the slowest mode, of a cycle of the fastest, recorded


def response(rng, masses):
    """Times and acceleration of the last mass of a chain with a joint, hit there."""
    stiff = (2 * np.pi * rng.uniform(20, 60)) ** 2 * rng.uniform(0.7, 1.4, masses)
    joint = int(rng.integers(masses))
    slip = rng.uniform(0.3, 1.0) * 1e-4 * np.arange(1, SLIDERS + 1) / SLIDERS  # m, until it slips
    slides = rng.uniform(0.05, 0.2) * stiff[joint] / SLIDERS  # the part of that spring that may
    stretched = np.eye(masses) - np.eye(masses, k=-1)
    linear = stretched.T @ np.diag(stiff) @ stretched
    squared, shapes = np.linalg.eigh(linear)
    c = shapes @ np.diag(2 * rng.uniform(0.001, 0.003) * np.sqrt(squared)) @ shapes.T
    stiff[joint] -= slides * SLIDERS
    k, along = stretched.T @ np.diag(stiff) @ stretched, stretched[joint]
    h = 2 * np.pi / np.sqrt(squared[-1]) / STEPS
    found = np.empty(int(CYCLES * 2 * np.pi / np.sqrt(squared[0]) / h))
    q, v, z = np.zeros(masses), np.zeros(masses), np.zeros(SLIDERS)
    v[-1] = 1e-3 * np.sqrt(squared[0])
    for i in range(len(found)):
        z = np.clip(z, along @ q - slip, along @ q + slip)
        a = -(k @ q) - c @ v - along * slides * np.sum(along @ q - z)
        found[i] = a[-1]
        v = v + h * a
        q = q + h * v
    return h * EVERY * np.arange(len(found[::EVERY])), found[::EVERY]


def said(record, **reading):
    """Whether the report of what moves most in a record tells of the mixture."""
    seen = rs.inspect(record, **reading)
    report = str(rs.identify(seen.decays()))
    return "mixture of modes" in report, report


def trial(seed, masses):
    rng = np.random.default_rng(seed)
    t, a = response(rng, masses)
    a = a + 10 ** (-DECIBELS / 20) * a.std() * rng.standard_normal(len(a))
    return said(rs.Decay.from_acceleration(t, a, unit="m"))[0]


def main(arguments=None):
    parser = parser_of(__doc__, 10, "of each kind")
    parser.add_argument("--file", help="a measured record in its place")
    given = parser.parse_args(arguments)
    if given.file:
        told, report = said(given.file, column=["acc1", "acc3"], unit="m/s^2")
        print(report)
        print(f"told: {told}")
        return told
    totals = []
    for masses, name in ((4, "several modes"), (1, "one mode")):
        found = [*tried(given, trial, masses)]
        totals.append(sum(found))
        print(f"{name}: told in {totals[-1]} of {len(found)}", flush=True)
    return totals


if __name__ == "__main__":
    main()
