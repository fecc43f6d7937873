"""Program: builds everything at a control period of 20 ms, then drives a lane change.

Only the constant PERIOD_NS is changed, before any other module is imported. Arguments: a folder
for the data, the model, the summary and the log.
"""

import runpy
import sys
from importlib import util
from pathlib import Path

NAME = "rt_controller.contract.timing"
EPISODES = 20


def import_timing_of_20_ms() -> None:
    """Import the contract's timing with one line changed."""
    spec = util.find_spec(NAME)
    assert spec is not None
    assert spec.origin is not None
    source = Path(spec.origin).read_text().replace("NS = 25_000_000", "NS = 20_000_000")
    timing = util.module_from_spec(spec)
    exec(compile(source, spec.origin, "exec"), vars(timing))
    assert timing.PERIOD_NS == 20_000_000
    sys.modules[NAME] = timing


def fit_linear_model(folder: Path) -> Path:
    """The folder of a linear model, fitted to drives of the simulated car."""
    import numpy as np

    from offline.baselines.linear import fit_linear
    from offline.data.dataset import Roads, Simulated, load_dataset, save_dataset, split_episodes
    from offline.data.generate import assemble, make_episode
    from offline.data.recipe import Recipe
    from offline.data.signals import VEHICLE_ROLES
    from rt_controller.contract.signals import VEHICLE
    from rt_controller.model.bundle import Bundle

    recipe = Recipe()
    drives = assemble(
        [make_episode(recipe, seed) for seed in np.random.SeedSequence(1).spawn(EPISODES)]
    )
    save_dataset(
        folder / "data",
        drives.recording,
        drives.slices,
        split_episodes(EPISODES, 1),
        schema=VEHICLE,
        roles=VEHICLE_ROLES,
        roads=Roads(recipe.curvatures_per_m, 2.0, 0.15),
        origin=Simulated(recipe, EPISODES, 1, "20 ms"),
        rejected=drives.rejected,
    )
    model = fit_linear(load_dataset(folder / "data")).matrices
    Bundle.linear(model.A, model.B_uc, model.B_uw, model.c).save(folder / "model")
    return folder / "model"


def drive_lane_change(folder: Path, model: Path) -> None:
    """Write summary.json and drive.log of a lane change, and the DBC for this period."""
    from virtual_drive import drive

    from rt_controller.bus.dbc import DBC_PATH

    tool = Path(__file__).parents[2] / "tools" / "cycle_times.py"
    with_cycle_times = runpy.run_path(str(tool))["with_cycle_times"]
    (folder / "messages.dbc").write_text(with_cycle_times(DBC_PATH.read_text()))
    drive(folder, model, "--record", str(folder / "drive.log"), "--scenario", "lane_change_60")


if __name__ == "__main__":
    target = Path(sys.argv[1])
    import_timing_of_20_ms()
    drive_lane_change(target, fit_linear_model(target))
