"""A joint sticks in small motions and slips in large ones: its force over one cycle of each.

Three loops of force over displacement. The smallest is a slanted line without area; the larger two
have flat tops and bottoms at the same force, and their area is what a cycle loses.
"""

import matplotlib.pyplot as plt
import numpy as np

import romsindy as rs
from romsindy.physics.memory import SlippingJoint

linear = rs.ReducedModel.from_coefficients({"omega^2": 2500.0, "c_linear": 0.2}, unit="m")
joint = rs.ReducedModel((*linear.terms, SlippingJoint(slip=2e-3)), (*linear.values, 500.0), "m")
for start, look in ((0.009, "-"), (0.005, "--"), (0.0018, "-.")):  # m
    motion = joint.simulate(start, 0.0, np.arange(0, 0.2, 5e-4)).between(end=0.121)
    force = -linear.residual(motion.q, motion.q_dot, motion.q_ddot)  # of the joint, per unit mass
    plt.plot(1e3 * motion.q, force, look, label=f"released from {1e3 * start:g} mm")
plt.gca().set(xlabel="displacement (mm)", ylabel="force of the joint (m/s²)", ylim=(-1.2, 1.8))
plt.legend(loc="upper left")
plt.show()
