"""The cross-section: stiffness and inertia per unit length."""

from __future__ import annotations

from dataclasses import dataclass, fields

from romsindy.physics.validation import require_positive


@dataclass(frozen=True)
class Section:
    """Stiffness and inertia of a cross-section about its centroid.

    Parameters
    ----------
    EA, GA, EI : float
        Axial stiffness, N; shear stiffness with its correction factor, N; bending stiffness, N m^2.
    mass, rotary_inertia : float
        Per unit length, kg/m and kg m.

    Raises
    ------
    ValueError
        For a value that is not positive (rotary_inertia may be zero).
    """

    EA: float
    GA: float
    EI: float
    mass: float
    rotary_inertia: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            zero_allowed = field.name == "rotary_inertia"
            require_positive(field.name, getattr(self, field.name), zero_allowed=zero_allowed)

    @classmethod
    def rectangle(
        cls,
        width: float,
        thickness: float,
        young: float,
        density: float,
        poisson: float = 0.3,
        shear_correction: float = 5.0 / 6.0,
    ) -> Section:
        """Make a solid rectangle that bends about its `width` axis (SI units).

        Raises
        ------
        ValueError
            For an argument that is not positive, or a Poisson ratio outside (-1, 0.5].

        Examples
        --------
        >>> round(Section.rectangle(0.025, 0.001, young=210e9, density=7800).EI, 6)
        0.4375
        """
        names = ("width", "thickness", "young", "density", "shear_correction")
        values = (width, thickness, young, density, shear_correction)
        for name, value in zip(names, values, strict=True):
            require_positive(name, value)
        if not -1.0 < poisson <= 0.5:
            raise ValueError(f"poisson must lie in (-1, 0.5], got {poisson}; steel has 0.3")
        area, second_moment = width * thickness, width * thickness**3 / 12.0
        return cls(
            EA=young * area,
            GA=shear_correction * young / (2.0 * (1.0 + poisson)) * area,
            EI=young * second_moment,
            mass=density * area,
            rotary_inertia=density * second_moment,
        )
