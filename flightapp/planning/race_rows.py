"""Where the numbers of one segment lie: rows of one number per sample, behind one another in one flat array.

Behind the samples themselves come what obstacles are to them, then the sums of what the inequalities contribute.
"""

from flightapp.planning.race_samples import ENTRIES, ROWS, SAMPLES

S = SAMPLES
"""Numbers of a row."""
AT_AWAY, AT_LACK, AT_SQUARE = ROWS * S, (ROWS + 3) * S, (ROWS + 4) * S
"""Where rows begin of ways out of obstacles (3), of how much too near these are, and of the specific force squared."""
AT_VALUE, AT_WORST, AT_RATIO, AT_PUSH = ((ROWS + 5 + 8 * block) * S for block in range(4))
"""Of the inequalities, of the worst of them, of multipliers over slacks, and of forces: eight kinds each."""
AT_PULL = (ROWS + 37) * S
"""Of the right-hand side by the samples."""
AT_MOVED = AT_PULL + ROWS * S
"""Of the second derivative by the samples and the duration."""
AT_PP, AT_VV, AT_FF, AT_AA, AT_JJ, AT_FJ = (AT_MOVED + (ROWS + 6 * block) * S for block in range(6))
"""Of second derivatives: by position twice, and so on, for the pairs of axes xx, xy, xz, yy, yz, zz; by force and its
derivative for all nine."""
AT_FOLDED = AT_FJ + 9 * S
"""Of the same by velocity, acceleration and jerk alone: nine for each pair of axes."""
LENGTH = AT_FOLDED + 6 * 9 * S
"""Of the whole array."""
COLUMNS = 6 * ENTRIES
"""Entries of all pairs of axes."""
