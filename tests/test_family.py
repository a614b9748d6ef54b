"""What a report says: one size for effects that do the same to one mode, numbers as told."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import romsindy as rs
from romsindy.beam import Beam, Section
from romsindy.beam.motion import Sensor
from romsindy.diagnosis.found import EffectFamily, effects_of, small_vibration
from romsindy.diagnosis.on_beam import InstrumentedBeam
from romsindy.diagnosis.on_beam.mounted import PlaceOnBeam, mounted_effects
from romsindy.diagnosis.on_beam.parameters import damping_effects, parameter_effects
from romsindy.diagnosis.on_beam.report import BeamReport, in_interval
from romsindy.effects import (
    CubicStiffness,
    Damper,
    Hum,
    Hysteretic,
    LinearFrequency,
    MoreMass,
    Viscous,
)
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record, scales

OMEGA, C = 30.0, 0.3
MODEL = rs.ReducedModel.from_coefficients({"omega^2": OMEGA**2, "c_linear": C, "gamma_3": 50.0})
T = np.arange(0, 8, 0.01)


@pytest.fixture(scope="module")
def record():
    q = 0.1 * np.exp(-C / 2 * T) * np.cos(OMEGA * T)
    return Record.of(rs.add_noise(rs.Decay(T, q, unit="m"), 40, 0), 1e-4)


def part(effect, strength):
    return Part(effect, (), np.array([[strength]]))


def said(*parts, errors=None):
    """A fitted hypothesis as far as sentences ask it, with errors of its strengths."""
    errors = np.full(len(parts), 1e-6) if errors is None else np.asarray(errors)
    return SimpleNamespace(
        parts=parts,
        names=tuple(p.effect.name for p in parts),
        effects=parts,
        blamed=tuple(range(len(parts))),
        covariance=np.diag(errors**2),
        score=0.0,
        growth=lambda ratio: max(ratio, 1.0),
        solution=SimpleNamespace(slices=lambda: [slice(i, i + 1) for i in range(len(parts))]),
    )


@pytest.mark.parametrize(
    ("effect", "strength", "omega", "zeta"),
    [
        (Viscous(), 0.12, OMEGA, (C + 0.12) / (2 * OMEGA)),
        # h |q| against the velocity takes 2 h a^2 of a cycle, a damper c pi omega a^2.
        (Hysteretic(), 2.0, OMEGA, C / (2 * OMEGA) + 2.0 / (np.pi * OMEGA**2)),
        (LinearFrequency(), 40.0, np.hypot(OMEGA, 40**0.5), C / (2 * np.hypot(OMEGA, 40**0.5))),
        (MoreMass(), 0.02, OMEGA / 1.02**0.5, C / (2 * OMEGA * 1.02**0.5)),
    ],
)
def test_small_vibrations_are_those_of_the_linear_equation(record, effect, strength, omega, zeta):
    """Closed forms; what is cubic adds 1e-8, the corners of |q| 1e-4 of what they take."""
    found = small_vibration(MODEL, [part(effect, strength)], record)
    np.testing.assert_allclose(found, (omega / (2 * np.pi), zeta), rtol=1e-4)


def test_effects_that_do_the_same_are_one_answer(record):
    """By hand: 0.42 over 2 omega is 0.0070 in the place of 0.0050, 40 % more."""
    damper, loop = part(Viscous(), 0.12), part(Hysteretic(), 0.12 * np.pi * OMEGA / 2)
    rivals = [said(loop, errors=[0.6]), said(damper, errors=[0.5])]
    family = EffectFamily.of(rivals, MODEL, record, 1.0)
    assert family.members == ("viscous", "hysteretic")
    assert family.size == pytest.approx(0.4, rel=1e-3)
    text = family.in_words("odds 50 : 1")
    first, rest = text.split(": another damping")
    # 0.6 of 0.12 pi omega / 2 = 5.65 is 10.6 % of what is added, 4.2 % of what was assumed.
    assert first == (
        "linear damping 40 +- 4.2 % higher than assumed (damping ratio 0.0070 instead of 0.0050;"
        " odds 50 : 1)"
    )
    assert rest.endswith("; a mode that rings beside the first would tell them apart")
    mass = said(part(MoreMass(), 0.01), errors=[1e-4])
    stiffness = said(part(LinearFrequency(), -9.0), errors=[5.0])
    heavier = EffectFamily.of([mass, stiffness], MODEL, record, 1.0)
    assert heavier.size == pytest.approx(1.01**-0.5 - 1, rel=1e-6)
    assert heavier.in_words().startswith(
        "linear frequency 0.4963 +- 0.0049 % lower than assumed (4.751 instead of 4.775 Hz): "
    )
    assert EffectFamily.of([said(damper)], MODEL, record, 1.0) is None
    assert EffectFamily.of([said(damper), mass], MODEL, record, 1.0) is None
    both = said(damper, part(MoreMass(), 0.01))
    assert EffectFamily.of([said(damper), both], MODEL, record, 1.0) is None


@pytest.fixture(scope="module")
def seen():
    section = Section.rectangle(0.025, 0.001, 210e9, 7800.0)
    beam = Beam(0.45, section, 8, alpha=0.4, gravity=(0.0, 0.0))
    return InstrumentedBeam(beam, beam.sensors([Sensor(x) for x in (0.2, 0.3, 0.45)]))


def test_a_beam_has_the_damping_of_its_changes(seen):
    """Rayleigh: alpha adds alpha / 2 omega, eta adds eta omega / 2; a damper c phi^2 / 2 omega."""
    beam, curve, omega = seen.beam, seen.curve(0.01), float(seen.basis.omega[0])
    model = rs.ReducedModel.from_coefficients({"omega^2": omega**2, "c_linear": beam.alpha})
    t = np.arange(0, 4, 4e-3)
    q = 0.01 * np.exp(-beam.alpha / 2 * t) * np.cos(omega * t)
    heard = Record.of(rs.add_noise(rs.Decay(t, q, unit="kg^0.5 m"), 40, 0), 1e-4)
    by_mass, by_stiffness = damping_effects(curve)
    damper, *others = mounted_effects(curve, [Damper()])
    # What does the same to one mode as others is tried at some points, what does not at the tip.
    assert [e.mounting.at / beam.length for e in others] == [0.25, 0.5, 0.75]
    assert len(mounted_effects(curve, [CubicStiffness()])) == 1
    tip = np.vdot(beam.point_load((0.0, 1.0)), seen.basis.shapes[0])
    for effect, added in ((by_mass, 1.0), (by_stiffness, omega**2), (damper, tip**2)):
        found = small_vibration(model, [part(effect, 0.1)], heard)[1]
        # Splines over the curve.
        assert found == pytest.approx((beam.alpha + 0.1 * added) / (2 * omega), rel=1e-4)
    (longer,) = parameter_effects(seen, 0.01, names=("density",))
    denser = small_vibration(model, [part(longer, 0.01)], heard)[0]
    changed = beam.with_effect(longer.on_beam(0.01)).modes(count=1).omega[0] / (2 * np.pi)
    assert denser == pytest.approx(changed, rel=1e-5)
    # Amplitudes are told as the tip moves: 2 % is what the beam bends beyond its first mode.
    readings = seen.readings(beam, 0.01, 0.5, 4e-3)
    assert seen.shown.sensor == "y(0.45)" and seen.shown.unit == "mm"
    assert 1e-3 * seen.shown.per_q * 0.01 == pytest.approx(readings[0, -1], rel=0.02)


def test_the_recipe_of_a_family_needs_no_place(seen):
    """The damper is likeliest and was simulated; the material is what an engineer tries first."""
    curve = seen.curve(0.01)
    (damper,) = mounted_effects(curve, [Damper()], {"viscous": 0.2319})
    point, whole = part(damper, 0.02), part(damping_effects(curve)[0], 0.1)
    rivals = said(whole), said(point)
    family = EffectFamily("linear damping", 0.005, 0.007, 1e-5, rivals)
    given = {"parts": (point,), "faults": (), "sensor_errors": (), "slack": None, "seen": seen}
    said_of = {"verdict": "ambiguous", "refused": False, "effects": ()}
    reduced = SimpleNamespace(family=family, best=rivals[1], **said_of)
    found = BeamReport(reduced=reduced, **given)
    assert found.recipe.endswith("beam = beam.with_effect(MassDamping(change=0.1))")
    assert found.model.alpha == pytest.approx(0.5) and found.not_there == ()
    alone = SimpleNamespace(**vars(reduced) | {"family": None})
    at_point = BeamReport(reduced=alone, **given, place=PlaceOnBeam(0.2319, 0.2045, 0.2681, 0.45))
    assert "AtPoint(at=0.2319" in at_point.recipe and at_point.model.alpha == 0.4
    line = f"Missing: {damper.label}, 0.02 N s/m, or a stop at 0.232 m."
    there = "at 0.23 m (0.20 to 0.27 m)"
    assert at_point._placed(line) == (
        f"Missing: {Damper.label} {there}, 0.02 N s/m, or a stop at 0.232 m."
    )
    # Its strength goes with the place, in no proportion: it is told at both ends.
    alone.effects = (
        SimpleNamespace(
            name="viscous", values={"strength": 0.02}, standard_errors={"strength": 0.004}
        ),
    )
    ends = PlaceOnBeam(0.2319, 0.2045, 0.2681, 0.45, strengths=(0.029, 0.0143))
    line = f"Missing: {at_point.reduced.best.effects[0].effect.label}, 0.02 +- 0.004 N s/m."
    assert replace(at_point, place=ends)._placed(line) == (
        f"Missing: {Damper.label} {there}, 0.02 (0.029 to 0.014) N s/m."
    )
    untold = PlaceOnBeam(0.32, 0.21, 0.45, 0.45, strengths=(0.09, 0.018))
    damper, *_ = mounted_effects(curve, [Damper()])  # at the tip, where the mode moves most
    best = said(part(damper, 0.02))
    alone.best, alone.model = best, SimpleNamespace(unit="kg^0.5 m")
    anywhere = BeamReport(reduced=alone, **given, place=untold)
    line = f"Missing: {damper.label}, 0.02 +- 0.001 N s/m (odds 90 : 1)."
    assert anywhere._placed(line) == (
        f"Missing: {Damper.label} between 0.21 and 0.45 m, 0.09 to 0.018 N s/m there; at the tip"
        " it would be 0.02 +- 0.001 N s/m (odds 90 : 1)."
    )


def test_hum_is_told_in_hertz(record):
    hum = Part.of(Hum(), scales([record]), 1, [2 * np.pi * 50])
    heard = said(replace(hum, strengths=np.array([[1e-3, 0.0]])))
    heard.covariance = np.diag([1e-6, 1e-6, 2 * np.pi * 0.01]) ** 2
    heard.solution.slices = lambda: [slice(0, 3)]
    (found,) = effects_of(heard, [heard], 1.0, MODEL)
    assert found.values["frequency"] == pytest.approx(50) and found.units["frequency"] == "Hz"
    assert "frequency 50 +- 0.01 Hz" in str(found)


def test_a_place_has_the_digits_of_its_interval():
    assert in_interval(PlaceOnBeam(0.2319, 0.2045, 0.2681, 0.45)) == "at 0.23 m (0.20 to 0.27 m)"
    assert in_interval(PlaceOnBeam(0.3302, 0.3241, 0.3368, 0.45)) == "at 0.330 m (0.324 to 0.337 m)"


def alone(moved):
    """A hypothesis of one part, known to 0.002, and its rivals: itself."""
    one = said(moved, errors=[0.002])
    return one, [one]


def test_a_value_within_its_tolerance_is_told_with_it():
    changed = replace(part(Viscous(), 0.012), tolerance=0.03)
    (found,) = effects_of(*alone(changed), 1.0, MODEL)
    assert found.sure and found.within == (
        "damping proportional to speed is 0.312 +- 0.002 1/s (assumed 0.3 +- 0.03)"
    )
    mass = replace(part(MoreMass(), 0.012), tolerance=0.03)
    (found,) = effects_of(*alone(mass), 1.0, MODEL)
    assert found.within == "mass that moves along (added mass), 0.012 +- 0.002 (tolerance 0.03)"
