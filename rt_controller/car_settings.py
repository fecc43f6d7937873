"""Settings of the simulated car, for `rt-controller --bus virtual` and `sim-bridge`."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict

CAR_PRIORITY = 40
"""SCHED_FIFO priority of the car's thread, below the controller's"""


class CarSettings(BaseModel):
    """The car at the other end of the bus and its manoeuvre."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    scenario: str = "double_lane_change"
    """name of a shipped scenario, or the path of a .toml file"""
    plant: str = "own"
    """own, fmu:FILE.fmu (FMI 2 or 3 co-simulation) or commonroad:NUMBER"""
    plant_mapping: Path | None = None
    """which variable of the FMU is which signal; default: FILE.toml beside FILE.fmu"""
    car: str | None = None
    """parameters of the own car: a shipped name, or the path of a .toml file"""
    friction: float | None = None
    """of the road, 1 being the road of the tyre test; default: the scenario's"""
    friction_right: float | None = None
    """of the road under the own car's right wheels; default: as under the left ones"""
