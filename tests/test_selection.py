"""Which terms are chosen, and which signs they may have."""

import numpy as np
import pytest

from romsindy.effects.choices import PLACES, sought
from romsindy.fit.friction import smoothed
from romsindy.fit.selection import Gram, Trials
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.coupling import Along, MixedStiffness, SlavedInertia
from romsindy.physics.damping import Friction, PowerDamping
from romsindy.physics.inertia import AddedMass
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
    for place in ("decay", "jointed", "driven", "series"):
        assert {Friction(), PowerDamping(2)} <= {*sought(place)}
    assert all(law.has("damping") for law in sought("driven"))
    with pytest.raises(ValueError, match="place = 'air' must be one of"):
        sought("air")
    assert len(PLACES) == 7


def test_friction_is_smooth_at_the_speed_of_its_own_direction():
    """Of two coordinates that move at 1 and 10 per second, 0.1 per cent each."""

    class Moved:
        q_dot = np.array([[1.0, -10.0], [0.5, 2.0]])

    class Seen:
        motion = Moved

    laws = tuple(Along(Friction(), w) for w in ((1.0,), (0.0, 1.0), (1.0, -1.0)))
    model = smoothed(CoupledModel(laws, (1.0, 1.0, 1.0)), [Seen])
    assert [t.law.creep for t in model.terms] == pytest.approx([0.001, 0.01, 0.011])
