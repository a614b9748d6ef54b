"""A cantilever let go from a tip force, five sensors: which modes are identified, and how well?

    python benchmarks/tip_release.py --count 3 --seed 1     # prints a row a mode, for each seed

The default beam is held by a force at its tip, 0.15 of its length aside, and simulated for 6 s by
the element model; noise of 35 dB is added. Nothing is told to the identification. The truth are
the normal modes of the undamped beam and the damping of small vibrations.
"""

import argparse
import time

import numpy as np

from romsindy import Beam, Decay, identify

DECIBEL, DURATION, RATE = 35.0, 6.0, 1000.0
PLACES = (0.2, 0.4, 0.6, 0.8, 1.0)


def released(beam, duration=DURATION):
    """Times, and displacements across the beam at the sensors, without noise."""
    sensors = beam.sensors([place * beam.length for place in PLACES])
    shape = beam.release_shape(0.15 * beam.length)
    motion = beam.simulate(shape, duration, 1 / RATE, sensors=sensors, progress=False)
    return motion.t, motion.sensors.displacement[:, ::2]


def noisy(t, clean, seed):
    rng = np.random.default_rng(seed)
    noise = clean.std(axis=0) * 10 ** (-DECIBEL / 20) * rng.standard_normal(clean.shape)
    return Decay(t, clean + noise, unit="m")


def backbone_error(fit, mode):
    """Largest error of the frequency over it, at three amplitudes that the mode reached."""
    undamped = Beam.cantilever(alpha=0.0, eta=0.0)
    most = float(fit.records[0].tones[mode - 1].amplitude.max())
    tips = [part * most * fit.mode_shapes[-1, mode - 1] for part in (0.3, 0.65, 0.95)]
    true = undamped.normal_mode(tips, mode, progress=False)
    main = int(np.argmax(fit.mode_shapes[:, mode - 1] == 1.0))
    sensors = undamped.sensors([PLACES[main] * undamped.length])
    sizes = []
    for shape, omega in zip(true.shapes, true.frequency, strict=True):
        cycle = 2 * np.pi / omega
        motion = undamped.simulate(shape, cycle, cycle / 400, sensors=sensors, progress=False)
        sizes.append(np.ptp(motion.sensors.displacement[:, 0]) / 2)
    band = fit.band(sizes, mode)
    return float(np.abs(band.frequency / true.frequency - 1).max())


def true_damping_ratio(beam, mode, cycles=10):
    """Of a small vibration of one mode, from the fall of its velocity over whole cycles."""
    small = Beam.cantilever(alpha=0.0, eta=0.0).normal_mode([1e-5], mode, progress=False)
    cycle = 2 * np.pi / small.frequency[0]
    sensors = beam.sensors([beam.length])
    options = {"sensors": sensors, "progress": False}
    motion = beam.simulate(small.shapes[0], (cycles + 1) * cycle, cycle / 400, **options)
    tip = motion.sensors.displacement[:, 0]
    first, last = np.ptp(tip[:400]), np.ptp(tip[400 * cycles : 400 * (cycles + 1)])
    return float(np.log(first / last) / (2 * np.pi * cycles))


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=3, help="draws of the noise")
    parser.add_argument("--seed", type=int, default=1, help="of the first one")
    given = parser.parse_args(arguments)
    beam = Beam.cantilever()
    t, clean = released(beam)
    for seed in range(given.seed, given.seed + given.count):
        begin = time.perf_counter()
        fit = identify(noisy(t, clean, seed), "auto")
        print(
            f"seed {seed}: {fit.model.n_coordinates} modes, residual {fit.adequacy:.3f},"
            f" {time.perf_counter() - begin:.0f} s",
            flush=True,
        )
        for mode, zeta in enumerate(fit.model.linear_damping_ratios, 1):
            off = zeta / true_damping_ratio(beam, mode) - 1
            print(
                f"  mode {mode}: backbone within {100 * backbone_error(fit, mode):.3f} %,"
                f" damping {100 * zeta:.4f} %, off by {100 * off:+.2f} %",
                flush=True,
            )


if __name__ == "__main__":
    main()
