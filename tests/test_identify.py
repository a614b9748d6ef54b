"""One door: the records say which way is taken, and every result answers the same questions."""

import numpy as np
import pytest

import romsindy as rs
from romsindy.physics.coupling import Along
from romsindy.physics.damping import PowerDamping
from romsindy.physics.stiffness import Stiffness

TRUTH = {"omega^2": 400.0, "c_linear": 0.4, "gamma_3": 100.0}
MODEL = rs.ReducedModel.from_coefficients(TRUTH, unit="m")
T = np.arange(0, 12, 0.01)


def decay(seed, amplitude=1.0, channels=1, noise=1e-3):
    clean = MODEL.simulate(amplitude, 0.0, T)
    rng = np.random.default_rng(seed)
    q = np.column_stack([clean.q * s for s in (1.0, 0.5)[:channels]])
    q = q + noise * rng.standard_normal(q.shape)
    return rs.Decay(T, q if channels > 1 else q[:, 0], unit="m", stage="free")


def shaken(seed):
    rng = np.random.default_rng(seed)
    tones = rng.uniform(1.5, 5.5, 30)
    phase = rng.uniform(0, 2 * np.pi, 30)
    u = 2.0 * np.cos(2 * np.pi * np.outer(T, tones) + phase).sum(axis=1)
    driven = rs.ReducedModel.from_coefficients({**TRUTH, "gain [force]": 1.0}, unit="m")
    y = driven.simulate(0.0, 0.0, T, u=u).y + 1e-3 * rng.standard_normal(len(T))
    return rs.ForcedVibration(T, y, u, unit="m")


@pytest.fixture(scope="module")
def found():
    """One result of every kind, of the same structure."""
    return {
        "decay": rs.identify(decay(1)),
        "channels": rs.identify(decay(2, channels=2)),
        "driven": rs.identify(shaken(3), order=3),
        "given": rs.identify([decay(4), shaken(5)], terms=[Stiffness(3)]),
    }


KINDS = ("decay", "channels", "driven", "given")


@pytest.mark.parametrize("kind", KINDS)
def test_every_result_has_the_structure_in_its_intervals(found, kind):
    """Four standard errors to either side: chance leaves one of 15,000 outside."""
    result = found[kind]
    for name, value in TRUTH.items():
        key = name if name in result.model.coefficients else f"{name} [q1]"
        low, high = result.interval(key)
        middle, half = (low + high) / 2, (high - low) / 2
        assert abs(value - middle) < 2 * half, (key, low, high)
    assert result.verdict.explained
    with pytest.raises(ValueError, match="name = 'stiffness' is no coefficient: there are"):
        result.interval("stiffness")


@pytest.mark.parametrize("kind", KINDS)
def test_every_result_predicts_a_record_that_took_no_part(found, kind):
    """From the state of its first 100 samples, to twice the noise."""
    record = decay(11, 0.8, channels=2 if kind == "channels" else 1)
    missed = found[kind].predict(record, 100) - record.signal
    assert np.sqrt(np.mean(missed**2)) < 2e-3
    with pytest.raises(ValueError, match="samples = 3 must be a whole number from 4 to the 1200"):
        found[kind].predict(record, 3)


def test_what_cannot_be_predicted_is_refused(found):
    result, record = found["decay"], decay(11)
    other = rs.Decay(T, 1e3 * record.q, unit="mm")
    for wrong, message in (
        (record.q, "record is ndarray: give one Decay"),
        ([record], "record is list: give one Decay"),
        (other, "decay 0 is in mm, the model in m: load the decay with unit='m'"),
    ):
        with pytest.raises(ValueError) as refused:
            result.predict(wrong, 100)
        assert message in str(refused.value)


def test_what_was_saved_predicts_as_well(found, tmp_path):
    """The equation is all that is needed of one coordinate; of several the sensors are."""
    record = decay(11, 0.8)
    found["given"].save(tmp_path / "found.json")
    loaded = rs.Estimate.load(tmp_path / "found.json")
    assert np.std(loaded.predict(record, 100) - record.q) < 2e-3
    found["channels"].save(tmp_path / "several.json")
    with pytest.raises(ValueError, match="what the channels show of several coordinates is not"):
        rs.Estimate.load(tmp_path / "several.json").predict(decay(11, channels=2), 100)


def test_results_with_inputs_predict_under_them(found):
    record = shaken(12)
    for kind in ("driven", "given"):
        missed = found[kind].predict(record, 100) - record.y
        assert np.sqrt(np.mean(missed**2)) < 2e-3


def test_fixed_coefficients_stay_with_terms_given():
    fit = rs.identify(decay(6), terms=[Stiffness(3), PowerDamping(1)], fixed={"omega^2": 400.0})
    assert fit.interval("omega^2") == (400.0, 400.0)
    assert list(fit.model.coefficients) == ["omega^2", "c_linear", "gamma_3"]


