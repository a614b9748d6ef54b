"""Driven motion: work, linear frequency response, static limits, frames, histories, bad input."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from romsindy.beam import CLAMPED, BaseAcceleration, Beam, PointForce, RadauIIA, Section, transient
from romsindy.effects.mounting import PointMass

ALPHA, ETA = 20.0, 1e-4
AT = 0.1


def run(beam: Beam, *arguments, **options):
    return beam.simulate(*arguments, progress=False, **options)


def straight(**changes) -> Beam:
    """Without gravity or spring, so that Rayleigh damping is exactly modal; a mass is inside."""
    values = {"alpha": ALPHA, "eta": ETA, "tip_mass": 0.0, "spring_stiffness": 0.0, "gravity": 0.0}
    beam = Beam.cantilever(length=0.3, elements=6, **{**values, **changes})
    return beam.with_effect(PointMass(0.02, at=0.15))


def default() -> Beam:
    return Beam.cantilever(elements=6)


# -- work ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["force", "base"])
@pytest.mark.parametrize(("stages", "steps"), [(2, (0.04, 0.02, 0.01)), (3, (0.08, 0.04, 0.02))])
def test_balance_of_work_converges_with_the_order_of_the_method(name, stages, steps):
    """On a soft beam of two elements whose every mode is resolved; it is damped, too."""
    soft = Section(EA=40.0, GA=40.0, EI=1.0, mass=1.0, rotary_inertia=0.1)
    beam = Beam(1.0, soft, elements=2, gravity=(0.0, -0.5), alpha=0.2, eta=0.01)
    options = {
        name: lambda t: 0.5 * np.sin(3 * t) ** 4,
        "method": RadauIIA(stages),
        "modes": beam.modes(count=2),
        "energy_tolerance": 1e9,  # without effect: every sample is one step
    }
    balances = [run(beam, duration=1.6, step=h, **options).energy for h in steps]
    errors = np.array([abs(e.total[-1] - e.total[0]) for e in balances])
    # at least the declared order: the fastest modes are only just resolved by the longest step
    assert np.all(np.log2(errors[:-1] / errors[1:]) > RadauIIA(stages).order - 0.5)
    # the balance is one of energies that have been at work
    assert balances[0].dissipated[-1] > 0.3 * balances[0].work[-1] > 100 * errors[0]


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_work_is_energy_and_dissipation_to_the_tolerance(tolerance):
    """A force that is put on at once sets off waves too fast for the samples: steps are cut."""
    beam = default()
    motion = run(beam, duration=0.3, force=lambda t: 0.5, energy_tolerance=tolerance)
    energy = motion.energy
    stored = energy.kinetic + energy.strain + energy.potential
    largest = np.abs(energy.work).max()
    assert_allclose(energy.work, stored + energy.dissipated, atol=tolerance * largest)
    assert energy.drift < tolerance
    assert motion.cost.steps > len(motion.t)
    # of a dead force: the force times the way of its point
    tip = run(beam, duration=0.3, force=lambda t: 0.5, sensors=beam.sensors([beam.length]))
    way = tip.sensors.displacement[:, 0]
    assert_allclose(tip.energy.work, 0.5 * way, atol=1e-4 * largest)


# -- linear frequency response -------------------------------------------------------------------


def response(modes, unit, omega: float) -> complex:
    """Tip displacement: sum of phi_k(tip) (phi_k . unit) / (omega_k^2 - omega^2 + i omega c_k)."""
    damping = ALPHA + ETA * modes.omega**2
    dynamic = modes.omega**2 - omega**2 + 1j * omega * damping
    return np.sum(modes.shapes[:, -1, 1] * unit / dynamic)


def steady(beam: Beam, omega: float, samples: int = 48, **drive) -> complex:
    """Complex amplitude of the tip in the last period, once the first swing has died."""
    periods = math.ceil(2.0 * omega / (2 * np.pi))  # 2 s: e^(-ALPHA / 2 * 2) = 2e-9 is left
    step = 2 * np.pi / omega / samples
    sensors = beam.sensors([beam.length])
    motion = run(beam, duration=periods * samples * step, step=step, sensors=sensors, **drive)
    last = slice(-samples, None)
    tip = motion.sensors.displacement[last, 0]
    return 2.0 / samples * np.sum(tip * np.exp(-1j * omega * motion.t[last]))


@pytest.mark.parametrize(
    "ratio", [0.5, 1.0, pytest.param(5.2, marks=pytest.mark.slow)]
)  # below, at and above mode 1; mode 2 is at 5.3
@pytest.mark.parametrize("name", ["tip", "inside", "base"])
def test_small_force_gives_the_linear_frequency_response(name, ratio):
    """Amplitude and phase, against the sum over modes with Rayleigh damping.

    The base acts by the modal participation -phi_k^T M 1.
    """
    beam = straight()
    modes = beam.modes(count=20)
    omega = ratio * modes.omega[0]

    def history(t):
        return 1e-4 * np.cos(omega * t)

    drives = {
        "tip": ({"force": history}, modes.shapes[:, -1, 1]),
        # 0.1 m is the middle node of six elements over 0.3 m
        "inside": ({"force": PointForce(history, at=AT)}, modes.shapes[:, 4, 1]),
        "base": ({"base": history}, -modes.momenta[:, :, 1].sum(axis=1)),
    }
    drive, unit = drives[name]
    # twenty of 36 modes leave out 1e-10; the swing, 2e-5 of the length, and the step leave 1e-7
    expected = 1e-4 * response(modes, unit, omega)
    assert abs(steady(beam, omega, **drive) - expected) < 1e-6 * abs(expected)


def test_base_drives_the_first_mode_of_a_cantilever_by_the_known_participation():
    """Euler and Bernoulli: (phi^T M 1)^2 / m = 4 sigma^2 / beta^2 = 0.6131."""
    beam = Beam.cantilever(elements=20, tip_mass=0.0, spring_stiffness=0.0, gravity=0.0)
    load = BaseAcceleration(lambda t: 1.0).load(beam.assembly)
    participation = np.vdot(beam.modes(count=1).shapes[0], load)
    mass = beam.section.mass * beam.length
    sigma, beta = 0.734095514, 1.875104069
    # shear and rotary inertia of a slender beam, (thickness / length)^2
    assert_allclose(participation**2 / mass, 4 * sigma**2 / beta**2, rtol=1e-5)
    assert participation < 0.0


# -- static limits -------------------------------------------------------------------------------


def test_constant_force_swings_about_the_static_shape():
    """All modes by w_k (1 - cos omega_k t): the tip comes to twice its static displacement."""
    beam = straight(alpha=0.0, eta=0.0)
    modes = beam.modes(count=20)
    sensors = beam.sensors([beam.length])
    motion = run(beam, duration=0.3, step=5e-4, force=lambda t: 1e-4, sensors=sensors)
    shares = 1e-4 * modes.shapes[:, -1, 1] ** 2 / modes.omega**2
    tip = (1.0 - np.cos(np.outer(motion.t, modes.omega))) @ shares
    static = beam.equilibrium(beam.point_load((0.0, 1e-4))).tip[1]
    # modes too fast for the steps lose their swing: energy 1e-4 of all, a hundredth of the speed
    assert_allclose(motion.sensors.displacement[:, 0], tip, atol=1e-3 * static)
    assert_allclose(tip.max(), 2.0 * static, rtol=0.05)  # as far as the modes come together


def test_strong_damping_leaves_the_static_shape():
    """Far beyond what is linear: the tip of a bare cantilever rises by half its length."""
    beam = replace(straight(alpha=40.0), gravity=(0.0, -9.81))
    forces = [PointForce(lambda t: 15.0), PointForce(lambda t: -2.0, at=AT, direction=(1.0, 1.0))]
    motion = run(beam, duration=4.0, step=4e-3, force=forces, keep_field=True)
    load = beam.point_load((0.0, 15.0)) + beam.point_load((-(2.0**0.5), -(2.0**0.5)), at=AT)
    static = beam.equilibrium(load)
    assert static.tip[1] > 0.5 * beam.length
    # e^(-40 / 2 * 4) is left of the swing; statics and steps stop at 1e-9 of the length
    assert_allclose(motion.field.displacement[-1], static.displacement.ravel(), atol=1e-9)
    assert motion.force.shape == (len(motion.t), 2)


@pytest.mark.parametrize("direction", [(0.0, 1.0), (3.0, -4.0)])
def test_steady_acceleration_of_the_base_is_another_gravity(direction):
    """Einstein's lift, with a spring, and masses that turn and weigh."""
    beam = Beam.cantilever(elements=6, tip_mass=0.01)
    beam = beam.with_effect(PointMass(0.02, at=0.2, rotary_inertia=1e-5))
    base = BaseAcceleration(lambda t: 3.0, direction=direction)
    norm = math.hypot(*direction)
    gravity = (-3.0 * direction[0] / norm, -9.81 - 3.0 * direction[1] / norm)
    shape = beam.release_shape(0.1)
    lifted = run(beam, shape, 0.3, base=base, keep_field=True)
    heavy = run(replace(beam, gravity=gravity), shape, 0.3, keep_field=True)
    for one, other in zip(lifted.field, heavy.field, strict=True):
        # rounding of the sum of both loads: 1e-16 of forces, a thousand times that of stiff axial
        # accelerations, and what three hundred steps add up
        assert_allclose(one, other, atol=1e-9 * np.abs(other).max())
    assert_allclose(lifted.energy.kinetic, heavy.energy.kinetic, rtol=1e-9)


