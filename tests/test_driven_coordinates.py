"""Several coordinates under measured inputs, by equations that are written down here."""

import numpy as np
import oracles
import pytest
from click.testing import CliRunner
from scipy.integrate import odeint

import romsindy as rs
from romsindy.commands.main import main
from romsindy.effects.outside import DriveAlong
from romsindy.fit.kernel.collocation import Grid, Trajectory
from romsindy.fit.kernel.equation import ExtendedEquation
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.driven import Sampled
from romsindy.fit.records.modes import modes_near, modes_of
from romsindy.fit.results.fitted import small_vibrations
from romsindy.physics.coupling import Along, MixedStiffness
from romsindy.physics.input import Input
from romsindy.physics.stiffness import Stiffness

SHAPES = np.array([[1.0, 0.7], [0.5, 1.0]])
K1, K2, C1, C2, G1, G2, V = 990.0, 5040.0, 0.8, 1.4, 4e3, 2e4, 900.0
GAINS = (3.0, -2.0)
TRUTH = {
    "omega^2 [q1]": K1,
    "omega^2 [q2]": K2,
    "c_linear [q1]": C1,
    "c_linear [q2]": C2,
    "gamma_3 [q1]": G1,
    "gamma_3 [q2]": G2,
    "V q1^2 q2": V,
}
DT = 0.01
TERMS = [*(Along.coordinate(Stiffness(3), i) for i in (1, 2)), MixedStiffness((2, 1))]
# Frequencies 2 % off, the rest unknown.
START = {k: 1.04 * v if "omega" in k else v if "c_" in k else 0.0 for k, v in TRUTH.items()}


def multisine(seed, low=1.0, high=16.0, lines=80, size=1.0):
    force = oracles.multisine(seed, low, high, lines)
    return lambda t: size * force(t)


def rates(t, y, forces, gains, cubic=1.0):
    """Two coupled Duffing oscillators under forces, each with gains on both."""
    q1, q2, v1, v2 = y
    a1 = -C1 * v1 - K1 * q1 - cubic * (G1 * q1**3 + 2 * V * q1 * q2)
    a2 = -C2 * v2 - K2 * q2 - cubic * (G2 * q2**3 + V * q1**2)
    for force, (b1, b2) in zip(forces, gains, strict=True):
        push = float(force(t))
        a1, a2 = a1 + b1 * push, a2 + b2 * push
    return [v1, v2, a1, a2]


def moved(forces, gains, n, start=(0.0,) * 4, cubic=1.0):
    t = DT * np.arange(n)
    args = (forces, gains, cubic)
    return t, odeint(rates, start, t, args, tfirst=True, rtol=1e-10, atol=1e-12)


def noisy(y, seed, level=0.01):
    return y + level * y.std(axis=0) * np.random.default_rng(seed).standard_normal(y.shape)


def driven(seed, shapes=SHAPES, gains=(GAINS,), n=1400, size=1.0, offset=0.0, derivative=0):
    """A record of channels with 40 dB of noise under as many multisines as there are gains."""
    forces = [multisine(seed + 50 * i, size=size) for i in range(len(gains))]
    t, y = moved(forces, gains, n)
    q = y[:, :2]
    if derivative == 2:
        q = np.array([rates(s, x, forces, gains)[2:] for s, x in zip(t, y, strict=True)])
    x = noisy(q @ np.atleast_2d(shapes).T, seed + 900) + offset
    names = ["force", "force 2"][: len(gains)]
    return rs.ForcedVibration(
        t,
        x,
        np.column_stack([f(t) for f in forces]),
        unit="m",
        measured=("displacement", "velocity", "acceleration")[derivative],
        inputs=names,
        input_unit="N",
        interpolation="band-limited",
    )


def misses(fit, gains=(GAINS,)):
    """Errors over standard errors of all coefficients."""
    truth = dict(TRUTH)
    for name, (b1, b2) in zip(("force", "force 2"), gains, strict=False):
        truth |= {f"gain [{name}] [q1]": b1, f"gain [{name}] [q2]": b2}
    found, error = fit.model.coefficients, fit.standard_errors
    assert {*found} == {*truth}
    return np.array([(found[k] - truth[k]) / e for k, e in error.items()])


@pytest.fixture(scope="module")
def fitted():
    record = driven(1, n=2000, offset=np.array([0.02, -0.01]))
    return rs.refine(rs.CoupledModel.from_coefficients(START, unit="m"), record)


def test_two_channels_give_back_both_equations(fitted):
    # Nine values, each normal: one in 1700 such fits has one beyond four standard errors.
    assert np.abs(misses(fitted)).max() < 4
    np.testing.assert_allclose(fitted.mode_shapes, SHAPES, atol=3e-3)
    np.testing.assert_allclose(fitted.offsets, [[0.02, -0.01]], atol=2e-4)
    ratio = fitted.model.coefficients["gain [force] [q2]"] / GAINS[0]
    assert ratio == pytest.approx(GAINS[1] / GAINS[0], abs=0.01)  # the participation
    low, high = fitted.interval("gain [force] [q2]")
    assert 0 < high - low < 0.02 * abs(GAINS[1])
    delay, error = fitted.delays["force"]
    assert abs(delay) < 4 * error < 0.02 * DT
    assert fitted.verdict.explained and "explains the record" in str(fitted)
    assert small_vibrations(fitted, fitted.records)[1].coordinate == 2


