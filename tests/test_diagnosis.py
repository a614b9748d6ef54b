"""Effects hidden by an independent integrator are named, and nothing else is."""

from __future__ import annotations

import inspect
import json
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfilt

import romsindy as rs
from romsindy.commands import diagnose as diagnose_command
from romsindy.commands.main import main
from romsindy.diagnosis import CATALOGUE, TermEffect, diagnose
from romsindy.diagnosis.arguments import checked_records
from romsindy.diagnosis.decay_search import ProcessNoise
from romsindy.diagnosis.evidence import FormError
from romsindy.diagnosis.pictures import MissingForce, record_errors
from romsindy.diagnosis.search import _with_tones, screen
from romsindy.diagnosis.simulated import model_of_simulation
from romsindy.effects import AirDrag, DryFriction, LinearFrequency, Viscous
from romsindy.effects.memory import Viscoelastic
from romsindy.effects.outside import Hum
from romsindy.fit.kernel.collocation import Trajectory, TrajectoryError
from romsindy.fit.kernel.gauss_newton import _linearised, fit
from romsindy.fit.kernel.part import Part
from romsindy.fit.kernel.shooting import shoot
from romsindy.fit.records.record import Record, scales
from romsindy.fit.refine import refine
from romsindy.physics.damping import PowerDamping

TURN = 2 * np.pi
OMEGA = TURN * 5
NOMINAL = {
    "omega^2": OMEGA**2,
    "gamma_2": 0.05 * OMEGA**2,
    "gamma_3": 0.2 * OMEGA**2,
    "Upsilon_3": 0.15,
    "c_linear": 0.01 * OMEGA,
}
MODEL = rs.ReducedModel.from_coefficients(NOMINAL)
DURATION, LONG = 8.0, 12.0  # s: 40 cycles, and 60 where the quiet ones tell


def nothing(t, q, v):
    return 0.0


def decay(
    amplitude, force=nothing, snr_db=40, seed=0, changed=None, reading=None, duration=DURATION
):
    """A decay integrated here, with a force per unit mass on the left side."""
    t, q = motion(amplitude, force, tuple((changed or {}).items()), duration)
    q = q if reading is None else reading(t, q)
    return rs.add_noise(rs.Decay(t, q), snr_db, seed)


@cache  # several tests look at the same motion with other noise
def motion(amplitude, force, changed, duration):
    c = NOMINAL | dict(changed)
    u = c["Upsilon_3"]

    def rates(t, y):
        q, v = y
        f = c["omega^2"] * q + c["gamma_2"] * q**2 + c["gamma_3"] * q**3 + c["c_linear"] * v
        return [v, -(f + u * q * v * v + force(t, q, v)) / (1 + u * q * q)]

    t = np.arange(0, duration, 0.004)
    q = solve_ivp(rates, (0, duration), [amplitude, 0], "DOP853", t, rtol=1e-9, atol=1e-10).y[0]
    return t, q


def three(**options):
    """Two records to learn from and one held out."""
    return [decay(a, seed=i, **options) for i, a in enumerate((1.0, 0.6, 0.8))]


def report(**options):
    *learn, test = three(**options)
    return diagnose(MODEL, learn, held_out=test)


@cache  # several tests look at the same diagnosis
def report_of(name):
    return report(**HIDDEN[name][0])


# Strengths near 0.3 % of the frequency or 0.001 of the damping ratio at the largest amplitude.
HIDDEN = {
    "quadratic_drag": ({"force": lambda t, q, v: 0.003 * abs(v) * v}, {"strength": 0.003}),
    "amplitude_damping": ({"force": lambda t, q, v: 1.2 * q * q * v}, {"strength": 1.2}),
    "cubic_stiffness": ({"force": lambda t, q, v: 10.0 * q**3}, {"strength": 10.0}),
    "nonlinear_inertia": ({"changed": {"Upsilon_3": 0.17}}, {"strength": 0.02}),
    "linear_frequency": ({"changed": {"omega^2": 1.004 * OMEGA**2}}, {"strength": 3.948}),
    "viscous": (
        {"changed": {"c_linear": 0.35}, "duration": LONG},
        {"strength": 0.35 - 0.01 * OMEGA},
    ),
    "drift": ({"force": lambda t, q, v: 0.5 * t * q}, {"strength": 0.5}),
    "mains_hum": (
        {"reading": lambda t, q: q + 0.01 * np.sin(314 * t)},
        {"frequency": 314.0 / (2 * np.pi)},  # Hz
    ),
    "gain": ({"reading": lambda t, q: 1.03 * q}, {"strength": 0.03}),
    "saturation": ({"reading": lambda t, q: np.clip(q, -0.7, 0.7)}, {"limit": 0.7}),
}


QUICK = ("cubic_stiffness",)


@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=[pytest.mark.slow] * (x not in QUICK)) for x in HIDDEN]
)
def test_a_hidden_effect_is_named_with_its_value(name):
    truth = HIDDEN[name][1]
    result = report_of(name)
    # A gain makes all nonlinear coefficients others by as much: here, the cubic one does as well.
    assert result.verdict == ("ambiguous" if name == "gain" else "named"), result
    assert [e.name for e in result.effects] == [name]
    (effect,) = result.effects
    for key, value in truth.items():
        # Four standard errors and rounding of exponents: one in 16,000 by chance.
        error = effect.standard_errors[key]
        assert abs(effect.values[key] - value) < 4 * error + 0.01 * abs(value), effect
    # The held-out record is predicted to its noise; 2,000 samples know theirs to 2 %.
    assert result.gap.after < 1.1 < result.gap.before
    assert str(result.effects[0]) in result.sentence


@pytest.mark.slow
def test_a_gain_far_off_is_less_likely_than_another_stiffness():
    """Both do the same of a cubic spring: half as much again, or a sensor 22 % off.

    Calibrations are seldom more than a tenth off.
    """
    duffing = {"omega^2": OMEGA**2, "gamma_3": 0.2 * OMEGA**2, "c_linear": 0.01 * OMEGA}
    changed = {"gamma_2": 0.0, "Upsilon_3": 0.0, "gamma_3": 1.5 * duffing["gamma_3"]}
    decays = [decay(a, seed=i, changed=changed) for i, a in enumerate((1.0, 0.6))]
    result = diagnose(rs.ReducedModel.from_coefficients(duffing), decays)
    assert result.verdict == "named" and result.equivalent == (("cubic_stiffness",),)


