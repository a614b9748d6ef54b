"""Decays of beams whose inertia and stiffness are known: the truth that identification must find.

The truth is the static curve (`Beam.static_curve`): h = x'^T M x' - 1, and K is the modal force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.polynomial import polynomial
from scipy.interpolate import CubicSpline

import romsindy as rs
from romsindy.beam.structure import CLAMPED, Section

DURATION, STEP = 25.0, 1e-3  # s
FASTEST = 80.0  # rad/s; faster beams are simulated at a part of the step
SIDE = np.linspace(0.1, 0.95, 18)  # where bands are judged, of the largest |q|


@dataclass(frozen=True, eq=False)
class KnownDecay:
    """A decay without noise, and the functions behind it.

    Attributes
    ----------
    decay : Decay
    q : (n,) array
        Coordinates, ascending, 0 among them, unit of the decay.
    h, stiffness : (n,) arrays
        Inertia less 1, and K(q)/q in 1/s^2; at q = 0 that is omega^2.
    """

    decay: rs.Decay
    q: np.ndarray
    h: np.ndarray
    stiffness: np.ndarray

    @property
    def amplitude(self) -> float:
        """Largest |q| of the decay."""
        return float(np.abs(self.decay.q).max())

    @property
    def points(self) -> np.ndarray:
        """Coordinates of both signs where bands are judged, those that the decay reaches."""
        q = self.amplitude * np.concatenate([-SIDE[::-1], SIDE])
        return q[(q >= self.decay.q.min()) & (q <= self.decay.q.max())]

    def curves(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """h and K/q at coordinates (n,)."""
        return CubicSpline(self.q, self.h)(q), CubicSpline(self.q, self.stiffness)(q)

    @property
    def coefficients(self) -> dict[str, float]:
        """omega^2 and Upsilon_3, the curvature of h at rest, from its even part."""
        q = np.linspace(0.0, 0.3 * self.amplitude, 31)
        even = (self.curves(q)[0] + self.curves(-q)[0]) / 2
        upsilon = polynomial.polyfit(q**2, even, [1, 2, 3])[1]
        omega2 = self.stiffness[np.flatnonzero(self.q == 0)[0]]
        return {"omega^2": float(omega2), "Upsilon_3": float(upsilon)}


@dataclass(frozen=True)
class Release:
    """A beam and how it is let go, in mode 1; ``at`` is as in `Beam.release_shape`, in m."""

    name: str
    beam: rs.Beam
    displacement: float
    at: float | None = None


def default_release() -> Release:
    """What ``romsindy simulate decay.npz --release-mode 1`` simulates."""
    beam = rs.Beam.cantilever()
    return Release("default", beam, beam.length / 3)


def cantilever_release(seed: int) -> Release:
    """A cantilever of random dimensions, with tip mass and spring."""
    draw = np.random.default_rng(seed).uniform
    length, spring, installed = draw(0.3, 0.6), draw(10, 40), draw(0.06, 0.2)
    beam = rs.Beam.cantilever(
        length=length,
        width=draw(0.015, 0.04),
        thickness=draw(0.0008, 0.0015),
        tip_mass=draw(0, 0.002),
        spring_stiffness=spring,
        spring_length=installed,
        spring_pretension=draw(0.2, 0.8) * spring * installed,
        alpha=draw(0.2, 0.6),
        eta=draw(0.3e-5, 2e-5),
        elements=40,
    )
    return Release(f"cantilever {seed}", beam, length * draw(0.25, 0.35))


def clamped_release(seed: int) -> Release:
    """A clamped-clamped beam of random dimensions, displaced by half to one thickness."""
    draw = np.random.default_rng(seed).uniform
    length, thickness = draw(0.3, 0.6), draw(0.0008, 0.0015)
    beam = rs.Beam(
        length=length,
        section=Section.rectangle(draw(0.015, 0.04), thickness, 210e9, 7800.0, 0.3),
        elements=40,
        left=CLAMPED,
        right=CLAMPED,
        gravity=(0.0, -9.81),
        alpha=draw(0.5, 1.5),
        eta=draw(0.3e-5, 1e-5),
    )
    return Release(f"clamped beam {seed}", beam, thickness * draw(0.5, 1.0), length / 2)


def known_decay(release: Release, cache: Path | None = None) -> KnownDecay:
    """Simulate, or read from the folder, 25 s of mode 1 at 1 kHz and its static curve."""
    arrays = cached(cache, release.name.replace(" ", "_"), lambda: _simulated(release))
    columns = (arrays[name] for name in ("t", "q", "q_dot", "q_ddot"))
    truth = (arrays[name] for name in ("held", "h", "stiffness"))
    return KnownDecay(rs.Decay(*columns, unit="kg^0.5 m"), *truth)


def cached(
    folder: Path | None, name: str, make: Callable[[], dict[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Arrays that ``make`` returns; kept in a file, and read from there, where a folder is named.

    A file is not compared with the beam that it came from: empty the folder when a beam changes.
    """
    if folder is None:
        return make()
    file = folder / f"{name}.npz"
    if not file.exists():
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(file, **make())  # type: ignore[arg-type]
    with np.load(file) as archive:
        return dict(archive)


def _simulated(release: Release) -> dict[str, np.ndarray]:
    beam = release.beam
    shape = beam.release_shape(release.displacement, mode=1, at=release.at)
    modes = beam.modes(count=10)
    every = int(np.ceil(modes.omega[modes.index(1)] / FASTEST))
    motion = beam.simulate(shape, DURATION, STEP / every, modes=modes, progress=False)
    decay = modes.project(motion, mode=1)
    rows = {"t": decay.t, "q": decay.q, "q_dot": decay.q_dot, "q_ddot": decay.q_ddot}
    curve = beam.static_curve(1, 1.02 * float(np.abs(decay.q).max()), 61)
    still = curve.q == 0
    ratio = np.where(still, curve.omega2, curve.force / np.where(still, 1.0, curve.q))
    truth = {"held": curve.q, "h": curve.inertia - 1, "stiffness": ratio}
    return {name: values[::every] for name, values in rows.items()} | truth
