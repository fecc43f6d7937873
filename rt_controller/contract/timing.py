"""Periods and time-outs that both ends of the bus agree on."""

PERIOD_S = 0.025
"""the control period, and the model's sampling time. Paper: table of hyperparameters"""
PERIOD_NS = 25_000_000

COMMAND_TIMEOUT_S = 0.100
"""a command older than this is no command: the vehicle's side brakes"""

COUNTER_MODULUS = 16
"""counters of frames come round after so many periods"""

HOLD_PLAN_TICKS = 2
"""how many ticks in a row the last good plan may stand in for a missing one"""

MISSION_PERIOD_TICKS = 4
"""MISSION goes out every 100 ms"""
IDENT_PERIOD_TICKS = 40
"""IDENT goes out every second"""

COUNTER_AHEAD_TICKS = 4
"""one end counts on while it hears nothing from the other, and may be ahead by so much"""


def counter_lag(newer: int, older: int) -> int:
    """Periods by which the counter `older` lies behind `newer`; 0 where it is ahead."""
    lag = (newer - older) % COUNTER_MODULUS
    return 0 if lag >= COUNTER_MODULUS - COUNTER_AHEAD_TICKS else lag