@pytest.mark.slow
def test_a_coefficient_that_leaves_more_than_noise_is_told_though_it_is_small():
    """2 % of the cubic stiffness: 0.09 % of the frequency, and 2.3 times the noise in the end."""
    known = {"c_linear": 0.004 * OMEGA}
    changed = known | {"gamma_3": 1.02 * NOMINAL["gamma_3"]}
    measured = decay(1.0, changed=changed, duration=LONG)
    result = diagnose(rs.ReducedModel.from_coefficients(NOMINAL | known), measured)
    assert result.small and result.best.names == ("cubic_stiffness",)
    # Nonlinear inertia shifts the frequency alike.
    assert result.verdict == "ambiguous" and ("nonlinear_inertia",) in result.equivalent
    assert result.gap.after < 1.1 and "It is small" in result.sentence
    # What has no more than noise to explain is not told.
    changed = known | {"gamma_3": 1.005 * NOMINAL["gamma_3"]}
    measured = decay(1.0, changed=changed, duration=LONG)
    assert diagnose(rs.ReducedModel.from_coefficients(NOMINAL | known), measured).verdict == "none"


@pytest.mark.slow
def test_what_values_of_the_model_do_as_well_is_told_beside_them():
    """Structural damping: its harmonics are below the noise, so values of the model come first."""
    result = report(force=lambda t, q, v: 6.0 * abs(q) ** 1.016 * np.tanh(v / 0.03))
    assert result.verdict == "ambiguous" and result.best.names == ("viscous",), result
    assert ("hysteretic",) in result.equivalent
    # One answer, with one size: the loop takes 2 h a^2 of a cycle, a damper c pi omega a^2.
    family = result.family
    assert family.members == ("viscous", "hysteretic") and family.assumed == 0.005
    # |q|^0.016 and the corner of tanh are each 2 % of what is added.
    assert family.found - 0.005 == pytest.approx(6.0 / (np.pi * OMEGA**2), rel=0.05)
    (missing,) = (x for x in result.sentence.splitlines() if x.startswith("Missing: "))
    assert missing.startswith("Missing: linear damping ") and "do not tell" not in missing
    assert json.loads(result.to_json())["family"]["members"] == ["viscous", "hysteretic"]
    assert result.next_best.names not in (("viscous",), ("hysteretic",))


def test_what_is_not_surely_there_is_not_the_nearest():
    """Three standard errors, as they are told where more than noise is left."""
    found = replace(report_of("cubic_stiffness"), verdict="unknown")
    assert "the nearest is" in found.sentence and len(found.table()) > 1
    unsure = replace(found, best=found.best.at(FormError(jump=0.1)))
    assert "nothing in the catalogue explains it.\n" in unsure.sentence
    assert len(unsure.table()) == 1


def test_the_nearest_is_told_where_it_brings_cycles_together():
    """A simulation that had hardly a cycle in common has, and still none that keeps the phase."""
    result = report_of("cubic_stiffness")
    alone = {"frequency": np.nan, "damping": np.nan, "parts": ()}
    apart = tuple(replace(d, **alone) for d in result.differences)
    lost = replace(result, verdict="unknown", gap=result.gap.unchanged(), differences=apart)
    assert all(d.apart for d in apart) and lost.gap.closed == 0
    assert "explains it; the nearest is the coefficient gamma_3 4" in lost.sentence
    assert "With it, cycle by cycle, they agree within" in lost.sentence
    assert f"It closes nothing of the gap on {lost.gap.where}." in lost.sentence
    nothing = replace(lost, differences=result.differences)
    assert "explains it.\n" in nothing.sentence


def test_harmonics_of_hum_need_not_show_in_every_record():
    def hum(*sizes):
        return lambda t, q: q + sum(x * np.sin(k * 314.3 * t) for k, x in enumerate(sizes, 1))

    one, two = hum(0.01), hum(0.01, 0.008)
    records = [Record.of(decay(a, reading=r), 1e-4) for a, r in ((1.0, one), (0.6, two))]
    ((frequency, highest), *_) = screen(MODEL, (), [Hum()], records).scales.combs
    assert frequency == pytest.approx(314.3, rel=1e-3) and highest == 2


@pytest.mark.slow
def test_mass_is_told_beside_stiffness_and_damping_that_moved():
    """Values come first; effects that would have to be negative do not crowd mass out."""
    linear = {"omega^2": OMEGA**2, "c_linear": 0.04 * OMEGA}
    nothing_else = dict.fromkeys(NOMINAL, 0.0)
    model = rs.ReducedModel.from_coefficients(linear)
    *learn, test = three(changed=nothing_else | {k: x / 1.04 for k, x in linear.items()})
    result = diagnose(model, learn, held_out=test)
    assert result.best.names == ("linear_frequency",), result
    assert ("added_mass",) in result.equivalent and result.verdict == "ambiguous"


@pytest.mark.slow
def test_what_is_gone_after_the_first_swings_is_named():
    """Neither cycles at equal amplitude nor what was held out show it: the first eighth does."""
    damping = {"c_linear": 0.05 * OMEGA}
    model = rs.ReducedModel.from_coefficients(NOMINAL | damping)
    clips = lambda t, q: np.clip(q, -0.8, 0.8)  # noqa: E731
    for reading, verdict in ((clips, "named"), (None, "none")):
        *learn, test = three(changed=damping, reading=reading)
        result = diagnose(model, learn, held_out=test)
        assert result.verdict == verdict, result
        assert not reading or result.best.names == ("saturation",)


def test_nothing_hidden_is_found():
    verdicts = [report(snr_db=snr).verdict for snr in (30, 60)]
    assert verdicts == ["none", "none"]


@pytest.mark.study
@pytest.mark.slow
def test_two_effects_are_both_named():
    result = report(force=lambda t, q, v: 0.004 * abs(v) * v + 20.0 * q**3)
    assert {e.name for e in result.effects} == {"quadratic_drag", "cubic_stiffness"}
    assert result.gap.after < 1.1


@pytest.mark.study
@pytest.mark.slow
def test_a_value_that_moved_by_more_than_matters_is_told_beside_a_force():
    """Drag beside another frequency: 0.5 % of it matters, 0.02 % does not."""
    sizes = (0.01, 0.0004)
    changes = ({"omega^2": (1 + size) * OMEGA**2} for size in sizes)
    both, one = (report(force=lambda t, q, v: 0.006 * abs(v) * v, changed=c) for c in changes)
    assert both.verdict == one.verdict == "named"
    assert [e.name for e in both.effects] == ["quadratic_drag", "linear_frequency"]
    assert both.effects[1].values["strength"] == pytest.approx(sizes[0] * OMEGA**2, rel=0.02)
    assert [e.name for e in one.effects] == ["quadratic_drag"]


