"""A single-track car with tyres that saturate, fitted to 72 s of driving.

`python -m benchmarks.rivals.bicycle_fit` drives, fits and writes `bicycle.json`. The equations are
of Rajamani, *Vehicle Dynamics and Control* (2012), chapter 2 (motion along a road); the side force
is an arctangent of the slip angle. Lags, roll and relaxation are left out, as usual in nonlinear
MPC. Wheelbase, axles and steering ratio are those of the car.

All functions compute with numbers and with arrays. Derivatives are exact: an imaginary part of
1e-30 is carried through the equations (complex-step differentiation).
"""

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.car import DEFAULT_CAR
from rt_controller.contract.limits import DEFAULT_GEOMETRY, INPUT_LIMITS, PLAN_STEER_RAD
from rt_controller.contract.signals import AT_REST, GRAVITY_MPS2, N_INPUTS, N_STATES, ControlInput
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.bundle import Bundle

FILE = Path(__file__).with_name("bicycle.json")
_SLOWEST_MPS = 1.0
_CARRIER_MPS = 15.0
IMAGINARY = 1e-30
"""step of the differentiation"""
Values = Sequence[Any]
"""numbers, or arrays of one shape"""


class Parameters(NamedTuple):
    """What is fitted; forces are per mass. The defaults are where the fit begins."""

    gyration_m2: float = 1.8
    """yaw inertia"""
    stiffness_front_per_rad: float = 12.0
    """cornering stiffness in units of the axle's load"""
    stiffness_rear_per_rad: float = 14.0
    friction_front: float = 1.0
    """largest side force in units of the axle's load"""
    friction_rear: float = 1.0
    drive_mps2: float = 4.5
    """of the full throttle at low speed"""
    throttle_shape: float = 1.0
    """smaller: the first half of the throttle has more of the effect"""
    power_w_per_kg: float = 50.0
    """of the full throttle at high speed"""
    brake_mps2_per_n: float = 0.06
    rolling_mps2: float = 0.2
    drag_per_m: float = 3e-4

    @classmethod
    def load(cls) -> "Parameters":
        """Those of `bicycle.json`."""
        return cls(**json.loads(FILE.read_text(encoding="utf-8"))["parameters"])

    def full_throttle_mps2(self, speed_mps: Any) -> Any:
        """Acceleration of the full throttle: power limits it at speed; smooth in between."""
        share = speed_mps * self.drive_mps2 / self.power_w_per_kg
        return self.drive_mps2 / (1.0 + share**2) ** 0.5

    def throttle_for(self, share: float) -> float:
        """Throttle that has this share of the effect of the full one; 0 to 1."""
        effect = min(max(share, 0.0), 1.0)
        return self.throttle_shape * effect / (1.0 + self.throttle_shape - effect)


def _rates(x: Values, u: Values, curvature_per_m: Any, car: Parameters) -> tuple[Any, ...]:
    """d/dt of a `VehicleState`, of Δs the rate of progress, under a `ControlInput`."""
    vx, vy, yaw_rate, _, ey, epsi = x
    throttle, brake_n, steer_rad = u
    maths: Any = math if isinstance(vx, float) else np
    speed = max(vx, _SLOWEST_MPS) if maths is math else np.where(vx.real > _SLOWEST_MPS, vx, 1.0)
    wheelbase_m, rear_m, ratio, _ = DEFAULT_GEOMETRY
    front_m, wheel = wheelbase_m - rear_m, steer_rad / ratio

    def grip(slip: Any, stiffness: Any, friction: Any) -> Any:
        return friction * 2.0 / math.pi * maths.atan(0.5 * math.pi * stiffness / friction * slip)

    front_slip = wheel - (vy + front_m * yaw_rate) / speed
    rear_slip = (rear_m * yaw_rate - vy) / speed
    per_m = GRAVITY_MPS2 / wheelbase_m
    front = per_m * rear_m * grip(front_slip, car.stiffness_front_per_rad, car.friction_front)
    rear = per_m * front_m * grip(rear_slip, car.stiffness_rear_per_rad, car.friction_rear)
    effect = throttle * (1.0 + car.throttle_shape) / (throttle + car.throttle_shape)
    along = effect * car.full_throttle_mps2(speed) - car.brake_mps2_per_n * brake_n
    along = along - car.rolling_mps2 - car.drag_per_m * vx**2
    progress = (vx * maths.cos(epsi) - vy * maths.sin(epsi)) / (1.0 - ey * curvature_per_m)
    return (
        along - front * maths.sin(wheel) + yaw_rate * vy,
        front * maths.cos(wheel) + rear - yaw_rate * vx,
        (front_m * front * maths.cos(wheel) - rear_m * rear) / car.gyration_m2,
        progress,
        vx * maths.sin(epsi) + vy * maths.cos(epsi),
        yaw_rate - curvature_per_m * progress,
    )


