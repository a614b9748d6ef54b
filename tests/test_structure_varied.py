"""Values of parts of a deck, against decks that have them, and against statics."""

import numpy as np
import pytest
from solid_decks import decks, needs_ccx

import romsindy as rs
from romsindy.structure.deck import Deck, DeckError
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
        # A parabola through 0.9, 1 and 1.1, which is asked between them.
        ("modulus of root", 1.05, 2e-5),
        ("density of root", 0.95, 2e-5),
        # Springs at the clamp in the place of what is rigid: it first frees what is pressed
        # sideways, which no polynomial follows as closely.
        ("clamp of held", None, 2e-4),
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
