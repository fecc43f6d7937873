"""MDF: every group has a clock of its own, every channel a unit."""

import numpy as np
import pytest
from asammdf import MDF, Signal

from offline.logs.mf4_log import read_mf4
from offline.logs.series import to_drive
from rt_controller.contract.errors import DatasetError


def signal(name, period_s, unit="", count=50):
    t = period_s * np.arange(count)
    return Signal(samples=np.sin(t), timestamps=t, name=name, unit=unit)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "a.mf4"
    with MDF() as mdf:
        mdf.append([signal("Speed", 0.01, "km/h"), signal("Same", 0.01, "m")])
        mdf.append([signal("Steer", 0.02, "deg"), signal("Same", 0.02, "m")])
        mdf.save(path)
    return path


def test_each_channel_has_the_time_of_its_group_and_its_unit(path):
    log = read_mf4(path, ("Speed", "Steer"))
    assert log.channel("Speed").unit == "km/h"
    assert log.channel("Speed").t_s[1] == pytest.approx(0.01)
    assert log.channel("Steer").t_s[1] == pytest.approx(0.02)


def test_a_name_of_two_groups_is_told_apart_by_the_number(path):
    with pytest.raises(DatasetError, match="Same@0, Same@1"):
        read_mf4(path, ("Same",))
    assert read_mf4(path, ("Same@1",)).channel("Same@1").t_s[1] == pytest.approx(0.02)


def test_a_unit_that_is_not_the_mappings_is_refused(path, parse):
    mapping = parse(
        '[states]\nvx_mps = { column = "Speed", unit = "m/s" }\n'
        '[inputs]\nsteer_rad = { column = "Steer" }\n'
    )
    with pytest.raises(DatasetError, match=r"a\.mf4, column Speed: .* m/s.* says km/h"):
        to_drive(read_mf4(path, mapping.columns), mapping)


def test_the_files_unit_is_taken_where_the_mapping_has_none(path, parse):
    mapping = parse(
        '[states]\nvx_mps = { column = "Speed" }\n[inputs]\nsteer_rad = { column = "Steer" }\n'
    )
    drive = to_drive(read_mf4(path, mapping.columns), mapping)
    assert drive.series("vx_mps").values[10] == pytest.approx(np.sin(0.1) / 3.6)
    assert drive.series("steer_rad").values[10] == pytest.approx(np.radians(np.sin(0.2)))


def test_a_missing_channel_is_answered_with_near_ones(path):
    with pytest.raises(DatasetError, match="Did you mean Steer"):
        read_mf4(path, ("Steering",))


@pytest.mark.parametrize("keep", [0, 40, 300, 1500])
def test_a_truncated_file_is_refused(path, keep):
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(DatasetError, match=r"a\.mf4"):
        read_mf4(path, ("Speed",))
