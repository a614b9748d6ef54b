"""Every law: weak forms, derivatives, potentials, energy, dimensions, names and JSON."""

import json
import pickle
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import quad

from romsindy.physics.damping import (
    DAMPING,
    AmplitudeDamping,
    Friction,
    PowerDamping,
    RubbingFriction,
    damping_law,
)
from romsindy.physics.inertia import AddedMass, Inertia, LinearConvection, QuadraticInertia
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import ConstantForce, GapForce, MagnetForce, Stiffness, StopForce
from romsindy.physics.term import Combination, ForceLaw, Term, unit_text
from romsindy.physics.term_sum import term_from_key

POLYNOMIAL = [
    *(Inertia(k) for k in (2, 3, 4, 5, 6, 9)),
    *(Stiffness(m) for m in (1, 2, 5)),
    *DAMPING.values(),
    QuadraticInertia(),
    LinearConvection(),
]
SHAPED = [
    PowerDamping(2.1),
    AmplitudeDamping(1.9),
    Friction(1.05),
    RubbingFriction(0.1),
    RubbingFriction(-0.2, -1),
    Stiffness(2.97),
    Stiffness(2, odd=True),
    Stiffness(4, odd=True),
    ConstantForce(),
    AddedMass(),
    StopForce(0.3),
    StopForce(-0.3, -1, 1.25),
    GapForce(0.4),
    GapForce(0.4, 1.5),
    MagnetForce(1.7),
    MagnetForce(1.7, -1, 2.1),
]
COMBINED = Combination(
    "bending_stiffness",
    (Stiffness(1), Inertia(3), PowerDamping(1), AmplitudeDamping(2)),
    (30.0, -0.2, 0.1, 0.3),
)
ALL = [*POLYNOMIAL, *SHAPED]
T = np.linspace(0.3, 1.9, 4001)
Q, Q_DOT, Q_DDOT = np.cos(T) + 0.2, -np.sin(T), -np.cos(T)
OFF_KINKS = np.array([-0.93, -0.55, -0.21, 0.17, 0.47, 0.88])
SPEEDS = np.array([1.3, -0.7, 0.4, -2.0, 0.9, -0.3])


@pytest.mark.parametrize("term", [*POLYNOMIAL, COMBINED], ids=lambda t: t.key)
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


@pytest.mark.parametrize(
    "law", [t for t in [*ALL, COMBINED] if t.has("stiffness")], ids=lambda t: t.key
)
def test_potential_is_the_work_against_the_force(law):
    kinks = [-0.4, -0.3, 0.3, 0.4]
    for q in OFF_KINKS:
        work = quad(lambda x: float(law.stiffness(np.array(x))), 0, q, points=kinks, limit=200)[0]
        assert law.potential(np.array(q)) == pytest.approx(work, abs=1e-7)


