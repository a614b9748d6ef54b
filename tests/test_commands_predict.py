"""`romsindy predict`: responses and backbones against closed forms, and a level left out."""

from __future__ import annotations

import csv
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.optimize import brentq

import romsindy as rs
from romsindy.commands.main import main
from romsindy.fit.adequacy.verdicts import Adequacy
from romsindy.fit.results.forced_band import forced_band
from romsindy.fit.steady.fit import SteadyEstimate

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import steady_points

sys.path.pop(0)

K, C = 2500.0, 2.0
LINEAR = rs.ReducedModel.from_coefficients({"omega^2": K, "c_linear": C}, unit="m")
VERDICT = Adequacy(1.0, 0.5, 1.0, False, np.zeros(0), np.zeros((0, 6)), 0.1, "m")


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run a command in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])


def save(model, relative=1e-3, reach=0.1):
    """A result whose coefficients are off by parts, independently, as a file found.json."""
    free = tuple(model.coefficients)
    model = replace(model, amplitude_range=(0.0, reach))
    covariance = np.diag(np.square(relative * np.array(model.values)))
    rs.Estimate(model, free, covariance, VERDICT, ()).save("found.json")


def columns(path):
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert rows
    return {
        name: np.array(
            [row[name] if name == "stable" else float(row[name] or "nan") for row in rows]
        )
        for name in rows[0]
    }


# -- under a force ---------------------------------------------------------------------------------


def test_a_linear_response_and_its_band_are_the_closed_form(run, tmp_path):
    """Errors of stiffness and damping by its derivatives, far from where they are no straight
    line."""
    save(LINEAR, 3e-4)
    done = run("predict", "found.json", "--force", 0.5, "--frequency", "7:9", "--csv", "t.csv")
    assert done.exit_code == 0 and "force per unit mass of 0.5 m/s^2" in done.stdout
    found = columns(tmp_path / "t.csv")
    w = 2 * np.pi * found["frequency [Hz]"]
    q = 0.5 / (K - w**2 + 1j * C * w)
    # At the ends of the range, between orbits, splines are a twentieth of a percent off.
    np.testing.assert_allclose(found["displacement [m]"], np.abs(q), rtol=1e-3)
    np.testing.assert_allclose(found["phase [deg]"], np.degrees(np.angle(q)), atol=0.05)
    assert set(found["stable"]) == {"yes"}
    size = np.abs(q)
    slopes = size**3 / 0.25 * np.array([(K - w**2) * K, C * w * C * w]) * 3e-4
    # A band of 400 draws is known to some per cent.
    half = 1.96 * np.linalg.norm(slopes, axis=0)
    np.testing.assert_allclose(found["high [m]"] - found["low [m]"], 2 * half, rtol=0.15)


def test_a_base_acceleration_has_its_name_and_its_sign(run):
    """q counts from the base: above resonance it goes with the acceleration, below against it."""
    named = {"omega^2": K, "c_linear": C, "Gamma [base]": 1.5}
    save(rs.ReducedModel.from_coefficients(named, unit="m"))
    done = run("predict", "found.json", "--force", 2, "--frequency", "7:9", "--json", "-")
    content = json.loads(done.stdout)
    assert content["excitation"] == "base acceleration" and content["unit"] == "m/s^2"
    assert "Response to a base acceleration of 2 m/s^2" in done.stderr
    w = 2 * np.pi * np.array(content["columns"]["frequency [Hz]"])
    q = -1.5 * 2 / (K - w**2 + 1j * C * w)
    off = np.exp(1j * np.radians(content["columns"]["phase [deg]"])) - q / np.abs(q)
    assert np.abs(off).max() < 1e-3  # of a hundredth of a degree, and splines
    size = np.array(content["columns"]["displacement [m]"])
    np.testing.assert_allclose(size, np.abs(q), rtol=1e-3)  # splines at the ends


