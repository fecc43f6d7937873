"""`rt-controller signals check`: which mapped signals arrive, and do they contradict each other."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from math import inf, isnan
from statistics import median
from typing import Any

from rt_controller.gateway.samples import longest_gap_s
from rt_controller.mapping.can_log import LoggedFrame, read_samples
from rt_controller.mapping.car_file import CarFile
from rt_controller.mapping.measurement import ALLOWED_UNUSABLE_SHARE
from rt_controller.mapping.relations import (
    COMMANDED,
    ENGAGE,
    HELP,
    NOT_COMPARED,
    Comparison,
    check_relations,
    relations_of,
)
from rt_controller.mapping.signal_frames import SignalReader
from rt_controller.mapping.slots import Slot, command_slots, measured_slots

BIT_RATE = 500_000
"""of the bus whose load is given"""


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
    """no measurements, see `Measurement`"""
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
    bus_load_percent: float
    """see `BusLoad`"""
    slots: list[SlotReport]
    relations: dict[str, Comparison]
    """whether they contradict kinematics, see `check_relations`"""
    dropped: dict[str, int]
    """frames by message that were damaged or repeated"""

    @property
    def is_ok(self) -> bool:
        """True if every signal arrives and no relation is contradicted."""
        is_contradicted = any(each.is_contradicted for each in self.relations.values())
        return all(each.ok for each in self.slots) and not is_contradicted

    def figures(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "ok": self.is_ok,
            "duration_s": self.duration_s,
            "frames": self.frames,
            "bus_load_percent": self.bus_load_percent,
            "bit_rate_per_s": BIT_RATE,
            "signals": [asdict(each) for each in self.slots],
            "contradictions": [
                {"problem": f"{text}: {found.answer}", "remedy": HELP}
                for text, found in self.relations.items()
                if found.is_contradicted
            ],
            "not_compared": [
                f"{text} ({found.answer.removeprefix(NOT_COMPARED)})"
                for text, found in self.relations.items()
                if found.answer.startswith(NOT_COMPARED)
            ],
            "dropped_frames": self.dropped,
        }


def check_signals(
    car: CarFile, frames: Iterable[LoggedFrame], where: str, channel: int | str | None = None
) -> CheckReport:
    """Read the frames of a bus or a log, and check every mapped signal.

    Commands may be missing; a recorded wheel angle is compared with the yaw rate. A log that begins
    before its drive is judged from the first time that `engage` is on.

    Args:
        car: the mapping.
        frames: with their times in s.
        where: the bus or the log, for messages.
        channel: of the log, as in `[can] channel`; None: all.

    Raises:
        ConfigError, DatasetError: a column is not in the DBC, its unit does not fit, or times go
            back.
    """
    mapping, load = car.mapping, BusLoad()
    slots = measured_slots(mapping)
    sources = (*slots, *command_slots(mapping))
    reader = SignalReader(sources, mapping.messages, car.database, str(car.path))
    found = read_samples(load.count(frames), reader, where, channel)
    begin_s = next((each.time_s for each in found.get(ENGAGE, ()) if each.number > 0.5), -inf)
    tracks = {}
    for slot in sources:
        to_si, delay_s = reader.measurements[slot.name].to_si, slot.column.delay_s
        tracks[slot.name] = [
            (time_s - delay_s, to_si(number)) for _, time_s, number in found[slot.name]
        ]
    dropped = {
        name: counts.wrong_length + counts.wrong_checksum + counts.repeated
        for name, counts in reader.counts.items()
    }
    compared = (*(slot.name for slot in slots), COMMANDED)
    usable = {name: [each for each in tracks[name] if not isnan(each[1])] for name in compared}
    return CheckReport(
        load.duration_s,
        load.frames,
        load.percent,
        [
            *(_report(slot, tracks[slot.name], begin_s, reader, load.frames) for slot in slots),
            *_damaged_commands(command_slots(mapping), reader),
        ],
        check_relations(usable, relations_of(mapping.car.car.geometry if mapping.car else None)),
        {name: count for name, count in dropped.items() if count},
    )


def _damaged_commands(slots: Iterable[Slot], reader: SignalReader) -> Iterator[SlotReport]:
    """Commands that were recorded and cannot be read; others may be missing."""
    for slot in slots:
        message = reader.sources[slot.name].message
        counts = reader.counts[message.name]
        if counts.wrong_checksum + counts.wrong_length > counts.accepted:
            problem, remedy = reader.objection(slot.name)
            identifier, column = f"{message.frame_id:#x}", slot.column.column
            report = SlotReport(slot.name, column, message.name, identifier, slot.si, 0, 0, None)
            report.ok, report.problem, report.remedy = False, problem, remedy
            yield report


class BusLoad:
    """Number, time and bits of the frames that pass through `count`."""

    def __init__(self) -> None:
        self.frames = self._bits = 0
        self._first_s = self._last_s = 0.0

    def count(self, frames: Iterable[LoggedFrame]) -> Iterator[LoggedFrame]:
        """The frames as they are."""
        for each in frames:
            frame = each.frame
            self._first_s = self._first_s if self.frames else frame.timestamp
            self._last_s = frame.timestamp
            self.frames += 1
            self._bits += (67 if frame.is_extended_id else 47) + 8 * len(frame.data)
            yield each

    @property
    def duration_s(self) -> float:
        """From the first frame to the last."""
        return self._last_s - self._first_s

    @property
    def percent(self) -> float:
        """Of a classic bus with `BIT_RATE`, without stuff bits."""
        bits = BIT_RATE * self.duration_s
        return 100.0 * self._bits / bits if bits > 0.0 else 0.0


def _report(
    slot: Slot,
    whole: Sequence[tuple[float, float]],
    begin_s: float,
    reader: SignalReader,
    frames: int,
) -> SlotReport:
    source = reader.sources[slot.name]
    message = source.message
    identifier = f"{message.frame_id:#x}"
    cycle_s = 1e-3 * message.cycle_time if message.cycle_time else None
    track = [each for each in whole if each[0] >= begin_s]
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
    problem, remedy = reader.objection(slot.name)
    if problem:
        if frames == 0:
            problem, remedy = "no frame at all", "Check bus, channel and bit rate"
    elif unusable > ALLOWED_UNUSABLE_SHARE * n:
        problem = f"{unusable} of {n} samples cannot be used"
        remedy = reader.measurements[slot.name].explain()
    elif found_s is not None and found_s > allowed_s:
        problem = f"a gap of {found_s:.3g} s, allowed {allowed_s:.3g} s"
        remedy = "Find out why frames are missing, or write longest_gap_s"
    elif cycle_s and report.period_s and not 0.5 < report.period_s / cycle_s < 2.0:
        problem = (
            f"a sample every {1e3 * report.period_s:.3g} ms, the DBC says {1e3 * cycle_s:.3g} ms"
        )
        remedy = "Check the times of the log, and whether two nodes send the message"
    report.ok, report.problem, report.remedy = not problem, problem, remedy
    return report
