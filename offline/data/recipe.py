"""What an episode is drawn from: the driver's inputs after the paper's recipe, and the conditions.

Conditions are road, wind, load and tyres, which the state does not contain. All are pure functions
of a random generator. Bounds and rates of the inputs are those of the controller
(`rt_controller.contract.limits`), so that the model is trained on the inputs that the controller
can plan. Paper: section III-A, data acquisition.
"""

from dataclasses import dataclass
from math import radians
from typing import NamedTuple

import numpy as np

from offline.data.variation import NOMINAL, Variation, describe
from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS, PEDAL_CHANGE_S, PLAN_STEER_RAD, InputLimits
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.plant.parameters import (
    Parameters,
    default_car,
    with_cornering_stiffness,
    with_mass_factor,
    with_payload,
)
from sim_bridge.plant.parts import Payload, RoadParameters


def monotone_cubic(knot_t: Array, knot_y: Array, t: Array) -> Array:
    """Values at t of the cubic Hermite spline through the knots that does not overshoot them.

    Slopes are weighted harmonic means of the neighbouring secants, zero where these change sign
    (Fritsch and Butland, 1984). Written out, because scipy rounds differently and the digests of
    the data sets that the shipped models were trained on depend on the last bit.
    """
    width = np.diff(knot_t)
    secant = np.diff(knot_y) / width
    left, right = secant[:-1], secant[1:]
    w_left, w_right = 2 * width[1:] + width[:-1], width[1:] + 2 * width[:-1]
    same_sign = left * right > 0
    safe_left, safe_right = np.where(same_sign, left, 1.0), np.where(same_sign, right, 1.0)
    harmonic = (w_left + w_right) / (w_left / safe_left + w_right / safe_right)
    inner = np.where(same_sign, harmonic, 0.0)
    slope = np.concatenate([secant[:1], inner, secant[-1:]])

    i = np.clip(np.searchsorted(knot_t, t, side="right") - 1, 0, len(width) - 1)
    h = width[i]
    s = (t - knot_t[i]) / h
    return np.asarray(
        (1 + 2 * s) * (1 - s) ** 2 * knot_y[i]
        + s * (1 - s) ** 2 * h * slope[i]
        + s**2 * (3 - 2 * s) * knot_y[i + 1]
        + s**2 * (s - 1) * h * slope[i + 1]
    )


@dataclass(frozen=True, slots=True)
class Recipe:
    """The values that an episode is drawn from."""

    curvatures_per_m: tuple[float, ...] = (-4e-3, -2e-3, 0.0, 2e-3, 4e-3)
    first_speed_mps: tuple[float, float] = (15.0 / 3.6, 130.0 / 3.6)
    segment_s: tuple[float, ...] = (0.5, 1.0, 2.0)
    throttles: tuple[float, ...] = (0.0, 0.03, 0.06, 0.1, 0.15, 0.25, 0.4, 0.7, 1.0)
    """dense where a car is driven at constant speed; c_class_125kw_fwd holds 120 km/h at 0.15"""
    brakes_n: tuple[float, ...] = (0.0, 15.0, 30.0, 50.0, 75.0, 100.0, 150.0)
    drive_brake_coast: tuple[float, float, float] = (0.55, 0.25, 0.20)
    steering_knots: tuple[int, ...] = (2, 3, 4, 6)
    steering_window_s: float = 2.0
    """duration over which the knots above are spread"""
    variation: Variation | None = None
    """of road, wind, load and tyres; None: those of the car file, and no wind"""
    largest_steer_deg: float | None = None
    """of the steering wheel at any speed, at least 40; None: what a plan may use, up to 300"""

    @property
    def largest_steer_rad(self) -> float:
        """The largest angle of the steering wheel at any speed."""
        degrees = self.largest_steer_deg
        return PLAN_STEER_RAD if degrees is None else radians(degrees)

    @property
    def text(self) -> str:
        """The conditions, and the largest angle of the steering wheel if it was chosen."""
        angle = self.largest_steer_deg
        steering = "" if angle is None else f", steering wheel up to {angle:g} deg"
        return describe(self.variation) + steering


class Pedals(NamedTuple):
    """Target pedal positions of one segment."""

    throttle: float
    brake_n: float


