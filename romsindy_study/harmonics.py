"""Harmonics chosen by cross-validation over cycles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, KFold

from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay
from romsindy.regression.estimator import HarmonicSINDy

CHOICES = tuple(tuple(range(top + 1)) for top in range(2, 8))
# Cycles of a block: enough to read a backbone off each on its own.
_BLOCK = 12


def blocks(decay: Decay, cycles: int = _BLOCK) -> list[Decay]:
    """Cut a decay into pieces of whole cycles that share none.

    Raises
    ------
    ValueError
        If the decay has fewer than four blocks of cycles.
    """
    up, _ = decay.crossings
    starts = up[:-cycles:cycles]
    if len(starts) < 4:
        raise ValueError(
            f"cycles = {cycles} a block make {len(starts)} blocks of the {len(up) - 1} cycles of"
            " the decay: four are needed, use fewer cycles or a longer record"
        )
    # A cycle counts when the samples before and after its crossings are there.
    first = np.maximum(starts - 2, 0)
    last = np.minimum(up[cycles::cycles] + 2, len(decay.t) - 1)
    return [decay.between(*decay.t[[a, b]]) for a, b in zip(first, last, strict=True)]


def held_out_score(
    estimator: HarmonicSINDy, _: Sequence[Decay], backbones: Sequence[Backbone]
) -> float:
    """Minus the rms relative error of frequency in blocks of cycles that were not learnt from.

    The same yardstick for all harmonics, unlike R^2 of the projected rows. A cycle at whose
    amplitude the model has no motion counts as wrong by 100 %.
    """
    amplitude = np.concatenate([b.amplitude for b in backbones])
    frequency = np.concatenate([b.frequency for b in backbones])
    error = estimator.model_.backbone(amplitude) / frequency - 1
    return -float(np.sqrt(np.mean(np.nan_to_num(error, nan=1.0) ** 2)))


def choose_harmonics(
    decay: Decay,
    estimator: HarmonicSINDy,
    choices: Sequence[Sequence[int]] = CHOICES,
    *,
    folds: int = 4,
    seed: int = 0,
) -> GridSearchCV:
    """Search the harmonics of a regression by k-fold cross-validation over blocks of cycles.

    The decay has derivatives, and a choice is a set of harmonics. Blocks are dealt into ``folds``,
    shuffled, so that each holds loud and quiet ones. The search is returned fitted: see its
    ``best_params_["projection__harmonics"]`` and ``cv_results_``.

    Raises
    ------
    ValueError
        If the decay has too few cycles for four blocks.
    """
    search = GridSearchCV(
        clone(estimator),
        {"projection__harmonics": [tuple(h) for h in choices]},
        scoring=held_out_score,
        cv=KFold(folds, shuffle=True, random_state=seed),
    )
    pieces = blocks(decay)
    # Decays bring their own times: what scikit-learn calls y is free for the truth.
    return search.fit(pieces, [extract_backbone(piece) for piece in pieces])
