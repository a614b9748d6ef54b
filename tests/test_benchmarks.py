"""The benchmarks' own functions: their measures against values by hand, and small runs of them."""

from __future__ import annotations

import importlib
import shutil
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

import romsindy as rs
from romsindy.fit.kernel.collocation import TrajectoryError
from romsindy.fit.records.arguments import small_frequencies
from romsindy.physics.example import EXAMPLE_MODEL
from romsindy.physics.term import law_called
from romsindy.record.ringing import tones_of
from romsindy.regression.projection import HarmonicRows

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"


@pytest.fixture
def benchmark(request):
    """A benchmark as a module, among its neighbours."""
    if request.param.startswith("exudyn"):
        pytest.importorskip("exudyn")
    folders = [str(BENCHMARKS), str(BENCHMARKS / "diagnosis")]
    sys.path[:0] = folders
    try:
        yield importlib.import_module(request.param)
    finally:
        sys.path[:] = [p for p in sys.path if p not in folders]


def benchmark_of(name):
    return pytest.mark.parametrize("benchmark", [name], indirect=True)


@benchmark_of("continuation")
def test_small_benchmark_of_continuation(benchmark):
    rows = benchmark.duffing(repeats=1) | benchmark.icrom(repeats=1)
    for name, row in rows.items():
        assert row.error <= 1e-9 or not name.endswith(("by themselves", "21", "41")), name
    for peer in (benchmark.auto_07p(20, repeats=1), benchmark.pycont_lite(repeats=1)):
        assert peer is None or peer.error < 1e-3


@pytest.mark.slow
@benchmark_of("identification")
def test_small_benchmark(benchmark):
    """The benchmark's own functions, on fewer seeds: every number asked for is reached."""
    tables = benchmark.oscillator([5]) | benchmark.extracted([0]) | benchmark.plain_sindy()
    for name, (number, asked) in tables.items():
        assert number <= asked, name


@pytest.mark.slow
@benchmark_of("dry_friction")
def test_friction_under_a_force_is_chosen_and_held_by_its_interval(benchmark):
    """75 cycles of a multisine, by a simulator that shares nothing with the package."""
    record, truth = benchmark.driven(1, n=1500)
    fit = rs.identify(record, order=3)
    assert {*fit.model.coefficients} == {*truth, "gain [force]"}
    for name, value in truth.items():
        low, high = fit.interval(name)
        assert low <= value <= high, name


@pytest.mark.slow
@benchmark_of("dry_friction")
def test_friction_under_a_multisine_is_followed_by_one_simulation(benchmark):
    """Steps across its jump went round, and the fit fell back to pieces of forty cycles."""
    record, truth = benchmark.driven(3007, n=2500)
    fit = rs.identify(record, terms=[law_called(name) for name in truth])
    assert fit.verdict.piece == 0 and fit.verdict.explained
    for name, value in truth.items():
        low, high = fit.interval(name)
        assert low <= value <= high, name


@pytest.mark.slow
@benchmark_of("dry_friction")
def test_small_benchmark_of_dry_friction_in_one_of_two_modes(benchmark):
    _, _, missing, false, holds, _ = benchmark.trial("coupled", 2)
    assert not missing and not false and all(holds.values())


@benchmark_of("dry_friction")
def test_the_benchmark_of_dry_friction_stops_by_its_closed_form(benchmark):
    """Friction f takes 2 f / omega^2 from the amplitude in every half cycle, and then holds."""
    omega, f = 2.0, 0.3
    t = np.linspace(0, 4 * np.pi / omega, 401)
    q = benchmark.strokes(lambda s, q, v: -(omega**2) * q, np.array([f]), [1.0, 0.0], t)[:, 0]
    fall = 2 * f / omega**2
    assert q[100::100] == pytest.approx([-1 + fall, 1 - 2 * fall, -1 + 3 * fall, 1 - 4 * fall])
    held = benchmark.strokes(lambda s, q, v: -(omega**2) * q, np.array([f]), [0.07, 0.0], t)
    assert np.all(held == 0.07)  # 0.28 of 0.3


@pytest.mark.slow
@benchmark_of("kinetic_coupling")
def test_small_benchmark_of_kinetic_coupling(benchmark):
    _, missing, false, holds, _ = benchmark.trial(100)
    # Of 15 intervals of 95 % three or more fail in 4 %.
    assert not missing and not false and sum(holds.values()) >= 13


@benchmark_of("kinetic_coupling")
def test_the_benchmark_of_kinetic_coupling_moves_as_its_coefficients_say(benchmark):
    """Lagrange's equations with the fast mode itself, and those of the six products of inertia."""
    system, _, _ = benchmark.drawn(3)
    model = rs.CoupledModel.from_coefficients(benchmark.coefficients(system))
    t = np.linspace(0, 1, 200)
    theirs = benchmark.simulated(system, [0.8, 0.7], t)
    np.testing.assert_allclose(model.simulate([0.8, 0.7], [0, 0], t).q, theirs, atol=1e-7)


@pytest.mark.slow
@benchmark_of("curved_sensor")
def test_small_benchmark_of_a_curved_sensor(benchmark):
    one = benchmark.trial(3, cycles=40.0)
    assert not one.asked and one.structure == "stiffness polynomial"
    y = benchmark.read_motion(3, inertia=0.2, cycles=5.0).signal
    assert np.isfinite(y).all() and len(y) > 100


@benchmark_of("backbone")
def test_backbones_of_decays_that_start_fast(benchmark):
    """Drag, friction and an acceleration: bars hold the truth, and the first cycles have no bias.

    Neighbouring cycles err alike: a decay is worth some five of them, and five draws some 25, of
    which 95 % less three standard errors are 82 %.
    """
    shapes = {
        ("displacement", 12.0, 40.0): benchmark.Oscillator(drag=0.07, cube=0.2),
        ("displacement", 9.0, 50.0): benchmark.Oscillator(friction=0.011, square=0.1),
        ("acceleration", 12.0, 50.0): benchmark.Oscillator(viscous=0.02),
    }
    for (quantity, cycles, snr_db), shape in shapes.items():
        case = benchmark.decayed("", shape, quantity, cycles, snr_db)
        score = benchmark.score(case, 5, 0)
        assert score.lost == 0
        assert benchmark.within(score.frequency) > 82, quantity
        assert benchmark.within(score.damping) > 82, quantity
        # Two per cent are asked for, beside what five draws know.
        assert np.all(np.abs(score.bias) < 0.02 + 2 * score.bias_std), quantity


