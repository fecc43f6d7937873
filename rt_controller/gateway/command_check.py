"""What a car's DBC says of the commands, compared with what is sent; before a drive."""

from collections.abc import Iterator

from cantools.database.can import Message

from rt_controller.contract.car import Car
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.mapping.car_file import CarFile
from rt_controller.mapping.measurement import placeholder
from rt_controller.mapping.signal_frames import SignalReader, SignalWriter
from rt_controller.mapping.slots import command_slots
from rt_controller.mapping.tables import MessageMapping


def require_sendable(car: CarFile, description: Car) -> None:
    """Return if the messages of the car can carry every command.

    Raises:
        ConfigError: a range, a period or a checksum of the DBC does not allow it; all are named,
            each with both numbers. Or a column is not in the DBC.
        DatasetError: a unit is missing or does not fit.
    """
    mapping, where = car.mapping, str(car.path)
    slots = command_slots(mapping)
    SignalWriter(slots, mapping.messages, car.database, where)
    reader = SignalReader(slots, mapping.messages, car.database, where)
    mistakes = list(_ranges(reader, description))
    sent: dict[str, tuple[Message, list[tuple[str, str]]]] = {}
    for slot, (message, _) in reader.sources.items():
        tasks = sent.setdefault(message.name, (message, []))[1]
        tasks += [(part.name, slot) for part in reader.measurements[slot].parts]
    for name, (message, tasks) in sent.items():
        settings = mapping.messages.get(name, MessageMapping())
        mistakes += [*_period(message, settings), *_protection(message, tasks, settings)]
    if mistakes:
        listed = "".join(f"\n  {each}" for each in mistakes)
        raise ConfigError(f"{where}: {mapping.can.dbc.name} does not allow the commands:{listed}")


def _ranges(reader: SignalReader, car: Car) -> Iterator[str]:
    """Commands that their signals cannot have."""
    upper, lock_rad = car.limits.upper, car.geometry.lock_rad
    sent = {
        "commands.throttle": (0.0, upper.throttle),
        "commands.brake_n": (0.0, upper.brake_n),
        "commands.steer_rad": (-lock_rad, lock_rad),
        "commands.mode": (0.0, float(max(Mode))),
    }
    for name, measured in reader.measurements.items():
        signal, unit = measured.signal, measured.signal.unit or ""
        low, high = sorted(map(measured.from_si, sent[name]))
        lowest, highest = measured.sendable
        lsb = abs((measured.fine or signal).scale)
        if lowest - lsb <= low and high <= highest + lsb:
            continue
        hint = placeholder(signal)
        yield (
            f"{name}: {signal.name} may have {lowest:.6g} to {highest:.6g} {unit}, the controller "
            f"commands {low:.6g} to {high:.6g} {unit}{f' ({hint})' if hint else ''}. Correct unit, "
            f"sign, factor and offset, or the range in the DBC, or write what the car can do in "
            f"[car]"
        )


def _period(message: Message, settings: MessageMapping) -> Iterator[str]:
    """A cycle time that is shorter than the control period, unless the mapping gives another."""
    cycle_ms, period_ms = message.cycle_time or 0, 1e3 * PERIOD_S
    if settings.period_s is None and 0 < cycle_ms < period_ms:
        yield (
            f"{message.name}: the DBC says a frame every {cycle_ms:g} ms, the gateway sends one "
            f"every {period_ms:g} ms. If the car accepts that, write period_s = {PERIOD_S:g} in "
            f"[messages.{message.name}]"
        )


def _protection(
    message: Message, commands: list[tuple[str, str]], settings: MessageMapping
) -> Iterator[str]:
    """A signal that has two tasks: a DBC where two signals share bits is refused before."""
    tasks = [
        *commands,
        *((each.name, "multiplexer") for each in message.signals if each.is_multiplexer),
    ]
    tasks += [(settings.checksum.signal, "the checksum")] if settings.checksum else []
    tasks += [(settings.counter, "the counter")] if settings.counter else []
    tasks += [(name, "a constant of driving") for name in settings.driving]
    first: dict[str, str] = {}
    for name, task in tasks:
        if first.setdefault(name, task) != task:
            yield (
                f"{message.name}: expected one task for {name}, found {first[name]} and {task}. "
                f"Correct [commands] or [messages.{message.name}]"
            )
