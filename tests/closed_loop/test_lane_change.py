"""Models drive the paper's double lane change in lockstep: shipped, with a history, of 20 ms."""

import json
import os
import subprocess
import sys
from pathlib import Path

import can
import cantools
import numpy as np
import pytest
from made_frames import decode_frames
from made_models import WITH_ALL, make_bundle
from virtual_drive import drive

from rt_controller.bus.messages import FEEDBACK, STATE
from rt_controller.contract.signals import VehicleState
from rt_controller.control import estimator, steering_factor
from rt_controller.control.lift import Encoder
from rt_controller.control.piqp_solver import MAX_ITERATIONS
from rt_controller.control.warm_start import MAX_ROUNDS
from rt_controller.model.artifact import save_bundle


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The double lane change of the shipped model: its figures and its log."""
    folder = tmp_path_factory.mktemp("recorded")
    log = folder / "drive.log"
    return drive(folder, "mdk-net", "--record", str(log)), log


def test_the_shipped_networks_stay_on_their_path(recorded, tmp_path):
    for figures in (recorded[0], drive(tmp_path, "mdk-net-paper")):
        assert figures["ey_rms_m"] <= 0.10
        assert figures["ey_peak_m"] <= 0.30
        assert figures["vx_rms_mps"] <= 0.5
        assert figures["ticks"] >= 400
        assert figures["final_mode"] == "STANDBY"
        assert figures["qp_iterations"]["max"] <= MAX_ROUNDS + MAX_ITERATIONS
        assert figures["ticks_by_fault"] == {}
    more = {"epsi_rms_rad", "deadline_misses", "skipped_ticks", "scheduler", "model"}
    assert more <= set(figures)
    for key in ("step_us", "wake_us", "qp_us", "qp_iterations"):
        assert set(figures[key]) == {"p50", "p99", "p999", "max", "mean"}


def test_a_car_whose_actuators_are_late_as_stated_stays_on_its_path(tmp_path):
    late = ("--actuation-delay", "5", "--mpc.actuation-delay", "5")
    figures = drive(tmp_path, "mdk-net", *late)
    assert figures["final_mode"] == "STANDBY"
    assert figures["ticks_by_fault"] == {}
    assert figures["ey_peak_m"] <= 0.05


def test_the_same_run_twice_gives_the_same_frames(tmp_path, recorded):
    log = tmp_path / "second.log"
    # The log has the name of the channel.
    drive(tmp_path, "mdk-net", "--record", str(log), channel=recorded[1].parent.name)
    assert log.stat().st_size > 100_000
    assert log.read_bytes() == recorded[1].read_bytes()


def test_far_from_the_middle_of_its_speeds_a_network_drives_better_than_a_linear_model(tmp_path):
    """The effect of the steering depends on the speed; a linear model has one for all speeds."""
    network, linear = (
        drive(tmp_path, model, "--scenario", "lane_change_120") for model in ("mdk-net", "lti")
    )
    assert network["ey_rms_m"] <= 0.10
    assert network["ey_rms_m"] < linear["ey_rms_m"]


def test_in_real_time_the_car_runs_beside_the_controller(tmp_path):
    scenario = tmp_path / "short.toml"
    scenario.write_text(
        'format = 2\nname = "short"\nduration_s = 1.5\n[reference]\nspeed_kmh = 60.0\n'
    )
    # Deadlines are not tested here: a shared machine may stall longer than a vehicle's.
    options = ("--max-misses", "1000", "--scenario", str(scenario))
    figures = drive(tmp_path, "mdk-net-paper", *options, pace="realtime")
    assert figures["final_mode"] == "STANDBY"
    assert figures["ticks"] + figures["skipped_ticks"] >= 60
    assert figures["ey_peak_m"] <= 0.3
    assert figures["wake_us"]["max"] > 0.0


STEPS = WITH_ALL.history_steps
HALF_A_STEP_OF_THE_FRAMES = np.array([1e-6, 1e-6, 1e-6, 1.01e-5, 1.26e-3, 1.76e-4])


def made(folder, **more):
    bundle = make_bundle(WITH_ALL, rank=2, bend=0.02, **more)
    save_bundle(folder / "model", bundle, "# made for a test\n")
    return folder / "model"


@pytest.fixture
def model(tmp_path):
    return made(tmp_path)


@pytest.mark.parametrize("more", [{}, {"saturates": True, "drift": 2}])
def test_the_model_stays_on_its_path(tmp_path, more):
    model = made(tmp_path, **more)
    figures = drive(model.parent, model)
    assert figures["ey_peak_m"] <= 1.0
    assert figures["final_mode"] == "STANDBY"
    assert figures["model"].startswith("made")


def test_every_history_equals_the_rows_of_the_log(model, monkeypatch):
    shown = []
    lift = Encoder.lift

    def recorded_lift(encoder, state, curvature_per_m):
        assert encoder.history is not None
        shown.append(np.vstack([encoder.history, [*state[:3], *[np.nan] * 3]]))
        return lift(encoder, state, curvature_per_m)

    monkeypatch.setattr(Encoder, "lift", recorded_lift)
    monkeypatch.setattr(estimator, "GAIN", VehicleState(*[1.0] * 6))  # states as measured
    monkeypatch.setattr(steering_factor, "INFORMATION", np.inf)  # the wheel as applied
    log = model.parent / "drive.log"
    drive(model.parent, model, "--record", str(log))

    driven = rows_of(log)
    begun, over = span_of_the_mission(driven)
    compared = 0
    for rows in shown:
        (place,) = np.nonzero(np.all(np.abs(driven[:, :3] - rows[-1, :3]) < 1e-9, axis=1))
        # Repeated states, and those of self-test and warm-up, have no single row in the log.
        if len(place) == 1 and begun + STEPS <= place[0] <= over:
            expected = driven[place[0] - STEPS : place[0]]
            assert np.all(np.abs(rows[:-1] - expected) <= HALF_A_STEP_OF_THE_FRAMES)
            compared += 1
    assert compared > 300


def rows_of(log):
    """(T, 6): v_x, v_y, yaw rate of each instant, and the input applied until the next."""
    states = []
    applied = []
    for frame in can.LogReader(log):
        if frame.arbitration_id == STATE.codecs[0].arbitration_id:
            state = STATE.codecs[0].read(frame.data)
            assert state is not None
            states.append(state)
            applied.append((np.nan,) * 3)
        elif frame.arbitration_id == FEEDBACK.codecs[0].arbitration_id:
            feedback = decode_frames(FEEDBACK, frame.data)
            assert feedback is not None
            if len(applied) > 1:  # the car waits with the input that keeps its bend
                applied[-2] = feedback  # sent together with the state at the end of its period
    return np.hstack([np.array(states), np.array(applied)])


def span_of_the_mission(driven):
    """First row with an applied command, and the last one: the log ends with the mission."""
    begun, over = np.flatnonzero(np.isfinite(driven[:, 3]))[[0, -1]]
    return int(begun), int(over)


RIGS = Path(__file__).parents[1] / "rigs"
PERIOD_S = 0.020


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    target = tmp_path_factory.mktemp("period")
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, RIGS / "drive_at_20_ms.py", target]
    ended = subprocess.run(
        command, capture_output=True, text=True, check=False, env=environment, timeout=300
    )
    assert ended.returncode == 0, ended.stderr
    return target


def test_a_linear_model_of_20_ms_stays_on_its_path(folder):
    figures = json.loads((folder / "summary.json").read_text())
    assert figures["final_mode"] == "STANDBY"
    assert figures["ey_rms_m"] <= 0.2
    assert figures["ey_peak_m"] <= 0.4


def test_every_message_is_sent_at_the_cycle_time_of_the_generated_dbc(folder):
    catalogue = cantools.database.load_file(folder / "messages.dbc")
    stamps = {}
    for message in can.CanutilsLogReader(folder / "drive.log"):
        stamps.setdefault(message.arbitration_id, []).append(message.timestamp)
    for message in catalogue.messages:
        times = stamps.get(message.frame_id, [])
        assert len(times) > 3, f"{message.name}: expected a call that sends it every cycle time"
        cycle_s = (times[-2] - times[1]) / (len(times) - 3)
        assert cycle_s == pytest.approx(message.cycle_time / 1e3, abs=1e-6), message.name
    assert catalogue.get_message_by_name("ACT_CMD").cycle_time == 1e3 * PERIOD_S
    assert catalogue.get_message_by_name("MISSION").cycle_time == 100