@pytest.mark.parametrize(
    "term",
    [*ALL, COMBINED, Friction(creep=0.3), Friction(1.05, 0.2)],
    ids=str,
)
def test_derivatives_are_differences(term):
    q, v, h = OFF_KINKS, SPEEDS, 1e-6

    def difference(part, dq, dv):
        above, below = [(q + s * h * dq, v + s * h * dv) for s in (1, -1)]
        arguments = 2 if part == "damping" else 1
        function = getattr(term, part)
        return (function(*above[:arguments]) - function(*below[:arguments])) / (2 * h)

    # Central differences: h^2 times third derivatives, and rounding of 1e-16 / h.
    for part in ("inertia", "convection", "stiffness"):
        stated = getattr(term, f"{part}_dq")(q)
        np.testing.assert_allclose(stated + 0 * q, difference(part, 1, 0), rtol=1e-7, atol=1e-8)
    by_q, by_v = term.damping_dq(q, v), term.damping_dq_dot(q, v)
    np.testing.assert_allclose(by_q + 0 * q, difference("damping", 1, 0), rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(by_v + 0 * q, difference("damping", 0, 1), rtol=1e-7, atol=1e-8)


def test_regularised_friction_is_friction_above_its_velocity_scale():
    friction = damping_law("coulomb")
    smooth = friction.regularised(0.01)
    fast = np.array([-2.0, -0.2, 0.2, 2.0])
    # 1 - tanh(20) is 1e-17.
    np.testing.assert_allclose(smooth.damping(0.0, fast), friction.damping(0.0, fast), rtol=1e-15)
    assert smooth.smooth and Stiffness(3).regularised(0.01) == Stiffness(3)
    assert smooth.key == friction.key and smooth.jumping() == friction
    with pytest.raises(ValueError, match="velocity_scale = 0 must be positive"):
        friction.regularised(0)


@pytest.mark.parametrize("law", [Friction(), Friction(1.05), RubbingFriction(0.1)], ids=str)
def test_averaged_friction_is_the_mean_over_the_step(law):
    """Quadrature of the jump in the speed, with the normal force of the middle."""
    q, v, change = np.array([0.5, 0.3, -0.4]), np.array([0.02, -0.3, 0.07]), 0.1
    mean = law.averaged(q, v, np.zeros(3), np.full(3, change))
    speeds = v[:, None] + change * (2 * (np.arange(20000) + 0.5) / 20000 - 1)
    expected = np.mean(law.damping(q[:, None], speeds), axis=1)
    np.testing.assert_allclose(mean.force, expected, atol=1e-4)  # one sample of the quadrature


@pytest.mark.parametrize("law", [Friction(), Friction(1.05), RubbingFriction(0.1)], ids=str)
def test_friction_with_creep_has_the_mean_and_the_slopes_of_its_weights(law):
    """Quadrature by weights on a line down to both ends, and central differences."""
    q, v, change, creep = np.array([0.5, 0.3, -0.4]), np.array([0.02, -0.3, 0.07]), 0.09, 0.05
    mean = law.averaged(q, v, np.zeros(3), np.full(3, change), creep)
    place = 2 * (np.arange(20000) + 0.5) / 20000 - 1
    speeds = v[:, None] + np.hypot(change, creep) * place
    there = law.damping(q[:, None], speeds) * 2 * (1 - np.abs(place))
    np.testing.assert_allclose(mean.force, np.mean(there, axis=1), atol=1e-4)  # one sample

    def force(dv, dc):
        return law.averaged(q, v + dv, np.zeros(3), np.full(3, change + dc), creep).force

    h = 1e-6
    np.testing.assert_allclose(mean.by_q_dot, (force(h, 0) - force(-h, 0)) / (2 * h), atol=1e-7)
    np.testing.assert_allclose(mean.by_change, (force(0, h) - force(0, -h)) / (2 * h), atol=1e-7)


@pytest.mark.parametrize("term", ALL, ids=lambda t: t.key)
def test_damping_never_feeds_energy(term):
    assert np.all(np.asarray(term.damping(Q, Q_DOT) * Q_DOT) >= 0)


@pytest.mark.parametrize("term", POLYNOMIAL, ids=lambda t: t.key)
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


@pytest.mark.parametrize("law", [*ALL, COMBINED], ids=lambda t: t.key)
def test_json_holds_type_and_fields(law):
    model = ReducedModel((Stiffness(7), law), (30.0, 0.5), "m", (0.0, 1.0))
    assert ReducedModel.from_json(model.to_json()) == model
    assert law.key in str(model)


@pytest.mark.parametrize(
    "law",
    [
        StopForce(0.1 + 0.2, 1, 1.0 / 3 + 1),
        PowerDamping(2 + 1e-9),
        RubbingFriction(np.pi),
        Friction(1.0 / 3),
        Stiffness(3 - 1e-12),
        MagnetForce(1 / 3, -1, 2 + 1e-15),
        Friction(creep=1e-3 / 7),
        Combination("cause", (Stiffness(1), StopForce(1 / 3)), (1 / 3, np.pi)),
    ],
    ids=lambda law: type(law).__name__,
)
def test_numbers_survive_to_the_last_digit(law):
    model = ReducedModel((law,), (1 / 3,), "m")
    assert ReducedModel.from_json(model.to_json()) == model
    if not isinstance(law, Combination | Friction):
        assert term_from_key(law.key) == law


def test_laws_that_differ_in_the_tenth_digit_stand_side_by_side():
    model = ReducedModel((StopForce(0.1234567891), StopForce(0.1234567892)), (1.0, 2.0))
    assert len(model.coefficients) == 2


def test_whole_powers_are_the_terms_of_a_polynomial():
    """What a diagnosis finds as |q|^3 sign(q) joins gamma_3."""
    assert Stiffness(3.0) == Stiffness(3) and Stiffness(3.0).key == "gamma_3"
    assert PowerDamping(2.0).key == "c_quadratic" and PowerDamping(3.0) == damping_law("cubic")
    assert AmplitudeDamping(2.0) == damping_law("q^2 q_dot")
    q = np.array([-0.7, 0.4])
    np.testing.assert_allclose(Stiffness(3).stiffness(q), np.abs(q) ** 3 * np.sign(q), rtol=1e-15)


def test_undamped_keeps_the_stiffness_of_a_combination():
    model = ReducedModel((Stiffness(1), COMBINED), (30.0, 0.5))
    free = model.undamped()
    q = np.linspace(-1, 1, 9)
    np.testing.assert_array_equal(free.stiffness(q), model.stiffness(q))
    np.testing.assert_array_equal(free.inertia(q), model.inertia(q))
    assert np.all(free.damping(q, q) == 0) and np.any(model.damping(q, q) != 0)
    assert Combination("c", (PowerDamping(1),), (1.0,)).undamped() is None


@dataclass(frozen=True)
class Ripple(ForceLaw):
    """A law of one's own."""

    length: float

    dimension = (0, 0)

    @property
    def key(self):
        return f"ripple {self.length!r}"

    def expression(self, q="q", q_dot="q_dot", q_ddot="q_ddot"):
        return f"sin({q}/{self.length:g})"

    def stiffness(self, q):
        return np.sin(q / self.length)


def test_a_law_of_ones_own_survives_json():
    model = ReducedModel((Stiffness(1), Ripple(1 / 3)), (30.0, 0.5))
    text = model.to_json()
    assert ReducedModel.from_json(text) == model
    content = json.loads(text)
    content["terms"][1]["type"] = "elsewhere.Ripple"
    with pytest.raises(ValueError, match=r"'elsewhere.Ripple' is no law.*import the module"):
        ReducedModel.from_json(json.dumps(content))
    content["terms"][1] |= {"type": "StopForce"}
    with pytest.raises(ValueError, match=r"takes no 'length': .*It takes gap, side, exponent"):
        ReducedModel.from_json(json.dumps(content))


def test_infinity_survives_strict_json():
    """JSON has no infinity: other readers refuse the bare word that Python writes for it."""
    model = ReducedModel((Ripple(np.inf), Ripple(-np.inf)), (1.0, 2.0))
    text = model.to_json()
    json.loads(text, parse_constant=pytest.fail)
    assert ReducedModel.from_json(text) == model


def test_abstract_laws_are_no_terms():
    assert Term.from_key("omega^2") is None and ForceLaw.from_key("omega^2") is None


def test_units_and_text():
    assert Inertia(4).expression() == "(2 q^3 q_ddot + 3 q^2 q_dot^2)"
    assert Inertia(2).expression() == "(2 q q_ddot + q_dot^2)"
    assert Stiffness(3).unit("m") == "1/(m^2 s^2)"
    assert damping_law("coulomb").unit("rad") == "rad/s^2"
    assert damping_law("cubic").unit("m") == "s/m^2"


def test_a_magnet_softens_linearly_at_rest():
    assert MagnetForce(2.0).stiffness_dq(np.array(0.0)) == pytest.approx(-2.0 / 2.0)


@pytest.mark.parametrize("key", ["omega2", "gamma_1", "Upsilon_x", "c_quad", "gamma_1.5"])
def test_unknown_names_are_refused_with_a_hint(key):
    with pytest.raises(ValueError, match=r"is not known: use .*gamma_m or Upsilon_k"):
        term_from_key(key)
    with pytest.raises(ValueError, match=r"did you mean 'omega\^2'"):
        term_from_key("omega2")


@pytest.mark.parametrize("make", [lambda: Stiffness(0), lambda: Inertia(1), lambda: Inertia(2.5)])
def test_orders_are_checked(make):
    with pytest.raises(ValueError, match=r"must be a (whole )?number of at least"):
        make()


def test_damping_kind_is_checked():
    with pytest.raises(ValueError, match=r"damping kind 'viscous' is not known: use one of"):
        damping_law("viscous")


def test_an_exponent_that_was_fitted_makes_no_odd_unit():
    assert unit_text({"rad": -2.001, "s": -1.0}) == "1/(rad^2 s)"
    assert unit_text({"m": 0.996, "s": -2}) == "m/s^2" and unit_text({"m": -1.87}) == "1/m^1.87"
