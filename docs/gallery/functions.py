"""Inertia and stiffness as functions of displacement, each with its 95 % band and the true one.

Two panels over displacement. Above, inertia rises from 1 at rest to 2 at either end. Below,
stiffness rises from 36 to 70. The bands are narrow at rest and wider at the ends, and the dashed
true curves stay in them.
"""

import matplotlib.pyplot as plt
import numpy as np

import romsindy as rs
from romsindy.show.plots import plot_inertia, plot_stiffness

terms = {"omega^2": 36.0, "gamma_2": 2.0, "gamma_3": 9.0, "Upsilon_3": 0.3, "c_linear": 0.06}
model = rs.ReducedModel.from_coefficients(terms, unit="m")
decay = rs.add_noise(model.simulate(1.8, 0.0, np.arange(0, 60, 1 / 40)), snr_db=25, seed=0)
found = rs.identify(decay)
figure, (above, below) = plt.subplots(2, sharex=True)
plot_inertia(found, {"true": model}, label="identified, 95 %", ax=above)
plot_stiffness(found, {"true": model}, label="identified, 95 %", ax=below)
above.set(xlabel="", ylabel="$1 + h(q)$ (–)")
below.set(ylabel="$K(q) / q$ (1/s²)")
plt.show()
