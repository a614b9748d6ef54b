"""A measured clamped beam, whose third mode joins its first at 1:5: one coordinate and two.

    python benchmarks/clamped_beam.py                     # the whole of run b
    python benchmarks/clamped_beam.py --between 2.3 3.1   # the resonance alone, s

What a model leaves is compared with two noises: what a fit of one coordinate takes for noise, other
vibrations included, and what is heard beside all vibrations, which is that of the verdict. All that
is given is the number of coordinates.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from romsindy import HarmonicSINDy, ROMLibrary, load_decay, refine
from romsindy.fit.coupled.identify import identify_coupled

DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "cc_beam_bristol.npz"
LAWS = {"inertia": (), "stiffness": (1, 3, 5), "damping": ("linear", "quadratic")}


def run_b(path=DATA, ends=(None, None)):
    """The free part of the record, a velocity in m/s."""
    return load_decay(path, "m/s", column="mode1b_v", time="mode1b_t").free().between(*ends)


def taken_for_noise(decay):
    """Rms of what one coordinate takes for noise, m/s."""
    one = refine(HarmonicSINDy(ROMLibrary(**LAWS)).fit(decay).model_, decay)
    return one.records[0].noise.std


def left_by(decay, coordinates):
    """The fit of so many coordinates, and the rms of what it leaves, m/s."""
    fit = identify_coupled(decay, coordinates)
    return fit, float(np.sqrt(np.mean(np.concatenate(fit.residuals) ** 2)))


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--between", type=float, nargs=2, default=(None, None), help="s")
    decay = run_b(ends=parser.parse_args(arguments).between)
    rows, noise = [], taken_for_noise(decay)
    for coordinates in (1, 2):
        start = time.perf_counter()
        fit, left = left_by(decay, coordinates)
        rows.append(left)
        print(
            f"{coordinates} of them: {1e3 * left:.2f} mm/s left, {left / noise:.2f} times what one"
            f" coordinate takes for noise, {fit.adequacy:.2f} times what is heard beside all"
            f" vibrations; {len(fit.free)} coefficients, {time.perf_counter() - start:.0f} s"
        )
    print(fit.verdict)
    return rows


if __name__ == "__main__":
    main()
