"""Tyres: lagged slip (relaxation length), and the friction force from the lagged slip.

Each direction has its Magic Formula of pure slip; under combined slip each force is weighted by the
slip in the other direction. The aligning moment is side force times a trail that becomes zero where
the contact slides.
Pacejka, Tyre and Vehicle Dynamics, 2012: ch. 4 (formula, weights, similarity), ch. 7 (relaxation).
"""

from math import atan, cos, hypot, sin, sqrt
from typing import NamedTuple

from sim_bridge.plant.car_parts import TyreParameters
from sim_bridge.plant.jit import compiled

_LEAST_LATERAL_RELAXATION = 0.2
_LEAST_LONGITUDINAL_RELAXATION = 0.2
_LARGEST_SLIP = 3.0
_LEAST_LOAD_FACTOR = 0.3
"""lower limit of the influence of the load on friction"""


class SlipRates(NamedTuple):
    """Linear lag of one slip: its rate is `rate - decay * slip`."""

    rate: float
    decay: float
    damping: float
    """added to the slip for the force: material damping of the tyre"""


class TyreForce(NamedTuple):
    """Force of the road on one tyre in the wheel's own axes, and the moment around its vertical."""

    forward_n: float
    left_n: float
    aligning_nm: float


@compiled
def lateral_relaxation(
    slip: float, forward_mps: float, left_mps: float, load_n: float, tyre: TyreParameters
) -> SlipRates:
    """Lag of the tangent of the slip angle; its length decreases as the tyre starts to slide."""
    length_m = tyre.lateral_relaxation_m * max(load_n, 500.0) / tyre.relaxation_load_n
    start, end = tyre.lateral_relaxation_start_slip, tyre.lateral_relaxation_end_slip
    left = min(1.0, max(_LEAST_LATERAL_RELAXATION, (end - abs(slip)) / (end - start)))
    return _relaxation(slip, forward_mps, -left_mps, length_m, left, tyre.lateral_damping_s, tyre)


@compiled
def longitudinal_relaxation(
    slip: float, forward_mps: float, rim_mps: float, load_n: float, tyre: TyreParameters
) -> SlipRates:
    """Lag of the slip ratio, as `lateral_relaxation`; `rim_mps` is spin times rolling radius."""
    length_m = tyre.longitudinal_relaxation_m * max(load_n, 500.0) / tyre.relaxation_load_n
    left = max(
        _LEAST_LONGITUDINAL_RELAXATION, 1.0 - abs(slip) / tyre.longitudinal_relaxation_end_slip
    )
    sliding_mps, damping_s = rim_mps - forward_mps, tyre.longitudinal_damping_s
    return _relaxation(slip, forward_mps, sliding_mps, length_m, left, damping_s, tyre)


@compiled
def _relaxation(
    slip: float,
    forward_mps: float,
    sliding_mps: float,
    length_m: float,
    left: float,
    damping_s: float,
    tyre: TyreParameters,
) -> SlipRates:
    """Lag of a slip over a length of which the share `left` remains.

    Written with the sliding velocity instead of the slip: there is no division by the speed. The
    material damping decreases with the rolling speed.
    """
    speed_mps = abs(forward_mps)
    change = sliding_mps - speed_mps * slip
    end_mps = tyre.damping_end_mps
    damping = damping_s * end_mps / (end_mps + speed_mps) * change / length_m
    return SlipRates(sliding_mps / (length_m * left), speed_mps / (length_m * left), damping)


@compiled
def cornering_stiffness_npr(load_n: float, tyre: TyreParameters) -> float:
    """Lateral force per radian of small slip angle: degressive in the load."""
    relative = load_n / tyre.cornering_stiffness_load_n
    return tyre.cornering_stiffness_npr * 2.0 * relative / (1.0 + relative * relative)


@compiled
def _limit_n(
    load_n: float, friction: float, friction_per_load: float, tyre: TyreParameters
) -> float:
    excess = load_n / tyre.reference_load_n - 1.0
    return friction * max(_LEAST_LOAD_FACTOR, 1.0 + friction_per_load * excess) * load_n


