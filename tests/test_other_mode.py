"""A mode that takes part is named by its resonance; one that only rings along is not."""

import importlib
import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.diagnosis import other_mode
from romsindy.effects import CubicStiffness, DryFriction, Hum, SecondMode
from romsindy.fit.records.record import Record
from romsindy.record.files import load_decay
from romsindy.record.files.save import save_decay
from romsindy.record.ringing import beside

OMEGA, GAMMA, DAMPING = 2 * np.pi * 10.0, 900.0, 0.6
SEEN, NOISE = 0.5, 1e-3  # what the sensor shows of the other mode; m
COEFFICIENTS = {"omega^2": OMEGA**2, "gamma_3": GAMMA, "c_linear": DAMPING}
MODEL = rs.ReducedModel.from_coefficients(COEFFICIENTS, unit="m")
FEW = (CubicStiffness(), SecondMode())


def decay(ratio=3.1, start=(0.8, 0.3), power=(3, 1), k=0.0, friction=0.0, hum=0.0, seed=0):
    """Two oscillators, the first one hard, with a potential k q1^a q2^b, seen by one sensor."""
    a, b = power

    def rates(_, y):
        q1, q2, v1, v2 = y
        f1 = GAMMA * q1**3 + DAMPING * v1 + friction * np.tanh(v1 / 0.3)
        f1 += k * a * q1 ** (a - 1) * q2**b
        f2 = 0.8 * v2 + k * b * q1**a * q2 ** (b - 1)
        return [v1, v2, -(OMEGA**2) * q1 - f1, -((ratio * OMEGA) ** 2) * q2 - f2]

    t = np.arange(0, 3, 1 / 150)
    options = {"t_eval": t, "method": "DOP853", "rtol": 1e-9, "atol": 1e-12}
    q = solve_ivp(rates, (0, 3), [*start, 0.0, 0.0], **options).y[:2].T @ [1, SEEN]
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(t))
    return rs.Decay(t, q + hum * np.sin(2 * np.pi * 50 * t + 0.3) + noise, unit="m")


# Friction is not viscous damping by more than this, but by less than tests repeat to.
FINE = {"frequency": 1e-4, "damping": 1e-2, "signal": 2e-4}


@pytest.fixture(scope="module")
def one_to_three():
    return rs.diagnose(MODEL, decay(k=600.0), catalogue=FEW)


@pytest.mark.slow
def test_a_mode_in_resonance_is_named_and_added(one_to_three):
    report = one_to_three
    assert (report.verdict, report.left, report.effects) == ("named", "noise", ())
    assert "a mode at 31" in report.sentence and "through a 1:3 resonance near" in report.sentence
    assert [t.key for t in report.interaction.couplings] == ["V q1^3 q2"]
    # The sensor shows half of q2: all its values are those of q2 / 2, whose mass is four.
    values, errors = report.model.coefficients, report.fit.standard_errors
    truth = {"omega^2 [q1]": OMEGA**2, "gamma_3 [q1]": GAMMA, "V q1^3 q2": 600 / SEEN}
    for name, value in truth.items():
        assert values[name] == pytest.approx(value, abs=4 * errors[name])
    # Where the frequency of the first mode is a third of that of the other.
    sizes = np.linspace(0.1, 0.9, 400)
    there = np.interp(3.1 / 3 * OMEGA, MODEL.backbone(sizes), sizes)
    assert report.interaction.resonance.amplitude == pytest.approx(there, rel=0.1)


@pytest.mark.slow
def test_the_gap_shrinks_on_equal_footing(one_to_three):
    found, gap = one_to_three.interaction, one_to_three.gap
    assert found.before > 10 > 1.25 > found.after
    assert gap.before > 10 > 1.25 > gap.after and gap.closed > 0.99
    alone, together = found.left
    assert f"one coordinate leaves {alone}" in one_to_three.sentence
    assert f"two leave {together}" in one_to_three.sentence
    assert alone.endswith(f"{found.before:.3g} times the noise")


