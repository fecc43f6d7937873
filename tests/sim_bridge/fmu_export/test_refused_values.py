"""Values that the exported FMU refuses, as the files of a car and of a tyre do."""

from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

from c_compiler import needs_c_compiler
from exported_fmu import ExportedFmu, car_with_tyre_file, exported

from sim_bridge.fmu_export.description import FmiVersion

pytestmark = needs_c_compiler

FAILED = "status 3|failed"
"""of a call; fmpy says it differently for the two versions"""


@pytest.fixture(params=list(FmiVersion), ids=["fmi2", "fmi3"])
def file(request: pytest.FixtureRequest) -> Path:
    return exported(request.param)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"v0_mps": -1.0}, "v0_mps: expected a number of at least 0"),
        ({"v0_mps": 71.0}, "v0_mps: expected a number of at least 0 and at most 70, found 71"),
        ({"road__bank_rad": 3.0}, "road.bank_rad: expected a number of at least -0.7 and at most"),
        ({"road__grade_rad": -0.8}, "road.grade_rad: expected a number of at least -0.7"),
        ({"road__friction_left": 0.0}, "road.friction_left: expected a number above 0"),
        ({"driveline__front_share": 1.5}, "at most 1, found 1.5"),
        ({"steer_rad": float("nan")}, "steer_rad: expected a finite number"),
        ({"vx_mps": 3.0}, "vx_mps: expected an input or a parameter"),
        ({"time": 3.0}, "time: expected an input or a parameter"),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_name(
    file: Path, values: dict[str, float], words: str
) -> None:
    fmu = ExportedFmu(file)
    with pytest.raises(Exception, match=FAILED):
        fmu.set(**values)
    assert words in fmu.messages[-1]
    fmu.close()


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("body.mass_kg", 1700.0, "the sum of sprung and unsprung masses, found 1700."),
        (
            *("tyre.lateral_relaxation_end_slip", 0.01),
            "more than lateral_relaxation_start_slip, found 0.01.",
        ),
        ("gearbox.ratios[2]", 9.0, "ratios that decrease from gear to gear, found others."),
    ],
)
def test_parameters_that_contradict_each_other_are_refused_as_in_a_car_file(
    file: Path, name: str, value: float, expected: str
) -> None:
    fmu = ExportedFmu(file)
    fmu.set(**{name: value})
    with pytest.raises(Exception, match=FAILED):
        fmu.initialise()
    assert f"{name.partition('[')[0]}: expected {expected}" in fmu.messages[-1]
    fmu.close()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("fnomin", 0.0),
        ("lmuy", 0.0),
        ("pky1", 2.0),
        ("is_right", 2.0),
        ("unloaded_radius", 334.0),
    ],
)
def test_coefficients_of_a_tyre_have_the_limits_of_a_tyre_file(name: str, value: float) -> None:
    fmu = ExportedFmu(exported(FmiVersion.FMI3, car_with_tyre_file()))
    with pytest.raises(Exception, match=FAILED):
        fmu.set(**{f"tyre_file.{name}": value})
    assert f"tyre_file.{name}: expected a number" in fmu.messages[-1]
    fmu.close()


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("pdx1", 0.097, "a peak friction pdx1 * lmux of 0.2 to 2.5, found 0.097."),
        ("pdy1", -9.6, "a peak friction |pdy1| * lmuy of 0.2 to 2.5, found -9.6."),
        ("pkx1", 1.0, "a slip stiffness over load pkx1 * lkx of 2 to 200, found 1."),
        ("pky1", -0.42, "a cornering stiffness over load of 2 to 200, found -0.42."),
        ("fnomin", 4.5, "a factor of at most 5 to the mean wheel load, found 4.5."),
    ],
)
def test_a_tyre_that_no_car_has_is_refused_as_in_a_tyre_file(
    name: str, value: float, expected: str
) -> None:
    fmu = ExportedFmu(exported(FmiVersion.FMI3, car_with_tyre_file()))
    fmu.set(**{f"tyre_file.{name}": value})
    with pytest.raises(Exception, match=FAILED):
        fmu.initialise()
    assert f"tyre_file.{name}: expected {expected}" in fmu.messages[-1]
    fmu.close()
