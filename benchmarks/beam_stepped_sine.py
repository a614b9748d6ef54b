"""The model of a beam's decay against its stepped sine: amplitudes, and the frequencies of jumps.

    python benchmarks/beam_stepped_sine.py                 # tip amplitudes of 0.05, 0.1 and 0.2 L
    python benchmarks/beam_stepped_sine.py --levels 0.1

The default beam is let go and its tip recorded; `romsindy.refine` finds the equation. A harmonic
force at the tip does its work on the tip's displacement alone: per unit mass it is the force over
the modal mass at the tip. Then the element model is driven by a stepped sine with continuous phase,
up through the upper fold and down through the lower one, and the amplitude of the first harmonic is
read at the end of every step.
"""

import argparse

import numpy as np

from romsindy import Beam, Decay, HarmonicSINDy, ROMLibrary, forced_response, refine

STEP, DWELL, READ = 2e-3, 25.0, 2.0  # s: of time, at a frequency, and of it looked at
FINE = 5e-4  # between frequencies near a fold, relative


def decay(beam):
    """The tip after a release at a quarter of the length, as a decay."""
    sensors = beam.sensors([beam.length])
    shape = beam.release_shape(0.25 * beam.length, mode=1)
    motion = beam.simulate(shape, 30.0, STEP, sensors=sensors, energy_tolerance=1e-5)
    return Decay(motion.t, motion.sensors.displacement[:, 0], unit="m")


def identified(record, order=9):
    """Its equation of motion."""
    library = ROMLibrary(
        stiffness=range(1, order + 1), inertia=range(3, order + 1), damping=("linear", "q^2 q_dot")
    )
    start = HarmonicSINDy(library).fit(record).model_
    return refine(start, record)


def stepped(beam, force, frequency, dwell=DWELL):
    """First harmonics of the tip, m, at the end of each step of a stepped sine, frequency in Hz."""
    ends = dwell * np.arange(1, len(frequency) + 1)
    starts = np.concatenate([[0.0], np.cumsum(2 * np.pi * np.asarray(frequency) * dwell)[:-1]])

    def push(t):
        i = np.minimum(np.searchsorted(ends, t, side="right"), len(ends) - 1)
        phase = starts[i] + 2 * np.pi * np.asarray(frequency)[i] * (t - ends[i] + dwell)
        return force * np.cos(phase) * np.minimum(t / 1.0, 1.0)

    sensors = beam.sensors([beam.length])
    motion = beam.simulate(duration=ends[-1], step=STEP, force=push, sensors=sensors)
    tip, found = motion.sensors.displacement[:, 0], []
    for end, hertz in zip(ends, frequency, strict=True):
        cycles = np.floor(READ * hertz)
        here = (motion.t > end - cycles / hertz) & (motion.t <= end)
        waves = np.exp(2j * np.pi * hertz * np.outer(motion.t[here], np.arange(-3, 4)))
        found.append(2 * abs(np.linalg.lstsq(waves, tip[here], rcond=None)[0][4]))
    return np.array(found)


def level(beam, fit, part):
    """One level: a table of frequencies and amplitudes, and the folds."""
    mass = 1 / beam.modes(count=1).shapes[0, -1, 1] ** 2
    band = fit.band([part * beam.length])
    omega, zeta = float(band.frequency[0]), float(band.damping_ratio[0])
    force = 2 * zeta * omega**2 * part * beam.length * mass
    response = forced_response(fit.model, force / mass, (0.93 * omega, 1.07 * omega))
    hertz, size = response.frequency / (2 * np.pi), np.abs(response.coefficients[:, 1])
    folds = [hertz[b.index] for b in response.bifurcations if b.kind == "fold"]
    top = int(np.argmax(size))
    print(f"level {part:g} L: force {1e3 * force:.4g} mN, foretold peak {size[top]:.5f} m")
    last = folds[0] if folds else hertz[top]
    up = np.concatenate(
        [last * (1 - np.array([0.02, 0.008, 0.003])), last * (1 + FINE * np.arange(-3.5, 4))]
    )
    low = folds[1] if folds else last
    down = np.concatenate(
        [low * (1 + np.array([0.02, 0.008, 0.003])), low * (1 - FINE * np.arange(-3.5, 4))]
    )
    for name, sweep, branch, fold in (
        ("up", up, slice(0, top + 1), last),
        ("down", down, slice(top, None), low),
    ):
        measured = stepped(beam, force, sweep)
        order = np.argsort(hertz[branch])
        jump = int(np.argmax(np.abs(np.diff(np.log(measured))))) if folds else len(sweep)
        for i, (f, a) in enumerate(zip(sweep, measured, strict=True)):
            upper = (name == "up") == (i <= jump) if folds else name == "up"
            here = slice(0, top + 1) if upper else slice(top, None)
            line = hertz[here], size[here]
            if folds and not upper:
                from_fold = int(np.argmin(hertz[top:])) + top
                line = hertz[from_fold:], size[from_fold:]
            order = np.argsort(line[0])
            foretold = float(np.interp(f, line[0][order], line[1][order]))
            print(
                f"  {name:4s} {f:.5f} Hz  {a:.5f} m  foretold {foretold:.5f}  {100 * (foretold - a) / size[top]:+.2f} % of the peak",
                flush=True,
            )
        if folds:
            between = sweep[jump : jump + 2]
            print(
                f"  jumps between {between[0]:.5f} and {between[1]:.5f} Hz, foretold {fold:.5f} Hz: {100 * (fold / between.mean() - 1):+.3f} % from the middle",
                flush=True,
            )


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--levels", type=float, nargs="+", default=[0.05, 0.1, 0.2])
    given = parser.parse_args(arguments)
    beam = Beam.cantilever()
    fit = identified(decay(beam))
    print(fit)
    for part in given.levels:
        level(beam, fit, part)


if __name__ == "__main__":
    main()
