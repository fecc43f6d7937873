"""A whole car in numbers, read from a car file and refused when such a car cannot be.

A car file is TOML: one table for each part of the car, and in it for each field of that part
`{ value = ..., source = "..." }`. The unit ends the field's name; the source says in plain words
where the number comes from. The files that ship lie in `cars/`.
"""

import tomllib
from importlib import resources
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

from rt_controller.contract.errors import ConfigError
from sim_bridge.plant.car_parts import (
    GRAVITY_MPS2,
    AeroParameters,
    BodyParameters,
    BrakeParameters,
    ConverterParameters,
    DrivelineParameters,
    EngineParameters,
    GearboxParameters,
    RoadParameters,
    SteeringParameters,
    SuspensionParameters,
    TyreParameters,
)

__all__ = [
    "C_CLASS_150KW_AWD",
    "GRAVITY_MPS2",
    "Parameters",
    "load_parameters",
    "shipped_cars",
    "with_mass_factor",
    "with_road_friction",
]


class Parameters(NamedTuple):
    """A whole car on its road."""

    body: BodyParameters
    suspension: SuspensionParameters
    tyre: TyreParameters
    engine: EngineParameters
    converter: ConverterParameters
    gearbox: GearboxParameters
    driveline: DrivelineParameters
    brakes: BrakeParameters
    steering: SteeringParameters
    aero: AeroParameters
    road: RoadParameters


_GEARS = 6
_ANY_SIGN = {
    "suspension.roll_steer_front",
    "suspension.roll_steer_rear",
    "suspension.roll_centre_front_m",
    "suspension.roll_centre_rear_m",
    "suspension.pitch_centre_m",
    "suspension.bar_front_nmprad",
    "suspension.bar_rear_nmprad",
    "suspension.camber_gain_front",
    "suspension.camber_gain_rear",
    "tyre.lateral_friction_per_load",
    "tyre.longitudinal_friction_per_load",
    "tyre.lateral_curvature",
    "tyre.longitudinal_curvature",
    "tyre.camber_slip",
    "engine.drag_nm",
    "engine.fall_below_quartic_nm",
    "engine.drag_nm_per_krpm",
    "steering.caster_trail_m",
    "aero.lift",
}
_MAY_BE_ZERO = {
    "suspension.jounce_front_nspm",
    "suspension.jounce_rear_nspm",
    "suspension.rebound_front_nspm",
    "suspension.rebound_rear_nspm",
    "tyre.vertical_damping_nspm",
    "tyre.trail_m",
    "tyre.lateral_damping_s",
    "tyre.longitudinal_damping_s",
    "tyre.rolling_resistance",
    "tyre.rolling_resistance_spm",
    "engine.fall_below_nm",
    "engine.fall_above_nm",
    "engine.fall_above_quartic_nm",
    "gearbox.shift_dip",
    "driveline.front_share",
    "driveline.viscous_nms",
    "driveline.shaft_damping_nms",
    "brakes.slope_above_knee",
    "steering.damping_nms",
    "steering.friction_nm",
    "aero.drag",
}
_AT_MOST_ONE = {
    "gearbox.efficiencies",
    "gearbox.shift_dip",
    "driveline.final_efficiency",
    "driveline.front_share",
    "brakes.slope_above_knee",
    "converter.coupling_speed_ratio",
}


def shipped_cars() -> list[str]:
    """Names of the cars that come with the package."""
    folder = resources.files("sim_bridge") / "cars"
    return sorted(
        f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")
    )


def load_parameters(name_or_path: str | Path) -> Parameters:
    """A shipped car by name, or one from a TOML file.

    Raises:
        ConfigError: there is none of that name; a field is missing, unknown, has no source or is
            not a number; or no car can be like that. The message names the field.
    """
    name = str(name_or_path)
    if name in shipped_cars():
        text = (resources.files("sim_bridge") / "cars" / f"{name}.toml").read_text("utf-8")
    elif name.endswith(".toml"):
        try:
            text = Path(name).read_text("utf-8")
        except OSError as error:
            raise ConfigError(
                f"{name}: expected a car file, found nothing readable ({error.strerror})."
            ) from error
    else:
        raise ConfigError(
            f"car {name!r}: expected one of {', '.join(shipped_cars())} or the path of a .toml "
            f"file."
        )
    try:
        return parse_parameters(text)
    except (tomllib.TOMLDecodeError, ValueError) as error:
        raise ConfigError(f"car {name}: {error}") from error


def parse_parameters(text: str) -> Parameters:
    """The car that the text of a car file describes.

    Raises:
        ValueError: see `load_parameters`.
    """
    raw = tomllib.loads(text)
    parts = Parameters.__annotations__
    _require_names(raw, parts.keys(), "the file")
    car = Parameters(**{name: _part(name, kind, raw[name]) for name, kind in parts.items()})
    _require_possible(car)
    return car


