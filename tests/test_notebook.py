"""What a notebook shows of models and results, and curves as data frames."""

import re
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

import romsindy as rs
from romsindy.fit.results.estimate import Curve
from romsindy.inspection.tables import summary, tables
from romsindy.physics.example import EXAMPLE_MODEL

COUPLED = rs.CoupledModel.from_coefficients(
    {"omega^2 [q1]": 100.0, "omega^2 [q2]": 900.0, "V q1^2 q2^2": 40.0}, unit="m"
)


def parts_of(html):
    """Formulas as text, rows of the table, and sentences; well-formed, or this raises."""
    page = ElementTree.fromstring(f"<div>{html.replace('<wbr>', '').replace('<br>', ' ')}</div>")
    formulas = ["".join(p.itertext()) for p in page.iter("p") if p.find("math") is not None]
    rows = [["".join(cell.itertext()) for cell in row] for row in page.iter("tr")]
    return formulas, rows, [*page.iter("p")][-1].text


@pytest.mark.parametrize("model", [EXAMPLE_MODEL, COUPLED], ids=["one", "two"])
def test_a_model_is_its_equations_and_its_coefficients(model):
    formulas, rows, sentence = parts_of(model._repr_html_())
    assert len(formulas) == model.n_coordinates
    assert all(f.endswith("=0") for f in formulas)
    assert {key: float(value) for key, value, _ in rows[1:]} == pytest.approx(
        model.coefficients,
        rel=1e-5,  # six digits are shown
    )
    for term, row in zip(model.terms, rows[1:], strict=True):
        assert row[2] == term.unit(model.unit)
    assert "t in s" in sentence
    assert model.latex() in model._repr_latex_()


def test_an_estimate_has_errors_and_its_verdict():
    fit = rs.refine(EXAMPLE_MODEL, rs.example_decay(50.0, periods=20))
    formulas, rows, sentence = parts_of(fit._repr_html_())
    assert len(formulas) == 1 and rows == fit.table()
    assert sentence.startswith(str(fit.verdict))


def test_columns_of_a_curve_become_a_frame():
    pytest.importorskip("pandas", reason="pandas is not installed")
    backbone = rs.extract_backbone(rs.example_decay(periods=20))
    frame = backbone.to_frame()
    assert len(frame) == len(backbone) and {*frame.attrs["units"]} == {*frame}
    assert frame.attrs["units"]["amplitude"] == backbone.unit == "m"
    assert frame.attrs["units"]["frequency_std"] == "rad/s"
    for name in frame:
        np.testing.assert_array_equal(frame[name], getattr(backbone, name))
    arrays = {name for name, value in vars(backbone).items() if isinstance(value, np.ndarray)}
    assert {*frame} == arrays
    x = np.arange(3.0)
    assert [*Curve(x, x, x - 1, x + 1).to_frame()] == ["q", "value", "low", "high"]


def test_several_coordinates_have_a_column_each():
    pytest.importorskip("pandas", reason="pandas is not installed")
    curve = rs.backbone_curve(COUPLED, (0.01, 0.05), n_points=5)
    frame = curve.to_frame()
    np.testing.assert_array_equal(frame[["amplitude_1", "amplitude_2"]], curve.amplitude)
    assert frame["stable"].dtype == bool
    response = rs.forced_response(EXAMPLE_MODEL, 0.01, frequency=(0.9, 1.1), n_points=20)
    assert [*response.to_frame()] == ["frequency", "amplitude", "residual", "stable"]


def test_without_pandas_the_remedy_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ValueError, match=re.escape("run pip install pandas")):
        rs.extract_backbone(rs.example_decay(periods=20)).to_frame()


def test_an_inspection_is_its_tables():
    seen = rs.inspect(rs.example_decay(40.0, periods=20))
    _, rows, sentence = parts_of(f"<div>{seen._repr_html_()}</div>")
    assert rows == [[*row] for table in tables(seen) for row in table.rows]
    assert len(seen.modes) == 1 and sentence == summary(seen)
