"""From the crankshaft to the wheels: torque converter, shafts that twist, differentials.

The centre differential is viscous, both axle differentials are open.
"""

from typing import NamedTuple

from rt_controller.contract.arrays import Array
from sim_bridge.plant.drive import engine, gearbox
from sim_bridge.plant.drive.drive_parts import ConverterParameters, DrivelineParameters
from sim_bridge.plant.drive.engine import RPM_OF_RADPS
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.states import AT, N_FRONT, N_WHEELS

_LEAST_CONTROL_SPEED_MPS = 3.0
"""below it the slip of the traction control is computed with this speed"""


class ConverterTorque(NamedTuple):
    """Torque taken from the engine and torque delivered to the gearbox."""

    impeller_nm: float
    turbine_nm: float


class AxleTorque(NamedTuple):
    """Drive torque of each wheel of an axle."""

    front_wheel_nm: float
    rear_wheel_nm: float


@compiled
def converter_torque(
    engine_radps: float, turbine_radps: float, converter: ConverterParameters
) -> ConverterTorque:
    """Torques at both ends of the converter; a turbine faster than the engine drives the engine.

    The capacity is largest at stall and decreases with a power of the speed ratio. Both branches
    meet at equal speeds with the same slope.
    """
    engine_rpm = max(1.0, engine_radps * RPM_OF_RADPS)
    turbine_rpm = turbine_radps * RPM_OF_RADPS
    if turbine_rpm > engine_rpm:
        overrun_nm = _capacity_nm(turbine_rpm, engine_rpm / turbine_rpm, converter)
        return ConverterTorque(-overrun_nm, -overrun_nm)
    ratio = max(0.0, turbine_rpm / engine_rpm)
    impeller_nm = _capacity_nm(engine_rpm, ratio, converter)
    gain = (
        converter.stall_torque_ratio
        - (converter.stall_torque_ratio - 1.0) * ratio / converter.coupling_speed_ratio
    )
    return ConverterTorque(impeller_nm, impeller_nm * max(1.0, gain))


@compiled
def _capacity_nm(faster_rpm: float, ratio: float, converter: ConverterParameters) -> float:
    full_nm = converter.capacity_nm_per_rpm2 * faster_rpm * faster_rpm
    return full_nm * (1.0 - float(ratio**converter.capacity_fade))


@compiled
def driven_speed_radps(
    front_radps: float, rear_radps: float, driveline: DrivelineParameters
) -> float:
    """Speed at the input of the centre differential, from the mean wheel speeds of the axles."""
    return driveline.front_share * front_radps + (1.0 - driveline.front_share) * rear_radps


@compiled
def axle_torque(
    shafts_nm: float, front_radps: float, rear_radps: float, driveline: DrivelineParameters
) -> AxleTorque:
    """Torque split of the centre differential; its viscous coupling drives the slower axle."""
    ratio = driveline.final_ratio
    coupled_nm = driveline.viscous_nms * ratio * ratio * (rear_radps - front_radps)
    lossy_nm = shafts_nm * driveline.final_efficiency
    if shafts_nm < 0.0:
        lossy_nm = shafts_nm / driveline.final_efficiency
    return AxleTorque(
        0.5 * (driveline.front_share * lossy_nm + coupled_nm),
        0.5 * ((1.0 - driveline.front_share) * lossy_nm - coupled_nm),
    )


@compiled
def axle_speeds_radps(state: Array) -> tuple[float, float]:
    """Mean wheel speed of the front and of the rear axle."""
    first = AT.spin_radps
    return 0.5 * (state[first] + state[first + 1]), 0.5 * (state[first + 2] + state[first + 3])


@compiled
def output_speed_radps(state: Array, p: Parameters) -> float:
    """Speed of the gearbox's output shaft that follows from the wheel speeds, without its twist."""
    front, rear = axle_speeds_radps(state)
    return p.driveline.final_ratio * driven_speed_radps(front, rear, p.driveline)


