"""Large static deflections against the elastica and published values."""

from __future__ import annotations

import beam_oracles as oracles
import numpy as np
import pytest
from numpy.testing import assert_allclose

from romsindy.beam import CLAMPED, FREE, Beam, NoEquilibriumError, Section
from romsindy.beam.structure import Spring

RIGID = 1e8  # EA and GA beside EI = L = 1: bending alone, to 1e-7
TOLERANCE = 1e-5  # what 20 elements leave; the issue asks for 1e-4


def bare(
    elements: int = 20, EA: float = RIGID, GA: float = RIGID, EI: float = 1.0, weight: float = 0.0
) -> Beam:
    section = Section(EA, GA, EI, 1.0)  # of mass 1: its weight is a load along the beam
    return Beam(length=1.0, section=section, elements=elements, gravity=(0.0, weight))


def tip(beam: Beam, load: np.ndarray | None = None) -> np.ndarray:
    u, w, theta = beam.equilibrium(load).tip
    return np.array([w, -u, theta])


@pytest.mark.parametrize("alpha", oracles.TIP_LOAD)
def test_tip_load(alpha):
    beam = bare()
    found = tip(beam, beam.point_load((0.0, alpha)))
    assert_allclose(found, oracles.TIP_LOAD[alpha], rtol=TOLERANCE)


@pytest.mark.parametrize("load", oracles.UNIFORM_LOAD)
def test_uniform_load(load):
    found = tip(bare(weight=load))
    assert_allclose(found, oracles.UNIFORM_LOAD[load], rtol=TOLERANCE)


@pytest.mark.parametrize("turns", [0.25, 0.5, 1.0])
def test_end_moment_bends_an_arc(turns):
    beam = bare()
    shape = beam.equilibrium(beam.point_load(moment=2 * np.pi * turns))
    angle = 2 * np.pi * turns * shape.s
    radius = 1 / (2 * np.pi * turns)
    assert_allclose(shape.displacement[:, 2], angle, atol=1e-9)
    x, y = shape.s + shape.displacement[:, 0], shape.displacement[:, 1]
    assert_allclose(x, radius * np.sin(angle), atol=TOLERANCE)
    assert_allclose(y, radius * (1 - np.cos(angle)), atol=TOLERANCE)


@pytest.mark.parametrize("GA", oracles.BATISTA)
def test_shear_flexible_beam_of_batista(GA):
    beam = bare(EA=1e10, GA=GA, EI=10.0)
    shape = beam.equilibrium(beam.point_load((0.0, 10.0)))
    assert_allclose(shape.tip[:2], oracles.BATISTA[GA], rtol=TOLERANCE)


def test_beam_of_geradin_and_cardona():
    EA, GA, EI = oracles.GERADIN_SECTION
    beam = Beam(5.0, Section(EA, GA, EI, 1.0), elements=20, gravity=(0.0, 0.0))
    u, w, theta = beam.equilibrium(beam.point_load((0.0, -600e3))).tip
    assert_allclose([5 + u, w, -theta], oracles.GERADIN_TIP, rtol=2e-6)  # seven digits printed


def test_convergence_order():
    """Quadratic elements with reduced integration: fourth order at the nodes."""
    exact = np.array(oracles.TIP_LOAD[5.0])
    errors = []
    for elements in (4, 8, 16):
        beam = bare(elements)
        errors.append(np.abs(tip(beam, beam.point_load((0.0, 5.0))) / exact - 1))
    order = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert_allclose(order, 4.0, atol=0.35)  # not yet asymptotic on four elements


def test_default_equilibrium():
    shape = Beam.cantilever(elements=30).equilibrium()
    assert_allclose(-shape.tip[1] / 0.45, 0.02173, atol=5e-6)  # all the digits that are known


def test_reaction_of_the_spring_at_rest():
    """The spring alone, without gravity, pulls the beam straight: EA u / L + k u = pretension."""
    beam = Beam.cantilever(elements=10, gravity=0.0)
    expected = 1.51 / (beam.section.EA / 0.45 + 24.4)
    assert_allclose(beam.equilibrium().tip[0], expected, rtol=1e-9)


def test_both_ends_clamped_carries_its_weight_by_stretching():
    beam = Beam(1.0, Section(1e4, 1e4, 1e-3, 1.0), elements=40, right=CLAMPED, gravity=(0.0, -1.0))
    shape = beam.equilibrium()
    # a cable of stiffness EA: sag^3 = 3 q L^4 / (64 EA); its bent ends make it 4 % smaller here
    assert_allclose(-shape.displacement[40, 1], (3 / (64 * 1e4)) ** (1 / 3), rtol=0.06)


