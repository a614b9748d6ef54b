"""A user's own simulator: what is asked, what is refused, and what is put into it.

The oracle is the simulator itself with a law hidden in it, integrated by scipy: the force that is
found must be that law, in newtons, and the simulator with it must come down to the noise.
"""

import sys
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.commands.main import main
from romsindy.diagnosis.all_sensors import Readings, chi_squared
from romsindy.diagnosis.on_simulator import simulator_rounds
from romsindy.diagnosis.on_simulator.report import SimulatorReport
from romsindy.diagnosis.on_simulator.seen import (
    Beginning,
    ForceScale,
    OnSimulator,
    ValueEffect,
    turning_points,
)
from romsindy.diagnosis.on_simulator.simulator_rounds import SimulatorRounds, left_of
from romsindy.diagnosis.on_simulator.workflow import _reduced, _shape, _value_effect
from romsindy.diagnosis.rounds import Outcome
from romsindy.diagnosis.search import Options, screen, with_textbook_exponent
from romsindy.diagnosis.structure import AskedMotion
from romsindy.effects import (
    AirDrag,
    CubicStiffness,
    DryFriction,
    LinearFrequency,
    MicroSlip,
    MoreMass,
    Stop,
    Viscous,
)
from romsindy.effects.base import Scales
from romsindy.effects.outside import Hum, SecondMode
from romsindy.fit.kernel.equation import ExtendedEquation
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import Combination
from romsindy.simulator import Program, Simulator, SimulatorError
from romsindy.simulator.force import LANGUAGES, LawForce
from romsindy.simulator.simulator import times

MASS, DAMPING, STIFFNESS, CUBIC = 0.35, 0.05, 80.0, 4e4  # kg, N s/m, N/m, N/m^3
FRICTION = 0.01  # N
OTHER = 110.0  # rad/s, of another mode
T = np.arange(2400) / 200


def motion(release, t, force, stiffness=STIFFNESS, cubic=CUBIC):
    def rates(s, y):
        push = -DAMPING * y[1] - stiffness * y[0] - cubic * y[0] ** 3 + force(s, *y)
        return [y[1], push / MASS]

    span = (0.0, t[-1])
    return solve_ivp(rates, span, [release, 0.0], "LSODA", t, rtol=1e-9, atol=1e-11).y[0]


def nothing(t, x, v):
    return 0.0


def simulate(release, t, force=nothing, k=STIFFNESS):
    return motion(release, t, force, k)


def record(release, seed, force=nothing, k=STIFFNESS, t=T):
    x = motion(release, t, force, k)
    noise = 0.01 * np.std(x) * np.random.default_rng(seed).standard_normal(len(x))
    return rs.Decay(t, x + noise, unit="m")


# -- what is asked and refused ---------------------------------------------------------------------


def wrong(kind):
    def simulator(release, t):
        x = motion(release, t, nothing)
        if kind == "raises":
            return 1 / 0
        return {
            "length": x[:-1],
            "NaN": np.where(t > 3, np.nan, x),
            "runaway": x * np.exp(np.clip(100 * (t - 3), 0, 600)),
            "millimetres": 1000 * x,
            "sign": -x,
            "words": "no numbers",
            "still": 0 * x,
            "noise": x + 0.001 * np.random.default_rng().standard_normal(len(x)),
        }[kind]

    return simulator


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("raises", "release = .*: it raised ZeroDivisionError: division by zero"),
        ("length", "shape .*: return one row for each of the .* times"),
        ("NaN", "NaN or infinity, or nearly, from 3.* s on"),
        ("runaway", "NaN or infinity, or nearly, from 3.[2-4]"),
        ("millimetres", r"1e\+03 times the release .*check units \(mm and m\)"),
        ("sign", "of the other sign"),
        ("words", "which is no array of numbers"),
        ("still", "nothing moves"),
        ("noise", "asked twice, the answers are .* apart: .*fix their seed"),
    ],
)
def test_a_simulator_that_gives_no_motion_is_refused_by_name(kind, message):
    with pytest.raises(SimulatorError, match=f"simulator simulator, .*{message}"):
        rs.diagnose(wrong(kind), record(0.03, 0))


def test_what_was_computed_is_kept():
    asked = []

    def fails_at_last(release, t):
        asked.append(release)
        if len(asked) > 3:
            raise RuntimeError("the licence has ended")
        return motion(release, t, nothing)

    kept = Simulator.of(fails_at_last)
    with pytest.raises(SimulatorError, match=r"licence has ended.*what was computed before"):
        rs.diagnose(kept, [record(0.03, 0), record(0.015, 1)])
    assert [d.release for d in kept.computed] == [asked[0], asked[2]]  # the second was the repeat
    again = kept.decay(asked[0], kept.computed[0].t[:50], 1)
    assert np.array_equal(again.displacements, kept.computed[0].displacements[:50])
    assert len(asked) == 4  # it was not asked again


def test_arguments_that_do_not_belong_are_refused():
    with pytest.raises(ValueError, match=r"<lambda> takes release: give a function"):
        rs.diagnose(lambda release: release, record(0.03, 0))
    with pytest.raises(ValueError, match=r"parameters name .m., and the simulator simulate"):
        rs.diagnose(simulate, record(0.03, 0), parameters={"m": 1.0})
    with pytest.raises(ValueError, match=r"parameters of 'k' = \(80.0, -1\) must be a value"):
        rs.diagnose(simulate, record(0.03, 0), parameters={"k": (80.0, -1)})
    with pytest.raises(ValueError, match="values of a simulator of one's own"):
        rs.diagnose(rs.ReducedModel.from_coefficients({"omega^2": 200.0}), [], parameters={"k": 1})
    with pytest.raises(ValueError, match=r"free = .*: of a simulator"):
        rs.diagnose(simulate, record(0.03, 0), free=["gamma_3"])
    several = rs.Decay(T, np.stack([1e-4 * np.sin(T), np.sin(15 * T)], axis=1))
    with pytest.raises(ValueError, match=r"the first channel moves by .*give one first"):
        rs.diagnose(simulate, several)


