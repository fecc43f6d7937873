"""One description of the car: geometry, limits of its inputs, brake, and thresholds of the checks.

The bundle of a model carries it, and the mapping file of a car with messages of its own. Checks,
limits, low-speed law, envelope and gateway read it.
"""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from rt_controller.contract.limits import (
    DEFAULT_GEOMETRY,
    INPUT_LIMITS,
    LARGEST,
    LARGEST_LATERAL_MPS2,
    MOST_LATERAL_MPS2,
    PLAN_TURN_MPS2,
    SMALLEST,
    UNNAMED_GEOMETRY,
    InputLimits,
    SteeringGeometry,
)
from rt_controller.contract.names import hint
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import ControlInput

DEFAULT_BRAKE_MPS2_PER_N = 0.05
"""deceleration of the default car per newton on its pedal; the forces of a stop are given for it"""
NO_THRESHOLDS: Mapping[str, float] = MappingProxyType({})


class Car(NamedTuple):
    """What has to be known of a car; a value that is not given is that of the default car."""

    geometry: SteeringGeometry = DEFAULT_GEOMETRY
    limits: InputLimits = INPUT_LIMITS
    """bounds and rates of the inputs, at most those that the models are trained with"""
    plan_lateral_mps2: float = PLAN_TURN_MPS2
    """lateral acceleration up to which a plan turns the wheel further than 40 deg"""
    largest_lateral_mps2: float = LARGEST_LATERAL_MPS2
    """that a command may ask for in steady state; the vehicle refuses more"""
    path_lateral_mps2: float = MOST_LATERAL_MPS2
    """that a path may need at its wanted speed"""
    throttle_mps2: float | None = None
    """acceleration of the full throttle at low speed; None: as the model predicts"""
    brake_mps2_per_n: float | None = None
    """deceleration per newton on the brake pedal; None: as the model predicts, and the forces of a
    stop are those of the default car"""
    thresholds: Mapping[str, float] = NO_THRESHOLDS
    """of plausibility checks, by the lower-case name of their quantity; others keep theirs"""

    @property
    def force_scale(self) -> float:
        """Force on the brake pedal over that of the default car, for the same deceleration."""
        gain = self.brake_mps2_per_n
        return 1.0 if gain is None else DEFAULT_BRAKE_MPS2_PER_N / gain

    @property
    def own_values(self) -> dict[str, Any]:
        """Of the table [car] without the geometry: the values that are not the default ones."""
        usual = DEFAULT_CAR._values()
        return {name: value for name, value in self._values().items() if value != usual[name]}

    def _values(self) -> dict[str, Any]:
        upper, rate = self.limits.upper, self.limits.rate_per_s
        return {
            "largest_brake_n": upper.brake_n,
            "throttle_rate_per_s": rate.throttle,
            "brake_rate_n_per_s": rate.brake_n,
            "steer_rate_radps": rate.steer_rad,
            **{name: getattr(self, name) for name in Car._fields[2:-1]},
            "thresholds": dict(self.thresholds),
        }


def car_of(table: Mapping[str, Any]) -> Car:
    """The car of the values of a table [car], checked by `RANGES`; None and missing: the default.

    Raises:
        ValueError: values that are unknown, no numbers, or outside their range; all are named.
    """
    found = {name: value for name, value in table.items() if value is not None}
    thresholds = found.pop("thresholds", {})
    if not isinstance(thresholds, Mapping):
        raise ValueError(f"thresholds: expected a table, found {thresholds!r:.40}")
    wrong = [
        *_objections(found, RANGES),
        *_objections(thresholds, dict.fromkeys(THRESHOLDS, THRESHOLD_RANGE), "thresholds."),
    ]
    if wrong:
        raise ValueError("; ".join(wrong))
    upper, rate = INPUT_LIMITS.upper, INPUT_LIMITS.rate_per_s
    geometry = {name: found[name] for name in SteeringGeometry._fields if name in found}
    return Car(
        UNNAMED_GEOMETRY._replace(**geometry),
        InputLimits(
            INPUT_LIMITS.lower,
            upper._replace(brake_n=found.get("largest_brake_n", upper.brake_n)),
            ControlInput(
                found.get("throttle_rate_per_s", rate.throttle),
                found.get("brake_rate_n_per_s", rate.brake_n),
                found.get("steer_rate_radps", rate.steer_rad),
            ),
        ),
        **{name: found[name] for name in Car._fields[2:-1] if name in found},
        thresholds=MappingProxyType(dict(thresholds)),
    )


def _objections(
    values: Mapping[str, Any], ranges: Mapping[str, tuple[float, float]], place: str = ""
) -> Iterator[str]:
    for name, value in values.items():
        if name not in ranges:
            yield f"{place}{name}: no such value{hint(name, ranges)}. Known: {', '.join(ranges)}"
            continue
        low, high = ranges[name]
        if isinstance(value, bool) or not isinstance(value, int | float):
            yield f"{place}{name}: expected a number, found {value!r:.40}"
        elif not low <= value <= high:
            yield f"{place}{name}: expected {low:g} to {high:g}, found {value!r:.40}"


DEFAULT_CAR = Car()
UNNAMED_CAR = Car(UNNAMED_GEOMETRY)
"""for models of an unnamed car: its lock is not known"""
RANGES: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        **{
            name: (low, high)
            for name, low, high in zip(SteeringGeometry._fields, SMALLEST, LARGEST, strict=True)
        },
        "largest_brake_n": (10.0, INPUT_LIMITS.upper.brake_n),
        "throttle_rate_per_s": (0.2, INPUT_LIMITS.rate_per_s.throttle),
        "brake_rate_n_per_s": (50.0, INPUT_LIMITS.rate_per_s.brake_n),
        "steer_rate_radps": (0.3, INPUT_LIMITS.rate_per_s.steer_rad),
        "plan_lateral_mps2": (1.0, PLAN_TURN_MPS2),
        "largest_lateral_mps2": (1.0, LARGEST_LATERAL_MPS2),
        "path_lateral_mps2": (1.0, MOST_LATERAL_MPS2),
        "throttle_mps2": (0.5, 15.0),
        "brake_mps2_per_n": (0.005, 0.5),
    }
)
"""of the values of [car]; limits end at those within which the models are trained"""
THRESHOLDS = tuple(quantity.name.lower() for quantity in Quantity)
"""names of the plausibility checks whose thresholds a car may set"""
THRESHOLD_RANGE = (1e-6, 1e6)
