"""CalculiX as the solver of a deck: its matrices, and the shapes that forces hold.

CalculiX is an external program (ccx, GPL), which is only called: the model part of the deck with
steps of our own. Tried with version 2.20.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array

from romsindy.structure.deck import Deck, DeckError
from romsindy.structure.linear import HeldCases, Matrices
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
# ALPHA=0 damps nothing by itself. In a nonlinear step *DYNAMIC asks for energy from the first on.
_RELEASED = (
    "*NSET,NSET={told}\n{nodes}\n*ELSET,ELSET={told}\n{element}\n"
    "*STEP,NLGEOM,INC=1000\n*STATIC\n{step:.9e},{step:.9e}\n*CONTROLS,PARAMETERS=FIELD\n1e-7,1e-6\n"
    "*CLOAD\n{loads}\n{output}"
    "*STEP,NLGEOM,INC={most}\n*DYNAMIC,DIRECT,ALPHA=0.\n{step:.9e},{end:.9e}\n"
    "*CONTROLS,PARAMETERS=FIELD\n1e-6,1e-5\n*CLOAD,OP=NEW\n{free},0.\n{output}"
)
_TOLD_IN_TIME = "*NODE PRINT,NSET={0}\nU\n*EL PRINT,ELSET={0},TOTALS=ONLY\nELSE\n*END STEP\n"
_HEAD = 2  # lines of a .sta before those of the increments
_WHOLE = 0.1  # of a step: nearer to the end of one
STOPPED = "it was interrupted"
_LOOKS = 0.5  # s, between looks at how far a job is
_STUCK = ("too many cutbacks", "increment size smaller", "seems to diverge")
_ERROR = re.compile(r"\*ERROR[^\n]*(?:\n(?!\s*\*)[^\n]*)?")
_MOST_TOLD = 400  # characters of what ccx says
_INSTALL = (
    "install it (Debian and Ubuntu: apt install calculix-ccx; others: www.calculix.de), or name"
    " the program with ccx="
)


Told = Callable[[int], object]  # of the number of increments that are done


class Released(NamedTuple):
    """A structure that was let go, in time."""

    t: Array  # (m,), s, even, from the release on
    moved: Array  # (m, k), displacements of some freedoms
    rayleigh: tuple[float, float]  # factors of mass (1/s) and stiffness (s) that damp it
    ended: str = ""  # why it ended before its time

    def true(self, omega: Array) -> Array:
        """Frequencies, rad/s, of what is seen at some: the trapezoidal rule is too slow."""
        step = self.t[1] - self.t[0]
        return np.asarray(2 / step * np.tan(omega * step / 2))


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

    def released(
        self,
        deck: Deck,
        known: Matrices,
        load: Array,
        rows: Sequence[int],
        step: float,
        count: int,
        rayleigh: tuple[float, float] = (0.0, 0.0),
        told: Told = lambda _: None,
    ) -> Released:
        """Displacements of some freedoms after a load (n,) that held the structure is let go.

        By ``*DYNAMIC`` in so many steps, s, of the trapezoidal rule, whose period is too long by
        (omega step)^2 / 12, see `Released.true`; as many as converge before an interruption.

        Raises a DeckError where CalculiX refuses the deck, or takes no step.
        """
        where = known.nodes[rows], known.directions[rows]
        steps = _RELEASED.format(
            told=_SET,
            nodes=_in_lines(where[0]),
            element=deck.solid,
            step=step,
            end=count * step,
            most=count + 1,
            loads=_loads(known, load),
            free=f"{known.nodes[0]},{known.directions[0]}",
            output=_TOLD_IN_TIME.format(_SET),
        )
        ended = ""
        with self._job("released", _damped(deck, *rayleigh) + steps) as job:
            try:
                job.run(may_end=True, told=told)
            except KeyboardInterrupt:
                ended = STOPPED
            tables = {
                round(time / step) - 1: table
                for time, table in _blocks(job.read(".dat"), where[0])
                if time > step / 2 and abs(time / step - round(time / step)) < _WHOLE
            }
        order = np.searchsorted(np.unique(where[0]), where[0])
        moved = np.array([tables[i][order, where[1]] for i in range(len(tables))])
        if len(moved) < 2 and ended:
            raise KeyboardInterrupt
        if len(moved) < 2:
            raise DeckError(f"{deck.path}: CalculiX takes no step in time after the release")
        if not ended and len(moved) <= count:
            ended = "the next step does not converge in CalculiX"
        return Released(step * np.arange(len(moved)), moved, rayleigh, ended)

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

    def run(self, *, may_end: bool = False, told: Told = lambda _: None) -> None:
        """Run it; with ``may_end`` it may stop where there is no further equilibrium."""
        self.path(".inp").write_text(self.text, encoding="utf-8")
        with subprocess.Popen(
            [self.program, self.name],
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            stdin=subprocess.DEVNULL,
        ) as ccx:
            said = None
            try:
                while said is None:
                    try:
                        said, _ = ccx.communicate(timeout=_LOOKS)
                    except subprocess.TimeoutExpired:
                        told(self.read(".sta").count("\n") - _HEAD)
            except BaseException:  # as `subprocess.run` does
                ccx.kill()
                raise
        self.path(".printed").write_text(said, encoding="utf-8")
        error = _ERROR.search(said)
        stuck = any(words in said for words in _STUCK)
        if may_end and stuck and self.read(".sta").count("\n") >= _HEAD:
            return
        if error is not None or ccx.returncode:
            what = " ".join((error[0] if error else said[-_MOST_TOLD:]).split())[:_MOST_TOLD]
            raise DeckError(f"CalculiX refuses the deck ({self.name}): {what}")


def _symmetric(path: Path, n: int) -> csc_array:
    """A matrix from its upper triangle, "row column value" in each line."""
    rows, columns, values = np.loadtxt(path, ndmin=2).T
    half = coo_array((values, (rows.astype(int) - 1, columns.astype(int) - 1)), (n, n)).tocsc()
    return csc_array(half + half.T - diags_array(half.diagonal()))


def _damped(deck: Deck, alpha: float, beta: float) -> str:
    """The model with Rayleigh damping: of its springs and masses as well, as was tried."""
    lines: list[str] = []
    for card in deck.cards:
        if card.name == "DENSITY" and (alpha or beta):
            lines.append(f"*DAMPING,ALPHA={alpha:.9e},BETA={beta:.9e}")
        lines += () if card.name == "DAMPING" else card.lines
    return "\n".join(lines) + "\n"


def _step(known: Matrices, load: Array) -> str:
    return _HELD.format(loads=_loads(known, load), free=_SET)


def _loads(known: Matrices, load: Array) -> str:
    rows = zip(known.nodes, known.directions, load, strict=True)
    return "\n".join(f"{node},{direction},{force:.12e}" for node, direction, force in rows if force)


def _node_set(nodes: Array) -> str:
    return f"*NSET,NSET={_SET}\n{_in_lines(nodes)}\n"


def _in_lines(nodes: Array) -> str:
    numbers = [str(n) for n in np.unique(nodes)]
    lines = [numbers[i : i + _PER_LINE] for i in range(0, len(numbers), _PER_LINE)]
    return "\n".join(",".join(line) + "," for line in lines)


def _printed(text: str, known: Matrices) -> Iterator[tuple[int, Array]]:
    """Number of the step, and displacements of the free freedoms, where a step was completed."""
    rows = np.searchsorted(np.unique(known.nodes), known.nodes)
    for time, table in _blocks(text, known.nodes):
        if abs(time - round(time)) < 1e-6:  # no increment within a step
            yield round(time), table[rows, known.directions]


def _blocks(text: str, nodes: Array) -> Iterator[tuple[float, Array]]:
    """Times, and numbers and displacements (k, 4) of some nodes, in the order of their numbers."""
    count = len(np.unique(nodes))
    whole = text.rpartition("\n")[0]  # lines
    for block in whole.split("displacements (vx,vy,vz)")[1:]:
        head, *body = [line.split() for line in block.split("\n") if line.strip()]
        if len(body) < count or len(body[count - 1]) < 4:
            return  # the file was cut off there
        table = np.array(body[:count], float)
        yield float(head[-1]), table[np.argsort(table[:, 0])]