@benchmark_of("bands")
def test_a_band_that_is_known(benchmark):
    low, high = np.array([0.0, 0.0, 0.0]), np.array([1.0, 2.0, 3.0])
    truth = np.array([0.5, 2.5, -0.25])
    assert benchmark.holds(low, high, truth).tolist() == [True, False, False]
    # Widths 1, 2, 3; the truth is 0.5 and 0.25 outside, and a unit costs 2 / 0.05 = 40.
    expected = ((1 + 0) + (2 + 20) + (3 + 10)) / 3
    assert benchmark.interval_score(low, high, truth) == pytest.approx(expected)
    assert benchmark.half_width(1.0, 3.0, -4.0) == pytest.approx(25.0)


@benchmark_of("bands")
def test_quantiles_have_the_best_interval_score(benchmark):
    """For a standard normal truth the score of +-z is least at z = 1.96."""
    truth = np.random.default_rng(0).standard_normal(200_000)
    z = np.linspace(1.6, 2.4, 9)
    scores = [benchmark.interval_score(-x, x, truth) for x in z]
    # 200,000 draws tell neighbours 0.1 apart, whose scores differ by 0.2 %.
    assert abs(z[np.argmin(scores)] - 1.96) < 0.1


@benchmark_of("bands")
def test_bootstrap_over_cycles_gives_standard_errors(benchmark):
    """Rows with independent errors: the closed form s^2 (X'X)^-1 of least squares."""
    rng, cycles, noise = np.random.default_rng(1), 400, 0.1
    x = rng.standard_normal((3 * cycles, 2)) * [1.0, 5.0]
    y = x @ [2.0, -3.0] + noise * rng.standard_normal(len(x))
    cycle, harmonic = np.divmod(np.arange(len(x)), 3)
    rows = HarmonicRows(x, y, cycle, harmonic, np.ones(cycles), np.ones(len(x)))
    exact = noise * np.sqrt(np.diag(np.linalg.inv(x.T @ x)))
    found = benchmark.resampled(rows).std(axis=0)
    # 200 repetitions know a standard deviation to 5 %, 400 cycles to another 4 %.
    np.testing.assert_allclose(found, exact, rtol=0.2)


@benchmark_of("known_beams")
def test_truth_of_the_benchmark_from_a_polynomial(benchmark):
    """h = 2 q^2 + 3 q^3 + 5 q^4 has Upsilon_3 = 2; K/q = 7 + q has omega^2 = 7."""
    q = np.linspace(-1.1, 1.1, 41)
    decay = rs.Decay(np.arange(9.0), np.linspace(1.0, -0.5, 9))
    known = benchmark.KnownDecay(decay, q, 2 * q**2 + 3 * q**3 + 5 * q**4, 7 + q)
    # Cubic splines on 41 nodes follow q^4 to some 1e-5.
    assert known.coefficients == pytest.approx({"omega^2": 7.0, "Upsilon_3": 2.0}, abs=1e-3)
    assert known.points.min() == pytest.approx(-0.5) and len(known.points) == 9 + 18


@benchmark_of("known_beams")
def test_arrays_are_made_once(benchmark, tmp_path):
    made = []

    def make():
        made.append(1)
        return {"x": np.array([1.0, 2.0])}

    for _ in range(2):
        assert benchmark.cached(tmp_path / "new", "beam", make)["x"].tolist() == [1.0, 2.0]
    assert len(made) == 1


@pytest.mark.slow
@benchmark_of("trials")
def test_a_trial_on_a_few_cycles(benchmark):
    """All rows of one noise come out, and its bands hold what an exact structure determines."""
    model = EXAMPLE_MODEL
    q = np.linspace(-2.0, 2.0, 81)
    away = np.where(q == 0, 1e-9, q)
    clean = rs.example_decay(periods=15, samples=40)
    known = benchmark.KnownDecay(clean, q, model.inertia(q) - 1, model.stiffness(away) / away)
    trial = benchmark.trial(known, 40.0, 3)
    assert min(trial.least_h) >= 0
    for name in ("h", "K/q", "omega^2", "Upsilon_3"):
        assert np.all(np.isfinite(trial.half_widths[name])), name
        # 95 % bands of one seed go together: half of the points is far below what chance leaves.
        assert np.mean(trial.holds[name]) > 0.5, name
    rows = list(benchmark.summary([trial], "oscillator", 40.0))
    assert len(rows) == 13
    assert not any("nan" in measured for _, measured, _ in rows)


@benchmark_of("trials")
def test_failed_identifications_are_counted(benchmark):
    def fails_at_two(seed):
        if seed == 2:
            raise TrajectoryError("lost")
        return seed

    found, row = benchmark.attempted(fails_at_two, range(4), 1, "this")
    assert found == [0, 1, 3] and row == ("this: identifications that fail", "1 of 4", "0")


@pytest.mark.slow
@benchmark_of("releases")
def test_random_releases_are_counted(benchmark):
    """Of a hundred 94 are counted right, nearly all that are not at 10 dB."""
    trials = [t for t in map(benchmark.trial, range(8)) if t.snr_db > 10]
    counts = [(t.found(), len(t.blows)) for t in trials]
    assert len(counts) >= 4
    assert sum(found == (blows, 0) for found, blows in counts) >= len(counts) - 1


@pytest.mark.slow
@benchmark_of("defects")
def test_small_benchmark_of_defects(benchmark):
    """One decay: what was put on it is named, and the backbone holds as that without it does."""
    for name in ("one second of zeros", "spike", "hum of 60 Hz", "offset of 1000"):
        trial = benchmark.trial(101, name)
        assert trial.named and not trial.refusal, name
        # 95 % is expected of many decays; of one, a dozen neighbours go wrong together.
        assert trial.inside["frequency"] > 0.6 and trial.wider["frequency"] < 3, name


@benchmark_of("hidden")
def test_strength_of_a_hidden_effect(benchmark):
    """Closed forms along cos t: q^3 shifts by 3/8, friction damps by 2/pi, Maxwell both."""
    shift, ratio = benchmark.harmonic(lambda q, v, z: q**3)
    assert (shift, ratio) == pytest.approx((3 / 8, 0.0), abs=1e-12)
    # 512 points catch the jump of the sign to 1 / 512^2
    ratio = benchmark.harmonic(lambda q, v, z: np.sign(v))[1]
    assert ratio == pytest.approx(2 / np.pi, rel=1e-5)
    # k i w / (1/tau + i w) at w = tau = 1 is (1 + i) / 2; the start dies with exp(-6 pi)
    both = benchmark.harmonic(lambda q, v, z: z[0], lambda q, v, z: [v - z[0]], 1)
    assert both == pytest.approx((1 / 4, 1 / 4), rel=1e-4)


