"""Values of parts of a deck, against decks that have them, and against statics."""

import numpy as np
import pytest
from solid_decks import decks, needs_ccx

import romsindy as rs
from romsindy.structure.deck import Deck, DeckError
from romsindy.structure.linear import Units
from romsindy.structure.parts import PartValue, softened

ROOT = {"ROOT": lambda middle: middle[0] < 0.1}
T = np.arange(0, 0.1, 2e-4)


@pytest.fixture(scope="module")
def arch(tmp_path_factory):
    """A shallow arch whose left third is a set of its own."""
    return decks.arch(tmp_path_factory.mktemp("arch") / "arch.inp", 0.001, (8, 2, 1), ROOT)


def _middle(structure):
    places = structure.coordinates
    return min(places, key=lambda n: float(np.abs(places[n] - [0.15, 0.0, 0.001]).sum()))


@needs_ccx
@pytest.mark.parametrize(
    ("name", "value", "rel"),
    [
        # A polynomial through 0.9, 0.95, 1, 1.05 and 1.1, which is asked between them.
        pytest.param("modulus of root", 1.07, 2e-6, marks=pytest.mark.slow),
        pytest.param("density of root", 0.97, 2e-6, marks=pytest.mark.slow),
        ("thickness of root", 1.03, 2e-6),
        # Springs at the clamp in the place of what is rigid: it first frees what is pressed
        # sideways, which no polynomial follows as closely.
        pytest.param("clamp of held", None, 2e-4, marks=pytest.mark.slow),
    ],
)
def test_between_decks_lies_the_deck_of_a_value(arch, tmp_path, name, value, rel):
    """Motion at a value of a part is that of the deck with it, which is held by itself."""
    structure = rs.Structure.from_calculix(arch, store=tmp_path / "s.npz", progress=False)
    sensors, given = [(_middle(structure), 3)], {"damping": 0.01, "held_by": "mode"}
    simulator = structure.simulator(sensors, 1e-3, values=[name], **given)
    value = 1.5 * simulator.steps[name] if value is None else value
    x = simulator.simulate(6e-4, T, **{name: value})
    other = structure.varied(name, value)
    expected = other.simulator(sensors, 1e-3, **given).simulate(6e-4, T)
    usual = simulator.simulate(6e-4, T)
    changed = np.abs(expected - usual).max()
    assert changed > 0.05 * np.abs(usual).max()  # over ten cycles
    # So far a phase is off after all cycles, with the frequency by ``rel``.
    phase = structure.omega[0] * T[-1] * rel
    assert np.abs(x - expected).max() < phase * np.abs(usual).max()


@needs_ccx
@pytest.mark.study
@pytest.mark.slow
def test_a_simulator_is_made_exact_at_values_that_are_off_together(arch, tmp_path):
    """There it is the deck with both, and beside it nearer than the sum of what each does."""
    structure = rs.Structure.from_calculix(arch, store=tmp_path / "s.npz", progress=False)
    sensors, given = [(_middle(structure), 3)], {"damping": 0.01, "held_by": "mode"}
    names, units = ("modulus of ROOT", "clamp of HELD"), Units(1.0, 1e3)
    simulator = structure.simulator(sensors, 1e-3, values=names, units=units, **given)
    found = {names[0]: 1.06, names[1]: 1.5 * simulator.steps[names[1]]}
    right = simulator.right_at({**found, "alpha": 0.4})

    def off(told, values):
        deck = structure.varied(names[0], values[names[0]])
        deck = deck.varied(names[1], 1e3 * values[names[1]])  # of a force in kN
        expected = deck.simulator(sensors, 1e-3, units=units, **given).simulate(6e-4, T)
        return np.abs(told.simulate(6e-4, T, **values) - expected).max() / 6e-4

    # Both hold their cases to 1e-4 of the largest change of stiffness.
    assert off(right, found) < 1e-4 < 2e-3 < off(simulator, found)
    beside = {name: 1.002 * value for name, value in found.items()}
    assert off(right, beside) < 0.1 * off(simulator, beside)
    plain = structure.simulator(sensors, 1e-3, **given)
    assert plain.right_at({"modulus": 1.1}) is None


