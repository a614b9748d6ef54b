"""The decks of the benchmark, and the mark of tests that need CalculiX."""

import importlib.util
import shutil
from pathlib import Path

import pytest

_PATH = Path(__file__).resolve().parents[1] / "benchmarks" / "decks.py"
_spec = importlib.util.spec_from_file_location("benchmark_decks", _PATH)
decks = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(decks)

needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="there is no CalculiX here (ccx): apt install calculix-ccx"
)
