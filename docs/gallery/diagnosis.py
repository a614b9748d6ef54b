"""A simulation lacks the drag of the air; the diagnosis adds it, and then it leaves noise alone.

Three panels over time, with one scale. A measured decay; what the simulation leaves of it, which
grows to half as much within a second and stays; what it leaves with the effect that was found, a
thin flat line.
"""

import matplotlib.pyplot as plt
import numpy as np

import romsindy as rs

simulation = rs.ReducedModel.from_coefficients({"omega^2": 2500.0, "c_linear": 0.4}, unit="m")
real = rs.ReducedModel.from_coefficients(simulation.coefficients | {"c_quadratic": 1.0}, unit="m")
t = np.arange(0, 5, 0.005)  # s
decay = rs.add_noise(real.simulate(0.08, 0.0, t), snr_db=30, seed=3)
models = simulation, rs.diagnose(simulation, decay).model
curves = [decay.q, *(decay.q - model.simulate(0.08, 0.0, t).q for model in models)]
axes, names = plt.subplots(3, sharex=True, sharey=True)[1], ("record", "before", "after")
for ax, curve, name, color in zip(axes, curves, names, ("0.3", "C3", "C0"), strict=True):
    ax.plot(t, 1e3 * curve, color=color, lw=1)
    ax.set(ylabel=f"{name} (mm)", xlabel="time (s)", xlim=(0, 5))
    ax.label_outer()
plt.show()
