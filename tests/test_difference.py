"""Differences between decays of closed form, in frequency, damping and waveform."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

import romsindy as rs
from romsindy.diagnosis import words
from romsindy.diagnosis.difference import Difference, Tolerance
from romsindy.diagnosis.gap import HELD_OUT, Gap, Prediction
from romsindy.fit.records.record import Record
from romsindy.record.smoothing import Cycles

T = np.arange(0, 20, 0.0025)
TOLERANCE = Tolerance(1e-4, 1e-2, 2e-4)  # what the best sensors show


def signal(frequency=5.0, zeta=0.005, third=0.0, mean=0.0, amplitude=1.0, t=T):
    """A decay with a third harmonic that grows with the cube of the amplitude."""
    omega = 2 * np.pi * frequency
    a = amplitude * np.exp(-zeta * omega * t)
    return a * np.cos(omega * t) + third * a**3 * np.cos(3 * omega * t) + mean


def record(x=None, noise=0.0, seed=0, colour=0.0, t=T):
    """White noise of a standard deviation, or that of an autoregression of the first order."""
    x = signal(t=t) if x is None else x
    white = np.random.default_rng(seed).standard_normal(len(t))
    coloured = lfilter([np.sqrt(1 - colour**2)], [1, -colour], white)
    return Record.loud(rs.Decay(t, x + noise * coloured), 2e-4)


def difference(measured, x):
    return Difference.of(measured, x[: len(measured.t)])


def test_cycles_of_a_decay_have_its_frequency_and_decay_rate():
    omega = 2 * np.pi * 5.0
    cycles = Cycles.of(T, signal(third=0.1, mean=0.2), omega * T)
    frequency, rate = cycles.rates()
    # Amplitudes that fall by 3 % a cycle let harmonics leak into each other: the mean changes the
    # phase by 1e-4 of itself, from cycle to cycle by a thirtieth of that.
    assert_allclose(frequency, omega, rtol=1e-5)
    assert_allclose(rate[5:-5], 0.005 * omega, rtol=5e-3)
    assert_allclose(cycles.waveform[:, 0].real, 0.2, rtol=2e-2)
    loud = cycles.amplitude > 0.1
    third = np.abs(cycles.waveform[loud, 2])
    assert_allclose(third, 0.1 * cycles.amplitude[loud] ** 3, rtol=2e-2)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"frequency": 5.005}, (1e-3, 0.0, 0.0)),
        ({"zeta": 0.0055}, (0.0, 1 - 0.005 / 0.0055, 0.0)),
        ({"zeta": 0.0045}, (0.0, -0.1, 0.0)),
        ({"mean": 0.01}, (0.0, 0.0, 0.01)),
        ({}, (0.0, 0.0, 0.0)),
    ],
)
def test_differences_of_closed_form(changed, expected):
    d = difference(record(), signal(**changed))
    assert_allclose((d.frequency, d.damping, d.signal), expected, rtol=0.08, atol=1e-4)
    assert d.exceeds(TOLERANCE) is any(expected)
    assert len(d.parts) == 14


def test_frequency_and_damping_are_compared_at_equal_amplitude():
    """A hardening decay beside one that decays faster: same frequency at every amplitude."""

    def hardening(rate):
        turns = 31.4 * (T + 0.1 * (1 - np.exp(-2 * rate * T)) / (2 * rate))
        return np.exp(-rate * T) * np.cos(turns)

    d = difference(record(hardening(0.15)), hardening(0.18))
    assert_allclose(d.damping, 1 - 0.15 / 0.18, rtol=0.01)
    assert max(abs(p.frequency) for p in (d, *d.parts)) < 3e-5


@pytest.mark.parametrize("cycles", [20, 25, 30])
def test_a_frequency_that_swings_to_and_fro_is_no_agreement(cycles):
    """By 1 %, in as many cycles as an eighth of a record has: there it is nearly that on average.

    In parts of eight cycles it is all of the swing but for what these average themselves.
    """
    t = np.arange(0, 30, 0.0025)
    turns, swing = 2 * np.pi * 5.0 * t, 2 * np.pi * 5.0 / cycles
    swinging = np.exp(-0.1 * t) * np.cos(
        turns + 0.01 * (2 * np.pi * 5.0 / swing) * np.sin(swing * t)
    )
    d = difference(record(swinging, noise=0.003, t=t), signal(zeta=0.1 / (2 * np.pi * 5.0), t=t))
    assert abs(d.frequency) < 1e-3 and d.exceeds(Tolerance())
    worst = d.largest(Tolerance())
    assert worst.share < 1 / 12 and 0.004 < abs(worst.frequency) < 0.0105


def test_the_part_where_a_difference_is_largest_has_its_amplitudes():
    d = difference(record(noise=0.001), signal(third=0.01))
    loud = d.largest(TOLERANCE)
    assert d.exceeds(TOLERANCE) and loud.amplitude[1] > 0.9 and loud.amplitude[0] > 0.2
    assert loud.signal > 2 * d.parts[-1].signal


@pytest.mark.parametrize(
    ("cycles", "colour"),
    [
        (20, 0.9),
        *(pytest.param(20, c, marks=pytest.mark.slow) for c in (0.0, 0.99)),
        *(pytest.param(80, c, marks=pytest.mark.slow) for c in (0.0, 0.9, 0.99)),
    ],
)
def test_standard_errors_are_the_scatter_over_seeds(colour, cycles):
    """40 records: an rms is known to 11 %.

    The mean position under noise that wanders for as long as the record is told from an offset in
    nine of ten records only.
    """
    t = T[T < cycles / 5]
    all_of_them = [
        difference(record(signal(t=t), 0.01, seed, colour, t), signal(t=t)) for seed in range(40)
    ]
    for name in ("frequency", "damping"):
        values, errors = (
            np.array([getattr(d, k) for d in all_of_them]) for k in (name, f"{name}_std")
        )
        assert 0.5 < np.sqrt(np.mean((values / errors) ** 2)) < 1.4, name
    chance = {0.0: 1, 0.9: 4, 0.99: 6}[colour]
    assert sum(d.exceeds(TOLERANCE) for d in all_of_them) <= chance


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_noise_is_no_difference_of_short_parts(colour):
    """Thirty parts of 150 cycles, of which sixteen have nine: as of 14, one record in ten."""
    t = np.arange(0, 30, 0.0025)
    x = signal(zeta=0.002, t=t)
    found = [difference(record(x, 0.01, seed, colour, t), x) for seed in range(20)]
    assert len(found[0].parts) == 30
    assert sum(d.exceeds(TOLERANCE) for d in found) <= {0.0: 1, 0.9: 2}[colour]


def test_a_simulation_that_dies_is_compared_over_what_it_has():
    measured = record(noise=0.001)
    dying = np.where(T < 4, signal(frequency=5.05), 0.0)
    d = difference(measured, dying)
    assert_allclose(d.frequency, 0.01, rtol=0.05)
    assert d.amplitude[0] > 0.4 and d.exceeds(TOLERANCE)


@pytest.mark.parametrize(
    "x", [np.zeros_like(T), signal(amplitude=0.001), np.full_like(T, np.nan), np.exp(-T)]
)
def test_a_simulation_that_shares_no_amplitudes_differs(x):
    d = difference(record(noise=0.001), x)
    assert np.isnan(d.frequency) and d.signal > 0.2
    assert d.exceeds(TOLERANCE) and d.exceeds(Tolerance(0.1, 0.5, 0.1))


@pytest.mark.parametrize(("x", "off"), [(signal(), 0.28), (np.zeros_like(T), 0.0)])
def test_a_motion_that_friction_holds_from_the_start_is_compared(x, off):
    loud = record(noise=0.001)
    held = replace(loud, signal=np.zeros_like(loud.signal))
    d = Difference.of(held, x[: len(loud.t)], exact=True)
    # Rms of a decay over its first amplitude: e^(-2 zeta omega t) / 2 is averaged over its length.
    assert_allclose(d.signal, off, atol=0.01)


def test_a_record_of_three_cycles_is_compared_as_it_is():
    t = T[T < 0.8]
    d = difference(record(signal(t=t), 0.001, t=t), signal(t=t))
    assert not d.exceeds(TOLERANCE)
    assert difference(record(signal(t=t), 0.001, t=t), signal(amplitude=0.9, t=t)).signal > 0.02


def test_hum_is_a_difference_of_the_waveform():
    """A window spreads its line: its rms is read to 6 %."""
    measured = record(signal() + 0.02 * np.cos(2 * np.pi * 50.3 * T), 0.001)
    assert_allclose(difference(measured, signal()).signal, 0.02 / np.sqrt(2), rtol=0.1)


def gap(before, after, measured=None):
    measured = measured or record(noise=0.001)
    n = len(measured.t)
    return Gap((Prediction(measured, before[:n], after[:n]),), True)


def test_a_gap_that_closes_and_what_changes_it():
    """Neither of the two signals has noise: their difference is that of closed form."""
    found = gap(signal(frequency=5.005), signal())
    assert not found.within(TOLERANCE) and found.leaves_within(TOLERANCE)
    assert 0.99 < found.closed <= 1
    (change,) = found.changes
    assert_allclose(change.frequency, 0.001, rtol=0.01)
    assert change.frequency_std < 1e-6 and change.exceeds(TOLERANCE)
    (back,) = found.changes_from(gap(signal(), signal(zeta=0.006)))
    assert_allclose(back.damping, 1 / 6, rtol=0.01)


def test_a_change_beside_the_harmonics_is_a_change():
    """A tone of 2 % at a frequency of its own is all that two exact motions differ by: its rms, but
    for 5 per cent that the spline of few harmonics takes of it.

    One shown by a measured record and by neither of the two is none of it.
    """
    tone = 0.02 * np.cos(2 * np.pi * 3.7 * T)
    (change,) = gap(signal(), signal() + tone).changes
    assert_allclose(change.signal, 0.02 / np.sqrt(2), rtol=0.1)
    measured = record(signal() + 0.02 * np.cos(2 * np.pi * 50.3 * T), 0.001)
    (alike,) = gap(signal(), signal(), measured).changes
    assert alike.signal < 1e-6


def test_signals_without_common_amplitudes_have_words_for_it():
    """A simulation that dies after two cycles: nothing can be compared, and nan says nothing."""
    found = gap(signal(zeta=0.5), signal())
    rows = {row[0]: row[1:] for row in found.table()}
    assert "nan" not in str(rows)
    before, after = rows["amplitudes compared, [q]"]
    assert before == "hardly any in common"
    # From 1 to exp(-pi), less up to two cycles of 3 % at either end: their windows lie within.
    ends = [np.exp(-np.pi), 1.0]
    assert_allclose([float(a) for a in after.split(" to ")], ends, rtol=0.07)
    assert rows["frequency, % off"][0] == rows["damping ratio, % off"][0] == "-"
    assert rows["waveform, % of amplitude"][0].endswith("(all that differs)")
    # The amplitudes are those of the record: not where it passes zero.
    (apart,) = found.differences_before
    assert apart.apart and apart.amplitude == pytest.approx(ends, rel=0.07)


def test_a_record_has_one_name_in_sentence_and_table():
    """The held-out record is the worst of two: it differs by the frequency that was put in."""
    measured, n = record(noise=0.001), len(record(noise=0.001).t)
    one = Prediction(measured, signal()[:n], signal()[:n])
    other = Prediction(measured, signal(frequency=5.005)[:n], signal()[:n], HELD_OUT)
    found = Gap((one, other), True)
    sentence = words.difference(found.differences_before, TOLERANCE, found.shown)
    assert "0.1 % in frequency over" in sentence and f"in {HELD_OUT} (" in sentence
    assert "record 2" not in sentence
    titles = [row[0].partition(": ")[0] for row in found.table()[1:]]
    assert {*titles} == {"record 1", HELD_OUT}


def test_a_part_of_a_record_is_said_to_be_one():
    """In the second half the simulation runs ahead faster and faster."""
    omega = 2 * np.pi * 5
    ahead = 1e-4 * omega * np.maximum(T - 10, 0) ** 2
    later = np.exp(-0.005 * omega * T) * np.cos(omega * T + ahead)
    found = gap(later, signal())
    (whole,) = found.differences_before
    sentence = words.difference([whole], TOLERANCE, found.shown)
    part = whole.worst(TOLERANCE)
    assert part is not whole and part.frequency > abs(whole.frequency)
    assert part.amplitude[1] < np.exp(-np.pi / 2)
    assert ", where they differ most (" in sentence


def test_a_gap_within_tolerance_and_one_that_grows():
    stated = Tolerance(frequency=2e-3, source="stated")
    found = gap(signal(frequency=5.005), signal())
    assert found.before > 10 and found.within(stated)
    grows = gap(signal(), signal(frequency=5.005))
    assert grows.closed == 0 and not grows.leaves_within(TOLERANCE)
    # Better damping does not make up for a frequency that is now wrong.
    assert not gap(signal(zeta=0.006), signal(frequency=5.005)).leaves_within(TOLERANCE)


@pytest.mark.parametrize("name", ["frequency", "damping", "signal"])
@pytest.mark.parametrize("value", [-0.1, float("nan"), float("inf"), "1 %", None])
def test_a_tolerance_that_is_no_size_is_refused(name, value):
    with pytest.raises(ValueError, match=f"tolerance of {name} = .*such as 0.001"):
        Tolerance(**{name: value})
