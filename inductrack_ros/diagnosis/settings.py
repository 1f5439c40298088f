# SPDX-License-Identifier: Apache-2.0
"""Every threshold of the diagnosis, with its unit, its meaning and where it comes from."""

#: Chance that a round of the search adds an effect to a complete model (a level; rivals are counted in each round).
LEVEL = 0.01
#: Size of the sets of known effects that are looked for together, and how many of the best single ones make pairs and
#: triples. Linear algebra alone; what would make them needless is a search without a limit.
LARGEST_SET, IN_PAIRS, IN_TRIPLES = 3, 14, 8
#: Sets refitted in each round: the best, and those whose expected deviance is so near to it that the refit may turn
#: them round (four times the 99.9 % point of χ² with one degree of freedom).
REFITTED, NEAR = 4, 43.0
#: Sets refitted in a round at the most, where the first keep less than others promise, as many single effects with
#: contact taken exactly, and forces of any shape. A bound on time alone.
MOST_REFITTED, FORCES_REFITTED = 12, 3
#: Rounds of the search at the most: each adds a set.
ROUNDS = 4
#: Rivals whose deviance after refitting is within this of the answer's cannot be told from it (99 % point of χ² with
#: one degree of freedom).
TWINS = 6.6
#: Gauss–Newton steps of a refit, and of the look at a rival.
REFIT_STEPS, LOOK_STEPS = 12, 5
#: A coordinate counts as shaken where no disturbance would raise the deviance by this (its 99.9 % point, χ² with one
#: degree of freedom at the edge of its range).
SHAKEN = 9.5
#: Intervals of a force's table: for all laws, and for laws along the track and in time, which may change often.
COARSE, MEDIUM, FINE = 8, 24, 120
#: A limit is the size that this part of such campaigns would have shown.
POWER = 0.9
#: Gauss–Newton steps of the first fit.
FIRST_STEPS = 40
#: Rows of a campaign that are used at the most, half a minute at 1 kHz: each takes some 60 kB, and 10 ms of a search. A
#: filter that keeps nothing of what it has passed would make this needless.
MOST_ROWS = 30_000
#: A free parameter whose deviation is this part of its prior's is one that the data say nothing about.
UNDETERMINED = 0.1
#: Effects found one after the other at the most: a model that lacks more is too far from the rig for any of them to be
#: sure.
MOST_EFFECTS = 3
#: Where more is missing than that, an effect is a lead if it leaves less than this part of the open-loop χ²: what it
#: explains is more than all that is still missing.
LEAD = 0.5