def draw_inputs(
    rng: np.random.Generator,
    recipe: Recipe,
    periods: int,
    most_steer_rad: float = INPUT_LIMITS.upper.steer_rad,
) -> Array:
    """Inputs of one episode, (periods, 3) as `ControlInput`, within bounds and rates.

    At the start pedals are released and the steering is straight. The largest angle of the wheel is
    drawn between that of the paper and `most_steer_rad`, the largest one that a plan may use at the
    first speed: the car is steered little and much at every speed.
    """
    pedals = follow_pedals(draw_pedal_targets(rng, recipe, periods), INPUT_LIMITS)
    largest_rad = float(rng.uniform(INPUT_LIMITS.upper.steer_rad, most_steer_rad))
    steering = draw_steering(rng, recipe, periods, largest_rad)
    steering = limit_rate(steering, INPUT_LIMITS.rate_per_s.steer_rad)
    return np.column_stack([pedals, steering])


def draw_pedal_targets(rng: np.random.Generator, recipe: Recipe, periods: int) -> list[Pedals]:
    """Target of each period, constant over segments of one random length."""
    length = round(float(rng.choice(recipe.segment_s)) / PERIOD_S)
    targets: list[Pedals] = []
    while len(targets) < periods:
        intent = rng.choice(3, p=recipe.drive_brake_coast)
        throttle, brake_n = rng.choice(recipe.throttles), rng.choice(recipe.brakes_n)
        target = Pedals(
            throttle=float(throttle) if intent == 0 else 0.0,
            brake_n=float(brake_n) if intent == 1 else 0.0,
        )
        targets += [target] * length
    return targets[:periods]


def follow_pedals(targets: list[Pedals], limits: InputLimits) -> Array:
    """Pedals (periods, 2) that follow their targets at limited rates.

    A pedal is pressed only if the other has been released for `PEDAL_CHANGE_S`.
    """
    change = round(PEDAL_CHANGE_S / PERIOD_S)
    throttle_step = limits.rate_per_s.throttle * PERIOD_S
    brake_step = limits.rate_per_s.brake_n * PERIOD_S
    throttle = brake_n = 0.0
    throttle_released = brake_released = change
    pedals = np.empty((len(targets), 2))
    for k, target in enumerate(targets):
        target_throttle = target.throttle if brake_released >= change else 0.0
        target_brake_n = target.brake_n if throttle_released >= change else 0.0
        throttle += min(max(target_throttle - throttle, -throttle_step), throttle_step)
        brake_n += min(max(target_brake_n - brake_n, -brake_step), brake_step)
        throttle_released = throttle_released + 1 if throttle == 0.0 else 0
        brake_released = brake_released + 1 if brake_n == 0.0 else 0
        pedals[k] = throttle, brake_n
    return pedals


def draw_steering(
    rng: np.random.Generator, recipe: Recipe, periods: int, largest_rad: float
) -> Array:
    """Steering wheel angle (periods,) through random knots, continuous with its slope."""
    knots_per_window = int(rng.choice(recipe.steering_knots))
    spacing_s = recipe.steering_window_s / knots_per_window
    n_knots = int(np.ceil(periods * PERIOD_S / spacing_s)) + 1
    knots = rng.uniform(-largest_rad, largest_rad, size=n_knots)
    knot_t = spacing_s * np.arange(n_knots, dtype=np.float64)
    angle = monotone_cubic(knot_t, knots, PERIOD_S * np.arange(periods, dtype=np.float64))
    return np.clip(angle, -largest_rad, largest_rad)


def limit_rate(signal: Array, rate_per_s: float) -> Array:
    """The signal (periods,), followed from zero at most at `rate_per_s`."""
    step = rate_per_s * PERIOD_S
    limited = np.empty_like(signal)
    value = 0.0
    for k, target in enumerate(signal):
        value += min(max(target - value, -step), step)
        limited[k] = value
    return limited


Range = tuple[float, float]

CONDITIONS = (*RoadParameters._fields, "mass_factor", "cg_ahead_m", "stiffness_factor")
"""columns: road and wind in the axes of the car; mass with the load, relative to the car file;
shift of the centre of gravity by the load, positive forward; cornering stiffness, relative to the
car file"""
FRICTION_COLUMNS = [CONDITIONS.index("friction_left"), CONDITIONS.index("friction_right")]

