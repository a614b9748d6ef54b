"""Pages: what is seen stands in words, equations are MathML, verdicts are banners."""

import re
from xml.etree import ElementTree

from romsindy import ReducedModel
from romsindy.physics.example import EXAMPLE_MODEL
from romsindy.show.axes import with_unit
from romsindy.show.page import Picture, write_page
from romsindy.text import TextTable


def draw(figure):
    left, right = figure.subplots(1, 2)
    left.plot([0, 1], [0, 1], label="measured")
    left.plot([0, 1], [1, 1], label="model")
    left.set(xlabel="time (s)", ylabel=with_unit("q", "kg^0.5 m"))
    right.set(title="empty", ylabel="damping ratio (%)")


def page_of(tmp_path, **content):
    path = tmp_path / "page.html"
    write_page(path, "report", "inspect", title="A page", sentence="One.\nTwo.", **content)
    return path.read_text(encoding="utf-8")


def test_texts_beside_images_say_what_is_seen(tmp_path):
    pictures = [Picture("name", "A figure", "Its caption.", draw)]
    page = page_of(tmp_path, tables=[], pictures=pictures)
    seen = "A figure; q (kg^1/2 m) against time (s): measured, model; empty damping ratio (%)"
    assert f'alt="{seen}"' in page and "<figcaption>Its caption.</figcaption>" in page


def test_equations_are_mathml_in_parts(tmp_path):
    """One element for each term, between which a line may end; well-formed, every number there."""
    (parts,) = EXAMPLE_MODEL.formulas()
    assert "".join(parts) == EXAMPLE_MODEL.latex()
    page = page_of(tmp_path, tables=[], equation="text", equation_title="E", formulas=[parts])
    elements = re.findall(r"<math.*?</math>", page, re.S)
    assert len(elements) == len(parts) == len(EXAMPLE_MODEL.terms) + 2
    texts = ["".join(ElementTree.fromstring(e).itertext()) for e in elements]
    for text, value in zip(texts[1:-1], EXAMPLE_MODEL.values, strict=True):
        assert f"{value:.4g}" in text
    assert "http" not in page  # self-contained, as it was


def test_powers_of_two_digits_stay_together():
    model = ReducedModel.from_coefficients({"omega^2": 1.0, "gamma_11": 2.0})
    assert r"q^{11}" in model.latex() and "q^11" in model.equation()


def test_verdicts_are_banners_and_long_pages_have_contents(tmp_path):
    rows = [["a", "b"], ["1", "–"]]
    tables = [TextTable(f"Table {i}", rows) for i in range(5)]
    page = page_of(tmp_path, verdict="ambiguous", tables=tables)
    assert '<div class="banner unsure"><b>ambiguous</b>One.<br>Two.</div>' in page
    for i in range(1, 6):
        assert f'<a href="#part-{i}">Table {i - 1}</a>' in page
        assert f'<h2 id="part-{i}">Table {i - 1}</h2>' in page
    assert page.count('<div class="frame" tabindex="0"><table>') == 5
    assert "<nav" not in page_of(tmp_path, tables=tables[:2])
