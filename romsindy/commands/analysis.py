"""One record identified: free decays, regressions beside the identification, and the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from romsindy.fit.collocation import TrajectoryError
from romsindy.fit.functions.identification import Identification
from romsindy.fit.functions.identify import identify as fit
from romsindy.fit.verdict import LEAST_CYCLES
from romsindy.record.backbone import Backbone, extract_backbone, joined
from romsindy.record.decay import Decay
from romsindy.record.filters import Butterworth
from romsindy.regression.comparison import (
    PAPER,
    WEIGHTED,
    Candidate,
    Judged,
    compare_models,
    judge,
)
from romsindy.show.identification_page import IdentificationReport
from romsindy.text import bar


@dataclass(frozen=True)
class Settings:
    """What the command line asks of an identification; see `romsindy identify --help`."""

    seed: int
    order: int
    damping: tuple[str, ...]
    fix: Mapping[str, float]
    harmonics: tuple[int, ...] | None
    amplitude: tuple[float, float] | None
    cutoff: float | None
    plain: bool
    weighted: bool
    curvature: float


def analysed(
    title: str, decays: Sequence[Decay], settings: Settings, picked: str = ""
) -> IdentificationReport:
    """Identify an equation from the free decays of one mode, beside plain regressions.

    An interrupt leaves the regressions, and the report says so.

    Parameters
    ----------
    title : str
        Of the report.
    decays : sequence of Decay
    settings : Settings
    picked : str
        What was used of the record.

    Raises
    ------
    ValueError
        If the decays cannot be used, or the settings contradict them.
    """
    free, backbones = _used(decays, settings.amplitude)
    backbone = joined(backbones)
    fastest = float(backbone.frequency.max()) / (2 * np.pi)
    if settings.cutoff is not None and 0 < settings.cutoff < fastest:
        raise ValueError(
            f"cutoff = {settings.cutoff:g} Hz would take away the vibration itself, of up to"
            f" {fastest:.4g} Hz: choose a multiple of that"
        )
    conditioned = [d.conditioned(Butterworth(settings.cutoff)) for d in free]
    recipe = deepcopy(WEIGHTED if settings.weighted else PAPER)
    if settings.harmonics is not None:
        recipe.set_params(projection__harmonics=settings.harmonics)
    choices = (settings.order, settings.damping, settings.fix, recipe)
    four = {c.name: c for c in compare_models(conditioned, backbone, *choices)}
    found, trouble, interrupted = None, "", False
    main: Judged = four["IC-ROM"]
    columns: list[Judged] = list(four.values())
    if not (settings.plain or settings.weighted):
        found, trouble, interrupted = _functions(free, settings)
        if found is not None:
            fixed = settings.fix
            main = judge("identified", found.single_model, backbone, fixed, found.standard_errors)
            columns = [main, *_beside(four, "omega^2" in fixed)]
    return IdentificationReport(
        title, conditioned, backbones, columns, main, found, trouble, picked, interrupted
    )


def _functions(
    free: Sequence[Decay], settings: Settings
) -> tuple[Identification | None, str, bool]:
    """The identification, or why there is none, and whether by an interrupt."""
    only = "Regressions alone, without functions and bands"
    with bar(None, "identifying") as steps:
        say: Callable[[str], None] = steps.set_postfix_str
        try:
            found = fit(
                list(free),
                fixed=settings.fix,
                curvature=settings.curvature,
                seed=settings.seed,
                progress=say,
            )
        except TrajectoryError as error:
            return None, f"{only}: {error}.", False
        except KeyboardInterrupt:
            return None, f"{only}: interrupted.", True
        return found, "", False


def _beside(four: Mapping[str, Candidate], fixed: bool) -> list[Candidate]:
    """Regressions to be held against an identification."""
    suffix = ", omega fixed" if fixed else ""
    names = ("IC-ROM", "stiffness")
    return [replace(four[name + suffix], name=f"plain {name}") for name in names]


def _used(
    decays: Sequence[Decay], amplitude: tuple[float, float] | None
) -> tuple[list[Decay], list[Backbone]]:
    """The free decays, or their cycles with these amplitudes, and their backbones."""
    free = [d.single().free() for d in decays]
    backbones = [extract_backbone(d) for d in free]
    if amplitude is None:
        return free, backbones
    low, high = amplitude
    inside = [(b.amplitude >= low) & (b.amplitude <= high) for b in backbones]
    enough = [np.count_nonzero(cycles) >= LEAST_CYCLES for cycles in inside]
    if not any(enough):
        n = max(int(np.sum(cycles)) for cycles in inside)
        sizes = joined(backbones).amplitude
        raise ValueError(
            f"amplitude = {amplitude} holds {n or 'no'} cycle{'s' * (n > 1)}, fewer than"
            f" {LEAST_CYCLES}: those of the decay have amplitudes from {sizes.min():.3g} to"
            f" {sizes.max():.3g} {free[0].unit or '[q]'}"
        )
    parts = [
        d.between(float(b.t[cycles][0]), float(b.t[cycles][-1]))
        for d, b, cycles, some in zip(free, backbones, inside, enough, strict=True)
        if some
    ]
    return parts, [extract_backbone(d) for d in parts]