@benchmark_of("oscillator")
def test_motion_of_the_generator(benchmark):
    """A linear oscillator in closed form; dry friction F lowers each turning point by 2 F."""
    zeta, t = 0.02, np.linspace(0, 60, 1201)
    linear = benchmark.Nominal(zeta, (0.0,) * 4, (0.0,) * 3)
    damped = np.sqrt(1 - zeta**2)
    exact = np.exp(-zeta * t) * (np.cos(damped * t) + zeta / damped * np.sin(damped * t))
    q, _, a = benchmark.motion(linear, [], t, 1.0)
    np.testing.assert_allclose(q, exact, atol=1e-7)  # of steps to 1e-9
    speed = -np.exp(-zeta * t) * np.sin(damped * t) / damped
    np.testing.assert_allclose(a, -exact - 2 * zeta * speed, atol=1e-7)

    def velocity(t, q, v):
        return v

    force = lambda t, q, v, side, z: 0.02 * side[0]  # noqa: E731
    friction = benchmark.Hidden("dry_friction", {}, force, [velocity])
    bare = benchmark.Nominal(0.0, (0.0,) * 4, (0.0,) * 3)
    q, v, _ = benchmark.motion(bare, [friction], np.arange(40) * np.pi, 1.0)
    turns = 1 - 0.04 * np.arange(26)  # stands still within 0.02 of the middle
    np.testing.assert_allclose(np.abs(q[:25]), turns[:25], atol=1e-6)
    assert np.all(np.abs(q[25:]) <= 0.02 + 1e-6) and np.all(v[26:] == 0)


@benchmark_of("noises")
def test_noises_of_the_trials(benchmark):
    """Each has the level that is asked for; a band and a filter leave a stop band."""
    rng = np.random.default_rng(0)
    x = np.sin(np.arange(20_000) / 5)
    power = {}
    for kind in benchmark.KINDS:
        (noise,) = benchmark.noises(kind, [x], [400.0], 40.0, rng)
        power[kind] = np.abs(np.fft.rfft(noise)) ** 2
        ratio = np.sqrt(np.mean(noise**2) / np.mean(x**2))
        # lines, drift and mixed levels come on top: up to 5 times
        assert ratio == pytest.approx(0.01, rel=1e-6) or 0.004 < ratio < 0.05, kind
    for kind in ("causal", "band"):
        last = power[kind][-200:].mean()
        assert last < 0.2 * power[kind][200:4000].mean(), kind
    assert power["ar1"][10:1000].mean() > 100 * power["ar1"][-1000:].mean()


@benchmark_of("score")
def test_marks_of_a_diagnosis(benchmark):
    said = lambda verdict, *sets: benchmark.Said(verdict, sets[0], sets)  # noqa: E731
    marks = lambda *a, **k: "".join(k[0] for k, v in benchmark.marks(*a, **k).items() if v)  # noqa: E731
    assert marks(said("named", ("a",)), ["a"]) == "rif"
    assert marks(said("ambiguous", ("b",), ("a",)), ["a"]) == "i"
    assert marks(said("named", ("b",)), ["a"]) == "w"
    assert marks(said("unknown", ("a",)), ["a"]) == ""
    assert marks(said("named", ("mains_hum",)), [], excused=["mains_hum"]) == "rif"
    assert marks(said("named", ("mains_hum",)), []) == "w"
    both = ("linear_frequency",), ("added_mass",)
    assert marks(said("ambiguous", *both), ["added_mass"]) == "rif"
    assert marks(said("named", both[0]), ["added_mass"]) == "w"
    # values within their tolerances first, which are no name, and a mass beside them
    assert marks(said("ambiguous", (), ("added_mass",)), ["added_mass"]) == "i"
    told = replace(said("ambiguous", ("b",), ("a",)), members=("b", "a"))
    assert marks(told, ["a"]) == "if" and marks(told, ["c"]) == ""


@benchmark_of("run")
def test_small_run_of_blind_trials(benchmark, tmp_path):
    """A row is made, diagnosed and stored, and a second run reads what the first stored."""
    seeds = [1]
    (first,) = benchmark.results_of("null_white", seeds, tmp_path, 1, False)
    assert not first["wrong"] and "error" not in first
    (second,) = benchmark.results_of("null_white", seeds, tmp_path, 1, False)
    assert second["seconds"] == first["seconds"]
    assert "null_white" in benchmark.line("null_white", [first], "none")


@pytest.mark.slow
@benchmark_of("forced")
def test_small_benchmark_of_forced_diagnosis(benchmark):
    """The held force of a linear oscillator in closed form; a wrong gain is named, and no other."""
    linear = benchmark.Nominal(0.02, (0.0,) * 4, (0.0,) * 3)
    t = 0.3 * np.arange(200)
    damped = np.sqrt(1 - 0.02**2)
    exact = 1 - np.exp(-0.02 * t) * (np.cos(damped * t) + 0.02 / damped * np.sin(damped * t))
    for made in (benchmark.held, lambda n, push, t: benchmark.driven(n, [], t, push)):
        np.testing.assert_allclose(made(linear, lambda now: 1.0, t), exact, atol=1e-5)
    seed = next(s for s in range(99) if "input_gain" in benchmark.hidden_in(s))
    result = benchmark.one(seed, "forced")
    assert result["right"] and "error" not in result


