"""Relations between the signals of a car that hold for every car, and contradictions to them.

d(e_psi)/dt = yaw rate - curvature * v_x
d(e_y)/dt   = v_x e_psi + v_y
yaw rate    = curvature * v_x                       where e_psi hardly changes
yaw rate    = v_x * wheel / (ratio * (L + K v_x^2)) roughly
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import (
    DEFAULT_GEOMETRY,
    UNDERSTEER_RAD_PER_MPS2,
    SteeringGeometry,
)
from rt_controller.gateway.contradiction import (
    CURVATURE,
    HEADING,
    LATERAL,
    NOT_COMPARED,
    OFFSET,
    SPEED,
    WANTED,
    WHEELS,
    YAW_RATE,
    Relation,
    remedy,
    sentence,
)
from rt_controller.gateway.window_comparison import (
    LEAST_WINDOWS,
    Agreement,
    Comparison,
    Track,
    best_delay,
    centred,
    changes,
    compare,
    correlation,
    grid_of,
    integrals,
    on_grid,
)

SHORT, MIDDLE, LONG = 12, 20, 40
"""steps of a window: 0.6 s, 1 s and 2 s"""
LARGEST_CURVATURE_FACTOR = 2.0
"""in a lane change on a road of 0.001 1/m, noise and bias of two usual sensors made it 1.6"""
LARGEST_STEERING_FACTOR = 2.5
"""between the yaw rate of the assumed geometry and the measured one"""
LEAST_SPEED_MPS = 3.0
LEAST_HEADING_RAD = 0.02
LEAST_LATERAL_M = 0.1
LEAST_DRIFT_M, LEAST_DRIFT_SHARE = 0.08, 0.15
"""by v_y, and its share of the lateral motion: less may be a delay of another signal"""
REAR_SLIP_S2_PER_M = 0.005
"""side-slip angle of the rear axle per lateral acceleration, of the default car"""
LEAST_ROAD_TURN_RAD = 0.08
LEAST_YAW_RATE_RADPS = 0.05
"""less is an offset of a few degrees of the steering wheel"""
JUMP_RAD, JUMP_M = 0.2, 0.5
"""in a step of 0.05 s: no motion, but another lane"""
STEADY_HEADING = 0.3
"""largest change of e_psi per turn of the car on a road that it follows"""
STEADY_SPEED = 0.03
LONGEST_STEERING_DELAY = 6
"""steps"""
LEAST_CORRELATION = 0.8
"""between yaw rate and commands that are followed"""


class Findings(NamedTuple):
    """What `check_relations` returns."""

    contradictions: tuple[tuple[str, str], ...]
    """each with its remedy"""
    not_compared: tuple[str, ...]
    """each with its reason"""


def check_relations(
    tracks: Mapping[str, Track], has_pose: bool, geometry: SteeringGeometry | None
) -> Findings:
    """Contradictions between signals, of which `tracks` has the usable samples.

    Args:
        tracks: by slot; without those that are not mapped.
        has_pose: place on the road may be computed from the pose.
        geometry: of the car; None: not known, that of the default car is assumed.
    """
    times_s = grid_of(list(tracks.values()))
    values = {name: on_grid(track, times_s) for name, track in tracks.items()}
    absent: list[str] = []
    found: list[Relation] = []
    for signal, others, make in (
        (CURVATURE, (YAW_RATE, SPEED, HEADING), _curvature),
        (HEADING, (YAW_RATE, SPEED, CURVATURE), _heading),
        (OFFSET, (SPEED, HEADING), _lateral),
    ):
        needed = (signal, *others)
        if has_pose and signal not in tracks:
            continue
        if missing := [name for name in needed if not tracks.get(name)]:
            absent.append(f"{signal} (no samples of {', '.join(missing)})")
        else:
            found += make(values, found)
    for signal in WHEELS:
        if signal not in tracks:
            if signal == WHEELS[0]:
                absent.append(f"{signal} (not mapped)")
        elif missing := [name for name in (signal, YAW_RATE, SPEED) if not tracks[name]]:
            absent.append(f"{signal} (no samples of {', '.join(missing)})")
        else:
            found.append(_wheel(signal, values, geometry))
    if tracks.get(WANTED) and tracks.get("mission.engage"):
        found.append(_speed(values))
    for each in found:
        if each.result.agreement in NOT_COMPARED:
            name = f"{SPEED} with {WANTED}" if each.signal == SPEED else each.signal
            absent.append(f"{name} ({NOT_COMPARED[each.result.agreement]})")
    wrong = [each for each in found if each.is_contradiction]
    is_geometry_known = geometry is not None
    contradictions = tuple((sentence(each), remedy(each, is_geometry_known)) for each in wrong)
    return Findings(contradictions, tuple(absent))


def _moving(values: Mapping[str, Array], steps: int) -> Array:
    """1 for windows with motion, else NaN (N - steps,)."""
    mean_mps = integrals(values[SPEED], steps) / integrals(np.ones(len(values[SPEED])), steps)
    return np.where(mean_mps > LEAST_SPEED_MPS, 1.0, np.nan)


def _curvature(values: Mapping[str, Array], _: list[Relation]) -> Iterator[Relation]:
    turned, heading = integrals(values[YAW_RATE], LONG), changes(values[HEADING], LONG, JUMP_RAD)
    road = integrals(values[CURVATURE] * values[SPEED], LONG)
    largest = STEADY_HEADING * np.maximum(np.abs(turned), np.abs(road))
    turned = np.where(np.abs(heading) < largest, turned, np.nan)
    result = compare(turned * _moving(values, LONG), road, LEAST_ROAD_TURN_RAD)
    words = "yaw rate / v_x where the car follows the road"
    yield Relation(CURVATURE, words, result, LARGEST_CURVATURE_FACTOR)


def _heading(values: Mapping[str, Array], before: list[Relation]) -> Iterator[Relation]:
    turned = integrals(values[YAW_RATE], SHORT)
    road = integrals(values[CURVATURE] * values[SPEED], SHORT)
    if any(each.is_contradiction for each in before):  # parts of the road that seem straight
        road[np.abs(road) > 0.5 * LEAST_HEADING_RAD] = np.nan
    expected = centred((turned - road) * _moving(values, SHORT))
    result = compare(
        expected, centred(changes(values[HEADING], SHORT, JUMP_RAD)), LEAST_HEADING_RAD
    )
    words = "a slope of yaw rate - curvature * v_x"
    yield Relation(HEADING, words, result)


def _lateral(values: Mapping[str, Array], _: list[Relation]) -> Iterator[Relation]:
    speed, is_measured = values[SPEED], LATERAL in values
    # At rest and in reverse the course has no angle; such windows are left out anyway.
    speed = np.where(speed > LEAST_SPEED_MPS, speed, np.nan)
    across = values[LATERAL] if is_measured else _steady_lateral(speed, values[YAW_RATE])
    moved = centred(changes(values[OFFSET], MIDDLE, JUMP_M))
    expected, turned = (
        integrals(speed * centred(values[HEADING] + sign * across / speed), MIDDLE)
        for sign in (1.0, -1.0)
    )
    least_m = LEAST_LATERAL_M if is_measured else 2.0 * LEAST_LATERAL_M
    drift = np.abs(centred(integrals(across, MIDDLE)))
    sideways = (drift > LEAST_DRIFT_M) & np.isfinite(moved) & np.isfinite(expected)
    sideways &= np.sum(drift[sideways]) > LEAST_DRIFT_SHARE * np.sum(np.abs(moved[sideways]))
    if is_measured:
        as_mapped, mirrored = (np.abs(moved - by)[sideways].sum() for by in (expected, turned))
        drift_of = Relation(
            LATERAL,
            "the slope of e_y - v_x sin(e_psi)",
            Comparison(Agreement.TOO_LITTLE_MOTION),
        )
        if np.count_nonzero(sideways) < LEAST_WINDOWS:
            yield drift_of
        elif mirrored < 0.5 * as_mapped:
            yield drift_of._replace(result=Comparison(Agreement.OPPOSITE_SIGN))
            return
    words = "a slope of v_x sin(e_psi) + v_y cos(e_psi)"
    result = compare(expected, moved, least_m)
    yield Relation(OFFSET, words, result)


def _steady_lateral(speed: Array, yaw_rate: Array) -> Array:
    """v_y of the default car in a steady turn, for a car that does not measure it."""
    return (DEFAULT_GEOMETRY.rear_axle_m - REAR_SLIP_S2_PER_M * speed**2) * yaw_rate


def _wheel(signal: str, values: Mapping[str, Array], geometry: SteeringGeometry | None) -> Relation:
    length_m, _, ratio, _ = geometry or DEFAULT_GEOMETRY
    speed = values[SPEED]
    per_turn = ratio * (length_m + UNDERSTEER_RAD_PER_MPS2 * speed**2)
    expected = integrals(_driven(signal, values) * speed / per_turn, SHORT)
    yaw = integrals(values[YAW_RATE], SHORT) * _moving(values, SHORT)
    window_s = integrals(np.ones(len(speed)), SHORT)
    delayed = best_delay(expected, yaw, LONGEST_STEERING_DELAY)
    result = compare(yaw / window_s, delayed / window_s, LEAST_YAW_RATE_RADPS)
    if signal == WHEELS[1] and correlation(delayed, yaw) < LEAST_CORRELATION:
        result = Comparison(Agreement.UNCLEAR)
    if result.agreement is Agreement.NONE:  # such as a sliding car
        result = Comparison(Agreement.UNCLEAR)
    return Relation(
        signal,
        "the wheel angle of the yaw rate by the geometry of the car",
        result,
        LARGEST_STEERING_FACTOR,
    )


def _driven(signal: str, values: Mapping[str, Array]) -> Array:
    """The signal; commands only while the car follows them."""
    if signal != WHEELS[1]:
        return values[signal]
    follows = values.get("mission.engage", 1.0) > np.float64(0.5)
    follows = follows & ~(values.get("mission.car_brakes", 0.0) > np.float64(0.5))
    return np.where(follows, values[signal], np.nan)


def _speed(values: Mapping[str, Array]) -> Relation:
    wanted = np.where(values["mission.engage"] > 0.5, values[WANTED], np.nan)
    is_steady = np.ones(max(len(wanted) - LONG, 0), dtype=bool)
    for each in (wanted, values[SPEED]):
        mean_mps = integrals(each, LONG) / integrals(np.ones(len(each)), LONG)
        is_steady &= np.abs(each[LONG:] - each[:-LONG]) < STEADY_SPEED * mean_mps
        is_steady &= mean_mps > LEAST_SPEED_MPS
    expected = np.where(is_steady, integrals(wanted, LONG), np.nan)
    result = compare(expected, integrals(values[SPEED], LONG), LEAST_SPEED_MPS)
    return Relation(SPEED, "the wanted speed, at a steady speed", result)
