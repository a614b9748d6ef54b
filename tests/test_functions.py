"""Functions with bands: series, windows, evidence, draws, and what `identify` makes of a record."""

import re

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp
from scipy.signal import lfilter
from scipy.stats import multivariate_normal, norm

import romsindy as rs
from romsindy.commands.main import main
from romsindy.fit.functions import evidence
from romsindy.fit.functions.evidence import _hold_in_cone, _inside, draw, lifted, nearest
from romsindy.fit.functions.series import Magnitudes, Series, Sizes
from romsindy.fit.functions.windows import Window, linearised, reduced, windows_of
from romsindy.fit.records.arguments import prepared
from romsindy.physics.damping import PowerDamping
from romsindy.physics.example import add_noise

SCALES = Magnitudes(reach=0.02, rate=40.0, decay=0.4)
SMALL = Sizes(5, 3, 3)


DRAG = (PowerDamping(2),)
TINY = Sizes(2, 1, 1)


def series(seed=0, sizes=SMALL, forces=DRAG):
    rng = np.random.default_rng(seed)
    made = Series.linear(SCALES, sizes, forces)
    return made.moved(made.values + 0.1 * rng.standard_normal(len(made.values)))


def states(n=6, seed=1):
    rng = np.random.default_rng(seed)
    return [rng.uniform(-1, 1, (n, 1)) * x for x in (0.02, 0.8, 32.0)]


def decay(coefficients, start=1.0, seconds=8.0, snr_db=40.0, seed=0, rate=400.0):
    """A decay integrated by LSODA, with white noise."""
    model = rs.ReducedModel.from_coefficients(coefficients, unit="m")
    motion = model.simulate(start, 0.0, np.arange(int(seconds * rate)) / rate)
    clean = rs.Decay(motion.t, motion.q, unit="m")
    return clean if snr_db is None else add_noise(clean, snr_db, seed)


STIFF = {"omega^2": 1482.0, "gamma_3": 300.0, "c_linear": 0.6}


# -- series -----------------------------------------------------------------------------------


@pytest.mark.parametrize("sizes", [SMALL, Sizes(1, 0, 0), Sizes(4, 0, 3), Sizes(1, 3, 0)])
def test_derivatives_of_a_series(sizes):
    """Central differences: about step^2 = 1e-10 off where values are of order one."""
    equation, state, step = series(sizes=sizes), states(), 1e-5
    by_value = equation.by_parameter(None, *state)
    for slope, unit in zip(by_value, np.eye(len(equation.values)), strict=True):
        ends = [
            equation.moved(equation.values + s * step * unit).linearise(None, *state).residual
            for s in (1, -1)
        ]
        numbers = (ends[0] - ends[1]) / (2 * step)
        assert slope == pytest.approx(numbers, abs=1e-8 * np.abs(by_value).max())
    for i, slope in enumerate(equation.linearise(None, *state)[1:]):
        moved = [
            [x + s * step * (j == i) * np.abs(x).max() for j, x in enumerate(state)]
            for s in (1, -1)
        ]
        ends = [equation.linearise(None, *m).residual for m in moved]
        numbers = (ends[0] - ends[1]) / (2 * step * np.abs(state[i]).max())
        assert slope[:, :, 0] == pytest.approx(numbers, abs=1e-7 * np.abs(slope).max() + 1e-12)


@pytest.mark.parametrize("sizes", [SMALL, Sizes(1, 0, 0), Sizes(17, 11, 8)])
def test_taylor_coefficients_are_the_same_equation(sizes):
    """Ordinary terms, each with its own code, give the same residual, up to rounding."""
    equation = series(sizes=sizes)
    model = rs.ReducedModel(equation.terms(), equation.taylor(equation.values)[0], "m")
    q, v, a = (x[:, 0] for x in states())
    expected = model.linearise(q, v, a)[0]
    found = equation.linearise(None, *states()).residual[:, 0]
    assert found == pytest.approx(expected, rel=1e-9)


