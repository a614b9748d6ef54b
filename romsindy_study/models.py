"""The models that the study compares: three families, four orders."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

from romsindy.record.backbone import Backbone
from romsindy.record.decay import Decay
from romsindy.regression.estimator import PAPER, HarmonicSINDy, regress
from romsindy.regression.judged import Judged
from romsindy.regression.library import (
    BeamTheoryLibrary,
    DampingLibrary,
    ICROMLibrary,
    StiffnessLibrary,
)

ORDERS = (3, 5, 7, 9)
FAMILIES = ("stiffness", "beam theory", "IC-ROM")


def library(family: str, order: int, damping: Sequence[str] = ()) -> Any:
    """The terms of a family of models up to a power of q in the force, and kinds of damping.

    Parameters
    ----------
    family : str
        "stiffness" (a polynomial alone), "beam theory" (the paper's eq. 8: q^2 q_ddot and
        q q_dot^2 with coefficients apart) or "IC-ROM", with inertia up to q^(order - 1).

    Raises
    ------
    ValueError
        For a family that does not exist.
    """
    if family not in FAMILIES:
        raise ValueError(f"family = {family!r} must be one of {FAMILIES}")
    terms = StiffnessLibrary(tuple(range(1, order + 1)))
    if damping:
        terms = terms + DampingLibrary(tuple(damping))
    if family == "beam theory":
        return BeamTheoryLibrary() + terms
    return ICROMLibrary(tuple(range(3, order + 1))) + terms if family == "IC-ROM" else terms


def identify(
    decay: Decay,
    backbone: Backbone,
    family: str,
    order: int,
    *,
    recipe: HarmonicSINDy = PAPER,
    omega: float | None = None,
    damping: Sequence[str] = (),
) -> Judged:
    """Identify one model of a `library` and hold its backbone against the extracted one.

    ``omega`` is a linear frequency that is known, rad/s; it is estimated by default.
    """
    fixed = {} if omega is None else {"omega^2": omega**2}
    name = f"{family} {order}" + (", omega fixed" if omega is not None else "")
    return regress(name, library(family, order, damping), decay, backbone, recipe, fixed)


def identify_all(
    decay: Decay, backbone: Backbone, omega: float, recipe: HarmonicSINDy = PAPER
) -> Iterator[Judged]:
    """All families and orders, the linear frequency estimated and fixed to ``omega`` (rad/s)."""
    for family, order, known in itertools.product(FAMILIES, ORDERS, (None, omega)):
        yield identify(decay, backbone, family, order, recipe=recipe, omega=known)
