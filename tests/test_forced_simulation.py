"""Motions under inputs against closed forms and another integrator."""

import numpy as np
import pytest
from scipy.integrate import simpson, solve_ivp
from scipy.linalg import expm
from test_forced import CUBIC, DAMPING, DT, GAIN, OMEGA, T, duffing, misses, multisine, noisy

import romsindy as rs
from romsindy.physics.coupling import Along
from romsindy.physics.damping import PowerDamping
from romsindy.physics.equations import without_inputs
from romsindy.physics.input import Input, input_in
from romsindy.physics.stiffness import Stiffness

DUFFING = {
    "omega^2": OMEGA**2,
    "c_linear": DAMPING,
    "gamma_3": CUBIC,
    "gain [force]": GAIN,
}


def linear(*inputs, damping=DAMPING):
    """An oscillator under inputs of this gain."""
    terms = (Stiffness(1), PowerDamping(1), *inputs)
    return rs.ReducedModel(terms, (OMEGA**2, damping, *[GAIN] * len(inputs)), "m")


def exact(u, slope, start):
    """The linear oscillator under inputs that go on with a slope (n,), by matrix exponentials."""
    a = np.zeros((4, 4))
    a[0, 1], a[1, :3], a[2, 3] = 1.0, [-(OMEGA**2), -DAMPING, GAIN], 1.0
    step, states = expm(a * DT), [np.array(start)]
    for value, rate in zip(u[:-1], slope, strict=True):
        states.append((step @ [*states[-1], value, rate])[:2])
    return np.array(states).T


@pytest.mark.parametrize("way", ["hold", "linear"])
def test_samples_that_are_held_or_go_straight_are_exact(way):
    u, start = multisine(1)[0], (0.01, -0.3)
    model = linear(Input("force", way))
    slope = np.diff(u) / DT if way == "linear" else np.zeros(len(u) - 1)
    q, q_dot = exact(u, slope, start)
    record = model.simulate(*start, T, u=u)
    assert record.interpolation == way and record.names == ("force",)
    np.testing.assert_array_equal(record.u[:, 0], u)
    # Local errors of 1e-10, and 200 cycles.
    assert np.abs(record.y - q).max() < 1e-8 * np.abs(q).max()
    moved = model.simulate(*start, T, u=u, measured="velocity")
    assert np.abs(moved.y - q_dot).max() < 1e-8 * np.abs(q_dot).max()
    pushed = model.simulate(*start, T, u=u, measured="acceleration").y
    expected = GAIN * u - DAMPING * q_dot - OMEGA**2 * q
    assert np.abs(pushed - expected).max() < 1e-8 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("lag", "tolerance"), [(0.0, 1e-8), pytest.param(0.02, 1e-7, marks=pytest.mark.slow)]
)
def test_a_multisine_has_its_transfer_function_and_that_of_a_lag(lag, tolerance):
    """In the middle, where neither the start nor the ends of the samples are felt.

    With a lag the ends of the samples are felt as 1 / distance^2.
    """
    rng = np.random.default_rng(2)
    omega, phase = 2 * np.pi * rng.uniform(1, 30, 80), rng.uniform(0, 2 * np.pi, 80)
    t, damping, late = DT * np.arange(6000), 3.0, 0.0037
    h = GAIN * np.exp(-1j * omega * late) / (OMEGA**2 - omega**2 + 1j * damping * omega)
    waves = np.exp(1j * (np.multiply.outer(t, omega) + phase))
    model = linear(Input("force", delay=late, lag=lag), damping=damping)
    q = model.simulate(0.0, 0.0, t, u=waves.sum(axis=1).real).y
    middle, expected = slice(3000, 5000), (waves @ (h / (1 + 1j * omega * lag))).real
    assert np.abs(q - expected)[middle].max() < tolerance * np.abs(expected).max()


@pytest.mark.filterwarnings("ignore:.*saturated")  # what is held, sampled more often
def test_samples_that_are_held_act_late():
    """A jump within a step of the samples: the response of another that is held on finer steps."""
    u = multisine(3, 400)[0]
    fine = np.repeat(u, 4)
    late = 3 * DT / 4
    shifted = np.concatenate([np.full(3, u[0]), fine[:-3]])
    t = DT / 4 * np.arange(1600)
    one = linear(Input("force", "hold", late)).simulate(0, 0, T[:400], u=u).y
    other = linear(Input("force", "hold")).simulate(0, 0, t, u=shifted).y[::4]
    assert np.abs(one - other).max() < 1e-9 * np.abs(one).max()


