"""The control period and the times that both ends of the bus agree on.

`PERIOD_NS` is the one place where the period is written; everything else that depends on it is
computed from it, here and in the other packages. After a change of it run
`python tools/cycle_times.py` to write the new cycle times into the two DBC files.
"""

PERIOD_NS = 25_000_000
"""the control period, and the model's sampling time. Paper: table of hyperparameters"""
PERIOD_S = PERIOD_NS / 1e9
PERIOD_MS = PERIOD_NS / 1e6

LONGEST_S = 1e7
"""longest time that a person may set, about four months: it fits into 64 bits of nanoseconds"""

COMMAND_TIMEOUT_S = 0.100
"""a command older than this is ignored and the vehicle brakes"""
COMMAND_TIMEOUT_TICKS = round(COMMAND_TIMEOUT_S / PERIOD_S)
COMMAND_TIMEOUT_NS = round(COMMAND_TIMEOUT_S * 1e9) - PERIOD_NS // 2
"""ages are about multiples of the period: the limit lies between two of them"""

COUNTER_MODULUS = 16
"""number of values of a frame's counter, 0..15"""
LONG_COUNTER_MODULUS = 8 * COUNTER_MODULUS
"""of the counter with the cycle of three bits beside it, in the frames of the vehicle: 3.2 s"""

HOLD_PLAN_TICKS = 2
"""how many ticks in a row the last good plan may replace a missing one"""

MISSION_PERIOD_TICKS = round(0.1 / PERIOD_S)
"""MISSION is sent every 100 ms"""
MISSION_VALID_NS = 500_000_000
"""ValidFor of the MISSION of the simulated car, and of a car with its own messages"""
IDENT_PERIOD_TICKS = round(1.0 / PERIOD_S)
"""IDENT_CONTROLLER and IDENT_VEHICLE are sent every second"""

COUNTER_AHEAD_TICKS = 4
"""an end that receives nothing goes on counting, and may be ahead by this much"""


def counter_lag(newer: int, older: int) -> int:
    """Periods by which the long counter `older` is behind `newer`; 0 if it is ahead."""
    lag = (newer - older) % LONG_COUNTER_MODULUS
    return 0 if lag >= LONG_COUNTER_MODULUS - COUNTER_AHEAD_TICKS else lag