def test_times_are_fine_enough_and_beyond_the_record():
    t = times(10.0, 0.05, 15.0)
    assert t[0] == 0 and t[-1] >= 10 and np.allclose(np.diff(t), t[1])
    assert 0.05 / t[1] == pytest.approx(round(0.05 / t[1]))  # samples of the record are among them
    assert 2 * np.pi / 15 / t[1] >= 60


# -- the equation backwards ------------------------------------------------------------------------


@pytest.mark.parametrize("phase", [0.4, 1.9, 3.5, 6.0])
def test_a_motion_goes_back_to_where_it_turned(phase):
    """Of a damped oscillator in closed form: q = exp(-d t) (cos w t + d / w sin w t)."""
    damping, rate = 0.3, np.sqrt(36.0 - 0.3**2)
    model = rs.ReducedModel.from_coefficients({"omega^2": 36.0, "c_linear": 2 * damping})
    t = phase / rate
    q = np.exp(-damping * t) * (np.cos(rate * t) + damping / rate * np.sin(rate * t))
    q_dot = -36.0 / rate * np.exp(-damping * t) * np.sin(rate * t)
    since = (phase % np.pi) / rate  # it turns every half cycle
    expected = np.exp(-damping * (t - since)) * (-1) ** int(phase // np.pi)
    (found,) = turning_points(model, (float(q), float(q_dot)), rate)
    assert found == pytest.approx((expected, since), rel=1e-7)


# -- other modes -----------------------------------------------------------------------------------

RATE, OTHER = 6.0, 26.3  # rad/s: of the slow mode, and of another
SLOW, FAST = 0.03, 0.3  # their damping, 1/s
SHAPE, OTHER_SHAPE = np.array([1.0, 0.6]), np.array([0.6, -1.0])  # which is orthogonal
SIZE, CYCLE = 0.02, 2 * np.pi / RATE
LINEAR = rs.ReducedModel.from_coefficients({"omega^2": RATE**2 + SLOW**2, "c_linear": 2 * SLOW})
EQUATION = ExtendedEquation(LINEAR, (), 0, 0.01, 0.0)  # of the slow mode


class _Bar:
    """Two masses with a force at either: how far a point moves with the first sensor."""

    points: ClassVar = {"here": (0.0, 0.0, 0.0), "there": (1.0, 0.0, 0.0)}

    def simulate(self, release, t, force=None, point=None):
        shape = {"here": 1.0, "there": 0.25, None: 1.0}[point]
        x = release * np.cos(RATE * t)
        if force is not None:
            for at, y in zip(t, x, strict=True):
                force(at, shape * y, 0.0)
        return x


def test_a_point_moves_with_the_coordinate_by_what_a_force_sees_there():
    simulator, t = Simulator.of(_Bar()), np.arange(0, 10, 0.01)
    simulator.decay(0.1, t, 1)
    known = {"released": [(0.1, 0.1)], "scale": ForceScale(2.0, 1.0)}
    seen = OnSimulator(simulator, np.ones(1), np.ones(1), {}, **known)
    assert seen.at_point == "here" and list(seen.points) == ["here", "there"]
    (there,) = seen.at(["there"])
    assert there.at_point == "there" and there.scale == pytest.approx((2.0, 0.25), rel=1e-6)
    part = Part(MoreMass(), (), np.array([[0.1]]))
    assert not simulator.takes_mass and seen.mass([part]) == 0
    # Where all sensors found no box of places, what acts is exported at its point all the same.
    taking = replace(there, simulator=SimpleNamespace(points=simulator.points, takes_mass=True))
    given = {"reduced": None, "sensor_errors": (), "seen": taking, "missed": 0.0}
    report = SimulatorReport(parts=(part,), **given)
    assert (report.point, report._there) == ("there", " at there")
    assert report._placed == {"point": "there"}
    assert replace(report, parts=())._placed is None
    # Work at a point that moves by a quarter: k x^n does the same with 4^(n + 1) times the k.
    there, seen = replace(there, reach=(0.1, 1.0)), replace(seen, reach=(0.1, 1.0))
    for effect, power in ((Viscous(), 1), (AirDrag(), 2), (CubicStiffness(), 3), (MoreMass(), 1)):
        part = Part(effect, (), np.array([[0.1]]))
        assert there.strength([part], seen) == pytest.approx(4 ** (power + 1), rel=1e-5)


def ring(t, omega, damping):
    """A mode let go from 1 at rest, and its velocity, in closed form."""
    phase, fall = omega * t, np.exp(-damping * t)
    squared = omega**2 + damping**2
    at = fall * (np.cos(phase) + damping / omega * np.sin(phase))
    return at, -fall * squared / omega * np.sin(phase)


def slow_state(since):
    """Of the slow mode so long after its release."""
    return tuple(SIZE * float(x) for x in ring(since, RATE, SLOW))


def two_modes(q, t, *, other=0.2, damping=FAST):
    slow, fast = ring(t, RATE, SLOW)[0], other * ring(t, OTHER, damping)[0]
    return q * (np.outer(slow, SHAPE) + np.outer(fast, OTHER_SHAPE))


def two_modes_cut(since, other=0.2):
    """A simulator, the record of its coordinate, what two sensors measured, and without noise.

    It was cut ``since`` its release, s.
    """
    t = np.arange(1200) * CYCLE / 40
    clean = two_modes(SIZE, since + t, other=other)
    noise = 0.01 * clean.std(axis=0) * np.random.default_rng(5).standard_normal(clean.shape)
    decay, first = rs.Decay(t, clean + noise, unit="m"), 1 + other * OTHER_SHAPE[0]
    simulator = Simulator(lambda release, t: two_modes(release / first, t, other=other), "two")
    seen = OnSimulator(simulator, SHAPE, SHAPE / (SHAPE @ SHAPE), {}, released=[(first, 1.0)])
    return seen, Record.of(seen.decay(decay), 1e-6), decay, clean


@pytest.mark.parametrize("cycles", [0, 0.3, 0.8, 1.3, 2.6, 4.1])
def test_other_modes_tell_how_long_ago_a_record_was_released(cycles):
    """It turned every half cycle since; let go from there, the simulator does what was measured."""
    seen, record, decay, clean = two_modes_cut(cycles * CYCLE)
    found = seen.moved(AskedMotion(EQUATION, (), record, slow_state(cycles * CYCLE), None), decay)
    assert found.release.since == pytest.approx(cycles * CYCLE, rel=1e-6)
    # Splines of the fifth order, of 60 samples a cycle of the slow mode and 14 of the other.
    assert np.abs(found.readings[0] - clean).max() < 1e-4 * SIZE


def test_without_other_modes_a_record_turned_just_before():
    seen, record, decay, _ = two_modes_cut(1.3 * CYCLE, other=0.0)
    found = seen.moved(AskedMotion(EQUATION, (), record, slow_state(1.3 * CYCLE), None), decay)
    assert found.release.since == pytest.approx(0.3 * CYCLE, rel=0.01)


@pytest.mark.parametrize("cycles", [0.003, 2.003])
def test_a_state_that_turns_a_little_later_is_no_cycle_later(cycles):
    """Read anew it turns just after the record begins, and not just before: it was let go then."""
    seen, record, decay, clean = two_modes_cut(0.0)
    q, q_dot = slow_state(0.0)
    known = Beginning(cycles * CYCLE, (q, abs(q_dot) + 0.01 * RATE * q))
    found = seen.moved(AskedMotion(EQUATION, (), record, slow_state(0.0), known), decay)
    ago = round(2 * cycles) / 2 * CYCLE
    assert found.release.since == pytest.approx(ago, abs=0.01 * CYCLE)
    # Most is the state itself, which is so far from where it turns.
    assert ago or np.abs(found.readings[0] - clean).max() < 1e-3 * SIZE


@pytest.mark.parametrize("since", [0, 3 * CYCLE])
def test_all_sensors_hear_other_modes_and_allow_what_is_not_known(since):
    """What is right leaves noise: chi-square is the number of samples, within four deviations."""
    seen, record, decay, clean = two_modes_cut(0.0)
    read = Readings.of(record, decay, 0.0, 1e-6)
    n = len(read.t)

    def left(motion):
        return chi_squared([left_of(seen, read, motion[:n], RATE, Beginning(since))])

    right = left(clean)
    assert abs(right - n) < 4 * np.sqrt(2 * n)
    # A gain off by a deviation, and a first mode that is as far off as the coordinate may be.
    assert left(clean * [1, 1.002]) < right + 4
    assert left(two_modes(1.005 * SIZE, decay.t, other=0.2 / 1.005)) < right + 4
    # Another mode that dies twice as fast: it is not what is not known.
    assert left(two_modes(SIZE, decay.t, damping=2 * FAST)) > right + 50
    # More of it may be: a part of 0.05, two deviations here, or any where a record was cut.
    tenth, half = (left(two_modes(SIZE, decay.t, other=x)) - right for x in (0.22, 0.3))
    assert tenth < 4 and (half < 20 if since else half > 40)


def test_where_no_explanation_comes_near_no_place_is_looked_for():
    """All sensors are asked of what leaves next to nothing of the coordinate: of nothing here."""
    best = SimpleNamespace(names=("cubic_stiffness",))
    found = SimpleNamespace(report=SimpleNamespace(best=best, verdict="unknown"), trouble="")
    seen = SimpleNamespace(shape=np.ones(2), points={"here": np.zeros(3)})
    rounds = SimpleNamespace(structure=seen, near=lambda *given: [])
    rounds._brought_nearer = lambda outcome: outcome
    assert SimulatorRounds._once_heard(rounds, found) is found


@pytest.mark.parametrize("decided", [True, False])
def test_the_coordinate_says_nothing_else_once_all_sensors_decided(decided):
    """Heard once more it would rather have a density: that stands only where nothing decided."""
    density, spring = (
        SimpleNamespace(report=SimpleNamespace(best=SimpleNamespace(names=(name,))), corrected=x)
        for name, x in (("density", 1.0), ("linear_frequency", 1.5))
    )
    rounds = SimpleNamespace(decided=decided, own_error=float)
    assert SimulatorRounds._no_nearer(rounds, density, spring, True) is decided
    nearer = SimpleNamespace(report=spring.report, corrected=1.0)
    assert not SimulatorRounds._no_nearer(rounds, nearer, spring, True)


@pytest.mark.parametrize("decided", [True, False])
def test_what_all_sensors_fitted_stays_where_it_moves_to_another_place(decided):
    """The coordinate's own look may be far off along what values do together."""
    spring = SimpleNamespace(names=("linear_frequency",), parts=("looked at",))
    found = SimpleNamespace(
        report=SimpleNamespace(best=spring, verdict="named"), trouble="", parts=("fitted",)
    )
    rounds = SimpleNamespace(
        structure=SimpleNamespace(points={"here": np.zeros(3)}),
        decided=decided,
        near=lambda *given: [spring],
        likeliest=lambda asked, heard: spring,
        next_parts=lambda parts, looked: looked,
        from_measured=lambda parts: [],
        run=lambda effects, before, parts: parts,
        _brought_nearer=lambda parts: parts,
    )

    def heard(asked, found):
        rounds.structure = "elsewhere"

    rounds._heard = heard
    now = SimulatorRounds._once_heard(rounds, found)
    assert now == (("fitted",) if decided else ("looked at",))


def _listening(monkeypatch, asked, *stated):
    """Rounds to which nothing is promising; with which values these are asked is kept."""
    rounds = SimpleNamespace(
        structure="deck", records=[SimpleNamespace(count=1000)], n_training=1, general=[]
    )
    read = SimpleNamespace(t=np.arange(1000), first=0, measured=np.ones((1000, 2)))
    rounds._read, rounds.simulate, rounds.unsure = lambda i: read, lambda *given: [], stated
    rounds._left_by = lambda *given: np.ones(2)
    rounds._fit, rounds.measured = None, [read]
    monkeypatch.setattr(simulator_rounds, "scales", lambda records: Scales(1.0, 1.0, 1.0))
    nothing_more = SimpleNamespace(promising=lambda general: [])

    def of(fit, values, begins):
        asked.extend(values)
        return nothing_more

    monkeypatch.setattr(simulator_rounds.CandidateSearch, "of", of)
    return rounds


def test_values_may_be_off_within_tolerances_beside_whatever_is_compared(monkeypatch):
    """Though none of them was told: a spring that stood for them all was 26 % too strong."""
    stated = ValueEffect("E", 2.0, Combination("E", (Stiffness(1),), (1.0,)), 0.06)
    rounds = _listening(monkeypatch, asked := [], Viscous(), stated)
    found = SimpleNamespace(
        report=SimpleNamespace(best=SimpleNamespace(effects=())), parts=(), corrected=[]
    )
    assert SimulatorRounds._compared(rounds, found, False) is found
    assert [(p.effect, p.values.tolist(), p.tolerance) for p in asked] == [(stated, [0.0], 0.06)]


@pytest.mark.parametrize("there", [True, False])
def test_what_stands_in_a_simulator_for_what_it_cannot_have_is_told(there, monkeypatch):
    """A joint that does not slip is a spring: all sensors heard the spring, and nothing better."""
    spring = Part.of(LinearFrequency(), Scales(1.0, 1.0, 1.0), 1)
    release = SimpleNamespace(_replace=lambda state: state)
    begun = SimpleNamespace(release=release, start=np.zeros(2))

    def named(*effects):
        report = SimpleNamespace(best=SimpleNamespace(effects=effects))
        return SimpleNamespace(report=report, parts=(spring,), corrected=[begun])

    found, again = named(SimpleNamespace(effect=MicroSlip())), named(spring)
    rounds = _listening(monkeypatch, [])
    rounds.run = lambda *given: again
    told = SimulatorRounds._compared(rounds, found, there)
    assert told is (found if there else again)


def rung(release, t, k=1.0):
    """A mode that stiffens and another one beside it, in one channel; ``k`` is of all springs."""
    second = 0.1 * release * np.exp(-1.2 * t) * np.cos(np.sqrt(k) * 50.0 * t)
    return motion(release, t, nothing, k * STIFFNESS, k * CUBIC / 4) + second


@pytest.mark.slow
def test_what_a_value_does_is_learnt_from_all_releases():
    """All springs together: stiffness and its cube change alike. From one release they do not."""
    simulator, t = Simulator.of(rung), T[:400]
    decays = [rs.Decay(t, rung(release, t), unit="m") for release in (0.03, 0.01)]
    options = Options((), 0.01, 1, 1e-4, 1, lambda _: None)
    on, known = _reduced(simulator, decays, {"k": 1.0}, options)
    model = known.model

    def changes(seen):
        weights = _value_effect(seen, model, "k", 0.03).direction.weights
        there = dict(zip((term.key for term in model.terms), weights, strict=True))
        return [there[key] / model.coefficients[key] for key in ("omega^2", "gamma_3")]

    assert changes(on) == pytest.approx([1.0, 1.0], abs=0.03)
    assert changes(replace(on, released=on.released[:1]))[1] > 1.5


def test_a_tone_that_the_simulator_rings_is_no_harmonic_of_hum():
    """Its half and its third were starts of hum with harmonics, where itself was none."""
    t, tone = np.arange(4000) / 200, 71.0
    x = SIZE * np.exp(-SLOW * t) * np.cos(RATE * t) + 0.02 * SIZE * np.cos(tone * t)
    x += 0.002 * SIZE * np.random.default_rng(1).standard_normal(len(t))
    records = [Record.of(rs.Decay(t, x), 1e-6)]

    def combs(*beside):
        found = screen(LINEAR, (), [Hum(beside=beside)], records).candidates
        return [e.frequency for e, _ in found if e.harmonics > 1]

    assert any(tone / f == pytest.approx(round(tone / f), abs=1e-3) for f in combs())
    assert combs(tone) == []


def test_values_that_do_the_same_stay_where_they_were_simulated():
    """Two that only their difference tells: a prior around zero would take both back."""
    t, omega2 = np.arange(2000) / 200, LINEAR.coefficients["omega^2"]
    both = [
        ValueEffect(name, 1.0, Combination(name, (Stiffness(1),), (x * omega2,)), 0.03)
        for name, x in (("modulus", 1.0), ("density", -1.0))
    ]
    parts = [Part.of(effect, Scales(SIZE, RATE, 10.0), 1) for effect in both]
    x = SIZE * np.exp(-SLOW * t) * np.cos(np.sqrt(1.05 * omega2 - SLOW**2) * t)
    seen = [Record.of(rs.Decay(t, x), 1e-6)]
    there = [replace(p, near=x) for p, x in zip(parts, (0.3, 0.25), strict=True)]
    stay, taken_back = (fit(LINEAR, given, seen, iterations=30).parts for given in (there, parts))
    assert [p.values[0] for p in stay] == pytest.approx([0.3, 0.25], abs=2e-3)
    assert [p.values[0] for p in taken_back] == pytest.approx([0.025, -0.025], abs=2e-3)


def test_an_exponent_that_is_held_in_what_was_found_is_held_in_the_simulator():
    """Left free in what the simulator does, it wanders, and the strength with it."""
    free = Part.of(Stop(1), Scales(SIZE, RATE, 10.0), 1, start=(0.01, 1.1))
    free = free.moved(np.array([40.0, 0.0, 0.0]))
    held = with_textbook_exponent(free.moved(np.array([5.0, 1e-4, 0.0])))
    structure = SimpleNamespace(with_effects=tuple)
    own = (free.moved(np.array([-1.0, 0, 0])),)
    rounds = SimpleNamespace(structure=structure, own=own, known={})
    (found,) = SimulatorRounds.next_parts(rounds, (free,), (held,))
    # In the simulator it is so many times as strong as in its equation, a value so much larger.
    assert found.values == pytest.approx([45.0 * 40.0 / 39.0, 0.0101, 1.0], rel=1e-12)
    assert found.moved(np.array([0.0, 0.0, 0.1])).values[-1] == 1.0


# -- a force as code -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "law",
    [DryFriction().term().regularised(0.01), AirDrag().term(), CubicStiffness().term()],
    ids=lambda law: law.key,
)
def test_code_of_a_force_is_the_force(law):
    force = LawForce(((law, 3.0), (Stop(1).term(), 40.0)), 0.35, 1.5)
    space: dict = {}
    exec(force.code("py"), space)
    for x, v in [(0.02, 0.3), (-0.05, 0.02), (0.0, -0.7)]:
        assert space["force"](0.0, x, v) == pytest.approx(force(0.0, x, v), rel=1e-12)
    assert "pow" in force.code("c") or "tanh" in force.code("c") or "fabs" in force.code("c")
    with pytest.raises(ValueError, match="language = 'f90' must be one of"):
        force.code("f90")


