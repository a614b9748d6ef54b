"""Structures of finite elements: what needs no external program."""

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp
from scipy.io import savemat
from scipy.optimize import brentq
from scipy.sparse import csc_array, diags_array
from solid_decks import decks

import romsindy as rs
from romsindy.commands.main import main
from romsindy.structure.deck import Deck, DeckError
from romsindy.structure.linear import Matrices, linear_modes
from romsindy.structure.structure import load_structure

# Two modes: V = omega^2 q^2 / 2 + fast^2 y^2 / 2 + bend q^2 y, held by a force of the first.
OMEGA, FAST, BEND = 10.0, 45.0, 300.0


def _held(q):
    """Force, and y that follows, in closed form: y = -bend q^2 / fast^2."""
    y = -BEND * q**2 / FAST**2
    return OMEGA**2 * q + 2 * BEND * q * y, y


def _turned():
    """Mass, shapes, and what turns modal coordinates to those of three freedoms."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(3, 3)) + 3 * np.eye(3)
    mass = root @ root.T
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    shapes = np.linalg.solve(root.T, axes).T  # rows with shape M shape = 1
    return mass, shapes


def _arrays(reach=0.4, count=17):
    mass, shapes = _turned()
    q = np.linspace(-reach, reach, count)
    q = q[q != 0]
    force, y = _held(q)
    moved = np.outer(q, shapes[0]) + np.outer(y, shapes[1])
    return {
        "mass": mass,
        "shapes": shapes,
        "omega": [OMEGA, FAST, 400.0],
        "cases": {1: (force, moved)},
        "nodes": [5, 5, 9],
        "directions": [1, 3, 2],
    }


def test_the_equation_of_two_modes_is_that_in_closed_form():
    """K = omega^2 q - 2 (bend / fast)^2 q^3, h = (2 bend q / fast^2)^2: exact polynomials."""
    found = rs.Structure.from_arrays(**_arrays()).reduce(1)
    values = found.model.coefficients
    assert values["omega^2"] == pytest.approx(OMEGA**2, rel=1e-12)
    assert values["gamma_3"] == pytest.approx(-2 * (BEND / FAST) ** 2, rel=1e-9)
    assert values["Upsilon_3"] == pytest.approx((2 * BEND / FAST**2) ** 2, rel=1e-9)
    # What is not there is left out.
    assert set(values) == {"omega^2", "gamma_3", "Upsilon_3"}
    assert max(found.between) < 1e-9


def test_a_scale_of_the_shapes_changes_nothing():
    arrays = _arrays()
    arrays["shapes"] = arrays["shapes"] * np.array([[3.0], [0.1], [7.0]])
    found = rs.Structure.from_arrays(**arrays).reduce(1).model.coefficients
    expected = rs.Structure.from_arrays(**_arrays()).reduce(1).model.coefficients
    assert found == pytest.approx(expected, rel=1e-9)


def test_a_structure_shows_itself_in_a_line():
    """Not all its arrays: a notebook shows it where a cell ends with it."""
    text = repr(rs.Structure.from_arrays(**_arrays()))
    assert text.startswith("Structure('arrays', ") and len(text) < 200


def test_a_mode_that_points_the_other_way_is_the_same():
    """The sign of a shape, and of the factors with it, is anybody's choice."""
    arrays = _arrays()
    factors, moved = arrays["cases"][1]
    arrays["shapes"], arrays["cases"] = -arrays["shapes"], {1: (-factors, moved)}
    found = rs.Structure.from_arrays(**arrays).reduce(1).model.coefficients
    expected = rs.Structure.from_arrays(**_arrays()).reduce(1).model.coefficients
    assert found == pytest.approx(expected, rel=1e-9)


