"""Blind trials of decks in time: a beam, a plate with a stiffener and an arch lack something.

Meshes are made by gmsh, of solids. The truth is the whole mesh in time with something hidden at a
node that is drawn, in a clamp or in a part: by CalculiX (``*DYNAMIC``), or where a dashpot is
hidden, for which that has no element, by felupe with the same trapezoidal rule. romsindy has the
deck without it, reduced by statics, and noisy records of three nodes. What is named and has an
element goes into a corrected deck, by ``romsindy export``, and that is let go as the truth was.
Needs gmsh and ccx on the path, and felupe.

    python benchmarks/blind_decks.py --first 2000 --count 24 --motions motions   # stored there
    python benchmarks/blind_decks.py --first 2000 --count 24 --motions motions --only-motions
    python benchmarks/blind_decks.py --motions motions --modes   # how far the simulator is off
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

import romsindy as rs
from romsindy.record.backbone import EqualAmplitude, extract_backbone
from romsindy.structure.simulator import Damping
from romsindy.typing import Array

_YOUNG, _POISSON, _DENSITY = 210e9, 0.3, 7800.0
_STEPS, _KEPT, _CYCLES = 300, 3, 10  # of a linear cycle; every third is measured
_RELEASES = (0.8, 0.5)  # of the thickness, at the first sensor
_REACH = 1.3  # of the thickness: so far the deck is held
_SNR, _DAMPING = 40.0, 0.008  # dB; alpha over 2 omega
_WITHIN = {"modulus": 0.03, "density": 0.02, "alpha": 0.2}
_MOVES = 0.4  # of what the loudest node moves: there something may be hidden
# What may be hidden, its size from least to most (of omega^2, of the modal mass, of the damping,
# of the modulus), and names that are right.
_HIDDEN: dict[str, tuple[float, float, set[str]]] = {
    "mass": (0.02, 0.08, {"added_mass"}),
    "spring": (0.03, 0.1, {"linear_frequency"}),
    "dashpot": (0.5, 2.0, {"viscous"}),
    "cubic spring": (0.03, 0.1, {"cubic_stiffness"}),
    "clamp": (0.02, 0.06, {"clamp of LEFT"}),
    "part": (0.05, 0.15, {"modulus of PART"}),
    "nothing": (0.0, 0.0, set()),
}

_BEAM = """
Point(1) = {0, 0, 0};
c[] = Extrude {0, 0.02, 0} { Point{1}; Layers{1}; };
s[] = Extrude {0, 0, 0.006} { Curve{c[1]}; Layers{1}; Recombine; };
v[] = Extrude {0.2, 0, 0} { Surface{s[1]}; Layers{5}; Recombine; };
w[] = Extrude {0.3, 0, 0} { Surface{v[0]}; Layers{7}; Recombine; };
Physical Volume("PART") = {v[1]};
Physical Volume("REST") = {w[1]};
"""
_PLATE = """
Point(1) = {0, 0, 0};
a[] = Extrude {0, 0.04, 0} { Point{1}; Layers{1}; };
b[] = Extrude {0, 0.02, 0} { Point{a[0]}; Layers{1}; };
c[] = Extrude {0, 0.04, 0} { Point{b[0]}; Layers{1}; };
l[] = Extrude {0, 0, 0.004} { Curve{a[1]}; Layers{1}; Recombine; };
m[] = Extrude {0, 0, 0.004} { Curve{b[1]}; Layers{1}; Recombine; };
n[] = Extrude {0, 0, 0.004} { Curve{c[1]}; Layers{1}; Recombine; };
t[] = Extrude {0, 0, 0.006} { Curve{m[0]}; Layers{1}; Recombine; };
p[] = Extrude {0.3, 0, 0} { Surface{l[1], m[1], n[1]}; Layers{6}; Recombine; };
w[] = Extrude {0.3, 0, 0} { Surface{t[1]}; Layers{6}; Recombine; };
Physical Volume("REST") = {p[1], p[7], p[13]};
Physical Volume("PART") = {w[1]};
"""
# Of radius 8 m about (0.2, y, z): its middle is 2.5 mm higher than its ends.
_ARCH = """
Point(1) = {0, 0, 0};
c[] = Extrude {0, 0.02, 0} { Point{1}; Layers{1}; };
half = Asin(0.2 / 8);
z = -8 * Cos(half);
s[] = Extrude {-0.005 * Sin(half), 0, 0.005 * Cos(half)} { Curve{c[1]}; Layers{1}; Recombine; };
v[] = Extrude {{0, 1, 0}, {0.2, 0, z}, 0.8 * half} { Surface{s[1]}; Layers{5}; Recombine; };
w[] = Extrude {{0, 1, 0}, {0.2, 0, z}, 1.2 * half} { Surface{v[0]}; Layers{7}; Recombine; };
Physical Volume("PART") = {v[1]};
Physical Volume("REST") = {w[1]};
"""


class Shape(NamedTuple):
    """A structure that is clamped at its left and its right end."""

    mesh: str  # text of gmsh
    length: float
    thickness: float
    sensors: tuple[tuple[float, float, float], ...]  # near these places, in direction 3


SHAPES = {
    "beam": Shape(_BEAM, 0.5, 0.006, ((0.25, 0.01, 0.0), (0.125, 0.01, 0.0), (0.4, 0.01, 0.0))),
    "plate": Shape(_PLATE, 0.3, 0.004, ((0.15, 0.05, 0.0), (0.1, 0.0, 0.0), (0.2, 0.1, 0.0))),
    "arch": Shape(_ARCH, 0.4, 0.005, ((0.2, 0.01, 0.0), (0.1, 0.01, 0.0), (0.32, 0.01, 0.0))),
}


class Hidden(NamedTuple):
    """What a trial hides: its size, and where among the nodes that move (a part of them)."""

    shape: str
    kind: str
    size: float
    where: float
    values: dict[str, float]  # of the truth over those that are told


def hidden_of(seed: int) -> Hidden:
    """What the trial of a seed hides; of each 24 the latter half is told wrong."""
    rng = np.random.default_rng(seed)
    shape, kind = [*SHAPES][seed % len(SHAPES)], [*_HIDDEN][seed % len(_HIDDEN)]
    least, most, _ = _HIDDEN[kind]
    size = float(np.exp(rng.uniform(np.log(least), np.log(most)))) if most else 0.0
    if kind == "part":
        size *= float(rng.choice([-1, 1]))
    where = float(rng.uniform())
    off = {name: 1 + part * float(rng.normal()) for name, part in _WITHIN.items()}
    wrong = seed // 12 % 2 == 1
    return Hidden(shape, kind, size, where, off if wrong else dict.fromkeys(_WITHIN, 1.0))


class Mesh:
    """Nodes and elements of a structure, as gmsh writes them."""

    def __init__(self, name: str, folder: Path) -> None:
        self.shape = SHAPES[name]
        made = folder / f"{name}.inp"
        options = "Mesh.ElementOrder = 2;\nMesh.SecondOrderIncomplete = 1;\nMesh.Algorithm = 6;\n"
        made.with_suffix(".geo").write_text(self.shape.mesh + options, encoding="utf-8")
        subprocess.run(
            ["gmsh", "-3", "-format", "inp", "-o", made.name, f"{name}.geo"],
            cwd=folder,
            check=True,
            capture_output=True,
        )
        self.text = made.read_text(encoding="utf-8").split("\n", 2)[2]  # without its heading
        blocks = [b.partition("\n") for b in self.text.split("\n*")]
        rows = [[float(v) for v in line.split(",")] for line in blocks[0][2].split("\n") if line]
        self.places = np.array(rows)[:, 1:]
        assert np.array_equal(np.array(rows)[:, 0], np.arange(1, len(rows) + 1))
        numbers = [
            int(v)
            for head, _, body in blocks
            if head.startswith("ELEMENT")
            for v in body.replace("\n", ",").split(",")
            if v.strip()
        ]
        elements = np.reshape(numbers, (-1, 21))
        self.number, self.elements = elements[:, 0], elements[:, 1:]
        part = next(body for head, _, body in blocks if "ELSET=PART" in head)
        self.part = {int(v) for v in part.replace("\n", ",").split(",") if v.strip()}

    @cached_property
    def ends(self) -> dict[str, Array]:
        """Numbers of the nodes of either clamp."""
        x, length = self.places[:, 0], self.shape.length
        arch = self.shape is SHAPES["arch"]
        tilt = self.places[:, 2] * np.tan(np.arcsin(0.2 / 8)) if arch else 0.0 * x
        return {
            "LEFT": np.flatnonzero(np.abs(x + tilt) < 1e-9) + 1,
            "RIGHT": np.flatnonzero(np.abs(x - tilt - length) < 1e-9) + 1,
        }

    def near(self, place: tuple[float, ...]) -> int:
        """The node nearest to a place."""
        return int(np.argmin(np.linalg.norm(self.places - place, axis=1))) + 1

    def deck(self, modulus: float = 1.0, density: float = 1.0, part: float = 1.0) -> str:
        """The deck without its clamps; values are those over steel."""
        lines = []
        for name, factor in (("REST", 1.0), ("PART", part)):
            lines += [
                f"*MATERIAL, NAME={name}",
                f"*ELASTIC\n{_YOUNG * modulus * factor:.9e}, {_POISSON}",
                f"*DENSITY\n{_DENSITY * density:.9e}",
                f"*SOLID SECTION, ELSET={name}, MATERIAL={name}",
            ]
        for name, nodes in self.ends.items():
            lines += [f"*NSET, NSET={name}", *(f"{n}," for n in nodes)]
        return "\n".join([self.text.rstrip(), *lines]) + "\n"


CLAMPS = "*BOUNDARY\nLEFT, 1, 3\nRIGHT, 1, 3\n"


def told(mesh: Mesh, folder: Path) -> rs.Structure:
    """The structure as romsindy is told."""
    deck = folder / "told.inp"
    deck.write_text(mesh.deck() + CLAMPS, encoding="utf-8")
    return rs.Structure.from_calculix(deck, store=folder / "told.npz", progress=False)


class Truth(NamedTuple):
    """A structure with what is hidden: the model of CalculiX, and what its elements do not hold."""

    mesh: Mesh
    model: str  # without clamps
    clamps: str
    node: int  # of what is hidden
    strength: float
    alpha: float  # 1/s
    density: float
    dashpot: float = 0.0  # N s/m, at the node


def truth_of(hidden: Hidden, mesh: Mesh, known: rs.Structure, folder: Path) -> Truth:
    """The truth of a trial: sizes are those over the first mode of what is told."""
    off, omega = hidden.values, known.omega[0]
    alpha = 2 * _DAMPING * omega * off["alpha"]
    rows = np.flatnonzero(known.directions == 3)
    moved = np.abs(known.shapes[0, rows])
    rows = rows[moved > _MOVES * moved.max()]
    row = int(rows[int(hidden.where * len(rows))])
    node, phi = int(known.nodes[row]), float(abs(known.shapes[0, row]))
    model, clamps, strength = mesh.deck(off["modulus"], off["density"]), CLAMPS, 0.0
    element = int(mesh.number.max()) + 1
    if hidden.kind == "mass":
        strength = hidden.size / phi**2
        model += f"*ELEMENT, TYPE=MASS, ELSET=HID\n{element}, {node}\n*MASS, ELSET=HID\n"
        model += f"{strength:.9e}\n"
    elif hidden.kind == "spring":
        strength = hidden.size * omega**2 / phi**2
        model += f"*ELEMENT, TYPE=SPRING1, ELSET=HID\n{element}, {node}\n*SPRING, ELSET=HID\n3\n"
        model += f"{strength:.9e}\n"
    elif hidden.kind == "cubic spring":
        there = phi / np.abs(known.shapes[0]).max() * mesh.shape.thickness
        strength = hidden.size * omega**2 / phi**2 / (0.75 * there**2)
        model += _cubic(mesh, node, element, strength)
        clamps += "FAR, 1, 3\n"
    elif hidden.kind == "dashpot":
        strength = hidden.size * alpha / phi**2
    elif hidden.kind == "part":
        strength = 1 + hidden.size
        model = mesh.deck(off["modulus"], off["density"], strength)
    elif hidden.kind == "clamp":
        strength = _clamp_that_softens(hidden, mesh, model, folder)
        model, clamps = model + _springs(mesh, element, strength), "*BOUNDARY\nRIGHT, 1, 3\n"
    dashpot = strength if hidden.kind == "dashpot" else 0.0
    return Truth(mesh, model, clamps, node, strength, alpha, off["density"], dashpot)


def _cubic(mesh: Mesh, node: int, element: int, strength: float) -> str:
    """A spring to a node far below, of a table."""
    x, y, z = mesh.places[node - 1]
    far = len(mesh.places) + 1
    at = np.linspace(-3, 3, 1201) * mesh.shape.thickness
    table = "\n".join(f"{strength * v**3:.9e}, {v:.9e}" for v in at)
    return (
        f"*NODE, NSET=FAR\n{far}, {x}, {y}, {z - 500.0}\n*ELEMENT, TYPE=SPRINGA, ELSET=HID\n"
        f"{element}, {far}, {node}\n*SPRING, ELSET=HID, NONLINEAR\n\n{table}\n"
    )


def _springs(mesh: Mesh, element: int, stiffness: float) -> str:
    """Springs in the place of the left clamp: of middles of edges four thirds, of corners less."""
    nodes = mesh.ends["LEFT"]
    counts = np.array([np.sum(mesh.elements == n) for n in nodes])
    middle = np.isin(nodes, mesh.elements[:, 8:])
    shares = np.where(middle, 4 / 3, 1 / 3) * counts
    text = ""
    for n, share in zip(nodes, shares / shares.sum(), strict=True):
        for direction in (1, 2, 3):
            name = f"CL{element}"
            text += f"*ELEMENT, TYPE=SPRING1, ELSET={name}\n{element}, {n}\n*SPRING, ELSET={name}\n"
            text += f"{direction}\n{stiffness * share:.9e}\n"
            element += 1
    return text


def _clamp_that_softens(hidden: Hidden, mesh: Mesh, model: str, folder: Path) -> float:
    """Stiffness of all springs that lowers omega^2 by the size, N/m."""
    element = int(mesh.number.max()) + 1

    def omega2(springs: str, clamps: str) -> float:
        deck = folder / "clamp.inp"
        deck.write_text(model + springs + clamps, encoding="utf-8")
        return float(rs.Structure.from_calculix(deck, modes=2, progress=False).omega[0] ** 2)

    rigid = omega2("", CLAMPS)

    def off(exponent: float) -> float:
        soft = omega2(_springs(mesh, element, 10**exponent), "*BOUNDARY\nRIGHT, 1, 3\n")
        return 1 - soft / rigid - hidden.size

    return float(10 ** brentq(off, 6, 12, xtol=1e-3))


# -- in time --------------------------------------------------------------------------------------


def motion(truth: Truth, sensors: list[int], release: float, omega: float, folder: Path) -> Array:
    """Displacements (n, n_sensors) in direction 3, after the first of them was held displaced."""
    step = 2 * np.pi / omega / _STEPS
    if truth.dashpot:
        return _by_felupe(truth, sensors, release, step)
    return _by_calculix(truth, sensors, release, step, folder)


def _by_calculix(
    truth: Truth, sensors: list[int], release: float, step: float, folder: Path
) -> Array:
    first, *rest = truth.model.split("\n")
    damping = f"*DAMPING, ALPHA={truth.alpha:.9e}, BETA=0."
    text = "\n".join([first, *rest]).replace("*DENSITY", f"{damping}\n*DENSITY")
    output = "*NODE PRINT, NSET=READ\nU\n*EL PRINT, ELSET=PART, TOTALS=ONLY\nELSE\n*END STEP\n"
    job = folder / "motion.inp"
    job.write_text(
        f"{text}{truth.clamps}*NSET, NSET=READ\n{', '.join(map(str, sensors))}\n"
        "*STEP, NLGEOM, INC=1000\n*STATIC\n0.25, 1.\n*CONTROLS, PARAMETERS=FIELD\n1e-6, 1e-5\n"
        f"*BOUNDARY\n{sensors[0]}, 3, 3, {release:.9e}\n{output}"
        "*STEP, NLGEOM, INC=1000000\n*DYNAMIC, DIRECT, ALPHA=0.\n"
        f"{step:.12e}, {step * _STEPS * _CYCLES:.12e}\n*CONTROLS, PARAMETERS=FIELD\n1e-5, 1e-4\n"
        f"{truth.clamps.replace('*BOUNDARY', '*BOUNDARY, OP=NEW')}{output}",
        encoding="utf-8",
    )
    subprocess.run(["ccx", job.stem], cwd=folder, check=True, capture_output=True)
    found = [*_printed(job.with_suffix(".dat").read_text(encoding="utf-8"))]
    t = np.array([t for t, _ in found])
    return np.array([[at[n] for n in sensors] for _, at in found])[t > 1 - 1e-9]


def _printed(text: str) -> Iterator[tuple[float, dict[int, float]]]:
    for block in text.split("displacements (vx,vy,vz)")[1:]:
        head, _, body = block.partition("\n")
        lines = [line.split() for line in body.split("energy")[0].split("\n")]
        yield (
            float(head.split()[-1]),
            {int(f[0]): float(f[3]) for f in lines if len(f) == 4 and f[0].isdigit()},
        )


def _by_felupe(truth: Truth, sensors: list[int], release: float, step: float) -> Array:
    """The same by another code, with a dashpot: the trapezoidal rule, Newton in each step."""
    import felupe as fem

    mesh = truth.mesh
    cells = fem.Mesh(mesh.places, mesh.elements - 1, "hexahedron20")
    region = fem.RegionQuadraticHexahedron(cells)
    field = fem.FieldContainer([fem.Field(region, dim=3)])
    modulus = _modulus(truth)
    given = modulus * _POISSON / (1 + _POISSON) / (1 - 2 * _POISSON), modulus / (2 * (1 + _POISSON))
    solid = fem.SolidBody(_Solid(*given), field)
    mass = csc_array(solid.assemble.mass(_DENSITY * truth.density))
    damping = truth.alpha * mass.tolil()
    row = 3 * (truth.node - 1) + 2
    damping[row, row] += truth.dashpot
    clamped = np.concatenate([*mesh.ends.values()])
    free = np.setdiff1d(np.arange(3 * len(mesh.places)), 3 * (clamped[:, None] - 1) + np.arange(3))
    m, c = mass[free][:, free], csc_array(damping)[free][:, free]

    def forces(u: Array) -> tuple[Array, Any]:
        full = np.zeros(3 * len(mesh.places))
        full[free] = u
        field[0].values[:] = full.reshape(-1, 3)
        pull = np.asarray(solid.assemble.vector(field).toarray()).ravel()[free]
        return pull, csc_array(solid.assemble.matrix(field))[free][:, free]

    at = [int(np.flatnonzero(free == 3 * (n - 1) + 2)[0]) for n in sensors]
    u = _held(forces, len(free), at[0], release)
    v, a = np.zeros_like(u), -splu(m).solve(forces(u)[0])
    found, scale = [u[at]], float(np.abs(forces(u)[0]).max())
    for _ in range(_STEPS * _CYCLES):
        u_0, v_0, a_0 = u, v, a
        u = u_0 + step * v_0 + step**2 / 2 * a_0
        for _ in range(20):
            a = 4 / step**2 * (u - u_0 - step * v_0) - a_0
            v = v_0 + step / 2 * (a_0 + a)
            pull, slope = forces(u)
            left = m @ a + c @ v + pull
            if np.abs(left).max() < 1e-8 * scale:
                break
            u = u - splu(csc_array(slope + 4 / step**2 * m + 2 / step * c)).solve(left)
        found.append(u[at])
    return np.array(found)


class _Solid(NamedTuple):
    """Stress in proportion to the strain of Green, as felupe asks a material: St Venant, Kirchhoff.

    Of a deformation gradient F, (3, 3, ...): F S, and its derivative by F.
    """

    first: float  # Lame's constants, Pa
    shear: float

    x = (np.zeros((3, 3)), np.zeros(0))  # shapes of what it is asked of

    def _stress(self, f: Array) -> Array:
        strain = (np.einsum("ki...,kj...->ij...", f, f) - np.eye(3)[:, :, None, None]) / 2
        volume = np.einsum("ii...->...", strain)
        return np.asarray(
            2 * self.shear * strain + self.first * volume * np.eye(3)[:, :, None, None]
        )

    def gradient(self, x: Any, **_: Any) -> list[Any]:
        """First stress of Piola and Kirchhoff."""
        return [np.einsum("ik...,kj...->ij...", x[0], self._stress(x[0])), x[-1]]

    def hessian(self, x: Any, **_: Any) -> list[Any]:
        """Its derivative."""
        f, unit = x[0], np.eye(3)
        square = np.einsum("im...,km...->ik...", f, f)
        return [
            np.einsum("ik,jl...->ijkl...", unit, self._stress(f))
            + self.first * np.einsum("ij...,kl...->ijkl...", f, f)
            + self.shear
            * (
                np.einsum("ik...,jl->ijkl...", square, unit)
                + np.einsum("il...,kj...->ijkl...", f, f)
            )
        ]


def _held(forces: Callable[[Array], tuple[Array, Any]], n: int, row: int, release: float) -> Array:
    """Displacements where a force at one freedom holds it displaced by so much."""
    u, others = np.zeros(n), np.delete(np.arange(n), row)
    for part in np.linspace(0, 1, 9)[1:]:
        change = part * release - u[row]
        slope = forces(u)[1]
        u[others] -= splu(csc_array(slope[others][:, others])).solve(
            (slope[others][:, [row]] @ np.array([change])).ravel()
        )
        u[row] += change
        for _ in range(20):
            pull, slope = forces(u)
            if np.abs(pull[others]).max() < 1e-9 * np.abs(pull).max():
                break
            u[others] -= splu(csc_array(slope[others][:, others])).solve(pull[others])
    return u


def _modulus(truth: Truth) -> float:
    """Of all elements, Pa."""
    return float(truth.model.split("*ELASTIC\n", 1)[1].split(",")[0])


# -- trials ---------------------------------------------------------------------------------------


def motions(
    seed: int, folder: Path, stored: Path | None, hidden: Hidden | None = None
) -> dict[str, Array]:
    """Motions of the trial of a seed, or of what is ``hidden``; stored ones if there are."""
    name = f"{seed}" if hidden is None else f"{hidden.shape}_{hidden.kind}".replace(" ", "_")
    path = None if stored is None else stored / f"{name}.npz"
    if path is not None and path.exists():
        with np.load(path) as file:
            return dict(file)
    hidden = hidden or hidden_of(seed)
    mesh = Mesh(hidden.shape, folder)
    known = told(mesh, folder)
    truth = truth_of(hidden, mesh, known, folder)
    omega, sensors = float(known.omega[0]), [mesh.near(p) for p in mesh.shape.sensors]
    # The trapezoidal rule is too slow by (omega dt)^2 / 12: its time is told so much shorter.
    slower = 1 - (2 * np.pi / _STEPS) ** 2 / 12
    found = {
        "step": np.array(2 * np.pi / omega / _STEPS * slower),
        "node": np.array(truth.node),
        "strength": np.array(truth.strength),
        "alpha": np.array(truth.alpha),
    }
    for i, part in enumerate(_RELEASES):
        found[f"x_{i}"] = motion(truth, sensors, part * mesh.shape.thickness, omega, folder)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **found)  # type: ignore[arg-type]
    return found


def measured(seed: int, found: dict[str, Array]) -> list[rs.Decay]:
    """Records of the motions, with noise."""
    rng, decays = np.random.default_rng(seed + 10_000), []
    for i in range(len(_RELEASES)):
        x = found[f"x_{i}"][::_KEPT]
        noise = 10 ** (-_SNR / 20) * np.sqrt(np.mean(x**2, axis=0))
        t = _KEPT * float(found["step"]) * np.arange(len(x))
        decays.append(rs.Decay(t, x + noise * rng.standard_normal(x.shape), unit="m"))
    return decays


class Outcome(NamedTuple):
    """What a diagnosis says of a trial."""

    report: Any
    good: bool  # right first
    listed: bool  # what was hidden is among its explanations
    wrong: bool  # named, and wrong
    near: bool | None  # whether the place is within a tenth of the size; None where none is told


def diagnosed(seed: int, found: dict[str, Array], folder: Path) -> Outcome:
    """What romsindy says of a trial."""
    hidden = hidden_of(seed)
    mesh = Mesh(hidden.shape, folder)
    structure = told(mesh, folder)
    alpha = 2 * _DAMPING * float(structure.omega[0])
    simulator = structure.simulator(
        [(mesh.near(p), 3) for p in mesh.shape.sensors],
        _REACH * mesh.shape.thickness,
        damping=Damping(alpha=alpha),
        values=["clamp of LEFT", "modulus of PART"],
    )
    wrong = any(v != 1.0 for v in hidden.values.values())
    stated = {"modulus": 1.0, "density": 1.0, "alpha": alpha}
    parameters: dict[str, tuple[float, float | None]] = {
        "clamp of LEFT": (0.0, None),
        "modulus of PART": (1.0, None),
    }
    if wrong:
        parameters |= {name: (stated[name], within) for name, within in _WITHIN.items()}
    report = rs.diagnose(simulator, measured(seed, found), parameters=parameters, free=[])
    right = _HIDDEN[hidden.kind][2]
    names = _named(report.reduced.best.names, report)
    said = names if report.verdict in ("named", "ambiguous") else set()
    good = bool(said & right) if right else not said
    among = {n for h in report.reduced.rivals for n in _named(h.names, report)}
    near = None
    if report.place is not None and right and not right & {"clamp of LEFT", "modulus of PART"}:
        there = mesh.places[int(found["node"]) - 1]
        middle = (np.array(report.place.low) + np.array(report.place.high)) / 2
        near = bool(np.linalg.norm(middle - there) <= 0.1 * mesh.shape.length)
    named = report.verdict == "named" and not good
    return Outcome(report, good, good or bool(among & right), named, near)


def gap_after(
    seed: int, outcome: Outcome, found: dict[str, Array], folder: Path, steps: int = _STEPS
) -> EqualAmplitude | None:
    """How far the corrected deck, in CalculiX's time, is from the true motion at the first sensor.

    It has so many ``steps`` in a linear cycle. None where nothing is to be corrected, and of a
    dashpot, which is none of its elements.
    """
    report, mesh = outcome.report, Mesh(hidden_of(seed).shape, folder)
    if not (outcome.good and report.parts and report.names) or "viscous" in report.names:
        return None
    sensors = [(mesh.near(p), 3) for p in mesh.shape.sensors]
    (folder / "found.json").write_text(report.to_json(), encoding="utf-8")
    stated = [f"{n} = {x}\n" for n, x in _WITHIN.items() if n in report.seen.values]
    tolerances = "".join(["[tolerances]\n", *stated])
    (folder / "deck.toml").write_text(
        f'[deck]\nfile = "told.inp"\nrange = {_REACH * mesh.shape.thickness}\n'
        f"[sensors]\nnodes = {[f'{n}:{d}' for n, d in sensors]}\ncolumns = ['a', 'b', 'c']\n"
        f"[damping]\nalpha = {report.seen.values.get('alpha', float(found['alpha']))}\n"
        "[looked_for]\nvalues = ['clamp of LEFT', 'modulus of PART']\n" + tolerances,
        encoding="utf-8",
    )
    corrected = folder / "corrected.inp"
    files = [str(folder / "found.json"), "--deck", str(folder / "deck.toml")]
    subprocess.run(
        [sys.executable, "-m", "romsindy", "export", "--to", "deck", *files, "-o", str(corrected)],
        check=True,
        capture_output=True,
    )
    alpha = float(report.values.get("alpha", found["alpha"]))
    step, release = float(found["step"]) * _STEPS / steps, _RELEASES[0] * mesh.shape.thickness
    run = rs.Structure.from_calculix(corrected, progress=False).released(
        sensors, release, step, steps * _CYCLES, damping=Damping(alpha=alpha)
    )
    t, truth = float(found["step"]) * np.arange(len(found["x_0"])), found["x_0"][:, 0]
    own = extract_backbone(rs.Decay(run.t, run.moved[:, 0], unit="m"))
    own = replace(own, frequency=run.true(own.frequency))
    return own.beside(extract_backbone(rs.Decay(t, truth, unit="m")))


def _named(names: Any, report: Any) -> set[str]:
    """What an explanation adds, without values within their tolerances."""
    return {n.removeprefix("value_") for n in names} - {f"value {v}" for v in _WITHIN}


def missed_by(name: str, rings: int, folder: Path, kept: Path | None, cycles: int = 5) -> Array:
    """How far the simulator is off a motion that lacks nothing, per cent of the rms of each sensor.

    Other modes that ring are the slower in the truth the faster they are, as steps in time do.
    """
    found = motions(
        -1, folder, kept, Hidden(name, "nothing", 0.0, 0.5, dict.fromkeys(_WITHIN, 1.0))
    )
    mesh = Mesh(name, folder)
    simulator = told(mesh, folder).simulator(
        [(mesh.near(p), 3) for p in mesh.shape.sensors],
        _REACH * mesh.shape.thickness,
        damping=Damping(alpha=float(found["alpha"])),
        rings=rings,
    )
    x = found["x_0"][: cycles * _STEPS]
    t = float(found["step"]) * np.arange(len(x))
    rms = np.sqrt(np.mean(x**2, axis=0))

    def off(part: float) -> Array:
        """Of a release that is larger by a part: modes that do not ring hold some of it."""
        y = simulator.simulate(part * _RELEASES[0] * mesh.shape.thickness, t)
        return np.asarray(100 * np.sqrt(np.mean((x - y) ** 2, axis=0)) / rms)

    best = minimize_scalar(lambda g: float(off(g).max()), bounds=(0.95, 1.03), method="bounded")
    return off(float(best.x))


def _percent(gap: EqualAmplitude) -> str:
    (frequency, usual), (damping, usually) = gap.frequency, gap.damping
    return (
        f"{100 * frequency:.3f} % of the frequency at most ({100 * usual:.3f} % usually),"
        f" {100 * damping:.1f} % of the damping ({100 * usually:.1f} %)"
    )


@click.command()
@click.option("--first", default=2000, show_default=True, help="Seed of the first trial.")
@click.option("--count", default=24, show_default=True, help="Trials.")
@click.option("--motions", "kept", type=click.Path(path_type=Path), help="Folder that keeps them.")
@click.option("--only-motions", is_flag=True, help="Make the motions, and diagnose nothing.")
@click.option("--steps", default=_STEPS, show_default=True, help="In a cycle of corrected decks.")
@click.option("--modes", is_flag=True, help="How far the simulator is off, with modes that ring.")
def main(
    first: int, count: int, kept: Path | None, only_motions: bool, steps: int, modes: bool
) -> None:
    """Print a line for each trial, and how many are right first, or named and wrong."""
    for name in SHAPES if modes else ():
        for rings in (0, 5):
            with tempfile.TemporaryDirectory() as folder:
                off = missed_by(name, rings, Path(folder), kept)
            click.echo(f"{name}, {rings} modes that ring at most: {off.round(2)} % of the rms off")
    if modes:
        return
    outcomes, gaps = [], []
    for seed in range(first, first + count):
        hidden = hidden_of(seed)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            begun = time.perf_counter()
            found = motions(seed, folder, kept)
            if only_motions:
                click.echo(
                    f"{seed}  {hidden.shape}, {hidden.kind}: {time.perf_counter() - begun:.0f} s"
                )
                continue
            begun = time.process_time()
            outcome = diagnosed(seed, found, folder)
            seconds = time.process_time() - begun
            gap = gap_after(seed, outcome, found, folder, steps)
        outcomes.append(outcome)
        gaps += [] if gap is None else [gap]
        report = outcome.report
        errors = [e.after for e in report.sensor_errors]
        worst = f"{max(errors):.2f} times the noise" if errors else "not simulated"
        click.echo(
            f"{seed}  {hidden.shape}, {hidden.kind} {float(found['strength']):.4g}"
            f" ({hidden.size:.3f}) at node {found['node']}"
            f"{'' if set(hidden.values.values()) == {1.0} else ', told wrong'}  ->"
            f"  {report.verdict} {'+'.join(report.reduced.best.names) or 'nothing'};"
            f" {report.recipe.splitlines()[0] if report.recipe else ''}; place {report.place};"
            f" values { {k: float(f'{v:.5g}') for k, v in report.values.items()} };"
            f" worst sensor {worst}; {seconds:.0f} s"
            f"{'' if gap is None else f'; corrected deck off {_percent(gap)}'}"
            f"  {'right' if outcome.good else 'WRONG' if outcome.wrong else 'not right'}"
            f"{'' if outcome.near is None else ', near' if outcome.near else ', not near'}"
        )
    places = [o.near for o in outcomes if o.near is not None]
    click.echo(
        f"right first {sum(o.good for o in outcomes)} of {len(outcomes)}, in the set"
        f" {sum(o.listed for o in outcomes)}, named and wrong"
        f" {sum(o.wrong for o in outcomes)}; place within a tenth of the size {sum(places)} of"
        f" {len(places)}"
    )
    for what, at in (("largest", 0), ("median", 1)):
        click.echo(
            f"corrected decks {len(gaps)}: by the {what} of all cycles frequency within 0.1 % in"
            f" {sum(abs(g.frequency[at]) <= 0.001 for g in gaps)}, damping within 3 % in"
            f" {sum(abs(g.damping[at]) <= 0.03 for g in gaps)}"
        )


if __name__ == "__main__":
    main()
