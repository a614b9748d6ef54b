"""The element as it is read against its own derivatives, and the compiled kernel against it."""

from __future__ import annotations

import beam_element as reference
import numpy as np
import pytest
from numpy.testing import assert_allclose

from romsindy.beam import Section, kernel
from romsindy.beam.assembly import element_mass

SECTION = Section(EA=5.0e3, GA=2.0e3, EI=3.0, mass=0.2, rotary_inertia=1e-3)
LENGTH = 0.3
ETA = 0.02
STIFFNESS = (LENGTH, SECTION.EA, SECTION.GA, SECTION.EI)
N_ELEMENTS = 4


@pytest.fixture
def field() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    shape = (2 * N_ELEMENTS + 1, 3)
    return 0.1 * rng.normal(size=shape), rng.normal(size=shape)


def central_difference(function, x, step=1e-6):
    columns = []
    for i in range(x.size):
        d = np.zeros(x.size)
        d[i] = step
        d = d.reshape(x.shape)
        columns.append((function(x + d) - function(x - d)).ravel() / (2 * step))
    return np.array(columns).T


def rotated(x: np.ndarray, s: np.ndarray, angle: float) -> np.ndarray:
    c, sn = np.cos(angle), np.sin(angle)
    px, py = s + x[:, 0], x[:, 1]
    return np.column_stack([c * px - sn * py - s, sn * px + c * py, x[:, 2] + angle])


def test_force_is_the_gradient_of_the_energy(field):
    x = field[0][:3]
    gradient = central_difference(
        lambda y: np.array(reference.strain_energy(y, LENGTH, SECTION)), x
    ).ravel()
    force = reference.internal_force(x, np.zeros((3, 3)), LENGTH, SECTION).ravel()
    assert_allclose(force, gradient, atol=1e-7 * np.abs(force).max())  # difference quotient


def test_tangent_is_the_derivative_of_the_force(field):
    x, v = field[0][:3], field[1][:3]
    K, D = reference.tangent(x, LENGTH, SECTION)
    rest = np.zeros((3, 3))
    numeric = central_difference(lambda y: reference.internal_force(y, rest, LENGTH, SECTION), x)
    assert_allclose(K, numeric, atol=1e-7 * np.abs(K).max())
    damping = central_difference(lambda y: reference.internal_force(x, y, LENGTH, SECTION, ETA), v)
    assert_allclose(ETA * D, damping, atol=1e-7 * np.abs(D).max())


def test_rigid_rotation_costs_nothing_and_is_not_damped(field):
    s = np.array([0.0, 0.5, 1.0]) * LENGTH
    x = rotated(np.zeros((3, 3)), s, 1.1)
    spin = np.column_stack([-x[:, 1], s + x[:, 0], np.ones(3)])  # rate of that rotation
    force = reference.internal_force(x, spin, LENGTH, SECTION, eta=1.0)
    assert_allclose(force, 0.0, atol=1e-11 * SECTION.EA)  # rounding of strains times EA


def test_force_turns_with_the_beam(field):
    s = np.array([0.0, 0.5, 1.0]) * LENGTH
    x = field[0][:3]
    still = np.zeros((3, 3))
    force = reference.internal_force(x, still, LENGTH, SECTION)
    turned = reference.internal_force(rotated(x, s, 0.7), still, LENGTH, SECTION)
    c, sn = np.cos(0.7), np.sin(0.7)
    expected = np.column_stack(
        [c * force[:, 0] - sn * force[:, 1], sn * force[:, 0] + c * force[:, 1], force[:, 2]]
    )
    assert_allclose(turned, expected, atol=1e-11 * SECTION.EA)


def test_mass_of_rigid_motions():
    M = element_mass(LENGTH, SECTION)
    s = np.array([0.0, 0.5, 1.0]) * LENGTH
    slide = np.tile([0.0, 1.0, 0.0], 3)
    spin = np.column_stack([0 * s, s, np.ones(3)]).ravel()
    assert_allclose(slide @ M @ slide, SECTION.mass * LENGTH, rtol=1e-14)
    inertia = SECTION.mass * LENGTH**3 / 3 + SECTION.rotary_inertia * LENGTH
    assert_allclose(spin @ M @ spin, inertia, rtol=1e-14)