def test_what_a_fast_mode_does_by_itself_is_foretold():
    """The frequency of both modes together, integrated, is that of the equation and its error."""
    found = rs.Structure.from_arrays(**_arrays()).reduce(1)
    (follower,) = found.followers
    assert follower.number == 2 and follower.ratio == pytest.approx(FAST / OMEGA)
    assert follower.share == pytest.approx(1.0, rel=1e-6)
    reach = found.reach
    truth = _frequency(reach)
    rom = found.frequencies(np.array([reach]))[0]
    missed = truth / rom - 1
    # First order in what is missed, and the start is not quite on the orbit: a fifth.
    assert abs(missed) > 1e-4
    assert follower.error == pytest.approx(missed, rel=0.2)


def _frequency(amplitude):
    """Angular frequency of the orbit of both modes in phase, by shooting."""

    def rate(_, z):
        q, y, q_dot, y_dot = z
        return [
            q_dot,
            y_dot,
            -(OMEGA**2) * q - 2 * BEND * q * y,
            -(FAST**2) * y - BEND * q**2,
        ]

    def rest(t, z):
        return z[2]

    rest.direction = 1.0

    def back(y0):
        """What y_dot is when q is next at rest: zero on an orbit with a mirror."""
        start, precise = [amplitude, y0, 0, 0], {"rtol": 1e-10, "atol": 1e-12}
        done = solve_ivp(rate, (0, 0.5), start, "DOP853", events=rest, **precise)
        turn = next(i for i, t in enumerate(done.t_events[0]) if t > 0.1)
        return done.y_events[0][turn][3], done.t_events[0][turn]

    near = _held(amplitude)[1]
    y0 = brentq(lambda y0: back(y0)[0], 1.5 * near, 0.5 * near)
    return np.pi / back(y0)[1]


def test_the_coordinate_can_be_what_the_mode_moves_at_a_sensor():
    structure = rs.Structure.from_arrays(**_arrays())
    modal, seen = structure.reduce(1), structure.reduce(1, sensor=(9, 2))
    size = structure.shapes[0][structure.freedom(9, 2)]
    assert seen.model.unit == "m" and modal.model.unit == "kg^0.5 m"
    amplitude = 0.2
    assert seen.frequencies(np.array([abs(size) * amplitude])) == pytest.approx(
        modal.frequencies(np.array([amplitude])), rel=1e-9
    )


def test_damping_that_is_stated_is_in_the_equation():
    found = rs.Structure.from_arrays(**_arrays()).reduce(1, damping_ratio=0.01)
    assert found.model.damping_ratio([1e-3])[0] == pytest.approx(0.01, rel=1e-4)


def test_an_asymmetric_structure_has_even_powers_and_a_sensor_may_turn_them():
    """V = omega^2 q^2 / 2 + a q^3 / 3: a sensor that moves the other way has -a."""
    arrays = _arrays()
    q = np.linspace(-0.4, 0.4, 8)
    arrays["cases"] = {1: (OMEGA**2 * q + 20 * q**2, np.outer(q, arrays["shapes"][0]))}
    structure = rs.Structure.from_arrays(**arrays)
    modal = structure.reduce(1).model.coefficients
    turned = np.sign(arrays["shapes"][0] @ structure.shapes[0])  # q is positive where it is largest
    assert modal["gamma_2"] == pytest.approx(20 * turned, rel=1e-9)
    signs = set()
    for node, direction in ((5, 1), (5, 3), (9, 2)):
        size = structure.shapes[0][structure.freedom(node, direction)]
        seen = structure.reduce(1, sensor=(node, direction)).model.coefficients
        assert seen["gamma_2"] == pytest.approx(20 * turned / size, rel=1e-9)
        signs.add(np.sign(size))
    assert signs == {-1.0, 1.0}  # both ways were tried


