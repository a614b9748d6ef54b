"""Direct reduced-order modelling against the exact coefficients of the elastica."""

from __future__ import annotations

import beam_oracles as oracles
import numpy as np
import pytest
from numpy.testing import assert_allclose

from romsindy.beam import CLAMPED, Beam, Section, relative_error, solve_static_cases
from romsindy.physics.model import ReducedModel

# so slender that stretch and shear change nothing above 1e-6
SLENDER = Section(EA=1e8, GA=1e8, EI=1.0, mass=1.0)


def bare() -> Beam:
    return Beam(1.0, SLENDER, elements=40, gravity=(0.0, 0.0))


@pytest.mark.parametrize("mode", oracles.SINGLE_MODE)
def test_cubic_coefficients_of_the_bare_cantilever(mode):
    model = bare().reduce(mode=mode, order=9, amplitude=0.1 / mode**2).coefficients
    found = [model[name] for name in ("omega^2", "gamma_3", "Upsilon_3")]
    assert_allclose(found, oracles.SINGLE_MODE[mode], rtol=2e-5)  # the issue asks for 1e-4


def test_quintic_coefficients_of_the_bare_cantilever():
    model = bare().reduce(order=9, amplitude=0.1).coefficients
    # least squares of order 9 is not quite the Taylor series: 5e-5
    assert_allclose(model["gamma_5"], oracles.GAMMA_5, rtol=2e-4)
    assert_allclose(model["Upsilon_5"], oracles.UPSILON_5, rtol=2e-4)


def test_odd_terms_vanish_by_symmetry():
    model = bare().reduce(order=7, amplitude=0.1).coefficients
    a = 0.1
    assert abs(model["gamma_2"] * a) < 1e-6 * model["omega^2"]
    assert abs(model["gamma_4"] * a**3) < 1e-6 * model["omega^2"]
    assert abs(model["Upsilon_4"] * a**3) < 1e-6


def test_dimensional_example():
    beam = Beam.cantilever(
        length=0.3, young=205e9, tip_mass=0, spring_stiffness=0, gravity=0, elements=120
    )
    scale = np.sqrt(beam.section.mass * 0.3) * 0.3  # q of the nondimensional beam
    model = beam.reduce(order=9, amplitude=0.1 * scale).coefficients
    truth = oracles.EXAMPLE
    modes = beam.modes(count=24)
    assert_allclose(modes.omega[0], truth["omega"], rtol=3e-5)
    assert_allclose(modes.omega[modes.axial > 0.5][0], truth["axial"], rtol=1e-5)
    # h/L = 1/300: stretch and shear are 3e-5 ... 1.3e-4, as another code has found
    for name in ("gamma_3", "Upsilon_3"):
        assert_allclose(model[name], truth[name], rtol=1e-4)
    for name in ("gamma_5", "Upsilon_5"):
        assert_allclose(model[name], truth[name], rtol=5e-4)


def test_default_system_near_its_taylor_series():
    """Reconstructed values, printed with two to four digits."""
    model = Beam.cantilever(elements=30).reduce(order=11).coefficients
    assert_allclose(model["omega^2"], 1482.2, rtol=2e-4)
    assert_allclose(model["gamma_2"], -5.1e3, rtol=0.01)
    assert_allclose(model["gamma_3"], 1.255e6, rtol=0.01)
    assert_allclose(model["gamma_4"], 2.4e7, rtol=0.03)
    assert_allclose(model["gamma_5"], -3.0e9, rtol=0.03)
    assert_allclose(model["Upsilon_3"], 229.7, rtol=1e-3)


def test_default_system_fitted_over_its_release():
    """Order 5 depends on the range and the spacing of the fit: a few per cent."""
    model = Beam.cantilever(elements=30).reduce(order=5, amplitude=0.024).coefficients
    assert_allclose(model["gamma_2"], -3.05e3, rtol=0.03)
    assert_allclose(model["gamma_3"], 9.60e5, rtol=0.03)
    assert_allclose(model["gamma_5"], -6.2e8, rtol=0.08)
    assert_allclose(model["Upsilon_3"], 226.9, rtol=0.01)
    assert_allclose(model["Upsilon_5"], 5.05e4, rtol=0.06)


def test_inertia_of_the_model_is_that_of_the_static_shapes():
    beam = Beam.cantilever(elements=20)
    cases = solve_static_cases(beam.assembly, beam.equilibrium(), 1, 0.02, 80)
    order = np.argsort(cases.q)
    q, x = cases.q[order], cases.displacement[order]
    slope = (x[2:] - x[:-2]) / (q[2:] - q[:-2])[:, None, None]
    inertia = [np.vdot(d, beam.assembly.mass_times(d)) for d in slope]
    model = beam.reduce(order=9, amplitude=0.02, cases=80)
    assert isinstance(model, ReducedModel)
    middle = slice(20, -20)
    # what a fit of order 8 leaves out shows at its ends; inside, central differences leave 1e-5
    assert_allclose(model.inertia(q[1:-1])[middle], np.array(inertia)[middle], rtol=2e-4)


def test_clamped_clamped_beam_hardens_by_stretching():
    """gamma_3 = EA / (2 L) (int phi'^2)^2 of the straight beam, whose axial inertia is small."""
    section = Section(EA=1e5, GA=1e8, EI=1.0, mass=1.0)
    beam = Beam(1.0, section, elements=40, right=CLAMPED, gravity=(0.0, 0.0))
    # int phi'^2 = 12.3026 for the mass-normalised first mode (R. D. Blevins, Formulas for Natural
    # Frequency and Mode Shape, 1979, table C-1)
    model = beam.reduce(order=7, amplitude=0.002).coefficients
    # bending stiffness beside EA: the error is 88 EI / (EA L^2), ten times less for ten times EA
    assert_allclose(model["gamma_3"], 0.5 * 1e5 * 12.3026**2, rtol=1e-3)


def test_relative_error():
    assert relative_error({"a": 1.5, "b": 2.0}, {"a": 1.0, "b": 2.0}) == {"a": 0.5, "b": 0.0}
    assert relative_error({}, {"a": 1.0}) == {"a": 1.0}
    assert np.isnan(relative_error({"a": 1.0}, {"a": 0.0})["a"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"order": 2}, "order = 2 leaves no inertia term"),
        ({"cases": 6}, "cases = 6 static cases are too few"),
        ({"amplitude": 0.0}, "amplitude must be positive"),
        ({"mode": 0}, "mode = 0 does not exist"),
    ],
)
def test_bad_input(options, message):
    with pytest.raises(ValueError, match=message):
        Beam.cantilever(elements=5).reduce(**options)
