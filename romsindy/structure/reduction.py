"""The reduced equation of one mode from the shapes that its force holds, and what it leaves out.

That what follows does so statically, with its inertia, is exact to the first power of (n omega /
omega_j)^2 for a mode j that follows in the harmonic n. What is left out changes the frequency by

    delta omega^2 = -(2 / A) d/dA sum_n S_n^2 omega_j^2 rho^2 / (4 (1 - rho))

with rho = (n omega / omega_j)^2 and S_n the harmonics of what mode j does while q = A cos(omega t):
the difference of the averaged Lagrangian of a mode j that is driven, and of one that follows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from romsindy.physics.model import ReducedModel
from romsindy.physics.validation import require_positive
from romsindy.structure.held import CurveError, Found, HeldCurve, coefficients
from romsindy.structure.linear import LinearModel
from romsindy.text import TextTable, listed, percent
from romsindy.typing import Array

_ORDERS = range(3, 14)
_FOLLOWS = 1e-3  # of the largest change of K and of h: so closely a polynomial follows
_POORLY = 1e-2  # the same: less closely is said
_STILL = 1e-3  # of the largest displacement of a mode: where it moves less it is not measured
_LOOKS = 41  # amplitudes at which a periodic motion is looked for
_SAMPLES = 128  # of a cycle
_STEP = 0.01  # of an amplitude, for a derivative
_NOTHING = 1e-6  # of the largest change of K, or of h: a term that does less is left out
_SHARE = 1e-3  # of h: a mode that does less does not count as following
_HEARD = 1e-3  # of the amplitude: a harmonic of what follows that is smaller is no resonance
_SLOW = 4.0  # times as fast as the first, at least, is fast
_ENOUGH = 0.01  # of a frequency: one mode that is off by more is not enough
_RESONANT = 0.02  # of a squared ratio of frequencies: nearer is resonance
_TINY = 1e-12  # of the mass: less is no inertia


class Follower(NamedTuple):
    """A mode that follows the one that is kept."""

    number: int
    ratio: float  # of its frequency to that of the mode that is kept
    share: float  # of h at the end of the range
    error: (
        float  # of the frequency there, relative, that following statically makes; nan: resonance
    )


@dataclass(frozen=True, eq=False, repr=False)
class Reduction:
    """A reduced equation of a structure, and how far it can be trusted.

    Attributes
    ----------
    model : ReducedModel
        Its equation of motion.
    curve : HeldCurve
        The shapes behind it.
    per_q : float
        The model's coordinate for a unit of the modal one.
    between : CurveError
        Errors of K and of h between the static cases, as parts of their largest change.
    fit : CurveError
        Those of the polynomials of the model.
    followers : tuple of Follower
        Modes that follow, the one with the largest share of h first.
    notes : tuple of str
        What is to be said beside.
    """

    structure: LinearModel
    model: ReducedModel
    curve: HeldCurve
    per_q: float
    between: CurveError
    fit: CurveError
    followers: tuple[Follower, ...]
    length: str  # unit of length of the structure
    notes: tuple[str, ...]

    @property
    def place(self) -> str:
        """The freedom that moves most, in words."""
        row = self.curve.mode.loudest
        s = self.structure
        return f"node {s.nodes[row]} in direction {s.directions[row]}"

    @property
    def moved(self) -> tuple[float, float]:
        """Least and largest displacement of that freedom, unit of length."""
        ends = self.curve.shapes_at(np.array(self.curve.range))[:, self.curve.mode.loudest]
        return float(ends.min()), float(ends.max())

    @property
    def error(self) -> float:
        """Relative error of the frequency at the end of the range by modes that follow."""
        return sum(abs(f.error) for f in self.followers)

    @property
    def reach(self) -> float:
        """Largest amplitude whose motion is within the range, unit of the model."""
        return float(self.model.amplitude_range[1])  # type: ignore[index]

    def frequencies(self, amplitudes: Array) -> Array:
        """Frequencies of the undamped motion, rad/s, at amplitudes of the model's coordinate."""
        return np.asarray(self.model.backbone(amplitudes))

    @property
    def tables(self) -> list[TextTable]:
        """Modes that follow, and the backbone."""
        rows = [["mode", "times as fast", "of h [%]", "changes the frequency by [%]"]]
        for f in self.followers:
            by = "resonance" if np.isnan(f.error) else f"{100 * f.error:.2g}"
            rows.append([f"{f.number}", f"{f.ratio:.3g}", f"{100 * f.share:.3g}", by])
        note = "What a mode does that follows with its own inertia, which the equation leaves out."
        follow = [TextTable("Modes that follow, at the end of the range", rows, note)]
        return [*(follow if self.followers else []), self._backbone]

    @property
    def _backbone(self) -> TextTable:
        amplitudes = self.reach * np.array([1e-3, 0.25, 0.5, 0.75, 1.0])
        rows = [[f"amplitude [{self.model.unit}]", "frequency [Hz]", "changed by [%]"]]
        hertz = self.frequencies(amplitudes) / (2 * np.pi)
        for a, f in zip(amplitudes, hertz, strict=True):
            rows.append([f"{a:.4g}", f"{f:.6g}", f"{100 * (f / hertz[0] - 1):.3f}"])
        return TextTable("Backbone", rows)

    def __str__(self) -> str:
        low, high = self.moved
        s, n = self.structure, len(self.curve.cases.factors)
        hz = ", ".join(f"{w / (2 * np.pi):.4g}" for w in s.omega[:6])
        lines = [
            f"{s.name}: {len(s.nodes):,} free degrees of freedom; modes at {hz} ... Hz",
            f"Mode {self.curve.mode.number} moves {self.place} most; held there from {low:.4g} to"
            f" {high:.4g} {self.length} by {n} static cases",
            f"Between them K is known to {percent(self.between.force)} and h to"
            f" {percent(self.between.inertia)} of their largest change, and the equation follows to"
            f" {percent(self.fit.force)} and {percent(self.fit.inertia)}",
            self.enough,
        ]
        return "\n".join(lines)

    @property
    def enough(self) -> str:
        """Whether one mode is enough."""
        if not self.followers:
            return "Nothing follows: the shape of the mode stays as it is"
        if any(np.isnan(f.error) for f in self.followers):
            return "One mode is not enough: a harmonic of its motion is in resonance with another"
        told = (
            "Modes that follow by themselves, and not at once, change the frequency by"
            f" {percent(self.error)} at the end of the range"
        )
        if self.error > _ENOUGH:
            told = f"One mode is not enough: {told[0].lower()}{told[1:]}"
        slow = [
            f"mode {f.number}, {f.ratio:.2g} times as fast, by {percent(f.error)}"
            for f in self.followers
            if f.ratio < _SLOW
        ]
        return f"{told} ({listed(slow)})" if slow else told


