"""What a model of several coordinates lacks, against two modes of a simulator of its own."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.commands.main import main
from romsindy.diagnosis import CoupledDiagnosis
from romsindy.diagnosis.residual_workflow import linear_values
from romsindy.effects import AirDrag, CubicStiffness, DryFriction, Hysteretic, QuinticStiffness
from romsindy.fit.kernel.collocation import Grid, Trajectory
from romsindy.fit.kernel.equation import ExtendedEquation
from romsindy.fit.kernel.linear_response import nodes
from romsindy.fit.kernel.part import Coefficient, OnCoordinate, Part

W1, W2 = 2 * np.pi * 5.0, 2 * np.pi * 13.4
C1, C2, G1, G2, K = 0.35, 0.8, 40.0, -900.0, 250.0
KNOWN = {
    "omega^2 [q1]": W1**2,
    "omega^2 [q2]": W2**2,
    "c_linear [q1]": C1,
    "c_linear [q2]": C2,
    "gamma_3 [q1]": G1,
    "gamma_3 [q2]": G2,
    "V q1^2 q2": K,
}
MODEL = rs.CoupledModel.from_coefficients(KNOWN, unit="m")
# What three sensors show of the modes: those that move most are off by half a per cent.
SHOWN = np.array([[1.005, -0.4], [0.45, 0.995], [0.8, 0.6]])
FEW = (CubicStiffness(), AirDrag(), DryFriction())


def nothing(q1, q2, v1, v2):
    return 0.0, 0.0


def decay(more=nothing, seed=0, size=1.0, snr=45.0, shown=SHOWN, stiff=1.0):
    """All that rings, with forces per unit mass on both left sides that the model lacks."""

    def rates(_, y):
        q1, q2, v1, v2 = y
        first, second = more(*y)
        first += stiff * W1**2 * q1 + C1 * v1 + G1 * q1**3 + 2 * K * q1 * q2
        second += W2**2 * q2 + C2 * v2 + G2 * q2**3 + K * q1**2
        return [v1, v2, -first, -second]

    t = np.arange(0, 6, 1 / 160)
    start = [size, 0.5 * size, 0.0, 0.0]
    options = {"t_eval": t, "method": "DOP853", "rtol": 1e-8, "atol": 1e-10}
    seen = solve_ivp(rates, (0, 6), start, **options).y[:2].T @ shown.T
    noise = np.random.default_rng(seed).standard_normal(seen.shape)
    return rs.Decay(t, seen + seen.std(axis=0) * 10 ** (-snr / 20) * noise, unit="m", stage="free")


def cubic(q1, q2, v1, v2):
    return 40.0 * q1**3, 0.0


@pytest.fixture(scope="module")
def cubic_in_mode_1():
    return rs.diagnose(MODEL, decay(cubic), catalogue=FEW)


def test_cubic_stiffness_of_one_mode_is_named_with_its_coordinate(cubic_in_mode_1):
    report = cubic_in_mode_1
    assert isinstance(report, CoupledDiagnosis) and report.verdict == "named", report
    (found,) = report.effects
    assert found.name == "cubic_stiffness [q1]" and "of mode 1" in found.label
    # The scale of q1 is known to a per cent: twice that of what goes with its square.
    assert found.values["strength"] == pytest.approx(40.0, rel=0.03)
    assert report.model.coefficients["gamma_3 [q1]"] == pytest.approx(G1 + 40.0, rel=0.02)
    assert report.gap.before > 10 * report.gap.after and report.gap.closed > 0.99


def test_what_was_found_is_written(cubic_in_mode_1, tmp_path):
    content = json.loads(cubic_in_mode_1.to_json())
    assert rs.CoupledModel.from_json(json.dumps(content["model"])).n_coordinates == 2
    cubic_in_mode_1.to_html(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "q2_ddot" in page and "Of record 1, channel" in page
    assert "Next: to confirm it" in cubic_in_mode_1.sentence


@pytest.mark.parametrize(("seed", "size"), [(1, 1.0), (2, 1.01)])
def test_nothing_is_missing(seed, size):
    """The second is a repeat that was let go from 1 % more."""
    report = rs.diagnose(MODEL, [decay(seed=seed, size=size), decay(seed=seed + 9, size=0.7)])
    assert report.verdict == "none" and not report.effects, report
    assert report.model == report.nominal and "They agree" in report.sentence


@pytest.mark.slow
def test_a_change_within_the_tolerance_is_none_and_beyond_it_is_told():
    stiffer = decay(stiff=1.004)  # 0.2 % in frequency
    assert rs.diagnose(MODEL, stiffer, tolerance=0.003, catalogue=()).verdict == "none"
    report = rs.diagnose(MODEL, stiffer, catalogue=())
    assert report.verdict == "named" and report.best.names == ("linear_frequency [q1]",)
    (found,) = report.effects
    assert found.relative == pytest.approx(0.004, abs=2e-4)
    assert "omega^2 [q1]" in str(found)


@pytest.mark.study
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("dry_friction [q2]", lambda q1, q2, v1, v2: (0.0, 2.0 * np.tanh(v2 / 0.02))),
        ("quadratic_drag [q1]", lambda q1, q2, v1, v2: (0.01 * abs(v1) * v1, 0.0)),
        ("coupling V q1^2 q2^2", lambda q1, q2, v1, v2: (300 * q1 * q2**2, 300 * q1**2 * q2)),
    ],
)
def test_one_effect_more_is_named(name, more):
    decays = [decay(more, i, size) for i, size in enumerate((1.0, 0.7))]
    report = rs.diagnose(MODEL, decays)
    assert report.verdict == "named" and report.best.names == (name,), report
    # Noise is known to a few per cent where two modes ring.
    assert report.remainder.ratio < 1.1 and report.gap.closed > 0.98


@pytest.mark.slow
def test_a_record_that_took_no_part_judges_and_one_channel_is_enough():
    both = np.array([[1.005, 0.995]])
    one, test = (decay(cubic, i, size, shown=both) for i, size in enumerate((1.0, 0.8)))
    report = rs.diagnose(MODEL, one, held_out=test, catalogue=FEW)
    assert report.verdict == "named" and report.best.names == ("cubic_stiffness [q1]",), report
    assert report.gap.where == "the record that took no part" and report.gap.closed > 0.99


@pytest.mark.slow
def test_what_a_fit_knows_no_better_is_no_effect():
    """Nothing is named of a model that was fitted to another decay, by its standard errors."""
    fit = rs.refine(MODEL, decay(seed=5))
    report = rs.diagnose(fit, decay(seed=6, size=0.9), catalogue=FEW)
    assert report.verdict == "none", report


def test_an_effect_pulls_at_its_coordinate_alone():
    """Force and slopes against a model that has the law among its terms."""
    rng = np.random.default_rng(0)
    grid = Grid(0.0, 0.01, 4, np.zeros(1, int), np.zeros(1))
    motion = Trajectory(grid, *rng.normal(size=(2, 5, 2)), rng.normal(size=(4, 3, 2)))
    law = QuinticStiffness()
    part = Part(OnCoordinate(law, 2, None), (), np.full((1, 1), 3.0))
    beside = ExtendedEquation(MODEL, (part,), 0, 0.01, 0.0)
    values = {**KNOWN, f"{law.term().key} [q2]": 3.0}
    inside = ExtendedEquation(rs.CoupledModel.from_coefficients(values, "m"), (), 0, 0.01, 0.0)
    at = nodes(motion)
    for mine, theirs in zip(beside.linearise(*at), inside.linearise(*at), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-12, atol=1e-9)
    by_value = beside.by_parameter(*at)[0]
    np.testing.assert_allclose(by_value[:, 1], at[1][:, 1] ** 5)
    assert not np.any(by_value[:, 0])


def test_names_follow_the_coordinate():
    on = OnCoordinate(Hysteretic(), 2, None)
    assert on.name == "hysteretic [q2]" and on.resembles == ("rubbing [q2]",)
    assert on.shaped({"exponent": 0.9}).of.exponent == 0.9
    assert [e.name for e in linear_values(MODEL).values()][:2] == [
        "linear_frequency [q1]",
        "viscous [q1]",
    ]
    assert isinstance(linear_values(MODEL)["c_linear [q2]"], Coefficient)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"free": ["gamma_3"]}, r"\['gamma_3'\] cannot be free; use names of .*c_linear \[q2\]"),
        ({"tolerances": {"gamma_3": 0.1}}, "the model has .*gamma_3 .q1."),
        ({"reference": decay}, "reference = ... does not go with a model of several coordinates"),
        ({"repeats": decay}, "repeats holds 1 record: give two or more"),
    ],
)
def test_what_cannot_be_meant_is_refused(given, words):
    given = {k: v(snr=60) if v is decay else v for k, v in given.items()}
    with pytest.raises(ValueError, match=words):
        rs.diagnose(MODEL, decay(), **given)


def test_a_mode_that_does_not_ring_is_refused():
    other = rs.CoupledModel.from_coefficients(KNOWN | {"omega^2 [q2]": 4 * W2**2}, unit="m")
    with pytest.raises(ValueError, match=r"a mode of 26.* Hz, but nothing near it rings"):
        rs.diagnose(other, decay())


def test_driven_records_are_of_one_coordinate():
    t = np.arange(0, 5, 0.01)
    driven = rs.ForcedVibration(t, np.sin(30 * t), np.cos(30 * t), unit="m", input_unit="N")
    with pytest.raises(ValueError, match="a CoupledModel, and forced vibrations are compared"):
        rs.diagnose(MODEL, driven)


def test_the_command_takes_all_that_rings(tmp_path):
    record = decay(seed=3)
    table = np.column_stack([record.t, record.q])
    np.savetxt(tmp_path / "d.csv", table, delimiter=",", header="t,a,b,c", comments="")
    (tmp_path / "m.json").write_text(MODEL.to_json())
    given = ["diagnose", "--measured", f"{tmp_path / 'd.csv'}", "--model", f"{tmp_path / 'm.json'}"]
    given += ["--unit", "m", "--report", f"{tmp_path / 'r.html'}", "--whole"]
    told = CliRunner().invoke(main, [*given, "--column", "a", "--column", "b"])
    assert told.exit_code == 0 and told.output.startswith("none"), told.output
    refused = CliRunner().invoke(main, [*given[:-1], "--mode", "1"])
    assert refused.exit_code == 2 and "the model is of several" in refused.output