def with_road_friction(
    parameters: Parameters, friction: float, friction_right: float | None = None
) -> Parameters:
    """The same car on a road of another friction, 1 being the road of the tyre test.

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
    return parameters._replace(road=RoadParameters(friction, right))


def with_mass_factor(parameters: Parameters, factor: float) -> Parameters:
    """The same car, every mass and inertia of its body times `factor`; the axles keep their share.

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


def _part(part: str, kind: Any, raw: Any) -> Any:
    if not isinstance(raw, dict):
        raise ValueError(f"{part}: expected a table of fields, found {raw!r}")
    _require_names(raw, kind._fields, part)
    return kind(**{name: _value(f"{part}.{name}", entry) for name, entry in raw.items()})


def _value(field: str, entry: Any) -> float | tuple[float, ...]:
    if not isinstance(entry, dict) or set(entry) != {"value", "source"}:
        raise ValueError(f"{field}: expected {{ value, source }}, found {entry!r}")
    source = entry["source"]
    if not isinstance(source, str) or not source.strip():
        raise ValueError(f"{field}: expected a source in words, found {source!r}")
    value = entry["value"]
    if field in ("gearbox.ratios", "gearbox.efficiencies"):
        if not isinstance(value, list) or len(value) != _GEARS:
            raise ValueError(f"{field}: expected {_GEARS} numbers, found {value!r}")
        return tuple(_number(field, one) for one in value)
    return _number(field, value)


def _number(field: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise ValueError(f"{field}: expected a number, found {value!r}")
    if field not in _ANY_SIGN and value < 0.0:
        raise ValueError(f"{field}: expected no negative number, found {value}")
    if field not in _ANY_SIGN | _MAY_BE_ZERO and value == 0.0:
        raise ValueError(f"{field}: expected a number above 0, found {value}")
    if field in _AT_MOST_ONE and value > 1.0:
        raise ValueError(f"{field}: expected at most 1, found {value}")
    return float(value)


def _require_names(raw: dict[str, Any], names: Any, where: str) -> None:
    missing, unknown = sorted(set(names) - set(raw)), sorted(set(raw) - set(names))
    if missing or unknown:
        raise ValueError(f"{where}: missing fields {missing}, unknown fields {unknown}")


def _require_possible(car: Parameters) -> None:
    """What single numbers cannot tell: whether they fit each other."""
    body = car.body
    parts_kg = body.sprung_mass_kg + body.unsprung_front_kg + body.unsprung_rear_kg
    _require(
        abs(parts_kg - body.mass_kg) < 1e-3 * body.mass_kg,
        "body.mass_kg",
        f"the sum of sprung and unsprung masses, {parts_kg:.1f}",
        body.mass_kg,
    )
    sprung_m = body.sprung_front_axle_m + body.sprung_rear_axle_m
    wheelbase_m = body.front_axle_m + body.rear_axle_m
    _require(
        abs(sprung_m - wheelbase_m) < 1e-3 * wheelbase_m,
        "body.rear_axle_m",
        f"the wheelbase of the sprung mass, {sprung_m:.3f}, with front_axle_m",
        wheelbase_m,
    )
    front_kgm = body.sprung_mass_kg * body.sprung_front_axle_m + body.unsprung_rear_kg * wheelbase_m
    _require(
        abs(front_kgm / body.mass_kg - body.front_axle_m) < 0.01 * wheelbase_m,
        "body.front_axle_m",
        f"where the masses put the centre of gravity, {front_kgm / body.mass_kg:.3f}",
        body.front_axle_m,
    )
    ratios = car.gearbox.ratios
    _require(
        all(low > high for low, high in pairwise(ratios)),
        "gearbox.ratios",
        "ratios that fall from gear to gear",
        ratios,
    )
    gearbox = car.gearbox
    _require(
        gearbox.up_rpm > gearbox.down_rpm and gearbox.up_rpm_full > gearbox.down_rpm_full,
        "gearbox.up_rpm",
        "up-shifts above the down-shifts",
        (gearbox.up_rpm, gearbox.up_rpm_full),
    )
    _require(
        car.engine.idle_speed_rpm < car.engine.peak_speed_rpm < car.engine.speed_limit_rpm,
        "engine.peak_speed_rpm",
        "a speed between idle and limit",
        car.engine.peak_speed_rpm,
    )


def _require(holds: bool, field: str, expected: str, found: object) -> None:
    if not holds:
        raise ValueError(f"{field}: expected {expected}, found {found}")


C_CLASS_150KW_AWD = load_parameters("c_class_150kw_awd")
