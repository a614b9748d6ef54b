"""Where on a structure something acts, against places that are known."""

from types import SimpleNamespace

import numpy as np
import pytest
from solid_decks import structure_trials

import romsindy as rs
from romsindy.diagnosis.on_simulator.candidates import (
    Candidate,
    CandidateSearch,
    PlaceSearch,
    Points,
)

PLATE = {
    f"{i}:3": np.array([x, y, 0.0])
    for i, (x, y) in enumerate((x, y) for x in np.linspace(0, 2, 33) for y in np.linspace(0, 1, 17))
}


def _of_each(misfit):
    return lambda points, share: [misfit(point, share) for point in points]


def _looked_for(at, width, first="0:3", floor=1000.0):
    """The place in a well of a ``width`` that narrows with what is heard, and how often was asked.

    A mode that is detuned loses step sooner where it is detuned more: far away all is as bad.
    """
    asked = []

    def misfit(point, share):
        asked.append(point)
        off = np.linalg.norm(PLATE[point] - at) / (width / share)
        return floor + 1e5 * share * off**2 / (1 + off**2)

    search = PlaceSearch(
        PLATE, first, _of_each(misfit), lambda rise, least, _: rise * floor / least
    )
    least, place = search.likeliest()
    return least, place, len(asked)


@pytest.mark.parametrize("at", [(0.4375, 0.25, 0.0), (1.3125, 0.75, 0.0), (1.9375, 0.0625, 0.0)])
def test_a_narrow_well_is_found_among_many_points(at):
    """Of 561 points a tenth is asked."""
    at = np.array(at)
    _, place, count = _looked_for(at, 0.15)
    assert place.at == pytest.approx(at, abs=0.07) and count < 70
    assert np.all(place.low <= at + 1e-12) and np.all(at <= place.high + 1e-12)
    assert place.told and "it acts at" in str(place) and "x = " in str(place)


def test_where_all_points_do_the_same_the_first_is_kept():
    least, place, _ = _looked_for(np.array([1.0, 0.5, 0.0]), 1e9, first="200:3")
    assert place.point == "200:3" and not place.told and least == pytest.approx(1000.0)
    assert str(place) == "these data cannot tell at which point of the structure it acts"
    assert place.low == pytest.approx([0, 0, 0]) and place.high == pytest.approx([2, 1, 0])


def test_a_point_that_nobody_stated_is_no_better_than_others():
    """The likeliest one, where none is told for sure."""
    at = np.array([1.3125, 0.75, 0.0])

    def misfit(point, share):
        return 1e3 + np.sum((PLATE[point] - at) ** 2)

    given = PLATE, "200:3", _of_each(misfit), lambda rise, *_: rise
    kept, found = (PlaceSearch(*given, stated=s).likeliest()[1] for s in (True, False))
    assert kept.point == "200:3" and found.at == pytest.approx(at, abs=0.04)
    assert not (kept.told or found.told)


def test_what_is_far_from_the_records_everywhere_is_asked_no_further():
    """What else explains them leaves 1000, this at the least 100,000 of half the readings."""
    asked = []

    def misfit(point, share):
        asked.append((point, share))
        return 2e5 * share * (1 + np.sum(PLATE[point]))

    search = PlaceSearch(PLATE, "0:3", _of_each(misfit), lambda rise, least, _: rise)
    assert search.first == 5e4 and len(asked) == 17
    assert search.likeliest(1000.0) == (1e5, None)
    assert len(asked) < 2 * 17 + 8 and len(set(asked)) == len(asked)
    assert search.likeliest(1e6)[1].point == "0:3"


def test_points_without_a_motion_are_no_place():
    """A law that is too strong where the structure hardly moves gives none there."""
    at = np.array([1.3125, 0.75, 0.0])

    def misfit(point, share):
        return 1.0 + 1e4 * np.sum((PLATE[point] - at) ** 2) if PLATE[point][0] > 0.5 else np.inf

    given = PLATE, "560:3", _of_each(misfit), lambda rise, *_: rise
    least, place = PlaceSearch(*given).likeliest()
    assert place.at == pytest.approx(at, abs=0.04) and least < 20 and place.low[0] > 1.1


@pytest.mark.study
@pytest.mark.slow
def test_a_damper_on_a_chain_is_found_where_it_is():
    """The truth is the whole chain in time, all its freedoms; the simulator has three modes.

    Other kinds, and more seeds, are those of benchmarks/structure_trials.py.
    """
    seed = 1201
    hidden = structure_trials.hidden_of(seed, False)
    parameters = dict.fromkeys(("modulus", "density"), 1.0)
    records = structure_trials.measured(hidden, seed)
    report = rs.diagnose(structure_trials.told(), records, parameters=parameters, free=[])
    assert structure_trials.right(hidden, report) and structure_trials.holds(hidden, report)
    assert -report.force(0.0, 0.0, 1.0) == pytest.approx(hidden.strength, rel=0.05)
    assert f"at {hidden.node}:3" in report.recipe


class _Table(CandidateSearch):
    """What something leaves where it is fitted to a point: the square of how far it is from one."""

    at = np.array([0.4375, 0.3125, 0.0])
    asked = 0

    @classmethod
    def left(cls, point):
        return float(np.sum((PLATE[point] - cls.at) ** 2))

    def _beside(self, candidate):
        _Table.asked += 1
        there = candidate.there
        look = SimpleNamespace(misfit=self.left(there.at_point))
        fitted = SimpleNamespace(parts=(there.at_point,))
        return _Table(SimpleNamespace(here=there), fitted, look)

    def _likeliest(self, points):
        own = self.fit.here
        best = min([own.at_point, *points], key=self.left)
        return own if best == own.at_point else SimpleNamespace(at_point=best)


def test_what_is_compared_is_at_its_likeliest_place():
    """Found among 561 points from the best of 17, fitted at few; its gain is off what was left."""
    here = SimpleNamespace(acts=lambda parts: True)
    search = _Table(SimpleNamespace(here=here), None, SimpleNamespace(misfit=2.0))
    points = Points(PLATE, "280:3")
    far = [(p, SimpleNamespace(at_point=p)) for p in points.apart()[0]]
    found = search._settled([Candidate(None, t, -_Table.left(p)) for p, t in far], points)
    best = min(PLATE, key=_Table.left)
    assert found.part == best == found.there.at_point
    assert found.gain == 2.0 - _Table.left(best) and _Table.asked < 12


def test_where_nobody_can_choose_a_place_none_is_looked_for():
    """A simulator that takes a force at one point of its own, and names none."""
    here = SimpleNamespace(acts=lambda parts: True)
    search = _Table(SimpleNamespace(here=here), None, SimpleNamespace(misfit=2.0))
    (first, *_) = PLATE
    alone = [Candidate(None, SimpleNamespace(at_point=first), 0.0)]
    assert search._settled(alone, Points({}, "")).part == first
