"""Channels of MDF files are read with the time of their group and their unit."""

import numpy as np
import pytest
from asammdf import MDF, Signal
from made_logs import series_of

from offline.logs.readers.mf4_log import read_mf4
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
    log = read_mf4(
        path,
        (
            ("Speed",),
            ("Steer",),
        ),
    )
    assert log.channel("Speed").unit == "km/h"
    assert log.channel("Speed").t_s[1] == pytest.approx(0.01)
    assert log.channel("Steer").t_s[1] == pytest.approx(0.02)


def test_a_name_of_two_groups_needs_the_number_of_the_group(path):
    with pytest.raises(DatasetError, match="Same@0, Same@1"):
        read_mf4(path, (("Same",),))
    assert read_mf4(path, (("Same@1",),)).channel("Same@1").t_s[1] == pytest.approx(0.02)


def test_a_unit_that_differs_from_the_mapping_is_refused(path, parse):
    mapping = parse(
        '[states]\nvx_mps = { column = "Speed", unit = "m/s" }\n'
        '[inputs]\nsteer_rad = { column = "Steer" }\n'
    )
    with pytest.raises(DatasetError, match=r"a\.mf4, column Speed: .* m/s.* in km/h, as the file"):
        to_drive(read_mf4(path, [each.names for each in mapping.every_column]), mapping)


def test_the_unit_of_the_file_is_used_if_the_mapping_has_none(path, parse):
    mapping = parse(
        '[states]\nvx_mps = { column = "Speed" }\n[inputs]\nsteer_rad = { column = "Steer" }\n'
    )
    drive = to_drive(read_mf4(path, [each.names for each in mapping.every_column]), mapping)
    assert series_of(drive, "vx_mps").values[10] == pytest.approx(np.sin(0.1) / 3.6)
    assert series_of(drive, "steer_rad").values[10] == pytest.approx(np.radians(np.sin(0.2)))


def test_a_missing_channel_is_refused_with_similar_ones(path):
    with pytest.raises(DatasetError, match="Did you mean Steer"):
        read_mf4(path, (("Steering",),))


@pytest.mark.parametrize("keep", [0, 40, 300, 1500])
def test_a_truncated_file_is_refused(path, keep):
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(DatasetError, match=r"a\.mf4"):
        read_mf4(path, (("Speed",),))
