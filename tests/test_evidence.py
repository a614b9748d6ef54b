"""Odds that stay honest where no hypothesis is quite right."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.linalg import cho_factor, cho_solve, expm

import romsindy as rs
from romsindy.diagnosis import residual_report, workflow
from romsindy.diagnosis.decay_search import ProcessNoise
from romsindy.diagnosis.difference import Tolerance
from romsindy.diagnosis.evidence import NO_FORM_ERROR, FormError, Hypothesis, offsets, weights
from romsindy.diagnosis.gap import foretold
from romsindy.diagnosis.search import Finding
from romsindy.diagnosis.verdict import Answer, Explanation, Rule
from romsindy.effects import CATALOGUE, LinearFrequency, Viscous
from romsindy.fit.kernel.gauss_newton import fit
from romsindy.fit.kernel.part import Part
from romsindy.fit.process_noise import Departures, Marginal, Windows
from romsindy.fit.records.record import Record, scales

OMEGA, ZETA = 2 * np.pi * 5, 0.005
DECAY = 2 * ZETA * OMEGA
MODEL = rs.ReducedModel.from_coefficients({"omega^2": OMEGA**2, "c_linear": DECAY})
EFFECTS = {e.name: e for e in CATALOGUE}


def wandering(seed, size, force=lambda q, v: 0.0, snr_db=40):
    """A decay of a linear oscillator whose frequency and damping ratio wander by a size.

    Piecewise constant over each cycle, alike over an e-fold of the amplitude: integrated here.
    """
    rng = np.random.default_rng(seed)
    t, n_cycles = np.arange(1600) / 100, 80
    alike = np.exp(-2 * np.pi * ZETA)
    wander = rng.standard_normal((n_cycles, 2))
    for k in range(1, n_cycles):
        wander[k] = alike * wander[k - 1] + np.sqrt(1 - alike**2) * wander[k]
    q, y = [], [1.0, 0.0]
    for k in range(n_cycles):
        rate = OMEGA * (1 + size * wander[k, 0])
        damping = 2 * (ZETA + size * wander[k, 1]) * OMEGA

        def rates(_, y, rate=rate, damping=damping):
            return [y[1], -(rate**2) * y[0] - damping * y[1] - force(*y)]

        found = solve_ivp(rates, (0, 0.2), y, "DOP853", np.arange(21) / 100, rtol=1e-9, atol=1e-11)
        q.append(found.y[0, :-1])
        y = found.y[:, -1]
    return rs.add_noise(rs.Decay(t, np.concatenate(q)), snr_db, seed)


def fitted(decays, *names):
    """Fit linear frequency, viscous damping and further effects, with exponents as they are."""
    records = [Record.loud(d, 2e-4) for d in decays]
    own = scales(records)
    effects = [LinearFrequency(), Viscous(), *(EFFECTS[n] for n in names)]
    parts = []
    for effect in effects:
        starts = [p.starts[0] for p in effect.parameters(own)]
        parts.append(replace(Part.of(effect, own, len(records), starts), parameters=()))
    return Hypothesis.of(MODEL, fit(MODEL, parts, records, iterations=30), 2, records), records


@pytest.mark.slow
def test_likelihood_is_that_of_a_dense_gaussian():
    """Columns by the matrix exponential, covariance in full, generalised least squares."""
    decay = wandering(3, 3e-4)
    hypothesis, (record,) = fitted([decay])
    parts, (motion,) = hypothesis.solution.parts, hypothesis.solution.motions
    windows = Windows.of(MODEL, parts, 0, record, motion)
    stiffness, damping = (p.strengths[0, 0] for p in parts)
    a = np.array([[0.0, 1.0], [-(OMEGA**2) - stiffness, -DECAY - damping]])
    t = record.t

    def free(state, t):
        powers = [expm(a * (s - t[0])) for s in t]
        return np.array([p @ state for p in powers])

    motion_there = free(motion.start, t)
    by_state = np.stack([free(e, t)[:, 0] for e in np.eye(2)], axis=1)
    by_value = []
    for i in range(2):  # differences of two matrix exponentials
        change = np.zeros((2, 2))
        change[1, i] = -1e-3 * (OMEGA if i == 0 else 1.0)
        there = np.array([expm((a + change) * s) @ motion.start for s in t])
        by_value.append((there - motion_there)[:, 0] / (1e-3 * (OMEGA if i == 0 else 1.0)))
    jacobian = record.whitened(np.column_stack([*by_value, by_state]))
    misfit = record.whitened(record.signal - motion_there[:, 0])
    # Of a linear oscillator an error of frequency or damping that lasts a window turns or stretches
    # its motion, by a part that grows with time, and stays.
    at = motion.grid.step * record.window_steps
    columns, levels = [], []
    for start, end in itertools.pairwise(at):
        q, v = expm(a * start) @ motion.start
        phase = np.ptp(record.phase(np.array([start, end])))
        back = expm(-a * start)
        ramp = np.clip((t - start) / (end - start), 0, 1)
        for state in ([v / record.rate, -q * record.rate], [q, v]):
            columns.append(ramp * free(back @ state, t)[:, 0] * phase)
        levels += 2 * [np.log(np.hypot(q, v / record.rate))]
    departures = record.whitened(np.column_stack(columns))
    alike = np.exp(-np.abs(np.subtract.outer(levels, levels)))
    kinds = np.arange(len(levels)) % 2
    alike *= kinds[:, None] == kinds
    marginal = Marginal.of(parts, [windows])
    for jump, excess in ((1e-5, 1.0), (3e-4, 1.0), (3e-3, 2.5)):
        covariance = excess * np.eye(len(t)) + jump**2 * departures @ alike @ departures.T
        factor = cho_factor(covariance, lower=True)
        weighed = cho_solve(factor, np.column_stack([jacobian, misfit]))
        normal = jacobian.T @ weighed
        best = np.linalg.solve(normal[:, :-1], normal[:, -1])
        dense = (misfit - jacobian @ best) @ (weighed[:, -1] - weighed[:, :-1] @ best)
        dense += 2 * np.sum(np.log(np.diag(factor[0]))) - len(t) * np.log(excess)
        # White noise: what is left are differences of the derivatives, and the step of the motion.
        assert marginal.cost(jump, excess) == pytest.approx(dense, rel=2e-4)
        system, step = marginal.solve(jump, excess)
        errors = np.sqrt(np.diag(np.linalg.inv(normal[:, :-1])))
        assert_allclose(np.sqrt(np.diag(system.covariance())), errors, rtol=0.01)
        assert np.all(np.abs(step - best) < 0.05 * errors)


def test_without_form_error_it_is_the_chi_square():
    hypothesis, records = fitted([wandering(1, 0.0), wandering(2, 0.0)], "quadratic_drag")
    solution = hypothesis.solution
    white = [r.whitened(e) for r, e in zip(records, solution.residuals, strict=True)]
    assert hypothesis.needs.jump == 0
    assert hypothesis.at(NO_FORM_ERROR).parts == solution.parts
    free = hypothesis.misfit - sum(float(e @ e) for e in white)
    # Both unsure values stay at nothing, at the price of a rise within chance.
    assert 0 <= free < 12 and hypothesis.moved == ()
    assert_allclose(hypothesis.covariance, solution.covariance, rtol=1e-3, atol=1e-12)


@cache
def trials(size):
    """Of two rivals one is true: is it preferred, how surely, and how far off is its strength?"""
    strengths = {"quadratic_drag": 6e-4, "amplitude_damping": 0.075}
    found = []
    for seed in range(24):
        name = list(strengths)[seed % 2]
        true = strengths[name] * (0.3 + 0.1 * (seed % 14))

        def force(q, v, name=name, true=true):
            return true * (abs(v) * v if name == "quadratic_drag" else q * q * v)

        decays = [wandering([seed, i], size, force) for i in range(2)]
        rivals = [fitted(decays, n)[0] for n in strengths]
        own = rivals[list(strengths).index(name)].at(FormError(size))
        z = (own.effects[0].strengths[0, 0] - true) / np.sqrt(own.covariance[2, 2])
        blind = sorted(rivals, key=lambda h: h.at(NO_FORM_ERROR).score)
        best = ProcessNoise().ranked(rivals)
        found.append(
            (
                z,
                best[0].effects[0].effect.name == name,
                weights(best)[0],
                blind[0].effects[0].effect.name == name,
                weights([h.at(NO_FORM_ERROR) for h in blind])[0],
                best[0].noise.jump,
            )
        )
    return np.array(found, float).T


@pytest.mark.study
@pytest.mark.slow
def test_odds_are_honest_where_the_model_wanders():
    """Of two damping laws beside process noise of a known size, which errors of 3e-4 hide."""
    z, right, odds, blind, blind_odds, size = trials(3e-4)
    # Of 24 independent standard normal values the rms is 0.72 to 1.29 in 95 %.
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.4
    assert 1e-4 < np.median(size) < 1e-3
    sure = odds > 20 / 21
    # One in twenty of such odds is wrong: two of them in 24 with a probability of 0.3.
    assert np.count_nonzero(sure & (right == 0)) <= 2
    # Without process noise most odds are sure, and many of these wrong.
    sure = blind_odds > 20 / 21
    assert np.count_nonzero(sure & (blind == 0)) >= 5


# -- the verdict ------------------------------------------------------------------------------

LEAVES = FormError(jump=3e-4, structure=1e-3)


BEYOND = Tolerance(signal=0.01)


def change(exceeds):
    """A difference that exceeds any tolerance, or none."""
    return SimpleNamespace(exceeds=lambda _: exceeds, within=lambda _: not exceeds)


def explanation(
    names=("drag",),
    *,
    score=0.0,
    misfit=0.0,
    sureness=9.0,
    needs=NO_FORM_ERROR,
    explained=True,
    ratio=1.2,
    after=1.0,
    closed=0.95,
    unseen=False,
    within=False,
    changes=True,
    lacking=True,
    agrees=False,
    beyond=(),
    elsewhere=0.0,
):
    """An explanation on stand-ins that hold what the rule looks at, and nothing else."""
    found = SimpleNamespace(
        names=names, score=score, misfit=misfit, sureness=sureness, needs=needs, noise=LEAVES
    )
    found.beyond, found.misfit_elsewhere = beyond, elsewhere
    found.at = lambda _: found
    found.growth = lambda _: 1.0  # what it leaves is noise
    parts = tuple(SimpleNamespace(effect=SimpleNamespace(structural=True)) for _ in names)
    found.effects, found.moved = (parts, ()) if lacking else ((), names)
    found.said = set(names)
    gap = SimpleNamespace(
        before=9.0, after=after, closed=closed, unseen=unseen, leaves_within=lambda _: within
    )
    whole = SimpleNamespace(
        closed=closed,
        changes=[change(changes)],
        changes_from=lambda _: [change(not within)],
        differences_after=[change(not agrees)],
    )
    left = SimpleNamespace(explained=explained, ratio=ratio)
    return Explanation(found, left, gap, whole, lacking)


# What needs no effect leaves more than the noise and the tolerance.
OPEN = {
    "names": (),
    "score": 100.0,
    "explained": False,
    "needs": LEAVES,
    "after": 5.0,
    "closed": 0.0,
}


def verdict_for(
    plain=None, effect=None, *, beyond=True, tolerance=BEYOND, form=NO_FORM_ERROR, exact=True
):
    """The verdict on a gap that is beyond the tolerance or not, and whether it is small."""
    as_it_was = SimpleNamespace(differences_before=[change(beyond)])
    without = explanation((), misfit=100.0).hypothesis
    rule = Rule(as_it_was, without, without, tolerance, form, exact)
    answer = rule.answer([plain or explanation(**OPEN)], effect)
    return answer.verdict + (", small" if answer.small else "")


def test_an_effect_comes_before_values_that_are_beyond_their_tolerance_or_refuted_elsewhere():
    """Both leave noise: which comes first says by how much one is likelier, which is 20 here."""
    damping = {"names": ("mass_damping",), "lacking": False, "score": 20.0, "within": True}
    drag = explanation(within=True)

    def first(effect=drag, **values):
        as_it_was = SimpleNamespace(differences_before=[change(True)])
        nothing, linear = (explanation((), misfit=x).hypothesis for x in (100.0, 0.0))
        rule = Rule(as_it_was, nothing, linear, BEYOND, NO_FORM_ERROR, False)
        answer = rule.answer([explanation(**damping | values)], effect)
        return answer.verdict, answer.explanation.hypothesis.names

    assert first() == ("ambiguous", ("mass_damping",))
    assert first(beyond=("mass_damping",)) == ("ambiguous", ("drag",))
    assert first(beyond=("mass_damping",), score=5.0) == ("ambiguous", ("mass_damping",))
    assert first(elsewhere=20.0) == ("named", ("drag",))
    # Though the effect leaves more than noise, values that are refuted are no answer.
    poor = explanation(explained=False, after=5.0, needs=LEAVES)
    assert first(poor) == ("named", ("mass_damping",))
    assert first(poor, elsewhere=20.0) == ("unknown", ("drag",))


def test_what_a_hypothesis_leaves():
    """Noise, what does not matter, or as much as the model leaves of its own reference record."""

    def left(form=NO_FORM_ERROR, **given):
        return explanation(**given).leaves(BEYOND, form)

    wrong = {"explained": False, "after": 5.0, "needs": LEAVES}
    assert left() == "noise"
    assert left(**wrong) == "effect"
    assert left(LEAVES, **wrong) == left(LEAVES.times(0.6), **wrong) == "form"
    assert left(FormError(1e-3, 1e-4), **wrong) == "effect"
    assert left(**wrong, within=True) == "tolerance"
    little = {"explained": False, "needs": LEAVES, "closed": 0.999}
    assert left(**little) == "little"
    assert left(**little | {"after": 1.5}) == left(**little | {"ratio": 1.5}) == "effect"
    assert left(**little | {"ratio": 1.5, "unseen": True}) == "little"


def test_an_effect_is_named_where_it_is_sure_and_leaves_nothing_that_matters():
    stated = Tolerance(source="stated")
    assert verdict_for(effect=explanation()) == "named"
    # "None" is not said of what leaves more than the tolerance, surely so or not.
    assert verdict_for() == verdict_for(beyond=False) == "unknown"
    # Whole records say it where nothing moved, whatever short stretches show: these may not reach
    # where the records differ.
    assert verdict_for(explanation(**OPEN, within=True), beyond=False) == "unknown"
    assert verdict_for(explanation(**OPEN, agrees=True), beyond=False) == "none"
    moved = OPEN | {"names": ("linear_frequency",), "lacking": False}
    assert verdict_for(explanation(**moved, agrees=True), beyond=False) == "unknown"
    # More than twice the noise forbids a name, unless it is within the tolerance.
    much = {"explained": False, "after": 5.0, "needs": LEAVES}
    assert verdict_for(effect=explanation(**much)) == "unknown"
    assert verdict_for(effect=explanation(**much, within=True)) == "named"
    # Three standard errors are asked for.
    assert verdict_for(effect=explanation(sureness=2.9), tolerance=stated) == "ambiguous"
    # What is small is told beyond doubt, and where no tolerance was stated.
    small = explanation(changes=False)
    assert verdict_for(effect=small, beyond=False) == "named, small"
    assert verdict_for(effect=small, beyond=False, tolerance=stated) == "none"
    # The reduction of a structure is known no better.
    within = explanation(**OPEN, agrees=True)
    assert verdict_for(within, small, beyond=False) == "named, small"
    assert verdict_for(within, small, beyond=False, exact=False) == "none"
    assert verdict_for(effect=explanation(), beyond=True, exact=False) == "named"
    hardly = explanation(changes=False, misfit=80.0)  # gains 20, less than five standard errors
    assert verdict_for(effect=hardly, beyond=False) == "none"


def test_values_within_tolerances_do_not_hide_an_effect_that_is_as_likely():
    """Odds of 33 to 1 are 7 of the scores: beyond them one is told alone, or first."""

    def told(score, exact=False, beyond=True):
        as_it_was = SimpleNamespace(differences_before=[change(beyond)])
        nothing, linear = (explanation((), misfit=x).hypothesis for x in (100.0, 10.0))
        rule = Rule(as_it_was, nothing, linear, BEYOND, NO_FORM_ERROR, exact)
        values = explanation((), score=score, within=True)
        answer = rule.answer([values], explanation(within=True))
        return answer.verdict, answer.explanation.hypothesis.names

    assert told(-8.0) == ("none", ())
    assert told(-6.0) == told(6.0) == ("ambiguous", ())
    assert told(8.0) == ("ambiguous", ("drag",))
    # ... where they differ by more than matters, and by how much values may be off is known.
    assert told(6.0, beyond=False) == told(6.0, exact=True) == ("none", ())


@pytest.mark.parametrize(
    ("said", "moved", "pliable"),
    [
        (("bouc_wen",), (), False),
        (("bouc_wen", "stop"), (), True),
        (("micro_slip",), ("linear_frequency",), True),
        (("micro_slip", "mains_hum"), (), False),  # lines of their own
        (("quadratic_drag", "stop"), (), False),
        (("quadratic_drag",), ("viscous", "linear_frequency"), False),
        (("quadratic_drag", "stop"), ("viscous",), True),
    ],
)
def test_a_loop_with_something_beside_it_is_not_named(said, moved, pliable):
    """Nor are three things: they take the shape of laws that are on no list."""
    unsure = LinearFrequency(), Viscous()
    parts = [SimpleNamespace(effect=e) for e in (*unsure, *(EFFECTS[n] for n in said))]
    blamed = (*range(2, len(parts)), *(i for i, e in enumerate(unsure) if e.name in moved))
    found = SimpleNamespace(effects=parts[2:], n_free=2, blamed=blamed)
    assert Hypothesis.pliable.fget(found) is pliable
    best = SimpleNamespace(pliable=pliable, effects=(), moved=(), names=said, sureness=9.0)
    answer = Answer("named", SimpleNamespace(lacking=True, hypothesis=best))
    outcome = Finding([best], [best], best)
    assert workflow._verdict(answer, outcome, [best]) == ("ambiguous" if pliable else "named")
    left = [SimpleNamespace(explained=True, ratio=1.0)]
    driven = residual_report._verdict(outcome, SimpleNamespace(closed=1.0), left, False)
    assert driven == ("ambiguous" if pliable else "named")


def test_values_of_the_model_come_before_effects():
    values = {"names": ("linear_frequency",), "lacking": False}
    assert verdict_for(explanation(**values)) == "named"
    assert verdict_for(explanation(**values, changes=False), beyond=False) == "none"
    # An effect that is as likely leaves it open, and one that is distinctly likelier is named.
    alike = explanation(score=1.0, closed=0.8)
    assert verdict_for(explanation(**values), alike) == "ambiguous"
    assert verdict_for(explanation(**values, score=50.0), explanation()) == "named"


def test_an_equation_whose_motions_die_out_asks_for_no_departures():
    """By exp(-40 t), 640 e-folds: what moves the end by a unit passes 1e200 at the start."""
    dying = rs.ReducedModel.from_coefficients({"omega^2": OMEGA**2 + 1600, "c_linear": 80.0})
    record = Record.of(wandering(0, 0.0), 1e-6)
    assert Departures.of(dying, (), [record], [record.motion]) is None


def test_without_a_motion_nothing_is_weighed():
    """Where no hypothesis has a motion, all were weighed at an infinite form error: a traceback."""
    with_motion, _ = fitted([wandering(0, 0.0)])
    without = replace(with_motion, weighed=None)
    (alone,) = ProcessNoise().ranked([without])
    assert (alone.noise, alone.score) == (NO_FORM_ERROR, np.inf)
    assert ProcessNoise().ranked([without, with_motion])[0].weighed is not None


def test_what_is_foretold_is_the_evidence_of_both_records_over_that_of_one():
    """p(b | a) = p(a, b) / p(a), each by a fit of its own: Laplace's method, values unknown before.

    Starts and zeros of either record are fitted in all, so that they cancel but for those of b.
    """
    decays = [wandering(seed, 0.0, lambda q, v: 0.1 * abs(v) * v, snr_db=30) for seed in (3, 4)]
    a, b = (Record.loud(d, 0.0) for d in decays)
    effect = EFFECTS["quadratic_drag"]

    def fitted(records):
        shown = scales(records)
        parts = [Part.of(e, shown, len(records)) for e in (LinearFrequency(), Viscous())]
        drag = replace(Part.of(effect, shown, len(records), effect.parameters(shown)[0].starts[:1]))
        found = fit(MODEL, [*parts, drag, offsets(records)], records)
        assert found.converged
        return Hypothesis.of(MODEL, found, 2, records)

    one, both = fitted([a]), fitted([a, b])

    def information(h):
        return np.linalg.slogdet(np.linalg.inv(h.solution.covariance[:4, :4]))[1]

    left = both.solution.chi_squared - one.solution.chi_squared
    expected = left + information(both) - information(one)
    # Of chi-squares of 1500; motions are linear in their values but for a part in a hundred.
    assert foretold(MODEL, one, {"b": b}) == pytest.approx(expected, abs=0.1)


def test_a_hum_foretells_noise_no_better_than_nothing():
    """Sizes of its own in another record fit noise: chi-square falls by one for each, 12 here."""
    humming = wandering(3, 0.0, snr_db=30)
    humming = replace(humming, q=humming.q + 0.05 * np.sin(2 * np.pi * 7.7 * humming.t))
    a = Record.loud(humming, 0.0)
    shown = scales([a])
    free = [Part.of(e, shown, 1) for e in (LinearFrequency(), Viscous())]
    hum = Part.of(EFFECTS["mains_hum"], shown, 1, [2 * np.pi * 7.7])
    found = [fit(MODEL, [*parts, offsets([a])], [a]) for parts in ([*free, hum], free)]
    assert all(f.converged for f in found)
    hypotheses = [Hypothesis.of(MODEL, f, 2, [a]) for f in found]
    gains = []
    for seed in range(10, 18):
        b = Record.loud(wandering(seed, 0.0, snr_db=30), 0.0)
        gains.append(np.subtract(*(foretold(MODEL, h, {"b": b}) for h in hypotheses)))

    assert abs(np.mean(gains)) < 5.2, gains  # three times sqrt(2 * 12 / 8)
