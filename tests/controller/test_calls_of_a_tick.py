"""What a tick costs, counted and not timed: calls, records and files may not grow unseen."""

import sys
from collections import Counter
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import rt_controller
from rt_controller import simulate
from rt_controller.safety.tick import Tick
from rt_controller.step import ControlStep

FIRST, TICKS = 60, 40
"""counted: in the lane change, with every cyclic message in it"""
ROOT = str(Path(rt_controller.__file__).parent)
MOST_CALLS, MOST_RECORDS, MOST_FILES = 304, 30, 46
"""of a tick on average: calls of functions of this package, tuples with named fields and other
records that are made, and files that are entered; a change that needs more has to say so here"""


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> Counter[tuple[str, str]]:
    """Python calls of the counted ticks, by file and function."""
    run, found, ticks = ControlStep.run, Counter[tuple[str, str]](), iter(range(10**6))

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            found[frame.f_code.co_filename, frame.f_code.co_name] += 1

    def counted(step: ControlStep, *arguments: Any) -> Tick:
        if not FIRST <= next(ticks) < FIRST + TICKS:
            return run(step, *arguments)
        sys.setprofile(note)
        try:
            return run(step, *arguments)
        finally:
            sys.setprofile(None)

    monkeypatch.setattr(ControlStep, "run", counted)
    simulate("double_lane_change", duration_s=(FIRST + TICKS + 5) * 0.025)
    return found


def test_a_tick_makes_no_more_calls_and_records_than_before(counts):
    own = {key: count for key, count in counts.items() if key[0].startswith(ROOT)}
    records = sum(count for (file, _), count in counts.items() if file == "<string>")
    files = {file for file, _ in own}
    found = sum(own.values()) / TICKS, records / TICKS, len(files)
    assert 0.5 * MOST_CALLS < found[0] <= MOST_CALLS, Counter(own).most_common(20)
    assert 0 < found[1] <= MOST_RECORDS, found
    assert 10 < found[2] <= MOST_FILES, sorted(files)
