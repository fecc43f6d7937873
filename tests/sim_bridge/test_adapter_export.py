"""The own car exported as an FMU and loaded as a plant is the same car."""

from importlib import resources
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")
pytest.importorskip("pythonfmu", reason="the extra [fmu] is not installed")

from made_fmus import wrap_as_fmi3
from wandering_inputs import wandering_inputs

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput
from rt_controller.settings import CarSettings
from sim_bridge.adapters.export import build_fmu, mapping_text
from sim_bridge.adapters.fmu_mapping import load_mapping
from sim_bridge.adapters.plants import open_plant
from sim_bridge.car import Car

CURVATURE_PER_M = 0.002


def worst_difference(one: Car, other: Car) -> float:
    """The largest relative difference of states and outputs in 5 s of driving."""
    worst = 0.0
    for control in wandering_inputs(200):
        pairs = zip(
            (*one.advance(control, CURVATURE_PER_M), *one.plant.outputs()),
            (*other.advance(control, CURVATURE_PER_M), *other.plant.outputs()),
            strict=True,
        )
        worst = max(worst, *(abs(a - b) / max(1.0, abs(a)) for a, b in pairs))
    return worst


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    fmu = tmp_path_factory.mktemp("export") / "car.fmu"
    build_fmu(fmu)
    return fmu


@pytest.fixture
def front_driven(tmp_path: Path) -> Path:
    """A car file outside the package."""
    source = resources.files("sim_bridge") / "cars" / "c_class_125kw_fwd.toml"
    file = tmp_path / "mine.toml"
    file.write_text(source.read_text("utf-8"))
    return file


def test_an_exported_car_drives_the_same_run(exported: Path) -> None:
    """Friction and initial speed are set by the mapping file written beside it."""
    own = Car(open_plant(CarSettings(), 0.6), 22.0)
    fmu = Car(open_plant(CarSettings(plant=f"fmu:{exported}"), 0.6), 22.0)
    assert fmu.state == own.state
    assert worst_difference(own, fmu) <= 1e-9
    fmu.plant.close()


def test_an_exported_car_drives_the_same_run_inside_an_fmi_3_container(
    exported: Path, tmp_path: Path
) -> None:
    container = wrap_as_fmi3(exported, tmp_path / "container.fmu", 0.001)
    container.with_suffix(".toml").write_text(mapping_text())
    own = Car(open_plant(CarSettings(), 0.85), 27.0)
    fmu = Car(open_plant(CarSettings(plant=f"fmu:{container}"), 0.85), 27.0)
    assert worst_difference(own, fmu) <= 1e-9
    fmu.plant.close()


def test_an_exported_car_fails_with_a_step_below_its_own(exported: Path, tmp_path: Path) -> None:
    mapping = tmp_path / "coarse.toml"
    mapping.write_text(mapping_text().replace("0.001", "0.0005"))
    plant = open_plant(CarSettings(plant=f"fmu:{exported}", plant_mapping=mapping), 0.85)
    car = Car(plant, 20.0)
    car.advance(ControlInput(0.0, 0.0, 0.0), 0.0)
    assert not car.is_sound
    assert "whole number" in (plant.failure or "")
    car.plant.close()


def test_the_written_mapping_file_can_be_loaded(tmp_path: Path) -> None:
    file = tmp_path / "car.toml"
    file.write_text(mapping_text())
    assert load_mapping(file).communication_step_s == 0.001


def test_a_car_file_is_contained_in_the_fmu(front_driven: Path, tmp_path: Path) -> None:
    fmu = tmp_path / "car.fmu"
    build_fmu(fmu, str(front_driven))
    name = str(front_driven)
    own = Car(open_plant(CarSettings(car=name), 0.85), 22.0)
    loaded = Car(open_plant(CarSettings(plant=f"fmu:{fmu}"), 0.85), 22.0)
    front_driven.unlink()
    assert worst_difference(own, loaded) <= 1e-9
    loaded.plant.close()


def test_a_car_file_is_not_overwritten_by_a_mapping(front_driven: Path) -> None:
    before = front_driven.read_text()
    with pytest.raises(ConfigError, match="found the car file there"):
        build_fmu(front_driven.with_suffix(".fmu"), str(front_driven))
    assert front_driven.read_text() == before


def test_an_unknown_car_is_not_exported(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="car 'lorry'"):
        build_fmu(tmp_path / "car.fmu", "lorry")
    assert not (tmp_path / "car.fmu").exists()


def test_a_file_name_without_fmu_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"ends in \.fmu"):
        build_fmu(tmp_path / "car.zip")


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="can be written"):
        build_fmu(tmp_path / "missing" / "car.fmu")
