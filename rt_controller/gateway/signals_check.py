"""`rt-controller signals check`: which mapped signals arrive, and do they contradict each other."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from itertools import pairwise
from math import isnan
from statistics import median
from typing import Any

import can

from rt_controller.gateway.samples import longest_gap_s
from rt_controller.gateway.signal_relations import COMMANDED, NOT_COMPARED, Track, check_relations
from rt_controller.mapping.car_file import CarFile
from rt_controller.mapping.signal_frames import SignalReader
from rt_controller.mapping.slots import Slot, command_slots, measured_slots

ALLOWED_UNUSABLE_SHARE = 0.01
"""share of samples that may be marked as missing by the car, or be implausible"""
HELP = (
    "A wrong column, unit, factor or sign of one signal contradicts in every relation that it is "
    "part of (of the wheel also a wrong geometry in [car]): correct the signal that all of them "
    "share first"
)


@dataclass(slots=True)
class SlotReport:
    """What arrived of one slot; the fields are those of `--json`."""

    signal: str
    column: str
    message: str
    identifier: str
    unit: str
    """SI"""
    samples: int
    unusable: int
    """marked as missing by the car, out of the range of the DBC, or not plausible"""
    expected_period_s: float | None
    """of the DBC"""
    period_s: float | None = None
    longest_gap_s: float | None = None
    lowest: float | None = None
    highest: float | None = None
    ok: bool = True
    problem: str = ""
    remedy: str = ""


@dataclass(slots=True)
class CheckReport:
    """What `check_signals` found."""

    duration_s: float
    frames: int
    slots: list[SlotReport]
    relations: dict[str, str]
    """whether they contradict kinematics, see `check_relations`"""
    dropped: dict[str, int]
    """frames by message that were damaged or repeated"""

    @property
    def is_ok(self) -> bool:
        """True if every signal arrives and no relation is contradicted."""
        return all(each.ok for each in self.slots) and "yes" not in self.relations.values()

    def figures(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "ok": self.is_ok,
            "duration_s": self.duration_s,
            "frames": self.frames,
            "signals": [asdict(each) for each in self.slots],
            "contradictions": [
                {"problem": text, "remedy": HELP}
                for text, answer in self.relations.items()
                if answer == "yes"
            ],
            "not_compared": [
                f"{text} ({answer.removeprefix(NOT_COMPARED)})"
                for text, answer in self.relations.items()
                if answer.startswith(NOT_COMPARED)
            ],
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
    dropped = {
        name: counts.wrong_length + counts.wrong_checksum + counts.repeated
        for name, counts in reader.counts.items()
    }
    usable = {
        name: [each for each in track if not isnan(each[1])] for name, track in tracks.items()
    }
    return CheckReport(
        times[-1] - times[0] if times else 0.0,
        len(times),
        [_report(slot, tracks[slot.name], reader, len(times)) for slot in slots],
        check_relations(usable, mapping.car.car.geometry if mapping.car else None),
        {name: count for name, count in dropped.items() if count},
    )


def _report(slot: Slot, track: Track, reader: SignalReader, frames: int) -> SlotReport:
    source = reader.sources[slot.name]
    message, counts = source.message, reader.counts[source.message.name]
    identifier = f"{message.frame_id:#x}"
    cycle_s = 1e-3 * message.cycle_time if message.cycle_time else None
    values = [value for _, value in track if not isnan(value)]
    n, unusable = len(track), len(track) - len(values)
    column = slot.column.column
    report = SlotReport(slot.name, column, message.name, identifier, slot.si, n, unusable, cycle_s)
    if values:
        report.lowest, report.highest = min(values), max(values)
    steps = [later[0] - earlier[0] for earlier, later in pairwise(track)]
    if steps:
        report.period_s, report.longest_gap_s = median(steps), max(steps)
    allowed_s, found_s = longest_gap_s(slot, source), report.longest_gap_s
    kind = "29-bit" if message.is_extended_frame else "11-bit"
    problem = remedy = ""
    if counts.wrong_checksum > counts.accepted:
        problem = f"{counts.wrong_checksum} frames of {message.name} with a wrong checksum"
        remedy = f"Correct [messages.{message.name}] checksum: kind, signal, data_id"
    elif not track and frames == 0:
        problem, remedy = "no frame at all", "Check bus, channel and bit rate"
    elif not track:
        problem = f"no sample: no frame of {message.name} ({kind} id {identifier})"
        if counts.accepted:
            problem = (
                f"no sample, although {message.name} arrives: its multiplexer value is not sent"
            )
        remedy = f"Check that the car sends it, and `column` of {slot.name}"
    elif unusable > ALLOWED_UNUSABLE_SHARE * n:
        low, high = slot.plausible
        problem = f"{unusable} of {n} samples cannot be used"
        remedy = (
            f"The car marks them as missing, or they are outside the range of the DBC or of "
            f"{low:g} to {high:g} {slot.si}: check unit, factor and offset, or write plausible"
        )
    elif found_s is not None and found_s > allowed_s:
        problem = f"a gap of {found_s:.3g} s, allowed {allowed_s:.3g} s"
        remedy = "Find out why frames are missing, or write longest_gap_s"
    report.ok, report.problem, report.remedy = not problem, problem, remedy
    return report
