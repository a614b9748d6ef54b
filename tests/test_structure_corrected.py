"""A deck with what was found, read and run again."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from solid_decks import decks, needs_ccx

import romsindy as rs
from romsindy.commands.main import main
from romsindy.physics.damping import PowerDamping
from romsindy.physics.stiffness import Stiffness
from romsindy.simulator.force import LawForce
from romsindy.structure.deck import Deck, DeckError
from romsindy.structure.linear import Units
from romsindy.structure.parts import Correction, corrected_deck

K, K3 = 2e3, 5e7  # N/m, N/m^3


@pytest.fixture(scope="module")
def deck(tmp_path_factory):
    """A shallow arch with a step and comments of its own, and the node that moves most."""
    path = decks.arch(tmp_path_factory.mktemp("arch") / "arch.inp", 0.001, (8, 2, 1))
    path.write_text(path.read_text() + "** my own comment\n*STEP\n*STATIC\n*END STEP\n")
    places = np.array([*Deck.load(path).nodes.values()])
    node = int(np.argmin(np.abs(places - [0.15, 0.0, 0.001]).sum(axis=1))) + 1
    return Deck.load(path), node


def _found(node, **changes):
    usual = {"spring": None, "reach": 2e-3, "mass": 0.0, "modulus": 1.0}
    usual |= {"density": 1.0, "parts": {}, "remarks": ["why"]}
    return Correction(node, 3, **{**usual, **changes})


def _written(deck, found, path, units=None):
    path.write_text(corrected_deck(deck, found, units or Units()))
    return path


def test_what_is_not_changed_stays_as_it_stands(deck, tmp_path):
    """Comments and steps too; the cards of the spring stand before the first step."""
    original, node = deck
    path = _written(original, _found(node, spring=lambda x: -K * x), tmp_path / "c.inp")
    text = path.read_text()
    added = [line for line in text.splitlines() if line not in original.lines]
    assert text.index("my own comment") < text.index("SPRING1") < text.index("*STEP")
    assert "** romsindy: why" in added
    kept = [line for line in text.splitlines() if line in original.lines]
    assert kept == original.lines


def test_materials_are_multiplied_under_a_comment(deck, tmp_path):
    original, node = deck
    found = _found(node, modulus=1.04, density=0.98)
    again = Deck.load(_written(original, found, tmp_path / "c.inp"))
    (elastic,), (density,) = again.of("ELASTIC"), again.of("DENSITY")
    assert [float(f) for f in next(elastic.fields())] == pytest.approx([2.184e11, 0.3])
    assert float(next(density.fields())[0]) == pytest.approx(7644)
    assert "** romsindy: 1.04 times as large" in (tmp_path / "c.inp").read_text()


def test_a_part_is_multiplied_beside_all_of_the_deck(deck, tmp_path):
    """A material that was multiplied twice is still one."""
    original, node = deck
    found = _found(node, modulus=1.04, density=0.98, parts={"modulus of SOLID": 0.9})
    again = Deck.load(_written(original, found, tmp_path / "c.inp"))
    for name, known, value in (("ELASTIC", 2.184e11, 0.9), ("DENSITY", 7644.0, 1.0)):
        said = [float(next(card.fields())[0]) for card in again.of(name)]
        assert said == pytest.approx([known, value * known])


def test_a_spring_is_in_the_units_of_the_deck(deck, tmp_path):
    """2000 N/m are 2 N/mm; a deck in mm and t counts forces in N."""
    original, node = deck
    path = _written(
        original, _found(node, spring=lambda x: -K * x), tmp_path / "c.inp", Units(1e-3, 1e3)
    )
    (card,) = Deck.load(path).of("SPRING")
    direction, stiffness = card.data
    assert direction == "3" and float(stiffness) == pytest.approx(2.0, rel=1e-9)


def test_what_is_included_stands_in_the_corrected_deck(deck, tmp_path):
    original, node = deck
    head, _, rest = original.path.read_text().partition("*MATERIAL")
    (tmp_path / "m.inc").write_text("*MATERIAL" + rest.partition("*STEP")[0])
    (tmp_path / "main.inp").write_text(head + "*INCLUDE, INPUT=m.inc\n")
    text = corrected_deck(Deck.load(tmp_path / "main.inp"), _found(node, modulus=1.1), Units())
    (tmp_path / "whole.inp").write_text(text)
    (elastic,) = Deck.load(tmp_path / "whole.inp").of("ELASTIC")
    assert "INCLUDE" not in text and float(next(elastic.fields())[0]) == pytest.approx(2.31e11)


@needs_ccx
def test_the_corrected_deck_has_the_spring(deck, tmp_path):
    """omega^2 grows by k phi^2 at first order, K by the work of the cubic spring."""
    original, node = deck
    plain = rs.Structure.from_calculix(original.path, progress=False)
    phi = plain.shapes[0][plain.freedom(node, 3)]
    linear = _written(original, _found(node, spring=lambda x: -K * x), tmp_path / "k.inp")
    stiffer = rs.Structure.from_calculix(linear, progress=False)
    # The mode gives way to the spring by a little: to second order in what it adds.
    grown = stiffer.omega[0] ** 2 - plain.omega[0] ** 2
    assert grown == pytest.approx(K * phi**2, rel=0.02)
    cubic = _written(original, _found(node, spring=lambda x: -K3 * x**3), tmp_path / "k3.inp")
    bent = rs.Structure.from_calculix(cubic, progress=False)
    assert bent.omega[0] == pytest.approx(plain.omega[0], rel=2e-3)  # a table has a slope at rest
    reach, row = 1.5e-3, plain.freedom(node, 3)
    curve = plain.static_curve(1, reach).curve
    more = bent.reduce(1, reach).model, plain.reduce(1, reach).model
    q = np.array([0.8 * reach / phi])
    # The node follows the mode as it bends: x_p(q), and the work of the spring along it.
    x = curve.shapes_at(q)[0, row]
    slope = phi + curve.following_at(q, slope=True)[0, row]
    pull = more[0].stiffness(q) - more[1].stiffness(q)
    assert pull[0] == pytest.approx(K3 * x**3 * slope, rel=0.01)


@needs_ccx
def test_the_corrected_deck_has_the_mass(deck, tmp_path):
    """omega^2 falls by 1 + m phi^2, by Rayleigh's quotient of the mode as it was."""
    original, node = deck
    plain = rs.Structure.from_calculix(original.path, progress=False)
    phi = plain.shapes[0][plain.freedom(node, 3)]
    written = _written(original, _found(node, mass=2e-3), tmp_path / "m.inp")
    heavier = rs.Structure.from_calculix(written, progress=False)
    ratio = plain.omega[0] ** 2 / heavier.omega[0] ** 2
    assert ratio - 1 == pytest.approx(2e-3 * phi**2, rel=0.02)
    in_t = _written(original, _found(node, mass=2e-3), tmp_path / "t.inp", Units(1e-3, 1e3))
    (card,) = Deck.load(in_t).of("MASS")
    assert float(card.data[0]) == pytest.approx(2e-6, rel=1e-9)


