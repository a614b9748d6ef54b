"""A structure as a simulator, against closed forms; and its TOML file."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp
from scipy.linalg import eigh, expm
from scipy.optimize import root as root_of
from solid_decks import decks, needs_ccx

import romsindy as rs
from romsindy.commands.main import main
from romsindy.physics.damping import PowerDamping
from romsindy.physics.stiffness import Stiffness
from romsindy.simulator.force import LawForce
from romsindy.simulator.simulator import Question
from romsindy.structure.deck_file import DeckFile
from romsindy.structure.linear import Units
from romsindy.structure.simulator import Damping

OMEGA = np.array([10.0, 37.0, 90.0])
SENSORS = [(1, 1), (2, 1)]
T = np.arange(0, 3, 0.002)


def _structure(cubic=0.0, follows=0.0, length=1.0, mass=1.0, stiffer=None):
    """Three masses in one line, with K = omega^2 q + cubic q^3, in units of length and mass.

    The third mode follows the first at rest; the second is stiffer along it, omega^2 + stiffer q^2.
    """
    rng = np.random.default_rng(5)
    root = rng.normal(size=(3, 3)) + 3 * np.eye(3)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    shapes = np.linalg.solve(root.T, axes).T
    q = np.linspace(-0.5, 0.5, 10)
    moved = np.outer(q, shapes[0]) + follows * np.outer(q**2, shapes[2])
    unit = length * np.sqrt(mass)  # of q
    tangents, back = [], root @ root.T @ shapes.T / mass * length
    for x in q:
        slope = 2 * follows * x
        inner = np.diag(OMEGA**2)
        inner[0, 0] += 3 * cubic * x**2 + (slope * OMEGA[2]) ** 2
        inner[0, 2] = inner[2, 0] = -slope * OMEGA[2] ** 2
        inner[1, 1] += (stiffer or 0.0) * x**2
        tangents.append(back @ inner @ back.T)
    return rs.Structure.from_arrays(
        root @ root.T / mass,
        shapes / length,
        OMEGA,
        {1: ((OMEGA[0] ** 2 * q + cubic * q**3) / unit, moved / length)},
        [1, 2, 3],
        [1, 1, 1],
        tangents=None if stiffer is None else {1: tangents},
    )


@pytest.mark.parametrize("held_by", ["force", "mode"])
@pytest.mark.parametrize("stiffer", [None, 900.0])
def test_modes_that_ring_are_stiffened_and_driven_by_the_first(held_by, stiffer):
    """All three modes of an energy that is exactly quadratic beside the curve, in time by scipy."""
    cubic, follows, alpha, k, c, m = 200.0, 0.4, 0.3, 20.0, 0.5, 0.05
    structure = _structure(cubic, follows, stiffer=stiffer)
    simulator = structure.simulator(SENSORS, held_by=held_by, damping=Damping(alpha=alpha))
    t = T / 2  # what is driven so fast asks for steps of 0.1 rad: their fourth power is the error
    x = simulator.simulate(0.1, t, lambda t, x, v: -k * x - c * v, "3:1", mass=m)
    phi = structure.shapes
    first, point = phi[:, 0], phi[:, 2]
    sign = np.sign(structure.static_curve().curve.following_at(np.array([0.3]))[0] @ phi[2])
    more = stiffer or 0.0

    def held(y):
        q, a, b = y
        beside = OMEGA[2] ** 2 * (b - sign * follows * q**2)
        by_q = OMEGA[0] ** 2 * q + cubic * q**3 + more * q * a**2 - 2 * sign * follows * q * beside
        # The mass is no part of the sign of q: the energy is even in it.
        return np.array([by_q, (OMEGA[1] ** 2 + more * q**2) * a, beside])

    # Held: a force at the first sensor, or of the first mode, that displaces that sensor.
    along = first if held_by == "force" else np.array([1.0, 0.0, 0.0])

    def left(z):
        return np.append(
            held(z[:3]) + k * point * (point @ z[:3]) - z[3] * along, first @ z[:3] - 0.1
        )

    rest = root_of(left, [0.1 / first[0], 0, 0, 1.0], tol=1e-13).x[:3]
    mass = np.eye(3) + m * np.outer(point, point)

    def moved(_, y):
        pull = held(y[:3]) + alpha * mass @ y[3:] + point * (k * point @ y[:3] + c * point @ y[3:])
        return np.append(y[3:], -np.linalg.solve(mass, pull))

    done = solve_ivp(
        moved, (0, t[-1]), np.append(rest, np.zeros(3)), "DOP853", t, rtol=1e-10, atol=1e-12
    )
    expected = done.y[:3].T @ phi[:, :2]
    assert np.abs(x - expected).max() < 1e-5 * np.abs(x).max()


def test_motions_side_by_side_are_those_of_each_alone():
    """With forces, masses and values of their own, over other times; some have no motion."""
    simulator = _structure(200.0, 0.4, stiffer=900.0).simulator(SENSORS, damping=Damping(alpha=0.3))
    spring = LawForce(((Stiffness(1), 4.0), (PowerDamping(1), 0.3)), 1.0, 0.5)
    asked = [
        Question(0.1, T),
        Question(0.05, T[:700], spring, {"mass": 0.05, "modulus": 1.1}, "3:1"),
        Question(0.08, T[:900], replace(spring, per_q=0.8), {"density": 0.9}, "2:1"),
        Question(0.08, T, lambda t, x, v: 40 * v, {}, "1:1"),
        Question(5.0, T),
        Question(0.1, T[::2], lambda t, x, v: -0.1 * v, {"alpha": 0.1}),
        Question(0.1, T, None, {"mass": -50.0}, "1:1"),
        Question(0.1, T, None, {"modulus": -0.2}),
    ]
    found = simulator.together(asked)
    for i in (0, 1, 2, 5):
        release, t, force, values, point = asked[i]
        alone = simulator.simulate(release, t, force, point, **values)
        assert np.abs(found[i] - alone).max() < 1e-10 * np.abs(alone).max()
    refused = {
        3: "the motion leaves the range",
        4: "the release 5 is beyond",
        6: "not positive: hold",
        7: "{'modulus': -0.2}: no stiffness there; take values nearer",
    }
    for i, message in refused.items():
        assert isinstance(found[i], ValueError) and message in str(found[i])


def test_a_motion_that_ended_leaves_no_range():
    """It grows, and would a little later; beside it is one that takes ten times as long."""
    simulator = _structure(200.0, 0.4).simulator(SENSORS)
    short = Question(0.08, T[:40], lambda t, x, v: 40 * v, {}, "1:1")
    alone, beside = simulator.together([short])[0], simulator.together([short, Question(0.1, T)])[0]
    assert isinstance(simulator.together([short._replace(t=T)])[0], ValueError)
    assert np.abs(alone - beside).max() < 1e-10 * np.abs(alone).max()


def test_without_numba_motions_are_the_same(tmp_path):
    """Compiled or interpreted, the loops do the same sums; a new interpreter finds no numba."""
    code = """
