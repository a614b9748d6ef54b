"""The harmonic balance at measured steady states, linearised about an orbit for each of them.

Every point has an orbit of its own, which is unknown too: its measured harmonics, within their
noise, and the others, which follow from the balance. So nothing is divided by the slope of a
response at a given frequency, which a fold does not have, and stability plays no part.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from romsindy.orbits.harmonic_balance import HarmonicBalance
from romsindy.physics.model import ReducedModel
from romsindy.record.recording import Quantity
from romsindy.typing import Array, Indices

# How often q is differentiated to give what was measured.
RATES: dict[Quantity, int] = {"displacement": 0, "velocity": 1, "acceleration": 2}

_LEAST_POINTS = 4
# Amplitudes of the force that agree to this part of the largest are one level.
SAME_LEVEL = 0.01
_SAME_HELD = 0.05  # those of a response that a control holds, which is measured with noise
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
    # (n,), standard deviation of the frequency of a fold, rad/s; 0 where a point is no fold
    frequency_std: Array

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
        return cls(
            omega,
            f + 0j,
            x / factor,
            sigma / np.abs(factor),
            phased,
            measured,
            np.zeros(len(omega)),
        )

    def __len__(self) -> int:
        return len(self.frequency)

    def some(self, which: NDArray[np.bool_] | Indices) -> SteadyPoints:
        """Some of the points."""
        names = ("frequency", "force", "q", "std", "frequency_std")
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
        """Number of the level of the force, or of the response that is held, (n,), from 0.

        All 0 where neither has levels. One level of the force holds no response.
        """
        force = np.abs(self.force)
        if np.ptp(force) <= SAME_LEVEL * force.max():
            return np.zeros(len(self), int)
        for size, same in ((force, SAME_LEVEL), (np.abs(self.q[:, 0]), _SAME_HELD)):
            order = np.argsort(size)
            jumps = np.diff(size[order]) > same * size.max()
            level = np.zeros(len(size), int)
            level[order[1:]] = np.cumsum(jumps)
            if 0 < level.max() and len(self) >= _PER_LEVEL * (level.max() + 1):
                return level
        return np.zeros_like(level)

    @property
    def runs(self) -> list[Indices]:
        """Points one after the other, of one level, whose frequency has one direction."""
        level, starts, way = self.level, [0], 0.0
        for i, step in enumerate(np.sign(np.diff(self.frequency)).tolist()):
            turned = level[i + 1] != level[i] or (way != 0 and step != way)
            way = 0.0 if turned else step
            if turned:
                starts.append(i + 1)
        return np.split(np.arange(len(self)), starts[1:])


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


_ROUNDING = 1e-12  # of a covariance


@dataclass(frozen=True)
class Chain:
    """How an excitation F becomes a force per unit mass: (gain + slope |F|) exp(i phase) F."""

    gain: float
    slope: float
    phase: float

    def force(self, measured: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Complex amplitudes per unit mass."""
        return (self.gain + self.slope * np.abs(measured)) * np.exp(1j * self.phase) * measured


CHAIN = ("gain", "slope", "phase")


@dataclass(frozen=True, eq=False)
class Rows:
    """First-order balance of n points, k equations each, in p parameters."""

    misfit: Array  # (n, k), force left over were the orbit as measured, unit of q per s^2
    # (n, k, p), its derivatives by the free coefficients and by those of the `CHAIN`
    by_parameter: Array
    by_q: Array  # (n, k, k), its derivatives by the measured quantities
    noise: Array  # (n, k, k), covariance of the misfit from the noise of the response
    size: Array  # (n,), amplitude of the force per unit mass
    # (n, j, 1 + k + p), what to take from the other Fourier coefficients: at once, and for changes
    # of the measured quantities and of the parameters
    others: Array

    def whitened(self, unexplained: float) -> tuple[Array, Array]:
        """By parameter (n k, p) and misfit (n k,), of unit variance.

        ``unexplained`` is the part of the force that the model leaves over: its standard deviation.
        """
        root = np.linalg.cholesky(self.covariance(unexplained))
        joined = np.concatenate([self.by_parameter, self.misfit[..., None]], axis=2)
        table = np.linalg.solve(root, joined).reshape(-1, joined.shape[2])
        return table[:, :-1], table[:, -1]

    def covariance(self, unexplained: float) -> Array:
        """Of the misfit, (n, k, k)."""
        slack = (unexplained * self.size) ** 2
        slack = slack + _ROUNDING * np.trace(self.noise, axis1=1, axis2=2)  # singular at folds
        return self.noise + slack[:, None, None] * np.eye(self.misfit.shape[1])


