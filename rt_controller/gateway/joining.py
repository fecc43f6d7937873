"""From a mapping file and a model to a bus with the messages of the contract."""

from collections.abc import Callable
from pathlib import Path

import can

from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.steering_geometry import DEFAULT_GEOMETRY, SteeringGeometry
from rt_controller.gateway.lateral_speed import LateralSpeed, RearAxle, identify
from rt_controller.gateway.signal_bus import SignalBus
from rt_controller.mapping.car_file import CarFile, read_car


def join_car(
    bus: can.BusABC,
    signals: Path,
    bundle: Bundle,
    now_ns: Callable[[], int],
    *,
    has_wall_clock: bool,
) -> SignalBus:
    """A `SignalBus` over the car's bus, by its mapping file.

    Raises:
        ConfigError, DatasetError, MissingExtraError: see `read_car`, `CarEnd` and `identify`.
    """
    car = read_car(signals)
    lateral_speed = choose_lateral_speed(car, bundle)
    return SignalBus(bus, car, lateral_speed, now_ns, has_wall_clock=has_wall_clock)


def choose_geometry(car: CarFile, bundle: Bundle) -> SteeringGeometry:
    """That of the mapping, else that of the model, else that of the default car."""
    data = car.mapping.car
    return data.geometry if data is not None else bundle.geometry or DEFAULT_GEOMETRY


def choose_lateral_speed(car: CarFile, bundle: Bundle) -> LateralSpeed:
    """The estimator with the constants of the mapping, else with those of the model.

    It is not used if the car measures v_y.
    """
    data, geometry = car.mapping.car, choose_geometry(car, bundle)
    if "vy_mps" in car.mapping.states:
        return LateralSpeed(RearAxle(geometry.rear_axle_m, 0.0, 0.0))
    if data is not None and data.rear_slip_s2_per_m is not None:
        inertia_m = geometry.rear_axle_m if data.yaw_inertia_m is None else data.yaw_inertia_m
        constants = RearAxle(geometry.rear_axle_m, data.rear_slip_s2_per_m, inertia_m)
        return LateralSpeed(constants)
    return LateralSpeed(identify(bundle, geometry))