def test_damping_follows_the_inertia():
    """alpha (1 + h) q_dot alone: D / M is the same at every q."""
    equation = series(sizes=Sizes(3, 4, 0), forces=())
    model = rs.ReducedModel(equation.terms(), equation.taylor(equation.values)[0], "m")
    q = np.linspace(-0.02, 0.02, 9)
    ratio = model.damping(q, np.ones(9)) / model.inertia(q)
    assert ratio == pytest.approx(np.full(9, ratio[0]), rel=1e-10)


# -- windows and evidence ---------------------------------------------------------------------


def linearised_record(signal, sizes=TINY):
    records = prepared(signal, "m", coloured=True)
    equation = Series.linear(Magnitudes(1.0, 38.5, 0.6), sizes)
    return linearised(equation, windows_of(records), records)


def dense(linear, jump):
    """All windows in one matrix: columns are values, then all starts, then the signal."""
    blocks = linear.blocks
    p, n = blocks[0].change.shape[1] - 2, len(blocks)
    rows, ties = [], []
    for i, b in enumerate(blocks):
        wide = np.zeros((len(b.signal), p + 2 * n + 1))
        wide[:, :p], wide[:, p + 2 * i : p + 2 * i + 2] = b.change[:, :p], b.change[:, p:]
        wide[:, -1] = b.signal
        rows.append(wide)
        if i + 1 < n:
            tie = np.zeros((2, p + 2 * n + 1))
            tie[:, :p], tie[:, p + 2 * i : p + 2 * i + 2] = b.end[:, :p], b.end[:, p:]
            tie[:, p + 2 * i + 2 : p + 2 * i + 4], tie[:, -1] = -np.eye(2), -b.rest
            error = jump * b.window.amplitude * np.array([1.0, 38.5])
            ties.append(tie / error[:, None])
    return np.concatenate([covariant(linear.record.noise, np.concatenate(rows)), *ties]), p


def covariant(noise, rows):
    """Rows times a root of the inverse of the covariance of the noise, which is built in full.

    Of cosines that are independent: variances of the noise, and of its drift, at their frequencies.
    """
    n = len(rows)
    frequency = np.arange(n) / (2 * n * noise.dt)
    power = noise.spectrum.leaking(n * noise.dt)(frequency)
    power = np.maximum(
        power + (noise.drift(frequency) if noise.drift else 0.0), 1e-3 * noise.std**2
    )
    waves = np.cos(np.pi * np.outer(np.arange(n), np.arange(n) + 0.5) / n) * np.sqrt(2 / n)
    waves[0] /= np.sqrt(2)
    return np.linalg.solve(np.linalg.cholesky((waves.T * power) @ waves), rows)


def test_windows_are_one_least_squares_problem():
    """White noise: samples over its standard deviation, as they are."""
    (linear,) = linearised_record(decay(STIFF, seconds=3.0))
    assert len(linear.blocks) > 4 and linear.record.noise.spectrum.white
    samples, p = dense(linear, 0.01)
    plain = np.concatenate([b.signal for b in linear.blocks]) / linear.record.noise.std
    assert np.linalg.norm(samples[: len(plain), -1]) == pytest.approx(np.linalg.norm(plain))
    agree(linear, samples, p, 0.01)


def in_noise(kind, seconds, seed):
    """A decay at 40 dB in a random walk beside white noise, or where neighbours err alike."""
    clean = decay(STIFF, seconds=seconds, snr_db=None)
    steps = np.random.default_rng(seed).standard_normal(len(clean.t))
    noise = np.cumsum(steps) / 30 + steps if kind == "slow" else lfilter([1.0], [1, -0.9], steps)
    return rs.Decay(clean.t, clean.q + 0.003 * noise, unit="m")


@pytest.mark.parametrize("kind", ["slow", "rough"])
def test_windows_in_noise_with_a_colour_are_one_generalised_least_squares_problem(kind):
    """Against its covariance matrix in full."""
    (linear,) = linearised_record(in_noise(kind, 6.0, 2))
    own = linear.record.noise
    assert own.drift is not None if kind == "slow" else not own.spectrum.white
    agree(linear, *dense(linear, 0.01), 0.01)


