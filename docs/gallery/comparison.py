"""A stiffness polynomial cannot follow the cycles of a decay; with inertia beside it, it can.

Left, frequency against amplitude: circles of cycles bend to the right and back to the left at
large amplitude; the dashed IC-ROM follows them, and the stiffness polynomial crosses them to and
fro. Right, their errors: up to half a per cent for the polynomial, next to nothing for the IC-ROM.
"""

import matplotlib.pyplot as plt
import numpy as np

import romsindy as rs

decay = rs.example_decay(snr_db=45, seed=0)
b, hz = rs.extract_backbone(decay), 2 * np.pi
figure, (left, right) = plt.subplots(1, 2, sharey=True)
left.plot(b.frequency / hz, b.amplitude, "o", color="0.5", mfc="w", label="cycles")
for name, look, inertia in (("polynomial", "-", ()), ("IC-ROM", "--", (3, 4, 5))):
    found = rs.HarmonicSINDy(rs.ROMLibrary(inertia=inertia)).fit(decay).model_.backbone(b.amplitude)
    left.plot(found / hz, b.amplitude, look, label=name)
    right.plot(100 * (found / b.frequency - 1), b.amplitude, look)
left.set(xlabel="frequency (Hz)", ylabel="amplitude (m)")
right.set(xlabel="error of frequency (%)", ylabel="amplitude (m)")
left.legend()
plt.show()