@benchmark_of("exudyn_beam")
def test_witness_of_the_beam_trials(benchmark):
    """Two codes that share no line agree: frequency, release, and 0.2 s with damper and drag."""
    from beam_truth import Spring

    from romsindy.beam import Beam
    from romsindy.effects import AirDrag, AtPoint, Damper

    spring = Spring(24.4, 0.097, 1.51)
    damper = benchmark.Force("damper", 0.3, {"damping": 0.01})
    drag = benchmark.Force("drag", 0.45, {"coefficient": 0.03})
    strip = ("cantilever", 0.45, 0.025, 0.001, 210e9, 7800.0, 0.37, 1e-5, 0.0008, spring)
    truth = benchmark.BeamTruth(*strip, forces=(damper, drag))
    other, moving = (benchmark.ExudynBeam(truth, 24, still) for still in (True, False))
    rest = other.static()
    omega, _, pattern = other.mode(rest)
    beam = Beam.cantilever(elements=12).with_effect(Damper().on_beam(0.01, AtPoint(0.3)))
    beam = beam.with_effect(AirDrag().on_beam(0.03))
    sensors = beam.sensors([0.2, 0.45])
    assert omega == pytest.approx(beam.modes(count=1).omega[0], rel=1e-5)  # 24 and 12 elements
    start = other.held_at(pattern, len(other.x) - 1, 0.1, rest)
    motion = moving.motion(start, 0.2, 5e-4, 10)
    read = other.read(motion, rest, [0.2, 0.45])
    own = sensors.measure(
        beam.simulate(beam.release_shape(0.1, mode=1), 0.2, 5e-3, sensors=sensors)
    )
    # (omega h)^2 / 12 of 8 radians, 1 / 4000 of the amplitude
    np.testing.assert_allclose(read, own[:, ::2], atol=1e-4)


@benchmark_of("exudyn_forces")
def test_size_of_what_is_hidden_in_a_beam(benchmark):
    """Medium: the witness's own modes shift by half a per cent, times 0.7 to 1.5."""
    from exudyn_beam import BeamTruth, ExudynBeam

    truth = BeamTruth("cantilever", 0.45, 0.025, 0.001, 210e9, 7800.0, 0.37, 1e-5)
    plain = ExudynBeam(truth, 20, still=True)
    rest = plain.static()
    omega, shape, _ = plain.mode(rest)
    bend = float((shape[5] - shape[2]) / plain.x[1])
    mode = benchmark.Mode(omega, plain.x, shape[1::3], rest[1::3], bend, 0.02)
    for kind in ("mass", "compliance"):
        for seed in range(3):
            changed, _ = benchmark.with_hidden(kind, truth, mode, np.random.default_rng(seed))
            other = ExudynBeam(changed, 20, still=True)
            shift = other.mode(other.static())[0] / omega - 1
            # first order of the shift, and the slope of the shape over the first element
            assert 0.9 * 0.0035 < -shift < 1.1 * 0.0075, (kind, seed)


@benchmark_of("exudyn_trials")
def test_a_beam_trial_is_made_once_and_told_wrongly(benchmark, tmp_path, monkeypatch):
    """Short records: what is stored is what was made, and errors stay within two tolerances."""
    monkeypatch.setattr(benchmark.Kind, "pace", lambda self, supports: (1e-3, 0.2, 4))
    trial, truth = benchmark.beam_trial("tip", 3, tmp_path)
    again, _ = benchmark.beam_trial("tip", 3, tmp_path)
    assert [np.array_equal(*y) for y in zip(trial.readings, again.readings, strict=True)] == [1] * 3
    exact, wrong = (trial.told[which] for which in ("exact", "wrong"))
    for field in ("length", "thickness", "density", "young", "alpha"):
        relative = abs(wrong["beam"][field] / exact["beam"][field] - 1)
        assert 0 < relative <= 2 * max(benchmark.TOLERANCES.values())
    shifts = np.subtract(wrong["sensors"], exact["sensors"])
    # two sigma of 1 mm; that at the tip stays there, on a length that is two sigma off
    assert np.all(np.abs(shifts) <= 2.001e-3) and len(truth["effects"]) == 1
    rows = importlib.import_module("beam_rows")
    found = {"right": True, "place": 0.3, "length": 0.45, "found_at": 0.31}
    found |= {"interval": [0.29, 0.32], "strength": [1.0, 1.2], "true_strength": 1.3}
    said = rows.place_line([found, found | {"right": False}])
    assert "1 of 1, within 5 %" in said and "strength in 0 of 1" in said
    assert "within its interval in 1 of 1, which is at most a fifth of the length in 1" in said


@benchmark_of("exudyn_trials")
def test_trials_of_damping_hide_linear_damping_alone(benchmark):
    plain = benchmark.nominal("cantilever", np.random.default_rng(0))
    chosen = [benchmark._chosen("tip_damping", seed, plain) for seed in range(8)]
    assert sorted(chosen) == sorted(2 * ["damper", "alpha", "damper", "eta"])


@benchmark_of("exudyn_trials")
def test_trials_of_what_is_mounted_hide_each_in_turn(benchmark):
    bare = replace(benchmark.nominal("cantilever", np.random.default_rng(0)), spring=None)
    chosen = [benchmark._chosen("bent_mounted", seed, bare) for seed in range(8)]
    assert sorted([*chosen, "spring_stiffness"]) == sorted(benchmark.MOUNTED)
    # What can stretch has a modulus beside its stiffness.
    called = [benchmark._called("modulus", supports) for supports in ("clamped", "cantilever")]
    assert called == ["modulus", "bending_stiffness"]


@benchmark_of("tellable")
def test_a_clamp_does_to_every_mode_what_a_softer_material_does(benchmark):
    """First order: 2 c EI/L of each frequency, as its curvature at the clamp says."""
    plain = benchmark.BeamTruth("cantilever", 0.45, 0.025, 1e-3, 210e9, 7800.0, 0.3, 1e-5)
    exact, compliance = asdict(plain), 0.002
    softer = exact | {"compliance": compliance}
    shift = benchmark.hidden(softer) - benchmark.at_rest(benchmark.beam_of(exact))
    first_order = -2 * compliance * 210e9 * 0.025 * 1e-9 / 12 / 0.45
    # its second order is less than ten times the square
    assert shift[:3] == pytest.approx([first_order] * 3, abs=10 * first_order**2)
    one, three = benchmark.distances(exact, softer, 6)
    # length, thickness, density, modulus: their powers in the frequency, and tolerances
    spread = np.hypot.reduce([2 * 0.001, 0.004, 0.005 / 2, 0.01 / 2])
    assert one == pytest.approx((first_order / spread) ** 2, rel=0.05)
    mass = {"kind": "mass", "at": 0.225, "values": {"mass": 0.001}}
    heavier = exact | {"forces": [mass]}
    assert one < three < benchmark.NAMED < benchmark.distances(exact, heavier, 6)[1]


