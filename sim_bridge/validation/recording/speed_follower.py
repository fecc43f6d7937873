"""`SpeedFollower`: the pedals with which the car follows a recorded speed.

The pedals are used instead of a forced speed because drive and brake forces of the tyres change
their side force and the wheel loads: near the limit the motion depends on them.
"""

from math import pi

import numpy as np
from numpy import float64
from scipy.ndimage import gaussian_filter1d

from rt_controller.contract.arrays import Array
from rt_controller.contract.physics import GRAVITY_MPS2
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.library import steady_pressures_mpa
from sim_bridge.plant.parameters import Parameters

_SMOOTHING_S = 0.1
_INTEGRAL_PS = 2.0
_LARGEST_INTEGRAL_MPS2 = 3.0
_BRAKE_LEAD_S = 0.05
_PEDALS_N = np.linspace(0.0, 600.0, 61)


class SpeedFollower:
    """Recorded acceleration ahead by the lag of the throttle, plus the integral of what is missing.

    The wanted force becomes a torque of engine or motor by the power at the wheels, and the torque
    a throttle by the map of the car; what the released throttle does not brake, the brake does.
    """

    def __init__(self, parameters: Parameters, speed_mps: Array, period_s: float) -> None:
        """`speed_mps` (n,) is the recorded speed, every `period_s`."""
        self._parameters = parameters
        self._speed_mps = speed_mps
        smooth = gaussian_filter1d(speed_mps.astype(float64), _SMOOTHING_S / period_s)
        self.acceleration_mps2: Array = np.gradient(smooth, period_s)
        """(n,) recorded rate of the speed"""
        is_electric = parameters.motor.inertia_kgm2 > 0.0
        drive = parameters.motor if is_electric else parameters.engine
        lag_s = parameters.motor.lag_s if is_electric else parameters.engine.throttle_lag_s
        self._lead, self._brake_lead = round(lag_s / period_s), round(_BRAKE_LEAD_S / period_s)
        self._throttles = np.array(drive.map_throttles)
        self._speeds_rpm = np.array(drive.map_speeds_rpm)
        self._map_nm = np.array(drive.map_nm)
        self._brake_forces_n = _brake_forces_n(parameters)
        self._integral_mps2 = 0.0
        self._period_s = period_s

    def pedals(self, k: int, rate_mps2: float, drive_rpm: float) -> tuple[float, float]:
        """Throttle and brake_n of the period after sample k; call once per period, in order.

        Args:
            rate_mps2: rate of the speed that the pedals gave in the period before.
            drive_rpm: speed of engine or motor.
        """
        missing_mps2 = float(self.acceleration_mps2[k]) - rate_mps2
        integral_mps2 = self._integral_mps2 + _INTEGRAL_PS * missing_mps2 * self._period_s
        limit_mps2 = _LARGEST_INTEGRAL_MPS2
        self._integral_mps2 = min(limit_mps2, max(-limit_mps2, integral_mps2))
        vx_mps = float(self._speed_mps[k])
        driving_n, braking_n = (
            self._force_n(self._ahead_mps2(k, lead) + self._integral_mps2, vx_mps)
            for lead in (self._lead, self._brake_lead)
        )
        n_per_nm = drive_rpm * pi / 30.0 / vx_mps * self._efficiency
        torques_nm = self._torques_nm(drive_rpm)
        throttle = float(np.interp(driving_n / n_per_nm, torques_nm, self._throttles))
        released_n = float(torques_nm[0]) * n_per_nm
        brake_n = float(np.interp(released_n - braking_n, self._brake_forces_n, _PEDALS_N))
        return (0.0, brake_n) if brake_n > 0.0 else (throttle, 0.0)

    @property
    def _efficiency(self) -> float:
        return self._parameters.driveline.final_efficiency

    def _ahead_mps2(self, k: int, lead: int) -> float:
        """Recorded acceleration `lead` periods after sample k."""
        return float(self.acceleration_mps2[min(k + lead, len(self.acceleration_mps2) - 1)])

    def _force_n(self, acceleration_mps2: float, vx_mps: float) -> float:
        """Force of all tyres for an acceleration on a level road without wind."""
        p = self._parameters
        drag_n = 0.5 * p.aero.air_density_kgpm3 * p.aero.area_m2 * p.aero.drag * vx_mps**2
        rolling = p.tyre.rolling_resistance + p.tyre.rolling_resistance_spm * vx_mps
        return p.body.mass_kg * (acceleration_mps2 + rolling * GRAVITY_MPS2) + drag_n

    def _torques_nm(self, drive_rpm: float) -> Array:
        """Torque at this speed for each throttle of the map."""
        column = int(
            np.clip(np.searchsorted(self._speeds_rpm, drive_rpm), 1, len(self._speeds_rpm) - 1)
        )
        below, above = self._speeds_rpm[column - 1 : column + 1]
        way = min(1.0, max(0.0, (drive_rpm - below) / (above - below)))
        torques_nm: Array = (1.0 - way) * self._map_nm[:, column - 1] + way * self._map_nm[
            :, column
        ]
        return torques_nm


def _brake_forces_n(parameters: Parameters) -> Array:
    """Steady brake force of all wheels for each of `_PEDALS_N`."""
    brakes, record = parameters.brakes, car_record(parameters)
    pressures_mpa = np.array([steady_pressures_mpa(pedal_n, record) for pedal_n in _PEDALS_N])
    torques_nm = 2.0 * pressures_mpa @ (brakes.front_nm_per_mpa, brakes.rear_nm_per_mpa)
    return np.asarray(torques_nm / parameters.tyre.rolling_radius_m)
