"""One function for every simulation: find, name and add what it lacks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from romsindy.beam import Beam, SensorArray, Shape
from romsindy.diagnosis.checks import FREE
from romsindy.diagnosis.on_beam.report import BeamReport
from romsindy.diagnosis.on_beam.workflow import diagnose_beam
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.search import Options
from romsindy.diagnosis.workflow import diagnose_model
from romsindy.effects import CATALOGUE
from romsindy.effects.base import Effect
from romsindy.fit.verdict import FALSE_ALARM, FLOOR
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay


def diagnose(
    model: ReducedModel | Beam,
    measured: Decay | Sequence[Decay],
    *,
    sensors: SensorArray | None = None,
    held_out: Decay | None = None,
    release: Shape | None = None,
    free: Sequence[str | Effect] | None = None,
    tolerances: Mapping[str, float] | None = None,
    catalogue: Sequence[Effect] = CATALOGUE,
    false_alarm: float = FALSE_ALARM,
    max_effects: int = 3,
    floor: float = FLOOR,
    n_jobs: int = 1,
    progress: Callable[[str], None] | None = None,
) -> DiagnosisReport | BeamReport:
    """Find, name and add what a simulation lacks.

    Parameters
    ----------
    model : ReducedModel or Beam
        The simulation.
    measured : Decay or sequence of Decay
        For a model: one channel each, in its unit. For a beam: displacements from the equilibrium
        [m], one channel per sensor; the beam is let go from rest at the first sample.
    sensors : SensorArray, optional
        Where the displacements of a beam were measured; needed for a beam, and for it alone.
    held_out : Decay, optional
        A decay to judge by, which takes no part otherwise. Without it the last quarter of each
        record is held out, if it holds six cycles.
    release : Shape, optional
        The shape that a beam is let go from, as of `Beam.release_shape`: its load, of any size,
        held the beam in every record. By default the load is read from the sensors.
    free : names or effects, optional
        What the simulation is unsure of: of "omega^2" and "c_linear", or effects without shape
        values. It follows the data under every hypothesis, and is blamed only where nothing else is
        needed. Of a beam, "omega^2" stands for the bending stiffness and "c_linear" for the damping
        in proportion to mass. Both by default for a model, nothing for a beam. Empty: the
        simulation is taken as exact.
    tolerances : mapping of str to float, optional
        Relative standard deviations of other coefficients of a model, or of parameters of a beam:
        "bending_stiffness", "point_masses", "spring_stiffness", "pre_tension", "mass_damping",
        "material_damping".
    catalogue : sequence of Effect
        What to look for; add your own. On a beam an effect is looked for at its ``mounting``.
    false_alarm : float
        Probability of naming an effect where there is none.
    max_effects : int
        Most effects at once.
    floor : float
        Disagreement that does not matter, as a part of the largest amplitude.
    n_jobs : int
        Processes for the candidates (joblib).
    progress : callable, optional
        Called with a line of text for every candidate under test.

    Returns
    -------
    DiagnosisReport or BeamReport
        For a ReducedModel or a Beam.

    Raises
    ------
    TypeError
        For a simulation that is neither a ReducedModel nor a Beam.
    ValueError
        For arguments that do not belong to the simulation, and for records that cannot be compared
        with it: other unit, sign, scale or mode, too few cycles, noise alone. The message names the
        remedy.
    """
    strange = [effect for effect in catalogue if not isinstance(effect, Effect)]
    if strange:
        raise ValueError(f"catalogue holds {strange[0]!r}, which is no Effect: give AirDrag(), say")
    options = Options(
        tuple(catalogue), false_alarm, max_effects, floor, n_jobs, progress or (lambda _: None)
    )
    several = [measured] if isinstance(measured, Decay) else list(measured)
    near = tolerances or {}
    if isinstance(model, Beam):
        if sensors is None:
            raise ValueError(
                "sensors = None: a Beam needs the sensors that measured it, such as"
                " sensors=beam.sensors([0.2, 0.45])"
            )
        return diagnose_beam(model, several, sensors, held_out, release, free or (), near, options)
    if not isinstance(model, ReducedModel):
        raise TypeError(f"model is a {type(model).__name__}: give a ReducedModel or a Beam")
    if sensors is not None:
        raise ValueError("sensors = ... belong to a Beam: leave them out for a ReducedModel")
    if release is not None:
        raise ValueError("release = ... belongs to a Beam: leave it out for a ReducedModel")
    return diagnose_model(model, several, held_out, FREE if free is None else free, near, options)