@pytest.mark.parametrize(
    ("name", "shift", "ratio"),
    [
        ("piecewise_damping", 0.0, 0.005),
        ("threshold", 0.0, 0.005),
        ("pressed_friction", 0.0, 0.005),
        ("negative_stiffness", -0.02, 0.0),
        ("self_heating", -0.02, 0.0),
    ],
)
@benchmark_of("strangers")
def test_what_is_on_no_list_is_as_strong_as_asked(benchmark, name, shift, ratio):
    """By its work along q = cos t: 2 pi ratio in a cycle, and pi shift in phase with q.

    It was scaled by 512 samples, in which four jumps are each off by half a sample: 1 %. The heat
    of a vibration that goes on is 1 in the mean.
    """
    setting = importlib.import_module("hidden").Setting(
        "strong", 0.005, [(0.0, 100.0)], 10.0, np.random.default_rng(3)
    )
    hidden = benchmark.MAKERS[name](name, setting)
    t = (np.arange(20_000) + 0.5) * 2 * np.pi / 20_000
    force = np.array(
        [
            hidden.force(s, q, v, [np.sign(switch(s, q, v)) for switch in hidden.switches], [1.0])
            for s, q, v in zip(t, np.cos(t), -np.sin(t), strict=True)
        ]
    )
    assert np.mean(force * np.cos(t)) == pytest.approx(shift, rel=0.01, abs=1e-9)
    assert -np.mean(force * np.sin(t)) == pytest.approx(ratio, rel=0.01, abs=1e-9)
    if hidden.rates is not None:
        warmer = [hidden.rates(s, np.cos(s), -np.sin(s), [1.0])[0] for s in t]
        assert np.mean(warmer) == pytest.approx(0.0, abs=1e-9)


@benchmark_of("exudyn_trials")
def test_a_beam_that_cannot_be_held_is_drawn_again(benchmark, monkeypatch, capsys):
    """Five times at the most; what never can be is the error that it is."""
    error = importlib.import_module("exudyn").ExudynError
    seen = []

    def drawn(kind, seed, attempt):
        seen.append(attempt)
        if attempt < first:
            raise error("no statics")
        return attempt

    monkeypatch.setattr(benchmark, "drawn", drawn)
    first = 2
    assert benchmark._made("bent_mounted", 3) == 2 and seen == [0, 1, 2]
    again = "bent_mounted 3: drawn again, since Exudyn says: no statics\n"
    assert capsys.readouterr().out == 2 * again
    first = 5
    with pytest.raises(error, match="no statics"):
        benchmark._made("bent_mounted", 3)


@benchmark_of("marked")
def test_a_diagnosis_that_fails_is_counted(benchmark):
    def refuses():
        raise ValueError("no")

    truth = {"effects": {"stop": {}}, "strength": "weak", "noise": "white"}
    found = benchmark.asked_of(refuses, truth)
    assert found["error"] == "ValueError in refuses: no"
    assert not (found["right"] or found["in_set"] or found["wrong"])
    stranger = benchmark.of_a_stranger
    said = benchmark.Said
    assert (
        stranger(said("unknown", (), ()))["right"] and stranger(said("named", ("a",), ()))["wrong"]
    )


@pytest.mark.slow
@pytest.mark.parametrize("row", ["hidden", "weak", "outside", "itself", "example"])
@benchmark_of("rows")
def test_small_rows(benchmark, row, tmp_path):
    """One trial of each row, of short records: no failure, and nothing wrong that is named."""
    seed = {"hidden": 51, "weak": 24, "outside": 19}.get(row, 0)
    result = benchmark.ROWS[row].one(seed, tmp_path)
    assert "error" not in result and not result["wrong"]
    assert result["sentence"] and result["seconds"] > 0


@benchmark_of("work_precision")
def test_work_is_compared_at_equal_precision(benchmark, tmp_path):
    """An own run, and the fastest of those whose error is no larger than another's."""
    coarse, fine = (benchmark.own(4, step, 1e-2, 1.0) for step in (4e-3, 2e-3))
    # Four elements of three nodes: their error of the shape is the same, that of the steps 1e-5.
    assert coarse.omega == pytest.approx(fine.omega, rel=1e-4)
    run = benchmark.Run
    good, better, slow = (run("own", 4, s, w) for s, w in ((1.0, 1.01), (2.0, 1.001), (3.0, 1.0)))
    fastest = benchmark.fastest_as_good
    assert fastest(run("Exudyn", 4, 9.0, 0.98), [slow, better, good], 1.0) is good
    assert fastest(run("Exudyn", 4, 9.0, 0.995), [slow, better, good], 1.0) is better
    assert fastest(run("Exudyn", 4, 9.0, 1.0 - 1e-9), [better, good], 1.0) is None
    benchmark.draw([good, better, slow], 1.0 + 1e-6, 1.0, tmp_path / "work.png")
    assert (tmp_path / "work.png").stat().st_size > 1000


@pytest.mark.slow
@benchmark_of("coupled")
def test_small_run_of_systems_of_two_coordinates(benchmark, capsys):
    benchmark.main(["--count", "1", "--seed", "5"])
    assert "1 of 1 with two modes" in capsys.readouterr().out
    row = benchmark.trial(7)
    # Noise of 1 % of the rms of a decay, over its largest sample; terms as they were drawn.
    assert row["error"] < 0.01 and not row["wrong"]


@benchmark_of("modes_apart")
def test_small_run_of_modes_that_are_told_apart(benchmark, capsys):
    """Modes 3.7 % apart that beat, and one under a force beside which another one rings."""
    for row in ("close", "driven"):
        benchmark.main(["--count", "1", "--seed", "1003", "--row", row])
        assert "two in 1 (1 at their frequencies)" in capsys.readouterr().out


@pytest.mark.slow
@benchmark_of("coupled")
def test_a_force_on_two_coordinates_is_told_from_a_term_that_lacks(benchmark):
    """Right terms under an unknown force are explained, and errors hold; one less not."""
    _, values, shapes, decays, _ = benchmark.decays_of(9, "force")
    decays = [decays[0].between(0.0, 0.4 * decays[0].t[-1])]
    shown = benchmark.as_shown(values, shapes, np.argmax(np.abs(shapes), axis=0))
    fit = benchmark.fitted(shown, decays)
    off = [(fit.model.coefficients[k] - v) / fit.standard_errors[k] for k, v in shown.items()]
    assert fit.verdict.explained and "forces that were not measured" in str(fit.verdict)
    assert np.abs(off).max() < 3.5  # of ten once in 200
    less = {name: value for name, value in shown.items() if name != "gamma_3 [q2]"}
    assert not benchmark.fitted(less, decays).verdict.explained


