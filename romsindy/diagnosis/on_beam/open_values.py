"""Values of a beam that its first mode leaves open, and what higher modes tell of them.

Along the first mode many values do the same as others, or as what is missing: it tells one
combination of them, and is the prior of the others. Higher modes have frequencies and rates that
other combinations move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from romsindy.diagnosis.evidence import Hypothesis
from romsindy.diagnosis.on_beam.all_sensors import OpenValues
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.mounted import BeamEffect
from romsindy.diagnosis.on_beam.next_release import ModesAtRest
from romsindy.diagnosis.on_beam.within_tolerances import beam_with, linear
from romsindy.diagnosis.structure import key_of
from romsindy.fit.kernel.part import Part
from romsindy.typing import Array

_STEP = 0.3  # standard errors, for what a change of a value does


@dataclass(frozen=True, eq=False)
class Opened:
    """Parts on a beam, and how far their strengths may be from what its first mode says."""

    parts: tuple[Part, ...]
    units: Array  # (n,), of the strengths: their standard errors
    known: Array  # (m, n), see `OpenValues`
    off: Array  # (n,), how far they were moved, in their units

    @classmethod
    def of(cls, h: Hypothesis, unseen: Sequence[Part]) -> Opened:
        """Of what was fitted to the first mode, and of parts that move it by nothing.

        Shape values stay as they are.
        """
        slices = h.solution.slices()
        rows = [(p, own) for p, own in zip(h.parts, slices, strict=True) if _on_beam(p)]
        values = [i for _, own in rows for i in range(own.start, own.stop)]
        first = np.cumsum([0, *(p.size for p, _ in rows)])[:-1]
        covariance = h.covariance[np.ix_(values, values)]
        errors = np.sqrt(np.diag(covariance))
        size = np.where(errors > 0, errors, 1.0)
        information = np.linalg.pinv(covariance / np.outer(size, size), hermitian=True)
        squares, vectors = np.linalg.eigh(information[np.ix_(first, first)])
        root = np.sqrt(np.clip(squares, 0.0, None))[:, None] * vectors.T
        parts = (*(p for p, _ in rows), *unseen)
        units = np.append(errors[first], np.ones(len(unseen)))
        return cls(parts, units, block_diag(root, np.eye(len(unseen))), np.zeros(len(units)))

    def moved(self, step: Array) -> Opened:
        """The same with strengths moved by a step, in their units, as far as they can be."""
        parts = tuple(
            p.moved(np.append(x, np.zeros(p.size - 1)))
            for p, x in zip(self.parts, step * self.units, strict=True)
        )
        gone = [
            (q.values - p.values)[0] / unit if unit else 0.0
            for p, q, unit in zip(self.parts, parts, self.units, strict=True)
        ]
        return replace(self, parts=parts, off=self.off + gone)

    def with_part(self, before: Part, after: Part) -> Opened:
        """The same with one of the parts elsewhere on the beam."""
        share = np.array([p is before for p in self.parts])
        ratio = float(after.values[0] / before.values[0]) if before.values[0] else 1.0
        parts = tuple(after if p is before else p for p in self.parts)
        return replace(self, parts=parts, units=np.where(share, abs(ratio), 1.0) * self.units)

    def changes(self, since: Opened) -> dict[tuple[str, str], Array]:
        """By how much values changed, by the keys of their parts."""
        pairs = zip(since.parts, self.parts, strict=True)
        return {key_of(after): after.values - before.values for before, after in pairs}

    def values(self, seen: InstrumentedBeam) -> OpenValues:
        """What they do to the higher modes of the beam about its equilibrium."""
        count = seen.shapes.shape[1]

        def modes(parts: Sequence[Part]) -> Array:
            # Forces that are no springs and dampers have no rate there.
            found = ModesAtRest.of(beam_with(seen.beam, [p for p in parts if linear([p])]), count)
            return np.stack([np.log(found.omega), found.rates], axis=1)[1:].ravel()

        here, slopes = modes(self.parts), np.zeros((2 * (count - 1), len(self.parts)))
        for i, e in enumerate(np.eye(len(self.parts))):
            tried = max((self.moved(x * _STEP * e) for x in (1, -1)), key=lambda o: _far(o, self))
            if step := float((tried.off - self.off)[i]):
                slopes[:, i] = (modes(tried.parts) - here) / step
        return OpenValues(slopes, self.known, self.off)


def _far(other: Opened, one: Opened) -> float:
    return float(np.abs(other.off - one.off).max())


def _on_beam(part: Part) -> bool:
    return isinstance(part.effect, BeamEffect)
