"""Regression under inputs, on motions of a simulator that shares nothing with the package."""

import pickle

import numpy as np
import pysindy as ps
import pytest
from sklearn.base import clone
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV
from test_forced import DAMPING, DT, GAIN, OMEGA, duffing, held, misses, multisine, noisy

import romsindy as rs
from romsindy import ForcedVibration, HarmonicSINDy, ROMLibrary

N, CUBIC = 4000, 2e4
T = DT * np.arange(N)
TRUTH = {
    "omega^2": OMEGA**2,
    "gamma_3": CUBIC,
    "c_linear": DAMPING,
    "gain [force]": GAIN,
}
DUFFING = ROMLibrary(inertia=(), stiffness=(1, 3))


@pytest.fixture(scope="module")
def record():
    """Force and displacement at 40 dB, (n,); velocity and acceleration without noise."""
    u, force = multisine(1, N)
    q, v = duffing(force, T, cubic=CUBIC)
    a = GAIN * force(T) - DAMPING * v - OMEGA**2 * q - CUBIC * q**3
    return u, noisy(q, 2), v, a


def errors(model):
    assert {*model.coefficients} == {*TRUTH}
    return np.array([model.coefficients[k] / v - 1 for k, v in TRUTH.items()])


@pytest.mark.slow
def test_duffing_under_a_multisine_and_its_fit(record):
    u, q = record[:2]
    estimator = HarmonicSINDy(DUFFING).fit(q, T, u=u)
    assert np.abs(errors(estimator.model_)).max() < 0.01
    assert estimator.score(q, T, u) > 0.999
    assert estimator.equations()[0].endswith("= 3 force(t)")
    np.testing.assert_array_equal(estimator.coef_, estimator.model_.values)
    fit = rs.refine(estimator.model_, ForcedVibration(T, q, u))
    assert np.abs(misses(fit, CUBIC)).max() < 3


@pytest.mark.slow
def test_a_forced_vibration_is_as_good_as_its_arrays(record):
    u, q = record[:2]
    by_arrays = HarmonicSINDy(DUFFING).fit(np.column_stack([q, record[2]]), T, u)
    vibration = ForcedVibration(T, q, u, unit="m", input_unit="N")
    by_record = HarmonicSINDy(DUFFING).fit(vibration)
    np.testing.assert_array_equal(by_record.coef_, by_arrays.coef_)
    assert by_record.model_.unit == "m" and "m/(s^2 N)" in str(by_record.model_)
    assert by_record.score(vibration) > 0.999
    halves = [q[:2000], q[2000:]], [T[:2000], T[2000:]], [u[:2000], u[2000:]]
    assert np.abs(errors(HarmonicSINDy(DUFFING).fit(*halves).model_)).max() < 0.02


@pytest.mark.parametrize(
    "measured", ["velocity", pytest.param("acceleration", marks=pytest.mark.slow)]
)
def test_other_quantities_are_read_as_they_were_measured(record, measured):
    y = record[2 if measured == "velocity" else 3]
    vibration = ForcedVibration(T, 0.1 + noisy(y, 3), record[0], measured=measured)
    assert np.abs(errors(HarmonicSINDy(DUFFING).fit(vibration).model_)).max() < 0.01


@pytest.mark.slow
def test_sparse_regression_keeps_what_is_needed(record):
    """Of stiffness and inertia up to order five."""
    u, q = record[:2]
    sparse = HarmonicSINDy(ROMLibrary(), ps.STLSQ(threshold=3e-3)).fit(q, T, u)
    assert np.abs(errors(sparse.model_)).max() < 0.01
    assert len(sparse.coef_) == 10 and np.count_nonzero(sparse.coef_) == 4
    with (
        pytest.warns(UserWarning, match="Sparsity parameter is too big"),
        pytest.raises(ValueError, match=r"left no 'gain \[force\]'"),
    ):
        HarmonicSINDy(DUFFING, ps.STLSQ(threshold=0.9)).fit(q, T, u)


def test_what_the_input_does_between_samples_is_found():
    """The phase of one that is held lags by half a sample: damping would be wrong."""
    u = multisine(4, N)[0]
    linear = HarmonicSINDy(ROMLibrary((), (1,)), LinearRegression())
    model = linear.fit(ForcedVibration(T, noisy(held(u), 5), u)).model_
    assert model.terms[-1].interpolation == "hold"
    assert model.coefficients["c_linear"] == pytest.approx(DAMPING, rel=0.01)


