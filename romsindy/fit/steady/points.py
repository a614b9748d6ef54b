"""Measured steady states: frequency, force and harmonics of the response, checked."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from romsindy.record.recording import Quantity
from romsindy.typing import Array, Indices

# How often q is differentiated to give what was measured.
RATES: dict[Quantity, int] = {"displacement": 0, "velocity": 1, "acceleration": 2}

_LEAST_POINTS = 4
# Amplitudes of the force that agree to this part of the largest are one level.
_SAME_LEVEL = 0.01
_PER_LEVEL = 4  # points on the mean: with fewer, the force is no level but differs from each


@dataclass(frozen=True, eq=False)
class SteadyPoints:
    """Steady states under force Re(F exp(i omega t)), one each row."""

    frequency: Array  # (n,), angular, rad/s
    # (n,), as measured, in its own unit; the amplitude where phases are not known
    force: NDArray[np.complex128]
    # (n, H), harmonics 1 ... H; the amplitude of the first where phases are not known
    q: NDArray[np.complex128]
    # (n, H), standard deviation of the real and of the imaginary part of q; 0 where it is not known
    std: Array
    phased: bool  # whether phases are known
    measured: Quantity

    @classmethod
    def of(
        cls,
        frequency: ArrayLike,
        force: ArrayLike,
        response: ArrayLike,
        std: ArrayLike | None,
        measured: Quantity,
    ) -> SteadyPoints:
        """Check what was measured; see `romsindy.fit.steady.fit.fit_steady` for what is raised."""
        if measured not in RATES:
            raise ValueError(f"measured = {measured!r} must be one of {list(RATES)}")
        omega = _column("frequency", frequency, len(np.atleast_1d(frequency)))
        phased = np.iscomplexobj(response)
        x = np.asarray(response, complex)
        x = x[:, None] if x.ndim == 1 else x
        if x.ndim != 2 or x.shape[0] != len(omega) or not x.shape[1]:
            raise ValueError(
                f"response has the shape {np.shape(response)}, but frequency has {len(omega)}"
                f" values: give ({len(omega)},), or ({len(omega)}, H) with H harmonics"
            )
        if x.shape[1] > 1 and not phased:
            raise ValueError("response has several harmonics and no phases: give complex ones")
        _require_finite("response", x)
        f = _column("force", force, len(omega), complex)
        if len(omega) < _LEAST_POINTS:
            raise ValueError(
                f"frequency has {len(omega)} values: at least {_LEAST_POINTS} steady states are"
                " needed"
            )
        if np.any(omega <= 0):
            raise ValueError(
                f"frequency = {omega[omega <= 0][0]:g} is not positive: give angular frequencies"
                " in rad/s"
            )
        if np.any(f == 0):
            count = int(np.sum(f == 0))
            raise ValueError(
                f"force is 0 in {count} of {len(f)} steady states: without a force there is no"
                " steady state; give the measured excitation, or leave these out"
            )
        if np.any(x[:, 0] == 0):
            raise ValueError("response has a first harmonic of 0: leave such points out")
        sigma = np.zeros(x.shape) if std is None else _noise(std, x.shape)
        if not phased and np.any(x.real < 0):
            raise ValueError(
                "response is real and negative: give amplitudes, or complex harmonics with phase"
            )
        factor = (1j * omega[:, None] * np.arange(1, x.shape[1] + 1)) ** RATES[measured]
        if not phased:
            factor, f = np.abs(factor), np.abs(f)
        return cls(omega, f + 0j, x / factor, sigma / np.abs(factor), phased, measured)

    def __len__(self) -> int:
        return len(self.frequency)

    def some(self, which: NDArray[np.bool_] | Indices) -> SteadyPoints:
        """Some of the points."""
        names = ("frequency", "force", "q", "std")
        return replace(self, **{name: getattr(self, name)[which] for name in names})

    @property
    def amplitude(self) -> Array:
        """Of the first harmonic of q, (n,)."""
        return np.abs(self.q[:, 0])

    @property
    def rate(self) -> int:
        """How often q is differentiated to give what was measured."""
        return RATES[self.measured]

    @property
    def level(self) -> Indices:
        """Number of the level of the force, (n,), from 0; all 0 where forces are no levels."""
        size = np.abs(self.force)
        order = np.argsort(size)
        jumps = np.diff(size[order]) > _SAME_LEVEL * size.max()
        level = np.zeros(len(size), int)
        level[order[1:]] = np.cumsum(jumps)
        return level if len(self) >= _PER_LEVEL * (level.max() + 1) else np.zeros_like(level)


def _column(name: str, values: ArrayLike, n: int, kind: type = float) -> NDArray:
    if kind is float and np.iscomplexobj(values):
        raise ValueError(f"{name} must be real numbers")
    x: NDArray = np.asarray(values, kind)
    if x.shape != (n,):
        raise ValueError(
            f"{name} has the shape {x.shape}, but frequency has {n} values: give ({n},)"
        )
    _require_finite(name, x)
    return x


def _require_finite(name: str, x: NDArray) -> None:
    bad = np.unique(np.argwhere(~np.isfinite(x))[:, 0]).tolist()
    if bad:
        raise ValueError(f"{name} is not finite in the points {bad[:5]}: leave these points out")


def _noise(std: ArrayLike, shape: tuple[int, ...]) -> Array:
    sigma = np.asarray(std, float)
    if sigma.shape not in ((), shape, shape[:1]):
        raise ValueError(f"std has the shape {sigma.shape}: give a number, {shape[:1]} or {shape}")
    if not np.all((sigma > 0) & np.isfinite(sigma)):
        raise ValueError(
            "std must be positive and finite: it is the standard deviation of the real and of the"
            " imaginary part of the response; leave it out where it is not known"
        )
    return np.broadcast_to(sigma[:, None] if sigma.shape == shape[:1] else sigma, shape)
