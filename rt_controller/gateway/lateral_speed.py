"""The constants with which the gateway estimates a lateral speed that the car does not measure.

They are those of the mapping, else those of the model's car, else identified from roll-outs of the
learned model; decision 049 compares the error with other estimators.
"""

from dataclasses import replace
from math import pi

import numpy as np
from scipy.optimize import least_squares

from rt_controller.contract.arrays import Array
from rt_controller.contract.car import UNNAMED_CAR, Car
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import SteeringGeometry
from rt_controller.contract.signals import N_STATES, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.lift import Encoder
from rt_controller.mapping.car_file import CarFile
from rt_controller.mapping.lateral_speed import LateralSpeed, RearAxle
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Step

_SPEEDS_MPS = (12.0, 20.0, 28.0, 35.0)
_FREQUENCIES_HZ = (0.5, 1.0)
_STEPS = 60
_WHEEL_AT_ROAD_RAD = 0.013
"""amplitude of the front wheels at 12 m/s; less at higher speed, for 1.5 m/s^2"""
_THROTTLE = 0.1
_FIRST_GUESS = (4e-3, 1.0)
LARGEST_MISFIT = 0.3
"""of v_y between the equation and the model, as a share; the shipped lifted models have 0.1"""
_BOUNDS = ((5e-4, 0.0), (0.03, 5.0))


def identify(bundle: Bundle, geometry: SteeringGeometry) -> RearAxle:
    """tau and q of the car that the model has learned, from roll-outs of the model.

    Sines of the steering wheel at several speeds, with lateral accelerations below 2 m/s^2; the
    constants whose v_y is nearest to that of the model, by least squares.

    Raises:
        ArtifactError: the encoder of the bundle cannot be loaded.
        ConfigError: the model is linear in the states, or its lateral speed is not that of a car.
    """
    if bundle.n_observables == N_STATES:
        raise _no_constants(f"{bundle.name}, which is linear over all speeds")
    drives = _roll_outs(bundle, geometry.steering_ratio)

    def errors(constants: Array) -> Array:
        differences = []
        for drive in drives:
            estimator = LateralSpeed(RearAxle(geometry.rear_axle_m, *constants.tolist()))
            for vx_mps, vy_mps, yaw_rate_radps in drive[:, :3].tolist():
                differences.append(estimator.update(vx_mps, yaw_rate_radps) - vy_mps)
        return np.array(differences)

    fit = least_squares(errors, _FIRST_GUESS, x_scale=(1e-3, 1.0), bounds=_BOUNDS)
    size = np.linalg.norm(np.concatenate([drive[:, 1] for drive in drives]))
    if not np.linalg.norm(fit.fun) < LARGEST_MISFIT * size:
        share = float(np.linalg.norm(fit.fun) / size)
        raise _no_constants(f"{bundle.name}, whose v_y differs by {100.0 * share:.0f} %")
    return RearAxle(geometry.rear_axle_m, *map(float, fit.x))


def _no_constants(found: str) -> ConfigError:
    return ConfigError(
        f"states: expected vy_mps, or a model from whose roll-outs v_y can be identified, found "
        f"{found}. Map vy_mps, or write [car] with rear_slip_s2_per_m and yaw_inertia_m, or choose "
        f"a lifted model."
    )


def _roll_outs(bundle: Bundle, steering_ratio: float) -> list[Array]:
    """States (K+1, 6) of the model in each sine."""
    encoder, step = Encoder(bundle), Step(bundle)
    drives = []
    for vx_mps in _SPEEDS_MPS:
        wheel_rad = _WHEEL_AT_ROAD_RAD * steering_ratio * (_SPEEDS_MPS[0] / vx_mps) ** 1.5
        for frequency_hz in _FREQUENCIES_HZ:
            if encoder.history is not None:
                encoder.history[:] = (vx_mps, 0.0, 0.0, _THROTTLE, 0.0, 0.0)
            start = VehicleState(vx_mps, 0.0, 0.0, vx_mps * PERIOD_S, 0.0, 0.0)
            psi = encoder.lift(start, 0.0).copy()
            states = [psi[: len(start)]]
            for k in range(_STEPS):
                steer_rad = wheel_rad * np.sin(2.0 * pi * frequency_hz * k * PERIOD_S)
                psi = step(psi, np.array([_THROTTLE, 0.0, steer_rad, 0.0, 1.0]))
                states.append(psi[: len(start)])
            drives.append(np.array(states))
    return drives


def choose_car(car: CarFile, bundle: Bundle) -> Car:
    """That of the mapping, else that of the model, else an unnamed one.

    Constants of the lateral speed that the mapping does not have are those of the model's car.
    """
    data, of_model = car.mapping.car, bundle.car or UNNAMED_CAR
    if data is None:
        return of_model
    if data.rear_slip_s2_per_m is not None or of_model.rear_slip_s2_per_m is None:
        return data.car
    return replace(
        data.car,
        rear_slip_s2_per_m=of_model.rear_slip_s2_per_m,
        yaw_inertia_m=of_model.yaw_inertia_m,
    )


def choose_lateral_speed(car: CarFile, bundle: Bundle) -> LateralSpeed:
    """The estimator with the constants of the car, else with those that its model has learned.

    It is not used if the car measures v_y.
    """
    own = choose_car(car, bundle)
    rear_m = own.rear_axle_m
    if "vy_mps" in car.mapping.states:
        return LateralSpeed(RearAxle(rear_m, 0.0, 0.0))
    if own.rear_slip_s2_per_m is not None:
        inertia_m = rear_m if own.yaw_inertia_m is None else own.yaw_inertia_m
        return LateralSpeed(RearAxle(rear_m, own.rear_slip_s2_per_m, inertia_m))
    return LateralSpeed(identify(bundle, own.geometry))
