"""How the house stands, in numbers: ``python tests/house.py`` prints them beside their goals.

``tests/test_architecture.py`` keeps each from getting worse.
"""

from __future__ import annotations

import ast
import pkgutil
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import romsindy

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "romsindy"
MODULES = sorted(
    m.name
    for m in pkgutil.walk_packages(romsindy.__path__, "romsindy.")
    if "__main__" not in m.name
)
MODELS = {"ReducedModel", "CoupledModel"}
RECORDS = {"Decay", "ForcedVibration", "Recording"}
PREPARED = {"Record", "ForcedRecord", "CoupledRecord", "Prepared"}


class Measure(NamedTuple):
    """A number of the house: what it is, how it is measured, what it is at most, and the goal."""

    what: str
    measure: Callable[[], int]
    ceiling: int
    goal: int


# -- imports --------------------------------------------------------------------------------------


def file_of(module: str) -> Path | None:
    """The file of a module, or None where there is no such module."""
    path = ROOT.joinpath(*module.split("."))
    for candidate in (path.with_suffix(".py"), path / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None


@cache
def imported(module: str) -> set[str]:
    """Modules that a module imports anywhere in its text: late, and for typing only, too."""
    found = set()
    for node in ast.walk(tree(file_of(module))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            # `from package import module` is an import of the module.
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                own = node.module.startswith("romsindy") and file_of(inner) is not None
                found.add(inner if own else node.module)
    return found


def arrows(module: str) -> set[str]:
    """Modules of the package that a module imports."""
    return ({n for n in imported(module) if n in MODULES}) - {module}


def room(module: str) -> str | None:
    """The package or module at the root that a module is in; the root itself has none."""
    return module.split(".")[1] if "." in module else None


def corner(module: str) -> str:
    """The file or subfolder of a room that a module is in."""
    return ".".join(module.split(".")[:3])


@cache
def chain(module: str) -> int:
    """Files in the longest chain of imports from a module on."""
    return 1 + max((chain(n) for n in arrows(module) if not module.startswith(f"{n}.")), default=0)


@cache
def floors(module: str) -> int:
    """Files and subfolders of its own room in the longest chain of imports from a module on."""
    inside = {n for n in arrows(module) if room(n) == room(module) and n.count(".") > 1}
    below = ((corner(n) != corner(module)) + floors(n) - 1 for n in inside)
    return 1 + max(below, default=0)


def floors_inside(name: str) -> int:
    """The longest chain of imports inside a room; its front page, which has all of it, aside."""
    return max(floors(m) for m in MODULES if room(m) == name and m.count(".") > 1)


def longest_chain_of_files() -> int:
    return max(map(chain, MODULES))


# -- text -----------------------------------------------------------------------------------------


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def files() -> list[Path]:
    """Those of the package."""
    return sorted(PACKAGE.rglob("*.py"))


def lines() -> int:
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files())


def kind_switches() -> Iterator[str]:
    """Where ``isinstance`` asks for the kind of a model or a record, outside of physics."""
    for path in files():
        if path.parent.name == "physics":
            continue
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance":
                asked = {n.id for n in ast.walk(node.args[1]) if isinstance(n, ast.Name)}
                if asked & (MODELS | RECORDS | PREPARED):
                    yield f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}"


def classes_defined_twice() -> list[str]:
    """Names of classes that stand in more than one file; an underscore makes no other name."""
    found = Counter(
        node.name.lstrip("_")
        for path in files()
        for node in tree(path).body
        if isinstance(node, ast.ClassDef)
    )
    return sorted(name for name, times in found.items() if times > 1)


# What is there now, and where the house goes: a ceiling comes down with what it measures.
FLOORS = {path.parent.name: 7 for path in sorted(PACKAGE.glob("*/__init__.py"))}
HOUSE = [
    *(
        Measure(f"floors inside {n}", partial(floors_inside, n), most, 7)
        for n, most in FLOORS.items()
    ),
    Measure("files in the longest chain of imports", longest_chain_of_files, 17, 16),
    Measure("isinstance on a kind of model or record", lambda: len([*kind_switches()]), 0, 0),
    Measure("classes defined twice", lambda: len(classes_defined_twice()), 0, 0),
    Measure("lines", lines, 67_636, 40_000),
    Measure("files", lambda: len(files()), 220, 220),
    Measure("public names", lambda: len(romsindy.__all__), 46, 46),
]


def main() -> None:
    """Print the numbers, the longest chain, and where kinds are asked for."""
    for what, measure, ceiling, goal in HOUSE:
        print(f"{what:<40} {measure():>7,}   at most {ceiling:>7,}   goal {goal:>7,}")
    top = max(MODULES, key=chain)
    path = [top]
    while below := [n for n in arrows(path[-1]) if not path[-1].startswith(f"{n}.")]:
        path.append(max(below, key=chain))
    print("longest chain:", " > ".join(m.removeprefix("romsindy.") for m in path))
    print("defined twice:", ", ".join(classes_defined_twice()))
    print("kinds asked for:", *kind_switches(), sep="\n  ")


if __name__ == "__main__":
    main()
