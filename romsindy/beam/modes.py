"""Linear modes about an equilibrium, and the projection of a motion on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.linalg import LinAlgError, eigh
from scipy.sparse import csc_array
from scipy.sparse.linalg import eigsh

from romsindy.beam.assembly import Assembly
from romsindy.beam.statics import NoEquilibriumError, Shape
from romsindy.record.decay import Decay

# up to this size a dense solve is quick, and it also serves meshes that are too small for Arnoldi
_DENSE = 120
_UNSTABLE = "the equilibrium is not stable; support the beam, or find another equilibrium"


class Recorded(Protocol):
    """A motion that modes and sensors can be asked about, such as a `Motion`."""

    @property
    def t(self) -> np.ndarray:
        """Time, s."""

    @property
    def basis(self) -> ModalBasis:
        """The modes in which it was recorded."""

    def modal(self, basis: ModalBasis) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, q_dot, q_ddot, (n_samples, n_modes) each."""

    def readings(self, rows: np.ndarray) -> np.ndarray:
        """Return what weights of the nodal displacements read, (n_samples, n_rows), m."""


@dataclass(frozen=True, eq=False)
class ModalBasis:
    """Mass-normalised modes about an equilibrium; the tip (right end) moves up in each.

    Attributes
    ----------
    omega : (n_modes,) array
        Angular frequencies, rad/s.
    shapes : (n_modes, n_nodes, 3) array
        (u, w, theta), kg^-0.5, kg^-0.5, rad m^-1 kg^-0.5.
    momenta : (n_modes, n_nodes, 3) array
        M phi; q = sum(momenta * (x - x_equilibrium)), kg^0.5 m.
    equilibrium : Shape
        The static state about which they are taken.
    axial : (n_modes,) array
        Share of the modal kinetic energy that is axial.
    """

    omega: np.ndarray
    shapes: np.ndarray
    momenta: np.ndarray
    equilibrium: Shape
    axial: np.ndarray

    def __repr__(self) -> str:
        first = ", ".join(f"{w:.6g}" for w in self.omega[:6])
        more = ", ..." if len(self.omega) > 6 else ""
        return f"ModalBasis({len(self.omega)} modes,\n           omega = {first}{more} rad/s)"

    def index(self, mode: int) -> int:
        """Return the row of mode 1, 2, ...

        Raises
        ------
        ValueError
            For a mode that is not in the basis.
        """
        if not 1 <= mode <= len(self.omega):
            raise ValueError(
                f"mode = {mode} is not in the basis; modes 1 to {len(self.omega)} are: ask "
                "beam.modes for a larger count"
            )
        return mode - 1

    def shape(self, mode: int) -> np.ndarray:
        """Return the shape of mode 1, 2, ..., (n_nodes, 3)."""
        return self.shapes[self.index(mode)]

    def point(self, mode: int) -> float | None:
        """Return where mode 1, 2, ... moves most across the beam, m; None is the right end."""
        node = int(np.argmax(np.abs(self.shape(mode)[:, 1])))
        s = self.equilibrium.s
        return None if node == len(s) - 1 else float(s[node])

    def coordinates(self, displacement: np.ndarray) -> np.ndarray:
        """Return q of all modes for displacements from straight, (..., n_nodes, 3)."""
        return self.rates(displacement - self.equilibrium.displacement)

    def rates(self, field: np.ndarray) -> np.ndarray:
        """Return the modal components of a velocity or acceleration field (..., n_nodes, 3)."""
        return np.tensordot(field, self.momenta, axes=([-2, -1], [-2, -1]))

    def project(self, motion: Recorded, mode: int = 1) -> Decay:
        """Return q, q_dot, q_ddot of one mode of a motion.

        Raises
        ------
        ValueError
            For a mode that does not exist, or a motion that was recorded in other modes and
            without its full field.
        """
        column = self.index(mode)
        q, q_dot, q_ddot = motion.modal(self)
        return Decay(motion.t, q[:, column], q_dot[:, column], q_ddot[:, column], unit="kg^0.5 m")


def assembled(assembly: Assembly, matrices: np.ndarray) -> tuple[csc_array, np.ndarray]:
    """Return the sparse matrix of the free degrees of freedom, and their flat numbers."""
    first = 6 * np.arange(assembly.n_elements)
    rows = (first[:, None] + np.arange(9))[:, :, None] + np.zeros(9, dtype=int)
    columns = rows.transpose(0, 2, 1)
    size = 3 * assembly.n_nodes
    full = csc_array((matrices.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))
    free = np.flatnonzero(~assembly.fixed.ravel())
    return full[free][:, free], free


def solve_modes(assembly: Assembly, equilibrium: Shape, count: int) -> ModalBasis:
    """Return the lowest `count` modes about an equilibrium: K phi = omega^2 M phi.

    Raises
    ------
    ValueError
        If `count` is not between 1 and what the mesh can carry.
    NoEquilibriumError
        If the equilibrium is unstable.
    """
    stiffness, _ = assembly.tangents(equilibrium.displacement)
    K, free = assembled(assembly, stiffness)
    M, _ = assembled(assembly, assembly.mass)
    if not 1 <= count < len(free) - 1:
        raise ValueError(
            f"count = {count} modes were asked for; this mesh has 1 to {len(free) - 2} of them: "
            "ask for fewer, or use more elements"
        )
    values, vectors = _eigenpairs(K, M, count)
    flat = np.zeros((count, assembly.n_nodes * 3))
    flat[:, free] = vectors.T[np.argsort(values)]
    shapes = flat.reshape(count, assembly.n_nodes, 3)
    momenta = np.array([assembly.mass_times(phi) for phi in shapes])
    scale = np.array([_sign(phi) for phi in shapes])
    scale /= np.sqrt(np.sum(shapes * momenta, axis=(1, 2)))
    shapes, momenta = shapes * scale[:, None, None], momenta * scale[:, None, None]
    axial = np.sum(shapes[..., 0] * momenta[..., 0], axis=1)
    # Rayleigh quotients: their error is the square of the shape's
    squares = [assembly.modal_stiffness(equilibrium.displacement, phi) for phi in shapes]
    if min(squares) <= 0.0:
        raise NoEquilibriumError(f"{_UNSTABLE} (omega^2 = {min(squares):.4g} 1/s^2)")
    return ModalBasis(np.sqrt(squares), shapes, momenta, equilibrium, axial)


def _eigenpairs(K: csc_array, M: csc_array, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the `count` smallest omega^2 and their shapes as columns, in any order."""
    size = K.shape[0]
    if size <= _DENSE:
        # M phi = phi K / omega^2: K may be inverted, M not if there is no rotary inertia
        try:
            inverses, vectors = eigh(
                M.toarray(), K.toarray(), subset_by_index=(size - count, size - 1)
            )
        except LinAlgError:
            raise NoEquilibriumError(_UNSTABLE) from None
        return 1.0 / inverses, vectors
    start = np.ones(size)  # a fixed start vector makes the result repeatable
    return eigsh(K, k=count, M=M, sigma=0.0, which="LM", v0=start)


def _sign(phi: np.ndarray) -> float:
    """Return the sign that makes the tip rise, or the largest deflection if the tip is held."""
    w = phi[:, 1]
    reference = w[-1] if abs(w[-1]) > 1e-3 * np.abs(w).max() else w[np.argmax(np.abs(w))]
    return 1.0 if reference >= 0.0 else -1.0
