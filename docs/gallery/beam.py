"""A steel strip let go from 200 mm swings in gravity, and its tip moves along the beam as well.

Shapes of a cantilever every 20 ms, from bent far upwards to bent farther downwards; where it is
bent most, its tip is nearer to the clamp. Dashed, it hangs at rest a little below straight.
"""

import matplotlib.pyplot as plt

import romsindy as rs

beam = rs.Beam.cantilever(elements=8, spring_stiffness=0.0)  # 450 x 25 x 1 mm, no spring
held, rest = beam.release_shape(tip_displacement=0.2, mode=1), beam.equilibrium()
motion = beam.simulate(held, duration=0.121, keep_field=True, progress=False)
field = motion.field.displacement.reshape(len(motion.t), -1, 3)  # along, across, rotation
for i in range(0, 121, 20):
    x, y = 1e3 * (held.s + field[i, :, 0]), 1e3 * field[i, :, 1]
    plt.plot(x, y, color=plt.colormaps["viridis"](i / 140))
    plt.text(x[-1] + 5, y[-1], f"{1e3 * motion.t[i]:.0f} ms", va="center")
plt.plot(1e3 * (rest.s + rest.displacement[:, 0]), 1e3 * rest.displacement[:, 1], "k--", lw=1)
plt.gca().set(xlabel="x (mm)", ylabel="y (mm)", xlim=(0, 500), aspect="equal")
plt.show()
