"""Cycles of measured decays, and curves of models beside them, as figures hold them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from romsindy.fit.estimate import Band, Estimate
from romsindy.fit.fitted import Fit
from romsindy.fit.record import Prepared, one_a_decay
from romsindy.orbits.curves import linear_mode
from romsindy.physics.coupled import AnyModel
from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.show.axes import Fact, with_unit
from romsindy.typing import Array

Models = Mapping[str, AnyModel | Estimate | Band]
# Amplitudes, curve, its band if any, and its look.
Curve = tuple[Array, Array, tuple[Array, Array] | None, dict[str, Any]]


def of_cycles(b: Backbone, decay: int | None = None) -> list[Fact]:
    """Number, time, amplitude, frequency and damping ratio of every cycle of a decay.

    The decay has a number itself where there are several.
    """
    return [
        *([] if decay is None else [Fact("decay", np.full(len(b), float(decay)))]),
        Fact("cycle", np.arange(1.0, len(b) + 1)),
        Fact("time (s)", b.t),
        Fact(with_unit("amplitude", b.unit), b.amplitude, b.amplitude_std),
        Fact("frequency (Hz)", b.frequency / (2 * np.pi), b.frequency_std / (2 * np.pi)),
        Fact("damping ratio (%)", 100 * b.damping_ratio, 100 * b.damping_ratio_std, 4),
    ]


def backbones_of(
    measured: Backbone | Sequence[Backbone] | Fit, models: Models | None, mode: int = 1
) -> tuple[Sequence[Backbone], Models | None]:
    """What was measured, a backbone for each decay, and the models beside it.

    Of a fit of several coordinates, the backbones are those of the tone of a mode.

    Raises
    ------
    ValueError
        If there are no cycles in it, or no such mode.
    """
    if isinstance(measured, Backbone):
        return [measured], models
    if measured and isinstance(measured, (list, tuple)):
        return measured, models
    if not isinstance(measured, Fit):
        raise ValueError(
            f"measured = {measured!r} holds no cycles: give a Backbone, and it among the models"
        )
    name = "fitted model"
    if measured.model.numbered:
        name += f", mode {mode} alone"
        coordinate = int(np.argmax(np.abs(linear_mode(measured.model.undamped(), mode)[1])))
        found = [_of_tone(r, coordinate) for r in one_a_decay(measured.records)]
    else:
        found = [extract_backbone(d) for d in measured.decays]
    return found, models or {name: measured}


def points_of(measured: Backbone | Sequence[Backbone] | Fit, mode: int) -> dict[str, Any]:
    """How the cycles of a measured decay look in every figure, and what they are called."""
    look: dict[str, Any] = {"fmt": "o", "ms": 3, "lw": 0.7, "color": "0.25", "mfc": "white"}
    several = isinstance(measured, Fit) and measured.model.n_coordinates > 1
    label = f"mode {mode} while others ring" if several else "cycles of the decay"
    return look | {"label": label, "zorder": 1}


def _of_tone(record: Prepared, coordinate: int) -> Backbone:
    """The tone of a coordinate at the windows where it was followed; its errors are not known."""
    tone = record.tones[coordinate]
    omega = 2 * np.pi * tone.frequency
    amplitude, unknown = tone.amplitude / omega**record.derivative, np.full(len(omega), np.nan)
    fall = -np.gradient(np.log(amplitude), tone.t)
    return Backbone(
        t=tone.t,
        amplitude=amplitude,
        frequency=omega,
        damping_ratio=fall / np.hypot(fall, omega),
        positive_peak=amplitude,
        negative_peak=-amplitude,
        amplitude_std=unknown,
        frequency_std=unknown,
        damping_ratio_std=unknown,
        unit=record.decay.unit,
    )


def numbered(backbones: Sequence[Backbone]) -> Iterator[tuple[int | None, Backbone]]:
    """Backbones with the numbers of their decays, where there are several."""
    for i, backbone in enumerate(backbones, 1):
        yield (i if len(backbones) > 1 else None), backbone


def misses(amplitude: Array, measured: Array, curves: Sequence[Curve]) -> Iterator[Fact]:
    """How far curves are off what was measured of cycles at their amplitudes."""
    for amplitudes, middle, _, style in curves:
        order = np.argsort(amplitudes)
        said = np.interp(amplitude, amplitudes[order], middle[order], np.nan, np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):  # of no damping, nothing is a part
            off = 100 * (said / measured - 1)
        yield Fact(f"{style['label']} off by (%)", off, digits=3)


def span_of(backbones: Sequence[Backbone]) -> Array:
    """Amplitudes from the least to the largest of cycles, (200,)."""
    amplitudes = np.concatenate([b.amplitude for b in backbones])
    return np.linspace(amplitudes.min(), amplitudes.max(), 200)
