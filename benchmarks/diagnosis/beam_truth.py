"""What the real beam of a blind trial is, in words that no simulator owns."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Spring:
    """Straight, from the right end to an anchor on the axis: N/m, m beyond the tip, N there."""

    stiffness: float
    length: float
    tension: float


@dataclass(frozen=True)
class Force:
    """A connector at a place on the axis, m; the meaning of ``values`` is its kind's."""

    kind: str
    at: float
    values: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class BeamTruth:
    """Everything that the real beam is; SI units.

    Attributes
    ----------
    supports : "cantilever", "clamped", "pinned"
        Free at the right, or both ends clamped, or both held but free to turn.
    compliance : float
        Of the left clamp, rad/(N m).
    """

    supports: str
    length: float
    width: float
    thickness: float
    young: float
    density: float
    alpha: float
    eta: float
    tip_mass: float = 0.0
    spring: Spring | None = None
    compliance: float = 0.0
    forces: tuple[Force, ...] = ()
    poisson: float = 0.3
