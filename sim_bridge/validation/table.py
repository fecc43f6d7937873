"""The acceptance table: each line as data, by test."""

import numpy as np

from sim_bridge.validation import (
    cornering,
    dwell,
    lane_change,
    longitudinal,
    numerics,
    peer,
)
from sim_bridge.validation.acceptance import (
    Absolute,
    AtLeast,
    AtMost,
    Goal,
    Line,
    Relative,
)
from sim_bridge.validation.cars import ALL_WHEEL, FRONT_WHEEL
from sim_bridge.validation.measures import largest_jump
from sim_bridge.validation.transients import STEP_SPEEDS_MPS, Transients

NUMERICS: tuple[Line[numerics.Numerics], ...] = (
    Line(
        1, "front wheel load at rest", "N", lambda e: e.front_load_n,
        Goal(4705.0, Relative(0.005)), ALL_WHEEL,
    ),
    Line(
        1, "rear wheel load at rest", "N", lambda e: e.rear_load_n,
        Goal(2655.0, Relative(0.005)), ALL_WHEEL,
    ),
    Line(
        1, "mirrored run differs by", "SI", lambda e: e.mirror_error, Goal(1e-9, AtMost())
    ),
    Line(
        1, "half the step changes yaw rate by", "deg/s", lambda e: e.yaw_rate_change_degps,
        Goal(0.1, AtMost()),
    ),
    Line(
        1, "half the step changes the way aside by", "mm", lambda e: 1e3 * e.lateral_change_m,
        Goal(5.0, AtMost()),
    ),
    Line(
        1, "coasting straight gains energy", "%", lambda e: 100.0 * e.straight_gain,
        Goal(1e-6, AtMost()),
    ),
    Line(
        1, "coasting in a turn gains energy", "%", lambda e: 100.0 * e.turning_gain,
        Goal(1e-6, AtMost()),
    ),
)  # fmt: skip

CORNERING: tuple[Line[cornering.Cornering], ...] = (
    Line(
        2, "steering wheel angle at 0.3 g", "deg", lambda e: e.wheel_angle_deg,
        Goal(26.95, Relative(0.05)), ALL_WHEEL,
    ),
    Line(
        2, "steering effort", "deg/g", lambda e: e.effort_degpg,
        Goal(88.0, Relative(0.05)), ALL_WHEEL,
    ),
    Line(
        2, "understeer, road wheel", "deg/g", lambda e: e.understeer_degpg,
        Goal(1.15, Relative(0.05)), ALL_WHEEL,
    ),
    Line(
        2, "understeer with compliance", "deg/g", lambda e: e.compliant_understeer_degpg,
        Goal(1.43, Relative(0.05)), ALL_WHEEL,
    ),
    Line(
        2, "yaw gain", "1/s", lambda e: e.yaw_gain_ps, Goal(0.289, Relative(0.05)), ALL_WHEEL
    ),
    Line(
        2, "roll", "deg/g", lambda e: e.roll_degpg, Goal(4.45, Relative(0.1)), ALL_WHEEL
    ),
    Line(
        2, "sideslip", "deg/g", lambda e: e.sideslip_degpg, Goal(-0.59, Relative(0.1)), ALL_WHEEL
    ),
)  # fmt: skip

LANE_CHANGE: tuple[Line[lane_change.LaneChange], ...] = (
    Line(
        3, "peak lateral acceleration", "g", lambda e: e.lateral_g,
        Goal(0.787, Relative(0.1)), FRONT_WHEEL,
    ),
    Line(
        3, "peak yaw rate", "deg/s", lambda e: e.yaw_rate_degps,
        Goal(25.6, Relative(0.1)), FRONT_WHEEL,
    ),
    Line(
        3, "peak sideslip", "deg", lambda e: e.sideslip_deg,
        Goal(3.7, Relative(0.1)), FRONT_WHEEL,
    ),
    Line(
        3, "peak roll", "deg", lambda e: e.roll_deg, Goal(3.3, Relative(0.1)), FRONT_WHEEL
    ),
    Line(
        3, "steering wheel to the right", "deg", lambda e: e.rightmost_deg,
        Goal(-105.0, Relative(0.1)), FRONT_WHEEL, is_judged=False,
    ),
    Line(
        3, "steering wheel to the left", "deg", lambda e: e.leftmost_deg,
        Goal(84.0, Relative(0.1)), FRONT_WHEEL, is_judged=False,
    ),
)  # fmt: skip


