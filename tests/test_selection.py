"""Which terms are chosen, and which signs they may have."""

import numpy as np
import pytest

from romsindy.effects.choices import PLACES, sought
from romsindy.fit.choice import Gram, Trials, dragged
from romsindy.fit.kernel.collocation import Grid, Trajectory
from romsindy.fit.kernel.equation import ExtendedEquation
from romsindy.fit.results.estimate import Estimate, massless, possible, stand_ins
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.coupling import Along, MixedStiffness, SlavedInertia
from romsindy.physics.damping import Friction, PowerDamping
from romsindy.physics.inertia import AddedMass, Inertia
from romsindy.physics.model import ReducedModel
from romsindy.physics.stiffness import Stiffness

N = 400


def regression(rng, values, least, refusable, noise=1.0):
    """Four columns, the last two alike; each value times its column, and noise."""
    x = rng.standard_normal((N, 4))
    x[:, 3] = 0.9 * x[:, 2] + np.sqrt(1 - 0.9**2) * x[:, 3]
    y = x @ values + noise * rng.standard_normal(N)
    halves = [
        Gram(a.T @ a, a.T @ b, float(b @ b), len(b))
        for a, b in ((x[::2], y[::2]), (x[1::2], y[1::2]))
    ]
    return Trials(halves, [0], [[1], [2], [3]], least, refusable)


def test_states_are_eliminated_as_if_they_were_projected_out():
    """Rows on what is perpendicular to the states have the same products, to rounding."""
    rng = np.random.default_rng(1)
    rows, at = rng.standard_normal((60, 6)), np.array([0.5, -1.0])
    states = np.linalg.qr(rows[:, 2:5])[0]
    alone = rows[:, [0, 1, 5]] - states @ (states.T @ rows[:, [0, 1, 5]])
    one, other = Gram.of(rows, at), Gram.of_products(alone.T @ alone, at, 60)
    np.testing.assert_allclose(one.matrix, other.matrix, rtol=1e-9)
    np.testing.assert_allclose(one.right, other.right, rtol=1e-9)
    # At their own values nothing is left but what the misfit was about them.
    np.testing.assert_allclose(one.misfit([0, 1], at), np.sum(alone[:, 2] ** 2), rtol=1e-9)


def test_a_sign_is_lifted_where_the_data_refuse_it_by_five_standard_errors():
    """A value of -0.2 is four standard errors of 1 / sqrt(400) off zero, -0.6 is twelve."""
    rng = np.random.default_rng(0)
    surely = regression(rng, [1.0, -0.6, 0.0, 0.0], {0: 0.0}, [0])
    hardly = regression(rng, [1.0, -0.2, 0.0, 0.0], {0: 0.0}, [0])
    assert surely.chosen([]) == [0] and hardly.chosen([]) == []
    never = regression(rng, [1.0, -0.6, 0.0, 0.0], {0: 0.0}, [])
    assert never.chosen([]) == []


def test_what_stood_in_for_another_law_goes_when_that_comes():
    """The law that is there is alike to one that would need the wrong sign beside it."""
    rng = np.random.default_rng(1)
    trials = regression(rng, [1.0, 0.0, 0.0, 2.0], {1: 0.0, 2: 0.0}, [1, 2])
    assert trials.chosen([]) == [2]
    assert trials.chosen([1]) == [2]


def test_signs_are_those_of_the_laws():
    assert Friction().least == PowerDamping(2).least == 0.0
    assert Along.coordinate(Friction(), 2).least == 0.0
    assert AddedMass().least == -1.0
    assert SlavedInertia((2,), (2,)).least == 0.0
    for free in (SlavedInertia((2,), (1, 1)), Stiffness(3), MixedStiffness((2, 1))):
        assert free.least == -np.inf


def test_friction_and_drag_are_looked_for_wherever_terms_are_chosen_in_time():
    for place in ("decay", "jointed", "driven", "series", "swept"):
        assert {Friction(), PowerDamping(2)} <= {*sought(place)}
    assert all(law.has("damping") for law in sought("driven"))
    with pytest.raises(ValueError, match="place = 'air' must be one of"):
        sought("air")
    assert len(PLACES) == 8


def test_friction_acts_along_its_own_direction():
    model = CoupledModel((Along(Friction(), (1.0, -1.0)),), (2.0,))
    equation = ExtendedEquation(model, (), 0, 0.01, 0.0, creep=1e-3)
    rest, q_dot = np.zeros((2, 2)), np.array([[1.0, -10.0], [0.5, 2.0]])
    residual = equation.linearise(np.zeros(2), rest, q_dot, rest)[0]
    np.testing.assert_allclose(residual, [[2.0, -2.0], [-2.0, 2.0]])


