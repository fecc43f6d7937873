"""The interface slcan with a bounded wait; importing it needs the package of serial ports."""

import can
from can.exceptions import error_check
from can.interfaces.slcan import slcanBus

SEND_TIMEOUT_S = 0.001
"""per frame: those of one period together take less than the period"""


class BoundedSlcanBus(slcanBus):
    """The interface slcan; a frame that the serial port does not take soon is an error."""

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame.

        Raises:
            can.CanOperationError: the port did not take it in time, whatever `timeout` is.
        """
        super().send(msg, SEND_TIMEOUT_S)

    def _write(self, string: str) -> None:
        with error_check("Could not write to serial device"):
            self.serialPortOrig.write(string.encode() + self.LINE_TERMINATOR)
