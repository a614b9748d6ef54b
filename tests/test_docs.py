"""The sources of the documentation name only what exists; the build itself is in .ci/run."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from catalogue import described, page
from fingerprint import averaged, fingerprint
from latex2mathml.converter import convert

import romsindy
from romsindy.effects import (
    BEAM_CATALOGUE,
    CATALOGUE,
    AirDrag,
    CubicStiffness,
    DryFriction,
    MicroSlip,
    NonlinearInertia,
    QuadraticStiffness,
    Viscoelastic,
)

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
EFFECTS = (*CATALOGUE, *BEAM_CATALOGUE)

each = pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(DOCS)))


def test_the_api_lists_every_public_name_once():
    blocks = re.findall(r":toctree: api\n\n(.*?)```", (DOCS / "api.md").read_text(), re.S)
    names = " ".join(blocks).split()
    assert sorted(name for name in names if "." not in name) == romsindy.__all__
    moved = {place for place in romsindy._MOVED.values() if re.fullmatch(r"romsindy[\w.]+", place)}
    assert {f"romsindy.{name}" for name in names if "." in name} == moved


def test_the_page_of_effects_has_them_all_with_their_advice():
    text = page()
    for effect in EFFECTS:
        section = text[text.index(f"({type(effect).__name__.lower()})=") :]
        assert effect.label[1:] in section and effect.advice in section
        assert {*effect.resembles} <= {e.name for e in EFFECTS}
    targets = re.findall(r"\]\(#(\w+)\)", text)
    assert {*targets} == {*re.findall(r"^\((\w+)\)=", text, re.M)}


def jenkins(a, slip=0.4):
    """Spring in series with a slider: its mean stiffness, and 4 slip (a - slip) lost in a cycle."""
    angle = np.arccos(max(1 - 2 * slip / a, -1.0))
    stiffness = (angle - np.sin(angle) * np.cos(angle)) / np.pi
    return stiffness / 2, 2 * slip * max(a - slip, 0.0) / (np.pi * a**2)


# Krylov and Bogoliubov's averages in closed form, at amplitude a, 1 rad/s and strength 1.
CLOSED = [
    (CubicStiffness(), lambda a: (3 / 8 * a**2, 0)),
    (NonlinearInertia(), lambda a: (-(a**2) / 4, 0)),
    (AirDrag(), lambda a: (0, 4 * a / (3 * np.pi))),
    (DryFriction(), lambda a: (0, 2 / (np.pi * a))),
    (MicroSlip(slip=0.4), jenkins),
    (Viscoelastic(relaxation=1.0), lambda a: (1 / 4, 1 / 4)),  # i / (1 + i) in series
]


@pytest.mark.parametrize("effect, exact", CLOSED, ids=lambda x: getattr(x, "name", ""))
def test_fingerprints_against_closed_forms(effect, exact):
    for a in (0.2, 0.9):
        # A jump or kink within a sample: squared, 1 / 1440 of the cycle.
        assert averaged(effect, a) == pytest.approx(exact(a), rel=1e-5, abs=1e-12)


def test_what_has_no_fingerprint():
    """An even force moves the mean; a fault of the sensor is no force."""
    assert fingerprint(QuadraticStiffness()) is None
    assert not [e.name for e in CATALOGUE if e.family == "measurement" and fingerprint(e)]
    seen = described(fingerprint(DryFriction()))
    assert seen == "Frequency: no change. Damping ratio: up, more at small amplitudes."


@each
def test_names_of_the_package_exist(path):
    """`rs.NAME` and commands of benchmarks in fences; `test_docs_names` has what is in quotes."""
    text = path.read_text()
    assert {*re.findall(r"\brs\.(\w+)", text)} <= {*dir(romsindy), *romsindy._MOVED}
    files = re.findall(r"\bpython (benchmarks/[\w/.]+\.py)", text)
    assert all((ROOT / file).exists() for file in files)


@each
def test_formulas_are_set(path):
    """What the converter does not know it leaves as it stands, with its backslash."""
    text = re.sub(r"^```.*?^```", "", path.read_text(), flags=re.S | re.M)
    formulas = re.findall(r"\$\$(.*?)\$\$", text, re.S)
    formulas += re.findall(r"\$([^$`]+)\$", re.sub(r"\$\$.*?\$\$", "", text, flags=re.S))
    assert [tex for tex in formulas if "\\" in convert(tex)] == []
