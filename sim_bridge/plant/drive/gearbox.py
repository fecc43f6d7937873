"""The automatic gearbox: six ratios, a shift map over the throttle, and the course of a shift."""

from rt_controller.contract.arrays import Array
from sim_bridge.plant.drive.drive_parts import GearboxParameters
from sim_bridge.plant.drive.engine import RPM_OF_RADPS
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.states import AT

N_GEARS = 6


@compiled
def ratio(
    gear: float, gear_before: float, since_shift_s: float, gearbox: GearboxParameters
) -> float:
    """Speed ratio; during a shift a smooth transition from the old to the new gear."""
    after = gearbox.ratios[int(gear) - 1]
    if since_shift_s >= gearbox.shift_time_s:
        return after
    before = gearbox.ratios[int(gear_before) - 1]
    done = since_shift_s / gearbox.shift_time_s
    return before + (after - before) * done * done * (3.0 - 2.0 * done)


@compiled
def kept_torque(
    gear: float, gear_before: float, since_shift_s: float, gearbox: GearboxParameters
) -> float:
    """Share of the combustion torque that the engine keeps: reduced during an up-shift.

    It is not reduced during a down-shift, in which the engine has to accelerate.
    """
    if since_shift_s >= gearbox.shift_time_s or gear < gear_before:
        return 1.0
    done = since_shift_s / gearbox.shift_time_s
    return 1.0 - gearbox.shift_dip * 16.0 * (done * (1.0 - done)) ** 2


@compiled
def up_shift_rpm(throttle: float, gearbox: GearboxParameters) -> float:
    """Turbine speed above which the next higher gear is engaged."""
    opened = float(throttle**gearbox.shift_shape)
    return gearbox.up_rpm + (gearbox.up_rpm_full - gearbox.up_rpm) * opened


@compiled
def down_shift_rpm(throttle: float, gearbox: GearboxParameters) -> float:
    """Turbine speed below which the next lower gear is engaged."""
    opened = float(throttle**gearbox.shift_shape)
    return gearbox.down_rpm + (gearbox.down_rpm_full - gearbox.down_rpm) * opened


@compiled
def highest_gear(output_radps: float, throttle: float, gearbox: GearboxParameters) -> float:
    """The highest gear with a margin of 10 % above its down-shift speed."""
    for gear in range(N_GEARS, 1, -1):
        turbine_rpm = output_radps * gearbox.ratios[gear - 1] * RPM_OF_RADPS
        if turbine_rpm > 1.1 * down_shift_rpm(throttle, gearbox):
            return float(gear)
    return 1.0


@compiled
def choose_gear(
    state: Array, output_radps: float, gearbox: GearboxParameters, step_s: float
) -> None:
    """Start a shift if it is due, and advance the shift timer; writes only the gear states.

    Called between steps: the gear is constant within a step.
    """
    elapsed_s = state[AT.since_shift_s] + step_s
    if elapsed_s >= gearbox.dwell_s:
        gear = int(state[AT.gear])
        turbine_rpm = output_radps * gearbox.ratios[gear - 1] * RPM_OF_RADPS
        throttle = min(1.0, max(0.0, state[AT.throttle]))
        step = 0
        if gear < N_GEARS and turbine_rpm > up_shift_rpm(throttle, gearbox):
            step = 1
        elif gear > 1 and turbine_rpm < down_shift_rpm(throttle, gearbox):
            step = -1
        if step != 0:
            state[AT.gear_before] = float(gear)
            state[AT.gear] = float(gear + step)
            elapsed_s = 0.0
    state[AT.since_shift_s] = min(elapsed_s, 10.0)
