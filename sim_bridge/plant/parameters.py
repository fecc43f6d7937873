"""`Parameters`: all numbers of a car, read from a car file and checked.

A car file is TOML: one table for each part of the car, and in it for each field of that part
`{ value = ..., source = "..." }`. The unit ends the field's name; the source states in words where
the number comes from. The shipped files are in `cars/`.
"""

from functools import cache
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, PlainValidator, TypeAdapter, ValidationInfo

from rt_controller.contract.errors import ConfigError
from rt_controller.mapping.toml_file import parse
from sim_bridge.plant import car_parts as parts
from sim_bridge.plant import drive_parts as drive
from sim_bridge.plant.car_values import STEEPEST_RAD, value_with_source
from sim_bridge.plant.contradictions import contradictions
from sim_bridge.plant.shipped_cars import CARS_FOLDER, DEFAULT_CAR
from sim_bridge.plant.tyre_coefficients import NO_TYRE_FILE, TyreFileParameters
from sim_bridge.plant.tyre_file import read_tyre_file
from sim_bridge.toml_file import read_shipped_or_own


def _read_tyre_file(entry: Any, info: ValidationInfo) -> TyreFileParameters:
    """The tyre file that an entry `{ value = "name.tir", source }` names beside the car file."""
    name = value_with_source(entry)
    if not isinstance(name, str) or not name.endswith(".tir"):
        raise ValueError(f"expected the path of a .tir file, found {name!r}")
    folder = info.context if isinstance(info.context, Path) else Path()
    try:
        return read_tyre_file(folder / name).parameters
    except ConfigError as error:
        raise ValueError(str(error)) from error


_FromTyreFile = Annotated[TyreFileParameters, PlainValidator(_read_tyre_file)]


class Parameters(NamedTuple):
    """A whole car on its road."""

    body: parts.BodyParameters
    suspension: parts.SuspensionParameters
    tyre: parts.TyreParameters
    driveline: drive.DrivelineParameters
    brakes: drive.BrakeParameters
    steering: parts.SteeringParameters
    aero: parts.AeroParameters
    road: parts.RoadParameters
    engine: drive.EngineParameters = drive.NO_ENGINE
    converter: drive.ConverterParameters = drive.NO_CONVERTER
    gearbox: drive.GearboxParameters = drive.ONE_GEAR
    motor: drive.MotorParameters = drive.NO_MOTOR
    """an electric motor, in place of engine, converter and gearbox"""
    anti_lock: drive.AntiLockParameters = drive.NO_ANTI_LOCK
    traction_control: drive.TractionControlParameters = drive.NO_TRACTION_CONTROL
    tyre_file: _FromTyreFile = NO_TYRE_FILE
    """coefficients that take the place of the forces of `tyre`"""


def load_parameters(name_or_path: str | Path) -> Parameters:
    """A shipped car by name, or one from a TOML file.

    Raises:
        ConfigError: there is no such car; a field is missing, unknown, without source or out of its
            limits; or fields contradict each other. The message names all such fields.
    """
    text = read_shipped_or_own(name_or_path, CARS_FOLDER, "car")
    remedies = {"tyre_file": "Move it above the first section of the file; keep [tyre]."}
    return parse(text, _SCHEMA, f"car {name_or_path}", Path(name_or_path).parent, remedies)


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
    road = parameters.road._replace(friction_left=friction, friction_right=right)
    return parameters._replace(road=road)


def with_road(parameters: Parameters, road: parts.RoadParameters) -> Parameters:
    """The same car on another ground, in another wind; takes effect from the next step on.

    Raises:
        ConfigError: a friction is not positive, a slope is above 0.7 rad, or the wind is not a
            number. The message names all such fields.
    """
    problems = [
        f"road.{name}: expected a positive number, found {getattr(road, name)}."
        for name in ("friction_left", "friction_right")
        if not (isfinite(getattr(road, name)) and getattr(road, name) > 0.0)
    ]
    problems += [
        f"road.{name}: expected a slope between -{STEEPEST_RAD} and {STEEPEST_RAD} rad, found "
        f"{getattr(road, name)}."
        for name in ("bank_rad", "grade_rad")
        if not abs(getattr(road, name)) <= STEEPEST_RAD
    ]
    problems += [
        f"road.{name}: expected a finite number, found {getattr(road, name)}."
        for name in ("wind_forward_mps", "wind_left_mps")
        if not isfinite(getattr(road, name))
    ]
    if problems:
        raise ConfigError("\n".join(problems))
    return parameters._replace(road=road)


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


def with_cornering_stiffness(parameters: Parameters, factor: float) -> Parameters:
    """The same car on tyres with `factor` times the cornering stiffness.

    Raises:
        ConfigError: the factor is not a positive number.
    """
    if not (isfinite(factor) and factor > 0.0):
        raise ConfigError(
            f"factor of the cornering stiffness: expected a positive number, found {factor}."
        )
    tyre, tyre_file = parameters.tyre, parameters.tyre_file
    return parameters._replace(
        tyre=tyre._replace(cornering_stiffness_npr=factor * tyre.cornering_stiffness_npr),
        tyre_file=tyre_file._replace(lky=factor * tyre_file.lky),
    )


def _require_consistent(car: Parameters) -> Parameters:
    problems = "\n".join(contradictions(car))
    if problems:
        raise ValueError(problems)
    return car


_SCHEMA: TypeAdapter[Parameters] = TypeAdapter(
    Annotated[Parameters, AfterValidator(_require_consistent)]
)
