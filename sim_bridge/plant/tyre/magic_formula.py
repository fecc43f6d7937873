"""Forces of a tyre from the coefficients of a `.tir` file: Magic Formula 5.2 and 6.x.

Without inflation pressure and turn slip. Axes as in these files (ISO): side force positive to the
left, slip angle positive if the wheel moves to its left, camber positive if it leans to the right.
Pacejka, Tyre and Vehicle Dynamics, 2012, sec. 4.3.2.
"""

from math import atan, cos, exp, hypot, pi, sin, sqrt
from typing import NamedTuple

from sim_bridge.plant.jit import compiled
from sim_bridge.plant.tyre.tyre_coefficients import TyreFileParameters
from sim_bridge.plant.tyre.tyres import TyreForce

_LEAST_LOAD_SHARE = 0.02
_LEAST = 1e-6


class PureSlip(NamedTuple):
    """Force of pure slip, with what other formulas need from it."""

    force_n: float
    stiffness_n: float
    peak_n: float
    """with the sign of PDX1 or PDY1"""
    shift: float
    offset_n: float
    steepness: float


@compiled
def _sine_n(slip: float, stiffness_n: float, peak_n: float, shape: float, bend: float) -> float:
    scaled = stiffness_n / (shape * peak_n) * slip
    return peak_n * sin(shape * atan(scaled - bend * (scaled - atan(scaled))))


@compiled
def _cosine(slip: float, steepness: float, shape: float, bend: float) -> float:
    scaled = steepness * slip
    return cos(shape * atan(scaled - bend * (scaled - atan(scaled))))


@compiled
def longitudinal(
    slip: float, camber: float, load_n: float, road: float, t: TyreFileParameters
) -> PureSlip:
    """Longitudinal force of pure slip."""
    nominal_n = t.fnomin * t.lfzo
    excess = load_n / nominal_n - 1.0
    shift = (t.phx1 + t.phx2 * excess) * t.lhx
    offset_n = load_n * (t.pvx1 + t.pvx2 * excess) * t.lvx * t.lmux * road
    friction = (t.pdx1 + t.pdx2 * excess) * (1.0 - t.pdx3 * camber * camber) * t.lmux * road
    peak_n = max(_LEAST, friction) * load_n
    stiffness_n = load_n * (t.pkx1 + t.pkx2 * excess) * exp(t.pkx3 * excess) * t.lkx
    shifted = slip + shift
    sign = 1.0 if shifted >= 0.0 else -1.0
    bend = (t.pex1 + t.pex2 * excess + t.pex3 * excess * excess) * (1.0 - t.pex4 * sign) * t.lex
    shape = t.pcx1 * t.lcx
    force_n = _sine_n(shifted, stiffness_n, peak_n, shape, min(1.0, bend)) + offset_n
    return PureSlip(force_n, stiffness_n, peak_n, shift, offset_n, stiffness_n / (shape * peak_n))


@compiled
def lateral(
    slip_angle: float, camber: float, load_n: float, road: float, t: TyreFileParameters
) -> PureSlip:
    """Side force of pure slip."""
    nominal_n = t.fnomin * t.lfzo
    excess = load_n / nominal_n - 1.0
    share = load_n / ((t.pky2 + t.pky5 * camber * camber) * nominal_n)
    stiffness_n = (
        t.pky1 * nominal_n * (1.0 - t.pky3 * abs(camber)) * sin(t.pky4 * atan(share)) * t.lky
    )
    camber_offset_n = load_n * (t.pvy3 + t.pvy4 * excess) * camber * t.lmuy * road
    offset_n = load_n * (t.pvy1 + t.pvy2 * excess) * t.lvy * t.lmuy * road + camber_offset_n
    shift = (t.phy1 + t.phy2 * excess) * t.lhy + t.phy3 * camber
    if t.pky6 != 0.0 or t.pky7 != 0.0:
        # Since version 6 the shift by camber follows from the camber stiffness.
        camber_n = load_n * (t.pky6 + t.pky7 * excess) * camber
        shift += (camber_n - camber_offset_n) / min(-_LEAST, stiffness_n)
    friction = (t.pdy1 + t.pdy2 * excess) * (1.0 - t.pdy3 * camber * camber) * t.lmuy * road
    # With a negative PDY1 the steepness is positive; the force is the same.
    peak_n = max(_LEAST, friction) * load_n if t.pdy1 > 0.0 else min(-_LEAST, friction) * load_n
    shifted = slip_angle + shift
    sign = 1.0 if shifted >= 0.0 else -1.0
    bend = (t.pey1 + t.pey2 * excess) * t.ley
    bend *= 1.0 + t.pey5 * camber * camber - (t.pey3 + t.pey4 * camber) * sign
    shape = t.pcy1 * t.lcy
    force_n = _sine_n(shifted, stiffness_n, peak_n, shape, min(1.0, bend)) + offset_n
    return PureSlip(force_n, stiffness_n, peak_n, shift, offset_n, stiffness_n / (shape * peak_n))


