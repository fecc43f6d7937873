"""Faults that a scenario begins with: the drive ends, whatever is wrong from the first tick on."""

from contextlib import closing

import pytest

from rt_controller import simulate
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.loop import Ending
from rt_controller.settings import BusSettings
from sim_bridge.faults.fault import SHORTHANDS
from sim_bridge.scenario import parse_scenario
from sim_bridge.session import open_session

PARTS = {
    "state_offset": {"signal": "ey_m", "value": 0.1},
    "state_noise": {"signal": "ey_m", "value": 0.1},
    "state_delayed": {"delay_s": 0.05},
}
SPEED_KMH = 40.0
"""above that of the low-speed law, so the mode of a normal drive is NOMINAL"""
SAFE_STOPS = {"state_lost", "state_invalid", "reference_lost", "command_lost"}


@pytest.mark.parametrize("kind", list(SHORTHANDS))
def test_a_drive_with_a_fault_from_its_first_tick_ends(kind: str) -> None:
    fault = {"kind": kind, "start_s": 0.0, "duration_s": 0.2, **PARTS.get(kind, {})}
    content = {
        "format": 2, "name": "x", "duration_s": 1.5, "reference": {"speed_kmh": SPEED_KMH},
        "faults": [fault],
    }  # fmt: skip
    drive = simulate(parse_scenario(content, "test"), model="lti")
    expected = Ending.SAFE_STOPPED if kind in SAFE_STOPS else Ending.MISSION_OVER
    assert drive.ending == expected.value
    assert Mode.NOMINAL in drive.modes


def test_simulated_time_does_not_wait_without_end_for_a_controller() -> None:
    bus = BusSettings(bus="virtual", channel="no-controller")
    with closing(open_session(bus, "straight")) as session:
        session.tick(PERIOD_NS)
        with pytest.raises(BusError, match="stays in STANDBY"):
            session.tick(11_000_000_000)
