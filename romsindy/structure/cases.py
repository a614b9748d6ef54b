"""Where the shapes that a force holds come from: given with the model, or computed and kept.

What stands in the file of a deck is not computed again.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from scipy.sparse import csc_array

from romsindy.record.files.save import whole
from romsindy.structure.calculix import CalculiX
from romsindy.structure.deck import Deck
from romsindy.structure.held import Found, HeldCurve, follow, of_cases
from romsindy.structure.linear import Basis, Compliance, HeldCases, LinearMode, Matrices, compliance
from romsindy.text import bar
from romsindy.typing import Array

_MOST_CASES = 40
_TANGENTS = 8  # shapes along a curve, about which the stiffness is asked for
MARK = "static cases of romsindy"  # in the file
_SAME = 1e-12  # of a factor: so near to one that is kept it is that


class CaseStore:
    """Modes and static cases of a deck: in an NPZ file, or without one in memory alone.

    Parameters
    ----------
    path : str or Path, optional
        The file; other decks may have theirs in it too.
    deck : Deck
        Whose text says which entries are its own.

    Raises
    ------
    ValueError
        For a file that keeps no static cases: it is not overwritten.
    """

    def __init__(self, path: str | Path | None, deck: Deck) -> None:
        self.path = None if path is None else Path(path)
        self._key = hashlib.sha256(deck.text.encode()).hexdigest()[:16]
        self._content: dict[str, Array] = {}
        if self.path is not None and self.path.exists():
            self._content = _read(self.path)

    def beside(self, deck: Deck) -> CaseStore:
        """The same for another deck: both write into one file."""
        other = CaseStore(None, deck)
        other.path, other._content = self.path, self._content
        return other

    def basis(self, count: int) -> Basis | None:
        """Modes that are kept, where they are as many as asked for."""
        if not self._has("omega") or self._get("asked") < count:
            return None
        data, rows, ends = (self._get(f"mass_{name}") for name in ("data", "rows", "ends"))
        n = len(ends) - 1
        mass = csc_array((data, rows, ends), (n, n))
        freedoms = self._get("nodes"), self._get("directions")
        return Basis(Matrices(None, mass, *freedoms), self._get("omega"), self._get("shapes"))

    def keep_basis(self, basis: Basis, count: int) -> None:
        """Keep modes, of which so many were asked for, with the mass.

        Static cases of the deck go: a mode that has the frequency of another has no shape of its
        own, and was another one before.
        """
        own = [name for name in self._content if name.startswith(self._key)]
        for name in own:
            del self._content[name]
        mass = basis.known.mass
        self._put(
            asked=np.array(count),
            mass_data=mass.data,
            mass_rows=mass.indices,
            mass_ends=mass.indptr,
            nodes=basis.known.nodes,
            directions=basis.known.directions,
            omega=basis.omega,
            shapes=basis.shapes,
        )

    def cases(self, mode: int, factors: Sequence[float]) -> HeldCases | None:
        """Static cases of a mode at these factors, if all are kept."""
        if not self._has(f"factors_{mode}"):
            return None
        near = np.abs(self._get(f"factors_{mode}") - np.array(factors)[:, None])
        if np.any(near.min(axis=1) > _SAME * np.abs(factors)):
            return None
        return HeldCases(np.array(factors), self._get(f"shapes_{mode}")[np.argmin(near, axis=1)])

    def keep_cases(self, mode: int, several: Sequence[HeldCases]) -> None:
        """Keep static cases of a mode beside those that are kept; also that there is none."""
        new = [h for h in several if self.cases(mode, h.factors.tolist()) is None]
        if not new:
            return
        name = f"factors_{mode}", f"shapes_{mode}"
        before = [tuple(self._get(n) for n in name)] if self._has(name[0]) else []
        columns = zip(*before, *new, strict=True)
        self._put(**{n: np.concatenate(x) for n, x in zip(name, columns, strict=True)})

    def compliance(self, mode: int, factors: Array, shapes: Array) -> Array | None:
        """What loads of these modes do at these factors of a mode, if it is kept."""
        names = [f"compliance_{mode}_{x}" for x in ("factors", "of", "shapes")]
        if not all(self._has(n) for n in names):
            return None
        given, of, found = (self._get(n) for n in names)
        same = of.shape == shapes.shape and np.array_equal(of, shapes)
        return found if same and np.allclose(given, factors, rtol=_SAME, atol=0.0) else None

    def keep_compliance(self, mode: int, factors: Array, shapes: Array, found: Array) -> None:
        """Keep it."""
        known = {"factors": factors, "of": shapes, "shapes": found}
        self._put(**{f"compliance_{mode}_{name}": x for name, x in known.items()})

    def _has(self, name: str) -> bool:
        return f"{self._key}_{name}" in self._content

    def _get(self, name: str) -> Array:
        return self._content[f"{self._key}_{name}"]

    def _put(self, **arrays: Array) -> None:
        self._content |= {f"{self._key}_{name}": x for name, x in arrays.items()}
        if self.path is not None:
            with whole(self.path) as new, new.open("wb") as file:
                np.savez(file, made_by=np.bytes_(MARK), **self._content)  # type: ignore[arg-type]


def _read(path: Path) -> dict[str, Array]:
    try:
        with np.load(path) as file:
            content = dict(file)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile):
        content = {}
    if bytes(content.pop("made_by", b"")) != MARK.encode():
        raise ValueError(f"store = {path} keeps no static cases: name another file, or a new one")
    return content


@dataclass(frozen=True, eq=False)
class GivenCases:
    """Cases that came with the model, by number of the mode."""

    given: Mapping[int, HeldCases]
    tangents: Mapping[int, Sequence[csc_array]] = field(default_factory=dict)  # at each of them

    def curve(self, mode: LinearMode, reach: float | None, tolerance: float) -> Found:
        """The curve through all of them; neither reach nor tolerance can be asked for."""
        if mode.number not in self.given:
            raise ValueError(
                f"mode = {mode.number} has no static cases: there are some of mode"
                f" {', '.join(map(str, self.given))}"
            )
        if reach is not None:
            raise ValueError(
                f"reach = {reach} cannot be asked of cases that are given: leave it out"
            )
        return of_cases(mode, self.given[mode.number])

    def compliance(self, curve: HeldCurve, shapes: Array) -> Compliance | None:
        """Where tangents were given with the cases."""
        given = self.tangents.get(curve.mode.number)
        if given is None:
            return None
        yields = np.array([compliance(k, curve.mode.mass, shapes) for k in given])
        return Compliance(curve.at, yields)


@dataclass(frozen=True, eq=False)
class DeckCases:
    """Cases that CalculiX computes when they are asked for, and keeps."""

    program: CalculiX
    deck: Deck
    known: Matrices
    store: CaseStore
    n_jobs: int
    progress: bool

    def curve(self, mode: LinearMode, reach: float | None, tolerance: float) -> Found:
        """The curve of a mode, walked outwards by CalculiX; what was computed is kept."""
        if reach is None:
            raise ValueError("reach is not given: say how far the node that moves most is moved")
        with bar(None, f"holding {self.deck.path.name}", unit="case") as progress:
            progress.disable = progress.disable or not self.progress

            def hold(rows: Sequence[Sequence[float]]) -> list[HeldCases]:
                tasks = (delayed(self._held)(mode, row) for row in rows)
                several = list(Parallel(n_jobs=self.n_jobs, backend="threading")(tasks))
                self.store.keep_cases(mode.number, several)
                progress.update(sum(len(row) for row in rows))
                if self.store.path is not None:
                    progress.set_postfix_str(f"what was held is kept in {self.store.path}")
                return [held.reached for held in several]

            return follow(hold, mode, reach, tolerance, _MOST_CASES)

    def compliance(self, curve: HeldCurve, shapes: Array) -> Compliance:
        """By CalculiX at some shapes along the curve, or kept."""
        at, mode = curve.evenly(_TANGENTS), curve.mode
        factors = curve.force_at(at)
        kept = self.store.compliance(mode.number, factors, shapes)
        if kept is None:
            tasks = (delayed(self._compliance)(mode, f, shapes) for f in factors)
            kept = np.array(Parallel(n_jobs=self.n_jobs, backend="threading")(tasks))
            self.store.keep_compliance(mode.number, factors, shapes, kept)
        return Compliance(at, kept)

    def _compliance(self, mode: LinearMode, factor: float, shapes: Array) -> Array:
        tangent = self.program.tangent(self.deck, self.known, factor * mode.momentum)
        return compliance(tangent, mode.mass, shapes)

    def _held(self, mode: LinearMode, factors: Sequence[float]) -> HeldCases:
        """Shapes at some factors, kept or computed; nan where there is none."""
        kept = self.store.cases(mode.number, factors)
        if kept is not None:
            return kept
        held = self.program.held(self.deck, self.known, mode.momentum, factors)
        shapes = np.full((len(factors), len(mode.shape)), np.nan)
        shapes[: len(held.factors)] = held.shapes
        return HeldCases(np.array(factors), shapes)


StaticCases = GivenCases | DeckCases  # where the shapes that a force holds come from
