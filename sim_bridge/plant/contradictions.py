"""`contradictions`: numbers of a car that do not fit each other, as messages.

`contradictions_of` is the part that an exported FMU checks too, after its parameters were set.
"""

from collections.abc import Iterator
from typing import NamedTuple

from rt_controller.contract.physics import GRAVITY_MPS2
from sim_bridge.plant.car_parts import BodyParameters, TyreParameters
from sim_bridge.plant.drive import drive_parts as drive
from sim_bridge.plant.jit import compiled, uncompiled
from sim_bridge.plant.tyre.tyre_coefficients import (
    LEAST_PLAUSIBLE,
    MOST_PLAUSIBLE,
    TyreFileParameters,
    tyre_quantities,
)

_LARGEST_LOAD_RATIO = 5.0
"""between the nominal load of a tyre file and the mean wheel load"""


class Contradictions(NamedTuple):
    """True for each field that contradicts others; a name is part and field of the parameters."""

    body_mass_kg: bool
    body_rear_axle_m: bool
    body_front_axle_m: bool
    tyre_lateral_relaxation_end_slip: bool
    gearbox_ratios: bool
    gearbox_up_rpm: bool
    engine_speed_limit_rpm: bool
    engine_map_speeds_rpm: bool
    engine_map_throttles: bool
    motor_map_speeds_rpm: bool
    motor_map_throttles: bool
    tyre_file_fnomin: bool
    tyre_file_pdx1: bool
    tyre_file_pdy1: bool
    tyre_file_pkx1: bool
    tyre_file_pky1: bool


EXPECTED = (
    "the sum of sprung and unsprung masses",
    "a value that with front_axle_m gives the wheelbase of the sprung mass",
    "the centre of gravity of sprung and unsprung masses",
    "more than lateral_relaxation_start_slip",
    "ratios that decrease from gear to gear",
    "up-shifts above the down-shifts",
    "more than idle_speed_rpm",
    "increasing values",
    "increasing positions from 0 to 1",
    "increasing values",
    "increasing positions from 0 to 1",
    f"a factor of at most {_LARGEST_LOAD_RATIO:g} to the mean wheel load",
    *(
        f"{quantity} of {least:g} to {most:g}"
        for quantity, least, most in zip(
            (
                "a peak friction pdx1 * lmux",
                "a peak friction |pdy1| * lmuy",
                "a slip stiffness over load pkx1 * lkx",
                "a cornering stiffness over load",
            ),
            LEAST_PLAUSIBLE,
            MOST_PLAUSIBLE,
            strict=True,
        )
    ),
)
"""what fits instead, for each field of `Contradictions`; in the messages of an exported FMU"""


@compiled
def parts_mass_kg(body: BodyParameters) -> float:
    """Sum of sprung and unsprung masses."""
    return body.sprung_mass_kg + body.unsprung_front_kg + body.unsprung_rear_kg


@compiled
def parts_front_axle_m(body: BodyParameters) -> float:
    """Distance of the front axle from the centre of gravity of sprung and unsprung masses."""
    wheelbase_m = body.front_axle_m + body.rear_axle_m
    front_kgm = body.sprung_mass_kg * body.sprung_front_axle_m + body.unsprung_rear_kg * wheelbase_m
    return front_kgm / body.mass_kg


@compiled
def is_increasing(axis: tuple[float, ...]) -> bool:
    """True if each value is larger than the one before."""
    is_rising = True
    for i in range(1, len(axis)):
        if not axis[i - 1] < axis[i]:
            is_rising = False
    return is_rising


@compiled
def is_outside(value: float, least: float, most: float) -> bool:
    """True if the value is not between its limits."""
    return not least <= value <= most


@compiled
def mean_wheel_load_n(body: BodyParameters) -> float:
    """Load of a wheel at rest, the mean of all four."""
    return 0.25 * body.mass_kg * GRAVITY_MPS2


