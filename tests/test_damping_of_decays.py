"""How much of the damping is linear, how much quadratic; and where it vanishes."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

import romsindy as rs
from romsindy.commands.main import main
from romsindy.record.backbone import PQ

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import damping

sys.path.pop(0)


def decay_of(model, start, unit="m", cycles=20):
    period = 2 * np.pi / np.sqrt(model.coefficients["omega^2"])
    t = np.arange(0.0, cycles * period, period / 60)
    clean = model.simulate(start, 0.0, t)
    return rs.add_noise(rs.Decay(t, clean.q, unit=unit, stage="free"), 46, seed=3)


ROLL = rs.ReducedModel.from_coefficients(
    {"omega^2": 4.0, "c_linear": 0.04, "c_quadratic": 0.3}, unit="rad"
)


@pytest.fixture(scope="module")
def rolled():
    return rs.identify(decay_of(ROLL, 0.3, "rad"))


def test_the_p_q_method_reads_small_damping():
    """Its formulas are of first order in the loss of a half-cycle, here some 4 %."""
    t = np.arange(0.0, 60.0, 0.02)
    clean = rs.Decay(t, ROLL.simulate(0.3, 0.0, t).q, unit="rad", stage="free")
    read = PQ.of([clean, clean])
    assert_allclose(read.values, [0.04, 0.3], rtol=0.02)
    assert read.half_cycles == 2 * PQ.of([clean]).half_cycles > 60


def test_linear_and_quadratic_damping_are_told_apart(rolled):
    split = rolled.damping
    for (value, low, high), true in ((split.linear, 0.04), (split.quadratic, 0.3)):
        assert low <= true <= high and low < value < high
        assert high - low < 0.3 * true
    assert split.explained and split.half_cycles > 30
    assert "linear" in split.sentence("rad") and "1/rad quadratic" in split.sentence("rad")
    assert split.sentence("rad") in rolled.ends()
    assert split.table("rad").rows[2][0] == f"P-Q, {split.half_cycles} half-cycles"


def test_three_cycles_are_enough():
    split = rs.identify(decay_of(ROLL, 0.3, "rad", cycles=3)).damping
    for (_, low, high), true in ((split.linear, 0.04), (split.quadratic, 0.3)):
        assert low <= true <= high and high - low < 2.5 * true


def test_it_is_asked_of_angles_and_on_demand(rolled):
    decay = decay_of(ROLL, 0.3)
    assert rs.identify(decay).damping is None
    asked = rs.identify(decay, damping_split=True)
    assert_allclose(asked.damping.linear, rolled.damping.linear, rtol=1e-6)
    with pytest.raises(ValueError, match="damping_split = True must be left out"):
        rs.identify(decay, 2, damping_split=True)


@pytest.mark.slow
def test_all_releases_count_together():
    one, both = (
        rs.identify([decay_of(ROLL, a, "rad", cycles=8) for a in starts]).damping
        for starts in ((0.3,), (0.3, 0.15))
    )
    assert np.ptp(both.linear[1:]) < np.ptp(one.linear[1:])
    assert both.half_cycles == 2 * one.half_cycles


def test_it_is_saved_and_read_again(rolled, tmp_path):
    again = rs.Identification.from_json(rolled.to_json())
    assert again.damping == rolled.damping
    content = json.loads(rolled.to_json())
    content["damping"]["linear"] = [1.0, 2.0]
    with pytest.raises(ValueError, match="three numbers"):
        rs.Identification.from_json(json.dumps(content))
    del content["damping"]["linear"]
    with pytest.raises(ValueError, match="damping holds"):
        rs.Identification.from_json(json.dumps(content))


def test_the_command_prints_it_and_writes_it_for_hydrodyn(tmp_path):
    decay = decay_of(ROLL, 0.3, "rad")
    table = np.column_stack([decay.t, np.degrees(decay.q)])
    file = tmp_path / "roll.csv"
    np.savetxt(file, table, delimiter=",", header="time [s],roll [deg]", comments="")
    saved = tmp_path / "found.json"
    run = CliRunner().invoke(main, ["identify", str(file), "--save", str(saved)])
    assert run.exit_code == 0 and "Damping by these two alone: " in run.output
    options = ["--to", "openfast", "--inertia", "1e9", "--freedom", "roll"]
    told = CliRunner().invoke(main, ["export", str(saved), *options])
    assert told.exit_code == 0 and "subtract what the model has already" in told.output
    split = rs.Identification.load(saved).damping
    numbers = [
        line.split()[:6] for line in told.output.splitlines() if line.strip() and line[0] != "!"
    ]
    added = np.array(numbers, float).reshape(2, 6, 6)
    assert_allclose(added[:, 3, 3], [1e9 * split.linear[0], 1e9 * split.quadratic[0]], rtol=1e-7)
    added[:, 3, 3] = 0
    assert not np.any(added)


@pytest.mark.parametrize(
    ("model", "options", "words"),
    [
        (ROLL, ["--inertia", "2", "--freedom", "heave"], "q is in rad, and heave in m"),
        (ROLL, ["--inertia", "2"], "go together"),
        (
            rs.ReducedModel.from_coefficients({"omega^2": 4.0, "delta_2": 0.1}, unit="m"),
            ["--inertia", "2", "--freedom", "heave"],
            "is not linear and quadratic alone (delta_2)",
        ),
    ],
)
def test_what_hydrodyn_cannot_have_is_refused(tmp_path, model, options, words):
    file = tmp_path / "model.json"
    file.write_text(model.to_json())
    told = CliRunner().invoke(main, ["export", str(file), "--to", "openfast", *options])
    assert told.exit_code and words in told.output


def test_a_model_alone_is_written_for_hydrodyn(tmp_path):
    file = tmp_path / "model.json"
    file.write_text(ROLL.to_json())
    options = ["--to", "openfast", "--inertia", "2", "--freedom", "pitch"]
    told = CliRunner().invoke(main, ["export", str(file), *options])
    assert told.exit_code == 0 and "8.00000000E-02" in told.output
    assert "6.00000000E-01" in told.output and "95 %" not in told.output


@pytest.mark.parametrize("language", ["openfast", "text"])
def test_inertia_and_freedom_belong_to_hydrodyn(tmp_path, language):
    file = tmp_path / "model.json"
    file.write_text(ROLL.to_json())
    told = CliRunner().invoke(main, ["export", str(file), "--to", language, "--inertia", "2"])
    assert told.exit_code == 2 and "go together" in told.output


@pytest.mark.parametrize(
    "seed", [41, pytest.param(57, marks=pytest.mark.slow)], ids=["cubic", "by place"]
)
def test_the_limit_cycle_is_foretold(seed):
    """Against one found by bisection with another integrator."""
    decay, true = damping.flutter(seed)
    found = rs.identify(decay)
    cycle = found.limit_cycle
    assert cycle.low <= true <= cycle.high and cycle.high - cycle.low < 0.4 * true
    assert cycle.sentence("m") in found.ends()
    assert rs.Identification.from_json(found.to_json()).limit_cycle == cycle


@pytest.mark.slow
def test_what_is_known_stays_known():
    """Of the split, and of the limit cycle, which a wrong frequency would move."""
    split = rs.identify(decay_of(ROLL, 0.3, "rad"), fixed={"c_linear": 0.04}).damping
    assert np.ptp([*split.linear, 0.04]) < 1e-12 and split.quadratic[1] <= 0.3 <= split.quadratic[2]
    decay, true = damping.flutter(41)
    free = rs.identify(decay)
    known = free.single_model.coefficients["omega^2"]
    cycle = rs.identify(decay, fixed={"omega^2": known}).limit_cycle
    assert cycle.low <= true <= cycle.high


def test_no_limit_cycle_where_damping_does_not_fall(rolled):
    assert rolled.limit_cycle is None


@pytest.mark.slow
def test_small_benchmarks_of_damping():
    holds, count, width, other = damping.main(["roll", "--first", "900", "--count", "8"])
    assert count >= 6 and np.all(holds >= count - 1) and np.all(width < other)
    inside, count, widest = damping.main(["flutter", "--first", "900", "--count", "4"])
    assert inside == count and widest <= 0.2
