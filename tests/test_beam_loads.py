"""Every effect: its tangents against differences, its energy, and what it does to the beam."""

from __future__ import annotations

from dataclasses import replace

import beam_oracles as oracles
import numpy as np
import pytest
from numpy.testing import assert_allclose

from romsindy.beam import PINNED, Beam, Section, Support
from romsindy.beam.changes import ClampCompliance, ExtraTension
from romsindy.beam.structure import Spring
from romsindy.effects import (
    AirDrag,
    AlongBeam,
    AtPoint,
    CubicStiffness,
    Damper,
    DryFriction,
    Load,
    Magnet,
    MoreMass,
    NonlinearInertia,
    PointMass,
    SpringFriction,
    Stop,
    TowardsAnchor,
    TwoSidedGap,
)
from romsindy.effects.mounting import Point
from romsindy.physics.damping import Friction, PowerDamping
from romsindy.physics.inertia import Inertia
from romsindy.physics.stiffness import GapForce, MagnetForce, Stiffness, StopForce

ANCHOR = TowardsAnchor((0.6, 0.1))
FORCES = [
    Spring(stiffness=30.0, anchor=(0.6, 0.1), natural_length=0.05),
    Load(Stiffness(3), 200.0, AtPoint(direction=(1.0, 2.0))),
    Load(PowerDamping(1), 0.3, AtPoint(direction=(1.0, 1.0))),
    Load(Friction(creep=0.5), 0.2),
    Load(Friction(creep=0.5), 0.2, ANCHOR),
    Load(PowerDamping(1.7), 0.2, ANCHOR),
    Load(StopForce(0.01), 100.0),
    Load(GapForce(0.01), 100.0, AtPoint(direction=(0.0, -1.0), datum=0.003)),
    Load(MagnetForce(0.2, -1, 3.0), 0.01, TowardsAnchor((0.4, -0.1), length=0.2)),
    Load(MagnetForce(0.2, 1, 3.0), 0.01),
    Load(PowerDamping(2), 0.36, AlongBeam()),
    Load(PowerDamping(1.2), 0.36, AlongBeam()),
]
PLACE = Point(0.45, 0.42, 0.08, 0.4, -0.3, 0.9, 2.0)
REST = (0.45, 0.45, 0.0, 0.0, 0.0, 0.0, 0.0)
ids = [f"{type(e.law).__name__} {type(e.mounting).__name__}" for e in FORCES]


def numeric(function, step=1e-6):
    """Return minus the derivative to three variables by central differences."""
    columns = [
        (np.array(function(step * e)) - np.array(function(-step * e))) / (2 * step)
        for e in np.eye(3)
    ]
    return -np.array(columns).T


def moved(dx=(0, 0, 0), dv=(0, 0, 0)) -> Point:
    return Point(PLACE.s, *(np.array(PLACE[1:]) + np.concatenate([dx, dv])))


@pytest.mark.parametrize("effect", FORCES, ids=ids)
def test_tangents_are_the_derivatives_of_the_force(effect):
    for analytic, function in [
        (effect.tangent(PLACE), lambda d: effect.force(moved(dx=d))),
        (effect.damping_tangent(PLACE), lambda d: effect.force(moved(dv=d))),
    ]:
        expected = numeric(function)
        scale = max(np.abs(expected).max(), 1e-3)
        assert_allclose(np.array(analytic, dtype=float), expected, atol=1e-7 * scale)


@pytest.mark.parametrize("effect", FORCES, ids=ids)
def test_an_effect_stores_or_dissipates(effect):
    force = np.array(effect.force(PLACE))
    gradient = numeric(lambda d: [effect.potential(moved(dx=d))] * 3)[0]
    stores = np.any(gradient != 0.0)
    if stores:
        assert_allclose(force, gradient, atol=1e-7 * np.abs(force).max())
    else:
        assert force @ np.array(PLACE[4:]) < 0.0


@pytest.mark.parametrize(
    "effect",
    [
        Spring(stiffness=20.0, anchor=(0.3, 0.4), natural_length=0.2, at=0.225),
        CubicStiffness().on_beam(2e4),
        Damper().on_beam(0.02, AtPoint(0.3)),
        DryFriction().on_beam(0.02),
        SpringFriction().on_beam(0.02),
        Stop(gap=0.05).on_beam(500.0),
        TwoSidedGap(gap=0.05).on_beam(500.0, AtPoint(0.4)),
        Magnet(distance=0.2).on_beam(6e-4, TowardsAnchor((0.46, -0.2), length=0.2)),
        AirDrag().on_beam(0.03),
        MoreMass().on_beam(0.002, AtPoint(0.31)),
        ExtraTension(0.2),
        ClampCompliance(0.05),
    ],
    ids=lambda e: type(getattr(e, "law", e)).__name__,
)
def test_energy_balance_with_the_effect(effect):
    beam = Beam.cantilever(elements=10).with_effect(effect)
    motion = beam.simulate(
        beam.release_shape(0.1, mode=1), 0.3, modes=beam.modes(count=2), progress=False
    )
    assert motion.stop_reason == "completed"
    assert motion.energy.drift < 1e-4


