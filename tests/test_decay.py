import numpy as np
import pytest
from oracles import viscous_decay

from romsindy import Butterworth, Decay, SavitzkyGolay, add_noise

T = np.arange(3000) * 0.01
OMEGA, ZETA = 2 * np.pi * 1.1, 0.01
Q = viscous_decay(T, OMEGA, ZETA)


def derivatives(t=T):
    """Exact velocity and acceleration of the linear oscillator released from rest."""
    damped = OMEGA * np.sqrt(1 - ZETA**2)
    velocity = -(OMEGA**2) / damped * np.exp(-ZETA * OMEGA * t) * np.sin(damped * t)
    q = viscous_decay(t, OMEGA, ZETA)
    return velocity, -(OMEGA**2) * q - 2 * ZETA * OMEGA * velocity


@pytest.mark.parametrize("method", [Butterworth(), SavitzkyGolay(15, 5)])
def test_derivatives_are_those_of_the_signal(method):
    found = Decay(T, Q).differentiated(method)
    velocity, acceleration = derivatives()
    inside = slice(150, -150)
    # Butterworth at ten times the fundamental: gain error 1e-8; Savitzky-Golay: (omega h)^6.
    np.testing.assert_allclose(found.q_dot[inside], velocity[inside], atol=2e-4 * OMEGA)
    np.testing.assert_allclose(found.q_ddot[inside], acceleration[inside], atol=2e-3 * OMEGA**2)


def test_default_cutoff_is_ten_times_the_fundamental():
    """A ripple at that frequency comes through at half its size: gain 1/2 forward and backward."""
    ripple = 0.01 * np.sin(2 * np.pi * 11.0 * T)
    change = Decay(T, Q + ripple).differentiated().q - Decay(T, Q).differentiated().q
    gain = np.std(change[500:-500]) / np.std(ripple[500:-500])
    assert gain == pytest.approx(0.5, abs=0.06)  # the fundamental is known to a line, 0.03 Hz


def test_smoothed_derivatives_agree_with_one_another():
    found = add_noise(Decay(T, Q), 35.0, 0).differentiated()
    np.testing.assert_allclose(found.q_dot[5:-5], np.gradient(found.q, T)[5:-5], atol=0.02 * OMEGA)
    np.testing.assert_allclose(
        found.q_ddot[5:-5], np.gradient(found.q_dot, T)[5:-5], atol=0.05 * OMEGA**2
    )


def test_velocity_and_acceleration_become_displacement():
    velocity, acceleration = derivatives()
    inside = slice(100, -100)
    from_v = Decay.from_velocity(T, velocity, "m")
    np.testing.assert_allclose(from_v.q[inside], Q[inside], atol=2e-4)
    assert from_v.measured == "velocity" and from_v.unit == "m"
    from_a = Decay.from_acceleration(T, acceleration)
    np.testing.assert_allclose(from_a.q[inside], Q[inside], atol=2e-3)
    assert any("drift removed" in note for note in from_a.notes)


def test_several_channels():
    both = Decay(T, np.stack([Q, 2 * Q], axis=1), unit="m")
    assert both.n_channels == 2
    np.testing.assert_array_equal(both.channel(1).q, 2 * Q)
    np.testing.assert_allclose(
        both.differentiated().channel(0).q_dot, Decay(T, Q).differentiated().q_dot, atol=1e-12
    )
    with pytest.raises(ValueError, match=r"2 channels: choose one with decay.channel\(i\)"):
        both.single()
    with pytest.raises(ValueError, match="channel 2 does not exist"):
        both.channel(2)


def test_jitter_is_resampled_and_said():
    t = T + np.random.default_rng(0).uniform(-1e-3, 1e-3, len(T))
    t[0], t[-1] = T[0], T[-1]
    with pytest.warns(
        UserWarning, match=r"jitters by 0.058 of the sampling interval .* at most 0.1"
    ):
        decay = Decay(t, viscous_decay(t, OMEGA, ZETA))
    # Cubic interpolation over (omega dt)^4 / 384.
    np.testing.assert_allclose(decay.q, Q, atol=1e-6)
    assert "resampled" in decay.notes[0]


def test_rounded_times_are_no_jitter():
    assert Decay(np.round(T + 1e-7, 6), Q).notes == ()


def test_free_part_is_found_and_said():
    x = np.concatenate([np.full(800, Q[0]), Q])
    t = np.arange(len(x)) * 0.01
    decay = Decay(t, x).free()
    assert decay.t[0] == pytest.approx(8.0, abs=0.1)
    assert "free decay starts at" in decay.notes[0]
    again = decay.free()
    assert len(again.t) == len(decay.t)  # nothing is lost by asking twice
    np.testing.assert_array_equal(Decay(t, x).free(start=9.0).t[0], 9.0)
    noisy = Decay(t, x + np.random.default_rng(1).normal(0, 0.1, len(t)))
    assert noisy.free(end=36.0).t[-1] == pytest.approx(36.0)
    assert noisy.free().t[-1] < 35.0