@pytest.mark.study
@pytest.mark.slow
@pytest.mark.parametrize(
    ("structural", "viscous", "base", "how", "beside"),
    [(4.0, 0.0, 40.0, {}, set()), (3.0, 0.06, 80.0, {"snr_db": 60}, {"viscous"})],
)
def test_kinds_of_linear_damping_are_not_told_apart_beside_a_force(
    structural, viscous, base, how, beside
):
    """A structure that loses the same in every cycle, whose base moves: viscous does as well.

    So it does in the place of both, where the base moves so much that the rest is next to nothing.
    """

    def force(t, q, v):
        lost = structural * abs(q) * np.sign(v) + viscous * v
        return lost - base * np.sin(0.44 * OMEGA * t)

    result = report(force=force, **how)
    assert result.verdict == "ambiguous"
    kinds = {frozenset(names) - {"base_excitation"} for names in result.equivalent}
    assert {frozenset({"viscous"}), frozenset({"hysteretic"} | beside)} <= kinds


@pytest.mark.slow
def test_one_more_is_looked_for_beside_the_best_alone():
    """The base moves, far from resonance, by more than a cubic spring does."""
    result = report(force=lambda t, q, v: 30.0 * q**3 - 40.0 * np.sin(0.44 * OMEGA * t))
    assert {e.name for e in result.effects} == {"base_excitation", "cubic_stiffness"}
    assert result.gap.after < 1.1


def test_a_fit_in_a_curved_valley_counts_by_a_motion_of_its_equation():
    """Stiffness, damping and a viscoelastic part in the place of a magnet and drag."""
    pull = 0.02 * OMEGA**2

    def missing(t, q, v):
        return pull / (1.6 - q) ** 3 + 0.01 * abs(v) * v

    records = [Record.of(decay(a, missing, seed=i), 1e-4) for i, a in enumerate((1.0, 0.6))]
    known = scales(records)
    starts = [p.starts[0] for p in Viscoelastic().parameters(known)]
    parts = [Part.of(e, known, 2) for e in (LinearFrequency(), Viscous())]
    found = fit(MODEL, [*parts, Part.of(Viscoelastic(), known, 2, starts)], records)
    # Of values that were left by a step beyond the valley it was 1.8 to 3 times as much.
    system, *_ = _linearised(MODEL, found.parts, records, found.motions)
    assert system.power == pytest.approx(found.chi_squared, rel=0.05)


def test_a_fit_ends_where_disturbances_grow_beyond_numbers():
    """A pendulum that stands on its head, at rest: they grow as exp(100 t)."""
    record = Record.of(decay(1.0), 1e-4)
    grid = record.motion.grid
    still = Trajectory(grid, *np.zeros((2, grid.n_steps + 1, 1)), np.zeros((grid.n_steps, 3, 1)))
    standing = rs.ReducedModel.from_coefficients({"omega^2": -1e4})
    with pytest.raises(TrajectoryError, match="without bound"):
        shoot(standing, [], [record], [still])


@pytest.mark.slow
def test_hum_stands_for_no_stiffness_and_has_other_harmonics_elsewhere():
    """Stiffness was "fitted beside" it, and lines of the held-out record "a further effect"."""

    def hum(*sizes):
        return lambda t, q: q + sum(x * np.sin(k * 314.3 * t) for k, x in enumerate(sizes, 1))

    changed = {"omega^2": 1.01 * OMEGA**2}
    learn, test = (
        decay(a, seed=i, changed=changed, reading=hum(*sizes))
        for i, (a, sizes) in enumerate(((1.0, (0.02,)), (0.8, (0.02, 0.015))))
    )
    result = diagnose(MODEL, learn, held_out=test)
    assert result.verdict == "named"
    assert [e.name for e in result.effects] == ["mains_hum", "linear_frequency"]
    assert result.moved == () and result.gap.after < 1.1
    assert result.effects[1].values["strength"] == pytest.approx(0.01 * OMEGA**2, rel=0.01)


def test_what_is_unknown_has_a_next_test_where_no_cycles_tell_loud_from_quiet():
    """Six cycles, none of which falls to half of the largest: there was no line at all."""
    short = decay(1.0, force=lambda t, q, v: 200 * np.sin(12 * q), duration=1.2)
    result = diagnose(MODEL, short, catalogue=[DryFriction()], max_effects=1)
    assert result.verdict == "unknown" and result.gap.loud_and_quiet is None
    assert result.sentence.splitlines()[-1] == (
        "Next: the same release again would show whether it repeats."
    )
    assert json.loads(result.to_json())["next"]["action"] == "the same release again"


def test_one_ambiguous_effect_has_a_next_test():
    """No rival is left to be told apart from, as where a search was stopped."""
    one = replace(report_of("cubic_stiffness"), verdict="ambiguous")
    assert len(one.rivals) == 1 and one.next_test is None
    advice = one.effects[0].advice
    assert one.sentence.splitlines()[-1] == f"Next: to confirm it, {advice}."


@pytest.mark.study
def coloured(decay, snr_db, seed):
    """With noise between half and one and a half times the frequency of the vibration."""
    rng, n = np.random.default_rng(seed), len(decay.t)
    rate = decay.dt * OMEGA / np.pi  # over half of that of the samples
    sections = butter(2, [0.5 * rate, 1.5 * rate], "band", output="sos")
    noise = sosfilt(sections, rng.standard_normal(n + 2000))[2000:]
    noise *= np.std(decay.signal) * 10 ** (-snr_db / 20) / np.std(noise)
    return rs.Decay(decay.t, decay.signal + noise)


@pytest.mark.slow
def test_a_quiet_record_does_not_excuse_what_a_loud_one_shows():
    model = rs.ReducedModel.from_coefficients(NOMINAL | {"gamma_5": 5.0})
    pair = (decay(a, lambda t, q, v: 45 * q**5, 200) for a in (1.0, 0.5))
    loud, quiet = (coloured(d, 30, 1 + i) for i, d in enumerate(pair))
    found = diagnose(model, [loud], held_out=quiet)
    assert found.verdict == "named"
    assert found.best.names == ("quintic_stiffness",)