import sys; sys.modules["numba"] = None
import numpy as np; from test_structure_simulator import SENSORS, T, _structure
motion = _structure(200.0, 0.4).simulator(SENSORS).simulate(0.1, T[:60])
np.save(sys.argv[1], motion)
"""
    command = [sys.executable, "-c", code, tmp_path / "x.npy"]
    subprocess.run(command, cwd=Path(__file__).parent, check=True)
    x = _structure(200.0, 0.4).simulator(SENSORS).simulate(0.1, T[:60])
    assert np.abs(np.load(tmp_path / "x.npy") - x).max() < 1e-10 * np.abs(x).max()


def test_what_other_modes_move_counts_in_modes_that_ring():
    """Two coordinates q, r and a third that is c q^2 + b q r: its energy, in time by scipy.

    On a slender structure that shortens so, this takes back what the second mode is stiffened by.
    The third is stiff: the force at the point does not move it.
    """
    omega = np.array([*OMEGA[:2], 3000.0])
    c, b, alpha, k, m = 0.8, 3.0, 0.3, 20.0, 0.05
    phi, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))  # rows are modes
    q, tangents = np.linspace(-0.5, 0.5, 10), []
    for x in q:
        by = np.array([-2 * c * x, -b * x, 1.0])
        inner = np.diag([*omega[:2] ** 2, 0.0]) + omega[2] ** 2 * np.outer(by, by)
        tangents.append(phi.T @ inner @ phi)
    moved = np.outer(q, phi[0]) + c * np.outer(q**2, phi[2])
    cases = {1: (omega[0] ** 2 * q, moved)}
    given = phi, omega, cases, [1, 2, 3], [1, 1, 1]
    structure = rs.Structure.from_arrays(np.eye(3), *given, tangents={1: tangents})
    simulator = structure.simulator(SENSORS, rings=1, damping=Damping(alpha=alpha))
    t = T / 2
    x = simulator.simulate(0.1, t, lambda t, x, v: -k * x, "3:1", mass=m)
    first, point = phi[:, 0], phi[:, 2]

    def there(z):
        return np.array([z[0], z[1], c * z[0] ** 2 + b * z[0] * z[1]])

    def tangent(z):
        return np.array([[1, 0], [0, 1], [2 * c * z[0] + b * z[1], b * z[0]]])

    def pull(z):
        return omega[:2] ** 2 * z + k * tangent(z).T @ point * (point @ there(z))

    def left(z):
        return np.append(pull(z[:2]) - z[2] * tangent(z).T @ first, first @ there(z) - 0.1)

    rest = root_of(left, [0.1 / first[0], 0, 1.0], tol=1e-13).x[:2]
    mass = np.eye(3) + m * np.outer(point, point)

    def motion(_, y):
        z, v, along = y[:2], y[2:], tangent(y)
        turned = np.array([0, 0, 2 * c * v[0] ** 2 + 2 * b * v[0] * v[1]])
        pushed = pull(z) + along.T @ mass @ (turned + alpha * along @ v)
        return np.append(v, -np.linalg.solve(along.T @ mass @ along, pushed))

    start = np.append(rest, np.zeros(2))
    done = solve_ivp(motion, (0, t[-1]), start, "DOP853", t, rtol=1e-10, atol=1e-12)
    expected = np.array([there(z) for z in done.y[:2].T]) @ phi[:, :2]
    assert np.abs(x - expected).max() < 1e-5 * np.abs(x).max()


@pytest.mark.parametrize("spring, mass, within", [(8.0, 0.0, 0.005), (0.0, 0.9, 0.015)])
def test_a_point_gives_by_the_modes_that_do_not_ring(spring, mass, within):
    """A string of 24 masses, of which three modes are kept: its lowest three modes by the matrices.

    A sixth of what the point gives lies beyond those: without it both are off by 6 %. What is left
    is the inertia of modes that do not ring.
    """
    n, at, seen = 24, 8, 15
    stiffness = 400.0 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    square, axes = np.linalg.eigh(stiffness)
    axes *= np.sign(axes[np.argmax(np.abs(axes), axis=0), np.arange(n)])
    q = np.linspace(-0.5, 0.5, 10)
    cases = {1: (square[0] * q, np.outer(q, axes[:, 0]))}
    given = np.sqrt(square), cases, np.arange(1, n + 1), np.ones(n, int)
    structure = rs.Structure.from_arrays(np.eye(n), axes.T, *given)
    t = np.arange(0, 40 * np.pi / np.sqrt(square[0]), 0.02)
    simulator = structure.simulator([(at + 1, 1), (seen + 1, 1)], rings=2)
    x = simulator.simulate(0.1, t, lambda t, x, v: -spring * x, f"{at + 1}:1", mass=mass)
    point = np.eye(1, n, at)[0]
    whole = stiffness + spring * np.outer(point, point), np.eye(n) + mass * np.outer(point, point)
    square, axes = eigh(*whole)
    held = axes[:, :3].T @ whole[1] @ np.linalg.solve(whole[0], point)
    expected = np.cos(np.outer(t, np.sqrt(square[:3]))) * held @ axes[[at, seen], :3].T
    expected *= np.sum(x * expected) / np.sum(expected**2)  # all modes are in the release
    assert np.abs(x - expected).max() < within * np.abs(expected).max()


@pytest.mark.parametrize("mass", [-0.2, 0.3, 3.0])
def test_a_mass_counts_in_some_modes_as_it_moves_all(mass):
    """Frequencies of four of 24 modes with a mass are those of the whole matrices, to rounding."""
    n, at, kept = 24, 8, np.array([1, 2, 3, 5])
    stiffness = 400.0 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    square, axes = np.linalg.eigh(stiffness)
    q = np.linspace(-0.5, 0.5, 10)
    given = np.sqrt(square), {1: (square[0] * q, np.outer(q, axes[:, 0]))}
    rows = np.arange(1, n + 1), np.ones(n, int)
    structure = rs.Structure.from_arrays(np.eye(n), axes.T, *given, *rows)
    counts = structure.counts(at, mass, kept)
    there = counts * structure.shapes[kept - 1, at]
    few = eigh(np.diag(square[kept - 1]), np.eye(4) + mass * np.outer(there, there))[0]
    whole = eigh(stiffness, np.eye(n) + mass * np.diag(np.eye(n)[at]))[0]
    assert few == pytest.approx(whole[kept - 1], rel=1e-10)
    assert np.all((counts >= 1) == (mass > 0))


def test_a_linear_structure_rings_in_closed_form():
    """All three modes, let go from a static shape under a force at the first sensor."""
    structure, zeta = _structure(), 0.02
    x = structure.simulator(SENSORS, damping=zeta).simulate(0.1, T)
    rows = [structure.freedom(*s) for s in SENSORS]
    phi = structure.shapes[:, rows]
    held = phi[:, 0] / OMEGA**2
    held *= 0.1 / (held @ phi[:, 0])
    turned = OMEGA * np.sqrt(1 - zeta**2)
    angle = np.outer(T, turned)
    wave = np.cos(angle) + zeta / np.sqrt(1 - zeta**2) * np.sin(angle)
    expected = (np.exp(-zeta * np.outer(T, OMEGA)) * wave * held) @ phi
    assert x[0, 0] == pytest.approx(0.1, rel=1e-9)
    assert np.abs(x - expected).max() < 1e-6 * np.abs(expected).max()


def _let_go(stiffness, phi):
    """Coordinates of modes from which a force holds the first sensor, whose row is phi, at 0.1."""
    held = np.linalg.solve(stiffness, phi)
    return held * (0.1 / (held @ phi))


def _by_matrices(whole, held):
    """Coordinates at all times, (n, 3), by the exponential of the matrix of the states."""
    step, states = expm(whole * T[1]), [np.append(held, np.zeros(3))]
    for _ in T[1:]:
        states.append(step @ states[-1])
    return np.array(states)[:, :3]


def test_a_spring_and_a_damper_at_the_first_sensor_are_those_of_the_matrices():
    """The force couples the modes: the exponential of the whole matrix is the oracle."""
    structure, k, c = _structure(), 30.0, 0.4
    simulator = structure.simulator(SENSORS)
    x = simulator.simulate(0.1, T, lambda t, x, v: -k * x - c * v)
    rows = [structure.freedom(*s) for s in SENSORS]
    phi = structure.shapes[:, rows]
    stiffness = np.diag(OMEGA**2) + k * np.outer(phi[:, 0], phi[:, 0])
    damping = c * np.outer(phi[:, 0], phi[:, 0])
    whole = np.block([[np.zeros((3, 3)), np.eye(3)], [-stiffness, -damping]])
    expected = _by_matrices(whole, _let_go(stiffness, phi[:, 0])) @ phi  # the spring holds as well
    assert np.abs(x - expected).max() < 1e-5 * np.abs(x).max()


def test_a_force_may_act_elsewhere_than_at_a_sensor():
    """A spring at the third mass, let go by a force at the first: the matrices again."""
    structure, k = _structure(), 30.0
    x = structure.simulator(SENSORS, point=(3, 1)).simulate(0.1, T, lambda t, x, v: -k * x)
    phi = structure.shapes[:, [structure.freedom(*s) for s in (*SENSORS, (3, 1))]]
    stiffness = np.diag(OMEGA**2) + k * np.outer(phi[:, 2], phi[:, 2])
    square, turn = np.linalg.eigh(stiffness)
    waves = np.cos(np.outer(T, np.sqrt(square))) * (_let_go(stiffness, phi[:, 0]) @ turn)
    expected = waves @ turn.T @ phi[:, :2]
    assert np.abs(x - expected).max() < 1e-5 * np.abs(x).max()


def test_a_mass_anywhere_is_that_of_the_matrices():
    """A mass and a damper at the third mass of a stiffer structure, in closed form."""
    structure, m, c = _structure(), 0.6, 0.3
    simulator = structure.simulator(SENSORS, point=(1, 1))
    given = (lambda t, x, v: -c * v), "3:1"
    x = simulator.simulate(0.1, T, *given, mass=m, modulus=1.3, density=1.1)
    phi = structure.shapes[:, [structure.freedom(*s) for s in (*SENSORS, (3, 1))]]
    together = np.outer(phi[:, 2], phi[:, 2])
    mass, stiffness = 1.1 * np.eye(3) + m * together, 1.3 * np.diag(OMEGA**2)
    parts = np.linalg.solve(mass, np.hstack([-stiffness, -c * together]))
    whole = np.block([[np.zeros((3, 3)), np.eye(3)], [parts]])
    expected = _by_matrices(whole, _let_go(stiffness, phi[:, 0])) @ phi[:, :2]
    assert np.abs(x - expected).max() < 1e-5 * np.abs(x).max()


def test_a_mass_at_a_point_that_bends_takes_energy_as_it_should():
    """Without damping, 1/2 (1 + h + m x_p'^2) q'^2 + the work of K stays: h is s'^T M s' here."""
    structure, m = _structure(cubic=200.0, follows=0.4), 0.6
    simulator = structure.simulator([(3, 1)], rings=0, held_by="mode")
    x = simulator.simulate(0.05, T, mass=m)[:, 0]
    q = np.linspace(-0.45, 0.45, 4001)
    at, curve = structure.shapes[:, structure.freedom(3, 1)], simulator.curve
    place, slope = at[0] * q + 0.4 * at[2] * q**2, at[0] + 0.8 * at[2] * q
    kinetic = 0.5 * (curve.inertia_at(q) + m * slope**2) / slope**2  # over the speed squared
    work = OMEGA[0] ** 2 * q**2 / 2 + 200 * q**4 / 4
    order = np.argsort(place)
    speed = np.gradient(x, T, edge_order=2)
    energy = np.interp(x, place[order], kinetic[order]) * speed**2
    energy += np.interp(x, place[order], work[order])
    assert np.ptp(energy[2:-2]) < 1e-3 * energy[2]  # differences of the samples: (0.1 rad)^2 / 6


def test_nonlinear_motion_is_that_of_the_reduced_equation():
    """Held by the mode alone, one mode swings: its equation has the frequency by quadrature."""
    structure = _structure(cubic=200.0, follows=0.4)
    simulator = structure.simulator(SENSORS, held_by="mode", rings=0)
    x = simulator.simulate(0.1, np.arange(0, 20, 0.002))[:, 0]
    found = structure.reduce(1)
    up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    # What follows shifts the middle of the sensor, not the period.
    periods = np.diff(up - x[up] / np.diff(x)[up]) * 0.002
    shape = structure.shapes[0][structure.freedom(1, 1)]
    q = simulator._held(0.1, simulator.sensors[0], simulator._at_first, None, 1.0)[0, 0]
    assert abs(shape * q - 0.1) > 1e-4  # it does follow
    expected = 2 * np.pi / found.frequencies(np.array([abs(q)]))[0]
    assert periods.mean() == pytest.approx(expected, rel=1e-5)


def test_a_stiffer_or_heavier_structure_is_faster_or_slower():
    """Ratios of damping kept, a structure 4 times as stiff does in half the time the same."""
    simulator = _structure(cubic=200.0, follows=0.4).simulator(SENSORS, damping=0.01)
    usual = simulator.simulate(0.1, T)
    assert simulator.simulate(0.1, T / 2, modulus=4.0) == pytest.approx(usual, abs=1e-6)
    assert simulator.simulate(0.1, 2 * T, density=4.0) == pytest.approx(usual, abs=1e-6)


def test_other_units_of_the_model_give_the_same_in_si():
    """A model in mm and t, asked in m and N."""

    def force(t, x, v):
        return -30 * x - 0.4 * v

    asked = 0.1, T, force
    usual = _structure(200.0, 0.4).simulator(SENSORS, damping=Damping(alpha=0.2)).simulate(*asked)
    small = _structure(200.0, 0.4, length=1e-3, mass=1e3)
    given = {"damping": Damping(alpha=0.2), "units": Units(1e-3, 1e3)}
    assert small.simulator(SENSORS, **given).simulate(*asked) == pytest.approx(usual, abs=1e-9)


def test_what_is_beyond_the_range_is_refused():
    simulator = _structure(cubic=-80.0).simulator(SENSORS)
    with pytest.raises(ValueError, match="is beyond the range that was held"):
        simulator.simulate(50.0, T)
    with pytest.raises(ValueError, match="the motion leaves the range that was held"):
        simulator.simulate(0.1, T, lambda t, x, v: 1e4)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"sensors": []}, r"sensors = \[\]"),
        ({"sensors": [(1, 2)]}, "is not free in direction 2"),
        ({"sensors": SENSORS, "held_by": "hand"}, "held_by = 'hand' is none of force, mode"),
        ({"sensors": SENSORS, "damping": -0.1}, "damping_ratio must be zero or positive"),
    ],
)
def test_simulators_that_cannot_be(given, words):
    with pytest.raises(ValueError, match=words):
        _structure().simulator(**given)


# -- the file -------------------------------------------------------------------------------------

DECK = """
[deck]
file = "beam.inp"
range = 0.1
units = "m,kg,s"

[damping]
alpha = 0.4

[sensors]
nodes = ["TIP:3"]
columns = ["tip"]

[tolerances]
modulus = 0.05
alpha = 0.2
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[deck]", "[dek]", "dek"),
        ('file = "beam.inp"', "", "has no 'file'"),
        ("range = 0.1", 'range = "far"', 'range = "far" must be a finite number'),
        ('"m,kg,s"', '"mm,t,ms"', "the time must be s"),
        ('"m,kg,s"', '"m,lb,s"', "the mass 'lb' is none of"),
        ('"TIP:3"', '"TIP"', "is not NODE:DIRECTION"),
        ('["tip"]', '["tip", "middle"]', "give nodes"),
        ("alpha = 0.2", "beta = 0.2", "its value is zero"),
        ("modulus", "moduluss", "moduluss"),
        ("range = 0.1", "range = ", "is no TOML"),
    ],
)
def test_a_file_that_cannot_be_meant(tmp_path, old, new, words):
    path = tmp_path / "beam.toml"
    path.write_text(DECK.replace(old, new))
    with pytest.raises(ValueError, match=words) as refusal:
        DeckFile.load(path)
    assert str(path) in str(refusal.value)


