"""What of a file is meant: decays with all that is in them, or one mode by itself, analysed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from romsindy.commands.options import grouped
from romsindy.commands.results import Result
from romsindy.fit.functions.identification import Identification
from romsindy.fit.identify import identify
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.verdict import LEAST_CYCLES
from romsindy.inspection.inspection import Inspection, inspect
from romsindy.inspection.page import picture
from romsindy.inspection.tables import picked
from romsindy.physics.example import example_decay
from romsindy.record.backbone import Backbone, extract_backbone, joined
from romsindy.record.decay import Decay
from romsindy.record.files import load_decay, load_recording
from romsindy.record.files.load import named
from romsindy.record.forced import ForcedVibration
from romsindy.record.recording import Recording
from romsindy.record.smoothing import Butterworth
from romsindy.regression.estimator import PAPER, WEIGHTED, compare_models
from romsindy.regression.judged import Beside, Judged, judge
from romsindy.show.identified import Identified
from romsindy.show.page import Picture
from romsindy.text import bar, listed


class Selection(NamedTuple):
    """What of a file is meant."""

    mode: int | None = None
    band: tuple[float, float] | None = None
    release: int | None = None
    whole: bool = False  # the file as it is
    coordinates: int = 1  # that ring together

    @property
    def isolates(self) -> bool:
        """Whether one mode is wanted by itself."""
        return self.mode is not None or self.band is not None


def decays_in(
    file: Path, reading: Mapping[str, Any], choice: Selection, say: Callable[[str], object]
) -> list[Decay]:
    """Decays of a file, one of every release, found as `identify` finds them.

    A filter would take away what a diagnosis is to name: hum, an offset, a second mode that is
    faint. A mode is isolated only where it is asked for; ``say`` is told what was chosen.

    Raises a ValueError if the file cannot be understood, or does not hold what was chosen.
    """
    if choice.whole:
        return [load_decay(file, **reading)]
    named_ones = choice.isolates and bool(reading["column"])
    recording = _clear(file, reading, named_ones or choice.coordinates > 1)
    with named(f"{file}"):
        with bar(None, "inspecting") as steps:
            found = inspect(recording, progress=steps.set_postfix_str)
        if choice.coordinates > 1:
            return list(found.whole_decays(choice.release, choice.coordinates))
        return _chosen(found, choice, lambda line: say(f"{file}: {line}"))


def _chosen(found: Inspection, choice: Selection, say: Callable[[str], object]) -> list[Decay]:
    try:
        mode = found.mode(choice.mode, choice.band)
    except ValueError as error:
        if choice.isolates:
            raise
        source = f"{found.recording.source}: "
        remedy = "--whole takes it as it is"
        raise ValueError(f"{str(error).removeprefix(source)}; {remedy}") from error
    releases = found.rings_in(mode, choice.release)
    if choice.isolates:
        say(picked(found, mode, releases))
        return list(found.decays(mode.number, release=choice.release))
    beside = [m for m in found.modes if m is not mode and not m.steady]
    if beside:
        modes = listed([f"mode {m.number} at {m.mean_frequency:.4g} Hz" for m in beside])
        say(
            f"beside mode {mode.number} at {mode.mean_frequency:.4g} Hz rings {modes}, which stays"
            f" in, for it may be what is missing; --mode {mode.number} takes it off."
        )
    decays = list(found.measured_decays(choice.release))
    for notes in filter(None, (d.notes for d in decays)):
        say("; ".join(notes))
    return decays


# -- one mode by itself: found, isolated, analysed, and told on a page -----------------------------


Analysis = Callable[[str, Sequence[Decay], str], Identified]

# The options that choose a mode, and releases.
mode_options = grouped(
    click.option(
        "--mode", type=int, help="Number of the mode, see inspect.  [default: moves most]"
    ),
    click.option(
        "--band", nargs=2, type=float, help="Lowest and highest frequency of the mode, Hz."
    ),
    click.option("--release", type=int, help="Number of the release, see inspect.  [default: all]"),
)


def inspected(
    file: Path | None, reading: Mapping[str, Any], seed: int, together: bool = False
) -> tuple[str, Inspection]:
    """Title of a file, or of the example, and what is in it, in all channels ``together``."""
    title = f"Free decay {file.name}" if file else "Example: synthetic decay, 35 dB"
    with bar(None, "inspecting") as steps:
        several = together or bool(reading["column"])
        record = _clear(file, reading, several) if file else example_decay(35.0, seed)
        return title, inspect(record, progress=steps.set_postfix_str)


def _clear(file: Path, reading: Mapping[str, Any], several: bool) -> Recording:
    """What is in a file, where it is clear which column is meant, or ``several`` may be."""
    recording = load_recording(file, **reading)
    names = list(recording.names)
    if len(names) > 1 and not several:
        raise ValueError(
            f"{file}: {len(names)} columns could be the measured one, {names}: choose with column="
        )
    return recording


@contextmanager
def of_file(file: Path | None, warnings: Sequence[str] = ()) -> Iterator[None]:
    """What is refused is told with the name of the file, and what is wrong with its samples."""
    try:
        yield
    except ValueError as error:
        sentence = str(error).removeprefix(f"{file}: ")
        words = "; ".join([f"{file or 'example'}: {sentence}", *warnings])
        raise ValueError(words) from error


def analysed(
    file: Path | None, reading: Mapping[str, Any], choice: Selection, analyse: Analysis, seed: int
) -> tuple[Identified, list[Picture], dict[str, Any], str]:
    """Analyse one mode of a file, or of the example: report, more figures, facts, what comes next.

    Raises a ValueError if the file cannot be understood, or does not hold what was chosen; as
    ``analyse``.
    """
    title, found = inspected(file, reading, seed)
    # What is wrong with samples is no news for a choice that does not exist.
    with of_file(file, found.warnings if choice == Selection() else ()):
        mode = found.mode(choice.mode, choice.band)
        releases = found.rings_in(mode, choice.release)
    used = picked(found, mode, releases)
    with of_file(file, found.warnings):
        try:
            report = analyse(title, found.decays(mode.number, release=choice.release), used)
        except KeyboardInterrupt as error:
            reached = f"{error}, after the inspection. {used.rstrip('.')}"
            raise KeyboardInterrupt(reached) from None
    more = [picture(found)] if len(found.modes) > 1 or len(found.releases) > 1 else []
    facts = {
        "channel": found.channel,
        "mode": mode.number,
        "modes": [m.mean_frequency for m in found.modes],
        "releases": tuple(i + 1 for i in releases),
        "warnings": found.warnings,
    }
    return report, more, facts, _next(str(file or "example"), report, found)


def of_one_mode(file: Path | None, page: Path, interactive: bool, **asked: Any) -> Result:
    """Analyse one mode of a file, or of the example, as `analysed`, and write its page."""
    report, more, facts, step = analysed(file, **asked)
    return Result.written(file, page, report, interactive, more, facts=facts, step=step)


def _next(file: str, report: Identified, inspection: Inspection) -> str:
    ringing = [m for m in inspection.modes if not m.steady]
    if report.found is None:
        return "the coefficients of all regressions with --full."
    if report.found.verdict.explained:
        return "--full prints the functions; romsindy diagnose asks what a simulation lacks."
    if len(ringing) > 1:
        return (
            f"{len(ringing)} modes ring: --coordinates auto models them together; --full prints"
            " all tables."
        )
    return f"romsindy inspect {file} shows what else is in it; --full prints all tables."


# -- its analysis: an identification with regressions beside it, or regressions alone -------------


USUAL = (5, ("linear",))  # order and damping of regressions, where nothing else is asked for
# Parts of the largest amplitude below which a decay is identified, one after the other, where the
# fit of more of it breaks down.
_QUIETER = (1.0, 0.5, 0.25)


@dataclass(frozen=True)
class Asked:
    """What the command line asks of an identification; see `romsindy identify --help`."""

    seed: int
    fix: Mapping[str, float]
    curvature: float | None
    damping_split: bool | None = None

    def fit(
        self,
        records: Sequence[Decay | ForcedVibration],
        coordinates: int | str,
        progress: Callable[[str], None],
        **model: Any,
    ) -> Any:
        """The identification of records, whatever they are: `romsindy.identify`."""
        return identify(
            records,
            coordinates,
            fixed=self.fix,
            curvature=self.curvature,
            damping_split=self.damping_split,
            seed=self.seed,
            progress=progress,
            **model,
        )


@dataclass(frozen=True)
class Recipe:
    """What the command line asks of regressions; see `romsindy regress --help`."""

    plain: bool
    order: int
    damping: tuple[str, ...]
    fix: Mapping[str, float]
    harmonics: tuple[int, ...] | None
    amplitude: tuple[float, float] | None
    cutoff: float | None


def regressed(title: str, decays: Sequence[Decay], picked: str, recipe: Recipe) -> Identified:
    """Make the regressions of the free decays of one mode; ``picked`` was used of the record.

    Raises a ValueError if the decays cannot be used, or the recipe contradicts them.
    """
    free, backbones = _used(decays, recipe.amplitude)
    backbone = joined(backbones)
    fastest = float(backbone.frequency.max()) / (2 * np.pi)
    if recipe.cutoff is not None and 0 < recipe.cutoff < fastest:
        raise ValueError(
            f"cutoff = {recipe.cutoff:g} Hz would take away the vibration itself, of up to"
            f" {fastest:.4g} Hz: choose a multiple of that"
        )
    conditioned = [d.conditioned(Butterworth(recipe.cutoff)) for d in free]
    how = deepcopy(PAPER if recipe.plain else WEIGHTED)
    if recipe.harmonics is not None:
        how.set_params(projection__harmonics=recipe.harmonics)
    four, broken = _regressions(
        conditioned, backbone, recipe.order, recipe.damping, recipe.fix, how
    )
    if broken is not None:
        raise broken
    beside = Beside(conditioned, backbones, [*four.values()], four["IC-ROM"])
    return Identified(title, conditioned, beside=beside, picked=picked)


def identified(title: str, decays: Sequence[Decay], picked: str, asked: Asked) -> Identified:
    """Identify an equation from the free decays of one mode, beside plain regressions.

    An interrupt leaves the regressions, and the report says so.

    Raises a ValueError if the decays cannot be used, or the options contradict them.
    """
    free, backbones = _used(decays, None)
    backbone, fixed = joined(backbones), asked.fix
    conditioned = [d.conditioned(Butterworth()) for d in free]
    four, broken = _regressions(conditioned, backbone, *USUAL, fixed, PAPER)
    if broken is not None and fixed:  # what was asked for may be at fault
        raise broken
    found, trouble, interrupted = _functions(free, asked)
    columns: list[Judged] = list(four.values())
    if found is not None:
        main: Judged = judge(
            "identified", found.single_model, backbone, fixed, found.standard_errors
        )
        columns = [main, *_beside(four, "omega^2" in fixed)]
        if broken is not None:
            note = f"there is no regression beside the identification: {broken}"
            found = replace(found, notes=(*found.notes, note))
    elif broken is not None:
        raise ValueError(f"{broken}; {trouble.rstrip('.')}") from broken
    else:
        main = four["IC-ROM"]
    forces = () if found is None else found.structure.forces
    return Identified(
        title,
        conditioned,
        found,
        Beside(conditioned, backbones, columns, main, forces),
        picked=picked,
        trouble=trouble,
        interrupted=interrupted,
    )


def _regressions(
    decays: Sequence[Decay], backbone: Backbone, *choices: Any
) -> tuple[dict[str, Judged], Exception | None]:
    """The four regressions by name; or none, and why."""
    with bar(None, "making the regressions"):
        try:
            return {c.name: c for c in compare_models(decays, backbone, *choices)}, None
        except (ValueError, ArithmeticError) as error:
            return {}, error


def _functions(free: Sequence[Decay], asked: Asked) -> tuple[Identification | None, str, bool]:
    """The identification, or why there is none, and whether by an interrupt.

    Where the fit breaks down, the quieter part of the decays is identified, and that is noted.
    """
    only, trouble = "Regressions alone, without functions and bands", ""
    # What overflows on the way is no news: a fit that ends in such numbers is told.
    with bar(None, "identifying") as steps, np.errstate(all="ignore"):
        say: Callable[[str], None] = steps.set_postfix_str
        for share in _QUIETER:
            decays = [d for d in (_below(f, share) for f in free) if d is not None]
            if not decays:
                break
            try:
                found: Identification = asked.fit(decays, 1, say)
            except (TrajectoryError, ArithmeticError, np.linalg.LinAlgError) as error:
                trouble = trouble or _in_words(error)
            except KeyboardInterrupt:
                return None, f"{only}: interrupted.", True
            else:
                if not trouble:
                    return found, "", False
                note = (
                    f"of the whole decay there is no fit ({trouble}); identified is the part below"
                    f" {100 * share:.0f} % of its largest amplitude"
                )
                return replace(found, notes=(note, *found.notes)), "", False
    return None, f"{only}: {trouble}.", False


def _in_words(error: Exception) -> str:
    if isinstance(error, TrajectoryError):
        return str(error)
    return (
        "numbers of the fit grew beyond all bounds, as no equation of one coordinate follows the"
        f" motion ({error})"
    )


def _below(decay: Decay, share: float) -> Decay | None:
    """The decay from where its amplitude has fallen to a share; None where few cycles are left."""
    if share == 1:
        return decay
    backbone = extract_backbone(decay)
    left = np.flatnonzero(backbone.amplitude <= share * backbone.amplitude.max())
    if len(left) < LEAST_CYCLES:
        return None
    return decay.between(start=float(backbone.t[left[0]]))


def _beside(four: Mapping[str, Judged], fixed: bool) -> list[Judged]:
    """Regressions to be held against an identification, where there are any."""
    if not four:
        return []
    suffix = ", omega fixed" if fixed else ""
    names = ("IC-ROM", "stiffness")
    return [replace(four[name + suffix], name=f"plain {name}") for name in names]


def _used(
    decays: Sequence[Decay], amplitude: tuple[float, float] | None
) -> tuple[list[Decay], list[Backbone]]:
    """The free decays, or their cycles with these amplitudes, and their backbones."""
    with bar(None, "reading the cycles"):
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