@compiled
def force(
    lateral_slip: float,
    longitudinal_slip: float,
    lean_rad: float,
    load_n: float,
    road_friction: float,
    mirror: float,
    t: TyreFileParameters,
) -> TyreForce:
    """Force and aligning moment of one tyre, with the arguments of `tyres.force`.

    Args:
        lateral_slip: tangent of the slip angle, positive if the force points left.
        longitudinal_slip: positive if the wheel drives.
        lean_rad: to the right.
        load_n: vertical.
        road_friction: against the road of the tyre test; multiplies the peaks.
        mirror: -1 if the file is of a tyre of the other side of the car, else 1.
        t: the coefficients.
    """
    if load_n <= _LEAST_LOAD_SHARE * t.fnomin:
        return TyreForce(0.0, 0.0, 0.0)
    angle = -mirror * lateral_slip
    camber = mirror * lean_rad
    along = longitudinal_slip
    excess = load_n / (t.fnomin * t.lfzo) - 1.0
    x = longitudinal(along, t.lgax * camber, load_n, road_friction, t)
    y = lateral(angle, t.lgay * camber, load_n, road_friction, t)

    steepness = (t.rbx1 + t.rbx3 * camber * camber) * cos(atan(t.rbx2 * along)) * t.lxal
    bend = min(1.0, t.rex1 + t.rex2 * excess)
    centre = _cosine(t.rhx1, steepness, t.rcx1, bend)
    forward_n = x.force_n * max(0.0, _cosine(angle + t.rhx1, steepness, t.rcx1, bend) / centre)

    steepness = (t.rby1 + t.rby4 * camber * camber) * cos(atan(t.rby2 * (angle - t.rby3)))
    bend = min(1.0, t.rey1 + t.rey2 * excess)
    shift = t.rhy1 + t.rhy2 * excess
    centre = _cosine(shift, steepness * t.lyka, t.rcy1, bend)
    left_n = y.force_n * max(0.0, _cosine(along + shift, steepness * t.lyka, t.rcy1, bend) / centre)
    drag_n = y.peak_n * (t.rvy1 + t.rvy2 * excess + t.rvy3 * camber) * cos(atan(t.rvy4 * angle))
    drag_n *= sin(t.rvy5 * atan(t.rvy6 * along)) * t.lvyka
    aligning_nm = _aligning_nm(
        angle, along, t.lgaz * camber, load_n, road_friction, forward_n, left_n, x, y, t
    )
    left_n += drag_n

    # Offsets and weights may leave the friction ellipse: bring the force back to it.
    share = hypot(
        forward_n / (x.peak_n + abs(x.offset_n)), left_n / (abs(y.peak_n) + abs(y.offset_n))
    )
    if share > 1.0:
        forward_n, left_n = forward_n / share, left_n / share
    return TyreForce(forward_n, mirror * left_n, mirror * aligning_nm)


@compiled
def _aligning_nm(
    angle: float,
    along: float,
    camber: float,
    load_n: float,
    road: float,
    forward_n: float,
    left_n: float,
    x: PureSlip,
    y: PureSlip,
    t: TyreFileParameters,
) -> float:
    """Aligning moment: pneumatic trail, residual moment and arm of the longitudinal force."""
    nominal_n = t.fnomin * t.lfzo
    excess = load_n / nominal_n - 1.0
    friction = t.lmuy * road
    stiffness_n = min(-_LEAST, y.stiffness_n)
    ratio = x.stiffness_n / stiffness_n * along
    cosine = 1.0 / sqrt(1.0 + angle * angle)

    shift = t.qhz1 + t.qhz2 * excess + (t.qhz3 + t.qhz4 * excess) * camber
    trailing = _equivalent(angle + shift, ratio)
    steepness = t.qbz1 + t.qbz2 * excess + t.qbz3 * excess * excess
    steepness *= (1.0 + t.qbz4 * camber + t.qbz5 * abs(camber)) * t.lky / friction
    peak_m = load_n * t.unloaded_radius / nominal_n * (t.qdz1 + t.qdz2 * excess) * t.ltr
    peak_m *= 1.0 + t.qdz3 * camber + t.qdz4 * camber * camber
    bend = t.qez1 + t.qez2 * excess + t.qez3 * excess * excess
    bend *= 1.0 + (t.qez4 + t.qez5 * camber) * 2.0 / pi * atan(steepness * t.qcz1 * trailing)
    trail_m = peak_m * _cosine(trailing, steepness, t.qcz1, min(1.0, bend)) * cosine

    rest = _equivalent(angle + y.shift + y.offset_n / stiffness_n, ratio)
    rest_steepness = t.qbz9 * t.lky / friction + t.qbz10 * y.steepness * t.pcy1 * t.lcy
    rest_nm = (t.qdz6 + t.qdz7 * excess) * t.lres
    rest_nm += (t.qdz8 + t.qdz9 * excess) * camber
    rest_nm += (t.qdz10 + t.qdz11 * excess) * camber * abs(camber)
    rest_nm *= load_n * t.unloaded_radius * friction * cos(atan(rest_steepness * rest)) * cosine

    arm_m = t.ssz1 + t.ssz2 * left_n / nominal_n + (t.ssz3 + t.ssz4 * excess) * camber
    arm_m *= t.unloaded_radius * t.ls
    return -trail_m * left_n + rest_nm + arm_m * forward_n


@compiled
def _equivalent(angle: float, ratio: float) -> float:
    """Slip angle that stands for both slips."""
    size = atan(hypot(angle, ratio))
    return size if angle >= 0.0 else -size
