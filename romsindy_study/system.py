"""The structure of the study: its decay, its backbone and its direct reduced-order models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from romsindy.beam import Beam, ModalBasis, Motion
from romsindy.beam.transient import NormalMode
from romsindy.physics.model import ReducedModel
from romsindy.record.backbone import Backbone, extract_backbone
from romsindy.record.decay import Decay
from romsindy_study.models import ORDERS

# Sensors of the simulated experiment, m; each reads the vertical and the axial displacement.
SENSORS = (0.03, 0.135, 0.24, 0.345, 0.45)
# An undamped stretch that shows how other modes follow the first, s.
COUPLING_DURATION = 1.0


@dataclass(frozen=True, eq=False)
class System:
    """What is known about the structure before anything is identified.

    Attributes
    ----------
    beam, modes : Beam, ModalBasis
        With the first ten modes about the sagged equilibrium.
    motion, decay, backbone : Motion, Decay, Backbone
        Damped, with the sensors of the simulated experiment; its mode 1, kg^0.5 m, with cycles.
    undamped : Motion
        A short undamped motion from a release by the modal force, where only slaves sound along.
    direct : mapping of int to ReducedModel
        Direct reduced-order models by order, fitted over the amplitudes of the decay.
    normal_mode : NormalMode
        Periodic orbits of the undamped beam: the backbone that no reduction and no decay blurs.
    """

    beam: Beam
    modes: ModalBasis
    motion: Motion
    undamped: Motion
    decay: Decay
    backbone: Backbone
    direct: Mapping[int, ReducedModel]
    normal_mode: NormalMode

    @property
    def omega(self) -> float:
        """True linear frequency of mode 1, rad/s."""
        return float(self.modes.omega[0])


def simulate_release(
    beam: Beam,
    modes: ModalBasis,
    duration: float,
    release_mode: int | None = None,
    *,
    progress: bool = False,
) -> Motion:
    """Let a beam go from a tip displacement of a third of its length.

    It moves for a duration in s and is recorded in ``modes``. The modal force of ``release_mode``
    holds it before; by default a force at the tip does, which lets mode 2 go along.

    Raises
    ------
    KeyboardInterrupt
        If the simulation was interrupted: a part of the decay is no basis for the study.
    """
    shape = beam.release_shape(beam.length / 3, mode=release_mode)
    sensors = beam.sensors(SENSORS)
    motion = beam.simulate(shape, duration, modes=modes, sensors=sensors, progress=progress)
    if motion.stop_reason != "completed":
        raise KeyboardInterrupt(motion.stop_reason)
    return motion


def simulate_system(
    elements: int = 150, duration: float = 25.0, orbits: int = 5, *, progress: bool = False
) -> System:
    """Simulate the default beam, let go by a force at its tip, and compute what is true of it.

    The mesh has 150 quadratic elements in the paper. ``duration`` is that of the decay, s;
    ``orbits`` is the number of periodic orbits, evenly spaced in tip displacement.

    Raises
    ------
    KeyboardInterrupt
        As `simulate_release`.
    """
    beam = Beam.cantilever(elements=elements)
    modes = beam.modes(count=10)
    motion = simulate_release(beam, modes, duration, progress=progress)
    undamped = simulate_release(
        replace(beam, alpha=0.0, eta=0.0), modes, COUPLING_DURATION, 1, progress=progress
    )
    decay = modes.project(motion)
    reach = float(np.abs(decay.q).max())
    direct = {order: beam.reduce(order=order, amplitude=reach) for order in ORDERS}
    # Up to 90 % of the release, the amplitude of the first whole cycles.
    tips = 0.9 * beam.length / 3 * np.arange(1, orbits + 1) / orbits
    normal_mode = beam.normal_mode(tips.tolist(), progress=progress)
    if normal_mode.stop_reason != "completed":
        raise KeyboardInterrupt(normal_mode.stop_reason)
    return System(
        beam, modes, motion, undamped, decay, extract_backbone(decay), direct, normal_mode
    )