@benchmark_of("coupled")
def test_stepped_motions_are_those_of_the_adaptive_method(benchmark):
    """Without a force, to the fourth-order error of 80 steps a cycle of the fast coordinate."""
    _, values, _, starts, _ = benchmark.drawn(2)
    t = benchmark.sampled(values)[:400]
    nothing = np.zeros(((len(t) - 1) * benchmark.INSIDE, 2))
    own = benchmark.simulated(values, starts[0], t, nothing)
    np.testing.assert_allclose(own, benchmark.simulated(values, starts[0], t), atol=1e-4)


@benchmark_of("coupled")
def test_vibrations_that_beat_are_heard_where_they_are_quieter(benchmark):
    """Loud, neither keeps a frequency; later both have that of small motions, to some 1e-3."""
    _, values, _, fitted, _ = benchmark.decays_of(9804)
    heard = sorted(tones_of(fitted[1])[0], key=lambda v: v.small_frequency)
    true = np.sqrt([values["omega^2 [q1]"], values["omega^2 [q2]"]]) / (2 * np.pi)
    np.testing.assert_allclose([v.small_frequency for v in heard], true, rtol=2e-3)
    tone, seconds = heard[0].tone, fitted[1].t[-1]
    assert 0.2 * seconds < tone.start < tone.end < 1.001 * seconds
    left = fitted[1].signal - sum(v(fitted[1].t) for v in heard)
    late = fitted[1].t > tone.start
    assert np.std(left[late]) < 0.1 * np.std(fitted[1].signal[late])  # phases are those of then


WAY_BACK = "from 25 per cent of the decays on"


@pytest.mark.slow
@benchmark_of("coupled")
def test_close_vibrations_of_one_sensor_are_told_apart(benchmark):
    """Frequencies 6 % apart, which beat."""
    _, values, _, fitted, _ = benchmark.decays_of(9156)
    fit = rs.identify(fitted, "auto")
    assert {*fit.model.coefficients} == {name for name, value in values.items() if value}
    assert fit.verdict.explained and np.all(np.diff(small_frequencies(fit.model)) > 0)


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason="these two are told apart at once now")
@benchmark_of("coupled")
def test_an_interrupt_on_the_way_back_keeps_a_fit_of_whole_decays(benchmark):
    """Parts of decays that were fitted on the way are not to be compared with whole ones."""
    _, _, _, fitted, _ = benchmark.decays_of(9156)
    said = []

    def stop(line):
        said.append(line)
        way = said[said.index(WAY_BACK) :] if WAY_BACK in said else []
        if line.startswith("terms: ") and sum(x.startswith("terms: ") for x in way) == 5:
            raise KeyboardInterrupt

    fit = rs.identify(fitted, "auto", progress=stop)
    assert WAY_BACK in said and fit.solution.interrupted
    assert sum(map(len, fit.residuals)) == sum(d.signal.size for d in fitted)


@benchmark_of("coupled")
def test_coefficients_as_a_sensor_shows_them(benchmark):
    """Scaled coordinates: the same motion, and the same forces on masses that differ."""
    _, values, shapes, _, _ = benchmark.drawn(2)
    main = np.argmax(np.abs(shapes), axis=0)
    shown = benchmark.as_shown(values, shapes, main)
    scale = shapes[main, range(2)]
    t = np.linspace(0, 0.5, 50)
    own = benchmark.simulated(values, np.array([0.4, 0.3]), t)
    model = rs.CoupledModel.from_coefficients(shown, unit="m")
    seen = model.simulate(scale * [0.4, 0.3], [0.0, 0.0], t).q
    np.testing.assert_allclose(seen, own * scale, atol=1e-7)


@pytest.mark.slow
@benchmark_of("tip_release")
def test_small_run_of_the_release_from_a_tip_force(benchmark):
    beam = rs.Beam.cantilever()
    fit = rs.identify(benchmark.noisy(*benchmark.released(beam, 2.0), seed=4), "auto")
    assert fit.model.n_coordinates >= 2 and fit.adequacy < 1.1
    # Two seconds end at a third of the amplitude: small motions are extrapolated.
    omega = beam.modes(count=2).omega
    np.testing.assert_allclose(fit.model.linear_modes[0][:2], omega, rtol=5e-3)


@pytest.mark.slow
@benchmark_of("double_beam")
def test_error_of_a_trajectory(benchmark, measured):
    """Half as large as measured: every window is half of its own norm away."""
    _, several = benchmark.decays(measured / "double_beam_train.npz")
    x = several[0].signal
    size = np.linalg.norm(np.lib.stride_tricks.sliding_window_view(x, benchmark.WINDOW), axis=1)
    expected = size.mean() / 2 / size.max()
    assert benchmark.trajectory_error(x / 2, x) == pytest.approx(expected, rel=1e-9)
    assert len(several) == 9 and several[0].measured == "velocity"


@pytest.mark.slow
@benchmark_of("forced_vibrations")
def test_small_benchmark_of_forced_vibrations(benchmark):
    """A sweep and a multisine, held and band-limited: no way between samples is named wrong."""
    for seed in (1, 3):
        s, off, note, exact, explained = benchmark.trial(seed, select=False)
        assert exact and explained
        assert max(map(abs, off.values())) < 4
        said = "held" if s.way == "hold" else "band-limited"
        assert said in note.replace("not ", "").split(",")[0] or "may be" in note


@pytest.mark.slow
@benchmark_of("driven_verdicts")
def test_small_benchmark_of_driven_verdicts(benchmark):
    """A step of an oscillator in closed form; a friction that is missing is noticed, and named."""
    s = benchmark.structure(3)._replace(truth={"omega^2": 4.0, "c_linear": 0.08}, dt=0.3)
    s = s._replace(push=np.ones((200 * benchmark.INSIDE, 3)))
    t, slow = 0.3 * np.arange(201), 2.0 * np.sqrt(1 - 0.02**2)
    gone = np.exp(-0.04 * t) * (np.cos(slow * t) + 0.04 / slow * np.sin(slow * t))
    # An error of the phase of (omega h)^4 / 120 a radian, over 120 of them.
    np.testing.assert_allclose(benchmark.motion(s), (1 - gone) / 4.0, atol=1e-5)
    row = benchmark.trial("white", 3)
    assert row.explained and row.noticed and row.like in benchmark.LIKE[row.missing]
    assert 0.02 <= row.leaves <= 0.04 and "noticed 1" in benchmark.line("white", [row])