SLOW_KNOT_S = 5.0
"""spacing of the random points of bank, grade and mean wind in a changing episode"""
GUST_KNOT_S = 1.5
PATCH_S = (0.5, 3.0)
"""duration of a patch, and of the road between two patches"""


class Conditions(NamedTuple):
    """The conditions of one episode."""

    car: Parameters
    """loaded, on the road of the first period"""
    roads: Array
    """(periods, 6) as `RoadParameters`"""
    rows: Array
    """(periods, q) as `CONDITIONS`"""


def draw_conditions(rng: np.random.Generator, variation: Variation, periods: int) -> Conditions:
    """The conditions of one episode: nominal, constant or changing."""
    kind = rng.random()
    is_changing = kind >= 1.0 - variation.changing_share
    if kind < variation.nominal_share:
        variation = NOMINAL
    nominal = default_car()
    payload = Payload(
        mass_kg=_draw(rng, variation.payload_kg, 0.0),
        ahead_m=_draw(rng, variation.payload_ahead_m, 0.0),
    )
    stiffness_factor = _draw(rng, variation.stiffness_factor, 1.0)
    car = with_mass_factor(nominal, _draw(rng, variation.mass_factor, 1.0))
    car = with_cornering_stiffness(with_payload(car, payload), stiffness_factor)
    roads = _draw_roads(rng, variation, nominal.road, periods, is_changing)
    load = (
        car.body.mass_kg / nominal.body.mass_kg,
        nominal.body.front_axle_m - car.body.front_axle_m,
        stiffness_factor,
    )
    return Conditions(
        car._replace(road=RoadParameters(*roads[0].tolist())),
        roads,
        np.hstack([roads, np.tile(load, (periods, 1))]),
    )


def _draw_roads(
    rng: np.random.Generator,
    variation: Variation,
    nominal: RoadParameters,
    periods: int,
    is_changing: bool,
) -> Array:
    """(periods, 6) as `RoadParameters`."""
    columns = {name: np.full(periods, value) for name, value in nominal._asdict().items()}
    if variation.friction is not None:
        level = rng.uniform(*variation.friction)
        columns["friction_left"][:] = columns["friction_right"][:] = level
    for name in ("bank_rad", "grade_rad", "wind_forward_mps", "wind_left_mps"):
        limits = getattr(variation, name)
        if limits is not None and is_changing:
            columns[name][:] = _draw_curve(rng, limits, SLOW_KNOT_S, periods)
        elif limits is not None:
            columns[name][:] = rng.uniform(*limits)
    if is_changing:
        gust = (-variation.gust_mps, variation.gust_mps)
        for name in ("wind_forward_mps", "wind_left_mps"):
            columns[name] += _draw_curve(rng, gust, GUST_KNOT_S, periods)
    roads = np.column_stack(list(columns.values()))
    if is_changing and variation.patch_friction is not None:
        _lay_patches(rng, variation.patch_friction, roads)
    return roads


def _lay_patches(rng: np.random.Generator, limits: Range, roads: Array) -> None:
    """Write patches of other friction into `roads`."""
    left, right = FRICTION_COLUMNS
    row = round(rng.uniform(0.0, PATCH_S[1]) / PERIOD_S)
    while row < len(roads):
        end = row + round(rng.uniform(*PATCH_S) / PERIOD_S)
        sides = ([left, right], [left], [right])[rng.integers(3)]
        roads[row:end, sides] = rng.uniform(*limits)
        row = end + round(rng.uniform(*PATCH_S) / PERIOD_S)


def _draw_curve(rng: np.random.Generator, limits: Range, spacing_s: float, periods: int) -> Array:
    """(periods,) values of a smooth curve through random points at equal distances in time."""
    t = PERIOD_S * np.arange(periods, dtype=np.float64)
    knot_t = spacing_s * np.arange(int(t[-1] / spacing_s) + 2, dtype=np.float64)
    return monotone_cubic(knot_t, rng.uniform(*limits, size=len(knot_t)), t)


def _draw(rng: np.random.Generator, limits: Range | None, otherwise: float) -> float:
    return otherwise if limits is None else float(rng.uniform(*limits))
