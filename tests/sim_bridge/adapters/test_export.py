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
from sim_bridge.fmu_export.archive import build_fmu
from sim_bridge.plant.protocol import RoadAt

pytestmark = needs_c_compiler

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


def test_a_road_that_changes_on_the_way_acts_on_the_exported_car(exported: Path) -> None:
    """Friction, bank, grade and wind reach it through the section [road] of its mapping."""
    own = open_plant(CarSettings(), 0.85)
    fmu = open_plant(CarSettings(plant=f"fmu:{exported}"), 0.85)
    assert fmu.road_inputs == own.road_inputs
    for plant in (own, fmu):
        plant.reset(20.0)
    for k in range(60):
        road = RoadAt(0.0, 0.0, 0.9 if k < 20 else 0.3, 0.9, 0.02, 0.03, 1.0, 2.0)
        motions = []
        for plant in (own, fmu):
            plant.set_road(road)
            motions.append(plant.step(ControlInput(0.0, 120.0, 0.3), 0.025))
        np.testing.assert_allclose(motions[1], motions[0], rtol=1e-9, atol=1e-9)
    fmu.close()


def test_a_car_file_is_contained_in_the_fmu(front_driven: Path, tmp_path: Path) -> None:
    fmu = tmp_path / "car.fmu"
    build_fmu(fmu, str(front_driven))
    name = str(front_driven)
    own = Car(open_plant(CarSettings(car=name), 0.85), 22.0)
    loaded = Car(open_plant(CarSettings(plant=f"fmu:{fmu}"), 0.85), 22.0)
    front_driven.unlink()
    assert worst_difference(own, loaded) <= 1e-9
    loaded.plant.close()


def test_a_file_that_cannot_be_exported_is_refused(front_driven: Path, tmp_path: Path) -> None:
    before = front_driven.read_text()
    for file, car, words in (
        (front_driven.with_suffix(".fmu"), str(front_driven), "found the car file there"),
        (tmp_path / "car.fmu", "lorry", "car 'lorry'"),
        (tmp_path / "car.zip", "c_class_150kw_awd", r"ends in \.fmu"),
        (tmp_path / "missing" / "car.fmu", "c_class_150kw_awd", "can be written"),
    ):
        with pytest.raises(ConfigError, match=words):
            build_fmu(file, car)
        assert not file.exists()
    assert front_driven.read_text() == before
