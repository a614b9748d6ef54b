"""The free motion: energy, order, frequency, accelerations, known backbones, failures."""

from __future__ import annotations

import beam_oracles as oracles
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import make_interp_spline
from scipy.special import ellipk

from romsindy.beam import CLAMPED, PINNED, Beam, RadauIIA, Section, StepTooLongError, transient
from romsindy.beam.integrator import lagrange

LARGE = 0.15  # the release of the default system, a third of its length


def default(**changes) -> Beam:
    return Beam.cantilever(elements=20, **changes)


def run(beam: Beam, shape, duration: float, step: float = 1e-3, **options):
    return beam.simulate(shape, duration, step, progress=False, **options)


@pytest.fixture(scope="module")
def decay_motion():
    beam = default()
    return run(beam, beam.release_shape(LARGE, mode=1), 4.0)


@pytest.mark.parametrize("stages", [2, 3, 4])
def test_tableau_meets_the_order_conditions(stages):
    method = RadauIIA(stages)
    b = method.A[-1]
    for k in range(1, method.order + 1):
        assert_allclose(b @ method.c ** (k - 1), 1 / k, rtol=1e-12)
    for k in range(1, stages + 1):  # stage order
        assert_allclose(method.A @ method.c ** (k - 1), method.c**k / k, rtol=1e-11)
    assert method.c[-1] == 1.0


def test_tableau_is_the_published_one():
    """Hairer and Wanner II, table IV.5.6."""
    r = np.sqrt(6.0)
    A = [
        [(88 - 7 * r) / 360, (296 - 169 * r) / 1800, (-2 + 3 * r) / 225],
        [(296 + 169 * r) / 1800, (88 + 7 * r) / 360, (-2 - 3 * r) / 225],
        [(16 - r) / 36, (16 + r) / 36, 1 / 9],
    ]
    assert_allclose(RadauIIA(3).A, A, rtol=1e-12)


def test_extrapolation_is_exact_for_polynomials():
    method = RadauIIA(3)
    p = lagrange(np.array([0.0, 0.4, 2.0]))[1]
    assert_allclose(method.extrapolation(0.5) @ p(method.c), p(1 + 0.5 * method.c), rtol=1e-12)


