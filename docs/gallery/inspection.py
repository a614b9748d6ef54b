"""Two modes ring down in one noisy record, and inspection follows each as its frequency falls.

Grey levels over time and frequency show two dark bands, at 9 Hz and at 26 Hz, which fade. A dashed
line runs along the middle of each; the lower one falls by a tenth.
"""

import matplotlib.pyplot as plt
import numpy as np

import romsindy as rs

terms = {"omega^2 [q1]": 2500.0, "omega^2 [q2]": 26000.0, "V q1^2 q2^2": 6e5, "V q1^4": 75e3}
damping = {"c_linear [q1]": 0.7, "c_linear [q2]": 1.0}  # 1/s; q in m
model = rs.CoupledModel.from_coefficients(terms | damping, unit="m")
t, rng = np.arange(0, 6, 1 / 200), np.random.default_rng(0)
q = model.simulate([0.06, 0.02], [0.0, 0.0], t).q.sum(axis=1) + 1e-3 * rng.standard_normal(len(t))
plt.specgram(q, NFFT=128, noverlap=124, pad_to=512, Fs=200, cmap="Greys", vmin=-80)
plt.colorbar(label="level (dB re 1 m²/Hz)")
for mode in rs.inspect(rs.Decay(t, q, unit="m")).modes:
    plt.plot(mode.parts[0].tone.t, mode.parts[0].tone.frequency, "--", label=f"mode {mode.number}")
plt.gca().set(xlabel="time (s)", ylabel="frequency (Hz)", xlim=(0, 6), ylim=(0, 50))
plt.legend(loc="upper right")
plt.show()
