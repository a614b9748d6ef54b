"""The simulated experiment of section 5, and its repetition over seeds of the noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from joblib import Parallel, delayed

from romsindy.beam import Motion
from romsindy.record.backbone import Backbone
from romsindy.record.decay import Decay
from romsindy.record.smoothing import Butterworth
from romsindy.regression.estimator import PAPER, WEIGHTED
from romsindy.regression.judged import Judged
from romsindy_study.models import identify

MODES, SNR_DB, CUTOFF, END = 3, 35.0, 100.0, 18.0
RECIPES = {"plain": PAPER, "weighted": WEIGHTED}
FITTED = ("stiffness", "IC-ROM")
ORDER = 5


@dataclass(frozen=True, eq=False)
class Trial:
    """What one measurement with its own noise leads to.

    Candidates are "stiffness, plain", "IC-ROM, weighted", ..., judged by the noise-free backbone.
    """

    seed: int
    candidates: Mapping[str, Judged]


def measured_decay(motion: Motion, seed: int, snr_db: float | None = SNR_DB) -> Decay:
    """Mode 1 as the experiment sees it: noisy sensors, noisy mode shapes, unfiltered.

    Parameters
    ----------
    motion : Motion
        Simulated with sensors; q alone is kept, kg^0.5 m, of the first 18 s.
    seed : int
        Of the noise; seed + 1 makes the noise of the mode shapes.
    snr_db : float, optional
        Signal-to-noise ratio of both, dB.

    Raises
    ------
    ValueError
        If the motion has no sensors.
    """
    if motion.sensor_array is None:
        raise ValueError("motion has no sensors: simulate with sensors=beam.sensors([...])")
    decay = motion.sensor_array.experiment(motion, MODES, snr_db, seed)
    return decay.channel(0).between(end=min(END, float(motion.t[-1])))


def filtered_decay(motion: Motion, seed: int) -> Decay:
    """`measured_decay` after the zero-phase Butterworth filter (4th order, 100 Hz)."""
    return measured_decay(motion, seed).differentiated(Butterworth(CUTOFF))


def trial(motion: Motion, backbone: Backbone, seed: int) -> Trial:
    """Measure once, identify models of order 5 by both recipes, judge by ``backbone``."""
    decay = filtered_decay(motion, seed)
    candidates = {
        f"{family}, {name}": identify(decay, backbone, family, ORDER, recipe=recipe)
        for family in FITTED
        for name, recipe in RECIPES.items()
    }
    return Trial(seed, candidates)


def trials(motion: Motion, backbone: Backbone, seeds: Sequence[int]) -> Iterator[Trial]:
    """Yield a `Trial` of every seed as it is finished, in any order.

    Runs wherever joblib is told to: ``with joblib.parallel_config(n_jobs=2)`` takes two
    processes, ``with joblib.parallel_config("dask")`` the cluster of the current Dask client.
    What has been yielded is the caller's: an interruption loses only the trials under way.
    """
    tasks = (delayed(trial)(motion, backbone, seed) for seed in seeds)
    yield from Parallel(return_as="generator_unordered")(tasks)
