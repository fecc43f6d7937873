"""What the system grants is asked for, said truthfully, and given back."""

import gc
import os
import sys
import threading
from collections.abc import Iterator

import pytest

from rt_controller.realtime import scheduling
from rt_controller.realtime.scheduling import (
    NOTHING_HOLDS,
    Guarantees,
    ProcessConduct,
    ThreadRank,
    prepare_process,
    rank_thread,
    release_process,
)


@pytest.fixture
def prepared() -> Iterator[ProcessConduct]:
    interval_s = sys.getswitchinterval()
    yield prepare_process(priority=50)
    release_process()
    sys.setswitchinterval(interval_s)


def in_a_thread(work: object) -> object:
    results: list[object] = []
    thread = threading.Thread(target=lambda: results.append(work()))
    thread.start()
    thread.join()
    return results[0]


def test_the_collector_is_off_for_the_run_and_on_again_after_it() -> None:
    conduct = prepare_process(priority=0)
    assert conduct.collector_off
    assert not gc.isenabled()
    release_process()
    assert gc.isenabled()


def test_a_thread_that_ends_takes_nothing_from_the_process(prepared: ProcessConduct) -> None:
    in_a_thread(lambda: rank_thread(40))
    assert not gc.isenabled()
    assert in_a_thread(gc.isenabled) is False


def test_threads_beside_the_loop_inherit_the_lowest_real_time_rank(
    prepared: ProcessConduct,
) -> None:
    if os.sched_getscheduler(0) != os.SCHED_FIFO:
        pytest.skip("this system grants no real-time scheduling")
    assert os.sched_getparam(0).sched_priority == 1
    assert in_a_thread(lambda: os.sched_getparam(0).sched_priority) == 1
    assert in_a_thread(lambda: rank_thread(50)) == ThreadRank(50, None)
    release_process()
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_a_rank_that_is_not_granted_is_not_claimed(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(scheduling.os, "sched_setscheduler", refuse)
    monkeypatch.setattr(scheduling.os, "sched_setaffinity", refuse)
    assert in_a_thread(lambda: rank_thread(50, cpu=0)) == ThreadRank(0, None)


@pytest.mark.parametrize("cpu", [10**6, 10**30])
def test_a_core_that_does_not_exist_is_not_claimed(cpu: int) -> None:
    assert in_a_thread(lambda: rank_thread(0, cpu)) == ThreadRank(0, None)


def test_the_line_says_which_of_them_hold() -> None:
    assert NOTHING_HOLDS.sentence() == ("SCHED_OTHER, memory NOT locked, collector ON, any core")
    all_hold = Guarantees(ProcessConduct(True, True), ThreadRank(50, 1))
    assert all_hold.sentence() == "SCHED_FIFO 50, memory locked, collector off, core 1"