def test_files_of_arrays_give_the_same(tmp_path):
    arrays = _arrays()
    factors, moved = arrays.pop("cases")[1]
    content = {**arrays, "factors_1": factors, "displacements_1": moved}
    content["coordinates"] = np.array([[5, 0.0, 0, 0], [9, 1.0, 0, 0]])
    content["tangents_1"] = np.arange(1.0, 1 + len(factors))[:, None, None] * np.eye(3)
    np.savez(tmp_path / "a.npz", **content)
    savemat(tmp_path / "a.mat", {**content, "mass": csc_array(arrays["mass"])})
    rows, columns = np.nonzero(arrays["mass"])
    parts = {"mass_row": rows, "mass_column": columns, "mass_value": arrays["mass"][rows, columns]}
    rest = {k: v for k, v in content.items() if k != "mass"}
    np.savez(tmp_path / "b.npz", **rest, **parts)
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values in content.items():
            file[name] = values
    expected = rs.Structure.from_arrays(**_arrays()).reduce(1).model.coefficients
    for name in ("a.npz", "a.mat", "b.npz", "a.h5"):
        structure = load_structure(tmp_path / name)
        found = structure.reduce(1).model.coefficients
        assert found == pytest.approx(expected, rel=1e-9), name
        tangents = [k.toarray()[0, 0] for k in structure.cases.tangents[1]]
        assert tangents == [1 + i for i in range(len(factors))]


def test_the_command_writes_equation_and_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arrays = _arrays()
    factors, moved = arrays.pop("cases")[1]
    places = np.array([[5, 0.0, 0, 0], [9, 1.0, 0, 0]])
    np.savez("a.npz", **arrays, factors_1=factors, displacements_1=moved, coordinates=places)
    done = CliRunner().invoke(main, ["reduce", "a.npz", "--save", "a.json"])
    assert done.exit_code == 0, done.output
    assert "gamma_3" in done.output and "mode 2, 4.5 times as fast" not in done.output
    model = rs.ReducedModel.from_json((tmp_path / "a.json").read_text())
    assert model.coefficients["gamma_3"] == pytest.approx(-2 * (BEND / FAST) ** 2, rel=1e-9)
    page = (tmp_path / "a.html").read_text()
    assert "Shapes" in page and "Modes that follow" in page


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mass": np.eye(2)}, "shapes has the shape"),
        ({"nodes": [1, 2]}, "nodes has the shape"),
        ({"mass": np.triu(np.ones((3, 3))) + 2 * np.eye(3)}, "mass is not symmetric"),
        ({"mass": -np.eye(3)}, "mass is not positive"),
        ({"cases": {1: ([1.0, 2.0], np.ones((3, 3)))}}, r"cases\[1\] has factors"),
        ({"cases": {1: (np.arange(1.0, 6), np.ones((5, 3)))}}, "is said to hold q"),
        ({"tangents": {1: [np.eye(3)]}}, r"tangents\[1\] are 1 of shape \[\(3, 3\)\]: give one of"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change, words):
    with pytest.raises(ValueError, match=words):
        rs.Structure.from_arrays(**{**_arrays(), **change}).reduce(1)


def test_what_cannot_be_asked_of_arrays_is_refused(tmp_path):
    structure = rs.Structure.from_arrays(**_arrays())
    with pytest.raises(ValueError, match="mode = 2 has no static cases"):
        structure.reduce(2)
    with pytest.raises(ValueError, match="mode = 9 is not known"):
        structure.reduce(9)
    with pytest.raises(ValueError, match=r"reach = 1\.0 cannot be asked"):
        structure.reduce(1, 1.0)
    with pytest.raises(ValueError, match="node 5 of arrays is not free in direction 2"):
        structure.reduce(1, sensor=(5, 2))
    with pytest.raises(ValueError, match="node 'TIP' is no number"):
        structure.reduce(1, sensor=("TIP", 2))
    np.savez(tmp_path / "a.npz", mass=np.eye(3))
    with pytest.raises(ValueError, match="there is no array 'shapes'"):
        load_structure(tmp_path / "a.npz")


# -- decks ----------------------------------------------------------------------------------------


@pytest.fixture
def deck(tmp_path):
    mesh = decks.block((2, 1, 1), (2.0, 1.0, 0.5))
    path = tmp_path / "a b.inp"  # a blank in the name is no trouble
    return decks.write_deck(path, mesh, decks.at(mesh[0], 0, 0.0), **decks.STEEL)


