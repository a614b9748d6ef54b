from dataclasses import replace

import numpy as np
import pytest

from romsindy import (
    HarmonicProjection,
    HarmonicSINDy,
    ReducedModel,
    add_noise,
    example_decay,
    extract_backbone,
)
from romsindy.regression.estimator import WEIGHTED, compare_models
from romsindy.regression.judged import coefficient_table, judge, negative_inertia


@pytest.fixture(scope="module")
def candidates():
    free = example_decay(35.0, 0).free()
    return list(compare_models(free.conditioned(), extract_backbone(free), recipe=WEIGHTED))


def test_four_models_and_their_errors(candidates):
    names = [c.name for c in candidates]
    assert names == ["stiffness", "stiffness, omega fixed", "IC-ROM", "IC-ROM, omega fixed"]
    stiffness, _, icrom, fixed = candidates
    assert icrom.rms_error < 2e-3 < stiffness.rms_error < stiffness.max_error
    # The fixed frequency is the one the measured backbone tends to: 6 rad/s.
    assert np.sqrt(fixed.model.coefficients["omega^2"]) == pytest.approx(6.0, rel=2e-3)
    assert "Upsilon_3" not in stiffness.model.coefficients


def test_known_coefficients_enter_every_model():
    free = example_decay(35.0, 0).free()
    fixed = {"omega^2": 36.0, "Upsilon_3": 0.3}
    models = list(compare_models(free.conditioned(), extract_backbone(free), fixed=fixed))
    assert models[2].model.coefficients["Upsilon_3"] == 0.3
    assert models[2].model.coefficients["omega^2"] != 36.0  # estimated here, fixed there
    assert models[3].model.coefficients["omega^2"] == 36.0
    with pytest.raises(ValueError, match="order = 2 must be at least 3"):
        list(compare_models(free.conditioned(), extract_backbone(free), order=2))


def test_uncertain_cycles_do_not_judge(candidates):
    """The frequency of the last cycle is not known to 1 %: nan, and counted nowhere."""
    backbone = extract_backbone(example_decay(35.0, 0))
    known = backbone.frequency_std.copy()
    known[-1] = 0.011 * backbone.frequency[-1]
    icrom = judge("IC-ROM", candidates[2].model, replace(backbone, frequency_std=known))
    assert np.flatnonzero(np.isnan(icrom.error)).tolist() == [len(backbone) - 1]
    assert icrom.lost == 0


def test_missing_motion_is_reported():
    """A high order that was learnt from small noisy amplitudes has no motion at large ones."""
    model = ReducedModel.from_coefficients({"omega^2": 36.0, "gamma_3": -8.0, "c_linear": 0.05})
    noisy = add_noise(model.simulate(1.6, 0.0, np.arange(8000) * 0.01), 25.0, 0)
    small = HarmonicSINDy(projection=HarmonicProjection(amplitude=(0.0, 0.5)))
    found = list(compare_models(noisy.conditioned(), extract_backbone(noisy), 7, recipe=small))
    lost = [c for c in found if c.lost]
    assert lost
    for c in lost:
        assert np.isnan(c.rms_error) and np.isnan(c.max_error)
    texts = coefficient_table(found)
    assert [cell == "no motion" for cell in texts[-1][2:]] == [bool(c.lost) for c in found]


def test_table_has_a_row_for_every_coefficient(candidates):
    rows = coefficient_table(candidates)
    assert [r[0] for r in rows[1:7]] == [
        "omega^2",
        "gamma_2",
        "gamma_3",
        "gamma_4",
        "gamma_5",
        "Upsilon_3",
    ]
    by = {r[0]: r for r in rows}
    assert by["Upsilon_3"][2:4] == ["-", "-"]
    assert by["omega^2"][5].endswith("(fixed)") and by["omega^2"][1] == "1/s^2"
    assert float(by["backbone error, rms"][4]) == pytest.approx(
        100 * candidates[2].rms_error, rel=0.01
    )


def test_rows_are_in_the_order_of_their_numbers():
    """gamma_10 comes after gamma_2 and gamma_9."""
    free = example_decay(35.0, 0).free()
    found = list(compare_models(free.conditioned(), extract_backbone(free), 10))
    names = [row[0] for row in coefficient_table(found)]
    gammas = [name for name in names if name.startswith("gamma")]
    assert gammas == [f"gamma_{m}" for m in range(2, 11)]


def test_where_inertia_falls_below_that_of_the_mode():
    """h = 0.3 q^2 - 0.4 q^4 is negative beyond |q| = sqrt(3/4); grid points are 0.001 apart."""
    model = ReducedModel.from_coefficients({"omega^2": 1, "Upsilon_3": 0.3, "Upsilon_5": -0.4})
    assert negative_inertia(model, -1.0, 1.0) == pytest.approx(np.sqrt(0.75), abs=1e-3)
    assert negative_inertia(model, -0.8, 0.8) is None
