"""The chapters in their order, computed one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from romsindy_study import chapters
from romsindy_study.content import Chapter
from romsindy_study.experiment import RECIPES, Trial, trials
from romsindy_study.models import FAMILIES, ORDERS, identify_all
from romsindy_study.system import System, simulate_release, simulate_system

Progress = Callable[[Iterable, str, int], Iterable]


def tell(
    progress: Progress,
    *,
    elements: int = 150,
    duration: float = 25.0,
    orbits: int = 5,
    seeds: int = 100,
    seed: int = 0,
    both_releases: bool = True,
) -> Iterator[Chapter]:
    """Run the study and yield its chapters as they are finished.

    Parameters
    ----------
    progress : callable
        ``progress(steps, what, total)`` wraps what takes time, as tqdm does.
    elements, duration, orbits : int, float, int
        See `simulate_system`.
    seeds, seed : int
        Number of noisy experiments, and the first seed. An experiment takes two seeds.
    both_releases : bool
        Whether to simulate a release by a modal force too.
    """
    system = simulate_system(elements, duration, orbits, progress=True)
    yield chapters.structure(system)
    yield chapters.cycles(system)
    fits = {}
    for name, recipe in RECIPES.items():
        found = identify_all(system.decay, system.backbone, system.omega, recipe)
        steps = progress(found, f"identifying, {name} regression", 2 * len(FAMILIES) * len(ORDERS))
        fits[name] = {c.name: c for c in steps}
    yield chapters.comparison(system, fits["plain"])
    yield chapters.recipes(system, fits["plain"], fits["weighted"])
    if both_releases:
        modal = simulate_release(system.beam, system.modes, duration, 1, progress=True)
        yield chapters.releases(system, modal)
    finished = finished_trials(system, range(seed, seed + 2 * seeds, 2), progress)
    yield chapters.experiment(system, finished, seeds)
    yield chapters.damping(system)
    yield chapters.harmonics(system, seed)


def finished_trials(system: System, seeds: range, progress: Progress) -> list[Trial]:
    """Trials of all seeds, or of those that were finished when Ctrl-C came (two at least)."""
    finished: list[Trial] = []
    steps = trials(system.motion, system.backbone, seeds)
    try:
        for trial in progress(steps, "noisy experiments", len(seeds)):
            finished.append(trial)
    except KeyboardInterrupt:
        if len(finished) < 2:
            raise
    return finished
