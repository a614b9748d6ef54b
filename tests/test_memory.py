"""Forces with a memory: against their inner state as a differential equation, and closed forms."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.effects import (
    Backlash,
    MicroSlip,
    SmallMass,
    SofteningLoop,
    Viscoelastic,
)
from romsindy.effects.base import Scales, State
from romsindy.fit.kernel.collocation import Grid, integrate
from romsindy.fit.kernel.equation import ExtendedEquation, equation_of
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.hypothesis import free_parts
from romsindy.fit.kernel.linear_response import nodes, sensitivity
from romsindy.fit.kernel.part import Part, moved_parts
from romsindy.fit.records.arguments import prepared
from romsindy.fit.verdict import PREDICTED
from romsindy.physics.damping import Friction, PowerDamping
from romsindy.physics.input import Input
from romsindy.physics.memory import MaxwellElement, SlippingJoint, TunedMass
from romsindy.physics.stiffness import Stiffness

OMEGA = 30.0
T = np.arange(0, 8, 0.005)


def slider(z, v, limit):
    """A slider that is dragged along at its limit."""
    return 0.0 if (z >= limit and v > 0) or (z <= -limit and v < 0) else v


def iwan(slips):
    return lambda q, v, z: [slider(x, v, s) for x, s in zip(z, slips, strict=True)]


def bouc_wen(slip, n, loss):
    def rates(q, v, z):
        return [v * (1 - (abs(z[0]) / slip) ** n * (1 - loss + loss * np.sign(v * z[0])))]

    return rates


def absorber(w, zeta):
    return lambda q, v, z: [z[1], -w * w * (z[0] - q) - 2 * zeta * w * (z[1] - v)]


W, ZETA = 0.96 * OMEGA, 0.02
SLIPS = 0.5 * ((np.arange(16) + 0.5) / 16) ** 2
# Effect, rates of its inner state, its force for a unit of strength, how many inner states, and a
# strength that shifts the damping ratio or the frequency by about 0.003.
CASES = {
    "jenkins": (MicroSlip(0.3), iwan([0.3]), lambda q, v, z: z[0], 1, 20.0),
    "iwan": (MicroSlip(0.5, 2.0), iwan(SLIPS), lambda q, v, z: np.mean(z, axis=0), 16, 20.0),
    "bouc_wen": (
        SofteningLoop(0.3, 1.4, 0.6),
        bouc_wen(0.3, 1.4, 0.6),
        lambda q, v, z: z[0],
        1,
        20.0,
    ),
    "play": (
        Backlash(0.25, 0.5),
        lambda q, v, z: [slider(z[0], v, 0.75)],
        lambda q, v, z: z[0] - np.clip(z[0], -0.25, 0.25),
        1,
        30.0,
    ),
    "maxwell": (
        Viscoelastic(0.04),
        lambda q, v, z: [v - z[0] / 0.04],
        lambda q, v, z: z[0],
        1,
        8.0,
    ),
    "tuned_mass": (
        SmallMass(W, ZETA),
        absorber(W, ZETA),
        lambda q, v, z: -(W**2) * (z[0] - q) - 2 * ZETA * W * (z[1] - v),
        2,
        2e-3,
    ),
}
MODEL = rs.ReducedModel.from_coefficients(
    {"omega^2": OMEGA**2, "gamma_3": 90.0, "Upsilon_3": 0.1, "c_linear": 0.3}
)


@lru_cache
def held(name, amplitude):
    """Inner state at rest, after a slow pull from 0."""
    _, rates, _, n, _ = CASES[name]
    if name in ("maxwell", "tuned_mass"):
        return [0.0] if n == 1 else [amplitude, 0.0]
    pull = solve_ivp(lambda q, z: rates(q, 1.0, z), (0, amplitude), np.zeros(n), max_step=1e-4)
    return list(pull.y[:, -1])


@lru_cache
def motion(name, amplitude):
    _, rates, force, _, strength = CASES[name]
    return integrated(rates, force, strength, amplitude, held(name, amplitude))


def integrated(rates, force, strength, amplitude, inner):
    """q of the oscillator with the force, by an integration of all states."""
    c = MODEL.coefficients

    def all_rates(_, y):
        q, v, z = y[0], y[1], y[2:]
        mass = 1 + c["Upsilon_3"] * q * q
        push = q * (c["omega^2"] + c["gamma_3"] * q * q) + c["Upsilon_3"] * q * v * v
        push += c["c_linear"] * v + strength * force(q, v, z)
        return [v, -push / mass, *rates(q, v, z)]

    # A step beyond a slider's limit may be no longer than this: errors of 1e-5.
    return solve_ivp(
        all_rates,
        (0, T[-1]),
        [amplitude, 0.0, *inner],
        t_eval=T,
        rtol=1e-8,
        atol=1e-9,
        max_step=4e-3,
    ).y[0]


def vibration(n=20 * 120, amplitude=1.0):
    """A steady vibration, 120 samples a cycle as at the Gauss points of 40 steps."""
    t = np.arange(n) * 2 * np.pi / OMEGA / 120
    q, v = amplitude * np.cos(OMEGA * t), -amplitude * OMEGA * np.sin(OMEGA * t)
    return State(t, q, v, -(OMEGA**2) * q, 0.0, OMEGA)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_force_along_a_decay_is_that_of_the_inner_state(name):
    effect, rates, force, _, _ = CASES[name]
    t = vibration().t
    rate = complex(-0.2, OMEGA)

    def q_and_v(s):
        z = np.exp(rate * s) * (1 - rate.real / (1j * rate.imag))  # let go at rest
        return z.real, (rate * z).real

    inner = solve_ivp(
        lambda s, z: rates(*q_and_v(s), z),
        (0, t[-1]),
        held(name, 1.0),
        t_eval=t,
        rtol=1e-9,
        atol=1e-11,
        max_step=1e-3,
    ).y
    q, v = q_and_v(t)
    expected = force(q, v, inner)
    state = State(t, q, v, 0 * t, 0.0, OMEGA)
    found = effect.forces(state)[0]
    # The parabola between two samples at a turning point errs by 1e-4, and slips are offset by it.
    np.testing.assert_allclose(found, expected, atol=2e-4 * np.abs(expected).max())
    cut = 1111  # it goes on from what it remembers
    first = State(t[:cut], q[:cut], v[:cut], 0 * t[:cut], 0.0, OMEGA)
    rest = State(
        t[cut:], q[cut:], v[cut:], 0 * t[cut:], 0.0, OMEGA, memory=effect.remembered(first)
    )
    parts = np.concatenate([effect.forces(first)[0], effect.forces(rest)[0]])
    np.testing.assert_allclose(parts, found, atol=1e-9 * np.abs(found).max())


def _absorbed(a):
    response = (W**2 + 2j * ZETA * W * OMEGA) / (W**2 - OMEGA**2 + 2j * ZETA * W * OMEGA)
    return -np.pi * a**2 * OMEGA**2 * response.imag


LOSSES = {
    "jenkins": lambda a: 4 * 0.3 * (a - 0.3),
    # Mean over the slips s = 0.5 p^2 of 4 s (a - s).
    "iwan": lambda a: 4 * (0.5 * a / 3 - 0.25 / 5),
    "play": lambda a: 4 * 0.5 * (a - 0.75),  # it slips from 0.25 + 0.5 on
    "maxwell": lambda a: np.pi * a**2 * 1.2 / (1 + 1.2**2),  # omega times relaxation is 1.2
    "tuned_mass": _absorbed,
}


@pytest.mark.parametrize("amplitude", [0.8, 1.3])
@pytest.mark.parametrize("name", LOSSES)
def test_energy_lost_in_a_cycle_is_the_closed_form(name, amplitude):
    state = vibration(130 * 120, amplitude)
    force = CASES[name][0].forces(state)[0]
    last = slice(-120, None)
    loss = np.mean(force[last] * state.q_dot[last]) * 2 * np.pi / OMEGA
    # 120 samples on a kink: (2 pi / 120)^2; 16 sliders: (1/16)^2 / 2
    assert loss == pytest.approx(LOSSES[name](amplitude), rel=4e-3)


def test_iwan_loses_by_the_power_of_its_scatter():
    """D ~ a^(3 + chi) with scatter 1 / (1 + chi) [Segalman 2005], far from full slip."""
    a = np.array([0.2, 0.4])
    losses = []
    for x in a:
        state = vibration(10 * 120, x)
        force = MicroSlip(1.0, 2.0).forces(state)[0]
        losses.append(np.mean((force * state.q_dot)[-120:]))
    power = np.log(losses[1] / losses[0]) / np.log(2)
    assert power == pytest.approx(3 - 0.5, abs=0.05)  # few of the 16 sliders slip


@pytest.mark.parametrize("name", CASES)
def test_slopes_are_those_of_slow_changes_of_a_vibration(name):
    """Of amplitude and phase together: force of the changed motion less that of the motion."""
    effect = CASES[name][0]
    state = vibration(100 * 120)
    size, turn = 3e-5, 2e-5  # of the amplitude, and in rad
    changed = np.exp(1j * OMEGA * state.t) * (1 + size + 1j * turn)
    q, v = changed.real, (1j * OMEGA * changed).real
    moved = effect.forces(state._replace(q=q, q_dot=v))[0]
    by_q, by_v, by_a = effect.slopes(state, np.ones(1))
    expected = by_q * (q - state.q) + by_v * (v - state.q_dot)
    steady = slice(-2400, None)
    error = (moved - effect.forces(state)[0] - expected)[steady]
    # At the kinks, one or two of 30 samples between them, the slope is neither of both.
    assert np.sqrt(np.mean(error**2)) < 0.12 * np.sqrt(np.mean(expected[steady] ** 2))
    assert by_a == 0.0


def test_where_a_joint_stuck_is_no_matter_of_the_amplitude_now():
    """What it slipped at first offsets it for good, many times the amplitude of the end."""
    state = vibration(60 * 120)
    fading = np.exp((-0.3 + 1j * OMEGA) * state.t)
    q, v, a = fading.real, *(((-0.3 + 1j * OMEGA) ** k * fading).real for k in (1, 2))
    by_q, by_v, _ = MicroSlip(0.3).slopes(state._replace(q=q, q_dot=v, q_ddot=a), np.ones(1))
    end = slice(-600, -60)
    assert abs(q[end]).max() < 0.04
    np.testing.assert_allclose(by_q[end], 1.0, atol=0.02)  # a spring
    np.testing.assert_allclose(by_v[end] * OMEGA, 0.0, atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_simulation_is_that_of_the_inner_state(name):
    true = motion(name, 1.0)
    effect, strength = CASES[name][0], CASES[name][4]
    grid = Grid.over(T, 2 * np.pi / 31.5, 40)
    equation = ExtendedEquation(
        MODEL, (Part(effect, (), np.array([[strength]])),), 0, grid.step, 0.0
    )
    found = integrate(equation, [1.0, 0.0], grid)
    # 46 dB of noise are 5e-3; the turning points cost 1e-4 of the force, which is 1e-2.
    error = found.samples(equation)[:, 0] - true
    assert np.abs(error).max() < 5e-4
    again = integrate(equation, [1.0, 0.0], grid, guess=found)
    np.testing.assert_allclose(again.q, found.q, atol=1e-8)
    residual = equation.linearise(*nodes(found)).residual
    assert np.abs(residual).max() < 1e-6 * OMEGA**2


# An Iwan element, the dearest, is many Jenkins elements: these are named.
NAMED = [pytest.param(x, marks=[pytest.mark.slow] * (x != "maxwell")) for x in CASES if x != "iwan"]


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize("seed", [1])
def test_it_is_named(name, seed):
    decays = [
        rs.add_noise(rs.Decay(T, motion(name, a)), 40, 10 * seed + i)
        for i, a in enumerate((1.0, 0.6, 0.8))
    ]
    report = rs.diagnose(MODEL, decays[:2], held_out=decays[2])
    effect = CASES[name][0]
    if name == "maxwell":  # to one mode it is a stiffness and a damping, at its one frequency
        assert report.verdict in ("named", "ambiguous")
        assert (effect.name,) in report.equivalent
        return
    assert report.verdict == "named" and report.best.names == (effect.name,)
    assert report.gap.after < PREDICTED
    (found,) = report.effects
    scales = Scales(1.0, OMEGA, T[-1])
    for p in effect.parameters(scales):
        if found.standard_errors[p.name] < 0.1 * effect.value(p.name):
            unit = 2 * np.pi if found.units[p.name] == "Hz" else 1.0  # a law says rad/s
            assert unit * found.values[p.name] == pytest.approx(effect.value(p.name), rel=0.1)


def test_joint_that_was_relaxed_slips_later_on_its_first_stroke():
    state = vibration(240)
    expected = np.maximum(state.q - 1, -1.5)  # a spring from the release on, then a slider
    expected[60:] = state.q[60:] + 1 - 1.5  # it never slips again
    for way in (1, -1):
        turned = state._replace(q=way * state.q, q_dot=way * state.q_dot)
        found = MicroSlip(1.5, relaxed=True).forces(turned)[0]
        np.testing.assert_allclose(found, way * expected, atol=1e-9)


@pytest.mark.study
@pytest.mark.slow
def test_joint_that_was_relaxed_at_the_release_is_named():
    """Sliders of large limits, loaded by the way from the release alone, stay where they slip."""
    slips = 1.4 * (np.arange(16) + 0.5) / 16
    decays = []
    for i, a in enumerate((1.0, -0.6, 0.8)):
        q = integrated(iwan(slips), CASES["iwan"][2], 20.0, a, np.zeros(16))
        decays.append(rs.add_noise(rs.Decay(T, q), 40, i))
    report = rs.diagnose(MODEL, decays[:2], held_out=decays[2])
    assert report.verdict == "named" and report.best.names == ("micro_slip",)
    assert report.gap.after < PREDICTED
    (found,) = report.effects
    assert found.variant == "relaxed at the release"
    truth = {"strength": 20.0, "slip": 1.4, "scatter": 1.0}
    assert found.values == pytest.approx(truth, rel=0.1)


@pytest.mark.slow
def test_tuned_mass_is_named_where_records_begin_after_the_release():
    """The mass is neither at rest nor in a steady vibration then: it may be anywhere."""
    decays = []
    for i, (a, late) in enumerate(((1.0, 0.3), (0.6, 0.45), (0.8, 0.17))):  # s
        begun = int(np.searchsorted(T, late))
        decays.append(rs.add_noise(rs.Decay(T[begun:], motion("tuned_mass", a)[begun:]), 40, i))
    report = rs.diagnose(MODEL, decays[:2], held_out=decays[2])
    assert report.verdict == "named" and report.best.names == ("tuned_mass",)
    assert report.gap.after < PREDICTED
    (found,) = report.effects
    truth = {"strength": 2e-3, "frequency": W / (2 * np.pi), "damping_ratio": ZETA}
    assert found.values == pytest.approx(truth, rel=0.1)


@pytest.mark.parametrize("law", [MaxwellElement(0.1), TunedMass(W, ZETA)], ids=["maxwell", "mass"])
def test_what_is_remembered_at_the_start_changes_without_a_jump(law):
    """From a release at rest to a vibration that has gone on for long, by the phase of the start.

    Of q = Re exp(i omega t) the inner state is that of the forced vibration, by its transfer
    function.
    """
    by_q, by_q_dot = law.gains

    def forced(angle):
        z = [(by_q + s * by_q_dot) / (s - law.pole) for s in (1j * OMEGA, -1j * OMEGA)]
        found = (z[0] * np.exp(1j * angle) + z[1] * np.exp(-1j * angle)) / 2
        return [found.real, found.imag]

    angles = np.arange(0, np.pi / 2, 1e-3)
    z = np.array([law.begun(np.cos(a), -OMEGA * np.sin(a), OMEGA) for a in angles])
    rested = law.rested(1.0)
    np.testing.assert_allclose(z[0], [rested.real, rested.imag], atol=1e-12)
    late = np.flatnonzero(np.sin(angles) > 0.2)
    expected = [forced(a) for a in angles[late]]
    np.testing.assert_allclose(z[late], expected, atol=1e-9 * np.abs(z).max())
    # The least that the whole way takes in a tenth of a radian, and four times as much.
    assert np.abs(np.diff(z, axis=0)).max() < 4 * 1e-3 / 0.1 * np.abs(z).max()


def test_a_record_that_begins_late_settles_wherever_the_second_mass_is():
    """Also where the motion begins neither at rest nor moving: there its start must not matter."""
    law = SmallMass(W, ZETA, late=True)
    for begun in range(20, 60, 3):
        q = motion("tuned_mass", 1.0)[begun : begun + 1500]
        decay = rs.add_noise(rs.Decay(T[: len(q)], q, unit="mm"), 40, begun)
        (record,) = prepared([decay], "mm")
        part = Part(law, (), np.array([[2e-3, 0.0, 0.0]]))
        found = fit(MODEL, [part], [record], fixed=True, iterations=6)
        assert found.converged
        assert found.chi_squared < 1.2 * len(q)


# -- laws that remember, in models and in their fits ---------------------------------------------


def model_with(name, strength=None):
    effect, *_, own = CASES[name]
    values = (*MODEL.values, own if strength is None else strength)
    return rs.ReducedModel((*MODEL.terms, effect.remembering), values, "mm")


@pytest.mark.parametrize("name", [n for n in CASES if n != "iwan"])  # sixteen sliders are slow
def test_a_model_is_simulated_with_what_it_remembers(name):
    _, rates, force, _, strength = CASES[name]
    truth = integrated(rates, force, strength, 0.8, held(name, 0.8))
    t = T[:240]
    found = model_with(name).simulate(0.8, 0.0, t, rtol=1e-8)
    np.testing.assert_allclose(found.q, truth[: len(t)], atol=1e-5)


def test_a_model_that_remembers_is_saved_and_refuses_what_it_cannot_say():
    model = model_with("tuned_mass")
    assert rs.ReducedModel.from_json(model.to_json()) == model
    assert "tuned_mass(q; frequency = 28.8, damping_ratio = 0.02)" in model.equation()
    assert r"\text{tuned\_mass}" in model.latex()
    for ask in (
        lambda: model.backbone(0.5),
        lambda: rs.forced_response(model, 1.0, (25.0, 35.0)),
        lambda: model.to_c(),
        lambda: rs.fit_steady(model, [29, 30, 31, 32], [1] * 4, [1j] * 4),
        lambda: model.terms[-1].weak(0.1, 0.0),
    ):
        with pytest.raises(ValueError, match="tuned_mass remembers the motion"):
            ask()
    rubbing = rs.ReducedModel((*model.terms, Friction()), (*model.values, 1.0), "mm")
    with pytest.raises(ValueError, match="c_coulomb jumps: give model"):
        rubbing.simulate(1.0, 0.0, T)
    with pytest.raises(ValueError, match="'tuned_mass' is not known"):
        rs.ReducedModel.from_coefficients({"tuned_mass": 0.1})


def fitted_parts(model, decay):
    records = prepared([decay], "mm")
    start, parts = free_parts(model, list(model.coefficients), records)
    return records[0], start, parts


def derivatives_off(start, parts, record):
    """Differences of simulated motions less their derivatives, as parts of these."""
    state, grid = record.motion.start, record.motion.grid

    def simulated(parts, state, guess=None):
        equation = equation_of(start, parts, 0, record)
        found = integrate(equation, state, grid, guess)
        return equation, found, found.samples(equation)[:, 0]

    equation, path, q = simulated(parts, state)
    exact = sensitivity(equation, path)[:, 0].T
    n, off = len(exact) - 2, []
    for i, slope in enumerate(exact):
        step = 1e-4 / np.abs(slope).max()
        change = step * np.eye(n + 2)[i]
        near = simulated(moved_parts(parts, change[:n]), state + change[n:], path)[2]
        off.append(np.linalg.norm((near - q) / step - slope) / np.linalg.norm(slope))
    return off


def beside_the_model(effect, strength):
    return (Part(effect, (), np.full((1, 1), strength)),)


@pytest.mark.parametrize(
    ("name", "beside"),
    [("jenkins", False), ("tuned_mass", False), ("tuned_mass", True), ("maxwell", True)],
)
def test_derivatives_of_a_motion_that_remembers(name, beside):
    """Of laws of a model, and of linear ones that a hypothesis has beside its model."""
    t = T[:600]
    decay = rs.Decay(t, motion(name, 0.8)[: len(t)], unit="mm")
    if beside:
        (record,), start = prepared([decay], "mm"), MODEL
        parts = beside_the_model(CASES[name][0], CASES[name][-1])
    else:
        record, start, parts = fitted_parts(model_with(name), decay)
    # The step takes 1e-4, a joint that sticks a little later another 4e-4.
    assert max(derivatives_off(start, parts, record)) < 5e-4


@pytest.mark.parametrize("ratio", [0.02, 0.1])
def test_derivatives_beside_a_mass_that_is_tuned_to_the_vibration(ratio):
    """It takes all of the vibration and gives it back: no slope of a slow change is like that."""
    t = T[:1600]
    (record,) = prepared([rs.Decay(t, np.exp(-0.1 * t) * np.cos(OMEGA * t), unit="mm")], "mm")
    parts = beside_the_model(SmallMass(frequency=OMEGA, damping_ratio=0.002), ratio)
    assert max(derivatives_off(MODEL, parts, record)) < 2e-4  # the step takes 1e-4


def absorber_decay(seed):
    """An oscillator with a second mass on it, of 1 % of its own; noise of 1e-3."""
    mu, w, zeta = 0.01, 0.97 * OMEGA, 0.03

    def rates(_, y):
        q, v, x, u = y
        f = w * w * (x - q) + 2 * zeta * w * (u - v)
        return [v, mu * f - OMEGA**2 * q - 90 * q**3 - 0.24 * v, u, -f]

    t = np.arange(0, 5, 0.005)
    q = solve_ivp(rates, (0, 5), [1.0, 0, 1.0, 0], t_eval=t, rtol=1e-10, atol=1e-12).y[0]
    decay = rs.Decay(t, q + 1e-3 * np.random.default_rng(seed).standard_normal(len(t)), unit="mm")
    truth = {"tuned_mass": mu, "tuned_mass frequency": w, "tuned_mass damping_ratio": zeta}
    return decay, truth | {"omega^2": OMEGA**2, "gamma_3": 90.0, "c_linear": 0.24}


def held_truth(fit, truth):
    pairs = ((fit.interval(name), value) for name, value in truth.items())
    return [low <= value <= high for (low, high), value in pairs]


@pytest.mark.slow
def test_a_second_mass_is_fitted_with_what_shapes_it():
    held_by = []
    for seed in range(2):
        decay, truth = absorber_decay(seed)
        fit = rs.identify(decay, terms=[Stiffness(3), TunedMass(0.99 * OMEGA, 0.02)])
        held_by += held_truth(fit, truth)
        assert fit.verdict.explained and fit.solution.converged
    assert np.mean(held_by) >= 0.8  # 12 intervals of six values that err together
    left = fit.predict(decay, 200) - decay.signal
    assert np.std(left) < 0.02 * np.std(decay.signal)
    assert "Shapes: tuned_mass frequency" in str(fit)
    again = rs.Estimate.from_json(fit.to_json())
    assert again.model == fit.model
    np.testing.assert_allclose(again.predict(decay, 200), fit.predict(decay, 200), atol=1e-9)


def joint_decay(seed):
    """A Jenkins element beside a Duffing oscillator, let go at rest after a slow pull."""
    k, slip = 25.0, 0.3

    def rates(_, y):
        q, v, z = y
        return [v, -(OMEGA**2) * q - 90 * q**3 - 0.12 * v - k * z, slider(z, v, slip)]

    t = np.arange(0, 8, 0.005)
    q = solve_ivp(rates, (0, 8), [1.0, 0, slip], t_eval=t, rtol=1e-8, atol=1e-10, max_step=4e-3)
    noise = 1e-3 * np.random.default_rng(seed).standard_normal(len(t))
    truth = {"slipping_joint": k, "slipping_joint slip": slip, "omega^2": OMEGA**2}
    return rs.Decay(t, q.y[0] + noise, unit="mm"), truth | {"gamma_3": 90.0, "c_linear": 0.12}


@pytest.mark.slow
def test_a_slipping_joint_is_fitted():
    held_by = []
    for seed in range(4):
        decay, truth = joint_decay(seed)
        terms = (Stiffness(1), Stiffness(3), PowerDamping(1), SlippingJoint(0.4))
        fit = rs.refine(rs.ReducedModel(terms, (OMEGA**2, 80.0, 0.2, 20.0), "mm"), decay)
        held_by += held_truth(fit, truth)
        assert fit.verdict.explained
    assert np.mean(held_by) >= 0.8


@pytest.mark.slow
def test_a_viscoelastic_part_under_an_input():
    k, relaxation = 20.0, 0.04
    w, phase = np.linspace(20, 42, 23), np.random.default_rng(5).uniform(0, 2 * np.pi, 23)

    def push(t):
        return 5.2 * np.sum(np.cos(np.multiply.outer(t, w) + phase), axis=-1)

    def rates(t, y):
        q, v, z = y
        pull = OMEGA**2 * q + 90 * q**3 + 0.24 * v + k * z
        return [v, push(t) - pull, v - z / relaxation]

    t = np.arange(0, 6, 0.005)
    q = solve_ivp(rates, (0, 6), [0, 0, 0], t_eval=t, rtol=1e-9, atol=1e-11).y[0]
    truth = {"omega^2": OMEGA**2, "gamma_3": 90.0, "c_linear": 0.24, "maxwell": k}
    terms = (
        Stiffness(1),
        Stiffness(3),
        PowerDamping(1),
        MaxwellElement(relaxation),
        Input("force"),
    )
    model = rs.ReducedModel(terms, (*truth.values(), 1.0), "mm")
    np.testing.assert_allclose(model.simulate(0, 0, t, rtol=1e-8, u=push).signal, q, atol=1e-6)
    truth |= {"maxwell relaxation": relaxation, "gain [force]": 1.0}
    held_by = []
    for seed in range(2):
        noisy = q + 1e-4 * np.random.default_rng(seed).standard_normal(len(t))
        record = rs.ForcedVibration(
            t, noisy, push(t), unit="mm", inputs="force", interpolation="band-limited"
        )
        fit = rs.identify(record, terms=[Stiffness(3), MaxwellElement(0.03)])
        held_by += held_truth(fit, truth)
        assert fit.verdict.explained
    assert np.mean(held_by) >= 0.8
    assert np.std(fit.predict(record, 100) - noisy) < 0.01 * np.std(noisy)
    with pytest.raises(ValueError, match=r"fixed names \['maxwell'\]: a force that remembers"):
        rs.refine(fit.model, record, fixed=["maxwell"])


def test_a_shape_that_no_record_shows_is_no_start():
    decay, _ = absorber_decay(0)
    with pytest.raises(ValueError, match=r"slip = 50, .* finds values from 0\.00\d+ to [12]\."):
        rs.identify(decay, terms=[SlippingJoint(50.0)])
