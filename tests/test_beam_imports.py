"""The beam stands alone: it knows the record and the equation, never the regression."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import romsindy.beam

FILES = sorted(Path(romsindy.beam.__file__).parent.rglob("*.py"))


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
    return names


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_arrows(path):
    names = imported(path)
    own = {n for n in names if n.startswith("romsindy")}
    allowed = ("romsindy.beam", "romsindy.decay", "romsindy.model", "romsindy.signals")
    assert all(n.startswith(allowed) for n in own), own
    assert not names & {"pysindy", "sklearn"}
    if path.name != "plotting.py":
        assert not any(n.startswith("matplotlib") for n in names)
