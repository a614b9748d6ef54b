"""Records that several tests share."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import pytest

import romsindy as rs

matplotlib.use("Agg")

_MEASURED = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def clean() -> rs.Decay:
    """The example oscillator with exact derivatives."""
    return rs.example_decay()


@pytest.fixture(scope="session")
def measured() -> Path:
    """Folder of the measured decays."""
    if not _MEASURED.is_dir():
        pytest.skip(f"measured decays are not at {_MEASURED.name}/ beside the project")
    return _MEASURED
