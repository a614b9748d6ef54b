"""The decks and chains of the benchmarks, and the mark of tests that need CalculiX."""

import importlib.util
import shutil
from pathlib import Path

import pytest


def _benchmark(name):
    path = Path(__file__).resolve().parents[1] / "benchmarks" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"benchmark_{name}", path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


decks, structure_trials = _benchmark("decks"), _benchmark("structure_trials")

needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="there is no CalculiX here (ccx): apt install calculix-ccx"
)