def peer_lines(angle_rad: float) -> tuple[Line[peer.Pair], ...]:
    """The lines of test 4 at one road-wheel angle."""
    turn = f"at {angle_rad:+.2f} rad"
    lines: tuple[Line[peer.Pair], ...] = (
        Line(
            4, f"yaw rate {turn}", "deg/s", lambda e: e.ours.steady_yaw_rate_degps,
            lambda e: Goal(e.theirs.steady_yaw_rate_degps, Relative(0.03)),
        ),
        Line(
            4, f"roll {turn}", "deg", lambda e: e.ours.steady_roll_deg,
            lambda e: Goal(e.theirs.steady_roll_deg, Relative(0.1)),
        ),
        Line(
            4, f"rise time {turn}", "s", lambda e: e.ours.rise_s, Goal(0.29, Absolute(0.02))
        ),
    )  # fmt: skip
    if angle_rad not in PEER_ON_RECORD:
        return lines
    yaw_rate_degps, roll_deg = PEER_ON_RECORD[angle_rad]
    return (
        *lines,
        Line(
            4, f"yaw rate {turn}, on record", "deg/s", lambda e: e.ours.steady_yaw_rate_degps,
            Goal(yaw_rate_degps, Relative(0.03)),
        ),
        Line(
            4, f"roll {turn}, on record", "deg", lambda e: e.ours.steady_roll_deg,
            Goal(roll_deg, Relative(0.1)),
        ),
    )  # fmt: skip


PEER_ON_RECORD = {0.01: (5.04, 1.77), 0.02: (10.02, 3.53), 0.03: (14.84, 5.26)}
"""yaw rate in deg/s and roll in deg by road-wheel angle, as version 3.0.2 gave them once: targets
that stay where they are when the installed version moves"""


def step_lines(index: int, speed_mps: float) -> tuple[Line[Transients], ...]:
    """The lines of test 5 for one of its steps."""
    at = f"{3.6 * speed_mps:.0f} km/h"
    return (
        Line(
            5, f"t90 of yaw rate, {at}", "s", lambda e: e.steps[index].yaw_rate.t90_s
        ),
        Line(
            5, f"overshoot of yaw rate, {at}", "%",
            lambda e: 100.0 * e.steps[index].yaw_rate.overshoot,
        ),
        Line(
            5, f"t90 of lateral acceleration, {at}", "s",
            lambda e: e.steps[index].lateral.t90_s,
        ),
        Line(
            5, f"steady lateral acceleration, {at}", "m/s²",
            lambda e: e.steps[index].lateral.steady, Goal(4.0, Relative(0.02)),
        ),
    )  # fmt: skip


TRANSIENTS: tuple[Line[Transients], ...] = (
    *(line for i, v in enumerate(STEP_SPEEDS_MPS) for line in step_lines(i, v)),
    Line(
        5, "yaw gain at 1 Hz", "1/s",
        lambda e: float(np.interp(1.0, e.yaw_rate.frequency_hz, e.yaw_rate.gain)),
    ),
    Line(
        5, "yaw phase at 1 Hz", "deg",
        lambda e: float(np.interp(1.0, e.yaw_rate.frequency_hz, e.yaw_rate.phase_deg)),
    ),
    Line(
        5, "yaw gain between neighbours jumps by", "%",
        lambda e: 100.0 * largest_jump(e.yaw_rate.frequency_hz, np.log(e.yaw_rate.gain)),
        Goal(2.0, AtMost()),
    ),
    Line(
        5, "yaw phase between neighbours jumps by", "deg",
        lambda e: largest_jump(e.yaw_rate.frequency_hz, e.yaw_rate.phase_deg),
        Goal(2.0, AtMost()),
    ),
    Line(
        5, "lateral gain between neighbours jumps by", "%",
        lambda e: 100.0 * largest_jump(e.lateral.frequency_hz, np.log(e.lateral.gain)),
        Goal(2.0, AtMost()),
    ),
    Line(
        5, "lateral phase between neighbours jumps by", "deg",
        lambda e: largest_jump(e.lateral.frequency_hz, e.lateral.phase_deg),
        Goal(2.0, AtMost()),
    ),
)  # fmt: skip

DWELL: tuple[Line[dwell.DwellSeries], ...] = (
    Line(
        6, "yaw rate left 1.00 s after", "%", lambda e: 100.0 * e.worst_left_over(1.0),
        Goal(35.0, AtMost()), is_judged=False,
    ),
    Line(
        6, "yaw rate left 1.75 s after", "%", lambda e: 100.0 * e.worst_left_over(1.75),
        Goal(20.0, AtMost()), is_judged=False,
    ),
    Line(
        6, "way aside after 1.07 s", "m", lambda e: e.least_displacement_m,
        Goal(1.83, AtLeast()), is_judged=False,
    ),
)  # fmt: skip

LONGITUDINAL: tuple[Line[longitudinal.Longitudinal], ...] = (
    Line(
        7, "deceleration with 150 N", "g", lambda e: e.deceleration_g,
        Goal(0.8, Relative(0.05)), ALL_WHEEL,
    ),
    Line(7, "way from 100 km/h to rest", "m", lambda e: e.stopping_m),
    Line(
        7, "brakings in which a rear wheel locks first", "", lambda e: float(e.rear_first),
        Goal(0.0, AtMost()),
    ),
    Line(
        7, "0-100 km/h", "s", lambda e: e.hundred_s, Goal(8.5, Absolute(0.5)), ALL_WHEEL
    ),
    Line(
        7, "highest gear reached", "", lambda e: float(e.top_gear), Goal(6.0, AtLeast()), ALL_WHEEL
    ),
    Line(
        7, "shifts taken back at a steady pedal", "", lambda e: float(e.reversals),
        Goal(0.0, AtMost()),
    ),
)  # fmt: skip