@pytest.mark.slow
@benchmark_of("steady_verdicts")
def test_small_benchmark_of_steady_verdicts(benchmark):
    """A linear oscillator in closed form; drag that is missing is noticed under every noise."""
    w = np.linspace(1.9, 2.1, 7)
    q, settled = benchmark.steady(w, np.ones(7), lambda q, v: 4.0 * q + 0.1 * v)
    assert settled.all()
    # An error of the phase of (omega h)^4 / 120 a radian.
    np.testing.assert_allclose(q, 1 / (4 - w**2 + 0.1j * w), rtol=1e-4)
    rows = benchmark.trial(51) + benchmark.trial(52, "c_quadratic")
    assert [r.explained for r in rows] == [True] * 5 + [False] * 5
    assert "noticed in 1 of 1" in benchmark.report(rows)[0]


@pytest.mark.slow
@benchmark_of("decay_verdicts")
def test_small_benchmark_of_decay_verdicts(benchmark):
    """A linear decay in closed form, and energy that viscous damping takes; an unknown force."""
    s = benchmark.Oscillator(30.0, 0.01, 0.0, 0.0)
    t = np.arange(600) / benchmark.RATE
    turned = 30.0 * np.sqrt(1 - 0.01**2)
    gone = np.exp(-0.3 * t) * (np.cos(turned * t) + 0.3 / turned * np.sin(turned * t))
    # Runge and Kutta's phase error (omega h)^4 / 120 a radian, over 60 of them.
    nothing = np.zeros(599 * benchmark.INSIDE)
    np.testing.assert_allclose(s.motion(nothing, t), gone, atol=1e-6)
    np.testing.assert_allclose(s.damping_ratio([0.1, 1.0]), 0.01, rtol=1e-6)
    row = benchmark.trial("oscillators", "force", 10, None)
    assert row.explained and "forces that were not measured" in row.said
    assert np.mean(row.held["K"]) > 0.9


@pytest.mark.slow
@benchmark_of("decay_verdicts")
def test_a_term_less_is_noticed_beside_a_force_that_was_not_measured(benchmark):
    row = benchmark.without("force", 20)
    assert row.explained and row.noticed


@pytest.mark.study
@pytest.mark.slow
@benchmark_of("silverbox")
def test_small_benchmark_of_a_measured_oscillator(benchmark, measured):
    """A tenth of what is learned: 0.26 mV is asked of all of it."""
    learned, rest = benchmark.records(measured / "silverbox_train.npz", share=0.1)
    fit = rs.identify(learned)
    assert len(fit.free) <= 10
    assert benchmark.missed(fit, rest.between(end=rest.t[0] + 3.0)) < 0.35
    assert "input is band-limited" in str(fit)


@pytest.mark.slow
@benchmark_of("generator")
def test_strong_dry_friction_that_stops_within_ten_cycles_is_named(benchmark, tmp_path):
    """Where its force jumps, motions that may depart from it go astray: the likeliest counts.

    Rubbing was likelier than the last of them, which left eight times what the fit does.
    """
    trial = benchmark.trial_of("hidden", 76018, tmp_path)
    *learned, held_out = trial.decays()
    report = rs.diagnose(trial.model, learned, held_out=held_out)
    assert report.verdict == "named" and report.best.names == ("dry_friction",)
    assert report.gap.after < 1.1 < 50 < report.gap.before


# A tuned mass follows what was learned, but not the stretches held out. Friction closes 99 % of a
# gap, and leaves more than noise without the other. Linear stiffness does what a magnet does but
# for a few per cent of the response, and hum is no second effect that would make two of it.
@pytest.mark.study
@pytest.mark.slow
@benchmark_of("generator")
@pytest.mark.parametrize(
    ("seed", "pair"),
    [
        (75001, ("cubic_stiffness", "cubic_damping")),
        (76010, ("dry_friction", "cubic_stiffness")),
        (76009, ("mains_hum", "magnet")),
    ],
)
def test_two_forces_are_told_by_what_was_held_out(benchmark, tmp_path, seed, pair):
    trial = benchmark.trial_of("two", seed, tmp_path)
    decays = trial.decays()
    held_out = decays.pop() if trial.held_out else None
    report = rs.diagnose(trial.model, decays, held_out=held_out)
    assert pair in report.equivalent and report.gap.after < 1.1


@pytest.mark.slow
@benchmark_of("measured")
@pytest.mark.filterwarnings("ignore:t is not uniform")
@pytest.mark.parametrize("runs", ["7, 8", "1, 3"])
def test_runs_of_one_hammer_test_lack_nothing(benchmark, measured, runs):
    """A filter at 60 Hz leaves nothing of the zero, which was fitted to a misfit: 1.2 peaks."""
    report = benchmark.against_repeat(f"double beam, runs {runs}", measured)()
    assert report.verdict == "none"
    assert all(d.signal < 0.01 for d in report.differences)


@benchmark_of("clamped_beam")
def test_small_run_of_a_measured_clamped_beam(benchmark, measured):
    """Mode 3 takes part: of 0.3 s one coordinate leaves far more than noise, a tenth of the rms."""
    decay = benchmark.run_b(measured / "cc_beam_bristol.npz", (2.4, 2.7))
    fit, left = benchmark.left_by(decay, 1)
    # Other vibrations are taken for noise beside what is heard between all of them.
    assert fit.adequacy > 10 and left / fit.adequacy < benchmark.taken_for_noise(decay) < left
    assert 0.02 < left / np.sqrt(np.mean(decay.signal**2)) < 0.3


@benchmark_of("beam_stepped_sine")
def test_small_benchmark_of_a_stepped_sine(benchmark):
    """The tip follows a circle: its first harmonic, and that of a cosine cubed, by hand."""
    circle = np.array([0.0, 2.0, 0.0, 0.0])
    linear, cubic = np.zeros((2, len(benchmark.FOLLOWS)))
    linear[0] = cubic[2] = 1.0
    assert benchmark.first_harmonic(circle, linear) == pytest.approx(2.0)
    assert benchmark.first_harmonic(circle, cubic) == pytest.approx(0.75 * 8)