@pytest.mark.slow
def test_of_as_many_values_those_are_told_that_leave_noise_alone():
    """Linear stiffness in the place of gamma_2 is within the tolerance, at six times the noise."""
    found = report(changed={"gamma_2": 0.15 * OMEGA**2, "c_linear": 0.02 * OMEGA})
    assert found.verdict == "named"
    assert found.best.names == ("quadratic_stiffness", "viscous")
    strength, *_ = (p.strengths for p in found.best.effects)
    assert_allclose(strength, 0.1 * OMEGA**2, rtol=0.02)  # +- 0.5 %, at four standard errors


@pytest.mark.slow
def test_what_leads_the_first_fit_astray_is_looked_for_about_that_fit():
    k, near = OMEGA**2, {"gamma_2": 0.0593, "gamma_3": -0.008}
    near = {name: value * k for name, value in near.items()}
    near |= {"Upsilon_3": 0.37, "c_linear": 0.0035 * OMEGA}
    more = {"gamma_4": 0.0163 * k, "gamma_5": 0.0353 * k}

    def clipped(t, q):
        return np.clip(q, -0.805, 0.805)

    def force(t, q, v):
        return more["gamma_4"] * q**4 + more["gamma_5"] * q**5

    loud, quiet = (
        decay(a, force, 40, i, near, clipped, duration=20.0) for i, a in enumerate((1.0, 0.5))
    )
    model = rs.ReducedModel.from_coefficients(NOMINAL | near | more)
    found = diagnose(model, [loud], held_out=quiet)
    assert (found.verdict, found.best.names) == ("named", ("saturation",))
    assert_allclose(found.best.effects[0].effect.value("limit"), 0.805, rtol=0.01)


@pytest.mark.slow
def test_fewer_effects_are_told_only_where_they_leave_as_little():
    known = {"c_linear": 0.05 * OMEGA, "gamma_2": -0.06 * OMEGA**2}

    def structural(t, q, v):
        return 0.08 * OMEGA**2 * abs(q) ** 0.94 * np.tanh(v / 1e-3)

    def hum(t, q):
        return q + 0.004 * np.sin(314.5 * t) + 0.007 * np.sin(629.0 * t)

    both = [
        decay(a, structural, snr, i, known, hum, length)
        for i, (a, snr, length) in enumerate([(1.0, 36, 4.8), (0.37, 27, 4.7)])
    ]
    found = diagnose(rs.ReducedModel.from_coefficients(NOMINAL | known), both)
    # Linear damping in the place of it leaves more: both explain the envelope to five per cent.
    assert (found.verdict, set(found.best.names)) == ("named", {"mains_hum", "hysteretic"})


@pytest.mark.slow
def test_an_effect_in_no_catalogue_is_unknown():
    """A stiffness that ripples with displacement and comes and goes in time."""

    def ripple(t, q, v):
        return 40 * np.sin(12 * q) * (1 + 0.5 * np.sin(0.9 * t))

    learn, _, test = three(force=ripple)
    result = diagnose(MODEL, learn, held_out=test, catalogue=CATALOGUE[:12], max_effects=1)
    assert result.verdict == "unknown"
    assert "nothing in the catalogue" in result.sentence
    page = replace(result, added=(), model=result.nominal).page()
    assert page["equation_title"] == "The simulation, unchanged" and page["equation_note"] == ""
    assert page["tables"][-1].title in ("What comes nearest", "The gap, before and after")


@pytest.mark.slow
def test_the_model_with_the_effect_moves_like_the_truth():
    result = report_of("quadratic_drag")
    truth = decay(0.9, HIDDEN["quadratic_drag"][0]["force"], snr_db=200)
    said = result.model.simulate(0.9, 0.0, truth.t)
    before = MODEL.simulate(0.9, 0.0, truth.t)
    assert np.std(said.q - truth.q) < 0.1 * np.std(before.q - truth.q)
    again = rs.ReducedModel.from_json(result.model.to_json())
    assert again.coefficients == result.model.coefficients


def test_an_effect_of_the_users_own():
    class FourthPower(TermEffect):
        name, family, sign = "fourth_power", "damping", 1
        label = "damping with the fourth power of speed"

        def term(self):
            return PowerDamping(4.0)

    *learn, test = three(force=lambda t, q, v: 3e-6 * abs(v) ** 3 * v)
    result = diagnose(MODEL, learn, held_out=test, catalogue=[FourthPower()])
    assert [e.name for e in result.effects] == ["fourth_power"]


@pytest.mark.study
@pytest.mark.slow
def test_exact_models_and_tolerances():
    """Nothing free: a moved frequency is an effect; with a tolerance on gamma_3 it is no effect."""
    *learn, test = three(changed={"omega^2": 1.004 * OMEGA**2})
    result = diagnose(MODEL, learn, held_out=test, free=())
    assert "linear_frequency" in [e.name for e in result.effects] and not result.moved
    *learn, test = three(changed={"gamma_3": 0.21 * OMEGA**2})
    result = diagnose(MODEL, learn, held_out=test, tolerances={"gamma_3": 0.1})
    assert not result.effects
    # The value that was fitted within its tolerance is part of the model and of the prediction.
    assert result.verdict == "none"
    assert result.model.coefficients["gamma_3"] == pytest.approx(0.21 * OMEGA**2, rel=0.01)


