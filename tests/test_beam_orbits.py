"""The beam's own periodic orbits against exact elastica dynamics and its other backbones."""

from __future__ import annotations

import beam_oracles as oracles
import numpy as np
import pytest

from romsindy.beam import Beam


def plain(elements: int = 16) -> Beam:
    return Beam.cantilever(elements=elements, gravity=0.0, tip_mass=0.0, spring_stiffness=0.0)


def test_shift_of_the_bare_cantilever_is_that_of_the_elastica() -> None:
    beam = plain()
    shares = [0.1, 0.4]
    orbits = beam.normal_mode([share * beam.length for share in shares])
    shift = orbits.frequency / orbits.linear_frequency - 1
    exact = np.array([oracles.BACKBONE[s] for s in shares])
    # Five bending modes held together; the sixth rings with what is left.
    np.testing.assert_allclose(shift, exact, rtol=5e-3)
    assert orbits.unrest.max() < 1e-6


def test_orbit_closes_when_it_is_followed_for_a_whole_period() -> None:
    beam = Beam.cantilever(elements=12, alpha=0.0, eta=0.0)
    orbits = beam.normal_mode([0.2 * beam.length])
    period = 2 * np.pi / orbits.frequency[0]
    motion = beam.simulate(orbits.shapes[0], period * 1.0001, period / 200, progress=False)
    q = motion.coordinates.displacement[:, :3]
    # The sample at one period; modes beyond the five that are held ring with 1e-4 of the first.
    assert np.abs(q[200] - q[0]).max() < 1e-4 * np.abs(q[0]).max()


def test_small_orbits_of_the_default_beam_follow_its_reduced_model() -> None:
    beam = Beam.cantilever(elements=12)
    orbits = beam.normal_mode([0.02 * beam.length])
    reduced = beam.reduce(order=5, amplitude=0.004)
    shift = orbits.frequency / orbits.linear_frequency - 1
    expected = reduced.backbone(orbits.amplitude) / orbits.linear_frequency - 1
    # The shift is cubic terms alone at this amplitude; mode 2 is not quasi-static at (1/4.3)^2.
    np.testing.assert_allclose(shift, expected, rtol=0.08)


def test_bad_input_is_named() -> None:
    beam = plain(4)
    with pytest.raises(ValueError, match="tip_displacements is empty"):
        beam.normal_mode([])
    with pytest.raises(ValueError, match="holds 0"):
        beam.normal_mode([0.0])
    with pytest.raises(ValueError, match="forces = 1 must be at least 2"):
        beam.normal_mode([0.01], forces=1)
