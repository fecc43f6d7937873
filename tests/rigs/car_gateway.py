"""A gateway in simulated time, between a car and what sends the commands."""

from own_car import VALUES, changed, command_reader, example, state_writer

from rt_controller.bus.messages import COMMAND, HEARTBEAT, Command, Heartbeat, Node
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.contract.faults import Fault
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.gateway.process import Gateway
from rt_controller.mapping.lateral_speed import LateralSpeed, RearAxle
from rt_controller.mapping.signal_frames import FrameQueue

REAR_AXLE = RearAxle(1.86, 0.005, 0.5)


def send_command(sender, control, tick, mode=Mode.NOMINAL):
    """As the controller does: the heartbeat says which state the command answers."""
    sender.send(COMMAND, Command(control, mode), 0, counter=tick)
    heartbeat = Heartbeat(mode, Fault(0), tick % 128, None, None, None)
    sender.send(HEARTBEAT, heartbeat, 0, counter=tick)


def with_period(folder, period_s):
    """The example, with commands that the car receives less often."""
    table = "[messages.DriveRequest]"
    return changed(folder, (table, f"{table}\nperiod_s = {period_s}"))


class QueueBus(FrameQueue):
    """A bus of one reader and one writer."""

    def __init__(self):
        super().__init__()
        self.waiting = []

    def recv(self, timeout):
        return self.waiting.pop(0) if self.waiting else None


class GatewayRig:
    """A gateway, the car at one end of it and what sends the commands at the other."""

    def __init__(self, car=None):
        car, self.below, self.above = car or example(), QueueBus(), QueueBus()
        self.gateway = Gateway(self.below, self.above, car, LateralSpeed(REAR_AXLE))
        self.writer, self.reader = state_writer(car), command_reader(car)
        self.commands = FrameQueue()
        self.sender = Outbox(self.commands, Node.CONTROLLER)
        self.inbox = Inbox(Node.CONTROLLER)
        self.values = dict(VALUES)
        self.change = lambda frame: True
        """changes a frame of the car; False: it is lost"""
        self.found = {}
        """newest values that the car received"""
        self.tick = 0

    def drive(self, command=None, mode=Mode.NOMINAL, is_car_silent=False):
        """One period; the newest values that the car received."""
        now_ns = self.tick * PERIOD_NS
        if not is_car_silent:
            sent = self.writer.frames(self.values, self.tick)
            self.below.waiting = [frame for frame in sent if self.change(frame)]
        if command is not None:
            send_command(self.sender, command, self.tick, mode)
            self.above.waiting += self.commands.frames
            self.commands.frames.clear()
        self.gateway.exchange(now_ns, has_wall_clock=False)
        self.above.frames.clear()
        self.gateway.tick(now_ns)
        for frame in self.above.frames:
            self.inbox.accept(frame, now_ns)
        self.tick += 1
        return self.read()

    def read(self):
        """The newest values that the car received."""
        while self.below.frames:
            self.found |= self.reader.read(self.below.frames.popleft())
        return self.found
