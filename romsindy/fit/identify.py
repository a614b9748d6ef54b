"""Identify an equation of motion from records: one door for all that is measured in time.

What was measured says which way is taken. Free decays of one coordinate become functions of q with
bands (`romsindy.fit.functions`), those of several coordinates and records with inputs become an
equation whose terms gain on data that take no part (`romsindy.fit.choice`). With
``terms`` given nothing is chosen, and their values are fitted (`romsindy.fit.refine`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from romsindy.fit.coupled.identify import identify_coupled, model_with_terms
from romsindy.fit.forced.identify import identify_forced
from romsindy.fit.functions.identification import Identification
from romsindy.fit.functions.identify import identify_decays
from romsindy.fit.records.arguments import listed_records, several_decays
from romsindy.fit.refine import refine, refine_terms, with_damping_split, with_limit_cycle
from romsindy.fit.results.fitted import Fit
from romsindy.fit.verdict import CURVATURE
from romsindy.physics.term import Term
from romsindy.physics.term_sum import term_from_key
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.recording import Given

Measured = Decay | ForcedVibration
_ANGLES = ("rad", "deg")


def identify(
    records: Measured | Sequence[Measured],
    coordinates: int | str = 1,
    *,
    terms: Sequence[Term | str] | None = None,
    fixed: Mapping[str, float] | None = None,
    order: int = 5,
    curvature: float | None = None,
    damping_split: bool | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Identification | Fit:
    """Identify the equation of motion behind records, with errors and a verdict.

    Parameters
    ----------
    records : Decay, ForcedVibration or sequence of them
        Free decays, of which the free part is used; vibrations with measured inputs; or both
        together. In one unit, in the quantity that was measured.
    coordinates : int or "auto"
        How many vibrations are modelled: the strongest, or as many as the data need. Records of
        several channels, and more than one coordinate, take the way of several.
    terms : sequence of Term or str, optional
        What the model has beside linear stiffness and viscous damping, by the names of coefficients
        or as laws; then nothing is chosen. Of several coordinates those of a `CoupledModel`, and
        their number is given.
    fixed : mapping, optional
        Known coefficients, such as ``{"omega^2": 1482.0}``, or ``{"omega^2 [q1]": 1482.0}`` of
        several coordinates, by frequency; in the unit of the records and seconds.
    order : int
        Highest order of stiffness and inertia that are looked for under inputs, of one coordinate.
    curvature : float, optional
        How far the sensor of a decay may be off a straight line at the largest amplitude, as a part
        of that: one standard deviation; 1 % by default, 0 where it is straight.
    damping_split : bool, optional
        Whether linear and quadratic damping of decays of one coordinate are told apart, as
        `Identification.damping`; by default those of angles are: ships roll, platforms pitch.
    seed : int
        Of the draws behind the bands of functions.
    progress : callable, optional
        Called with a line of text at every step.

    Returns
    -------
    Identification or Fit
        The first, with functions and their bands, for decays of one coordinate whose terms
        are not given; else the second.

    Raises
    ------
    ValueError
        For no records, units that differ, a record given twice, or what the records cannot have.
    TrajectoryError
        If no motion of the equation follows the measured one.

    Examples
    --------
    >>> from romsindy import example_decay
    >>> terms = ["gamma_2", "gamma_3", "Upsilon_3", "Upsilon_4", "Upsilon_5"]
    >>> fit = identify(example_decay(40, periods=20, samples=30), terms=terms)
    >>> f"{fit.model.coefficients['Upsilon_3']:.1f} 1/m^2", fit.verdict.explained
    ('0.3 1/m^2', True)
    """
    several = listed_records(records, "records")
    driven = Given.of(several).driven
    one = coordinates == 1 and not isinstance(coordinates, bool)
    laws: Sequence[Term] | None = None
    if terms is not None:
        _require(curvature is None, "curvature", curvature, "left out where terms are given")
        _require(isinstance(terms, (list, tuple)), "terms", terms, "a list, such as ['gamma_3']")
        laws = [term_from_key(t) if isinstance(t, str) else t for t in terms]
    if laws is not None and one:
        return refine_terms(several, laws, fixed or {}, progress)
    if one and not driven and all(r.n_channels == 1 for r in several):
        known = CURVATURE if curvature is None else curvature
        decays = several_decays(several)
        found = identify_decays(decays, fixed=fixed, curvature=known, seed=seed, progress=progress)
        found = with_limit_cycle(found, progress)
        wanted = decays[0].unit in _ANGLES if damping_split is None else damping_split
        return with_damping_split(found, progress) if wanted else found
    where = "where inputs drive the motion" if driven else "for several channels or coordinates"
    _require(curvature is None, "curvature", curvature, f"left out {where}")
    _require(not damping_split, "damping_split", damping_split, f"left out {where}")
    if laws is not None:
        start = model_with_terms(several, coordinates, laws, fixed or {})
        return refine(start, several, fixed=tuple(fixed or ()), progress=progress)
    if driven:
        return identify_forced(several, order, coordinates, fixed=fixed, progress=progress)
    return identify_coupled(several_decays(several), coordinates, fixed=fixed, progress=progress)


def _require(fits: bool, name: str, value: object, remedy: str) -> None:
    if not fits:
        raise ValueError(f"{name} = {value!r} must be {remedy}")
