"""One description of the car: geometry, limits of its inputs, brake, and thresholds of the checks.

The bundle of a model carries it, and the mapping file of a car with messages of its own. Checks,
limits, low-speed law, envelope and gateway read it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from typing import Any, NamedTuple

from rt_controller.contract.limits import (
    DEFAULT_GEOMETRY,
    INPUT_LIMITS,
    InputLimits,
    SteeringGeometry,
)
from rt_controller.contract.names import hint
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import ControlInput

_, _UPPER, _RATE = INPUT_LIMITS
ACCEPTED = 0.97
"""share of the lateral acceleration that the vehicle accepts, whose speed may differ a little"""


class CarValue(NamedTuple):
    """What a table [car] may say for one value."""

    low: float
    high: float
    default: float | None = None
    doc: str = ""


def _value(low: float, high: float, default: float | None, doc: str) -> Any:
    return field(default=default, metadata={"row": CarValue(low, high, default, doc)})


def _limit(low: float, default: float, doc: str) -> Any:
    """A value that ends at its default: the models are trained within it."""
    return _value(low, default, default, doc)


@dataclass(frozen=True)
class Car:
    """The values of the table [car]; one that is not given has its default."""

    wheelbase_m: float = _value(0.5, 10.0, DEFAULT_GEOMETRY.wheelbase_m, "front axle to rear axle")
    rear_axle_m: float = _value(
        0.0, 10.0, DEFAULT_GEOMETRY.rear_axle_m, "centre of gravity to rear axle"
    )
    steering_ratio: float = _value(
        1.0, 100.0, DEFAULT_GEOMETRY.steering_ratio, "wheel angle over front wheel angle"
    )
    lock_rad: float = _value(0.1, 30.0, _UPPER.steer_rad, "largest angle of the steering wheel")
    largest_brake_n: float = _limit(10.0, _UPPER.brake_n, "largest command of the brake")
    throttle_rate_per_s: float = _limit(0.2, _RATE.throttle, "largest change in a second")
    brake_rate_n_per_s: float = _limit(50.0, _RATE.brake_n, "largest change in a second")
    steer_rate_radps: float = _limit(0.3, _RATE.steer_rad, "largest speed of the steering wheel")
    plan_lateral_mps2: float = _limit(
        1.0, 7.0, "lateral acceleration up to which a plan turns the wheel further than 40 deg"
    )
    largest_lateral_mps2: float = _limit(
        1.0, 7.5, "lateral acceleration of a command in steady state; the vehicle refuses more"
    )
    path_lateral_mps2: float = _limit(
        1.0, 8.5, "lateral acceleration that a path may need: what a car can do on a dry road"
    )
    throttle_mps2: float | None = _value(
        0.5, 15.0, None, "acceleration of the full throttle at low speed"
    )
    brake_mps2_per_n: float | None = _value(
        0.005, 0.5, None, "deceleration per newton on the brake pedal"
    )
    rear_slip_s2_per_m: float | None = _value(
        1e-4, 0.05, None, "side-slip angle of the rear axle per lateral acceleration, for v_y"
    )
    yaw_inertia_m: float | None = _value(
        0.0, 10.0, None, "yaw inertia over mass and distance from centre of gravity to front axle"
    )
    thresholds: Mapping[str, float] = field(default_factory=dict)
    """of plausibility checks, by the lower-case name of their quantity; others keep theirs"""

    @cached_property
    def geometry(self) -> SteeringGeometry:
        return SteeringGeometry(
            self.wheelbase_m, self.rear_axle_m, self.steering_ratio, self.lock_rad
        )

    @cached_property
    def limits(self) -> InputLimits:
        """Bounds and rates of the inputs."""
        return INPUT_LIMITS._replace(
            upper=_UPPER._replace(brake_n=self.largest_brake_n),
            rate_per_s=ControlInput(
                self.throttle_rate_per_s, self.brake_rate_n_per_s, self.steer_rate_radps
            ),
        )

    @cached_property
    def accepted_mps2(self) -> float:
        """Lateral acceleration of a steady turn that a command may ask for."""
        return ACCEPTED * self.largest_lateral_mps2

    def largest_plan_rad(self, vx_mps: float, model_rad: float) -> float:
        """Bound of the wheel angle of a plan at this speed; the vehicle accepts every such angle.

        `model_rad`: largest angle that the model was trained with.
        """
        by_speed_rad = self.geometry.largest_wheel_rad(
            vx_mps, self.plan_lateral_mps2, self.accepted_mps2
        )
        return min(by_speed_rad, model_rad)

    @property
    def force_scale(self) -> float:
        """Force on the brake pedal over that of the default car, for the same deceleration.

        The default car brakes by 0.05 m/s^2 per newton; the forces of a stop are given for it.
        """
        return 1.0 if self.brake_mps2_per_n is None else 0.05 / self.brake_mps2_per_n

    @property
    def own_values(self) -> dict[str, Any]:
        """The values, except those of the geometry, that are not the default ones."""
        default = asdict(UNNAMED_CAR)
        return {
            name: value
            for name, value in asdict(self).items()
            if name not in SteeringGeometry._fields and value != default[name]
        }


UNNAMED_CAR = Car()
"""for models of an unnamed car: its lock is not known"""
DEFAULT_CAR = Car(*DEFAULT_GEOMETRY)
CAR_VALUES: Mapping[str, CarValue] = {
    each.name: each.metadata["row"] for each in fields(Car) if each.metadata
}
"""the table [car], without its thresholds"""
THRESHOLDS = dict.fromkeys((each.name.lower() for each in Quantity), CarValue(1e-6, 1e6))
"""of the plausibility checks"""


def car_of(table: Mapping[str, Any]) -> Car:
    """The car of the values of a table [car]; None and missing: the default.

    Raises:
        ValueError: values that are unknown, no numbers, or outside their range; all are named.
    """
    found = {name: value for name, value in table.items() if value is not None}
    thresholds = found.pop("thresholds", {})
    if not isinstance(thresholds, Mapping):
        raise ValueError(f"thresholds: expected a table, found {thresholds!r:.40}")
    wrong = [*_objections(found, CAR_VALUES), *_objections(thresholds, THRESHOLDS, "thresholds.")]
    if wrong:
        raise ValueError("; ".join(wrong))
    return Car(**found, thresholds=dict(thresholds))


def _objections(
    values: Mapping[str, Any], known: Mapping[str, CarValue], place: str = ""
) -> Iterator[str]:
    for name, value in values.items():
        if name not in known:
            yield f"{place}{name}: no such value{hint(name, known)}. Known: {', '.join(known)}"
        elif isinstance(value, bool) or not isinstance(value, int | float):
            yield f"{place}{name}: expected a number, found {value!r:.40}"
        elif not known[name].low <= value <= known[name].high:
            low, high = known[name][:2]
            yield f"{place}{name}: expected {low:g} to {high:g}, found {value!r:.40}"
