"""Releases from three amplitudes fall onto one backbone, and so does the identified equation.

Frequency across, amplitude upwards. As the amplitude falls from 78 mm, the frequency rises from
7.66 Hz to 7.95 Hz. Cycles of three decays, each with its standard error, overlap along one curve;
at the end of a decay the bars are long, and cycles stray together. The line lies amid them.
"""

import matplotlib.pyplot as plt
import numpy as np

import romsindy as rs
from romsindy.show.plots import plot_backbone

terms = {"omega^2": 2500.0, "gamma_3": 5e4, "Upsilon_3": 60.0, "c_linear": 0.4}  # q in m
model, t = rs.ReducedModel.from_coefficients(terms, unit="m"), np.arange(0, 5, 1 / 200)
decays = [rs.add_noise(model.simulate(q, 0.0, t), 25, i) for i, q in enumerate((0.08, 0.06, 0.04))]
backbones = [rs.extract_backbone(decay) for decay in decays]
ax = plt.axes()
for number, (b, look) in enumerate(zip(backbones, "os^", strict=True), 1):
    ax.plot(b.frequency / (2 * np.pi), b.amplitude, look, ms=3, label=f"release {number}")
plot_backbone(backbones, {"identified, 95 %": rs.identify(decays)}, ax=ax)
plt.show()
