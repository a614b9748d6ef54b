"""Decks of CalculiX, run: against a published beam, our own beam, arrays, and CalculiX in time."""

import numpy as np
import pytest
from click.testing import CliRunner
from solid_decks import decks, needs_ccx

import romsindy as rs
from romsindy.commands.main import main
from romsindy.structure.deck import DeckError

pytestmark = needs_ccx


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """The clamped beam, reduced up to a third of its thickness, and what was kept of it."""
    folder = tmp_path_factory.mktemp("beam")
    deck = decks.clamped_beam(folder / "clamped beam.inp")
    store = folder / "cases.npz"
    structure = rs.Structure.from_calculix(deck, store=store, progress=False)
    return structure, structure.reduce(1, 3.0), deck, store


def test_the_mass_is_that_of_the_deck(beam):
    """Density times volume, less the share of the clamped nodes: a half matrix would show."""
    structure, *_ = beam
    along = structure.directions == 3
    mass = structure.mass[along][:, along].sum()
    assert 0.98 * 556.8 < mass < 556.8


def test_a_clamped_beam_is_that_of_the_literature(beam):
    """Frequency of MORFE's clamped beam, cubic coefficient of Euler and Bernoulli.

    0.53739 rad/s (MORFE.jl, examples, 01_clamped_beam), 9.37e-6 in closed form.
    """
    structure, found, *_ = beam
    assert structure.omega[0] == pytest.approx(decks.LITERATURE, rel=1e-3)
    assert found.model.coefficients["gamma_3"] == pytest.approx(decks.CUBIC, rel=0.01)
    # A third of the thickness: omega^2 = omega_0^2 + 3/4 gamma_3 a^2, where h is nothing.
    a = found.reach
    cubic = np.sqrt(decks.LITERATURE**2 + 0.75 * decks.CUBIC * a**2)
    assert found.frequencies(np.array([a]))[0] == pytest.approx(cubic, rel=1.5e-3)


def test_a_symmetric_beam_has_no_even_terms(beam):
    _, found, *_ = beam
    assert not {"gamma_2", "gamma_4", "Upsilon_4"} & set(found.model.coefficients)


def test_what_was_computed_is_not_computed_again(beam):
    """With no program at all the same deck gives the same equation; another range asks for it."""
    _, found, deck, store = beam
    again = rs.Structure.from_calculix(deck, ccx="no-such-program", store=store)
    assert again.reduce(1, 3.0).model == found.model
    with pytest.raises(DeckError, match="no CalculiX"):
        again.reduce(1, 7.0)


def test_arrays_give_what_the_deck_gives(beam):
    structure, found, *_ = beam
    cases = {1: (found.curve.cases.factors, found.curve.cases.shapes)}
    arrays = rs.Structure.from_arrays(
        structure.mass,
        structure.shapes,
        structure.omega,
        cases,
        structure.nodes,
        structure.directions,
    )
    expected = structure.reduce(1, 3.0).model.coefficients
    given = arrays.reduce(1).model.coefficients
    # An order of its own, by cases that take no part: what both are sure of is the same.
    assert given["omega^2"] == pytest.approx(expected["omega^2"], rel=1e-12)
    a = 0.5 * found.reach
    pair = [m.frequencies(np.array([a]))[0] for m in (arrays.reduce(1), found)]
    assert pair[0] == pytest.approx(pair[1], rel=1e-6)


def test_another_direction_of_the_coordinate_is_tried_by_its_sensor(beam):
    structure, *_ = beam
    middle = structure.nodes[structure.mode(1).loudest]
    found = structure.reduce(1, 3.0, sensor=(int(middle), 3), units=("mm", "t"))
    assert found.model.unit == "mm" and found.reach == pytest.approx(3.0, rel=0.02)


