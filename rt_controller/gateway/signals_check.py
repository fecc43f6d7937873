"""`rt-controller signals check`: which mapped signals arrive, their period and plausibility."""

from cmath import phase
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from math import degrees, isnan, pi, radians
from statistics import median
from typing import Any

import can

from rt_controller.gateway.contradiction import WHEELS
from rt_controller.gateway.samples import longest_gap_s
from rt_controller.gateway.signal_relations import check_relations
from rt_controller.gateway.window_comparison import Track
from rt_controller.mapping.car_file import CarFile
from rt_controller.mapping.signal_reader import SignalReader
from rt_controller.mapping.slots import Slot, command_slots, measured_slots
from rt_controller.mapping.unit_mistakes import find_mistake

LEAST_SAMPLES = 20
LEAST_SPEED_MPS = 3.0
LEAST_TURN_RADPS = 0.02
COMMANDED = WHEELS[1]
RATIO_TOLERANCE = 0.15
LARGEST_LATERAL_MPS2 = 15.0
LARGEST_SLIP_RAD = radians(20.0)
"""between heading and direction of motion, for half of the time"""
ALLOWED_UNUSABLE_SHARE = 0.01
"""share of samples that may be marked as missing by the car, or be implausible"""


@dataclass(slots=True)
class SlotReport:
    """What arrived of one slot."""

    slot: Slot
    message: str
    identifier: str
    expected_period_s: float | None
    """of the DBC"""
    samples: int = 0
    unusable: int = 0
    """marked as missing by the car, out of the range of the DBC, or not plausible"""
    period_s: float | None = None
    longest_gap_s: float | None = None
    lowest: float | None = None
    highest: float | None = None
    problem: str = ""
    remedy: str = ""

    def figures(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "signal": self.slot.name,
            "column": self.slot.column.column,
            "message": self.message,
            "identifier": self.identifier,
            "unit": self.slot.si,
            "samples": self.samples,
            "unusable": self.unusable,
            "expected_period_s": self.expected_period_s,
            "period_s": self.period_s,
            "longest_gap_s": self.longest_gap_s,
            "lowest": self.lowest,
            "highest": self.highest,
            "ok": not self.problem,
            "problem": self.problem,
            "remedy": self.remedy,
        }


@dataclass(slots=True)
class CheckReport:
    """What `check_signals` found."""

    duration_s: float
    frames: int
    slots: list[SlotReport]
    relations: list[tuple[str, str]] = field(default_factory=list)
    """contradictions between signals, each with its remedy"""
    not_compared: list[str] = field(default_factory=list)
    """relations that could not be checked, each with its reason"""
    dropped: dict[str, int] = field(default_factory=dict)
    """frames by message that were damaged or repeated"""

    @property
    def is_ok(self) -> bool:
        """True if nothing was found."""
        return not self.relations and not any(each.problem for each in self.slots)

    def figures(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "ok": self.is_ok,
            "duration_s": self.duration_s,
            "frames": self.frames,
            "signals": [each.figures() for each in self.slots],
            "contradictions": [
                {"problem": problem, "remedy": remedy} for problem, remedy in self.relations
            ],
            "not_compared": self.not_compared,
            "dropped_frames": self.dropped,
        }


