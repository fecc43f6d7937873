"""A closed-loop drive in simulated time on a virtual bus."""

from rt_controller.car_settings import CarSettings
from rt_controller.config import BusSettings, ControllerConfig, Pace, RealtimeSettings
from rt_controller.contract.bundle import Bundle
from rt_controller.control.mpc import Mpc
from rt_controller.planner import Planner, warm_up
from rt_controller.session import open_session
from rt_controller.tracking import TrackingErrors
from rt_controller.virtual_car import build_virtual_car


def default_config() -> ControllerConfig:
    """The shipped settings, on a bus of its own and without real-time priority."""
    return ControllerConfig(
        bus=BusSettings(channel="benchmarks"), realtime=RealtimeSettings(priority=0)
    )


def drive_in_lockstep(
    config: ControllerConfig, bundle: Bundle, mpc: Mpc, scenario: str
) -> TrackingErrors:
    """Tracking errors of a whole scenario, driven with `mpc`."""
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
