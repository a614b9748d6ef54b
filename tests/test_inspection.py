"""What an inspection says of records whose content is known."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import cont2discrete, lfilter

import romsindy as rs
from romsindy.inspection.tables import next_steps, summary
from romsindy.record.recording import Recording

RATE = 1000.0  # Hz
T = np.arange(0, 10, 1 / RATE)
LOW, HIGH, ZETA = 11.0, 22.22, (0.004, 0.003)  # a ratio of 1 : 2.02


def decay(frequency, zeta, t, amplitude=1.0):
    """Free decay of a linear mode, let go at t = 0."""
    omega = 2 * np.pi * frequency
    return amplitude * np.exp(-zeta * omega * t) * np.cos(omega * np.sqrt(1 - zeta**2) * t)


def noise(n, size=1e-4, seed=0):
    return size * np.random.default_rng(seed).standard_normal(n)


def two_modes(t=T, amplitude=1e-3):
    return decay(LOW, ZETA[0], t, amplitude) + decay(HIGH, ZETA[1], t, 0.3 * amplitude)


@pytest.fixture(scope="module")
def pair():
    """Two modes near 1:2, in millimetres, 60 dB over the noise."""
    x = two_modes() + noise(len(T), 1e-6)
    return rs.inspect(Recording(T, x, ["tip"], unit="m", basis="by hand", source="pair.csv"))


@pytest.fixture(scope="module")
def twice():
    """The same mode let go twice, 50 Hz hum, and two channels."""
    t = np.arange(0, 16, 1 / RATE)
    x = np.where(t < 8, decay(LOW, 0.01, t), decay(LOW, 0.01, t - 8, 0.8))
    hum = 0.01 * np.sin(2 * np.pi * 50 * t)
    x = x + hum + noise(len(t))
    other = 0.1 * x + noise(len(t), seed=1)
    return rs.inspect(Recording(t, np.stack([other, x], axis=1), ["base", "tip"]))


def test_columns_that_are_several_tests_are_not_taken_together():
    """The same mode in another test, 2 % slower: no sensor of the same motion moves so."""
    one, other = (decay(f, 0.01, T) + noise(len(T), seed=k) for k, f in enumerate((LOW, 10.8)))
    base = 0.3 * one + noise(len(T), seed=2)
    x = np.stack([one, 0.9 * other, base], axis=1)
    found = rs.inspect(Recording(T, x, ["test 1", "test 2", "base"]))
    assert found.in_phase(found.dominant) == ("test 1", "base")
    first, *_ = next_steps(found, "romsindy identify file.csv")
    assert first == "romsindy identify file.csv --column 'test 1' --column base"
    assert summary(found).endswith("Left out: channel test 2.")


def test_modes_and_their_ratio(pair):
    """Frequency within 1e-4, damping ratio within 3 %: what 60 dB leave of exact values."""
    assert [m.number for m in pair.modes] == [1, 2]
    assert_allclose([m.mean_frequency for m in pair.modes], [LOW, HIGH], rtol=1e-4)
    assert_allclose([m.damping_ratio[0] for m in pair.modes], ZETA, rtol=0.03)
    ((low, high, near),) = pair.resonances
    assert (low.number, high.number, near.p, near.q) == (1, 2, 1, 2)
    # Where it is nearest to 2: the ridges scatter by 1e-3 where they fade.
    assert near.ratio == pytest.approx(HIGH / LOW, rel=1e-3)
    assert pair.dominant is pair.modes[0] and pair.mode(band=(15, 25)) is pair.modes[1]


def test_text_says_what_is_in_it_and_what_comes_next(pair):
    text = str(pair)
    assert "10000 at 1000 Hz, from 0 to 9.999 s" in text and "displacement in m (by hand)" in text
    assert re.search(r"^     1 +1[01]\.\d+( to 1[01]\.\d+)? +0\.4[01]", text, re.M)
    assert re.search(r"Mode 2 is 2\.0\d+ times mode 1 at an amplitude of .* [mu]m: near 1:2", text)
    assert re.search(
        r"Used: mode 1 at 1[01]\.\d+ .*Hz, which moves most, in channel tip, release 1\.", text
    )
    assert re.search(r"Left out: mode 2 at 22\.2\d+( to 22\.2\d+)? Hz\.", text)
    calls = re.findall(r"^  rs\.identify\((seen\.decays\(.*\))\)$", text, re.M)
    assert len(calls) == 2
    for call, frequency in zip(calls, (LOW, HIGH), strict=True):
        (alone,) = eval(call, {"seen": pair})  # what is printed can be pasted
        assert rs.extract_backbone(alone).linear_frequency() / (2 * np.pi) == pytest.approx(
            frequency, rel=1e-3
        )


def test_releases_hum_and_channels(twice):
    assert twice.channel == "tip" and len(twice.releases) == 2
    assert twice.releases[1].start == pytest.approx(8, abs=0.1)  # a cycle
    mode, hum = twice.modes
    assert mode.mean_frequency == pytest.approx(LOW, rel=1e-3) and twice.dominant is mode
    assert hum.steady and hum.mean_frequency == pytest.approx(50, rel=1e-3)
    assert "steady: mains" in str(twice) and "which moves most" not in str(twice)
    assert "give it by unit=" in str(twice)
    assert "release 1 and 2" not in str(twice) and "releases 1 and 2" in str(twice)
    assert "in channels base and tip, releases 1 and 2" in str(twice)
    assert "Left out: steady tone 2 at 50.000 Hz." in str(twice)
    both, second = twice.decays(), twice.decays(release=2)
    assert len(both) == 2 and len(second) == 1 and both[1].same_record(second[0])
    assert [n.channel for n in twice.noise] == ["base", "tip"]


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"mode": 3}, "mode = 3 is none of the modes: 1 at 11 Hz, 2 at 22.22 Hz"),
        ({"mode": 1, "band": (5, 15)}, "are two choices: give one"),
        ({"band": (30, 40)}, "band = 30 to 40 Hz holds no mode: 1 at 11 Hz"),
        ({"release": 2}, "release = 2: mode 1 .* rings in release 1 of 1"),
    ],
)
def test_choices_that_are_not_there(pair, choice, message):
    with pytest.raises(ValueError, match=message):
        pair.decays(**choice)


def test_json_holds_the_numbers(pair, twice):
    content = json.loads(pair.to_json(), parse_constant=pytest.fail)  # strict: no NaN
    assert content["rate"] == pytest.approx(RATE) and content["file"] == "pair.csv"
    first = content["modes"][0]
    assert first["frequency"]["loud"] == pytest.approx(LOW, rel=1e-3)
    along = first["along"][0]
    assert len(along["t"]) == len(along["frequency"]) == len(along["amplitude"]) > 10
    assert content["resonances"][0]["q"] == 2
    content = json.loads(twice.to_json(), parse_constant=pytest.fail)
    assert [a["release"] for a in content["modes"][0]["along"]] == [1, 2]
    assert content["unit"] is None and len(content["releases"]) == 2


def test_figure_shows_ridges_over_the_spectrogram(pair, twice):
    figure = pair.plot()
    time, ridges, spectrum = figure.axes[:3]
    assert time.get_xlabel() == "" and ridges.get_xlabel() == "time (s)"
    for line, mode in zip(ridges.lines, pair.modes, strict=True):
        assert_allclose(np.median(line.get_ydata()), mode.mean_frequency, rtol=1e-3)
    # The spectrum has its peaks where the modes are marked.
    f, size = spectrum.lines[1].get_data()
    for mode in pair.modes:
        near = np.abs(f - mode.mean_frequency) < 2
        assert f[near][np.argmax(size[near])] == pytest.approx(mode.mean_frequency, abs=0.2)
    assert len(twice.plot().axes[0].texts) == 2  # the releases


def test_page_is_one_file(pair, tmp_path):
    pair.to_html(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 1 and "http" not in page
    assert "near 1:2" in page and "seen.decays(mode=2)" in page
    pair.to_html(tmp_path / "page.html", "romsindy identify pair.csv")
    assert "romsindy identify pair.csv --mode 2" in (tmp_path / "page.html").read_text()


def test_nothing_that_rings():
    found = rs.inspect(Recording(T, noise(len(T)), source="noise.csv"))
    assert not found.modes and "Nothing can be identified: noise.csv" in str(found)
    assert "Next:" not in str(found)
    with pytest.raises(ValueError, match=r"noise\.csv: .*cut the record with start="):
        found.decays()
    assert found.plot().axes  # what there is can be looked at


def test_a_long_record_is_thinned_for_drawing():
    t = np.arange(0, 60, 1e-4)
    found = rs.inspect(Recording(t, decay(LOW, 0.002, t) + noise(len(t))))
    figure = found.plot()
    assert all(len(line.get_xdata()) <= 50_000 for ax in figure.axes for line in ax.lines)


def test_decays_are_inspected_too():
    found = rs.inspect(rs.example_decay(40.0, 1))
    (mode,) = found.modes
    # Its frequency goes from 0.894 to 0.955 Hz, and its harmonics belong to it.
    assert 0.89 < mode.mean_frequency < 0.96 and 2 in mode.harmonics


def test_a_file_is_read_as_it_is_asked_for(tmp_path):
    t = np.arange(0, 8, 1 / RATE)
    np.savetxt(tmp_path / "plain.txt", 1e3 * decay(LOW, 0.01, t))
    seen = rs.inspect(tmp_path / "plain.txt", unit="mm", rate=RATE)
    assert seen.recording.unit == "m" and seen.dominant.amplitude[0] < 1.01
    with pytest.raises(ValueError, match="say how a file is read"):
        rs.inspect(seen.recording, unit="mm")
    with pytest.raises(ValueError, match="lower frequency first"):
        seen.mode(band=(30.0, 5.0))


@pytest.mark.parametrize("size", [0.1, 3.0, 100.0])
@pytest.mark.parametrize("kind", ["line", "warming up", "bend"])
def test_a_drift_is_a_drift(kind, size):
    """Of any size: the mode beside it is found, shares add up, and nothing else is a mode."""
    part = T / T[-1]
    drift = {"line": part, "warming up": 1 - np.exp(-part / 0.3), "bend": (part - 0.3) ** 2}[kind]
    found = rs.inspect(Recording(T, decay(LOW, 0.003, T) + size * drift + noise(len(T), 1e-3)))
    (mode,) = found.modes
    assert mode.mean_frequency == pytest.approx(LOW, rel=2e-3)
    assert 0.9 < mode.share <= 1 and np.all(np.isfinite(mode.damping_ratio))


@pytest.mark.parametrize("seed", range(4))
def test_wandering_sensor_is_no_mode(seed):
    """A random walk alone, and one ten times the vibration: nothing slow is followed."""
    walk = np.cumsum(noise(len(T), 1.0, seed)) / 100
    for x in (walk, 10 * walk + decay(LOW, 0.003, T)):
        assert all(m.mean_frequency > 0.9 * LOW for m in rs.inspect(Recording(T, x)).modes)


def test_shares_of_a_record_add_up():
    """Two releases, of which the second rings at another frequency: of all that vibrates."""
    t = np.arange(0, 20, 1 / RATE)
    x = np.where(t < 10, decay(LOW, 0.01, t), decay(40.0, 0.003, t - 10, 0.5)) + noise(len(t), 1e-3)
    modes = rs.inspect(Recording(t, x)).modes
    shares = [m.share for m in modes]
    # Energies A^2 / (8 pi zeta f), and next to nothing is noise.
    energy = np.array([1 / (0.01 * LOW), 0.25 / (0.003 * 40)])
    assert len(modes) == 2 and sum(shares) <= 1
    assert_allclose(shares, energy / energy.sum(), rtol=0.15)  # a blow's cut takes a cycle


@pytest.mark.parametrize("colour", [0.0, 0.98])
def test_channel_of_noise_is_not_proposed(colour):
    x, rng = decay(LOW, 0.004, T), np.random.default_rng(2)
    dead = lfilter([1.0], [1.0, -colour], rng.standard_normal(len(T)))
    found = rs.inspect(Recording(T, np.stack([0.02 * dead / dead.std(), x], 1), ["dead", "tip"]))
    assert found.channel == "tip" and found.together == ("tip",)
    assert "--column dead" not in "\n".join(next_steps(found, "romsindy identify a.csv"))
    assert "noise alone" in str(found) and "channel dead" in found.short()


@pytest.mark.parametrize("input_", ["multisine", "sweep", "steps", "random", "blow"])
def test_measured_input_is_told_and_its_response_no_decay(tmp_path, input_):
    t, rng = np.arange(0, 20, 0.005), np.random.default_rng(3)
    steps = np.repeat(np.linspace(3, 12, 10), len(t) // 10)
    force, words = {
        "multisine": (sum(np.cos(2 * np.pi * 0.5 * k * t + k * k) for k in range(4, 30)), "tones"),
        "sweep": (np.sin(2 * np.pi * (2 * t + 0.25 * t**2)), "swept sine from"),
        "steps": (np.sin(2 * np.pi * np.cumsum(steps) * 0.005), "stepped sine from 2.8"),
        "random": (rng.standard_normal(len(t)), "random"),
        "blow": (np.where((t > 1) & (t < 1.03), 50.0, 0.0) + noise(len(t), 0.01), "blow"),
    }[input_]
    w = 2 * np.pi * 8
    b, a, _ = cont2discrete(([1.0], [1.0, 0.01 * w, w**2]), 0.005)
    q = lfilter(b.ravel(), a, force)
    q += 1e-4 * np.ptp(q) * rng.standard_normal(len(t))
    table = np.column_stack([t, 1e3 * q, force])
    path = tmp_path / "run.csv"
    np.savetxt(path, table, delimiter=",", header="t [s],q [mm],force [N]", comments="")
    found = rs.inspect(path)
    (drive,) = found.recording.drives
    assert words in drive.how and drive.lasting == (input_ != "blow")
    assert "load_forced" in "\n".join(next_steps(found))
    if drive.lasting:
        assert not found.modes and not found.releases
        with pytest.raises(ValueError, match="driven by the force"):
            found.decays()
    else:
        (mode,) = found.modes
        assert mode.mean_frequency == pytest.approx(8, rel=1e-3)


def test_what_comes_before_it_can_be_followed_is_told():
    """From 14 to 3 within two cycles: no window is as short."""
    t = np.arange(0, 20, 0.005)
    x = (
        decay(5.0, 0.003, t, 3.0)
        + np.where(t < 0.3, 11 * np.exp(-t / 0.05), 0)
        + noise(len(t), 0.01)
    )
    found = rs.inspect(Recording(t, x, unit="m"))
    assert found.modes[0].amplitude[0] < 10
    assert "release 1 begins with 1" in str(found) and "begins with" in found.short()


def test_the_answer_has_twenty_lines_at_most(pair, twice):
    t = np.arange(0, 12, 4 / RATE)
    rng = np.random.default_rng(1)
    modes = {7.0: 0.14, 19.0: 0.01, 31.0: 0.01, 47.0: 0.03, 83.0: 0.05}  # what is loud comes last
    many = sum(decay(f, 0.004, t % 4, size) for f, size in modes.items())
    x = np.stack([s * many + noise(len(t), 1e-4, k) for k, s in enumerate((1, -0.7, 0.3, 0.1))], 1)
    x[rng.integers(0, len(t), 9)] = 5.0
    full = rs.inspect(Recording(t, x + 0.1 * t[:, None], list("abcd")))
    for found in (pair, twice, full):
        short = found.short("romsindy identify a.csv")
        assert len(short.splitlines()) <= 19  # and one with the name of the page
        assert short.count(found.dominant.hertz) == 2 and "Next:" in short
    assert "--full shows them" in short
    cited = re.findall(r"(?:[Mm]ode |--mode )(\d)", short.replace(summary(full), ""))
    shown = re.findall(r"^ +(\d) +[\d.]+ (?:to [\d.]+ )? +(?:[\d.?]+ )+", short, re.M)
    assert cited and set(cited) <= set(shown)


def test_what_was_guessed_of_the_quantity_is_said_where_it_is_used(tmp_path):
    """A name is no unit: "v" may be a velocity, or a transverse displacement."""
    t = np.arange(0, 8, 0.01)
    x = np.exp(-0.1 * t) * np.cos(30 * t)
    said = {}
    for name in ("v", "probe", "q [mm]"):
        file = tmp_path / "run.csv"
        np.savetxt(file, np.c_[t, x], delimiter=",", header=f"t [s],{name}", comments="")
        said[name] = str(rs.inspect(file))
    assert "Taken as velocity: name 'v'." in said["v"]
    assert "Taken as displacement: assumed, for nothing in the file says it." in said["probe"]
    assert "Taken as" not in said["q [mm]"]