@compiled
def lateral_limit_n(load_n: float, tyre: TyreParameters) -> float:
    """Largest lateral force on the reference road."""
    return _limit_n(load_n, tyre.lateral_friction, tyre.lateral_friction_per_load, tyre)


@compiled
def longitudinal_limit_n(load_n: float, tyre: TyreParameters) -> float:
    """Largest longitudinal force on the reference road."""
    return _limit_n(load_n, tyre.longitudinal_friction, tyre.longitudinal_friction_per_load, tyre)


@compiled
def magic_formula_n(
    slip: float, stiffness_n: float, limit_n: float, shape: float, curvature: float
) -> float:
    """Force of pure slip: D sin(C atan(B x - E (B x - atan(B x)))) with B C D the stiffness."""
    scaled = stiffness_n / (shape * limit_n) * slip
    return limit_n * sin(shape * atan(scaled - curvature * (scaled - atan(scaled))))


@compiled
def weight(slip: float, other_slip: float, steepness: float) -> float:
    """Share of a force that remains under slip across it: cos(atan(B s)).

    B itself decreases with the slip along the force, by cos(atan(B s')). With the same steepness
    in both places the force of a sliding tyre is exactly opposite to its sliding velocity.
    """
    along = steepness * slip
    across = steepness * other_slip
    return sqrt((1.0 + along * along) / (1.0 + along * along + across * across))


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

    Friction by similarity: the force on a road of friction mu is mu f(slip / mu), so the stiffness
    of the tyre does not change. Pacejka 2012, sec. 4.2.
    """
    if load_n <= 0.0:
        return TyreForce(0.0, 0.0, 0.0)
    sideways = (lateral_slip - tyre.camber_slip * lean_rad) / road_friction
    along = longitudinal_slip / road_friction
    left_n = magic_formula_n(
        sideways,
        cornering_stiffness_npr(load_n, tyre),
        lateral_limit_n(load_n, tyre),
        tyre.lateral_shape,
        tyre.lateral_curvature,
    )
    forward_n = magic_formula_n(
        along,
        tyre.slip_stiffness * load_n,
        longitudinal_limit_n(load_n, tyre),
        tyre.longitudinal_shape,
        tyre.longitudinal_curvature,
    )
    left_n *= road_friction * weight(sideways, along, tyre.lateral_weight)
    forward_n *= road_friction * weight(along, sideways, tyre.longitudinal_weight)
    # The weights alone let a diagonal force exceed the friction ellipse by a few percent.
    share = hypot(
        forward_n / longitudinal_limit_n(load_n, tyre), left_n / lateral_limit_n(load_n, tyre)
    )
    if share > road_friction:
        forward_n *= road_friction / share
        left_n *= road_friction / share
    # The trail ends where the whole contact slides, so it depends on the combined slip.
    trail_m = tyre.trail_m * cos(
        tyre.trail_shape * atan(tyre.trail_stiffness * hypot(sideways, along))
    )
    return TyreForce(forward_n, left_n, -trail_m * left_n)


@compiled
def largest_slip(speed_mps: float, road_friction: float, tyre: TyreParameters) -> float:
    """Limit of the lagged slips of a slow tyre.

    At rest a slip is the deflection of the carcass over the relaxation length. It ends where the
    contact slides, and is not the slip -1 with which a locked wheel came to rest: that deflection
    would push the car back.

    Args:
        speed_mps: the larger one of the speeds of wheel centre and rim.
    """
    sliding = road_friction * tyre.longitudinal_friction / tyre.slip_stiffness
    return min(_LARGEST_SLIP, sliding + speed_mps)


@compiled
def rolling_resistance_nm(spin_radps: float, load_n: float, tyre: TyreParameters) -> float:
    """Torque against the rolling of a loaded tyre, applied as dry friction."""
    speed_mps = abs(spin_radps) * tyre.rolling_radius_m
    coefficient = tyre.rolling_resistance + tyre.rolling_resistance_spm * speed_mps
    return coefficient * load_n * tyre.rolling_radius_m
