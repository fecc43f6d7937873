"""The controller as an FMU, in the loop with the simulated car; it needs a C compiler.

pip install -e ".[fmu]" && python examples/controller_fmu.py
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy
from fmpy.simulation import instantiate_fmu

from offline.targets.fmu import write_fmu
from rt_controller import Bundle, ControlInput, Observation, simulate
from rt_controller.config import MpcSettings


class FmuLaw:
    def __init__(self, file: Path) -> None:
        description = fmpy.read_model_description(str(file))
        self.folder = TemporaryDirectory()
        fmpy.extract(str(file), self.folder.name)
        self.fmu = instantiate_fmu(self.folder.name, description, "CoSimulation")
        self.place = {each.name: each.valueReference for each in description.modelVariables}

    def reset(self) -> None:
        self.fmu.reset()
        self.period = 0

    def control(self, now: Observation) -> ControlInput:
        fmu, place = self.fmu, self.place
        if self.period == 0:
            fmu.setReal(range(place["start.throttle"], place["throttle"]), now.previous)
            fmu.setInteger([place["delay_periods"]], [len(now.under_way)])
            fmu.setupExperiment()
            fmu.enterInitializationMode()
            fmu.exitInitializationMode()
        inputs = [*now.state, now.curvature_per_m, *now.path, *now.preview]
        fmu.setReal(range(len(inputs)), inputs)
        fmu.doStep(0.025 * self.period, 0.025)
        self.period += 1
        return ControlInput(*fmu.getReal([place[name] for name in ControlInput._fields]))


if __name__ == "__main__":
    write_fmu(Path("controller.fmu"), Bundle.load("mdk-net"), MpcSettings())
    print(simulate(controller=FmuLaw(Path("controller.fmu"))).errors)
