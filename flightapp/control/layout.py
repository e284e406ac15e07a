"""Where each number lies in the one array that the control kernel works on.

Handing one array to compiled code takes a fraction of the time that handing it a dozen would. Indices are of the array,
but for `ENTRY_…`, which are within an entry of the history.
"""

PARAMETERS = 0
"""`Parameters`, in order."""
STAMP = 40
"""s, when the command is sent."""
STATE = 41
"""Stamp, position, q_wb, velocity, body rates."""
RATES = 55
"""rad/s, of the command."""
COUNT = 58
"""Entries written into the history."""
FREE = 59
"""1 where no limit held the last command back."""
# What is learnt: see `disturbance`.
DISTURBANCE = 60
"""m/s², world."""
STEADY = 63
"""m/s², its steady horizontal part."""
TRIM = 65
"""Relative error of the thrust."""
VELOCITY = 66
"""m/s, the observer's."""
SEEN = 69
"""s, the last state's stamp; `NEVER` before the first."""
NEVER = -1e9
SLOPE = 70
"""m/s², acceleration by the model at that stamp."""
DRAG = 73
"""Relative error of the drag."""
PLACE = 74
"""m, where the velocities seen have led."""
DRIFT = 77
"""m/s, by which the positions seen move faster than the velocities say."""
# The trajectory's head.
ORIGIN = 80
"""s, stamp of its start."""
SEGMENTS = 81
TURNS = 82
"""Segments of the yaw."""
SEGMENT = 83
"""The segment read last, and that of the yaw."""
TURN = 84
FORESEEN = 88
"""Position, velocity, q_wb, body rates and thrust at the moment when the newest command takes effect."""
# Commands sent.
HISTORY = 104
ROWS = 128
"""Half a second at 250 Hz. A power of two, so that a place in the ring is a mask away."""
MASK = ROWS - 1
ENTRY = 16
ENTRY_STAMP = 0
"""s, when it takes effect."""
ENTRY_COMMAND = 1
"""Body rates and thrust asked for."""
ENTRY_MODEL = 5
"""Body rates and thrust that the lags have made of the commands before, at its stamp."""
ENTRY_SUM = 9
"""Integrals of these over time."""
LINE = HISTORY + ROWS * ENTRY
"""Where the trajectory begins: knots, coefficients (n, 8, 3), knots of the yaw, its coefficients (m, 4)."""
