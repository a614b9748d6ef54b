"""Every number that decides a verdict, once, with the probability or the error it stands for.

Numbers that only steer computations (steps, iterations, starting values) stay where they are used.
"""

from __future__ import annotations

# -- does a model explain its data? (`romsindy.fit.adequacy.verdicts`) -----------------------------

# A right model is said to leave what repeats with the vibration this often (F test).
FALSE_ALARM = 0.01
# Rms of the residual over the noise. The level of the noise of a record is known to 4 % (white) or
# 10 % (coloured, with lines) by `record.noise`: beyond, something is missing wherever it lies.
EXPLAINED = 1.10
# Chi-square over degrees of freedom of what repeats with the vibration. A significant misfit of
# less than 30 % of the noise in power, 14 % in amplitude, where noise is least, does not matter.
STRUCTURE = 1.3

# What goes with the motion or the input of a driven record, as a part of its response, up to which
# nothing is missing (`romsindy.fit.adequacy.independence`): 60 dB.
BARELY = 1e-3
# Correlation from sample to sample from which noise is called coloured; noise of a force that is
# told beside that of the sensor, as a part of it in the response.
COLOURED, SMALLER = 0.3, 0.3

# A force under a decay is no noise where its quarters differ with this probability: winds are not
# the same all along either, but what fades with the motion does so by powers of ten.
FADES = 1e-4

# -- what do the data determine? (`romsindy.fit.functions`) -----------------------------------

# A function is determined where its 95 % band is within this part of its value to either side.
DETERMINED = 0.25
# A short equation follows the functions where it is off by this part of what they change by over
# the range; of a frequency that changes by less than so many of its 95 % half-widths, by these.
FOLLOWED, HARDLY = 0.1, 2.0
# Departures from the equation from window to window that are told, in amplitudes: a milliradian.
DEPARTURE = 1e-3
# Errors this many times those by the noise alone may be chance: windows are few.
BY_CHANCE = 1.5
# Noise of less than so many times the least that is told from none.
NOISE_FREE = 10.0
# What a sensor is expected to be off a straight line at the largest amplitude, as a part of that,
# where nothing else is said: one standard deviation, from the data sheets of usual sensors.
CURVATURE = 0.01
# A band of something that is never negative starts at 0 where it comes to this part of its end.
NEAR_ZERO = 0.05

# Acceleration of other modes, as a part of that of the modes that are modelled, from which on it is
# told: where a joint slips, what slips it counts, whichever mode that is.
MIXED = 0.3

# -- which terms are needed? (`romsindy.fit.choice`) -------------------------------------

# A term must bring down what is left beyond the noise by this part, 1 % in the rms, on data that
# took no part: less is the form of other laws.
TERM = 0.02
# Another choice of terms counts in the errors where its odds against the chosen one are above this:
# 1 to 20 (`romsindy.fit.choice`).
HARDLY_TOLD = 0.05
# A further coordinate must bring down the rms of what is left by this part.
MODE = 0.1

# Standard errors by which data must refuse the sign that a law of damping has, to lift it.
REFUSED = 5.0
# Standard errors by which the kinetic energy of what is dragged along must come out negative
# somewhere, for its terms to be refused: noise alone makes it so where it is nearly none.
NEGATIVE = 3.0

# -- what does an input do between its samples? (`romsindy.fit.records.smooth`) ----------

# A way must leave this part of the power less than another one: less may be the form of the model.
FORM = 0.003

# -- which records can be looked at? (`romsindy.fit.records.record`) -------

# What vibrates below this part of the largest amplitude is not looked at: 40 dB.
QUIET = 0.01
# A record starts with its release if its first cycle is this large a part of the largest: less
# than the decay of a cycle at a damping ratio of 3.5 %.
RELEASED = 0.8
# Fewer cycles tell nothing about an effect; a frequency further off is that of another mode.
LEAST_CYCLES, OTHER_MODE = 3, 1.5
# Against the amplitudes that a model holds for: a record below the first part of the least shares
# none of them; cycles below the second part of the least, or beyond the largest over it, are left
# out.
NO_OVERLAP, SHARED = 0.5, 0.9
# Rms that the richest equation may leave of a simulated series, as a part of its amplitude: more,
# and the series is not the decay of one mode.
ONE_MODE = 0.05
# The vibration must be this many times the noise in the rms: 6 dB.
ABOVE_NOISE = 2.0
# How near to -1 times the asymmetry of the model that of a reversed record is: its standard error
# must be half of this at most, so that the other sign is 11 standard errors off.
REVERSED = 0.3
# Chi-square of reversed records over that of the records as they are, at most, and over that with
# a quadratic force that explains them: then the force is the plainer explanation.
REVERSED_IS_BETTER, REVERSED_IS_NO_WORSE = 0.5, 1.02

