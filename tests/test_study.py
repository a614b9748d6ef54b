"""The study: its numbers against the beam's own, its files, its interruption."""

from __future__ import annotations

import base64
import csv
import math
import re

import numpy as np
import pytest
from click.testing import CliRunner
from joblib import parallel_config
from numpy.testing import assert_allclose

from romsindy import HarmonicSINDy, ROMLibrary
from romsindy.commands.main import main
from romsindy.physics.model import ReducedModel
from romsindy.record.signals import crossings
from romsindy.regression.estimator import PAPER, WEIGHTED
from romsindy_study import chapters, story, tables
from romsindy_study import command as study_command
from romsindy_study.content import Check, Table
from romsindy_study.experiment import measured_decay, trials
from romsindy_study.harmonics import blocks, choose_harmonics
from romsindy_study.models import identify, identify_all
from romsindy_study.system import simulate_system

# Ten quadratic elements have the linear frequency of the default beam within 1e-4, and twelve
# seconds hold a decade of amplitudes.
SMALL = {"elements": 10, "duration": 12.0, "orbits": 1}


@pytest.fixture(scope="module")
def system():
    return simulate_system(**SMALL)


@pytest.fixture(scope="module")
def plain(system):
    return {c.name: c for c in identify_all(system.decay, system.backbone, system.omega)}


@pytest.mark.slow
def test_the_system_is_the_paper_s(system):
    """Frequencies as printed in the paper; sag about 0.02 L."""
    assert_allclose(system.modes.omega[:2], [38.5, 165.9], rtol=1e-3)
    assert -system.beam.equilibrium().tip[1] / system.beam.length == pytest.approx(0.0217, rel=1e-2)
    assert system.motion.energy.drift < 1e-4


def test_numbers_of_the_study(system, plain):
    """What the independent prototype of this pipeline reached, with its margins."""
    assert plain["stiffness 5"].max_error > 0.01
    assert plain["IC-ROM 5"].max_error <= 0.0025
    assert plain["IC-ROM 9"].max_error <= 0.0006
    truth = system.beam.reduce(order=5, amplitude=float(np.abs(system.decay.q).max()))
    found = plain["IC-ROM 5"].model.coefficients
    for name in ("gamma_3", "Upsilon_3"):
        assert found[name] == pytest.approx(truth.coefficients[name], rel=0.1)
    omega = plain["IC-ROM 7"].model.coefficients["omega^2"] ** 0.5
    assert omega == pytest.approx(system.omega, rel=8e-4)


def test_fixed_frequency_is_kept(system, plain):
    fixed = plain["IC-ROM 5, omega fixed"].model.coefficients["omega^2"]
    assert fixed == pytest.approx(system.omega**2, rel=1e-14)


def test_beam_theory_is_nearly_collinear(plain):
    """Three cubic columns on two harmonics; tied together they are well conditioned."""
    assert tables.condition(plain["beam theory 3"]) > 10 * tables.condition(plain["IC-ROM 3"])
    assert plain["beam theory 3"].model.coefficients["beta_1"] < 0  # Upsilon_3 is positive


def test_unknown_family_is_refused(system):
    with pytest.raises(ValueError, match="family = 'cubic'"):
        identify(system.decay, system.backbone, "cubic", 3)


def test_parameter_errors_by_hand():
    direct = ReducedModel.from_coefficients({"omega^2": 100.0, "gamma_3": 2.0, "Upsilon_3": 4.0})
    found = ReducedModel.from_coefficients(
        {"omega^2": 121.0, "gamma_3": 1.0, "beta_1": 5.0, "beta_2": -4.0, "c_linear": 0.1}
    )
    errors = tables.parameter_errors(found, direct)
    expected = {"omega_1": 10.0, "gamma_3": 50.0, "beta_1": 25.0, "beta_2": 200.0}
    assert errors == pytest.approx(expected)


def test_same_seed_same_numbers(system):
    """However many processes, in whatever order."""
    alone = {t.seed: t for t in trials(system.motion, system.backbone, [2, 0])}
    with parallel_config(backend="threading", n_jobs=2):
        together = {t.seed: t for t in trials(system.motion, system.backbone, [0, 2])}
    for seed, name in ((0, "IC-ROM, plain"), (2, "stiffness, weighted")):
        ours, theirs = (x[seed].candidates[name].model.values for x in (alone, together))
        assert ours == theirs
    assert alone[0].candidates["IC-ROM, plain"].model != alone[2].candidates["IC-ROM, plain"].model


def test_experiment_finds_the_linear_frequency(system):
    """0.6 % in the mean is the paper's own figure."""
    found = [t.candidates["IC-ROM, plain"] for t in trials(system.motion, system.backbone, [0, 2])]
    omega = np.array([c.model.coefficients["omega^2"] ** 0.5 for c in found])
    assert np.mean(np.abs(omega / system.omega - 1)) < 0.006


def test_measured_decay_without_noise_is_the_modal_coordinate(system):
    """Five points tell three modes apart; what the others leave is the error."""
    clean = measured_decay(system.motion, 0, snr_db=None)
    q = system.decay.q[: len(clean.t)]
    assert np.abs(clean.q - q).max() < 0.02 * np.abs(q).max()


@pytest.mark.slow
def test_trials_run_on_a_dask_cluster(system):
    distributed = pytest.importorskip(
        "distributed", reason="dask.distributed is not installed: pip install 'romsindy[dask]'"
    )
    local = next(trials(system.motion, system.backbone, [4]))
    with (
        distributed.Client(n_workers=1, threads_per_worker=1, dashboard_address=None),
        parallel_config("dask"),
    ):
        (remote,) = trials(system.motion, system.backbone, [4])
    name = "IC-ROM, plain"
    assert remote.candidates[name].model.values == local.candidates[name].model.values