def test_a_base_that_starts_upwards_leaves_the_tip_below():
    beam = default()
    sensors = beam.sensors([beam.length])
    motion = run(beam, duration=0.01, base=lambda t: 1.0, sensors=sensors)
    tip = motion.sensors.displacement[:, 0]
    assert np.all(np.diff(tip) < 0.0)
    # at first the tip stays where it is in space: it lags by a t^2 / 2, until the clamp is felt
    assert_allclose(tip[1:4], -0.5 * motion.t[1:4] ** 2, rtol=0.02)


# -- histories -----------------------------------------------------------------------------------


def test_nothing_drives_it_bit_for_bit():
    beam = default()
    shape = beam.release_shape(0.1)
    free = run(beam, shape, 0.05)
    idle = run(beam, shape, 0.05, force=lambda t: 0.0, base=lambda t: 0.0 * t)
    assert_array_equal(free.coordinates, idle.coordinates)
    assert_array_equal(free.energy.total, idle.energy.total)
    assert free.force is None and free.base is None
    assert not idle.force.any() and not idle.base.any()


def test_at_rest_it_stays_until_it_is_driven():
    beam = default()
    motion = run(beam, duration=0.1, force=lambda t: np.where(t > 0.05, 0.1, 0.0))
    q = np.abs(motion.coordinates.displacement[:, 0])
    assert q[motion.t < 0.0495].max() < 1e-12 * q.max()  # rounding of the static sag
    assert motion.energy.drift < 1e-4  # the tolerance
    assert run(beam, duration=0.01).energy.drift == 0.0


