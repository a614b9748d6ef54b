"""A structure on a shaker: an equation from the first 15 s predicts the rest in its 95 % band.

Displacement over three seconds. Dots of the measurement swell and fade without rule; a blue band,
a few millimetres wide, follows them all along.
"""

import matplotlib.pyplot as plt
import numpy as np

import romsindy as rs

terms = {"omega^2": 987.0, "gamma_3": 2e4, "c_linear": 0.8, "gain [force]": 2.0}  # q in m
model, rng = rs.ReducedModel.from_coefficients(terms, unit="m"), np.random.default_rng(0)
t, tones = np.arange(0, 18, 0.01), np.arange(1, 12, 1 / 6)  # s, Hz
u = 0.4 * np.sin(2 * np.pi * (np.outer(t, tones) + rng.random(len(tones)))).sum(axis=1)  # N
y = model.simulate(0.0, 0.0, t, u=u).y + 2e-3 * rng.standard_normal(len(t))
record = rs.ForcedVibration(t, y, u, unit="m", input_unit="N", interpolation="band-limited")
first, rest = record.between(end=15.0), record.between(start=15.0)
told = rs.identify(first, order=3).forecast(rest, samples=50)  # of 0.5 s
plt.fill_between(rest.t, 1e3 * told.low, 1e3 * told.high, alpha=0.4, lw=0)
plt.plot(rest.t, 1e3 * rest.y, ".", color="0.2", ms=5)
plt.gca().set(xlabel="time (s)", ylabel="displacement (mm)", xlim=(15, 18))
plt.show()
