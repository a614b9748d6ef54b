import pickle

import numpy as np
import pysindy as ps
import pytest
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.pipeline import FeatureUnion

from romsindy import (
    BeamTheoryLibrary,
    DampingLibrary,
    EscapeError,
    HarmonicLibrary,
    HarmonicProjection,
    ICROMLibrary,
    ROMLibrary,
    ScaledOptimizer,
    StiffnessLibrary,
    implicit_data,
)
from romsindy.physics.example import EXAMPLE_MODEL
from romsindy.regression.library import library_terms

LIBRARIES = [
    ICROMLibrary((3, 4, 5)),
    StiffnessLibrary((1, 2, 3)),
    DampingLibrary(("linear", "coulomb")),
    BeamTheoryLibrary(),
    ROMLibrary((3, 5), (1, 3), ("linear", "q^2 q_dot")),
]
NAMES = ["q", "q_dot", "q_ddot"]


def signals(decay):
    return np.stack([decay.q, decay.q_dot, decay.q_ddot], axis=1)


def truth(library):
    return [EXAMPLE_MODEL.coefficients.get(t.key, 0.0) for t in library_terms(library)]


@pytest.mark.parametrize("library", LIBRARIES, ids=lambda lib: type(lib).__name__)
def test_columns_are_the_strong_forms(library, clean):
    x = signals(clean)[:50]
    columns = np.asarray(library.fit_transform(x))
    expected = np.stack([t.strong(*x.T) for t in library.terms], axis=1)
    np.testing.assert_array_equal(columns, expected)
    assert library.get_feature_names(NAMES) == [t.expression() for t in library.terms]
    assert len(library.get_feature_names_out()) == library.n_output_features_ == columns.shape[1]


@pytest.mark.parametrize("library", LIBRARIES, ids=lambda lib: type(lib).__name__)
def test_clone_pickle_and_parameters(library):
    copy = clone(library)
    assert copy.get_params() == library.get_params()
    assert pickle.loads(pickle.dumps(library)).get_params() == library.get_params()
    assert copy.set_params(channels=(2, 1, 0)).channels == (2, 1, 0)


def test_channels_choose_the_columns(clean):
    x = signals(clean)[:20]
    swapped = ROMLibrary(channels=(2, 0, 1)).fit_transform(x[:, [1, 2, 0]])
    np.testing.assert_array_equal(swapped, ROMLibrary().fit_transform(x))


def test_plain_sindy_recovers_every_coefficient(clean):
    """Time domain, public PySINDy alone: each coefficient to 1e-3 (it is 1e-13)."""
    library = ICROMLibrary((3, 4, 5)) + StiffnessLibrary((1, 2, 3)) + DampingLibrary()
    model = ps.SINDy(
        feature_library=library,
        optimizer=ScaledOptimizer(ps.STLSQ(threshold=1e-4, alpha=1e-12)),
    )
    data = implicit_data(clean)
    model.fit(t=clean.t, feature_names=NAMES, **data)
    np.testing.assert_allclose(model.coefficients()[0], truth(library), rtol=1e-6)
    assert model.get_feature_names()[0] == "(q^2 q_ddot + q q_dot^2)"
    prediction = model.predict(data["x"], data["u"])
    np.testing.assert_allclose(prediction, data["x_dot"], atol=1e-6)
    assert model.score(data["x"], clean.t, x_dot=data["x_dot"], u=data["u"]) > 1 - 1e-9


def test_plain_sindy_prints_the_equation(clean, capsys):
    model = ps.SINDy(feature_library=ROMLibrary((3, 4, 5), (1, 2, 3)), optimizer=ScaledOptimizer())
    model.fit(t=clean.t, feature_names=NAMES, **implicit_data(clean))
    model.print(lhs=["-q_ddot"])
    text = capsys.readouterr().out
    assert text.startswith("-q_ddot = ") and "36.000 q" in text
    assert "0.050 (2 q^3 q_ddot + 3 q^2 q_dot^2)" in text


def test_plain_optimizers_and_several_records(clean):
    data = implicit_data(clean)
    halves = {k: [v[:7000], v[8000:]] for k, v in data.items()}
    model = ps.SINDy(
        feature_library=ROMLibrary((3, 4, 5), (1, 2, 3)),
        optimizer=ps.STLSQ(threshold=1e-3, alpha=1e-12),
    )
    model.fit(t=[clean.t[:7000], clean.t[8000:]], **halves)
    np.testing.assert_allclose(
        model.coefficients()[0], truth(ROMLibrary((3, 4, 5), (1, 2, 3))), rtol=1e-6
    )


