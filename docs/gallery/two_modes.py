"""Two modes at 1 : 2 give each other their energy, as a model of both foretells until it is unsure.

Two panels over thirty seconds. The first mode swells while the second one fades, twice. Dots of a
measured record lie in the band of a prediction from its first two seconds, which is narrow for
fifteen seconds and wide at the second exchange.
"""

import matplotlib.pyplot as plt
import numpy as np

import romsindy as rs

linear = {"omega^2 [q1]": 39.5, "omega^2 [q2]": 159.0, "c_linear [q1]": 0.04, "c_linear [q2]": 0.06}
start, true = (rs.CoupledModel.from_coefficients(linear | {"V q1^2 q2": v}, "m") for v in (0, 15))
t, rng, decays = np.arange(0, 30, 1 / 30), np.random.default_rng(0), []
for q0 in ([0.3, 0.3], [0.05, 0.5]):
    noise = 0.02 * rng.standard_normal((len(t), 2))
    decays.append(rs.Decay(t, true.simulate(q0, [0.0, 0.0], t).q + noise, unit="m"))
told = rs.refine(start, decays[0]).forecast(decays[1], samples=60)  # of 2 s
for i, ax in enumerate(plt.subplots(2, sharex=True)[1]):
    ax.fill_between(t, told.low[:, i], told.high[:, i], color=f"C{i}", alpha=0.5, lw=0)
    ax.plot(t, decays[1].q[:, i], ".", color="0.2", ms=2)
    ax.set(ylabel=f"mode {i + 1} (m)", xlabel="time (s)", xlim=(0, 30))
plt.show()