def agree(linear, matrix, p, jump):
    found = reduced([linear], 38.5, 1.0, jump, np.zeros((0, p + 1)))
    best = np.linalg.lstsq(matrix[:, :-1], matrix[:, -1], rcond=None)[0]
    values = np.linalg.solve(found.rows[:p, :p], found.rows[:p, p])
    assert values == pytest.approx(best[:p], rel=1e-6)
    assert np.ravel(found.states(values)) == pytest.approx(best[p:], rel=1e-5, abs=1e-8)
    left = matrix[:, :-1] @ best - matrix[:, -1]
    assert found.rows[p, p] ** 2 == pytest.approx(left @ left, rel=1e-6)


def test_evidence_is_the_marginal_likelihood():
    """Against the normal density of the signal itself, with all that is unknown integrated out."""
    rng = np.random.default_rng(3)
    equation = Series.linear(Magnitudes(1.0, 1.0, 1.0), Sizes(3, 1, 1))
    p = len(equation.values)
    rows = rng.standard_normal((p + 8, p + 1))
    triangle = np.linalg.qr(rows, mode="r")
    data = evidence.Reduced(triangle, 0.0, ())
    costs, exact = [], []
    for scales in (evidence.MIDDLE, evidence.MIDDLE + 0.3):
        costs.append(evidence._cost(equation, data, scales) - evidence.prior_cost(scales))
        factor = evidence.prior_factor(equation, scales)
        covariance = np.eye(len(rows)) + rows[:, :p] @ factor @ factor.T @ rows[:, :p].T
        exact.append(-multivariate_normal(cov=covariance).logpdf(rows[:, p]))
    # The constant of the density is left out: differences count.
    assert costs[1] - costs[0] == pytest.approx(exact[1] - exact[0], rel=1e-9)


def test_process_noise_is_none_for_an_exact_equation_and_some_for_a_wandering_one():
    records = prepared(decay(STIFF, seconds=6.0), "m")
    equation = evidence.regressed(
        Series.linear(Magnitudes(1.0, 38.5, 0.6), Sizes(5, 0, 3)), records
    )
    none = np.zeros((0, len(equation.values) + 1))
    assert (
        evidence.fit(equation, windows_of(records), records, none).jump < 1e-3
    )  # what 1 % of noise hides
    # Every two seconds the phase slips by 0.05 rad: some three times a hundred cycles.
    clean = decay(STIFF, seconds=6.0, snr_db=None)
    t = clean.t + 0.05 / 38.5 * np.floor(clean.t / 2)
    slipped = np.interp(t, clean.t, clean.q)
    wandering = prepared(add_noise(rs.Decay(clean.t, slipped, unit="m"), 40, 0), "m")
    assert evidence.fit(equation, windows_of(wandering), wandering, none).jump > 5e-3


@pytest.mark.parametrize("sizes, coloured", [(Sizes(5, 0, 3), True), (Sizes(1, 0, 1), False)])
def test_colour_counts_where_no_more_than_noise_is_left(sizes, coloured):
    """Noise whose neighbours err alike, under the right equation and under a linear one.

    The frequency of a linear one is the same at all amplitudes; here it is higher at the start, by
    3/8 gamma_3 a^2 / omega^2 = 8 %.
    """
    records = prepared(in_noise("rough", 6.0, 2), "m", coloured=True)
    equation = evidence.regressed(Series.linear(Magnitudes(1.0, 38.5, 0.6), sizes), records)
    none = np.zeros((0, len(equation.values) + 1))
    found = evidence.fit(equation, windows_of(records), records, none)
    (noise,) = (record.noise for record in found.records)
    assert noise.alike is not coloured
    assert found.noise < 1.1 if coloured else found.noise > 1.1


def test_a_motion_beyond_all_numbers_is_refused_in_words():
    """Of a simpler structure that is tried from where another has ended, over a whole record."""
    records = prepared(in_noise("slow", 6.0, 2), "m", coloured=True)
    equation = evidence.regressed(
        Series.linear(Magnitudes(1.0, 38.5, 0.6), Sizes(5, 0, 3)), records
    )
    none, steep = np.zeros((0, len(equation.values) + 1)), equation.moved(1e200 * equation.values)
    found = evidence.fit(equation, windows_of(records), records, none)
    (record,) = found.records
    whole = Window(0, np.arange(len(record.t)), record.motion)
    with pytest.raises(rs.fit.kernel.collocation.TrajectoryError, match="one coordinate follows"):
        evidence.fit(steep, [whole], [record], none, start=found, noise=1.0)


