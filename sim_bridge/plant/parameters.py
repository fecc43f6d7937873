"""`Parameters`: all numbers of a car, read from a car file and checked.

A car file is TOML: one table for each part of the car, and in it for each field of that part
`{ value = ..., source = "..." }`. The unit ends the field's name; the source states in words where
the number comes from. The shipped files are in `cars/`. A file that begins with
`base = "NAME of a shipped car"` has what differs from that car only.
"""

from collections.abc import Mapping
from functools import cache
from math import inf, isfinite
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, PlainValidator, TypeAdapter, ValidationInfo

from rt_controller.contract.errors import ConfigError
from rt_controller.mapping.toml_file import checked, parse_table
from sim_bridge.plant import parts
from sim_bridge.plant.consistency import contradictions
from sim_bridge.plant.shipped_cars import CARS_FOLDER, DEFAULT_CAR, shipped_cars
from sim_bridge.plant.tyre_file import NO_TYRE_FILE, TyreFileParameters, read_tyre_file
from sim_bridge.toml_file import read_shipped_or_own


def _read_tyre_file(entry: Any, info: ValidationInfo) -> TyreFileParameters:
    """The tyre file that an entry `{ value = "name.tir", source }` names beside the car file."""
    name = parts.value_with_source(entry)
    if not isinstance(name, str) or not name.endswith(".tir"):
        raise ValueError(f"expected the path of a .tir file, found {name!r}")
    folder = info.context if isinstance(info.context, Path) else Path()
    try:
        return read_tyre_file(folder / name)
    except ConfigError as error:
        raise ValueError(str(error)) from error


_FromTyreFile = Annotated[TyreFileParameters, PlainValidator(_read_tyre_file)]


class Parameters(NamedTuple):
    """A whole car on its road."""

    body: parts.BodyParameters
    suspension: parts.SuspensionParameters
    tyre: parts.TyreParameters
    driveline: parts.DrivelineParameters
    brakes: parts.BrakeParameters
    steering: parts.SteeringParameters
    aero: parts.AeroParameters
    road: parts.RoadParameters
    engine: parts.EngineParameters = parts.NO_ENGINE
    converter: parts.ConverterParameters = parts.NO_CONVERTER
    gearbox: parts.GearboxParameters = parts.ONE_GEAR
    motor: parts.MotorParameters = parts.NO_MOTOR
    """an electric motor, in place of engine, converter and gearbox"""
    anti_lock: parts.AntiLockParameters = parts.NO_ANTI_LOCK
    traction_control: parts.TractionControlParameters = parts.NO_TRACTION_CONTROL
    tyre_file: _FromTyreFile = NO_TYRE_FILE
    """coefficients that take the place of the forces of `tyre`"""


def load_parameters(name_or_path: str | Path) -> Parameters:
    """A shipped car by name, or one from a TOML file.

    Raises:
        ConfigError: there is no such car; a field is missing, unknown, without source or out of its
            limits; or fields contradict each other. The message names all such fields.
    """
    remedies = {
        "tyre_file": "Move it above the first section of the file; keep [tyre].",
        "base": "Move it above the first section of the file.",
    }
    raw = _with_base(car_table(name_or_path), f"car {name_or_path}")
    return checked(raw, _SCHEMA, f"car {name_or_path}", Path(name_or_path).parent, remedies)


def car_table(name_or_path: str | Path) -> dict[str, Any]:
    """The content of a car file as it is written; that of a shipped car names it as the base.

    Raises:
        ConfigError: there is no such car, or the file is no TOML.
    """
    if str(name_or_path) in shipped_cars():
        return {"base": str(name_or_path)}
    text = read_shipped_or_own(name_or_path, CARS_FOLDER, "car")
    return parse_table(text, f"car {name_or_path}")


def _with_base(own: Mapping[str, Any], where: str) -> dict[str, Any]:
    """The tables of the base, with those of the car on top of them, field by field."""
    if "base" not in own:
        return dict(own)
    base = own["base"]
    if base not in shipped_cars():
        raise ConfigError(
            f"{where}: base: expected a shipped car, one of {', '.join(shipped_cars())}, found "
            f"{base!r}."
        )
    merged = parse_table(read_shipped_or_own(base, CARS_FOLDER, "car"), base)
    for name, table in own.items():
        if name != "base":
            is_table = isinstance(table, dict) and isinstance(merged.get(name), dict)
            merged[name] = {**merged[name], **table} if is_table else table
    return merged


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
    road = parameters.road._replace(friction_left=friction, friction_right=right)
    return with_road(parameters, road)


