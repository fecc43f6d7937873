"""`contradictions`: numbers of a car that do not fit each other, as messages."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

from rt_controller.contract.signals import GRAVITY_MPS2
from sim_bridge.plant import parts

if TYPE_CHECKING:
    from sim_bridge.plant.parameters import Parameters

_LARGEST_LOAD_RATIO = 5.0
"""between the nominal load of a tyre file and the mean wheel load"""


def contradictions(car: "Parameters") -> Iterator[str]:
    """A message for each part that is missing or too many, and each field that does not fit."""
    yield from _of_the_body(car.body)
    nominal_n, mean_n = car.tyre_file.fnomin, 0.25 * car.body.mass_kg * GRAVITY_MPS2
    least_n, most_n = mean_n / _LARGEST_LOAD_RATIO, mean_n * _LARGEST_LOAD_RATIO
    if nominal_n != 0.0 and not least_n <= nominal_n <= most_n:
        yield (
            f"tyre_file: FNOMIN: expected {least_n:.0f} to {most_n:.0f} N, within a factor of "
            f"{_LARGEST_LOAD_RATIO:g} of the mean wheel load at rest, found {nominal_n:g} N. Is "
            f"FORCE in the section [UNITS] right?"
        )
    start, end = car.tyre.lateral_relaxation_start_slip, car.tyre.lateral_relaxation_end_slip
    if not end > start:
        wanted = f"more than lateral_relaxation_start_slip, {start}"
        yield f"tyre.lateral_relaxation_end_slip: expected {wanted}, found {end}."
    absent = {
        "engine": car.engine == parts.NO_ENGINE,
        "converter": car.converter == parts.NO_CONVERTER,
        "gearbox": car.gearbox == parts.ONE_GEAR,
    }
    if car.motor != parts.NO_MOTOR:
        if not all(absent.values()):
            yield "motor: expected either engine, converter and gearbox, or a motor; found both."
        if car.motor.inertia_kgm2 == 0.0:
            yield "motor.inertia_kgm2: expected more than 0.0, found 0.0."
        yield from _of_a_map("motor", car.motor)
    elif any(absent.values()):
        yield from (f"{name}: expected a value, found none." for name in absent if absent[name])
    else:
        yield from _of_a_map("engine", car.engine)
        engine, gearbox = car.engine, car.gearbox
        if not _is_increasing(gearbox.ratios[::-1]):
            wanted = "ratios that decrease from gear to gear"
            yield f"gearbox.ratios: expected {wanted}, found {gearbox.ratios}."
        up_rpm = gearbox.up_rpm, gearbox.up_rpm_full
        if up_rpm[0] <= gearbox.down_rpm or up_rpm[1] <= gearbox.down_rpm_full:
            yield f"gearbox.up_rpm: expected up-shifts above the down-shifts, found {up_rpm}."
        if not engine.idle_speed_rpm < engine.speed_limit_rpm:
            wanted = f"more than idle_speed_rpm, {engine.idle_speed_rpm}"
            yield f"engine.speed_limit_rpm: expected {wanted}, found {engine.speed_limit_rpm}."


def _of_the_body(body: parts.BodyParameters) -> Iterator[str]:
    unsprung_kg = body.unsprung_front_kg + body.unsprung_rear_kg
    parts_kg = body.sprung_mass_kg + unsprung_kg
    sprung_m = body.sprung_front_axle_m + body.sprung_rear_axle_m
    wheelbase_m = body.wheelbase_m
    front_kgm = body.sprung_mass_kg * body.sprung_front_axle_m + body.unsprung_rear_kg * wheelbase_m
    front_axle_m = front_kgm / body.mass_kg
    found = []
    if abs(parts_kg - body.mass_kg) >= 1e-3 * body.mass_kg:
        wanted = f"the sum of sprung and unsprung masses, {parts_kg:.1f}"
        found.append(f"body.mass_kg: expected {wanted}, found {body.mass_kg}.")
    if abs(sprung_m - wheelbase_m) >= 1e-3 * wheelbase_m:
        wanted = f"the wheelbase of the sprung mass, {sprung_m:.3f}, with front_axle_m"
        found.append(f"body.rear_axle_m: expected {wanted}, found {wheelbase_m:.4f}.")
    if abs(front_axle_m - body.front_axle_m) >= 0.01 * wheelbase_m:
        wanted = f"the centre of gravity of the masses, {front_axle_m:.3f}"
        found.append(f"body.front_axle_m: expected {wanted}, found {body.front_axle_m}.")
    yield from found
    sprung_kg = body.mass_kg - unsprung_kg
    front_kgm = body.mass_kg * body.front_axle_m - body.unsprung_rear_kg * wheelbase_m
    if found and sprung_kg > 0.0 and 0.0 < front_kgm < sprung_kg * wheelbase_m:
        front_m = front_kgm / sprung_kg
        yield (
            f"If mass, axle distances and unsprung masses are right: sprung_mass_kg = "
            f"{sprung_kg:.1f}, sprung_front_axle_m = {front_m:.4f}, sprung_rear_axle_m = "
            f"{wheelbase_m - front_m:.4f}."
        )


def _of_a_map(name: str, part: parts.EngineParameters | parts.MotorParameters) -> Iterator[str]:
    speeds, pedals = part.map_speeds_rpm, part.map_throttles
    if not _is_increasing(speeds):
        yield f"{name}.map_speeds_rpm: expected increasing values, found {speeds}."
    if not (_is_increasing(pedals) and pedals[0] == 0.0 and pedals[-1] == 1.0):
        wanted = "increasing positions from 0.0 to 1.0"
        yield f"{name}.map_throttles: expected {wanted}, found {pedals}."


def _is_increasing(axis: Sequence[float]) -> bool:
    return all(before < after for before, after in pairwise(axis))