@pytest.mark.slow
def test_words_table_json_and_page_agree(one_to_three, tmp_path):
    report = one_to_three
    content = json.loads(report.to_json())
    assert content["interaction"]["couplings"] == ["V q1^3 q2"] and content["effects"] == []
    assert content["interaction"]["resonance"]["q"] == 3
    assert rs.CoupledModel.from_json(json.dumps(content["model"])).n_coordinates == 2
    (row,) = report.table()[1:]
    assert row[:3] == ["another mode", "1:3", "V q1^3 q2"]
    assert {"gap", "amplitude", "time", "coordinates"} == {*report.pictures()}
    caption = report.pictures()["coordinates"].caption
    assert f"one coordinate leaves {report.interaction.left[0]}" in caption
    report.to_html(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "One coordinate and two" in page and "q2_ddot" in page
    assert repr(report).startswith("<InteractionReport: named")


@pytest.mark.slow
def test_a_resonance_of_one_to_two():
    report = rs.diagnose(MODEL, decay(2.07, power=(2, 1), k=500.0, seed=1), catalogue=FEW)
    assert report.verdict == "named" and "through a 1:2 resonance" in report.sentence
    assert [t.key for t in report.interaction.couplings] == ["V q1^2 q2"]


@pytest.mark.slow
def test_a_mode_may_take_part_without_a_ratio():
    report = rs.diagnose(MODEL, decay(2.41, power=(2, 1), k=1500.0), catalogue=FEW)
    assert report.verdict == "named" and "takes part (V q1^2 q2" in report.sentence
    assert report.table()[1][1] == ""


def test_a_mode_that_only_rings_is_a_second_mode():
    report = rs.diagnose(MODEL, decay(), catalogue=FEW)
    assert type(report) is rs.diagnosis.DiagnosisReport and report.notes == ()
    assert [e.name for e in report.effects] == ["second_mode"]


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [3.1, 2.6])
def test_it_is_not_blamed_for_what_is_missing(ratio):
    """Friction that no catalogue holds is left; that the mode has no part in it is said."""
    report = rs.diagnose(MODEL, decay(ratio, friction=3.0), catalogue=FEW, tolerance=FINE)
    assert report.verdict == "unknown" and report.model.coefficients.keys() == COEFFICIENTS.keys()
    assert f"a mode at {10 * ratio:.4g} Hz rings along, and is not seen to" in report.sentence


@pytest.mark.slow
def test_friction_beside_a_mode_that_only_rings():
    report = rs.diagnose(MODEL, decay(friction=3.0), catalogue=(*FEW, DryFriction()))
    assert type(report) is rs.diagnosis.DiagnosisReport and report.notes == ()
    assert {e.name for e in report.effects} == {"second_mode", "dry_friction"}


@pytest.mark.slow
def test_one_mode_is_not_looked_at_twice(monkeypatch):
    """Hum, and what is missing of the one mode: the report is what it was."""
    monkeypatch.setattr(other_mode, "interaction_of", None)
    linear = rs.ReducedModel.from_coefficients(
        {k: COEFFICIENTS[k] for k in ("omega^2", "c_linear")}, unit="m"
    )
    one = decay(start=(0.8, 0.0))
    report = rs.diagnose(linear, one, catalogue=FEW)
    assert [e.name for e in report.effects] == ["cubic_stiffness"]
    module = importlib.import_module("romsindy.diagnosis.diagnose")
    monkeypatch.setattr(module, "with_other_mode", lambda found, options: found)
    assert rs.diagnose(linear, one, catalogue=FEW).to_json() == report.to_json()
    humming = decay(start=(0.8, 0.0), hum=0.02, friction=3.0)
    found = rs.diagnose(MODEL, humming, catalogue=(*FEW, Hum()), tolerance=FINE)
    assert found.verdict == "unknown"


@pytest.mark.study
@pytest.mark.slow
def test_the_clamped_beam_lacks_its_third_mode(measured, monkeypatch):
    """The first mode crosses a fifth of 376 Hz near 1 mm: 0.8 s about that, smooth laws alone."""
    for kinds in ("_ALONE", "_TOGETHER"):
        monkeypatch.setattr(other_mode, kinds, getattr(other_mode, kinds)[:1])
    file = measured / "cc_beam_bristol.npz"
    run = rs.load_decay(file, "m/s", column="mode1b_v", time="mode1b_t").free()
    known = {"omega^2": 8.3e4, "gamma_3": 2.2e11, "c_linear": 1.4}
    model = rs.ReducedModel.from_coefficients(known, unit="m")
    report = rs.diagnose(model, run.between(2.3, 3.1), catalogue=FEW[:1], max_effects=0)
    assert report.verdict == "named" and "through a 1:5 resonance near 1.0" in report.sentence
    assert "V q1^3 q2" in {t.key for t in report.interaction.couplings}
    assert report.interaction.before > 5 * report.interaction.after


def ringing(ratio):
    """A decay whose second mode rings with so many times the acceleration of the first."""
    t = np.arange(0, 12, 0.004)
    waves = (np.exp(-0.005 * w * t) * np.cos(w * t) for w in (2 * np.pi * 5.0, 2 * np.pi * 31.0))
    first, second = waves
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(t))
    return rs.Decay.from_acceleration(t, first + ratio * second + noise, unit="m")


@pytest.mark.parametrize("ratio", [0.0, 0.15, 2.0])
def test_a_mixture_of_modes_is_told_by_its_accelerations(ratio, tmp_path):
    decay = rs.inspect(ringing(ratio)).decays()[0]
    # Both die in time with their frequency: what was followed begins within a window of it.
    assert decay.beside == pytest.approx(ratio, rel=0.1)
    assert beside(ringing(ratio), np.array([5.0])) == pytest.approx(ratio, rel=0.1)
    path = tmp_path / "alone.csv"
    save_decay(decay, path)
    assert load_decay(path).beside == decay.beside
    said = " ".join(Record.of(decay, 1e-6).remarks)
    assert ("this mixture of modes" in said) == (ratio > 0.3)
