"""FMUs and mappings that are refused as plants."""

import zipfile
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")
pytest.importorskip("pythonfmu", reason="the extra [test] is not installed")

from made_fmus import FOREIGN_MAPPING, remap, rewrite_description

from rt_controller.contract.errors import ConfigError
from sim_bridge.adapters.fmu import open_fmu_plant


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"pedal"', '"pedals"', "expected a variable 'pedals', found none of that name (pedal"),
        ('unit = "bar"', 'unit = "furlong"', "found 'furlong'"),
        (", scale = 40000.0", "", "to measure force, found pressure"),
        ('throttle = "pedal"\n', "", "inputs.throttle"),
        ('throttle = "pedal"', 'throttle = "speed_kmh"', "a continuous output"),
        ('vy_mps = "slide_mps"', 'vy_mps = "trailers"', "of type Integer"),
        ("sign = -1", "sign = 2", "sign"),
        ("[start]", "[begin]", "begin"),
        ('throttle = "pedal"', 'throttle = "wheel_deg"', "found 'wheel_deg' twice"),
        ("0.005", "-0.005", "communication_step_s"),
        ("0.005", "2.0", "communication_step_s"),
        ('throttle = "pedal"', 'throttle = "mu"', "a fixed parameter"),
        ("trailers = 1", "speed_kmh = 1.0", "parameter, an input or a variable with a start value"),
        ("trailers = 1", "trailer = 1", "expected a variable 'trailer'"),
        ("[outputs]", "[outputs", "expected a TOML file"),
        ('unit = "bar", scale = 40000.0', "scale = 0, offset = nan", "inputs.brake_n.offset"),
    ],
)
def test_a_mapping_that_does_not_fit_is_refused(
    foreign_car: Path, old: str, new: str, words: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        open_fmu_plant(remap(foreign_car, old, new), None, 0.85)
    assert words in str(refused.value)


def test_an_initial_speed_that_the_fmu_does_not_take_is_refused(foreign_car: Path) -> None:
    remap(foreign_car, 'vx_mps = {variable = "v0_kmh", unit = "km/h"}\n', "")
    plant = open_fmu_plant(foreign_car, None, 0.85)
    with pytest.raises(ConfigError, match=r"starts at 25.00 m/s, found vx_mps 10.00"):
        plant.reset(25.0)
    plant.close()


def test_an_initial_motion_that_is_nan_is_refused(foreign_car: Path) -> None:
    mapping = FOREIGN_MAPPING.replace('"slide_mps"', '"mu"').replace('road_friction = "mu"\n', "")
    foreign_car.with_suffix(".toml").write_text(mapping + "mu = nan\n")
    plant = open_fmu_plant(foreign_car, None, 0.85)
    with pytest.raises(ConfigError, match="vy_mps nan"):
        plant.reset(10.0)
    plant.close()


def test_what_is_no_fmu_with_a_mapping_is_refused_by_name(foreign_car: Path) -> None:
    mapping, content = foreign_car.with_suffix(".toml"), foreign_car.read_bytes()
    with zipfile.ZipFile(foreign_car) as source:
        description = source.read("modelDescription.xml")
    with zipfile.ZipFile(foreign_car, "w") as bare:
        bare.writestr("modelDescription.xml", description)
    with pytest.raises(ConfigError, match="with libraries for no platform"):
        open_fmu_plant(foreign_car, None, 0.85)
    foreign_car.write_text("no FMU")
    with pytest.raises(ConfigError, match="expected an FMU"):
        open_fmu_plant(foreign_car, None, 0.85)
    foreign_car.unlink()
    with pytest.raises(ConfigError, match=r"Foreign\.fmu: expected an FMU, found no such file"):
        open_fmu_plant(foreign_car, None, 0.85)
    foreign_car.write_bytes(content)
    mapping.unlink()
    with pytest.raises(ConfigError, match=r"Foreign\.toml.*plant_mapping"):
        open_fmu_plant(foreign_car, None, 0.85)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("CoSimulation", "ModelExchange", "for model exchange only"),
        ('fmiVersion="2.0"', 'fmiVersion="4.0"', "Unsupported FMI version"),
        ("<Real/>", '<Real unit="m/s"/>', "FMU's own unit 'm/s', found 'km/h'"),
    ],
)
def test_an_fmu_of_another_kind_is_refused(
    foreign_car: Path, old: str, new: str, words: str
) -> None:
    rewrite_description(foreign_car, old, new)
    with pytest.raises(ConfigError, match=words):
        open_fmu_plant(foreign_car, None, 0.85)
