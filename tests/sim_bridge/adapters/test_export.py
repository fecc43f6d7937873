"""The own car exported as an FMU and loaded as a plant is the same car."""

from importlib import resources
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

from c_compiler import needs_c_compiler
from wandering_inputs import wandering_inputs

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput
from rt_controller.settings import CarSettings
from sim_bridge.adapters.plants import open_plant
from sim_bridge.car import Car
from sim_bridge.fmu_export.archive import build_fmu, mapping_text
from sim_bridge.plant.protocol import Plant, RoadAt

pytestmark = needs_c_compiler


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


def require_same_drive(own: Plant, fmu: Plant) -> None:
    """5 s of driving with a road that changes on the way."""
    cars = Car(own, 22.0), Car(fmu, 22.0)
    assert cars[0].state == cars[1].state
    for k, control in enumerate(wandering_inputs(200)):
        if k == 100:
            for plant in (own, fmu):
                plant.set_road(RoadAt(0.0, 0.0, 0.3, 0.9, 0.02, 0.03, 1.0, 2.0))
        found = [(*car.advance(control, 0.002), *car.plant.outputs()) for car in cars]
        np.testing.assert_array_equal(found[1], found[0])
    fmu.close()


@pytest.mark.parametrize("friction_right", [None, 0.3])
def test_an_exported_car_drives_the_same_run(exported: Path, friction_right: float | None) -> None:
    """Friction, initial speed and road are set by the mapping file written beside it."""
    own = open_plant(CarSettings(friction_right=friction_right), 0.6)
    settings = CarSettings(plant=f"fmu:{exported}", friction_right=friction_right)
    fmu = open_plant(settings, 0.6)
    assert fmu.road_inputs == own.road_inputs
    require_same_drive(own, fmu)


def test_a_car_file_is_contained_in_the_fmu(front_driven: Path, tmp_path: Path) -> None:
    fmu = tmp_path / "car.fmu"
    build_fmu(fmu, str(front_driven))
    own = open_plant(CarSettings(car=str(front_driven)), 0.85)
    front_driven.unlink()
    require_same_drive(own, open_plant(CarSettings(plant=f"fmu:{fmu}"), 0.85))


def test_a_reset_forgets_the_road_that_was_set_before_it(exported: Path) -> None:
    fmu = open_plant(CarSettings(plant=f"fmu:{exported}"), 0.85)
    motions = []
    for _ in range(2):
        fmu.reset(20.0)
        motions.append(fmu.step(ControlInput(0.0, 120.0, 0.0), 0.025).copy())
        fmu.set_road(RoadAt(0.0, 0.0, 0.1, 0.1, 0.02, 0.3, 1.0, 2.0))
    np.testing.assert_array_equal(motions[1], motions[0])
    fmu.close()


def test_an_exported_car_takes_steps_that_are_no_part_of_the_period(
    exported: Path, tmp_path: Path
) -> None:
    """With steps of 10 ms against periods of 25 ms its motion stays that of the own car."""
    mapping = tmp_path / "coarse.toml"
    mapping.write_text(mapping_text().replace("= 0.001", "= 0.01"))
    settings = CarSettings(plant=f"fmu:{exported}", plant_mapping=mapping)
    own, fmu = Car(open_plant(CarSettings(), 0.85), 20.0), Car(open_plant(settings, 0.85), 20.0)
    for _ in range(100):
        states = [car.advance(ControlInput(0.2, 0.0, 0.3), 0.0) for car in (own, fmu)]
    np.testing.assert_allclose(states[1], states[0], rtol=1e-4, atol=1e-4)
    fmu.plant.close()


def test_a_car_file_is_not_overwritten_by_a_mapping(front_driven: Path) -> None:
    before = front_driven.read_text()
    with pytest.raises(ConfigError, match="found the car file there"):
        build_fmu(front_driven.with_suffix(".fmu"), str(front_driven))
    assert front_driven.read_text() == before


@pytest.mark.parametrize(
    ("file", "car", "words"),
    [
        ("car.fmu", "lorry", "car 'lorry'"),
        ("car.zip", "c_class_150kw_awd", r"ends in \.fmu"),
        ("missing/car.fmu", "c_class_150kw_awd", "can be written"),
    ],
)
def test_a_file_that_cannot_be_made_is_refused(
    tmp_path: Path, file: str, car: str, words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        build_fmu(tmp_path / file, car)
    assert not (tmp_path / file).exists()
