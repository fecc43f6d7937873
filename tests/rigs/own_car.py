"""The car of examples/own_car: its file, its messages, and its frames in both directions."""

from pathlib import Path

from rt_controller.mapping.car_file import CarFile, read_car
from rt_controller.mapping.signal_frames import SignalReader, SignalWriter
from rt_controller.mapping.slots import command_slots, driving_slot, measured_slots

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_car" / "car.toml"
FILES = ("car.toml", "car.dbc", "line.csv")
VALUES = {
    "states.vx_mps": 20.0,
    "states.yaw_rate_radps": 0.02,
    "inputs.throttle": 0.25,
    "inputs.brake_n": 0.0,
    "inputs.steer_rad": 0.1,
    "pose.x": 20.0,
    "pose.y": 0.7,
    "pose.yaw": 0.03,
    "reference.v_mps": 22.0,
    "reference.a_mps2": -1.0,
    "reference.c0_m": 0.5,
    "reference.c1": 0.01,
    "reference.c2_per_m": 0.001,
    "reference.c3_per_m2": -0.0001,
    "mission.engage": 1.0,
    "mission.acknowledge": 0.0,
    "mission.car_brakes": 0.0,
}
"""of every slot that the car measures, in SI"""


def example() -> CarFile:
    return read_car(EXAMPLE)


def changed(folder: Path, *changes: tuple[str, str]) -> CarFile:
    """The example with other text instead of an old one, in its car file or its DBC."""
    texts = {name: (EXAMPLE.parent / name).read_text() for name in FILES}
    for old, new in changes:
        name = next(name for name, text in texts.items() if old in text)
        texts[name] = texts[name].replace(old, new)
    for name, text in texts.items():
        (folder / name).write_text(text)
    return read_car(folder / EXAMPLE.name)


def state_writer(car: CarFile) -> SignalWriter:
    """Sends what the car measures."""
    return SignalWriter(measured_slots(car.mapping), car.mapping.messages, car.database, "car")


def state_reader(car: CarFile) -> SignalReader:
    """Reads what the car measures."""
    return SignalReader(measured_slots(car.mapping), car.mapping.messages, car.database, "car")


def command_writer(car: CarFile) -> SignalWriter:
    """Sends commands to the car."""
    return SignalWriter(command_slots(car.mapping), car.mapping.messages, car.database, "car")


def command_reader(car: CarFile) -> SignalReader:
    """Reads commands as the car does."""
    slots = [*command_slots(car.mapping), *driving_slot(car.mapping)]
    return SignalReader(slots, car.mapping.messages, car.database, "car")
