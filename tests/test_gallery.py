"""Every picture of the gallery is drawn by a short script of public names, with units."""

from __future__ import annotations

import ast
import re
from importlib import import_module
from pathlib import Path

import gallery
import matplotlib.pyplot as plt
import numpy as np
import pytest
from gallery import CONTENTS, SCRIPTS, Script, draw, page

import romsindy

DOCS = Path(gallery.__file__).parent
FILES = sorted(SCRIPTS.glob("*.py"))
MOST = 14  # lines of code, imports among them, before plt.show()
QUICK = {"beam", "comparison", "hysteresis", "laws_of_damping", "tongue"}
UNIT = re.compile(r".+ \([^()]+\)$")
WRITTEN = [p.read_text(encoding="utf-8") for p in DOCS.rglob("*.md") if "pictures" not in p.parts]
PLAIN = '"""Caption.\n\nWhat is seen.\n"""\n\nimport romsindy as rs\n\nrs.inspect\nplt.show()\n'


def wrong(text):
    """What is wrong with the text of a script, as far as reading tells."""
    tree = ast.parse(text)
    paragraphs = (ast.get_docstring(tree) or "").split("\n\n")
    if len(paragraphs) != 2 or not all(p.rstrip().endswith(".") for p in paragraphs):
        yield "no caption and a paragraph that says what is seen"
    code = text.splitlines()[tree.body[0].end_lineno :]
    code = [line for line in code if line.strip() and not line.lstrip().startswith("#")]
    if code[-1] != "plt.show()":
        yield "it does not end by showing"
    if len(code[:-1]) > MOST:
        yield f"{len(code) - 1} lines"
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "rs":
            if node.attr not in romsindy.__all__:
                yield f"rs.{node.attr} is not public"
        elif isinstance(node, ast.Attribute) and node.attr.startswith("_"):
            yield f"{node.attr} is not public"
        elif isinstance(node, ast.ImportFrom) and node.module.startswith("romsindy"):
            # Other rooms are public as far as the docs name them.
            if not any(node.module in page for page in WRITTEN):
                yield f"{node.module} is not in the docs"
            there = dir(import_module(node.module))
            names = [alias.name for alias in node.names]
            yield from (f"no public {n}" for n in names if n not in there or n.startswith("_"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_scripts_are_short_and_of_public_names(path):
    assert [*wrong(path.read_text(encoding="utf-8"))] == []


@pytest.mark.parametrize(
    "text",
    [
        PLAIN.replace("\n\nWhat is seen.", ""),
        PLAIN.replace("rs.inspect", "rs.nothing"),
        PLAIN.replace("rs.inspect", "rs.inspect.__wrapped__"),
        PLAIN.replace("rs.inspect", "from romsindy.show.compared import Compared"),
        PLAIN.replace("rs.inspect", "from romsindy.show.plots import plot_nothing"),
        PLAIN.replace("rs.inspect", "x = 1\n" * 14),
        PLAIN.replace("plt.show()", "plt.close()"),
    ],
)
def test_what_is_wrong_is_seen(text):
    assert [*wrong(PLAIN)] == []
    assert [*wrong(text)]


def unlabelled(figure):
    """Labels of axes without a unit, and whether no axes have units on both."""
    labels = [(ax.get_xlabel(), ax.get_ylabel()) for ax in figure.axes]
    bare = [text for pair in labels for text in pair if text and not UNIT.match(text)]
    return bare + ["no axes with units"] * (not any(x and y for x, y in labels))


def outside(figure):
    """Lines that leave their axes."""
    for ax in figure.axes:
        for line in ax.lines:
            for values, limits in zip(line.get_data(), (ax.get_xlim(), ax.get_ylim()), strict=True):
                low, high = sorted(limits)
                if np.nanmin(values) < low or np.nanmax(values) > high:
                    yield f"{line.get_label()}: {values} beyond {limits}"


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n not in QUICK)) for n in CONTENTS]
)
def test_pictures_have_units_and_nothing_leaves_their_axes(name):
    figure = Script.of(name).figure()
    try:
        assert unlabelled(figure) == []
        assert [*outside(figure)] == []
        assert any(ax.has_data() for ax in figure.axes)
    finally:
        plt.close("all")


def test_labels_without_units_and_lines_outside_are_seen():
    figure, ax = plt.subplots()
    ax.plot([0, 1], [0, 1])
    assert unlabelled(figure) == ["no axes with units"] and not [*outside(figure)]
    ax.set(xlabel="time (s)", ylabel="displacement", ylim=(0, 0.5))
    assert unlabelled(figure) == ["displacement"] and len([*outside(figure)]) == 1
    plt.close("all")


def test_the_page_has_every_script_once():
    assert len(CONTENTS) >= 12 and {path.stem for path in FILES} == CONTENTS.keys()
    text = page()
    for name, (title, more) in CONTENTS.items():
        script = Script.of(name)
        assert text.count(f"](pictures/{name}.svg)") == 1 and f"## {title}\n" in text
        assert script.code in text and script.caption in text and text.count(script.seen) == 2
        assert (DOCS / more).exists()


def test_as_many_pictures_as_are_said():
    said = re.findall(r"(\w+) (?:more )?pictures, each", " ".join(WRITTEN))
    assert [*map(str.lower, said)] == ["fifteen"] * 2 and len(CONTENTS) == 15


def test_a_picture_is_written(tmp_path):
    assert draw("laws_of_damping", tmp_path / "new") < 20
    text = (tmp_path / "new" / "laws_of_damping.svg").read_text(encoding="utf-8")
    assert text.startswith("<?xml") and "</svg>" in text and not plt.get_fignums()
