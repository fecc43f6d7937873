"""How a drive of the bridge ends: mission over, controller silent, bus lost, braked by itself."""

from collections.abc import Iterator

import can
import pytest
from bridge_rig import CRUISE, BridgeRig, open_bridge

from rt_controller.bus.messages import FEEDBACK, MISSION
from rt_controller.contract.errors import BusError
from rt_controller.contract.limits import MOST_BRAKE_N
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.bridge import END_TICKS, LONGEST_END_TICKS
from sim_bridge.car_guard import FAILED_TICKS
from sim_bridge.scenario import load_scenario
from sim_bridge.scenario_run import AT_REST_MPS


@pytest.fixture
def rig() -> Iterator[BridgeRig]:
    with open_bridge() as rig:
        yield rig


def test_a_silent_controller_ends_in_a_standing_car(rig: BridgeRig) -> None:
    for _ in range(10):
        rig.tick()
    for _ in range(3):
        assert not rig.tick(control=None).is_watchdog_braking
    assert rig.tick(control=None).is_watchdog_braking
    while not rig.bridge.is_over:
        rig.tick(control=None)
        if not rig.newest(MISSION).is_engaged:
            assert rig.newest(FEEDBACK).brake_n > 0.0
    assert rig.bridge.summary().watchdog_braked
    assert rig.bridge.summary().braking_cause == "NO_COMMAND"
    assert rig.bridge.summary().final_speed_mps < 0.5
    assert rig.newest(FEEDBACK).brake_n == pytest.approx(MOST_BRAKE_N, abs=0.01)


@pytest.mark.parametrize("is_crash", [True, False])
def test_silence_after_a_stopped_car_is_the_end_of_a_drive_and_not_after_a_crash(
    rig: BridgeRig, is_crash: bool
) -> None:
    """A controller that crashes sends one last command with the mode SAFE_STOP too."""
    stop = ControlInput(0.0, 100.0, 0.0)
    sample = rig.tick()
    rig.tick(stop, Mode.SAFE_STOP)
    while not is_crash and sample.state.vx_mps > AT_REST_MPS:
        sample = rig.tick(stop, Mode.SAFE_STOP)
    while not rig.bridge.is_over:
        rig.tick(control=None)
    assert rig.bridge.summary().watchdog_braked
    assert rig.bridge.summary().controller_ended is not is_crash


def test_a_safe_stop_that_outlasts_the_scenario_brings_the_car_to_rest(rig: BridgeRig) -> None:
    ticks = load_scenario("straight").ticks
    braking = ControlInput(0.0, 75.0, 0.0)
    for _ in range(ticks - 20):
        rig.tick()
    for _ in range(20 * round(1 / PERIOD_S)):
        rig.tick(braking, Mode.SAFE_STOP)
        if rig.bridge.is_over:
            break
        if rig.newest(MISSION).is_engaged and rig.bridge.applied.throttle == 0.0:
            assert rig.newest(FEEDBACK).brake_n == braking.brake_n
    assert rig.bridge.is_over
    assert rig.bridge.summary().ticks > ticks + END_TICKS
    assert rig.bridge.summary().final_speed_mps < AT_REST_MPS


@pytest.mark.parametrize("ended_after", [None, 10])
def test_the_end_of_the_mission_is_sent_before_the_bridge_leaves(
    rig: BridgeRig, ended_after: int | None
) -> None:
    """It leaves later if the controller drives on: the mission may take long on its way."""
    ticks = 0
    while not rig.bridge.is_over:
        if ticks == ended_after:
            rig.bridge.end_mission()
        rig.tick()
        ticks += 1
    # The first command arrives a period later; a request ends the mission with the next tick.
    last = load_scenario("straight").ticks if ended_after is None else ended_after
    assert ticks == last + LONGEST_END_TICKS
    assert not rig.newest(MISSION).is_engaged
    assert not rig.bridge.summary().watchdog_braked


@pytest.mark.parametrize(
    ("steer_rad", "is_open", "cause", "text"),
    [
        (0.2, False, "LEAVING_PATH", "the car was about to leave its path"),
        (0.0, True, "ACTUATOR_FAILED", "the throttle stays open"),
    ],
)
def test_the_summary_names_the_cause_of_the_braking_and_the_actuator_that_failed(
    rig: BridgeRig, steer_rad: float, is_open: bool, cause: str, text: str
) -> None:
    rig.tick()
    assert rig.bridge.summary().braking_cause is None
    for _ in range(FAILED_TICKS * is_open):
        rig.bridge._actuators.note(CRUISE, CRUISE._replace(throttle=1.0))
    while not rig.bridge.summary().watchdog_braked:
        rig.tick(ControlInput(0.1, 0.0, steer_rad))
    summary = rig.bridge.summary()
    assert (summary.braking_cause, summary.braking_text) == (cause, text)
    assert summary.failed_actuators == (("THROTTLE",) if is_open else ())


def test_a_car_is_released_by_standby_after_the_end_of_the_mission(rig: BridgeRig) -> None:
    for _ in range(3):
        rig.tick()
    rig.bridge.end_mission()
    rig.tick()
    assert not rig.bridge.summary().released
    for _ in range(2):  # the command arrives a period later
        rig.tick(NEUTRAL_INPUT, Mode.STANDBY)
    assert rig.bridge.summary().released


def _unplug(*_: object, **__: object) -> None:
    raise can.CanOperationError("unplugged")


def test_a_bus_that_cannot_be_read_ends_the_bridge_before_the_drive(
    rig: BridgeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig.tick(control=None)
    monkeypatch.setattr(rig.bus, "recv", _unplug)
    with pytest.raises(BusError, match="unplugged"):
        rig.tick(control=None)


def test_a_car_whose_bus_fails_is_braked_to_rest(
    rig: BridgeRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    for _ in range(10):
        rig.tick()
    monkeypatch.setattr(rig.bus, "recv", _unplug)
    for _ in range(1000):
        if not rig.bridge.is_over:
            rig.tick()
    summary = rig.bridge.summary()
    assert rig.bridge.is_over
    assert summary.watchdog_braked
    assert summary.final_speed_mps < AT_REST_MPS
    with pytest.raises(BusError, match="unplugged"):
        rig.bridge.require_readable_bus()
