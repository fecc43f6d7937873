"""FMUs as plants: units and signs of the mapping, FMI 2 and 3, failures, refusals."""

import zipfile
from collections.abc import Callable
from math import isnan
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")
pytest.importorskip("pythonfmu", reason="the extra [test] is not installed")

from made_fmus import (
    FOREIGN_MAPPING,
    build,
    make_foreign_car,
    remap,
    rewrite_description,
)

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.adapters.fmu import FmuPlant
from sim_bridge.car import Car


@pytest.fixture
def foreign_car(tmp_path: Path) -> Path:
    """An FMU with other units and signs than the product, its mapping beside it."""
    return make_foreign_car(tmp_path, "Foreign")


def test_values_are_converted_with_the_units_and_signs_of_the_mapping(foreign_car: Path) -> None:
    plant = FmuPlant(foreign_car, None, 0.5)
    start = plant.reset(20.0)
    np.testing.assert_allclose(start, [20.0, 0.0, 0.0], atol=1e-12)

    motion = plant.step(ControlInput(throttle=0.5, brake_n=0.0, steer_rad=0.1), PERIOD_S)
    # Full throttle accelerates with 4 m/s^2 times friction, over two because of the trailer.
    speeds = 20.0 + 0.5 * np.arange(1, 6) * 0.005
    np.testing.assert_allclose(motion[:, 0], speeds, rtol=1e-12)
    np.testing.assert_allclose(motion[:, 2], 0.1 * speeds / 50.0, rtol=1e-12)

    # 100 N are 40 bar, which decelerate with 8 m/s^2 times friction over two.
    motion = plant.step(ControlInput(throttle=0.0, brake_n=100.0, steer_rad=0.0), PERIOD_S)
    assert motion[-1, 0] == pytest.approx(speeds[-1] - 2.0 * PERIOD_S)
    plant.close()


SAMPLE_MAPPING = """
communication_step_s = 0.0125
[inputs]
throttle = "realIn"
brake_n = false
steer_rad = false
[outputs]
vx_mps = {variable = "realOut", offset = 7.0}
vy_mps = "realIn"
yaw_rate_radps = "container.someReal"
[parameters]
"container.someReal" = 0.25
intParam = 7
booleanParameter = true
stringParameter = "cat"
"""


@pytest.mark.parametrize(
    ("parameter", "words"),
    [("fails_at_s", "no fuel left"), ("loses_itself_at_s", "yaw_rate_radps is nan")],
)
def test_a_failed_step_gives_nan_and_the_reason(
    foreign_car: Path, parameter: str, words: str
) -> None:
    remap(foreign_car, "trailers = 1", f"trailers = 1\n{parameter} = 0.06")
    car = Car(FmuPlant(foreign_car, None, 0.9), 10.0)
    for _ in range(2):
        assert np.isfinite(car.advance(NEUTRAL_INPUT, 0.0)).all()
    for _ in range(3):
        assert np.isnan(car.advance(NEUTRAL_INPUT, 0.0)).any()
        assert not car.is_sound
    assert car.plant.failure is not None
    assert words in car.plant.failure
    assert "0.06" in car.plant.failure
    assert all(isnan(value) for value in car.plant.outputs())
    car.reset(10.0)
    assert car.is_sound
    car.plant.close()


def test_a_unit_defined_by_base_units_is_converted(foreign_car: Path) -> None:
    """Some tools write m.s-1 or a name of their own, with a definition by base units."""
    rewrite_description(
        foreign_car,
        "<ModelVariables>",
        '<UnitDefinitions><Unit name="Tempo"><BaseUnit m="1" s="-1" factor="0.2777777778"/>'
        "</Unit></UnitDefinitions><ModelVariables>",
    )
    rewrite_description(foreign_car, "<Real/>", '<Real unit="Tempo"/>')
    remap(foreign_car, ', unit = "km/h"}\nvy_mps = "slide_mps"', '}\nvy_mps = "slide_mps"')
    with pytest.raises(ConfigError, match="FMU's own unit 'Tempo', found 'deg/s'"):
        FmuPlant(foreign_car, None, 0.85)
    mapping = foreign_car.with_suffix(".toml")
    mapping.write_text(
        mapping.read_text().replace('unit = "deg/s", sign = -1', "scale = 1.0, sign = -1")
    )
    plant = FmuPlant(foreign_car, None, 0.85)
    assert plant.reset(20.0)[0] == pytest.approx(20.0)
    plant.close()


@pytest.mark.parametrize("step_s", [0.0007, 0.0125, 0.04])
def test_every_instant_of_the_motion_is_that_of_the_fmu(foreign_car: Path, step_s: float) -> None:
    """A constant pull of 2 m/s^2, on any grid."""
    plant = FmuPlant(remap(foreign_car, "0.005", str(step_s)), None, 1.0)
    plant.reset(10.0)
    parts = [plant.step(ControlInput(1.0, 0.0, 0.0), PERIOD_S)[:, 0].copy() for _ in range(20)]
    speeds = np.concatenate(parts)
    t = np.arange(1, len(speeds) + 1) * 20 * PERIOD_S / len(speeds)
    np.testing.assert_allclose(speeds, 10.0 + 2.0 * t, rtol=1e-9)
    plant.close()


