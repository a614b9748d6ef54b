"""Print every number that the beam simulator promises, beside what was measured.

    python benchmarks/beam.py            all of it, about four minutes
    python benchmarks/beam.py speed      only the parts named: statics modes reduction backbone
                                         normal_mode accuracy speed

Run it on one thread (OMP_NUM_THREADS=1).
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
import beam_oracles as oracles

from romsindy.beam import Beam, Motion, Section
from romsindy.record.backbone import extract_backbone

Row = tuple[str, float, float]  # what, measured, at most
LARGE = 0.15


def bare(elements: int, weight: float = 0.0) -> Beam:
    return Beam(1.0, Section(1e8, 1e8, 1.0, 1.0), elements=elements, gravity=(0.0, weight))


def worst(found: np.ndarray | list, exact: np.ndarray | list | tuple) -> float:
    return float(np.max(np.abs(np.asarray(found) / np.asarray(exact) - 1)))


def statics() -> Iterator[Row]:
    def tip(beam: Beam, load: np.ndarray | None = None) -> np.ndarray:
        return np.array([1.0, -1.0, 1.0]) * beam.equilibrium(load).tip[[1, 0, 2]]

    for elements in (10, 20, 40):
        beam = bare(elements)
        error = max(
            worst(tip(beam, beam.point_load((0, a))), v) for a, v in oracles.TIP_LOAD.items()
        )
        yield f"tip load, alpha 0.1-10, {elements} elements", error, 1e-4
        error = max(
            worst(tip(bare(elements, weight=a)), v) for a, v in oracles.UNIFORM_LOAD.items()
        )
        yield f"uniform load, K 1-10, {elements} elements", error, 1e-4
        circle = beam.equilibrium(beam.point_load(moment=2 * np.pi)).tip
        error = float(np.abs(circle - [-1, 0, 2 * np.pi]).max())
        yield f"full circle, closure / L, {elements} elements", error, 1e-4
    for GA, exact in oracles.BATISTA.items():
        beam = Beam(1.0, Section(1e10, GA, 10.0, 1.0), elements=20, gravity=(0.0, 0.0))
        found = beam.equilibrium(beam.point_load((0.0, 10.0))).tip[:2]
        yield f"Batista GA = {GA:g}, 20 elements", worst(found, exact), 1e-4
    beam = Beam(5.0, Section(*oracles.GERADIN_SECTION, 1.0), elements=20, gravity=(0.0, 0.0))
    u, w, theta = beam.equilibrium(beam.point_load((0.0, -600e3))).tip
    yield "Geradin-Cardona, 20 elements", worst([5 + u, w, -theta], oracles.GERADIN_TIP), 1e-4
    beam = bare(40)
    momentum = beam.modes(count=1).momenta[0]
    errors = []
    for f, (q, w, u, _, _) in oracles.FINITE_AMPLITUDE.items():
        x = beam.equilibrium(f * momentum).displacement
        errors.append(worst([np.vdot(momentum, x), x[-1, 1], x[-1, 0]], [q, w, u]))
    # u of the smallest case is printed with six digits
    yield "finite-amplitude table, 40 elements", max(errors), 1e-4


def modes() -> Iterator[Row]:
    omega = bare(40).modes(count=3).omega
    yield (
        "bare cantilever, 3 modes, 40 elements",
        worst(omega, np.square(oracles.BETA_CLAMPED_FREE)),
        1e-4,
    )
    beam = Beam.cantilever()
    basis = beam.modes(count=32)
    axial = basis.omega[basis.axial > 0.5][:2]
    straight = Beam.cantilever(gravity=0.0).modes(count=1).omega[0]
    print(f"  150 elements: omega {basis.omega[:2]}, axial {axial} rad/s")
    yield "default: omega 38.4967, 165.895", worst(basis.omega[:2], [38.4967, 165.895]), 2e-4
    yield "default: axial 17960.5, 53847.5", worst(axial, [17960.5, 53847.5]), 2e-4
    yield "default: |sag / L - 0.0217|", abs(-beam.equilibrium().tip[1] / 0.45 - 0.0217), 5e-5
    yield "default: |factor - 1.003|", abs(basis.omega[0] / straight - 1.003), 5e-4


def reduction() -> Iterator[Row]:
    for mode, (_, gamma, upsilon) in oracles.SINGLE_MODE.items():
        c = bare(40).reduce(mode=mode, order=9, amplitude=0.1 / mode**2).coefficients
        yield f"gamma_3, mode {mode}, 40 elements", worst([c["gamma_3"]], [gamma]), 1e-4
        yield f"Upsilon_3, mode {mode}", worst([c["Upsilon_3"]], [upsilon]), 1e-4
        if mode == 1:
            yield "gamma_5, mode 1", worst([c["gamma_5"]], [oracles.GAMMA_5]), 1e-3
            yield "Upsilon_5, mode 1", worst([c["Upsilon_5"]], [oracles.UPSILON_5]), 1e-3
    beam = Beam.cantilever(
        length=0.3, young=205e9, tip_mass=0, spring_stiffness=0, gravity=0, elements=120
    )
    c = beam.reduce(order=9, amplitude=0.1 * np.sqrt(beam.section.mass * 0.3) * 0.3).coefficients
    for name in ("gamma_3", "Upsilon_3", "gamma_5", "Upsilon_5"):
        tolerance = 1e-4 if name.endswith("3") else 1e-3
        yield f"0.3 m example: {name}", worst([c[name]], [oracles.EXAMPLE[name]]), tolerance


def backbone() -> Iterator[Row]:
    beam = Beam.cantilever(
        length=0.3, young=205e9, tip_mass=0, spring_stiffness=0, gravity=0, alpha=0, eta=0,
        elements=40,
    )  # fmt: skip
    basis = beam.modes(count=1)
    for amplitude, exact in oracles.BACKBONE.items():
        shape = beam.release_shape(amplitude * 0.3, mode=1)
        motion = beam.simulate(shape, 2.5, modes=basis, progress=False)
        omega = oracles.frequency(motion.t, basis.project(motion).q)
        error = abs((omega / basis.omega[0] - 1) / exact - 1)
        limit = 0.03 if amplitude < 0.35 else 0.08
        yield f"shift of the frequency at w/L = {amplitude}", error, limit


def acceleration_error(motion: Motion, inner: slice = slice(4, -4)) -> float:
    decay = motion.basis.project(motion, 1)
    numeric = make_interp_spline(decay.t, decay.q, k=7).derivative(2)(decay.t)
    gap = np.abs(decay.q_ddot - numeric)[inner]
    return float(gap.max() / np.abs(decay.q_ddot).max())


def spline_error(motion: Motion, every: int) -> float:
    """Return how far a spline through every n-th sample misses that through all samples."""
    t, q = motion.t, motion.basis.project(motion, 1).q
    fine = make_interp_spline(t, q, k=7).derivative(2)(t)
    coarse = make_interp_spline(t[::every], q[::every], k=7).derivative(2)(t[::every])
    gap = np.abs(coarse - fine[::every])[4:-4]
    return float(gap.max() / np.abs(fine[4:-4]).max())


def normal_mode() -> Iterator[Row]:
    """The beam's own periodic orbits against exact elastica dynamics and the reduced model."""
    shares, exact = (np.array(list(x)) for x in (oracles.BACKBONE, oracles.BACKBONE.values()))
    plain = Beam.cantilever(elements=20, gravity=0.0, tip_mass=0.0, spring_stiffness=0.0)
    began = time.perf_counter()
    orbits = plain.normal_mode((shares * plain.length).tolist(), progress=False)
    yield "five orbits, 20 elements: s", time.perf_counter() - began, 60.0
    yield "velocity of other modes at the turning points", float(orbits.unrest.max()), 1e-6
    shift = orbits.frequency / orbits.linear_frequency - 1
    for share, error in zip(shares, np.abs(shift / exact - 1), strict=True):
        yield f"bare cantilever, shift at w/L = {share:g}", float(error), 5e-3
    beam = Beam.cantilever(elements=20)
    orbits = beam.normal_mode(
        [share * beam.length for share in (0.05, 0.1, 0.2, 0.3)], progress=False
    )
    reduced = beam.reduce(order=9, amplitude=0.024).backbone(orbits.amplitude)
    for a, error in zip(orbits.amplitude, np.abs(reduced / orbits.frequency - 1), strict=True):
        yield f"default beam, order-9 reduced model at q = {a:.4f}", float(error), 2e-3
    motion = beam.simulate(beam.release_shape(LARGE, mode=1), 25.0, progress=False)
    decay = extract_backbone(motion.basis.project(motion))
    read = make_interp_spline(decay.amplitude[::-1], decay.frequency[::-1])(orbits.amplitude)
    for a, error in zip(orbits.amplitude, np.abs(read / orbits.frequency - 1), strict=True):
        # damping lowers a frequency by zeta^2 / 2 = 1.1e-5
        yield f"default beam, backbone read off a decay at q = {a:.4f}", float(error), 1e-4