def test_kernel_equals_element(field):
    x, v = field
    out = np.zeros_like(x)
    power = kernel.add_internal_force(x, v, *STIFFNESS, ETA, out)
    G, D = kernel.tangent(x, *STIFFNESS)
    force, energy, dissipated = np.zeros_like(x), 0.0, 0.0
    for e in range(N_ELEMENTS):
        nodes = slice(2 * e, 2 * e + 3)
        force[nodes] += reference.internal_force(x[nodes], v[nodes], LENGTH, SECTION, ETA)
        energy += reference.strain_energy(x[nodes], LENGTH, SECTION)
        K_e, D_e = reference.tangent(x[nodes], LENGTH, SECTION)
        dissipated += ETA * v[nodes].ravel() @ D_e @ v[nodes].ravel()
        # the same formulas in another order of summation: a few roundings apart
        assert_allclose(D[e], D_e, atol=1e-14 * np.abs(D_e).max())
        assert_allclose(G[e] + D[e], K_e, atol=1e-14 * np.abs(K_e).max())
    assert_allclose(out, force, atol=1e-13 * np.abs(force).max())
    assert_allclose(kernel.strain_energy(x, *STIFFNESS), energy, rtol=1e-13)
    assert_allclose(power, dissipated, rtol=1e-12)


def test_small_strains_keep_their_digits():
    """A uniform stretch, turned a little, stores EA eps^2 / 2 per length and shears nothing."""
    stretch, angle = 1e-12, 1e-5
    s = LENGTH / 2 * np.arange(2 * N_ELEMENTS + 1)
    x = np.zeros((len(s), 3))
    x[:, 0] = s * (stretch * np.cos(angle) - 2 * np.sin(angle / 2) ** 2)
    x[:, 1] = s * (1 + stretch) * np.sin(angle)
    x[:, 2] = angle
    # u' of 5e-11 rounds at 1e-26, 1e-14 of the stretch; beside 1 it would round at 1e-4 of it
    energy = 0.5 * SECTION.EA * stretch**2 * s[-1]
    assert_allclose(kernel.strain_energy(x, *STIFFNESS), energy, rtol=1e-12)
    out = np.zeros_like(x)
    kernel.add_internal_force(x, np.zeros_like(x), *STIFFNESS, 0.0, out)
    assert_allclose(out[-1, 0], SECTION.EA * stretch, rtol=1e-9)  # turned: angle^2 / 2 less


@pytest.mark.parametrize("shift", [2.0, 2.0 + 1.0j])
def test_frontal_solution_equals_dense(field, shift):
    _, D = kernel.tangent(field[0], *STIFFNESS)
    mass = np.array([element_mass(LENGTH, SECTION)] * N_ELEMENTS)
    matrices = mass + shift * D
    n = field[0].size
    fixed = np.zeros(field[0].shape, dtype=bool)
    fixed[0], fixed[-1, 1] = True, True
    dense = np.zeros((n, n), dtype=matrices.dtype)
    for e in range(N_ELEMENTS):
        dense[6 * e : 6 * e + 9, 6 * e : 6 * e + 9] += matrices[e]
    held = fixed.ravel()
    dense[held], dense[:, held] = 0.0, 0.0
    dense[held, held] = 1.0
    rhs = field[1].ravel().astype(matrices.dtype)
    expected = np.linalg.solve(dense, rhs)
    kernel.factorise(matrices, fixed)
    kernel.solve(matrices, rhs)
    assert_allclose(rhs, expected, atol=1e-10 * np.abs(expected).max())  # conditioning about 1e5


def test_section_of_a_rectangle():
    section = Section.rectangle(0.025, 0.001, young=210e9, density=7800.0, poisson=0.3)
    assert_allclose(section.EI, 210e9 * 0.025 * 0.001**3 / 12, rtol=1e-14)
    assert_allclose(section.GA, 5 / 6 * 210e9 / 2.6 * 2.5e-5, rtol=1e-14)
