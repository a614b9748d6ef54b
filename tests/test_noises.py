"""Noises of driven records: the two that are found in what is left, and the verdict beside them."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, expm, toeplitz
from scipy.signal import lfilter
from scipy.stats import chi2

import romsindy as rs
from romsindy.fit.kernel.collocation import Grid, Trajectory
from romsindy.fit.kernel.equation import ExtendedEquation
from romsindy.fit.kernel.noises import Noises, TwoNoises, found_noises, steady
from romsindy.fit.records.coupled import driven_record
from romsindy.fit.records.driven import ForcedRecord
from romsindy.fit.records.modes import Modes
from romsindy.physics.coupled import linear_model

OMEGA, ZETA, PER_CYCLE = 2 * np.pi * 3.0, 0.02, 16
DT = 2 * np.pi / OMEGA / PER_CYCLE
LINEAR = rs.ReducedModel.from_coefficients(
    {"omega^2": OMEGA**2, "c_linear": 2 * ZETA * OMEGA}, unit="m"
)
TWO, SHAPES = np.array([OMEGA, 1.7 * OMEGA]), np.array([[1.0, 0.7], [0.5, -1.0]])
DUFFING = {"omega^2": OMEGA**2, "c_linear": 2 * ZETA * OMEGA, "gamma_3": 0.1 * OMEGA**2}


def multisine(n, rng):
    """A force of rms 1 about the resonance, as a function of time."""
    frequency = rng.uniform(0.4, 1.8, 60) * OMEGA
    phase = rng.uniform(0, 2 * np.pi, 60)
    return lambda t: np.cos(np.multiply.outer(t, frequency) + phase) @ np.full(60, np.sqrt(2 / 60))


def resting(n, r=1):
    """The covariance of a linear oscillator about rest, n samples; or of two in two channels."""
    t = DT * np.arange(n)
    rng = np.random.default_rng(0)
    push = multisine(n, rng)(t)
    model, record = LINEAR, ForcedRecord.of(rs.ForcedVibration(t, push, push, unit="m"), 1e-9)
    if r == 2:
        modes = Modes(TWO, np.full(2, ZETA), SHAPES, {"force": np.ones(2)}, np.zeros((0, 2)))
        both = rs.ForcedVibration(t, np.outer(push, [1.0, 0.5]), push, unit="m")
        model, record = linear_model(TWO, modes.ratios, "m"), driven_record(both, modes, 1e-9, n)
    grid: Grid = record.motion.grid
    still = Trajectory(
        grid, *(np.zeros((grid.n_steps + 1, r)) for _ in "qv"), np.zeros((grid.n_steps, 3, r))
    )
    equation = ExtendedEquation(model, (), 0, grid.step, 0.0)
    return TwoNoises.along(equation, (), 0, record, still)


def wandering(n, intensity, rng, omega=OMEGA):
    """Displacement under a white force: exact steps of the linear oscillator (C. Van Loan)."""
    a = np.array([[0.0, 1.0], [-(omega**2), -2 * ZETA * omega]])
    block = np.zeros((4, 4))
    block[:2, :2], block[2:, 2:], block[1, 2 + 1] = -a, a.T, intensity
    both = expm(block * DT)
    step = both[2:, 2:].T
    root = np.linalg.cholesky(step @ both[:2, 2:])
    state, found = np.zeros(2), []
    for kick in rng.standard_normal((n + 2000, 2)):
        state = step @ state + root @ kick
        found.append(state[0])
    return np.array(found[2000:])


def test_both_noises_are_those_that_were_made():
    """Steps of an oscillator by a matrix exponential; sizes of 6000 samples scatter by 3 %."""
    rng, n = np.random.default_rng(1), 6000
    intensity, sensor = 4 * ZETA * OMEGA**3, 0.3
    left = wandering(n, intensity, rng) + sensor * rng.standard_normal(n)
    found = found_noises(resting(n), left)
    assert found.force == pytest.approx(intensity, rel=0.15)
    assert found.shown == pytest.approx(sensor, rel=0.1)
    assert abs(found.colour) < 0.1


def test_a_force_that_fades_is_not_the_same_all_along():
    """Kicks of a tenth of the force in the later half are told, those of one force are not."""
    rng, n = np.random.default_rng(3), 6000
    noise = 0.3 * rng.standard_normal(n)
    found = Noises(np.array([4 * ZETA * OMEGA**3]), np.array([0.3]), np.zeros(1))
    same = wandering(n, float(found.force[0]), rng)
    fading = np.concatenate([same[: n // 2], wandering(n // 2, 0.01 * float(found.force[0]), rng)])
    assert steady(resting(n), same + noise, found) > 0.01
    assert steady(resting(n), fading + noise, found) < 1e-9


def test_a_coloured_sensor_is_no_force():
    rng, n = np.random.default_rng(2), 6000
    left = lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], rng.standard_normal(n + 200))[200:]
    found = found_noises(resting(n), left)
    assert found.colour == pytest.approx(0.9, abs=0.02)
    assert found.shown == pytest.approx(1.0, rel=0.1)
    assert found.force < 0.01 * 4 * ZETA * OMEGA**3  # what would move as much


def test_coordinates_and_channels_have_noises_of_their_own():
    rng, n = np.random.default_rng(5), 3000
    intensity = np.array([1.0, 0.1]) * 4 * ZETA * TWO**3
    q = np.stack([wandering(n, s, rng, w) for s, w in zip(intensity, TWO, strict=True)])
    coloured = lfilter([np.sqrt(1 - 0.8**2)], [1, -0.8], rng.standard_normal(n + 200))[200:]
    left = SHAPES @ q + np.stack([0.1 * rng.standard_normal(n), 0.4 * coloured])
    found = found_noises(resting(n, 2), left.ravel())
    np.testing.assert_allclose(found.force, intensity, rtol=0.3)
    np.testing.assert_allclose(found.shown, [0.1, 0.4], rtol=0.1)
    np.testing.assert_allclose(found.colour, [0.0, 0.8], atol=0.1)


@pytest.mark.parametrize("r", [1, 2])
def test_weighed_products_are_those_of_the_whole_covariance(r):
    """Formed in full: responses to the moves of every step, and autoregressions."""
    n, two = 60, resting(60, r)
    noises = Noises(*np.array([[3.0 * OMEGA**3, 0.4 * OMEGA**3], [1.0, 2.0], [0.6, -0.3]])[:, :r])
    moves, shown = (np.vstack([x.toarray() for x in several]) for several in (two.moves, two.shown))
    moved = np.linalg.pinv(moves)  # of least norm: what is left free is the first state
    free = np.linalg.svd(moves)[2][len(moves) :].T
    force = np.repeat(noises.force, len(moves) // r)
    covariance = shown @ moved * force @ moved.T @ shown.T
    sizes = zip(noises.shown, noises.colour, strict=True)
    covariance += block_diag(*(std**2 * toeplitz(a ** np.arange(n)) for std, a in sizes))
    columns = np.random.default_rng(3).standard_normal((r * n, 3))
    weight = np.linalg.inv(covariance)
    start = shown @ free  # fitted, whatever it is
    own = np.linalg.solve(start.T @ weight @ start, start.T @ weight @ columns)
    expected = columns.T @ weight @ (columns - start @ own)
    found = two.table(columns).weighed(noises).products
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_slow_noise_of_an_accelerometer_hides_no_motion():
    """Twice integrated it outgrows the motion, a sum of cosines, below the band of that."""
    n, rng = 4000, np.random.default_rng(6)
    frequency, phase = rng.uniform(0.6, 1.6, 60) * OMEGA, rng.uniform(0, 2 * np.pi, 60)
    waves = np.cos(np.multiply.outer(DT * np.arange(n), frequency) + phase)
    q, q_ddot = waves.sum(axis=1), waves @ -(frequency**2)
    slow = lfilter([np.sqrt(1 - 0.95**2)], [1, -0.95], rng.standard_normal(n))
    y = q_ddot + 10 ** (-35 / 20) * q_ddot.std() * slow
    vibration = rs.ForcedVibration(DT * np.arange(n), y, q, unit="m", measured="acceleration")
    motion = ForcedRecord.of(vibration, 1e-9).motion
    assert motion.grid.step < 2 * np.pi / OMEGA / 8
    found = np.interp(
        DT * np.arange(n), motion.grid.step * np.arange(len(motion.q)), motion.q[:, 0]
    )
    assert np.std((found - q)[200:-200]) < 0.15 * q.std()


def driven(seed, noise, extra=lambda q, v: 0.0, n=3000):
    """A Duffing oscillator under a multisine, by scipy, with one of four noises."""
    rng = np.random.default_rng(seed)
    t, push = DT * np.arange(n), multisine(n, rng)
    size = 6 * ZETA * OMEGA**2
    unknown = size * 0.05 * rng.standard_normal(n) if noise == "force" else np.zeros(n)

    def rate(at, x):
        q, v = x
        force = size * push(at) + unknown[min(int(at / DT), n - 1)]
        damping = 2 * ZETA * OMEGA * v
        return v, force - damping - OMEGA**2 * (q + 0.1 * q**3) - extra(q, v)

    step = DT if noise == "force" else np.inf  # that of what jumps at samples
    q = solve_ivp(rate, (0, t[-1]), (0, 0), t_eval=t, max_step=step, rtol=1e-6, atol=1e-8).y[0]
    unit = rng.standard_normal(n)
    if noise == "coloured":
        unit = lfilter([np.sqrt(1 - 0.95**2)], [1, -0.95], unit)
    y = q + (0.02 if noise in ("white", "coloured") else 0.003) * q.std() * unit
    u = size * push(t) + (0.05 * size * rng.standard_normal(n) if noise == "input" else 0.0)
    return rs.ForcedVibration(t, y, u, unit="m", interpolation="band-limited")


def fitted(record):
    return rs.refine(rs.ReducedModel.from_coefficients(DUFFING, unit="m"), record)


def verdict_on(record):
    return fitted(record).verdict


@pytest.mark.slow
def test_the_right_model_is_explained_where_a_force_was_not_measured():
    verdict = verdict_on(driven(11, "force"))
    assert verdict.explained and verdict.force > 3 * verdict.sensor
    assert "by forces that were not measured" in str(verdict)


@pytest.mark.slow
def test_friction_that_is_missing_is_noticed_beside_a_force_that_was_not_measured():
    rubbing = 0.05 * 6 * ZETA * OMEGA**2  # a twentieth of the rms of the force
    verdict = verdict_on(driven(12, "force", lambda q, v: rubbing * np.tanh(300 * v / OMEGA)))
    assert not verdict.explained and verdict.like == "the sign of q_dot"
    assert "does not explain" in str(verdict) and "most like the sign of q_dot" in str(verdict)


@pytest.mark.slow
def test_errors_hold_where_a_force_was_not_measured():
    """Sum of squares of 12 errors over their standard errors: chi-square, once in 1000 beyond."""
    fits = [fitted(driven(seed, "force", n=1000)) for seed in range(30, 34)]
    off = [
        (fit.model.coefficients[name] - value) / fit.standard_errors[name]
        for fit in fits
        for name, value in DUFFING.items()
    ]
    assert chi2.ppf(0.0005, 12) < np.sum(np.square(off)) < chi2.ppf(0.9995, 12)


def test_residuals_are_those_of_one_simulation_from_the_state_that_is_told():
    """By scipy, from the values and the state that the fit tells."""
    n, record = 1000, driven(41, "force", n=1000)
    fit, push, size = fitted(record), multisine(n, np.random.default_rng(41)), 6 * ZETA * OMEGA**2
    found = fit.model.coefficients
    k, c, k3, gain = (found[name] for name in (*DUFFING, "gain [force]"))
    late = fit.delays["force"][0]

    def rate(at, x):
        force = gain * size * push(at - late)
        return x[1], force - c * x[1] - x[0] * (k + k3 * x[0] ** 2)

    t = record.t
    q = solve_ivp(rate, (0, t[-1]), fit.states[0], t_eval=t, rtol=1e-7, atol=1e-9).y[0]
    left = record.y - q - fit.offsets[0]
    assert np.std(left - fit.residuals[0]) < 0.02 * np.std(left)


def test_the_gain_counts_that_the_sensor_of_the_input_is_noisy():
    """It loses the part of the power that is noise, 1 of 401 here: `W. Fuller`, section 1.1."""
    fit = fitted(driven(40, "input"))
    (name,) = [n for n in fit.free if "gain" in n]
    lost = 0.05**2 / (1 + 0.05**2)
    assert fit.standard_errors[name] > lost / np.sqrt(2) * 0.9
    assert fit.model.coefficients[name] == pytest.approx(
        1 - lost / 2, abs=2 * fit.standard_errors[name]
    )


def test_noise_of_the_force_sensor_does_not_hide_that_the_force_is_held():
    """Exact steps under a held force; straight lines smooth its noise, and so leave less."""
    n, dt, rng = 3000, 2 * np.pi / OMEGA / 24, np.random.default_rng(0)
    push = multisine(n, rng)(dt * np.arange(n))
    a = np.array([[0, 1, 0], [-(OMEGA**2), -2 * ZETA * OMEGA, 1], [0, 0, 0]])
    step, state, q_dot = expm(a * dt), np.zeros(2), []
    for force in push:
        q_dot.append(state[1])
        state = step[:2] @ [*state, force]
    y = q_dot + 1e-3 * np.std(q_dot) * rng.standard_normal(n)
    u = push + 0.02 * rng.standard_normal(n)
    fit = rs.refine(LINEAR, rs.ForcedVibration(dt * np.arange(n), y, u, "m", "velocity"))
    assert "the input is held" in fit.notes[0] and fit.verdict.explained


@pytest.mark.slow
@pytest.mark.parametrize("noise", ["white", "coloured", "input"])
def test_the_right_model_is_explained_whatever_the_noise(noise):
    """At a false alarm of 1 in 100 two of four would come once in 1700 times."""
    verdicts = [verdict_on(driven(seed, noise)) for seed in range(20, 24)]
    assert sum(v.explained for v in verdicts) >= 3


@pytest.mark.slow
def test_what_is_small_is_called_good_for_practice():
    """A square that moves the mean by some thousandths, beside noise of 0.3 %."""
    verdict = verdict_on(driven(13, "quiet", lambda q, v: 0.01 * OMEGA**2 * q**2))
    assert verdict.good and not verdict.explained and verdict.like == "q^2"
    assert "good for practice, and something small is missing" in str(verdict)