@pytest.mark.parametrize("mode", [None, 1])
def test_release_shape_reaches_the_displacement_and_is_in_balance(mode):
    beam = Beam.cantilever(elements=20)
    shape = beam.release_shape(beam.length / 3, mode=mode)
    rest = beam.equilibrium()
    assert_allclose(shape.tip[1] - rest.tip[1], 0.15, rtol=1e-10)
    residual, _ = beam.assembly.residual(shape.displacement)
    residual -= np.where(beam.assembly.fixed, 0.0, shape.load)
    assert np.abs(residual).max() < 1e-14 * beam.section.EA  # rounding of the strains


def test_release_of_a_beam_that_is_clamped_at_both_ends():
    beam = Beam(1.0, Section(1e4, 1e4, 1.0, 1.0), elements=10, right=CLAMPED, gravity=(0.0, 0.0))
    shape = beam.release_shape(1e-4, at=0.5)
    assert_allclose(shape.displacement[10, 1], 1e-4, rtol=1e-10)
    # 192 EI / L^3, and shear as 4 GA / L beside it
    assert_allclose(shape.load[10, 1], 1e-4 / (1 / 192 + 1 / 4e4), rtol=1e-3)
    with pytest.raises(ValueError, match="at = None is a point that is held"):
        beam.release_shape(1e-4)


@pytest.mark.parametrize("amplitude", oracles.FINITE_AMPLITUDE)
def test_finite_amplitude_under_a_modal_force(amplitude):
    q, w, u, stretch, ratio = oracles.FINITE_AMPLITUDE[amplitude]
    beam = bare(40)
    modes = beam.modes(count=1)
    shapes = [
        beam.equilibrium(factor * amplitude * modes.momenta[0]).displacement
        for factor in (0.999, 1.0, 1.001)
    ]
    coordinates = [float(np.vdot(modes.momenta[0], x)) for x in shapes]
    x, found = shapes[1], coordinates[1]
    assert_allclose([found, x[-1, 1], amplitude / found], [q, w, ratio], rtol=TOLERANCE)
    assert_allclose(x[-1, 0], u, rtol=TOLERANCE, atol=1e-9)  # printed with nine decimals
    slope = (shapes[2] - shapes[0]) / (coordinates[2] - coordinates[0])
    inertia = float(np.vdot(slope, beam.assembly.mass_times(slope)))
    # the difference quotient over 0.2 % of the force leaves 1e-6; 2e-8 is its rounding
    assert_allclose(inertia - 1, stretch, rtol=TOLERANCE, atol=2e-8)


def test_no_equilibrium_is_a_named_error():
    floating = Beam(1.0, Section(1e4, 1e4, 1.0, 1.0), elements=4, left=FREE)
    with pytest.raises(NoEquilibriumError, match="check the springs and supports"):
        floating.equilibrium()


def test_release_beyond_reach():
    beam = Beam.cantilever(elements=10)
    with pytest.raises(ValueError, match=r"tip_displacement = 0\.5 m is beyond the reach"):
        beam.release_shape(0.5)
    with pytest.raises(ValueError, match="beyond the reach"):
        beam.release_shape(-0.445)  # the beam already hangs 0.01 m low
    with pytest.raises(NoEquilibriumError, match="ask for less"):
        beam.release_shape(0.4, mode=3)


@pytest.mark.parametrize("name", ["length", "width", "thickness", "young", "density"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_dimensions_must_be_positive(name, value):
    with pytest.raises(ValueError, match=f"{name} must be .*{value}"):
        Beam.cantilever(**{name: value})


@pytest.mark.parametrize("name", ["tip_mass", "spring_stiffness", "alpha", "eta"])
def test_negative_parameters(name):
    with pytest.raises(ValueError, match=f"{name} must be zero or positive.*-1"):
        Beam.cantilever(**{name: -1.0})


def test_anchor_on_the_tip():
    with pytest.raises(ValueError, match="move the anchor away"):
        Beam.cantilever(spring_length=0.0, spring_pretension=0.0)
    with pytest.raises(ValueError, match="move the anchor away"):
        Beam.cantilever().with_effect(Spring(at=0.2, anchor=(0.2, 0.0)))


def test_tension_beyond_the_spring():
    with pytest.raises(ValueError, match="spring_pretension = 5"):
        Beam.cantilever(spring_pretension=5.0)


@pytest.mark.parametrize("elements", [0, -3, 2.5])
def test_elements_must_be_a_positive_whole_number(elements):
    with pytest.raises(ValueError, match=f"elements must be .*{elements}"):
        Beam.cantilever(elements=elements)


def test_poisson_ratio_has_bounds():
    with pytest.raises(ValueError, match=r"poisson must lie in \(-1, 0.5\], got 0.7"):
        Beam.cantilever(poisson=0.7)


def test_load_off_the_beam():
    with pytest.raises(ValueError, match=r"at = 0\.6 m is off the beam"):
        Beam.cantilever(elements=4).point_load((0.0, 1.0), at=0.6)