# -- draws ------------------------------------------------------------------------------------


def _drawn(*offsets, n):
    """Standard normal u >= -offset, n for each offset, all drawn at once."""
    rng, slope = np.random.default_rng(0), np.ones((1, 1))
    found = np.full((len(offsets), 1, n), np.nan)
    cones = zip(np.reshape(offsets, (-1, 1)), found, strict=True)
    _hold_in_cone([(offset, slope, u, rng.random((20, 1, n))) for offset, u in cones])
    return found[:, 0]


def test_draws_in_cones_are_truncated_normal():
    """u >= 0: mean sqrt(2/pi); u >= 1: phi(1) / Q(1). Known to 0.01, five times."""
    half, above = _drawn(0.0, -1.0, n=4000)
    assert half.min() >= 0 and above.min() >= 1
    assert half.mean() == pytest.approx(np.sqrt(2 / np.pi), abs=0.05)
    assert above.mean() == pytest.approx(norm.pdf(1) / norm.sf(1), abs=0.05)


def test_far_out_in_the_tail_draws_stay_finite():
    (drawn,) = _drawn(-60.0, n=50)
    assert np.all(np.isfinite(drawn)) and np.all(drawn >= 60 - 1e-9)


def test_lifted_series_and_a_point_inside():
    assert lifted(np.array([0.5, 0.0, 1.0]))[0] == pytest.approx(1.0)  # T_2 is -1 at 0
    assert lifted(np.array([2.0, 0.0, 1.0]))[0] == 2.0
    offset, slope = np.array([-1.0, 0.5]), np.array([[1.0], [0.1]])
    assert np.all(offset + slope @ _inside(offset, slope) > 0)


def test_nearest_point_of_the_cone():
    """One coefficient, h = r z^2: the least that is allowed is 0, and what goes with it follows."""
    equation = Series.linear(SCALES, Sizes(1, 1, 0))
    root = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    found = nearest(equation, np.array([1.0, -2.0, 1.0]), root)
    # In x, the nearest point of x_1 >= 2 is (0, 2, 0).
    assert found == pytest.approx([2.0, 0.0, 1.0], abs=1e-9)
    inside = np.array([1.0, 0.3, 1.0])
    assert np.array_equal(nearest(equation, inside, root), inside)