def test_a_communication_step_longer_than_the_period_takes_inputs_at_its_own_points(
    foreign_car: Path,
) -> None:
    plant = FmuPlant(remap(foreign_car, "0.005", "0.1"), None, 1.0)
    plant.reset(10.0)
    throttles = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    ends = [plant.step(ControlInput(x, 0.0, 0.0), PERIOD_S)[-1, 0] for x in throttles]
    # The pull of 2 m/s^2 at 0 s lasts to 0.1 s; the one at 0.125 s comes between two points.
    np.testing.assert_allclose(ends, [10.05, 10.1, 10.15, 10.2, 10.2, 10.2], rtol=1e-12)
    plant.close()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"pedal"', '"pedals"', "expected a variable 'pedals', found none of that name (pedal"),
        ('unit = "bar"', 'unit = "furlong"', "found 'furlong'"),
        (", scale = 40000.0", "", "to measure force, found pressure"),
        ('throttle = "pedal"', 'throttle = "speed_kmh"', "which is continuous output"),
        ('vy_mps = "slide_mps"', 'vy_mps = "trailers"', "of type Integer"),
        ("sign = -1", "sign = 2", "sign"),
        ("[start]", "[begin]", "begin"),
        ('throttle = "pedal"', 'throttle = "wheel_deg"', "found 'wheel_deg' twice"),
        ("0.005", "-0.005", "communication_step_s"),
        ('throttle = "pedal"', 'throttle = "mu"', "which is fixed parameter"),
        ("trailers = 1", "speed_kmh = 1.0", "which is continuous output"),
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


def unmapped(fmu: Path) -> Path:
    fmu.with_suffix(".toml").unlink()
    return fmu


def damaged(fmu: Path) -> Path:
    fmu.write_text("no FMU")
    return fmu


def without_library(fmu: Path) -> Path:
    with zipfile.ZipFile(fmu) as source:
        description = source.read("modelDescription.xml")
    with zipfile.ZipFile(fmu, "w") as target:
        target.writestr("modelDescription.xml", description)
    return fmu


def described(old: str, new: str) -> Callable[[Path], Path]:
    def change(fmu: Path) -> Path:
        rewrite_description(fmu, old, new)
        return fmu

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (unmapped, r"Foreign\.toml.*plant_mapping"),
        (damaged, r"expected an FMU \(a ZIP archive"),
        (lambda fmu: fmu.with_name("car.fmu"), r"car\.fmu: expected an FMU, found no such file"),
        (without_library, "expected a library for"),
        (described("CoSimulation", "ModelExchange"), "found FMI 2.0, model exchange only"),
        (described('fmiVersion="2.0"', 'fmiVersion="4.0"'), "Unsupported FMI version"),
        (described("<Real/>", '<Real unit="m/s"/>'), "FMU's own unit 'm/s', found 'km/h'"),
    ],
)
def test_a_file_that_cannot_be_driven_is_refused(
    foreign_car: Path, change: Callable[[Path], Path], words: str
) -> None:
    mapping = foreign_car.with_suffix(".toml")
    fmu = change(foreign_car)
    with pytest.raises(ConfigError, match=words):
        FmuPlant(fmu, mapping if mapping.exists() else None, 0.85)


def sample_model(folder: Path, version: int) -> Path:
    """Both packages ship a slave whose output is its own time; its mapping beside it."""
    maker = pytest.importorskip("pythonfmu" if version == 2 else "pythonfmu3")
    script = folder / f"sample_{folder.name}_{version}.py"
    slave = Path(maker.__file__).parent / "tests" / "slaves" / "pythonslave.py"
    script.write_text(slave.read_text())
    fmu = build(script, folder) if version == 2 else maker.FmuBuilder.build_FMU(script, folder)
    Path(fmu).with_suffix(".toml").write_text(SAMPLE_MAPPING)
    return Path(fmu)


@pytest.mark.parametrize("version", [2, 3])
def test_a_sample_model_of_pythonfmu_is_a_plant(tmp_path: Path, version: int) -> None:
    """Parameters of four types are set."""
    plant = FmuPlant(sample_model(tmp_path, version), None, 0.85)
    plant.reset(10.0)
    motion = plant.step(ControlInput(0.4, 0.0, 0.0), PERIOD_S)
    np.testing.assert_allclose(motion, [[7.0125, 0.4, 0.25], [7.025, 0.4, 0.25]])
    assert isnan(plant.outputs().roll_rad), "a further output that the mapping does not have"
    plant.close()


def test_the_remedy_for_a_fixed_step_that_is_no_part_of_the_period_works(tmp_path: Path) -> None:
    """An FMU that computes whole steps of 10 ms only; the control period is 25 ms."""
    fmu = sample_model(tmp_path, 3)
    rewrite_description(fmu, "<CoSimulation ", '<CoSimulation fixedInternalStepSize="0.01" ')
    for step_s in ("0.0125", "0.025", "0.005"):
        fmu.with_suffix(".toml").write_text(SAMPLE_MAPPING.replace("0.0125", step_s))
        with pytest.raises(ConfigError, match=r"Write communication_step_s = 0\.01 in"):
            FmuPlant(fmu, None, 0.85)
    fmu.with_suffix(".toml").write_text(SAMPLE_MAPPING.replace("0.0125", "0.01"))
    plant = FmuPlant(fmu, None, 1.0)
    plant.reset(10.0)
    plant.step(NEUTRAL_INPUT, PERIOD_S)
    found = plant.step(NEUTRAL_INPUT, PERIOD_S)[:, 0]  # the output is the time
    wanted = 7.0 + PERIOD_S + PERIOD_S * np.arange(1, len(found) + 1) / len(found)
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
    plant.close()
