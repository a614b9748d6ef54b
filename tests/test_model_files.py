"""Files of models: one reader for all commands, which refuses at once and says why."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from romsindy import Beam
from romsindy.physics.coupled import model_from_json
from romsindy.physics.example import EXAMPLE_MODEL


def test_the_equation_of_a_file_is_shown_without_sympy(run, tmp_path, monkeypatch):
    """As text; what is made for other programs says what to install."""
    monkeypatch.setitem(sys.modules, "sympy", None)
    (tmp_path / "m.json").write_text(EXAMPLE_MODEL.to_json())
    result = run("export", "m.json", "--to", "text")
    assert result.exit_code == 0 and result.output == f"{EXAMPLE_MODEL}\n"
    result = run("export", "m.json", "--to", "c")
    assert result.exit_code == 2 and 'pip install "romsindy[export]"' in result.stderr


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"coefficients": {"omega^2": -5, "gamma_3": 3}}, r"omega\^2 = -5 must be positive"),
        ({"coefficients": {"omega^2": True}}, r"omega\^2 = true must be a finite number"),
        ({"coefficients": {"omega^2": "191"}}, r'omega\^2 = "191" must be a finite number'),
        ('{"coefficients": {"omega^2": 1, "omega^2": 2}}', r"gives 'omega\^2' twice"),
        ({"coefficients": {"omega^2": 1}, "unit": {"a": 1}}, r"unit = \{\.\.\.\} must be a text"),
        ({"coefficients": {"omega^2": 1, "gamma_99999999999": 1}}, r"order 1e\+11, beyond 100"),
        ({"coefficients": {"omega^2 [q300]": 1}}, "beyond q20, the last of a model"),
        ({"coefficients": {"omega^2 [q1]": 1, "V q1 q99999999999": 1}}, "beyond q20"),
        ({"coefficients": {f"k_above {i}": 1 for i in range(20000)}}, "1000 terms, .* has 20000"),
        ({"terms": [{"type": "Stiffness", "value": 1}] * 20000}, "1000 terms, .* has 20000"),
        (
            {"terms": [{"type": "Stiffness", "degree": 1e12, "odd": False, "value": 1}]},
            "beyond 100",
        ),
        ({"terms": [{"type": {"a": 1}, "value": 1}]}, r"terms\[0\]\.type = .* must be a text"),
        (
            {"coefficients": {"omega^2": 4}, "amplitude_range": ["a", 1]},
            r'amplitude_range\[0\] = "a" must be a',
        ),
        ({"coefficients": {}}, "the model has no stiffness"),
        ("[" * 100_000, "deeper than any model"),
    ],
)
def test_what_no_command_can_use_is_refused_by_all(run, tmp_path, content, message):
    """One reader: at once, with a sentence, and alike."""
    text = content if isinstance(content, str) else json.dumps(content)
    (tmp_path / "m.json").write_text(text)
    (tmp_path / "t.csv").write_text("t,q\n0,1\n")
    results = [
        run("export", "m.json", "--to", "text"),
        run("diagnose", "--measured", "t.csv", "--model", "m.json"),
    ]
    for result in results:
        assert result.exit_code == 2 and re.search(message, result.stderr), result.output
    assert results[0].stderr == results[1].stderr


def test_models_that_0_2_0_saved_move_as_they_did():
    """Of one coordinate, under inputs, of two: saved by 0.2.0, with accelerations by its code."""
    for row in json.loads((Path(__file__).parent / "models_of_0_2_0.json").read_text()):
        model = model_from_json(json.dumps(row["model"]))
        assert json.loads(model.to_json()) == row["model"]
        found = model.acceleration(np.array(row["q"]), np.array(row["q_dot"]))
        np.testing.assert_allclose(found, row["q_ddot"], rtol=1e-12)


@pytest.mark.parametrize("elements", [0, 100_000_000, True, 2.5])
def test_a_mesh_that_no_machine_holds_is_refused(elements):
    with pytest.raises(ValueError, match="elements must be a whole number from 1 to 10000, got"):
        Beam.cantilever(elements=elements)


def test_elements_of_commands_are_refused_with_the_limit(run, tmp_path):
    result = run("simulate", "b.csv", "--elements", 100_000_000)
    assert result.exit_code == 2 and "from 1 to 10000" in result.stderr
    (tmp_path / "beam.toml").write_text(
        '[beam]\nelements = 100000000\n[sensors]\npositions = [0.2]\ncolumns = ["a"]\n'
    )
    (tmp_path / "t.csv").write_text("t,a\n0,1\n")
    result = run("diagnose", "--measured", "t.csv", "--beam", "beam.toml")
    assert result.exit_code == 2 and "beam.toml: elements must be a whole" in result.stderr


def test_a_column_of_a_beam_is_told_by_the_file_that_names_it(run, tmp_path):
    (tmp_path / "beam.toml").write_text(
        '[beam]\nelements = 4\n[sensors]\npositions = [0.2]\ncolumns = ["bass"]\n'
    )
    (tmp_path / "t.csv").write_text("t,base\n0,1\n0.1,2\n0.2,1\n")
    result = run("diagnose", "--measured", "t.csv", "--beam", "beam.toml")
    assert result.exit_code == 2 and "--column" not in result.stderr
    assert "[sensors] columns in beam.toml: 'bass' is none of ['base']" in result.stderr