@pytest.mark.slow
def test_two_processes_give_the_numbers_of_one():
    *learn, test = three(**HIDDEN["quadratic_drag"][0])
    names = ("quadratic_drag", "cubic_damping", "dry_friction")
    catalogue = [e for e in CATALOGUE if e.name in names]
    lines: list[str] = []

    def say(line):  # a closure that keeps what it hears cannot go to another process
        lines.append(line)

    one, two = (
        diagnose(MODEL, learn, held_out=test, catalogue=catalogue, n_jobs=n, progress=say)
        for n in (1, 2)
    )
    assert one.to_json() == two.to_json()
    assert [h.misfit for h in one.compared] == [h.misfit for h in two.compared]
    assert lines[: len(lines) // 2] == lines[len(lines) // 2 :]


def test_a_model_whose_motion_escapes_is_refused():
    """Negative damping: exp(1200) over the record is beyond all numbers."""
    wild = rs.ReducedModel.from_coefficients(NOMINAL | {"c_linear": -200.0})
    refused(decay(1.0), "no motion near that of the records.*check the signs", wild, free=())


def test_without_a_held_out_record_stretches_are_kept_back():
    """The last quarter of a record was, where nonlinearity has died."""
    result = diagnose(MODEL, decay(1.0, HIDDEN["quadratic_drag"][0]["force"]))
    assert result.gap.unseen
    (learns,), (judges,) = result.records, (p.record for p in result.gap.predictions)
    assert np.array_equal(learns.part, ~judges.part)
    assert learns.decay.t[-1] > 0.95 * DURATION


def test_report_files(tmp_path):
    result = report_of("quadratic_drag")
    result.to_html(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert page.count("data:image/png;base64") == 6 and result.sentence[:40] in page
    in_notebook = result._repr_html_()
    assert "<math" in in_notebook and all(row[0] in in_notebook for row in result.table())
    assert json.loads(result.to_json())["effects"][0]["name"] == "quadratic_drag"
    lost = replace(result, remainder=replace(result.remainder, structure=np.inf))
    content = json.loads(lost.to_json(), parse_constant=pytest.fail)  # strict JSON
    assert float(content["structure"]) == np.inf
    result.to_csv(tmp_path / "table.csv")
    assert "quadratic_drag,,strength" in (tmp_path / "table.csv").read_text()


def test_before_by_record_is_the_simulation_as_it_was():
    """As in the table of the gap; a fit of the frequency alone would leave nothing of it."""
    result = report_of("linear_frequency")
    parts = result.best.solution.parts
    names, before, after, _ = record_errors(MODEL, parts, result.records, result.gap)
    # The held-out decay reaches less far than the others: stretches of these judge, too.
    learns = ["record 1, fitted", "record 2, fitted"]
    assert names == [*learns, "record 1, held out", "record 2, held out", "the held-out record"]
    assert before[2:].max() == result.gap.before and after[2:].max() == result.gap.after
    # In 8 s the phase is lost by a tenth of a cycle, and noise is at 1 % of the rms.
    assert before.min() > 5 and after.max() < 1.1


@pytest.mark.parametrize("quantity", ["displacement", "velocity"])
def test_drag_is_in_phase_with_the_velocity_whatever_was_measured(quantity):
    clean = decay(1.0, HIDDEN["quadratic_drag"][0]["force"], snr_db=80, duration=LONG)
    if quantity == "velocity":
        whole = rs.Decay.from_velocity(clean.t, CubicSpline(clean.t, clean.q)(clean.t, 1))
        clean = whole.between(0.2)  # in the first cycle the mean is largest
    missing = MissingForce.of(MODEL, (), Record.loud(clean, 1e-4))
    with_q, with_v = np.abs(missing.harmonics())
    # The mean of an asymmetric vibration, which velocity has lost, looks like stiffness.
    assert with_v[1] > 2 * with_q[1]
    # At the up-crossing of q, where its phase is 0, the velocity is largest.
    assert_allclose(missing.q, np.hypot(missing.q, missing.q_dot) * np.sin(missing.phase), atol=0.2)


@pytest.mark.slow
def test_the_side_of_a_stop_is_reported():
    """In the sentence, the table and the JSON text: a stop below is met at negative q."""
    hidden = three(force=lambda t, q, v: -0.02 * OMEGA**2 * max(-q - 0.4, 0.0))
    result = diagnose(MODEL, hidden[:2], held_out=hidden[2])
    assert result.best.names == ("stop",)
    assert "a stop on one side [below], " in result.sentence
    assert result.table()[1][:2] == ["stop", "below"]
    assert json.loads(result.to_json())["effects"][0]["variant"] == "below"


def test_one_function_for_every_simulation():
    """All arguments have names, and those of the other kind of simulation are refused."""
    good = decay(1.0)
    beam = rs.Beam.cantilever(elements=4)
    sensors = beam.sensors([0.45])
    assert {"model", "sensors", "tolerances"} <= {*inspect.signature(rs.diagnose).parameters}
    result = rs.diagnose(model=MODEL, measured=good, catalogue=CATALOGUE[:1], max_effects=1)
    assert result.verdict == "none"
    refused(good, "sensors = None: a Beam needs", beam)
    refused(
        good,
        "tolerances name 'gamma_3': this beam has",
        beam,
        sensors=sensors,
        tolerances={"gamma_3": 1},
    )
    refused(good, "belong to a Beam", sensors=sensors)
    with pytest.raises(
        TypeError, match="model is a str: give a ReducedModel, Beam, Decay, or a function"
    ):
        rs.diagnose("model.json", good)
    refused(good, "catalogue", catalogue=[AirDrag])


def test_an_error_that_grows_does_not_fall():
    result = report_of("quadratic_drag")
    assert "closes all of the gap" in result.sentence
    swapped = [replace(p, before=p.after, after=p.before) for p in result.gap.predictions]
    worse = replace(result, gap=replace(result.gap, predictions=tuple(swapped)))
    assert worse.gap.closed == 0
    assert "closes" not in worse.sentence and "the noise hides" in worse.sentence


# -- bad input --------------------------------------------------------------------------------


def refused(measured, match, model=MODEL, **options):
    with pytest.raises(ValueError, match=match):
        diagnose(model, measured, **options)


def test_bad_requests_are_refused():
    good = decay(1.0)
    refused([], "measured is empty")
    refused([good, good], "same record")
    refused(good, "cannot be free", free=("gamma_3",))
    refused(good, "tolerances name", tolerances={"gamma_9": 0.1})
    refused(good, "must be positive", tolerances={"gamma_3": 0.0})
    zero = rs.ReducedModel.from_coefficients(NOMINAL | {"gamma_5": 0.0})
    refused(good, "'gamma_5', which is 0 in the model", zero, tolerances={"gamma_5": 0.1})
    refused(good, "probability", false_alarm=2.0)
    inch = rs.Decay(good.t, good.q, unit="rad")
    refused(inch, "is in rad, the model in m", rs.ReducedModel(MODEL.terms, MODEL.values, "m"))


def test_records_that_cannot_be_compared_are_refused():
    good = decay(1.0)
    refused(good.between(end=0.4), "cycles")
    noise = np.random.default_rng(0).standard_normal(len(good.t))
    refused(rs.Decay(good.t, noise), "noise|cycles")
    other_mode = rs.ReducedModel.from_coefficients(NOMINAL | {"omega^2": 9 * OMEGA**2})
    refused(good, "another mode", other_mode)
    reach = rs.ReducedModel(MODEL.terms, MODEL.values, None, (0.01, 1.2))
    refused(rs.Decay(good.t, 1000 * good.q), "other scale", reach)
    refused(rs.Decay(good.t, 1e-3 * good.q), "no overlap", reach)
    refused(rs.Decay(good.t, 1000 * good.q), "scale")  # nor does the frequency fit


def reversed_sign(decays):
    return [rs.Decay(d.t, -d.q) for d in decays]


@pytest.mark.parametrize("snr_db", [40, 60])
@pytest.mark.parametrize("name", [None, "quadratic_drag", "cubic_stiffness", "linear_frequency"])
def test_reversed_sign_is_told_apart_from_an_effect(name, snr_db):
    """Of an asymmetric model, whether something else is missing too or not."""
    options = HIDDEN[name][0] if name else {}
    good = three(snr_db=snr_db, **options)[:2]
    checked_records(MODEL, good, 2e-4)
    with pytest.raises(ValueError, match=r"sign reversed: pass Decay\(t, -q\)"):
        checked_records(MODEL, reversed_sign(good), 2e-4)


@pytest.mark.slow
def test_sign_is_not_blamed_without_reason():
    """Asymmetric effects are none, nor has a symmetric model a sign, nor noise an asymmetry."""
    for force in (
        lambda t, q, v: -0.06 * OMEGA**2 * q * q,
        lambda t, q, v: 0.2 * OMEGA**2 * max(-q - 0.5, 0.0) * -1,
        lambda t, q, v: 0.02 * OMEGA**2 * max(q, 0.0),
        lambda t, q, v: -0.1 * OMEGA**2,
    ):
        records = [decay(a, force, snr_db=60) for a in (1.0, 0.6)]
        checked_records(MODEL, records, 2e-4)
    symmetric = rs.ReducedModel.from_coefficients(NOMINAL | {"gamma_2": 0.0})
    checked_records(symmetric, three(), 2e-4)
    checked_records(symmetric, reversed_sign(three()), 2e-4)
    checked_records(MODEL, reversed_sign(three(snr_db=12)), 2e-4)


@pytest.mark.slow
def test_other_sampling_is_no_matter():
    fine = report_of("quadratic_drag")
    *learn, test = three(**HIDDEN["quadratic_drag"][0])
    learn[1] = rs.Decay(learn[1].t[::2], learn[1].q[::2])
    coarse = diagnose(MODEL, learn, held_out=test)
    assert [e.name for e in coarse.effects] == [e.name for e in fine.effects]


# -- measured --------------------------------------------------------------------------------


def sine_polynomial(omega, highest=11):
    """Coefficients of omega^2 sin(q) as an odd polynomial up to 2.6 rad."""
    q = np.linspace(0, 2.6, 400)
    powers = np.arange(1, highest + 1, 2)
    c = np.linalg.lstsq(q[:, None] ** powers, np.sin(q), rcond=None)[0] * omega**2
    return {("omega^2" if p == 1 else f"gamma_{p}"): v for p, v in zip(powers, c, strict=True)}


@pytest.mark.slow
def test_pendulum_lacks_dry_friction(measured):
    content = np.load(measured / "pendulum_free_swing.npz")
    swings = []
    for angle, start in ((45, 0.29), (90, 0.54), (135, 0.41)):
        q = np.deg2rad(content[f"release_{angle}deg_theta_deg"])
        swings.append(rs.Decay(np.arange(len(q)) / 1000, q, unit="rad").between(start))
    model = rs.ReducedModel.from_coefficients(
        sine_polynomial(2 * np.pi * 1.745) | {"c_linear": 0.9}, unit="rad"
    )
    result = diagnose(model, swings, floor=0.01)
    # The damping was assumed by far too high; the stiffness is left alone.
    assert [e.name for e in result.effects] == ["dry_friction", "viscous"]
    assert result.moved == ()
    assert result.effects[0].values["strength"] == pytest.approx(1.98, rel=0.2)
    # A filter has spoilt the first half of a cycle, which takes no part.
    pairs = zip(result.records, result.best.solution.residuals, strict=True)
    after = np.concatenate([left[record.first :] for record, left in pairs])
    assert np.rad2deg(np.sqrt(np.mean(after**2))) < 0.8
    # Eight cycles are enough for every picture; the simulation damps too much there.
    readings = {p.title: p.caption for p in result.pictures().values()}
    assert "nan" not in " ".join(readings.values())
    assert "with the velocity: damping" in readings["By phase"]


@pytest.mark.slow
@pytest.mark.parametrize(("run", "start"), [("21338", 9.5), ("21337", 26.5)])
def test_ship_lacks_quadratic_damping(measured, run, start):
    content = np.load(measured / "kvlcc2_roll_decay.npz")
    series = {
        name: rs.Decay(content[f"{name}_t"], content[f"{name}_phi"], unit="rad")
        for name in ("sim_fnpf_inviscid_0kn",)
    }
    with pytest.warns(UserWarning, match="not uniform"):
        test = rs.Decay(content[f"test_{run}_0kn_t"], content[f"test_{run}_0kn_phi"], unit="rad")
    known = model_of_simulation([series["sim_fnpf_inviscid_0kn"]])
    result = diagnose(
        known.model,
        test.between(start).free(),
        tolerances=known.tolerances,
        floor=known.floor,
    )
    # Seven cycles, and a simulation whose stiffness is known to 100 %: laws of damping that grows
    # with amplitude are alike here, the hysteresis of a joint among them.
    growing = {"quadratic_drag", "cubic_damping", "amplitude_damping", "bouc_wen", "micro_slip"}
    assert result.verdict in ("named", "ambiguous")
    # Beside them linear values of a simulation without viscosity, which move by more than matters.
    linear = {"viscous", "linear_frequency"}
    assert all(names and {*names} <= growing | linear for names in result.equivalent)
    # In the second run a larger linear damping does nearly as much, within what matters.
    assert not growing.isdisjoint(result.best.names)
    left = np.rad2deg(np.sqrt(np.mean(result.best.solution.residuals[0] ** 2)))
    assert left < 0.05


@pytest.mark.slow
def test_command_line(tmp_path, monkeypatch):
    rs.save_decay(decay(1.0, HIDDEN["quadratic_drag"][0]["force"]), tmp_path / "test.csv")
    (tmp_path / "model.json").write_text(MODEL.to_json())
    arguments = ["diagnose", "--measured", str(tmp_path / "test.csv"), "--model"]
    arguments += [str(tmp_path / "model.json"), "--report", str(tmp_path / "page.html")]
    done = CliRunner().invoke(main, [*arguments, "--exit-code"])
    assert done.exit_code == 10, done.output  # named
    assert "drag in air" in done.stdout and (tmp_path / "page.html").is_file()
    assert done.stdout.startswith("named\nThey differ: ") and "posterior" not in done.stdout
    assert len(done.stdout.splitlines()) <= 20
    exact = CliRunner().invoke(main, [*arguments, "--free", "nothing", "--full"])
    assert exact.exit_code == 0 and "drag in air" in exact.output
    assert "posterior" in exact.stdout and "error over noise" in exact.stdout
    # A floor of 0 is a floor: nothing is too small to matter.
    seen = {}

    def watched(**options):
        seen.update(options)
        raise ValueError("seen enough")

    monkeypatch.setattr(diagnose_command, "run_diagnosis", watched)
    CliRunner().invoke(main, [*arguments, "--floor", "0"])
    assert seen["floor"] == 0.0 and "free" not in seen
    refusal = CliRunner().invoke(main, arguments[:3])
    assert refusal.exit_code == 2 and "--simulated" in refusal.output


@pytest.mark.slow
def test_both_may_be_columns_of_one_file(tmp_path):
    """A spring hardens by 2 % of its force at 0.1 m, which the simulated column has not."""
    t = np.arange(0, 12, 0.01)
    linear = {"omega^2": 400.0, "c_linear": 0.3}
    hard = linear | {"gamma_3": 800.0}
    y, x = (rs.ReducedModel.from_coefficients(c).simulate(0.1, 0.0, t).q for c in (hard, linear))
    y = y + 1e-4 * np.random.default_rng(4).standard_normal(len(t))
    file, header = tmp_path / "both.csv", "t (s),test (m),sim (m)"
    np.savetxt(file, np.c_[t, y, x], delimiter=",", header=header, comments="")
    arguments = ["diagnose", "--measured", str(file), "--column", "test", "--simulated-column"]
    page = ["--report", str(tmp_path / "page.html")]
    done = CliRunner().invoke(main, [*arguments, "sim", *page])
    assert done.exit_code == 0 and "cubic stiffness), 8" in done.stdout, done.output
    wrong = CliRunner().invoke(main, [*arguments, "nothing", *page])
    assert wrong.exit_code == 2 and "--simulated-column 'nothing' is none of" in wrong.stderr
    none = CliRunner().invoke(main, [*arguments[:5], "--simulated", str(file), *page])
    assert none.exit_code == 2 and "choose with --simulated-column" in none.stderr


def test_an_interrupt_keeps_what_was_compared(tmp_path, monkeypatch):
    """Of the candidates the base and two are there; the page and the files are written."""
    rs.save_decay(decay(1.0, HIDDEN["quadratic_drag"][0]["force"]), tmp_path / "test.csv")
    (tmp_path / "model.json").write_text(MODEL.to_json())
    fitted, calls = ProcessNoise.fitted, []

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) > 3:
            raise KeyboardInterrupt
        return fitted(*arguments)

    monkeypatch.setattr(ProcessNoise, "fitted", interrupted)
    monkeypatch.chdir(tmp_path)
    arguments = [
        "diagnose",
        "--measured",
        "test.csv",
        "--model",
        "model.json",
        "--json",
        "all.json",
    ]
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 130 and "Stopped when 3 explanations were compared" in done.output
    assert (tmp_path / "test_diagnosis.html").is_file() and (tmp_path / "all.json").is_file()


def test_when_the_time_is_up_the_best_so_far_is_told(monkeypatch):
    """The clock ticks with every fit: after the sixth no other candidate is begun."""
    fitted, now = ProcessNoise.fitted, [0.0]

    def slow(*arguments):
        now.append(now[-1] + 1.0)
        return fitted(*arguments)

    monkeypatch.setattr(ProcessNoise, "fitted", slow)
    for module in ("diagnose", "search"):
        there = import_module(f"romsindy.diagnosis.{module}")  # beside it, a function of its name
        monkeypatch.setattr(there, "monotonic", lambda: now[-1])
    force = HIDDEN["quadratic_drag"][0]["force"]
    report = rs.diagnose(MODEL, decay(1.0, force), budget=5.5)
    # What comes then is the best again, with a whole exponent; all the search would be thirty.
    assert report.interrupted and len(now) - 1 <= 7
    assert report.sentence.startswith("Stopped when ")
    with pytest.raises(ValueError, match="budget = -1 must be seconds"):
        rs.diagnose(MODEL, decay(1.0, force), budget=-1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--tolerance speed=1", "Invalid value for '--tolerance': 'speed' in 'speed=1' is none of"),
        ("--tolerances gamma_3=0", "--tolerances of gamma_3 = 0.0 must be positive"),
        ("--tolerances gamma_9=1", "--tolerances name 'gamma_9', but the model has"),
        ("--repeats good.csv", "--repeats holds 1 decay: give two or more"),
        ("--repeats good.csv --repeats good.csv", "--repeats holds a record twice"),
        ("--reference slow.csv", "slow.csv vibrates at 1.26"),
        ("--held-out slow.csv", "slow.csv vibrates at 1.26"),
        ("--held-out good.csv", "good.csv is the same record as an earlier one"),
        ("--measured short.csv", "short.csv: no free decay between 0.032 and 0.156 s"),
        ("--measured short.csv --whole", "short.csv cannot be analysed: "),
        ("--release 2", "good.csv: release = 2: mode 1"),
        ("--model text.json", "text.json: the text is no JSON"),
        ("--floor 2", "--floor 2.0 must be a part of the largest amplitude"),
        ("--jobs 0", "--jobs 0 must be a number of processes"),
    ],
)
def test_the_command_names_options_and_files(tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    Path("model.json").write_text(MODEL.to_json())
    Path("text.json").write_text("hello")
    good = decay(1.0)
    several = {"good": (good.t, good.q), "slow": (4 * good.t, 0.9 * good.q)}
    several["short"] = (good.t[:40], good.q[:40])
    for name, columns in several.items():
        table = np.stack(columns, axis=1)
        np.savetxt(f"{name}.csv", table, delimiter=",", header="t,q", comments="")
    given = ["diagnose", "--measured", "good.csv", "--model", "model.json", *options.split()]
    done = CliRunner().invoke(main, given)
    assert done.exit_code == 2, done.output
    assert done.stderr.splitlines()[-1].startswith(f"Error: {message}")


@pytest.mark.study
@pytest.mark.slow
def test_clamped_beam_has_another_linear_frequency(measured):
    """Run a against the model of run b: 2 to 2.6 Hz lower at the start, the stiffening stays."""
    content = np.load(measured / "cc_beam_bristol.npz")
    runs = []
    for run, skipped in (("a", 0.6), ("b", 0.85)):
        record = rs.Decay.from_velocity(content[f"mode1{run}_t"], content[f"mode1{run}_v"], "m")
        start = record.free().t[0] + skipped
        runs.append(record.free().between(start, start + 1.8))
    library = rs.ROMLibrary(inertia=(), stiffness=(1, 3, 5), damping=("linear", "quadratic"))
    model = refine(rs.HarmonicSINDy(library).fit(runs[1]).model_, runs[1]).model
    # Both runs hold more than one mode: the gap stays open, and nothing is named. (With the whole
    # catalogue a magnet may come nearer; which one does changes with a few samples.)
    effects = [e for e in CATALOGUE if e.name in ("linear_frequency", "viscous")]
    result = diagnose(model, runs[0], floor=0.01, max_effects=1, catalogue=effects)
    # Coupling to mode 3 seemed to, until the model without it started from where coupling led.
    assert result.verdict == "unknown"
    assert "linear_frequency" in result.best.names
    shift = result.base.solution.parts[0].strengths[0, 0]
    omega2 = model.coefficients["omega^2"]
    assert -3.0 < (np.sqrt(omega2 + shift) - np.sqrt(omega2)) / (2 * np.pi) < -1.8


def test_pictures_say_what_was_measured():
    """A velocity was drawn as q in m."""
    truth = decay(1.0, snr_db=60)
    rate = rs.Decay.from_velocity(truth.t, np.gradient(truth.q, truth.dt), unit="mm")
    result = diagnose(MODEL, rate, catalogue=())
    figures = {name: p.figure() for name, p in result.pictures().items() if name != "record"}
    assert "velocity (mm/s)" in {ax.get_ylabel() for ax in figures["gap"].axes}
    assert figures["amplitude"].axes[-1].get_xlabel() == "amplitude of the velocity (mm/s)"


@pytest.mark.slow
def test_what_took_part_in_a_fit_does_not_judge_it():
    """Fits of short records were weighed a second time by the same samples: more values won."""
    short = decay(1.0, seed=1, force=lambda t, q, v: 0.02 * abs(v) * v).between(0, 1.2)
    result = diagnose(MODEL, short)
    assert not result.gap.unseen
    assert all(h.tested == 0 for h in result.compared)
    assert "quadratic_drag" in {name for names in result.equivalent for name in names}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "effect", "law", "truth"),
    [
        ("c_quadratic", "quadratic_drag", lambda v: abs(v) * v, 0.02),
        ("c_coulomb", "dry_friction", lambda v: np.tanh(v / 1e-3), 0.1),
    ],
)
def test_what_a_model_has_already_may_be_too_much(key, effect, law, truth):
    """A half too much of it was named as a gain and cubic stiffness at odds of 7000 : 1."""
    record = decay(1.0, force=lambda t, q, v: truth * law(v), seed=3, duration=LONG)
    model = rs.ReducedModel.from_coefficients(NOMINAL | {key: 1.5 * truth})
    fine = {"frequency": 1e-4, "damping": 1e-2, "signal": 2e-4}
    result = diagnose(model, record, tolerance=fine)
    # Of friction that turns round smoothly 87 % of the gap closes: nine tenths make it sure.
    assert result.verdict in ("named", "ambiguous") and result.equivalent == ((effect,),)
    (found,) = result.effects
    assert (found.variant, found.family) == (key, "damping")
    # Friction that turns round smoothly is less than it says in the smallest swings.
    error = max(3 * found.standard_errors["strength"], 0.05 * truth)
    assert found.values["strength"] == pytest.approx(-truth / 2, abs=error)


