"""Is a free decay explained, whatever its noise, do its bands hold, and is a missing term noticed?

    python benchmarks/decay_verdicts.py --count 40 --jobs 2     # records of each kind and row
    python benchmarks/decay_verdicts.py --first 300 --noise force --what oscillators

Beams of known_beams.py and oscillators, the noises in turn: each sample keeps 0.95 of the one
before at 35 dB, 1/f noise at 35 dB, a hum at 35 dB (the mains, or a few cycles a record) or a white
force that nobody measured, which alone would keep the structure moving by 0.5 to 1.5 % of the first
amplitude. White noise of 45 dB is beside the last two. `identify` finds the structure; bands are
judged at 36 coordinates (K/q and h) and 10 amplitudes (damping ratio; of oscillators).

The row "lacking" gives the right terms of an oscillator, then all but one. It counts records
where the lacking term leaves at least 2 % of the response of a record without noise, the other
terms fitted anew, and twice what the noise leaves. Oscillators are integrated here by Runge and
Kutta's method in plain numbers.
"""

import time
import warnings
from pathlib import Path
from typing import NamedTuple

import known_beams as beams
import numpy as np
from joblib import Parallel, delayed
from noise import pink
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.signal import lfilter
from seeds import parser_of, step

import romsindy as rs
from romsindy.fit.kernel.collocation import TrajectoryError

NOISES = ("ar1", "pink", "force", "hum")
LACKING = ("gamma_3", "c_quadratic", "c_coulomb")
RATE, LENGTH, INSIDE = 300.0, 20.0, 4  # Hz, s, steps of the integration between samples
SIDE = beams.SIDE
AMPLITUDES = np.linspace(0.1, 0.9, 10)  # where damping is judged, of the reach
LOUD, QUIET = 35.0, 45.0  # dB of noise, and of the white noise beside it


class Oscillator(NamedTuple):
    """(1 + u q^2) q'' + u q q'^2 + c q' + d |q'| q' + f sign(q') + K(q) = w, from 1 at rest."""

    omega: float
    zeta: float
    g2: float
    g3: float
    inertia: float = 0.0
    drag: float = 0.0
    friction: float = 0.0

    @property
    def c(self):
        return 2 * self.zeta * self.omega

    def h(self, q):
        return self.inertia * q**2

    def stiffness(self, q):
        """K/q."""
        return self.omega**2 * (1 + q * (self.g2 + q * self.g3))

    @property
    def taylor(self):
        """Of K: by q, q^2 and q^3."""
        return self.omega**2 * np.array([1, self.g2, self.g3])

    @property
    def coefficients(self):
        """Those that are not zero, by the names of the package."""
        values = {
            **dict(zip(("omega^2", "gamma_2", "gamma_3"), self.taylor.tolist(), strict=True)),
            "c_linear": self.c,
            "c_quadratic": self.drag,
            "c_coulomb": self.friction,
        }
        return {name: value for name, value in values.items() if value}

    def motion(self, force, t):
        """Displacement at the samples; ``force`` holds for each step inside of them."""
        numbers = self.inertia, self.c, self.drag, self.friction, *self.taylor, t[1] - t[0]
        u, c, d, f, k, k2, k3, dt = map(float, numbers)
        h = dt / INSIDE

        def rate(w, q, v):
            loss = c * v + d * abs(v) * v + f * ((v > 0) - (v < 0))
            return (w - loss - u * q * v * v - q * (k + q * (k2 + q * k3))) / (1 + u * q * q)

        q, v, found = 1.0, 0.0, [1.0]
        for i, w in enumerate(force.tolist()):
            q, v = step(rate, h, q, v, w, w, w)
            if (i + 1) % INSIDE == 0:
                found.append(q)
        return np.array(found)

    def damping_ratio(self, amplitudes):
        """Energy lost in a cycle over 2 pi a dE/da, of weak damping, by quadrature."""
        return np.array([self._lost(a) / (2 * np.pi * a * self._slope(a)) for a in amplitudes])

    def _potential(self, q):
        return self.omega**2 * q**2 * (1 / 2 + q * (self.g2 / 3 + q * self.g3 / 4))

    def _ends(self, a):
        middle = brentq(lambda m: self._potential(m + a) - self._potential(m - a), -a / 2, a / 2)
        return middle - a, middle + a

    def _slope(self, a):
        high, low = (self._potential(self._ends(a * (1 + e))[1]) for e in (1e-4, -1e-4))
        return (high - low) / (2e-4 * a)

    def _lost(self, a):
        low, high = self._ends(a)
        energy = self._potential(high)

        def power(angle):
            q = (low + high) / 2 + a * np.sin(angle)
            v = np.sqrt(max(2 * (energy - self._potential(q)) / (1 + self.h(q)), 0.0))
            return (self.c * v + self.drag * v * v + self.friction) * a * np.cos(angle)

        return 2 * quad(power, -np.pi / 2, np.pi / 2)[0]


