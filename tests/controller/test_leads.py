"""What is done before a tick, and when it is left out."""

import pytest

from rt_controller.loop import Leads, _prepare
from rt_controller.session import REHEARSALS_NS, _leads

MS = 1_000_000


class ScriptedClock:
    """Counts down to a tick; actions take the time they are given."""

    def __init__(self, left_ns: int) -> None:
        self.left_ns = left_ns

    def approach(self, lead_ns: int) -> bool:
        if self.left_ns < lead_ns:
            return False
        self.left_ns = lead_ns
        return True


class ScriptedStep:
    """Takes so long, by its own clock and by the scripted one."""

    def __init__(self, clock: ScriptedClock, prepare_ns: int, rehearse_ns: int) -> None:
        self.done: list[tuple[str, int]] = []
        self._clock = clock
        self._durations = {"prepare": prepare_ns, "rehearse": rehearse_ns}

    def prepare(self) -> None:
        self._act("prepare")

    def rehearse(self) -> None:
        self._act("rehearse")

    def _act(self, what: str) -> None:
        self.done.append((what, self._clock.left_ns))
        self._clock.left_ns -= self._durations[what]


def done(left_ns: int, prepare_ns: int, rehearse_ns: int, leads: Leads) -> list[tuple[str, int]]:
    clock = ScriptedClock(left_ns)
    step = ScriptedStep(clock, prepare_ns, rehearse_ns)
    _prepare(step, clock, leads)  # type: ignore[arg-type]
    return step.done


LEADS = Leads(4 * MS, (2 * MS, MS))


def test_everything_has_its_instant() -> None:
    found = done(20 * MS, MS, MS // 2, LEADS)
    assert found == [("prepare", 4 * MS), ("rehearse", 2 * MS), ("rehearse", MS)]


def test_what_comes_too_late_is_left_out() -> None:
    assert done(20 * MS, 3 * MS, MS // 2, LEADS) == [("prepare", 4 * MS), ("rehearse", MS)]
    assert done(20 * MS, 5 * MS, MS // 2, LEADS) == [("prepare", 4 * MS)]
    assert done(3 * MS, MS, MS // 2, LEADS) == [("rehearse", 2 * MS), ("rehearse", MS)]
    assert done(MS // 2, MS, MS // 2, LEADS) == []


@pytest.mark.parametrize(("prepare_ms", "rehearsals"), [(4.0, 3), (2.0, 2), (1.0, 1), (0.5, 0)])
def test_rehearsals_come_after_the_preparation(prepare_ms: float, rehearsals: int) -> None:
    leads = _leads(prepare_ms, is_lockstep=False)
    assert leads is not None
    assert leads.prepare_ns == round(prepare_ms * MS)
    assert leads.rehearsals_ns == REHEARSALS_NS[len(REHEARSALS_NS) - rehearsals :]
    assert all(lead_ns < leads.prepare_ns for lead_ns in leads.rehearsals_ns)


def test_without_preparation_there_is_no_rehearsal_and_lockstep_has_one() -> None:
    assert _leads(0.0, is_lockstep=False) is None
    assert _leads(0.0, is_lockstep=True) is None
    leads = _leads(4.0, is_lockstep=True)
    assert leads is not None
    assert len(leads.rehearsals_ns) == 1
