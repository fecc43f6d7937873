"""A simulated drive as a function: scenario, plant and model in, table of the drive out."""

from itertools import count
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from rt_controller.car_settings import CarSettings
from rt_controller.config import BusSettings, ControllerConfig, Pace
from rt_controller.contract.bundle import Bundle
from rt_controller.contract.errors import ConfigError, PlantError
from rt_controller.drive import Drive
from rt_controller.planner import build_planner
from rt_controller.session import open_session
from rt_controller.virtual_car import build_virtual_car

if TYPE_CHECKING:
    from sim_bridge.plant.protocol import Plant

_LONGEST_WAIT_S = 10.0
_numbers = count()


def simulate(
    scenario: str | Path = "double_lane_change",
    *,
    model: str | Path | Bundle | None = None,
    plant: "str | Plant" = "own",
    car: str | Path | None = None,
    friction: float | None = None,
    config: ControllerConfig | None = None,
    duration_s: float | None = None,
) -> Drive:
    """Drive a scenario with a simulated car, in simulated time, over a virtual CAN bus.

    The controller is the one of `rt-controller`, with its frames, checks and modes. The same
    arguments give the same drive on every machine.

    Args:
        scenario: name of a shipped scenario, or path of a .toml file.
        model: name of a shipped model, folder of a bundle, or a `Bundle`; default: mdk-net.
        plant: "own", "fmu:FILE.fmu", "commonroad:NUMBER", or an object that implements `Plant`.
        car: parameters of the own car: a shipped name, or path of a .toml file.
        friction: of the road; default: the scenario's.
        config: settings of the controller; `model` overrides its model.
        duration_s: bring the car to rest after this time; default: the scenario's end.

    Raises:
        ConfigError: scenario, plant, car or settings are refused.
        ArtifactError: the model does not fit.
        MissingExtraError: the extra `sim`, or one that the plant needs, is not installed.
        PlantError: the plant failed during the drive.
    """
    if duration_s is not None and not 0.0 < duration_s < inf:
        raise ConfigError(f"duration_s: expected a finite time above 0 s, found {duration_s}.")
    settings = (config or ControllerConfig()).model_copy(
        update={"bus": BusSettings(channel=f"simulate-{next(_numbers)}")}
    )
    settings = settings.model_copy(
        update={"realtime": settings.realtime.model_copy(update={"priority": 0})}
    )
    bundle = model if isinstance(model, Bundle) else Bundle.load(model or settings.model)
    planner = build_planner(bundle, settings.mpc)
    car_settings = CarSettings(
        scenario=str(scenario),
        plant=plant if isinstance(plant, str) else "own",
        car=None if car is None else str(car),
        friction=friction,
    )
    virtual = build_virtual_car(
        settings.bus, car_settings, None if isinstance(plant, str) else plant
    )
    try:
        session = open_session(settings, planner, virtual.clock(Pace.LOCKSTEP), None, True)
        try:
            with threadpool_limits(1, user_api="blas"):
                session.start(duration_s, False, _LONGEST_WAIT_S).join()
        finally:
            session.close()
    finally:
        virtual.close()
    if session.failure is not None:
        raise session.failure
    if virtual.plant_failure is not None:
        raise PlantError(f"The plant failed during the drive: {virtual.plant_failure}.")
    return session.drive()
