"""What was identified from which records, and its numbers in tables: for pages and commands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from romsindy.fit.functions.identification import Identification
from romsindy.fit.kernel.prepared import part_of
from romsindy.fit.results.estimate import Band, Estimate
from romsindy.fit.results.fitted import Fit, HeldOut, SmallVibration, small_vibrations
from romsindy.fit.results.forced_band import ForcedBand
from romsindy.fit.steady.fit import SteadyFit
from romsindy.orbits.continuation import ContinuationError
from romsindy.orbits.curves import BackboneCurve, backbone_curve
from romsindy.physics.equations import Equations, inputs_of
from romsindy.physics.input import input_in
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.regression.judged import Beside
from romsindy.show.compared import Compared, channels_of
from romsindy.text import TextTable, left_over, quantity, with_error
from romsindy.typing import Array, Indices

_LOW, _CURVE = 0.02, 40  # of the largest amplitude, where a backbone begins; points of it
_LEVEL = 0.02  # part of the force by which those of one level differ at most
_MOST = 6  # levels whose curves are told apart


@dataclass(frozen=True, eq=False)
class Identified:
    """What was identified, as its page and the command line need it."""

    title: str
    # Whole, as it was analysed; nothing where that was a table
    measured: Sequence[Decay | ForcedVibration] = ()
    # None where regressions alone were asked for, or nothing else was possible
    found: Estimate | None = None
    beside: Beside | None = None  # models held against the cycles of the decays
    channels: Sequence[str] = ()  # names of what was measured, where there are several
    held_out: HeldOut | None = None  # the rest of the record, where some of it was held out
    picked: str = ""  # what was used of the record, and what was left out
    trouble: str = ""  # why nothing else was possible
    interrupted: bool = False  # whether the user wished to stop before the end

    @property
    def model(self) -> Equations:
        """Whose equation is printed."""
        if self.beside is not None:
            return self.beside.main.model
        assert self.found is not None  # or there is a comparison
        return self.found.model

    # -- what there is --------------------------------------------------------------------------

    @property
    def series(self) -> Identification | None:
        """Where whole functions were identified."""
        return self.found if isinstance(self.found, Identification) else None

    @property
    def fit(self) -> Fit | None:
        """Where terms were fitted to records."""
        return self.found if isinstance(self.found, Fit) else None

    @property
    def steady(self) -> SteadyFit | None:
        """Where they were fitted to steady states."""
        return self.found if isinstance(self.found, SteadyFit) else None

    @property
    def force_unit(self) -> str | None:
        """Of the excitation of steady states."""
        return None if self.steady is None else self.steady.test.unit

    @cached_property
    def modes(self) -> tuple[SmallVibration, ...]:
        """Of several coordinates."""
        if self.fit is None or not self.model.numbered:
            return ()
        return small_vibrations(self.fit, self.fit.records)

    @cached_property
    def backbones(self) -> dict[int, BackboneCurve | str]:
        """The backbone of each mode, by its number; or why it has none, in a sentence."""
        return {mode.number: self._backbone(mode) for mode in self.modes}

    def _backbone(self, mode: SmallVibration) -> BackboneCurve | str:
        high = float(mode.measured_amplitude.max())
        try:
            return backbone_curve(self.model.undamped(), (_LOW * high, high), mode=mode.number)
        except (ValueError, ContinuationError) as error:
            return f"no backbone: {error}"

    @cached_property
    def band(self) -> Band | None:
        """Backbone and damping ratio up to the largest displacement, where no cycles show them."""
        if self.fit is None or self.beside is not None:
            return None
        if self.model.numbered or self.model.memories:
            return None
        peak = max(record.peak for record in self.fit.records)
        return self.fit.band(np.linspace(_LOW * peak, peak, _CURVE))

    @cached_property
    def levels(self) -> Mapping[float, ForcedBand | str]:
        """The response to each level of force, with its band; or why there is none."""
        found: dict[float, ForcedBand | str] = {}
        if self.steady is None:
            return found
        points = self.steady.points
        for force, mine in levels_of(self.steady):
            size, w = np.abs(points.force[mine]), points.frequency[mine]
            if np.ptp(size) > _LEVEL * size.max() or np.ptp(w) == 0:
                continue
            try:
                found[force] = self.steady.forced_response(force, (w.min(), w.max()))
            except (ValueError, ContinuationError) as error:
                found[force] = str(error)
        return found if len(found) <= _MOST else {}

    # -- what simulations leave -------------------------------------------------------------------

    @property
    def piece(self) -> float:
        """Cycles in each piece where a driven record was followed in pieces, or 0."""
        return float(getattr(self.found and self.found.verdict, "piece", 0.0))

    @cached_property
    def compared(self) -> Sequence[tuple[Any, Array]]:
        """Records of the fit with their residuals, in the measured quantity."""
        found = self.series or self.fit
        return [] if found is None else [*zip(found.records, found.residuals, strict=True)]

    @cached_property
    def left(self) -> list[float]:
        """What one simulation leaves of each record, over the noise, rms."""
        return [float(np.sqrt(np.mean(r.whitened(x) ** 2))) for r, x in self.compared]

    @cached_property
    def followed(self) -> list[Compared]:
        """Channels of the record of which most is left, or of all that inputs drive.

        Nothing where the equation has no motion that long.
        """
        if not self.compared or not all(np.isfinite(x).all() for _, x in self.compared):
            return []
        driven = [pair for pair in self.compared if pair[0].driven]
        return channels_of(driven or [self.compared[int(np.argmax(self.left))]])

    def what_is_left(self) -> str:
        """Of which record one simulation leaves how much, as a part of a sentence."""
        if self.piece:
            return (
                f"what the equation leaves of pieces of {self.piece:.0f} cycles, each from its own"
                " state"
            )
        if inputs_of(self.model):
            return (
                "what one simulation of the equation leaves of the record from its start to its end"
            )
        worst = int(np.argmax(self.left))
        record, left = self.compared[worst]
        what = "piece" if any(r.since > 0 for r, _ in self.compared) else "decay"
        several = f" ({what} {worst + 1}, the worst of {len(self.left)})"
        return (
            f"what one simulation of the equation leaves of the {what} from its start to its end,"
            f" {left_over(part_of([record], [left]), self.left[worst])}"
            f"{several if len(self.left) > 1 else ''}"
        )

    def inputs(self) -> dict[str, dict[str, Any]]:
        """What each input does: how strongly, how late, and what between its samples.

        Of several coordinates by its name and the coordinate: "force [q1]".
        """
        if self.fit is None:
            return {}
        dt, errors = self.measured[0].dt, self.fit.standard_errors
        pairs = [(t, law) for t in self.model.terms if (law := input_in(t)) is not None]
        return {
            law.signal + term.key.removeprefix(law.key): {
                "gain": self.model.coefficients[term.key],
                "gain_std": errors[term.key],
                "gain_unit": term.unit(self.model.unit),
                "delay": delay,
                "delay_std": error,
                "delay_in_samples": delay / dt,
                "unit": law.input_unit,
                "interpolation": law.interpolation,
            }
            for term, law in pairs
            for delay, error in [self.fit.delays[law.signal]]
        }

    # -- words ------------------------------------------------------------------------------------

    def equations(self) -> list[str]:
        """The equation that is printed, a line for each coordinate."""
        lines = f"{self.model.equation()}    (q in {self.model.unit or '[q]'}, t in s)"
        return lines.splitlines()

    def findings(self, alone: bool = False) -> list[str]:
        """The verdict, how well what was held out is predicted, how models follow the backbone.

        ``alone`` says the last of the identified one only, where there is one.
        """
        found = [] if self.found is None else [str(self.found.verdict)]
        found += [str(self.held_out)] if self.held_out is not None else []
        if self.beside is not None:
            one = alone and self.found is not None
            words = self.beside.missed() if one else self.beside.errors()
            found.append(f"{self.trouble} {words}".strip())
        return found

    def remarks(self) -> list[str]:
        """What the reader must know of the result, as sentences."""
        if self.series is not None:
            return self.series.conclusions()[1:]
        return [] if self.found is None else self.found.remarks()

    def notes(self) -> list[str]:
        """What was measured, and what was done to it; what holds for several of them once."""
        lines = [
            line for r in self.measured for line in (repr(r).splitlines()[0].strip("<>"), *r.notes)
        ]
        return [*dict.fromkeys(lines), *self._points()]

    def _points(self) -> Iterator[str]:
        """Which steady states were measured, and of which levels there is no curve."""
        if self.steady is None:
            return
        points, unit = self.steady.points, self.force_unit or "its unit"
        w, size = points.frequency / (2 * np.pi), np.abs(points.force)
        yield (
            f"{len(points)} steady states, {points.measured} under {size.min():.4g} to"
            f" {size.max():.4g} {unit}, {w.min():.5g} to {w.max():.5g} Hz"
        )
        for force, why in self.levels.items():
            if isinstance(why, str):
                yield f"no curve at {force:.4g} {unit}: {why}"


def levels_of(fit: SteadyFit) -> Iterator[tuple[float, Indices]]:
    """Mean amplitude of the excitation of each level, and which of the points are of it."""
    level, size = fit.points.level, np.abs(fit.points.force)
    for number in range(int(level.max()) + 1):
        mine = np.flatnonzero(level == number)
        yield float(size[mine].mean()), mine


def coefficients(result: Identified) -> TextTable:
    """Every coefficient that was found, with its error."""
    assert result.found is not None
    if result.series is not None:
        return result.series.coefficients()
    note = "Standard errors hold for these terms: what the choice of terms leaves open is more."
    return TextTable("Coefficients", result.found.table(), "" if result.steady else note)


def tables(result: Identified) -> list[TextTable]:
    """All of them, coefficients first."""
    if result.series is not None:
        return [*result.series.tables(), *more_tables(result)]
    return [*([coefficients(result)] if result.found else []), *more_tables(result)]


def more_tables(result: Identified) -> Iterator[TextTable]:
    """Those that the result itself does not print."""
    if result.beside is not None:
        yield result.beside.table()
    yield from few_tables(result)
    if result.modes:
        yield _shapes(result)
    if result.inputs():
        yield _inputs(result)


def few_tables(result: Identified) -> Iterator[TextTable]:
    """Those without which there is no answer."""
    if result.modes:
        yield _modes(result)
    if result.steady is not None:
        yield _excitation(result.steady)


def _modes(result: Identified) -> TextTable:
    """Modes of small vibrations."""
    header = ["mode", "frequency [Hz]", "+-", "damping ratio [%]", "+-", "moves", "amplitude"]
    note = (
        "Frequency and damping ratio are those of small vibrations, given these terms."
        " Amplitudes are those of the coordinate that moves most, in all records."
    )
    unit = result.model.unit or "[q]"
    return TextTable("Modes", [header, *(_mode(m, unit) for m in result.modes)], note)


def _mode(mode: SmallVibration, unit: str) -> list[str]:
    ends = (float(mode.measured_amplitude.max()), float(mode.measured_amplitude.min()))
    return [
        str(mode.number),
        *with_error(mode.frequency, mode.frequency_std),
        *with_error(100 * mode.damping_ratio, 100 * mode.damping_ratio_std),
        f"q{mode.coordinate}",
        " to ".join(dict.fromkeys(quantity(a, unit) for a in ends)),
    ]


def _shapes(result: Identified) -> TextTable:
    """What channels show of the coordinates."""
    assert result.fit is not None
    curved = result.fit.curved_shapes
    columns = np.column_stack([result.fit.mode_shapes, *curved.values()])
    rows = [
        [name, *(f"{x:.4g}" for x in row)]
        for name, row in zip(result.channels, columns, strict=True)
    ]
    header = ["channel", *result.model.coordinates, *curved]
    power = f"; and of their products, per power of {result.model.unit or '[q]'}"
    note = (
        "What each channel shows of each coordinate: 1 where that moves it most"
        f"{power if curved else ''}."
    )
    return TextTable("Mode shapes", [header, *rows], note)


def _inputs(result: Identified) -> TextTable:
    header = ["input", "gain", "+-", "unit", "delay [s]", "+-", "delay [samples]", "+-"]
    dt = result.measured[0].dt
    rows = [
        [
            name,
            *with_error(of["gain"], of["gain_std"]),
            of["gain_unit"],
            *(f"{of['delay']:.4g}", f"{of['delay_std']:.2g}"),
            *(f"{of['delay_in_samples']:.4g}", f"{of['delay_std'] / dt:.2g}"),
            of["interpolation"],
        ]
        for name, of in result.inputs().items()
    ]
    note = (
        "The gain of a base is its participation factor. By its delay an input acts later than"
        " it was measured."
    )
    return TextTable("Inputs", [[*header, "between samples"], *rows], note)


def _excitation(steady: SteadyFit) -> TextTable:
    """From the excitation, as measured, to a force per unit mass."""
    errors = steady.chain_errors
    rows = [
        [name, *(with_error(value, errors[name]) if name in errors else [f"{value:.5g}", "-"])]
        for name, value in vars(steady.chain).items()
    ]
    note = "Force per unit mass: (gain + slope |F|) exp(i phase) F, with F as measured."
    return TextTable("The excitation", [["", "value", "+-"], *rows], note)
