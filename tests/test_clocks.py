"""What changes with time, in records that follow one another on one clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.effects import CubicStiffness, Drift, SuddenChange
from romsindy.fit.records.record import Record, scales

OMEGA, LENGTH, RATE = 20.0, 12.0, 100.0
MODEL = rs.ReducedModel.from_coefficients({"omega^2": OMEGA**2, "gamma_3": 30.0, "c_linear": 0.2})
LOOK_FOR = (Drift(), SuddenChange(), CubicStiffness())


def decay(release: float, start: float, softer, seed: int, clock: float | None = None) -> rs.Decay:
    """A decay from ``release``, let go at ``start``, while the stiffness is softer(t) lower."""

    def rates(t, y):
        return [y[1], -(OMEGA**2 - softer(t)) * y[0] - 30.0 * y[0] ** 3 - 0.2 * y[1]]

    t = start + np.arange(0, LENGTH, 1 / RATE)
    run = solve_ivp(rates, (start, t[-1]), [release, 0.0], t_eval=t, rtol=1e-9, max_step=0.05)
    noise = 0.003 * np.random.default_rng(seed).standard_normal(len(t))
    return rs.Decay(t if clock is None else t - start + clock, run.y[0] + noise)


def two(softer, clock: float | None = None) -> list[rs.Decay]:
    """Decays that are let go at 100 s and 130 s."""
    return [decay(1.0, 100.0, softer, 1, clock), decay(0.7, 130.0, softer, 2, clock)]


def named(decays: list[rs.Decay], held_out: rs.Decay | None = None) -> tuple:
    report = rs.diagnose(MODEL, decays, held_out=held_out, catalogue=LOOK_FOR)
    (effect,) = report.effects
    assert report.verdict == "named"
    return effect, report.best.effects[0].effect


@pytest.mark.slow
def test_a_bolt_that_loosens_within_the_second_record_does_so_once():
    """Simulated with the instant at 134 s on the clock of both records."""
    found, effect = named(two(lambda t: 8.0 * (t > 134.0)))
    assert found.name == "sudden_change" and "130" in found.variant
    assert effect.origin + effect.time == pytest.approx(134.0, abs=0.05)  # a sixth of a cycle


def test_a_bolt_that_loosens_between_two_records_is_told_from_one_that_loosens_in_each():
    found, effect = named(two(lambda t: 4.0 * (t > 120.0)))
    assert found.name == "sudden_change"
    assert 112.0 < effect.origin < 130.0 and effect.length == 0


@pytest.mark.slow
def test_a_drift_goes_on_from_record_to_record():
    """Linear in the time from the first release on; the third decay takes no part."""
    later = decay(0.8, 160.0, lambda t: 0.1 * (t - 100.0), 3)
    found, effect = named(two(lambda t: 0.1 * (t - 100.0)), later)
    assert found.name == "drift" and found.variant == "over all records"
    assert effect.origin == 100.0


@pytest.mark.slow
def test_records_that_all_start_anew_know_no_common_time():
    """Each softens by the same law since its own release."""
    decays = [decay(a, 0.0, lambda t: 0.4 * t, i) for i, a in enumerate((1.0, 0.7))]
    found, effect = named(decays)
    assert found.name == "drift" and effect.origin is None


def test_spans_are_known_only_where_records_follow_one_another():
    first, second = (Record.of(d, 1e-4) for d in two(lambda t: 0.0))
    assert scales([second, first]).spans == ((130.0, second.clock + second.t[-1]), (100.0, 111.99))
    assert scales([first]).spans == ()
    moved = replace(second.decay, t=second.decay.t - 20.0)  # begins before the first ends
    assert scales([first, replace(second, decay=moved)]).spans == ()
