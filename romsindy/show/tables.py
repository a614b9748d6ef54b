"""Tables of what was identified, as its page shows and the command line prints them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from romsindy.fit.results.vibrations import SmallVibration
from romsindy.fit.steady.fit import SteadyFit
from romsindy.show.identified import Identified
from romsindy.text import TextTable, quantity, with_error


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
