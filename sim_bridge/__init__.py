"""The simulated vehicle at the other end of the bus: the public names, imported on first use."""

from typing import TYPE_CHECKING

from rt_controller.public_names import public_names

if TYPE_CHECKING:
    from sim_bridge.adapters.gym import CarEnv as CarEnv
    from sim_bridge.plant.protocol import Plant as Plant
    from sim_bridge.plant.protocol import PlantOutputs as PlantOutputs
    from sim_bridge.scenario import Scenario as Scenario
    from sim_bridge.scenario import load_scenario as load_scenario
    from sim_bridge.scenario import parse_scenario as parse_scenario

__all__, __getattr__, __dir__ = public_names(
    __name__,
    {
        "CarEnv": "adapters.gym",
        "Plant": "plant.protocol",
        "PlantOutputs": "plant.protocol",
        "Scenario": "scenario",
        "load_scenario": "scenario",
        "parse_scenario": "scenario",
    },
)