def test_a_delay_of_the_input_turns_the_phase():
    """By the angle of its time, and the velocity leads by a quarter of a cycle."""
    w = np.linspace(48.0, 52.0, 5)
    band = forced_band(
        LINEAR, 0.5, (47.0, 53.0), (), np.zeros((1, 1)), rate=1, lead=0.3, delay=2e-3
    )
    q = 0.5 * 1j * w * np.exp(1j * (0.3 - 2e-3 * w)) / (K - w**2 + 1j * C * w)
    states = band.steady_states(w)
    assert [s.frequency for s in states] == w.tolist()
    np.testing.assert_allclose([s.phase[0] for s in states], np.angle(q), atol=1e-3)
    np.testing.assert_allclose([s.amplitude[0] for s in states], np.abs(q), rtol=2e-4)


GAMMA, FORCE = 1.0, 0.05
DUFFING = {"omega^2": 1.0, "gamma_3": GAMMA, "c_linear": 0.05}


def balanced(w):
    """Amplitudes of a Duffing oscillator by one harmonic: roots of a cubic in their square."""
    a = 0.75 * GAMMA
    cubic = [a**2, 2 * a * (1 - w**2), (1 - w**2) ** 2 + (0.05 * w) ** 2, -(FORCE**2)]
    square = np.roots(cubic)
    return np.sqrt(np.sort(square[np.abs(square.imag) < 1e-9].real)[::-1])


def turns():
    """Frequencies at which two of them are one: the discriminant of the cubic is 0."""

    def discriminant(w):
        a = 0.75 * GAMMA
        p, q, r, s = a**2, 2 * a * (1 - w**2), (1 - w**2) ** 2 + (0.05 * w) ** 2, -(FORCE**2)
        return 18 * p * q * r * s - 4 * q**3 * s + q**2 * r**2 - 4 * p * r**3 - 27 * p**2 * s**2

    grid = np.linspace(1.0, 1.6, 400)
    signs = np.sign([discriminant(w) for w in grid])
    at = np.flatnonzero(signs[1:] != signs[:-1])
    return [brentq(discriminant, grid[i], grid[i + 1]) for i in at]


@pytest.fixture(scope="module")
def one_harmonic():
    model = rs.ReducedModel.from_coefficients(DUFFING)
    return rs.forced_response(model, FORCE, (0.8, 1.7), n_harmonics=1, n_points=400)


def test_three_responses_between_two_folds_are_those_of_the_cubic(one_harmonic):
    lower, upper = turns()
    for w in (0.9, (lower + upper) / 2, 1.6):
        states = one_harmonic.steady_states(w)
        # Straight between orbits.
        np.testing.assert_allclose([s.amplitude[0] for s in states], balanced(w), rtol=2e-3)
        assert [s.stable for s in states] == ([True, False, True] if len(states) == 3 else [True])
        of_phase = FORCE * np.cos([s.phase[0] for s in states])
        a = balanced(w)
        np.testing.assert_allclose(of_phase, (1 - w**2) * a + 0.75 * GAMMA * a**3, atol=1e-3)


def test_folds_are_where_the_discriminant_is_zero(one_harmonic):
    found = {fold.rising: fold.frequency for fold in one_harmonic.jumps}
    assert found[True] == pytest.approx(max(turns()), rel=1e-4)
    assert found[False] == pytest.approx(min(turns()), rel=1e-4)


