"""A lane change at 80 km/h by a vehicle whose samples jitter or are lost, and with faults in it."""

import json
import random

import pytest

from rt_controller.cli import app

SCENARIO = """
format = 2
name = "lane_change_80"
duration_s = 5.0
[road]
curvature_per_m = 0.001
[reference]
speed_kmh = 80.0
[reference.ey_m]
kind = "moves"
moves = [{ start_m = 20.0, length_m = 60.0, to_m = 3.5 }]
"""


def jitter(value_ms, more="before_drive = true, seed = 1"):
    return f'{{ kind = "jitter", value = {value_ms}, {more} }}'


def lost_periods(share):
    chosen = random.Random(5)
    at_s = [0.025 * k for k in range(20, 200) if chosen.random() < share]
    return [f'{{ kind = "bus_off", start_s = {s:.3f}, duration_s = 0.025 }}' for s in at_s]


def of_signal(kind, signal, value, more="start_s = 2.0"):
    return f'{{ kind = "{kind}", signals = ["{signal}"], value = {value}, {more} }}'


LOST_STATES = '{ kind = "drop", messages = ["STATE_A"], probability = 0.05, seed = 1 }'


@pytest.fixture
def drive(tmp_path):
    """Drives with faults; the figures."""

    def driven(*faults):
        files = {name: tmp_path / name for name in ("scenario.toml", "faults.toml", "out.json")}
        files["scenario.toml"].write_text(SCENARIO)
        files["faults.toml"].write_text(f"faults = [{', '.join(faults)}]")
        command = f"--bus virtual --pace lockstep --quiet --channel {tmp_path.name}".split()
        for option, file in zip(("--scenario", "--faults", "--json"), files.values(), strict=True):
            command += [option, str(file)]
        app.meta(command, result_action="return_value")
        return json.loads(files["out.json"].read_text())

    return driven


@pytest.mark.parametrize(
    ("faults", "rms_mm"),
    [
        ([jitter(5.0)], 4.0),
        ([jitter(10.0)], 5.0),
        ([jitter(12.5, "start_s = 2.0, duration_s = 0.025")], 3.5),  # one sample
        ([of_signal("drift", "SampleTime", 1.0, "before_drive = true")], 3.5),  # clock by 0.1 %
        ([of_signal("quantise", "SampleTime", 10.0, "before_drive = true")], 3.5),
        ([of_signal("noise", "SampleTime", 3.0, "before_drive = true")], 3.5),
        (lost_periods(0.1), 4.0),
        ([*lost_periods(0.1), jitter(10.0)], 5.5),
        ([LOST_STATES, jitter(10.0)], 5.5),
    ],
)
def test_a_vehicle_drives_on_with_samples_that_jitter_or_are_lost(drive, faults, rms_mm):
    found = drive(*faults)
    assert found["stop_cause"] == "NONE"
    assert "STATE_IMPLAUSIBLE" not in found["ticks_by_fault"]
    assert 1e3 * found["car_ey_rms_m"] < rms_mm


@pytest.mark.parametrize("jitter_ms", [5.0, 10.0])
@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        (of_signal("bias", "ds_m", 0.05), "PROGRESS_IMPLAUSIBLE"),
        (of_signal("scale", "ds_m", 1.1), "PROGRESS_IMPLAUSIBLE"),
        (of_signal("bias", "vx_mps", 1.0), "SPEED_IMPLAUSIBLE"),
        (of_signal("bias", "epsi_rad", 0.02), "HEADING_IMPLAUSIBLE"),
        (of_signal("bias", "yaw_rate_radps", 0.1), "YAW_RATE_IMPLAUSIBLE"),
    ],
)
def test_a_fault_is_found_among_samples_that_jitter(drive, jitter_ms, fault, cause):
    found = drive(jitter(jitter_ms), fault)
    assert found["stop_cause"] == cause
    assert 2.0 <= found["stop_s"] <= 2.5
