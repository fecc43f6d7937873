"""The CSV file with the times of the last ticks."""

import csv

import pytest

from rt_controller.contract.errors import RtControllerError
from rt_controller.realtime.timing import DeadlineAccount, TickTimes
from rt_controller.terminal.tick_file import write_ticks


def account(ticks: int) -> DeadlineAccount:
    found = DeadlineAccount(5, 10_000_000)
    for tick in range(ticks):
        found.record(TickTimes(*(100.0 * tick + k for k in range(len(TickTimes._fields)))), 0, 0)
    return found


@pytest.mark.parametrize(("ticks", "first"), [(3, 0), (12, 7)])
def test_the_file_has_one_row_for_each_of_the_last_ticks_oldest_first(tmp_path, ticks, first):
    write_ticks(tmp_path / "ticks.csv", account(ticks))
    with (tmp_path / "ticks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["tick"]) for row in rows] == list(range(first, ticks))
    assert list(rows[0]) == ["tick", *TickTimes._fields]
    for row in rows:
        assert float(row["wake_us"]) == 100.0 * int(row["tick"])
        assert float(row["qp_iterations"]) == 100.0 * int(row["tick"]) + len(TickTimes._fields) - 1


def test_without_a_file_nothing_is_written(tmp_path):
    write_ticks(None, account(3))
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_no_longer_exists_is_an_error(tmp_path):
    with pytest.raises(RtControllerError, match="--ticks"):
        write_ticks(tmp_path / "gone" / "ticks.csv", account(3))
