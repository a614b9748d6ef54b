"""A curved sensor and its offset: no inertia, and what of inertia they could be."""

import numpy as np
import pytest

import romsindy as rs
from romsindy.fit.functions.series import SensorCurvature, curvature_for
from romsindy.physics.example import add_noise


def test_what_a_sensor_shows_and_its_derivatives():
    sensor, x = SensorCurvature(0.01, 2), np.linspace(-2, 2, 7)
    values = np.array([0.03, 0.1, -0.2])
    shown, slope = sensor.shown(values, x, 2.0, 1)
    assert shown == pytest.approx(x + 0.03 * x * x / 2 - 0.2 * 2)
    step = 1e-6
    more = sensor.shown(values, x + step, 2.0, 1)[0]
    assert slope == pytest.approx((more - shown) / step, abs=1e-6)
    for i, column in enumerate(sensor.by_value(x, 2.0, 1).T):
        moved = sensor.shown(values + step * np.eye(3)[i], x, 2.0, 1)[0]
        assert column == pytest.approx((moved - shown) / step, abs=1e-6)


def test_the_curvature_that_stands_for_inertia():
    """x = q + 0.05 q^3 of a plain oscillator, read as q: h = (dx/dq)^2 - 1, exactly."""
    q = np.linspace(0, 0.8, 400)
    h = (1 + 0.15 * q**2) ** 2 - 1
    straight = 0.8 + 0.05 * 0.8**3
    assert curvature_for(q, h) == pytest.approx(1 - 0.8 / straight, rel=1e-5)  # trapezoids: h^2


def read(e, offset, inertia=0.0, derivative=0, seed=0):
    """Forty cycles at 45 dB through a sensor that shows y + e y^2 / y_max + offset y_max."""
    coefficients = {"omega^2": 900.0, "gamma_2": 60.0, "gamma_3": 250.0, "c_linear": 0.5}
    model = rs.ReducedModel.from_coefficients(coefficients | {"Upsilon_3": inertia}, unit="m")
    t = np.arange(1200) / 150
    motion = model.simulate(1.0, 0.0, t)
    y = (motion.q, motion.q_dot)[derivative]
    largest = np.abs(y).max()
    shown = y + e * y * y / largest + offset * largest
    if derivative:
        return add_noise(rs.Decay.from_velocity(t, shown, unit="m"), 45, seed)
    return add_noise(rs.Decay(t, shown, unit="m"), 45, seed)


@pytest.fixture(scope="module")
def curved():
    """Through a sensor that is curved by 3 %, three times what is expected."""
    return rs.identify(read(0.03, -0.015))


def test_a_curved_sensor_is_no_inertia(curved):
    assert curved.structure.name == "stiffness polynomial" and curved.verdict.explained
    text = str(curved)
    assert "do not ask for inertia" in text and "the sensor seems to be curved" in text.lower()
    q = np.array([-0.7, 0.7])
    k = curved.stiffness(q)
    exact = 900 + 60 * q + 250 * q * q
    assert np.all((k.low - 2 <= exact) & (exact <= k.high + 2))  # bands, and 0.2 % beside them


@pytest.mark.slow
@pytest.mark.parametrize(("e", "derivative"), [(-0.05, 0), (0.02, 1)])
def test_other_signs_and_quantities(e, derivative):
    found = rs.identify(read(e, 0.01, derivative=derivative, seed=3))
    assert found.structure.name == "stiffness polynomial" and found.verdict.explained


@pytest.mark.slow
def test_inertia_is_found_beside_a_straight_sensor_and_said_to_be_one_of_two():
    """h = 0.3 q^2: a straight sensor shows asinh-like 4.6 % more at q = 1."""
    found = rs.identify(read(0.0, 0.0, inertia=0.3), curvature=0.002)
    assert found.structure.name == "IC-ROM"
    note = next(n for n in found.notes if "one sensor cannot tell" in n)
    q = np.linspace(0, 1, 2000)
    stated = float(note.split("one that shows ")[1].split(" %")[0])
    assert stated == pytest.approx(100 * curvature_for(q, 0.3 * q * q), rel=0.2)  # band of h
    assert "0.2 % is expected" in note


@pytest.mark.parametrize("value", [-0.01, 1.5, float("nan"), True])
def test_a_curvature_that_is_none_is_refused(value):
    with pytest.raises(ValueError, match=r"curvature = .* must be a part of the largest"):
        rs.identify(rs.example_decay(), curvature=value)