def test_dispersion_is_one_for_noise_and_counts_repeated_samples():
    """Noise in which every sample stands four times has a quarter of the information."""
    clean = decay(STIFF, seconds=10.0, snr_db=None)
    rng = np.random.default_rng(5)
    found = []
    for held in (1, 4):
        noise = np.repeat(rng.standard_normal(-(-len(clean.t) // held)), held)[: len(clean.t)]
        records = prepared(rs.Decay(clean.t, clean.q + 0.003 * noise, unit="m"), "m")
        equation = Series.linear(Magnitudes(1.0, 38.5, 0.6), Sizes(5, 0, 3))
        equation = evidence.regressed(equation, records)
        none = np.zeros((0, len(equation.values) + 1))
        found.append(evidence.fit(equation, windows_of(records), records, none).dispersion)
    # A chi-square of about ten degrees of freedom scatters by 45 %.
    assert 0.3 < found[0] < 2.0
    assert found[1] > 2 * found[0]


# -- identify ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def example():
    """The oscillator of the package's examples: exact structure, 35 dB."""
    return rs.identify(rs.example_decay(35.0, 11))


def test_functions_of_an_oscillator_lie_in_their_bands(example):
    """95 % bands at 20 places: few of them, which go together, may miss; three times them none."""
    truth = rs.physics.example.EXAMPLE_MODEL
    q = np.linspace(0.95 * example.reach[0], 0.95 * example.reach[1], 20)
    h, k = example.inertia(q), example.stiffness(q)
    for curve, exact in ((h, truth.inertia(q) - 1), (k, truth.stiffness(q) / q)):
        width = (curve.high - curve.low) / 2
        assert np.mean((curve.low <= exact) & (exact <= curve.high)) >= 0.7
        assert np.all(np.abs(curve.value - exact) < 3 * width)
    assert example.structure.name == "IC-ROM"
    assert example.verdict.explained


def test_the_short_equation_says_how_far_it_is_off(example):
    """Against the truth, whose frequencies the functions have to 0.1 %."""
    text, short = str(example), example.short
    assert short.follows and f"In short: {short.model.equation()}" in text
    found = re.search(r"off the functions by at most ([\d.]+) % in frequency, of a change", text)
    stated = float(found[1]) / 100
    a = np.linspace(0.1, 0.95, 10) * min(map(abs, example.reach))
    truth = rs.physics.example.EXAMPLE_MODEL
    exact, own = truth.backbone(a), short.model.backbone(a)
    assert np.abs(own / exact - 1).max() < stated + 1e-3
    assert np.abs(own - exact).max() < 0.1 * np.ptp(exact)
    q = np.linspace(*example.reach, 20)
    asymmetry = np.abs(short.model.stiffness(q) - truth.stiffness(q)).max()
    assert asymmetry < 0.1 * np.abs(truth.stiffness(q) - 36 * q).max()


def test_what_is_printed_lies_in_its_band(example):
    short = example.short
    values = short.model.coefficients
    assert set(short.bands) == set(values)
    assert all(low <= values[name] <= high for name, (low, high) in short.bands.items())
    for name in example.model.coefficients:
        low, high = example.interval(name)
        assert low <= example.model.coefficients[name] <= high, name


def test_one_simulation_follows_the_motion_behind_the_noise(example):
    """About a dozen values from 14,463 samples: off by 3 % of the noise, and three times that."""
    (record,), (residual,) = example.records, example.residuals
    clean = rs.example_decay()
    behind = clean.q[np.isin(clean.t, record.decay.t)]
    off = record.signal - residual - behind
    assert np.std(off) < 0.1 * record.noise.std and len(off) == len(record.t)
    again = rs.Identification.from_json(example.to_json())
    assert again.residuals == again.records == ()  # not saved


def test_inertia_is_never_negative(example):
    q = np.linspace(*example.reach, 2001)
    for sample in (*example.samples[:50], example.model.values):
        model = rs.ReducedModel(
            example.terms if len(sample) == len(example.terms) else example.model.terms,
            tuple(sample),
        )
        assert model.inertia(q).min() >= 1 - 1e-9
    assert example.inertia(q).low.min() >= 0


def test_what_is_found_is_kept_in_a_file(example, tmp_path):
    example.save(tmp_path / "found.json")
    again = rs.Identification.load(tmp_path / "found.json")
    assert str(again) == str(example)
    assert again.interval("Upsilon_3") == example.interval("Upsilon_3")
    assert np.array_equal(again.covariance, example.covariance)
    with pytest.raises(ValueError, match=r"identify --save .* read by Estimate\.load"):
        rs.Identification.from_json(rs.Estimate.to_json(example))


@pytest.mark.slow
def test_seeds_are_arguments():
    first, same = (rs.identify(rs.example_decay(35.0, 11).between(end=5.0)) for _ in range(2))
    assert str(same) == str(first)


def test_beyond_the_data_there_are_no_bands(example):
    with pytest.raises(ValueError, match="stay within reach"):
        example.inertia([0.0, 5.0])
    with pytest.raises(ValueError, match="'Ypsilon' is no coefficient"):
        example.interval("Ypsilon")


@pytest.mark.slow
def test_a_structure_whose_fit_grows_beyond_all_numbers_is_left_out():
    """A simpler one, tried beside it, ended all in "Eigenvalues did not converge"."""
    found = rs.identify(rs.example_decay(40.0, 3).between(0, 30))
    assert found.structure.name == "IC-ROM"


@pytest.mark.parametrize(
    ("coefficients", "start", "name"),
    [
        pytest.param(STIFF, 1.0, "stiffness polynomial", marks=pytest.mark.slow),
        # gamma_3 changes omega^2 by 1e-6: nothing shows.
        pytest.param(STIFF, 0.002, "linear", marks=pytest.mark.slow),
        (STIFF | {"Upsilon_3": 0.3}, 1.0, "IC-ROM"),
    ],
)
def test_the_simplest_structure_is_at_the_head(coefficients, start, name):
    found = rs.identify(decay(coefficients, start))
    assert found.structure.name == name
    text = str(found)
    assert ("do not ask for inertia" in text) == (name != "IC-ROM")
    assert ("do not ask for nonlinear stiffness" in text) == (name == "linear")
    assert ("Upsilon_3" in found.model.coefficients) == (name == "IC-ROM")
    low, high = found.interval("omega^2")
    # Three times a 95 % interval: the truth is outside once in 1e8.
    assert abs(1482 - (low + high) / 2) < 1.5 * (high - low)


@pytest.mark.study
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["slow", "rough"])
def test_noise_with_a_colour_is_no_error_of_the_equation(kind):
    """Explained by the right equation; of nine 95 % intervals three miss once in 120 such tests.

    Taken for white, such noise is not explained, and its errors are two to ten times as large.
    """
    held = []
    for seed in range(3):
        found = rs.identify(in_noise(kind, 10.0, seed))
        assert found.verdict.explained and "errors and bands count it" not in str(found)
        for name in ("omega^2", "gamma_3", "c_linear"):
            low, high = found.interval(name)
            held.append(low <= STIFF[name] <= high)
    assert sum(held) >= 7


@pytest.mark.slow
def test_structures_that_differ_only_outside_the_range():
    """q^9 is 1e-6 of the force at 0.2 m: what is said there is the same, and beyond nothing is."""
    same, other = (rs.identify(decay(STIFF | more, start=0.2)) for more in ({}, {"gamma_9": 300.0}))
    assert str(other.structure) == str(same.structure)
    q = 0.9 * same.reach[1]
    one, two = same.stiffness(q), other.stiffness(q)
    assert abs(one.value[0] - two.value[0]) < (one.high - one.low)[0]
    assert "Nothing is known beyond q = -0.1" in str(other)


@pytest.mark.slow
def test_dry_friction_is_named():
    found = rs.identify(decay(STIFF | {"c_coulomb": 2.0, "c_linear": 0.2}))
    assert ", c_coulomb: (1 + h(q))" in str(found)
    assert "c_coulomb" in found.structure.forces
    assert found.interval("c_coulomb")[0] < 2.0 < found.interval("c_coulomb")[1]


@pytest.mark.slow
def test_a_known_coefficient_stays():
    found = rs.identify(decay(STIFF), fixed={"omega^2": 1482.0})
    assert found.model.coefficients["omega^2"] == 1482.0
    assert found.interval("omega^2") == (1482.0, 1482.0)
    assert "omega^2" not in found.free
    with pytest.raises(ValueError, match="fixed names"):
        rs.identify(decay(STIFF), fixed={"omega2": 1482.0})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fixed": {"omega^2": "many"}}, "must be a finite number"),
        ({"fixed": {"omega^2": float("nan")}}, "must be a finite number"),
        ({"fixed": {"Upsilon_3": -1.0}}, "must not be negative"),
        ({"fixed": ["omega^2"]}, "must map names to values"),
        ({"seed": 0.5}, "seed = 0.5 must be a whole number"),
        ({"seed": -1}, "seed = -1 must be a whole number"),
        ({"records": np.zeros(9)}, "give a Decay or a list of them"),
        ({"records": None}, "give a Decay or a list of them"),
        ({"records": []}, "records is empty"),
    ],
)
def test_what_cannot_be_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        rs.identify(**({"records": decay(STIFF, seconds=2.0)} | options))


