"""`Parameters`: all numbers of a car, read from a car file and checked.

A car file is TOML: one table for each part of the car, and in it for each field of that part
`{ value = ..., source = "..." }`. The unit ends the field's name; the source states in words where
the number comes from. The shipped files are in `cars/`.
"""

from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import AfterValidator, TypeAdapter

from rt_controller.contract.errors import ConfigError
from sim_bridge.plant import car_parts as parts
from sim_bridge.toml_file import parse, read_shipped_or_own, shipped_names

CARS_FOLDER = "cars"
DEFAULT_CAR = "c_class_150kw_awd"
"""the car of the training data"""


class Parameters(NamedTuple):
    """A whole car on its road."""

    body: parts.BodyParameters
    suspension: parts.SuspensionParameters
    tyre: parts.TyreParameters
    engine: parts.EngineParameters
    converter: parts.ConverterParameters
    gearbox: parts.GearboxParameters
    driveline: parts.DrivelineParameters
    brakes: parts.BrakeParameters
    steering: parts.SteeringParameters
    aero: parts.AeroParameters
    road: parts.RoadParameters


def shipped_cars() -> list[str]:
    """Names of the cars that come with the package."""
    return shipped_names(CARS_FOLDER)


def load_parameters(name_or_path: str | Path) -> Parameters:
    """A shipped car by name, or one from a TOML file.

    Raises:
        ConfigError: there is no such car; a field is missing, unknown, without source or out of its
            limits; or fields contradict each other. The message names all such fields.
    """
    text = read_shipped_or_own(name_or_path, CARS_FOLDER, "car")
    return parse(text, _SCHEMA, f"car {name_or_path}")


@cache
def default_car() -> Parameters:
    """The parameters of `DEFAULT_CAR`, read once."""
    return load_parameters(DEFAULT_CAR)


def with_road_friction(
    parameters: Parameters, friction: float, friction_right: float | None = None
) -> Parameters:
    """The same car on a road of another friction; 1 is the road of the tyre test.

    `friction` holds on both sides of the car, or on its left if `friction_right` is given.

    Raises:
        ConfigError: the friction is not a positive number.
    """
    right = friction if friction_right is None else friction_right
    for value in (friction, right):
        if not (isfinite(value) and value > 0.0):
            raise ConfigError(
                f"road friction: expected a positive number, 1 for the road of the tyre test, "
                f"found {value}. Dry asphalt is about 0.85, packed snow 0.3."
            )
    return parameters._replace(road=parts.RoadParameters(friction, right))


def with_mass_factor(parameters: Parameters, factor: float) -> Parameters:
    """The same car with all masses and inertias of its body times `factor`.

    Raises:
        ConfigError: the factor is not a positive number.
    """
    if not (isfinite(factor) and factor > 0.0):
        raise ConfigError(f"mass factor: expected a positive number, found {factor}.")
    body = parameters.body
    scaled = {
        name: factor * value
        for name, value in body._asdict().items()
        if name.endswith(("_kg", "_kgm2"))
    }
    return parameters._replace(body=body._replace(**scaled))


def _require_consistent(car: Parameters) -> Parameters:
    problems = "\n".join(_contradictions(car))
    if problems:
        raise ValueError(problems)
    return car


def _contradictions(car: Parameters) -> Iterator[str]:
    body, engine, gearbox = car.body, car.engine, car.gearbox
    parts_kg = body.sprung_mass_kg + body.unsprung_front_kg + body.unsprung_rear_kg
    if abs(parts_kg - body.mass_kg) >= 1e-3 * body.mass_kg:
        yield (
            f"body.mass_kg: expected the sum of sprung and unsprung masses, {parts_kg:.1f}, found "
            f"{body.mass_kg}."
        )
    sprung_m = body.sprung_front_axle_m + body.sprung_rear_axle_m
    wheelbase_m = body.front_axle_m + body.rear_axle_m
    if abs(sprung_m - wheelbase_m) >= 1e-3 * wheelbase_m:
        yield (
            f"body.rear_axle_m: expected the wheelbase of the sprung mass, {sprung_m:.3f}, with "
            f"front_axle_m, found {wheelbase_m}."
        )
    front_kgm = body.sprung_mass_kg * body.sprung_front_axle_m + body.unsprung_rear_kg * wheelbase_m
    front_axle_m = front_kgm / body.mass_kg
    if abs(front_axle_m - body.front_axle_m) >= 0.01 * wheelbase_m:
        yield (
            f"body.front_axle_m: expected the centre of gravity of the masses, {front_axle_m:.3f}, "
            f"found {body.front_axle_m}."
        )
    if not all(low > high for low, high in pairwise(gearbox.ratios)):
        yield (
            f"gearbox.ratios: expected ratios that decrease from gear to gear, found "
            f"{gearbox.ratios}."
        )
    if gearbox.up_rpm <= gearbox.down_rpm or gearbox.up_rpm_full <= gearbox.down_rpm_full:
        yield (
            f"gearbox.up_rpm: expected up-shifts above the down-shifts, found "
            f"{(gearbox.up_rpm, gearbox.up_rpm_full)}."
        )
    if not engine.idle_speed_rpm < engine.peak_speed_rpm < engine.speed_limit_rpm:
        yield (
            f"engine.peak_speed_rpm: expected a speed between idle and limit, found "
            f"{engine.peak_speed_rpm}."
        )


_SCHEMA: TypeAdapter[Parameters] = TypeAdapter(
    Annotated[Parameters, AfterValidator(_require_consistent)]
)
