"""Effects hidden in a finite-element beam and in its sensors are named and put back."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.interpolate import CubicSpline
from scipy.linalg import null_space

import romsindy as rs
from romsindy.beam import CLAMPED, Beam, NoEquilibriumError, Section, Support, load_beam
from romsindy.beam.changes import ClampCompliance, HeavierMasses, Longer, StifferBending
from romsindy.beam.motion import Sensor
from romsindy.beam.structure import Spring, springs_of
from romsindy.commands.main import main
from romsindy.diagnosis import rounds
from romsindy.diagnosis.on_beam import InstrumentedBeam
from romsindy.diagnosis.on_beam.all_sensors import _places_explain, find_fault
from romsindy.diagnosis.on_beam.instrumented import checked_readings
from romsindy.diagnosis.on_beam.mounted import mounted_effects
from romsindy.diagnosis.on_beam.parameters import (
    damping_effects,
    parameter_effects,
    standard_deviations,
)
from romsindy.diagnosis.on_beam.report import recipe_of
from romsindy.diagnosis.on_beam.within_tolerances import position_gains
from romsindy.effects import CATALOGUE, AirDrag, AtPoint, CubicStiffness, Damper, PointMass
from romsindy.effects.base import Scales, State
from romsindy.effects.mounting import Load, TowardsAnchor
from romsindy.record.signals import with_noise

PLACES = (0.12, 0.2, 0.28, 0.36, 0.45)
STEP, DURATION = 4e-3, 5.0
SHORT = 3.0  # where few cycles tell


def seen(beam):
    return InstrumentedBeam(beam, beam.sensors([Sensor(x) for x in PLACES]))


BEAM = Beam.cantilever(elements=8)
SEEN = seen(BEAM)
# Where the name is not at issue: one effect of the beam itself.
PLAIN = {"sensors": SEEN.sensors, "catalogue": (), "max_effects": 1}


def decay(beam, q, seed, duration=DURATION):
    readings = seen(beam).readings(beam, q, duration, STEP)
    return rs.Decay(STEP * np.arange(len(readings)), with_noise(readings, 40, seed), unit="m")


@pytest.fixture(scope="module")
def heavier():
    beam = BEAM.with_effect(PointMass(4e-4))
    return [decay(beam, q, i) for i, q in enumerate((0.016, 0.011, 0.013))]


@pytest.fixture(scope="module")
def own():
    return SEEN.readings(BEAM, 0.016, DURATION, STEP)


def test_release_shows_the_coordinate_asked_for(own):
    assert SEEN.coordinate(own[0]) == pytest.approx(0.016, rel=1e-6)


@pytest.fixture(scope="module")
def report(heavier):
    return rs.diagnose(BEAM, heavier[:2], sensors=SEEN.sensors, held_out=heavier[2])


@pytest.mark.study
@pytest.mark.slow
def test_hidden_mass_is_named_weighed_and_put_back(report):
    assert report.verdict == "named" and report.names == ("added_mass",)
    (mass,) = report.effects
    error = mass.standard_errors["strength"]
    assert mass.units == {"strength": "kg"} and error < 4e-6
    assert abs(mass.values["strength"] - 4e-4) < 4 * error
    on_beam = report.model.effects[-1]
    assert on_beam.mass == pytest.approx(mass.values["strength"], abs=2 * error)
    assert report.gap.before > 20 and report.gap.after < 1.1
    assert min(e.before for e in report.sensor_errors) > 10
    # 1 is noise alone; the standard error of its rms, and of the noise, is 2 % each.
    assert max(e.after for e in report.sensor_errors) < 1.1
    assert (
        "Missing: more mass between" in report.sentence
        and "at the tip it would be" in report.sentence
    )


@pytest.mark.study
@pytest.mark.slow
def test_report_is_written(report, tmp_path):
    report.to_html(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert ">Sensors<" in page and "beam.with_effect(PointMass(" in page
    assert json.loads(report.to_json())["sensors"][0]["label"] == "y(0.12)"
    report.to_csv(tmp_path / "table.csv")
    assert "added_mass" in (tmp_path / "table.csv").read_text()


@pytest.mark.study
@pytest.mark.slow
def test_improved_beam_keeps_a_faulty_sensor_out(heavier):
    """A fault of a sensor and an effect at once: both are named, and the effect is right."""
    spoilt = [rs.Decay(d.t, d.q * [1, 1.06, 1, 1, 1], unit="m") for d in heavier]
    report = rs.diagnose(BEAM, spoilt[:1], held_out=spoilt[2], **PLAIN)
    assert report.names == ("sensor_gain", "added_mass")
    assert report.model.effects[-1].mass == pytest.approx(4e-4, rel=0.01)
    assert [e.label for e in report.sensor_errors] == ["y(0.12)", "y(0.28)", "y(0.36)", "y(0.45)"]


@pytest.mark.slow
def test_what_a_beam_leaves_on_its_reference_does_not_matter():
    """A beam 1 % too soft misses its own reference by as much: that was refused."""
    truth = BEAM.with_effect(StifferBending(0.01))
    measured, reference = decay(truth, 0.011, 0, 4.0), decay(truth, 0.016, 1, 4.0)
    report = rs.diagnose(BEAM, measured, sensors=SEEN.sensors, reference=reference)
    assert report.verdict == "none" and report.names == ()
    assert report.reduced.tolerance.source == "reference"
    frequencies = [b.modes(count=1).omega[0] for b in (BEAM, truth)]
    shift = abs(frequencies[0] / frequencies[1] - 1)
    # Of the largest part: bending has another share of the stiffness there than at rest.
    assert 0.9 * shift < report.reduced.tolerance.frequency < 1.5 * shift


class MiddleDamper(Damper):
    """An effect of one's own: a damper at mid-span."""

    name, label = "middle_damper", "a second damper"
    mounting = AtPoint(0.225)


