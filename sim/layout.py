"""Where each quantity lies in the packed arrays that the compiled vehicle works on.

One array is the vehicle's memory: its state, its constants, normal noise for the gusts and the history, one after
the other (a kernel unpacks one array much faster than four). Indices are those of the state, `P_` indices those of
the constants, and the columns of a trace row are those of `TRACE`.
"""

# State: rigid body first, in the order of a trace row without its time.
POSITION = 0
ORIENTATION = 3
VELOCITY = 7
OMEGA = 10
FORCE = 13
"""Specific force, body."""
ROTORS = 16
"""Speeds of the four rotors, rad/s."""
GUST = 20
CHARGE = 23
VOLTAGE = 24
CONTACT = 25
"""1 while a foot touches the ground."""
STEPS = 26
"""Steps made."""
NOISE_ROW = 27
# Rate loop.
RATES = 28
"""Rate setpoint in force."""
THRUST = 31
MOTORS_ON = 32
PHASE = 33
"""Time since the rate loop's last run."""
SIGNALS = 34
"""Motor signals 0..1."""
GYRO_DELAY = 38
"""Two delay elements of the gyro filter for each axis."""
GYRO = 44
"""Filtered rates at the last run."""
ACCELERATION = 47
"""Filtered angular acceleration."""
INTEGRAL = 50
TORQUE = 53
"""Normalised torque asked of the rotors; yaw is low-passed."""
SATURATED = 56
"""Sign of the torque that could not be allocated, for each axis."""
# Pending commands: a ring of rows (time, rates (3), thrust).
QUEUE_HEAD = 59
QUEUE_TAIL = 60
QUEUE = 61
QUEUE_ROWS = 256
QUEUE_COLUMNS = 5
STATE_SIZE = QUEUE + QUEUE_ROWS * QUEUE_COLUMNS

# Constants.
P_STEP = 0
P_START = 1
P_MASS_INVERSE = 2
P_INERTIA = 3
P_ROTOR_X = 6
P_ROTOR_Y = 7
P_SPEED_MAX = 8
P_THRUST_COEFFICIENT = 9
P_TORQUE_RATIO = 10
P_DECAY_UP = 11
"""exp(-step / 2 / time constant), for the half step."""
P_DECAY_DOWN = 12
P_MOTOR_CURVE = 13
P_LINEAR_DRAG = 14
P_QUADRATIC_DRAG = 17
"""½ ρ C_d A, N/(m/s)²."""
P_DAMPING = 18
P_STIFFNESS = 19
P_CONTACT_DAMPING = 20
P_RATED_VOLTAGE = 21
P_RESISTANCE = 22
P_CAPACITY = 23
"""A s."""
P_EFFICIENCY = 24
P_AVIONICS = 25
P_OPEN_CIRCUIT = 26
"""Eleven pack voltages, at 0, 10, … 100 % charge."""
P_WIND = 37
P_GUST = 40
P_LOOP_PERIOD = 41
P_GAIN_P = 42
P_GAIN_I = 45
P_GAIN_D = 48
P_INTEGRAL_LIMIT = 51
P_THRUST_CURVE = 54
P_GYRO_FILTER = 55
"""b0, b1, b2, a1, a2."""
P_ACCELERATION_ALPHA = 60
P_YAW_ALPHA = 61
P_MIX_ROLL = 62
P_MIX_PITCH = 63
P_INERTIA_INVERSE = 64
P_LOOP_RATE = 67
CONSTANTS_SIZE = 68

TRACE = 17
"""Columns of a trace row: time, position, quaternion, velocity, angular velocity, specific force (body)."""

# Memory.
CONSTANTS = STATE_SIZE
"""Where the constants begin."""
NOISE = CONSTANTS + CONSTANTS_SIZE
"""Where the noise begins, three numbers for each step."""
NOISE_ROWS = 4096
HISTORY = NOISE + 3 * NOISE_ROWS
"""Where the trace rows begin."""