def test_nodes_sets_and_outer_faces_of_a_deck(deck):
    """Two bricks side by side have ten outer faces of twelve."""
    found = Deck.load(deck)
    assert len(found.faces) == 10
    assert found.nodes[1] == pytest.approx([0, 0, 0]) and len(found.nodes) == 32
    assert set(found.sets) == {"ALL", "HELD"} and len(found.sets["HELD"]) == 8
    assert found.node("7") == 7


def test_a_deck_is_cut_at_its_first_step_and_keeps_the_supports_that_stand_there(deck):
    step = "*Step\n*Static\n*Boundary, OP=NEW\nHELD, 1, 3, 0.0\n*CLOAD\n9, 3, 1.0\n*End Step"
    deck.write_text(deck.read_text().replace("*BOUNDARY\nHELD, 1, 3\n", "") + step)
    found = Deck.load(deck)
    assert "CLOAD" not in found.text.upper() and "HELD, 1, 3, 0.0" in found.text
    (note,) = found.notes
    assert "*CLOAD of the step is left out" in note and "line" in note


def test_files_that_a_deck_includes_are_read(deck, tmp_path):
    text = deck.read_text()
    head, _, rest = text.partition("*MATERIAL")
    (tmp_path / "material.inc").write_text("*MATERIAL" + rest)
    deck.write_text(head + "*INCLUDE, INPUT=material.inc\n")
    assert "*DENSITY" in Deck.load(deck).text
    (tmp_path / "material.inc").write_text(f"*INCLUDE, INPUT={deck.name}\n")
    with pytest.raises(DeckError, match="goes round in a circle"):
        Deck.load(deck)
    (tmp_path / "material.inc").unlink()
    with pytest.raises(DeckError, match=r"line \d+: \*INCLUDE asks for material.inc"):
        Deck.load(deck)


@pytest.mark.parametrize(
    ("card", "words"),
    [
        ("*EQUATION\n2\n1,1,1.,2,1,-1.", r"\*EQUATION cannot be reduced"),
        ("*MPC\nPLANE,1,2,3", r"\*MPC cannot be reduced"),
        ("*Rigid body, NSET=HELD, REF NODE=1", r"\*RIGID BODY cannot be reduced"),
        ("*TRANSFORM, NSET=HELD\n0.,1.,0.,-1.,0.,0.", r"\*TRANSFORM cannot be reduced"),
        ("*CONTACT PAIR, INTERACTION=I\nA,B", r"\*CONTACT PAIR cannot be reduced"),
        ("*SHELL SECTION, ELSET=SOLID\n0.1", "shells are expanded into solids"),
        ("*PLASTIC\n1.,0.", "keeps energy"),
        ("*ELEMENT, TYPE=S8R\n9,1,2,3,4,5,6,7,8", "elements S8R cannot be reduced"),
        ("*ELEMENT, TYPE=B32R\n9,1,2,3", "elements B32R cannot be reduced"),
        ("*BOUNDARY\n9,1,1,0.1", "holds a node away from its place"),
    ],
)
def test_what_cannot_be_reduced_is_named_with_its_line(deck, card, words):
    before = deck.read_text().count("\n")
    deck.write_text(deck.read_text() + card + "\n")
    with pytest.raises(DeckError, match=words) as refusal:
        Deck.load(deck)
    line = int(str(refusal.value).partition("line ")[2].partition(":")[0])
    assert line in (before, before + 1) and str(deck) in str(refusal.value)


def test_plane_elements_that_have_no_section_are_left_out(deck):
    """As gmsh writes them for the sets of a surface; with a section they count."""
    solids = Deck.load(deck).text
    line = "*ELEMENT, TYPE=CPS8, ELSET=FACE\n901,1,2,3,4,5,6,7,8\n"
    deck.write_text(deck.read_text().replace("*MATERIAL", f"{line}*MATERIAL", 1))
    found = Deck.load(deck)
    assert found.text == solids
    (note,) = found.notes
    assert "elements CPS8 are left out: they have no section" in note and "line" in note
    section = "*ELSET, ELSET=PANEL\n901\n*SOLID SECTION, ELSET=PANEL, MATERIAL=M\n"
    deck.write_text(deck.read_text() + section)
    with pytest.raises(DeckError, match="elements CPS8 cannot be reduced"):
        Deck.load(deck)


