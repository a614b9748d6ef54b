"""CalculiX as the solver of a deck: its matrices, and the shapes that forces hold.

CalculiX is an external program (ccx, GPL), which is only called: the model part of the deck with
steps of our own. Tried with version 2.20.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array

from romsindy.structure.deck import Deck, DeckError
from romsindy.typing import Array

_SET = "ROMSINDY_FREE"
_PER_LINE = 16  # entries in a line of a deck, at most
_MATRICES = "*STEP\n*FREQUENCY,SOLVER=MATRIXSTORAGE\n*END STEP\n"
_TANGENT = _MATRICES.replace("*STEP", "*STEP,PERTURBATION", 1)
# The default of 0.5 % of the mean force is far above what a fit can bear.
_HELD = (
    "*STEP,NLGEOM,INC=1000\n*STATIC\n1.,1.\n*CONTROLS,PARAMETERS=FIELD\n1e-7,1e-6\n"
    "*CLOAD,OP=NEW\n{loads}\n*NODE PRINT,NSET={free}\nU\n*END STEP\n"
)
_ERROR = re.compile(r"\*ERROR[^\n]*(?:\n(?!\s*\*)[^\n]*)?")
_TOLD = 400  # characters of what ccx says
_INSTALL = (
    "install it (Debian and Ubuntu: apt install calculix-ccx; others: www.calculix.de), or name"
    " the program with ccx="
)


class Matrices(NamedTuple):
    """Stiffness and mass of the free freedoms, and which these are."""

    stiffness: Any  # (n, n) csc_array; None where modes were kept, which alone ask for it
    mass: csc_array
    nodes: Array  # (n,), numbers
    directions: Array  # (n,), 1 to 3


class HeldCases(NamedTuple):
    """Static cases: shapes that multiples of one load hold."""

    factors: Array  # (m,)
    shapes: Array  # (m, n), displacements of the free freedoms; nan where nothing holds

    @property
    def reached(self) -> HeldCases:
        """Those that have a shape."""
        there = np.all(np.isfinite(self.shapes), axis=1)
        return HeldCases(self.factors[there], self.shapes[there])


@dataclass(frozen=True)
class CalculiX:
    """The program, and where it works.

    Parameters
    ----------
    program : str
        Its name on the path, or its file.
    folder : str or Path, optional
        Where decks and results of all jobs are kept; by default they are deleted.
    """

    program: str = "ccx"
    folder: str | Path | None = None

    def matrices(self, deck: Deck) -> Matrices:
        """Stiffness and mass of a deck about its undeformed shape.

        Raises
        ------
        DeckError
            Where CalculiX refuses the deck, no freedom is free, freedoms stand twice, or the mass
            of one is not positive.
        """
        with self._job("matrices", deck.text + _MATRICES) as job:
            job.run()
            labels = job.read(".dof").split()
            if not labels:
                raise DeckError(f"{deck.path}: no freedom is free: all nodes are held")
            pairs = np.array([[*map(int, label.split("."))] for label in labels])
            found = [_symmetric(job.path(ending), len(labels)) for ending in (".sti", ".mas")]
        if len(np.unique(pairs, axis=0)) < len(pairs):
            raise DeckError(
                f"{deck.path}: CalculiX counts freedoms of some nodes twice, as it does where it"
                " expands elements: use solids, masses and springs"
            )
        stiffness, mass = found
        light = np.flatnonzero(mass.diagonal() <= 0)
        if len(light):
            node, direction = pairs[light[0]]
            raise DeckError(
                f"{deck.path}: node {node} has no mass in direction {direction}: mass must be"
                " positive; give *DENSITY to all materials"
            )
        return Matrices(stiffness, mass, pairs[:, 0], pairs[:, 1])

    def held(self, deck: Deck, known: Matrices, load: Array, factors: Sequence[float]) -> HeldCases:
        """Shapes held by multiples of a load (n,), walked from the first factor on.

        They end where CalculiX finds no further equilibrium.

        Raises a DeckError where it refuses the deck.
        """
        steps = [_step(known, factor * load) for factor in factors]
        text = deck.text + _node_set(known.nodes) + "".join(steps)
        with self._job("held", text) as job:
            job.run(may_end=True)
            shapes = [x for step, x in _printed(job.read(".dat"), known) if step <= len(factors)]
        return HeldCases(np.array(factors[: len(shapes)]), np.reshape(shapes, (-1, len(load))))

    def tangent(self, deck: Deck, known: Matrices, load: Array) -> csc_array:
        """Stiffness of the free freedoms (n, n) about the shape that a load (n,) holds.

        Raises a DeckError where CalculiX finds no such shape.
        """
        text = deck.text + _node_set(known.nodes) + _step(known, load) + _TANGENT
        with self._job("tangent", text) as job:
            job.run()
            return _symmetric(job.path(".sti"), len(load))

    @contextmanager
    def _job(self, name: str, text: str) -> Iterator[_Job]:
        program = shutil.which(self.program)
        if program is None:
            raise DeckError(f"no CalculiX: there is no program {self.program!r}; {_INSTALL}")
        if self.folder is None:
            with tempfile.TemporaryDirectory() as folder:
                yield _Job(program, Path(folder), name, text)
            return
        Path(self.folder).mkdir(parents=True, exist_ok=True)
        folder = tempfile.mkdtemp(prefix=f"{name}_", dir=self.folder)
        yield _Job(program, Path(folder), name, text)


@dataclass(frozen=True)
class _Job:
    program: str
    folder: Path
    name: str
    text: str

    def path(self, ending: str) -> Path:
        return self.folder / f"{self.name}{ending}"

    def read(self, ending: str) -> str:
        path = self.path(ending)
        return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""

    def run(self, *, may_end: bool = False) -> None:
        """Run it; with ``may_end`` it may stop where there is no further equilibrium."""
        self.path(".inp").write_text(self.text, encoding="utf-8")
        done = subprocess.run(
            [self.program, self.name],
            cwd=self.folder,
            check=False,
            capture_output=True,
            text=True,
            errors="replace",
            stdin=subprocess.DEVNULL,
        )
        said = f"{done.stdout}\n{done.stderr}"
        self.path(".printed").write_text(said, encoding="utf-8")
        error = _ERROR.search(said)
        stuck = "too many cutbacks" in said or "increment size smaller" in said
        if may_end and stuck and self.read(".sta").count("\n") >= 2:
            return
        if error is not None or done.returncode:
            what = " ".join((error[0] if error else said[-_TOLD:]).split())[:_TOLD]
            raise DeckError(f"CalculiX refuses the deck ({self.name}): {what}")


def _symmetric(path: Path, n: int) -> csc_array:
    """A matrix from its upper triangle, "row column value" in each line."""
    rows, columns, values = np.loadtxt(path, ndmin=2).T
    place = rows.astype(int) - 1, columns.astype(int) - 1
    half = coo_array((values, place), (n, n)).tocsc()
    return csc_array(half + half.T - diags_array(half.diagonal()))


def _step(known: Matrices, load: Array) -> str:
    rows = zip(known.nodes, known.directions, load, strict=True)
    loads = "\n".join(f"{node},{direction},{force:.12e}" for node, direction, force in rows)
    return _HELD.format(loads=loads, free=_SET)


def _node_set(nodes: Array) -> str:
    numbers = [str(n) for n in np.unique(nodes)]
    lines = [numbers[i : i + _PER_LINE] for i in range(0, len(numbers), _PER_LINE)]
    return f"*NSET,NSET={_SET}\n" + "".join(",".join(line) + ",\n" for line in lines)


def _printed(text: str, known: Matrices) -> Iterator[tuple[int, Array]]:
    """Number of the step, and displacements of the free freedoms, where a step was completed."""
    row_of = {node: i for i, node in enumerate(np.unique(known.nodes))}
    rows = [row_of[node] for node in known.nodes]
    for block in text.split("displacements (vx,vy,vz)")[1:]:
        head, _, body = block.partition("\n")
        time = float(head.split()[-1])
        if abs(time - round(time)) > 1e-6:  # an increment within a step
            continue
        table = np.array([line.split() for line in body.split("\n") if line.strip()], float)
        if len(table) < len(row_of):
            return  # the file was cut off there
        order = np.argsort(table[:, 0])
        yield round(time), table[order][rows, known.directions]