def known(points: SteadyPoints) -> slice:
    """Fourier coefficients of q that are measured; without phases, q is largest at phase 0."""
    return slice(1, 2 if not points.phased else 1 + 2 * points.q.shape[1])


def _first(points: SteadyPoints) -> slice:
    """Equations in which the excitation stands, or a measured harmonic."""
    return known(points) if points.phased else slice(1, 3)


def others_of(points: SteadyPoints, c: Array) -> Indices:
    """Fourier coefficients of c, (n, 2 H + 1), that follow from their own equations."""
    return np.delete(np.arange(c.shape[1]), _first(points))


def measured(points: SteadyPoints) -> tuple[Array, Array]:
    """Measured Fourier coefficients of q, (n, k), and their standard deviations."""
    if not points.phased:
        return points.amplitude[:, None], points.std[:, :1]
    parts = np.stack([points.q.real, -points.q.imag], axis=2)
    return parts.reshape(len(points), -1), np.repeat(points.std, 2, axis=1)


def linearised(
    points: SteadyPoints, model: ReducedModel, free: tuple[str, ...], chain: Chain, c: Array
) -> Rows:
    """Balance about orbits with Fourier coefficients c, (n, 2 H + 1), by all parameters."""
    force, by_c, by_p, by_omega = _balance(points, model, free, c)
    own = known(points)
    equations, other = _first(points), others_of(points, c)
    # The other harmonics follow from their own equations: Schur's complement.
    right = np.concatenate([force[..., None], by_c[:, :, own], by_p, by_omega[..., None]], axis=2)
    others = np.linalg.solve(by_c[:, other[:, None], other], right[:, other])
    reduced = right[:, equations] - by_c[:, equations, other] @ others
    if not points.phased:
        size = np.linalg.norm(reduced[:, :2, 0], axis=1)[:, None, None]
        # The size of the force that the orbit needs: its phase is free.
        along = reduced[..., 0] / np.linalg.norm(reduced[..., 0], axis=1)[:, None]
        reduced = np.concatenate([size, along[:, None] @ reduced[..., 1:]], axis=2)
    k = own.stop - own.start
    q, std = measured(points)
    given, by_chain = _given(points, chain, k)
    by_q, by_omega = reduced[..., 1 : k + 1], reduced[..., -1]
    fold = points.frequency_std > 0
    by_q = np.where(fold[:, None, None], 0.0, by_q)  # as at a fold, but for the noise of c
    wide = by_omega * points.frequency_std[:, None]
    off = (by_q @ (q - c[:, own])[..., None])[..., 0]
    return Rows(
        misfit=reduced[..., 0] - given + off,
        by_parameter=np.concatenate([reduced[..., k + 1 : -1], -by_chain], axis=2),
        by_q=by_q,
        noise=(by_q * std[:, None] ** 2) @ by_q.swapaxes(1, 2) + wide[..., None] * wide[:, None],
        size=np.abs(chain.force(points.force)),
        others=others[..., :-1],
    )


def _balance(
    points: SteadyPoints, model: ReducedModel, free: tuple[str, ...], c: Array
) -> tuple[Array, Array, Array, Array]:
    """Forces without the excitation (n, m), and derivatives by c, coefficients and frequency."""
    balance = HarmonicBalance(model, c.shape[1] // 2)
    terms = {term.key: term for term in model.terms}
    orbits, omega = c[..., None], points.frequency
    force, by_c, by_omega = balance.linearise(orbits, omega)
    by_p = balance.by_coefficient([terms[name] for name in free], orbits, omega)
    return force, by_c, by_p, by_omega


def parts_of_force(points: SteadyPoints, chain: Chain, k: int) -> Array:
    """Fourier coefficients of the excitation per unit mass, (n, k)."""
    return _given(points, chain, k)[0]


def _given(points: SteadyPoints, chain: Chain, k: int) -> tuple[Array, Array]:
    """Fourier coefficients of the excitation (n, k), and their derivatives by the `CHAIN`."""
    force, size = chain.force(points.force), np.abs(points.force)
    by_chain = np.zeros((len(points), k, 3))
    if not points.phased:
        by_chain[:, 0, :2] = np.stack([size, size**2], axis=1)
        return np.abs(force)[:, None], by_chain
    turned = np.exp(1j * chain.phase) * points.force
    for column, change in enumerate((turned, size * turned, 1j * force)):
        by_chain[:, :2, column] = _parts(change)
    given = np.zeros((len(points), k))
    given[:, :2] = _parts(force)
    return given, by_chain


def _parts(z: NDArray[np.complex128]) -> Array:
    """Cosine and sine coefficient of Re(z exp(i omega t))."""
    return np.stack([z.real, -z.imag], axis=1)
