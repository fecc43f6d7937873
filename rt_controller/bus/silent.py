"""Where frames of a rehearsal go."""

import can


class SilentBus:
    """Takes every frame and drops it."""

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Nowhere."""