@pytest.mark.parametrize("sign, source", [(1.0, "force"), (-1.0, "base")])
def test_duffing_moves_as_in_another_integrator(sign, source):
    """Under a function of time; that other is good to 2e-9 here."""
    u, force = multisine(4, 600)
    names = {key.replace("gain [force]", Input(source).key): v for key, v in DUFFING.items()}
    model = rs.ReducedModel.from_coefficients(names, "m")
    q = duffing(force, T[:600], (0.1, 0.0), sign)[0]
    found = model.simulate(0.1, 0.0, T[:600], u=force, rtol=1e-12)
    assert found.interpolation is None and found.names == (source,)
    assert np.abs(found.y - q).max() < 1e-8 * np.abs(q).max()
    np.testing.assert_allclose(found.u[:, 0], u, atol=1e-10)
    # Samples do not tell what the force does at their ends.
    sampled = model.simulate(0.1, 0.0, T[:600], u=u).y
    assert np.abs(sampled - q).max() < 1e-2 * np.abs(q).max()


def test_several_inputs_go_by_columns():
    force, base = multisine(5, 800)[0], multisine(6, 800)[0]
    t = T[:800]
    both = linear(Input("force", "hold"), Input("base", "linear", 0.002))
    alone = linear(Input("force", "hold")).simulate(0, 0, t, u=force).y
    alone = alone + linear(Input("base", "linear", 0.002)).simulate(0, 0, t, u=base).y
    found = both.simulate(0, 0, t, u=np.column_stack([force, base]))
    assert found.names == ("force", "base") and found.interpolation is None
    np.testing.assert_allclose(found.y, alone, atol=1e-9 * np.abs(alone).max())


SEVERAL = rs.CoupledModel.from_coefficients(
    {
        **{"omega^2 [q1]": OMEGA**2, "omega^2 [q2]": 4 * OMEGA**2, "c_linear [q1]": DAMPING},
        **{"V q1^2 q2": 30.0, "g(q1^2)^2": 0.4, "gain [force] [q1]": GAIN},
        **{"gain [force] [q2]": -0.5 * GAIN, "Gamma [base] [q1 + 0.3 q2]": 0.8},
    },
    "m",
)


def pushed_rates(t, y, force, base):
    """Of `SEVERAL`, written down by hand."""
    q1, q2, v1, v2 = y
    f1 = GAIN * force(t) - 0.8 * base(t) - OMEGA**2 * q1 - DAMPING * v1 - 60 * q1 * q2
    f2 = -0.5 * GAIN * force(t) - 0.24 * base(t) - 4 * OMEGA**2 * q2 - 30 * q1**2
    return [v1, v2, (f1 - 1.6 * q1 * v1**2) / (1 + 1.6 * q1**2), f2]


@pytest.mark.parametrize("sampled", [False, True])
def test_several_coordinates_move_as_in_another_integrator(sampled):
    """Under a force on both and a base; what goes straight between samples, or at all times."""
    t, start = T[:120], [0.01, -0.02, 0.3, 0.1]
    pushes = [multisine(seed)[1] for seed in (3, 4)]
    u = np.stack([push(t) for push in pushes], axis=1)
    model = SEVERAL
    if sampled:
        ways = {"force": Input("force", "linear"), "base": Input("base", "linear")}
        terms = (Along(ways[t.law.source], t.weights) if input_in(t) else t for t in model.terms)
        model = rs.CoupledModel(tuple(terms), model.values, "m")
        pushes = [lambda s, x=x: np.interp(s, t, x) for x in u.T]
    step = {"max_step": DT / 2} if sampled else {}
    expected = solve_ivp(
        pushed_rates, t[[0, -1]], start, "DOP853", t, args=pushes, rtol=1e-11, atol=1e-13, **step
    ).y.T
    given = u if sampled else lambda s: [push(s) for push in pushes]
    found = model.simulate(start[:2], start[2:], t, u=given)
    assert found.y.shape == (120, 2) and found.names == ("force", "base")
    np.testing.assert_allclose(found.y, expected[:, :2], atol=1e-7 * np.abs(expected[:, :2]).max())
    felt = model.simulate(start[:2], start[2:], t, u=given, measured="acceleration")
    rates = np.array([pushed_rates(s, y, *pushes)[2:] for s, y in zip(t, expected, strict=True)])
    np.testing.assert_allclose(felt.y, rates, atol=1e-6 * np.abs(rates).max())