def test_samples_are_joined_by_a_cubic_spline():
    beam, omega = default(), 60.0

    def history(t):
        return 0.3 * np.sin(omega * t)

    t = np.linspace(0.0, 0.2, 201)
    smooth, sampled = (run(beam, duration=0.2, force=f) for f in (history, (t, history(t))))
    # 5 / 384 (omega h)^4 is the error of a cubic spline, a few times that at its ends
    limit = 5 * 5 / 384 * (omega * t[1]) ** 4
    q = smooth.coordinates.displacement
    assert_allclose(sampled.coordinates.displacement, q, atol=limit * np.abs(q).max())
    assert_allclose(sampled.force, history(sampled.t), atol=1e-15)
    # samples that begin earlier and end later are as good
    longer = np.linspace(-0.1, 0.4, 501)
    wide = run(beam, duration=0.2, force=PointForce([longer, history(longer)]))
    assert_allclose(wide.coordinates.displacement, q, atol=limit * np.abs(q).max())


def test_forces_and_base_add_up():
    """In the linear range, with the same force given in parts."""
    beam = straight()

    def history(t):
        return 1e-5 * np.sin(200.0 * t)

    several = [history, PointForce(history, at=AT), PointForce(history, direction=(1.0, 0.0))]
    alone = [run(beam, duration=0.05, force=force) for force in several]
    alone.append(run(beam, duration=0.05, base=history))
    together = run(beam, duration=0.05, force=several, base=history)
    total = sum(m.coordinates.displacement for m in alone)
    # quadratic terms are 1e-5 of the linear ones
    assert_allclose(together.coordinates.displacement, total, atol=1e-4 * np.abs(total).max())
    assert_array_equal(together.force[:, 1], alone[1].force)
    assert_array_equal(together.base, history(together.t))