@needs_ccx
def test_the_corrected_deck_has_values_of_parts(deck, tmp_path):
    """The frequency is that of the deck with these values; all that was changed is said."""
    original, node = deck
    path, plain = tmp_path / "p.inp", rs.Structure.from_calculix(original.path, progress=False)
    values = {"modulus of SOLID": 1.1, "clamp of HELD": 2e-11}
    _written(original, _found(node, parts=values), path)
    softer = plain.varied("clamp of HELD", 2e-11).varied("modulus of SOLID", 1.1)
    again = rs.Structure.from_calculix(path, progress=False)
    assert again.omega[0] == pytest.approx(softer.omega[0], rel=1e-6)
    assert abs(again.omega[0] / plain.omega[0] - 1) > 0.01
    text = path.read_text()
    assert "** romsindy: 1.1 times as large" in text
    assert "** romsindy: HELD is held by springs, direction 1" in text


def test_moved_nodes_stand_in_the_corrected_deck(deck, tmp_path):
    """Also those of a file that it includes, under a comment that says what and how much."""
    original, node = deck
    nodes, _, rest = original.path.read_text().partition("*ELEMENT")
    (tmp_path / "nodes.inc").write_text(nodes)
    (tmp_path / "main.inp").write_text("*INCLUDE, INPUT=nodes.inc\n*ELEMENT" + rest)
    found = _found(node, parts={"thickness of SOLID": 1.04})
    path = _written(Deck.load(tmp_path / "main.inp"), found, tmp_path / "c.inp")
    moved, before = Deck.load(path).nodes, original.nodes
    by = np.array([moved[n] - before[n] for n in before])
    assert by.min(axis=0) == pytest.approx([0, 0, -4e-5]) and by.max() == pytest.approx(4e-5)
    said = "** romsindy: SOLID is 1.04 times as thick: nodes move by up to 4e-05"
    assert said in path.read_text() and "INCLUDE" not in path.read_text()


