"""Three levels of a stepped sine give an equation, and its 95 % band foretells a fourth level.

Amplitude against frequency for four levels of force. Peaks grow and lean to the right with the
level. Dots of three levels were fitted; those of the fourth and highest, which took no part, lie
in its band as well.
"""

import matplotlib.pyplot as plt
import numpy as np

import romsindy as rs

beam = rs.ReducedModel.from_coefficients({"omega^2": 2500.0, "gamma_3": 2e6, "c_linear": 1.6}, "m")
levels, w, hz = (0.15, 0.3, 0.45, 0.6), np.linspace(48.2, 52.8, 36), 6.2832  # m/s^2, rad/s
noise = 5e-5 * np.random.default_rng(0).normal(size=(4, 36, 2)) @ (1, 1j)  # m
orbits = [rs.forced_response(beam, level, (48.0, 53.0)) for level in levels]
q = np.array([np.interp(w, o.frequency, o.coefficients[:, 1]) for o in orbits]) + noise
fit = rs.fit_steady(beam, np.tile(w, 3), np.repeat(levels[:3], 36), q[:3].ravel(), unit="m")
for b in (fit.forced_response(level, (48.0, 53.0)) for level in levels):
    plt.fill_between(b.frequency / hz, 1e3 * b.low, 1e3 * b.high, alpha=0.35, lw=0)
plt.plot(w / hz, 1e3 * abs(q.T), "o", ms=4, label=[f"{level:.2f} m/s²" for level in levels])
plt.gca().set(xlabel="frequency (Hz)", ylabel="first harmonic (mm)")
plt.legend()
plt.show()
