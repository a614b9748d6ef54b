"""The beam's own periodic orbits against exact elastica dynamics and its other backbones."""

from __future__ import annotations

import beam_oracles as oracles
import numpy as np
import pytest

from romsindy.beam import Beam, Shape, transient
from romsindy.effects import Damper
from romsindy.record.backbone import extract_backbone


def plain(elements: int = 16) -> Beam:
    return Beam.cantilever(elements=elements, gravity=0.0, tip_mass=0.0, spring_stiffness=0.0)


@pytest.mark.slow
def test_shift_of_the_bare_cantilever_is_that_of_the_elastica() -> None:
    beam = plain()
    shares = [0.1, 0.4]
    orbits = beam.normal_mode([share * beam.length for share in shares], progress=False)
    shift = orbits.frequency / orbits.linear_frequency - 1
    exact = np.array([oracles.BACKBONE[s] for s in shares])
    # Five bending modes held together; the sixth rings with what is left.
    np.testing.assert_allclose(shift, exact, rtol=5e-3)
    assert orbits.unrest.max() < 1e-6


@pytest.mark.slow
def test_orbit_closes_when_it_is_followed_for_a_whole_period() -> None:
    beam = Beam.cantilever(elements=12, alpha=0.0, eta=0.0)
    orbits = beam.normal_mode([0.2 * beam.length], progress=False)
    period = 2 * np.pi / orbits.frequency[0]
    motion = beam.simulate(orbits.shapes[0], period * 1.0001, period / 200, progress=False)
    q = motion.coordinates.displacement[:, :3]
    # The sample at one period; modes beyond the five that are held ring with 1e-4 of the first.
    assert np.abs(q[200] - q[0]).max() < 1e-4 * np.abs(q[0]).max()


@pytest.mark.slow
def test_small_orbits_of_the_default_beam_agree_with_reduced_model_and_decay() -> None:
    beam = Beam.cantilever(elements=12, alpha=0.3)
    orbits = beam.normal_mode([0.03 * beam.length, 0.04 * beam.length], progress=False)
    shift = orbits.frequency / orbits.linear_frequency - 1
    # What the single-mode model leaves out is of fourth order in amplitude.
    reduced = beam.reduce(order=5, amplitude=0.004).backbone(orbits.amplitude)
    np.testing.assert_allclose(reduced / orbits.linear_frequency - 1, shift, rtol=2e-3)
    motion = beam.simulate(beam.release_shape(0.05 * beam.length, mode=1), 5.0, progress=False)
    decay = extract_backbone(motion.basis.project(motion))
    assert decay.amplitude.min() < orbits.amplitude.min()  # nothing is extrapolated
    read = np.interp(orbits.amplitude, decay.amplitude[::-1], decay.frequency[::-1])
    # Damping lowers a frequency by zeta^2 / 2 = 8e-6.
    np.testing.assert_allclose(read, orbits.frequency, rtol=1.5e-5)


def test_mode_two_ends_at_its_internal_resonance() -> None:
    """Mode 2 softens until 3 times its frequency is that of mode 3: at 0.1 L it is past that."""
    beam = plain(12)
    omega = beam.modes(count=3).omega
    below = beam.normal_mode([0.04 * beam.length], mode=2, progress=False)
    assert omega[2] / 3 < below.frequency[0] < omega[1]
    with pytest.raises(
        RuntimeError, match=r"at a tip displacement of 0\.045 m.*internal resonance"
    ):
        beam.normal_mode([0.1 * beam.length], mode=2, progress=False)


@pytest.mark.slow
def test_interrupt_keeps_the_orbits_that_were_found(monkeypatch: pytest.MonkeyPatch) -> None:
    beam = plain(6)
    tips = [0.05 * beam.length, 0.1 * beam.length]
    first = beam.normal_mode(tips[:1], progress=False)
    held = transient._Shooting._held

    def interrupted(self: transient._Shooting, ratios: np.ndarray, tip: float) -> Shape:
        if tip == tips[1]:
            raise KeyboardInterrupt
        return held(self, ratios, tip)

    monkeypatch.setattr(transient._Shooting, "_held", interrupted)
    kept = beam.normal_mode(tips, progress=False)
    assert kept.stop_reason == "interrupted after 1 of 2 orbits"
    np.testing.assert_array_equal(kept.frequency, first.frequency)
    with pytest.raises(KeyboardInterrupt):
        beam.normal_mode(tips[1:], progress=False)


def test_bad_input_is_named() -> None:
    beam = plain(4)
    with pytest.raises(ValueError, match="tip_displacements is empty"):
        beam.normal_mode([])
    with pytest.raises(ValueError, match="holds 0"):
        beam.normal_mode([0.0])
    with pytest.raises(ValueError, match="forces = 1 must be at least 2"):
        beam.normal_mode([0.01], forces=1)
    damped = plain(4).with_effect(Damper().on_beam(0.01))
    with pytest.raises(ValueError, match="effects of the beam dissipate"):
        damped.normal_mode([0.01], progress=False)
