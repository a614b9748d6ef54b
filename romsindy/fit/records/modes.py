"""The linear modes that channels show under measured inputs, and the motion behind the channels.

A mode answers an input as an oscillator does. Given frequencies and damping ratios, what every
channel shows of every mode is a linear least-squares problem; they are such that the misfit of that
is least (variable projection [1]). Beside the measured inputs unknown forces of equal power at all
frequencies act on the modes: those that explain the channels best give the motion (N. Wiener's
filter). It tells channels apart into coordinates, however many there are of either.

[1] G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, lfilter, ss2tf

from romsindy.fit.kernel.collocation import Grid, Trajectory
from romsindy.fit.records.smooth import deviance, finer, on_grid, reflected
from romsindy.fit.verdict import MODE, WORTH
from romsindy.physics.equations import Equations
from romsindy.physics.input import Input
from romsindy.record.forced import ForcedVibration
from romsindy.record.ringing import require_channels
from romsindy.typing import Array

# Damping ratio from which modes are looked for, and its limits; how far their frequencies may move.
_RATIO, _LEAST, _MOST, _MOVES = 0.01, 1e-4, 0.5, 1.5
# Frequencies at which a mode is looked for: so far apart, with so many cycles in a record at least,
# and samples in a cycle.
_APART, _CYCLES, _SAMPLES = 0.005, 4.0, 3.0
_BESIDE = 0.05  # from a mode, whose frequency laws that a model lacks may move, to a further one
_HEARD = 1e-3  # of the largest answer of the modes to forces of one power


class Modes(NamedTuple):
    """Linear modes of R coordinates in c channels.

    ``omega`` (R,) in rad/s, ``ratios`` (R,) of damping, ``shapes`` (c, R), which are 1 in the
    channel that a mode moves most, ``gains`` (R,) of every input by its name, and ``left`` (n, c),
    what they leave of all channels, over the rms of each.
    """

    omega: Array
    ratios: Array
    shapes: Array
    gains: dict[str, Array]
    left: Array

    def ordered(self) -> Modes:
        """By frequency."""
        order = np.argsort(self.omega)
        gains = {name: gain[order] for name, gain in self.gains.items()}
        omega, ratios, shapes = self.omega[order], self.ratios[order], self.shapes[:, order]
        return Modes(omega, ratios, shapes, gains, self.left)

    @property
    def main(self) -> list[int]:
        """The channel of each coordinate whose reading says how large it is."""
        return [int(i) for i in np.argmax(self.shapes == 1.0, axis=0)]


def modes_in(model: Equations, shapes: Array) -> Modes:
    """The small vibrations of a model with its inputs, in channels of known shapes."""
    omega, modes = model.linear_modes
    order = np.argsort(np.argmax(np.abs(modes), axis=0))
    gains: dict[str, Array] = {}
    for term, gain in model.pushes:
        gains[term.source] = gains.get(term.source, 0.0) + np.asarray(gain)
    return Modes(omega[order], model.linear_damping_ratios[order], shapes, gains, np.zeros((0, 1)))


def modes_of(vibrations: Sequence[ForcedVibration], count: int | str) -> Modes:
    """So many modes, or "auto": each is where one more explains most of what others leave.

    Raises a ValueError if the inputs move fewer, or for another count.
    """
    whole = isinstance(count, int) and not isinstance(count, bool) and count >= 1
    if not whole and count != "auto":
        raise ValueError(f"coordinates = {count!r}: give 'auto' or a whole number of at least 1")
    require_channels(vibrations, vibrations[0].n_channels)
    modes = modes_near(vibrations, np.array([_loudest(vibrations, None)]))
    while not whole or len(modes.omega) < count:  # type: ignore[operator]
        more = modes_near(vibrations, np.append(modes.omega, _loudest(vibrations, modes)))
        if not _needed(modes, more, sure=not whole):
            if not whole:
                break
            hertz = ", ".join(f"{w / (2 * np.pi):.4g} Hz" for w in np.sort(modes.omega))
            raise ValueError(
                f"coordinates = {count}, but what the inputs move in the record is {hertz}: ask for"
                " as many at most, or drive and measure where others move"
            )
        modes = more
    return modes.ordered()


def mode_beside(
    rest: Sequence[ForcedVibration], own: float | None = None
) -> tuple[float, float] | None:
    """A further mode that the inputs move in records, or in what a model of one mode leaves.

    ``own`` is the angular frequency of the model, whose linear motion may be off; without a model
    that of the loudest mode. Returns that of the other, rad/s, and the part that it explains of the
    power that one leaves; None where it does not bring the rms down by half: less is the form of a
    law.
    """
    own = own or _loudest(rest, None)
    first = modes_near(rest, np.array([own]))
    both = modes_near(rest, np.append(first.omega, _loudest(rest, first)))
    near, other = np.argsort(np.abs(np.log(both.omega / own)))
    alone = _split(rest, both.omega[[near]], both.ratios[[near]])[1] / _scale(rest)
    found, part = float(both.omega[other]), 1 - float(np.sum(both.left**2) / np.sum(alone**2))
    apart = (
        _apart(both._replace(omega=np.array([own, found]))) and abs(np.log(found / own)) > _BESIDE
    )
    return (found, part) if part > 1 - WORTH**-2 and apart else None


def _apart(modes: Modes) -> bool:
    """Whether no two are closer than their bandwidth: then they are one, of nonlinear stiffness."""
    order = np.argsort(modes.omega)
    omega, width = modes.omega[order], (modes.omega * modes.ratios)[order]
    return bool(np.all(np.diff(omega) > width[1:] + width[:-1]))


def _needed(before: Modes, more: Modes, sure: bool) -> bool:
    """Whether a mode more explains more than chance, or, to be ``sure``, a tenth of what is left.

    For that, what other than linear modes leave is noise of a colour.
    """
    n = before.left.size
    if not _apart(more):
        return False
    if sure:
        gain = deviance(list(before.left.T)) - deviance(list(more.left.T))
        return bool(gain > -n * np.log(1 - MODE))
    values = 2 + len(more.shapes) * len(more.gains)
    return bool(n * np.log(np.mean(before.left**2) / np.mean(more.left**2)) > values * np.log(n))


def modes_near(
    vibrations: Sequence[ForcedVibration], omega: Array, ratios: Array | None = None
) -> Modes:
    """The modes near some angular frequencies, and damping ratios where they are known."""
    r, scale = len(omega), _scale(vibrations)
    ratios = np.full(r, _RATIO) if ratios is None else np.clip(ratios, 2 * _LEAST, _MOST / 2)
    low = np.log(np.concatenate([omega / _MOVES, np.full(r, _LEAST)]))
    high = np.log(np.concatenate([omega * _MOVES, np.full(r, _MOST)]))

    def misfit(x: Array) -> Array:
        return np.asarray((_split(vibrations, *np.exp(x).reshape(2, r))[1] / scale).ravel())

    start = np.log(np.concatenate([omega, ratios]))
    near = least_squares(misfit, start, bounds=(low, high), x_scale=np.repeat([0.01, 1.0], r))
    omega, ratios = np.exp(near.x).reshape(2, r)
    shown, left = _split(vibrations, omega, ratios)
    names = _names(vibrations)
    shapes, gains = np.empty((len(scale), r)), np.empty((len(names), r))
    for j, table in enumerate(shown.reshape(r, len(names), -1)):
        by_input, sizes, by_channel = np.linalg.svd(table, full_matrices=False)
        main = by_channel[0, np.argmax(np.abs(by_channel[0]))]
        shapes[:, j], gains[:, j] = by_channel[0] / main, sizes[0] * by_input[:, 0] * main
    return Modes(omega, ratios, shapes, dict(zip(names, gains, strict=True)), left / scale)


def motion_behind(v: ForcedVibration, modes: Modes, std: Array, grid: Grid) -> Trajectory:
    """Displacements of the coordinates on some steps, by channels with noise (c,)."""
    omega, ratios, shapes, gains, _ = modes
    size = np.stack([gains[name] for name in v.names])  # (I, R)
    by_input = [_answers(v, omega, ratios, d) for d in (0, v.derivative)]  # (n, R, I)
    q, driven = (np.einsum("nri,ir->nr", x, size) for x in by_input)
    missed = channels_of(v) - driven @ shapes.T
    lines, w = reflected(missed), np.pi / v.dt * np.linspace(0, 1, len(missed))
    compliance = 1 / ((omega**2 - w[:, None] ** 2) ** 2 + (2 * ratios * omega * w[:, None]) ** 2)
    seen = shapes * ((1j * w) ** v.derivative)[:, None, None]  # (n, c, R): modes to channels
    back = compliance[:, :, None] * seen.conj().swapaxes(1, 2)
    spread, noise = seen @ back, 2 * len(missed) * std**2
    # Their power is the usual one where the modes answer.
    unit = np.trace(spread, axis1=1, axis2=2).real
    heard = unit > _HEARD * unit.max()
    level = float(np.median(np.sum(np.abs(lines[heard]) ** 2, axis=1) / unit[heard]))
    explained = back @ np.linalg.inv(spread + np.diag(noise / level))
    rest = (explained @ lines[..., None])[..., 0]
    ends = [q[i] + explained[0].real @ missed[i] for i in (0, -1)]
    return on_grid(finer(reflected(q) + rest, *ends), v.dt, grid)


def channels_of(v: ForcedVibration) -> Array:
    """What was measured about its mean, (n, c)."""
    y = v.y.reshape(len(v.t), -1)
    return y - y.mean(axis=0)


def _names(vibrations: Sequence[ForcedVibration]) -> list[str]:
    return list(dict.fromkeys(name for v in vibrations for name in v.names))


def _scale(vibrations: Sequence[ForcedVibration]) -> Array:
    return np.sqrt(np.mean(np.concatenate([channels_of(v) for v in vibrations]) ** 2, axis=0))


def _answers(v: ForcedVibration, omega: Array, ratios: Array, derivative: int) -> Array:
    """What oscillators of unit gain do under each input from rest, (n, R, I), differentiated."""
    found = np.empty((len(v.t), len(omega), len(v.names)))
    for j, (w, zeta) in enumerate(zip(omega, ratios, strict=True)):
        rates = np.array([[0.0, 1.0], [-(w**2), -2 * zeta * w]])
        rows = (np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]]), rates[1:])[derivative]
        system = (rates, np.array([[0.0], [1.0]]), rows, np.full((1, 1), float(derivative == 2)))
        above, below = ss2tf(*cont2discrete(system, v.dt, "foh")[:4])
        for i, (name, u) in enumerate(zip(v.names, v.u.T, strict=True)):
            found[:, j, i] = lfilter(above[0], below, Input(name).sign * u)
    return found


def _split(
    vibrations: Sequence[ForcedVibration], omega: Array, ratios: Array
) -> tuple[Array, Array]:
    """What channels show of each mode by each input, (R I, c), and what is left of them, (n, c).

    Free vibrations, and the mean, are fitted to every record beside.
    """
    names, tables, channels = _names(vibrations), [], []
    for v in vibrations:
        driven = np.zeros((len(v.t), len(omega), len(names)))
        driven[..., [names.index(name) for name in v.names]] = _answers(
            v, omega, ratios, v.derivative
        )
        late = (v.t - v.t[0])[:, None] * omega
        fading = np.exp((1j * np.sqrt(1 - ratios**2) - ratios) * late)
        free = np.concatenate([fading.real, fading.imag, np.ones((len(v.t), 1))], axis=1)
        basis = np.linalg.qr(free)[0]
        table = driven.reshape(len(v.t), -1)
        tables.append(table - basis @ (basis.T @ table))
        y = channels_of(v)
        channels.append(y - basis @ (basis.T @ y))
    table, y = np.concatenate(tables), np.concatenate(channels)
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    shown = np.linalg.lstsq(table / size, y, rcond=None)[0] / size[:, None]
    return shown, y - table @ shown


def _loudest(vibrations: Sequence[ForcedVibration], modes: Modes | None) -> float:
    """Where one mode more would explain most of what is left, rad/s."""
    longest = max(float(v.t[-1] - v.t[0]) for v in vibrations)
    low, high = _CYCLES / longest, 1 / _SAMPLES / min(v.dt for v in vibrations)
    omega = 2 * np.pi * np.geomspace(low, high, int(np.log(high / low) / _APART))
    gain, at, scale = np.zeros(len(omega)), 0, _scale(vibrations)
    left = np.concatenate([channels_of(v) for v in vibrations])
    if modes is not None:
        left = _split(vibrations, modes.omega, modes.ratios)[1]
    for v in vibrations:
        n, window = len(v.t), np.hanning(len(v.t))[:, None]
        w = 2 * np.pi * np.fft.rfftfreq(n, v.dt)
        missed = np.fft.rfft(window * left[at : at + n] / scale, axis=0)
        inputs = np.fft.rfft(window * (v.u - v.u.mean(axis=0)), axis=0)
        gain += [_explained(x, w, v.derivative, inputs, missed) for x in omega]
        at += n
    return float(omega[np.argmax(gain)])


def _explained(
    omega: float,
    w: Array,
    derivative: int,
    inputs: NDArray[np.complex128],
    missed: NDArray[np.complex128],
) -> float:
    """Power of spectra (n, c) that a mode of this frequency under the inputs (n, I) explains."""
    answer = (1j * w) ** derivative / (omega**2 - w**2 + 2j * _RATIO * omega * w)
    basis = np.linalg.qr(answer[:, None] * inputs)[0]
    return float(np.sum(np.abs(basis.conj().T @ missed) ** 2))
