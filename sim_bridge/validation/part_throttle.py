"""Test 9: launch, cruise and coast-down at part throttle."""

from math import nan

import numpy as np

from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.run import Run, cruising_throttle, input_table, replay
from sim_bridge.validation.signal_metrics import crossing

THROTTLE = 0.2
RAMP_S = 3.0
LAUNCH_KMH = (20.0, 40.0, 60.0, 80.0)
CRUISE_MPS = 120.0 / 3.6
ENGINE_RPM = 2390.0
_LAUNCH_S = 30.0
_COASTING_S = 40.0
_SETTLED_S = 2.0
_INPUT_PERIOD_S = 0.01


def measure(parameters: Parameters) -> tuple[Run, Run, dict[str, float]]:
    """A launch from rest, cruising at 120 km/h, and coasting from there.

    Returns:
        the launch, the coast-down, and the values of the table by line.
    """
    launch = launched(parameters)
    coasting = replay(
        parameters, CRUISE_MPS, input_table(round(_COASTING_S / _INPUT_PERIOD_S)), _INPUT_PERIOD_S
    )
    throttle = cruising_throttle(parameters, CRUISE_MPS)
    seconds = input_table(round(_SETTLED_S / _INPUT_PERIOD_S), throttle)
    cruising = replay(parameters, CRUISE_MPS, seconds, _INPUT_PERIOD_S)
    values = {
        f"0-{kmh:.0f} km/h with throttle {THROTTLE}": crossing(
            launch.time_s, 3.6 * launch.speed_mps, kmh
        )
        for kmh in LAUNCH_KMH
    }
    return (
        launch,
        coasting,
        values
        | {
            f"torque at {ENGINE_RPM:.0f} rpm, throttle {THROTTLE}": torque_at_rpm(
                launch, ENGINE_RPM, parameters.gearbox.shift_time_s
            ),
            "throttle at 120 km/h": throttle,
            "engine torque at 120 km/h": float(cruising.column("engine_nm")[-1]),
            "engine speed at 120 km/h": float(cruising.column("engine_rpm")[-1]),
            "coast-down from 120 to 80 km/h": crossing(
                coasting.time_s, -3.6 * coasting.speed_mps, -80.0
            ),
        },
    )


def launched(parameters: Parameters) -> Run:
    """From rest; the throttle opens within 3 s and stays."""
    time_s = _INPUT_PERIOD_S * np.arange(round(_LAUNCH_S / _INPUT_PERIOD_S))
    throttle = THROTTLE * np.clip(time_s / RAMP_S, 0.0, 1.0)
    return replay(parameters, 0.0, input_table(len(time_s), throttle), _INPUT_PERIOD_S)


def torque_at_rpm(launch: Run, rpm: float, shift_time_s: float) -> float:
    """Torque of the engine in Nm when it first passes this speed with the throttle open.

    Passages within a shift are left out: the torque is reduced there. NaN if it does not pass it.
    """
    is_open = launch.time_s > RAMP_S + _SETTLED_S
    gear = launch.column("gear")
    shifts_s = launch.time_s[1:][np.diff(gear) != 0.0]
    since_shift_s = launch.time_s[:, None] - shifts_s
    # The first sample after a change of gear may be up to a period after the shift began.
    ends_s = shift_time_s + _INPUT_PERIOD_S
    is_shifting = ((since_shift_s >= 0.0) & (since_shift_s < ends_s)).any(axis=1)
    counts = is_open & ~is_shifting
    is_above = launch.column("engine_rpm") >= rpm
    passed = np.flatnonzero(counts[:-1] & counts[1:] & (is_above[:-1] != is_above[1:]))
    if not len(passed):
        return nan
    k = int(passed[0])
    before_rpm, after_rpm = launch.column("engine_rpm")[k : k + 2].tolist()
    share = (rpm - before_rpm) / (after_rpm - before_rpm)
    before_nm, after_nm = launch.column("engine_nm")[k : k + 2].tolist()
    return float(before_nm + share * (after_nm - before_nm))
