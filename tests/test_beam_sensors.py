"""Sensors, noise, the modal transform and the simulated experiment."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from romsindy.beam import Beam, Sensor
from romsindy.record.signals import with_noise

POINTS = [0.03, 0.135, 0.24, 0.345, 0.45]  # the paper's


@pytest.fixture(scope="module")
def beam():
    return Beam.cantilever(elements=30)


@pytest.fixture(scope="module")
def motion(beam):
    shape = beam.release_shape(0.1, mode=1)
    return beam.simulate(shape, 0.3, sensors=beam.sensors(POINTS), keep_field=True, progress=False)


def test_a_sensor_reads_its_point(beam):
    array = beam.sensors([Sensor(0.45), Sensor(0.45, (2.0, 0.0)), Sensor(0.1, (3.0, 4.0))])
    x = beam.release_shape(0.1).displacement
    readings = array.rows @ x.ravel()
    u, w = (np.interp(0.1, beam.assembly.s, x[:, i]) for i in (0, 1))
    assert_allclose(readings[:2], [x[-1, 1], x[-1, 0]], rtol=1e-12)
    # linear against quadratic interpolation between nodes 7.5 mm apart
    assert_allclose(readings[2], 0.6 * u + 0.8 * w, rtol=1e-3)


def test_a_bare_position_is_a_transverse_and_an_axial_sensor(beam):
    array = beam.sensors([0.24])
    assert [s.direction for s in array.sensors] == [(0.0, 1.0), (1.0, 0.0)]
    assert array.labels == ["y(0.24)", "x(0.24)"]


def test_recorded_readings_are_those_of_the_field(beam, motion):
    rest = motion.basis.equilibrium.displacement.ravel()
    expected = (motion.field.displacement - rest) @ motion.sensor_array.rows.T
    assert_allclose(motion.sensors.displacement, expected, atol=1e-14)
    assert_allclose(beam.sensors(POINTS).measure(motion), expected, atol=1e-14)


def test_noise_has_its_ratio_and_its_seed():
    rng = np.random.default_rng(0)
    signal = rng.normal(size=(100_000, 2)) * [1.0, 1e-3]
    noisy = with_noise(signal, 35.0, seed=3)
    ratio = np.std(noisy - signal, axis=0) / np.std(signal, axis=0)
    assert_allclose(20 * np.log10(1 / ratio), 35.0, atol=0.05)  # sd of 100 000 samples
    assert np.array_equal(noisy, with_noise(signal, 35.0, seed=3))
    assert not np.array_equal(noisy, with_noise(signal, 35.0, seed=4))


def test_clean_experiment_finds_the_modal_coordinates(beam, motion):
    decay = beam.sensors(POINTS).experiment(motion, modes=3, snr_db=None)
    q = motion.coordinates.displacement
    # modes 4, 5, ... and axial shortening are not told apart: 1e-2 of mode 1
    assert decay.q.shape == (len(motion.t), 3)
    assert_allclose(decay.q[:, 0], q[:, 0], atol=0.01 * np.abs(q[:, 0]).max())


def test_small_motion_in_three_modes_is_found_exactly(beam):
    modes = beam.modes(count=3)
    array = beam.sensors(POINTS)
    phi = array.mode_shapes(modes, 3)
    q = np.random.default_rng(1).normal(size=(50, 3))
    readings = q @ phi.T
    assert_allclose(readings @ np.linalg.pinv(phi).T, q, atol=1e-12)
    fields = np.tensordot(q, modes.shapes, axes=1).reshape(50, -1)
    assert_allclose(fields @ array.rows.T, readings, atol=1e-12)


def test_noisy_experiment_is_repeatable_and_near(beam, motion):
    array = beam.sensors(POINTS)
    one, same = array.experiment(motion, seed=5), array.experiment(motion, seed=5)
    other = array.experiment(motion, seed=6)
    q = motion.coordinates.displacement[:, 0]
    assert np.array_equal(one.q, same.q)
    assert not np.array_equal(one.q, other.q)
    # 35 dB is 1.8 % on each of the ten channels and on the shapes
    assert_allclose(one.q[:, 0], q, atol=0.06 * np.abs(q).max())


def test_sensor_off_the_beam(beam):
    with pytest.raises(ValueError, match=r"sensor at = 0\.5 m is off the beam.*0 and 0\.45"):
        beam.sensors([0.1, 0.5])
    with pytest.raises(ValueError, match="off the beam"):
        beam.sensors([Sensor(-0.01)])


def test_bad_sensors(beam):
    with pytest.raises(ValueError, match="points nowhere"):
        Sensor(0.1, (0.0, 0.0))
    with pytest.raises(ValueError, match="sensors is empty"):
        beam.sensors([])
    with pytest.raises(ValueError, match="modes = 3 cannot be told apart by 2 sensors"):
        beam.sensors([0.3]).mode_shapes(beam.modes(count=3), 3)


def test_sensors_that_were_not_recorded(beam):
    motion = beam.simulate(beam.release_shape(0.01, mode=1), 0.01, progress=False)
    with pytest.raises(ValueError, match=r"simulate with sensors="):
        beam.sensors([0.2]).measure(motion)
