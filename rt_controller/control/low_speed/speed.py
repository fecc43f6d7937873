"""Speed and stopping of a slowly rolling car: wanted acceleration, and the pedals for it.

pedal acceleration = wanted acceleration - disturbance. The disturbance is what the pedals do not
explain: slope, drag, the creep of an automatic transmission, and wrong gains of the pedals. It is
estimated in every tick, also while the model drives, so the pedals do not jump at the handover.
"""

from typing import NamedTuple

from rt_controller.contract.signals import ControlInput, PathReference
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.low_speed.handover import ARRIVE

SPEED_GAIN_PER_S = 3.0
"""acceleration per speed error"""
STRONGEST_MPS2 = 2.0
"""acceleration, and braking beyond that of the reference"""
LARGEST_CHANGE_MPS2 = 10.0 * PERIOD_S
"""of the wanted acceleration in one period: a jerk of 10 m/s^3"""
PEDAL_LAG_S = 0.3
"""time constant from pedals to acceleration, usual for engines and hydraulic brakes"""
DISTURBANCE_TIME_S = 1.5
"""time constant of the estimated disturbance: longer than the lag"""
LARGEST_DISTURBANCE_MPS2 = 3.0
BRAKED_MPS = 0.3
"""a braked car that is wanted to move and seems slower than this may stand"""
PRESS_BRAKE_MPS2 = -0.3
"""pedal acceleration below which a released or pressed accelerator gives way to the brake"""
PRESS_THROTTLE_MPS2 = 0.1
"""pedal acceleration above which the brake gives way to the accelerator"""
SLOWEST_RATIO_MPS = 0.1
"""least reference speed in the ratio of the speed to it, in the braking towards a stop"""
FASTEST_RATIO = 1.6
"""largest ratio of the speed to its reference, in the braking towards a stop"""
FINAL_MPS2 = 1.0
"""least deceleration towards a reference that stands: the car does not creep to rest"""


class PedalGains(NamedTuple):
    """Steady acceleration of the car at low speed per unit of each pedal."""

    throttle_mps2: float
    """of the whole travel"""
    brake_mps2_per_n: float
    """deceleration"""


def wanted_mps2(vx_mps: float, path: PathReference) -> float:
    """Acceleration that leads the speed to its reference.

    Towards a stop the reference v = sqrt(2 b d) falls with the distance d. A car that is slower
    needs less than b to stop in the same distance, and a faster one more: b (v_x / v)^2.
    """
    v_mps, a_mps2 = path.v_mps, path.a_mps2
    forward = a_mps2
    if a_mps2 < 0.0:
        ratio = min(max(vx_mps, 0.0) / max(v_mps, SLOWEST_RATIO_MPS), FASTEST_RATIO)
        forward = a_mps2 * ratio * ratio
    if v_mps < ARRIVE.v_mps and a_mps2 < ARRIVE.a_mps2 and vx_mps > 0.0:
        forward -= FINAL_MPS2
    strongest_braking = min(a_mps2, 0.0) - STRONGEST_MPS2
    wanted = forward + SPEED_GAIN_PER_S * (v_mps - vx_mps)
    return min(max(wanted, strongest_braking), max(a_mps2, 0.0) + STRONGEST_MPS2)


def pedal_mps2(control: ControlInput, gains: PedalGains) -> float:
    """Acceleration that the pedals cause."""
    return control.throttle * gains.throttle_mps2 - control.brake_n * gains.brake_mps2_per_n


def lagged_mps2(before_mps2: float, pedals_mps2: float) -> float:
    """Acceleration that the pedals cause by now, from that of one period before."""
    return before_mps2 + PERIOD_S / PEDAL_LAG_S * (pedals_mps2 - before_mps2)


def next_disturbance(disturbance_mps2: float, found_mps2: float) -> float:
    """The estimate one period later, from the acceleration that the pedals do not explain."""
    share = PERIOD_S / DISTURBANCE_TIME_S
    estimate = disturbance_mps2 + share * (found_mps2 - disturbance_mps2)
    return min(max(estimate, -LARGEST_DISTURBANCE_MPS2), LARGEST_DISTURBANCE_MPS2)


def pedals_for(
    acceleration_mps2: float, previous: ControlInput, gains: PedalGains
) -> tuple[float, float]:
    """(throttle, brake_n) for an acceleration by the pedals, one of them 0.

    Between the two thresholds both are released, if the wanted pedal is not pressed already.
    """
    if acceleration_mps2 < (0.0 if previous.brake_n > 0.0 else PRESS_BRAKE_MPS2):
        return 0.0, -acceleration_mps2 / gains.brake_mps2_per_n
    if acceleration_mps2 > (0.0 if previous.throttle > 0.0 else PRESS_THROTTLE_MPS2):
        return acceleration_mps2 / gains.throttle_mps2, 0.0
    return 0.0, 0.0