@pytest.mark.slow
@benchmark_of("forecasts")
def test_small_benchmark_of_forecasts(benchmark):
    """A decay, and a stepped sine: their bands hold most, and the table has a line for each."""
    rows = [benchmark.trial(0, 3), benchmark.trial(1, 3)]
    assert all(0.85 < row.held <= 1 for row in rows)
    names = [line[0] for line in benchmark.table(rows)[1:]]
    assert names == ["decay, terms", "stepped sine", "all"]


@benchmark_of("forecasts")
def test_the_benchmark_of_forecasts_steps_to_a_closed_form(benchmark):
    """Linear oscillators under a force, and the best constant width of two errors."""
    laws, w = {"omega^2": 4.0, "c_linear": 0.2}, np.array([1.8, 2.0])
    found = benchmark.steady(laws, w, np.ones(2))
    # What is left of the start after 160 cycles, and the tolerance of the integration.
    np.testing.assert_allclose(found, 1 / (4 - w**2 + 0.2j * w), rtol=1e-5)
    truth, ends = np.array([0.1, -0.1]), np.full(2, 0.2)
    row = benchmark.Row(0, "stepped sine", "", truth, np.zeros(2), -ends, ends, ())
    assert row.held == 1 and row.score == pytest.approx(0.4)
    assert row.best == pytest.approx(0.2, rel=0.06)  # widths are 6 % apart


@pytest.mark.study
@pytest.mark.slow
@benchmark_of("batch")
def test_a_batch_of_the_benchmark_is_identified(benchmark, tmp_path):
    benchmark.write_records(tmp_path, 1, 5)
    decay = rs.load_decay(tmp_path / "run00005.csv")
    assert len(decay.t) == 4000 and decay.unit == "m"
    assert benchmark.seconds(tmp_path) > 0
    (tmp_path / "run00006.csv").write_text("nothing")
    with pytest.raises(RuntimeError, match=r"1 of 2 records identified.*1 refused"):
        benchmark.seconds(tmp_path)


@benchmark_of("deck_trials")
def test_trials_of_a_deck_hide_one_kind_after_the_other(benchmark):
    """Six seeds hide six kinds; values are told exactly, or off by their tolerances."""
    several = [benchmark.hidden_of(seed, wrong=False) for seed in range(6)]
    assert {h.kind for h in several} == set(benchmark._HIDDEN)
    assert all(set(h.values.values()) == {1.0} for h in several)
    off = np.array([[*benchmark.hidden_of(s, wrong=True).values.values()] for s in range(600)])
    # Standard deviations of 600 draws are known to 3 %: three of these.
    assert np.std(off, axis=0) == pytest.approx([*benchmark._WITHIN.values()], rel=0.09)


@pytest.mark.study
@pytest.mark.slow
@benchmark_of("deck_trials")
def test_what_a_deck_lacks_is_found_in_a_beam_of_another_code(benchmark, tmp_path, monkeypatch):
    """A damper at the tip: named, with the strength that the beam had.

    In one record of five seconds, in which the second mode is loud: it was told as mains hum.
    """
    if shutil.which("ccx") is None:
        pytest.skip("there is no CalculiX here (ccx): apt install calculix-ccx")
    hidden = benchmark.Hidden("damper", 0.25, dict.fromkeys(benchmark._WITHIN, 1.0))
    monkeypatch.setattr(benchmark, "_RELEASES", benchmark._RELEASES[1:])
    decays = benchmark.measured(hidden, seed=7)
    report = rs.diagnose(benchmark.told(tmp_path), decays, free=[])
    assert report.verdict == "named" and report.reduced.best.names == ("viscous",)
    # Steps, meshes and shear differ: a hundredth of what was hidden.
    assert report.force(0.0, 0.0, 1.0) == pytest.approx(-0.25, rel=0.01)
    assert max(e.after for e in report.sensor_errors) < 3


@benchmark_of("blind_decks")
def test_trials_of_decks_hide_every_kind_in_every_structure(benchmark):
    """Of 42 seeds: seven kinds in three structures, half of them told wrong."""
    several = [benchmark.hidden_of(seed) for seed in range(42)]
    pairs = {(h.shape, h.kind) for h in several}
    assert len(pairs) == len(benchmark.SHAPES) * len(benchmark._HIDDEN) == 21
    wrong = [set(h.values.values()) != {1.0} for h in several[:24]]
    assert wrong == [False] * 12 + [True] * 12


@pytest.mark.study
@pytest.mark.slow
@benchmark_of("blind_decks")
def test_two_codes_move_an_arch_alike_and_so_does_its_simulator(benchmark, tmp_path, monkeypatch):
    """CalculiX and felupe share the law of the solid, and neither elements nor solver."""
    pytest.importorskip("felupe", reason="there is no felupe here: pip install felupe")
    for program in ("ccx", "gmsh"):
        if shutil.which(program) is None:
            pytest.skip(f"there is no {program} here")
    name = "arch"
    monkeypatch.setattr(benchmark, "_CYCLES", 1)
    monkeypatch.setattr(benchmark, "_RELEASES", (0.8,))
    kept = tmp_path / "motions"  # the one of CalculiX, which all that follows is compared with
    off, alone = (benchmark.missed_by(name, n, tmp_path, kept, cycles=1).max() for n in (5, 0))
    assert off < 1.0 < 5.0 < alone
    (stored,) = kept.iterdir()
    x = np.load(stored)["x_0"]
    mesh = benchmark.Mesh(name, tmp_path)
    known = benchmark.told(mesh, tmp_path)
    hidden = benchmark.Hidden(name, "nothing", 0.0, 0.5, dict.fromkeys(benchmark._WITHIN, 1.0))
    truth = benchmark.truth_of(hidden, mesh, known, tmp_path)
    sensors = [mesh.near(p) for p in mesh.shape.sensors]
    release, step = 0.8 * mesh.shape.thickness, 2 * np.pi / known.omega[0] / benchmark._STEPS
    y = benchmark._by_felupe(truth, sensors, release, float(step))
    # CalculiX stops its iterations at 1e-4 of the step.
    assert np.abs(x - y).max() < 1e-3 * release


@pytest.mark.slow
@benchmark_of("dry_friction")
def test_friction_is_found_in_one_of_two_modes_and_when_it_holds(benchmark):
    """Of the two that stop, each with an offset as large as the noise, no term is false."""
    _, _, missing, false, holds, fit = benchmark.trial("coupled", 9907)
    assert not (missing or false) and all(holds.values())
    assert fit.verdict.explained
