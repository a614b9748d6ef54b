"""The usual recipe on the same blind trials: low-pass, differentiate, regress the residual force.

    python benchmarks/diagnosis/recipe.py --count 50 --cache FOLDER

The residual acceleration of the nominal model is regressed on every candidate force of the
catalogue by forward orthogonal least squares (FROLS; linear stiffness and viscous damping always
free), and by STLSQ; the first choice, and the largest term left, are the names.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np
import pysindy as ps
from generator import trial_of, truth_of

import romsindy as rs
from romsindy.diagnosis import CATALOGUE
from romsindy.effects.base import Scales, State

# Linear terms are free; q_ddot as a candidate would win always, by the noise that it shares.
_LEFT_OUT = ("linear_frequency", "viscous", "added_mass")
_CUTOFFS = (6.0, 10.0, 20.0)  # of the low-pass, in fundamentals


def named(model: rs.ReducedModel, decays: list[rs.Decay], cutoff: float) -> tuple[str, str]:
    """First choice of FROLS, and the largest normalised term of STLSQ."""
    omega = np.sqrt(model.coefficients["omega^2"])
    scales = Scales(1.0, omega, 20.0, (2 * np.pi * 50.0, 2.2 * omega, 0.5 * omega))
    columns: dict[str, list[np.ndarray]] = {}
    base, target = [], []
    for decay in decays:
        smooth = decay.differentiated(rs.Butterworth(cutoff * omega / (2 * np.pi)))
        inside = slice(100, -100)  # the filter rings at the ends
        state = State(
            smooth.t[inside], smooth.q[inside], smooth.q_dot[inside], smooth.q_ddot[inside], 0.0025
        )
        target.append(-model.residual(state.q, state.q_dot, state.q_ddot))
        base.append(np.stack([state.q, state.q_dot]))
        for effect in CATALOGUE:
            if effect.per_record or effect.readings(state.t, state.q) is not None:
                continue  # not a force: outside the recipe
            known = effect.parameters(scales)
            for shape in itertools.islice(itertools.product(*(p.starts for p in known)), 20):
                values = {p.name: value for p, value in zip(known, shape, strict=True)}
                column = effect.shaped(values).forces(state)[0]
                columns.setdefault(f"{effect.name} {effect.variant} {shape}", []).append(column)
    names = [n for n in columns if n.split()[0] not in _LEFT_OUT]
    theta = np.stack([np.concatenate(columns[n]) for n in names], axis=1)
    free = np.concatenate(base, axis=1).T
    y = np.concatenate(target)
    q = np.linalg.qr(free)[0]
    theta, y = theta - q @ (q.T @ theta), y - q @ (q.T @ y)
    size = np.linalg.norm(theta, axis=0)
    met = size > 1e-9 * size.max()  # a gap that is never reached leaves an empty column
    names = [n for n, m in zip(names, met, strict=True) if m]
    theta = theta[:, met] / size[met]
    frols = names[int(np.argmax(np.abs(theta.T @ y)))].split()[0]
    best = {n.split()[0]: i for i, n in reversed(list(enumerate(names)))}
    kept = list(best.values())
    threshold = 0.2 * np.abs(theta[:, kept].T @ y).max()
    stlsq = ps.STLSQ(threshold=threshold, alpha=1e-6).fit(theta[:, kept], y[:, None])
    largest = int(np.argmax(np.abs(stlsq.coef_)))
    return frols, names[kept[largest]].split()[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cache", type=Path, default=Path("trials"))
    chosen = parser.parse_args()
    hits = {(c, k): 0 for c in _CUTOFFS for k in ("FROLS", "STLSQ")}
    total = 0
    known = {e.name: e for e in CATALOGUE}
    for seed in range(chosen.first, chosen.first + chosen.count):
        (name,) = truth_of("hidden", seed, chosen.cache)["effects"]
        effect = known[name]
        is_force = effect.readings(np.zeros(1), np.zeros(1)) is None
        if not is_force or effect.per_record or name in _LEFT_OUT:
            continue
        total += 1
        trial = trial_of("hidden", seed, chosen.cache)
        for cutoff in _CUTOFFS:
            frols, stlsq = named(trial.model, trial.decays(), cutoff)
            hits[cutoff, "FROLS"] += frols == name
            hits[cutoff, "STLSQ"] += stlsq == name
    for (cutoff, kind), n in hits.items():
        print(f"{kind}, low-pass at {cutoff:g} fundamentals: {n} of {total} right")


if __name__ == "__main__":
    main()
