"""A magnet whose exponent is not known beforehand: poles, dipoles and what lies between."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import romsindy as rs
from romsindy.beam import Beam
from romsindy.beam.motion import Sensor
from romsindy.diagnosis.found import effects_of
from romsindy.diagnosis.on_beam.instrumented import InstrumentedBeam
from romsindy.diagnosis.on_beam.mounted import mounted_effects
from romsindy.effects.base import Scales, State

VALUES = {"omega^2": 900.0, "gamma_3": 90.0, "c_linear": 0.25}
T = np.arange(0, 10, 0.005)


def pulled(amplitude, exponent):
    """An oscillator between whose rest and the magnet there are 1.5; 1 of pull at rest."""

    def rates(_, y):
        pull = 1.0 * ((1 - y[0] / 1.5) ** -exponent - 1)
        return y[1], -900 * y[0] - 90 * y[0] ** 3 - 0.25 * y[1] + pull

    return solve_ivp(rates, (0, T[-1]), [amplitude, 0.0], t_eval=T, rtol=1e-9, atol=1e-10).y[0]


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [3.0, 4.0])
def test_the_exponent_of_a_magnet_is_found(exponent):
    decays = [
        rs.add_noise(rs.Decay(T, pulled(a, exponent)), 40, i) for i, a in enumerate((1.0, 0.6, 0.8))
    ]
    model = rs.ReducedModel.from_coefficients(VALUES)
    # At the default tolerance another gamma_3 does as well. The strength of a cubic pull goes with
    # its distance and exponent: alone it is less than three standard errors off zero.
    fine = {"frequency": 1e-4, "damping": 1e-2, "signal": 2e-4}
    report = rs.diagnose(model, decays[:2], held_out=decays[2], tolerance=fine)
    assert report.verdict in ("named", "ambiguous") and report.equivalent == (("magnet",),)
    # As it was fitted, before it was rounded to a whole number that does as well.
    fitted = next(h for h in report.compared if h.names == ("magnet",))
    (found,) = effects_of(fitted, [fitted], 1.0, model)
    # A larger exponent at a larger distance pulls nearly alike: four standard errors.
    error = abs(found.values["exponent"] - exponent)
    assert error < max(4 * found.standard_errors["exponent"], 0.02)


def test_the_exponent_of_a_magnet_is_free_on_a_beam():
    beam = Beam.cantilever(elements=8)
    curve = InstrumentedBeam(beam, beam.sensors([Sensor(0.45)])).curve(0.01)
    magnets = [e for e in mounted_effects(curve) if e.name == "magnet"]
    known = {p.name: p for p in magnets[0].parameters(Scales(0.01, 38.0, 10.0))}
    assert (
        known["exponent"].starts[0] == 4 and known["exponent"].low < 2 < 4 < known["exponent"].high
    )
    stops = [e for e in mounted_effects(curve) if e.name == "stop"]
    assert "exponent" not in {p.name for p in stops[0].parameters(Scales(0.01, 38.0, 10.0))}


def test_a_magnet_moves_no_sensor_that_is_zero_at_rest():
    """A beam with one, let go a little, swings about its rest, as the equation does about zero."""
    beam = Beam.cantilever(elements=8)
    seen = InstrumentedBeam(beam, beam.sensors([Sensor(0.45)]))
    magnets = [e for e in mounted_effects(seen.curve(0.01)) if e.name == "magnet"]
    magnet = magnets[0].shaped({"distance": 0.1})
    still = State(np.zeros(1), *np.zeros((3, 1)), 1e-3)
    # Of a pull of 1 N: what the equilibrium is solved to.
    assert magnet.forces(still) == pytest.approx(np.zeros((1, 1)), abs=1e-8)
    pulled = beam.with_effect(magnet.on_beam(0.01))
    softer = pulled.modes(count=1).omega[0] ** 2 - beam.modes(count=1).omega[0] ** 2
    ones = np.ones((1, 1))
    # The pull at rest also bends the beam, which changes its stiffness by less.
    assert magnet.slopes(still, 0.01 * ones)[0][0] == pytest.approx(softer, rel=0.05)
