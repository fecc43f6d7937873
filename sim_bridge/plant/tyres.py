"""Tyres: slip behind its relaxation length, and the friction force that slip makes.

The force is one Magic Formula of the combined slip, pointing along it: both pure curves have the
same shape over slip divided by slip at the peak, so a sliding wheel is pulled against its sliding.
Pacejka, Tyre and Vehicle Dynamics, 2012: ch. 4 (formula, similarity method), ch. 7 (relaxation).
"""

from math import atan, hypot, sin
from typing import NamedTuple

from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import TyreParameters

_LEAST_LATERAL_RELAXATION = 0.02
_LEAST_LONGITUDINAL_RELAXATION = 0.05


class SlipRates(NamedTuple):
    """Linear lag of one slip: its rate is `rate - decay * slip`."""

    rate: float
    decay: float
    damping: float
    """what the tyre's material damping adds to the slip that makes force"""


class TyreForce(NamedTuple):
    """Force of the road on one tyre in the wheel's own axes, and the moment around its vertical."""

    forward_n: float
    left_n: float
    aligning_nm: float


@compiled
def _damping(at_rest_s: float, forward_mps: float, tyre: TyreParameters) -> float:
    """Material damping; a rolling tyre loses it as fresh rubber enters the contact."""
    return at_rest_s * tyre.damping_end_mps / (tyre.damping_end_mps + abs(forward_mps))


@compiled
def lateral_relaxation(
    slip: float, forward_mps: float, left_mps: float, load_n: float, tyre: TyreParameters
) -> SlipRates:
    """Lag of the tangent of the slip angle, over a length that fades as the tyre starts to slide.

    Written with the sliding velocity instead of the slip, it needs no division by the speed.
    """
    length_m = tyre.lateral_relaxation_m * max(load_n, 500.0) / tyre.relaxation_load_n
    left = max(_LEAST_LATERAL_RELAXATION, 1.0 - abs(slip) / tyre.lateral_relaxation_end_slip)
    change = -left_mps - abs(forward_mps) * slip
    faded_m = length_m * left
    return SlipRates(
        -left_mps / faded_m,
        abs(forward_mps) / faded_m,
        _damping(tyre.lateral_damping_s, forward_mps, tyre) * change / length_m,
    )


@compiled
def longitudinal_relaxation(
    slip: float, forward_mps: float, rim_mps: float, load_n: float, tyre: TyreParameters
) -> SlipRates:
    """Lag of the slip ratio, as `lateral_relaxation`; `rim_mps` is spin times rolling radius."""
    length_m = tyre.longitudinal_relaxation_m * max(load_n, 500.0) / tyre.relaxation_load_n
    used = abs(slip) * tyre.longitudinal_slip_gain / tyre.peak_slip
    left = max(_LEAST_LONGITUDINAL_RELAXATION, 1.0 - used)
    change = rim_mps - forward_mps - abs(forward_mps) * slip
    faded_m = length_m * left
    return SlipRates(
        (rim_mps - forward_mps) / faded_m,
        abs(forward_mps) / faded_m,
        _damping(tyre.longitudinal_damping_s, forward_mps, tyre) * change / length_m,
    )


@compiled
def cornering_stiffness_npr(load_n: float, tyre: TyreParameters) -> float:
    """Lateral force per radian of small slip angle: grows ever more slowly with the load."""
    relative = load_n / tyre.stiffness_load_n
    return tyre.stiffness_npr * 2.0 * relative / (1.0 + relative * relative)


@compiled
def friction_limit_n(load_n: float, tyre: TyreParameters) -> float:
    """Largest horizontal force on the reference road."""
    excess = load_n / tyre.reference_load_n - 1.0
    gain = max(0.3, 1.0 + tyre.peak_friction_per_load * excess)
    return tyre.peak_friction * gain * load_n


@compiled
def force(
    lateral_slip: float,
    longitudinal_slip: float,
    lean_rad: float,
    load_n: float,
    road_friction: float,
    tyre: TyreParameters,
) -> TyreForce:
    """Force of one tyre; `lean_rad` is the wheel's lean to the right against the ground.

    Friction by similarity: a road of friction mu takes mu f(slip / mu), so the stiffness of the
    tyre stays what it is. Pacejka 2012, sec. 4.2.
    """
    if load_n <= 0.0:
        return TyreForce(0.0, 0.0, 0.0)
    sideways = lateral_slip - tyre.camber_gain * lean_rad
    along = longitudinal_slip * tyre.longitudinal_slip_gain
    combined = hypot(sideways, along)
    limit_n = friction_limit_n(load_n, tyre)
    stiffness_npr = cornering_stiffness_npr(load_n, tyre)
    if combined < 1e-9:
        return TyreForce(
            stiffness_npr * along,
            stiffness_npr * sideways,
            -tyre.trail_m * stiffness_npr * sideways,
        )
    scaled = stiffness_npr / (tyre.shape * limit_n) * combined / road_friction
    bent = scaled - tyre.curvature * (scaled - atan(scaled))
    force_n = road_friction * limit_n * sin(tyre.shape * atan(bent))
    left_n = force_n * sideways / combined
    trail_left = max(0.0, 1.0 - combined / (road_friction * tyre.trail_end_slip))
    return TyreForce(force_n * along / combined, left_n, -tyre.trail_m * trail_left * left_n)


@compiled
def rolling_resistance_nm(spin_radps: float, load_n: float, tyre: TyreParameters) -> float:
    """Torque that opposes the rolling of a loaded tyre, like dry friction in its bearing."""
    speed_mps = abs(spin_radps) * tyre.rolling_radius_m
    coefficient = tyre.rolling_resistance + tyre.rolling_resistance_spm * speed_mps
    return coefficient * load_n * tyre.rolling_radius_m