def test_a_size_of_which_no_power_is_a_number_is_refused():
    known = decay(STIFF, seconds=2.0)
    with pytest.raises(ValueError, match=r"the decay reaches .*e-31 .*: say what .* unit="):
        rs.identify(rs.Decay(known.t, 1e-30 * known.q))


def test_two_structures_in_one_fit_are_refused():
    other = decay(STIFF | {"omega^2": 3000.0}, seconds=4.0, seed=2)
    with pytest.raises(rs.fit.kernel.collocation.TrajectoryError, match="different structures"):
        rs.identify([decay(STIFF, seconds=4.0), other])


@pytest.mark.slow
def test_fewer_cycles_than_terms():
    """Four cycles: the functions are known roughly, and that is said."""
    found = rs.identify(decay(STIFF, seconds=0.7, snr_db=45))
    assert "Nothing is known beyond q" in str(found)
    assert re.search(r"K\(q\)/q is known to \+- [\d.]+ % \(95 %\)", str(found))
    k = found.stiffness([0.5 * found.reach[1]])
    exact = 1482 + 300 * (0.5 * found.reach[1]) ** 2
    assert k.low[0] <= exact <= k.high[0]
    assert (k.high - k.low)[0] > 5


@pytest.mark.slow
def test_a_bead_on_a_wire_is_explained():
    """y = x^2 / 2: h = x^2, K = omega^2 x. Ten cycles; a false alarm happens once in 100."""
    explained = 0
    for seed in range(4):
        found = rs.identify(bead(seconds=2.0, seed=seed))
        explained += found.verdict.explained
        q = np.linspace(0.9 * found.reach[0], 0.9 * found.reach[1], 9)
        h, k = found.inertia(q), found.stiffness(q)
        assert np.mean((h.low <= q**2) & (q**2 <= h.high)) > 0.5
        assert np.mean((k.low <= 987.0) & (987.0 <= k.high)) > 0.5
    assert explained >= 3


