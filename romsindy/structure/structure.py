"""A structure of finite elements, of a deck or of arrays: the place from which all is asked."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.sparse import coo_array, csc_array, issparse

from romsindy.physics.validation import require_positive
from romsindy.record.files.columns import library
from romsindy.structure.calculix import CalculiX, Released, Told
from romsindy.structure.cases import CaseStore, DeckCases, GivenCases, StaticCases
from romsindy.structure.deck import Deck
from romsindy.structure.held import Found
from romsindy.structure.linear import HeldCases, LinearModel, Units, check_arrays, linear_modes
from romsindy.structure.parts import CLAMP, PART, SOFT, PartValue, softened
from romsindy.structure.reduction import Reduction, reduced
from romsindy.structure.ringing import RungModes
from romsindy.structure.simulator import (
    HELD_BY,
    Damping,
    Member,
    PartDecks,
    StructureSimulator,
    member_of,
)
from romsindy.typing import Array

_MODES = 20  # beside the one that is asked for: those that may follow it
_TOLERANCE = 1e-4
_RING, _LOWEST = 12, 3  # modes that ring beside the one that is kept, and the lowest of them
_RUNG = 0.003  # of the mode that is kept, at a sensor: what a release rings less is noise
_HELD_AT, _TRIED = 1e-3, 20  # so near to a release, part of it, a load is looked for, and cases
_SEEN = 1e-3  # of the largest displacement of a mode: a sensor that it moves less does not see it


@dataclass(frozen=True, eq=False, repr=False)
class Structure(LinearModel):
    """A structure of finite elements about its undeformed rest.

    Made by `from_calculix` or `from_arrays`. Units are those of the model: with m, kg and s the
    coordinate q of a mode is in kg^0.5 m.

    Examples
    --------
    A mass of 2 kg, held by 8 q + 3 q^3 for a q in kg^0.5 m:

    >>> q = np.array([-2.0, -1.0, 1.0, 2.0])
    >>> held = 8 * q + 3 * q**3, q[:, None] / np.sqrt(2)
    >>> mass = Structure.from_arrays([[2.0]], [[1.0]], [8**0.5], {1: held}, [1], [1])
    >>> round(mass.reduce(1).model.coefficients["gamma_3"], 9)
    3.0
    """

    cases: StaticCases = field(kw_only=True)

    @classmethod
    def from_calculix(
        cls,
        deck: str | Path,
        *,
        ccx: str = "ccx",
        folder: str | Path | None = None,
        store: str | Path | None = None,
        n_jobs: int = 1,
        modes: int = _MODES,
        progress: bool = True,
    ) -> Structure:
        """Read a deck of CalculiX, whose program ccx gives the matrices and, later, static cases.

        Parameters
        ----------
        deck : str or Path
            Up to its first step it is the model; supports may stand in that step. Solids
            (C3D4 to C3D20R), masses and springs.
        ccx : str
            The program, on the path or as a file.
        folder : str or Path, optional
            Where all files of CalculiX are kept; by default they are deleted.
        store : str or Path, optional
            NPZ file in which static cases are kept: what stands there is not computed again.
        n_jobs : int
            Both directions side by side with 2.
        modes : int
            Number of linear modes, at least the one to be reduced.
        progress : bool
            Whether to show a progress bar on a terminal.

        Raises
        ------
        DeckError
            For a deck that cannot be reduced, or no CalculiX: file, line and remedy.
        """
        model, program = Deck.load(deck), CalculiX(ccx, folder)
        return cls._of_deck(model, program, CaseStore(store, model), n_jobs, modes, progress)

    @classmethod
    def _of_deck(
        cls, deck: Deck, program: CalculiX, kept: CaseStore, n_jobs: int, modes: int, progress: bool
    ) -> Structure:
        basis = kept.basis(modes)
        if basis is None:
            basis = linear_modes(str(deck.path), program.matrices(deck), modes)
            kept.keep_basis(basis, modes)
        known = basis.known
        return cls(
            str(deck.path),
            known.mass,
            basis.omega,
            basis.shapes,
            known.nodes,
            known.directions,
            deck.nodes,
            deck.notes,
            deck.faces,
            deck.node,
            cases=DeckCases(program, deck, known, kept, n_jobs, progress),
        )

    def varied(self, name: str, value: float) -> Structure:
        """The structure with another value of a part of its deck.

        Parameters
        ----------
        name : str
            "modulus of SET" or "density of SET", over those of the deck, of a set of elements that
            has a section; "thickness of SET", the same of a set of solids, whose nodes are moved
            from its middle surface; "clamp of SET", the compliance of all nodes of a set that is
            held, unit of length in one of force: springs hold them then.
        value : float
            Of that.

        Raises
        ------
        ValueError
            For arrays, another name, or a set that is not there.
        """
        own, part = self.cases, PartValue.of_name(name)
        if part is None or not isinstance(own, DeckCases):
            raise ValueError(
                f"{name!r} is no value of a part of {self.name}: a deck has such as 'modulus of"
                " SET', 'density of SET', 'thickness of SET' and 'clamp of SET'"
            )
        deck = part.deck(own.deck, value)
        kept = own.store.beside(deck)
        return self._of_deck(deck, own.program, kept, own.n_jobs, len(self.omega), own.progress)

    @classmethod
    def from_arrays(
        cls,
        mass: Any,
        shapes: Any,
        omega: Any,
        cases: Mapping[int, tuple[Any, Any]],
        nodes: Any,
        directions: Any,
        coordinates: Any = None,
        name: str = "arrays",
        tangents: Mapping[int, Sequence[Any]] | None = None,
    ) -> Structure:
        """Make a structure of what any finite-element program can give.

        Parameters
        ----------
        mass : (n, n) array or sparse array
            Of the free freedoms.
        shapes : (k, n) array
            Linear modes, in any scale.
        omega : (k,) array
            Their frequencies, rad/s.
        cases : dict
            By number of the mode (from 1): factors (m,), and displacements (m, n) under the loads
            factor * mass @ shape, with the shape scaled to shape @ mass @ shape = 1.
        nodes, directions : (n,) arrays of int
            Node, and direction from 1 to 3, of each freedom.
        coordinates : dict, optional
            (3,) by number of the node, for pictures.
        tangents : dict, optional
            By number of the mode: the tangent stiffness (n, n) at each of its cases, which says how
            other modes are stiffened along it. Without it they are as stiff as at rest.

        Raises
        ------
        ValueError
            For arrays that do not fit together, or cases that their loads cannot hold.
        """
        matrix, rows = csc_array(mass), np.atleast_2d(np.asarray(shapes, float))
        n, frequencies = matrix.shape[0], np.atleast_1d(np.asarray(omega, float))
        check_arrays(matrix, rows, frequencies, np.asarray(nodes), np.asarray(directions))
        rows = rows / np.sqrt(np.sum((rows @ matrix) * rows, axis=1))[:, None]
        signs = np.sign(rows[np.arange(len(rows)), np.argmax(np.abs(rows), axis=1)])
        given = {}
        for mode, (factors, displacements) in cases.items():
            held = HeldCases(np.asarray(factors, float), np.asarray(displacements, float))
            if held.shapes.shape != (len(held.factors), n):
                raise ValueError(
                    f"cases[{mode}] has factors {held.factors.shape} and displacements"
                    f" {held.shapes.shape}: give m factors, and (m, {n}) displacements"
                )
            given[int(mode)] = held._replace(factors=signs[int(mode) - 1] * held.factors)
        stiff = {int(m): [csc_array(k) for k in ks] for m, ks in dict(tangents or {}).items()}
        for mode, several in stiff.items():
            came, wanted = {k.shape for k in several}, {(n, n)}
            count = len(given[mode].factors) if mode in given else 0
            if len(several) != count or came != wanted:
                raise ValueError(
                    f"tangents[{mode}] are {len(several)} of shape {sorted(came)}: give one of"
                    f" {(n, n)} for each of the {count} cases of the mode"
                )
        places = {int(k): np.asarray(x, float) for k, x in dict(coordinates or {}).items()}
        return cls(
            name,
            matrix,
            frequencies,
            signs[:, None] * rows,
            np.asarray(nodes),
            np.asarray(directions),
            places,
            cases=GivenCases(given, stiff),
        )

    def static_curve(
        self, mode: int = 1, reach: float | None = None, tolerance: float = _TOLERANCE
    ) -> Found:
        """Shapes under the force of one mode, and their error.

        Parameters
        ----------
        mode : int
            Counted from 1.
        reach : float, optional
            How far the node that moves most is moved, in either direction, unit of length of the
            model. Arrays hold what they hold.
        tolerance : float
            Cases are added until K(q) and h(q) change by less than this part of their largest
            change.

        Raises
        ------
        ValueError
            For a mode that is not known, or cases that are too few.
        """
        if reach is not None:
            require_positive("reach", reach)
        require_positive("tolerance", tolerance)
        return self.cases.curve(self.mode(mode), reach, tolerance)

    def reduce(
        self,
        mode: int = 1,
        reach: float | None = None,
        order: int | None = None,
        *,
        sensor: tuple[int | str, int] | None = None,
        damping_ratio: float = 0.0,
        units: tuple[str, str] = ("m", "kg"),
        tolerance: float = _TOLERANCE,
    ) -> Reduction:
        """Return the reduced equation of one mode, and how far it can be trusted.

        Parameters
        ----------
        mode, reach, tolerance
            As for `static_curve`.
        order : int, optional
            Highest power in the restoring force, 3 or more; by default the lowest that follows K
            and h.
        sensor : (node, direction), optional
            The coordinate is then what the mode alone moves there, in the unit of length, in the
            place of the modal one.
        damping_ratio : float
            Of small vibrations; 0 leaves damping out.
        units : (length, mass)
            Names of the model's units; its time is in seconds.
        """
        row = None if sensor is None else self.freedom(*sensor)
        found = self.static_curve(mode, reach, tolerance)
        return reduced(self, found, order, row, damping_ratio, units)

    def simulator(
        self,
        sensors: Sequence[tuple[int | str, int]],
        reach: float | None = None,
        mode: int = 1,
        *,
        point: tuple[int | str, int] | None = None,
        damping: Damping | float = 0.0,
        rings: int = _RING,
        held_by: str = "force",
        units: Units | None = None,
        values: Sequence[str] = (),
        tolerance: float = _TOLERANCE,
    ) -> StructureSimulator:
        """Return the structure as a simulator, which `diagnose` compares with measured decays.

        Parameters
        ----------
        sensors : sequence of (node, direction)
            Where displacements were measured, in the order of the channels; at the first the
            structure is let go.
        mode, reach, tolerance
            As for `static_curve`.
        point : (node, direction), optional
            Where what is missing acts.  [default: it is looked for]
        damping : Damping or float
            Of all modes, or one damping ratio for them. "damping_ratio", "alpha" and "beta" are
            values of the simulator, as are "modulus" and "density" over those of the model.
        rings : int
            Number of further modes that ring beside it, at most: the three lowest that move a
            sensor, and those that a force at the first sensor bends most.
        held_by : str
            What holds the structure until it is let go: a "force" at the first sensor, or the modal
            force of the "mode".
        units : Units, optional
            SI units in one of the model.  [default: m, kg]
        values : sequence of str
            Values of parts that the simulator takes as well, as `varied` names them; a clamp in
            m/N. Further decks are held for each, with a polynomial between them.
        """
        stated = damping if isinstance(damping, Damping) else Damping(damping)
        for name, value in stated._asdict().items():
            require_positive(name, value, zero_allowed=True)
        if held_by not in HELD_BY:
            raise ValueError(f"held_by = {held_by!r} is none of {', '.join(HELD_BY)}")
        if not sensors:
            raise ValueError("sensors = []: say where the decays were measured, such as [(412, 3)]")
        rows = [self.freedom(*sensor) for sensor in sensors]
        acts = rows[0] if point is None else self.freedom(*point)
        curve = self.static_curve(mode, reach, tolerance).curve
        others = self._rung(mode, rows, rings, held_by)
        known = self.cases.compliance(curve, self.shapes[[n - 1 for n in (mode, *others)]])
        at = [n - 1 for n in others]
        ringing = RungModes.of(curve, others, self.omega[at] ** 2, self.shapes[at], known)
        si, kept = units or Units(), [mode, *others]

        def member(at: Mapping[str, float]) -> Member:
            """The deck with values of parts, in its own units."""
            deck: Structure = self
            for name, value in at.items():
                deck = deck.varied(name, value)
            return member_of(
                self, kept, deck, lambda n: deck.static_curve(n, reach, tolerance).curve
            )

        parts = {name: self._between(name, kept, si, member) for name in values}
        given = self, rows, acts, point is None, stated, ringing, held_by, si, parts
        return StructureSimulator(
            *given, lambda at: member({name: x / parts[name].unit for name, x in at.items()})
        )

    def _rung(self, mode: int, rows: list[int], most: int, held_by: str) -> list[int]:
        """Numbers of the modes that ring: the lowest that sensors see, and what a release rings."""
        seen = np.abs(self.shapes[:, rows])
        loud = np.abs(self.shapes).max(axis=1)
        vibrates = (self.omega > 0) & (seen.max(axis=1) > _SEEN * loud)
        others = [i for i in np.flatnonzero(vibrates).tolist() if i + 1 != mode]
        lowest = others[: min(_LOWEST, most)]
        if held_by == "force":
            bent = seen[others, :1] * seen[others] / self.omega[others, None] ** 2
            own = seen[mode - 1, 0] * seen[mode - 1] / self.omega[mode - 1] ** 2
            part = (bent / np.maximum(own, 1e-300)).max(axis=1)
            rung = [i for x, i in sorted(zip(-part, others, strict=True)) if -x > _RUNG]
            lowest += [i for i in rung if i not in lowest][: most - len(lowest)]
        return [i + 1 for i in sorted(lowest)]

    def released(
        self,
        sensors: Sequence[tuple[int | str, int]],
        release: float,
        step: float,
        count: int,
        mode: int = 1,
        *,
        held_by: str = "force",
        damping: Damping | None = None,
        told: Told = lambda _: None,
    ) -> Released:
        """Let the deck itself go, with all its modes, in CalculiX's own time (``*DYNAMIC``).

        Parameters
        ----------
        sensors, mode, held_by
            As for `simulator`.
        release : float
            Displacement of the first sensor, unit of length of the deck.
        step, count : float, int
            s, and how many: a 200th of a cycle, less where half of that changes what is seen.
        damping : Damping, optional
            CalculiX takes Rayleigh damping: a ratio is that of the mode and, where a force held it,
            of the mode that rings most beside it.
        told : callable, optional
            Takes the number of steps that are done.

        Raises
        ------
        ValueError
            For arrays, and a release that no load holds.
        """
        own, rows = self.cases, [self.freedom(*sensor) for sensor in sensors]
        if not isinstance(own, DeckCases):
            raise ValueError(f"{self.name} is no deck: arrays have no motion in CalculiX's time")
        self.mode(1)  # what is rigid cannot be held
        load, beside = self.mode(mode).momentum, np.inf
        if held_by == "force":
            load = np.eye(1, len(self.nodes), rows[0])[0]
            rung = (self.shapes[:, rows[0]] / self.omega) ** 2
            others = np.where(np.arange(len(rung)) + 1 == mode, 0, rung)
            beside = float(self.omega[np.argmax(others)])
        rayleigh = (damping or Damping()).rayleigh(float(self.omega[mode - 1]), beside)
        load = self._holding(own, load, rows[0], release) * load
        return own.program.released(own.deck, own.known, load, rows, step, count, rayleigh, told)

    def _holding(self, own: DeckCases, load: Array, row: int, release: float) -> float:
        """Times a load that displaces a freedom by ``release``, by secants from the linear one."""
        before, at = 0.0, 0.0
        factor = release / float(self.shapes[:, row] @ (self.shapes @ load / self.omega**2))
        for _ in range(_TRIED):
            held = own.program.held(own.deck, own.known, load, [factor])
            if not len(held.factors):  # nothing holds so much
                factor = (before + factor) / 2
                continue
            x = float(held.shapes[0, row])
            if abs(x / release - 1) < _HELD_AT:
                return factor
            there = factor + (release - x) * (factor - before) / (x - at)
            before, at, factor = factor, x, there
        raise ValueError(
            f"release = {release:.4g} is held by no load in CalculiX on {self.name}, which found"
            f" {at:.4g} last: it may snap through before; take a smaller one"
        )

    def _between(
        self,
        name: str,
        kept: list[int],
        units: Units,
        member: Callable[[Mapping[str, float]], Member],
    ) -> PartDecks:
        """Decks with other values of a part."""
        part = PartValue.of_name(name)
        assumed, unit, scale, values = 1.0, 1.0, 0.0, [1 + PART * x for x in (-1, -0.5, 0.5, 1)]
        if part is not None and part.kind == CLAMP:
            mode, unit = self.mode(kept[0]), units.length / units.force

            def omega2(compliance: float) -> float:
                return float(self.varied(name, compliance).omega[kept[0] - 1] ** 2)

            slight = 1e-3 * float(np.abs(mode.shape).max()) ** 2 / mode.omega2
            softer = softened(omega2, slight)
            assumed, scale, values = 0.0, unit * softer * SOFT[0], [softer * x for x in SOFT]

        return PartDecks(assumed, tuple((unit * v, member({name: v})) for v in values), scale, unit)


# -- arrays of any program -------------------------------------------------------------------------

_NEEDED = ("mass", "shapes", "omega", "nodes", "directions")
_CASE = re.compile(r"factors_(\d+)$")
KINDS = (".npz", ".mat", ".h5", ".hdf5")


def load_structure(path: str | Path) -> Structure:
    """Read the arguments of `Structure.from_arrays` from an NPZ, a MATLAB or an HDF5 file.

    It holds mass (n, n), or mass_row, mass_column (counted from 0) and mass_value of its entries;
    shapes (k, n), omega (k,), nodes (n,), directions (n,); of each mode that was held, such as the
    first, factors_1 (m,) and displacements_1 (m, n), and if they are known tangents_1 (m, n, n);
    and, for pictures, coordinates (n_nodes, 4): number of the node, x, y, z.

    Raises
    ------
    ValueError
        For a file that cannot be read, an array that is missing, or arrays that do not fit.
    """
    content = _content(Path(path))
    if "mass" not in content and "mass_value" in content:
        rows, columns = (_flat(content[f"mass_{name}"]).astype(int) for name in ("row", "column"))
        size = max(rows.max(), columns.max()) + 1
        content["mass"] = coo_array((_flat(content["mass_value"]), (rows, columns)), (size, size))
    missing = [name for name in _NEEDED if name not in content]
    modes = [int(found[1]) for name in content if (found := _CASE.match(name))]
    if missing or not modes:
        name = missing[0] if missing else "factors_1"
        raise ValueError(
            f"{path}: there is no array {name!r}: a structure has {', '.join(_NEEDED)}, and"
            " factors_1 with displacements_1 of static cases"
        )
    try:
        cases = {m: (_flat(content[f"factors_{m}"]), content[f"displacements_{m}"]) for m in modes}
        places = np.asarray(content.get("coordinates", np.zeros((0, 4))))
        return Structure.from_arrays(
            content["mass"],
            content["shapes"],
            _flat(content["omega"]),
            cases,
            _flat(content["nodes"]).astype(int),
            _flat(content["directions"]).astype(int),
            {int(row[0]): row[1:] for row in places},
            str(path),
            {m: content[f"tangents_{m}"] for m in modes if f"tangents_{m}" in content},
        )
    except (KeyError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def _content(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file")
    if path.suffix.lower() == ".mat":
        return dict(loadmat(path, squeeze_me=False))
    if path.suffix.lower() in (".h5", ".hdf5"):
        with library("h5py", path).File(path) as file:
            return {name: np.asarray(values) for name, values in file.items()}
    with np.load(path) as file:
        return dict(file)


def _flat(values: Any) -> Any:
    return np.asarray(values.todense() if issparse(values) else values).ravel()
