"""What a simulation lacks against forced vibrations, made by a simulator of its own."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import odeint, solve_ivp

import romsindy as rs
from romsindy.diagnosis import ForcedReport
from romsindy.diagnosis.arguments import checked_driven
from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.residual_search import ByNoises, NoiseOfBest
from romsindy.diagnosis.residual_workflow import search_beside_inputs
from romsindy.diagnosis.search import Options
from romsindy.effects import CATALOGUE, AirDrag, CubicStiffness, DryFriction, MoreMass, Viscous
from romsindy.effects.base import Scales
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import Part
from romsindy.fit.kernel.shooting import resimulated
from romsindy.fit.records.driven import drives_of
from romsindy.physics.input import Input

OMEGA, DAMPING, CUBIC, GAIN = 2 * np.pi * 5.0, 0.8, 3e4, 2.0
DT = 0.01
T = DT * np.arange(1800)
KNOWN = {"omega^2": OMEGA**2, "c_linear": DAMPING, "gamma_3": CUBIC, "gain [force]": GAIN}
FEW = (AirDrag(), Viscous(), CubicStiffness(), MoreMass())


def sweep(t):
    """3 to 7 Hz over 18 s, N."""
    return 2.0 * np.sin(2 * np.pi * (3.0 + 2.0 * t / T[-1]) * t)


def record(
    seed, more=lambda q, v: 0.0, gain=GAIN, mass=1.0, late=0.0, level=1.0, stiff=1.0, damped=1.0
):
    """A swept sine, 40 dB, with a force (m/s^2) on the left side that the simulation lacks."""
    return remembering(
        seed, lambda q, v, z: (more(q, v), 0.0), gain, mass, late, level, stiff, damped
    )


def remembering(seed, law, gain=GAIN, mass=1.0, late=0.0, level=1.0, stiff=1.0, damped=1.0):
    """The same with a force that has a state: ``law(q, v, z)`` gives it, and the rate of z."""

    def rates(t, y):
        q, v, z = y
        force, rate = law(q, v, z)
        push = gain * level * sweep(t - late) - force
        own = damped * DAMPING * v + stiff * OMEGA**2 * q + CUBIC * q**3
        return [v, (push - own) / mass, rate]

    q = odeint(rates, (0.0, 0.0, 0.0), T, tfirst=True, rtol=1e-10, atol=1e-12)[:, 0]
    noise = 0.01 * q.std() * np.random.default_rng(seed).standard_normal(len(q))
    return rs.ForcedVibration(T, q + noise, level * sweep(T), unit="m", input_unit="N")


def drag(q, v):
    return 2.0 * v * abs(v)


def model(**changed):
    return rs.ReducedModel.from_coefficients({**KNOWN, **changed}, unit="m")


def without_gain():
    known = {k: v for k, v in KNOWN.items() if k != "gain [force]"}
    return rs.ReducedModel.from_coefficients(known, unit="m")


@pytest.fixture(scope="module")
def right():
    return record(1)


def test_nothing_is_missing(right):
    report = rs.diagnose(model(), right)
    assert isinstance(report, ForcedReport) and report.verdict == "none"
    assert report.model == report.nominal and not report.effects
    assert "They agree" in report.sentence and "1 % of the response, as noise" in report.sentence


@pytest.mark.slow
def test_drag_is_named_with_its_strength():
    report = rs.diagnose(model(), record(2, drag))
    (found,) = report.effects
    assert report.verdict == "named" and found.name == "quadratic_drag"
    assert abs(found.values["strength"] - 2.0) < 4 * found.standard_errors["strength"] < 1.0
    assert found.units["strength"] == "1/m"
    assert report.gap.before > 5 * report.gap.after and report.gap.closed > 0.99
    assert report.gap.after == pytest.approx(0.01, rel=0.05)
    # The input is as it was.
    assert report.model.coefficients["gain [force]"] == GAIN
    assert "named" in json.loads(report.to_json())["verdict"]
    for picture in report.pictures().values():
        assert picture.figure().axes


@pytest.mark.slow
def test_the_gain_of_the_input_is_wrong(right):
    report = rs.diagnose(model(**{"gain [force]": 1.9}), right)
    (gain,) = report.effects
    assert report.verdict == "named" and gain.name == "input_gain"
    assert gain.values["strength"] == pytest.approx(0.1, abs=4 * gain.standard_errors["strength"])
    assert report.model.coefficients["gain [force]"] == pytest.approx(GAIN, rel=0.005)


@pytest.mark.slow
def test_a_linear_simulation_of_a_stiff_spring_with_friction_is_told_both():
    """Either alone leads a simulation over another fold than the measured motion."""
    measured = record(4, lambda q, v: 1.2e5 * q**3 + 1.5 * np.tanh(v / 0.002))
    known = {k: v for k, v in KNOWN.items() if k != "gamma_3"}
    simulated = rs.ReducedModel.from_coefficients(known, unit="m")
    report = rs.diagnose(simulated, measured, catalogue=(*FEW, DryFriction()))
    found = {e.name: e for e in report.effects}
    assert report.verdict == "named" and set(found) == {"cubic_stiffness", "dry_friction"}
    for name, value in (("cubic_stiffness", 1.2e5 + CUBIC), ("dry_friction", 1.5)):
        error = found[name].standard_errors["strength"]
        assert abs(found[name].values["strength"] - value) < 4 * error < 0.1 * value


@pytest.mark.parametrize("seed", [4, 5])
def test_friction_that_holds_under_an_input_settles(seed):
    """Averaged over a step alone, the force of what sticks jumps from iterate to iterate."""
    records = checked_driven([record(seed, lambda q, v: 2.0 * np.tanh(v / 5e-4))], 0.0)
    found = fit(model(), [Part(DryFriction(), (), np.array([[1.0]]))], records)
    assert found.converged
    # It turns round over 0.7 % of the largest velocity: a part of the motion in quiet stretches.
    assert found.parts[0].strengths[0, 0] == pytest.approx(2.0, rel=1e-3)


def test_values_by_noises_lead_back_from_far_off():
    """A cube that is far off, without the drag: to where a fit goes, and that stays."""
    records = checked_driven([record(2, drag)], 0.0)
    values = (CubicStiffness(), 5e4), (AirDrag(), 0.0)
    parts = tuple(Part(e, (), np.array([[x]])) for e, x in values)
    settled = fit(model(), parts, records)
    far = resimulated(model(), replace(settled, parts=parts), records)
    near, there = (ByNoises.of(model(), s, records).solved(s, ()) for s in (settled, far))
    errors = np.sqrt(np.diag(near.covariance))
    best, own, back = (of_all(parts) for parts in (settled.parts, near.parts, there.parts))
    assert np.all(np.abs(own - best) < 0.01 * errors)
    # The noise found far off weighs motions that a large force moves: less is known, not another.
    assert np.all(np.abs(back - best) < 2 * np.sqrt(np.diag(there.covariance)))
    assert np.all(np.abs(back - best) < 20 * errors)


def of_all(parts):
    return np.concatenate([part.values for part in parts])


def test_values_by_noises_are_right_where_a_force_has_shifted_a_jump():
    """Of a response that jumps least squares leave least by a delay that is wrong."""
    lines = 2 * np.pi * np.arange(2.0, 8.0, 0.04)
    # As those of white noise up to 50 Hz, of 5 % of the force
    size = 0.05 * GAIN * sweep(T).std() * np.sqrt(0.04 / 50)
    a, b = size * np.random.default_rng(2).standard_normal((2, len(lines)))

    def law(q, v, t):  # a state of rate 1 is the time
        return -(a @ np.cos(lines * t) + b @ np.sin(lines * t)), 1.0

    records = checked_driven([remembering(2, law)], 0.0)
    inputs = rs.ReducedModel.from_coefficients({**KNOWN, "gain [force]": 0.9 * GAIN}, unit="m")
    solution = fit(without_gain(), drives_of(inputs, records), records)
    solved = ByNoises.of(without_gain(), solution, records).solved(solution, ())
    off = np.stack([of_all(parts) - [GAIN, 0.0] for parts in (solution.parts, solved.parts)])
    squares, noises = np.abs(off / np.sqrt(np.diag(solved.covariance))).max(axis=1)
    assert noises < 3 < squares


def test_nothing_is_screened_beside_a_motion_that_grows_beyond_numbers():
    """Products of a response that is finite and huge are not."""
    records = checked_driven([record(1)], 0.0)
    scales = Scales(0.05, OMEGA, float(T[-1]))
    unsure = (Part(Viscous(), (), np.array([[-40.0]])),)  # grows as exp(20 t): 1e213 in 25 s
    search = search_beside_inputs(
        model(), records, scales, unsure, Options(FEW, 1e-3, 1, 0.0, 1, str), "band-limited"
    )
    solution = replace(fit(model(), search.beside, records), parts=(*unsure, *search.beside))
    start = Hypothesis(solution, 2, 1.0, None)
    assert search._screened(start) == []


def test_the_chain_is_late():
    report = rs.diagnose(model(), record(3, late=0.004), catalogue=FEW)
    (late,) = report.effects
    assert late.name == "input_delay" and report.verdict == "named"
    assert late.values["delay"] == pytest.approx(0.004, abs=4 * late.standard_errors["delay"])


@pytest.mark.slow
def test_an_input_that_is_not_held_has_no_strength_and_is_named(right):
    """Held inputs are late by half a sample, 9 degrees at 5 Hz: an effect without any value."""
    terms = [Input("force", "hold", 0.0, "N") if isinstance(t, Input) else t for t in model().terms]
    held = rs.ReducedModel(tuple(terms), model().values, "m")
    report = rs.diagnose(held, right, catalogue=FEW)
    assert report.verdict == "named" and report.best.names == ("input_between_samples",)
    (found,) = report.effects
    assert found.values == {} and found.relative is None
    assert "an input that is not what was assumed between its samples" in report.sentence


def test_an_input_that_the_model_does_not_have_is_fitted():
    """Half as much force again is no alarm, and the report says why."""
    report = rs.diagnose(without_gain(), record(4, gain=1.5 * GAIN), catalogue=FEW)
    assert report.verdict == "none"
    assert any("gain and delay are fitted" in note for note in report.notes)


@pytest.mark.slow
def test_a_mass_is_told_from_stiffness_by_a_known_gain():
    """Where the gain is fitted, and all is linear, stiffness and damping may be others as well."""
    heavy = record(5, mass=1.01)
    assert rs.diagnose(model(), heavy, catalogue=FEW).best.names == ("added_mass",)
    linear = {"omega^2": OMEGA**2, "c_linear": DAMPING}
    options = {"t_eval": T, "method": "DOP853", "rtol": 1e-9, "atol": 1e-12}

    def rates(t, y):
        return [y[1], (GAIN * sweep(t) - DAMPING * y[1] - OMEGA**2 * y[0]) / 1.002]

    q = solve_ivp(rates, (0.0, T[-1]), (0.0, 0.0), **options).y[0]
    q += 0.01 * q.std() * np.random.default_rng(6).standard_normal(len(q))
    measured = rs.ForcedVibration(T, q, sweep(T), unit="m")
    report = rs.diagnose(rs.ReducedModel.from_coefficients(linear, "m"), measured, catalogue=FEW)
    assert report.verdict == "ambiguous"
    assert report.equivalent == (("added_mass",), ("linear_frequency", "viscous"))
    assert "Next: at no level that was simulated" in report.sentence


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "law", "truth"),
    [
        (
            "maxwell",
            lambda q, v, z: (40.0 * z, v - z / 0.05),
            {"strength": 40.0, "relaxation": 0.05},
        ),
        (
            "bouc_wen",
            lambda q, v, z: (30.0 * z, v - abs(v) * z / 0.02),
            {"strength": 30.0, "slip": 0.02},
        ),
    ],
)
def test_a_force_that_remembers_is_named(name, law, truth):
    """A spring and a damper in series, 40 / s^2 and 50 ms; a loop that softens, z within 2 cm."""
    report = rs.diagnose(model(), remembering(21, law))
    (found,) = report.effects
    assert report.verdict == "named" and found.name == name
    for value, true in truth.items():
        error = found.standard_errors[value]
        assert abs(found.values[value] - true) < 4 * error < 0.1 * true


@pytest.mark.slow
def test_a_difference_within_the_stated_tolerance_is_none():
    """0.2 % of the frequency is 9.1 % of the response in resonance."""
    off = record(11, stiff=1.004)
    assert rs.diagnose(model(), off, catalogue=FEW).best.names == ("linear_frequency",)
    report = rs.diagnose(model(), off, catalogue=FEW, tolerance=0.003)
    assert report.verdict == "none" and report.left == "noise"
    assert "9.1 % of the response (tolerance: 0.3 %, 5 % and 1 %)." in report.sentence
    assert report.model == report.nominal
    closer = rs.diagnose(model(), off, catalogue=FEW, tolerance=0.001)
    assert closer.verdict == "named" and closer.best.names == ("linear_frequency",)


@pytest.mark.slow
def test_what_is_beyond_the_tolerance_is_named_beside_it():
    report = rs.diagnose(model(), record(12, drag), catalogue=FEW, tolerance=0.003)
    assert report.verdict == "named" and report.best.names == ("quadratic_drag",)


def test_repeats_say_what_does_not_matter():
    """Two runs whose frequencies differ by 0.2 %, damping by 2 %; a third between them."""
    runs = [record(15, stiff=0.998, damped=0.99), record(16, stiff=1.002, damped=1.01)]
    third = record(17, stiff=1.001)
    assert rs.diagnose(model(), third, catalogue=FEW).verdict == "named"
    report = rs.diagnose(model(), third, catalogue=FEW, repeats=runs)
    assert report.verdict == "none"
    # 40 dB over 18 s: either frequency is known to 4e-5, their difference to 6e-5.
    assert report.tolerance.frequency == pytest.approx(0.002, abs=6e-5)
    assert "repeat runs differ by 0.2 % in frequency" in report.sentence


@pytest.mark.slow
def test_a_held_out_record_takes_no_part_and_tells():
    """Drag that was learnt in one sweep closes the gap of a weaker one; else it stays open."""
    weaker = record(13, drag, level=0.7)
    report = rs.diagnose(model(), record(12, drag), held_out=weaker, catalogue=FEW)
    assert report.verdict == "named" and report.best.names == ("quadratic_drag",)
    assert report.gap.where == "the record that took no part" and len(report.records) == 1
    assert len(report.gap.records) == 1 and report.gap.records[0].decay is weaker
    assert report.gap.before > 1 and report.gap.after == pytest.approx(0.01, rel=0.05)
    assert "It closes all of the squared gap on the record that took no part." in report.sentence
    assert report.gap.table()[0][0] == "on the record that took no part"
    assert "held-out record" in report.pictures()["time"].caption
    other = rs.diagnose(model(), record(1), held_out=weaker, catalogue=FEW)
    assert other.verdict == "unknown" and other.gap.closed < 0.5
    again = "Next: the same input again would show whether it repeats, and one of half the size "
    assert other.sentence.splitlines()[-1].startswith(again)


@pytest.mark.slow
def test_an_effect_that_gains_nothing_on_the_held_out_record_is_dropped():
    """Drag in one of the runs alone is no property of the structure that both measure."""
    report = rs.diagnose(model(), record(12, drag), held_out=record(14), catalogue=FEW)
    assert report.verdict == "unknown" and not report.best.effects


def test_an_interrupt_keeps_what_was_compared(monkeypatch):
    """The simulation, its values as far as they came, and one candidate."""
    fitted, calls = NoiseOfBest.fitted, []

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) > 3:
            raise KeyboardInterrupt
        return fitted(*arguments)

    monkeypatch.setattr(NoiseOfBest, "fitted", interrupted)
    report = rs.diagnose(model(), record(12, drag), catalogue=FEW)
    assert report.interrupted and report.verdict != "named" and len(report.compared) == 4
    assert report.sentence.startswith("Stopped when 4 explanations were compared")


def test_what_does_not_go_with_inputs_is_refused(right):
    decay = rs.Decay(T, right.y, unit="m")
    with pytest.raises(ValueError, match="held_out = a Decay does not go with forced"):
        rs.diagnose(model(), right, held_out=decay)
    with pytest.raises(ValueError, match="repeats = a Decay does not go with forced"):
        rs.diagnose(model(), right, repeats=[right, decay])
    with pytest.raises(ValueError, match=r"reference = \.\.\. does not go with forced"):
        rs.diagnose(model(), right, reference=decay)
    with pytest.raises(ValueError, match="repeats holds 1 record: give two or more"):
        rs.diagnose(model(), right, repeats=[right])
    with pytest.raises(ValueError, match="repeats holds a record twice"):
        rs.diagnose(model(), right, repeats=[right, right])
    with pytest.raises(ValueError, match="hold 1800 and 1500 samples: cut them alike"):
        rs.diagnose(model(), right, repeats=[right, right.between(end=14.995)])
    with pytest.raises(ValueError, match="record 1 is the same record as an earlier one"):
        rs.diagnose(model(), right, held_out=right)
    with pytest.raises(ValueError, match="one kind at a time"):
        rs.diagnose(model(), [right, decay])
    with pytest.raises(ValueError, match="driven by 'base', and record 0 has"):
        other = {"omega^2": OMEGA**2, "Gamma [base]": 1.0}
        rs.diagnose(rs.ReducedModel.from_coefficients(other, "m"), right)
    with pytest.raises(ValueError, match="record 0 is noise"):
        noise = np.random.default_rng(7).standard_normal(len(T))
        rs.diagnose(model(), rs.ForcedVibration(T, noise, right.u, unit="m"), catalogue=CATALOGUE)