def test_every_language_has_the_zero_force():
    for language in LANGUAGES:
        assert "force" in LawForce((), 1.0).code(language)


# -- programs --------------------------------------------------------------------------------------

SCRIPT = """
import sys
import numpy as np
release, out, duration, step, k = float(sys.argv[1]), sys.argv[2], *map(float, sys.argv[3:6])
t = np.arange(0, duration + step / 2, step)
x = release * np.exp(-0.1 * t) * np.cos(np.sqrt(k) * t)
np.savetxt(out, np.c_[t, x, 0.5 * x], delimiter=",", header="time [s],a [m],b [m]", comments="")
"""


def test_a_program_gives_what_it_writes(tmp_path):
    script = tmp_path / "model.py"
    script.write_text(SCRIPT)
    command = f"{sys.executable} {script} {{release}} {{out}} {{duration}} {{step}} {{k}}"
    program = Program(command, tmp_path / "runs")
    assert program.takes_values == ("k",) and not program.takes_force
    t = np.arange(200) / 100
    x = Simulator.of(program).decay(0.3, t, 2, values={"k": 100.0}).displacements
    exact = 0.3 * np.exp(-0.1 * t) * np.cos(10 * t)
    assert np.allclose(x, np.stack([exact, 0.5 * exact], axis=1), atol=1e-12)
    assert (tmp_path / "runs/run_001/command.txt").read_text().split()[2] == "0.3"
    program.simulate(0.2, t, k=100.0)
    assert (tmp_path / "runs/run_002/out.csv").exists()  # the first run stays


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("raise SystemExit('no licence')", "it ended with 1 and said:\nno licence"),
        ("pass", "it wrote no file out.csv"),
        ("import time; time.sleep(60)", "it did not end within 0.2 s"),
        ("import sys; open(sys.argv[2], 'w').write('nonsense')", "what it wrote cannot be read"),
    ],
)
def test_a_program_that_fails_is_told_with_its_folder(tmp_path, code, message):
    script = tmp_path / "model.py"
    script.write_text(code)
    limit = 0.2 if "sleep" in code else 60.0
    program = Program(f"{sys.executable} {script} {{release}} {{out}}", tmp_path / "runs", limit)
    with pytest.raises(SimulatorError, match=f"(?s)run_001.*{message}"):
        program.simulate(0.1, np.arange(100) / 100)


