# SPDX-License-Identifier: Apache-2.0
"""Every threshold of the look at the data, with its meaning and where it comes from.

`python benchmarks/check_levels.py` draws clean campaigns and prints how far each statistic goes in them; docs/check.md
quotes it."""

from __future__ import annotations

from scipy import stats

#: Chance that a look says anything false about a whole clean campaign, for each statistic with a known distribution.
FALSE_ALARMS = 0.01

# ---- clocks

#: A step in time longer than this many usual steps is a hole.
HOLE = 5.0
#: A hole longer than all the rest of the run and than so many steps is no run any more; nor is one of so many s and
#: steps.
SPLIT, PAUSE, PAUSE_STEPS = 1000.0, 10.0, 100.0
#: A clock jumped where the travel went on as in so many usual steps at most, while by its speed it should have gone as
#: far as the hole is long.
WENT_ON = 3.0
#: Steps differ by more than this part of their median (standard deviation): jitter of the stamps.
JITTER = 0.02
#: Samples that come so many at a time on average, with nothing between, were stamped when they arrived.
BATCH = 4.0
#: Steps (s) that no rig has between its samples, and that one has only if its file says that its time is in seconds;
#: fewer samples tell neither.
LONGEST_STEP, SLOW_STEP, FEW = 600.0, 0.25, 20

# ---- samples

#: A sample is off where it leaves its neighbours' prediction by this many times what those predictions differ among
#: themselves. A kink, which an impact makes, reaches 3.0 at most, wherever between the samples it lies.
KINK = 4.0
#: Nothing smaller than this part of the channel's range is called an outlier.
SMALLEST = 1e-4
#: Within this part of the nominal gap (of what the next sample may close) a cradle may touch, whatever its sensors'
#: zeros.
TOUCHING = 0.2
#: No force pushes a cradle across the room that the track leaves it with so many times its weight.
HARDEST = 10.0
#: Written in place of a measurement that was not had. 0 is one where it stands far from its neighbours.
FILLERS = (
    -9999.0,
    9999.0,
    -999.0,
    999.0,
    -99999.0,
    99999.0,
    -99.99,
    1e20,
    -1e20,
    1e30,
    -1e30,
    1e38,
    -1e38,
    32767.0,
    -32768.0,
    65535.0,
    2147483647.0,
    -2147483648.0,
)
#: A value this many times the channel's usual range away from it is none of the channel's.
ABSURD = 50.0
#: More than this part of a channel is not set aside: then the channel itself is in doubt.
MOST_SET_ASIDE = 0.2

# ---- sensors

#: Part of a run's samples at its largest or smallest value from which on a channel is saturated, and the fewest of them
#: in a row.
SATURATED, FLAT = 0.02, 8
#: An end of the range is read so many times as often as the value next to it where the sensor is saturated: noise alone
#: makes its ends the rarest readings.
PILED_UP = 5
#: A channel hangs where it repeats one value for this part of a run while the rest of the channel moves.
STUCK = 0.1
#: A channel that leaves its value in a smaller part of its samples, at either side, stands still.
RARE = 0.01
#: The readings' step matters from this part of the noise on.
STEP_MATTERS = 1.0

# ---- noise

#: Noise found over stated beyond which one of the two is not in the unit it seems to be in (a thousand is a milli, 57.3
#: are degrees).
NOISE_IMPOSSIBLE = 30.0
#: From here on it is said.
NOISE_DIFFERS = 1.5
#: Samples further apart (s) do not tell noise from a cradle's motion, which goes up to some 20 Hz.
SLOWEST = 0.025
#: Estimates by a line and by a cubic through the neighbours agree to this factor where what they see is noise and not
#: motion.
SAME_NOISE = 1.3

# ---- channels against each other and against the model

#: A slope between what should be equal, beyond which (or below whose inverse) units are wrong; its sign wrong: at any
#: size.
UNIT = 3.0
#: The same, beyond which it is said: no sensor's scale is off so far.
SCALE = 1.3
#: Correlation from which on a slope means anything.
ALIKE = 0.9
#: Runs of one rig need currents that differ from the stated ones by one factor, to this; and speeds as near are alike.
ONE_CURRENT = 1.15
#: No track falls so steeply: it pushes with this part of the weight.
STEEP = 0.5
#: A speed (m/s) that is surely one, and one that no cradle has.
MOVING, FASTEST = 1.0, 300.0
#: So many times the room that the track leaves is outside of it, whatever the sensors' zeros.
OUTSIDE = 6.0
#: A channel that spans less than the room and whose middle is so many times the room away has another zero.
ELSEWHERE = 1.1
#: An accelerometer's mean is gravity where it is that to this part of itself.
UPRIGHT = 0.15
#: A coordinate moves where it spans more than this many times its noise (noise alone spans 4.7 of them in 98 % of its
#: samples).
MOVES = 6.5
#: A temperature (°C) that no track or magnet of a rig has; in kelvin all have.
HOTTEST = 200.0
#: Values of a run for each number that is free in it (its initial state), below which any model would fit.
VALUES_FOR_EACH = 2
#: A named factor is meant where the one found is this near to it; at any size it is where it is as near as EXACTLY.
NEAR, EXACTLY = 1.35, 1.03
#: What the model leaves of the motion: above BAD the channels do not belong to it, below GOOD they do. Of surge, whose
#: noise is small beside its motion, clean campaigns leave 0.19 at most, of the others 0.5.
BAD, BAD_SURGE, GOOD = 0.7, 0.4, 0.35


def sigmas(count: int, level: float = FALSE_ALARMS) -> float:
    """Standard deviations that the largest of ``count`` normal numbers exceeds with the chance ``level``."""
    return float(stats.norm.isf(level / (2 * max(count, 1))))
