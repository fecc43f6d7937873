"""The Reference-FMUs of the Modelica Association run as plants, or a refusal says how they will.

They are not part of the project. The tests run where RT_CONTROLLER_REFERENCE_FMUS names a folder
with NAME_fmi2.fmu and NAME_fmi3.fmu for Dahlquist and Feedthrough.
"""

import os
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.adapters.fmu import FmuPlant

VARIABLE = "RT_CONTROLLER_REFERENCE_FMUS"
FOLDER = Path(os.environ.get(VARIABLE) or "no such folder")
MAPPING = """
communication_step_s = {step_s}
[inputs]
throttle = {throttle}
brake_n = {brake_n}
steer_rad = {steer_rad}
[outputs]
vx_mps = {{variable = "{first}", scale = 1.0}}
vy_mps = {{variable = "{second}", scale = 1.0}}
yaw_rate_radps = {{variable = "{second}", scale = 1.0}}
"""
NO_INPUTS = {"throttle": "false", "brake_n": "false", "steer_rad": "false"}
FEEDTHROUGH = {
    "throttle": '"Float64_continuous_input"',
    "brake_n": '"Float64_discrete_input"',
    "steer_rad": '"Float64_tunable_parameter"',
    "first": "Float64_continuous_output",
    "second": "Float64_discrete_output",
}
pytestmark = [
    pytest.mark.skipif(not FOLDER.is_dir(), reason=f"{VARIABLE} names no folder with the FMUs"),
    pytest.mark.parametrize("version", [2, 3]),
]


def drive(name: str, folder: Path, v0_mps: float, n_periods: int, **names: str) -> np.ndarray:
    """(n_periods + 1, 3) motion at the periods' ends; the step is the one that a refusal names."""
    file, fmu = folder / "mapping.toml", FOLDER / f"{name}.fmu"
    file.write_text(MAPPING.format(step_s=PERIOD_S, **NO_INPUTS | names))
    try:
        plant = FmuPlant(fmu, file, 0.85)
    except ConfigError as refused:
        named = re.search(r"communication_step_s = ([0-9.e-]+)", str(refused))
        if named is None:
            raise
        file.write_text(MAPPING.format(step_s=named[1], **NO_INPUTS | names))
        plant = FmuPlant(fmu, file, 0.85)
    ends = [plant.reset(v0_mps)]
    for k in range(n_periods):
        ends.append(plant.step(ControlInput(0.5 + 0.01 * k, 10.0, 0.0), PERIOD_S)[-1].copy())
    assert plant.failure is None
    plant.close()
    return np.array(ends)


def test_a_decay_follows_its_solution(version: int, tmp_path: Path) -> None:
    motion = drive(f"Dahlquist_fmi{version}", tmp_path, 1.0, 40, first="x", second="x")
    # Its own solver is Euler's method with a step of 0.1 s; in between FMI 2 holds the value.
    np.testing.assert_allclose(motion[::4, 0], 0.9 ** np.arange(11), rtol=1e-9)
    assert np.all(np.diff(motion[:, 0]) <= 0.0)


def test_inputs_pass_through_and_a_fixed_parameter_is_no_input(
    version: int, tmp_path: Path
) -> None:
    """With its step of 0.1 s the FMI 3 one takes an input once in four periods."""
    motion = drive(f"Feedthrough_fmi{version}", tmp_path, 0.0, 40, **FEEDTHROUGH)
    np.testing.assert_allclose(motion[5:, 0], 0.5 + 0.01 * np.arange(4, 40), atol=0.041)
    np.testing.assert_allclose(motion[5:, 1], 10.0)
    fixed = FEEDTHROUGH | {"steer_rad": '"Float64_fixed_parameter"'}
    with pytest.raises(ConfigError, match=r"a fixed parameter.*under \[parameters\]"):
        drive(f"Feedthrough_fmi{version}", tmp_path, 0.0, 40, **fixed)
