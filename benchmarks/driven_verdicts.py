"""Is a right model of a driven record explained, whatever its noise, and is a wrong one noticed?

    python benchmarks/driven_verdicts.py --count 20 --jobs 2      # so many records of each noise
    python benchmarks/driven_verdicts.py --first 300 --noise force

The records are those of forced_vibrations.py, with white or coloured noise of the sensor, a force
that nobody measured, or noise of the force sensor. The right terms are given, then all but the last
nonlinear one; the force that tells most of what is left is compared with it.
"""

import argparse
import warnings
from dataclasses import replace
from typing import NamedTuple

from forced_vibrations import system
from joblib import Parallel, delayed

from romsindy import ReducedModel, refine

NOISES = ("white", "coloured", "force", "input")
LIKE = {  # the force as the verdict calls it; in a band of one mode some look alike
    "gamma_2": ("q^2", "q_dot^2"),
    "gamma_3": ("q^3", "|q| q", "q q_dot^2", "q^5"),
    "c_quadratic": ("|q_dot| q_dot", "q_dot^3", "q^2 q_dot", "the sign of q_dot"),
}


class Row(NamedTuple):
    """One record: its verdicts, and how many of the right coefficients hold."""

    noise: str
    seed: int
    explained: bool
    held: int
    values: int
    lacking: str
    noticed: bool
    like: str
    part: float


def trial(noise, seed):
    """Both models of one record."""
    warnings.simplefilter("ignore")
    s = system(seed, noise)
    laws = {n: v for n, v in s.truth.items() if "[" not in n}
    right = fitted(laws, s)
    errors = right.standard_errors
    values = {n: v for n, v in s.truth.items() if n in errors}
    held = sum(abs(right.model.coefficients[n] - v) < 2 * errors[n] for n, v in values.items())
    lacking = [n for n in laws if n not in ("omega^2", "c_linear")][-1]
    wrong = fitted({n: v for n, v in laws.items() if n != lacking}, s).verdict
    return Row(
        noise,
        seed,
        right.verdict.explained,
        held,
        len(values),
        lacking,
        not wrong.explained,
        wrong.like,
        wrong.part,
    )


def fitted(laws, s):
    """A model of these laws, its values near those of the truth."""
    start = {n: v * (1.03 if n == "omega^2" else 1.0) for n, v in laws.items()}
    record = replace(s.record, interpolation=s.way)
    return refine(ReducedModel.from_coefficients(start, unit="m"), record)


def line(noise, rows):
    """What came out of the records with one noise."""
    n, held, values = len(rows), sum(r.held for r in rows), sum(r.values for r in rows)
    noticed = [r for r in rows if r.noticed]
    named = sum(r.like in LIKE[r.lacking] for r in noticed)
    return (
        f"{noise:9}  right model explained {sum(r.explained for r in rows)} of {n},"
        f" two standard errors hold {100 * held / values:.0f} % of {values};"
        f"  a term less: noticed {len(noticed)}, the force named {named}"
    )


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--noise", choices=NOISES)
    options = parser.parse_args(arguments)
    seeds = range(options.first, options.first + options.count)
    for noise in [options.noise] if options.noise else NOISES:
        rows = Parallel(options.jobs)(delayed(trial)(noise, seed) for seed in seeds)
        for r in rows:
            if not r.explained or not r.noticed or r.like not in LIKE[r.lacking]:
                said = f"explained: {r.explained}; without {r.lacking}: {r.noticed}, {r.like}"
                print(f"{noise:9}  {r.seed:6}  {said}, {100 * r.part:.2g} % left")
        print(line(noise, rows), flush=True)


if __name__ == "__main__":
    main()
