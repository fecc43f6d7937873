"""Lateral speed from yaw rate and speed, for a car that does not measure it.

At the rear axle the side-slip angle is the lateral force over the cornering stiffness, and by the
balance of moments that force follows from lateral acceleration and yaw acceleration:

    v_y = b r - tau v_x (dv_y/dt + r v_x) + tau q v_x dr/dt

with b the distance from the centre of gravity to the rear axle, tau = m a / (L C_r) and
q = I_z / (m a). With v_y = z + q r no derivative of the yaw rate is needed:

    tau v_x dz/dt = (b - q - tau v_x^2) r - z

Steering and front tyres do not occur, so an offset of the steering wheel has no effect. tau and q
are identified from the learned model; decision 049 compares the error with other estimators.
"""

from math import exp, isfinite, nan, pi
from typing import NamedTuple

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
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Step

SLOWEST_MPS = 1.0
"""the equation has no solution at rest; below, v_y is that of rolling: b r"""
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


class RearAxle(NamedTuple):
    """The constants of the equation above."""

    rear_axle_m: float
    """b"""
    slip_s2_per_m: float
    """tau: side-slip angle of the rear axle per lateral acceleration"""
    inertia_m: float
    """q"""


class LateralSpeed:
    """Estimates v_y once a period; nothing is allocated."""

    def __init__(self, rear_axle: RearAxle) -> None:
        self.rear_axle = rear_axle
        self._z: float | None = None
        self._yaw_rate_radps = 0.0

    def forget(self) -> None:
        """The next period does not follow on the last one."""
        self._z = None

    def update(self, vx_mps: float, yaw_rate_radps: float) -> float:
        """v_y in m/s of a period; NaN if a value is.

        The first one assumes a steady turn; the assumption decays with tau v_x, 0.1 s at 20 m/s.
        """
        b, tau, q = self.rear_axle
        if not (isfinite(vx_mps) and isfinite(yaw_rate_radps)):
            self.forget()
            return nan
        if vx_mps < SLOWEST_MPS or tau <= 0.0:
            self.forget()
            return b * yaw_rate_radps if vx_mps > 0.0 else 0.0
        if self._z is None:
            self._z = (b - q - tau * vx_mps**2) * yaw_rate_radps
        else:
            mean_radps = 0.5 * (self._yaw_rate_radps + yaw_rate_radps)
            target = (b - q - tau * vx_mps**2) * mean_radps
            self._z = target + (self._z - target) * exp(-PERIOD_S / (tau * vx_mps))
        self._yaw_rate_radps = yaw_rate_radps
        return self._z + q * yaw_rate_radps


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
    """That of the mapping, else that of the model, else an unnamed one."""
    data = car.mapping.car
    return data.car if data is not None else bundle.car or UNNAMED_CAR


def choose_lateral_speed(car: CarFile, bundle: Bundle) -> LateralSpeed:
    """The estimator with the constants of the mapping, else with those of the model.

    It is not used if the car measures v_y.
    """
    data, geometry = car.mapping.car, choose_car(car, bundle).geometry
    rear_m = geometry.rear_axle_m
    if "vy_mps" in car.mapping.states:
        return LateralSpeed(RearAxle(rear_m, 0.0, 0.0))
    if data is not None and data.rear_slip_s2_per_m is not None:
        inertia_m = rear_m if data.yaw_inertia_m is None else data.yaw_inertia_m
        return LateralSpeed(RearAxle(rear_m, data.rear_slip_s2_per_m, inertia_m))
    return LateralSpeed(identify(bundle, geometry))
