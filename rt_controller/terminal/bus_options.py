"""Options that choose a CAN bus, the same for both ends of it."""

from typing import Annotated

from cyclopts import Parameter
from pydantic import BaseModel, PositiveInt


class BusOptions(BaseModel):
    """A CAN bus in the words of python-can."""

    bus: str
    """python-can interface: socketcan, local, vector, …; virtual stays in one process, in which
    rt-controller simulates the car"""
    channel: str = "rt-controller"
    """the interface's channel, e.g. can0 or ws://127.0.0.1:54701/"""
    bitrate: PositiveInt | None = None
    """bit/s, where the interface sets it"""
    bus_option: Annotated[dict[str, str], Parameter(show_default=False)] = {}
    """further options of the interface, as --bus-option.KEY VALUE"""
