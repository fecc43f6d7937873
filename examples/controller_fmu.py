"""The controller as an FMU, in the loop with the simulated car.

pip install -e ".[fmu]" && offline-export --target fmu --output controller.fmu
python examples/controller_fmu.py controller.fmu
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy
from fmpy.simulation import instantiate_fmu

from rt_controller import ControlInput, Observation, simulate


class FmuLaw:
    def __init__(self, file: Path) -> None:
        description = fmpy.read_model_description(str(file))
        self.folder = TemporaryDirectory()
        fmpy.extract(str(file), self.folder.name)
        self.fmu = instantiate_fmu(self.folder.name, description, "CoSimulation")
        self.place = {each.name: each.valueReference for each in description.modelVariables}

    def reset(self) -> None:
        self.fmu.reset()
        self.time_s = 0.0

    def control(self, now: Observation) -> ControlInput:
        inputs = [*now.state, now.curvature_per_m, *now.path, *now.preview]
        self.fmu.setReal(range(19), inputs)  # the first variables, then three start values
        if self.time_s == 0.0:
            self.fmu.setReal(range(19, 22), now.previous)
            self.fmu.setInteger([self.place["delay_periods"]], [len(now.under_way)])
            self.fmu.enterInitializationMode()
            self.fmu.exitInitializationMode()
        self.fmu.doStep(self.time_s, 0.025)
        self.time_s += 0.025
        return ControlInput(*self.fmu.getReal([self.place[each] for each in ControlInput._fields]))


if __name__ == "__main__":
    print(simulate("double_lane_change", controller=FmuLaw(Path(sys.argv[1]))).errors)