def test_harmonic_library_in_plain_sindy(clean):
    library = HarmonicLibrary(ROMLibrary((3, 4, 5), (1, 2, 3)), HarmonicProjection((0, 1, 2)))
    model = ps.SINDy(feature_library=library, optimizer=ScaledOptimizer())
    x = signals(clean)
    model.fit(x, clean.t, feature_names=NAMES)
    np.testing.assert_allclose(model.coefficients()[0], truth(library.library), rtol=1e-6)
    rows = model.predict(x)
    assert rows.shape == (5 * 148, 1)  # 2 H + 1 rows for each of the 148 cycles
    assert model.score(x, clean.t) > 1 - 1e-9
    assert model.get_feature_names() == library.library.get_feature_names(NAMES)
    assert clone(library).projection.harmonics == (0, 1, 2)
    assert pickle.loads(pickle.dumps(library)).library.inertia == (3, 4, 5)


def test_harmonic_library_takes_other_libraries(clean):
    """A PySINDy polynomial of q explains what is left when inertia is known."""
    polynomial = ps.PolynomialLibrary(degree=3, include_bias=False)
    model = ps.SINDy(feature_library=HarmonicLibrary(polynomial), optimizer=ScaledOptimizer())
    model.fit(signals(clean), clean.t)
    assert model.score(signals(clean), clean.t) > 0.99


def test_sums_of_harmonic_libraries(clean):
    total = HarmonicLibrary(ICROMLibrary()) + HarmonicLibrary(StiffnessLibrary())
    assert isinstance(total, HarmonicLibrary)
    assert total.fit_transform(signals(clean)).shape[1] == 8
    with pytest.raises(TypeError, match=r"HarmonicLibrary \+ StiffnessLibrary would mix cycles"):
        HarmonicLibrary(ICROMLibrary()) + StiffnessLibrary()
    with pytest.raises(ValueError, match="same projection"):
        HarmonicLibrary(ICROMLibrary()) + HarmonicLibrary(
            StiffnessLibrary(), HarmonicProjection((1,))
        )


def test_grid_search_over_plain_sindy(clean):
    """scikit-learn hands t over as y; the true orders win."""
    search = GridSearchCV(
        ps.SINDy(feature_library=ROMLibrary(), optimizer=ScaledOptimizer()),
        {"feature_library__inertia": [(3,), (3, 4, 5)]},
        cv=TimeSeriesSplit(2),
    )
    # In this layout all three columns are states, and the second equation is the one we mean.
    search.fit(signals(clean)[:4000], clean.t[:4000])
    assert np.all(np.isfinite(search.cv_results_["mean_test_score"]))


def test_feature_union(clean):
    union = FeatureUnion([("inertia", ICROMLibrary()), ("stiffness", StiffnessLibrary())])
    assert union.fit_transform(signals(clean)).shape == (len(clean.t), 8)


def test_bad_use_is_refused(clean):
    x = signals(clean)
    with pytest.raises(
        ValueError, match=r"channels = \(0, 1, 2\) must name the columns .* 2 columns"
    ):
        ROMLibrary().fit(x[:, :2])
    with pytest.raises(ValueError, match="terms are listed twice"):
        StiffnessLibrary((1, 1)).fit(x)
    with pytest.raises(TypeError, match="PolynomialLibrary is not a library of terms"):
        library_terms(ps.PolynomialLibrary())
    with pytest.raises(ValueError, match=r"no q_dot and q_ddot: call decay.differentiated"):
        implicit_data(type(clean)(clean.t, clean.q))
    with pytest.raises(ValueError, match=r"needs \[q, q_dot, q_ddot\]"):
        ps.SINDy(feature_library=HarmonicLibrary(ROMLibrary())).fit(x[:, :2], clean.t)


def test_transform_refuses_other_columns_than_fit(clean):
    library = ROMLibrary().fit(signals(clean))
    for x in (signals(clean)[:, :2], np.zeros((5, 4))):
        with pytest.raises(ValueError, match=rf"X has {x.shape[1]} features, but .* 3 features"):
            library.transform(x)


def test_simulation_of_an_implicit_equation_by_pysindy_is_refused(clean):
    """PySINDy takes -q_ddot for the derivative of q, which then grows: not for hours."""
    model = ps.SINDy(feature_library=ROMLibrary((3, 4, 5), (1, 2, 3)), optimizer=ScaledOptimizer())
    model.fit(t=clean.t, **implicit_data(clean))
    with pytest.raises(EscapeError, match=r"1000 times as much as in fit.*ReducedModel\("):
        model.simulate(clean.q[:1], clean.t[:400], u=lambda t: np.zeros(2))
