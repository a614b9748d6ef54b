"""Imports run one way, and the README tells the truth."""

import ast
import doctest
import importlib
import re
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter

import house
import pytest
from house import HOUSE, MODULES, PACKAGE, ROOT, arrows, imported, room

import romsindy

# The rooms in the order of the data flow: each imports from those before it, never from those
# after it. `beam` is beside `fit`: neither knows the other, nor `regression`, which for several
# coordinates starts from the records of a fit. `show` draws arrays, models and fits; a diagnosis
# and an inspection have pages of their own drawn by it; `notebook` is how any of them shows itself.
# Applications, such as `romsindy_study`, stand beside the package: no room knows them.
ROOMS = [
    {"text", "typing"},
    {"notebook"},
    {"record"},
    {"physics"},
    {"orbits", "simulator"},
    {"effects", "structure"},
    {"beam", "fit"},
    {"regression"},
    {"show"},
    {"diagnosis", "inspection"},
    {"commands"},
]
MOST_PACKAGES, MOST_MODULES, LONGEST_CHAIN = 13, 5, 11


def test_rooms_are_few():
    packages = {p.parent.name for p in PACKAGE.glob("*/__init__.py")}
    modules = {p.stem for p in PACKAGE.glob("*.py")}
    assert len(packages) <= MOST_PACKAGES and len(modules) <= MOST_MODULES
    known = set().union(*ROOMS)
    assert packages | (modules - {"__init__", "__main__"}) == known


@pytest.mark.parametrize("measure", HOUSE, ids=lambda measure: measure.what)
def test_the_house_gets_no_worse(measure):
    """A ratchet: who makes a number smaller writes the new one into `house.py`."""
    assert measure.goal <= measure.ceiling
    assert measure.measure() <= measure.ceiling, "python tests/house.py says where"


def test_floors_are_counted_by_files_and_subfolders(monkeypatch):
    """a > s.one > s.two > b: four files, three floors; what lies in another room is none."""
    ways = {"a": ["s.one"], "s.one": ["s.two"], "s.two": ["b"], "b": []}
    graph = {f"romsindy.toy.{m}": {f"romsindy.toy.{n}" for n in to} for m, to in ways.items()}
    graph["romsindy.toy.b"] = {"romsindy.other.c"}
    monkeypatch.setattr(house, "arrows", lambda module: graph.get(module, set()))
    assert house.floors("romsindy.toy.a") == 3
    assert house.chain("romsindy.toy.a") == 5


@pytest.mark.parametrize("module", MODULES)
def test_imports_run_one_way(module):
    """From room to room in the order of the data flow."""
    floor = {name: i for i, rooms in enumerate(ROOMS) for name in rooms}
    own = room(module)
    for other in {room(n) for n in arrows(module)} - {own}:
        assert floor[other] < floor[own], f"{module} imports from {other}"


def test_no_circle_of_imports():
    """Between files, inside packages too; a package's own front page may import all of it."""
    sorter = TopologicalSorter(
        {m: {n for n in arrows(m) if not m.startswith(f"{n}.")} for m in MODULES}
    )
    try:
        sorter.prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(reversed(error.args[1])))


def test_the_chain_of_rooms_is_short():
    rooms = {}
    for module in MODULES:
        own = room(module)
        rooms.setdefault(own, set()).update({room(n) for n in arrows(module)} - {own})

    @cache
    def floors(name):
        return 1 + max((floors(other) for other in rooms.get(name, ())), default=0)

    assert max(map(floors, rooms)) <= LONGEST_CHAIN


def test_only_show_knows_matplotlib():
    knowing = {room(m) for m in MODULES if any(n.startswith("matplotlib") for n in imported(m))}
    assert knowing <= {"show"}


def test_models_and_signals_know_no_regression():
    """A ReducedModel holds no PySINDy object; only the regression side imports it."""
    hosts = {"pysindy", "sklearn"}
    knowing = {room(m) for m in MODULES if {n.split(".")[0] for n in imported(m)} & hosts}
    assert knowing <= {"regression"}