def test_interrupted_run_returns_the_force_that_it_felt(monkeypatch):
    beam, advance = default(), transient.Stepper.advance

    def interrupt(self, t, sample):
        if t > 0.0195:
            raise KeyboardInterrupt
        return advance(self, t, sample)

    monkeypatch.setattr(transient.Stepper, "advance", interrupt)
    motion = run(beam, duration=1.0, force=np.sin, base=np.cos)
    assert_array_equal(motion.force, np.sin(motion.t))
    assert_array_equal(motion.base, np.cos(motion.t))
    assert len(motion.t) == 21


# -- bad input -----------------------------------------------------------------------------------

T = np.linspace(0.0, 1.0, 11)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        (
            {"force": lambda t: np.where(t < 0.5, 1.0, np.nan)},
            ValueError,
            "force is nan at t = 0.5",
        ),
        ({"base": lambda t: np.inf}, ValueError, "base is inf at t = 0 s: give finite values"),
        ({"force": (0.5 * T, T)}, ValueError, "force is nan at t = 0.501 s.*samples must cover"),
        ({"base": (T + 0.1, T)}, ValueError, "base is nan at t = 0 s.*samples must cover"),
        ({"base": 9.81}, TypeError, "base is a float: give a function of time"),
        (
            {"force": BaseAcceleration(np.sin)},
            TypeError,
            "force is a BaseAcceleration: give it as base=",
        ),
        ({"force": "sine"}, TypeError, "force is a str: give a function of time"),
        ({"base": PointForce(np.sin)}, TypeError, "base is a PointForce"),
        ({"force": (T, T[1:])}, ValueError, r"force has times of shape \(11,\).*\(10,\)"),
        ({"force": (T[::-1], T)}, ValueError, "do not increase, 1 s and then 0.9 s: sort"),
        ({"base": (T, np.nan * T)}, ValueError, "base has samples that are not finite"),
        ({"force": lambda t: t[:3]}, ValueError, r"values of shape \(3,\) at 1001 times"),
        ({"force": math.sin}, TypeError, "force cannot be asked at an array.*np.sin"),
        ({"force": lambda t: 1.0 if t < 1 else 0.0}, TypeError, "array of times.*np.where"),
        ({"duration": None}, TypeError, "duration is not given.*duration=10"),
        ({"shape": 1.0}, TypeError, "shape is 1.0: give a Shape, or the time as duration=1.0"),
    ],
)
def test_bad_excitation_is_refused_before_the_work(options, error, message):
    with pytest.raises(error, match=message):
        run(default(), **{"duration": 1.0, "force": None, **options})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"at": 0.0}, "force acts at = 0 m, where the beam is held.*give PointForce"),
        ({}, "force acts at = 0.45 m, where the beam is held"),
        ({"at": 0.5}, "at = 0.5 m is off the beam"),
        ({"direction": (0.0, 0.0)}, "points nowhere"),
    ],
)
def test_force_must_act_on_what_can_move(given, message):
    beam = replace(default(), right=CLAMPED)
    with pytest.raises(ValueError, match=message):
        run(beam, duration=0.1, force=PointForce(np.sin, **given))


def test_a_force_that_fails_between_samples_is_named():
    """Steps look between the samples, which alone are seen before the work."""
    hole = PointForce(lambda t: np.where(np.abs(t - 0.00465) < 1e-4, np.nan, 1e-3))
    with pytest.raises(ValueError, match=r"force is nan at t = 0\.0046"):
        run(default(), duration=0.01, force=hole)
