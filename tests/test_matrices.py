"""Matrices that CalculiX writes, read and refused: a program that writes what a test wants."""

import sys

import pytest

from romsindy.structure.calculix import CalculiX
from romsindy.structure.deck import Deck, DeckError
from romsindy.structure.linear import linear_modes

_DECK = """*NODE
1, 0, 0, 0
*ELEMENT, TYPE=MASS, ELSET=P
1, 1
*DENSITY
1.0
"""


def _program(folder, labels, stiffness, mass):
    """A program in the place of ccx, which writes these matrices ("row column value")."""
    files = {".dof": "\n".join(labels), ".sti": stiffness, ".mas": mass}
    script = folder / "solver"
    lines = [f"open(sys.argv[1] + {e!r}, 'w').write({t!r})" for e, t in files.items()]
    script.write_text(f"#!{sys.executable}\nimport sys\n" + "\n".join(lines) + "\n")
    script.chmod(0o755)
    (folder / "deck.inp").write_text(_DECK)
    return CalculiX(str(script)), Deck.load(folder / "deck.inp")


def _half(matrix):
    rows = range(len(matrix))
    return "\n".join(f"{i + 1} {j + 1} {matrix[i][j]}" for i in rows for j in rows if j >= i)


_ONE = [[float(i == j) for j in range(4)] for i in range(4)]


def test_half_a_matrix_is_made_whole(tmp_path):
    stiffness = [[2.0, -1.0], [-1.0, 3.0]]
    program, deck = _program(
        tmp_path, ["1.1", "1.2"], _half(stiffness), _half([[4.0, 0], [0, 5.0]])
    )
    found = program.matrices(deck)
    assert found.stiffness.toarray().tolist() == stiffness
    assert found.mass.diagonal().tolist() == [4.0, 5.0]
    assert (found.nodes.tolist(), found.directions.tolist()) == ([1, 1], [1, 2])


@pytest.mark.parametrize(
    ("labels", "mass", "words"),
    [
        (["1.1", "1.2", "1.1", "1.3"], _ONE, "counts freedoms of some nodes twice"),
        ([], _ONE, "no freedom is free"),
        (
            ["1.1", "1.2", "1.3", "2.1"],
            [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 0.0, 0], [0, 0, 0, 1.0]],
            "node 1 has no mass in direction 3: mass must be positive",
        ),
    ],
)
def test_matrices_of_no_structure_are_refused(tmp_path, labels, mass, words):
    program, deck = _program(tmp_path, labels, _half(_ONE), _half(mass))
    with pytest.raises(DeckError, match=words):
        program.matrices(deck)


def test_a_mass_that_is_not_positive_is_refused(tmp_path):
    """Its diagonal is, but two nodes together have a negative one: eigenvalues 3 and -1."""
    mass = [[1.0, 2.0, 0, 0], [2.0, 1.0, 0, 0], [0, 0, 3.0, 0], [0, 0, 0, 3.0]]
    stiffness = [[float(i + 1) if i == j else 0.0 for j in range(4)] for i in range(4)]
    labels = ["1.1", "1.2", "1.3", "2.1"]
    program, deck = _program(tmp_path, labels, _half(stiffness), _half(mass))
    with pytest.raises(DeckError, match=r"the mass is not positive: an eigenvalue is -0\.33 of"):
        linear_modes("deck.inp", program.matrices(deck), 2)
