"""`diagnose` reads records as `identify` does, and compares what record and model share."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.commands.diagnose import _CODES
from romsindy.commands.main import main
from romsindy.commands.measurement import Selection, decays_in
from romsindy.diagnosis import decay_search, diagnose
from romsindy.diagnosis.arguments import of_repeats, shared_part
from romsindy.diagnosis.difference import WIDEST, Difference, Tolerance
from romsindy.diagnosis.simulated import model_of_simulation
from romsindy.diagnosis.verdict import Verdict
from romsindy.diagnosis.words import difference, over_sensors
from romsindy.fit.verdict import SHARED
from romsindy.text import Shown, left_over

OMEGA, ZETA, RATE, NOISE = 2 * np.pi * 7, 0.005, 200, 2e-5
CUBIC = 40 * OMEGA**2  # 1/(m^2 s^2)
MODEL = rs.ReducedModel.from_coefficients(
    {"omega^2": OMEGA**2, "gamma_3": CUBIC, "c_linear": 2 * ZETA * OMEGA}, unit="m"
)
READING = dict.fromkeys(("unit", "quantity", "column", "time", "rate", "start", "end"))


def swing(amplitude, duration=8.0, other=0.0):
    """A Duffing oscillator let go, (n,) m; another mode at 31 Hz may ring beside it."""

    def rates(_, y):
        return [y[1], -2 * ZETA * OMEGA * y[1] - OMEGA**2 * y[0] - CUBIC * y[0] ** 3]

    t = np.arange(int(duration * RATE)) / RATE
    done = solve_ivp(rates, (0, duration), [amplitude, 0.0], "DOP853", t, rtol=1e-9, atol=1e-12)
    return done.y[0] + other * np.exp(-t) * np.cos(2 * np.pi * 31 * t)


def noisy(x, seed=0):
    return x + NOISE * np.random.default_rng(seed).standard_normal(len(x))


def written(path, x, unit="mm", scale=1e3):
    table = np.column_stack([np.arange(len(x)) / RATE, scale * x])
    header = f"time [s],tip [{unit}]"
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def read(path, **chosen):
    told = []
    return decays_in(path, READING, Selection(**chosen), told.append), "\n".join(told)


@pytest.fixture
def no_search(monkeypatch):
    def refuse(self):
        raise AssertionError("a search was started")

    monkeypatch.setattr(decay_search.DecaySearch, "run", refuse)


def test_hold_level_and_tail_are_taken_off(tmp_path):
    free, level = swing(0.012, 36.0), 0.006
    x = noisy(np.concatenate([np.full(300, 0.012), free]) + level)
    (found,), told = read(written(tmp_path / "held.csv", x))
    first = round(found.t[0] * RATE)
    assert abs(first - 300) < RATE / 7 / 8  # the release, to an eighth of a cycle
    own = free[first - 300 :][: len(found.t)]
    assert np.std(found.q - own) == pytest.approx(NOISE, rel=0.1)
    # The level is that of thousands of samples: a tenth of the noise of one.
    assert abs(np.mean(found.q - own)) < 0.1 * NOISE
    # It ends where the amplitude falls to three times the noise.
    assert found.t[-1] - found.t[0] == pytest.approx(
        np.log(0.012 / (3 * NOISE)) / (ZETA * OMEGA), rel=0.1
    )
    assert "held until 1.5 s" in told and "level of 6 mm" in told


def test_hum_clipping_and_a_faint_mode_stay(tmp_path):
    """What a filter would take away is what is to be named: samples are those of the file."""
    t = np.arange(8 * RATE) / RATE
    x = noisy(swing(0.012, other=2e-4) + 1e-4 * np.cos(2 * np.pi * 50 * t))
    x = np.minimum(x, 0.0115)
    (found,), _ = read(written(tmp_path / "all.csv", x))
    first = round(found.t[0] * RATE)
    assert len(found.t) > 0.9 * len(x)
    assert np.ptp(found.q - x[first:][: len(found.q)]) < 1e-9  # digits of the file


def test_several_releases_and_another_mode(tmp_path):
    amplitudes = (0.012, 0.011, 0.010)
    parts = [np.concatenate([np.full(200, a), swing(a, 16.0, other=0.003)]) for a in amplitudes]
    file = written(tmp_path / "three.csv", noisy(np.concatenate(parts) - 0.004))
    found, told = read(file)
    assert len(found) == 3 and "rings mode 2 at 31 Hz, which stays in" in told
    assert "--mode 1 takes it off" in told
    for decay, a in zip(found, amplitudes, strict=True):
        assert np.ptp(decay.q) / 2 == pytest.approx(a + 0.003, rel=0.15)  # both modes
    # One of them by itself; its first cycles may be spoilt by what was subtracted.
    (alone,), told = read(file, release=2, mode=1)
    assert 0.009 < np.ptp(alone.q) / 2 < 0.0115 and "Left out: mode 2" in told


def test_a_release_that_is_not_there_is_refused(tmp_path):
    file = written(tmp_path / "one.csv", noisy(swing(0.012)))
    with pytest.raises(
        ValueError, match=r"one.csv: release = 7: mode 1 .* rings in release 1 of 1"
    ):
        read(file, release=7)
    file = written(tmp_path / "noise.csv", noisy(np.zeros(1600)))
    with pytest.raises(ValueError, match=r"noise.csv: no free decay .* --whole takes it as it is"):
        read(file)


def test_what_identify_mends_is_mended(tmp_path):
    """Spiked samples and one that is missing: the file was refused."""
    x = noisy(swing(0.012))
    spiked = x.copy()
    spiked[[300, 900, 1500]] += 0.02
    file = written(tmp_path / "bad.csv", spiked)
    lines = file.read_text().splitlines()
    lines[700] = lines[700].split(",")[0] + ",nan"
    file.write_text("\n".join(lines))
    (found,), told = read(file)
    first = round(found.t[0] * RATE)
    off = found.q - x[first:][: len(found.q)]
    assert np.abs(off).max() < 10 * NOISE and told.count("1 spike of") == 3
    assert "1 sample is missing: interpolated" in told


def test_a_velocity_starts_at_its_release(tmp_path):
    free = swing(0.012)
    rate = np.concatenate([np.zeros(300), np.gradient(free, 1 / RATE)]) + 0.05
    (found,), _ = read(written(tmp_path / "v.csv", rate, unit="m/s", scale=1.0))
    assert found.measured == "velocity" and 1.4 < found.t[0] < 1.8
    own = np.interp(found.t, 1.5 + np.arange(len(free)) / RATE, free)
    assert np.std(found.q - own) < 0.01 * np.std(own)
    assert abs(np.mean(found.signal)) < 0.01 * np.std(found.signal)


def test_columns_are_chosen_as_for_identify(tmp_path):
    x = noisy(swing(0.012))
    table = np.column_stack([np.arange(len(x)) / RATE, x, 0.5 * x])
    file = tmp_path / "two.csv"
    np.savetxt(file, table, delimiter=",", header="t,a [m],b [m]", comments="")
    with pytest.raises(ValueError, match="2 columns could be the measured one"):
        read(file)
    chosen = READING | {"column": ["a"]}
    assert len(decays_in(file, chosen, Selection(), print)) == 1
    several = READING | {"column": ["a", "b"]}
    assert len(decays_in(file, several, Selection(mode=1), lambda _: None)) == 1


def test_a_saved_decay_that_is_free_is_taken_as_it_is(tmp_path):
    decay = rs.Decay(np.arange(8 * RATE) / RATE, swing(0.012), unit="m").free()
    rs.save_decay(decay, tmp_path / "a.csv")
    (found,), _ = read(tmp_path / "a.csv")
    assert np.array_equal(found.q, decay.q) and found.stage == "free"


def test_a_harder_hit_is_compared_where_the_model_reaches(no_search):
    """It was refused as another mode: the model was asked where it knows nothing."""
    # Of order 9, and of no use beyond: at three times its reach the frequency would be threefold.
    wild = MODEL.coefficients | {"gamma_9": 0.2 * CUBIC / 0.012**6}
    reach = 0.012
    model = rs.ReducedModel.from_coefficients(MODEL.coefficients | {"gamma_9": 0.0}, unit="m")
    model = rs.ReducedModel(model.terms, model.values, "m", (0.0, reach))
    hit = rs.Decay(np.arange(12 * RATE) / RATE, noisy(swing(0.036, 12.0)), unit="m")
    part = shared_part(model, hit)
    # The amplitude of a viscous decay falls as exp(-zeta omega t).
    start = np.log(0.036 * SHARED / reach) / (ZETA * OMEGA)
    assert part.decay.t[0] == pytest.approx(start, abs=1.5 * 2 * np.pi / OMEGA)
    found = diagnose(model, hit)
    assert found.verdict == "none" and found.records[0].amplitude < 1.15 * reach
    assert "Note: record 1 reaches 35" in found.sentence and "the model 12 mm" in found.sentence
    bent = rs.ReducedModel.from_coefficients(wild, unit="m")
    bent = rs.ReducedModel(bent.terms, bent.values, "m", (0.0, 0.006))
    assert diagnose(bent, hit, tolerance=0.05).verdict == "none"  # gamma_9 is nothing at 6 mm


def test_a_level_beyond_the_model_is_taken_off_and_told(no_search):
    """The model has no motion there: "min() arg is an empty sequence"."""
    model = rs.ReducedModel(MODEL.terms, MODEL.values, "m", (0.0, 0.012))
    record = rs.Decay(np.arange(16 * RATE) / RATE, noisy(swing(0.012, 16.0)) + 0.03, unit="m")
    found = diagnose(model, record)
    assert found.verdict == "none" and "record 1 rests at 30 mm" in found.sentence
    # Without a reach nothing says that it is too far: it stays, to be named.
    assert np.mean(shared_part(MODEL, record).decay.q) > 0.02


def test_a_simulated_series_is_taken_as_by_the_command(no_search):
    t = np.arange(8 * RATE) / RATE
    series = rs.Decay(t, swing(0.012), unit="m")
    found = diagnose(series, rs.Decay(t, noisy(swing(0.011)), unit="m"))
    known = model_of_simulation([series])
    assert found.verdict == "none"
    assert found.nominal.coefficients == known.model.coefficients
    assert found.tolerance.signal >= known.floor
    # It follows itself: what does not matter is what is said by default, and said to be so.
    assert "would not matter" in found.sentence and "its own reference" not in found.sentence
    with pytest.raises(ValueError, match="the simulated series cannot be analysed"):
        diagnose(series.between(0, 0.2), series)
    with pytest.raises(ValueError, match="model is a Decay, which has no input"):
        diagnose(series, rs.ForcedVibration(t, series.q, np.cos(t), unit="m", input_unit="N"))
    with pytest.raises(TypeError, match="give a ReducedModel, Beam, Decay, or a function"):
        diagnose("model", series)


@pytest.mark.slow
def test_a_saved_identification_is_the_same_by_file(tmp_path, no_search):
    """Its file was taken for an estimate of a series: 0.15 % in frequency in the place of 0.006."""
    first = rs.Decay(np.arange(8 * RATE) / RATE, noisy(swing(0.012), 1), unit="m")
    found = rs.identify(first)
    found.save(tmp_path / "found.json")
    rs.save_decay(first, tmp_path / "again.csv")
    told = {}
    for options in ([], ["--tolerance", "damping=1e-3"]):
        given = ["diagnose", "--measured", "again.csv", "--model", "found.json", *options]
        given = [str(tmp_path / x) if x.endswith((".csv", "found.json")) else x for x in given]
        out = tmp_path / f"{len(options)}.json"
        done = CliRunner().invoke(
            main, [*given, "--json", str(out), "--report", str(out) + ".html"]
        )
        assert done.exit_code == 0, done.output
        told[len(options)] = json.loads(out.read_text())["tolerance"]
    (again,), _ = read(tmp_path / "again.csv")
    by_python = diagnose(found, again).tolerance
    for kind in WIDEST:
        assert told[0][kind] == pytest.approx(getattr(by_python, kind), rel=1e-6)
    assert told[2]["damping"] == 1e-3 and told[2]["source"] == "stated"  # stated, it stands


# -- nothing falsely sure -------------------------------------------------------------------------


def test_what_records_do_not_determine_is_no_agreement():
    """ "They agree within 97 % in damping": four cycles of a damping ratio of 0.2 %."""
    told = Difference((0.1, 0.2), 2e-4, 1e-4, 0.1, 0.87, 2e-3, 1e-3, 0.01)
    text = difference([told], Tolerance(), Shown("m"))
    assert text == (
        "They agree within 0.03 % in frequency and 0.3 % in waveform over 0.1 to 0.2 m, and may"
        " differ by 97 % in damping, which these records do not determine (0.1 %, 5 % and 1 % would"
        " not matter)."
    )
    text = difference([told], Tolerance(1e-5, 0.0, 0.0, source="stated"), Shown("m"))
    assert text.startswith("They may differ by 0.03 % in frequency, 97 % in damping and 0.3 % in")


def test_records_agree_within_what_all_of_them_show():
    """The bound of the closer of two records was told for both."""
    near = Difference((0.1, 0.2), 1e-5, 1e-5, 0.0, 0.01, 1e-4, 1e-4, 0.01, name="record 1")
    far = Difference((0.05, 0.15), 4e-4, 1e-5, 0.0, 0.01, 1e-4, 1e-4, 0.01, name="record 2")
    text = difference([near, far], Tolerance(), Shown("m"))
    assert text == difference([far, near], Tolerance(), Shown("m"))
    assert text.startswith("They agree within 0.04") and " over 0.05 to 0.2 m" in text


def test_repeats_that_do_not_determine_damping_do_not_excuse_it():
    """A tolerance of 910 % was taken from a reference, and "none" was said on it."""
    t = np.arange(1200) / RATE
    runs = []
    for i, zeta in enumerate((0.002, 0.02)):
        q = 0.01 * np.exp(-zeta * OMEGA * t) * np.cos(OMEGA * t)
        runs.append(rs.Decay(t, noisy(q, i), unit="m"))
    spread = of_repeats(runs, 2e-4)
    assert spread.damping == WIDEST["damping"] and spread.frequency < WIDEST["frequency"]
    ((kind, source, size),) = (x for x in spread.undetermined if x[0] == "damping")
    assert source == "repeats" and size > 0.5
    other = rs.ReducedModel.from_coefficients({"omega^2": OMEGA**2, "c_linear": 0.6}, unit="m")
    found = diagnose(other, runs[0], repeats=runs, catalogue=(), free=())
    assert f"% in {kind}, which does not determine it: more than 25 % matters" in found.sentence
    assert found.verdict != "none"


def test_each_tolerance_is_said_to_be_from_where_it_is():
    """ "The model misses its own reference record by 1 % and 0.02 %": these were the defaults."""
    left = Tolerance.read_off({"frequency": 5e-2, "damping": 0.0, "signal": 0.0}, "reference")
    both = Tolerance().or_more(left)
    assert [both.source_of(k) for k in WIDEST] == ["default"] * 3  # capped, so not as it was
    repeats = Tolerance.read_off({"frequency": 0.0, "damping": 0.2, "signal": 0.0}, "repeats")
    both = both.or_more(repeats)
    assert both.source_of("damping") == "repeats" and both.source_of("signal") == "default"
    assert both.undetermined == (("frequency", "reference", 5e-2),)


@pytest.mark.parametrize(
    ("kind", "times", "sentence"),
    [
        ("noise", 1.1, "nothing but noise ({first}); at the worst sensor, y(0.2), {worst}."),
        ("noise", 2.1, "{worst} at the worst sensor, y(0.2); {there}."),
        ("tolerance", 1.1, "{first}, which does not matter; at the worst sensor, y(0.2), {worst}."),
        ("tolerance", 6.6, "{worst} at the worst sensor, y(0.2); {there}, which does not matter."),
    ],
)
def test_what_is_left_of_a_beam_is_one_sentence(kind, times, sentence):
    told = {
        "first": left_over(0.02, 0.93),
        "worst": f"1 % of the response, {times} times the noise",
    }
    told["there"] = f"{told['first']} in the coordinate of the first mode"
    first = SimpleNamespace(after=None, left=lambda _: told["first"])
    gap = SimpleNamespace(predictions=[first], worst=0)
    assert over_sensors(gap, kind, "y(0.2)", 0.01, times) == sentence.format(**told)


def test_every_verdict_has_an_exit_code():
    assert set(_CODES) == set(Verdict.__args__)
    assert sorted(_CODES.values()) == [0, 10, 11, 12]
