"""A beam is diagnosed however it was held before it was let go, and however it is supported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import romsindy as rs
from romsindy.beam import CLAMPED, Beam, NoEquilibriumError, Section, Sensor
from romsindy.beam.changes import Denser, StifferBending, StifferMaterial, StifferSpring
from romsindy.diagnosis.on_beam import InstrumentedBeam
from romsindy.diagnosis.on_beam.parameters import that_do_the_same
from romsindy.diagnosis.on_beam.release import (
    FAILURES,
    BeamRelease,
    OnBeam,
    _towards,
    bending,
    read_release,
    rung_by,
)
from romsindy.diagnosis.on_beam.within_tolerances import effects_of
from romsindy.diagnosis.structure import AskedMotion
from romsindy.effects import AtPoint, Damper, PointMass
from romsindy.fit.records.record import Record
from romsindy.record.signals import with_noise

BEAM = Beam.cantilever(elements=8)
SEEN = InstrumentedBeam(BEAM, BEAM.sensors([Sensor(x) for x in (0.12, 0.2, 0.28, 0.36, 0.45)]))
TIP = BEAM.point_load((0.0, 1.0))
STEP = 4e-3


def pulled(seen, truth, q, seed, load, duration=3.0, step=STEP, snr=37.0):
    """A decay of a beam that a load held."""
    readings = seen.readings(truth, q, duration, step, load)
    return rs.Decay(step * np.arange(len(readings)), with_noise(readings, snr, seed), unit="m")


def test_what_rings_after_a_release_is_read_from_the_sensors():
    """A force at the tip moves mode k by F phi_k(tip) / omega_k^2: a closed form."""
    readings = SEEN.readings(BEAM, 0.016, 0.5, STEP, TIP)
    ringing = read_release(SEEN, BEAM, (0.016, 0.0), readings, STEP).ringing
    basis = BEAM.modes(count=3)
    exact = basis.shapes[:, -1, 1] / basis.omega**2
    # Mode 4, of 0.2 %, cannot be seen at 250 Hz; the others take part of it. Modes that go with
    # the first where it bends far, 1e-3, are no ringing.
    np.testing.assert_allclose(ringing.displaced / 0.016, exact[1:] / exact[0], atol=3e-3)
    assert not ringing.rates.any()


def test_a_mode_that_is_sampled_barely_twice_a_cycle_is_read():
    """The sensors tell three modes apart; one that was not read rang in the record alone."""
    basis = BEAM.modes(count=3)
    step = 0.9 * np.pi / basis.omega[2]
    readings = SEEN.readings(BEAM, 0.016, 0.5, step / 8, TIP)[::8]
    ringing = read_release(SEEN, BEAM, (0.016, 0.0), readings, step).ringing
    exact = basis.shapes[:, -1, 1] / basis.omega**2
    np.testing.assert_allclose(ringing.displaced / 0.016, exact[1:] / exact[0], atol=3e-3)


def test_a_release_is_read_as_far_as_the_beam_can_be_held():
    def simulated(ratios):
        if ratios[0] > 0.31:
            raise NoEquilibriumError("too far")
        return 10 * ratios

    here = simulated(np.array([0.1]))
    for step, reached in ((0.1, 0.2), (0.4, 0.3), (0.7, 0.275), (2.0, 0.1)):
        start = np.array([0.1])
        ratios, found = _towards(simulated, start, np.array([step]), here, lambda x: -x[0])
        np.testing.assert_allclose([ratios[0], found[0]], [reached, 10 * reached])


def test_a_release_is_read_no_further_than_it_comes_nearer():
    """Where the whole step leads beyond what was measured by more than it was short, half of it."""
    here = 10 * (start := np.array([0.1]))
    given = (lambda ratios: 10 * ratios, start, np.array([0.2]), here)
    for measured, reached in ((3.0, 0.3), (1.8, 0.2), (1.3, 0.15), (0.9, 0.1)):
        ratios, _ = _towards(*given, lambda x, to=measured: abs(x[0] - to))
        assert ratios[0] == pytest.approx(reached)


def test_a_load_that_cannot_hold_the_beam_was_not_its_release():
    """What was read gives way to the first mode alone; a load that was given does not."""
    q = SEEN.coordinate(SEEN.readings(BEAM, 0.016, 1.5, STEP))
    decay = rs.Decay(STEP * np.arange(len(q)), q, unit="kg^0.5 m")
    record, on = Record.of(decay, 1e-4), OnBeam(SEEN)
    # Thirty times as far as the first, in a mode that is 16 times as fast: it cannot be bent so.
    rung = bending(BEAM, STEP).ringing(np.array([0.0, 0.5]), np.zeros(2))
    asked = AskedMotion(None, (), record, (0.016, 0.0), BeamRelease(None, rung))
    found = on.moved(asked, decay)
    assert found.release.load is None and found.release.ringing is None
    np.testing.assert_allclose(SEEN.coordinate(found.readings[0])[: len(q)], q, atol=1e-4)
    modes = BEAM.modes(count=3)
    load = BeamRelease(modes.momenta[2] * modes.omega[2] ** 2)
    with pytest.raises(FAILURES):
        on.moved(asked._replace(release=load), decay)


def test_modal_release_needs_no_higher_mode():
    noisy = with_noise(SEEN.readings(BEAM, 0.016, 0.5, STEP), 37, 0)
    ringing = read_release(SEEN, BEAM, (0.016, 0.0), noisy, STEP).ringing
    # 37 dB over 40 samples of 5 sensors: a standard error of about 1e-3.
    assert np.all(np.abs(ringing.displaced / 0.016) < 4e-3)


def test_first_mode_swings_as_far_from_any_load():
    """The coordinate asked for is that of the first mode; what others add dies soon."""
    momentum, rest = BEAM.modes(count=1).momenta[0], BEAM.equilibrium().displacement
    modal, tip = (SEEN.held(BEAM, 0.016, load).displacement - rest for load in (None, TIP))
    assert np.vdot(momentum, tip) == pytest.approx(np.vdot(momentum, modal), rel=1e-9)
    assert SEEN.seen(modal) == pytest.approx(0.016, rel=1e-9)


@pytest.mark.parametrize("seed", [0, *(pytest.param(i, marks=pytest.mark.slow) for i in (1, 2))])
def test_a_release_at_the_tip_is_no_effect(seed):
    """It was "named: nonlinear inertia", with a posterior of 1.00."""
    decays = [pulled(SEEN, BEAM, q, 2 * seed + i, TIP, 1.5) for i, q in enumerate((0.016, 0.013))]
    report = rs.diagnose(BEAM, decays[:1], sensors=SEEN.sensors, held_out=decays[1])
    assert report.verdict == "none" and report.names == ()
    assert report.recipe == "# the beam as it was"
    # 1 is noise alone; the standard error of its rms, and of the noise, is 3 % each.
    assert max(e.after for e in report.sensor_errors) < 1.15


@pytest.mark.study
@pytest.mark.slow
def test_values_that_the_first_mode_leaves_open_are_told_by_the_second():
    """The second frequency is that of the true beam; it was 0.7 % off, with 16 times the noise."""
    truth = BEAM.with_effect(StifferBending(0.015)).with_effect(StifferSpring(-0.02))
    decays = [pulled(SEEN, truth, q, i, TIP, 1.5) for i, q in enumerate((0.016, 0.013))]
    known = {"bending_stiffness": 0.01, "spring_stiffness": 0.02, "pre_tension": 0.02}
    given = {"sensors": SEEN.sensors, "held_out": decays[1], "tolerances": known}
    report = rs.diagnose(BEAM, decays[:1], **given)
    assert report.verdict == "none"
    right, found = (b.modes(count=2).omega[1] for b in (truth, report.model))
    assert found == pytest.approx(right, rel=5e-4)
    assert max(e.after for e in report.sensor_errors) < 1.3


def test_a_release_rings_more_by_a_complex_number():
    """A quarter of a cycle before: what was a displacement d is a rate of -omega d."""
    modes, still = bending(BEAM, STEP), np.zeros(2)
    omega = modes.omega[1]
    release = BeamRelease(None, modes.ringing(still, still))
    for displaced, rates, by, expected in (
        ([1.0, 3.0], still, 2.0 + 1.0j, ([2.0, 3.0], [-omega, 0.0])),
        (still, [omega, 0.0], 1.0j, ([1.0, 0.0], still)),
    ):
        more = BeamRelease(None, modes.ringing(np.array(displaced), np.array(rates)))
        found = rung_by(release, more, np.array([by])).ringing
        np.testing.assert_allclose(found.displaced, expected[0], atol=1e-9)
        np.testing.assert_allclose(found.rates, expected[1], atol=1e-9 * omega)


@pytest.mark.study
@pytest.mark.slow
@pytest.mark.parametrize("given", [False, True], ids=["read", "given"])
def test_a_hidden_mass_is_found_after_a_release_at_the_tip(given):
    truth = BEAM.with_effect(PointMass(4e-4))
    decays = [pulled(SEEN, truth, q, i, TIP) for i, q in enumerate((0.016, 0.013))]
    release = BEAM.release_shape(0.1) if given else None
    given = {"release": release, "max_effects": 1}
    report = rs.diagnose(BEAM, decays[:1], sensors=SEEN.sensors, held_out=decays[1], **given)
    # The record of one mode says how heavy it is for that mode, but hardly where.
    assert ("added_mass",) in report.equivalent and report.verdict in ("named", "ambiguous")
    mass = next(h for h in report.reduced.rivals if h.names == ("added_mass",))
    (effect,) = effects_of(mass.effects)
    heavier = BEAM.with_effect(effect)
    right, found = (b.modes(count=1).omega[0] for b in (truth, heavier))
    nominal = BEAM.modes(count=1).omega[0]
    assert found - nominal == pytest.approx(right - nominal, rel=0.02)


def test_a_release_needs_its_load():
    decay = rs.Decay(STEP * np.arange(500), np.ones((500, 5)) * np.linspace(0, 1, 500)[:, None])
    with pytest.raises(ValueError, match="release is held by no load"):
        rs.diagnose(BEAM, decay, sensors=SEEN.sensors, release=BEAM.equilibrium())


LENGTH = 0.45
SPAN = Beam(
    LENGTH, Section.rectangle(0.025, 0.001, 210e9, 7800.0), 8, right=CLAMPED, alpha=0.37, eta=1e-5
)
SPAN_SEEN = InstrumentedBeam(
    SPAN, SPAN.sensors([Sensor(part * LENGTH) for part in (0.15, 0.3, 0.5, 0.7, 0.85)])
)
MIDDLE = SPAN.point_load((0.0, 1.0), at=LENGTH / 2)


@pytest.mark.study
@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "name"), [(None, ()), (4e-3, ("viscous",))], ids=["nothing", "damper"]
)
def test_a_beam_without_a_free_end_is_diagnosed(hidden, name):
    """Clamped at both ends, and held at mid-span: it was refused for its tip, which cannot move."""
    truth = SPAN
    if hidden is not None:
        truth = SPAN.with_effect(Damper().on_beam(hidden, AtPoint(LENGTH / 2)))
    decays = [
        pulled(SPAN_SEEN, truth, q, i, MIDDLE, duration=2.5, step=2e-3)
        for i, q in enumerate((2e-4, 1.65e-4))
    ]
    own = {"catalogue": (), "max_effects": 1}  # of the beam itself
    report = rs.diagnose(SPAN, decays[:1], sensors=SPAN_SEEN.sensors, held_out=decays[1], **own)
    if not name:
        assert report.verdict == "none"
        return
    assert name in report.equivalent
    values = {h.names: h.effects[0].strengths[0, 0] for h in report.reduced.rivals}
    assert values[name] == pytest.approx(hidden, rel=0.05)
    if report.names == name:
        assert report.effects[0].label.endswith("at 0.225 m")


@pytest.mark.parametrize("beam", [SPAN, replace(BEAM, effects=())], ids=["span", "cantilever"])
def test_what_moves_a_beam_alone_is_its_modulus_over_its_density(beam):
    """M and K grow by one factor each: sag, frequencies and damping are those of their ratio."""
    (stiffness,) = that_do_the_same(beam) - {"density"}
    change = {"modulus": StifferMaterial, "bending_stiffness": StifferBending}[stiffness]
    one, other = beam.with_effect(Denser(1 / 1.03 - 1)), beam.with_effect(change(0.03))
    first, second = (b.modes(count=3) for b in (one, other))
    # An axial stiffness of its own moves a cantilever by a part in a million.
    np.testing.assert_allclose(first.omega, second.omega, rtol=1e-5)
    sag, same = (m.equilibrium.displacement for m in (first, second))
    np.testing.assert_allclose(sag, same, rtol=1e-5, atol=1e-8)
    assert not that_do_the_same(BEAM)  # its spring and mass keep theirs


@pytest.mark.study
@pytest.mark.slow
def test_a_density_is_told_beside_the_modulus_that_does_the_same():
    truth = SPAN.with_effect(Denser(0.03))
    decays = [
        pulled(SPAN_SEEN, truth, q, i, None, duration=2.0, step=2e-3)
        for i, q in enumerate((2e-4, 1.65e-4))
    ]
    report = rs.diagnose(SPAN, decays[:1], sensors=SPAN_SEEN.sensors, held_out=decays[1])
    assert report.verdict == "ambiguous" and report.family.members == ("modulus", "density")
    assert "nothing that vibrates would separate" in report.sentence
