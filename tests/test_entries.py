"""Files of models with nonsense in any place: refused by name, without a word of Python."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import romsindy as rs
from romsindy.commands.main import main
from romsindy.commands.options import estimate_of, model_of

# A linear oscillator as `identify --save` writes it, by hand.
LINEAR = {"type": "Stiffness", "degree": 1, "odd": False}
VISCOUS = {"type": "PowerDamping", "exponent": 1.0}
FOUND: dict[str, Any] = {
    "terms": [
        {"name": "omega^2", "value": 36.0, **LINEAR},
        {"name": "c_linear", "value": 0.12, **VISCOUS},
    ],
    "unit": "m",
    "amplitude_range": [0.0, 0.5],
    "free": ["omega^2", "c_linear"],
    "covariance": [[0.0144, 6e-5], [6e-5, 1e-6]],
    "verdict": {
        "ratio": 1.0,
        "p_value": 0.5,
        "structure": 1.0,
        "below_floor": False,
        "amplitude": [0.5],
        "misfit": [[1.0, 1.0, 1.0, 1.0, "NaN", "NaN"]],
        "limit": 0.5,
        "unit": "m",
        "false_alarm": 0.01,
    },
    "notes": ["typed in"],
    "structures": [{"sizes": [1, 0, 0], "forces": ["Coulomb friction"], "log_evidence": 0.0}],
    "structure": 0,
    "richest": [LINEAR, VISCOUS],
    "samples": [[36.0, 0.12], [36.1, 0.121]],
    "widest": [[36.0, 0.12], [36.2, 0.122]],
    "reach": [-0.5, 0.5],
}
NESTED: dict[str, Any] = {
    "terms": [
        {"value": 36.0, "type": "Along", "law": LINEAR, "weights": [1.0, -1.0]},
        {"value": 1.0, "type": "MixedStiffness", "powers": [2, 1]},
        {"value": 1.0, "type": "MixedDamping", "row": 1, "column": 2, "powers": [1]},
        {"value": 1.0, "type": "SlavedInertia", "first": [2], "second": [1, 1]},
    ]
}
ONE: dict[str, Any] = {
    "terms": [
        {"value": 36.0, **LINEAR},
        {"value": 1.0, "type": "Inertia", "order": 3},
        {"value": 1.0, "type": "PositionDamping", "power": 2},
        {"value": 1.0, "type": "StopForce", "gap": 0.1, "side": 1, "exponent": 1.5},
        {"value": 1.0, "type": "Friction", "exponent": 0.0, "creep": 0.0},
        {
            "value": 1.0,
            "type": "Input",
            "source": "force",
            "interpolation": "linear",
            "delay": 0.0,
            "input_unit": "N",
            "lag": 0.0,
            "power": 1,
        },
        {
            "value": 1.0,
            "type": "Combination",
            "cause": "bending",
            "terms": [{"type": "Stiffness", "degree": 3, "odd": False}],
            "weights": [1.0],
        },
    ]
}
WRONG: list[Any] = [
    None,
    7.5,
    10**400,
    float("nan"),
    float("inf"),
    True,
    "x",
    [],
    [{}],
    {},
    {"x": 1},
    [[[1]]],
]
PYTHON = re.compile(
    r"None|object|__|argument|Error|attribute|unpack|subscript|class|\bdict|tuple|True"
    r"|not iterable|reshape|zip|unexpected|int\(|float\("
)
FREE = {"name"}  # says nothing that the type and its fields do not


def places(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every entry, whatever its depth; of a list of numbers the first."""
    if path:
        yield path
    if isinstance(content, dict):
        for key in sorted(content.keys() - FREE):
            yield from places(content[key], (*path, key))
    elif isinstance(content, list):
        some = content if content and isinstance(content[0], dict) else content[:1]
        for i, item in enumerate(some):
            yield from places(item, (*path, i))


def changed(content: Any, path: tuple[Any, ...], value: Any) -> str:
    """JSON text of the content with another value in one place."""
    content = inside = copy.deepcopy(content)
    for key in path[:-1]:
        inside = inside[key]
    inside[path[-1]] = value
    return json.dumps(content)


