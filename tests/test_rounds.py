"""Rounds of a diagnosis on a simulated structure, where explanations take turns."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

import romsindy as rs
from romsindy.diagnosis.evidence import NO_FORM_ERROR
from romsindy.diagnosis.rounds import Rounds
from romsindy.diagnosis.search import Options, Request
from romsindy.diagnosis.structure import Moved, corrected
from romsindy.diagnosis.workflow import diagnose_model
from romsindy.effects import LinearFrequency, MoreMass
from romsindy.fit.kernel.part import Part
from romsindy.fit.records.record import Record, scales
from romsindy.fit.verdict import EXPLAINED, FLOOR

OPTIONS = Options((), 0.01, 2, 1e-4, 1, lambda _: None)


@dataclass
class _Said:
    """What a look says."""

    best: SimpleNamespace
    rivals: tuple[SimpleNamespace, ...]
    verdict: str = "named"
    compared: tuple = ()
    interrupted: bool = False


class _Turning(Rounds):
    """Each look at it, by what is on the structure, finds what a table says.

    An exponent is the textbook's in what ends with a prime.
    """

    def __post_init__(self) -> None:
        self.clear, self.seen = [], []

    def simulate(self, parts, needed=()):
        assert list(needed) in ([], list(parts))
        return list(parts)

    def _look(self, effects, found, most):
        on = "".join(p.said for p in found)
        self.seen.append(on)
        said = self.model[on]
        name, free = said.removesuffix("'"), not said.endswith("'")
        exponent = SimpleNamespace(low=2.5, high=3.5 if free else 2.5)
        part = SimpleNamespace(effect=SimpleNamespace(name=name), said=said, parameters=[exponent])
        best = SimpleNamespace(names=(name,), parts=[part], effects=[part])
        return _Said(best, (best,))

    def _settled(self, parts, report):
        return {p.said for p in parts} == {p.said for p in report.best.parts}

    def _checked(self, report):
        return report

    def _simulated_of(self, report):
        return report.best


def _looked(table):
    """The rounds, and what they found, where a look at this structure finds that."""
    structure = SimpleNamespace(with_effects=tuple, failures=(), apart=False)
    given = ([], [], False, [], [], OPTIONS, [], NO_FORM_ERROR)
    rounds = _Turning(structure, None, table, *given)
    return rounds, rounds.run((), [])


def _looks(table):
    """What is on the structure at each look, and what is told."""
    rounds, found = _looked(table)
    return rounds.seen, "".join(p.said for p in found.report.best.parts)


def test_what_takes_turns_is_looked_at_no_further_than_once_around():
    """Each from the structure with the other: the third time that it comes it would go on so."""
    assert _looks({"": "a", "a": "b", "b": "a"})[0] == ["", "a", "b", "a"]
    assert _looks({"": "a", "a": "b", "b": "b"})[0] == ["", "a", "b"]


def test_what_takes_turns_is_told_together():
    """Neither is named, and what comes first is on the structure that is told."""
    found = _looked({"": "a", "a": "b", "b": "a"})[1]
    assert found.report.verdict == "ambiguous"
    assert [h.names for h in found.report.rivals] == [("b",), ("a",)]
    assert [p.said for p in found.parts] == ["b"]


@pytest.mark.parametrize(("before", "verdict"), [("none", "ambiguous"), ("unknown", "named")])
def test_what_comes_from_outside_is_told_beside_values_that_were_enough(before, verdict):
    """Beside other values of the structure it was needed; it may stand for what these do."""
    hum = SimpleNamespace(effect=SimpleNamespace(name="hum", structural=False))
    values, found = (SimpleNamespace(names=n, effects=e) for n, e in (((), ()), (("hum",), (hum,))))
    rounds = SimpleNamespace(looked=[_Said(values, (), before)])
    told = Rounds._checked(rounds, _Said(found, (found,)))
    assert told.verdict == verdict
    assert [h.names for h in told.rivals] == [("hum",), ()][: 1 + (before == "none")]


def test_an_exponent_that_takes_turns_is_that_of_the_textbook():
    """From the structure with the one the other is found: the first that has fewer values stays."""
    assert _looks({"": "a", "a": "a'", "a'": "a"}) == (["", "a", "a'"], "a'")
    assert _looks({"": "a'", "a'": "a", "a": "a'"}) == (["", "a'", "a", "a'"], "a'")


def test_an_equation_has_what_it_needs_where_the_structure_has_more():
    """A clamp that gives way does ever less: by its linear law the equation would run away."""
    model = rs.ReducedModel.from_coefficients({"omega^2": 36.0, "c_linear": 0.1})
    decay = model.simulate(1.0, 0.0, np.arange(0.0, 5.0, 0.02))
    record = Record.of(decay, 1e-6)
    needed = Part.of(LinearFrequency(), scales([record]), 1)
    there = needed.moved(13 * needed.values)
    asked = []

    def moved(motion, decay):
        asked.extend((motion.equation.parts, motion.parts))
        raise StopIteration

    def start(model, parts, record):
        asked.append(parts)
        return 1.0, 0.0

    structure = SimpleNamespace(with_effects=tuple, start=start, moved=moved)
    with pytest.raises(StopIteration):
        corrected(structure, model, [there], record, decay, None, record, (needed,))
    begun, equation, simulated = ([p.values[0] for p in parts] for parts in asked)
    assert begun == equation == [needed.values[0]] and simulated == [there.values[0]]


def test_a_fast_mode_that_is_nearly_as_simulated_is_no_misfit_of_the_first():
    """It rings 1 % more than in the structure, where a filter has left hardly any noise."""
    model = rs.ReducedModel.from_coefficients({"omega^2": (10 * np.pi) ** 2, "c_linear": 0.3})
    t = np.arange(3200) / 200
    clean, noise = model.simulate(1.0, 0.0, t).q, np.random.default_rng(0).standard_normal(3400)
    quiet = 0.01 * sosfilt(butter(8, 0.4, output="sos"), noise)[200:]
    ring = 0.1 * np.exp(-0.15 * t) * np.cos(2 * np.pi * 70 * t)

    def moved(asked, decay):
        return Moved([(clean + ring)[:, None]], asked.start, None)

    structure = SimpleNamespace(
        with_effects=tuple, start=lambda *_: (1.0, 0.0), moved=moved, coordinate=np.ravel
    )
    decay = rs.Decay(t, clean + 1.01 * ring + quiet)
    record = Record.of(decay, FLOOR)
    found = corrected(structure, model, [], record, decay, None, record).decay
    there = Record.of(found, FLOOR)
    left = there.whitened(found.signal - clean)
    assert np.sqrt(left @ left / there.count) < EXPLAINED


@pytest.mark.parametrize("refused", [None, 6000.0])
def test_values_that_other_modes_refute_do_not_stand_for_an_effect(refused):
    """Both do the same to the first mode, and leave a tone of another one, which nothing explains.

    A tenth of mass more is a stiffness that is so much less.
    """
    omega, t = 2 * np.pi, np.arange(3000) / 100
    model = rs.ReducedModel.from_coefficients({"omega^2": omega**2, "c_linear": 0.12}, "m")
    heavy = {"omega^2": omega**2 / 1.1, "c_linear": 0.12 / 1.1}
    slow = rs.ReducedModel.from_coefficients(heavy, "m").simulate(0.01, 0.0, t).q
    tone = 1e-4 * np.exp(-0.1 * t) * np.cos(2.7 * omega * t)
    noise = 1e-5 * np.random.default_rng(3).standard_normal(len(t))
    decay = rs.Decay(t, slow + tone + noise, unit="m")
    catalogue = (MoreMass(), LinearFrequency())
    options = Options(catalogue, 0.01, 1, 1e-4, 1, lambda _: None)
    names = frozenset({"added_mass"})
    known = {"omega^2": 0.2, "c_linear": 0.2}
    said = None if refused is None else {frozenset[str](): refused, names: 0.0}
    request = Request([decay], None, (), known, options)
    found = diagnose_model(model, request, NO_FORM_ERROR, False, said)
    assert found.best.names == (() if refused is None else tuple(names))