@pytest.mark.parametrize(("stages", "steps"), [(2, (0.04, 0.02, 0.01)), (3, (0.08, 0.04, 0.02))])
def test_convergence_order(stages, steps):
    """On a beam whose every mode is resolved: soft, two elements."""
    soft = Section(EA=40.0, GA=40.0, EI=1.0, mass=1.0, rotary_inertia=0.1)
    beam = Beam(1.0, soft, elements=2, gravity=(0.0, -0.5))
    shape = beam.release_shape(0.3, mode=1)
    modes = beam.modes(count=2)
    # a tolerance without effect: every sample is one step
    options = {"modes": modes, "energy_tolerance": 1e9}
    exact = run(beam, shape, 1.6, 0.0025, method=RadauIIA(4), **options).coordinates.displacement
    errors = [
        np.abs(
            run(beam, shape, 1.6, h, method=RadauIIA(stages), **options).coordinates.displacement[
                -1
            ]
            - exact[-1]
        ).max()
        for h in steps
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    # at least the declared order: the fastest modes are only just resolved by the longest step
    assert np.all(orders > RadauIIA(stages).order - 0.5)


@pytest.mark.parametrize("damped", [True, False])
@pytest.mark.parametrize("mode", [None, 1])
def test_energy_balance(damped, mode):
    beam = default() if damped else default(alpha=0.0, eta=0.0)
    motion = run(beam, beam.release_shape(LARGE, mode=mode), 1.0)
    assert motion.energy.drift < 1e-4
    kept = motion.energy.total[-1] - motion.energy.dissipated[-1]
    if damped:
        assert 0.3 * motion.energy.total[0] < motion.energy.dissipated[-1]
    else:
        assert motion.energy.dissipated[-1] == 0.0
        assert_allclose(kept, motion.energy.total[0], rtol=1e-4)


def test_small_decay_has_the_damping_of_rayleigh():
    """zeta omega = alpha / 2 + eta omega^2 / 2 for the strain part of omega^2.

    The bare beam has all its stiffness in strain.
    """
    beam = Beam.cantilever(elements=10, tip_mass=0.0, spring_stiffness=0.0, gravity=0.0, eta=1e-4)
    motion = run(beam, beam.release_shape(1e-4, mode=1), 4.0)
    rate = 0.5 * (0.37 + 1e-4 * motion.basis.omega[0] ** 2)
    total = motion.energy.total - motion.energy.dissipated
    damped = np.sqrt(motion.basis.omega[0] ** 2 - rate**2)
    period = round(2 * np.pi / damped / 1e-3)
    cycles = (len(motion.t) - 1) // period
    measured = -0.5 * np.log(total[cycles * period] / total[0]) / motion.t[cycles * period]
    # energy is read at nearly the same phase of the cycle, hence the loose tolerance
    assert_allclose(measured, rate, rtol=2e-3)


@pytest.mark.parametrize("amplitude", [1e-7, 1e-10])
def test_swing_far_below_the_static_sag(amplitude):
    """q'' + alpha q' + omega^2 q = 0 down to where rounding drowns the swing.

    Long decays end like this. Newton's method feels how small the motion is, not for how long it
    has gone on: a short record of a small release is enough.
    """
    thickness = 1e-3
    steel = Section.rectangle(0.02, thickness, 210e9, 7800.0)
    beam = Beam(0.45, steel, elements=10, right=CLAMPED, alpha=1.0)
    motion = run(beam, beam.release_shape(amplitude, mode=1, at=0.225), 0.05, 2.5e-4)
    c = motion.coordinates
    q, q_dot, q_ddot = (x[1:, 0] for x in (c.displacement, c.velocity, c.acceleration))
    spring = motion.basis.omega[0] ** 2 * q
    # the sag, 0.4 of the thickness, makes the spring asymmetric: linear to amplitude / thickness
    linear = amplitude / thickness * np.abs(spring).max()
    assert_allclose(q_ddot + beam.assembly.alpha * q_dot + spring, 0.0, atol=linear)


@pytest.mark.parametrize("damping", [0.0, 0.01])
@pytest.mark.parametrize("angle", [0.5, 2.0])
def test_pendulum_swings_as_if_rigid_and_undamped(damping, angle):
    """A stiff beam hanging from a pin: T = 4 K(sin^2(angle/2)) / w0, w0^2 = 3 g / (2 L).

    Damping on strain rates must not feel the swing.
    """
    stiff = Section(EA=1e6, GA=1e6, EI=1e4, mass=1.0)
    beam = Beam(1.0, stiff, elements=4, left=PINNED, gravity=(9.81, 0.0), eta=damping)
    s = beam.assembly.s
    turned = np.column_stack([s * (np.cos(angle) - 1), s * np.sin(angle), np.full_like(s, angle)])
    modes = beam.modes(count=1)
    w0 = np.sqrt(1.5 * 9.81)
    assert_allclose(modes.omega[0], w0, rtol=1e-4)  # stiff, not rigid
    motion = run(beam, beam.shape(turned), 6.0, 2e-3, modes=modes, sensors=beam.sensors([1.0]))
    omega = oracles.frequency(motion.t, motion.sensors.displacement[:, 0])
    period = 4 * ellipk(np.sin(angle / 2) ** 2) / w0
    assert_allclose(2 * np.pi / omega, period, rtol=2e-4)
    assert motion.energy.dissipated[-1] < 1e-4 * motion.energy.total[0]


@pytest.mark.parametrize("amplitude", oracles.BACKBONE)
def test_frequency_on_the_exact_backbone(amplitude):
    beam = Beam.cantilever(
        length=0.3, young=205e9, tip_mass=0, spring_stiffness=0, gravity=0, alpha=0, eta=0,
        elements=20,
    )  # fmt: skip
    modes = beam.modes(count=1)
    motion = run(beam, beam.release_shape(amplitude * 0.3, mode=1), 1.5, modes=modes)
    omega = oracles.frequency(motion.t, modes.project(motion).q)
    shift = omega / modes.omega[0] - 1
    # the release is not exactly on the normal mode; the issue allows 3 % and 8 % of the shift
    assert_allclose(shift, oracles.BACKBONE[amplitude], rtol=0.01)


def test_halving_the_step_leaves_the_frequency():
    beam = default(alpha=0.0, eta=0.0)
    shape = beam.release_shape(LARGE, mode=1)
    modes = beam.modes(count=1)
    coarse, fine = (
        oracles.frequency(m.t, modes.project(m).q)
        for m in (run(beam, shape, 2.0, h, modes=modes) for h in (1e-3, 5e-4))
    )
    assert_allclose(coarse, fine, rtol=1e-6)  # ten times better than the issue asks


def second_derivative(t, q):
    return make_interp_spline(t, q, k=7).derivative(2)(t)


def test_acceleration_is_the_second_derivative_over_the_whole_decay(decay_motion):
    motion = decay_motion
    inner = slice(4, -4)  # the spline itself is poor at its ends
    for mode in (1, 2):
        decay = motion.basis.project(motion, mode)
        numeric = second_derivative(decay.t, decay.q)
        peak = np.abs(decay.q_ddot).max()
        assert_allclose(decay.q_ddot[inner], numeric[inner], atol=1e-3 * peak)


def test_velocity_is_the_first_derivative(decay_motion):
    decay = decay_motion.basis.project(decay_motion, 1)
    numeric = make_interp_spline(decay.t, decay.q, k=7).derivative(1)(decay.t)
    peak = np.abs(decay.q_dot).max()
    assert_allclose(decay.q_dot[4:-4], numeric[4:-4], atol=1e-5 * peak)


def test_acceleration_after_a_tip_force_in_fine_samples():
    """A tip force also sets off high modes; sampled finely enough, derivatives agree as well."""
    beam = default()
    motion = run(beam, beam.release_shape(LARGE), 0.2, 1e-4)
    decay = motion.basis.project(motion)
    numeric = second_derivative(decay.t, decay.q)
    later = slice(20, -4)  # 2 ms: until axial waves have died
    peak = np.abs(decay.q_ddot).max()
    assert_allclose(decay.q_ddot[later], numeric[later], atol=1e-3 * peak)


def test_first_acceleration_starts_the_motion(decay_motion):
    decay = decay_motion.basis.project(decay_motion, 1)
    # q(h) = q0 + a0 h^2 / 2 + O(h^4): h^2 omega^2 / 12 is 1e-4, axial waves add 1e-3 at first
    steps = np.arange(3, 7)
    secant = 2 * (decay.q[steps] - decay.q[0]) / decay.t[steps] ** 2
    start = np.polyval(np.polyfit(decay.t[steps] ** 2, secant, 1), 0.0)
    assert_allclose(decay.q_ddot[0], start, rtol=0.02)


def test_full_field_gives_the_same_coordinates():
    beam = default()
    motion = run(beam, beam.release_shape(0.05, mode=1), 0.05, keep_field=True)
    others = beam.modes(count=12)
    q, q_dot, q_ddot = motion.modal(others)
    for full, own in zip(
        (q, q_dot, q_ddot),
        (
            motion.coordinates.displacement,
            motion.coordinates.velocity,
            motion.coordinates.acceleration,
        ),
        strict=True,
    ):
        assert_allclose(full[:, :10], own, atol=1e-6 * np.abs(own).max())


def test_projection_on_modes_that_were_not_recorded():
    beam = default()
    motion = run(beam, beam.release_shape(0.05, mode=1), 0.02, modes=beam.modes(count=2))
    assert beam.modes(count=1).project(motion).q.shape == (21,)
    with pytest.raises(ValueError, match="keep_field=True"):
        beam.modes(count=5).project(motion)
    with pytest.raises(ValueError, match="keep_field=True"):
        default(tip_mass=0.01).modes(count=2).project(motion)


def test_step_too_long_keeps_the_motion(monkeypatch):
    beam = default()
    shape = beam.release_shape(LARGE, mode=1)
    good = transient.Integrator.step

    def breaks_down(self, state, h):
        return None if self.iterations > 30 else good(self, state, h)

    monkeypatch.setattr(transient.Integrator, "step", breaks_down)
    with pytest.raises(StepTooLongError, match=r"try step = 0\.0001 s") as caught:
        run(beam, shape, 0.1)
    motion = caught.value.motion
    assert 1 < len(motion.t) < 101
    assert caught.value.step_to_try == pytest.approx(1e-4)
    assert "step too long" in motion.stop_reason


def test_a_step_beyond_all_measure_fails():
    """Cut a thousandfold, it still spans several swings."""
    beam = default(alpha=0.0, eta=0.0)
    with pytest.raises(StepTooLongError, match="did not converge at t = 0 s with step = 400 s"):
        run(beam, beam.release_shape(LARGE), 400.0, 400.0, energy_tolerance=1e9)


def test_interrupted_run_returns_what_it_has(monkeypatch):
    beam = default()
    shape = beam.release_shape(0.05, mode=1)
    advance = transient.Stepper.advance

    def interrupt(self, t, sample):
        if t > 0.0195:
            raise KeyboardInterrupt
        return advance(self, t, sample)

    monkeypatch.setattr(transient.Stepper, "advance", interrupt)
    motion = run(beam, shape, 1.0)
    assert motion.stop_reason == "interrupted at 0.02 s of 1 s"
    assert_allclose(motion.t[-1], 0.02)
    assert len(motion.energy.total) == 21


@pytest.mark.parametrize("name", ["duration", "step", "energy_tolerance"])
def test_options_must_be_positive(name):
    beam = default()
    options = {"duration": 0.1, "step": 1e-3, name: -1.0}
    with pytest.raises(ValueError, match=f"{name} must be positive.*-1"):
        beam.simulate(beam.equilibrium(), **options, progress=False)


def test_step_longer_than_the_duration():
    beam = default()
    with pytest.raises(ValueError, match=r"step = 2.0 s is longer than duration = 1.0 s"):
        run(beam, beam.equilibrium(), 1.0, 2.0)


def test_shape_of_another_mesh():
    beam = default()
    with pytest.raises(ValueError, match="release a shape of the same mesh"):
        run(beam, Beam.cantilever(elements=10).equilibrium(), 1.0)


def test_progress_bar_is_shown_on_a_terminal_alone(capsys, monkeypatch):
    beam = default()
    beam.simulate(beam.release_shape(0.01, mode=1), 0.01)
    beam.normal_mode([0.01 * beam.length])
    assert capsys.readouterr().err == ""
    monkeypatch.setattr("romsindy.text.on_terminal", lambda: True)
    beam.simulate(beam.release_shape(0.01, mode=1), 0.01)
    assert "simulate" in capsys.readouterr().err
