"""The whole way of recorded drives: import, training, export, and a drive with that model."""

import json

from offline.commands import export, import_logs
from offline.commands import train as training
from rt_controller import simulate
from rt_controller.contract.faults import StopCause

MAPPING = """
time = { column = "time_s" }
[states]
vx_mps = { column = "vx_mps", unit = "m/s" }
vy_mps = { column = "vy_mps", unit = "m/s" }
yaw_rate_radps = { column = "yaw_rate_radps", unit = "rad/s" }
ds_m = { column = "ds_m", unit = "m" }
ey_m = { column = "ey_m", unit = "m" }
epsi_rad = { column = "epsi_rad", unit = "rad" }
[inputs]
throttle = { column = "throttle", unit = "1" }
brake_n = { column = "brake_n", unit = "N" }
steer_rad = { column = "steer_rad", unit = "rad" }
[exogenous]
curvature_per_m = { column = "curvature_per_m", unit = "1/m" }
"""
DRIVES = ("sine_60", "double_lane_change", "slalom")
DRIVE_S = 12.0


def test_a_model_of_recorded_drives_drives(tmp_path, monkeypatch):
    """Few steps: the model stays close to the shipped one that the training begins with."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "map.toml").write_text(MAPPING)
    (tmp_path / "logs").mkdir()
    for name in DRIVES:
        simulate(name, duration_s=DRIVE_S).to_csv(f"logs/{name}.csv")

    run(import_logs.app, "map.toml", "logs", "--data", "data")
    options = ("--init", "mdk-net", "--steps", "20", "--batch", "32", "--learning-rate", "1e-5")
    run(training.app, "--data", "data", *options)
    run(export.app, "--name", "own", "--json", "export.json")

    figures = json.loads((tmp_path / "export.json").read_text())
    drive = simulate("slalom", model="runs/latest/bundle", duration_s=10.0)
    assert drive.model == f"own {figures['model_sha256'][:8]}"
    assert drive.stop_cause == StopCause.STOP_REQUESTED.name
    assert drive.errors.ey_peak_m < 0.05


def run(app, *tokens):
    assert app(tokens, result_action="return_value") in (None, 0)