def test_several_coordinates_say_what_drives_them():
    first, second = SEVERAL.equations()
    assert first.endswith("= 3 force(t) - 0.8 base(t)") and second.endswith("- 0.24 base(t)")
    assert "gain [force] [q1]                     3  m/(s^2 [input])" in str(SEVERAL)
    assert rs.CoupledModel.from_json(SEVERAL.to_json()) == SEVERAL
    force = SEVERAL.to_sympy()[1]
    assert str(force[1]).count("force(t)") == 1 and "base(t)" in str(force[0])
    free = without_inputs(SEVERAL)
    assert len(free.terms) == len(SEVERAL.terms) - 3 and not free.pushes
    with pytest.raises(ValueError, match="the model has no input"):
        free.simulate([0.1, 0.0], [0.0, 0.0], T, u=np.sin(T))
    with pytest.raises(
        ValueError, match=r"1 columns, and the model the inputs \['force', 'base'\]"
    ):
        SEVERAL.simulate([0.1, 0.0], [0.0, 0.0], T, u=np.sin(T))


def test_the_work_of_the_force_is_energy_and_what_is_lost():
    """With inertia, so that the energy is more than that of an oscillator."""
    inertia = {**DUFFING, "Upsilon_3": 20.0}
    model = rs.ReducedModel.from_coefficients(inertia, "m")
    t = 1e-3 * np.arange(4001)
    u = multisine(7)[1](t)
    q = model.simulate(0.05, 0.0, t, u=u).y
    q_dot = model.simulate(0.05, 0.0, t, u=u, measured="velocity").y
    work = simpson(GAIN * u * q_dot, x=t)
    lost = simpson(DAMPING * q_dot**2, x=t)
    gained = np.diff(model.energy(q, q_dot)[[0, -1]])[0]
    assert work == pytest.approx(gained + lost, rel=1e-6)


def test_what_is_simulated_is_fitted():
    model = rs.ReducedModel.from_coefficients(DUFFING, "m")
    record = model.simulate(0.0, 0.0, T, u=multisine(20)[0])
    heard = rs.ForcedVibration(T, noisy(record.y, 9), record.u, "m")
    assert np.abs(misses(rs.refine(model, heard))).max() < 3.5


def test_without_an_input_the_motion_is_free():
    free = {k: v for k, v in DUFFING.items() if "gain" not in k}
    driven = rs.ReducedModel.from_coefficients(DUFFING, "m").simulate(0.1, 0.0, T[:500])
    alone = rs.ReducedModel.from_coefficients(free, "m").simulate(0.1, 0.0, T[:500])
    assert isinstance(driven, rs.Decay)
    np.testing.assert_array_equal(driven.q, alone.q)


def test_a_motion_that_escapes_is_refused():
    soft = rs.ReducedModel.from_coefficients({**DUFFING, "gamma_3": -CUBIC}, "m")
    with pytest.raises(rs.EscapeError, match="goes to infinity"):
        soft.simulate(0.0, 0.0, T, u=100 * multisine(1)[0])


def test_what_cannot_be_simulated_is_refused():
    u = multisine(1)[0]
    with pytest.raises(ValueError, match=r"u is given, and the model has no input: .* leave u out"):
        linear().simulate(0, 0, T, u=u)
    model = linear(Input("force"), Input("base"))
    with pytest.raises(ValueError, match=r"u has 1 columns, and the model the inputs \['force'"):
        model.simulate(0, 0, T, u=u)
    with pytest.raises(ValueError, match=rf"u must have shape \({len(T)},\)"):
        linear(Input("force")).simulate(0, 0, T, u=u[1:])
    with pytest.raises(ValueError, match="t is not uniform: under inputs"):
        linear(Input("force")).simulate(0, 0, T + DT / 10 * np.sin(T), u=u)
    dry = rs.ReducedModel.from_coefficients({**DUFFING, "c_coulomb": 0.2}, "m")
    with pytest.raises(ValueError, match=r"'c_coulomb' jumps .* model.regularised"):
        dry.simulate(0, 0, T, u=u)
    assert dry.regularised(0.1).simulate(0, 0, T[:100], u=u[:100]).y.std() > 0


def test_solve_ivp_agrees_where_nothing_is_special():
    """Inertia in the equation: the force is divided by it."""
    model = rs.ReducedModel.from_coefficients({**DUFFING, "Upsilon_3": 20.0}, "m")
    force = multisine(10)[1]

    def rates(t, y):
        inertia = 1 + 20.0 * y[0] ** 2
        left = 20.0 * y[0] * y[1] ** 2 + DAMPING * y[1] + OMEGA**2 * y[0] + CUBIC * y[0] ** 3
        return [y[1], (GAIN * float(force(t)) - left) / inertia]

    options = {"t_eval": T[:500], "method": "DOP853", "rtol": 1e-11, "atol": 1e-13}
    q = solve_ivp(rates, T[[0, 499]], (0.0, 0.0), **options).y[0]
    found = model.simulate(0.0, 0.0, T[:500], u=force).y
    assert np.abs(found - q).max() < 1e-7 * np.abs(q).max()
