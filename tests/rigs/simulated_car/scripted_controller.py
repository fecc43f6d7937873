"""A scripted controller at the other end of a virtual bus, for the tests of the vehicle."""

from rt_controller.bus.messages import COMMAND, HEARTBEAT, Command, Heartbeat
from rt_controller.bus.send import Outbox
from rt_controller.contract.faults import Fault


def send_command(outbox: Outbox, command: Command, now_ns: int, counter: int) -> None:
    """A command with its heartbeat, which answers the state with this long counter."""
    heartbeat = Heartbeat(command.mode, Fault(0), counter % 128, 500_000, 1_000_000, 3)
    outbox.send(COMMAND, command, now_ns, counter=counter)
    outbox.send(HEARTBEAT, heartbeat, now_ns, counter=counter)
