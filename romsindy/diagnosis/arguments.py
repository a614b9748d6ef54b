"""Arguments that cannot be meant are refused, with a hint, before anything is looked at."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, TypeVar, cast

import numpy as np

from romsindy.beam import Beam
from romsindy.effects.base import Effect
from romsindy.physics.coupled import AnyModel
from romsindy.physics.equations import inputs_of
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.units import UNITS

Kind = TypeVar("Kind")

# What a model is unsure of, where nothing else is said.
FREE = ("omega^2", "c_linear")


_WHOLE = (int, np.integer)


_NUMBER = (*_WHOLE, float, np.floating)


def decays_of(name: str, given: object) -> list[Decay]:
    """One decay or several, as a list; other things are refused by the name of the argument."""
    several = [given] if isinstance(given, Decay) else given
    if not isinstance(several, Iterable) or isinstance(several, (str, bytes)):
        raise ValueError(f"{name} = {given!r} must be a Decay, or several of them in a list")
    decays, others = _of_kind(list(several), Decay)
    if others:
        raise ValueError(
            f"{name} holds a {type(others[0]).__name__}: give Decay objects, as load_decay reads"
            " them"
        )
    return decays


def _of_kind(given: object, kind: type[Kind]) -> tuple[list[Kind], list[object]]:
    """Records of a kind, of several or one, and what else there is."""
    several = list(given) if isinstance(given, (list, tuple)) else [given]
    others = [v for v in several if not isinstance(v, kind)]
    return [v for v in several if isinstance(v, kind)], others


def check_numbers(floor: float, false_alarm: float, max_effects: int, n_jobs: int) -> None:
    """Raise a ValueError for settings of a search that are no numbers, or not of their range."""
    if not (isinstance(floor, _NUMBER) and 0 < floor < 1):
        raise ValueError(f"floor = {floor!r} must be a part of the largest amplitude, below 1")
    if not (isinstance(false_alarm, _NUMBER) and 0 < false_alarm < 1):
        raise ValueError(f"false_alarm = {false_alarm!r} must be a probability between 0 and 1")
    if not (isinstance(max_effects, _WHOLE) and max_effects >= 0):
        raise ValueError(f"max_effects = {max_effects!r} must be a number of effects, such as 3")
    if not (isinstance(n_jobs, _WHOLE) and n_jobs != 0):
        raise ValueError(f"n_jobs = {n_jobs!r} must be a number of processes; -1 uses all cores")


def check_request(
    model: AnyModel,
    measured: Sequence[Decay] | Sequence[ForcedVibration],
    held_out: Decay | ForcedVibration | None,
    free: Sequence[str | Effect],
    tolerances: Mapping[str, float],
    word: str = "decay",
    may_be_free: Collection[str] = FREE,
) -> None:
    """Raise a ValueError for arguments that cannot be meant: "decay 0" in messages."""
    if not measured:
        raise ValueError("measured is empty: give at least one Decay")
    if isinstance(free, str) or not isinstance(free, Iterable):
        raise ValueError(f"free = {free!r} must be a list of names or effects, such as ['omega^2']")
    unknown = [name for name in free if not isinstance(name, Effect) and name not in may_be_free]
    if unknown:
        raise ValueError(
            f"free = {list(free)}: {unknown} cannot be free; use names of {list(may_be_free)}, and"
            " tolerances for other coefficients"
        )
    if not isinstance(tolerances, Mapping):
        raise ValueError(
            f"tolerances = {tolerances!r} must map names to relative standard deviations, such as"
            " {'gamma_3': 0.05}"
        )
    for name, relative in tolerances.items():
        if name not in model.coefficients:
            raise ValueError(
                f"tolerances name {name!r}, but the model has {list(model.coefficients)}"
            )
        if not (isinstance(relative, _NUMBER) and 0 < relative < float("inf")):
            raise ValueError(f"tolerances of {name} = {relative!r} must be positive (relative)")
        if model.coefficients[name] == 0:
            raise ValueError(
                f"tolerances name {name!r}, which is 0 in the model: a relative tolerance of 0 is"
                " none; give the coefficient its expected size, or leave it to the catalogue"
            )
    everything: list[Decay | ForcedVibration] = [*measured]
    everything += [held_out] if held_out is not None else []
    for i, decay in enumerate(everything):
        if decay.unit is not None and model.unit is not None and decay.unit != model.unit:
            known = UNITS.get(model.unit)
            remedy = f"load the {word} with unit={model.unit!r}, or give"
            if known is None or known.base == decay.unit:  # records are in SI once they are read
                remedy = "give"
            raise ValueError(
                f"{word} {i} is in {decay.unit}, the model in {model.unit}: {remedy} the model's"
                f" coefficients for q in {decay.unit}"
            )
        if any(np.array_equal(decay.signal, other.signal) for other in everything[:i]):
            raise ValueError(
                f"{word} {i} is the same record as an earlier one: give it once, and hold out"
                " another"
            )


def forced_alone(measured: object) -> list[ForcedVibration]:
    """Forced vibrations, one or several, as a list; empty where there are none.

    Raises
    ------
    ValueError
        For decays among them.
    """
    driven, others = _of_kind(measured, ForcedVibration)
    if driven and others:
        raise ValueError(
            "measured holds forced vibrations and others: diagnose decays, and forced vibrations,"
            " one kind at a time"
        )
    return driven


def refuse_beside(what: str, instead: str, **given: object) -> None:
    """Refuse arguments that do not go with something, and say what to do instead.

    Raises
    ------
    ValueError
        By the name of the argument.
    """
    strange = [name for name, value in given.items() if value is not None]
    if strange:
        raise ValueError(f"{strange[0]} = ... does not go with {what}: leave it out, or {instead}")


def driven_of(name: str, given: object) -> list[ForcedVibration]:
    """Driven records of an argument beside driven ``measured``, one or several, as a list.

    Raises
    ------
    ValueError
        For decays, and for anything else.
    """
    found, others = _of_kind(given, ForcedVibration)
    if others:
        raise ValueError(
            f"{name} = a {type(others[0]).__name__} does not go with forced vibrations: give a"
            " ForcedVibration, with its inputs"
        )
    return found


def reduced(model: AnyModel | Beam) -> ReducedModel:
    """The model, if it is one that driven records can be compared with.

    Raises
    ------
    ValueError
        For a Beam, and for several coordinates.
    """
    if not isinstance(model, Beam) and model.n_coordinates == 1:
        model.refuse_memory("what is compared here")
        return cast(ReducedModel, model)
    beam = isinstance(model, Beam)
    remedy = "reduce it first, beam.reduce(...)" if beam else "give that of one coordinate"
    raise ValueError(
        f"model is a {type(model).__name__}, and forced vibrations are compared with a"
        f" ReducedModel: {remedy}"
    )


def check_inputs(
    model: ReducedModel, measured: Sequence[ForcedVibration], word: str = "record"
) -> None:
    """Raise a ValueError for a record without an input of the model."""
    for term in inputs_of(model):
        for i, v in enumerate(measured):
            if term.source not in v.names:
                raise ValueError(
                    f"the model is driven by {term.source!r}, and {word} {i} has {list(v.names)}:"
                    " give all inputs under the names of the model"
                )


def check_repeats(repeats: Sequence[Any]) -> None:
    """Raise a ValueError for fewer than two runs of a test, or one that is there twice."""
    if len(repeats) < 2:
        raise ValueError(f"repeats holds {len(repeats)} record: give two or more of the same test")
    if any(a.same_record(b) for i, a in enumerate(repeats) for b in repeats[:i]):
        raise ValueError("repeats holds a record twice: give each run of the test once")
