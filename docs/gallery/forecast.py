"""A decay that took no part, predicted from its first quarter of a second, and what is left of it.

Two panels over time. Above, dots of a measured decay lie on the line of the prediction. Below, the
difference scatters evenly about zero; nearly all of it is within the 95 % band, which is as wide
as the noise at first and grows towards the end.
"""

import matplotlib.pyplot as plt
import numpy as np

import romsindy as rs

terms = {"omega^2": 2500.0, "gamma_3": 5e4, "Upsilon_3": 60.0, "c_linear": 0.4}  # q in m
model, t = rs.ReducedModel.from_coefficients(terms, unit="m"), np.arange(0, 4, 1 / 200)
known, new = (rs.add_noise(model.simulate(q, 0.0, t), 25, i) for i, q in enumerate((0.08, 0.06)))
told = rs.identify(known).forecast(new, samples=50)  # of 0.25 s
figure, (above, below) = plt.subplots(2, sharex=True)
above.plot(t, told.value, lw=1)
above.plot(t, new.q, ".", color="0.3", ms=2)
below.fill_between(t, told.low - told.value, told.high - told.value, alpha=0.35, lw=0)
below.plot(t, new.q - told.value, ".", color="0.3", ms=2)
above.set(ylabel="displacement (m)")
below.set(ylabel="left (m)", xlabel="time (s)", xlim=(0, 4))
plt.show()
