"""A bus on which nothing is heard and nothing arrives: for rehearsals."""

from typing import Any

import can


class SilentBus(can.BusABC):
    """Takes every frame and drops it."""

    def __init__(self, channel: Any = None, **options: Any) -> None:
        super().__init__(channel=channel, **options)
        self.channel_info = "silent bus"

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Nowhere."""

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return None, True
