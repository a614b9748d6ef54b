"""Error of a beam's frequency against the time that its simulation takes, beside Exudyn.

    python benchmarks/work_precision.py [--elements 40] [--elements 150] [--duration 25]
                                        [--figure work.png]

A bare cantilever in 6 g is let go straight and swings through a quarter of its length, undamped.
The frequency is the mean over all its cycles; the truth is that of the finest own simulation.
Exudyn's elements have two nodes and its steps are of second order (generalised alpha), its best for
this; the own elements have three, and the steps are of fifth order. Run it on one thread
(OMP_NUM_THREADS=1), and on a machine that does nothing else.
"""

from __future__ import annotations

import itertools
import sys
import time
import warnings
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from beam_oracles import frequency

from romsindy.beam import Beam

GRAVITY = 6 * 9.81  # m/s^2
OWN = ((4e-3, 1e-2), (2e-3, 1e-3), (1e-3, 1e-4))  # step in s, relative error of the energy
EXUDYN = (2e-3, 1e-3, 5e-4, 2.5e-4)  # s; at 4 ms its Newton method fails
FINEST = (1e-3, 1e-5)


class Run(NamedTuple):
    """One simulation: what, its elements, seconds that it took, and its mean frequency, rad/s."""

    what: str
    elements: int
    seconds: float
    omega: float


def heavy_cantilever(elements: int) -> Beam:
    """The bare default beam in 6 g."""
    return Beam.cantilever(
        tip_mass=0.0, spring_stiffness=0.0, gravity=GRAVITY, alpha=0.0, eta=0.0, elements=elements
    )


def own(elements: int, step: float, tolerance: float, duration: float) -> Run:
    """Let go straight, simulated here."""
    beam = heavy_cantilever(elements)
    straight = beam.shape(np.zeros((2 * elements + 1, 3)))
    tip = beam.sensors([beam.length])
    motion = beam.simulate(
        straight, duration, step, energy_tolerance=tolerance, sensors=tip, progress=False
    )
    what = f"own, {step * 1e3:g} ms, energy {tolerance:g}"
    return Run(
        what, elements, motion.cost.seconds, frequency(motion.t, motion.sensors.displacement[:, 0])
    )


def exudyn(elements: int, step: float, duration: float) -> Run:
    """The same in Exudyn."""
    warnings.simplefilter("ignore", DeprecationWarning)  # names that older versions share
    import exudyn as exu
    from exudyn.utilities import (
        CoordinateConstraint,
        LoadMassProportional,
        MarkerBodyMass,
        MarkerNodeCoordinate,
        NodePointGround,
        NodeRigidBody2D,
        ObjectBeamGeometricallyExact2D,
        SensorNode,
    )

    beam = heavy_cantilever(elements)
    section = beam.section
    length = beam.length / elements
    mbs = exu.SystemContainer().AddSystem()
    nodes = [
        mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[i * length, 0.0, 0.0]))
        for i in range(elements + 1)
    ]
    for pair in itertools.pairwise(nodes):
        body = mbs.AddObject(
            ObjectBeamGeometricallyExact2D(
                nodeNumbers=list(pair),
                physicsLength=length,
                physicsMassPerLength=section.mass,
                physicsCrossSectionInertia=section.rotary_inertia,
                physicsBendingStiffness=section.EI,
                physicsAxialStiffness=section.EA,
                physicsShearStiffness=section.GA,
            )
        )
        marker = mbs.AddMarker(MarkerBodyMass(bodyNumber=body))
        mbs.AddLoad(LoadMassProportional(markerNumber=marker, loadVector=[0.0, -GRAVITY, 0.0]))
    ground = mbs.AddMarker(
        MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0)
    )
    for coordinate in range(3):
        held = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=coordinate))
        mbs.AddObject(CoordinateConstraint(markerNumbers=[ground, held]))
    tip = mbs.AddSensor(
        SensorNode(
            nodeNumber=nodes[-1],
            storeInternal=True,
            outputVariableType=exu.OutputVariableType.Displacement,
        )
    )
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = round(duration / step)
    settings.timeIntegration.endTime = duration
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.8
    settings.timeIntegration.verboseMode = 0
    # with its default of 1e-8, Newton stalls at the rounding of EA and halves steps for ever
    settings.timeIntegration.newton.relativeTolerance = 1e-5
    settings.timeIntegration.newton.absoluteTolerance = 1e-6
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = step
    settings.linearSolverType = exu.LinearSolverType.EigenSparse
    began = time.perf_counter()
    mbs.SolveDynamic(settings)
    seconds = time.perf_counter() - began
    t, _, w = mbs.GetSensorStoredData(tip)[:, :3].T
    return Run(f"Exudyn, {step * 1e3:g} ms", elements, seconds, frequency(t, w - _rest()))


def _rest() -> float:
    """Where the tip hangs at rest, m."""
    beam = heavy_cantilever(40)
    return float(beam.equilibrium().tip[1])


def fastest_as_good(run: Run, others: list[Run], truth: float) -> Run | None:
    """The fastest of some runs whose error is no larger; None if there is none."""
    error = abs(run.omega / truth - 1)
    as_good = [other for other in others if abs(other.omega / truth - 1) <= error]
    return min(as_good, key=lambda other: other.seconds, default=None)


def table(runs: list[Run], truth: float, duration: float) -> None:
    """Print every run, and the fastest own run that is as good as each of Exudyn's."""
    print(f"{'':26} elements   s per s   error of the frequency   own run as good: s per s, share")
    for run in runs:
        line = f"{run.what:26} {run.elements:8d} {run.seconds / duration:9.3f}"
        line += f" {abs(run.omega / truth - 1):24.1e}"
        if run.what.startswith("Exudyn"):
            ours = [r for r in runs if r.what.startswith("own") and r.elements == run.elements]
            best = fastest_as_good(run, ours, truth)
            line += "   none" if best is None else ""
            if best is not None:
                line += f" {best.seconds / duration:16.3f} {best.seconds / run.seconds:13.2f}"
        print(line, flush=True)


def draw(runs: list[Run], truth: float, duration: float, path: Path) -> None:
    """Error against time, a line for each code and number of elements."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    ax = figure.subplots()
    by_line = itertools.groupby(runs, key=lambda run: (run.what.split(",")[0], run.elements))
    for (name, elements), group in by_line:
        points = sorted((r.seconds / duration, abs(r.omega / truth - 1)) for r in group)
        style = {"own": "C0o", "Exudyn": "C1s"}[name] + ("-" if elements < 100 else "--")
        ax.loglog(*zip(*points, strict=True), style, label=f"{name}, {elements} elements")
    ax.set(xlabel="s per simulated s", ylabel="error of the frequency, relative")
    figure.legend(loc="outside upper center", ncols=2)
    figure.savefig(path)


@click.command(help=__doc__)
@click.option("--elements", multiple=True, default=(40, 150), show_default=True)
@click.option("--duration", default=25.0, show_default=True, help="Simulated time, s.")
@click.option("--figure", type=click.Path(path_type=Path), help="Write the diagram there.")
def main(elements: tuple[int, ...], duration: float, figure: Path | None) -> None:
    own(2, 1e-3, 1e-2, 1.0)  # compiles
    truth = own(2 * max(elements), *FINEST, duration).omega
    runs = []
    for count in elements:
        runs += [own(count, *settings, duration) for settings in OWN]
        runs += [exudyn(count, step, duration) for step in EXUDYN]
    table(runs, truth, duration)
    if figure:
        draw(runs, truth, duration, figure)


if __name__ == "__main__":
    main()