def check_signals(car: CarFile, frames: Iterable[tuple[float, can.Message]]) -> CheckReport:
    """Read the frames of a bus or a log, each with its time in s, and check every mapped signal.

    Commands may be missing; a recorded wheel angle is compared with the yaw rate.

    Raises:
        ConfigError, DatasetError: a column is not in the DBC, or its unit does not fit.
    """
    mapping, where = car.mapping, str(car.path)
    slots = measured_slots(mapping)
    reader = SignalReader(slots, mapping.messages, car.database, where)
    commands = SignalReader(command_slots(mapping), mapping.messages, car.database, where)
    delays_s = {slot.name: slot.column.delay_s for slot in slots}
    tracks: dict[str, list[tuple[float, float]]] = {name: [] for name in (*delays_s, COMMANDED)}
    times: list[float] = []
    for time_s, frame in frames:
        times.append(time_s)
        for name, value in (reader.read(frame) or {}).items():
            tracks[name].append((time_s - delays_s[name], value))
        if COMMANDED in (values := commands.read(frame) or {}):
            tracks[COMMANDED].append((time_s, values[COMMANDED]))
    reports = [_report(slot, tracks[slot.name], reader, len(times)) for slot in slots]
    dropped = {
        name: counts.wrong_length + counts.wrong_checksum + counts.repeated
        for name, counts in reader.counts.items()
    }
    usable = {
        name: [each for each in track if not isnan(each[1])] for name, track in tracks.items()
    }
    not_compared: list[str] = []
    data = mapping.car
    geometry = data.geometry if data is not None else None
    found = check_relations(usable, mapping.pose is not None, geometry)
    return CheckReport(
        times[-1] - times[0] if times else 0.0,
        len(times),
        reports,
        [*_contradictions(usable, not_compared), *found.contradictions],
        [*not_compared, *found.not_compared],
        {name: count for name, count in dropped.items() if count},
    )


def _report(slot: Slot, track: Track, reader: SignalReader, frames: int) -> SlotReport:
    message = reader.sources[slot.name].message
    cycle_s = 1e-3 * message.cycle_time if message.cycle_time else None
    report = SlotReport(slot, message.name, f"{message.frame_id:#x}", cycle_s, len(track))
    counts = reader.counts[message.name]
    values = [value for _, value in track if not isnan(value)]
    report.unusable = len(track) - len(values)
    if values:
        report.lowest, report.highest = min(values), max(values)
    steps = [later[0] - earlier[0] for earlier, later in pairwise(track)]
    if steps:
        report.period_s, report.longest_gap_s = median(steps), max(steps)
    allowed_s = longest_gap_s(slot, reader.sources[slot.name])
    kind = "29-bit" if message.is_extended_frame else "11-bit"
    if counts.wrong_checksum > counts.accepted:
        report.problem = f"{counts.wrong_checksum} frames of {message.name} with a wrong checksum"
        report.remedy = f"Correct [messages.{message.name}] checksum: kind, signal, data_id"
    elif not track and frames == 0:
        report.problem, report.remedy = "no frame at all", "Check bus, channel and bit rate"
    elif not track:
        report.problem = f"no sample: no frame of {message.name} ({kind} id {message.frame_id:#x})"
        if counts.accepted:
            report.problem = (
                f"no sample, although {message.name} arrives: its multiplexer value is not sent"
            )
        report.remedy = f"Check that the car sends it, and `column` of {slot.name}"
    elif report.unusable > ALLOWED_UNUSABLE_SHARE * len(track):
        low, high = slot.plausible
        report.problem = f"{report.unusable} of {len(track)} samples cannot be used"
        report.remedy = (
            f"The car marks them as missing, or they are outside the range of the DBC or of "
            f"{low:g} to {high:g} {slot.si}: check unit, factor and offset, or write plausible"
        )
    elif report.longest_gap_s is not None and report.longest_gap_s > allowed_s:
        report.problem = f"a gap of {report.longest_gap_s:.3g} s, allowed {allowed_s:.3g} s"
        report.remedy = "Find out why frames are missing, or write longest_gap_s"
    return report