def advance(x: Values, u: Values, curvature_per_m: Any, car: Parameters) -> tuple[Any, ...]:
    """The `VehicleState` after one period, by a Runge-Kutta step."""
    vx, vy, yaw_rate, _, ey, epsi = x
    start = (vx, vy, yaw_rate, 0.0 * vx, ey, epsi)  # progress is that of one period

    def moved(rates: Values, time_s: float) -> list[Any]:
        return [value + time_s * rate for value, rate in zip(start, rates, strict=True)]

    a = _rates(start, u, curvature_per_m, car)
    b = _rates(moved(a, 0.5 * PERIOD_S), u, curvature_per_m, car)
    c = _rates(moved(b, 0.5 * PERIOD_S), u, curvature_per_m, car)
    d = _rates(moved(c, PERIOD_S), u, curvature_per_m, car)
    mean = [(p + 2.0 * q + 2.0 * r + s) / 6.0 for p, q, r, s in zip(a, b, c, d, strict=True)]
    return tuple(moved(mean, PERIOD_S))


class Bicycle:
    """The fitted car: prediction, and derivatives along one."""

    def __init__(self) -> None:
        self.parameters = Parameters.load()

    def step(self, x: Array, control: ControlInput, curvature_per_m: float) -> Array:
        """States (..., 6) one period after x (..., 6)."""
        states = tuple(np.moveaxis(x, -1, 0))
        return np.stack(advance(states, control, curvature_per_m, self.parameters), axis=-1)

    def predict(self, x: Sequence[float], inputs: Array, curvature_per_m: float) -> Array:
        """States (N + 1, 6) under inputs (N, 3), x (6,) first."""
        states = [tuple(map(float, x))]
        for u in inputs.tolist():
            states.append(advance(states[-1], u, curvature_per_m, self.parameters))
        return np.array(states)

    def derivatives(self, states: Array, inputs: Array, curvature_per_m: float) -> Array:
        """(N, 6, 10) of the following state by states (N, 6), inputs (N, 3) and curvature."""
        columns = np.column_stack([states, inputs, np.full(len(states), curvature_per_m)])
        moved = columns.T[:, :, None] + IMAGINARY * 1j * np.eye(columns.shape[1])[:, None]
        x, u, kappa = moved[:N_STATES], moved[N_STATES:-1], moved[-1]
        after = np.stack(advance(x, u, kappa, self.parameters))
        return np.asarray(after.imag.transpose(1, 0, 2) / IMAGINARY)

    def bundle(self) -> Bundle:
        """The car linearised at 15 m/s: pedal gains at low speed, and the interface of `Mpc`.

        Its wheel has the bounds of the plans of learned models.
        """
        state, at_rest = AT_REST._replace(vx_mps=_CARRIER_MPS), np.zeros((1, N_INPUTS))
        derivatives = self.derivatives(np.array([state]), at_rest, 0.0)[0]
        A, B_uc, B_uw = np.split(derivatives, [N_STATES, N_STATES + N_INPUTS], axis=1)
        following = self.predict(state, at_rest, 0.0)[1]
        linear = Bundle.linear(A, B_uc, B_uw, following - A @ np.array(state), name="bicycle")
        wide = INPUT_LIMITS.with_wheel(PLAN_STEER_RAD)
        signal_range = np.array([(*wide.lower, -inf), (*wide.upper, inf)])
        return replace(linear, signal_range=signal_range, car=DEFAULT_CAR)