@needs_ccx
def test_a_part_with_a_modulus_of_its_own_is_a_material_of_its_own(arch):
    """All parts 1.2 times as stiff are the deck 1.2 times as stiff."""
    structure = rs.Structure.from_calculix(arch, progress=False)
    stiffer = structure.varied("modulus of ROOT", 1.2).varied("modulus of SOLID", 1.2)
    assert stiffer.omega**2 == pytest.approx(1.2 * structure.omega**2, rel=1e-5)  # digits of ccx
    half = structure.varied("density of ROOT", 1.2)
    assert half.mass.sum() - structure.mass.sum() == pytest.approx(
        0.2 * _share(structure), rel=1e-6
    )


def _share(structure):
    """Mass of the free nodes that the left third moves, in all directions, of the deck."""
    heavy = structure.varied("density of ROOT", 2.0)
    return float(heavy.mass.sum() - structure.mass.sum())


@needs_ccx
def test_a_clamp_of_springs_is_as_soft_as_was_asked(arch):
    """Far stiffer springs than the strip are the clamp, and each node has its share of one."""
    structure = rs.Structure.from_calculix(arch, progress=False)
    stiff = structure.varied("clamp of HELD", 1e-16)
    assert stiff.omega[0] == pytest.approx(structure.omega[0], rel=1e-4)
    deck = PartValue("clamp", "HELD").deck(Deck.load(arch), 1e-9)
    springs = [float(c.data[1]) for c in deck.of("SPRING")]
    assert springs == pytest.approx([1e9 / len(deck.sets["HELD"])] * 3)


def _places(deck):
    return np.array([deck.nodes[n] for n in sorted(deck.nodes)])


def _thicker(path, name, factor):
    return PartValue("thickness", name).deck(Deck.load(path), factor)


@pytest.mark.parametrize("layers", [1, 3])
def test_a_thicker_arch_is_the_mesh_of_a_thicker_arch(tmp_path, layers):
    """All nodes, also those in the middles of edges, where the mesh of that thickness has them."""
    thin = decks.arch(tmp_path / "a.inp", 0.03, (8, 2, layers))
    thick = decks.arch(tmp_path / "b.inp", 0.03, (8, 2, layers), thickness=0.002 * 1.07)
    moved, expected = _places(_thicker(thin, "SOLID", 1.07)), _places(Deck.load(thick))
    assert np.abs(moved - expected).max() < 1e-12 < np.abs(moved - _places(Deck.load(thin))).max()


@pytest.mark.parametrize("kind", ["hexahedra", "wedges"])
def test_a_thicker_shell_is_a_shell_of_the_same_middle_radius(tmp_path, kind):
    """A quarter of a tube: nodes move along its radii, also those in the middles of edges."""
    places, elements = decks.block((6, 4, 2), (np.pi / 2, 0.1, 0.004))
    angle, r = places[:, 0], 0.098 + places[:, 2]
    round_ = np.stack([r * np.cos(angle), places[:, 1], r * np.sin(angle)], axis=1)
    deck = decks.write_deck(tmp_path / "t.inp", (round_, elements), [1], **decks.STEEL)
    if kind == "wedges":  # of eight corners two halves, without nodes in the middles
        text, halves = deck.read_text().partition("*ELEMENT")[0], []
        for a, b, c, d, e, f, g, h in (nodes[:8] for nodes in elements):
            halves += [(a, b, c, e, f, g), (a, c, d, e, g, h)]
        rows = [", ".join(map(str, (i, *nodes))) for i, nodes in enumerate(halves, 1)]
        text += "*ELEMENT, TYPE=C3D6, ELSET=SOLID\n" + "\n".join(rows) + "\n*DENSITY\n1\n"
        deck.write_text(text)
    moved = _places(_thicker(deck, "SOLID", 1.1))
    used = {n for nodes in Deck.load(deck).solids.values() for n in nodes}
    there = np.array([n in used for n in range(1, len(places) + 1)])
    radius = np.hypot(moved[:, 0], moved[:, 2])[there]
    assert radius == pytest.approx((0.1 + 1.1 * (r - 0.1))[there], abs=1e-12)
    assert np.arctan2(moved[:, 2], moved[:, 0]) == pytest.approx(angle, abs=1e-10)