def oscillator(rng):
    """One with inertia or without, with drag or without."""
    omega, zeta = 2 * np.pi * rng.uniform(4, 8), rng.uniform(0.002, 0.008)
    g2, g3 = rng.uniform(-0.15, 0.15), rng.uniform(0.05, 0.3)
    inertia, drag = rng.uniform(0.1, 0.4, 2) * rng.integers(0, 2, 2)
    return Oscillator(omega, zeta, g2, g3, inertia, drag * zeta)


def lacking(rng, name):
    """One with a term that will be left out."""
    omega, zeta = 2 * np.pi * rng.uniform(4, 8), rng.uniform(0.002, 0.005)
    g2, g3 = rng.uniform(-0.1, 0.1), rng.uniform(0.005, 0.1)
    return Oscillator(
        omega,
        zeta,
        g2,
        g3,
        drag=rng.uniform(1.0, 8.0) * zeta * (name == "c_quadratic"),
        friction=rng.uniform(0.05, 0.5) * zeta * omega**2 * (name == "c_coulomb"),
    )


def sampling(noise, rng):
    """Times, and the force of intensity 1 that holds inside of samples."""
    t = np.arange(0, LENGTH, 1 / RATE)
    white = rng.standard_normal((len(t) - 1) * INSIDE) * np.sqrt(RATE * INSIDE)
    return t, white * (noise == "force")


def intensity(omega, zeta, rng):
    """Root of that of a force which keeps a structure moving by about 1 %, of amplitude 1."""
    return rng.uniform(0.005, 0.015) * np.sqrt(4 * zeta * omega**3)


def heard(q, t, noise, omega, rng):
    """A motion with the noise of its sensor."""
    n = len(t)
    level = np.std(q) * 10 ** (-LOUD / 20)
    if noise == "ar1":
        own = lfilter([1.0], [1.0, -0.95], rng.standard_normal(n + 1000))[1000:]
    elif noise == "pink":
        own = pink(n, omega / (2 * np.pi), rng)
    else:
        own = rng.standard_normal(n)
        level = np.std(q) * 10 ** (-QUIET / 20)
    y = q + own * level / np.std(own)
    if noise == "hum":
        few = rng.uniform(2, 6) / t[-1]
        frequency = rng.choice([50.0, 60.0, few])
        size = np.sqrt(2) * np.std(q) * 10 ** (-LOUD / 20)
        y += size * np.sin(2 * np.pi * (frequency * t + rng.random()))
    return y


class Row(NamedTuple):
    """One record: whether it is explained, points that hold and all of them, and the time."""

    noise: str
    seed: int
    explained: bool
    held: dict
    said: str
    seconds: float


def trial(what, noise, seed, cache):
    """`identify` a record, and compare its bands with the truth."""
    warnings.simplefilter("ignore")
    rng = np.random.default_rng([NOISES.index(noise), seed])
    decay, h, stiffness, ratio = RECORDS[what](noise, seed, rng, cache)
    start = time.perf_counter()
    try:
        found = rs.identify(decay)
    except TrajectoryError as error:
        return Row(noise, seed, False, {}, str(error), time.perf_counter() - start)
    seconds = time.perf_counter() - start
    least, largest = found.reach
    q = np.concatenate([least * SIDE[::-1], largest * SIDE])
    held = {}
    for name, curve, truth in (("K", found.stiffness(q), stiffness), ("M", found.inertia(q), h)):
        held[name] = (curve.low <= truth(q)) & (truth(q) <= curve.high)
    if ratio is not None:
        a = AMPLITUDES * min(-least, largest)
        band, true = found.band(a), ratio(a)
        held["damping"] = np.abs(band.damping_ratio - true) <= 1.96 * band.damping_ratio_std
    return Row(noise, seed, found.verdict.explained, held, str(found.verdict), seconds)


def of_an_oscillator(noise, seed, rng, cache):
    s = oscillator(rng)
    t, force = sampling(noise, rng)
    q = s.motion(force * intensity(s.omega, s.zeta, rng), t)
    decay = rs.Decay(t, heard(q, t, noise, s.omega, rng), unit="m")
    return decay, s.h, s.stiffness, s.damping_ratio


