"""The choice of terms, and what it adds to errors, against enumeration and repeated draws."""

import itertools

import numpy as np
import pytest

from romsindy.fit.choice import Gram, Trials, alternatives, mixed

N = 600


def trials_of(x, y, least=None):
    """Columns of a linear regression with noise of 1; the first always takes part."""
    gram = Gram(x.T @ x, x.T @ y, float(y @ y), len(y))
    return Trials([gram], [0], [[i] for i in range(1, x.shape[1])], least or {})


def alike(rng, shared=0.95):
    """Three columns; the last two are nearly one."""
    x = rng.standard_normal((N, 3))
    x[:, 2] = shared * x[:, 1] + np.sqrt(1 - shared**2) * x[:, 2]
    return x


def test_all_models_of_two_terms_by_enumeration():
    rng = np.random.default_rng(3)
    x = alike(rng)
    y = x @ [1.0, 0.3, 0.3] + 0.9 * rng.standard_normal(N)
    found = {}
    for where in [(0,), (0, 1), (0, 2), (0, 1, 2)]:
        b = np.zeros(3)
        b[list(where)] = np.linalg.lstsq(x[:, where], y, rcond=None)[0]
        own = np.zeros((3, 3))
        own[np.ix_(where, where)] = np.linalg.inv(x[:, where].T @ x[:, where])
        found[where] = b, own, np.sum((y - x @ b) ** 2) + len(where) * np.log(N)
    base, own, bic = found[0, 1]
    odds = {k: np.exp((bic - other) / 2) for k, (_, _, other) in found.items()}
    assert odds.pop((0,)) < 1e-6  # beyond the window; the others are within it
    assert all(o > 0.3 for o in odds.values())
    squares = {k: c + np.outer(b - base, b - base) for k, (b, c, _) in found.items()}
    expected = sum(o * squares[k] for k, o in odds.items()) / sum(odds.values())
    covariance = mixed(own, alternatives(trials_of(x, y), [0]), [0, 1, 2])
    np.testing.assert_allclose(covariance, expected, rtol=1e-6)


def test_the_mixture_takes_the_errors_of_the_fit_for_every_choice():
    """Noise less than the trials take it for: no variance comes out below zero."""
    rng = np.random.default_rng(3)
    x = alike(rng)
    trials = trials_of(x, x @ [1.0, 0.3, 0.3] + 0.9 * rng.standard_normal(N))
    kept, where = [0, 1], [0, 1, 2]
    own, values, scale = trials.covariance(kept), trials.values(kept), np.array([0.2, 0.3, 0.1])
    wide = np.outer(scale, scale)
    found = alternatives(trials, kept, scale)
    expected = (1 - sum(a.weight for a in found)) * wide * own
    for gone, _, weight, _ in found:
        others = [k for k in kept if k != gone]
        shift = trials.values(others) - values
        expected += weight * (wide * trials.covariance(others) + np.outer(shift, shift))
    covariance = mixed(wide * own, found, where)
    np.testing.assert_allclose(covariance, expected, rtol=1e-9)
    assert np.all(np.linalg.eigvalsh(covariance) > 0)


def test_a_choice_that_the_data_tell_adds_nothing():
    rng = np.random.default_rng(0)
    x, _ = np.linalg.qr(rng.standard_normal((N, 4)))
    noise = rng.standard_normal(N)
    noise -= x @ (x.T @ noise)  # no other column gains anything by chance
    trials = trials_of(x, x @ [20.0, 20.0, 0.0, 0.0] + 0.9 * noise)
    assert trials.chosen([]) == [0]
    assert alternatives(trials, [0]) == []
    np.testing.assert_array_equal(mixed(np.eye(2), [], [0, 1]), np.eye(2))


def test_values_that_cannot_be_do_not_count():
    rng = np.random.default_rng(3)
    x = alike(rng)
    y = x @ [1.0, 0.4, -0.3] + 0.9 * rng.standard_normal(N)
    free, positive = (alternatives(trials_of(x, y, least), [0]) for least in ({}, {1: 0.0}))
    assert (None, 1) in [a[:2] for a in free]
    assert (None, 1) not in [a[:2] for a in positive]


def test_intervals_hold_the_truth_where_terms_are_hardly_told_apart():
    inside = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        truth = np.array([1.0, 1.0, rng.choice([0, 1]) * rng.uniform(-1, 1)])
        x = alike(rng)
        trials = trials_of(x, x @ truth + rng.standard_normal(N))
        kept = trials.chosen([])
        where = trials.places(kept)
        own = trials.covariance(kept)[np.ix_(where, where)]
        both = mixed(own, alternatives(trials, kept), where)
        off = np.abs(trials.values(kept) - truth)[where]
        inside.append([np.mean(off < 1.96 * np.sqrt(np.diag(c))) for c in (own, both)])
    nominal, counted = np.mean(inside, axis=0)
    assert nominal < 0.89  # a term in doubt is there as often as not
    assert 0.9 <= counted <= 0.98


@pytest.mark.parametrize("present", [[], [0, 1]])
def test_terms_of_which_none_alone_gains_are_kept_where_they_are_present(present):
    rng = np.random.default_rng(1)
    x = alike(rng, 0.9999)
    y = x @ [1.0, 700.0, -700.0] + rng.standard_normal(N)
    trials = trials_of(x, y)
    least = min(trials.left_out(kept) for kept in ([], [0], [1]))
    assert trials.left_out([]) - least < trials.cost([0], trials.left_out([]))
    assert sorted(trials.chosen(present)) == present


def test_parts_that_are_left_out_are_judged_by_the_others():
    rng = np.random.default_rng(2)
    x = rng.standard_normal((4, N // 4, 3))
    y = x @ [1.0, 1.0, 0.0] + rng.standard_normal(x.shape[:2])
    grams = [Gram(a.T @ a, a.T @ b, float(b @ b), len(b)) for a, b in zip(x, y, strict=True)]
    trials = Trials(grams, [0], [[1], [2]], {})
    expected = 0.0
    for part, (a, b) in enumerate(zip(x, y, strict=True)):
        others = [i for i in range(4) if i != part]
        rest = np.concatenate(x[others])[:, :2], np.concatenate(y[others])
        expected += np.sum((b - a[:, :2] @ np.linalg.lstsq(*rest, rcond=None)[0]) ** 2)
    assert trials.left_out([0]) == pytest.approx(expected)
    assert trials.chosen([]) == [0]
    pairs = itertools.product([[], [0], [1]], repeat=2)
    assert all(trials.chosen(a) == trials.chosen(b) for a, b in pairs)