@pytest.mark.slow
def test_inertia_and_two_inputs():
    """A base and a force; a motion to one side, whose mean an offset of the sensor hides."""
    names = {"omega^2": OMEGA**2, "c_linear": DAMPING, "gamma_2": 1500.0, "gamma_3": CUBIC}
    names |= {"Upsilon_3": 8.0, "gain [force]": GAIN, "Gamma [base]": 1.5}
    u = np.column_stack([multisine(1, N)[0], multisine(6, N)[0]])
    truth = rs.ReducedModel.from_coefficients(names, "m")
    moved = truth.simulate(0.0, 0.0, T, u=u)
    y = 0.3 + noisy(moved.y, 7)
    vibration = ForcedVibration(T, y, u, unit="m", inputs=moved.names)
    model = HarmonicSINDy(ROMLibrary((3,), (1, 2, 3))).fit(vibration).model_
    off = {k: model.coefficients[k] / v - 1 for k, v in names.items()}
    assert max(map(abs, off.values())) < 0.03, off


@pytest.mark.slow
def test_known_coefficients_and_gains(record):
    u, q = record[:2]
    known = {"gamma_3": CUBIC, "gain [force]": GAIN}
    model = HarmonicSINDy(DUFFING, fixed=known).fit(q, T, u).model_
    assert np.abs(errors(model)).max() < 0.01
    assert {k: model.coefficients[k] for k in known} == known
    with pytest.raises(ValueError, match="contradicts the data"):
        HarmonicSINDy(DUFFING, fixed={"omega^2": 5.0}).fit(q, T, u)
    with pytest.raises(ValueError, match="fixed names 'gamma_5'"):
        HarmonicSINDy(DUFFING, fixed={"gamma_5": 5.0}).fit(q, T, u)


def test_scikit_learn_takes_it(record):
    u, q = record[:2]
    estimator = HarmonicSINDy(DUFFING, projection=rs.WindowProjection(cycles=8))
    fitted = estimator.fit(q[:1000], T[:1000], u[:1000])
    assert clone(fitted).get_params()["projection__cycles"] == 8
    again = pickle.loads(pickle.dumps(fitted))
    np.testing.assert_array_equal(again.coef_, fitted.coef_)
    whole = ForcedVibration(T, q, u, interpolation="band-limited")
    pieces = [whole.between(0.0, 6.0), whole.between(6.01, 12.0)]
    grid = {"library": [ROMLibrary((), (1,)), DUFFING]}
    search = GridSearchCV(HarmonicSINDy(), grid, cv=2).fit(pieces)
    assert search.best_params_["library"] is DUFFING


def test_what_does_not_go_together_is_refused(record):
    u, q = record[:2]
    forced, fit = ForcedVibration(T, q, u), HarmonicSINDy(DUFFING).fit
    with pytest.raises(ValueError, match=r"u has 3999 samples, and t 4000"):
        fit(q, T, u[1:])
    with pytest.raises(ValueError, match="x is a Decay, which nothing drives: leave out u"):
        fit(rs.Decay(T, q), u=u)
    with pytest.raises(ValueError, match="x is a ForcedVibration, which has inputs: leave out u"):
        fit(forced, u=u)
    with pytest.raises(ValueError, match="x holds forced vibrations and others"):
        fit([forced, rs.Decay(T, q)])
    with pytest.raises(ValueError, match="t is missing"):
        fit(q, u=u)
    with pytest.raises(ValueError, match="x holds 2 records, but t 2 and u 1"):
        fit([q, q[:-1]], [T, T[:-1]], [u])
    with pytest.raises(ValueError, match="give WindowProjection"):
        HarmonicSINDy(DUFFING, projection=rs.HarmonicProjection()).fit(forced)
    with pytest.raises(ValueError, match=r"the model has inputs: use model_\.simulate"):
        fit(q[:1000], T[:1000], u[:1000]).predict(q, T)
    with pytest.raises(ValueError, match="displacement of the base"):
        moved = ForcedVibration(T, q, u / OMEGA**2, inputs="base")
        fit(moved)