def with_road(parameters: Parameters, road: parts.RoadParameters) -> Parameters:
    """The same car on another ground, in another wind; takes effect from the next step on.

    Raises:
        ConfigError: a friction is not positive, a slope is above 0.7 rad, or the wind is not a
            number. The message names all such fields.
    """
    steepest = parts.STEEPEST_RAD
    problems = []
    for name, value in road._asdict().items():
        if name.startswith("friction"):
            is_right, wanted = 0.0 < value < inf, "a positive number, dry asphalt is about 0.85"
        elif name.startswith("wind"):
            is_right, wanted = isfinite(value), "a finite number"
        else:
            is_right = abs(value) <= steepest
            wanted = f"a slope between -{steepest} and {steepest} rad"
        if not is_right:
            problems.append(f"road.{name}: expected {wanted}, found {value}.")
    if problems:
        raise ConfigError("\n".join(problems))
    return parameters._replace(road=road)


def with_mass_factor(parameters: Parameters, factor: float) -> Parameters:
    """The same car with all masses and inertias of its body times `factor`.

    Raises:
        ConfigError: the factor is not a positive number.
    """
    _require_positive("mass factor", factor)
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
    _require_positive("factor of the cornering stiffness", factor)
    tyre, tyre_file = parameters.tyre, parameters.tyre_file
    return parameters._replace(
        tyre=tyre._replace(cornering_stiffness_npr=factor * tyre.cornering_stiffness_npr),
        tyre_file=tyre_file._replace(lky=factor * tyre_file.lky),
    )


def _require_positive(name: str, factor: float) -> None:
    if not 0.0 < factor < inf:
        raise ConfigError(f"{name}: expected a positive number, found {factor}.")


def with_payload(parameters: Parameters, payload: parts.Payload) -> Parameters:
    """The same car with a load: masses, centres of gravity and moments of inertia change."""
    body, load_kg = parameters.body, payload.mass_kg
    if load_kg == 0.0:
        return parameters
    mass_kg = body.mass_kg + load_kg
    forward_m = load_kg * payload.ahead_m / mass_kg
    sprung_kg = body.sprung_mass_kg + load_kg
    ahead_of_sprung_m = payload.ahead_m + body.sprung_front_axle_m - body.front_axle_m
    sprung_forward_m = load_kg * ahead_of_sprung_m / sprung_kg
    height_m = (body.sprung_mass_kg * body.sprung_height_m + load_kg * payload.height_m) / sprung_kg
    # Parallel axes: both masses move against the new centre of gravity.
    vertical_kgm2 = (
        body.sprung_mass_kg * (height_m - body.sprung_height_m) ** 2
        + load_kg * (payload.height_m - height_m) ** 2
    )
    along_kgm2 = (
        body.sprung_mass_kg * sprung_forward_m**2
        + load_kg * (ahead_of_sprung_m - sprung_forward_m) ** 2
    )
    yaw_kgm2 = body.mass_kg * forward_m**2 + load_kg * (payload.ahead_m - forward_m) ** 2
    loaded = body._replace(
        mass_kg=mass_kg,
        yaw_inertia_kgm2=body.yaw_inertia_kgm2 + yaw_kgm2,
        front_axle_m=body.front_axle_m - forward_m,
        rear_axle_m=body.rear_axle_m + forward_m,
        sprung_mass_kg=sprung_kg,
        sprung_roll_inertia_kgm2=body.sprung_roll_inertia_kgm2 + vertical_kgm2,
        sprung_pitch_inertia_kgm2=body.sprung_pitch_inertia_kgm2 + vertical_kgm2 + along_kgm2,
        sprung_front_axle_m=body.sprung_front_axle_m - sprung_forward_m,
        sprung_rear_axle_m=body.sprung_rear_axle_m + sprung_forward_m,
        sprung_height_m=height_m,
    )
    return parameters._replace(body=loaded)


def _require_consistent(car: Parameters) -> Parameters:
    problems = "\n".join(contradictions(car))
    if problems:
        raise ValueError(problems)
    return car


_SCHEMA: TypeAdapter[Parameters] = TypeAdapter(
    Annotated[Parameters, AfterValidator(_require_consistent)]
)