def test_a_deck_that_is_not_there_is_named(tmp_path):
    (tmp_path / "beam.toml").write_text(DECK)
    given = ["diagnose", "--measured", str(tmp_path / "beam.toml")]
    done = CliRunner().invoke(main, [*given, "--deck", str(tmp_path / "beam.toml")])
    assert done.exit_code == 2 and "beam.inp: there is no such deck" in done.output


@needs_ccx
def test_damping_that_is_not_stated_is_found(tmp_path):
    decks.cantilever(tmp_path / "beam.inp", elements=4)
    with (tmp_path / "beam.inp").open("a") as file:
        file.write("*NSET, NSET=TIP\n1\n")
    text = DECK.replace("alpha = 0.2", "").replace("alpha = 0.4", "").replace("TIP:3", "{tip}:3")
    places = decks.block((4, 1, 1), (1.0, 0.02, 0.01))[0]
    tip = decks.at(places, 0, 1.0)[0]
    (tmp_path / "beam.toml").write_text(text.replace("{tip}", str(tip)))
    found = DeckFile.load(tmp_path / "beam.toml")
    assert len(found.simulator(progress=False).ringing.numbers) == 3  # the lowest
    assert set(found.parameters) == {"damping_ratio", "modulus"} and found.columns == ("tip",)
