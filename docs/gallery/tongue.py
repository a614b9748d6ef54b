"""Where a second mode has thrice its frequency, the backbone of a mode that hardens turns aside.

Amplitude against frequency. The line of the first coordinate rises to the right, turns down into a
narrow tongue at 8.4 Hz, comes to rest there, and goes on upwards. In the tongue the dashed line of
the second coordinate rises from next to nothing to its largest amplitude.
"""

import matplotlib.pyplot as plt

import romsindy as rs
from romsindy.show.plots import plot_branch

terms = {"omega^2 [q1]": 2500.0, "omega^2 [q2]": 25000.0, "gamma_3 [q1]": 1e6}
coupling = {"V q1^3 q2": 1e5, "V q1^2 q2^2": 1.5e6}  # q in m
model = rs.CoupledModel.from_coefficients(terms | coupling, unit="m")
plot_branch(rs.backbone_curve(model, amplitude=(0.001, 0.03), mode=1, n_points=120))
plt.show()
