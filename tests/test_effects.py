"""Effects are written once: what follows from one small class, and the table of all of them."""

from __future__ import annotations

import inspect
from dataclasses import dataclass

import numpy as np
import pytest
from catalogue import page, rows

import romsindy as rs
from romsindy.beam import Beam
from romsindy.beam.motion import Sensor
from romsindy.effects import (
    BEAM_CATALOGUE,
    CATALOGUE,
    AtPoint,
    MemoryEffect,
    TermEffect,
    look_alikes,
)
from romsindy.effects.base import Scales, State
from romsindy.physics.stiffness import Stiffness
from romsindy.physics.term import ForceLaw

EFFECTS = {f"{e.name} {e.variant}".strip(): e for e in (*BEAM_CATALOGUE, *CATALOGUE)}


@dataclass(frozen=True)
class OneWaySpring(TermEffect, ForceLaw):
    """A spring to the ground along a direction, that hardens one way only."""

    name, family, sign = "one_way_spring", "stiffness", 1
    label = "a spring that hardens one way"
    resembles = ("bilinear", "cubic_stiffness", "quadratic_stiffness")
    mounting = AtPoint(0.225, direction=(0.0, 1.0), datum=-0.003)
    key, dimension = "k_one_way", (3, 0)

    def expression(self, q="q", q_dot="q_dot", q_ddot="q_ddot"):
        return f"max({q}, 0)^3"

    def stiffness(self, q):
        return np.maximum(q, 0.0) ** 3

    def potential(self, q):
        return np.maximum(q, 0.0) ** 4 / 4

    def stiffness_dq(self, q):
        return 3 * np.maximum(q, 0.0) ** 2


# -- the effect of a contributor ----------------------------------------------------------------

MODEL = rs.ReducedModel.from_coefficients(
    {"omega^2": 900.0, "gamma_3": 150.0, "Upsilon_3": 0.1, "c_linear": 0.3}, unit="m"
)
SPRUNG = rs.ReducedModel((*MODEL.terms, OneWaySpring()), (*MODEL.values, 12.0), "m")


def test_the_effect_is_one_small_class():
    lines = inspect.getsource(OneWaySpring).splitlines()
    code = [line for line in lines if line.strip() and not line.strip().startswith('"""')]
    assert len(code) <= 20


def test_it_is_a_term_of_a_reduced_model_and_survives_json():
    again = rs.ReducedModel.from_json(SPRUNG.to_json())
    assert again == SPRUNG and again.coefficients["k_one_way"] == 12.0
    assert "k_one_way" in str(again) and "1/(m^2 s^2)" in str(again)
    motion = SPRUNG.simulate(1.0, 0.0, np.linspace(0, 4, 2001))
    # Energy is lost to the viscous damping alone: dE/dt = -c q_dot^2, by Simpson's rule.
    energy = SPRUNG.energy(motion.q, motion.q_dot)
    h = motion.t[1]
    power = 0.3 * motion.q_dot**2
    lost = h / 3 * (power[0] + 4 * power[1::2].sum() + 2 * power[2:-1:2].sum() + power[-1])
    assert energy[0] - energy[-1] == pytest.approx(lost, rel=1e-7)


@pytest.mark.slow
def test_it_is_named_in_a_reduced_model():
    t = np.arange(0, 12, 0.005)
    decays = [
        rs.add_noise(SPRUNG.simulate(a, 0.0, t), 40, i) for i, a in enumerate((1.0, 0.6, 0.8))
    ]
    decays = [rs.Decay(d.t, d.q, unit="m") for d in decays]
    report = rs.diagnose(
        MODEL, decays[:2], held_out=decays[2], catalogue=(*CATALOGUE, OneWaySpring())
    )
    assert report.verdict == "named" and [e.name for e in report.effects] == ["one_way_spring"]
    assert report.effects[0].values["strength"] == pytest.approx(12.0, rel=0.02)
    assert OneWaySpring() in report.model.terms


