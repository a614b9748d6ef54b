"""Rounds of a diagnosis on a simulated structure, where explanations take turns."""

from types import SimpleNamespace

from romsindy.diagnosis.evidence import NO_FORM_ERROR
from romsindy.diagnosis.rounds import Rounds
from romsindy.diagnosis.search import Options

OPTIONS = Options((), 0.01, 2, 1e-4, 1, lambda _: None)


class _Turning(Rounds):
    """Each look at it, by what is on the structure, finds what a table says."""

    def __post_init__(self) -> None:
        self.clear, self.seen = [], []

    def simulate(self, parts):
        return list(parts)

    def _look(self, effects, found, most):
        on = "".join(p.effect.name for p in found)
        self.seen.append(on)
        names = self.model[on]
        part = SimpleNamespace(effect=SimpleNamespace(name=names))
        best = SimpleNamespace(names=(names,), parts=[part], effects=[part])
        return SimpleNamespace(
            verdict="named", best=best, rivals=(best,), compared=(), interrupted=False
        )

    def _settled(self, parts, report):
        return frozenset(p.effect.name for p in parts) == frozenset(report.best.names)

    def _checked(self, report):
        return report

    def _simulated_of(self, report):
        return report.best


def _looks(table):
    """What is on the structure at each look, where a look at this finds that."""
    structure = SimpleNamespace(with_effects=tuple, failures=(), apart=False)
    given = ([], [], False, [], [], OPTIONS, [], NO_FORM_ERROR)
    rounds = _Turning(structure, None, table, *given)
    rounds.run((), [])
    return rounds.seen


def test_what_takes_turns_is_looked_at_no_further_than_once_around():
    """Each from the structure with the other: the third time that it comes it would go on so."""
    assert _looks({"": "a", "a": "b", "b": "a"}) == ["", "a", "b", "a"]
    assert _looks({"": "a", "a": "b", "b": "b"}) == ["", "a", "b"]
