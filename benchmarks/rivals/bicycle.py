"""A single-track car with tyres that saturate, fitted to 54 s of driving.

`python -m benchmarks.rivals.bicycle` drives, fits and writes `bicycle.json`. The equations are of
Rajamani, *Vehicle Dynamics and Control* (2012), chapter 2 (motion along a road); the side force
is an arctangent of the slip angle. Lags, roll and relaxation are left out, as usual in nonlinear
MPC. Wheelbase, axles and steering ratio are those of the car.
"""

import json
from dataclasses import replace
from functools import cache
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from benchmarks.rivals.scenarios import FIT
from rt_controller import simulate
from rt_controller.contract.arrays import Array
from rt_controller.contract.car import DEFAULT_CAR
from rt_controller.contract.figures import write_figures
from rt_controller.contract.limits import DEFAULT_GEOMETRY, INPUT_LIMITS, PLAN_STEER_RAD
from rt_controller.contract.signals import (
    AT_REST,
    GRAVITY_MPS2,
    N_INPUTS,
    N_STATES,
    ControlInput,
    StateColumn,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.bundle import Bundle

FILE = Path(__file__).with_name("bicycle.json")
COMMAND, DRIVER = "python -m benchmarks.rivals.bicycle", "mdk-net"
DELAY = 2
"""periods after which a command acts"""
_STEPS, _STRIDE = 20, 5
"""periods of a prediction in the fit, and from the begin of one to the next"""
_SLOWEST_MPS = 1.0
_ERRORS = np.array(VehicleState(0.1, 0.05, 0.01, 1.0, 0.02, 0.005))
"""errors that count the same in the fit; progress has no weight, since it follows from the speed"""
_OBSERVED = [c for c in StateColumn if c is not StateColumn.ds_m]
_CARRIER_MPS = 15.0


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


def _rates(x: ca.SX, u: ca.SX, curvature_per_m: ca.SX, car: Parameters) -> ca.SX:
    """d/dt of a `VehicleState` (6,), of Δs the rate of progress, under a `ControlInput` (3,)."""
    vx, vy, yaw_rate, _, ey, epsi = (x[i] for i in range(N_STATES))
    speed = ca.fmax(vx, _SLOWEST_MPS)
    wheelbase_m, rear_m, ratio, _ = DEFAULT_GEOMETRY
    front_m, wheel = wheelbase_m - rear_m, u[2] / ratio

    def grip(slip: ca.SX, stiffness: Any, friction: Any) -> ca.SX:
        return friction * 2.0 / np.pi * ca.atan(0.5 * np.pi * stiffness / friction * slip)

    front_slip = wheel - (vy + front_m * yaw_rate) / speed
    rear_slip = (rear_m * yaw_rate - vy) / speed
    per_m = GRAVITY_MPS2 / wheelbase_m
    front = per_m * rear_m * grip(front_slip, car.stiffness_front_per_rad, car.friction_front)
    rear = per_m * front_m * grip(rear_slip, car.stiffness_rear_per_rad, car.friction_rear)
    throttle = u[0] * (1.0 + car.throttle_shape) / (u[0] + car.throttle_shape)
    along = throttle * car.full_throttle_mps2(speed) - car.brake_mps2_per_n * u[1]
    along -= car.rolling_mps2 + car.drag_per_m * vx**2
    progress = (vx * ca.cos(epsi) - vy * ca.sin(epsi)) / (1.0 - ey * curvature_per_m)
    return ca.vertcat(
        along - front * ca.sin(wheel) + yaw_rate * vy,
        front * ca.cos(wheel) + rear - yaw_rate * vx,
        (front_m * front * ca.cos(wheel) - rear_m * rear) / car.gyration_m2,
        progress,
        vx * ca.sin(epsi) + vy * ca.cos(epsi),
        yaw_rate - curvature_per_m * progress,
    )


@cache
def step_function() -> ca.Function:
    """(x (6,), u (3,), curvature, parameters) -> x after one period, by a Runge-Kutta step."""
    x, u, kappa = ca.SX.sym("x", N_STATES), ca.SX.sym("u", N_INPUTS), ca.SX.sym("kappa")
    theta = ca.SX.sym("theta", len(Parameters._fields))
    car, h = Parameters(*ca.vertsplit(theta)), PERIOD_S
    start = ca.vertcat(x[:3], 0.0, x[4:])  # progress is that of one period
    a = _rates(start, u, kappa, car)
    b = _rates(start + 0.5 * h * a, u, kappa, car)
    c = _rates(start + 0.5 * h * b, u, kappa, car)
    d = _rates(start + h * c, u, kappa, car)
    after = start + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return ca.Function("step", [x, u, kappa, theta], [after])


class Bicycle:
    """The fitted car: prediction, and derivatives along one."""

    def __init__(self, horizon: int) -> None:
        self.parameters, self._horizon = Parameters.load(), horizon
        x, u, kappa = ca.SX.sym("x", N_STATES), ca.SX.sym("u", N_INPUTS), ca.SX.sym("kappa")
        after = step_function()(x, u, kappa, ca.DM(self.parameters))
        self._step = ca.Function("period", [x, u, kappa], [after])
        self._roll_out = self._step.mapaccum("roll_out", horizon)
        by_all = ca.jacobian(after, ca.vertcat(x, u, kappa))
        self._derivatives = ca.Function("derivatives", [x, u, kappa], [by_all]).map(horizon)

    def step(self, x: Array, u: Array, curvature_per_m: Array) -> Array:
        """States (batch, 6) one period after x (batch, 6), under u (batch, 3)."""
        return np.array(self._step(x.T, u.T, curvature_per_m.T)).T

    def predict(self, x: Array, inputs: Array, curvature_per_m: float) -> Array:
        """States (N + 1, 6) under inputs (N, 3), x (6,) first."""
        found = self._roll_out(x, inputs.T, curvature_per_m)
        return np.vstack([x, np.array(found).T])

    def derivatives(self, states: Array, inputs: Array, curvature_per_m: float) -> Array:
        """(N, 6, 10) of the following state by states (N, 6), inputs (N, 3) and curvature."""
        found = np.array(self._derivatives(states.T, inputs.T, curvature_per_m))
        return found.reshape(N_STATES, len(states), -1).transpose(1, 0, 2)

    def bundle(self) -> Bundle:
        """The car linearised at 15 m/s: pedal gains at low speed, and the interface of `Mpc`.

        Its wheel has the bounds of the plans of learned models.
        """
        state = np.array(AT_REST._replace(vx_mps=_CARRIER_MPS))
        at_rest = np.zeros((self._horizon, N_INPUTS))
        derivatives = self.derivatives(np.tile(state, (self._horizon, 1)), at_rest, 0.0)[0]
        A, B_uc, B_uw = np.split(derivatives, [N_STATES, N_STATES + N_INPUTS], axis=1)
        following = self.predict(state, at_rest, 0.0)[1]
        linear = Bundle.linear(A, B_uc, B_uw, following - A @ state, name="bicycle")
        wide = INPUT_LIMITS.with_wheel(PLAN_STEER_RAD)
        signal_range = np.array([(*wide.lower, -inf), (*wide.upper, inf)])
        return replace(linear, signal_range=signal_range, car=DEFAULT_CAR)


def fit() -> dict[str, Any]:
    """Parameters of the least squares of all predictions of 20 periods, and their errors."""
    starts, inputs, curvatures, targets = [], [], [], []
    for scenario in FIT:
        drive = simulate(scenario, model=DRIVER)
        columns = list(drive.columns)
        states = drive.values[:, [columns.index(name) for name in VehicleState._fields]]
        sent = drive.values[:, [columns.index(name) for name in ControlInput._fields]]
        curvature = drive["curvature_per_m"]
        last = int(np.flatnonzero([mode.drives for mode in drive.modes])[-1])
        for k in range(DELAY, last - _STEPS, _STRIDE):
            starts.append(states[k])
            inputs.append(sent[k - DELAY : k - DELAY + _STEPS])
            curvatures.append(curvature[k : k + _STEPS])
            targets.append(states[k + 1 : k + 1 + _STEPS])
    count = len(starts)
    theta = ca.MX.sym("theta", len(Parameters._fields))
    roll_out = step_function().mapaccum(_STEPS).map(count)
    stacked = [np.concatenate(each).T for each in (inputs, curvatures)]
    stacked[1] = np.concatenate(curvatures)[None]
    predicted = roll_out(np.array(starts).T, *stacked, ca.repmat(theta, 1, _STEPS * count))
    errors = ca.DM(1.0 / _ERRORS[_OBSERVED]) * (predicted - np.concatenate(targets).T)[_OBSERVED, :]
    weighted = ca.vec(errors) / np.sqrt(count * _STEPS)
    value = ca.Function("errors", [theta], [weighted])
    jacobian = ca.Function("jacobian", [theta], [ca.jacobian(weighted, theta)])
    first = np.array(Parameters())
    found = least_squares(
        lambda x: np.array(value(x * first)).ravel(),
        np.ones(len(first)),
        lambda x: np.array(jacobian(x * first)) * first,
        loss="soft_l1",
        bounds=(0.02, 20.0),
    )
    rms = np.sqrt(np.mean(np.square(np.array(value(found.x * first)).reshape(-1, 5)), axis=0))
    rms *= _ERRORS[_OBSERVED] * np.sqrt(count * _STEPS)
    return {
        "command": COMMAND,
        "scenarios": [scenario.name for scenario in FIT],
        "driver": DRIVER,
        "driven_s": sum(scenario.duration_s for scenario in FIT),
        "predictions": count,
        "rms_over_half_a_second": {c.name: float(x) for c, x in zip(_OBSERVED, rms, strict=True)},
        "parameters": dict(zip(Parameters._fields, (found.x * first).tolist(), strict=True)),
    }


if __name__ == "__main__":
    write_figures(FILE, fit())