def test_blocks_share_no_cycle(system):
    pieces = blocks(system.decay, 12)
    cycles = [len(crossings(p.q, p.dt)[0]) - 1 for p in pieces]
    assert cycles == [12] * len(pieces)
    total = len(crossings(system.decay.q, system.decay.dt)[0]) - 1
    assert total - 12 < sum(cycles) <= total
    with pytest.raises(ValueError, match="four are needed"):
        blocks(system.decay, 40)


def test_cross_validation_asks_for_the_third_harmonic(system):
    """Without it inertia and stiffness are one column: q^3 and q^2 q'' are alike in cos(theta)."""
    estimator = HarmonicSINDy(
        ROMLibrary(damping=()), projection=PAPER.projection, weighted=WEIGHTED.weighted
    )
    search = choose_harmonics(system.decay, estimator, [(0, 1, 2), (0, 1, 2, 3)])
    assert search.best_params_["projection__harmonics"] == (0, 1, 2, 3)
    poor, good = search.cv_results_["mean_test_score"]
    assert good > -0.005 > poor


def test_csv_has_full_precision(tmp_path):
    rows = [["a", 1 / 3, None], ["b", float("nan"), 2.0]]
    path = Table("numbers", "", "", ["name", "x", "y"], rows).write_csv(tmp_path)
    with path.open(encoding="utf-8") as file:
        header, first, second = csv.reader(file)
    assert header == ["name", "x", "y"]
    assert float(first[1]) == 1 / 3 and first[2] == ""
    assert math.isnan(float(second[1]))
    assert Table("numbers", "", "", [], rows).formatted()[1] == ["b", "no motion", "2"]


@pytest.mark.parametrize(
    ("measured", "at_most", "passed"),
    [(0.9, True, True), (1.1, True, False), (1.1, False, True), (0.9, False, False)],
)
def test_check(measured, at_most, passed):
    assert Check("x", measured, 1.0, at_most=at_most).passed is passed


def test_a_model_without_motion_keeps_no_bound():
    nan = float("nan")
    assert not Check("x", nan, 1.0).passed and not Check("x", nan, 1.0, at_most=False).passed


@pytest.fixture
def small(monkeypatch):
    """The quick study on the small beam, with two seeds."""
    monkeypatch.setattr(study_command, "QUICK", SMALL | {"both_releases": False})
    return lambda *args: CliRunner().invoke(main, ["study", "--quick", "--seeds", "2", *args])


@pytest.mark.slow
def test_command_writes_report_tables_and_figures(small, tmp_path, system, plain, monkeypatch):
    monkeypatch.setattr(story, "simulate_system", lambda *args, **kwargs: system)
    result = small("--out", str(tmp_path))
    assert result.exit_code == 0, result.output
    first = "pass  stiffness polynomial of order 5, largest error of the backbone"
    assert first in result.output
    # Where something is not as expected, the last words say what that means.
    passed, failed = (len(re.findall(f"^{v}", result.output, re.M)) for v in ("pass", "FAIL"))
    assert f"{passed} of {passed + failed} numbers are as expected" in result.output
    assert ("FAIL marks the other" in result.output) == bool(failed)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    # Self-contained: what is linked is the paper, or a part of the page.
    assert not re.search(r'(src|href)="(?!data:image|https://doi\.org|#)', page)
    parts = re.findall(r'href="#([^"]+)"', page)
    assert len(parts) == page.count('<h2 id="') and all(f'id="{p}"' in page for p in parts)
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert len(pictures) == len(list(tmp_path.glob("*.png"))) == len(list(tmp_path.glob("*.svg")))
    assert all(base64.b64decode(p).startswith(b"\x89PNG") for p in pictures)
    with (tmp_path / "backbone_errors.csv").open(encoding="utf-8") as file:
        rows = {(r["family"], float(r["order"])): r for r in csv.DictReader(file)}
    for family, order in (("stiffness", 5), ("IC-ROM", 9)):
        written = float(rows[family, order]["max, estimated"])
        assert written == pytest.approx(100 * plain[f"{family} {order}"].max_error, rel=1e-9)
    with (tmp_path / "experiment_seeds.csv").open(encoding="utf-8") as file:
        assert {row["seed"] for row in csv.DictReader(file)} == {"0", "2"}


def test_interrupted_study_writes_what_is_finished(small, tmp_path, system, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(story, "simulate_system", lambda *args, **kwargs: system)
    monkeypatch.setattr(story, "identify_all", interrupted)
    result = small("--out", str(tmp_path))
    assert result.exit_code == 130
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "stopped early" in page and "Decay and backbone" in page
    assert "Simulated experiment" not in page


def test_interrupted_seeds_are_kept(system, monkeypatch):
    def interrupted(motion, backbone, seeds):
        yield from trials(motion, backbone, seeds[:3])
        raise KeyboardInterrupt

    monkeypatch.setattr(story, "trials", interrupted)
    finished = story.finished_trials(system, range(0, 200, 2), lambda steps, *_: steps)
    assert {t.seed for t in finished} == {0, 2, 4}
    assert "Interrupted: 3 of 100 seeds" in chapters.experiment(system, finished, 100).text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["--seeds", "1"], "1 is not in the range"), (["--out", __file__], "is a file")],
)
def test_bad_input_is_refused(arguments, message):
    result = CliRunner().invoke(main, ["study", *arguments])
    assert result.exit_code == 2 and message in result.output