def bead(seconds, seed, snr_db=40.0):
    """A bead on the wire y = x^2 / 2, integrated in its own equation of motion."""

    def motion(t, s):
        x, v = s
        return [v, -(x * v * v + 987.0 * x + 0.6 * v) / (1 + x * x)]

    t = np.arange(int(250 * seconds)) / 250
    x = solve_ivp(motion, (0, t[-1]), [0.5, 0.0], t_eval=t, rtol=1e-10, atol=1e-12).y[0]
    return add_noise(rs.Decay(t, x, unit="m"), snr_db, seed)


@pytest.mark.slow
def test_noise_alone_is_no_departure_from_the_equation():
    """20 dB: what the noise hides is not told as another mode."""
    found = rs.identify(decay(STIFF, snr_db=20, seed=3))
    assert not any("departs" in note for note in found.notes)


@pytest.mark.slow
def test_a_simulation_is_limited_by_the_model():
    found = rs.identify(decay(STIFF | {"gamma_15": 40.0}, snr_db=None))
    k = found.stiffness([-0.5, 0.5])
    assert k.value == pytest.approx(1482 + 300 * 0.25, rel=1e-3)


def test_draws_belong_to_the_fit():
    """Mean and scatter of draws are those of the normal posterior where h >= 0 does not bind."""
    records = prepared(decay(STIFF), "m")
    equation = evidence.regressed(
        Series.linear(Magnitudes(1.0, 38.5, 0.6), Sizes(5, 0, 3)), records
    )
    none = np.zeros((0, len(equation.values) + 1))
    found = evidence.fit(equation, windows_of(records), records, none)
    draws = draw(found, 4000, np.random.default_rng(0))
    spread = draws.std(axis=0)
    assert np.all(np.abs(draws.mean(axis=0) - found.series.values) <= 0.3 * spread)


def test_the_few_terms_of_a_saved_file_are_exported(example, tmp_path):
    """What identify shows; a file that holds no identification is refused by the option's name."""
    example.save(tmp_path / "found.json")
    (tmp_path / "model.json").write_text(example.model.to_json())
    run = lambda name: CliRunner().invoke(  # noqa: E731
        main, ["export", str(tmp_path / name), "--to", "text", "--short"]
    )
    assert run("found.json").stdout.strip() == str(example.short.model)
    refused = run("model.json")
    assert refused.exit_code == 2 and "--short is of what identify --save wrote" in refused.output