@pytest.mark.study
@pytest.mark.slow
def test_it_is_simulated_and_named_on_a_beam():
    beam = Beam.cantilever(elements=8)
    effect = OneWaySpring()
    sprung = beam.with_effect(effect.on_beam(8000.0))  # 2000 N/m^3 move nothing by 0.1 %
    motion = sprung.simulate(sprung.release_shape(0.1, mode=1), 0.5, progress=False)
    assert motion.energy.drift < 1e-4
    sensors = beam.sensors([Sensor(x) for x in (0.12, 0.2, 0.28, 0.36, 0.45)])
    step = 4e-3
    decays = []
    for i, tip in enumerate((0.1, 0.07, 0.085)):
        shape = sprung.release_shape(tip, mode=1)
        seen = sensors.measure(
            sprung.simulate(shape, 5.0, step, sensors=sensors, progress=False), 40, i
        )
        decays.append(rs.Decay(step * np.arange(len(seen)), seen, unit="m"))
    report = rs.diagnose(
        beam, decays[:2], sensors=sensors, held_out=decays[2], catalogue=[effect], max_effects=1
    )
    assert report.verdict == "named" and report.names == ("one_way_spring",)
    (found,) = report.effects
    assert found.values["strength"] == pytest.approx(8000.0, rel=0.03)
    assert found.units["strength"] == "N/m^3" and found.label.endswith("at 0.225 m")
    assert report.model.effects[-1].law == effect


# -- every effect -------------------------------------------------------------------------------


# What remembers has no slopes of its own at one instant: see test_memory.py.
OF_THE_INSTANT = {k: e for k, e in EFFECTS.items() if not isinstance(e, MemoryEffect)}


@pytest.mark.parametrize("effect", OF_THE_INSTANT.values(), ids=OF_THE_INSTANT.keys())
def test_slopes_are_those_of_the_force(effect):
    """Central differences of forces and readings, off every kink."""
    scales = Scales(1.0, 30.0, 10.0, (100.0,))
    effect = effect.shaped({p.name: p.starts[0] for p in effect.parameters(scales)})
    t, q = np.array([1.0, 2.0, 3.0, 4.0]), np.array([-0.83, -0.31, 0.42, 0.77])
    v, a, h = np.array([2.0, -3.0, 1.5, -2.5]), np.array([9.0, -4.0, 2.0, 7.0]), 1e-6
    strengths = np.ones(effect.n_strengths)

    def at(function, *arguments):
        value = function(*arguments)
        return 0.0 * q if value is None else strengths @ value

    def force(dq=0.0, dv=0.0, da=0.0):
        return at(effect.forces, State(t, q + dq, v + dv, a + da, 1e-3))

    by_q, by_v, by_a = effect.slopes(State(t, q, v, a, 1e-3), strengths)
    # Differences: h^2 times third derivatives below 1e3, and rounding over h.
    for slope, change in ((by_q, {"dq": h}), (by_v, {"dv": h}), (by_a, {"da": h})):
        back = {k: -x for k, x in change.items()}
        difference = (force(**change) - force(**back)) / (2 * h)
        np.testing.assert_allclose(slope + 0 * q, difference, rtol=1e-6, atol=1e-7)
    shown = (at(effect.readings, t, q + h) - at(effect.readings, t, q - h)) / (2 * h)
    np.testing.assert_allclose(strengths @ effect.reading_slopes(t, q), shown, atol=1e-7)


def test_looking_alike_is_mutual():
    for a in EFFECTS.values():
        for name in look_alikes(a.name, EFFECTS.values()):
            assert a.name in look_alikes(name, EFFECTS.values())


def test_a_cubic_stiffness_that_was_found_joins_the_one_there_is():
    """And a whole power of the speed the named damping."""
    found = EFFECTS["cubic_stiffness"].shaped({"exponent": 3.0}).term()
    assert found == Stiffness(3) and found.key == "gamma_3"


def test_it_joins_the_table_and_the_page_of_effects():
    """A new effect needs no word in the documentation: test_docs.py looks at those there are."""
    catalogue = [*CATALOGUE, OneWaySpring()]
    assert len(rows(catalogue)) == len(rows(CATALOGUE)) + 1
    section = page(catalogue).split("(onewayspring)=")[1].split("###")[1]
    # Its force averages to 0 over one half of the cycle: frequency rises with its amplitude.
    assert section.startswith(" A spring that hardens one way\n")
    assert r"$$\operatorname{max}(q, 0)^{3}$$" in section
    assert "![Frequency: up, more at large amplitudes. Damping ratio: no change.]" in section
