"""Replay of a recorded drive: the simulated car with recorded steering and speed, open loop.

The pedals follow the recorded speed, so that the tyres have drive and brake forces and the wheels
their loads; a speed that is only forced has neither. What engine and brakes of the car cannot give
is added as a force at the centre of gravity, so that the speed is the recorded one. There is no
other feedback. A car that spins is started again with the recorded motion.
"""

from dataclasses import dataclass
from math import atan2, nan, pi, radians

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, gaussian_filter1d

from offline.logs.recorded_drive import PERIOD_S, RecordedDrive
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import GRAVITY_MPS2, ControlInput
from sim_bridge.plant.library import (
    N_OUTPUTS,
    STEP_S,
    advance,
    car_record,
    settle,
    steady_pressures_mpa,
    write_outputs,
)
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs
from sim_bridge.plant.states import AT, N_STATES, N_WHEELS

SETTLING_S = 2.0
"""left out of the comparison after a start"""
LARGEST_LAG_S = 0.5
SPEED_RATE = "speed_rate_mps2"
"""recorded rate of the speed, and what the pedals alone give the car"""
_LARGEST_DEVIATION_RAD = radians(15.0)
"""of the sideslip; a car that is further from the recorded motion has spun"""
_SMOOTHING_S, _BRAKE_LEAD_S = 0.1, 0.05
_INTEGRAL_PS, _LARGEST_INTEGRAL_MPS2 = 2.0, 3.0
_PEDALS_N = np.linspace(0.0, 600.0, 61)


@dataclass(frozen=True, slots=True)
class Comparison:
    """A signal of the car against the recorded one."""

    recording: str
    signal: str
    """with its unit, which is that of the two RMS values"""
    rms_recorded: float
    rms_error: float
    error_percent: float
    """RMS error over the RMS of the recorded signal"""
    gain: float
    """of the car over the recording, least squares: 1.1 if the car answers by a tenth too much"""
    lag_s: float
    """by which the recording comes after the car, for the smallest RMS error"""
    error_at_lag_percent: float
    """`error_percent` times the share that remains with the recording shifted by `lag_s`"""
    compared_s: float
    """duration of the part that is compared"""
    spins: int
    """how often the car left the recorded motion and was started again"""


def replay_drive(parameters: Parameters, drive: RecordedDrive) -> list[Comparison]:
    """The rate of the speed by the pedals, and each signal of the recording, compared."""
    pedals = _Pedals(parameters, drive.speed_mps)
    ratio = parameters.steering.ratio if drive.is_road_wheel else 1.0
    # The middles of the periods, so that the car is not steered half a period late.
    steer_rad = ratio * 0.5 * (drive.steer_rad[:-1] + drive.steer_rad[1:])
    speed_mps, n, record = drive.speed_mps, len(drive.speed_mps), car_record(parameters)
    vy_mps, yaw_rate_radps = (drive.signals.get(m, np.zeros(n)) for m in MOTION_FIELDS[1:])
    motion, outputs, rate_mps2 = np.empty((n, 3)), np.empty((n, N_OUTPUTS)), np.zeros(n)
    steps, state = np.empty((round(PERIOD_S / STEP_S), 3)), np.zeros(N_STATES)
    control, spins, is_compared = ControlInput(0.0, 0.0, 0.0), -1, np.ones(n, dtype=bool)
    for k in range(n):
        sideslip_rad = atan2(state[AT.vy_mps], speed_mps[k]) - atan2(vy_mps[k], speed_mps[k])
        if k == 0 or not abs(sideslip_rad) <= _LARGEST_DEVIATION_RAD:
            state = settle(float(speed_mps[k]), parameters)
            state[AT.vy_mps], state[AT.yaw_rate_radps] = vy_mps[k], yaw_rate_radps[k]
            spins += 1
            is_compared[k : k + round(SETTLING_S / PERIOD_S)] = False
        motion[k] = state[[AT.vx_mps, AT.vy_mps, AT.yaw_rate_radps]]
        write_outputs(state, control, record, outputs[k])
        if k == n - 1:
            break
        drive_rpm = float(state[AT.engine_radps]) * 30.0 / pi
        throttle, brake_n = pedals.after(k, float(rate_mps2[k]), drive_rpm)
        control = ControlInput(throttle, brake_n, float(steer_rad[k]))
        advance(state, control, record, len(steps), STEP_S, steps)
        rate_mps2[k + 1] = (float(state[AT.vx_mps]) - speed_mps[k]) / PERIOD_S
        # The wheels turn faster by as much, so their slips remain.
        more_mps = float(speed_mps[k + 1] - state[AT.vx_mps])
        state[AT.vx_mps] += more_mps
        spin = slice(AT.spin_radps, AT.spin_radps + N_WHEELS)
        state[spin] += more_mps / parameters.tyre.rolling_radius_m
    columns = np.hstack((motion, outputs)).T
    car = dict(zip(MOTION_FIELDS + PlantOutputs._fields, columns, strict=True))
    pairs = {SPEED_RATE: (pedals.acceleration_mps2, rate_mps2)} | {
        name: (values, car[name]) for name, values in drive.signals.items()
    }
    return [
        compare(drive.name, name, recorded, ours, is_compared, spins)
        for name, (recorded, ours) in pairs.items()
    ]


