"""A deck let go in CalculiX's own time, and the command that compares it with a measured decay."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from solid_decks import decks, needs_ccx

import romsindy as rs
from romsindy.commands.main import main
from romsindy.physics.damping import PowerDamping
from romsindy.physics.stiffness import Stiffness
from romsindy.record.backbone import extract_backbone
from romsindy.record.decay import Decay
from romsindy.simulator.force import LawForce
from romsindy.structure.calculix import STOPPED, Released
from romsindy.structure.deck import Deck
from romsindy.structure.linear import Units
from romsindy.structure.parts import Correction, corrected_deck
from romsindy.structure.simulator import Damping

K = 12e3  # N/m: the strip is held by 28e3 in its mode
SMALL, LARGE = 1e-6, 0.8e-3  # m, of a thickness of 2 mm


def _cycles(t, x):
    return extract_backbone(Decay(t, x, unit="m", stage="free"))


def _decay(frequency, ratio, amplitude=1.0, bent=0.0):
    """Frequency (1 + bent a^2), by the phase in closed form."""
    omega, t = 2 * np.pi * frequency, np.linspace(0, 12 / frequency, 2401)
    rate = ratio * omega
    a = amplitude * np.exp(-rate * t)
    return _cycles(t, a * np.cos(omega * (t + bent * (amplitude**2 - a**2) / (2 * rate))))


def test_cycles_beside_others_of_the_same_amplitude():
    """Frequencies 2 % apart and ratios 1:1.25, whatever either was let go at."""
    gap = _decay(10.2, 0.0125, 1.2, bent=0.05).beside(_decay(10.0, 0.01, 1.0, bent=0.05))
    assert gap.frequency == pytest.approx((0.02, 0.02), abs=3e-4)
    assert gap.damping == pytest.approx((0.2, 0.2), abs=0.02)
    low, high = gap.amplitude
    assert 0.4 < low < high < 1.0
    assert _decay(10.0, 0.01, 1.0).beside(_decay(10.0, 0.01, 9.0)) is None


def test_the_frequency_of_the_trapezoidal_rule_in_closed_form():
    """It turns by 2 atan(omega step / 2) in a step."""
    step, omega = 0.01, np.array([3.0, 12.0])
    run = Released(step * np.arange(5), np.zeros((5, 1)), (0.0, 0.0))
    seen = 2 / step * np.arctan(omega * step / 2)
    assert run.true(seen) == pytest.approx(omega, rel=1e-12)
    assert 1 - seen / omega == pytest.approx((omega * step) ** 2 / 12, rel=0.01)


def test_a_ratio_as_rayleigh_damping_has_the_same_rates_at_two_frequencies():
    stated, omega = Damping(0.01, 0.3, 1e-5), np.array([50.0, 300.0])
    alpha, beta = stated.rayleigh(*omega)
    assert alpha + beta * omega**2 == pytest.approx(stated.rates(omega), rel=1e-12)
    assert stated.rayleigh(50.0) == pytest.approx((0.3 + 1.0, 1e-5))


@pytest.fixture(scope="module")
def strip(tmp_path_factory):
    """A strip clamped at both ends, its file, and its middle and another node."""
    folder = tmp_path_factory.mktemp("strip")
    mesh = decks.block((4, 1, 1), (0.3, 0.02, 0.002))
    held = decks.at(mesh[0], 0, 0.0, 0.3)
    path = decks.write_deck(folder / "strip.inp", mesh, held, **decks.STEEL, kind="C3D20")
    store = folder / "strip.cases.npz"
    middle, other = (int(np.argmin(np.abs(mesh[0] - [x, 0, 0]).sum(1))) + 1 for x in (0.15, 0.075))
    structure = rs.Structure.from_calculix(path, store=store, progress=False)
    return structure, path, (middle, 3), (other, 3)


def _let_go(structure, sensors, release, steps, cycles, held_by="mode", **more):
    step = 2 * np.pi / structure.omega[0] / steps
    return structure.released(sensors, release, step, cycles * steps, held_by=held_by, **more)


@needs_ccx
@pytest.mark.slow
def test_a_small_release_rings_with_frequency_and_damping_in_closed_form(strip):
    """omega sqrt(1 - zeta^2) to 1e-4, zeta = (alpha / omega + beta omega) / 2.

    The trapezoidal rule takes (omega step)^2 / 6 off a ratio, which is 0.2 % here.
    """
    structure, _, *sensors = strip
    omega = structure.omega[0]
    stated = Damping(alpha=0.02 * omega, beta=0.01 / omega)
    run = _let_go(structure, sensors, SMALL, 60, 5, damping=stated)
    cycles = _cycles(run.t, run.moved[:, 0])
    assert not run.ended and len(run.t) == 301
    assert run.moved[0, 0] == pytest.approx(SMALL, rel=1e-3)
    assert run.true(cycles.frequency) == pytest.approx(omega * np.sqrt(1 - 0.015**2), rel=1e-4)
    assert cycles.damping_ratio == pytest.approx(0.015, rel=4e-3)
    rows = [structure.freedom(*sensor) for sensor in sensors]
    ratio = np.divide(*structure.shapes[0][rows])
    assert run.moved[0, 0] / run.moved[0, 1] == pytest.approx(ratio, rel=1e-3)


@needs_ccx
@pytest.mark.slow
def test_springs_and_masses_are_damped_as_well(strip, tmp_path):
    """With alpha M and beta K of all that there is, any added part leaves the ratios."""
    _, path, *sensors = strip
    found = Correction(sensors[0][0], 3, lambda x: -K * x, 1e-3, 0.01, 1.0, 1.0, {}, ["added"])
    (tmp_path / "more.inp").write_text(corrected_deck(Deck.load(path), found, Units()))
    more = rs.Structure.from_calculix(tmp_path / "more.inp", progress=False)
    stated = Damping(alpha=0.02 * more.omega[0], beta=0.01 / more.omega[0])
    run = _let_go(more, sensors, SMALL, 60, 4, damping=stated)
    assert _cycles(run.t, run.moved[:, 0]).damping_ratio == pytest.approx(0.015, rel=4e-3)


@needs_ccx
def test_what_was_computed_before_an_interruption_is_kept(strip):
    structure, _, *sensors = strip

    def told(n):
        if n > 60:
            raise KeyboardInterrupt

    run = _let_go(structure, sensors, SMALL, 60, 30, told=told)
    assert run.ended == STOPPED and 30 < len(run.t) < 1800
    assert np.abs(run.moved[:, 0]).max() == pytest.approx(SMALL, rel=1e-2)


@needs_ccx
def test_a_step_that_does_not_converge_ends_a_run(strip):
    """A point force over two thicknesses is let go in coarse steps."""
    structure, _, *sensors = strip
    run = _let_go(structure, sensors[:1], 4e-3, 20, 5, held_by="force")
    assert "does not converge" in run.ended and 2 <= len(run.t) < 101
    assert run.moved[0, 0] == pytest.approx(4e-3, rel=1e-3)


def test_arrays_have_no_motion_in_time():
    held = [-2.0, -1.0, 1.0, 2.0], np.array([[-2.0], [-1.0], [1.0], [2.0]])
    mass = rs.Structure.from_arrays([[1.0]], [[1.0]], [1.0], {1: held}, [1], [1])
    with pytest.raises(ValueError, match="arrays is no deck"):
        mass.released([(1, 1)], 1.0, 0.1, 10)


# -- the command ----------------------------------------------------------------------------------


@pytest.fixture
def folder(strip, tmp_path, monkeypatch):
    """A deck, its file, and a diagnosis that found a spring in the middle."""
    _, path, (middle, _), (other, _) = strip
    for name in (path, path.with_suffix(".cases.npz")):
        (tmp_path / name.name).write_bytes(name.read_bytes())
    (tmp_path / "strip.toml").write_text(
        f'[deck]\nfile = "strip.inp"\nrange = 0.001\n[damping]\nalpha = 12.0\n'
        f'[sensors]\nnodes = ["{middle}:3", "{other}:3"]\ncolumns = ["middle", "other"]\n'
        f'[release]\nheld_by = "mode"\n[force]\nnode = "{middle}:3"\n'
    )
    _found(tmp_path, (Stiffness(1), K))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _found(folder, *laws, **values):
    force = LawForce(laws, 1.0, 1.0, (1e-3, 1.0))
    content = {"verdict": "named", "effects": [], "values": values, "force_laws": force.content()}
    (folder / "d.json").write_text(json.dumps(content))


def _export(*more):
    given = ["export", "d.json", "--to", "deck", "--deck", "strip.toml", "-o", "c.inp", *more]
    return CliRunner().invoke(main, given)


def _measure(strip, folder):
    """The record of a strip that has the spring, in fine steps, on the scale of true time."""
    _, path, *sensors = strip
    found = Correction(sensors[0][0], 3, lambda x: -K * x, 1e-3, 0.0, 1.0, 1.0, {}, ["truth"])
    (folder / "truth.inp").write_text(corrected_deck(Deck.load(path), found, Units()))
    truth = rs.Structure.from_calculix(folder / "truth.inp", progress=False)
    run = _let_go(truth, sensors, LARGE, 150, 7, damping=Damping(alpha=12.0))
    seen = _cycles(run.t, run.moved[:, 0]).frequency.mean()
    table = np.column_stack([run.t * seen / run.true(seen), run.moved])
    header = "time [s],middle [m],other [m]"
    np.savetxt(folder / "test.csv", table, delimiter=",", header=header, comments="")


def _rows(text):
    """Numbers of the table: kind of row by rows of columns, the first sensor first."""
    rows = [line for line in text.splitlines() if line.strip().startswith(("frequency", "damping"))]
    return {
        (row.split(maxsplit=2)[0], row.split()[1], i >= 4): row.split()[2:]
        for i, row in enumerate(rows)
    }


@needs_ccx
@pytest.mark.slow
def test_the_corrected_deck_swings_as_was_measured(strip, folder):
    """The truth is the deck with the spring: 0.1 % of the frequency afterwards, and more before.

    The simulator has one mode with all that follows it: it agrees to its 0.1 %.
    """
    _measure(strip, folder)
    done = _export("--dynamic", "--measured", "test.csv", "--cycles", "6", "--steps", "100")
    assert done.exit_code == 0, done.output
    rows = _rows(done.output)
    for other in (False, True):
        before, after, simulated, improved = map(float, rows["frequency,", "largest", other])
        assert before < -5 and abs(after) < 0.1
        assert simulated == pytest.approx(before, abs=0.2) and abs(improved) < 0.2
        assert abs(float(rows["damping,", "median", other][1])) < 2
    assert "SPRING1" in (folder / "c.inp").read_text()
    assert "ALPHA and BETA damp an added mass and spring too" in done.output
    # A force that damps is in the simulator alone; a ratio is said in the terms of CalculiX.
    _found(folder, (Stiffness(1), K), (PowerDamping(1), 0.5), damping_ratio=0.001)
    done = _export("--dynamic", "--measured", "test.csv", "--cycles", "4", "--steps", "100")
    assert _rows(done.output)["damping,", "median", False][1] == "-"
    assert "nothing of the force that damps" in done.output
    assert "no damping ratio: 0.001 of the corrected deck is ALPHA=" in done.output


@needs_ccx
def test_what_is_beyond_the_range_is_said_and_the_deck_is_written(strip, folder):
    t = np.arange(3000) / 20e3
    x = 2.5e-3 * np.exp(-8 * t) * np.cos(2 * np.pi * 150 * t)
    table = np.column_stack([t, x, 0.5 * x])
    np.savetxt(folder / "test.csv", table, delimiter=",", header="t,middle,other", comments="")
    done = _export("--dynamic", "--measured", "test.csv", "--unit", "m")
    assert done.exit_code == 2
    assert "strip.toml: the release" in done.output and "([deck] range)" in done.output
    assert (folder / "c.inp").is_file()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["--dynamic"], "--dynamic lets a deck go as a measured decay was: give --to deck, --deck"),
        (["--measured", "strip.inp"], "--measured is for --dynamic"),
        (["--cycles", "5"], "--cycles is for --dynamic"),
        (["--unit", "mm"], "--unit is for --dynamic"),
    ],
)
@needs_ccx
def test_options_that_go_together(folder, given, words):
    done = _export(*given)
    assert done.exit_code == 2 and words in done.output
    assert not (folder / "c.inp").exists()
