"""Engine, converter, gearbox and shafts in a row: how they move and what they leave the wheels."""

from numpy import float64
from numpy.typing import NDArray

from sim_bridge.plant import converter, driveline, engine, gearbox
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.states import AT


@compiled
def axle_speeds_radps(state: NDArray[float64]) -> tuple[float, float]:
    """Mean wheel speed of the front and of the rear axle."""
    first = AT.spin_radps
    return 0.5 * (state[first] + state[first + 1]), 0.5 * (state[first + 2] + state[first + 3])


@compiled
def output_speed_radps(state: NDArray[float64], p: Parameters) -> float:
    """Speed of the gearbox's output shaft as the wheels turn it, without its wind-up."""
    front, rear = axle_speeds_radps(state)
    return p.driveline.final_ratio * driveline.driven_speed_radps(front, rear, p.driveline)


@compiled
def drive(
    state: NDArray[float64],
    throttle: float,
    p: Parameters,
    rate: NDArray[float64],
    decay: NDArray[float64],
) -> driveline.AxleTorque:
    """Torque at the wheels; throttle, engine, turbine and wind-up go into `rate` and `decay`."""
    front, rear = axle_speeds_radps(state)
    ratio = p.driveline.final_ratio * gearbox.ratio(
        state[AT.gear], state[AT.gear_before], state[AT.since_shift_s], p.gearbox
    )
    wind_up_radps = state[AT.turbine_radps] / ratio - driveline.driven_speed_radps(
        front, rear, p.driveline
    )
    shafts_nm = driveline.shaft_nm(state[AT.wind_up_rad], wind_up_radps, p.driveline)
    efficiency = gearbox.efficiency(state[AT.gear], p.gearbox)
    load_nm = shafts_nm * efficiency if shafts_nm < 0.0 else shafts_nm / efficiency

    hydraulic = converter.converter_torque(
        state[AT.engine_radps], state[AT.turbine_radps], p.converter
    )
    kept = gearbox.handed_over(
        state[AT.gear], state[AT.gear_before], state[AT.since_shift_s], p.gearbox
    )
    engine_nm = engine.torque_nm(state[AT.engine_radps], state[AT.throttle], kept, p.engine)
    rate[AT.throttle] = throttle / p.engine.throttle_lag_s
    decay[AT.throttle] = 1.0 / p.engine.throttle_lag_s
    rate[AT.engine_radps] = (engine_nm - hydraulic.impeller_nm) / p.engine.inertia_kgm2
    rate[AT.turbine_radps] = (
        hydraulic.turbine_nm - load_nm / ratio
    ) / p.converter.turbine_inertia_kgm2
    rate[AT.wind_up_rad] = wind_up_radps
    return driveline.axle_torque(shafts_nm, front, rear, p.driveline)
