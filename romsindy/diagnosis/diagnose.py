"""One function for every simulation: find, name and add what it lacks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from time import monotonic
from typing import Any

import numpy as np

from romsindy.beam.beam import Beam
from romsindy.beam.equilibrium import Shape
from romsindy.beam.motion import SensorArray
from romsindy.diagnosis.arguments import (
    FREE,
    check_numbers,
    decays_of,
    driven_of,
    forced_alone,
    of_estimate,
    of_references,
    of_repeats,
    refuse_beside,
    shared_part,
    stated,
)
from romsindy.diagnosis.difference import Tolerance
from romsindy.diagnosis.evidence import NO_FORM_ERROR
from romsindy.diagnosis.gap import HELD_OUT, name_of
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam, checked_readings
from romsindy.diagnosis.on_beam.report import BeamReport
from romsindy.diagnosis.on_beam.workflow import diagnose_beam
from romsindy.diagnosis.on_simulator.report import SimulatorReport
from romsindy.diagnosis.on_simulator.workflow import checked_values, diagnose_simulator
from romsindy.diagnosis.other_mode import InteractionReport, with_other_mode
from romsindy.diagnosis.report import DiagnosisReport
from romsindy.diagnosis.residual_report import CoupledDiagnosis, ForcedReport
from romsindy.diagnosis.residual_workflow import (
    diagnose_coupled,
    diagnose_forced,
    of_coupled_repeats,
    tolerances_of,
)
from romsindy.diagnosis.residual_workflow import of_repeats as of_driven_repeats
from romsindy.diagnosis.search import Options, Request
from romsindy.diagnosis.simulated import model_of_simulation
from romsindy.diagnosis.workflow import diagnose_model
from romsindy.effects import CATALOGUE
from romsindy.effects.base import Effect
from romsindy.fit.results.estimate import Estimate
from romsindy.fit.results.fitted import Fit
from romsindy.fit.verdict import FALSE_ALARM, FLOOR, SAME_SIGNAL
from romsindy.physics.coupled import CoupledModel
from romsindy.physics.equations import Equations
from romsindy.physics.model import ReducedModel
from romsindy.record.decay import Decay
from romsindy.record.forced import ForcedVibration
from romsindy.record.recording import Measurement
from romsindy.simulator import Program, Simulator

Simulation = Simulator | Callable[..., Any] | str  # of a user: an object, a function, a command


def diagnose(
    model: ReducedModel | CoupledModel | Estimate | Beam | Decay | Simulation,
    measured: Decay | ForcedVibration | Sequence[Decay] | Sequence[ForcedVibration],
    *,
    sensors: SensorArray | None = None,
    held_out: Decay | ForcedVibration | None = None,
    release: Shape | None = None,
    free: Sequence[str | Effect] | None = None,
    tolerances: Mapping[str, float] | None = None,
    parameters: Mapping[str, float | tuple[float, float]] | None = None,
    tolerance: Tolerance | float | Mapping[str, float] | None = None,
    repeats: Sequence[Decay] | Sequence[ForcedVibration] | None = None,
    reference: Decay | Sequence[Decay] | None = None,
    catalogue: Sequence[Effect] = CATALOGUE,
    false_alarm: float = FALSE_ALARM,
    max_effects: int = 3,
    floor: float | None = None,
    n_jobs: int = 1,
    budget: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> (
    DiagnosisReport
    | CoupledDiagnosis
    | InteractionReport
    | BeamReport
    | ForcedReport
    | SimulatorReport
):
    """Find, name and add what a simulation lacks.

    Against forced vibrations an input of the model is taken as known, gain, delay and all, and may
    turn out to be wrong; inputs that it does not have are fitted.

    Parameters
    ----------
    model : ReducedModel, CoupledModel, Estimate, Beam, Decay, function, object or command
        The simulation. A `Fit`, an `Identification` or another `Estimate` stands for its model,
        and knows how far that may be off. A decay is a simulated series, which is reduced to an
        equation of one coordinate first. A function ``simulate(release, t)``, an object with that
        method, or a command is a `Simulator` of one's own, see `romsindy.simulator`; where it takes
        a ``force``, what is found is added, and it runs again.
    measured : Decay, ForcedVibration, or sequence of either
        For a model: one channel each, in its unit; of a `CoupledModel` any number of channels, in
        which its coordinates ring together. For a beam: displacements from the equilibrium
        [m], one channel per sensor, or velocities or accelerations where a decay says so. Forced
        vibrations are compared with a model, and take all but ``sensors``, ``release`` and
        ``reference``.
    sensors : SensorArray, optional
        Where the displacements of a beam were measured; needed for a beam, and for it alone.
    held_out : Decay or ForcedVibration, optional
        A record to judge by, of the kind of the others, which takes no part otherwise. Without it
        every fourth stretch of a few cycles of each decay is held out, if it has 18 cycles; of
        forced vibrations nothing is.
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
        "length", "thickness", "width", "density", "modulus", "bending_stiffness",
        "axial_stiffness", "point_masses", "rotary_inertia", "spring_stiffness", "pre_tension",
        "clamp_compliance" (of a rigid clamp in rad/(N m)), "mass_damping", "material_damping"; in
        m those of positions, "anchor_x", "anchor_y" and "sensor_positions".
    parameters : mapping of str to (float, float) or float, optional
        Values that a simulator of one's own takes, under the names that it gives them: the value
        as assumed, and its relative standard deviation: it follows the data within that. A value
        alone may be off by any amount, and is looked for like an effect.
    tolerance : Tolerance, float or mapping of str to float, optional
        Difference that does not matter: relative, of the frequency; or of "frequency", "damping"
        (of the damping ratio, relative) and "signal" (rms of the waveform, as a part of the largest
        amplitude). Where the simulation is within it, nothing is looked for. By default what
        tests repeat to: 0.1 %, 5 % and 1 %, or ``floor`` if that is more, or what an `Estimate`
        itself is known to; what is smaller is told only where an effect is there beyond doubt. Of
        forced vibrations "frequency" and "damping" are those of the equation, "signal" what it
        leaves with other values of these; by default all counts that stands out of the noise.
    repeats : sequence of Decay or ForcedVibration, optional
        The same test, measured two times or more: what these differ by does not matter.
    reference : Decay or sequence of Decay, optional
        What a model was identified from, or a beam updated to: what it leaves there does not
        matter elsewhere.
    catalogue : sequence of Effect
        What to look for; add your own. On a beam an effect is looked for at its ``mounting``.
    false_alarm : float
        Probability of naming an effect where there is none.
    max_effects : int
        Most effects at once.
    floor : float, optional
        Disagreement that does not matter, as a part of the largest amplitude. By default 2e-4, and
        of a simulated series what its equation may leave.
    n_jobs : int
        Processes for the candidates (joblib).
    budget : float, optional
        s, after which no further candidate is begun: what is best then is told, as interrupted.
        What promises most comes first. The gap, and a beam with what was found, come after.
    progress : callable, optional
        Called with a line of text for every candidate under test.

    Returns
    -------
    DiagnosisReport, CoupledDiagnosis or BeamReport
        For an equation or a series, for several coordinates, or for a Beam; an `InteractionReport`
        where a model lacks another mode, a `ForcedReport` for forced vibrations.

    Raises
    ------
    TypeError
        For a simulation that is none of these.
    ValueError
        For arguments that do not belong to the simulation, and for records that cannot be compared
        with it: other unit, sign, scale or mode, too few cycles, noise alone. The message names the
        remedy.

    Examples
    --------
    >>> from romsindy.physics.example import EXAMPLE_MODEL, example_decay
    >>> diagnose(EXAMPLE_MODEL, example_decay(40, periods=20, samples=30)).verdict
    'none'
    """
    _check_searched(catalogue, progress)
    check_numbers(FLOOR if floor is None else floor, false_alarm, max_effects, n_jobs, budget)
    references = decays_of("reference", reference) if reference is not None else []
    driven = forced_alone(measured)
    simulator = simulator_of(model)
    if simulator is None and parameters is not None:
        raise ValueError(
            "parameters = ... are values of a simulator of one's own: for a model or a Beam say"
            " tolerances"
        )
    if isinstance(model, Measurement) and not model.driven:
        if driven:
            raise ValueError("model is a Decay, which has no input: give the equation instead")
        series = model
        known = model_of_simulation([series])
        model, references = known.model, [*known.reference, *references]
        tolerances = known.tolerances if tolerances is None else tolerances
        floor = known.floor if floor is None else floor
    simulation: Any = None if simulator is not None else _equation_or_beam(model)
    floor, near = FLOOR if floor is None else floor, tolerances or {}
    given = Tolerance(signal=max(SAME_SIGNAL, floor)) if tolerance is None else stated(tolerance)
    end = np.inf if budget is None else monotonic() + budget
    options = Options(
        tuple(catalogue), false_alarm, max_effects, floor, n_jobs, progress or _silent, given, end
    )
    without = {"sensors": sensors, "release": release, "reference": reference}
    # Values of a simulator that are stated stand for what it is unsure of.
    usual = () if parameters or isinstance(simulation, Beam) else FREE
    request = Request(driven, held_out, usual if free is None else free, near, options)
    if driven:
        refuse_beside("forced vibrations", "diagnose decays", **without)
        return _of_driven(simulation, request, repeats)
    if held_out is not None and (not isinstance(held_out, Measurement) or held_out.driven):
        raise ValueError(f"held_out is a {type(held_out).__name__}: give one Decay")
    request = replace(request, measured=decays_of("measured", measured))
    again = decays_of("repeats", repeats) if repeats is not None else None
    if simulator is not None:
        refuse_beside("a simulator", "say it in the simulator", **without, tolerances=tolerances)
        if again is not None:
            request = request.tolerating(of_repeats([d.channel(0) for d in again], floor))
        return diagnose_simulator(simulator, request, checked_values(parameters or {}))
    if isinstance(simulation, Beam):
        if sensors is None:
            raise ValueError(
                "sensors = None: a Beam needs the sensors that measured it, such as"
                " sensors=beam.sensors([0.2, 0.45])"
            )
        if again is not None:
            request = request.tolerating(_runs_of_sensors(simulation, sensors, again, floor))
        return diagnose_beam(simulation, request, sensors, release, references)
    if simulation.n_coordinates > 1:
        refuse_beside("a model of several coordinates", "model one coordinate", **without)
        if isinstance(model, Estimate) and tolerances is None:
            request = replace(request, tolerances=tolerances_of(simulation, model))
        if again is not None:
            request = request.tolerating(of_coupled_repeats(simulation, again, options))
        return diagnose_coupled(simulation, request)
    if sensors is not None:
        raise ValueError("sensors = ... belong to a Beam: leave them out for an equation")
    if release is not None:
        raise ValueError("release = ... belongs to a Beam: leave it out for an equation")
    if again is not None:
        request = request.tolerating(of_repeats(again, floor))
    if isinstance(model, Estimate):
        if tolerance is None:
            request = request.tolerating(of_estimate(model, _largest(simulation, request.measured)))
        references += model.decays if isinstance(model, Fit) else ()
    return _of_decays(simulation, request, references)


def simulator_of(model: object) -> Simulator | None:
    """A simulator of one's own, from a function, an object or a command; None for others.

    Raises a ValueError for one that cannot be asked.
    """
    if isinstance(model, (Estimate, Equations, Beam, Measurement)):
        return None
    if isinstance(model, str) and "{" in model:
        return Simulator.of(Program(model))
    if isinstance(model, Simulator) or callable(model) or callable(getattr(model, "simulate", 0)):
        return Simulator.of(model)
    return None


def _equation_or_beam(model: object) -> Any:
    """What is simulated: the equation of an estimate, or what was given."""
    simulation = model.model if isinstance(model, Estimate) else model
    if not isinstance(simulation, (Equations, Beam)):
        raise TypeError(
            f"model is a {type(model).__name__}: give a ReducedModel, Beam, Decay, or a function"
            " simulate(release, t)"
        )
    return simulation


def _silent(_: str) -> None:
    """Nobody is told of progress."""


def _of_driven(simulation: Equations | Beam, request: Request, repeats: object) -> ForcedReport:
    """Against driven records."""
    if request.held_out is not None:
        request = replace(request, held_out=driven_of("held_out", request.held_out)[0])
    if repeats is not None:
        runs = driven_of("repeats", repeats)
        request = request.tolerating(of_driven_repeats(simulation, runs, request.options))
    return diagnose_forced(simulation, request)


def _runs_of_sensors(
    beam: Beam, sensors: SensorArray, again: Sequence[Decay], floor: float
) -> Tolerance:
    """What repeats of a beam differ by, in its first mode."""
    seen = InstrumentedBeam(beam, sensors)
    runs = [checked_readings(d, i, sensors, beam.length) for i, d in enumerate(again)]
    return of_repeats([seen.decay(d) for d in runs], floor)


def _of_decays(
    simulation: ReducedModel, request: Request, references: Sequence[Decay]
) -> DiagnosisReport | InteractionReport:
    """An equation against decays, of one coordinate or with another mode."""
    form = NO_FORM_ERROR
    if references:
        left, form = of_references(simulation, references, request.options.floor)
        request = request.tolerating(left)
    report = with_other_mode(diagnose_model(simulation, request, form), request.options)
    return replace(report, notes=(*_left_out(simulation, request), *report.notes))


def _check_searched(catalogue: object, progress: object) -> None:
    """Raise a ValueError for what is no catalogue, or nothing to call."""
    if isinstance(catalogue, str) or not isinstance(catalogue, Iterable):
        raise ValueError(f"catalogue = {catalogue!r} must be a list of effects")
    if progress is not None and not callable(progress):
        raise ValueError(f"progress = {progress!r} must be a function of a line of text")
    strange = [effect for effect in catalogue if not isinstance(effect, Effect)]
    if strange:
        raise ValueError(f"catalogue holds {strange[0]!r}, which is no Effect: give AirDrag(), say")


def _largest(model: ReducedModel, decays: Sequence[Decay]) -> float:
    """Amplitude up to which decays are compared, unit of q."""
    most = np.inf if model.amplitude_range is None else model.amplitude_range[1]
    return min(most, max((float(np.ptp(d.single().q)) / 2 for d in decays), default=1.0))


def _left_out(model: ReducedModel, request: Request) -> tuple[str, ...]:
    """What of the records is not compared, for the model does not reach so far."""
    records = {name_of(i): d for i, d in enumerate(request.measured)}
    records |= {} if request.held_out is None else {HELD_OUT: request.held_out}
    told = {name: shared_part(model, d).left_out for name, d in records.items()}
    return tuple(f"{name} {text}." for name, text in told.items() if text)