def reduced(
    structure: LinearModel,
    found: Found,
    order: int | None,
    row: int | None,
    damping_ratio: float,
    units: tuple[str, str],
) -> Reduction:
    """The equation along a curve of shapes; arguments and errors are those of `Structure.reduce`.

    ``row`` is the freedom whose displacement by the mode is the coordinate.
    """
    curve, length = found.curve, units[0]
    require_positive("damping_ratio", damping_ratio, zero_allowed=True)
    if order is not None and order < 3:
        raise ValueError(f"order = {order} leaves no inertia term; give 3 or more")
    tried = [_tried(curve, n) for n in (_ORDERS if order is None else [order])]
    values, fit = next(
        (t for t in tried if curve.close(t[1], _FOLLOWS)), min(tried, key=lambda t: max(t[1]))
    )
    notes = [*structure.notes, *found.notes]
    if not curve.close(fit, _POORLY):
        notes.append(
            f"the equation follows K to {percent(fit.force)} and h to {percent(fit.inertia)} of"
            " their change only: a smaller range is followed better"
        )
    per_q, unit = 1.0, f"{units[1]}^0.5 {length}"
    if row is not None:
        per_q, unit = float(curve.mode.shape[row]), length
        if abs(per_q) < _STILL * float(np.abs(curve.mode.shape).max()):
            raise ValueError(
                f"mode {curve.mode.number} hardly moves node {structure.nodes[row]} in direction"
                f" {structure.directions[row]}: give a sensor that it moves"
            )
        values = {name: v / per_q ** _power(name) for name, v in values.items()}
    if damping_ratio:
        values["c_linear"] = 2 * damping_ratio * float(np.sqrt(curve.omega2))
    model = ReducedModel.from_coefficients(values, unit=unit)
    reach, rate = _largest_motion(model, abs(per_q) * curve.amplitude)
    return Reduction(
        structure,
        replace(model, amplitude_range=(0.0, reach)),
        curve,
        per_q,
        found.error,
        fit,
        _followers(structure, curve, reach / abs(per_q), rate),
        length,
        tuple(notes),
    )


