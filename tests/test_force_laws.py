"""Derivatives, potentials and names of the force laws, against differences and quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad

from romsindy.physics.force_laws import (
    AddedMass,
    AmplitudePowerDamping,
    ConstantForce,
    HystereticDamping,
    Magnet,
    PowerDamping,
    PowerStiffness,
    RubbingDamping,
    StopStiffness,
    TwoSidedGap,
    term_from_key,
)
from romsindy.physics.model import ReducedModel
from romsindy.physics.terms import Stiffness

LAWS = [
    PowerDamping(2.1),
    AmplitudePowerDamping(1.9),
    HystereticDamping(1.05),
    RubbingDamping(0.1),
    RubbingDamping(-0.2, -1),
    PowerStiffness(2.97),
    ConstantForce(),
    AddedMass(),
    StopStiffness(0.3),
    StopStiffness(-0.3, -1, 1.25),
    TwoSidedGap(0.4),
    TwoSidedGap(0.4, 1.5),
    Magnet(1.7),
    Magnet(1.7, -1, 2.1),
]
Q = np.array([-0.93, -0.55, -0.21, 0.17, 0.47, 0.88])  # off every kink
V = np.array([1.3, -0.7, 0.4, -2.0, 0.9, -0.3])


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_derivatives_are_those_of_differences(law):
    h = 1e-6
    for part in ("inertia", "convection", "stiffness"):
        f = getattr(law, part)
        slope = (f(Q + h) - f(Q - h)) / (2 * h)
        np.testing.assert_allclose(getattr(law, f"{part}_dq")(Q), slope, rtol=1e-7, atol=1e-8)
    by_q = (law.damping(Q + h, V) - law.damping(Q - h, V)) / (2 * h)
    by_v = (law.damping(Q, V + h) - law.damping(Q, V - h)) / (2 * h)
    np.testing.assert_allclose(law.damping_dq(Q, V), by_q, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(law.damping_dq_dot(Q, V), by_v, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("law", [x for x in LAWS if x.has("stiffness")], ids=str)
def test_potential_is_the_work_against_the_force(law):
    kinks = [-0.4, -0.3, 0.3, 0.4]
    for q in Q:
        work = quad(lambda x: float(law.stiffness(np.array(x))), 0, q, points=kinks, limit=200)[0]
        assert law.potential(np.array(q)) == pytest.approx(work, abs=1e-7)


@pytest.mark.parametrize("law", [x for x in LAWS if x.has("damping")], ids=str)
def test_dampers_never_feed_energy(law):
    assert np.all(law.damping(Q, V) * V >= 0)


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_names_lead_back_to_the_law(law):
    assert term_from_key(law.key) == law
    model = ReducedModel((Stiffness(1), law), (30.0, 0.5), "m", (0.0, 1.0))
    assert ReducedModel.from_json(model.to_json()) == model
    assert law.key in str(model)


def test_a_magnet_softens_linearly_at_rest():
    assert Magnet(2.0).stiffness_dq(np.array(0.0)) == pytest.approx(-2.0 / 2.0)
