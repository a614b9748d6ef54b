"""What an inspection says of records whose content is known."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

import romsindy as rs
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
    assert re.search(r"^     1 +1[01]\.\d+( to 1[01]\.\d+)? +0\.40", text, re.M)
    assert re.search(r"Mode 2 is 2\.0\d+ times mode 1 at an amplitude of .* [mu]m: near 1:2", text)
    assert "Used: mode 1 at 11 Hz, which moves most, in channel tip, release 1." in text
    assert "Left out: mode 2 at 22.22 Hz." in text
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
    assert "Left out: steady tone 2 at 50 Hz." in str(twice)
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