def accuracy() -> Iterator[Row]:
    for damped in (True, False):
        beam = Beam.cantilever(elements=40, **({} if damped else {"alpha": 0.0, "eta": 0.0}))
        basis = beam.modes(count=10)
        name = "damped" if damped else "undamped"
        for mode in (1, None):
            shape = beam.release_shape(LARGE, mode=mode)
            force = "tip force" if mode is None else "modal force"
            motion = beam.simulate(shape, 25.0, modes=basis, progress=False)
            print(f"  {name}, {force}: {motion!r}")
            yield f"energy drift over 25 s, {name}, {force}", motion.energy.drift, 1e-4
            if damped:
                label = f"acceleration against spline of q, {force}"
                yield label, acceleration_error(motion), 1e-3
                if mode is None:
                    fine = beam.simulate(shape, 1.0, 1e-4, modes=basis, progress=False)
                    error = acceleration_error(fine, slice(20, -4))
                    yield f"{label}, sampled at 10 kHz", error, 1e-3
                    yield (
                        "error of that spline itself when given 1 kHz of the 10 kHz motion",
                        (spline_error(fine, 10)),
                        np.inf,
                    )
            if mode is None and not damped:
                continue  # its steps are cut by the energy balance, not by the sampling
            half = beam.simulate(shape, 25.0, 5e-4, modes=basis, progress=False)
            a, b = (oracles.frequency(m.t, basis.project(m).q) for m in (motion, half))
            yield f"frequency against halved step, {name}, {force}", abs(a / b - 1), 1e-5


