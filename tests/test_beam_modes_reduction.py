"""Reduced models of several modes against static shapes, orbits and motions of the beam itself."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq, root

from romsindy.beam import Beam, NoEquilibriumError
from romsindy.beam.static_shapes import find_static_surface, shells
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.model import ReducedModel


@pytest.fixture(scope="module")
def beam():
    return Beam.cantilever(elements=20)


def following(model, q):
    """Where all forces but the first vanish: r with r_1 = q, and dr/dq."""
    r, rest = np.zeros(model.n_coordinates), np.zeros(model.n_coordinates)
    r[0] = q
    for _ in range(10):  # Newton doubles the digits: five steps would do
        slope = model.linearise(r, rest, rest)[1]
        r[1:] -= np.linalg.solve(slope[1:, 1:], model.stiffness(r)[1:])
    slope = model.linearise(r, rest, rest)[1]
    return r, np.array([1.0, *-np.linalg.solve(slope[1:, 1:], slope[1:, 0])])


@pytest.mark.parametrize(
    ("reach", "order", "tolerance"),
    [
        (0.0071, 9, 1e-6),  # the tip moves by 0.1 L; left are 1.1e-7 of V, 3e-9 of the inertia
        pytest.param(
            0.0142, 9, 4e-5, marks=pytest.mark.slow
        ),  # 0.2 L; 1.4e-5 and 7e-7: the spring is about as short as this motion
        pytest.param(0.0214, 9, 4e-4, marks=pytest.mark.slow),  # 0.3 L; 1.2e-4 and 1.3e-5
    ],
)
def test_the_model_of_one_mode_is_on_the_curve_where_the_second_follows(
    beam, reach, order, tolerance
):
    curve = beam.static_curve(amplitude=reach, cases=20)
    second = np.abs(curve.basis.coordinates(curve.shapes)[:, 1]).max()
    model = beam.reduce(modes=(1, 2), order=order, amplitude=(1.05 * reach, 6 * second))
    places, tangents = map(np.array, zip(*[following(model, q) for q in curve.q], strict=True))
    inertia = np.einsum("ni,nij,nj->n", tangents, model.inertia(places), tangents)
    assert_allclose(inertia, curve.inertia, atol=tolerance * curve.inertia.max())
    energy = np.array([beam.assembly.strain(x) + beam.assembly.potential(x) for x in curve.shapes])
    energy -= energy[len(energy) // 2]
    assert_allclose(model.potential(places), energy, atol=tolerance * energy.max())


def test_static_forces_are_reciprocal(beam):
    """dr_1/df_2 = dr_2/df_1, from shapes under loads alone."""
    basis = beam.modes(count=2)
    force = np.array([12.0, 40.0])  # r is about (0.007, 0.001) there

    def coordinates(change):
        load = np.tensordot(force + change, basis.momenta, axes=1)
        return basis.coordinates(beam.equilibrium(load).displacement)

    def slopes(step):
        ends = [coordinates(step * row) - coordinates(-step * row) for row in np.eye(2)]
        return np.array(ends) / (2 * step)

    # Differences of fourth order: 2e-10 of the largest remains.
    compliance = (4 * slopes(0.25) - slopes(0.5)) / 3
    assert abs(compliance[0, 1]) > 0.1 * compliance[1, 1]
    assert abs(compliance[0, 1] - compliance[1, 0]) < 2e-9 * compliance[0, 0]


def test_tangents_are_those_of_differences_and_the_inertia_is_theirs(beam):
    basis, amplitudes = beam.modes(count=2), (0.006, 0.001)
    surface = find_static_surface(beam.assembly, beam.equilibrium(), (1, 2), amplitudes, 49)
    momenta = basis.momenta
    moved = np.einsum("nixk,jxk->nij", surface.tangents, momenta)
    assert_allclose(moved, np.broadcast_to(np.eye(2), moved.shape), atol=1e-10)
    model = beam.reduce(modes=(1, 2), order=7, amplitude=amplitudes)
    mass = [[beam.assembly.mass_times(t) for t in pair] for pair in surface.tangents]
    inertia = np.einsum("nixk,njxk->nij", surface.tangents, mass)
    # Order 7 leaves 2e-8 of an inertia that changes by 0.015, and 3e-6 of the force.
    assert_allclose(model.inertia(surface.r), inertia, atol=1e-7)
    assert_allclose(model.stiffness(surface.r), surface.force, atol=1e-5 * surface.force.max())


def test_what_follows_is_in_the_coefficients_of_fewer_modes(beam):
    """Of the Taylor series: mode 3 follows as -V_113 r_1^2 / omega_3^2, and so on."""
    options = {"order": 5, "cases": 343}
    three = beam.reduce(modes=(1, 2, 3), amplitude=(1e-3, 3e-4, 1e-4), **options).coefficients
    two = beam.reduce(modes=(1, 2), amplitude=(1e-3, 3e-4), **options).coefficients
    one = beam.reduce(mode=1, order=5, amplitude=1e-3).coefficients
    # At these amplitudes order 5 leaves 5e-6; what follows makes up 3e-4 or more.
    for name in ("gamma_2 [q1]", "V q1^2 q2", "V q1 q2^2", "gamma_2 [q2]"):
        assert two[name] == pytest.approx(three[name], rel=2e-5)
    assert one["gamma_2"] == pytest.approx(two["gamma_2 [q1]"], rel=2e-5)
    for fewer, name, more, mode in ((one, "", two, 2), (two, " [q1]", three, 3)):
        share = more[f"V q1^2 q{mode}"] / more[f"omega^2 [q{mode}]"]
        lost = 2 * share**2 * more[f"omega^2 [q{mode}]"]
        assert fewer[f"gamma_3{name}"] == pytest.approx(more["gamma_3 [q1]"] - lost, rel=2e-5)
        slaved = fewer["g(q1^2)^2"] if name else fewer["Upsilon_3"] / 4
        assert slaved == pytest.approx(more["g(q1^2)^2"] + share**2, rel=2e-5)


def test_the_order_of_the_modes_is_that_of_the_coordinates(beam):
    there = beam.reduce(modes=(1, 2), order=3, amplitude=(0.004, 0.001)).coefficients
    back = beam.reduce(modes=(2, 1), order=3, amplitude=(0.001, 0.004)).coefficients
    for name, other in (("omega^2 [q1]", "omega^2 [q2]"), ("V q1^2 q2", "V q1 q2^2")):
        assert there[name] == pytest.approx(back[other], rel=1e-9)  # rounding of least squares
    assert there["g(q1^2)^2"] == pytest.approx(back["g(q2^2)^2"], rel=1e-9)


def half_period(model, start, omega):
    """From rest until the first coordinate turns: time, and what the others still move."""
    t = np.linspace(0.0, 0.8 * 2 * np.pi / omega, 400)
    motion = model.simulate(start, np.zeros(len(start)), t, rtol=1e-9)
    velocity = CubicHermiteSpline(t, motion.q_dot, motion.q_ddot)
    sign = np.sign(motion.q_dot[:, 0])
    at = 100 + int(np.flatnonzero(sign[100:-1] != sign[101:])[0])
    turn = brentq(lambda s: velocity(s)[0], t[at], t[at + 1], xtol=1e-14)
    return turn, velocity(turn)[1:] / np.abs(motion.q_dot[:, 0]).max()


def orbit_frequency(model, start, omega):
    """Of the periodic orbit that starts from rest at the first coordinate of `start`."""
    first, *others = start
    found = root(lambda x: half_period(model, [first, *x], omega)[1], others, tol=1e-9).x
    turn, left = half_period(model, [first, *found], omega)
    assert np.abs(left).max() < 1e-6
    return np.pi / turn


@pytest.mark.parametrize("share", [0.1, pytest.param(0.3, marks=pytest.mark.slow)])
def test_orbits_are_those_of_the_beam(share):
    beam = Beam.cantilever(elements=12)
    orbit = beam.normal_mode([share * beam.length], progress=False)
    start = beam.modes(count=2).coordinates(orbit.shapes[0].displacement)
    reach = (1.1 * start[0], 0.1 * start[0])
    model = beam.reduce(modes=(1, 2), order=9, amplitude=reach)
    shift = orbit_frequency(model, start, orbit.linear_frequency) / orbit.linear_frequency - 1
    # The issue asks for 1 %; 0.02 % is left, where one coordinate leaves 0.2 % at 0.3 L.
    assert shift == pytest.approx(orbit.frequency[0] / orbit.linear_frequency - 1, rel=1e-3)


@pytest.mark.slow
def test_orbits_near_one_to_three_need_the_second_mode():
    beam = Beam.cantilever(
        elements=12,
        spring_stiffness=100.0,
        spring_length=0.1,
        spring_pretension=6.75,
        gravity=0.0,
    )
    basis = beam.modes(count=2)
    assert basis.omega[1] / basis.omega[0] == pytest.approx(3.0, abs=5e-3)
    orbit = beam.normal_mode([0.07 * beam.length], progress=False)
    start = basis.coordinates(orbit.shapes[0].displacement)
    omega, shift = basis.omega[0], orbit.frequency[0] / basis.omega[0] - 1
    two = beam.reduce(modes=(1, 2), order=7, amplitude=(1.1 * start[0], 0.3 * start[0]))
    one = beam.reduce(mode=1, order=7, amplitude=1.1 * start[0])
    # 0.01 % and 6 % are left; the second mode holds 5 % of the first at the turning point.
    assert orbit_frequency(two, start, omega) / omega - 1 == pytest.approx(shift, rel=1e-3)
    assert abs((one.backbone([start[0]])[0] / omega - 1) / shift - 1) > 0.05


@pytest.mark.slow
def test_motion_of_two_modes_is_that_of_the_beam():
    beam = Beam.cantilever(elements=12, alpha=0.0, eta=0.0)
    two = beam.reduce(modes=(1, 2), order=7, amplitude=(0.0125, 0.003))
    one = beam.reduce(mode=1, order=7, amplitude=0.0125)
    basis = beam.modes(count=2)
    load = np.tensordot(two.stiffness([0.01, 0.002]), basis.momenta, axes=1)
    shape = beam.equilibrium(load)
    start = basis.coordinates(shape.displacement)
    assert_allclose(start, [0.01, 0.002], atol=1e-7)  # the forces of the model hold it there
    motion = beam.simulate(shape, 1.0, 2.5e-4, modes=basis, progress=False)
    truth = motion.coordinates.displacement

    def left(q, truth):
        return np.sqrt(np.mean((q - truth) ** 2) / np.mean(truth**2))

    simulated = two.simulate(start, [0.0, 0.0], motion.t, rtol=1e-9).q
    alone = one.simulate(start[0], 0.0, motion.t).q
    # Six cycles of mode 1, 27 of mode 2: 4e-4 and 5e-3 are left, and 3.6e-2 by one coordinate.
    assert left(simulated[:, 0], truth[:, 0]) < 1e-3
    assert left(simulated[:, 1], truth[:, 1]) < 1e-2
    assert left(alone, truth[:, 0]) > 20 * left(simulated[:, 0], truth[:, 0])


def test_one_mode_stays_a_model_of_one_coordinate(beam):
    model = beam.reduce(modes=(2,), amplitude=[0.001])
    assert isinstance(model, ReducedModel)
    assert model == beam.reduce(mode=2, amplitude=0.001) == beam.reduce(2, 5, 0.001, 41)
    several = beam.reduce(modes=[1, 2], order=3, amplitude=[0.004, 0.001])
    assert isinstance(several, CoupledModel)
    assert (several.unit, several.amplitude_range) == ("kg^0.5 m", (0.0, 0.004))


@pytest.mark.parametrize(("dimensions", "cases", "points"), [(2, 26, 49), (3, 27, 27), (1, 4, 5)])
def test_shells_fill_the_ball_from_its_centre(dimensions, cases, points):
    found = shells(dimensions, cases)
    assert found.shape == (points, dimensions)
    radius = np.linalg.norm(found, axis=1)
    assert radius[0] == 0.0 and radius[-1] == pytest.approx(1.0)
    assert np.all(np.diff(radius) > -1e-12)
    assert len(np.unique(found.round(9), axis=0)) == points


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"modes": (1, 1)}, r"modes = \(1, 1\) holds a mode twice"),
        ({"modes": (0, 1)}, "mode = 0 does not exist; modes count from 1"),
        ({"modes": (1, 99)}, "mode = 99 does not exist on this mesh, which has 28"),
        ({"modes": ()}, r"amplitude = \(0.01, 0.002\) is no amplitude for each of the modes"),
        ({"amplitude": 0.01}, r"amplitude = 0.01 is no amplitude .* modes \(1, 2\)"),
        ({"amplitude": (0.01, 0.0)}, "amplitude must be positive"),
        ({"order": 2}, "order = 2 leaves no inertia term"),
        ({"cases": 48}, "cases = 48 static cases are too few for order 5 of 2 modes; give 49"),
    ],
)
def test_bad_input(options, message):
    asked = {"modes": (1, 2), "amplitude": (0.01, 0.002), **options}
    with pytest.raises(ValueError, match=message):
        Beam.cantilever(elements=5).reduce(**asked)


def test_too_far():
    with pytest.raises(NoEquilibriumError, match=r"at .*, .*; the beam .* ask for less"):
        Beam.cantilever(elements=5).reduce(modes=(1, 2), amplitude=(0.5, 0.5))