@pytest.mark.slow
def test_the_verdict_names_the_coupling_that_is_missing(fitted):
    """Its force is the derivative of V q1^2 q2, in both equations; see `rates`."""
    alone = {k: v for k, v in fitted.model.coefficients.items() if k != "V q1^2 q2"}
    model = rs.CoupledModel.from_coefficients(alone, unit="m")
    verdict = rs.refine(model, fitted.records[0].decay).verdict
    assert not verdict.explained and not verdict.good and verdict.like == "V q1^2 q2"
    assert "most like V q1^2 q2 (p = " in str(verdict)


def test_a_record_that_took_no_part_is_predicted(fitted):
    other = driven(2, size=1.2, offset=np.array([0.02, -0.01]))
    missed = fitted.predict(other, 60) - other.y
    assert missed.shape == other.y.shape
    # The state is that of 60 samples with a noise of 1 %: noise and a little more.
    assert np.all(missed.std(axis=0) < 0.015 * other.y.std(axis=0))
    with pytest.raises(ValueError, match=r"is driven by \['force'\], and the record has \['base"):
        fitted.predict(rs.ForcedVibration(other.t, other.y, other.u, "m", inputs="base"), 60)
    with pytest.raises(ValueError, match="the record has 1 channels, the fit 2"):
        fitted.predict(rs.ForcedVibration(other.t, other.y[:, 0], other.u, "m"), 60)


