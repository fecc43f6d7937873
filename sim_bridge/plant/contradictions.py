"""`contradictions`: numbers of a car that do not fit each other, as messages."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

from rt_controller.contract.physics import GRAVITY_MPS2
from sim_bridge.plant import drive_parts as drive
from sim_bridge.plant.car_parts import BodyParameters

if TYPE_CHECKING:
    from sim_bridge.plant.parameters import Parameters

_LARGEST_LOAD_RATIO = 5.0
"""between the nominal load of a tyre file and the mean wheel load"""


def contradictions(car: "Parameters") -> Iterator[str]:
    """A message for each part that is missing or too many, and each field that does not fit."""
    yield from _of_the_body(car.body)
    mean_n = 0.25 * car.body.mass_kg * GRAVITY_MPS2
    least_n, most_n = mean_n / _LARGEST_LOAD_RATIO, mean_n * _LARGEST_LOAD_RATIO
    if car.tyre_file.fnomin != 0.0 and not least_n <= car.tyre_file.fnomin <= most_n:
        yield (
            f"tyre_file: FNOMIN: expected {least_n:.0f} to {most_n:.0f} N, within a factor of "
            f"{_LARGEST_LOAD_RATIO:g} of the mean wheel load at rest, found "
            f"{car.tyre_file.fnomin:g} N. Is FORCE in the section [UNITS] right?"
        )
    if not car.tyre.lateral_relaxation_end_slip > car.tyre.lateral_relaxation_start_slip:
        yield (
            f"tyre.lateral_relaxation_end_slip: expected more than lateral_relaxation_start_slip, "
            f"{car.tyre.lateral_relaxation_start_slip}, found "
            f"{car.tyre.lateral_relaxation_end_slip}."
        )
    parts = (
        ("engine", car.engine, drive.NO_ENGINE),
        ("converter", car.converter, drive.NO_CONVERTER),
        ("gearbox", car.gearbox, drive.ONE_GEAR),
    )
    missing = [name for name, part, absent in parts if part == absent]
    if car.motor != drive.NO_MOTOR:
        if len(missing) < len(parts):
            yield "motor: expected either engine, converter and gearbox, or a motor; found both."
        if car.motor.inertia_kgm2 == 0.0:
            yield "motor.inertia_kgm2: expected more than 0.0, found 0.0."
        yield from _of_a_map("motor", car.motor)
    elif missing:
        yield from (f"{name}: expected a value, found none." for name in missing)
    else:
        yield from _of_a_map("engine", car.engine)
        yield from _of_the_gearbox(car.gearbox)
        if not car.engine.idle_speed_rpm < car.engine.speed_limit_rpm:
            yield (
                f"engine.speed_limit_rpm: expected more than idle_speed_rpm, "
                f"{car.engine.idle_speed_rpm}, found {car.engine.speed_limit_rpm}."
            )


def _of_the_body(body: BodyParameters) -> Iterator[str]:
    parts_kg = body.sprung_mass_kg + body.unsprung_front_kg + body.unsprung_rear_kg
    sprung_m = body.sprung_front_axle_m + body.sprung_rear_axle_m
    wheelbase_m = body.front_axle_m + body.rear_axle_m
    front_kgm = body.sprung_mass_kg * body.sprung_front_axle_m + body.unsprung_rear_kg * wheelbase_m
    front_axle_m = front_kgm / body.mass_kg
    found = []
    if abs(parts_kg - body.mass_kg) >= 1e-3 * body.mass_kg:
        found.append(
            f"body.mass_kg: expected the sum of sprung and unsprung masses, {parts_kg:.1f}, found "
            f"{body.mass_kg}."
        )
    if abs(sprung_m - wheelbase_m) >= 1e-3 * wheelbase_m:
        found.append(
            f"body.rear_axle_m: expected the wheelbase of the sprung mass, {sprung_m:.3f}, with "
            f"front_axle_m, found {wheelbase_m:.4f}."
        )
    if abs(front_axle_m - body.front_axle_m) >= 0.01 * wheelbase_m:
        found.append(
            f"body.front_axle_m: expected the centre of gravity of the masses, {front_axle_m:.3f}, "
            f"found {body.front_axle_m}."
        )
    yield from found
    sprung_kg = body.mass_kg - body.unsprung_front_kg - body.unsprung_rear_kg
    front_kgm = body.mass_kg * body.front_axle_m - body.unsprung_rear_kg * wheelbase_m
    if found and sprung_kg > 0.0 and 0.0 < front_kgm < sprung_kg * wheelbase_m:
        front_m = front_kgm / sprung_kg
        yield (
            f"If mass, axle distances and unsprung masses are right: sprung_mass_kg = "
            f"{sprung_kg:.1f}, sprung_front_axle_m = {front_m:.4f}, sprung_rear_axle_m = "
            f"{wheelbase_m - front_m:.4f}."
        )


def _of_the_gearbox(gearbox: drive.GearboxParameters) -> Iterator[str]:
    if not _is_increasing(gearbox.ratios[::-1]):
        yield (
            f"gearbox.ratios: expected ratios that decrease from gear to gear, found "
            f"{gearbox.ratios}."
        )
    if gearbox.up_rpm <= gearbox.down_rpm or gearbox.up_rpm_full <= gearbox.down_rpm_full:
        yield (
            f"gearbox.up_rpm: expected up-shifts above the down-shifts, found "
            f"{(gearbox.up_rpm, gearbox.up_rpm_full)}."
        )


def _of_a_map(name: str, part: drive.EngineParameters | drive.MotorParameters) -> Iterator[str]:
    if not _is_increasing(part.map_speeds_rpm):
        yield f"{name}.map_speeds_rpm: expected increasing values, found {part.map_speeds_rpm}."
    pedals = part.map_throttles
    if not (_is_increasing(pedals) and pedals[0] == 0.0 and pedals[-1] == 1.0):
        yield (
            f"{name}.map_throttles: expected increasing positions from 0.0 to 1.0, found {pedals}."
        )


def _is_increasing(axis: Sequence[float]) -> bool:
    return all(before < after for before, after in pairwise(axis))
