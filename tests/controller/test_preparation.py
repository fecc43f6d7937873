"""Which parts of the preparation are done before a tick, and when they are left out."""

import pytest

from rt_controller.loop import WARM_UP_LEADS_NS, Schedule, prepare_tick, schedule_preparation
from rt_controller.realtime import timing
from rt_controller.realtime.timing import DeadlineAccount, TickTimer

MS = 1_000_000


class ScriptedClock:
    """Counts down to a tick; actions take the time they are given."""

    def __init__(self, left_ns: int) -> None:
        self.left_ns = left_ns

    def sleep_until_before_tick(self, lead_ns: int) -> bool:
        if self.left_ns < lead_ns:
            return False
        self.left_ns = lead_ns
        return True


class ScriptedStep:
    """Each part takes a given time, on the scripted clock."""

    def __init__(self, clock: ScriptedClock, update_ns: int, warm_up_ns: int) -> None:
        self.done: list[tuple[str, int]] = []
        self._clock = clock
        self._update_ns, self._warm_up_ns = update_ns, warm_up_ns

    def update_matrices(self) -> None:
        self._act("update_matrices", self._update_ns)

    def read_ahead(self) -> None:
        self._act("read_ahead", 0)

    def warm_up(self) -> None:
        self._act("warm_up", self._warm_up_ns)

    def _act(self, part: str, takes_ns: int) -> None:
        self.done.append((part, self._clock.left_ns))
        self._clock.left_ns -= takes_ns


SCHEDULE = Schedule(4 * MS, (2 * MS, MS))
UPDATE = ("update_matrices", 4 * MS)
FIRST_WARM_UP = [("read_ahead", 2 * MS), ("warm_up", 2 * MS)]
SECOND_WARM_UP = [("read_ahead", MS), ("warm_up", MS)]


@pytest.mark.parametrize(
    ("left_ns", "update_ns", "warm_up_ns", "expected"),
    [
        pytest.param(
            *(20 * MS, MS, MS // 2, [UPDATE, *FIRST_WARM_UP, *SECOND_WARM_UP]), id="all in time"
        ),
        pytest.param(20 * MS, 3 * MS, MS // 2, [UPDATE, *SECOND_WARM_UP], id="long update"),
        pytest.param(20 * MS, 5 * MS, MS // 2, [UPDATE], id="update ends after the tick"),
        pytest.param(20 * MS, MS, 3 * MS // 2, [UPDATE, *FIRST_WARM_UP], id="long warm-up"),
        pytest.param(
            *(3 * MS, MS, MS // 2, [*FIRST_WARM_UP, *SECOND_WARM_UP]), id="too late to update"
        ),
        pytest.param(MS // 2, MS, MS // 2, [], id="too late for all"),
    ],
)
def test_each_part_is_done_at_its_time_or_left_out(
    monkeypatch: pytest.MonkeyPatch,
    left_ns: int,
    update_ns: int,
    warm_up_ns: int,
    expected: list[tuple[str, int]],
) -> None:
    clock = ScriptedClock(left_ns)
    monkeypatch.setattr(timing.time, "perf_counter_ns", lambda: -clock.left_ns)
    step = ScriptedStep(clock, update_ns, warm_up_ns)
    timer = TickTimer(clock, DeadlineAccount(1, 0))  # type: ignore[arg-type]
    prepare_tick(step, clock, SCHEDULE, timer)  # type: ignore[arg-type]
    assert step.done == expected


@pytest.mark.parametrize(("prepare_ms", "warm_ups"), [(4.0, 3), (2.0, 2), (1.0, 1), (0.5, 0)])
def test_warm_ups_are_scheduled_after_the_update_of_the_matrices(
    prepare_ms: float, warm_ups: int
) -> None:
    schedule = schedule_preparation(prepare_ms, is_lockstep=False)
    assert schedule is not None
    assert schedule.update_matrices_ns == round(prepare_ms * MS)
    assert schedule.warm_ups_ns == WARM_UP_LEADS_NS[len(WARM_UP_LEADS_NS) - warm_ups :]
    in_lockstep = schedule_preparation(prepare_ms, is_lockstep=True)
    assert in_lockstep is not None
    assert len(in_lockstep.warm_ups_ns) == 1
    assert schedule_preparation(0.0, is_lockstep=False) is None
