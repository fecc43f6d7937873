"""The control period is one constant: data, model, plant, bus and controller follow from it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import can
import cantools
import pytest

RIGS = Path(__file__).parents[1] / "rigs"
PERIOD_S = 0.020


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target: Path = tmp_path_factory.mktemp("period")
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, RIGS / "drive_at_20_ms.py", target]
    ended = subprocess.run(
        command, capture_output=True, text=True, check=False, env=environment, timeout=300
    )
    assert ended.returncode == 0, ended.stderr
    return target


def test_a_linear_model_of_20_ms_stays_on_its_path(folder: Path) -> None:
    figures = json.loads((folder / "summary.json").read_text())
    assert figures["final_mode"] == "STANDBY"
    assert figures["ey_rms_m"] <= 0.2
    assert figures["ey_peak_m"] <= 0.4


def test_every_message_is_sent_at_the_cycle_time_of_the_generated_dbc(folder: Path) -> None:
    catalogue = cantools.database.load_file(folder / "messages.dbc")
    stamps: dict[int, list[float]] = {}
    for message in can.CanutilsLogReader(folder / "drive.log"):
        stamps.setdefault(message.arbitration_id, []).append(message.timestamp)
    for message in catalogue.messages:
        times = stamps.get(message.frame_id, [])
        assert len(times) > 3, f"{message.name}: expected a call that sends it every cycle time"
        cycle_s = (times[-2] - times[1]) / (len(times) - 3)
        assert cycle_s == pytest.approx(message.cycle_time / 1e3, abs=1e-6), message.name
    assert catalogue.get_message_by_name("ACT_CMD").cycle_time == 1e3 * PERIOD_S
    assert catalogue.get_message_by_name("MISSION").cycle_time == 100
