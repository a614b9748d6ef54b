"""Which differences matter, what takes no part, and the words for it."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from test_diagnosis import LONG, MODEL, OMEGA, decay

import romsindy as rs
from romsindy.commands.main import main
from romsindy.diagnosis import decay_search, diagnose, search
from romsindy.diagnosis.arguments import of_repeats, stated
from romsindy.diagnosis.difference import WIDEST, Difference, Tolerance
from romsindy.diagnosis.held_out import SHORTEST, parted
from romsindy.diagnosis.search import Screened
from romsindy.diagnosis.simulated import model_of_simulation
from romsindy.diagnosis.words import odds
from romsindy.effects import CubicStiffness, Hysteretic
from romsindy.effects.outside import Hum, SecondMode
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record, scales
from romsindy.fit.refine import refine
from romsindy.text import percent

OTHER = {"c_linear": 1.1 * 0.01 * OMEGA}  # ten per cent more damping


@pytest.fixture
def no_search(monkeypatch):
    """Whatever is found without a search is found."""

    def refuse(self):
        raise AssertionError("a search was started")

    monkeypatch.setattr(decay_search.DecaySearch, "run", refuse)


def test_beside_fewer_effects_a_value_that_moved_has_what_does_the_same():
    """In one mode hysteretic damping is viscous damping, 50 % more, but for what 25 dB hide."""
    more = {"c_linear": 0.015 * OMEGA, "gamma_3": 0.3 * OMEGA**2}
    records = [Record.loud(decay(0.3, changed=more, snr_db=25), 2e-4)]
    known = scales(records)
    options = search.Options((CubicStiffness(), Hysteretic()), 0.01, 2, 2e-4, 1, lambda text: None)
    unsure = search.unsure_parts(MODEL, ("omega^2", "c_linear"), {}, known, 1)
    matters = {"viscous": 0.05 * 0.01 * OMEGA}
    noise = decay_search.ProcessNoise(matters=matters)
    looked = decay_search.DecaySearch(MODEL, records, unsure, options, noise)
    best = looked.hypothesis([Part.of(CubicStiffness(), known, 1, [3.0])])
    assert best.material == ("viscous",) and best.names == ("cubic_stiffness", "viscous")
    found = looked.with_instead(search.Finding([best], [best], looked.hypothesis([])))
    assert [h.names for h in found.rivals] == [best.names, ("cubic_stiffness", "hysteretic")]


def test_a_tone_in_the_place_of_another_has_its_frequency():
    """A second mode that hardly fades is hum: of one line, though a comb was what screened best."""
    records = [Record.loud(decay(0.3), 2e-4)]
    known = scales(records)._replace(tones=(100.0,), combs=((50.0, 4),))
    options = search.Options((), 0.01, 2, 2e-4, 1, lambda text: None)
    looked = decay_search.DecaySearch(MODEL, records, (), options, decay_search.ProcessNoise())
    mode = Part.of(SecondMode(), known, 1, [313.0, 0.0003])
    comb = Screened(Hum(frequency=50.0, harmonics=4), 0.0, np.zeros((1, 8)))
    hum = looked._sibling(mode, comb, SimpleNamespace(scales=known))
    assert hum.effect == Hum(frequency=313.0) and hum.strengths.shape == (1, 2)


@pytest.mark.slow
def test_a_difference_within_the_stated_tolerance_is_none(no_search):
    run = decay(1.0, changed=OTHER, duration=LONG)
    found = diagnose(MODEL, run, tolerance={"damping": 0.2})
    assert found.verdict == "none" and found.gap.before > 3
    assert "nothing that matters" in found.sentence and "tolerance: " in found.sentence


@pytest.mark.parametrize(("noise", "found"), [(35, "not known"), (80, "known")])
def test_a_stated_tolerance_ends_the_search_where_the_record_shows_that_it_is_kept(
    noise, found, monkeypatch
):
    """The same equation, to 0.001 %: at 35 dB this record cannot show that, at 80 it does."""
    asked = []

    def run(self):
        asked.append(True)
        exact = self.hypothesis([])
        return search.Finding([exact], [exact], exact)

    monkeypatch.setattr(decay_search.DecaySearch, "run", run)
    fine = {"frequency": 1e-5, "damping": 1e-2, "signal": 1e-3}
    assert diagnose(MODEL, decay(1.0, snr_db=noise), tolerance=fine).verdict == "none"
    assert bool(asked) == (found == "not known")


def test_a_tolerance_is_stated_or_read_off():
    repeats = Tolerance(source="repeats")
    assert stated(0.01).stated and not repeats.stated and not Tolerance().stated
    assert stated(0.01).or_more(repeats).stated


@pytest.mark.slow
def test_the_same_difference_matters_without_one():
    found = diagnose(MODEL, decay(1.0, changed=OTHER))
    assert found.verdict != "none" and "They differ: " in str(found)
    sizes = [d.damping for d in found.differences]
    assert sizes == pytest.approx([1 / 1.1 - 1], abs=0.02)


@pytest.mark.slow
def test_a_file_against_itself_is_none(no_search):
    run = decay(1.0, changed=OTHER, snr_db=60)
    known = model_of_simulation([run])
    assert diagnose(measured=run, **known._asdict()).verdict == "none"


def test_a_fit_that_broke_off_stands_for_no_simulation():
    """Cubic stiffness alone cannot follow 170 cycles of this decay; it once stood for them all the
    same, with a damping of an eighth. 3 %: what an equation that is short by its inertia may err.
    """
    values = {"gamma_3": 4.7e10, "gamma_5": 7.9e16, "Upsilon_3": 8.8e5, "c_linear": 0.467}
    model = rs.ReducedModel.from_coefficients({"omega^2": 2e4, **values}, "m")
    clean = model.simulate(3.4e-4, 0.0, np.arange(0, 8, 1 / 2345))
    noise = 1e-6 * np.random.default_rng(1).standard_normal(len(clean.t))
    known = model_of_simulation([rs.Decay(clean.t, clean.q + noise, unit="m")]).model
    assert known.coefficients["c_linear"] == pytest.approx(0.467, rel=0.03)


def test_repeat_runs_say_what_does_not_matter(no_search):
    runs = [decay(1.0, seed=i, changed={"c_linear": c}) for i, c in enumerate((0.30, 0.33))]
    spread = of_repeats(runs, 2e-4)
    assert spread.damping == pytest.approx(0.03 / 0.33, abs=0.03) and spread.source == "repeats"
    found = diagnose(MODEL, decay(1.0, seed=3), repeats=runs)
    assert found.verdict == "none" and "repeat runs differ by" in found.sentence


def test_a_fit_knows_what_it_leaves(no_search):
    """Cubic stiffness alone cannot follow a model with inertia: that is not news of another run."""
    run = decay(1.0, seed=1)
    plain = rs.ReducedModel.from_coefficients(
        {"omega^2": OMEGA**2, "gamma_3": 5.0, "c_linear": 0.01 * OMEGA}
    )
    fit = refine(plain, run)
    left = Difference.of(fit.records[0], fit.records[0].signal - fit.residuals[0])
    fine = {"frequency": 1e-4, "damping": 1e-2, "signal": 2e-4}
    assert left.exceeds(Tolerance(**fine))
    found = diagnose(fit, decay(1.0, seed=2), tolerance=fine)
    assert found.verdict == "none" and "its own reference record" in found.sentence


def test_tolerances_of_several_sources():
    one, other = Tolerance(0.1, 0.0, 0.0, "stated"), Tolerance(0.0, 0.2, 0.0, "repeats")
    assert one.or_more(other) == Tolerance(0.1, 0.2, 0.0, "stated and repeats")
    assert stated(0.5).frequency == 0.5 and stated(one) is one
    assert Tolerance().or_more(other).source == "repeats"


def test_a_model_is_known_less_well_where_its_record_was_quiet():
    """What is known at the quiet end allows nothing at the loud one; power weighs in between."""
    amplitude = np.array([0.001, 0.01])
    quiet = Tolerance(source="bands", bands={"frequency": np.array([amplitude, [0.01, 0.0]])})
    assert quiet.over(0.001, 0.001).frequency == pytest.approx(0.01)
    assert quiet.over(0.01, 0.01).frequency == Tolerance().frequency
    assert quiet.over(0.001, 0.001).damping == Tolerance().damping
    # Linear in the amplitude and weighed by its square on a logarithmic scale: the integral of
    # 0.01 (10 - x) / 9 x dx over that of x dx, x from 1 to 10; 2 % for the 20 points.
    mean = 0.01 / 9 * (10 * 99 / 2 - 999 / 3) / (99 / 2)
    assert quiet.over(0.001, 0.01).frequency == pytest.approx(mean, rel=0.02)
    off = Difference((0.001, 0.001), 0.005, 1e-5, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert off.within(quiet) and not off.exceeds(quiet)
    loud = replace(off, amplitude=(0.01, 0.01))
    assert loud.exceeds(quiet) and not loud.within(quiet)
    # More than makes it another structure determines nothing.
    wide = Tolerance(source="bands", bands={"frequency": np.array([amplitude, [0.5, 0.5]])})
    assert wide.over(0.001, 0.01).frequency == WIDEST["frequency"]
    assert wide.over(0.001, 0.01).undetermined[0][:2] == ("frequency", "bands")


@pytest.mark.parametrize("cycles", [SHORTEST - 2, 24, 59])
def test_parts_that_learn_and_judge_span_the_amplitudes(cycles):
    whole = decay(1.0)
    record = Record.loud(whole.between(end=cycles / 5.05), 2e-4)
    parts = parted(record)
    if cycles < SHORTEST:
        assert parts is None
        return
    learns, judges = parts
    assert np.array_equal(learns.part, ~judges.part)
    assert learns.count + judges.count == pytest.approx(record.count)
    assert 0.15 < judges.count / record.count < 0.4
    reach = np.abs(record.signal)
    for part in parts:
        assert reach[part.part].max() > 0.7 * reach.max()
        late = np.flatnonzero(part.part)[-1] / len(reach)
        assert late > 0.6
    # White misfits of one part tell nothing about the other: they are never both non-zero.
    x = np.random.default_rng(0).standard_normal(len(reach))
    assert not np.any(learns.whitened(x) * judges.whitened(x))


@pytest.mark.slow
def test_a_record_that_died_long_ago_is_held_out_where_it_lives():
    """Its last quarter was held out, and refused: it holds no cycles."""
    friction = decay(1.0, force=lambda t, q, v: 5.0 * np.tanh(v / 0.01))
    assert diagnose(MODEL, [friction]).gap.unseen


def test_numbers_in_words():
    assert [percent(x) for x in (0.0123, 1.4, 0.00012)] == ["1.2 %", "140 %", "0.012 %"]
    assert odds(6.0, "dry friction") == "odds 400 : 1 against the next, dry friction"
    # What is out of the question needs no name.
    assert odds(400.0, "play") == "odds above 1000000 : 1 against the next"


@pytest.mark.slow
def test_the_sentence_the_table_and_the_files_say_the_same(tmp_path):
    found = diagnose(MODEL, decay(1.0, changed=OTHER))
    lines = found.sentence.splitlines()
    starts = ("They differ: ", "Missing: ", "Left: ", "Next: ")
    assert all(line.startswith(s) for line, s in zip(lines, starts, strict=False))
    content = json.loads(found.to_json())
    assert content["gap"]["closed"] == found.gap.closed and content["left"] == found.left
    assert content["tolerance"]["source"] == "default"
    assert content["differences"][0]["damping"] == found.differences[0].damping
    page = tmp_path / "page.html"
    found.to_html(page)
    text = page.read_text()
    assert lines[0] in text and lines[0] in repr(found)
    assert found.gap.table()[1][2] in text


def test_an_interrupted_diagnosis_names_nothing(monkeypatch):
    def interrupted(self, base):
        self.hypothesis([])
        raise KeyboardInterrupt

    monkeypatch.setattr(decay_search.DecaySearch, "_best_of", interrupted)
    found = diagnose(MODEL, decay(1.0, changed=OTHER))
    assert found.interrupted and found.verdict != "named"
    assert found.sentence.startswith("Stopped when ")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tolerance": "x"}, "tolerance = 'x' must be a relative size"),
        ({"tolerance": {"speed": 1}}, "or a mapping of"),
        ({"tolerance": -1}, "tolerance of frequency = -1.0"),
        ({"tolerances": 0.1}, "tolerances = 0.1 must map names"),
        ({"tolerances": {"gamma_3": "a"}}, "must be positive"),
        ({"free": 5}, "free = 5 must be a list"),
        ({"free": "omega^2"}, "must be a list"),
        ({"held_out": []}, "held_out is a list: give one Decay"),
        ({"repeats": 5}, "repeats = 5 must be a Decay"),
        ({"reference": "a"}, "reference = 'a' must be a Decay"),
        ({"floor": 2}, "floor = 2 must be a part"),
        ({"false_alarm": "x"}, "false_alarm = 'x' must be a probability"),
        ({"max_effects": 1.5}, "max_effects = 1.5"),
        ({"n_jobs": 0}, "n_jobs = 0 must be a number of processes"),
        ({"catalogue": 3}, "catalogue = 3 must be a list of effects"),
        ({"progress": 3}, "progress = 3 must be a function"),
    ],
)
def test_wrong_arguments_are_refused_by_name(given, message):
    with pytest.raises(ValueError, match=message.replace("^", r"\^")):
        diagnose(MODEL, decay(1.0), **given)


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, seed in (("a", 1), ("b", 2)):
        run = decay(1.0, seed=seed)
        np.savetxt(f"{name}.csv", np.column_stack([run.t, run.q]), delimiter=",", header="t,q")
    (tmp_path / "model.json").write_text(MODEL.to_json())
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(main, ["diagnose", "--model", "model.json", *arguments])


@pytest.mark.slow
def test_the_command_line_knows_tolerance_repeats_and_reference(files, no_search):
    known = ["--repeats", "b.csv", "--repeats", "a.csv", "--reference", "b.csv"]
    result = run("--measured", "a.csv", "--tolerance", "damping=0.2", *known, "--json", "a.json")
    assert result.exit_code == 0, result.output
    content = json.loads((files / "a.json").read_text())
    assert content["tolerance"]["source"] == "stated and repeats and reference"
    assert content["tolerance"]["damping"] == 0.2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--tolerance", "x"], "'x' is not NAME=SIZE"),
        (["--tolerances", "0.1"], "'0.1' is not NAME=SIZE"),
        (["--tolerances", "gamma_9=0.1"], "--tolerances name 'gamma_9'"),
        (["--floor", "2"], "--floor 2.0 must be"),
        (["--jobs", "0"], "--jobs 0 must be"),
        (["--repeats", "a.csv"], "--repeats holds 1 decay"),
        (["--held-out", "a.csv"], "a.csv is the same record"),
        (["--mode", "7"], "mode = 7 is none of the modes"),
    ],
)
def test_refusals_of_the_command_line_name_files_and_options(files, arguments, message):
    result = run("--measured", "a.csv", *arguments)
    assert result.exit_code == 2 and message in result.output, result.output
    assert "Traceback" not in result.output