@pytest.mark.parametrize("derivative", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_one_channel_shows_two_coordinates(derivative):
    record = driven(3, shapes=[1.0, 1.0], derivative=derivative)
    fit = rs.identify(record, 2, terms=TERMS)
    assert np.abs(misses(fit)).max() < 4
    np.testing.assert_array_equal(fit.mode_shapes, [[1.0, 1.0]])
    assert fit.verdict.explained


@pytest.mark.slow
def test_an_input_that_reaches_one_coordinate_only_and_one_that_reaches_both():
    gains = ((3.0, 0.0), (1.0, 2.5))
    fit = rs.identify(driven(14, gains=gains, size=0.7), 2, terms=TERMS)
    assert np.abs(misses(fit, gains)).max() < 4
    alone, error = (x["gain [force] [q2]"] for x in (fit.model.coefficients, fit.standard_errors))
    assert abs(alone) < 2 * error
    # One gain of an input that is not told from 0 is no record that says nothing.
    assert not fit.verdict.undetermined and {*fit.delays} == {"force", "force 2"}


def test_a_decay_beside_a_driven_record():
    t, y = moved([], [], 1200, start=(0.1, 0.05, 0.0, 0.0))
    decay = rs.Decay(t, noisy(y[:, :2] @ SHAPES.T, 7), unit="m", stage="free")
    fit = rs.identify([driven(5), decay], 2, terms=TERMS, fixed={"c_linear [q1]": C1})
    assert "c_linear [q1]" not in fit.standard_errors
    assert np.abs(misses(fit)).max() < 4
    assert fit.decays[0].n_channels == 2 and len(fit.states) == 2


@pytest.mark.parametrize("second", [-0.25, 0.0])
def test_a_second_mode_in_the_band_of_one_coordinate_is_told(second):
    """Asked for one: what is left answers the force as the other mode does, or there is none."""
    one = driven(5, shapes=[[1.0, second]], gains=[(3.0, -2.0 if second else 0.0)], size=0.2)
    fit = rs.identify(one)
    said = [note for note in fit.notes if note.startswith("another mode rings near")]
    assert len(said) == bool(second) and fit.verdict.explained == (not second)
    if second:
        assert "coordinates=2" in said[0] and said[0] in str(fit)
        # A part of its bandwidth, 1.4 / 2 pi Hz.
        assert float(said[0].split()[4]) == pytest.approx(np.sqrt(K2) / (2 * np.pi), abs=0.05)


@pytest.mark.slow
def test_coordinates_and_terms_are_chosen():
    fit = rs.identify(driven(6, n=3000), "auto")
    assert np.abs(misses(fit)).max() < 4
    assert fit.verdict.explained


@pytest.mark.study
@pytest.mark.slow
def test_modes_that_a_strongly_nonlinear_motion_hides_are_told():
    """The stiffness doubles, and both linear modes are looked for where the first one resounds."""
    fit = rs.identify(driven(44, shapes=[1.0, 1.0], n=400, size=3.0), 2)
    assert not fit.verdict.explained
    told = "fewer channels than coordinates (1 and 2) are told apart by their linear modes, found"
    assert any(told in note and "give a channel for each" in note for note in fit.notes)


@pytest.mark.slow
def test_the_command_takes_several_channels(tmp_path):
    record, file = driven(20, n=1500), tmp_path / "shaker.csv"
    columns = np.column_stack([record.t, record.y, record.u])
    header = "time [s],left [m],right [m],force [N]"
    np.savetxt(file, columns, delimiter=",", header=header, comments="")
    assert rs.load_forced(file, "force", column=["left", "right"]).n_channels == 2
    options = ["--input", "force", "--column", "left", "--column", "right", "--coordinates", "2"]
    page, kept = tmp_path / "page.html", tmp_path / "kept.json"
    more = ["--interpolation", "band-limited", "--report", str(page), "--save", str(kept)]
    more += ["--held-out", "0.2"]
    result = CliRunner().invoke(main, ["identify", str(file), *options, *more])
    assert result.exit_code == 0, result.output
    assert "The model explains the record" in result.stdout and "Modes:" in result.stdout
    text = page.read_text()
    assert all(x in text for x in ("gain [force] [q2]", "force [q2]", "Over time: channel 2"))
    assert "took no part in the fit" in result.stdout and ">nan<" not in text
    assert np.abs(misses(rs.Estimate.load(kept))).max() < 4


def test_linear_modes_are_those_of_the_equations():
    """Without noise, but for what straight lines between samples miss of the force."""
    t, y = moved([multisine(8)], [GAINS], 2000, cubic=0.0)
    record = rs.ForcedVibration(t, y[:, :2] @ SHAPES.T, multisine(8)(t), unit="m")
    modes = modes_of([record], 2)
    np.testing.assert_allclose(modes.omega**2, [K1, K2], rtol=1e-4)
    np.testing.assert_allclose(2 * modes.ratios * modes.omega, [C1, C2], rtol=1e-2)
    np.testing.assert_allclose(modes.shapes, SHAPES, atol=5e-3)
    np.testing.assert_allclose(modes.gains["force"], GAINS, rtol=0.06)  # straight at 11 Hz
    near = modes_near([record], 1.1 * modes.omega)
    np.testing.assert_allclose(near.omega, modes.omega, rtol=1e-6)


def test_derivatives_by_gain_and_delay_are_finite_differences():
    t = DT * np.arange(200)
    grid = Grid.over(t, 0.08, 8)
    rng = np.random.default_rng(3)
    inputs = {"force": Sampled(multisine(9)(t), DT, grid)}
    drive = DriveAlong(Input(), 0.003, 0.1, directions=((1.0, 0.0), (0.3, 1.0)))
    part = Part(drive, drive.parameters(), np.array([[2.0, -1.5]]))
    model = rs.CoupledModel.from_coefficients({"omega^2 [q1]": K1, "omega^2 [q2]": K2}, unit="m")
    n = grid.n_steps
    motion = Trajectory(
        grid, *(rng.standard_normal(s) for s in ((n + 1, 2), (n + 1, 2), (n, 3, 2)))
    )
    at = (grid.node_times(0, n).ravel(), *(rng.standard_normal((3 * n, 2)) for _ in range(3)))

    def residual(change):
        moved = part.moved(np.array(change))
        return ExtendedEquation(model, (moved,), 0, motion.grid.step, 0.0, inputs=inputs).linearise(
            *at
        )[0]

    equation = ExtendedEquation(model, (part,), 0, motion.grid.step, 0.0, inputs=inputs)
    slopes = equation.by_parameter(*at)
    assert slopes.shape == (3, 3 * n, 2)
    for i, step in enumerate((1e-3, 1e-3, 1e-6)):
        ends = [residual(s * step * np.eye(3)[i]) for s in (1, -1)]
        np.testing.assert_allclose(slopes[i], (ends[0] - ends[1]) / (2 * step), 1e-4, 0.02)


def test_what_cannot_be_had_is_refused_with_a_remedy():
    record = driven(10, n=800)
    alone = rs.ForcedVibration(record.t, record.y[:, 0], record.u, "m", input_unit="N")
    model = rs.CoupledModel.from_coefficients(START, unit="m")
    with pytest.raises(ValueError, match="y has 2 channels, and one is needed here: choose one, y"):
        rs.refine(rs.ReducedModel.from_coefficients({"omega^2": K1}, unit="m"), record)
    with pytest.raises(ValueError, match="decay 1 has 1 channels, others 2: give the same of all"):
        rs.refine(model, [record, alone])
    with pytest.raises(ValueError, match="decay 1 is the same record as an earlier one"):
        rs.refine(model, [record, record])
    with pytest.raises(ValueError, match=r"fixed names \['gain \[force\] \[q1\]'\], and gains"):
        own = rs.CoupledModel.from_coefficients({**START, "gain [force] [q1]": 1.0}, unit="m")
        rs.refine(own, record, fixed=["gain [force] [q1]"])
    with pytest.raises(ValueError, match="coordinates = 0: give 'auto' or a whole number"):
        rs.identify(record, 0)
