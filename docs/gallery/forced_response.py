"""The response to three levels of force bends along the backbone; between its folds it is unstable.

Amplitude against frequency. A low peak stands nearly upright at 7.95 Hz; two higher ones lean to
the left along the dark backbone. Each of these has two folds, marked by circles, with a dashed
stretch between them.
"""

import matplotlib.pyplot as plt

import romsindy as rs
from romsindy.show.plots import plot_branch, plot_forced_response

terms = {"omega^2": 2500.0, "gamma_3": 5e4, "Upsilon_3": 60.0, "c_linear": 0.4}  # q in m
model = rs.ReducedModel.from_coefficients(terms, unit="m")
ax = plot_branch(rs.backbone_curve(model, amplitude=(0.002, 0.075)))  # m
for color, force in (("C2", 0.3), ("C1", 0.8), ("C0", 1.3)):  # m/s^2
    response = rs.forced_response(model, force, frequency=(46.0, 52.0))  # rad/s
    plot_forced_response(response, color=color, ax=ax)
plt.show()
