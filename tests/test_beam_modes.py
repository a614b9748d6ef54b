"""Linear modes against closed forms, and the projection of a motion on them."""

from __future__ import annotations

import beam_oracles as oracles
import numpy as np
import pytest
from numpy.testing import assert_allclose

from romsindy.beam import CLAMPED, Beam, NoEquilibriumError, Section, Support

SLENDER = Section(EA=1e8, GA=1e8, EI=1.0, mass=1.0)
STILL = (0.0, 0.0)


def test_cantilever_frequencies():
    omega = Beam(1.0, SLENDER, elements=40, gravity=STILL).modes(count=3).omega
    # 40 elements leave 5e-6 in mode 3; shear and stretch 1e-8
    assert_allclose(omega, np.square(oracles.BETA_CLAMPED_FREE), rtol=1e-5)


def test_frequencies_converge_with_fourth_order():
    exact = oracles.BETA_CLAMPED_FREE[2] ** 2
    errors = [
        Beam(1.0, SLENDER, elements=n, gravity=STILL).modes(count=3).omega[2] / exact - 1
        for n in (4, 8, 16)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert_allclose(orders, 4.0, atol=0.3)  # four elements are not yet asymptotic


def test_clamped_clamped_frequencies():
    beam = Beam(1.0, SLENDER, elements=40, right=CLAMPED, gravity=STILL)
    assert_allclose(beam.modes(count=3).omega, np.square(oracles.BETA_CLAMPED_CLAMPED), rtol=2e-5)


@pytest.mark.parametrize("stiffness", [0.5, 5.0, 50.0])
def test_elastic_clamp(stiffness):
    beam = Beam(1.0, SLENDER, elements=30, left=Support.elastic(stiffness), gravity=STILL)
    expected = oracles.elastic_clamp_root(stiffness) ** 2
    assert_allclose(beam.modes(count=1).omega[0], expected, rtol=1e-5)


def test_axial_frequencies_with_tip_mass_and_spring():
    beam = Beam.cantilever(elements=40, gravity=0.0, spring_pretension=0.0)
    section = beam.section
    mu = 0.0008 / (section.mass * beam.length)
    kappa = 24.4 * beam.length / section.EA
    exact = [
        b * np.sqrt(section.EA / section.mass) / beam.length for b in oracles.axial_root(mu, kappa)
    ]
    modes = beam.modes(count=32)
    assert_allclose(modes.omega[modes.axial > 0.5][:2], exact, rtol=1e-5)


def test_default_system():
    beam = Beam.cantilever()
    modes = beam.modes(beam.equilibrium(), count=32)
    axial = modes.omega[modes.axial > 0.5]
    # the paper's digits: 38.5 and 165.9 are printed with three and four of them
    assert_allclose(modes.omega[0], 38.4967, rtol=1e-5)
    assert_allclose(modes.omega[1], 165.895, rtol=1e-5)
    assert_allclose(axial[:2], [17960.5, 53847.5], rtol=2e-4)
    straight = Beam.cantilever(gravity=0.0).modes(count=2).omega
    assert_allclose(straight, [38.385, 165.858], rtol=1e-4)
    assert_allclose(modes.omega[0] / straight[0], 1.003, atol=5e-4)
    assert_allclose(modes.shape(1)[-1, 1], 6.368, rtol=1e-4)


def test_modes_are_mass_normalised_and_point_up():
    beam = Beam.cantilever(elements=20)
    modes = beam.modes(count=5)
    gram = np.einsum("ank,bnk->ab", modes.shapes, modes.momenta)
    assert_allclose(gram, np.eye(5), atol=1e-8)
    assert np.all(modes.shapes[:, -1, 1] > 0)


def test_coordinates_of_a_modal_displacement():
    beam = Beam.cantilever(elements=20)
    modes = beam.modes(count=4)
    x = modes.equilibrium.displacement + 0.01 * modes.shape(3)
    assert_allclose(modes.coordinates(x), [0.0, 0.0, 0.01, 0.0], atol=1e-10)


@pytest.mark.parametrize("mode", [0, -1, 6])
def test_a_mode_that_does_not_exist(mode):
    modes = Beam.cantilever(elements=10).modes(count=5)
    with pytest.raises(ValueError, match=f"mode = {mode} is not in the basis"):
        modes.shape(mode)
    if mode < 1:
        with pytest.raises(ValueError, match=f"mode = {mode} does not exist"):
            Beam.cantilever(elements=10).release_shape(0.1, mode=mode)


def test_more_modes_than_the_mesh_has():
    with pytest.raises(ValueError, match="count = 40 modes were asked for"):
        Beam.cantilever(elements=3).modes(count=40)
    with pytest.raises(ValueError, match="use more elements"):
        Beam.cantilever(elements=3).release_shape(0.01, mode=17)


def test_an_unstable_equilibrium_has_no_modes():
    beam = Beam(1.0, SLENDER, elements=10, gravity=(-20.0, 0.0))  # buckles at 7.84 EI / L^3
    with pytest.raises(NoEquilibriumError, match="not stable"):
        beam.modes(count=2)
