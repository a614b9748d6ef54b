import pickle

import numpy as np
import pytest

from romsindy.physics.terms import (
    DAMPING_KINDS,
    Inertia,
    LinearConvection,
    QuadraticInertia,
    RegularisedCoulomb,
    Stiffness,
    damping_term,
    term_from_key,
)

ALL = [
    *(Inertia(k) for k in (2, 3, 4, 5, 6, 9)),
    *(Stiffness(m) for m in (1, 2, 5)),
    *(damping_term(kind) for kind in DAMPING_KINDS),
    QuadraticInertia(),
    LinearConvection(),
]
SMOOTH = [term for term in ALL if term.smooth] + [RegularisedCoulomb(0.3)]
T = np.linspace(0.3, 1.9, 4001)
Q, Q_DOT, Q_DDOT = np.cos(T) + 0.2, -np.sin(T), -np.cos(T)


@pytest.mark.parametrize("term", ALL, ids=lambda t: t.key)
def test_weak_form_is_the_strong_form(term):
    """d2/dt2 second + d/dt first + zeroth, by finite differences, is the strong form."""
    weak = term.weak(Q, Q_DOT)
    dt = T[1] - T[0]
    total = np.zeros_like(T)
    if weak.second is not None:
        total += np.gradient(np.gradient(weak.second, dt), dt)
        # The stated rate is the derivative of what it belongs to.
        rate = np.gradient(weak.second, dt)
        np.testing.assert_allclose(weak.second_rate[2:-2], rate[2:-2], atol=1e-5)
    if weak.first is not None:
        total += np.gradient(weak.first, dt)
    if weak.zeroth is not None:
        total += weak.zeroth
    strong = term.strong(Q, Q_DOT, Q_DDOT)
    # Central differences of second order with dt = 4e-4 on functions of curvature below 100.
    np.testing.assert_allclose(total[3:-3], strong[3:-3], atol=3e-5)


@pytest.mark.parametrize("order", [2, 3, 4, 5, 8])
def test_inertia_is_lagranges_equation_of_its_kinetic_energy(order):
    """d/dt (dL/dq') - dL/dq of L = s q^(k-1) q'^2 / 2, s = 2 for even k (the paper's eq. 17)."""
    s = 2 if order % 2 == 0 else 1
    momentum = s * Q ** (order - 1) * Q_DOT
    force = s * (order - 1) / 2 * Q ** (order - 2) * Q_DOT**2
    lagrange = np.gradient(momentum, T) - force
    strong = Inertia(order).strong(Q, Q_DOT, Q_DDOT)
    np.testing.assert_allclose(lagrange[1:-1], strong[1:-1], atol=1e-5)


@pytest.mark.parametrize("degree", [1, 2, 5])
def test_potential_integrates_stiffness(degree):
    term = Stiffness(degree)
    q = np.linspace(0, 1.3, 20001)
    work = np.sum((term.stiffness(q)[1:] + term.stiffness(q)[:-1]) / 2 * np.diff(q))
    np.testing.assert_allclose(term.potential(1.3), work, rtol=1e-7)


@pytest.mark.parametrize("term", SMOOTH, ids=lambda t: t.key)
def test_derivatives_are_differences(term):
    h = 1e-5

    def difference(part, *steps):
        above, below = [(Q + sign * steps[0], Q_DOT + sign * steps[1]) for sign in (h, -h)]
        arguments = 2 if part == "damping" else 1
        function = getattr(term, part)
        return (function(*above[:arguments]) - function(*below[:arguments])) / (2 * h)

    # Central differences: h^2 times third derivatives below 1e3, and rounding of 1e-11.
    for part in ("inertia", "convection", "stiffness"):
        stated = getattr(term, f"{part}_dq")(Q)
        np.testing.assert_allclose(stated + 0 * Q, difference(part, 1, 0), atol=1e-7)
    by_q, by_q_dot = term.damping_dq(Q, Q_DOT), term.damping_dq_dot(Q, Q_DOT)
    np.testing.assert_allclose(by_q + 0 * Q, difference("damping", 1, 0), atol=1e-7)
    np.testing.assert_allclose(by_q_dot + 0 * Q, difference("damping", 0, 1), atol=1e-7)


def test_regularised_friction_is_friction_above_its_velocity_scale():
    friction = damping_term("coulomb")
    smooth = friction.regularised(0.01)
    fast = np.array([-2.0, -0.2, 0.2, 2.0])
    # 1 - tanh(20) is 1e-17.
    np.testing.assert_allclose(smooth.damping(0.0, fast), friction.damping(0.0, fast), rtol=1e-15)
    assert smooth.smooth and Stiffness(3).regularised(0.01) == Stiffness(3)
    with pytest.raises(ValueError, match="velocity_scale = 0 must be positive"):
        friction.regularised(0)


@pytest.mark.parametrize("term", ALL, ids=lambda t: t.key)
def test_damping_never_feeds_energy(term):
    assert np.all(np.asarray(term.damping(Q, Q_DOT) * Q_DOT) >= 0)


@pytest.mark.parametrize("term", ALL, ids=lambda t: t.key)
def test_dimension_follows_from_scaling(term):
    """Lengths in other units and times in other units scale a term by its dimension."""
    length, time = term.dimension
    scaled = term.strong(4 * Q, 4 / 2 * Q_DOT, 4 / 4 * Q_DDOT)
    expected = 4.0**length * 2.0**time * term.strong(Q, Q_DOT, Q_DDOT)
    np.testing.assert_array_equal(scaled, expected)  # powers of two scale without rounding


@pytest.mark.parametrize("term", ALL, ids=lambda t: t.key)
def test_key_pickle_and_scalars(term):
    assert term_from_key(term.key) == term == pickle.loads(pickle.dumps(term))
    value = term.strong(float(Q[7]), float(Q_DOT[7]), float(Q_DDOT[7]))
    np.testing.assert_allclose(value, term.strong(Q, Q_DOT, Q_DDOT)[7], rtol=1e-13)


def test_units_and_text():
    assert Inertia(4).expression() == "(2 q^3 q_ddot + 3 q^2 q_dot^2)"
    assert Inertia(2).expression() == "(2 q q_ddot + q_dot^2)"
    assert Stiffness(3).unit("m") == "1/(m^2 s^2)"
    assert damping_term("coulomb").unit("rad") == "rad/s^2"
    assert damping_term("cubic").unit("m") == "s/m^2"


@pytest.mark.parametrize("key", ["omega2", "gamma_1", "Upsilon_x", "c_quad", "gamma_1.5"])
def test_unknown_names_are_refused_with_a_hint(key):
    with pytest.raises(ValueError, match=r"is not known: use .*gamma_m or Upsilon_k"):
        term_from_key(key)
    with pytest.raises(ValueError, match=r"did you mean 'omega\^2'"):
        term_from_key("omega2")


@pytest.mark.parametrize("make", [lambda: Stiffness(0), lambda: Inertia(1), lambda: Inertia(2.5)])
def test_orders_are_checked(make):
    with pytest.raises(ValueError, match="must be a whole number of at least"):
        make()


def test_damping_kind_is_checked():
    with pytest.raises(ValueError, match=r"damping kind 'viscous' is not known: use one of"):
        damping_term("viscous")