@compiled
def contradictions_of(
    body: BodyParameters,
    tyre: TyreParameters,
    engine: drive.EngineParameters,
    gearbox: drive.GearboxParameters,
    motor: drive.MotorParameters,
    tyre_file: TyreFileParameters,
) -> Contradictions:
    """Which fields contradict others, for a car that has either engine and gearbox or a motor."""
    sprung_m = body.sprung_front_axle_m + body.sprung_rear_axle_m
    wheelbase_m = body.front_axle_m + body.rear_axle_m
    has_falling_ratios = True
    for gear in range(1, len(gearbox.ratios)):
        if not gearbox.ratios[gear - 1] > gearbox.ratios[gear]:
            has_falling_ratios = False
    is_electric = motor.inertia_kgm2 > 0.0
    has_tyre_file = tyre_file.fnomin > 0.0
    load_ratio = tyre_file.fnomin / mean_wheel_load_n(body)
    tyre_has = tyre_quantities(tyre_file) if has_tyre_file else LEAST_PLAUSIBLE
    least, most = LEAST_PLAUSIBLE, MOST_PLAUSIBLE
    return Contradictions(
        body_mass_kg=abs(parts_mass_kg(body) - body.mass_kg) >= 1e-3 * body.mass_kg,
        body_rear_axle_m=abs(sprung_m - wheelbase_m) >= 1e-3 * wheelbase_m,
        body_front_axle_m=abs(parts_front_axle_m(body) - body.front_axle_m) >= 0.01 * wheelbase_m,
        tyre_lateral_relaxation_end_slip=(
            tyre.lateral_relaxation_end_slip <= tyre.lateral_relaxation_start_slip
        ),
        gearbox_ratios=not (is_electric or has_falling_ratios),
        gearbox_up_rpm=(
            gearbox.up_rpm <= gearbox.down_rpm or gearbox.up_rpm_full <= gearbox.down_rpm_full
        ),
        engine_speed_limit_rpm=not (is_electric or engine.idle_speed_rpm < engine.speed_limit_rpm),
        engine_map_speeds_rpm=not is_increasing(engine.map_speeds_rpm),
        engine_map_throttles=not (
            is_increasing(engine.map_throttles)
            and engine.map_throttles[0] == 0.0
            and engine.map_throttles[-1] == 1.0
        ),
        motor_map_speeds_rpm=not is_increasing(motor.map_speeds_rpm),
        motor_map_throttles=not (
            is_increasing(motor.map_throttles)
            and motor.map_throttles[0] == 0.0
            and motor.map_throttles[-1] == 1.0
        ),
        tyre_file_fnomin=(
            has_tyre_file and is_outside(load_ratio, 1.0 / _LARGEST_LOAD_RATIO, _LARGEST_LOAD_RATIO)
        ),
        tyre_file_pdx1=is_outside(tyre_has.pdx1, least.pdx1, most.pdx1),
        tyre_file_pdy1=is_outside(tyre_has.pdy1, least.pdy1, most.pdy1),
        tyre_file_pkx1=is_outside(tyre_has.pkx1, least.pkx1, most.pkx1),
        tyre_file_pky1=is_outside(tyre_has.pky1, least.pky1, most.pky1),
    )