def _largest_motion(model: ReducedModel, reach: float) -> tuple[float, float]:
    """Amplitude up to which an equation has periodic motion, and the frequency there, rad/s."""
    amplitudes = reach * np.linspace(0, 1, _LOOKS)[1:]
    frequencies = model.backbone(amplitudes)
    last = int(np.argmin(np.append(np.isfinite(frequencies), False))) - 1
    if last < 0:
        raise ValueError(
            f"the equation has no periodic motion up to {reach:.4g}: ask for a smaller range"
        )
    return float(amplitudes[last]), float(frequencies[last])


def _tried(curve: HeldCurve, order: int) -> tuple[dict[str, float], CurveError]:
    """Coefficients of an order, and how far their K and h are from the curve's."""
    values = {n: v for n, v in coefficients(curve, order).items() if _does(curve, n, v)}
    model = ReducedModel.from_coefficients(values)
    off = model.stiffness(curve.q) - curve.force, model.inertia(curve.q) - curve.inertia
    return values, curve.as_parts(*off)


def _does(curve: HeldCurve, name: str, value: float) -> bool:
    """Whether a term changes K or h at the end of the range."""
    end, largest = max(-curve.range[0], curve.range[1]), curve.changes
    if name.startswith("gamma"):
        return abs(value) * end ** (_power(name) + 1) > _NOTHING * largest.force
    return name == "omega^2" or abs(value) * end ** _power(name) > _NOTHING * largest.inertia


def _power(name: str) -> int:
    """Power of the coordinate that a coefficient has in its unit: gamma_3 and Upsilon_3 have 2."""
    return int(name.partition("_")[2]) - 1 if "_" in name else 0


def _followers(
    structure: LinearModel, curve: HeldCurve, reach: float, rate: float
) -> tuple[Follower, ...]:
    """Modes that follow while q swings by ``reach`` at ``rate``, rad/s."""
    momenta = structure.shapes @ structure.mass
    wave = np.cos(2 * np.pi * np.arange(_SAMPLES) / _SAMPLES)
    near = reach * np.array([1 - _STEP, 1 + _STEP])
    sizes = [np.abs(np.fft.rfft(_moved(curve, a * wave, momenta), axis=0)) for a in near]
    harmonics = np.arange(1, len(sizes[0]))[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        rho = (harmonics * rate / structure.omega) ** 2
        lost = [_missed(2 / _SAMPLES * s[1:], rho, reach) for s in sizes]
    change = -(2 / reach) * (lost[1] - lost[0]) / (near[1] - near[0]) * structure.omega**2
    ends = np.array(curve.range)
    slopes = curve.following_at(ends, slope=True) @ momenta.T
    shares = np.max(slopes**2, axis=0) / max(float((curve.inertia_at(ends) - 1).max()), _TINY)
    found = [
        Follower(i + 1, float(w / np.sqrt(curve.omega2)), float(share), float(x / (2 * rate**2)))
        for i, (w, share, x) in enumerate(zip(structure.omega, shares, change, strict=True))
        if share > _SHARE and i + 1 != curve.mode.number
    ]
    return tuple(sorted(found, key=lambda f: -f.share))


def _moved(curve: HeldCurve, q: Array, momenta: Array) -> Array:
    """Coordinates of the other modes where they follow, (len(q), k)."""
    return curve.following_at(q) @ momenta.T


def _missed(sizes: Array, rho: Array, reach: float) -> Array:
    """Averaged Lagrangian that is missed, over omega_j^2, (k,), by harmonics of sizes (n, k)."""
    near = np.abs(1 - rho) < _RESONANT
    far = np.where(near, 0.0, sizes**2 * rho**2 / (4 * np.where(near, 1.0, 1 - rho)))
    resonant = np.any(near & (sizes > _HEARD * reach), axis=0)
    return np.where(resonant, np.nan, np.sum(far, axis=0))