def bare(**options) -> Beam:
    return Beam(1.0, Section(1e8, 1e8, 1.0, 1.0), elements=20, gravity=(0.0, 0.0), **options)


def test_dashpot_damps_small_modal_motion():
    """zeta omega = c phi(tip)^2 / 2, with phi(tip) = 2 for the unit cantilever."""
    beam = bare().with_effect(Damper().on_beam(0.05))
    motion = beam.simulate(
        beam.release_shape(1e-3, mode=1), 20.0, 0.02, modes=beam.modes(count=1), progress=False
    )
    q, q_dot = motion.coordinates.displacement[:, 0], motion.coordinates.velocity[:, 0]
    radius = np.hypot(q, q_dot / motion.basis.omega[0])
    rate = -np.polyfit(motion.t, np.log(radius), 1)[0]
    assert_allclose(rate, 0.5 * 0.05 * 4, rtol=0.01)  # first order in c / omega


@pytest.mark.slow
def test_drag_damps_in_proportion_to_amplitude():
    """d a/dt = -(4 / 3 pi) omega k int |phi|^3 ds a^2, averaged over a cycle."""
    drag = AirDrag().on_beam(1.0)  # k = 1 per unit length and mass
    beam = bare().with_effect(drag)
    modes = beam.modes(count=1)
    motion = beam.simulate(
        beam.release_shape(0.02, mode=1), 30.0, 0.02, modes=modes, progress=False
    )
    q, q_dot = motion.coordinates.displacement[:, 0], motion.coordinates.velocity[:, 0]
    omega = modes.omega[0]
    radius = np.hypot(q, q_dot / omega)
    phi = modes.shape(1)[:, 1]
    integral = float(beam.assembly.tributary @ np.abs(phi) ** 3)
    slope = np.polyfit(motion.t, 1 / radius, 1)[0]
    assert_allclose(slope, 4 / (3 * np.pi) * omega * integral, rtol=0.01)  # first order


def test_added_mass_at_the_tip():
    """Rayleigh quotient of a light mass: omega^2 / (1 + m phi(tip)^2)."""
    light = 1e-5
    omega = bare().with_effect(PointMass(light)).modes(count=1).omega[0]
    assert_allclose(omega, bare().modes(count=1).omega[0] * (1 - 0.5 * light * 4), rtol=1e-8)


def test_clamp_compliance_is_an_elastic_clamp():
    omega = bare().with_effect(ClampCompliance(0.2)).modes(count=1).omega[0]
    assert_allclose(omega, oracles.elastic_clamp_root(5.0) ** 2, rtol=1e-5)


def test_clamp_compliance_is_in_series_with_the_stiffness_of_the_clamp():
    """A clamp of 5 N m/rad that gives way by 0.2 rad/(N m) more is one of 2.5 N m/rad."""
    elastic = replace(bare(), left=Support.elastic(5.0)).with_effect(ClampCompliance(0.2))
    assert elastic.left.rotational_stiffness == pytest.approx(2.5, rel=1e-15)
    omega = elastic.modes(count=1).omega[0]
    assert_allclose(omega, oracles.elastic_clamp_root(2.5) ** 2, rtol=1e-5)
    twice = bare().with_effect(ClampCompliance(0.2)).with_effect(ClampCompliance(0.3))
    assert twice.left.rotational_stiffness == pytest.approx(2.0, rel=1e-15)


def test_clamp_compliance_keeps_what_else_the_support_holds():
    """A clamp that slides along the beam still slides."""
    sliding = replace(bare(), left=Support((False, True, True)))
    assert sliding.with_effect(ClampCompliance(0.2)).left.fixed == (False, True, False)


def test_a_grounded_spring_carries_a_tip_load():
    """A grounded linear spring beside the beam's own 3 EI / L^3."""
    beam = bare().with_effect(Load(Stiffness(1), 7.0))
    assert_allclose(beam.equilibrium(beam.point_load((0.0, 1e-4))).tip[1], 1e-5, rtol=1e-5)


def test_stop_is_silent_inside_its_gap():
    beam = Beam.cantilever(elements=10)
    stopped = beam.with_effect(Stop(1, gap=0.05).on_beam(1e3))
    stopped = stopped.with_effect(Stop(-1, gap=-0.08).on_beam(1e3))
    shape = beam.release_shape(0.03, mode=1)
    free, held = (
        b.simulate(shape, 0.2, modes=b.modes(count=1), progress=False).coordinates.displacement
        for b in (beam, stopped)
    )
    assert np.array_equal(free, held)
    assert stopped.release_shape(0.1).load[-1, 1] > beam.release_shape(0.1).load[-1, 1] + 10.0


