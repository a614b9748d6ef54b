"""The right terms are found, and held-out errors are those of fits that left the cycles out."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.linalg import lstsq

import romsindy as rs
from romsindy.physics.example import EXAMPLE_MODEL, add_noise
from romsindy.selection import candidates
from romsindy.selection.candidates import Structure, best, describe, judged
from romsindy.selection.linearised_fit import LARGE, LinearisedFit
from romsindy.selection.select import Selection, default_candidates, select_model
from romsindy.show.plots import plot_selection

TRUE = set(EXAMPLE_MODEL.coefficients)
DECAY = rs.example_decay(snr_db=35.0, seed=1)
SHORT = [rs.example_decay(snr_db=35.0, seed=s, periods=50) for s in (1, 2)]
FULL = rs.ROMLibrary((3, 4, 5), (1, 2, 3, 4, 5), ("linear", "coulomb"))
SMALL = [FULL, rs.ROMLibrary((3,), (1, 2, 3)), rs.ROMLibrary((), (1, 2, 3, 4, 5))]


@pytest.fixture(scope="module")
def choice() -> Selection:
    return select_model(DECAY)


@pytest.fixture(scope="module")
def tangent(choice: Selection) -> LinearisedFit:
    return LinearisedFit.at(choice.fit, list(FULL.terms))


def test_true_terms_are_chosen_among_all_orders_and_dampings(choice: Selection) -> None:
    assert set(choice.chosen.keys) == TRUE
    assert choice.fit.verdict.explained
    assert len(choice.path) > len(default_candidates())  # sparse subsets were seen too


def test_models_that_lack_a_term_predict_worse(choice: Selection) -> None:
    """Every coefficient of the example is at least 20 standard errors from zero."""
    for c in choice.path:
        if not set(c.keys) >= TRUE:
            assert c.verdict in (candidates.WORSE, candidates.INADEQUATE), c.name
    assert all(set(c.keys) > TRUE for c in choice.equivalent)


def test_text_and_figure_name_the_choice(choice: Selection) -> None:
    text = str(choice)
    assert "Chosen of" in text and choice.chosen.name in text
    assert f"from {len(choice.equivalent)} of the other structures" in text
    assert len(choice.table()) == len(choice.path) + 1
    ax = plot_selection(choice)
    assert [t.get_text() for t in ax.get_legend().get_texts()] == [
        candidates.CHOSEN,
        candidates.EQUIVALENT,
        "worse",
    ]
    plt.close(ax.figure)


def test_band_with_the_choice_is_not_narrower_than_without(choice: Selection) -> None:
    amplitudes = np.array([0.2, 1.0, 1.6])
    alone, both = choice.fit.band(amplitudes), choice.band(amplitudes)
    np.testing.assert_array_equal(both.frequency, alone.frequency)
    # Larger models have larger errors, but for what the noise of covariances does.
    assert np.all(both.frequency_std > 0.98 * alone.frequency_std)


def test_sensitivities_agree_with_fitting_anew(choice: Selection, tangent: LinearisedFit) -> None:
    """A larger and a smaller model, neither the one of the tangent."""
    larger = rs.refine(_model(tangent.solve([t.key for t in FULL.terms])), DECAY)
    # Of 15000; what separates models is of order one.
    assert tangent.chi_squared(larger.free) == pytest.approx(larger.chi_squared, abs=0.2)
    for name, error in larger.standard_errors.items():
        assert tangent.solve(larger.free)[name] == pytest.approx(
            larger.model.coefficients[name], abs=0.3 * error
        )


def test_cycles_are_predicted_by_the_fit_to_all_others(tangent: LinearisedFit) -> None:
    keys = sorted(TRUE)
    errors = tangent.cycle_errors(keys)
    columns = [*map(tangent.keys.index, keys), -2, -1]  # the last two are the states
    for cycle in (0, 40, len(errors) - 1):
        others = np.arange(len(errors)) != cycle
        x = tangent.theta[others][..., columns].reshape(-1, len(columns))
        scale = np.linalg.norm(x, axis=0)
        solution = lstsq(x / scale, tangent.target[others].ravel())[0] / scale
        rest = tangent.target[cycle] - tangent.theta[cycle][:, columns] @ solution
        assert errors[cycle] == pytest.approx(rest @ rest, rel=1e-8)


def test_forecast_is_the_fit_to_smaller_amplitudes(tangent: LinearisedFit) -> None:
    keys = sorted(TRUE)
    columns = [*map(tangent.keys.index, keys), -2, -1]
    large = tangent.amplitude > LARGE * tangent.amplitude.max()
    x, y = tangent.theta[..., columns], tangent.target
    scale = np.sqrt(np.sum(x**2, axis=(0, 1)))
    solution = lstsq((x[~large] / scale).reshape(-1, len(columns)), y[~large].ravel())[0] / scale
    expected = np.sqrt(np.sum((y[large] - x[large] @ solution) ** 2) / tangent.samples[large].sum())
    error, p_value = tangent.forecast(keys)
    assert error == pytest.approx(expected, rel=1e-6)
    assert p_value > 0.01
    wrong, p_wrong = tangent.forecast([k for k in keys if k != "Upsilon_5"])
    assert wrong > 2 * error and p_wrong < 1e-6


def test_dry_friction_is_found() -> None:
    truth = rs.ReducedModel.from_coefficients(
        {"omega^2": 36.0, "gamma_3": 9.0, "c_linear": 0.03, "c_coulomb": 0.05}, unit="m"
    )
    t = np.linspace(0, 30, 3001)
    decay = add_noise(truth.simulate(1.5, 0.0, t), 40.0, seed=2)
    candidates = [
        rs.ROMLibrary((), (1, 2, 3), ("linear", kind)) for kind in ("coulomb", "quadratic")
    ]
    choice = select_model(decay, candidates)
    assert set(choice.chosen.keys) == set(truth.coefficients)
    error = choice.fit.standard_errors["c_coulomb"]
    assert abs(choice.model.coefficients["c_coulomb"] - 0.05) < 4 * error


def test_known_coefficients_and_several_decays() -> None:
    choice = select_model(SHORT, SMALL, fixed={"omega^2": 36.0}, survivors=1)
    assert choice.model.coefficients["omega^2"] == 36.0
    assert {*choice.chosen.keys, "omega^2"} == TRUE
    assert len(choice.fit.states) == 2


def test_two_processes_give_the_numbers_of_one() -> None:
    one, two = (select_model(SHORT[0], SMALL, n_jobs=n) for n in (1, 2))
    assert one.table() == two.table() and one.model == two.model
    assert any(c.fit is not None for c in two.equivalent)  # fitted in other processes


def test_where_all_are_wrong_the_best_is_chosen_and_said_not_to_explain() -> None:
    choice = select_model(SHORT[0], SMALL[2:], sparse=False)
    assert not choice.fit.verdict.explained
    assert "does not explain the data" in str(choice)


def test_interrupt_keeps_what_it_had() -> None:
    lines: list[str] = []

    def impatient(line: str) -> None:
        lines.append(line)
        if sum(text.startswith("fitting") for text in lines) == 2:
            raise KeyboardInterrupt

    choice = select_model(SHORT[0], SMALL, progress=impatient)
    assert choice.message.startswith("interrupted")
    assert set(choice.chosen.keys) == set(choice.fit.free)


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="decays is empty"):
        select_model([])
    with pytest.raises(ValueError, match="candidates is empty"):
        select_model(DECAY, [])
    with pytest.raises(ValueError, match="survivors = 0 must be at least 1"):
        select_model(DECAY, survivors=0)
    with pytest.raises(ValueError, match=r"fixed names \['gamma_7'\], which candidate 0 has not"):
        select_model(DECAY, SMALL, fixed={"gamma_7": 1.0})
    with pytest.raises(ValueError, match="candidate 0 has no free coefficient"):
        select_model(DECAY, [rs.ROMLibrary((), (1,), ())], fixed={"omega^2": 36.0})
    with pytest.raises(ValueError, match="decay 1 is the same record"):
        select_model([DECAY, DECAY], SMALL)
    with pytest.raises(TypeError, match="is not a library of terms"):
        select_model(DECAY, ["IC-ROM"])


def contender(keys: str, excess: float, std: float, p: float = 0.5, size: int = 0) -> Structure:
    return Structure(tuple(keys.split()), size or len(keys.split()), 1.0, excess, std, 1.0, p)


def test_smallest_within_one_standard_error_wins() -> None:
    some = [contender("a b c", 0, 0), contender("a b", 2, 2.1), contender("a", 5, 4.9)]
    some += [contender("b", 5, 2.4)]
    assert best(some).keys == ("a", "b")
    same = candidates.EQUIVALENT
    verdicts = {c.keys: c.verdict for c in judged(some, best(some))}
    assert verdicts == {
        ("a",): same,
        ("b",): candidates.WORSE,
        ("a", "b"): candidates.CHOSEN,
        ("a", "b", "c"): same,
    }


def test_term_of_high_order_counts_as_that_order() -> None:
    some = [contender("a b c", 0, 0), contender("a z", -1, 2, size=9)]
    assert best(some).keys == ("a", "b", "c")


def test_model_that_fails_at_large_amplitudes_is_passed_over() -> None:
    some = [contender("a b", 0, 0), contender("a", 1, 2, p=1e-4)]
    assert best(some).keys == ("a", "b")
    assert judged(some)[0].verdict == candidates.NARROW


def test_short_names_join_orders() -> None:
    keys = ["Upsilon_3", "Upsilon_5", "omega^2", "gamma_2", "gamma_3", "gamma_4", "c_linear"]
    assert describe(keys) == "omega^2, gamma 2-4, Upsilon 3 5, c_linear"


def _model(coefficients: dict[str, float]) -> rs.ReducedModel:
    return rs.ReducedModel.from_coefficients(coefficients, unit="m")