def test_what_is_added_has_numbers_of_its_own(deck, tmp_path):
    """Springs of a clamp, a spring and a mass: no element number stands twice."""
    original, node = deck
    found = _found(node, spring=lambda x: -K * x, mass=1e-3, parts={"clamp of HELD": 2e-11})
    again = Deck.load(_written(original, found, tmp_path / "c.inp"))
    points = [f[0] for c in again.of("ELEMENT") if "C3D" not in c.lines[0] for f in c.fields()]
    assert len(points) == 3 * len(original.sets["HELD"]) + 2 == len({*points})


def test_supports_in_a_step_are_put_before_it_first(deck, tmp_path):
    original, node = deck
    text = original.path.read_text()
    head, held, rest = text.partition("*BOUNDARY\nHELD, 1, 3\n")
    path = tmp_path / "s.inp"
    path.write_text(head + rest.replace("*STEP\n", "*STEP\n" + held))
    with pytest.raises(ValueError, match="supports stand in the first step: put them before it"):
        corrected_deck(Deck.load(path), _found(node, parts={"clamp of HELD": 2e-11}), Units())


def _diagnosis(force, **values):
    content = {"verdict": "named", "effects": [], "values": values}
    return {**content, "force_laws": None if force is None else force.content()}


@pytest.fixture
def folder(deck, tmp_path, monkeypatch):
    original, node = deck
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arch.inp").write_text(original.path.read_text())
    (tmp_path / "arch.toml").write_text(
        f'[deck]\nfile = "arch.inp"\nrange = 0.001\n[damping]\nalpha = 0.4\n'
        f'[sensors]\nnodes = ["{node}:3"]\ncolumns = ["middle"]\n[tolerances]\nmodulus = 0.05\n'
    )
    return tmp_path


def _export(*more):
    given = ["export", "d.json", "--to", "deck", "--deck", "arch.toml", *more]
    return CliRunner().invoke(main, given)


def test_a_diagnosis_is_written_back_into_the_deck(folder):
    """Spring as an element, damper as a comment, modulus in its material."""
    laws = ((Stiffness(1), K), (PowerDamping(1), 3.0))
    content = _diagnosis(LawForce(laws, 1.0, 1.0, (1e-3, 1.0)), modulus=1.03, alpha=0.4)
    content |= {"sentence": "They differ.\nMissing: a spring, 2000 +- 12.\nPlace: it acts at 3:3."}
    (folder / "d.json").write_text(json.dumps(content))
    done = _export("-o", "corrected.inp")
    assert done.exit_code == 0, done.output
    text = (folder / "corrected.inp").read_text()
    assert "no element in *DYNAMIC" in text and "modulus = 1.03" in text
    assert "** romsindy: Missing: a spring, 2000 +- 12." in text and "They differ" not in text
    assert "** romsindy: Place: it acts at 3:3." in text
    (card,) = Deck.load(folder / "corrected.inp").of("SPRING")
    assert float(card.data[1]) == pytest.approx(K, rel=1e-6)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (_diagnosis(None, alpha=0.4), "nothing was added to the deck"),
        ({"verdict": "named"}, "this is no diagnosis of a deck"),
        (
            _diagnosis(None, alpha=0.4) | {"force_laws": {"laws": [["zeta_9", 1.0]], "mass": 1.0}},
            "force_laws has no 'per_q', 'reach'",
        ),
    ],
)
def test_what_cannot_be_written_back(folder, content, words):
    (folder / "d.json").write_text(json.dumps(content))
    done = _export()
    assert done.exit_code == 2
    assert words in done.output.replace(" and ", ", ")


def test_the_deck_itself_is_not_replaced(folder):
    (folder / "d.json").write_text(json.dumps(_diagnosis(None, modulus=1.1)))
    before = (folder / "arch.inp").read_bytes()
    done = _export("-o", "arch.inp", "--overwrite")
    assert done.exit_code == 2 and "is the deck, arch.inp: no output replaces" in done.output
    assert (folder / "arch.inp").read_bytes() == before
    # What was written by the same command is.
    assert _export("-o", "new.inp").exit_code == 0 and _export("-o", "new.inp").exit_code == 0


def test_deck_and_language_go_together(folder):
    (folder / "d.json").write_text("{}")
    done = CliRunner().invoke(main, ["export", "d.json", "--to", "deck"])
    assert done.exit_code == 2 and "go together" in done.output


def test_an_error_of_the_deck_is_one(folder):
    (folder / "arch.inp").unlink()
    (folder / "d.json").write_text(json.dumps(_diagnosis(None, modulus=1.1)))
    done = _export()
    assert done.exit_code == 2 and "there is no such deck" in done.output
    with pytest.raises(DeckError):
        Deck.load(folder / "arch.inp")