def test_extra_tension_pulls_harder():
    beam = Beam.cantilever(elements=10, gravity=0.0)
    tight = beam.with_effect(ExtraTension(0.5))
    by_argument = Beam.cantilever(elements=10, gravity=0.0, spring_pretension=2.01)
    assert_allclose(tight.modes(count=2).omega, by_argument.modes(count=2).omega, rtol=1e-12)
    assert beam.effects != tight.effects


def test_magnet_attracts():
    beam = Beam.cantilever(elements=10)
    sag = beam.equilibrium().tip[1]
    law, pole = MagnetForce(0.1, -1, 4.0), TowardsAnchor((0.45, -0.1), length=0.1)
    below = beam.with_effect(Load(law, 0.01, pole))
    assert below.equilibrium().tip[1] < sag


def test_a_magnet_pulls_by_the_inverse_power_of_the_distance():
    """Force 0.01 N at 0.1 m, towards the pole, with the fourth power."""
    law, pole = MagnetForce(0.1, -1, 4.0), TowardsAnchor((0.4, -0.1), length=0.1)
    fx, fy, moment = Load(law, 0.01, pole).force(PLACE)
    dx, dy = 0.4 - PLACE.x, -0.1 - PLACE.y
    r = np.hypot(dx, dy)
    assert_allclose([fx, fy, moment], 0.01 * (0.1 / r) ** 4 * np.array([dx, dy, 0]) / r, rtol=1e-13)


def test_a_mounted_law_is_the_law():
    """At a point the force is the law of the displacement along the direction, and nothing else."""
    load = Load(StopForce(0.03), 70.0, AtPoint(direction=(0.0, 1.0), datum=0.02))
    assert_allclose(load.force(PLACE), (0.0, -70.0 * (PLACE.y - 0.02 - 0.03), 0.0), rtol=1e-14)


def test_the_equilibrium_of_a_mounted_contact():
    """A contact counts its gap from where its point rests."""
    rest = Point(0.45, 0.449, -0.012, -0.04)
    assert Stop(gap=0.05).placed(AtPoint(), rest) == AtPoint(datum=-0.012)
    pole = Magnet(-1, 0.2).placed(AtPoint(), rest)
    assert_allclose(pole.anchor, (0.449, -0.212)) and pole.length == 0.2


def test_point_between_nodes_shares_its_force():
    beam = bare()
    load = beam.point_load((0.0, 1.0), at=0.51)
    assert_allclose(load.sum(axis=0), [0.0, 1.0, 0.0], atol=1e-14)
    assert_allclose(load[:, 1] @ beam.assembly.s, 0.51, rtol=1e-14)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Load(PowerDamping(1), float("nan")), "strength must be a finite number"),
        (lambda: Load(Friction(), 0.1), "Friction jumps: give it a creep"),
        (lambda: Load(Inertia(3), 0.1), "Inertia is no force"),
        (lambda: Load(Stiffness(1), 1.0, AlongBeam()), "mount it AtPoint or TowardsAnchor"),
        (lambda: NonlinearInertia().on_beam(1.0), "NonlinearInertia names no place on a beam"),
        (lambda: AtPoint(direction=(0.0, 0.0)), "points nowhere"),
        (lambda: TowardsAnchor((0.1, float("inf"))), "anchor must be a finite number"),
        (lambda: TowardsAnchor((0.1, 0.2), length=-1.0), "length = -1.0 m must be zero or"),
        (lambda: PointMass(-0.1), "mass must be zero or positive"),
        (lambda: ClampCompliance(0.0), "compliance must be positive"),
        (
            lambda: replace(bare(), left=PINNED).with_effect(ClampCompliance(0.1)),
            "the left end turns freely",
        ),
        (lambda: Spring(stiffness=float("inf")), "stiffness must be a finite number"),
        (
            lambda: Beam.cantilever().with_effect(Damper().on_beam(1.0, AtPoint(0.9))),
            "0.9 m is off",
        ),
        (lambda: Beam.cantilever().with_effect(ExtraTension(2.0)), "at most 0.856"),
        (lambda: bare().with_effect(ExtraTension(0.1)), "the beam has 0 springs"),
        (lambda: bare().with_effect(SpringFriction().on_beam(0.1)), "the beam has 0 springs"),
        (lambda: SpringFriction().on_beam(0.1).force(PLACE), "with_effect"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_what_is_no_effect_is_refused():
    with pytest.raises(TypeError, match=r"effect is a AirDrag: give a load, such as AirDrag\(\)"):
        bare().with_effect(AirDrag())