def test_fixed_coefficients_stay_where_terms_are_chosen(found):
    """Known to be what they are, they are no candidates, and the others keep their intervals."""
    known = {"omega^2": 400.0, "gamma_2": 0.0}
    driven = rs.identify(shaken(3), order=3, fixed=known)
    channels = rs.identify(decay(2, channels=2), fixed={f"{k} [q1]": v for k, v in known.items()})
    for fit, coordinate in ((driven, ""), (channels, " [q1]")):
        for name, value in known.items():
            assert fit.interval(name + coordinate) == (value, value)
        assert not {k + coordinate for k in known} & {*fit.free}
    for fit, free in ((driven, found["driven"]), (channels, found["channels"])):
        name = next(n for n in fit.free if n.startswith("c_linear"))
        assert fit.standard_errors[name] <= 1.1 * free.standard_errors[name]


def test_terms_of_several_coordinates_may_be_given():
    """Two oscillators that know nothing of one another, in two channels of their sums."""
    both = [decay(7), decay(8, 0.7)]
    other = rs.ReducedModel.from_coefficients({"omega^2": 3000.0, "c_linear": 0.5}, unit="m")
    second = other.simulate(0.5, 0.0, T).q
    records = [
        rs.Decay(
            T, np.column_stack([d.q + s * second, 0.4 * d.q - s * second]), unit="m", stage="free"
        )
        for d, s in zip(both, (1.0, 0.6), strict=True)
    ]
    cubic = Along.coordinate(Stiffness(3), 1)
    fit = rs.identify(records, 2, terms=[cubic], fixed={"omega^2 [q2]": 3000.0})
    assert fit.interval("omega^2 [q2]") == (3000.0, 3000.0)
    errors = fit.standard_errors
    truth = {f"{k} [q1]": v for k, v in TRUTH.items()} | {"c_linear [q2]": 0.5}
    assert {*errors} == {*truth}
    # The noise of both channels is that of one decay: correlated, which nobody knows.
    for name, value in truth.items():
        assert abs(fit.model.coefficients[name] - value) < 4 * errors[name]


def test_what_a_way_cannot_have_is_refused_with_a_remedy():
    several, driven = decay(7, channels=2), shaken(8)
    for records, asked, message in (
        (
            driven,
            {"coordinates": 2},
            "coordinates = 2, but what the inputs move in the record is 3.",
        ),
        (driven, {"curvature": 0.01}, "curvature = 0.01 must be left out where inputs drive"),
        (driven, {"fixed": {"gamma_9": 1.0}}, "fixed names ['gamma_9'], but there are omega^2,"),
        (several, {"fixed": {"omega^2": 1.0}}, "fixed names ['omega^2'], but there are omega^2 [q"),
        (several, {"fixed": {"omega^2 [q1]": -1.0}}, "fixed omega^2 [q1] = -1 must not be negati"),
        (several, {"coordinates": 2, "terms": [Stiffness(3)]}, "say which coordinate each is of"),
        (several, {"coordinates": "auto", "terms": []}, "must be a number where terms are given"),
        (several, {"terms": [Stiffness(3)], "fixed": {"b": 1.0}}, "fixed names ['b'], but there"),
        (several, {"terms": [Stiffness(3)], "fixed": ["b"]}, "fixed = ['b'] must map names to"),
        (several, {"terms": [], "curvature": 0.0}, "must be left out where terms are given"),
        (several, {"terms": "gamma_3"}, "terms = 'gamma_3' must be a list, such as ['gamma_3']"),
        (several, {"terms": Stiffness(3)}, "must be a list, such as ['gamma_3']"),
        (several, {"terms": ["gama_3"]}, "coefficient name 'gama_3' is not known: use"),
        (several, {"terms": ["gamma_3 [q1]"]}, "give names or laws of one coordinate, such as"),
        (driven, {"order": 2.5}, "order = 2.5 must be a whole number, 1 or more"),
    ):
        with pytest.raises(ValueError) as refused:
            rs.identify(records, **asked)
        assert message in str(refused.value)


def test_terms_are_named_or_given_as_laws():
    decay = rs.example_decay(40, periods=20, samples=30)
    named, given = (rs.identify(decay, terms=t) for t in (["gamma_3"], (Stiffness(3),)))
    assert named.model == given.model and "gamma_3" in named.free


@pytest.mark.parametrize("name", ["identify_coupled", "identify_forced", "free_run", "study"])
def test_an_old_name_answers_with_the_new_one(name):
    with pytest.raises(AttributeError, match=f"romsindy.{name} is now "):
        getattr(rs, name)
