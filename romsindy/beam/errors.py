"""The failures of a solve; bad input is a plain ValueError."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from romsindy.beam.motion import Motion


class NoEquilibriumError(RuntimeError):
    """No static equilibrium was found under the load or displacement asked for."""


class StepTooLongError(RuntimeError):
    """Newton did not converge within a time step.

    Attributes
    ----------
    motion
        The motion up to there.
    step_to_try
        A shorter step [s].
    """

    def __init__(self, message: str, motion: Motion, step_to_try: float) -> None:
        super().__init__(message)
        self.motion = motion
        self.step_to_try = step_to_try