def contradictions(
    body: BodyParameters,
    tyre: TyreParameters,
    engine: drive.EngineParameters,
    converter: drive.ConverterParameters,
    gearbox: drive.GearboxParameters,
    motor: drive.MotorParameters,
    tyre_file: TyreFileParameters,
) -> Iterator[str]:
    """A message for each part that is missing or too many, and each field that does not fit."""
    found = uncompiled(contradictions_of)(body, tyre, engine, gearbox, motor, tyre_file)
    yield from _of_the_body(found, body)
    if found.tyre_file_fnomin:
        mean_n = uncompiled(mean_wheel_load_n)(body)
        least_n, most_n = mean_n / _LARGEST_LOAD_RATIO, mean_n * _LARGEST_LOAD_RATIO
        yield (
            f"tyre_file: FNOMIN: expected {least_n:.0f} to {most_n:.0f} N, within a factor of "
            f"{_LARGEST_LOAD_RATIO:g} of the mean wheel load at rest, found "
            f"{tyre_file.fnomin:g} N. Is FORCE in the section [UNITS] right?"
        )
    if found.tyre_lateral_relaxation_end_slip:
        yield (
            f"tyre.lateral_relaxation_end_slip: expected more than lateral_relaxation_start_slip, "
            f"{tyre.lateral_relaxation_start_slip}, found {tyre.lateral_relaxation_end_slip}."
        )
    if motor != drive.NO_MOTOR:
        if (engine, converter, gearbox) != (drive.NO_ENGINE, drive.NO_CONVERTER, drive.ONE_GEAR):
            yield "motor: expected either engine, converter and gearbox, or a motor; found both."
        if motor.inertia_kgm2 == 0.0:
            yield "motor.inertia_kgm2: expected more than 0.0, found 0.0."
        yield from _of_a_map("motor", motor, found.motor_map_speeds_rpm, found.motor_map_throttles)
        return
    missing = [
        name
        for name, part, absent in (
            ("engine", engine, drive.NO_ENGINE),
            ("converter", converter, drive.NO_CONVERTER),
            ("gearbox", gearbox, drive.ONE_GEAR),
        )
        if part == absent
    ]
    if missing:
        for name in missing:
            yield f"{name}: expected a value, found none."
        return
    yield from _of_a_map("engine", engine, found.engine_map_speeds_rpm, found.engine_map_throttles)
    if found.gearbox_ratios:
        yield (
            f"gearbox.ratios: expected ratios that decrease from gear to gear, found "
            f"{gearbox.ratios}."
        )
    if found.gearbox_up_rpm:
        yield (
            f"gearbox.up_rpm: expected up-shifts above the down-shifts, found "
            f"{(gearbox.up_rpm, gearbox.up_rpm_full)}."
        )
    if found.engine_speed_limit_rpm:
        yield (
            f"engine.speed_limit_rpm: expected more than idle_speed_rpm, {engine.idle_speed_rpm}, "
            f"found {engine.speed_limit_rpm}."
        )


def _of_the_body(found: Contradictions, body: BodyParameters) -> Iterator[str]:
    if found.body_mass_kg:
        yield (
            f"body.mass_kg: expected the sum of sprung and unsprung masses, "
            f"{uncompiled(parts_mass_kg)(body):.1f}, found {body.mass_kg}."
        )
    if found.body_rear_axle_m:
        sprung_m = body.sprung_front_axle_m + body.sprung_rear_axle_m
        yield (
            f"body.rear_axle_m: expected the wheelbase of the sprung mass, {sprung_m:.3f}, with "
            f"front_axle_m, found {body.front_axle_m + body.rear_axle_m:.4f}."
        )
    if found.body_front_axle_m:
        yield (
            f"body.front_axle_m: expected the centre of gravity of the masses, "
            f"{uncompiled(parts_front_axle_m)(body):.3f}, found {body.front_axle_m}."
        )
    if found.body_mass_kg or found.body_rear_axle_m or found.body_front_axle_m:
        wheelbase_m = body.front_axle_m + body.rear_axle_m
        sprung_kg = body.mass_kg - body.unsprung_front_kg - body.unsprung_rear_kg
        front_kgm = body.mass_kg * body.front_axle_m - body.unsprung_rear_kg * wheelbase_m
        if sprung_kg > 0.0 and 0.0 < front_kgm < sprung_kg * wheelbase_m:
            front_m = front_kgm / sprung_kg
            yield (
                f"If mass, axle distances and unsprung masses are right: sprung_mass_kg = "
                f"{sprung_kg:.1f}, sprung_front_axle_m = {front_m:.4f}, sprung_rear_axle_m = "
                f"{wheelbase_m - front_m:.4f}."
            )


def _of_a_map(
    name: str,
    part: drive.EngineParameters | drive.MotorParameters,
    has_wrong_speeds: bool,
    has_wrong_throttles: bool,
) -> Iterator[str]:
    if has_wrong_speeds:
        yield f"{name}.map_speeds_rpm: expected increasing values, found {part.map_speeds_rpm}."
    if has_wrong_throttles:
        yield (
            f"{name}.map_throttles: expected increasing positions from 0.0 to 1.0, found "
            f"{part.map_throttles}."
        )
