"""Drag in air lets damping grow with amplitude: cycles, the identified equation, and the true one.

Damping ratio against amplitude. Circles with error bars, one for each cycle of a decay, rise along
a line from 0.6 % to 1.8 %. The identified curve and the true one lie on each other, within a 95 %
band that is narrow in the middle.
"""

import matplotlib.pyplot as plt
import numpy as np

import romsindy as rs
from romsindy.show.plots import plot_damping

terms = {"omega^2": 2500.0, "gamma_3": 5e4, "c_linear": 0.4, "c_quadratic": 0.5}  # q in m
model = rs.ReducedModel.from_coefficients(terms, unit="m")
decay = rs.add_noise(model.simulate(0.08, 0.0, np.arange(0, 5, 1 / 200)), snr_db=28, seed=0)
ax = plot_damping(
    rs.extract_backbone(decay), {"identified, 95 %": rs.identify(decay), "true": model}
)
ax.legend(loc="upper left")
plt.show()