def test_folds_are_told_with_intervals_and_the_middle_has_a_band(run, tmp_path):
    """More harmonics move them by less than half a percent; errors are those of coefficients."""
    save(rs.ReducedModel.from_coefficients(DUFFING, unit="m"), reach=1.0)
    hz = 1 / (2 * np.pi)
    written = ["--csv", "t.csv", "--json", "t.json", "--figure", "t.png"]
    span = f"{0.8 * hz}:{1.7 * hz}"
    done = run("predict", "found.json", "--force", FORCE, "--frequency", span, *written)
    assert done.exit_code == 0, done.output
    folds = {f["rising"]: f for f in json.loads((tmp_path / "t.json").read_text())["folds"]}
    for rising, true in ((True, max(turns())), (False, min(turns()))):
        assert folds[rising]["frequency"] == pytest.approx(true * hz, rel=5e-3)
        assert folds[rising]["low"] < folds[rising]["frequency"] < folds[rising]["high"]
    assert "A sweep of rising frequency jumps at" in done.output
    found = columns(tmp_path / "t.csv")
    size, low, high = (found[f"{name} [m]"] for name in ("displacement", "low", "high"))
    assert np.all((low <= size) & (size <= high))
    unstable = found["stable"] == "no"
    assert np.sum(unstable) > 10
    inside = found["frequency [Hz]"][unstable]
    assert folds[False]["frequency"] < inside.min() < inside.max() < folds[True]["frequency"]
    assert (tmp_path / "t.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "found_predicted.html").read_text(encoding="utf-8").count("image/png") == 1


def test_a_quick_sweep_jumps_late(run, tmp_path):
    """By a delay that grows as the rate to the power of two thirds (Jung and others, 1990)."""
    save(rs.ReducedModel.from_coefficients(DUFFING, unit="m"), reach=1.0)
    hz = 1 / (2 * np.pi)
    given = ["--force", FORCE, "--frequency", f"{0.8 * hz}:{1.7 * hz}", "--json", "t.json"]
    delays = []
    for rate in (1e-7, 8e-7):
        done = run("predict", "found.json", *given, "--sweep-rate", rate, "--overwrite")
        assert done.exit_code == 0, done.output
        assert f"A sweep of rising frequency at {rate:g} Hz/s jumps at" in done.output
        content = json.loads((tmp_path / "t.json").read_text())
        folds, jumps = ({f["rising"]: f for f in content[name]} for name in ("folds", "jumps"))
        assert content["sweep_rate"] == rate
        assert all(j["low"] < j["frequency"] < j["high"] for j in jumps.values())
        delays.append([jumps[up]["frequency"] - folds[up]["frequency"] for up in (True, False)])
    slow, quick = np.array(delays)
    assert slow[0] > 0 > slow[1]
    np.testing.assert_allclose(quick, 4 * slow, rtol=0.1)  # the law is that of slow sweeps
    refused = run("predict", "found.json", "--sweep-rate", 1)
    assert (
        refused.exit_code == 2 and "--sweep-rate is for the response to a --force" in refused.stderr
    )
    above = f"{1.01 * min(turns()) * hz}:{1.7 * hz}"  # the fold of the falling sweep lies below
    up = run("predict", "found.json", "--force", FORCE, "--frequency", above, "--sweep-rate", 1e-7)
    assert "rising frequency at 1e-07 Hz/s" in up.output and "falling" not in up.output
    quick = run("predict", "found.json", *given, "--sweep-rate", 1e-2, "--overwrite")
    assert "where it jumps is no more than a guess" in quick.output
    none = run("predict", "found.json", "--force", 1e-3 * FORCE, "--sweep-rate", 1)
    assert "A sweep jumps nowhere in this range." in none.output


def test_beyond_the_data_there_is_no_band_and_a_sentence_says_why(run, tmp_path):
    save(LINEAR, reach=1e-3)
    done = run("predict", "found.json", "--force", 0.5, "--frequency", "7:9", "--csv", "t.csv")
    assert done.exit_code == 0 and "there is no band; a smaller force" in done.output
    found = columns(tmp_path / "t.csv")
    beyond = found["displacement [m]"] > 1.02e-3  # amplitudes so much larger are as large
    assert np.array_equal(np.isnan(found["low [m]"]), beyond) and not beyond.all()
    (largest,) = re.findall(r"Largest: (\S+) m at", done.output)
    assert float(largest) == pytest.approx(0.5 / (C * np.sqrt(K)), rel=1e-3)


def test_a_model_alone_has_no_band(run, tmp_path):
    (tmp_path / "model.json").write_text(LINEAR.to_json())
    done = run("predict", "model.json", "--force", 0.5, "--frequency", "7:9", "--csv", "t.csv")
    assert done.exit_code == 0 and "No band: the file holds an equation" in done.output
    assert np.isnan(columns(tmp_path / "t.csv")["low [m]"]).all() and "low" not in done.output
    assert "at an end of the range" not in done.output
    assert (
        "at an end of the range"
        in run("predict", "model.json", "--force", 0.5, "--frequency", "7:7.5").output
    )
    refused = run("predict", "model.json")
    assert refused.exit_code == 2 and "give --amplitude" in refused.stderr


def test_several_coordinates_move_by_the_closed_form(run, tmp_path):
    """Two linear coordinates that nothing couples, one of which is pushed twice as hard."""
    named = {"omega^2 [q1]": K, "omega^2 [q2]": 4 * K, "c_linear [q1]": C, "c_linear [q2]": C}
    (tmp_path / "pair.json").write_text(rs.CoupledModel.from_coefficients(named, "m").to_json())
    arguments = ["--frequency", "7:9", "--csv", "t.csv"]
    assert run("predict", "pair.json", "--force", "0.5,1", *arguments).exit_code == 0
    found = columns(tmp_path / "t.csv")
    w = 2 * np.pi * found["frequency [Hz]"]
    for name, force, k in (("q1", 0.5, K), ("q2", 1.0, 4 * K)):
        size = force / np.abs(k - w**2 + 1j * C * w)
        # Straight between orbits: only those of the ends are not orbits.
        np.testing.assert_allclose(found[f"amplitude {name} [m]"], size, rtol=1e-3)
    refused = run("predict", "pair.json", "--force", 0.5)
    assert refused.exit_code == 2 and "has 1 of 2 numbers: give one for each" in refused.stderr


def test_the_bands_of_coupled_coordinates_are_the_closed_form(run, tmp_path):
    """Two masses with a spring and a damper between them, one input on both, and its errors."""
    named = {"omega^2 [q1]": K, "omega^2 [q2]": 1.3 * K, "omega^2 [q1 - q2]": 0.4 * K}
    named |= {"c_linear [q1]": C, "c_linear [q1 - q2]": 0.5 * C}
    named |= {"gain [force] [q1]": 0.7, "gain [force] [q2]": -0.3}
    save(rs.CoupledModel.from_coefficients(named, "m"), 3e-4)
    arguments = ["--force", 2, "--frequency", "7:14", "--csv", "t.csv", "--figure", "t.svg"]
    done = run("predict", "found.json", *arguments)
    assert done.exit_code == 0 and "Response to a force of 2 (unit of the input)" in done.stdout
    found = columns(tmp_path / "t.csv")
    w = 2 * np.pi * found["frequency [Hz]"]

    def size(values):
        k1, k2, k, c1, c, *gain = values.values()
        stiff = np.array([[k1 + k, -k], [-k, k2 + k]])
        damping = np.array([[c1 + c, -c], [-c, c]])
        rows = stiff - w[:, None, None] ** 2 * np.eye(2) + 1j * w[:, None, None] * damping
        return np.linalg.solve(rows, 2 * np.array(gain)[:, None])[..., 0].T

    q, off = size(named), 1e-6
    slopes = [np.abs(size(named | {n: (1 + off) * x})) - np.abs(q) for n, x in named.items()]
    half = 1.96 * 3e-4 / off * np.linalg.norm(slopes, axis=0)
    # The first coordinate nearly stands still between the resonances, where lines are bent.
    clear = np.abs(q) > 0.05 * np.abs(q).max(axis=1)[:, None]
    for i, name in enumerate(("q1", "q2")):
        at = clear[i]
        shown = found[f"displacement {name} [m]"]
        np.testing.assert_allclose(shown, np.abs(q[i]), rtol=2e-3, atol=2e-3 * np.abs(q[i]).max())
        turned = np.exp(1j * np.radians(found[f"phase {name} [deg]"])) - q[i] / np.abs(q[i])
        assert np.abs(turned[at]).max() < 0.02
        wide = (found[f"high {name} [m]"] - found[f"low {name} [m]"])[at]
        np.testing.assert_allclose(wide, 2 * half[i][at], rtol=0.2)  # as known from 400 draws
    peak = re.search(r"Largest: (\S+) m \((\S+) to (\S+)\) and (\S+) m \((\S+) to", done.stdout)
    assert peak and float(peak[2]) < float(peak[1]) < float(peak[3])


def test_a_band_does_not_know_how_coordinates_are_counted():
    """A hardening direction beside a stiff one, turned by an angle: the same jumps and bands."""
    w = np.array([0.6, 0.8])
    along, across = "[0.6 q1 + 0.8 q2]", "[0.8 q1 - 0.6 q2]"
    named = {f"omega^2 {along}": 1.0, f"gamma_3 {along}": GAMMA, f"c_linear {along}": 0.05}
    named |= {f"omega^2 {across}": 30.0, f"c_linear {across}": 0.3}
    pair, one = rs.CoupledModel.from_coefficients(named), rs.ReducedModel.from_coefficients(DUFFING)
    variance = np.diag([1e-3, 3e-3, 1e-3]) ** 2
    bands = [
        rs.Estimate(model, free, variance, VERDICT, ()).forced_response(force, (0.8, 1.7))
        for model, free, force in (
            (pair, tuple(named)[:3], FORCE * w),
            (one, ("omega^2", "gamma_3", "c_linear"), FORCE),
        )
    ]
    turned, plain = bands
    assert [fold.rising for fold in turned.folds] == [fold.rising for fold in plain.folds]
    for rate in (1e-5, -1e-5):
        (two,), (lone,) = turned.jumps(rate), plain.jumps(rate)
        assert two.frequency == pytest.approx(lone.frequency, rel=1e-4)
        assert two.high - two.low == pytest.approx(lone.high - lone.low, rel=0.1)
    at = np.array([0.9, 1.1, 1.2, 1.6])
    for branch in ("upper", "lower"):
        for several, single in zip(turned.at(at, branch), plain.at(at, branch), strict=True):
            np.testing.assert_allclose(several, np.outer(single, w), rtol=3e-3)


@pytest.mark.slow
def test_dry_friction_is_made_smooth(run, tmp_path):
    """Far above the friction, the first harmonic balances with that of a square wave."""
    named = {"omega^2": K, "c_linear": C, "c_coulomb": 0.05}
    model = rs.ReducedModel.from_coefficients(named, unit="m")
    (tmp_path / "dry.json").write_text(model.to_json())
    done = run("predict", "dry.json", "--force", 1.0, "--frequency", "7.9:8", "--json", "-")
    assert "Dry friction is made smooth below" in done.stderr
    content = json.loads(done.stdout)["columns"]
    size = max(content["amplitude [m]"])
    # At resonance the force is what damping takes, up to the smooth part of the stroke.
    assert size == pytest.approx((1.0 - 4 / np.pi * 0.05) / (C * np.sqrt(K)), rel=2e-3)


# -- without a force -------------------------------------------------------------------------------


def test_a_backbone_and_its_band(run, tmp_path):
    """Frequency by the exact one, damping of a linear damper, and errors by differences."""
    model = rs.ReducedModel.from_coefficients({"omega^2": K, "gamma_3": 5e4, "c_linear": C}, "m")
    save(model)
    done = run("predict", "found.json", "--csv", "t.csv", "--figure", "t.pdf")
    assert done.exit_code == 0, done.output
    found = columns(tmp_path / "t.csv")
    a = found["amplitude [m]"]
    assert a[[0, -1]] == pytest.approx([0.005, 0.1])
    np.testing.assert_allclose(found["frequency [Hz]"], model.backbone(a) / (2 * np.pi), rtol=1e-7)
    ends = []
    for name, value in model.coefficients.items():
        more, less = (
            rs.ReducedModel.from_coefficients(model.coefficients | {name: value * (1 + off)}, "m")
            for off in (1e-3, -1e-3)
        )
        ends.append((more.backbone(a) - less.backbone(a)) / 2)
    half = 1.96 * np.linalg.norm(ends, axis=0) / (2 * np.pi)
    np.testing.assert_allclose(found["high [Hz]"] - found["low [Hz]"], 2 * half, rtol=1e-3)
    far = run("predict", "found.json", "--amplitude", "0.05:0.2")
    assert "Beyond 0.1 m nothing was measured" in far.output


# -- steady states ---------------------------------------------------------------------------------

HEADER = "frequency [Hz],force [N],displacement [m],displacement phase [deg],spread [m]"


def write(path, w, force, q, spread):
    table = w / (2 * np.pi), force, np.abs(q), np.degrees(np.angle(q)), spread
    np.savetxt(path, np.column_stack(table), "%.12g", ",", header=HEADER, comments="")


def test_what_is_saved_of_steady_states_foretells_the_same(run, tmp_path):
    """A force in N, whose gain is fitted; only points of the smaller one take part."""
    w = np.tile(2 * np.pi * np.linspace(7.5, 8.5, 20), 2)
    force = np.repeat([0.1, 0.4], 20)
    rng = np.random.default_rng(0)
    spread = np.full(40, 1e-5)
    noise = spread * (rng.standard_normal(40) + 1j * rng.standard_normal(40))
    q = 2.0 * force / (K - w**2 + 1j * C * w)
    write(tmp_path / "points.csv", w, force, q + noise, spread)
    wanted = ["--term", "c_linear", "--save", "found.json"]
    done = run("steady", "points.csv", "--force", "0.05:0.2", *wanted, "--json", "s.json")
    assert done.exit_code == 0, done.output
    assert "20 of 40 steady states are used, under 0.05 to 0.2 N; 20 are left out." in done.output
    (content,) = json.loads((tmp_path / "s.json").read_text())
    assert content["points"] == 20 and content["left_out"] == 20
    done = run("predict", "found.json", "--force", 0.4, "--csv", "t.csv")
    assert "Response to a force of 0.4 N" in done.output
    assert "the force 0.4 was not measured: those of the test are 0.1 to 0.1 N" in done.output
    found = columns(tmp_path / "t.csv")
    w = 2 * np.pi * found["frequency [Hz]"]
    assert w[[0, -1]] == pytest.approx(2 * np.pi * np.array([7.5, 8.5]))  # of the points
    true = 2.0 * 0.4 / np.abs(K - w**2 + 1j * C * w)
    assert np.all((found["low [m]"] <= true) & (true <= found["high [m]"]))
    none = run("steady", "points.csv", "--force", "1:2")
    assert none.exit_code == 2 and "those of the table are 0.1 to 0.4" in none.stderr


def test_a_saved_test_reads_back_as_it_was():
    w = np.linspace(0.8, 1.2, 30)
    model = rs.ReducedModel.from_coefficients({"omega^2": 1.1, "c_linear": 0.2})
    noise = 1e-3 * np.random.default_rng(1).standard_normal(30)
    fit = rs.fit_steady(model, w, np.ones(30), 0.2 / (1 - w**2 + 0.1j * w) + noise, std=1e-3)
    saved = SteadyEstimate.from_json(fit.to_json())
    one, other = (x.forced_response(0.7, (0.8, 1.2)) for x in (fit, saved))
    for name in ("amplitude", "low", "high"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert saved.chain == fit.chain and saved.interval("c_linear") == fit.interval("c_linear")
    content = json.loads(fit.to_json())
    content["test"]["form"] = [[0.0]]
    with pytest.raises(ValueError, match="does not belong to the coefficients"):
        SteadyEstimate.from_json(json.dumps(content))
    del content["test"]
    with pytest.raises(ValueError, match="write it again with romsindy steady --save"):
        SteadyEstimate.from_json(json.dumps(content))


def test_a_file_without_its_test_asks_for_a_force_per_unit_mass(run, tmp_path):
    w = np.linspace(45.0, 55.0, 30)
    model = rs.ReducedModel.from_coefficients({"omega^2": K, "c_linear": 1.0}, unit="m")
    fit = rs.fit_steady(model, w, np.ones(30), 0.2 / (K - w**2 + 1j * C * w))
    content = json.loads(fit.to_json())
    del content["test"]
    (tmp_path / "old.json").write_text(json.dumps(content))
    done = run("predict", "old.json", "--force", 0.1)
    assert "The file knows no gain: --force is a force per unit mass" in done.output


@pytest.mark.slow
def test_a_level_that_was_left_out_lies_in_its_band(run, tmp_path):
    """Three levels of a branch with its unstable part, of an oscillator that was not simulated by
    the package: the largest, 1.8 times the next, is left out. Points between folds belong to the
    nearest band."""
    one, kind, w, force, response, spread = steady_points.measured(302)
    assert kind == "branch"
    write(tmp_path / "points.csv", w, force, response[:, 0], spread[:, 0])
    largest = one.force(one.size, one.resonance(one.size))
    used = f"{0.1 * largest}:{0.7 * largest}"
    terms = [x for name in one.truth for x in ("--term", name)]
    done = run("steady", "points.csv", "--force", used, *terms, "--save", "found.json")
    assert done.exit_code == 0, done.output
    curve = one.branch(largest, np.array([*np.linspace(0.1, 0.97, 60), 0.985, 0.9995]))
    band = SteadyEstimate.load(tmp_path / "found.json").forced_response(
        largest, (0.98 * curve[:, 1].min(), 1.02 * curve[:, 1].max())
    )
    inside = [any(s.low <= size <= s.high for s in band.steady_states(at)) for size, at in curve]
    # 95 % of a point; along a curve they are hardly independent.
    assert np.mean(inside) > 0.85


# -- what cannot be --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--force", "x"], "'x' is no positive number, such as 0.2"),
        (["--force", "-1"], "'-1' is no positive number"),
        (["--force", "0"], "'0' is no positive number"),
        (["--force", "1,2"], "--force has 2 of 1 numbers: give one"),
        (["--force"], "--force is the force of a test, such as --force 0.2; files are overwritten"),
        (["--force", "--full"], "files are overwritten with --overwrite"),
        (["--force", "1", "--frequency", "9:7"], "'9:7' is not LOW:HIGH"),
        (["--force", "1", "--frequency", "0:7"], "'0:7' is not LOW:HIGH"),
        (["--force", "1", "--frequency", "7"], "'7' is not LOW:HIGH"),
        (["--force", "1", "--amplitude", "1:2"], "--amplitude is for a backbone: leave it out"),
        (["--frequency", "7:9"], "--frequency is for the response to a --force: give both"),
        (["--amplitude", "2:1"], "'2:1' is not LOW:HIGH"),
    ],
)
def test_options_that_cannot_be(run, options, words):
    save(LINEAR)
    refused = run("predict", "found.json", *options)
    assert refused.exit_code == 2 and words in refused.stderr, refused.stderr
    assert refused.stderr.count("\n") == 1


def test_where_there_is_no_response_it_is_said(run, tmp_path):
    """Undamped, in resonance at the first frequency."""
    model = rs.ReducedModel.from_coefficients({"omega^2": (2 * np.pi * 8) ** 2}, unit="m")
    (tmp_path / "model.json").write_text(model.to_json())
    refused = run("predict", "model.json", "--force", 1, "--frequency", "8:9")
    assert (
        refused.exit_code == 2
        and "no response to a force per unit mass of 1 m/s^2 is found" in (refused.stderr)
    )


@pytest.mark.parametrize("text", ["hello", '{"a": 1}', "[1]"])
def test_a_file_that_is_no_result_is_refused(run, tmp_path, text):
    (tmp_path / "no.json").write_text(text)
    refused = run("predict", "no.json", "--force", 1)
    assert refused.exit_code == 2 and refused.stderr.startswith("Error: no.json: ")
    assert "FOUND is what identify --save or steady --save wrote" in refused.stderr
