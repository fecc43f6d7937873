"""Real-time settings are requested, reported as granted, and undone."""

import gc
import os
import sys
import threading
from contextlib import ExitStack

import pytest

from rt_controller.realtime import scheduling
from rt_controller.realtime.scheduling import (
    NO_GUARANTEES,
    Guarantees,
    real_time_process,
    set_thread_priority,
)


def in_a_thread(work: object) -> object:
    results: list[object] = []
    thread = threading.Thread(target=lambda: results.append(work()))
    thread.start()
    thread.join()
    return results[0]


@pytest.mark.parametrize("was_collecting", [True, False])
def test_collector_and_switch_interval_are_those_that_were_found_when_the_context_ends(
    was_collecting,
):
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(0.02)
    if not was_collecting:
        gc.disable()
    try:
        with real_time_process(priority=0, lock_memory=False) as process:
            assert process.collector_off
            assert not gc.isenabled()
            assert in_a_thread(gc.isenabled) is False
            assert sys.getswitchinterval() == pytest.approx(scheduling.SWITCH_INTERVAL_S)
        assert gc.isenabled() is was_collecting
        assert sys.getswitchinterval() == pytest.approx(0.02)
    finally:
        gc.enable()
        sys.setswitchinterval(interval_s)


def test_the_last_of_several_contexts_restores_the_collector():
    with ExitStack() as second:
        with real_time_process(priority=0, lock_memory=False):
            second.enter_context(real_time_process(priority=0, lock_memory=False))
        assert not gc.isenabled()
    assert gc.isenabled()


def test_the_end_of_the_context_gives_a_priority_back_that_was_found(monkeypatch):
    present = (os.SCHED_FIFO, os.sched_param(30))

    def change(_, policy, parameter):
        nonlocal present
        present = (policy, parameter)

    monkeypatch.setattr(scheduling.os, "sched_getscheduler", lambda _: present[0])
    monkeypatch.setattr(scheduling.os, "sched_getparam", lambda _: present[1])
    monkeypatch.setattr(scheduling.os, "sched_setscheduler", change)
    with real_time_process(priority=50, lock_memory=False):
        assert present == (os.SCHED_FIFO, os.sched_param(1))
    assert present == (os.SCHED_FIFO, os.sched_param(30))


def test_other_threads_inherit_the_lowest_real_time_priority():
    with real_time_process(priority=50):
        if os.sched_getscheduler(0) != os.SCHED_FIFO:
            pytest.skip("this system grants no real-time scheduling")
        assert os.sched_getparam(0).sched_priority == 1
        assert in_a_thread(lambda: os.sched_getparam(0).sched_priority) == 1
        assert in_a_thread(lambda: set_thread_priority(50)) == Guarantees(fifo_priority=50)
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_a_refused_priority_is_not_reported(monkeypatch):
    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr(scheduling.os, "sched_setscheduler", refuse)
    monkeypatch.setattr(scheduling.os, "sched_setaffinity", refuse)
    assert in_a_thread(lambda: set_thread_priority(50, cpu=0)) == NO_GUARANTEES


@pytest.mark.parametrize("cpu", [10**6, 10**30])
def test_a_core_that_does_not_exist_is_not_reported(cpu):
    assert in_a_thread(lambda: set_thread_priority(0, cpu)) == NO_GUARANTEES


def test_the_sentence_names_all_guarantees():
    assert NO_GUARANTEES.sentence() == (
        "SCHED_OTHER, memory NOT locked, garbage collector ON, any core"
    )
    all_hold = Guarantees(True, True, 50, 1)
    assert all_hold.sentence() == "SCHED_FIFO 50, memory locked, garbage collector off, core 1"
