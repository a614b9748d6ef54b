"""Effects hidden in a finite-element beam and in its sensors are named and put back."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import romsindy as rs
from romsindy.beam import Beam
from romsindy.beam.effects import AddedMass, ClampCompliance, Drag
from romsindy.beam.sensors import Sensor
from romsindy.cli import main
from romsindy.diagnosis.parameters import Stiffer, parameter_effects
from romsindy.diagnosis.sensing import find_fault
from romsindy.diagnosis.structure import Setup, diagnose_beam, load_beam
from romsindy.signals import with_noise

PLACES = (0.12, 0.2, 0.28, 0.36, 0.45)
STEP, DURATION = 4e-3, 5.0


def seen(beam):
    return Setup(beam, beam.sensors([Sensor(x) for x in PLACES]))


BEAM = Beam.cantilever(elements=8)
SETUP = seen(BEAM)


def decay(beam, q, seed):
    readings = seen(beam).readings(beam, q, DURATION, STEP)
    return rs.Decay(STEP * np.arange(len(readings)), with_noise(readings, 40, seed), unit="m")


@pytest.fixture(scope="module")
def heavier():
    beam = BEAM.with_effect(AddedMass(mass=4e-4))
    return [decay(beam, q, i) for i, q in enumerate((0.016, 0.011, 0.013))]


@pytest.fixture(scope="module")
def own():
    return SETUP.readings(BEAM, 0.016, DURATION, STEP)


def test_release_shows_the_coordinate_asked_for(own):
    assert SETUP.coordinate(own[0]) == pytest.approx(0.016, rel=1e-6)


def test_hidden_mass_is_named_weighed_and_put_back(heavier):
    report = diagnose_beam(BEAM, SETUP.sensors, heavier[:2], held_out=heavier[2])
    assert report.verdict in ("named", "ambiguous") and report.names == ("added_mass",)
    improved, mass = report.improved()
    assert mass == pytest.approx(4e-4, rel=0.02)  # 0.3 % of the fit, and what one mode reduces to
    noise = np.std(heavier[2].q, axis=0) * 10 ** (-40 / 20)
    before, after = (report.sensor_errors(b, heavier[2], noise) for b in (BEAM, improved))
    assert min(before.values()) > 20
    assert max(after.values()) < 1.25  # 1 is noise alone; the standard error of its rms is 2 %


def test_directions_follow_the_beam():
    """Second-order convergence of omega^2: the direction is the derivative."""
    directions = {p.name: p.direction for p in parameter_effects(BEAM, SETUP.sensors, 0.016)}
    slope = directions["bending_stiffness"].linear_shift(SETUP.basis.omega[0] ** 2)

    def omega2(change):
        return BEAM.with_effect(Stiffer(change)).modes(count=3).omega[0] ** 2

    assert slope == pytest.approx((omega2(0.01) - omega2(-0.01)) / 0.02, rel=0.02)
    softer = BEAM.with_effect(ClampCompliance(1e-3)).modes(count=3).omega[0]
    assert softer < SETUP.basis.omega[0]
    assert set(directions) >= {"spring_stiffness", "pre_tension", "clamp_compliance"}


@pytest.mark.parametrize(
    ("kind", "spoil", "value"),
    [
        ("gain", lambda y: 1.05 * y, 0.05),
        ("offset", lambda y: y + 0.002, 0.002),
        ("saturation", lambda y: np.clip(y, -0.04, 0.04), 0.04),
    ],
)
def test_faulty_sensor_is_told_from_the_others(own, kind, spoil, value):
    readings = with_noise(own, 35, 0)
    assert find_fault(readings, own, SETUP.shapes, SETUP.sensors.labels) is None
    readings[:, 2] = spoil(readings[:, 2])
    fault = find_fault(readings, own, SETUP.shapes, SETUP.sensors.labels)
    assert (fault.channel, fault.kind) == (2, kind)
    assert fault.value == pytest.approx(value, rel=0.1)


def test_physics_is_no_fault_of_a_sensor(own):
    for effect in (Drag(coefficient=2.0), AddedMass(mass=1e-3), ClampCompliance(0.01)):
        beam = BEAM.with_effect(effect)
        readings = with_noise(seen(beam).readings(beam, 0.016, 3.0, STEP), 35, 0)
        assert find_fault(readings, own, SETUP.shapes, SETUP.sensors.labels) is None


def test_channels_must_be_those_of_the_sensors(heavier):
    with pytest.raises(ValueError, match="5 channels, but there are 2 sensors"):
        diagnose_beam(BEAM, BEAM.sensors([Sensor(0.2), Sensor(0.4)]), heavier[:1])
    with pytest.raises(ValueError, match="measured is empty"):
        diagnose_beam(BEAM, SETUP.sensors, [])


def test_command_line_reads_a_beam(heavier, tmp_path):
    table = np.column_stack([heavier[0].t, heavier[0].q])
    header = ",".join(["t [s]", *(f"y{i} [m]" for i in range(5))])
    np.savetxt(tmp_path / "test.csv", table, delimiter=",", header=header, comments="")
    file = tmp_path / "beam.toml"
    columns = f"columns = {[f'y{i}' for i in range(5)]}\n"
    file.write_text(f"[beam]\nelements = 8\n[sensors]\npositions = {list(PLACES)}\n{columns}")
    arguments = ["diagnose", "--measured", str(tmp_path / "test.csv"), "--beam", str(file)]
    done = CliRunner().invoke(main, [*arguments, "--report", str(tmp_path / "page.html")])
    assert done.exit_code == 0, done.output
    assert "more mass at the tip" in done.output and (tmp_path / "page.html").is_file()
    file.write_text("[beam]\nlenght = 1\n")
    with pytest.raises(ValueError, match="lenght"):
        load_beam(file)
    file.write_text("[beam]\nelements = 8\n")
    with pytest.raises(ValueError, match="positions"):
        load_beam(file)


def test_blind_trials_run():
    """One trial of the benchmark, short; a gain of at least 3.5 % is far above 30 dB of noise."""
    script = Path(__file__).resolve().parents[1] / "benchmarks" / "diagnosis" / "structure.py"
    arguments = ["--effects", "sensor_gain", "--duration", "4", "--jobs", "1"]
    done = subprocess.run(
        [sys.executable, str(script), *arguments], capture_output=True, text=True, check=True
    )
    assert "headline right 1 of 1" in done.stdout
