"""A model that is shown road and past, and whose input matrix follows psi_0, drives the car.

And what it is shown is what the log says: each state, with what the actuators did from there on.
"""

import json
from collections.abc import Callable
from pathlib import Path

import can
import numpy as np
import pytest
from made_models import WITH_ALL, make_bundle

from rt_controller.bus.frames import ACT_FB, STATE_A, decode_feedback, decode_state_a
from rt_controller.cli import app
from rt_controller.contract.artifact import save_bundle
from rt_controller.contract.signals import VehicleState
from rt_controller.control.lift import Encoder

STEPS = WITH_ALL.history_steps
HALF_A_STEP_OF_THE_FRAMES = np.array([1e-6, 1e-6, 1e-6, 1.01e-5, 1.26e-3, 3.5e-5])


@pytest.fixture
def model(tmp_path: Path) -> Path:
    save_bundle(tmp_path / "model", make_bundle(WITH_ALL, rank=2, bend=0.1), "# made for a test\n")
    return tmp_path / "model"


def drive(model: Path, *options: str) -> int:
    command = f"--bus virtual --pace lockstep --quiet --channel {model.parent.name}"
    with pytest.raises(SystemExit) as ended:
        app.meta([*command.split(), "--model", str(model), *options])
    assert isinstance(ended.value.code, int)
    return ended.value.code


def test_it_stays_on_its_path(model: Path) -> None:
    summary = model.parent / "summary.json"
    assert drive(model, "--json", str(summary)) == 0
    figures = json.loads(summary.read_text())
    assert figures["ey_peak_m"] <= 1.0
    assert figures["final_mode"] == "STANDBY"
    assert figures["model"].startswith("made")


def test_every_history_is_the_one_in_the_log(model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[np.ndarray] = []
    lift: Callable[[Encoder, VehicleState, float], np.ndarray] = Encoder.lift

    def watched(encoder: Encoder, state: VehicleState, curvature_per_m: float) -> np.ndarray:
        assert encoder.history is not None
        shown.append(np.vstack([encoder.history, [*state[:3], *[np.nan] * 3]]))
        return lift(encoder, state, curvature_per_m)

    monkeypatch.setattr(Encoder, "lift", watched)
    log = model.parent / "drive.log"
    assert drive(model, "--record", str(log)) == 0

    driven = rows_of(log)
    begun, over = span_of_the_mission(driven)
    compared = 0
    for rows in shown:
        (place,) = np.nonzero(np.all(driven[:, :3] == rows[-1, :3], axis=1))
        # States that came twice, and those of self-test and warm-up, have no one place in the log.
        if len(place) == 1 and begun + STEPS <= place[0] <= over:
            expected = driven[place[0] - STEPS : place[0]]
            assert np.all(np.abs(rows[:-1] - expected) <= HALF_A_STEP_OF_THE_FRAMES)
            compared += 1
    assert compared > 300


def rows_of(log: Path) -> np.ndarray:
    """(T, 6): v_x, v_y, yaw rate of each instant, and what the actuators did until the next."""
    states: list[tuple[float, ...]] = []
    applied: list[tuple[float, ...]] = []
    for frame in can.LogReader(log):
        if frame.arbitration_id == STATE_A.arbitration_id:
            state = decode_state_a(frame.data)
            assert state is not None
            states.append(state)
            applied.append((np.nan,) * 3)
        elif frame.arbitration_id == ACT_FB.arbitration_id:
            feedback = decode_feedback(frame.data)
            assert feedback is not None
            applied[-2] = feedback  # told together with the state that it led to
    return np.hstack([np.array(states), np.array(applied)])


def span_of_the_mission(driven: np.ndarray) -> tuple[int, int]:
    """First instant that a command acted from, and the one at which a driver took the car."""
    begun = int(np.flatnonzero(np.isfinite(driven[:, 3]))[0])
    hands_off = np.all(driven[begun:, 3:] == 0.0, axis=1)
    return begun, begun + int(np.flatnonzero(hands_off)[0])
