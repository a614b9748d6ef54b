"""What README and docs put in back quotes is there: names, options, commands, files; and counts."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from functools import cache, cached_property
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import click
import pytest

import romsindy
import romsindy_study
from romsindy.commands.main import main

if find_spec("tomllib"):
    import tomllib
else:  # Python 3.10
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
BUILT = {DOCS / "changelog.md", DOCS / "effects" / "catalogue.md", DOCS / "pictures" / "page.md"}
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted({*DOCS.rglob("*.md")} - BUILT)]
PACKAGES = ("romsindy", "romsindy_study")
FOLDERS = (*PACKAGES, "benchmarks", "docs", "examples", "tests")
TREE = [path for folder in FOLDERS for path in (ROOT / folder, *(ROOT / folder).rglob("*"))]
# What a small name in the text stands for.
VARIABLES = {
    "band": ("ForcedBand", "Band"),
    "beam": ("Beam",),
    "decay": ("Decay",),
    "estimator": ("HarmonicSINDy",),
    "fit": ("Fit", "SteadyFit"),
    "found": ("Identification",),
    "inspection": ("Inspection",),
    "model": ("ReducedModel", "CoupledModel"),
    "report": (
        *("DiagnosisReport", "BeamReport", "ForcedReport", "InteractionReport"),
        "SimulatorReport",
    ),
}
# Of other packages, a coefficient, the reader's; and another command.
NOT_OURS = {"Axes", "Figure", "GridSearchCV", "ValueError", "Gamma", "MyEffect"}
OTHER_COMMAND = "jupyter"
FILES = ("csv", "html", "json", "npz", "toml")  # `beam.toml` is a file, no attribute of a beam
NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

each = pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))


def quoted(text: str) -> list[str]:
    """What stands in single back quotes, outside of fences; of a table "in 0.2" only the rest."""
    text = re.sub(r"^(```|~~~).*?^\1$", "", text, flags=re.S | re.M)
    text = re.sub(
        r"^\| in 0\.\d \|.*?\n\n",
        lambda table: re.sub(r"^\|[^|]*\|", "|", table[0], flags=re.M),
        text,
        flags=re.S | re.M,
    )
    return [" ".join(words.split()) for words in re.findall(r"(?<!`)`([^`]+)`(?!`)", text)]


def wrong(text: str) -> list[str]:
    """What a quoted text names that is not there."""
    words = text.split()
    lost = [f"no file {word}" for word in words if is_path(word) and not is_there(word)]
    lost += wrong_options(words)
    if (key := re.match(r"([a-z]\w*)=(?!=)", text)) and key[1] not in arguments():
        lost.append(f"nothing takes {key[1]}=")
    return lost + ([] if text.endswith(FILES) else [*wrong_names(text)])


# -- files ----------------------------------------------------------------------------------------


def is_path(word: str) -> bool:
    """Whether it is below a folder of ours, or ends as one, or is Python; not what users write."""
    return bool(re.fullmatch(rf"({'|'.join(FOLDERS)})/[\w./]*|[\w/]+(\.py|/)", word))


def is_there(word: str) -> bool:
    """In full or from any folder on: `romsindy/fit/verdict.py`, `fit/verdict.py`, `verdict.py`."""
    return any(path.as_posix().endswith("/" + word.rstrip("/")) for path in TREE)


# -- commands and options -------------------------------------------------------------------------


@cache
def options() -> dict[str, set[str]]:
    """Options of every command."""
    context = click.Context(main)
    commands = {name: main.get_command(context, name) for name in main.list_commands(context)}
    return {
        name: {option for p in command.get_params(context) for option in (*p.opts, "--help")}
        for name, command in commands.items()
    }


@cache
def of_benchmarks() -> set[str]:
    """Options of all benchmarks: rows of one of them have names of commands."""
    scripts = (path.read_text() for path in (ROOT / "benchmarks").rglob("*.py"))
    return {option for script in scripts for option in re.findall(r'"(--[a-z][\w-]*)"', script)}


def wrong_options(words: list[str]) -> list[str]:
    """Those that the command named before them lacks; without one, those that are nowhere."""
    if words[0] == OTHER_COMMAND:
        return []
    if words[0] == "romsindy" and len(words) > 1:
        if words[1] not in options():
            return [f"no command {words[1]}"]
        known = options()[words[1]]
    else:
        known = options().get(words[0], set().union(*options().values())) | of_benchmarks()
    asked = [word.split("=")[0] for word in words if re.match(r"--[a-z]", word)]
    return [f"no option {option}" for option in asked if option not in known]


# -- names of Python ------------------------------------------------------------------------------


@cache
def places() -> dict[str, list[str]]:
    """The modules in which a class or function is defined, by its name."""
    found: dict[str, list[str]] = {}
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for name in re.findall(r"^(?:class|def) (\w+)", path.read_text(), re.M):
            found.setdefault(name, []).append(module)
    return found


def defined(name: str) -> list[Any]:
    return [getattr(import_module(module), name) for module in places().get(name, ())]


@cache
def arguments() -> set[str]:
    """Names of all arguments of what is public and of its methods."""
    public = [getattr(romsindy, name) for name in romsindy.__all__]
    classes = [c for c in public if inspect.isclass(c) and not issubclass(c, Exception)]
    methods = [m for c in classes for _, m in inspect.getmembers(c, inspect.isroutine)]
    functions = [f for f in (*public, *methods) if inspect.isfunction(f) or inspect.ismethod(f)]
    return {name for f in (*classes, *functions) for name in inspect.signature(f).parameters}


def wrong_names(text: str) -> Iterator[str]:
    """In an expression of Python: `rs.x`, `romsindy.x`, `Class.x`, `fit.x`, `plot_it(...)`."""
    try:
        tree = ast.parse(text.removeprefix("python -m "), mode="eval")
    except SyntaxError:
        return  # a command, a formula, a sentence
    for node in ast.walk(tree):
        try:
            meant(node)
        except LookupError as error:
            yield str(error)


def meant(node: ast.AST) -> list[Any]:
    """What an expression of ours may be, instances by their classes; nothing if it is not ours.

    Raises
    ------
    LookupError
        If it should be there and is not.
    """
    if isinstance(node, ast.Name) and node.id not in NOT_OURS:
        return named(node.id)
    if isinstance(node, ast.Attribute):
        owners = meant(node.value)
        found = [member(owner, node.attr) for owner in owners if has(owner, node.attr)]
        if owners and not found:
            raise LookupError(f"no {ast.unparse(node)}")
        return [one for several in found for one in several]
    if isinstance(node, ast.Call):
        return called(node)
    return []


def named(name: str) -> list[Any]:
    if name in ("rs", *PACKAGES):
        return [romsindy_study if name == "romsindy_study" else romsindy]
    found = [cls for word in VARIABLES.get(name, (name,)) for cls in defined(word)]
    if not found and re.fullmatch(r"([A-Z][a-z]+)+", name):
        raise LookupError(f"no class {name}")
    return [one for one in found if name in VARIABLES or inspect.isclass(one)]


def called(node: ast.Call) -> list[Any]:
    """What a call returns."""
    if isinstance(node.func, ast.Name) and node.func.id in VARIABLES:
        return []  # `fit(x, t)`, the method of an estimator
    functions = meant(node.func)
    if isinstance(node.func, ast.Name) and re.fullmatch(r"[a-z]+_\w+", node.func.id):
        functions = defined(node.func.id)
        if not functions:
            raise LookupError(f"no function {node.func.id}")
    functions = [function for function in functions if callable(function)]
    keys = {key.arg for key in node.keywords}
    if functions and not any(takes(function, keys) for function in functions):
        raise LookupError(f"{ast.unparse(node.func)} does not take all of {sorted(keys)}")
    return [one for f in functions for one in ([f] if inspect.isclass(f) else typed(f, "return"))]


def takes(function: Any, keys: set[str | None]) -> bool:
    known = inspect.signature(function).parameters
    return keys <= {*known} or any(p.kind is p.VAR_KEYWORD for p in known.values())


def has(owner: Any, name: str) -> bool:
    """Whether a module has a name or module, or an instance of a class an attribute."""
    if isinstance(owner, ModuleType):
        return hasattr(owner, name) or find_spec(f"{owner.__name__}.{name}") is not None
    if not inspect.isclass(owner) or hasattr(owner, name):
        return hasattr(owner, name)
    ours = [cls for cls in owner.__mro__ if cls.__module__.startswith("romsindy")]
    return any(
        name in cls.__annotations__ or f"self.{name} = " in inspect.getsource(cls) for cls in ours
    )


def member(owner: Any, name: str) -> list[Any]:
    """What it is, an attribute of an instance by its class where that is ours."""
    if isinstance(owner, ModuleType):
        inside = f"{owner.__name__}.{name}"
        return [getattr(owner, name) if hasattr(owner, name) else import_module(inside)]
    value = inspect.getattr_static(owner, name, None)
    if isinstance(value, property):
        return typed(value.fget, "return")
    if isinstance(value, cached_property):
        return typed(value.func, "return")
    if callable(value) or isinstance(value, (classmethod, staticmethod)):
        return [getattr(owner, name)]
    return [one for cls in owner.__mro__ for one in typed(cls, name)]


def typed(owner: Any, name: str) -> list[Any]:
    """The classes of ours in an annotation."""
    words = re.findall(r"\w+", str(getattr(owner, "__annotations__", {}).get(name, "")))
    return [one for word in words for one in defined(word) if inspect.isclass(one)]


# -- tests ----------------------------------------------------------------------------------------


@each
def test_what_stands_in_back_quotes_is_there(path):
    assert [(text, why) for text in quoted(path.read_text()) if (why := wrong(text))] == []


@pytest.mark.parametrize(
    "text",
    [
        "fit.share",
        "adequacy_of(fit)",
        "rs.nothing",
        "romsindy.plotting",
        "Fit.problem",
        "fit.verdict.share",
        "LinearDamping()",
        "beam.simulate(dissipation=1)",
        "dissipation=1",
        "report.model.nothing",
        "romsindy identify --no-refine",
        "romsindy name",
        "--no-refine",
        "romsindy/fit/nothing.py",
        "nothing.py",
        "python benchmarks/nothing.py",
        "diagnosis/nothing/",
    ],
)
def test_what_is_not_there_is_seen(text):
    assert wrong(text)


@each
def test_what_stands_in_fences_is_there(path):
    """Names of `rs` and options of commands, also in what is not run."""
    wrong = []
    for fence in re.findall(r"^```.*?^```", path.read_text(), re.S | re.M):
        wrong += [name for name in re.findall(r"\brs\.(\w+)", fence) if not hasattr(romsindy, name)]
        commands = re.findall(r"^(?:\$ )?romsindy (.*)", fence.replace("\\\n", " "), re.M)
        for words in (["romsindy", *command.split()] for command in commands):
            if len(words) > 1 and re.fullmatch("[a-z]+", words[1]):
                wrong += wrong_options(words)
    assert wrong == []


@each
def test_as_many_notebooks_as_are_said(path):
    there = len([*(ROOT / "examples").rglob("*.ipynb")])
    said = re.findall(r"(\w+) notebooks\b", path.read_text().lower())
    assert {NUMBERS.index(word) for word in said if word in NUMBERS} <= {there}


def test_the_readme_of_an_index_has_no_relative_link():
    """By the substitutions of pyproject.toml, which make the long description of the wheel."""
    tools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]
    text = readme = (ROOT / "README.md").read_text()
    for one in tools["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]["substitutions"]:
        text = re.sub(one["pattern"], one["replacement"], text)
    links = re.compile(r"\]\(([^)]*)\)|\]\[|\b(?:href|src)=")
    whole = [link for link in links.findall(readme) if link.startswith("http")]
    assert links.findall(text) == whole and len(whole) > 1
    assert re.findall(r"^#+ .*", text, re.M) == re.findall(r"^#+ .*", readme, re.M)
