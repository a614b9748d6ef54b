"""What a caller gives, checked: records, which are made ready, and coefficients that are known."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import cast

import numpy as np

from romsindy.fit.kernel.prepared import Prepared
from romsindy.fit.records.coupled import CoupledRecord, record_along
from romsindy.fit.records.driven import ForcedRecord
from romsindy.fit.records.modes import Modes
from romsindy.fit.records.record import NUMERICS, Record, sharing_drift
from romsindy.physics.equations import Equations
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.recording import Given
from romsindy.typing import Array


def listed_records(
    records: Decay | ForcedVibration | Sequence[Decay | ForcedVibration], name: str = "decays"
) -> list[Decay | ForcedVibration]:
    """One record or several as a list; ``name`` is that of the argument.

    Raises a ValueError for none, or anything else.
    """
    given = Given.of(records)
    if given.others:
        raise ValueError(
            f"{name} is {type(records).__name__}: give a Decay or a list of them; arrays become one"
            ' by Decay(t, q, unit="m"), and with an input by ForcedVibration(t, y, u, unit="m")'
        )
    if not given.several:
        raise ValueError(f"{name} is empty: give at least one Decay")
    return given.several


def several_decays(decays: Decay | Sequence[Decay | ForcedVibration]) -> list[Decay]:
    """The same of decays alone.

    Raises a ValueError for none, or anything else.
    """
    several = listed_records(decays)
    if Given.of(several).driven:
        raise ValueError(
            "decays hold a ForcedVibration, and free decays are needed here: refine() and"
            " identify() take inputs"
        )
    return several  # type: ignore[return-value]


def require_unit(several: Sequence[Decay | ForcedVibration], unit: str | None) -> None:
    """All decays in the unit of the model, each given once."""
    for i, decay in enumerate(several):
        if decay.unit != unit:
            raise ValueError(
                f"decay {i} is in {decay.unit or 'an unknown unit'}, the model in"
                f" {unit or 'an unknown unit'}: load the decay with unit={unit!r}"
            )
        if any(decay.same_record(other) for other in several[:i]):
            raise ValueError(
                f"decay {i} is the same record as an earlier one: counted twice, it would make"
                " every error bar too small; give it once"
            )


def require_known(fixed: Mapping[str, float], names: Sequence[str]) -> None:
    """Coefficients that are known: finite numbers by some of these names."""
    if not isinstance(fixed, Mapping):
        raise ValueError(f"fixed = {fixed!r} must map names to values, as {{'omega^2': 1482.0}}")
    unknown = sorted(set(fixed) - set(names))
    if unknown:
        raise ValueError(f"fixed names {unknown}, but there are {', '.join(names)}")
    for name, value in fixed.items():
        if not isinstance(value, (int, float, np.number)) or not np.isfinite(value):
            raise ValueError(f"fixed {name} = {value!r} must be a finite number")
        # No stable rest, no sum of squares.
        if name.split(" [")[0] in ("omega^2", "Upsilon_3") and value < 0:
            raise ValueError(f"fixed {name} = {value:g} must not be negative")


def small_frequencies(model: Equations) -> Array:
    """Of small vibrations, Hz, in the order of the coordinates that move most in them."""
    omega, modes = model.linear_modes
    return omega[np.argsort(np.argmax(np.abs(modes), axis=0))] / (2 * np.pi)


def not_fixed(model: Equations, fixed: Collection[str]) -> tuple[str, ...]:
    """Coefficients of a model but for those that are fixed, which must be among them."""
    unknown = sorted(set(fixed) - set(model.coefficients))
    if unknown:
        raise ValueError(f"fixed names {unknown}, but the model has {list(model.coefficients)}")
    return tuple(name for name in model.coefficients if name not in fixed)


def free_names(model: Equations, fixed: Collection[str]) -> tuple[str, ...]:
    """The same, at least one, and forces that remember all among them."""
    free = not_fixed(model, fixed)
    held = sorted({*fixed} & {law.key for law in model.memories})
    if held:
        raise ValueError(
            f"fixed names {held}: a force that remembers is fitted with what shapes it; leave them"
            " out"
        )
    if not free:
        raise ValueError("fixed names every coefficient of the model: leave one to fit")
    return free


def prepared(
    decays: Decay | Sequence[Decay], unit: str | None, *, coloured: bool = False
) -> tuple[Record, ...]:
    """Free decays in a unit, ready to be fitted, by noise that is white or has a colour.

    Raises a ValueError for no decays, another unit, or a decay given twice.
    """
    several = several_decays(decays)
    require_unit(several, unit)
    records = sharing_drift([Record.of(d.single().free(), NUMERICS) for d in several])
    return tuple(record.without_faults(coloured=coloured) for record in records)


def ready(several: Sequence[Decay | ForcedVibration]) -> tuple[Prepared, ...]:
    """Free decays and forced vibrations of one channel, ready to be fitted together."""
    free = [cast(Decay, d).single().free() for d in several if not d.driven]
    decays = iter(sharing_drift([Record.of(d, NUMERICS) for d in free]))
    return tuple(
        ForcedRecord.of(cast(ForcedVibration, measured), NUMERICS)
        if measured.driven
        else next(decays).without_faults()
        for measured in several
    )


def ready_along(
    several: Sequence[Decay | ForcedVibration], modes: Modes
) -> tuple[CoupledRecord, ...]:
    """The same of several coordinates, whose linear modes are known from the driven ones."""
    return tuple(record_along(measured, modes) for measured in several)
