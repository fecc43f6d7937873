"""`--faults FILE`: its faults reach the bridge, of the own car and of another plant."""

from contextlib import closing
from pathlib import Path

import pytest

from rt_controller.contract.errors import ConfigError
from rt_controller.settings import BusSettings, CarSettings
from rt_controller.virtual_car import open_virtual_car

BUS = BusSettings(bus="virtual", channel="file-of-faults")


def test_the_faults_of_a_file_are_added_to_the_scenario(tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text('[[faults]]\nkind = "bus_off"\nstart_s = 1.0\n')
    settings = CarSettings(scenario="straight", faults=path)
    with closing(open_virtual_car(BUS, settings)) as car:
        assert [each.kind for each in car.bridge.scenario.faults] == ["bus_off"]


def test_a_file_that_is_missing_is_refused(tmp_path: Path) -> None:
    settings = CarSettings(scenario="straight", faults=tmp_path / "none.toml")
    with pytest.raises(ConfigError, match=r"none\.toml: expected a TOML file"):
        open_virtual_car(BUS, settings)