def test_offset_is_removed_and_said():
    decay = Decay(T, Q + 0.4, unit="m").free()
    np.testing.assert_allclose(decay.q, Q[-len(decay.q) :], atol=1e-3)
    assert "offset of 0.4" in decay.notes[-1]
    assert Decay(T, Q).free().notes == ()


def test_tail_in_the_noise_is_cut_and_said():
    decay = Decay(T, Q + np.random.default_rng(0).normal(0, 0.1, len(T))).free()
    assert decay.t[-1] < 27  # the amplitude is 0.2, twice the noise, at 23 s
    assert "tail after" in decay.notes[-1] and "noise (rms 0.1 " in decay.notes[-1]


def test_upsampled_keeps_the_samples():
    coarse = Decay(T[::20], Q[::20])  # 4.5 samples a cycle
    fine = coarse.upsampled()
    assert 1 / (fine.dt * 1.1) >= 40
    np.testing.assert_allclose(np.interp(coarse.t, fine.t, fine.q)[5:-5], coarse.q[5:-5], atol=1e-3)


def test_what_came_with_derivatives_is_left_alone(clean):
    assert clean.conditioned() is clean


def test_no_step_is_done_twice():
    raw = Decay(T, Q + 0.4 + np.random.default_rng(0).normal(0, 0.05, len(T)))
    free = raw.free()
    assert (raw.stage, free.stage) == ("raw", "free")
    assert free.free() is free
    # A quieter part of a free decay is one: its own offset and end are not looked for again.
    part = free.between(5.0, 12.0)
    assert part.stage == "free" and part.free() is part
    np.testing.assert_array_equal(free.free(start=5.0, end=12.0).q, part.q)
    conditioned = free.conditioned()
    assert conditioned.stage == "conditioned" and conditioned.conditioned() is conditioned
    assert conditioned.free() is conditioned
    assert conditioned.crossings is conditioned.crossings  # split once
    for bad, match in (
        ({"stage": "cooked"}, r"stage = 'cooked' must be one of"),
        ({"stage": "conditioned"}, r"needs q_dot and q_ddot"),
        ({"measured": "velocity"}, r"measured = 'velocity' needs q_dot"),
    ):
        with pytest.raises(ValueError, match=match):
            Decay(T, Q, **bad)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(q=np.where(T == T[7], np.nan, Q)), r"q has 1 value that is NaN, .* sample 7: cut"),
        (dict(t=np.where(T == T[7], np.inf, T)), "t has 1 value that is NaN, infinite"),
        (dict(t=T[::-1]), r"t must increase, but it decreases at sample 1 \(29.99 -> 29.98 s\)"),
        (dict(t=np.round(T / 2, 2)), r"t must increase, but it repeats at sample"),
        (dict(t=T + (T > 12) * 0.5), r"t has a gap of 0.51 s after 12 s .*: split"),
        (dict(q=np.ones(len(T))), r"q is constant \(1\)"),
        (dict(q=Q[:-1]), r"q must have shape \(3000,\) or \(3000, n_channels\).*got \(2999,\)"),
        (dict(q_dot=Q[:-1]), r"q_dot must have shape"),
        (dict(q_dot=np.stack([Q, Q], 1)), r"q, q_dot and q_ddot must have the same shape"),
        (dict(t=T[:5], q=Q[:5]), r"at least 8 samples"),
        (dict(q=["a"] * len(T)), r"q must be an array of real numbers"),
        (dict(q=Q * 1j), r"q must be an array of real numbers"),
    ],
)  # fmt: skip
def test_bad_input_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        Decay(**({"t": T, "q": Q} | change))


def test_other_bad_input():
    with pytest.raises(ValueError, match="grows, so it is forced"):
        Decay(T, Q[::-1]).free()
    with pytest.raises(ValueError, match="fewer than three cycles"):
        Decay(T[:200], Q[:200]).free()
    with pytest.raises(ValueError, match=r"start = 40, end = None leave 0 samples"):
        Decay(T, Q).between(40)
    with pytest.raises(ValueError, match="must be a positive frequency in Hz"):
        Butterworth(cutoff=-1)
    with pytest.raises(ValueError, match="longer than the record"):
        Decay(T[:20], Q[:20]).differentiated(SavitzkyGolay(31))


def test_arrays_cannot_be_changed_behind_its_back():
    with pytest.raises(ValueError, match="read-only"):
        Decay(T, Q).q[0] = 1.0


@pytest.mark.parametrize(
    ("unit", "remedy"),
    [("g", "by 9.80665, .*from_acceleration"), ("mm/s", "by 0.001, .*from_velocity")],
)
def test_a_unit_of_another_quantity_than_q_is_refused(unit, remedy):
    """A record of an acceleration in g would become a displacement in "g"."""
    t = np.arange(1000) / 100
    x = np.exp(-0.2 * t) * np.cos(20 * t)
    for make in (Decay.from_acceleration, Decay):
        with pytest.raises(ValueError, match=f"unit = '{unit}' is a unit of .*{remedy}"):
            make(t, x, unit=unit)
