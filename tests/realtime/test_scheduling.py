"""Real-time settings are requested, reported as granted, and undone."""

import gc
import os
import sys
import threading
from collections.abc import Iterator

import pytest

from rt_controller.realtime import scheduling
from rt_controller.realtime.scheduling import (
    NO_GUARANTEES,
    Guarantees,
    ProcessSettings,
    ThreadPriority,
    prepare_process,
    release_process,
    set_thread_priority,
)


@pytest.fixture
def prepared() -> Iterator[ProcessSettings]:
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


def test_the_garbage_collector_is_off_until_the_process_is_released() -> None:
    process = prepare_process(priority=0)
    assert process.collector_off
    assert not gc.isenabled()
    release_process()
    assert gc.isenabled()


def test_the_settings_of_the_process_outlive_a_thread(prepared: ProcessSettings) -> None:
    in_a_thread(lambda: set_thread_priority(40))
    assert not gc.isenabled()
    assert in_a_thread(gc.isenabled) is False


def test_other_threads_inherit_the_lowest_real_time_priority(
    prepared: ProcessSettings,
) -> None:
    if os.sched_getscheduler(0) != os.SCHED_FIFO:
        pytest.skip("this system grants no real-time scheduling")
    assert os.sched_getparam(0).sched_priority == 1
    assert in_a_thread(lambda: os.sched_getparam(0).sched_priority) == 1
    assert in_a_thread(lambda: set_thread_priority(50)) == ThreadPriority(50, None)
    release_process()
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_a_refused_priority_is_not_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(scheduling.os, "sched_setscheduler", refuse)
    monkeypatch.setattr(scheduling.os, "sched_setaffinity", refuse)
    assert in_a_thread(lambda: set_thread_priority(50, cpu=0)) == ThreadPriority(0, None)


@pytest.mark.parametrize("cpu", [10**6, 10**30])
def test_a_core_that_does_not_exist_is_not_reported(cpu: int) -> None:
    assert in_a_thread(lambda: set_thread_priority(0, cpu)) == ThreadPriority(0, None)


def test_the_sentence_names_all_guarantees() -> None:
    assert NO_GUARANTEES.sentence() == ("SCHED_OTHER, memory NOT locked, collector ON, any core")
    all_hold = Guarantees(ProcessSettings(True, True), ThreadPriority(50, 1))
    assert all_hold.sentence() == "SCHED_FIFO 50, memory locked, collector off, core 1"
