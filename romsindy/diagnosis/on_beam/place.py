"""Where on a beam a force or a mass acts, from what the higher modes do of it.

Along the curve of the first mode an effect at any point can do the same work: the first coordinate
tells what acts, and not where. The higher modes are moved by phi_m(a) times the force, so that the
sensors, beside the first mode, do tell. The beam is simulated with the effect at some points a, as
strong as the first coordinate asks for there; between them the readings are splines over a. With
the gains of the sensors marginalised, their misfit is a likelihood of a.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import null_space

from romsindy.beam.beam import Beam
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.mounted import MountedEffect
from romsindy.diagnosis.on_beam.parameters import ParameterEffect, points
from romsindy.effects.base import State
from romsindy.effects.mounting import AtPoint, PointMass
from romsindy.fit.kernel.linear_response import sampled
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.fit.verdict import PLACE, PLACE_RISE
from romsindy.typing import Array

_FINE = 301
_GAINS = 2e-3  # standard deviation of the gain of a sensor, by calibration and place
_FREQUENCY = 2e-4  # relative standard deviation of the frequency of a higher mode, at the least
_DAMPING = 0.2  # the same of its damping


@dataclass(frozen=True, eq=False)
class Latitude:
    """What sensors and higher modes may do beside what is simulated: standard deviations."""

    gains: Array  # (n_sensors,), relative, of the sensors
    frequencies: Array  # (n_modes,), relative, of the modes above the first that are told apart
    rates: Array  # (n_modes,), of their damping, 1/s

    @property
    def spreads(self) -> Array:
        """All, as the columns that they belong to."""
        pairs = np.stack([self.frequencies, self.rates], axis=1).ravel()
        return np.concatenate([self.gains, pairs])

    @classmethod
    def of(cls, seen: InstrumentedBeam, doubtful: Sequence[Beam], gains: Array) -> Latitude:
        """Latitude of a beam, given what it would be if each doubtful parameter were another."""
        count = seen.shapes.shape[1]
        omega = seen.basis.omega[:count]
        shifts = [b.modes(count=count).omega / omega - 1 for b in doubtful]
        spread = np.sqrt(_FREQUENCY**2 + sum(x**2 for x in shifts))
        rates = _DAMPING * (seen.beam.alpha + seen.beam.eta * omega**2) / 2
        return cls(np.hypot(_GAINS, gains), (spread * np.ones(count))[1:], rates[1:])


@dataclass(frozen=True)
class PlaceOnBeam:
    """Where an effect acts, m.

    Attributes
    ----------
    at : float
        The likeliest point.
    low, high : float
        Three standard errors to either side.
    length : float
        Of the beam.
    """

    at: float
    low: float
    high: float
    length: float

    @property
    def told(self) -> bool:
        """Whether the data can tell where."""
        return self.high - self.low < PLACE * self.length

    def untold(self) -> PlaceOnBeam:
        """The same, where nothing else supports it."""
        return replace(self, low=0.0, high=self.length)

    def __str__(self) -> str:
        if not self.told:
            return "these data cannot tell where on the beam it acts"
        return f"it acts at {self.at:.3g} m ({self.low:.3g} to {self.high:.3g} m)"


def can_be_anywhere(part: Part) -> bool:
    """Whether an effect acts at one point, which was not given."""
    effect = part.effect
    if isinstance(effect, MountedEffect):
        usual = effect.effect.mounting
        return isinstance(usual, AtPoint) and usual.at is None
    return isinstance(effect, ParameterEffect) and effect.change is PointMass


def place_now(seen: InstrumentedBeam, part: Part) -> float:
    """Where an effect that can be anywhere is taken to act, m."""
    effect = part.effect
    at = effect.mounting.at if isinstance(effect, MountedEffect) else effect.at  # type: ignore[attr-defined]
    return seen.beam.length if at is None else float(at)


def moved_to(seen: InstrumentedBeam, part: Part, at: float, record: Record) -> Part:
    """An effect elsewhere, where it does the same to the first mode in a record."""
    effect, strength = part.effect, float(part.strengths[0, 0])
    if isinstance(effect, ParameterEffect):
        squared = (_lift(seen, effect.at) / _lift(seen, at)) ** 2
        weights = tuple(w / squared for w in effect.direction.weights)
        there = replace(effect, at=at, direction=replace(effect.direction, weights=weights))
        return replace(part, effect=there, strengths=part.strengths * squared)
    effect = cast(MountedEffect, effect)
    mounting = cast(AtPoint, effect.mounting)
    ratio = _lift(seen, at) / _lift(seen, mounting.at)
    metres = {p.name: effect.value(p.name) * ratio for p in part.parameters if p.unit == "m"}
    other = replace(effect.shaped(metres), mounting=replace(mounting, at=at))
    q, q_dot, q_ddot = (sampled(record.motion, k)[:, 0] for k in range(3))
    state = State(record.t, q, q_dot, q_ddot, record.motion.grid.step)
    here, elsewhere = effect.forces(state)[0], other.forces(state)[0]
    share = strength * float(here @ elsewhere) / float(elsewhere @ elsewhere)
    return replace(part, effect=other, strengths=np.array([[share]]))


def _lift(seen: InstrumentedBeam, at: float | None) -> float:
    """Transverse size of the first mode at a point."""
    return float(np.vdot(seen.beam.point_load((0.0, 1.0), at=at), seen.basis.shape(1)))


def find_place(
    seen: InstrumentedBeam,
    records: Sequence[Record],
    measured: Sequence[Array],
    simulated: Sequence[Sequence[Array]],
    slack: Latitude,
) -> PlaceOnBeam:
    """Where an effect acts.

    The noise of the records, of the coordinate, is that of the sensors. What these read in each is
    ``measured``, (n, n_sensors), and ``simulated`` the same for the effect at each of the `points`.
    """
    at = np.array(points(seen.beam))
    m, spreads = 1 + len(at), slack.spreads
    gram = np.zeros((m + len(spreads),) * 2)
    samples = 0
    for record, y, readings in zip(records, measured, simulated, strict=True):
        table = _table(seen, record, y, readings)
        gram += table.T @ table
        samples += len(table)
    known, cross = gram[m:, m:] + np.diag(1 / spreads**2), gram[m:, :m]
    left = gram[:m, :m] - cross.T @ np.linalg.solve(known, cross)
    fine = np.linspace(at[0], at[-1], _FINE)
    v = np.column_stack([np.ones(_FINE), -CubicSpline(at, np.eye(len(at)))(fine)])
    chi_squared = np.einsum("ij,jk,ik->i", v, left, v)
    noise = max(float(chi_squared.min()) / samples, 1.0)
    inside = fine[chi_squared < chi_squared.min() + PLACE_RISE * noise]
    best = float(fine[np.argmin(chi_squared)])
    return PlaceOnBeam(best, float(inside.min()), float(inside.max()), seen.beam.length)


def _table(
    seen: InstrumentedBeam, record: Record, measured: Array, simulated: Sequence[Array]
) -> Array:
    """Whitened columns of the sensors beside the first mode: measured, simulated, slack.

    The release is known no better than it was read: what a little of the higher modes would do from
    there, and errors of the phase and the amplitude of the first, are taken off.
    """
    noise = _level(record, measured - simulated[-1])
    beside = null_space((seen.shapes[:, 0] / noise)[None])
    usual = simulated[len(simulated) // 2]
    modal, t = usual @ np.linalg.pinv(seen.shapes).T, record.t
    share, rate = (t / t[-1])[:, None], np.gradient(usual, t, axis=0)
    free = [rate, share * rate, share**2 * rate, usual, share * usual]
    own = [np.outer(usual[:, s], row) for s, row in enumerate(np.eye(len(noise)))]
    for k, shape in list(enumerate(seen.shapes.T))[1:]:
        own += [np.outer(t * np.gradient(modal[:, k], t), shape)]
        own += [np.outer(t * modal[:, k], shape)]
        omega = seen.basis.omega[k]
        ring = np.exp((1j * omega - (seen.beam.alpha + seen.beam.eta * omega**2) / 2) * t)
        free += [np.outer(ring.real, shape), np.outer(ring.imag, shape)]

    def white(columns: Sequence[Array]) -> Array:
        parts = [record.whitened((y / noise) @ beside) for y in columns]
        return np.stack([x.ravel() for x in parts], axis=1)

    basis = np.linalg.qr(white(free))[0]
    table = white([measured, *simulated, *own])
    return np.asarray(table - basis @ (basis.T @ table))


def _level(record: Record, left: Array) -> Array:
    """Noise of the sensors over that of the coordinate, (n_sensors,)."""
    differences = np.diff(record.whitened(left), axis=0)
    # Differences of neighbours see noise, and hardly a slow misfit.
    return np.asarray(np.std(differences, axis=0) / np.sqrt(2))
