"""A drive in simulated time, on a virtual bus, with whatever plans in the controller's place."""

from rt_controller.config import BusSettings, CarSettings, ControllerConfig, Pace, RealtimeSettings
from rt_controller.contract.bundle import Bundle
from rt_controller.control.mpc import Mpc
from rt_controller.session import Planner, open_session, warm_up
from rt_controller.tracking import TrackingErrors
from rt_controller.virtual_car import build_virtual_car


def plain_config() -> ControllerConfig:
    """The controller as it ships, on a bus of its own, without a claim to the machine."""
    return ControllerConfig(
        bus=BusSettings(channel="benchmarks"), realtime=RealtimeSettings(priority=0)
    )


def drive(config: ControllerConfig, bundle: Bundle, mpc: Mpc, scenario: str) -> TrackingErrors:
    """The whole scenario; how well the car followed it."""
    warm_up(mpc)
    car = build_virtual_car(config.bus, CarSettings(scenario=scenario))
    try:
        session = open_session(config, Planner(bundle, mpc), car.clock(Pace.LOCKSTEP), None, True)
        try:
            session.start(None, False, 10.0).join()
        finally:
            session.close()
        if session.failure is not None:
            raise session.failure
    finally:
        car.close()
    return session.record.tracking.errors()
