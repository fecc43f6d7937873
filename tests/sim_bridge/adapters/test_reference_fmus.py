"""The Reference-FMUs of the Modelica Association run as plants, or a refusal says how they will.

They are not part of the project. The tests run where RT_CONTROLLER_REFERENCE_FMUS names a folder
with NAME_fmi2.fmu and NAME_fmi3.fmu for BouncingBall, Dahlquist, Feedthrough and VanDerPol.
"""

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.adapters.fmu import open_fmu_plant

VARIABLE = "RT_CONTROLLER_REFERENCE_FMUS"
FOLDER = Path(os.environ.get(VARIABLE) or "no such folder")
pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(), reason=f"{VARIABLE} names no folder with the Reference-FMUs"
)

WITHOUT_INPUTS = """
communication_step_s = {step_s}
[inputs]
throttle = false
brake_n = false
steer_rad = false
[outputs]
vx_mps = {{variable = "{first}", scale = 1.0}}
vy_mps = {{variable = "{second}", scale = 1.0}}
yaw_rate_radps = {{variable = "{second}", scale = 1.0}}
"""
FEEDTHROUGH = """
communication_step_s = {step_s}
[inputs]
throttle = "Float64_continuous_input"
brake_n = "Float64_discrete_input"
steer_rad = "Float64_tunable_parameter"
[outputs]
vx_mps = "Float64_continuous_output"
vy_mps = "Float64_discrete_output"
yaw_rate_radps = "Float64_discrete_output"
[parameters]
Float64_fixed_parameter = 3.0
"""


def drive(
    fmu: Path, mapping: Callable[[float], str], folder: Path, v0_mps: float, n_periods: int = 40
) -> np.ndarray:
    """(n_periods + 1, 3) motion at the periods' ends; the step is the one that a refusal names."""
    file = folder / "mapping.toml"
    file.write_text(mapping(PERIOD_S))
    try:
        plant = open_fmu_plant(fmu, file, 0.85)
    except ConfigError as refused:
        named = re.search(r"communication_step_s = ([0-9.e-]+)", str(refused))
        if named is None:
            raise
        file.write_text(mapping(float(named[1])))
        plant = open_fmu_plant(fmu, file, 0.85)
    ends = [plant.reset(v0_mps)]
    for k in range(n_periods):
        ends.append(plant.step(ControlInput(0.5 + 0.01 * k, 10.0, 0.0), PERIOD_S)[-1].copy())
    assert plant.failure is None
    plant.close()
    return np.array(ends)


def without_inputs(first: str, second: str) -> Callable[[float], str]:
    return lambda step_s: WITHOUT_INPUTS.format(step_s=step_s, first=first, second=second)


@pytest.mark.parametrize("version", [2, 3])
def test_a_decay_follows_its_solution(version: int, tmp_path: Path) -> None:
    fmu = FOLDER / f"Dahlquist_fmi{version}.fmu"
    motion = drive(fmu, without_inputs("x", "x"), tmp_path, 1.0)
    # Its own solver is Euler's method with a step of 0.1 s; in between FMI 2 holds the value.
    np.testing.assert_allclose(motion[::4, 0], 0.9 ** np.arange(11), rtol=1e-9)
    assert np.all(np.diff(motion[:, 0]) <= 0.0)


@pytest.mark.parametrize("version", [2, 3])
def test_an_oscillator_follows_its_solution(version: int, tmp_path: Path) -> None:
    fmu = FOLDER / f"VanDerPol_fmi{version}.fmu"
    motion = drive(fmu, without_inputs("x0", "x1"), tmp_path, 2.0)
    x0, x1 = 2.0, 0.0
    for _ in range(1000):
        x0, x1 = x0 + 0.001 * x1, x1 + 0.001 * ((1.0 - x0 * x0) * x1 - x0)
    np.testing.assert_allclose(motion[-1, :2], [x0, x1], atol=0.03)


@pytest.mark.parametrize("version", [2, 3])
def test_a_ball_falls(version: int, tmp_path: Path) -> None:
    fmu = FOLDER / f"BouncingBall_fmi{version}.fmu"
    motion = drive(fmu, without_inputs("h", "v"), tmp_path, 1.0, n_periods=17)
    t = np.arange(18) * PERIOD_S
    np.testing.assert_allclose(motion[:, 0], 1.0 - 0.5 * 9.81 * t**2, atol=0.02)


@pytest.mark.parametrize("version", [2, 3])
def test_inputs_pass_through(version: int, tmp_path: Path) -> None:
    """With its step of 0.1 s the FMI 3 one takes an input once in four periods."""
    fmu = FOLDER / f"Feedthrough_fmi{version}.fmu"
    motion = drive(fmu, lambda step_s: FEEDTHROUGH.format(step_s=step_s), tmp_path, 0.0)
    expected = 0.5 + 0.01 * np.arange(40)
    np.testing.assert_allclose(motion[5:, 0], expected[4:], atol=0.041)
    np.testing.assert_allclose(motion[5:, 1], 10.0)


@pytest.mark.parametrize("version", [2, 3])
def test_a_fixed_parameter_is_no_input(version: int, tmp_path: Path) -> None:
    fmu = FOLDER / f"Feedthrough_fmi{version}.fmu"
    mapping = FEEDTHROUGH.replace("Float64_tunable_parameter", "Float64_fixed_parameter")
    with pytest.raises(ConfigError, match=r"a fixed parameter.*under \[parameters\]"):
        drive(fmu, lambda step_s: mapping.format(step_s=step_s), tmp_path, 0.0)