def speed() -> Iterator[Row]:
    Beam.cantilever(elements=2).simulate(
        Beam.cantilever(elements=2).release_shape(0.01), 0.01, progress=False
    )  # compiles
    for elements, limit in ((40, 0.5), (150, 1.5)):
        beam = Beam.cantilever(elements=elements)
        for mode in (1, None):
            shape = beam.release_shape(LARGE, mode=mode)
            motion = beam.simulate(shape, 4.0, progress=False)
            force = "tip force" if mode is None else "modal force"
            pace = motion.cost.seconds / motion.t[-1]
            yield f"first 4 s, {elements} elements, {force}: s per simulated s", pace, limit
    beam = Beam.cantilever()
    sensors = beam.sensors([0.03, 0.135, 0.24, 0.345, 0.45])
    began = time.perf_counter()
    motion = beam.simulate(beam.release_shape(LARGE), 25.0, sensors=sensors, progress=False)
    yield "25 s decay, 150 elements, 5 sensors, 10 modes: s", time.perf_counter() - began, 40.0
    yield "the same, s per simulated s", motion.cost.seconds / 25.0, 1.5
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    yield "largest memory so far, MB", memory, 500.0


PARTS: dict[str, Callable[[], Iterator[Row]]] = {
    "statics": statics,
    "modes": modes,
    "reduction": reduction,
    "backbone": backbone,
    "normal_mode": normal_mode,
    "accuracy": accuracy,
    "speed": speed,
}


def main(names: list[str]) -> int:
    unknown = [name for name in names if name not in PARTS]
    if unknown:
        print(f"no part called {unknown}; there are {list(PARTS)}", file=sys.stderr)
        return 2
    missed = 0
    for name in names or PARTS:
        print(name)
        for what, measured, limit in PARTS[name]():
            verdict = "ok" if measured <= limit else "MISSED"
            missed += measured > limit
            print(f"  {what:62} {measured:10.3g}  at most {limit:8.3g}  {verdict}", flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
