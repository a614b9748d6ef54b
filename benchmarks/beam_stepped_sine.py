"""The model of a beam's decay against its stepped sine: amplitudes, and the frequencies of jumps.

    python benchmarks/beam_stepped_sine.py                 # tip amplitudes of 0.05, 0.1 and 0.2 L
    python benchmarks/beam_stepped_sine.py --levels 0.1 --dwell 100 --fine 2.5e-4

The default beam is let go in its first mode, and the decay of that mode gives the equation. The
tip follows the mode by a polynomial, found from the same decay; a harmonic force at the tip does
its work on it. Then the element model is driven by a stepped sine with continuous phase, up through
the upper fold and down through the lower one, and the first harmonic of the tip is read at the end
of every step.
"""

import argparse

import numpy as np

from romsindy import Beam, Decay, HarmonicSINDy, ROMLibrary, forced_response, refine

STEP, READ = 2e-3, 2.0  # s: of time, and at the end of each frequency looked at
FAR = 0.02, 0.008, 0.003  # from a fold, relative
NEAR = 0.02  # of the peak: a motion so near to a branch is on it
FOLLOWS = np.arange(1, 6)  # powers of the mode in the displacement of the tip
ORDER = 7


def released(beam):
    """The first mode as a decay, kg^0.5 m, and the polynomial by which the tip follows it."""
    sensors = beam.sensors([beam.length])
    shape = beam.release_shape(0.25 * beam.length, mode=1)
    motion = beam.simulate(shape, 30.0, STEP, sensors=sensors, energy_tolerance=1e-5)
    q, tip = motion.coordinates.displacement[:, 0], motion.sensors.displacement[:, 0]
    shown = np.linalg.lstsq(q[:, None] ** FOLLOWS, tip, rcond=None)[0]
    return Decay(motion.t, q, unit="kg^0.5 m"), shown


def identified(decay):
    """Its equation of motion."""
    library = ROMLibrary(
        stiffness=range(1, ORDER + 1), inertia=range(3, ORDER + 1), damping=("linear", "q^2 q_dot")
    )
    return refine(HarmonicSINDy(library).fit(decay).model_, decay)


def first_harmonic(coefficients, shown):
    """Of the tip, m, for an orbit of the mode by its Fourier coefficients."""
    phase = 2 * np.pi * np.arange(64) / 64
    q = np.real(np.exp(1j * np.outer(phase, np.arange(len(coefficients)))) @ coefficients)
    return 2 * abs(np.mean(q[:, None] ** FOLLOWS @ shown * np.exp(-1j * phase)))


def stepped(beam, force, frequency, dwell):
    """First harmonics of the tip, m, at the end of each step of a stepped sine, frequency in Hz."""
    frequency = np.asarray(frequency)
    ends = dwell * np.arange(2, len(frequency) + 2)  # the first lasts twice as long
    lengths = np.diff(ends, prepend=0.0)
    turns = np.cumsum(frequency * lengths) - frequency * lengths

    def push(t):
        i = np.minimum(np.searchsorted(ends, t, side="right"), len(ends) - 1)
        phase = turns[i] + frequency[i] * (t - ends[i] + lengths[i])
        return force * np.minimum(t, 1.0) * np.cos(2 * np.pi * phase)

    sensors = beam.sensors([beam.length])
    motion = beam.simulate(duration=ends[-1], step=STEP, force=push, sensors=sensors)
    tip, found = motion.sensors.displacement[:, 0], []
    for end, hertz in zip(ends, frequency, strict=True):
        here = (motion.t > end - np.floor(READ * hertz) / hertz) & (motion.t <= end)
        waves = np.exp(2j * np.pi * hertz * np.outer(motion.t[here], np.arange(-3, 4)))
        found.append(2 * abs(np.linalg.lstsq(waves, tip[here], rcond=None)[0][4]))
    return np.array(found)