def test_commands_that_cannot_be_run_are_refused(tmp_path):
    for command, needed in [("octave model.m {out}", "release"), ("octave m.m {release}", "out")]:
        with pytest.raises(ValueError, match=f"has no {{{needed}}}: write it where"):
            Program(command)
    with pytest.raises(ValueError, match="time_limit = 0 must be positive"):
        Program("a {release} {out}", time_limit=0)
    unknown = Program("a {release} {out} {k}", tmp_path)
    with pytest.raises(SimulatorError, match=r"nothing is known for {k}; name it among"):
        unknown.simulate(0.1, np.arange(10) / 10)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--simulator", "a {out}"], "has no {release}: write it where"),
        (["--simulator", "a {release} {out}", "--model", "m.json"], "name one of --simulated"),
        (["--simulator", "a {release} {out}", "--parameter", "k"], "'k' is not NAME=VALUE"),
        (["--model", "m.json", "--parameter", "k=1"], "--parameter is a value of a program"),
        (["--simulator", "a {release} {out}", "--parameter", "k=1:0.1"], "takes nothing beside"),
        (["--simulator", "no_such_program {release} {out}"], "there is no program"),
    ],
)
def test_the_command_refuses_what_is_no_program(tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.json").write_text('{"coefficients": {"omega^2": 228.0}, "unit": "m"}')
    decay = record(0.03, 0)
    table = np.c_[decay.t, decay.q]
    np.savetxt("d.csv", table, delimiter=",", header="time [s],x [m]", comments="")
    done = CliRunner().invoke(main, ["diagnose", "--measured", "d.csv", *options])
    assert done.exit_code == 2 and message in done.output
    assert np.allclose(np.loadtxt("d.csv", delimiter=",", skiprows=1), table)  # it is as it was


# -- what is missing, and the simulator with it ----------------------------------------------------


ASKED: list[float] = []


def friction(t, x, v):
    return -FRICTION * np.tanh(v / 1e-4)


@cache  # several tests look at the same diagnosis
def rubbing():
    def rubs(release, t, force=nothing):
        ASKED.append(release)
        return motion(release, t, force)

    ASKED.clear()
    measured = record(0.03, 1, friction)
    return rs.diagnose(rubs, measured, catalogue=[DryFriction(), AirDrag()])


@pytest.mark.slow
def test_friction_is_named_and_put_into_the_simulator():
    report = rubbing()
    assert report.verdict == "named" and report.names == ("dry_friction",)
    assert report.force(0.0, 0.01, 0.2) == pytest.approx(-FRICTION, rel=0.01)
    (sensor,) = report.sensor_errors
    assert sensor.before > 20 and sensor.after < 1.1
    assert report.seen.scale.mass == pytest.approx(MASS, rel=1e-3)
    assert "Added to rubs: the force" in report.sentence
    # The simulator with the code of the report follows another run, from elsewhere.
    there = motion(0.02, T, friction)
    space: dict = {}
    exec(report.force.code("py"), space)
    assert np.std(motion(0.02, T, space["force"]) - there) < 0.01 * np.std(there)
    assert np.std(motion(0.02, T, nothing) - there) > 0.1 * np.std(there)


def test_what_the_simulator_was_asked_is_told():
    """All that it was let go from, but for the one that was asked twice."""
    sentence = rubbing().sentence
    least, most = min(ASKED), max(ASKED)
    said = f"Simulator: {len(ASKED) - 1} decays from {least:.3g} to {most:.3g} m; its equation of"
    (line,) = (x for x in sentence.splitlines() if x.startswith("Simulator: "))
    assert line.startswith(said) and line.endswith("was taken off.")


def test_what_explains_nothing_is_in_no_recipe():
    """The sentence told that nothing explains it, and the recipe what the simulator lacks."""
    reduced = replace(rubbing().reduced, verdict="unknown")
    no_nearer = replace(reduced, gap=reduced.gap.unchanged())
    report = replace(rubbing(), reduced=no_nearer, parts=())
    assert "Missing: nothing in the catalogue explains it.\n" in report.sentence
    assert "friction" not in report.sentence and "Not added" not in report.sentence
    assert report.force is None and "friction" not in report.recipe
    assert report.recipe.startswith("the simulator as it was: nothing in the catalogue explains")
    assert Outcome(no_nearer, rubbing().parts, []).or_before(["before"])[1:3] == ((), ["before"])
    assert Outcome(reduced, rubbing().parts, []).or_before(["before"]).parts == rubbing().parts


def test_where_it_is_taken_to_act_is_told_where_points_could_tell():
    """One sensor tells no place; a simulator that offers no points has its own."""
    usual = rubbing()
    offers = replace(usual.seen.simulator, simulate=_Bar().simulate)
    report = replace(usual, seen=replace(usual.seen, simulator=offers))
    assert "Place: it is taken to act at here; sensors at several points" in report.sentence
    assert "Place:" not in usual.sentence


@pytest.mark.slow
def test_a_simulator_without_a_force_has_its_equation_instead():
    def stop(t, x, v):
        return -60 * max(x - 0.02, 0.0)

    report = rs.diagnose(lambda release, t: motion(release, t, nothing), record(0.03, 1, stop))
    assert report.names == ("stop",) and report.force is None and not report.parts
    (effect,) = report.effects
    assert effect.values["gap"] == pytest.approx(0.02, abs=3 * effect.standard_errors["gap"])
    assert effect.values["strength"] == pytest.approx(60 / MASS, rel=0.03)
    assert "it takes no force" in report.sentence and "k_above" in report.recipe


@pytest.mark.slow
def test_a_value_of_the_simulator_follows_within_its_tolerance():
    records = [record(0.03, 1, k=81.5), record(0.02, 2, k=81.5)]
    report = rs.diagnose(simulate, records, parameters={"k": (STIFFNESS, 0.03)})
    assert report.values["k"] == pytest.approx(81.5, abs=0.02)
    assert "Within its tolerance k is 81.5" in report.sentence
    assert report.sensor_errors[0].after < 1.1


@pytest.mark.slow
def test_a_simulator_that_is_right_lacks_nothing():
    records = [record(0.03, 3), record(0.02, 4)]
    report = rs.diagnose(simulate, records)
    assert report.verdict == "none" and not report.effects


@pytest.mark.slow
class _Knowing:
    """The oscillator, and of what it is a mode: of a structure with another one, seldom rung."""

    mode_frequencies = (np.sqrt(STIFFNESS / MASS), OTHER)

    def simulate(self, release, t, force=nothing):
        return simulate(release, t, force)


def test_frequencies_of_modes_are_positive():
    known = _Knowing()
    known.mode_frequencies = (0.0, OTHER)
    with pytest.raises(ValueError, match=r"mode_frequencies of _Knowing .* must be positive"):
        rs.diagnose(known, record(0.03, 11, t=T[:600]), catalogue=[Hum()])


@pytest.mark.slow
@pytest.mark.parametrize("given", [simulate, _Knowing()])
def test_what_rings_at_a_mode_that_the_simulator_knows_is_nothing_else(given):
    """A tenth of the motion, which dies in two seconds: of others it is a second mode."""
    t = T[:1000]
    rung = 3e-3 * np.exp(-0.5 * t) * np.cos(1.02 * OTHER * t)
    measured = rs.Decay(t, record(0.03, 11, t=t).q + rung, unit="m")
    report = rs.diagnose(given, measured, catalogue=[Hum(), SecondMode()])
    assert (report.names == ("second_mode",)) == (given is simulate), str(report)


def test_nothing_is_added_that_makes_a_simulator_worse():
    """Forces that no effect of the catalogue is: what comes nearest stays out of the simulator."""
    measured = record(0.03, 1, lambda t, x, v: -0.15 * np.sin(40 * x / 0.03))
    report = rs.diagnose(simulate, measured, catalogue=[AirDrag()])
    (sensor,) = report.sensor_errors
    assert report.verdict == "unknown" and sensor.after <= sensor.before
    assert report.force is None and "dded to" not in report.sentence
    assert "Next: " in report.sentence and "not in the simulator" not in report.recipe


@pytest.mark.slow
def test_all_channels_tell_a_dashpot_from_damping_of_the_structure():
    """Along the slow mode of two masses they are the same; the other mode dies otherwise."""
    springs = 80.0 * np.array([[6.0, -5.0], [-5.0, 5.0]])

    def simulate(release, t, force=nothing, eta=1e-3):
        inverse = np.diag([1 / 0.2, 1 / 0.15])  # kg

        def rates(s, y):
            push = -springs @ (y[:2] + eta * y[2:]) + np.array([0.0, force(s, y[1], y[3])])
            return np.concatenate([y[2:], inverse @ push])

        held = np.linalg.solve(springs, [0.0, 1.0])
        start = np.append(release * held / held[1], [0.0, 0.0])
        done = solve_ivp(rates, (0, t[-1]), start, t_eval=t, rtol=1e-7, atol=1e-9)
        return done.y[1::-1].T

    def measured(**given):
        x = simulate(0.03, T[:1600], **given)
        noise = 0.01 * x.std(axis=0) * np.random.default_rng(6).standard_normal(x.shape)
        return rs.Decay(T[:1600], x + noise, unit="m")

    for decay, name in [
        (measured(force=lambda t, x, v: -0.01 * v), "viscous"),
        (measured(eta=1.5e-3), "eta"),
    ]:
        report = rs.diagnose(simulate, decay, catalogue=[Viscous()], parameters={"eta": 1e-3})
        assert report.verdict == "named" and report.names == (name,)
        assert max(e.after for e in report.sensor_errors) < 1.1


@pytest.mark.parametrize(
    "given",
    [
        lambda release, t: np.full(len(t), release),
        lambda release, t: release * np.exp(-30 * t),
        lambda release, t: release * np.exp(0.1 * t) * np.cos(15 * t),
    ],
)
def test_a_simulator_that_gives_no_decay_is_told_as_the_simulator(given):
    """Nothing is wrong in the record, which a message without a name seemed to say."""
    with pytest.raises(ValueError, match=r"what simulator .* gives, released from .*, is no free"):
        rs.diagnose(given, record(0.05, 1))


# -- two masses in a row: what all sensors tell, and one mode does not ---------------------------


def chain(release, t, k1=900.0, k2=1500.0, c1=0.15, m2=0.8):
    """Two masses, 1.2 and m2 kg, let go from a pull at the second: exact, by eigenvectors."""
    x = np.array([1 / k1, 1 / k1 + 1 / k2])
    rates = np.zeros((4, 4))
    rates[:2, 2:] = np.eye(2)
    rates[2] = np.array([-k1 - k2, k2, -c1 - 0.2, 0.2]) / 1.2
    rates[3] = np.array([k2, -k2, 0.2, -0.2]) / m2
    values, vectors = np.linalg.eig(rates)
    start = np.linalg.solve(vectors, np.concatenate([x * release / x[0], [0.0, 0.0]]))
    return ((np.exp(np.outer(t - t[0], values)) * start) @ vectors.T).real[:, :2]


CHAIN_T = np.arange(5000) / 250


def chain_record(seed, **values):
    """At 40 dB, in mm."""
    x = chain(20.0, CHAIN_T, **values)
    noise = 0.01 * x.std(axis=0) * np.random.default_rng(seed).standard_normal(x.shape)
    return rs.Decay(CHAIN_T, x + noise, unit="mm")


@pytest.mark.slow
def test_all_sensors_tell_values_that_the_first_mode_does_not():
    """Stiffnesses 2 and -3 % off: one frequency has many such pairs, both modes have this one.

    Within three standard errors of the truth, which are a part of the tolerances.
    """
    truth = {"k1": 918.0, "k2": 1455.0, "c1": 0.165}
    given = {"k1": (900.0, 0.03), "k2": (1500.0, 0.03), "c1": (0.15, 0.1)}
    report = rs.diagnose(chain, chain_record(22, **truth), parameters=given)
    assert report.verdict == "none"
    assert max(e.after for e in report.sensor_errors) < 1.1
    best = report.reduced.best
    rows = zip(best.parts, best.solution.slices(), strict=True)
    found = {
        p.effect.name: (p.values[0], best.covariance[own, own][0, 0] ** 0.5) for p, own in rows
    }
    for name, value in truth.items():
        change, error = found[name]
        assert abs(given[name][0] + change - value) < 3 * error
        assert error < 0.15 * given[name][0] * given[name][1]


@pytest.mark.slow
def test_a_value_without_tolerance_is_told_where_others_leave_more_than_noise():
    """The second mass is 7 % heavier: two stiffnesses within 2 % follow the first mode as well."""
    given = {"k1": (900.0, 0.02), "k2": (1500.0, 0.02), "m2": 0.8}
    report = rs.diagnose(chain, chain_record(23, m2=0.856), parameters=given)
    assert report.verdict == "named" and report.reduced.best.names == ("m2",)
    (effect,) = report.effects
    assert abs(effect.values["strength"] - 0.056) < 3 * effect.standard_errors["strength"] < 0.006
    assert str(effect).startswith("m2 ") and "% higher than assumed" in str(effect)
    assert max(e.after for e in report.sensor_errors) < 1.1


class Clamped:
    """A chain whose first spring is a clamp that may give way, by so many m for each N."""

    steps: ClassVar = {"give": 2e-5}

    def simulate(self, release, t, give=0.0, k2=1500.0):
        return chain(release, t, k1=1 / (1 / 900 + give), k2=k2)


@pytest.mark.study
@pytest.mark.slow
def test_what_there_can_be_no_simulator_with_gives_way_to_what_there_can():
    """A clamp is softer by a fifth. To first order the other spring would be negative for that."""
    give = 1 / 700 - 1 / 900
    report = rs.diagnose(
        Clamped(), chain_record(31, k1=700.0), parameters={"give": 0.0, "k2": 1500.0}
    )
    assert report.verdict == "named" and report.reduced.best.names == ("give",)
    assert report.values == pytest.approx({"give": give, "k2": 1500.0}, rel=1e-3)
    assert max(e.after for e in report.sensor_errors) < 1.1


class Interpolated:
    """A stiffness that is taken 0.1 % too high, but near one at which it was asked to be right."""

    def __init__(self, right=None):
        self.right = right

    def simulate(self, release, t, k=STIFFNESS):
        off = 1e-3 if self.right is None else 0.02 * abs(k / self.right - 1)
        return simulate(release, t, k=k * (1 + off))

    def right_at(self, values):
        if values["k"] < 0:
            raise ValueError("there is no such deck")
        return Interpolated(values["k"])


def test_a_simulator_is_asked_to_be_exact_at_values():
    """Most need not; what cannot be asked at some values stays what it is."""
    right = Simulator.of(Interpolated()).right_at({"k": 81.5})
    t = times(1.0, 0.005, 15.0)
    assert np.array_equal(right.simulate(0.03, t, k=81.5), simulate(0.03, t, k=81.5))
    assert Simulator.of(Interpolated()).right_at({"k": -1.0}) is None
    assert Simulator.of(simulate).right_at({"k": 81.5}) is None


@pytest.mark.study
@pytest.mark.slow
def test_values_are_found_again_with_a_simulator_that_is_exact_there():
    """A thousandth of the stiffness, which is many standard errors, is not left in the value."""
    records = [record(0.03, 1, k=81.5), record(0.02, 2, k=81.5)]
    given = {"parameters": {"k": (STIFFNESS, 0.03)}, "catalogue": []}
    report = rs.diagnose(Interpolated(), records, **given)
    best, effect = report.reduced.best, report.parts[0].effect
    assert effect.name == "k" and report.values["k"] == pytest.approx(81.5, abs=0.01)
    assert np.sqrt(best.covariance[0, 0]) < 0.01
    assert report.sensor_errors[0].after < 1.1


@pytest.mark.parametrize("n_sensors", [2, 3])
def test_other_modes_do_not_show_in_the_coordinate(n_sensors):
    """Two modes with known shapes ring in some channels: the weights see one and not the other."""
    first, second = np.array([1.0, 0.3, 0.1])[:n_sensors], np.array([1.0, -0.7, 0.6])[:n_sensors]
    t = np.arange(2500) / 500
    waves = [a * np.exp(-0.2 * t) * np.cos(w * t) for a, w in ((1.0, 50), (0.2, 330))]
    shape, reading = _shape(np.outer(waves[0], first) + np.outer(waves[1], second))
    # The two are uncorrelated over many cycles but for the part of one at either end.
    assert shape == pytest.approx(first, abs=0.01)
    assert reading @ first == pytest.approx(1.0, abs=0.01) and abs(reading @ second) < 0.01


def test_channels_that_move_as_one_are_read_by_least_squares():
    t = np.arange(2500) / 500
    shape, reading = _shape(np.outer(np.cos(50 * t), [1.0, 0.5]))
    assert shape == pytest.approx([1.0, 0.5]) and reading == pytest.approx([0.8, 0.4])


def test_a_simulator_of_other_units_is_told_by_its_frequency():
    """Newtons per millimetre that stand for newtons per metre: 32 times as fast."""

    def stiff(release, t, force=nothing):
        return motion(release, t, force, 1000 * STIFFNESS)

    # A linear record and its simulator have 2.41 and 76 Hz; what bends stays small.
    decay = rs.Decay(T, motion(1e-4, T, nothing), unit="m")
    with pytest.raises(ValueError, match=r"vibrates at about 76\.1 Hz, the records at 2\.41 Hz"):
        rs.diagnose(stiff, decay)


def test_what_does_ever_less_the_more_there_is_of_it_is_found_in_few_rounds():
    """A clamp whose equation needs its cube root: of 8 that was found 512 must be there."""
    clamp = ValueEffect("clamp", 0.0, Combination("clamp", (Stiffness(1),), (-1.0,)), size=1.0)
    found = Part.of(clamp, Scales(SIZE, RATE, 10.0), 1).moved(np.array([8.0]))
    rounds = SimpleNamespace(structure=SimpleNamespace(with_effects=tuple), own=(), known={})
    there, seen = (found,), []
    for _ in range(5):
        rounds.own = (found.moved(np.cbrt(there[0].values) - found.values),)
        there = SimulatorRounds.next_parts(rounds, there, (found,))
        seen.append(float(there[0].values[0]))
    # A factor at first, then by the power that it had; by five times at the most.
    assert seen == pytest.approx([32.0, 160.0, 512.0, 512.0, 512.0])


def test_what_changes_its_sign_changes_by_a_difference():
    """Of -2 that was found the equation has 1 for the 3 in the simulator."""
    free = Part.of(Viscous(), Scales(SIZE, RATE, 10.0), 1)
    found, own, there = (free.moved(np.array([x])) for x in (-2.0, 1.0, 3.0))
    rounds = SimpleNamespace(structure=SimpleNamespace(with_effects=tuple), own=(own,), known={})
    (after,) = SimulatorRounds.next_parts(rounds, (there,), (found,))
    assert after.values == pytest.approx([0.0])


@pytest.mark.parametrize("off, verdict", [(1.004, "none"), (1.06, "unknown")])
def test_what_is_wrong_with_another_mode_alone_is_not_nothing(off, verdict):
    """Two modes in closed form; of the second the simulator has another frequency.

    Four thousandths, two standard deviations of what is known, may be a repeat; six hundredths
    are a wrong mode.
    """
    shapes = np.array([[1.0, 0.7, 1.2], [0.0, 0.3, -0.15]])

    def two_modes(release, t, off=1.0):
        omega = np.array([30.0, 81.0 * off])
        angle = np.outer(t, omega)
        return release * (np.exp(-0.01 * angle) * np.cos(angle)) @ shapes

    t, rng = np.arange(0, 6, 0.005), np.random.default_rng(4)
    moved = [two_modes(release, t, off) for release in (0.02, 0.012)]
    noise = [0.01 * np.std(x, axis=0) * rng.standard_normal(x.shape) for x in moved]
    decays = [rs.Decay(t, x + e, unit="m") for x, e in zip(moved, noise, strict=True)]
    report = rs.diagnose(lambda release, t: two_modes(release, t), decays)
    assert report.verdict == verdict and report.names == () == report.parts
    worst = max(report.sensor_errors, key=lambda e: e.after)
    assert worst.label == "channel 2" and worst.part > 0.05 and worst.after > 5
