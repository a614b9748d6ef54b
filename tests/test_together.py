"""An F test of columns that are tried together, beside nested least squares."""

import numpy as np
from scipy.stats import f

from romsindy.fit.adequacy.independence import tell_together


def _power(columns, y):
    return float(np.sum((y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]) ** 2))


def test_of_nested_models():
    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((60, 7)), rng.standard_normal(60)
    x[:, 6] = x[:, 5] - 2 * x[:, 1]  # told by others
    y += 0.8 * x[:, 4]
    table = np.column_stack([1e4 * x, y])
    found = tell_together(table.T @ table, 3, 60)
    alone, both = _power(x[:, :3], y), _power(x, y)
    ratio = (alone - both) / 3 / (both / 54)
    single = alone - _power(x[:, [0, 1, 2, 4]], y)
    best = f.sf(single / ((alone - single) / 56), 1, 56)
    assert found.most == 1
    np.testing.assert_allclose(found.p_value, 2 * min(f.sf(ratio, 3, 54), 4 * best), rtol=1e-6)
    np.testing.assert_allclose(found.excess, alone / 57 / (both / 54), rtol=1e-9)
    left = y - 1e4 * x @ found.values
    np.testing.assert_allclose(left @ left, both, rtol=1e-9)


def test_noise_alone_is_found_as_often_as_promised():
    """4 per cent or fewer of 1,000 at 2 per cent: five standard deviations are 2.2."""
    rng = np.random.default_rng(1)
    tables = rng.standard_normal((1000, 40, 9))
    found = [tell_together(t.T @ t, 3, 40).p_value for t in tables]
    assert np.mean(np.array(found) < 0.02) < 0.042
