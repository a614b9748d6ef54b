"""An estimate keeps what is known of a model, in memory and in a file, to the last digit."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import romsindy as rs
from romsindy.fit.adequacy.verdicts import examine
from romsindy.physics.example import EXAMPLE_MODEL

OMEGA, C = 6.0, 0.12
# By hand, as another program would write it: a linear oscillator with correlated coefficients.
BY_HAND: dict[str, Any] = {
    "coefficients": {"omega^2": 36, "c_linear": 0.12},
    "unit": "m",
    "free": ["omega^2", "c_linear"],
    "covariance": [[0.0144, 6e-5], [6e-5, 1e-6]],
    "verdict": {
        "ratio": 1,
        "p_value": 0.5,
        "structure": 1,
        "below_floor": False,
        "amplitude": [0.5],
        "misfit": [[1, 1, 1, 1, "NaN", "NaN"]],
        "limit": 0.5,
        "unit": "m",
        "false_alarm": 0.01,
    },
    "notes": ["typed in"],
}


@pytest.fixture(scope="module")
def fit() -> rs.Fit:
    """A fit with a coefficient that stays and a note."""
    decay = rs.example_decay(snr_db=40, seed=3)
    hum = 0.02 * np.sin(2 * np.pi * 17.7 * decay.t)
    record = rs.Decay(decay.t, decay.q + hum, unit="m")
    return rs.refine(EXAMPLE_MODEL, record, fixed=("gamma_2",))


def same(one: object, two: object) -> bool:
    """Whether two objects have equal fields, nan included, to the last digit."""
    pairs = [(v, vars(two)[k]) for k, v in vars(one).items()]
    return all(
        np.array_equal(a, b, equal_nan=True) if isinstance(a, np.ndarray | float) else a == b
        for a, b in pairs
    )


def test_a_fit_comes_back_from_its_file(fit: rs.Fit, tmp_path: Path) -> None:
    fit.save(tmp_path / "fit.json")
    estimate = rs.Estimate.load(str(tmp_path / "fit.json"))
    assert type(estimate) is rs.Estimate and type(rs.Fit.load(tmp_path / "fit.json")) is rs.Estimate
    assert estimate.model == fit.model and estimate.free == fit.free
    assert fit.notes and estimate.notes == fit.notes
    np.testing.assert_array_equal(estimate.covariance, fit.covariance)
    assert same(estimate.verdict, fit.verdict)
    assert estimate.standard_errors == fit.standard_errors
    assert str(estimate) == str(fit) and "(fixed)" in str(fit)
    amplitudes = np.linspace(0.2, 1.7, 7)
    assert same(estimate.band(amplitudes), fit.band(amplitudes))
    assert estimate.to_json() == fit.to_json()


def test_the_file_is_also_that_of_its_model(fit: rs.Fit) -> None:
    assert rs.ReducedModel.from_json(fit.to_json()) == fit.model


def test_numbers_that_are_not_finite_survive_in_strict_json(fit: rs.Fit) -> None:
    nowhere = examine(fit.records, [np.full(len(r.signal), np.inf) for r in fit.records], 0)
    assert nowhere.ratio == np.inf and nowhere.misfit.shape == (0, 6)
    gap = replace(fit.verdict, misfit=np.where(fit.verdict.misfit > 1, np.nan, np.pi))
    covariance = np.array([[5e-324, -0.0], [1 / 3, np.inf]])
    for verdict in (nowhere, gap):
        estimate = rs.Estimate(fit.model, fit.free[:2], covariance, verdict, ())
        text = estimate.to_json()
        json.loads(text, parse_constant=pytest.fail)  # what other readers refuse
        again = rs.Estimate.from_json(text)
        assert same(again.verdict, verdict)
        assert again.covariance.tobytes() == covariance.tobytes()


def test_band_of_a_linear_oscillator() -> None:
    """Propagation of errors in closed form, from JSON written by hand."""
    with_sure_term = BY_HAND | {
        "coefficients": {**BY_HAND["coefficients"], "gamma_3": 0},
        "free": [*BY_HAND["free"], "gamma_3"],
        "covariance": [[0.0144, 6e-5, 0], [6e-5, 1e-6, 0], [0, 0, 0]],
    }
    slopes = np.array([-C / (4 * OMEGA**3), 1 / (2 * OMEGA)])  # of zeta = c / (2 omega)
    zeta_std = np.sqrt(slopes @ BY_HAND["covariance"] @ slopes)
    for content in (BY_HAND, with_sure_term):
        band = rs.Estimate.from_json(json.dumps(content)).band([0.1, 0.4])
        np.testing.assert_allclose(band.frequency, OMEGA, rtol=1e-12)
        np.testing.assert_allclose(band.damping_ratio, C / (2 * OMEGA), rtol=1e-12)
        # Differences over a tenth of a standard error: (0.1 * 0.12 / 36)^2 off.
        np.testing.assert_allclose(band.frequency_std, 0.12 / (2 * OMEGA), rtol=1e-6)
        np.testing.assert_allclose(band.damping_ratio_std, zeta_std, rtol=1e-6)


def test_text_of_an_estimate_written_by_hand() -> None:
    estimate = rs.Estimate.from_json(json.dumps(BY_HAND))
    lines = str(estimate).splitlines()
    assert "omega^2                36 +- 0.12" in lines[1] and "0.12 +- 0.001" in lines[2]
    assert lines[3].startswith("The model explains the data to their noise, up to")
    assert lines[4] == "Note: typed in."
    assert repr(estimate) == "<Estimate: 2 coefficients, adequacy 1.000>"


VERDICT = BY_HAND["verdict"]


@pytest.mark.parametrize(
    ("change", "explained", "words"),
    [
        ({"p_value": 0.15}, True, "it may be noise, p = 0.15)"),
        ({"p_value": 9e-24, "structure": 1.2}, True, "but too little to matter: within 30 % of"),
        ({"p_value": 9e-24, "below_floor": True}, True, "too little to matter: below the floor)"),
        ({"p_value": 9e-24, "structure": 2.0}, False, "it is more than noise, p = 9e-24)"),
    ],
)
def test_words_and_p_value_agree(change: dict, explained: bool, words: str) -> None:
    content = BY_HAND | {"verdict": VERDICT | {"limit": 0.4} | change}
    verdict = rs.Estimate.from_json(json.dumps(content)).verdict
    assert verdict.explained is explained and words in str(verdict)
    assert ("does not explain" in str(verdict)) is not explained


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"covariance": [[0.0144]]}, r"covariance has the shape \(1, 1\), but 2 .* give \(2, 2\)"),
        ({"covariance": [[0.0144, 6e-5], [6e-5]]}, "covariance must be a table of numbers"),
        ({"covariance": {"omega^2": 1}}, r"covariance = .* must be a list"),
        ({"covariance": [[-1, 0], [0, 1]]}, "variances of at least zero"),
        ({"free": ["omega^2", "gamma_3"]}, r"free = \['omega\^2', 'gamma_3'\] must name"),
        ({"free": ["omega^2", "omega^2"]}, "must name coefficients of .* once"),
        ({"free": "omega^2"}, 'free = "omega.* must be a list'),
        ({"notes": [1]}, r"notes\[0\] = 1 must be a text"),
        ({"verdict": "good"}, 'verdict = "good" must be a table'),
        ({"verdict": {"ratio": 1}}, "verdict has no 'p_value', 'structure'"),
        ({"verdict": VERDICT | {"ratio": None}}, r"verdict\.ratio = null must be a number"),
        ({"verdict": VERDICT | {"misfit": [1, 2]}}, "misfit has the shape .* for each 6"),
        ({"coefficients": {"omega^2": None}}, r"omega\^2 = null must be a finite number"),
    ],
)
def test_entries_that_do_not_fit_are_named(
    change: dict[str, Any], message: str, tmp_path: Path
) -> None:
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(BY_HAND | change))
    with pytest.raises(ValueError, match=rf"fit\.json is no file of Estimate\.save: .*{message}"):
        rs.Estimate.load(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (json.dumps(BY_HAND).encode()[:-40], r"no JSON, or only the beginning of one \(.*line 1"),
        (b"", "no JSON, or only the beginning of one"),
        (b"PK\x03\x04\xff\xfe", "codec can't decode"),
        (b"[1, 2]", "holds no model"),
        (
            EXAMPLE_MODEL.to_json().encode(),
            "holds a model without covariance, free, notes, verdict: write it again with identify"
            r" --save .* \(in Python: ReducedModel\.from_json\)",
        ),
    ],
)
def test_files_of_another_kind_are_named(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "fit.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"fit\.json is no file of Estimate\.save: .*{message}"):
        rs.Estimate.load(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    for path in (tmp_path / "nothing.json", tmp_path):
        with pytest.raises(FileNotFoundError, match=f"{path.name}: no such file"):
            rs.Estimate.load(path)


def known(coefficients: dict[str, float], covariance: dict[str, list[float]], reach: float) -> Any:
    """An estimate typed in, of which these coefficients have errors."""
    own = {"coefficients": coefficients, "amplitude_range": [0.0, reach]}
    errors = {"free": list(covariance), "covariance": list(covariance.values())}
    return rs.Estimate.from_json(json.dumps(BY_HAND | own | errors))


def test_functions_have_bands_by_the_covariance() -> None:
    """h = U q^2 and K/q = w + g q^2 are linear in coefficients: their bands are closed forms."""
    values = {"omega^2": 36.0, "gamma_3": 9.0, "Upsilon_3": 0.4}
    errors = {"omega^2": [0.04, 0.01, 0], "gamma_3": [0.01, 0.09, 0], "Upsilon_3": [0, 0, 0.0025]}
    found = known(values, errors, 0.5)
    q = np.linspace(-0.5, 0.5, 11)
    h, k = found.inertia(q), found.stiffness(q)
    assert h.value == pytest.approx(0.4 * q**2)
    assert h.high - h.value == pytest.approx(1.96 * 0.05 * q**2, rel=1e-6, abs=1e-12)
    std = np.sqrt(0.04 + 2 * 0.01 * q**2 + 0.09 * q**4)
    assert k.value == pytest.approx(36.0 + 9.0 * q**2, rel=1e-6)  # the limit at 0 is a secant
    assert k.value - k.low == pytest.approx(1.96 * std, rel=1e-6)
    with pytest.raises(ValueError, match=r"leaves the range of the data, -0.5 to 0.5 m"):
        found.inertia([0.6])
    with pytest.raises(ValueError, match="coordinate = 2 must be a whole number from 1 to 1"):
        found.stiffness(q, coordinate=2)


def test_functions_along_each_of_several_coordinates() -> None:
    """Along q2 alone g(q1 q2)^2 shows no inertia, g(q2^2)^2 shows 4 a q2^2."""
    linear = {"omega^2 [q1]": 36.0, "omega^2 [q2]": 144.0}
    more = {"gamma_2 [q2]": 15.0, "g(q1 q2)^2": 0.5, "g(q2^2)^2": 0.25}
    errors = {"gamma_2 [q2]": [1.0, 0.0], "g(q2^2)^2": [0.0, 0.01]}
    found = known(linear | more, errors, 1.0)
    q = np.array([-0.8, 0.3, 0.6])
    h, k = found.inertia(q, coordinate=2), found.stiffness(q, coordinate=2)
    assert h.value == pytest.approx(q**2)
    assert h.high - h.value == pytest.approx(1.96 * 0.1 * 4 * q**2)
    assert k.value == pytest.approx(144.0 + 15.0 * q)
    assert k.high - k.value == pytest.approx(1.96 * np.abs(q))
