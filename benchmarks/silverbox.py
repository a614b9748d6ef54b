"""An electronic Duffing oscillator under a multisine: fitted to 80 %, the rest predicted.

    python benchmarks/silverbox.py

The first 50 samples of the rest give the state; all else is a free run (M. Schoukens, J. P. Noel,
"Three benchmarks addressing open challenges in nonlinear system identification", IFAC 2017; its
training part alone is used). Also the time of one refinement of 65,000 samples with 8 coefficients.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from romsindy import ForcedVibration, identify, refine
from romsindy.physics.stiffness import Stiffness

DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "silverbox_train.npz"
PART, STATE = 0.8, 50


def records(path=DATA, share=1.0):
    """The part that is learned, and the rest; or a share of both."""
    data = np.load(path)
    n = len(data["y_V"])
    t, y, u = np.arange(n) / float(data["fs"]), data["y_V"], data["u_V"]
    first = round(PART * n)
    learned, rest = slice(first - round(share * first), first), slice(first, n)
    return [ForcedVibration(t[s], y[s], u[s], unit="V", input_unit="V") for s in (learned, rest)]


def missed(fit, rest):
    """Rms of a free run less the measurement, after the samples for the state, mV."""
    off = fit.predict(rest, STATE) - rest.y
    return 1e3 * float(np.sqrt(np.mean(off[STATE:] ** 2)))


def main(arguments=None):
    argparse.ArgumentParser(description=__doc__.split("\n")[0]).parse_args(arguments)
    learned, rest = records()
    start = time.perf_counter()
    fit = identify(learned, progress=print)
    seconds = time.perf_counter() - start
    print(fit)
    print(f"{len(fit.free)} coefficients, {seconds:.0f} s; free run {missed(fit, rest):.3f} mV rms")
    whole = ForcedVibration(
        np.arange(len(learned.t) + len(rest.t)) * learned.dt,
        np.concatenate([learned.y, rest.y]),
        np.concatenate([learned.u, rest.u]),
        unit="V",
        input_unit="V",
    )
    terms = {*fit.model.terms[:-1], Stiffness(5)}
    wide = identify(learned, terms=[t for t in terms if t.key not in ("omega^2", "c_linear")])
    refine(wide.model, rest)
    start = time.perf_counter()
    again = refine(wide.model, whole)
    print(f"{len(again.free)} coefficients again, {len(whole.t)} samples:", end=" ")
    print(f"{time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