def test_no_room_knows_the_applications():
    """They are found by their entry points, as any package's command is."""
    assert not [m for m in MODULES for n in imported(m) if n.startswith("romsindy_")]


def test_what_is_not_needed_is_not_imported():
    """A fit needs no compiler, no figures and no beam, and the package by itself nothing."""
    code = """
import sys, romsindy as rs
assert "numpy" not in sys.modules
rs.HarmonicSINDy().fit(rs.example_decay())
names = {"matplotlib", "numba", "romsindy.beam", "romsindy.diagnosis"}
sys.exit(str(names & {*sys.modules}) if names & {*sys.modules} else 0)
"""
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_laws_are_known_by_name_whatever_was_imported():
    """A model is read in a new interpreter, where nothing else has asked for its laws."""
    code = """
import romsindy as rs
laws = {"omega^2": 36.0, "c_coulomb": 0.1, "gain [force]": 1.0, "Upsilon_3": 0.5}
rs.ReducedModel.from_coefficients(laws)
laws = {f"{name} [q1]": value for name, value in laws.items() if not name.startswith("gain")}
rs.CoupledModel.from_coefficients({**laws, "omega^2 [q2]": 40.0, "V q1^2 q2": 1.0})
"""
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_public_names_exist_once():
    assert len(set(romsindy.__all__)) == len(romsindy.__all__)
    for name in romsindy.__all__:
        assert getattr(romsindy, name).__doc__, name
    assert {*romsindy.__all__} <= {*dir(romsindy)}
    with pytest.raises(AttributeError, match="has no attribute 'Decaye'"):
        romsindy.Decaye  # noqa: B018
    assert callable(romsindy.beam.Beam)  # a room, without an import of its own


def test_names_that_left_the_root_say_where_they_are():
    for name, place in romsindy._MOVED.items():
        with pytest.raises(AttributeError, match=f"romsindy.{name} is now {re.escape(place)}"):
            getattr(romsindy, name)
        if re.fullmatch(r"romsindy(\.\w+)+", place):
            module, _, own = place.rpartition(".")
            assert own == name and getattr(importlib.import_module(module), own).__doc__


def test_type_checkers_see_the_public_names():
    """`__init__.pyi` says where the late imports come from."""
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))
    imports = [n for n in stub.body if isinstance(n, ast.ImportFrom)]
    seen = {alias.asname: (n.module, alias.name) for n in imports for alias in n.names}
    assert sorted(seen) == romsindy.__all__
    for name, (module, own) in seen.items():
        assert getattr(importlib.import_module(module), own) is getattr(romsindy, name)


@pytest.mark.parametrize("module", MODULES)
def test_examples_in_docstrings_run(module):
    results = doctest.testmod(importlib.import_module(module))
    assert results.failed == 0


def test_every_public_name_has_an_example():
    lacking = [n for n in romsindy.__all__ if ">>>" not in (getattr(romsindy, n).__doc__ or "")]
    assert not lacking, f"no example in the docstring of {', '.join(lacking)}"


def test_versions_agree():
    project = (ROOT / "pyproject.toml").read_text()
    assert f'version = "{romsindy.__version__}"' in project
    assert f"version: {romsindy.__version__}" in (ROOT / "CITATION.cff").read_text()
    assert f"## {romsindy.__version__}" in (ROOT / "CHANGELOG.md").read_text()
    pinned = (ROOT / "examples" / "pysindy" / "requirements.txt").read_text()
    assert pinned.strip() == f"romsindy=={romsindy.__version__}"


def test_ci_runs_the_readme():
    """.ci/run takes the test command from between the README's markers."""
    readme = (ROOT / "README.md").read_text()
    block = re.search(r"<!-- test command -->\n```sh\n(.*?)```", readme, re.S)
    assert "pytest" in block[1] and "pip install" in block[1]
    run = (ROOT / ".ci" / "run").read_text()
    steps = ["<!-- test command -->", "ruff check", "ruff format --check", "bin/mypy"]
    places = [run.index(step) for step in steps]
    assert places == sorted(places)
