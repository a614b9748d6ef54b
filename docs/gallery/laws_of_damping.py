"""Four laws of damping, told apart by how the damping ratio changes with amplitude.

Damping ratio against amplitude. That of a viscous damper is level; that of dry friction falls
steeply and flattens; that of drag rises along a line, and that of speed cubed along a parabola.
"""

import matplotlib.pyplot as plt
import numpy as np

import romsindy as rs

amplitude = np.linspace(0.003, 0.05, 100)  # m
laws = {"dry friction": ("c_coulomb", 0.3), "viscous": ("c_linear", 0.8)}  # m/s^2, 1/s
laws |= {"drag": ("c_quadratic", 0.8), "speed cubed": ("c_cubic", 0.6)}  # 1/m, s/m^2
for look, (law, (name, value)) in zip(("-", "--", "-.", ":"), laws.items(), strict=True):
    model = rs.ReducedModel.from_coefficients({"omega^2": 2500.0, name: value}, unit="m")
    ratio = 100 * model.damping_ratio(amplitude)
    plt.plot(1e3 * amplitude, ratio, look)
    plt.text(51, ratio[-1], law, va="center")
plt.gca().set(xlabel="amplitude (mm)", ylabel="damping ratio (%)", xlim=(0, 63), ylim=(0, None))
plt.show()