def fits(good: Any, value: Any, path: tuple[Any, ...]) -> bool:
    """Whether the value is of the kind of the good one, so that it may be taken."""
    if isinstance(good, bool) and value is True:
        return True
    if value is None:
        return path[-1] in ("unit", "input_unit", "amplitude_range")
    numbers = isinstance(good, int | float) and not isinstance(good, bool)
    if numbers or good == "NaN":
        return type(value) in (int, float)
    if value == [] and path[-1] in ("notes", "forces", "powers"):
        return True
    return value == "x" and path[-1] in ("notes", "cause", "unit", "input_unit", 0)


DIAGNOSE = ["diagnose", "--measured", "DIR/t.csv", "--model", "DIR/found.json"]
CASES = [(c, p) for c in (FOUND, NESTED, ONE) for p in places(c)]


@pytest.mark.parametrize(("content", "path"), CASES, ids=lambda x: ".".join(map(str, x))[:40])
def test_nonsense_is_refused_by_its_name(content: dict[str, Any], path: tuple[Any, ...]) -> None:
    """In every entry, every kind of JSON; what is of the right kind may be taken, or refused."""
    good: Any = content
    for key in path:
        good = good[key]
    names = [key for key in path if isinstance(key, str)]
    for value in WRONG:
        text = changed(content, path, value)
        try:
            estimate_of(text), model_of(text)
        except ValueError as error:
            named = names[-1] in str(error) or names[0] in str(error)
            assert named or "has no stiffness" in str(error), (value, error)
            assert not PYTHON.search(str(error)), (value, error)
        else:
            assert fits(good, value, path), value


@pytest.mark.parametrize(
    "key", ["richest", "samples", "widest", "structure", "structures", "reach"]
)
def test_files_are_refused_by_all_who_read_them(key: str, tmp_path: Path) -> None:
    """In Python with the name of the file and the key, on the command line with the exit code 2."""
    file = tmp_path / "found.json"
    file.write_text(changed(FOUND, (key,), {"x": 1}))
    message = rf"{key} = {{\.\.\.}} must be a"
    with pytest.raises(ValueError, match=rf"found\.json is no file of Identification.*{message}"):
        rs.Identification.load(file)
    (tmp_path / "t.csv").write_text("t,q\n0,1\n")
    for command in (["export", str(file), "--to", "text", "--short"], DIAGNOSE):
        done = CliRunner().invoke(main, [str(a).replace("DIR", str(tmp_path)) for a in command])
        assert done.exit_code == 2 and re.search(message, done.stderr), done.output


def test_the_file_by_hand_is_read_as_it_stands() -> None:
    found = estimate_of(json.dumps(FOUND))
    assert isinstance(found, rs.Identification) and found.reach == (-0.5, 0.5)
    assert found.interval("omega^2") == pytest.approx((36.0, 36.1), abs=0.01)
    for content in (NESTED, ONE):
        assert estimate_of(json.dumps(content)) is None
        model = model_of(json.dumps(content))
        assert model_of(model.to_json()) == model


@pytest.mark.parametrize("missing", sorted(FOUND.keys() - {"unit", "amplitude_range"}))
def test_what_is_missing_is_named(missing: str) -> None:
    content = {k: v for k, v in FOUND.items() if k != missing}
    with pytest.raises(ValueError, match=f"{missing}|holds no model"):
        rs.Identification.from_json(json.dumps(content))


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"x": 1}, "effects = "),
        ([3], r"effects\[0\] = 3 must be a table"),
        ([{"name": 1, "label": "a"}], r"effects\[0\]\.name = 1 must be a text"),
        ([{"name": "mass"}], r"effects\[0\] has no 'label'"),
    ],
)
def test_a_diagnosis_is_exported_or_refused(effects: Any, message: str, tmp_path: Path) -> None:
    (tmp_path / "d.json").write_text(json.dumps({"model": ONE, "effects": effects}))
    done = CliRunner().invoke(main, ["export", str(tmp_path / "d.json"), "--to", "text"])
    assert done.exit_code == 2 and re.search(message, done.stderr), done.output
