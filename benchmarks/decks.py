"""Decks of CalculiX reduced to one equation: against the literature, our beam, CalculiX in time.

Meshes are made here, of solids, by numpy. Needs CalculiX (``ccx``) on the path.

    python benchmarks/decks.py                # the table
    python benchmarks/decks.py --row size     # 20,000 degrees of freedom, by the clock
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import click
import numpy as np
from scipy.interpolate import CubicSpline

import romsindy as rs
from romsindy.beam import CLAMPED, FREE, Section
from romsindy.structure.reduction import Reduction
from romsindy.text import aligned
from romsindy.typing import Array

Mesh = tuple[Array, list[list[int]]]

_CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]
_SIDES = [(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0)]
_NODES = [
    *_CORNERS,
    *((a, b, 2) for a, b, _ in _CORNERS),
    *_SIDES,
    *((a, b, 2) for a, b, _ in _SIDES),
    *((a, b, 1) for a, b, _ in _CORNERS),
]
_STEPS = 60  # of a cycle in time: they lose (2 pi / 60)^2 / 12 of the frequency, 0.09 %
STEEL = {"young": 210e9, "poisson": 0.3, "density": 7800.0}
# MORFE.jl, examples/01_clamped_beam: rad/s; the cubic coefficient of Euler and Bernoulli.
LITERATURE, CUBIC = 0.53739, 9.37e-6


# -- meshes ---------------------------------------------------------------------------------------


def block(counts: Sequence[int], size: Sequence[float]) -> Mesh:
    """Coordinates (n, 3), and elements of 20 nodes, of a block of counts[i] elements an edge."""
    n = 2 * np.array(counts)
    lattice = np.stack(np.meshgrid(*[np.arange(k + 1) for k in n], indexing="ij"), -1)
    lattice = lattice.reshape(-1, 3)
    lattice = lattice[np.sum(lattice % 2, axis=1) <= 1]  # corners and middles of edges
    number = {tuple(p): i for i, p in enumerate(lattice.tolist(), 1)}
    first = np.stack(np.meshgrid(*[np.arange(0, k, 2) for k in n], indexing="ij"), -1)
    elements = [
        [number[tuple(p)] for p in (corner + np.array(_NODES)).tolist()]
        for corner in first.reshape(-1, 3)
    ]
    return lattice / n * np.array(size), elements


def write_deck(
    path: Path,
    mesh: Mesh,
    held: Iterable[int],
    *,
    young: float,
    poisson: float,
    density: float,
    kind: str = "C3D20R",
    parts: Mapping[str, Callable[[Array], bool]] | None = None,
) -> Path:
    """Write a deck; ``held`` are the numbers of the nodes that are clamped.

    Elements are in the first of the ``parts`` that has their middle, each a set with a section.
    """
    places, elements = mesh
    sets: dict[str, list[int]] = {name: [] for name in [*(parts or {}), "SOLID"]}
    for i, nodes in enumerate(elements):
        middle = places[np.array(nodes) - 1].mean(axis=0)
        inside = (name for name, has in (parts or {}).items() if has(middle))
        sets[next(inside, "SOLID")].append(i)
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{i}, {x:.12g}, {y:.12g}, {z:.12g}" for i, (x, y, z) in enumerate(places, 1)]
    for name, members in sets.items():
        lines.append(f"*ELEMENT, TYPE={kind}, ELSET={name}")
        for i in members:
            first, last = elements[i][:10], elements[i][10:]
            lines += [", ".join(map(str, [i + 1, *first])) + ",", ", ".join(map(str, last))]
    clamped = [f"{n}," for n in held]
    if clamped:
        lines += ["*NSET, NSET=HELD", *clamped, "*BOUNDARY", "HELD, 1, 3"]
    lines += ["*MATERIAL, NAME=M", "*ELASTIC", f"{young}, {poisson}", "*DENSITY", f"{density}"]
    lines += [f"*SOLID SECTION, ELSET={name}, MATERIAL=M" for name in sets]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def at(places: Array, axis: int, *values: float) -> list[int]:
    """Numbers of the nodes at one of these coordinates."""
    near = np.abs(places[:, axis, None] - np.array(values)).min(axis=1)
    return [int(n) for n in np.flatnonzero(near < 1e-9) + 1]


def clamped_beam(path: Path) -> Path:
    """1000 x 24 x 10 with E = 160e3, nu = 0.22, rho = 2.32e-3, clamped at both ends."""
    mesh = block((40, 2, 1), (1000.0, 24.0, 10.0))
    held = at(mesh[0], 0, 0.0, 1000.0)
    return write_deck(path, mesh, held, young=160e3, poisson=0.22, density=2.32e-3)


def arch(
    path: Path,
    rise: float,
    counts: Sequence[int] = (24, 2, 1),
    parts: Mapping[str, Callable[[Array], bool]] | None = None,
    thickness: float = 0.002,
) -> Path:
    """A strip of steel, 300 x 20 x 2 mm, clamped at both ends, its middle higher by ``rise``."""
    places, elements = block(counts, (0.3, 0.02, thickness))
    held = at(places, 0, 0.0, 0.3)
    places[:, 2] -= thickness / 2 - 0.001  # one middle surface
    places[:, 2] += 4 * rise * places[:, 0] * (0.3 - places[:, 0]) / 0.3**2
    return write_deck(path, (places, elements), held, **STEEL, parts=parts)


def stiffened(path: Path, thickness: float = 0.002) -> Path:
    """A plate of steel, 200 x 100 x 2 mm, clamped at both ends, with a stiffener along it, WEB.

    That is 10 mm high, and has a thickness.
    """
    places, elements = block((8, 5, 3), (0.2, 5.0, 3.0))
    middles = [places[np.array(e) - 1].mean(axis=0) for e in elements]
    kept = [e for e, (_, y, z) in zip(elements, middles, strict=True) if z < 1 or 2 < y < 3]
    used = sorted({n for e in kept for n in e})
    number = {n: i for i, n in enumerate(used, 1)}
    places = places[np.array(used) - 1]
    ends = 0.05 - thickness / 2, 0.05 + thickness / 2
    places[:, 1] = np.interp(places[:, 1], range(6), [0, 0.025, *ends, 0.075, 0.1])
    places[:, 2] = np.interp(places[:, 2], range(4), [0, 0.002, 0.007, 0.012])
    mesh = places, [[number[n] for n in e] for e in kept]
    parts: Mapping[str, Callable[[Array], bool]] = {"WEB": lambda middle: bool(middle[2] > 0.002)}
    return write_deck(path, mesh, at(places, 0, 0.0, 0.2), **STEEL, parts=parts)


def plate(path: Path, counts: Sequence[int] = (14, 10, 1)) -> Path:
    """A plate of steel, 200 x 150 x 2 mm, clamped at all edges."""
    mesh = block(counts, (0.2, 0.15, 0.002))
    held = {*at(mesh[0], 0, 0.0, 0.2), *at(mesh[0], 1, 0.0, 0.15)}
    return write_deck(path, mesh, sorted(held), **STEEL)


def cantilever(path: Path, elements: int = 50, thickness: float = 0.01) -> Path:
    """A strip of 1000 x 20 x 10 mm, clamped at one end, without lateral contraction."""
    mesh = block((elements, 1, 1), (1.0, 0.02, thickness))
    mesh[0][:, 2] -= thickness / 2 - 0.005  # one middle surface
    steel = {**STEEL, "poisson": 0.0}
    return write_deck(path, mesh, at(mesh[0], 0, 0.0), **steel, kind="C3D20")


# -- in time --------------------------------------------------------------------------------------


def released(found: Reduction, cycles: int = 5) -> tuple[float, float]:
    """Frequency in Hz, and amplitude in the modal coordinate, of a release, by CalculiX in time.

    It is let go from the softer end of the range, so that it stays within.
    """
    curve, structure = found.curve, found.structure
    row, cases = curve.mode.loudest, curve.cases
    softer = min((0, -1), key=lambda end: abs(cases.factors[end]))
    step = 2 * np.pi / found.frequencies(np.array([found.reach]))[0] / _STEPS
    run = structure.released(
        [(int(structure.nodes[row]), int(structure.directions[row]))],
        float(cases.shapes[softer, row]),
        step,
        cycles * _STEPS,
        curve.mode.number,
        held_by="mode",
    )
    t, x = run.t, run.moved[:, 0]
    up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossed = t[up] - x[up] * step / np.diff(x)[up]
    seen = 2 * np.pi * (len(crossed) - 1) / np.ptp(crossed)
    q = np.interp([x.min(), x.max()], curve.shapes_at(curve.q)[:, row], curve.q)
    return float(run.true(seen)) / (2 * np.pi), float(np.ptp(q)) / 2


# -- rows -----------------------------------------------------------------------------------------


def _beam(folder: Path) -> list[list[str]]:
    structure = rs.Structure.from_calculix(clamped_beam(folder / "beam.inp"))
    found = structure.reduce(1, 3.0)
    a = found.reach
    cubic = np.sqrt(LITERATURE**2 + 0.75 * CUBIC * a**2)
    off = {
        "omega": (structure.omega[0] / LITERATURE - 1, 0.1),
        "cubic": (found.model.coefficients["gamma_3"] / CUBIC - 1, 1.0),
        "backbone at 0.3 thicknesses": (found.frequencies(np.array([a]))[0] / cubic - 1, 0.15),
    }
    return [
        [f"clamped beam, {name}", f"{100 * x:+.3f}", f"{most}"] for name, (x, most) in off.items()
    ]


def against_beam(folder: Path) -> tuple[float, float]:
    """Errors of K/q and of h of the cantilever against `Beam`, as parts of their change."""
    curve = rs.Structure.from_calculix(cantilever(folder / "c.inp")).static_curve(1, 0.3).curve
    section = Section.rectangle(0.02, 0.01, 210e9, 7800.0, 0.0)
    beam = rs.Beam(1.0, section, 60, left=CLAMPED, right=FREE, gravity=(0.0, 0.0))
    reach = float(np.abs(curve.q).max())
    own = beam.static_curve(1, reach, 40)
    q = curve.q[np.abs(curve.q) > 0.02 * reach]
    pairs = (
        (curve.force_at(q) / q / curve.omega2, CubicSpline(own.q, own.force)(q) / q / own.omega2),
        (curve.inertia_at(q), CubicSpline(own.q, own.inertia)(q)),
    )
    stiffness, inertia = (float(np.abs(x - y).max() / np.abs(y - 1).max()) for x, y in pairs)
    return stiffness, inertia


def _cantilever(folder: Path) -> list[list[str]]:
    rows = zip(("K/q", "h"), against_beam(folder), strict=True)
    return [[f"cantilever, {n} against our beam", f"{100 * x:.3f}", "0.1"] for n, x in rows]


def _in_time(name: str, make: Callable[[Path], Path]) -> Callable[[Path], list[list[str]]]:
    def row(folder: Path) -> list[list[str]]:
        deck = make(folder / f"{name}.inp")
        found = rs.Structure.from_calculix(deck).reduce(1, 0.002)
        frequency, amplitude = released(found)
        off = found.frequencies(np.array([amplitude]))[0] / (2 * np.pi) / frequency - 1
        told = f"{name}, frequency at one thickness against *DYNAMIC"
        return [[told, f"{100 * off:+.3f}", "0.3"]]

    return row


def _size(folder: Path) -> list[list[str]]:
    begun = time.perf_counter()
    structure = rs.Structure.from_calculix(plate(folder / "big.inp", (40, 26, 1)), n_jobs=2)
    found = structure.reduce(1, 0.002)
    took = time.perf_counter() - begun
    kinds = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    largest = max(resource.getrusage(kind).ru_maxrss for kind in kinds) / 2**20
    what = f"{len(structure.nodes):,} degrees of freedom, {len(found.curve.cases.factors)} cases"
    return [
        [f"{what}, minutes", f"{took / 60:.1f}", "10"],
        ["the same, GiB", f"{largest:.2f}", "4"],
    ]


ROWS = {
    "beam": _beam,
    "cantilever": _cantilever,
    "plate": _in_time("plate", plate),
    "arch": _in_time("arch", lambda path: arch(path, 0.002)),
    "size": _size,
}


@click.command()
@click.option("--row", "rows", multiple=True, type=click.Choice(list(ROWS)), help="One row.")
def main(rows: tuple[str, ...]) -> None:
    """Print errors in per cent, or what is named, beside what is asked."""
    table = [["what", "found", "at most"]]
    for name in rows or ROWS:
        with tempfile.TemporaryDirectory() as folder:
            table += ROWS[name](Path(folder))
    click.echo(aligned(table))


if __name__ == "__main__":
    main()