@pytest.mark.slow
def test_simulation_with_friction_is_reduced_with_it():
    """Without it the reduction missed its own series by 50 %, and nothing mattered any more."""
    force = lambda t, q, v: 0.2 * np.tanh(v / 1e-3)  # noqa: E731
    series = decay(1.0, force, snr_db=90)
    known = model_of_simulation([series])
    # What the smooth law lacks of a jump is a thousandth of it.
    assert known.model.coefficients["c_coulomb"] == pytest.approx(0.2, rel=5e-3)
    test = decay(0.9, force, seed=1)
    given = {"tolerances": known.tolerances, "floor": known.floor, "reference": series}
    assert diagnose(known.model, test, **given).verdict == "none"


@pytest.mark.parametrize(
    ("unit", "remedy"),
    [
        ("mm", r"the model in mm: give the model's coefficients for q in m$"),  # records are in SI
        ("rad", r"the model in rad: load the decay with unit='rad', or give the model's coeff"),
    ],
)
def test_remedy_for_a_unit_works(unit, remedy):
    model = rs.ReducedModel(MODEL.terms, MODEL.values, unit)
    record = decay(1.0)
    with pytest.raises(ValueError, match=f"decay 0 is in m, {remedy}"):
        diagnose(model, rs.Decay(record.t, record.q, unit="m"))


