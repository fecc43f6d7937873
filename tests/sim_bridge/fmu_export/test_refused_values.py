"""Values that the exported FMU refuses."""

from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

from c_compiler import needs_c_compiler
from exported_fmu import ExportedFmu, exported

pytestmark = needs_c_compiler

FAILED = "status 3"


@pytest.fixture(scope="module")
def file() -> Path:
    return exported()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"v0_mps": -1.0}, "v0_mps: expected a speed of 0 to 70 m/s"),
        ({"v0_mps": 71.0}, "v0_mps: expected a speed of 0 to 70 m/s"),
        ({"road__bank_rad": 3.0}, "road.bank_rad: expected a slope of at most 0.7 rad"),
        ({"road__grade_rad": -0.8}, "road.grade_rad: expected a slope of at most 0.7 rad"),
        ({"road__friction_left": 0.0}, "road.friction_left: expected a friction above 0"),
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
