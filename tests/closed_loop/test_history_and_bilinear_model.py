"""A model with curvature, history and a bilinear input matrix drives the car.

The history that it gets is that of the log: each state, with the input applied from it.
"""

from collections.abc import Callable
from pathlib import Path

import can
import numpy as np
import pytest
from made_frames import decode_frames
from made_models import WITH_ALL, make_bundle
from virtual_drive import drive

from rt_controller.bus.messages import FEEDBACK, STATE
from rt_controller.contract.signals import VehicleState
from rt_controller.control import estimator
from rt_controller.control.lift import Encoder
from rt_controller.model.artifact import save_bundle

STEPS = WITH_ALL.history_steps
HALF_A_STEP_OF_THE_FRAMES = np.array([1e-6, 1e-6, 1e-6, 1.01e-5, 1.26e-3, 1.76e-4])


def made(folder: Path, **more: int) -> Path:
    bundle = make_bundle(WITH_ALL, rank=2, bend=0.02, **more)
    save_bundle(folder / "model", bundle, "# made for a test\n")
    return folder / "model"


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return made(tmp_path)


@pytest.mark.parametrize("more", [{}, {"saturates": True, "drift": 2}])
def test_the_model_stays_on_its_path(tmp_path: Path, more: dict[str, int]) -> None:
    model = made(tmp_path, **more)
    figures = drive(model.parent, model)
    assert figures["ey_peak_m"] <= 1.0
    assert figures["final_mode"] == "STANDBY"
    assert figures["model"].startswith("made")


def test_every_history_equals_the_rows_of_the_log(
    model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[np.ndarray] = []
    lift: Callable[[Encoder, VehicleState, float], np.ndarray] = Encoder.lift

    def recorded_lift(encoder: Encoder, state: VehicleState, curvature_per_m: float) -> np.ndarray:
        assert encoder.history is not None
        shown.append(np.vstack([encoder.history, [*state[:3], *[np.nan] * 3]]))
        return lift(encoder, state, curvature_per_m)

    monkeypatch.setattr(Encoder, "lift", recorded_lift)
    monkeypatch.setattr(estimator, "GAIN", VehicleState(*[1.0] * 6))  # states as measured
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


def rows_of(log: Path) -> np.ndarray:
    """(T, 6): v_x, v_y, yaw rate of each instant, and the input applied until the next."""
    states: list[tuple[float, ...]] = []
    applied: list[tuple[float, ...]] = []
    for frame in can.LogReader(log):
        if frame.arbitration_id == STATE.codecs[0].arbitration_id:
            state = STATE.codecs[0].read(frame.data)
            assert state is not None
            states.append(state)
            applied.append((np.nan,) * 3)
        elif frame.arbitration_id == FEEDBACK.codecs[0].arbitration_id:
            feedback = decode_frames(FEEDBACK, frame.data)
            assert feedback is not None
            applied[-2] = feedback  # sent together with the state at the end of its period
    return np.hstack([np.array(states), np.array(applied)])


def span_of_the_mission(driven: np.ndarray) -> tuple[int, int]:
    """First row with an applied command, and the last one: the log ends with the mission."""
    begun, over = np.flatnonzero(np.isfinite(driven[:, 3]))[[0, -1]]
    return int(begun), int(over)
