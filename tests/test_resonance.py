"""Which modes of a fit ring at p:q, on decays of a simulator that shares nothing with it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.physics.example import EXAMPLE_MODEL

OMEGA, GAMMA = 2 * np.pi * 10.0, 900.0
SHAPES = np.array([[1.0, 0.6], [0.5, 1.0]])


def fitted(ratio, starts=((0.8, 0.5),), swapped=False):
    """A fit to two oscillators whose small frequencies have a ratio; the lower one hardens."""

    def rates(_, y):
        q1, q2, v1, v2 = y
        a1 = -(OMEGA**2) * q1 - GAMMA * q1**3 - 0.6 * v1
        return [v1, v2, a1, -((ratio * OMEGA) ** 2) * q2 - 1.0 * v2]

    t, found = np.arange(0, 4, 1 / 400), []
    for number, start in enumerate(starts):
        options = {"t_eval": t, "method": "DOP853", "rtol": 1e-9, "atol": 1e-12}
        q = solve_ivp(rates, (0, 4), [*start, 0.0, 0.0], **options).y[:2].T @ SHAPES.T
        noise = np.random.default_rng(number).standard_normal(q.shape)
        found.append(rs.Decay(t, 1e-3 * (q + 1e-3 * noise), unit="m"))
    low, high = ("q2", "q1") if swapped else ("q1", "q2")
    start = {
        f"omega^2 [{low}]": OMEGA**2,
        f"omega^2 [{high}]": (ratio * OMEGA) ** 2,
        f"gamma_3 [{low}]": GAMMA * 1e6,
        f"c_linear [{low}]": 0.6,
        f"c_linear [{high}]": 1.0,
    }
    return rs.refine(rs.CoupledModel.from_coefficients(start, unit="m"), found)


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "q"), [(2.06, 2), (3.09, 3)])
@pytest.mark.parametrize("swapped", [False, True])
def test_the_ratio_is_that_of_the_frequencies_and_the_amplitude_where_it_is(ratio, q, swapped):
    """3 % above p:q at rest: the lower frequency comes up to it at one amplitude."""
    fit = fitted(ratio, swapped=swapped)
    (found,) = fit.resonances
    assert (found.lower, found.higher, found.p, found.q) == (0, 1, 1, q)
    # The frequencies of windows scatter by some 1e-4 at 60 dB.
    assert found.ratio == pytest.approx(q, rel=1e-3)
    single = rs.ReducedModel.from_coefficients({"omega^2": OMEGA**2, "gamma_3": GAMMA})
    sizes = np.linspace(0.01, 0.8, 400)
    there = np.interp(ratio / q * OMEGA, single.backbone(sizes), sizes)
    # Windows lie a quarter of their length apart, over which the amplitude falls by some percent.
    assert found.amplitude == pytest.approx(1e-3 * there, rel=0.1)
    said = f"Note: modes 1 and 2 ring at 1:{q} (ratio {found.ratio:.4g} at"
    assert said in str(fit) and str(fit).count(" ring at ") == 1
    assert f"{1e6 * found.amplitude:.3g} um)" in str(fit)


def test_a_note_is_kept_in_the_file(tmp_path):
    fit = fitted(2.06)
    fit.save(tmp_path / "fit.json")
    assert "ring at 1:2" in str(rs.Estimate.load(tmp_path / "fit.json"))


@pytest.mark.slow
def test_the_nearest_of_all_records_is_told():
    """Small motions stay 0.6 % away; only the larger ones come upon the ratio."""
    near, far = (0.8, 0.5), (0.1, 0.5)
    (both,), (alone,) = (fitted(2.012, x).resonances for x in ((far, near), (far,)))
    assert alone.ratio == pytest.approx(2.012, rel=1e-3)  # at 0.1 the frequency moves by 1e-3
    # The frequency moves by some 1e-3 from one window to the next.
    assert both.ratio == pytest.approx(2.0, rel=2e-3) and both.off < alone.off


@pytest.mark.slow
def test_nothing_is_told_where_there_is_nothing():
    fit = fitted(2.41 * 1.01)
    assert fit.resonances == () and "ring at" not in str(fit)
    single = rs.refine(EXAMPLE_MODEL, rs.example_decay(snr_db=40, seed=3))
    assert single.resonances == () and single.notes == ()
