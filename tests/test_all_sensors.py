"""What all sensors say beside the first mode: closed forms, and linear algebra written out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eigvals

import romsindy as rs
from romsindy.beam import Beam, Section
from romsindy.beam.motion import Sensor
from romsindy.diagnosis.all_sensors import Readings, along, followed, with_errors, without
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.found import family_of
from romsindy.diagnosis.on_beam import InstrumentedBeam, beam_rounds
from romsindy.diagnosis.on_beam.all_sensors import (
    Latitude,
    OpenValues,
    SimulatedReadings,
    TriedOnBeam,
    left_of,
    weigh,
)
from romsindy.diagnosis.on_beam.instrumented import ModesAtRest
from romsindy.diagnosis.on_beam.mounted import PlaceOnBeam
from romsindy.diagnosis.on_beam.parameters import damping_effects
from romsindy.diagnosis.on_beam.report import variance_of
from romsindy.diagnosis.on_beam.within_tolerances import slopes
from romsindy.diagnosis.rounds import Rounds, undecided
from romsindy.effects import AtPoint, Damper, Viscous
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record

BEAM = Beam.cantilever(elements=6)
SECTION = Section.rectangle(0.025, 0.001, 210e9, 7800.0)
LENGTH = BEAM.length
ALL = InstrumentedBeam(BEAM, BEAM.sensors([Sensor(x) for x in (0.15, 0.25, 0.32, 0.45)]))
DT, CYCLES = 2e-3, 12
T = np.arange(0.0, CYCLES * 2 * np.pi / ALL.basis.omega[0], DT)
NOISE = 1e-5  # m, of every sensor


def ringing(k, size, off=0.0, rate=0.3):
    """What sensors read of a mode that dies, m, with a frequency that is off by a part."""
    turned = (1j * ALL.basis.omega[k] * (1 + off) - rate) * T
    return np.outer(size * np.exp(turned).real, ALL.shapes[:, k])


def readings(more=0.0):
    """Of the first mode in white noise, and of ``more`` that tells nothing of the noise."""
    noisy = ringing(0, 0.02) + NOISE * np.random.default_rng(5).standard_normal((len(T), 4))
    own = rs.Decay(T, noisy, unit="m")
    q = rs.Decay(T, ALL.coordinate(noisy), unit="kg^0.5 m")
    read = Readings.of(Record.of(q, 1e-9), own, 0.0, 1e-9)
    return replace(read, measured=read.measured + more)


def test_cosines_over_the_noise_are_white_and_leave_out_the_first_mode():
    first, second = ringing(0, 0.02), ringing(1, 1e-4)
    read, shape = readings(), ALL.shapes[:, 0]
    along_first, beside = (np.abs(read.cosines(x, shape)).max() for x in (first, second))
    assert along_first < 1e-6 * beside
    left = read.cosines(read.measured - first, shape)
    # Of four sensors three are left beside a shape; a chi-square of n is n +- sqrt(2 n).
    n = 3 * len(T)
    assert np.sum(left**2) == pytest.approx(n, abs=5 * np.sqrt(2 * n))


def test_errors_count_as_noise_with_their_covariance():
    rng = np.random.default_rng(0)
    table, errors = rng.standard_normal((30, 3)), 4 * rng.standard_normal((30, 5))
    white = with_errors(table, errors)
    covariance = np.eye(30) + errors @ errors.T
    assert_allclose(white.T @ white, table.T @ np.linalg.solve(covariance, table), rtol=1e-10)
    span = np.column_stack([errors, errors[:, 0], np.zeros(30)])  # columns may say nothing new
    best = np.linalg.lstsq(errors, table)[0]
    assert_allclose(without(table, span), table - errors @ best, atol=1e-10)
    assert_allclose(without(table, np.zeros((30, 0))), table)  # sensors may show one mode


def test_other_modes_follow_the_first_as_it_was_measured():
    shapes = np.random.default_rng(1).standard_normal((6, 3))
    own, measured = 0.9 * np.cos(20 * T), np.cos(20.2 * T)
    expected = along(measured, T) @ shapes
    found = followed(along(own, T) @ shapes, own, measured, T)
    assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("off", [4e-4, 4e-3])
def test_a_second_mode_may_be_off_by_what_is_known_of_it(off):
    """Its phase may run away by radians, and is followed; more than is known of it costs."""
    read = readings(ringing(1, 4e-4, off))
    motion = SimulatedReadings(ringing(0, 0.02) + ringing(1, 4e-4), ringing(1, 1e-4))
    known = Latitude.of(ALL, (), (0.0, 0.0), np.zeros(ALL.shapes.shape))
    wide = replace(known, frequencies=np.full_like(known.frequencies, 1e-2))
    wrong, right = (
        float(np.sum(left_of(ALL, [read], [motion], slack).left ** 2)) for slack in (known, wide)
    )
    n = 3 * len(T)
    assert right == pytest.approx(n, abs=6 * np.sqrt(2 * n))
    # The prior counts (off / sigma)^2.
    least = (off / known.frequencies[0]) ** 2 - (off / 1e-2) ** 2
    assert wrong - right == pytest.approx(least, rel=0.1)


def test_steps_in_time_leave_of_every_mode_what_is_not_known_of_it():
    """Those of the trapezoidal rule, by which a mode is 2 / h arctan(omega h / 2)."""
    seen = InstrumentedBeam(BEAM, BEAM.sensors([Sensor(x) for x in np.linspace(0.1, 0.4, 6)]))
    known = Latitude.of(seen, (), (0.0, 0.0), np.zeros(seen.shapes.shape)).frequencies
    omega = seen.basis.omega[1 : len(known) + 1]
    half = np.sqrt(3 * known[0]) / omega[0]  # a series: (omega h)^2 / 12 of the second
    slower = 1 - np.arctan(omega * half) / (omega * half)
    assert len(known) > 1
    assert_allclose(known, slower, rtol=0.03)  # the next term of the series


def test_a_value_that_is_open_moves_by_what_the_second_mode_says():
    """Where a unit moves it by 1 %, half of that is half a unit.

    How much more of the mode the release had is found beside that.
    """
    more = 0.4 - 0.3j
    size, off = 4e-4, 5e-3
    measured = (1 + 0.25 * more) * np.exp((1j * ALL.basis.omega[1] * (1 + off) - 0.3) * T)
    read = readings(np.outer(size * measured.real, ALL.shapes[:, 1]))
    motion = SimulatedReadings(ringing(0, 0.02) + ringing(1, size), ringing(1, 0.25 * size))
    slack = Latitude.of(ALL, (), (0.0, 0.0), np.zeros(ALL.shapes.shape))
    values = OpenValues(np.array([[1e-2], [0.0]]), np.eye(1), np.array([0.1]))
    found = left_of(ALL, [read], [motion], slack, values)
    # It is at 0.1 of its standard deviations; to 5e-4 the frequency may be off by itself.
    assert found.step == pytest.approx([0.5], abs=0.01)
    assert found.turns == pytest.approx(1e-2 * found.step[0] * ALL.basis.omega[1] * T[-1], rel=0.01)
    assert found.more[0] == pytest.approx([more], abs=0.02)
    # Where the first mode holds it at 0.1 of a unit beyond, to 1e-2 of one, it goes back.
    held = left_of(ALL, [read], [motion], slack, values._replace(known=100 * np.eye(1)))
    assert held.step == pytest.approx([-0.1], abs=0.03)


def test_a_sensor_off_its_place_reads_every_mode_otherwise():
    """Each by the slope of its shape: as the gain of the sensor they would be alike."""
    off = np.array([2e-3, -2e-3, 2e-3, 0.0])
    slope = slopes(ALL)
    moved = ALL.shapes + off[:, None] * slope
    placed = [replace(s, at=s.at + x) for s, x in zip(ALL.sensors.sensors, off, strict=True)]
    exact = BEAM.sensors(placed).mode_shapes(ALL.basis, ALL.shapes.shape[1])
    assert_allclose(moved, exact, atol=2e-3 * np.abs(exact).max())
    parts = [ringing(k, size) @ np.linalg.pinv(ALL.shapes).T for k, size in enumerate((0.02, 2e-3))]
    read = readings(sum(parts) @ exact.T - ringing(0, 0.02))
    motion = SimulatedReadings(ringing(0, 0.02) + ringing(1, 2e-3), ringing(1, 5e-4))
    alike = np.abs(slope[:, :1] / ALL.shapes[:, :1]) * ALL.shapes  # as of a gain
    right, wrong = (
        np.sum(left_of(ALL, [read], [motion], Latitude.of(ALL, (), (0.0, 0.0), p)).left ** 2)
        for p in (2e-3 * slope, 2e-3 * alike)
    )
    n = 3 * len(T)
    assert right == pytest.approx(n, abs=6 * np.sqrt(2 * n)) and wrong > 1.5 * n


def test_sensors_that_show_one_mode_are_heard():
    few = InstrumentedBeam(BEAM, BEAM.sensors([Sensor(x) for x in (0.2, 0.32, 0.45)]))
    assert few.shapes.shape == (3, 1)
    first = np.outer(0.02 * np.exp((1j * few.basis.omega[0] - 0.3) * T).real, few.shapes[:, 0])
    noisy = first + NOISE * np.random.default_rng(2).standard_normal(first.shape)
    q = rs.Decay(T, few.coordinate(noisy), unit="kg^0.5 m")
    read = Readings.of(Record.of(q, 1e-9), rs.Decay(T, noisy, unit="m"), 0.0, 1e-9)
    slack = Latitude.of(few, (), (0.0, 0.0), np.zeros(few.shapes.shape))
    left = left_of(few, [read], [SimulatedReadings(first, np.zeros_like(first))], slack).left
    n = 2 * len(T)
    assert np.sum(left**2) == pytest.approx(n, abs=6 * np.sqrt(2 * n))


def test_a_place_has_the_interval_of_its_likelihood():
    """chi^2 = ((a - a0) / s)^2: three standard errors, and the evidence of a Gaussian."""
    spread, at, points = 0.01, 0.31, np.linspace(0.25, 1.0, 7) * LENGTH
    left = np.stack([(points - at) / spread, np.zeros(7)])
    one, other = (TriedOnBeam(frozenset({n}), points, left, np.zeros((7, 0))) for n in ("a", "b"))
    none = TriedOnBeam(frozenset(), None, np.array([[7.0]]), np.zeros((1, 0)))
    same = TriedOnBeam(frozenset({"c"}), points, np.zeros((2, 7)), np.zeros((7, 0)))
    found, _, nothing, alike = weigh([one, other, none, same], [readings()], ALL)
    assert found.place.at == pytest.approx(at, abs=1e-3)
    assert_allclose([found.place.low, found.place.high], [at - 0.03, at + 0.03], atol=1e-3)
    # Half of the belief is at the tip, half is spread along the beam.
    expected = -2 * np.log(np.sqrt(2 * np.pi) * spread / LENGTH / 2)
    assert found.misfit == pytest.approx(expected, abs=0.01)
    assert alike.misfit == pytest.approx(-2 * np.log((1 + 0.75) / 2), abs=1e-6)
    assert nothing.misfit == 49.0


def test_a_place_is_looked_at_again_about_where_it_was():
    points = (np.linspace(0.25, 1.0, 7) * LENGTH).tolist()
    told, anywhere = PlaceOnBeam(0.3, 0.29, 0.31, LENGTH), PlaceOnBeam(0.3, 0.1, 0.45, LENGTH)
    apart = points[1] - points[0]
    assert_allclose(told.about(points), [0.3 - apart, 0.3, 0.3 + apart])
    assert anywhere.about(points) == points
    end = PlaceOnBeam(points[-1], points[-1] - 0.01, points[-1], LENGTH)
    assert_allclose(end.about(points), points[-2:])
    # Its interval is not cut off, wherever in it the likeliest point is.
    wide = replace(told, at=0.41, low=0.31, high=0.44)
    assert_allclose(wide.about(points), [*(0.41 - apart * np.arange(2, -1, -1)), points[-1]])
    assert not wide.cut_off(wide.about(points), points)
    low, high = replace(told, low=0.2), replace(told, high=0.4)
    assert all(p.cut_off([0.24, 0.3, 0.36], points) for p in (low, high))
    assert not told.cut_off([0.24, 0.3, 0.36], points) and not anywhere.cut_off(points, points)
    assert_allclose(told.between(np.array(points)), [0.3 - apart / 4, 0.3 + apart / 4])
    assert anywhere.between(np.array(points)) == []


def test_modes_die_as_the_linear_beam_says():
    """Half of what a damper takes of a mode; the same by the eigenvalues of the whole beam."""
    c, at, count = 0.05, 0.27, 2
    beam = Beam(LENGTH, SECTION, 6, gravity=(0.0, 0.0), alpha=0.3, eta=1e-5)
    still = beam.modes(count=8)
    own = ModesAtRest.of(beam, count).rates
    assert_allclose(own, (beam.alpha + beam.eta * still.omega[:count] ** 2) / 2, rtol=1e-4)
    damped = beam.with_effect(Damper().on_beam(c, AtPoint(at)))
    more = ModesAtRest.of(damped, count).rates
    load = beam.point_load((0.0, 1.0), at=at)
    moved = np.array([np.vdot(load, shape) for shape in still.shapes])
    assert_allclose(more - own, c * moved[:count] ** 2 / 2, rtol=1e-3)
    rates = np.diag(beam.alpha + beam.eta * still.omega**2) + c * np.outer(moved, moved)
    block = np.block([[np.zeros((8, 8)), np.eye(8)], [-np.diag(still.omega**2), -rates]])
    found = np.sort(-eigvals(block).real)
    # Damping of a few per cent couples the modes in second order alone.
    assert_allclose(more, np.sort(found)[::2][:count], rtol=0.02)


def test_a_mode_tells_its_rate_as_least_squares_do():
    """The closed form of amplitude and rate, as sums, beside the covariance of a fit of four."""
    omega, rate, ratio, duration, dt = 40.0, 0.8, 25.0, 3.0, 2e-3
    t = np.arange(0.0, duration, dt)
    wave = ratio * np.exp((1j * omega - rate) * t)
    columns = np.stack([wave.real, wave.imag, -t * wave.real, -t * wave.imag], axis=1)
    covariance = np.linalg.inv(columns.T @ columns)
    assert variance_of(ratio, rate, duration, dt) == pytest.approx(covariance[2, 2], rel=0.02)
    assert variance_of(ratio, rate, duration, dt) == pytest.approx(covariance[3, 3], rel=0.02)


def test_damping_is_no_less_than_none():
    beam = Beam.cantilever(elements=6, alpha=0.3)
    seen = InstrumentedBeam(beam, beam.sensors([Sensor(LENGTH)]))
    effects = {e.name: e for e in damping_effects(seen.curve(0.02))}
    low, high = Part(effects["mass_damping"], (), np.array([[0.0]])).limits()
    assert low[0] == -0.3 and high[0] > 1e6


def test_other_modes_speak_for_what_they_were_asked():
    """What was not asked is as likely as the likeliest of its parts, or as none."""
    t = np.arange(0.0, 4.0, 0.01)
    decay = rs.add_noise(rs.Decay(t, 0.1 * np.exp(-0.1 * t) * np.cos(20 * t), unit="m"), 40, 0)
    records = [Record.of(decay, 1e-4)]
    model = rs.ReducedModel.from_coefficients({"omega^2": 400.0, "c_linear": 0.1})
    part = Part(Viscous(), (), np.array([[0.1]]))
    plain = Hypothesis.of(model, fit(model, [part], records), 0, records)
    said = {frozenset({"viscous"}): 40.0, frozenset({"drag"}): 7.0, frozenset(): 300.0}
    assert replace(plain, elsewhere=said).score == plain.score + 40.0
    del said[frozenset({"viscous"})]
    assert replace(plain, elsewhere=said).score == plain.score + 300.0
    assert replace(plain, elsewhere={frozenset({"drag"}): 7.0}).score == plain.score


def test_explanations_that_take_turns_are_told_together():
    """Each from a structure that was simulated with the other: none is named."""

    @dataclass(frozen=True)
    class Said:
        verdict: str
        best: SimpleNamespace
        rivals: tuple = ()

    def of(name):
        effect = SimpleNamespace(effect=SimpleNamespace(name=name))
        return SimpleNamespace(names=(name,), effects=(effect,))

    density, clamp = of("density"), of("clamp_compliance")
    doubtful = {frozenset(h.names): h for h in (density, clamp)}
    found = undecided(Said("named", clamp, (clamp,)), doubtful)
    assert found.verdict == "ambiguous" and found.rivals == (clamp, density)
    for said, doubts in ((Said("unknown", clamp), doubtful), (Said("named", clamp), {})):
        assert undecided(said, doubts) is said
    assert family_of([density.names, clamp.names]) == "linear frequency"
    assert family_of([density.names, ("viscous",)]) is None


@pytest.mark.parametrize(
    ("simulated", "along", "least"), [(1.0, 2.0, 1.0), (2.0, 1.0, 1.0), (None, 3.0, 3.0)]
)
def test_values_alone_leave_what_is_less(simulated, along, least):
    """As any explanation, or along the measured first mode: neither way is held against them."""
    both = (x if x is None else SimpleNamespace(rms=x) for x in (simulated, along))
    rounds = SimpleNamespace(_tried=lambda *_: next(both), _along=lambda *_: next(both))
    assert beam_rounds.BeamRounds._alone(rounds, None, [], None).rms == least


def test_what_a_structure_cannot_have_is_not_named_on_it_alone():
    """It could not be refuted; a fault of the measurement needs no structure."""

    @dataclass(frozen=True)
    class Said:
        verdict: str
        best: SimpleNamespace
        compared: tuple
        rivals: tuple = ()

    def of(name, structural=True):
        effect = SimpleNamespace(effect=SimpleNamespace(name=name, structural=structural))
        return SimpleNamespace(names=(name,), effects=(effect,))

    tuned, hum, magnet = of("tuned_mass"), of("mains_hum", structural=False), of("magnet")
    beam = SimpleNamespace(
        with_effects=lambda parts: [p for p in parts if p.effect.name == "magnet"]
    )

    def asked(said, looked):
        rounds = SimpleNamespace(structure=beam, looked=looked)
        rounds.can_have = partial(Rounds.can_have, rounds)
        return Rounds._checked(rounds, said)

    both = Said("named", tuned, (tuned, hum, magnet), (tuned,))
    alone = replace(both, compared=(tuned, hum))
    for reports in ([both], [both, alone]):
        found = asked(reports[-1], reports)
        assert found.verdict == "ambiguous" and found.rivals == (tuned, magnet)
    for best, compared in ((hum, (hum, magnet)), (magnet, (magnet,)), (tuned, (tuned, hum))):
        said = Said("named", best, compared)
        assert asked(said, [said]) is said