# -- what does a simulation lack? (`romsindy.diagnosis`) --------------------------------------

# Difference of minus twice the logarithm of the evidence up to which hypotheses are not told
# apart: odds of exp(7 / 2) = 33 to 1 ("strong" on the scale of R. Kass, A. Raftery, JASA 90, 1995).
EQUIVALENT = 7.0
# Rise of chi-square up to which values that moved do as one effect does: two standard errors of
# one value.
AS_ONE = 4.0
# Rise of chi-square up to which an exponent is a whole number, three standard errors of one value;
# the part of the whole number within which it is one as well, where that foretells what took no
# part as well: its error may be larger by this factor, to which the level of noise is known.
ROUNDED, NEARLY_WHOLE, AS_WELL = 9.0, 0.01, 1.05
# By which two good predictions of data that took no part may differ, each by its errors of form,
# and how much surer an effect must be than values that moved where nothing took no part.
AS_GOOD, UNJUDGED = 2 * EQUIVALENT, 2 * EQUIVALENT
# Price of a force that goes with a power of the input, beside that of its strength: at one level of
# a sine it is another gain but for harmonics above the resonance, and so it is called.
RARER = 2 * EQUIVALENT
# Where the gap stays open, another effect must bring the misfit down by this factor to count.
WORTH = 2.0
# By how much an effect must bring chi-square down on data that took no part. Values that were
# fitted to noise gain less than nothing there, and scatter by about this.
GAINED = 2.0
# What a further effect must close, to matter beside another one: this part of the gap in the rms,
# and this part of the power of the noise.
MATERIAL = 0.03
# The form error of a model on another record than its reference: within this factor it is alike.
# Its size is estimated from a few tens of correlated windows, on a grid of factors of 1.8.
SAME_SIZE = 2.0
# A record that took no part is predicted where its error is at most this many times the noise:
# `EXPLAINED`, and as much again for the errors of the fitted values and of the amplitudes beyond.
PREDICTED = 1.25
# Part of the squared gap that closes where what is left, if it is less than the noise, is no sign
# of a further effect; and that must close before values of the model, or what is small, are told.
CLOSED, MOSTLY_CLOSED = 0.99, 0.9
# Standard errors that the strength of what is named must be off zero: 1 in 400 by chance; and of
# what is named although it is smaller than tests repeat to: 1 in 1.7 million.
NAMED_ABOVE, SMALL_ABOVE = 3.0, 5.0
# Times the noise beyond which nothing is named, unless what is left is within the tolerance.
LEFT_OVER = 2.0
# What the measurement itself may add without being wrong: change of the gain, and curvature of the
# sensor (the part of the largest amplitude that the square adds there).
KNOWN_GAIN, KNOWN_CURVATURE = 0.01, 0.01
# A gap that an effect may leave in the screening, where its shape is but a guess.
SCREENED = 0.01
# Disagreement that does not matter, as a part of the largest amplitude: 74 dB, what the best
# sensors reach.
FLOOR = 2e-4
# Differences that do not matter where nothing else is said, those to which tests repeat: relative,
# of frequency and of damping ratio at equal amplitude, and the rms of the waveform, where phase and
# amplitude agree, over the largest amplitude.
SAME_FREQUENCY, SAME_DAMPING, SAME_SIGNAL = 1e-3, 5e-2, 1e-2
# The widest that repeats, a reference or bands may make these: what differs by more, or is known no
# better, is not determined there. A damping ratio is where its band is within `DETERMINED`; another
# frequency by 2 % is another structure; a waveform that is off by 10 % is another motion.
WIDEST_FREQUENCY, WIDEST_DAMPING, WIDEST_SIGNAL = 0.02, DETERMINED, 0.1
# Standard errors from which on a difference is no chance: up to fifteen spans, of three values
# each, are looked at in every record; of shorter ones each must be as much surer as there are more.
SURE = 3.5
# The fault of a sensor of a beam is named above this part of the rms of its channel, and where one
# channel explains this part of what does not fit: a beam that bends otherwise than simulated is no
# fault of a sensor.
SENSOR_FAULT, ONE_SENSOR = 0.01, 0.8
# Rise of chi-square over the noise up to which an effect may be there on a beam: three standard
# errors, for readings between the points are interpolated; an interval of places that is wider than
# this part of the length says nothing.
PLACE_RISE, PLACE = 9.0, 1 / 3
# A beam whose modes move, or are displaced, by less than this part of their largest at the first
# sample was let go from rest, or hit at rest: more must be read from the sensors.
MOVING = 0.1
# Rms over the noise up to which a simulation as it was is not searched for what it lacks: the level
# of white noise is known to half of what is beyond 1.
NOTHING_LEFT = 1.01