@compiled
def cut_per_s(state: Array, forward_mps: tuple[float, float, float, float], p: Parameters) -> float:
    """Rate of the share of torque that the traction control takes away.

    It acts on driven wheels that are too fast and, because a motor brakes too, on those too slow.

    Args:
        forward_mps: speed of each wheel's centre along the wheel; in a turn they differ.
    """
    control = p.traction_control
    if control.slip == 0.0:
        return 0.0
    first = 0 if p.driveline.front_share > 0.0 else N_FRONT
    last = N_WHEELS if p.driveline.front_share < 1.0 else N_FRONT
    slip = 0.0
    for wheel in range(first, last):
        rim_mps = state[AT.spin_radps + wheel] * p.tyre.rolling_radius_m
        speed_mps = max(abs(forward_mps[wheel]), _LEAST_CONTROL_SPEED_MPS)
        slip = max(slip, abs(rim_mps - forward_mps[wheel]) / speed_mps)
    wanted = min(1.0, max(-1.0, (slip - control.slip) / control.slip_band))
    cut = state[AT.torque_cut]
    if wanted > 0.0:
        return wanted * control.cut_per_s if cut < 1.0 else 0.0
    return wanted * control.restore_per_s if cut > 0.0 else 0.0


@compiled
def drive_nm(state: Array, p: Parameters) -> float:
    """Torque of the engine at its crankshaft, or of the motor at its shaft."""
    kept = 1.0 - state[AT.torque_cut]
    if p.motor.inertia_kgm2 > 0.0:
        return engine.motor_nm(state[AT.turbine_radps], state[AT.throttle], kept, p.motor)
    kept *= gearbox.kept_torque(
        state[AT.gear], state[AT.gear_before], state[AT.since_shift_s], p.gearbox
    )
    return engine.torque_nm(state[AT.engine_radps], state[AT.throttle], kept, p.engine)


@compiled
def wheel_torque(
    state: Array, throttle: float, p: Parameters, rate: Array, decay: Array
) -> AxleTorque:
    """Torque at the wheels; throttle, engine, turbine and wind-up go into `rate` and `decay`."""
    front, rear = axle_speeds_radps(state)
    ratio = p.driveline.final_ratio * gearbox.ratio(
        state[AT.gear], state[AT.gear_before], state[AT.since_shift_s], p.gearbox
    )
    wind_up_radps = state[AT.turbine_radps] / ratio - driven_speed_radps(front, rear, p.driveline)
    shafts_nm = (
        p.driveline.shaft_stiffness_nmprad * state[AT.wind_up_rad]
        + p.driveline.shaft_damping_nms * wind_up_radps
    )
    efficiency = p.gearbox.efficiencies[int(state[AT.gear]) - 1]
    load_nm = shafts_nm * efficiency if shafts_nm < 0.0 else shafts_nm / efficiency

    torque_nm = drive_nm(state, p)
    lag_s = p.engine.throttle_lag_s
    if p.motor.inertia_kgm2 > 0.0:
        lag_s = p.motor.lag_s
        motor_radps2 = (torque_nm - load_nm / ratio) / p.motor.inertia_kgm2
        rate[AT.engine_radps] = motor_radps2
        rate[AT.turbine_radps] = motor_radps2
    else:
        hydraulic = converter_torque(state[AT.engine_radps], state[AT.turbine_radps], p.converter)
        rate[AT.engine_radps] = (torque_nm - hydraulic.impeller_nm) / p.engine.inertia_kgm2
        rate[AT.turbine_radps] = (
            hydraulic.turbine_nm - load_nm / ratio
        ) / p.converter.turbine_inertia_kgm2
    rate[AT.throttle] = throttle / lag_s
    decay[AT.throttle] = 1.0 / lag_s
    rate[AT.wind_up_rad] = wind_up_radps
    return axle_torque(shafts_nm, front, rear, p.driveline)