def swung(reach, n=1):
    """A motion of n coordinates, as a record of sines of these amplitudes."""
    grid = Grid.over(np.linspace(0, 1, 200), 0.1, 12)
    t = grid.start + grid.step * np.arange(grid.n_steps + 1)
    inside = grid.node_times(0, grid.n_steps)
    rates, sizes = 2 * np.pi * np.arange(3, 3 + n), np.broadcast_to(reach, n)
    q, q_dot, q_ddot = (
        sizes * rates**k * np.sin(rates * x[..., None] + k * np.pi / 2)
        for k, x in ((0, t), (1, t), (2, inside))
    )
    return Trajectory(grid, q, q_dot, q_ddot)


def test_kinetic_energy_of_what_is_dragged_along():
    """h q_dot^2 / 2 of one coordinate, (g' q_dot)^2 / 2 of several; masses at rest are no such."""
    energy = dragged([Stiffness(3), Inertia(3), Inertia(4)], [swung(0.3)])
    assert {*energy} == {1, 2}
    q = np.sqrt(2 * energy[1])  # 2 T = h = q^2
    assert q.max() == pytest.approx(0.3, rel=1e-3) and q.min() < 0.02
    np.testing.assert_allclose(np.abs(energy[2]), q**3, rtol=1e-9)
    squares = [SlavedInertia(p, p) for p in ((2, 0), (1, 1), (0, 2))]
    pairs = (((2, 0), (1, 1)), ((2, 0), (0, 2)), ((1, 1), (0, 2)))
    mixed = [SlavedInertia(*pair) for pair in pairs]
    several = dragged([*squares, *mixed, Along.coordinate(AddedMass(), 2)], [swung([0.3, 0.2], 2)])
    assert {*several} == {*range(6)}
    # One fast mode g = a q1^2 + b q1 q2 + c q2^2: its energy is a sum of squares.
    a, b, c = 0.7, -1.1, 0.4
    values = [a * a, b * b, c * c, a * b, a * c, b * c]
    total = sum(v * several[i] for i, v in enumerate(values))
    assert np.min(total) > -1e-12 and np.any(several[3] < 0)


def test_inertia_that_nothing_has_is_no_choice():
    """Of two inertias the data may want one negative, as long as their sum is not."""
    rng = np.random.default_rng(4)
    q = np.linspace(-1, 1, 41)
    x = rng.standard_normal((N, 3))
    for values, expected in (
        ([1.0, -0.5, 0.0], []),  # h = -q^2 / 2: ten standard errors
        ([1.0, 0.5, 0.0], [0]),
        ([1.0, 2.0, -1.5], [0, 1]),  # h = 2 q^2 - 1.5 q^4
        ([1.0, 1.0, -1.5], [0]),  # h = q^2 - 1.5 q^4 is negative at the ends
    ):
        y = x @ values + rng.standard_normal(N)
        gram = Gram(x.T @ x, x.T @ y, float(y @ y), N)
        kinetic = {0: q**2 / 2, 1: q**4 / 2}
        found = Trials([gram], [0], [[1], [2]], {}, kinetic=kinetic).chosen([])
        assert sorted(found) == expected


@pytest.mark.parametrize(("value", "stays"), [(0.02, True), (-0.02, False), (-0.06, True)])
def test_friction_that_supplies_energy_stays_where_it_is_sure(value, stays):
    """Errors are 0.01: five of them refuse the sign that friction has."""
    names = ("omega^2", "c_coulomb")
    model = ReducedModel.from_coefficients({"omega^2": 9.0, "c_coulomb": value})
    found = Estimate(model, names, 1e-4 * np.eye(2), None, ())
    friction = model.terms[1]
    assert possible(found, [friction]) == ([friction] if stays else [])


def test_fast_modes_cannot_have_less_than_no_mass():
    """What is judged is the least of the energies that the products stand for, by its error."""
    names = ("g(q1^2)^2", "g(q1^2) g(q2^2)", "g(q2^2)^2")

    def found(*values, error=0.01):
        model = CoupledModel.from_coefficients(dict(zip(names, values, strict=True)))
        return Estimate(model, names, error**2 * np.eye(3), None, ())

    assert massless(found(0.4, 0.2, 0.1)) == 0.0 and not [*stand_ins(found(0.4, 0.2, 0.1))]
    # With both squares alike the least is their mean less the product.
    assert massless(found(0.1, 0.13, 0.1)) == pytest.approx(0.03 / (0.01 * np.sqrt(1.5)))
    (said,) = stand_ins(found(0.1, 0.15, 0.1))
    assert "fast modes with less than no mass, by 4.08 standard errors" in said