@pytest.mark.parametrize("hertz", np.arange(24.6, 25.9, 0.18))
def test_hum_beside_a_harmonic_is_looked_for_where_it_is(hertz):
    """The fifth is at 25.3 Hz: the smooth part of the record takes hum with it, but for a flank.

    From half a line of a spectrum away a fit still finds its frequency.
    """
    hum = decay(
        1.0, seed=2, duration=LONG, reading=lambda t, q: q + 0.02 * np.sin(TURN * hertz * t)
    )
    record = Record.loud(hum, 1e-5)
    known = scales([record])
    linear = fit(MODEL, [Part.of(e, known, 1) for e in (LinearFrequency(), Viscous())], [record])
    tones = _with_tones(MODEL, linear.parts, [record], [record.motion], ()).tones
    assert np.abs(np.array(tones) / TURN - hertz).min() < 0.5 / LONG


@pytest.mark.slow
def test_hum_is_found_beside_what_hides_it():
    """A sensor that saturates was named alone: the pairs that promised most held no hum."""
    limit = 0.78

    def reading(t, q):
        shown = np.clip(q, -limit, limit)
        return shown + 0.007 * np.sin(314.3 * t + 1) + 0.003 * np.sin(628.6 * t + 2)

    result = diagnose(MODEL, decay(1.0, reading=reading))
    assert result.verdict == "named"
    assert set(result.best.names) == {"mains_hum", "saturation"}
    (found,) = (e for e in result.effects if e.name == "saturation")
    assert found.values["limit"] == pytest.approx(limit, abs=4 * found.standard_errors["limit"])
    # The noise of 2,000 samples is known to 4 %.
    assert result.gap.after < 1.1