def test_a_deck_without_density_is_refused(deck):
    deck.write_text(deck.read_text().replace("*DENSITY\n7800.0\n", ""))
    with pytest.raises(DeckError, match=r"there is no \*DENSITY"):
        Deck.load(deck)


def test_sensors_that_are_not_there(deck):
    found = Deck.load(deck)
    with pytest.raises(ValueError, match="node 99 is not in"):
        found.node("99")
    with pytest.raises(ValueError, match=r"the set HELD of .* holds 8 nodes"):
        found.node("HELD")
    with pytest.raises(ValueError, match="TIP"):
        found.node("TIP")


def test_a_file_of_something_else_is_no_store(deck, tmp_path):
    np.savez(tmp_path / "other.npz", a=1.0)
    with pytest.raises(ValueError, match="keeps no static cases"):
        rs.Structure.from_calculix(deck, store=tmp_path / "other.npz")


def test_without_calculix_the_way_to_it_is_said(deck, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    given = ["reduce", str(deck), "--range", "0.1", "--ccx", "no-such-program"]
    done = CliRunner().invoke(main, given)
    assert done.exit_code == 2
    assert "no CalculiX" in done.output and "apt install calculix-ccx" in done.output
    assert "--ccx" in done.output and not list(tmp_path.glob("*.npz"))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([], "--range is missing"),
        (["--range", "1", "--sensor", "9"], "is not NODE:DIRECTION"),
        (["--range", "1", "--sensor", "9:x"], "is not NODE:DIRECTION"),
        (["--range", "1", "--units", "mm,t,ms"], "the time must be s"),
        (["--range", "1", "--store", "{deck}"], "its name must end in .npz"),
        (["--range", "1", "--store", "other.npz"], "did not write it there before"),
    ],
)
def test_options_that_cannot_be_meant(deck, given, words, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    before = deck.read_bytes()
    np.savez("other.npz", a=1.0)
    given = [g.format(deck=deck) for g in given]
    done = CliRunner().invoke(main, ["reduce", str(deck), *given])
    assert done.exit_code == 2 and words in done.output
    assert deck.read_bytes() == before


def test_no_output_replaces_what_a_deck_includes(deck, monkeypatch, tmp_path):
    """Nor the file that keeps its cases, though no option names it."""
    monkeypatch.chdir(tmp_path)
    head, _, rest = deck.read_text().partition("*MATERIAL")
    (tmp_path / "material.inc").write_text("*MATERIAL" + rest)
    (tmp_path / "main.inp").write_text(head + "*INCLUDE, INPUT=material.inc\n")
    for output in ("material.inc", "main.cases.npz"):
        given = ["reduce", "main.inp", "--range", "1", "--save", output, "--overwrite"]
        done = CliRunner().invoke(main, given)
        assert done.exit_code == 2 and "no output replaces an input" in done.output, done.output
    assert (tmp_path / "material.inc").read_text() == "*MATERIAL" + rest


@pytest.mark.parametrize("spread", [(4.0, 1.0), (6.0, 0.0)])  # a rod's, and equal masses
def test_the_same_modes_come_with_the_same_digits_and_signs(spread):
    """A rod that is the same from either end: rounding chose which end of a mode was up."""
    n, beside = 60, {"offsets": [0, 1, -1], "shape": (60, 60)}
    pairs = (2.0, -1.0), spread
    stiffness, mass = (csc_array(diags_array([a, b, b], **beside)) for a, b in pairs)
    known = Matrices(stiffness, mass, np.arange(n) + 1, np.full(n, 3))
    first, *others = (linear_modes("chain", known, 6) for _ in range(3))
    for again in others:
        assert np.array_equal(again.omega, first.omega)
        assert np.array_equal(again.shapes, first.shapes)
    # Signs are those of the closed form, whose first swing is up.
    exact = np.sin(np.outer(np.arange(1, 7), np.arange(1, n + 1)) * np.pi / (n + 1))
    assert np.all(np.sum(exact * first.shapes, axis=1) > 0)