@pytest.mark.study
@pytest.mark.slow
def test_a_force_of_ones_own_is_found():
    """At mid-span a damper acts along another curve than at the tip, which drops faster."""
    truth = BEAM.with_effect(Damper().on_beam(0.02, AtPoint(0.225)))
    decays = [decay(truth, q, i, SHORT) for i, q in enumerate((0.016, 0.013))]
    own = PLAIN | {"catalogue": [MiddleDamper()]}
    report = rs.diagnose(BEAM, decays[:1], held_out=decays[1], **own)
    assert ("middle_damper",) in report.equivalent
    best = {h.names: h.effects[0].strengths[0, 0] for h in report.reduced.rivals}
    assert best[("middle_damper",)] == pytest.approx(0.02, rel=0.02)
    if report.names not in (("middle_damper",), ("viscous",)):
        return  # the first of those that are alike is no damper
    (effect,) = report.effects
    assert effect.units == {"strength": "N s/m"}
    assert effect.label.endswith(("at 0.225 m", "at the tip"))


def test_forces_do_the_work_of_the_beam():
    """Mass damping of unit strength takes the power 2 T, and the mode has unit mass."""
    curve = SEEN.curve(0.016)
    at = np.arange(3, len(curve.q) - 3, 19)
    steps = (curve.shapes[at + 1] - curve.shapes[at - 1]) / (curve.q[2] - curve.q[0])
    power = [2 * BEAM.assembly.kinetic(v) for v in steps]
    zero = np.zeros(len(at))
    rate = 0.3
    state = State(zero, curve.q[at], zero + rate, zero, 1e-3)
    mass_damping = damping_effects(curve)[0]
    force = mass_damping.forces(state)[0]
    # Differences over 1/60 of the reach; the spline of 42 shapes.
    np.testing.assert_allclose(force, rate * np.array(power), rtol=1e-4)
    middle = State(zero, zero, zero + 1.0, zero, 1e-3)
    unit = mass_damping.forces(middle)[0]
    np.testing.assert_allclose(unit, 1.0, rtol=1e-4)


