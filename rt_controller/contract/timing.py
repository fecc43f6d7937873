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