def _contradictions(
    tracks: Mapping[str, Track], not_compared: list[str]
) -> Iterable[tuple[str, str]]:
    """Signals that contradict each other: yaw rate, speed and pose; adds to `not_compared`."""
    speed, yaw_rate = tracks["states.vx_mps"], tracks["states.yaw_rate_radps"]
    if min(len(speed), len(yaw_rate)) < LEAST_SAMPLES:
        not_compared.append(f"speed times yaw rate (fewer than {LEAST_SAMPLES} samples)")
        return
    lateral = sorted(abs(v * r) for v, r in _paired(speed, yaw_rate))
    if lateral[int(0.99 * len(lateral))] > LARGEST_LATERAL_MPS2:
        yield (
            f"speed times yaw rate reaches {lateral[-1]:.3g} m/s^2",
            "Correct the unit of states.vx_mps or states.yaw_rate_radps",
        )
    if "pose.yaw" in tracks:
        moved = _velocities(tracks["pose.x"], tracks["pose.y"])
        for cause, causes, name, track, least in (
            (
                "the slope of pose.yaw",
                _slopes(tracks["pose.yaw"], is_angle=True),
                "states.yaw_rate_radps",
                yaw_rate,
                LEAST_TURN_RADPS,
            ),
            (
                "the speed of the pose",
                [(time_s, abs(velocity)) for time_s, velocity in moved],
                "states.vx_mps",
                speed,
                LEAST_SPEED_MPS,
            ),
        ):
            pairs = [(a, b) for a, b in _paired(causes, track) if max(abs(a), abs(b)) > least]
            if len(pairs) < LEAST_SAMPLES:
                not_compared.append(f"{name} with {cause} (too little motion)")
            else:
                yield from _ratio(cause, name, pairs)
        yield from _heading(tracks["pose.yaw"], moved)


def _ratio(cause: str, name: str, pairs: list[tuple[float, float]]) -> Iterable[tuple[str, str]]:
    """A contradiction if a signal differs from the same quantity by the pose."""
    power = sum(a * a for a, _ in pairs)
    if power == 0.0:
        yield f"{cause} is 0 while {name} is not", f"Correct the columns of [pose] and {name}"
        return
    ratio = sum(a * b for a, b in pairs) / power
    if abs(ratio - 1.0) > RATIO_TOLERANCE:
        mistake = "a wrong sign" if ratio < 0.0 else find_mistake(ratio) or "a wrong factor"
        yield (
            f"{name} is {ratio:.3g} times {cause}, expected 1 ({mistake}?)",
            f"Correct unit, factor or sign of {name} or of [pose]",
        )


def _paired(one: Track, other: Track) -> list[tuple[float, float]]:
    """Each value of `other` with the newest value of `one` at that time."""
    pairs, k = [], 0
    for time_s, value in other:
        while k + 1 < len(one) and one[k + 1][0] <= time_s:
            k += 1
        if one and one[k][0] <= time_s:
            pairs.append((one[k][1], value))
    return pairs


def _slopes(track: Track, reach: int = 4, is_angle: bool = False) -> Track:
    """Derivative over `reach` samples, at the later one."""
    slopes = []
    for (t0, a), (t1, b) in zip(track, track[reach:], strict=False):
        change = b - a
        if is_angle:
            change = (change + pi) % (2.0 * pi) - pi
        if t1 > t0:
            slopes.append((t1, change / (t1 - t0)))
    return slopes


def _velocities(x: Track, y: Track) -> list[tuple[float, complex]]:
    """Velocity of the pose on the map: x is its real part."""
    slopes_y = _slopes(y)
    return [
        (time_s, complex(vx, vy))
        for (time_s, _), (vx, vy) in zip(slopes_y, _paired(_slopes(x), slopes_y), strict=False)
    ]


def _heading(yaw: Track, moved: list[tuple[float, complex]]) -> Iterable[tuple[str, str]]:
    """A contradiction if the car mostly moves in another direction than it points."""
    directions = [
        (time_s, phase(velocity)) for time_s, velocity in moved if abs(velocity) > LEAST_SPEED_MPS
    ]
    away_rad = [
        (direction - heading + pi) % (2.0 * pi) - pi
        for heading, direction in _paired(yaw, directions)
    ]
    if len(away_rad) >= LEAST_SAMPLES and median(map(abs, away_rad)) > LARGEST_SLIP_RAD:
        yield (
            f"the pose moves at {degrees(median(away_rad)):.0f} deg to pose.yaw, expected 0",
            "Correct sign or offset of pose.yaw, which counts counterclockwise from x (a compass: "
            "sign = -1, offset = -90.0), or exchange pose.x and pose.y",
        )