def compare(
    recording: str,
    signal: str,
    recorded: Array,
    car: Array,
    is_compared: NDArray[np.bool_],
    spins: int = 0,
) -> Comparison:
    """The figures of two signals (n,) of the samples `is_compared` (n,); NaN where there is none.

    All lags are compared over the same samples: those with 0.5 s of `is_compared` before and after
    them; between samples by a parabola through the squared errors.
    """
    measured, answer = recorded[is_compared], car[is_compared]
    size, error, power = _rms(measured), _rms(answer - measured), float(measured @ measured)
    percent = 100.0 * error / size if size > 0.0 else nan
    lag_s = remaining = nan
    n = round(LARGEST_LAG_S / PERIOD_S)
    at = np.flatnonzero(binary_erosion(is_compared, np.ones(2 * n + 1)))
    if len(at):
        squares = np.array(
            [np.mean((car[at - lag] - recorded[at]) ** 2) for lag in range(-n, n + 1)]
        )
        k = int(np.argmin(squares))
        shift, smallest = 0.0, squares[k]
        if 0 < k < 2 * n:
            before, after = squares[k - 1], squares[k + 1]
            bend = before - 2.0 * smallest + after
            shift = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
            smallest = max(0.0, smallest - 0.25 * (before - after) * shift)
        lag_s = float((k - n + shift) * PERIOD_S)
        remaining = float(np.sqrt(smallest / squares[n])) if squares[n] > 0.0 else 1.0
    return Comparison(
        recording=recording,
        signal=signal,
        rms_recorded=size,
        rms_error=error,
        error_percent=percent,
        gain=float(measured @ answer) / power if power > 0.0 else nan,
        lag_s=lag_s,
        error_at_lag_percent=remaining * percent,
        compared_s=PERIOD_S * np.count_nonzero(is_compared),
        spins=spins,
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else nan


class _Pedals:
    """Recorded acceleration ahead by the lag of the throttle, plus the integral of what is missing.

    The wanted force becomes a torque of engine or motor by the power at the wheels, and the torque
    a throttle by the map of the car; what the released throttle does not brake, the brake does.
    """

    def __init__(self, car: Parameters, speed_mps: Array) -> None:
        smooth = gaussian_filter1d(speed_mps.astype(np.float64), _SMOOTHING_S / PERIOD_S)
        self.acceleration_mps2: Array = np.gradient(smooth, PERIOD_S)
        """(n,) recorded rate of the speed"""
        is_electric = car.motor.inertia_kgm2 > 0.0
        drive = car.motor if is_electric else car.engine
        lag_s = car.motor.lag_s if is_electric else car.engine.throttle_lag_s
        self._car, self._speed_mps, self._integral_mps2 = car, speed_mps, 0.0
        self._leads = tuple(round(lead_s / PERIOD_S) for lead_s in (lag_s, _BRAKE_LEAD_S))
        self._throttles, self._map_nm = np.array(drive.map_throttles), np.array(drive.map_nm)
        self._speeds_rpm = np.array(drive.map_speeds_rpm)
        record, brakes = car_record(car), car.brakes
        pressures_mpa = np.array([steady_pressures_mpa(pedal_n, record) for pedal_n in _PEDALS_N])
        torques_nm = 2.0 * pressures_mpa @ (brakes.front_nm_per_mpa, brakes.rear_nm_per_mpa)
        self._brake_forces_n = torques_nm / car.tyre.rolling_radius_m

    def after(self, k: int, rate_mps2: float, drive_rpm: float) -> tuple[float, float]:
        """Throttle and brake_n of the period after sample k; call once per period, in order.

        Args:
            rate_mps2: rate of the speed that the pedals gave in the period before.
            drive_rpm: speed of engine or motor.
        """
        acceleration_mps2, car = self.acceleration_mps2, self._car
        missing_mps2 = float(acceleration_mps2[k]) - rate_mps2
        integral_mps2 = self._integral_mps2 + _INTEGRAL_PS * missing_mps2 * PERIOD_S
        limit_mps2 = _LARGEST_INTEGRAL_MPS2
        self._integral_mps2 = min(limit_mps2, max(-limit_mps2, integral_mps2))
        vx_mps, last = float(self._speed_mps[k]), len(acceleration_mps2) - 1
        rolling = car.tyre.rolling_resistance + car.tyre.rolling_resistance_spm * vx_mps
        resisted_mps2 = self._integral_mps2 + rolling * GRAVITY_MPS2
        aero = car.aero
        drag_n = 0.5 * aero.air_density_kgpm3 * aero.area_m2 * aero.drag * vx_mps**2
        driving_n, braking_n = (
            car.body.mass_kg * (acceleration_mps2[min(k + lead, last)] + resisted_mps2) + drag_n
            for lead in self._leads
        )
        n_per_nm = drive_rpm * pi / 30.0 / vx_mps * car.driveline.final_efficiency
        torques_nm = [float(np.interp(drive_rpm, self._speeds_rpm, row)) for row in self._map_nm]
        throttle = float(np.interp(driving_n / n_per_nm, torques_nm, self._throttles))
        released_n = torques_nm[0] * n_per_nm
        brake_n = float(np.interp(released_n - braking_n, self._brake_forces_n, _PEDALS_N))
        return (0.0, brake_n) if brake_n > 0.0 else (throttle, 0.0)