CURVE = SEEN.curve(0.016)
FORCES = [
    f.shaped(
        {p.name: p.starts[len(p.starts) // 2] for p in f.parameters(Scales(0.016, 38.0, 20.0))}
    )
    for f in (*mounted_effects(CURVE), *damping_effects(CURVE))
]


def test_recipes_run():
    """What a diagnosis adds to a beam is added again where its recipe is pasted."""
    changes = [StifferBending(0.01), ClampCompliance(1e-3), PointMass(4e-4)]
    for added in (*(force.on_beam(0.01) for force in FORCES), *changes):
        names = {"beam": BEAM}
        exec(recipe_of([added]), names)
        assert names["beam"] == BEAM.with_effect(added) != BEAM


@pytest.mark.parametrize("force", FORCES, ids=lambda f: f"{f.name} {f.variant}")
def test_a_force_on_the_beam_is_projected_on_its_curve(force):
    """The work of the load itself on the shapes x(q) with velocity x'(q) q_dot, node by node.

    Less that of what holds the beam at rest, where sensors are zero: the pull of a magnet.
    """
    at = np.arange(5, len(CURVE.q) - 5, 11)
    loaded, own = BEAM.with_effect(force.on_beam(1.0)).assembly, BEAM.assembly

    def working(i, rate):
        x, v = CURVE.shapes[i], CURVE.tangents[i]
        return np.vdot(v, loaded.residual(x, rate * v)[0] - own.residual(x, rate * v)[0])

    rate, rest = 0.3, int(np.argmin(np.abs(CURVE.q)))
    work = np.array([working(i, rate) for i in at]) - working(rest, 0.0)
    zero = np.zeros(len(at))
    said = force.forces(State(zero, CURVE.q[at], zero + rate, zero, 0.0))[0]
    # Friction creeps below 1 mm/s; Simpson's rule on 8 elements integrates drag to 1e-3.
    np.testing.assert_allclose(said, work, atol=2e-3 * np.abs(work).max() + 1e-12)


@pytest.mark.parametrize("force", FORCES, ids=lambda f: f"{f.name} {f.variant}")
def test_slopes_are_those_of_the_force(force):
    """Central differences; 1e-5 of the reach keeps their error below 1e-6 of the largest slope."""
    q, q_dot = np.array([-0.0113, -0.004, 0.0052, 0.0121]), np.array([0.2, -0.3, 0.1, -0.25])

    def at(q, q_dot):
        return force.forces(State(0 * q, q, q_dot, 0 * q + 3.0, 1e-3))[0]

    h = 1.6e-7
    by_q, by_q_dot, _ = force.slopes(State(0 * q, q, q_dot, 0 * q + 3.0, 1e-3), np.array([1.0]))
    top = np.abs(by_q).max() + np.abs(by_q_dot).max() + 1e-300
    for slope, (dq, dv) in ((by_q, (h, 0.0)), (by_q_dot, (0.0, h))):
        change = (at(q + dq, q_dot + dv) - at(q - dq, q_dot - dv)) / (2 * h)
        np.testing.assert_allclose(np.broadcast_to(slope, q.shape), change, atol=1e-5 * top)


def test_directions_follow_the_beam():
    """Second-order convergence of omega^2: the direction is the derivative."""
    directions = {p.name: p for p in parameter_effects(SEEN, 0.016)}
    slope = directions["bending_stiffness"].linear_shift(SEEN.basis.omega[0] ** 2)

    def omega2(change):
        return BEAM.with_effect(StifferBending(change)).modes(count=3).omega[0] ** 2

    assert slope == pytest.approx((omega2(0.01) - omega2(-0.01)) / 0.02, rel=0.02)
    softer = BEAM.with_effect(ClampCompliance(1e-3)).modes(count=3).omega[0]
    assert softer < SEEN.basis.omega[0]
    assert set(directions) >= {"spring_stiffness", "pre_tension", "clamp_compliance"}


@pytest.mark.parametrize(
    ("kind", "spoil", "value"),
    [
        ("gain", lambda y: 1.05 * y, 0.05),
        ("offset", lambda y: y + 0.002, 0.002),
        ("saturation", lambda y: np.clip(y, -0.04, 0.04), 0.04),
    ],
)
def test_faulty_sensor_is_told_from_the_others(own, kind, spoil, value):
    readings = with_noise(own, 35, 0)
    assert find_fault(readings, own, SEEN.shapes, SEEN.sensors.labels) is None
    readings[:, 2] = spoil(readings[:, 2])
    fault = find_fault(readings, own, SEEN.shapes, SEEN.sensors.labels)
    assert (fault.channel, fault.kind) == (2, kind)
    assert fault.value == pytest.approx(value, rel=0.1)


def test_a_sensor_off_its_place_within_the_tolerance_is_no_fault(own):
    """It was left out as faulty: a place that is off by a little is an error of the gain."""
    readings = with_noise(own, 40, 0)
    off = np.array([0.0015, -0.001, 0.0, 0.001, -0.0015])[: readings.shape[1]]
    gains = position_gains(SEEN, 0.001)
    readings = readings * (1 + off / 0.001 * gains)
    given = (own, SEEN.shapes, SEEN.sensors.labels)
    assert find_fault(readings, *given) is not None
    assert find_fault(readings, *given, gains) is None
    # 10 % are more than ten standard deviations; an offset is no error of the gain.
    for kind, spoil in (("gain", lambda y: 1.1 * y), ("offset", lambda y: y + 0.004)):
        spoilt = readings.copy()
        spoilt[:, 2] = spoil(spoilt[:, 2])
        fault = find_fault(spoilt, *given, gains)
        assert (fault.channel, fault.kind) == (2, kind)


def test_sensors_off_their_places_are_blamed_in_1_of_400():
    """Three standard errors, as what is named. Of 20,000 draws 54 are expected, +- 15: 2 sigma."""
    rng, q = np.random.default_rng(0), np.array([1.0, -2.0, 0.5])
    gains = position_gains(SEEN, 0.001)
    drives = null_space(SEEN.shapes.T).T * SEEN.shapes[:, 0]
    follow = rng.standard_normal((20_000, len(gains))) * gains @ drives.T
    blamed = [not _places_explain(np.outer(q, x), q, drives, gains) for x in follow]
    assert sum(blamed) == pytest.approx(54, abs=15)


def test_few_clipped_swings_are_seen(own):
    """The first three swings to either side, 8 % below the top: too little for the parity test."""
    readings = with_noise(own, 30, 0)
    limit = 0.92 * np.abs(readings[:, 3]).max()
    readings[:, 3] = np.clip(readings[:, 3], -limit, limit)
    fault = find_fault(readings, own, SEEN.shapes, SEEN.sensors.labels)
    assert (fault.channel, fault.kind) == (3, "saturation")
    assert fault.value == pytest.approx(limit)
    # Rounded to 12 bits, a decay that is let go from rest does not clip.
    step = np.abs(own).max() / 2048
    rounded = step * np.round(own / step)
    assert find_fault(rounded, own, SEEN.shapes, SEEN.sensors.labels) is None


@pytest.mark.parametrize("seed", range(3))
def test_swings_that_are_cut_under_noise_are_seen(own, seed):
    """Noise on top hides that the largest values are alike: these were taken for "none"."""
    limit = 0.88 * np.abs(own[:, 1]).max()
    cut = own.copy()
    cut[:, 1] = np.clip(cut[:, 1], -limit, limit)
    fault = find_fault(with_noise(cut, 33, seed), own, SEEN.shapes, SEEN.sensors.labels)
    assert (fault.channel, fault.kind) == (1, "saturation")
    # What it would have read is estimated with what it did: some of the cut is lost.
    assert fault.value == pytest.approx(limit, rel=0.04)
    noisy = with_noise(own, 33, seed)
    assert find_fault(noisy, own, SEEN.shapes, SEEN.sensors.labels) is None


def test_physics_is_no_fault_of_a_sensor(own):
    for effect in (AirDrag().on_beam(0.03), PointMass(1e-3), ClampCompliance(0.01)):
        beam = BEAM.with_effect(effect)
        readings = with_noise(seen(beam).readings(beam, 0.016, 3.0, STEP), 35, 0)
        assert find_fault(readings, own, SEEN.shapes, SEEN.sensors.labels) is None


def test_channels_must_be_those_of_the_sensors(heavier):
    with pytest.raises(ValueError, match="5 channels, but there are 2 sensors"):
        rs.diagnose(BEAM, heavier[:1], sensors=BEAM.sensors([Sensor(0.2), Sensor(0.4)]))
    with pytest.raises(ValueError, match="measured is empty"):
        rs.diagnose(BEAM, [], sensors=SEEN.sensors)
    with pytest.raises(ValueError, match="of a beam"):
        rs.diagnose(BEAM, heavier[:1], sensors=SEEN.sensors, free=["gamma_3"])
    with pytest.raises(TypeError, match="model is a dict"):
        rs.diagnose({}, heavier[:1])


def test_one_sensor_is_one_channel():
    """A decay of shape (n,) belongs to one sensor; numbers agree with their nouns."""
    one = BEAM.sensors([Sensor(0.45)])
    t = np.linspace(0, 5, 1251)
    single = rs.Decay(t, 0.1 * np.exp(-0.2 * t) * np.cos(38.5 * t), unit="m")
    flat, column = (
        checked_readings(rs.Decay(t, q, unit="m"), 0, one, 0.45).q
        for q in (single.q, single.q[:, None])
    )
    assert flat.shape == (1251, 1) and np.array_equal(flat, column)
    two = rs.Decay(t, np.stack([single.q, single.q], axis=1))
    with pytest.raises(ValueError, match="has 2 channels, but there is 1 sensor:"):
        rs.diagnose(BEAM, two, sensors=one)
    with pytest.raises(ValueError, match="has 1 channel, but there are 5 sensors"):
        rs.diagnose(BEAM, single, sensors=SEEN.sensors)


def test_other_units_are_noticed(heavier):
    """In mm the beam would have to move farther than it is long; the remedy works."""
    first = heavier[0]
    in_mm = rs.Decay(first.t, 1e3 * first.q, unit="mm")
    with pytest.raises(ValueError, match="decay 0 is in mm, the beam in m") as error:
        rs.diagnose(BEAM, in_mm, sensors=SEEN.sensors)
    assert "Decay(t, 0.001 * q, unit='m')" in str(error.value)
    unknown = rs.Decay(first.t, 1e3 * first.q)
    with pytest.raises(ValueError, match=r"the beam is 0\.45 m long: if it is in mm"):
        rs.diagnose(BEAM, unknown, sensors=SEEN.sensors)
    modal = rs.Decay(first.t, first.q, unit="kg^0.5 m")
    with pytest.raises(ValueError, match="give the displacements of the sensors"):
        rs.diagnose(BEAM, modal, sensors=SEEN.sensors)
    mended = rs.Decay(in_mm.t, 0.001 * in_mm.q, unit="m")
    np.testing.assert_allclose(
        checked_readings(mended, 0, SEEN.sensors, BEAM.length).q, first.q, rtol=1e-12
    )


@pytest.mark.study
@pytest.mark.slow
def test_recipe_and_model_are_those_of_the_verdict(heavier):
    """A drift in time is no property of a beam: it is said, and nothing else is put in its place.

    The clock of the measurement runs away by 0.4 % a minute, so that all frequencies drift.
    """
    own = [SEEN.readings(BEAM, q, 1.05 * SHORT, STEP) for q in (0.016, 0.013)]
    t = STEP * np.arange(int(SHORT / STEP))
    decays = []
    for i, y in enumerate(own):
        warped = CubicSpline(STEP * np.arange(len(y)), y)(t * (1 + 2e-3 * t))
        decays.append(rs.Decay(t, with_noise(warped, 40, i), unit="m"))
    drifts = PLAIN | {"catalogue": [e for e in CATALOGUE if e.name == "drift"]}
    report = rs.diagnose(BEAM, decays[:1], held_out=decays[1], **drifts)
    there = {p.effect.name for p in report.parts}
    named = {e.name for e in report.effects}
    assert there <= named and "drift" in named
    assert len(report.not_there) == len(named - there)
    assert "not on the beam" in report.recipe and "Not on the improved beam" in report.sentence
    assert len(report.model.effects) == len(BEAM.effects) + len(there)


@pytest.mark.slow
def test_a_parameter_within_its_tolerance_is_no_effect():
    """1 % of bending stiffness, of which the standard deviation is 1 %: it follows the data."""
    truth = BEAM.with_effect(StifferBending(0.01))
    decays = [decay(truth, q, i) for i, q in enumerate((0.016, 0.013))]
    report = rs.diagnose(
        BEAM,
        decays[:1],
        sensors=SEEN.sensors,
        held_out=decays[1],
        tolerances={"bending_stiffness": 0.01, "point_masses": 1e-4},
    )
    assert report.verdict == "none"
    assert report.model.section.EI == pytest.approx(1.01 * BEAM.section.EI, rel=1e-3)
    assert report.gap.before > 10 and report.gap.after < 1.1
    # The noise of four sensors is known to a few per cent, and some values were fitted.
    assert 0.8 < report.with_modes < 1.1
    assert "With higher modes" not in report.sentence  # they fit as they are
    worst, *others = report.sensor_errors
    off = replace(report, sensor_errors=(replace(worst, after=5.0), *others))
    assert f"damping it is {report.with_modes:.2g} times the noise" in off.sentence
    assert "With higher modes" not in replace(off, with_modes=2.0).sentence


@pytest.mark.study
@pytest.mark.slow
def test_a_damper_comes_before_damping_that_would_be_far_beyond_its_tolerance():
    """Damping of the mass, known to 10 %, would have to be half as large again."""
    truth = BEAM.with_effect(Damper().on_beam(0.0042))
    decays = [decay(truth, q, i) for i, q in enumerate((0.016, 0.013))]
    report = rs.diagnose(
        BEAM,
        decays[:1],
        sensors=SEEN.sensors,
        held_out=decays[1],
        tolerances={"bending_stiffness": 0.01, "mass_damping": 0.1},
    )
    assert report.names == ("viscous",)
    (damper,) = report.effects
    error = damper.standard_errors["strength"]  # with that of its place
    assert abs(damper.values["strength"] - 0.0042) < 3 * error < 0.003
    assert "mass damping" not in report.sentence


@pytest.mark.parametrize(
    ("tolerances", "message"),
    [
        ({"youngs_modulus": 0.1}, "this beam has .*bending_stiffness.*spring_stiffness"),
        ({"bending_stiffness": 0.0}, "must be positive"),
        ({"material_damping": 0.1}, "which is 0 in this beam"),
    ],
)
def test_tolerances_are_of_parameters_of_the_beam(heavier, tolerances, message):
    beam = replace(BEAM, eta=0.0)
    with pytest.raises(ValueError, match=message):
        rs.diagnose(beam, heavier[:1], sensors=SEEN.sensors, tolerances=tolerances)


def test_tolerances_become_standard_deviations():
    """The pull of the default spring is 1.51 N by construction."""
    names = ("pre_tension", "mass_damping", "point_masses")
    found = standard_deviations(BEAM, dict.fromkeys(names, 0.1))
    assert found["pre_tension"] == pytest.approx(0.151, rel=1e-9)
    assert found["mass_damping"] == pytest.approx(0.037) and found["point_masses"] == 0.1
    heavy = BEAM.with_effect(HeavierMasses(0.5))
    assert [e.mass for e in heavy.effects if isinstance(e, PointMass)] == [pytest.approx(0.0012)]


@pytest.mark.slow
def test_a_beam_that_cannot_be_simulated_ends_in_unknown(heavier, monkeypatch):
    def fails(*arguments, **options):
        raise NoEquilibriumError("no equilibrium found")

    measured = heavier[0].between(end=SHORT)
    with monkeypatch.context() as patch:
        patch.setattr(rounds, "corrected", fails)
        with pytest.raises(ValueError, match="the beam as it is cannot be simulated"):
            rs.diagnose(BEAM, measured, **PLAIN)
    good = rounds.corrected

    def fails_with_effects(seen, model, parts, *rest):
        return fails() if parts else good(seen, model, parts, *rest)

    monkeypatch.setattr(rounds, "corrected", fails_with_effects)
    report = rs.diagnose(BEAM, measured, **PLAIN)
    assert report.verdict == "unknown" and report.parts == ()
    assert "could not be simulated with this: no equilibrium found" in report.sentence


@pytest.mark.study
@pytest.mark.slow
def test_a_record_may_start_in_the_middle_of_a_swing(heavier):
    """A quarter of a cycle after the release it was refused; the mass found is the same."""
    late = [d.between(0.04) for d in heavier[:2]]
    report = rs.diagnose(BEAM, late[:1], sensors=SEEN.sensors, held_out=late[1])
    # To both modes a mass at a tip that has one is nearly a density, wherever the record begins.
    assert set(report.equivalent) <= {("added_mass",), ("density",)}
    mass = next(h for h in report.reduced.rivals if h.names == ("added_mass",))
    assert mass.effects[0].strengths[0, 0] == pytest.approx(4e-4, rel=0.02)


@pytest.mark.study
@pytest.mark.slow
def test_a_beam_of_another_length_lacks_no_mass():
    """0.5 % longer than said: it was "named: more mass at the tip"."""
    truth = BEAM.with_effect(Longer(0.005))
    decays = [decay(truth, q, i, SHORT) for i, q in enumerate((0.016, 0.013))]
    report = rs.diagnose(BEAM, decays[:1], held_out=decays[1], **PLAIN)
    assert report.names != ("added_mass",) and ("length",) in report.equivalent


@pytest.mark.study
@pytest.mark.slow
def test_command_line_reads_a_beam(heavier, tmp_path):
    """Of more elements than are simulated."""
    table = np.column_stack([heavier[0].t, heavier[0].q])
    header = ",".join(["t [s]", *(f"y{i} [m]" for i in range(5))])
    np.savetxt(tmp_path / "test.csv", table, delimiter=",", header=header, comments="")
    file = tmp_path / "beam.toml"
    columns = f"columns = {[f'y{i}' for i in range(5)]}\n"
    file.write_text(f"[beam]\nelements = 24\n[sensors]\npositions = {list(PLACES)}\n{columns}")
    arguments = ["diagnose", "--measured", str(tmp_path / "test.csv"), "--beam", str(file)]
    done = CliRunner().invoke(main, [*arguments, "--report", str(tmp_path / "page.html")])
    assert done.exit_code == 0, done.output
    assert "at the tip it would be 0.0004" in done.output and (tmp_path / "page.html").is_file()
    file.write_text("[beam]\nlenght = 1\n")
    with pytest.raises(ValueError, match=r"no 'lenght': did you mean 'length'\? It takes"):
        load_beam(file)
    file.write_text("[beam]\nelements = 8\n")
    with pytest.raises(ValueError, match="positions"):
        load_beam(file)


BEAM_FILE = """
[beam]
length = 0.3
elements = 8
alpha = 0.4
left = "clamped"
right = "clamped"
[beam.rectangle]
width = 0.02
thickness = 0.001
young = 70e9
density = 2700
[[beam.masses]]
mass = 0.001
at = 0.15
[[beam.springs]]
stiffness = 20.0
anchor = [0.15, 0.2]
natural_length = 0.2
at = 0.15
[sensors]
positions = [0.1, 0.15]
columns = ["a", "b"]
"""


def test_any_beam_is_read_from_a_file(tmp_path):
    file = tmp_path / "beam.toml"
    file.write_text(BEAM_FILE)
    beam, sensors, columns = load_beam(file)
    section = Section.rectangle(0.02, 0.001, 70e9, 2700.0)
    effects = (PointMass(0.001, 0.15), Spring(0.15, 20.0, (0.15, 0.2), 0.2))
    assert beam == Beam(0.3, section, 8, right=CLAMPED, alpha=0.4, effects=effects)
    assert [s.at for s in sensors.sensors] == [0.1, 0.15] and columns == ["a", "b"]
    file.write_text(BEAM_FILE.replace('right = "clamped"', "right = 2.5"))
    assert load_beam(file)[0].right == Support.elastic(2.5)
    # Of a section itself nobody asks what it is made of: no stretch at all is a way to model.
    rectangle = BEAM_FILE[BEAM_FILE.index("[beam.rectangle]") : BEAM_FILE.index("[[beam.masses]]")]
    stiff = "[beam.section]\nEA = 1e12\nGA = 1e9\nEI = 0.1\nmass = 0.05\n"
    file.write_text(BEAM_FILE.replace(rectangle, stiff))
    assert load_beam(file)[0].section.EA == 1e12


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('right = "clamped"', 'right = "welded"', "right = 'welded': give one of"),
        ("width = 0.02\n", "", r"\[beam\.rectangle\] has no 'width': add"),
        ("width = 0.02", "widht = 0.02", "takes no 'widht': did you mean 'width'"),
        ("width = 0.02", "width = nan", "width = NaN must be a finite number"),
        ("width = 0.02", "width = 1979-05-27", "width = .* must be a finite number"),
        ("young = 70e9", 'young = "steel"', 'young = "steel" must be a finite number'),
        ("young = 70e9", "young = [1.0]", r"young = \[\.\.\.\] must be a finite number"),
        ("young = 70e9", "young = 70e3", "sound would travel at 5.09 m/s .*: give SI units"),
        ("length = 0.3\n", "", "has no 'length': add"),
        ("alpha = 0.4", "alhpa = 0.4", r"\[beam\] takes no 'alhpa': did you mean 'alpha'"),
        ("alpha = 0.4", "effects = 5", r"\[beam\] takes no 'effects'"),
        ("alpha = 0.4", "gravity = true", "gravity = true must be a finite number"),
        ("[0.15, 0.2]", "[0.15]", r"anchor = \[0\.15\] must be two numbers"),
        ("[[beam.masses]]", "[beam.masses]", r"\[\[beam\.masses\]\] = .* must be a list"),
        ("[sensors]", "[sensor]", "takes no 'sensor': did you mean 'sensors'"),
        ('["a", "b"]', '["b", "b"]', r"\[sensors\] columns has 'b' twice: give every position"),
        ('["a", "b"]', '["b", 1]', r"\[sensors\] columns\[1\] = 1 must be a text"),
        ("elements = 8", "elements = 8.5", "elements must be a whole number from 1 to 10000"),
        ("[beam.rectangle]", "[beam.round]", r"\[beam\] left is of a beam with \[beam\.rect"),
        ("[sensors]", "[beam.section]\nEI = 1.0\n[sensors]", "two sections"),
        ("[0.1, 0.15]", '["a", 0.15]', r"positions\[0\] = \"a\" must be a finite number"),
        ("[0.1, 0.15]", "0.15", "give positions = "),
        ("at = 0.15\n[[", "at = 0.4\n[[", "0.4 m is off the beam"),
    ],
)
def test_a_file_of_no_beam_is_refused(tmp_path, old, new, message):
    file = tmp_path / "beam.toml"
    file.write_text(BEAM_FILE.replace(old, new, 1))
    with pytest.raises(ValueError, match=message):
        load_beam(file)


def test_a_second_load_towards_an_anchor_is_no_second_spring():
    """The friction in the spring is looked for at the spring, wherever the other pulls."""
    beam = Beam.cantilever(elements=6)
    (spring,) = springs_of(beam)
    other = Load(CubicStiffness().term(), 1.0, TowardsAnchor((0.3, 0.4), 0.2, 0.1))
    curve = beam.with_effect(other).static_curve(amplitude=0.01, cases=9)
    found = {e.name: e for e in mounted_effects(curve)}
    assert found["spring_friction"].mounting.anchor == spring.anchor