def test_the_command_reduces_a_deck(beam, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, _, deck, store = beam
    given = [str(deck), "--range", "3", "--store", str(store), "--save", "beam.json", "--jobs", "2"]
    done = CliRunner().invoke(main, ["reduce", *given])
    assert done.exit_code == 0, done.output
    assert "2,241 free degrees of freedom" in done.output and "Backbone:" in done.output
    assert (tmp_path / "beam.json").exists() and (tmp_path / "clamped beam.html").exists()


@pytest.mark.study
@pytest.mark.slow
def test_where_a_shallow_arch_snaps_through_the_range_is_said(tmp_path):
    """Its rise is six thicknesses: pushed down it is held to a part of what was asked."""
    structure = rs.Structure.from_calculix(decks.arch(tmp_path / "arch.inp", 0.012), progress=False)
    found = structure.reduce(1, 0.006)
    assert any("CalculiX finds no shape beyond" in note for note in found.notes)
    assert min(map(abs, found.moved)) < 0.0055


def test_a_free_block_is_rigid(tmp_path):
    mesh = decks.block((2, 1, 1), (2.0, 1.0, 0.5))
    deck = decks.write_deck(tmp_path / "free.inp", mesh, [], **decks.STEEL, kind="C3D20")
    structure = rs.Structure.from_calculix(deck, progress=False)
    with pytest.raises(ValueError, match=r"mode = 1 of .* is rigid"):
        structure.reduce(1, 0.1)


def test_what_calculix_refuses_is_told_in_its_words(tmp_path):
    deck = decks.arch(tmp_path / "arch.inp", 0.002, (2, 1, 1))
    deck.write_text(deck.read_text().replace("MATERIAL=M\n", "MATERIAL=N\n"))
    with pytest.raises(DeckError, match="CalculiX refuses the deck"):
        rs.Structure.from_calculix(deck, progress=False)


def test_all_files_are_kept_on_request(tmp_path):
    deck = decks.arch(tmp_path / "arch.inp", 0.002, (4, 1, 1))
    rs.Structure.from_calculix(deck, folder=tmp_path / "kept", progress=False)
    assert list((tmp_path / "kept").glob("matrices_*/matrices.sti"))


def test_all_nodes_held(tmp_path):
    mesh = decks.block((1, 1, 1), (1.0, 1.0, 1.0))
    held = range(1, len(mesh[0]) + 1)
    deck = decks.write_deck(tmp_path / "a.inp", mesh, held, **decks.STEEL)
    with pytest.raises(DeckError, match="no freedom is free"):
        rs.Structure.from_calculix(deck, progress=False)


def test_a_part_without_density_is_named_by_a_node(tmp_path):
    """A second material that has none: its inner nodes have no mass."""
    deck = decks.arch(tmp_path / "a.inp", 0.001, (4, 2, 1), {"ROOT": lambda x: x[0] < 0.1})
    light = "*MATERIAL, NAME=LIGHT\n*ELASTIC\n2e11, 0.3\n*SOLID SECTION, ELSET=ROOT, MATERIAL=LIGHT"
    text = deck.read_text()
    deck.write_text(text.replace("*SOLID SECTION, ELSET=ROOT, MATERIAL=M", light))
    with pytest.raises(
        DeckError, match=r"has no mass in direction \d: .*\*DENSITY|refuses the deck"
    ):
        rs.Structure.from_calculix(deck, progress=False)


@pytest.mark.slow
def test_a_cantilever_of_solids_is_our_beam(tmp_path):
    """K/q and h of a slender cantilever, nu = 0, to 1e-3 of their change."""
    assert max(decks.against_beam(tmp_path)) < 1e-3


@pytest.mark.slow
def test_an_arch_swings_as_its_equation_says(tmp_path):
    """A release from one thickness, by CalculiX in time: the frequency to 0.3 %."""
    deck = decks.arch(tmp_path / "arch.inp", 0.002)
    found = rs.Structure.from_calculix(deck, progress=False).reduce(1, 0.002)
    frequency, amplitude = decks.released(found)
    assert amplitude > 0.8 * found.reach  # it swings far
    expected = found.frequencies(np.array([amplitude]))[0] / (2 * np.pi)
    assert frequency == pytest.approx(expected, rel=3e-3)
    # Unlike the linear frequency by far: the oracle would notice.
    assert abs(frequency * 2 * np.pi / found.structure.omega[0] - 1) > 0.05