def of_a_beam(noise, seed, rng, cache):
    release = (beams.cantilever_release, beams.clamped_release)[seed % 2](seed // 2)
    known = beams.known_decay(release, cache)
    t, q, omega = known.decay.t, known.decay.q, np.sqrt(known.coefficients["omega^2"])
    if noise == "force":
        name = f"{release.name.replace(' ', '_')}_shaken"
        q = beams.cached(cache, name, lambda: shaken(release, omega, known.amplitude, rng))["q"]
    decay = rs.Decay(t, heard(q, t, noise, omega, rng), unit=known.decay.unit)
    return decay, lambda q: known.curves(q)[0], lambda q: known.curves(q)[1], None


def shaken(release, omega, amplitude, rng):
    """A decay of a beam whose base is moved by white noise, which goes as a force on mode 1."""
    beam = release.beam
    modes = beam.modes(count=10)
    every = int(np.ceil(omega / beams.FASTEST))
    t = np.arange(round(beams.DURATION / beams.STEP) + 1) * beams.STEP
    zeta = (beam.alpha / omega + beam.eta * omega) / 2
    white = rng.standard_normal(len(t)) / np.sqrt(beams.STEP)
    taken = np.sum(modes.momenta[modes.index(1), :, 1])  # by mode 1, of an acceleration
    base = white * intensity(omega, zeta, rng) * amplitude / taken
    shape = beam.release_shape(release.displacement, mode=1, at=release.at)
    motion = beam.simulate(
        shape,
        beams.DURATION,
        beams.STEP / every,
        base=(t, base),
        modes=modes,
        progress=False,
    )
    return {"q": modes.project(motion, mode=1).q[::every]}


RECORDS = {"beams": of_a_beam, "oscillators": of_an_oscillator}


class Lacking(NamedTuple):
    """One record: its verdicts with the right terms and with one less, and how much that leaves."""

    noise: str
    seed: int
    lacking: str
    explained: bool
    noticed: bool
    said: str
    left: float
    noises: float


def without(noise, seed):
    """`refine` the right terms, and all but one, whose lack is measured without noise."""
    warnings.simplefilter("ignore")
    rng, name = np.random.default_rng([len(NOISES), NOISES.index(noise), seed]), LACKING[seed % 3]
    s = lacking(rng, name)
    t, force = sampling(noise, rng)
    free = s.motion(0 * force, t)
    push = intensity(s.omega, s.zeta, rng)
    y = heard(s.motion(force * push, t) if noise == "force" else free, t, noise, s.omega, rng)
    less = {n: v for n, v in s.coefficients.items() if n != name}
    clean = fitted(less, rs.Decay(t, free, unit="m"))
    noises = rms(y - free) / rms(free)
    left = rms(clean.residuals[0]) / rms(clean.records[0].signal) if clean else 1.0
    if left < max(0.02, 2 * noises):
        return None
    decay = rs.Decay(t, y, unit="m")
    right, wrong = fitted(s.coefficients, decay), fitted(less, decay)
    explained, noticed = is_explained(right), not is_explained(wrong)
    told = right if noticed else wrong
    said = f"without {name}: {noticed}; {told.verdict if told else 'no motion'}"
    return Lacking(noise, seed, name, explained, noticed, said, left, noises)


def is_explained(fit):
    return fit is not None and fit.verdict.explained


def fitted(laws, decay):
    """A fit of these laws; None where they have no motion."""
    try:
        return rs.refine(rs.ReducedModel.from_coefficients(laws, unit="m"), decay)
    except TrajectoryError:
        return None


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


def line(name, rows):
    """What came out of some records."""
    text = f"{name:20}  explained {sum(r.explained for r in rows)} of {len(rows)}, bands hold"
    for what in ("K", "M", "damping"):
        points = [r.held[what] for r in rows if what in r.held]
        if points:
            text += f" {100 * np.mean(np.concatenate(points)):.1f} % ({what})"
    return f"{text}, {np.median([r.seconds for r in rows]):.1f} s each"


def main(arguments=None):
    parser = parser_of(__doc__, 40)
    parser.add_argument("--noise", choices=NOISES)
    parser.add_argument("--what", choices=[*RECORDS, "lacking"])
    parser.add_argument("--cache", type=Path, help="folder of simulated beams")
    options = parser.parse_args(arguments)
    seeds = range(options.first, options.first + options.count)
    each = [(options.noise or NOISES[s // 2 % 4], s) for s in seeds]
    for what in [options.what] if options.what else [*RECORDS, "lacking"]:
        if what == "lacking":
            tried = Parallel(options.jobs)(delayed(without)(*one) for one in each)
            told(what, [r for r in tried if r], lambda r: r.explained and r.noticed, missed)
        else:
            tried = Parallel(options.jobs)(delayed(trial)(what, *o, options.cache) for o in each)
            told(what, tried, lambda r: r.explained, line)


def told(what, rows, right, line):
    """Rows that are not as they should be, then what came out of each noise and of all."""
    for r in rows:
        if not right(r):
            print(f"{what} {r.noise} {r.seed}: {r.said}")
    for noise in NOISES:
        own = [r for r in rows if r.noise == noise]
        if own:
            print(line(f"{what}, {noise}", own))
    print(line(what, rows), flush=True)


def missed(name, rows):
    explained, noticed = sum(r.explained for r in rows), sum(r.noticed for r in rows)
    said = f"right terms explained {explained} of {len(rows)}, a term less noticed {noticed}"
    return f"{name:20}  {said}"


if __name__ == "__main__":
    main()
