"""Vibrations in a free decay: signals that are known in closed form."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

import romsindy as rs
from romsindy.record.ridges import find_ridges
from romsindy.record.ringing import ringing_in
from romsindy.record.signals import downsample
from romsindy.record.vibrations import dominant, find_vibrations, isolated, resonances, together

RATE = 2000.0
T = np.arange(0, 6.0, 1 / RATE)


def tone(frequency, zeta, size=1.0, phase=0.3, t=T):
    """A damped cosine: displacement, velocity and acceleration in closed form."""
    w = 2 * np.pi * frequency
    z = size * np.exp((-zeta + 1j) * w * t + 1j * phase)
    return [np.real(z * ((-zeta + 1j) * w) ** k) for k in range(3)]


def softening(size=1.0, order=1, t=T):
    """40 Hz at rest, 44 Hz at the largest amplitude; of a harmonic, order times the phase."""
    a = np.exp(-1.2 * t)
    phase = 2 * np.pi * (40 * t + 4 * (1 - a**2) / 2.4)
    return size * a**order * np.cos(order * phase + 0.2), 40 + 4 * a**2


def noise(level, seed=0):
    return level * np.random.default_rng(seed).standard_normal(len(T))


def test_tones_are_followed_to_their_frequencies():
    x = tone(40.0, 0.003)[0] + tone(97.0, 0.004, 0.5)[0] + tone(310.0, 0.002, 0.3)[0] + noise(1e-3)
    found = find_vibrations(x, 1 / RATE)
    assert len(found) == 3
    for v, (f, zeta) in zip(found, [(40.0, 0.003), (97.0, 0.004), (310.0, 0.002)], strict=True):
        assert v.mean_frequency == pytest.approx(f, rel=2e-4)
        assert v.loud.damping_ratio == pytest.approx(zeta, rel=0.04)  # of three windows


def test_frequency_that_moves_is_followed():
    x, frequency = softening()
    (ridge,) = find_ridges(x + noise(1e-3), 1 / RATE)
    inside = (T > 0.1) & (T < 4.0)  # later it is noise, to a part in a hundred
    _, found, size = ridge.along(T[inside])
    assert np.abs(found / frequency[inside] - 1).max() < 2e-3
    assert np.abs(size / np.exp(-1.2 * T[inside]) - 1).max() < 0.03


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_ends_are_one_point_of_the_backbone_each(derivative):
    """Drag, 60 to 40 Hz: frequency and damping ratio are known at every amplitude."""
    a = 1 / (1 + 1.2 * T)
    turn = a * np.exp(2j * np.pi * (40 * T + 20 * T * a))
    rate = -1.2 * a + 2j * np.pi * (40 + 20 * a**2)
    x = np.real(turn * rate**derivative)
    (found,) = find_vibrations(x + noise(1e-4 * np.std(x)), 1 / RATE, derivative)
    for end, size in ((found.loud, a[0]), (found.quiet, a[-1])):
        assert abs(np.log(end.amplitude / size)) < 0.25
        hertz = 40 + 20 * end.amplitude**2
        assert end.frequency == pytest.approx(hertz, rel=5e-3)
        # Its course over the first windows is extrapolated.
        zeta = 1.2 * end.amplitude / (2 * np.pi * hertz)
        assert end.damping_ratio == pytest.approx(zeta, rel=0.05)


def test_harmonic_belongs_to_its_vibration_and_a_mode_near_it_does_not():
    main, _ = softening()
    harmonic, _ = softening(0.1, 2)
    with_harmonic = find_vibrations(main + harmonic + noise(1e-4), 1 / RATE)
    assert [[n for n, _ in v.harmonics] for v in with_harmonic] == [[2]]
    other = find_vibrations(main + tone(80.6, 0.003, 0.1)[0] + noise(1e-4), 1 / RATE)
    assert [v.harmonics for v in other] == [(), ()]
    (resonance,) = resonances(other)
    assert (resonance.p, resonance.q) == (1, 2)


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_isolated_vibration_is_the_one_that_was_put_in(derivative):
    own, others = tone(40.0, 0.003), [tone(97.0, 0.004, 0.3), tone(310.0, 0.002, 0.02)]
    x = own[derivative] + sum(o[derivative] for o in others)
    found = find_vibrations(x, 1 / RATE, derivative)
    decay = isolated(T, x, found, dominant([v.energy for v in found]), "m")
    assert decay.unit == "m" and decay.stage == "free" and decay.derivative == derivative
    truth = [np.interp(decay.t, T, s) for s in own]
    # Where the others have faded by 60 dB they are no longer followed: a thousandth of the largest
    # of them, the acceleration at 97 Hz, is 2e-3 of the own one. One with less than 2e-4 of the
    # energy of the signal, 2 % of the displacement here, is no vibration to be taken off.
    largest = [np.abs(s).max() for s in own]
    assert np.abs(decay.signal - truth[derivative]).max() < 0.02 * largest[derivative]
    assert np.abs(decay.q - truth[0]).max() < (0.02 if derivative == 0 else 0.005) * largest[0]


def test_offset_of_an_accelerometer_moves_no_displacement():
    """0.1 m/s^2 over six seconds would be 1.8 m."""
    x = tone(40.0, 0.003, 1e-3)[2] + 0.1 + 0.02 * T
    found = find_vibrations(x - x.mean(), 1 / RATE, 2)
    decay = isolated(T, x - x.mean(), found, dominant([v.energy for v in found]), "m")
    assert np.abs(decay.q - np.interp(decay.t, T, tone(40.0, 0.003, 1e-3)[0])).max() < 2e-5


def test_hum_is_steady_and_never_dominant():
    x = tone(40.0, 0.003, 0.5)[0] + np.cos(2 * np.pi * 50 * T) + noise(1e-3)
    found = find_vibrations(x, 1 / RATE)
    assert [v.steady for v in found] == [False, True]
    assert dominant([v.energy * (not v.steady) for v in found]) == 0


def test_noise_rings_nowhere():
    for seed in range(5):
        assert find_vibrations(noise(1.0, seed), 1 / RATE) == ()


def test_seven_cycles_are_enough():
    t = np.arange(0, 4.0, 0.001)
    (found,) = find_vibrations(tone(1.75, 0.04, t=t)[0], 0.001)
    assert found.mean_frequency == pytest.approx(1.75, rel=0.01)


def test_downsampled_signal_is_the_slow_signal():
    """To the ends: a decimation that pads with zeros loses the last cycle."""
    slow = tone(5.0, 0.001)[0]
    coarse = downsample(slow, 20)
    assert len(coarse) == len(T[::20])
    # Odd reflection has a kink where the slope of the signal changes: 1e-3 at the very ends.
    assert np.abs(coarse - slow[::20]).max() < 3e-3
    assert np.abs(coarse - slow[::20])[20:-20].max() < 2e-4


def test_channels_together_are_the_mode_with_less_noise():
    """Three channels of one noise: the error of their weighted sum is that of one over |shape|."""
    rng, level = np.random.default_rng(5), 0.02
    own, other = tone(40.0, 0.003)[0], tone(97.0, 0.004, 0.5)[0]
    shape = np.array([1.0, -0.8, 0.5])
    x = np.outer(own, shape) + np.outer(other, [1.0, 0.3, -1.1])
    x = np.column_stack([x, tone(23.0, 0.01)[0]]) + level * rng.standard_normal((len(T), 4))
    (ridge,) = [v.tone for v in find_vibrations(x[:, 0], 1 / RATE) if v.mean_frequency < 50]
    combined, seen = together(T, x, 0, ridge)
    assert seen[:3] == pytest.approx(shape, abs=0.01)
    assert seen[3] == 0  # another vibration
    weights = shape / (shape @ shape)
    rest = combined - own - (weights @ [1.0, 0.3, -1.1]) * other
    assert rest.std() == pytest.approx(level / np.linalg.norm(shape), rel=0.03)


def test_high_harmonics_stay_with_their_vibration():
    """A seventh harmonic that is taken for another vibration would be taken off."""
    a = np.exp(-1.2 * T)
    phase = 2 * np.pi * (40 * T + 4 * (1 - a**2) / 2.4)
    x = a * (np.cos(phase) + 0.05 * np.cos(3 * phase) + 0.03 * np.cos(7 * phase)) + noise(1e-4)
    (found,) = find_vibrations(x, 1 / RATE)
    assert [n for n, _ in found.harmonics] == [3, 7]


def test_strong_tone_near_a_multiple_is_no_harmonic():
    """A quarter of a second of 64.6 Hz, and of 271.6 Hz, which is 4.2 times as fast."""
    t = np.arange(0, 0.25, 1 / 5000)
    x = 0.3 * tone(64.6, 0.01, t=t)[0] + tone(271.6, 0.003, t=t)[0]
    assert any(abs(v.mean_frequency / 271.6 - 1) < 0.01 for v in find_vibrations(x, 1 / 5000))


def test_tone_that_is_driven_stays():
    driven = tone(17.6, 1e-7)[0] + tone(18.0, 0.02, 0.5)[0] + noise(1e-3)
    assert any(v.stays for v in find_vibrations(driven, 1 / RATE))
    assert not any(v.stays for v in find_vibrations(tone(40.0, 2e-3)[0] + noise(1e-3), 1 / RATE))


@pytest.mark.parametrize(("k2", "derivative"), [(0.25, 0), (-0.6, 0), (0.5, 1), (-0.4, 2)])
def test_second_harmonic_of_an_asymmetric_spring_is_no_mode(k2, derivative):
    """Its frequency moves with amplitude; integrated numerically, drag and all."""

    def rates(_, y):
        q, v = y
        return [v, -0.01 * v - 0.05 * v * abs(v) - q - k2 * q**2 - 0.8 * q**3]

    t = np.arange(0, 900, 0.25)
    q, v = solve_ivp(rates, (0, t[-1]), [0.9, 0.0], "DOP853", t, rtol=1e-9).y
    x = [q, v, np.array(rates(0, (q, v))[1])][derivative]
    x = x + 3e-3 * np.std(x) * np.random.default_rng(1).standard_normal(len(t))
    found = [v for v in find_vibrations(x, 0.25, derivative) if not v.faint]
    assert len(found) == 1 and resonances(found) == ()


@pytest.mark.parametrize("polluted", [0.0, 0.02])
def test_harmonic_of_a_fundamental_that_sweeps_is_told_by_its_phase(polluted):
    """60 to 40 Hz; its amplitude grows first and falls with the square later, as where springs
    harden much. A tone that crosses it takes part of its phase."""
    a = np.exp(-0.8 * T)
    phase = 2 * np.pi * (40 * T + 20 * (1 - a**2) / 1.6)
    size = 0.02 * a**2 / (a**3 + 0.03)
    main = a * np.cos(phase) + noise(1e-4) + tone(103.0, 0.004, polluted)[0]
    harmonic = size * np.cos(2 * phase + 0.2)
    found = find_vibrations(main + harmonic, 1 / RATE)
    (own,) = [v for v in found if v.mean_frequency < 60]
    # No mode of its own, and not made by the motion either: its amplitude goes its own way.
    assert 2 in [n for n, _ in own.carried] and resonances([own]) == ()
    assert 2 not in [n for n, _ in own.harmonics]
    assert all(v is own or 100 < v.mean_frequency < 106 for v in found)
    other = find_vibrations(main + size * np.cos(2 * np.pi * 81.0 * T), 1 / RATE)
    assert any(abs(v.mean_frequency / 81.0 - 1) < 0.01 for v in other)


def test_mode_that_decays_by_itself_is_no_harmonic():
    """0.4 % off 2:1: over a decay their phases part; and at 2:1, where it decays faster."""
    for f, zeta in ((80.32, 0.0022), (80.0, 0.0085)):
        x = tone(40.0, 0.003)[0] + tone(f, zeta, 0.3)[0] + noise(1e-3)
        assert [v.harmonics for v in find_vibrations(x, 1 / RATE)] == [(), ()]


def test_shares_of_tones_that_beat_add_up_to_one():
    """Fitted together they may cancel: energies would add up to more than there is."""
    for ratio in (1.03, 1.1, 1.3):
        x = tone(40.0, 0.004)[0] - 0.9 * tone(40.0 * ratio, 0.003)[0] + noise(1e-2)
        share = sum(v.share for v in find_vibrations(x, 1 / RATE))
        assert 0.99 < share <= 1 + 1e-12


def test_amplitudes_begin_where_the_decay_begins():
    """Damped by 4 %: a window of sixteen cycles sees the mean of what falls to a fiftieth."""
    t = T[T < 0.7]
    (found,) = find_vibrations(tone(40.0, 0.04, t=t)[0] + noise(1e-3)[: len(t)], 1 / RATE)
    # Knots of splines are four cycles apart, in which it falls to a third.
    assert found.displacement[0] == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("kind", ["line", "warming up", "walk"])
def test_drift_is_no_vibration(kind):
    """As large as the vibration, or larger: the rest of a drift is no peak of the spectrum."""
    drifts = {
        "line": T / T[-1],
        "warming up": 1 - np.exp(-T / 0.7),
        "walk": np.cumsum(noise(1.0, 3)) / 100,
    }
    x = tone(40.0, 0.004)[0] + 2 * drifts[kind] + noise(1e-3)
    (found,) = find_vibrations(x - x.mean(), 1 / RATE)
    assert found.mean_frequency == pytest.approx(40.0, rel=2e-3)
    assert 0.8 < found.share <= 1


@pytest.mark.parametrize("ratio", [1.9, 2.07, 3.1])
def test_mode_that_dies_away_early_is_found(ratio):
    """Two hundred cycles of a mode; of another, 20 dB weaker, nothing is left by the middle."""
    t = np.arange(0, 20, 1 / 200)
    weak = tone(10.0 * ratio, 0.01, 0.1, t=t)[0]
    x = tone(10.0, 0.005, t=t)[0] + weak
    x += 0.002 * np.random.default_rng(7).standard_normal(len(t))
    first, second = find_vibrations(x, 1 / 200)
    assert second.mean_frequency == pytest.approx(10.0 * ratio, rel=2e-3)
    # At the start, where both are loud, the fits give up to 7e-4 of the first to the second.
    assert second.share == pytest.approx(weak @ x / (x @ x), abs=1e-3)  # of 0.0018 to 0.0028
    assert not (first.harmonics or second.harmonics)


def test_tone_of_few_cycles_a_window_is_heard():
    """Twelve cycles: the tone fills its octave, and no bin of it may count as noise."""
    t = np.arange(0, 2, 1e-3)
    modes = [(6.2, 0.006, 0.005), (26.4, 0.01, 2e-3), (72.0, 0.01, 1e-3)]
    x = sum(tone(*mode, t=t)[0] for mode in modes)
    x += 7e-5 * np.random.default_rng(4).standard_normal(len(t))
    found = find_vibrations(x, 1e-3)
    # Twelve cycles at 35 dB know the slowest to some 1e-3.
    np.testing.assert_allclose([v.mean_frequency for v in found], [6.2, 26.4, 72.0], rtol=3e-3)


def test_mode_that_comes_and_goes_is_not_steady():
    """As one that gets its energy from another, and gives it back."""
    size = 0.1 * (1 - 0.8 * np.cos(2 * np.pi * (T - 0.5) / 2))
    x = tone(40.0, 0.003)[0] + size * np.cos(2 * np.pi * 83.0 * T) + noise(1e-3)
    low, high = find_vibrations(x, 1 / RATE)
    assert not (low.steady or high.steady)
    assert high.mean_frequency == pytest.approx(83.0, rel=1e-3)


def seen(*signals, shapes, level=0.0, colour=0.0):
    """Signals in channels of some shapes, with noise that keeps a part from sample to sample."""
    x = np.stack(signals, axis=1) @ np.transpose(shapes)
    e = np.random.default_rng(3).standard_normal(x.shape)
    e = lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], e, axis=0)
    return rs.Decay(T, x + level * e, unit="m", stage="free")


@pytest.mark.parametrize("shapes", [[[1.0, 0.8], [0.7, -0.5]], [[1.0, 0.8], [0.5, 0.45]], [[1, 1]]])
def test_two_vibrations_that_beat_are_told_apart(shapes):
    """3 % apart: five beats; windows of less than a beat cannot."""
    decay = seen(tone(30, 3e-3)[0], tone(30.9, 5e-3, 0.7)[0], shapes=shapes, level=0.01)
    found = sorted(ringing_in([decay]), key=lambda v: v.small_frequency)
    # Noise of 1 % in 12,000 samples moves a frequency by less than 1e-3 Hz, the damping of a
    # wave that beats with another one by some per cent.
    assert [v.small_frequency for v in found] == pytest.approx([30, 30.9], abs=5e-3)
    assert [v.small_damping_ratio for v in found] == pytest.approx([3e-3, 5e-3], rel=0.1)


def test_one_whose_frequency_moves_in_coloured_noise_is_no_two():
    decay = seen(softening()[0], shapes=[[1.0], [-0.6]], level=0.02, colour=0.95)
    assert len(ringing_in([decay])) == 1


def test_hum_beside_a_vibration_is_no_second_one():
    hum = 0.4 * np.cos(2 * np.pi * 41 * T)
    decay = seen(tone(40, 3e-3)[0], hum, shapes=[[1.0, 0.3], [0.5, 1.0]], level=0.01)
    assert [round(v.small_frequency) for v in ringing_in([decay])] == [40]


@pytest.mark.parametrize("omega", [14.0, 15.8, 17.0])  # rad/s; of six, no harmonic
def test_what_rings_in_a_channel_alone_is_heard(omega):
    t = np.arange(0, 20, 0.02)
    x = np.exp(-0.05 * t)[:, None] * np.cos(np.outer(t, [6.0, omega])) * [1.0, 0.5]
    found = sorted(v.small_frequency for v in ringing_in([rs.Decay(t, x)])[:2])
    assert found == pytest.approx(np.array([6.0, omega]) / (2 * np.pi), rel=2e-3)


def test_a_mode_alone_in_its_channel_comes_before_a_combination():
    """q1^2 q2 rings at the difference of the frequencies, too, in the channel of q1."""
    model = rs.CoupledModel.from_coefficients(
        {"omega^2 [q1]": 36.0, "omega^2 [q2]": 250.0, "c_linear [q1]": 0.1, "c_linear [q2]": 0.1}
        | {"V q1^2 q2": 5.0},
        unit="m",
    )
    decay = model.simulate((1.0, 0.5), (0.0, 0.0), np.arange(0, 20, 0.02))
    two = sorted(v.small_frequency for v in ringing_in([decay])[:2])
    # Frequencies of the small motion follow from the largest one by a fit.
    assert two == pytest.approx(np.sqrt([36.0, 250.0]) / (2 * np.pi), rel=5e-3)


@pytest.mark.slow
def test_the_scale_of_each_that_beats_is_that_of_the_channel_it_moves_most():
    """By another simulator; what is followed of them in the channels differs by some per cent."""
    w1, w2 = 2 * np.pi * 4.0409, 2 * np.pi * 5.2532
    g1, g2, k = 6.48e5, 1.205e5, 2.986e5

    def rates(_, s):
        x, y, u, v = s
        first = w1**2 * x + 0.449 * u + g1 * x**3 + 2 * k * x * y**2
        return [u, v, -first, -(w2**2 * y + 0.539 * v + g2 * y**3 + 2 * k * x**2 * y)]

    t = np.arange(0, 6.187, 1 / 200)
    start = [0.00565, 0.01654, 0.0, 0.0]
    q = solve_ivp(rates, (0, 6.2), start, "DOP853", t, rtol=1e-9, atol=1e-12).y[:2].T
    x = q @ [[1.0, 0.5], [0.4, 1.0]]
    x = x + 0.0065 * x.std(axis=0) * np.random.default_rng(8).standard_normal(x.shape)
    fit = rs.identify(rs.Decay(t, x, unit="m"), 2)
    assert fit.mode_shapes == pytest.approx(np.array([[1.0, 0.4], [0.5, 1.0]]), abs=0.01)
    found = fit.model.coefficients
    assert found["omega^2 [q2]"] == pytest.approx(w2**2, rel=1e-3)
    assert found["V q1^2 q2^2"] == pytest.approx(k, rel=0.1)
