"""FMUs and mappings that are refused as plants."""

import zipfile
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")
pytest.importorskip("pythonfmu", reason="the extra [test] is not installed")

from made_fmus import FOREIGN_MAPPING, remap, rewrite_description

from rt_controller.contract.errors import ConfigError
from sim_bridge.adapters.fmu import FmuPlant


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"pedal"', '"pedals"', "expected a variable 'pedals', found none of that name (pedal"),
        ('unit = "bar"', 'unit = "furlong"', "found 'furlong'"),
        (", scale = 40000.0", "", "to measure force, found pressure"),
        ('throttle = "pedal"\n', "", "inputs.throttle"),
        ('throttle = "pedal"', 'throttle = "speed_kmh"', "which is continuous output"),
        ('vy_mps = "slide_mps"', 'vy_mps = "trailers"', "of type Integer"),
        ("sign = -1", "sign = 2", "sign"),
        ("[start]", "[begin]", "begin"),
        ('throttle = "pedal"', 'throttle = "wheel_deg"', "found 'wheel_deg' twice"),
        ("0.005", "-0.005", "communication_step_s"),
        ("0.005", "2.0", "communication_step_s"),
        ('throttle = "pedal"', 'throttle = "mu"', "which is fixed parameter"),
        ("trailers = 1", "speed_kmh = 1.0", "which is continuous output"),
        ("trailers = 1", "trailer = 1", "expected a variable 'trailer'"),
        ("[outputs]", "[outputs", "expected a TOML file"),
        ('unit = "bar", scale = 40000.0', "scale = 0, offset = nan", "inputs.brake_n.offset"),
    ],
)
def test_a_mapping_that_does_not_fit_is_refused(
    foreign_car: Path, old: str, new: str, words: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        FmuPlant(remap(foreign_car, old, new), None, 0.85)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({'vx_mps = {variable = "v0_kmh", unit = "km/h"}': ""}, "vx_mps 25.00, found vx_mps 10.00"),
        (
            {'"slide_mps"': '"mu"', 'road_friction = "mu"': "", "trailers = 1": "mu = nan"},
            "vy_mps nan",
        ),
    ],
)
def test_a_start_that_the_fmu_does_not_take_is_refused(
    foreign_car: Path, changes: dict[str, str], words: str
) -> None:
    mapping = FOREIGN_MAPPING
    for old, new in changes.items():
        mapping = mapping.replace(old, new)
    foreign_car.with_suffix(".toml").write_text(mapping)
    plant = FmuPlant(foreign_car, None, 0.85)
    with pytest.raises(ConfigError, match=words):
        plant.reset(25.0)
    plant.close()


def test_a_missing_or_damaged_file_is_refused_by_name(foreign_car: Path, tmp_path: Path) -> None:
    foreign_car.with_suffix(".toml").unlink()
    with pytest.raises(ConfigError, match=r"Foreign\.toml.*plant_mapping"):
        FmuPlant(foreign_car, None, 0.85)
    foreign_car.write_text("no FMU")
    for path, words in (
        (foreign_car, r"expected an FMU \(a ZIP archive"),
        (tmp_path / "car.fmu", r"car\.fmu: expected an FMU, found no such file"),
    ):
        with pytest.raises(ConfigError, match=words):
            FmuPlant(path, None, 0.85)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("CoSimulation", "ModelExchange", "found FMI 2.0, model exchange only"),
        ('fmiVersion="2.0"', 'fmiVersion="4.0"', "Unsupported FMI version"),
        ("<Real/>", '<Real unit="m/s"/>', "FMU's own unit 'm/s', found 'km/h'"),
    ],
)
def test_an_fmu_whose_description_does_not_fit_is_refused(
    foreign_car: Path, old: str, new: str, words: str
) -> None:
    rewrite_description(foreign_car, old, new)
    with pytest.raises(ConfigError, match=words):
        FmuPlant(foreign_car, None, 0.85)


def test_an_fmu_without_a_library_for_this_platform_is_refused(
    foreign_car: Path, tmp_path: Path
) -> None:
    bare = tmp_path / "bare.fmu"
    with zipfile.ZipFile(foreign_car) as source, zipfile.ZipFile(bare, "w") as target:
        target.writestr("modelDescription.xml", source.read("modelDescription.xml"))
    with pytest.raises(ConfigError, match="expected a library for"):
        FmuPlant(bare, foreign_car.with_suffix(".toml"), 0.85)