def foretold(beam, fit, shown, part):
    """Force, N, and frequency, Hz, and first harmonic of the tip along the response, with folds."""
    q = part * beam.length / shown[0]
    band = fit.band([q])
    force = float(2 * band.damping_ratio[0] * band.frequency[0] ** 2 * q) / shown[0]
    ends = band.frequency[0] * np.array([0.93, 1.07])
    response = forced_response(fit.model, force * shown[0], tuple(ends))
    tip = np.array([first_harmonic(c, shown) for c in response.coefficients])
    folds = [b.index for b in response.bifurcations if b.kind == "fold"]
    return force, response.frequency / (2 * np.pi), tip, folds


def compared(beam, fit, shown, part, dwell, fine):
    """Print one level; errors of the amplitudes over the peak, and of the folds, relative.

    Near a fold a motion lingers: what is near neither branch is on its way, and is not compared.
    The fold lies near the last motion on its branch: between the ones before and after it.
    """
    force, hertz, tip, folds = foretold(beam, fit, shown, part)
    top = int(np.argmax(tip))
    print(f"level {part:g} L: {1e3 * force:.4g} mN, foretold peak {1e3 * tip[top]:.3f} mm")
    upper, lower = folds or (top, top)
    branches = slice(0, upper + 1), slice(lower, None)
    off, missed = [], []
    for sign, at in ((-1, upper), (1, lower)):
        near = fine * np.arange(3.5, -4.0, -1)
        sweep = hertz[at] * (1 + sign * np.concatenate([FAR, near]))
        values = np.array([_on(hertz[b], tip[b], sweep) for b in branches])
        measured = stepped(beam, force, sweep, dwell)
        away = (values - measured) / tip[top]
        nearest = np.nanargmin(np.abs(away), axis=0)
        there = np.abs(away[nearest, np.arange(len(sweep))]) < NEAR
        for i, (f, a) in enumerate(zip(sweep, measured, strict=True)):
            told = f"  {f:.5f} Hz  {1e3 * a:.3f} mm  "
            if there[i]:
                off.append(away[nearest[i], i])
                told += (
                    f"foretold {1e3 * values[nearest[i], i]:.3f}  {100 * off[-1]:+.2f} % of peak"
                )
            print(told if there[i] else f"{told}on its way", flush=True)
        if folds:
            own = there & (nearest == (sign > 0))
            last = int(np.flatnonzero(own)[-1])
            ends = sweep[max(last - 1, 0)], sweep[min(last + 1, len(sweep) - 1)]
            missed.append(_outside(hertz[at], *sorted(ends)))
            print(
                f"  leaves its branch between {ends[0]:.5f} and {ends[1]:.5f} Hz, foretold", end=""
            )
            print(f" {hertz[at]:.5f} Hz")
    print(
        f"  amplitudes within {100 * np.abs(off).max():.2f} % of the peak ({len(off)} of 22);",
        end="",
    )
    print(f" folds outside their brackets by {[f'{100 * m:.3f} %' for m in missed]}")
    return off, missed


def _on(hertz, tip, frequency):
    """Amplitudes on a branch; nan beyond its end."""
    order = np.argsort(hertz)
    return np.interp(frequency, hertz[order], tip[order], left=np.nan, right=np.nan)


def _outside(value, low, high):
    return max(low - value, value - high, 0.0) / value


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--levels", type=float, nargs="+", default=[0.05, 0.1, 0.2])
    parser.add_argument("--dwell", type=float, default=40.0, help="s at each frequency")
    parser.add_argument("--fine", type=float, default=5e-4, help="steps near a fold, relative")
    given = parser.parse_args(arguments)
    beam = Beam.cantilever()
    decay, shown = released(beam)
    fit = identified(decay)
    print(fit)
    how = given.dwell, given.fine
    return [compared(beam, fit, shown, part, *how) for part in given.levels]


if __name__ == "__main__":
    main()