def test_a_stiffener_alone_becomes_thicker(tmp_path):
    """It is that of a thicker one; of the plate only the nodes on which it stands move."""
    thin = decks.stiffened(tmp_path / "a.inp")
    thick = decks.stiffened(tmp_path / "b.inp", thickness=0.0024)
    before, after = _places(Deck.load(thin)), _places(Deck.load(thick))
    moved = _places(_thicker(thin, "WEB", 1.2))
    high, below = before[:, 2] > 0.002 - 1e-9, before[:, 2] < 1e-9
    web = high & (np.abs(before[:, 1] - 0.05) < 0.0011)
    assert np.abs(moved - after)[web].max() < 1e-12
    others = below | (np.abs(before[:, 1] - 0.05) > 0.03)
    assert np.array_equal(moved[others], before[others])
    plate = _places(_thicker(thin, "SOLID", 1.1)) - before
    assert np.abs(plate).max(axis=0) == pytest.approx([0, 0, 1e-4])


@needs_ccx
def test_the_frequency_of_a_strip_grows_with_its_thickness(tmp_path):
    """It is that of a fresh mesh of the thickness; so is the mass."""
    thin = rs.Structure.from_calculix(decks.cantilever(tmp_path / "a.inp"), progress=False)
    fresh = decks.cantilever(tmp_path / "b.inp", thickness=0.01 * 1.06)
    fresh = rs.Structure.from_calculix(fresh, progress=False)
    moved = thin.varied("thickness of SOLID", 1.06)
    assert moved.omega[0] == pytest.approx(fresh.omega[0], rel=1e-6)
    # Shear bends a strip of a hundred thicknesses by 1e-4 more.
    assert moved.omega[0] == pytest.approx(1.06 * thin.omega[0], rel=2e-5)
    assert moved.mass.sum() == pytest.approx(1.06 * thin.mass.sum(), rel=1e-6)


@pytest.mark.parametrize(
    ("size", "name", "factor", "words"),
    [
        ((0.1, 0.1, 0.1), "SOLID", 1.1, "only 1 times as wide as thick"),
        ((0.3, 0.01, 0.01), "SOLID", 1.1, "only 1 times as wide as thick"),
        ((0.3, 0.02, 0.002), "TIP", 1.1, "no set of solids has that name: there are SOLID"),
        ((0.3, 0.02, 0.002), "SOLID", -0.1, "must be positive"),
    ],
)
def test_what_has_no_thickness_is_refused(tmp_path, size, name, factor, words):
    deck = decks.write_deck(tmp_path / "a.inp", decks.block((3, 2, 2), size), [1], **decks.STEEL)
    with pytest.raises(ValueError, match=words):
        _thicker(deck, name, factor)


def test_parts_of_several_plates_and_tetrahedra_have_no_thickness(tmp_path):
    deck = decks.stiffened(tmp_path / "a.inp")
    deck.write_text(deck.read_text() + "*ELSET, ELSET=BOTH\nWEB, SOLID\n")
    with pytest.raises(DeckError, match=r"more than one pair of broad faces .* a set of its own"):
        _thicker(deck, "BOTH", 1.1)
    tets = "*ELEMENT, TYPE=C3D4, ELSET=TETS\n9001, 1, 2, 3, 4\n"
    deck.write_text(deck.read_text() + tets)
    with pytest.raises(DeckError, match=r"element 9001 is a tetrahedron.* mesh the part with"):
        _thicker(deck, "TETS", 1.1)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("modulus of TIP", r"no \*SOLID SECTION has that ELSET: there are ROOT and SOLID"),
        (
            "clamp of TIP",
            r"no line of \*BOUNDARY holds a set of nodes of that name: there are HELD",
        ),
    ],
)
def test_a_part_that_is_not_there_is_refused(arch, name, words):
    part = PartValue.of_name(name)
    with pytest.raises(DeckError, match=words):
        part.deck(Deck.load(arch), 1.2)


def test_a_clamp_that_a_mode_does_not_feel_is_refused():
    with pytest.raises(ValueError, match="this mode does not feel it"):
        softened(lambda compliance: 4.0, 1e-9)


def test_arrays_have_no_parts():
    q = np.array([-2.0, -1.0, 1.0, 2.0])
    held = 8 * q + 3 * q**3, q[:, None] / np.sqrt(2)
    mass = rs.Structure.from_arrays([[2.0]], [[1.0]], [8**0.5], {1: held}, [1], [1])
    with pytest.raises(ValueError, match="no value of a part of arrays: a deck has such as"):
        mass.varied("modulus of ROOT", 1.1)
