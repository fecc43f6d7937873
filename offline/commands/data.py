"""`offline-data`: the data set of the simulated car."""

import time
from functools import partial
from typing import Annotated, Any

from cyclopts import Parameter
from pydantic import Field

from offline.commands.options import DataFolder, JsonFile, require_ready
from offline.commands.terminal import STDOUT
from offline.config import PRESETS, LargestSteer
from offline.data.variation import RecipeName, Variation, choose_variation, describe
from rt_controller.contract.figures import require_folder, write_figures
from rt_controller.terminal.command_line import new_app, run_command
from sim_bridge.campaign import THIS_MACHINE, Backend

Ranges = Annotated[
    Variation | None,
    Parameter(
        name="*", group="Road, wind, load and tyres", negative_none="no-", negative_iterable=""
    ),
]

app = new_app("offline-data", "Make the data set: episodes of the simulated car.")
main = partial(run_command, app)


@app.default
def make_data(
    *,
    episodes: Annotated[int, Field(ge=10)] = PRESETS["paper"].episodes,
    seed: int = PRESETS["paper"].data_seed,
    recipe: RecipeName = "nominal",
    ranges: Ranges = None,
    largest_steer_deg: Annotated[LargestSteer | None, Parameter(negative_none="no-")] = None,
    data: DataFolder = None,
    backend: Backend = THIS_MACHINE,
    json_file: JsonFile = None,
) -> None:
    """Make the data set of the paper's recipe, or check an existing one.

    Args:
        episodes: episodes of 10 s, each of five trajectories; at least 10, for three parts
        seed: seed of the random streams and of the split into parts
        recipe: nominal: the car and the road of the car file, without wind; varied: other roads,
            wind, load and tyres too. The ranges below replace or add to those of the recipe
        largest_steer_deg: largest angle of the steering wheel, 40 to 300; default: what a plan may
            use at the speed, up to 300. Linear baselines need small angles
    """
    variation = choose_variation(recipe, ranges)
    require_ready(json_file)
    require_folder(data, "--data")
    from offline.commands.dataset import find_or_make, require_origin
    from offline.data.recipe import Recipe

    wanted = Recipe(variation=variation, largest_steer_deg=largest_steer_deg)
    begun = time.monotonic()
    folder, dataset = find_or_make(data, episodes, seed, wanted, backend)
    wall_s = time.monotonic() - begun
    require_origin(folder, dataset.origin, episodes, seed, wanted)
    manifest = dataset.manifest
    STDOUT.print(
        f"{manifest.trajectories} trajectories of {episodes} episodes, "
        f"{100 * manifest.rejected_fraction:.1f} % of the drawn drives rejected, "
        f"SHA-256 {dataset.sha256:.16}…, {wall_s:.1f} s\n{folder}",
        soft_wrap=True,
    )
    figures: dict[str, Any] = {
        "folder": str(folder),
        "n_episodes": episodes,
        "n_trajectories": manifest.trajectories,
        "rejected_fraction": manifest.rejected_fraction,
        "sha256": dataset.sha256,
        "wall_s": wall_s,
    }
    if variation is not None:
        STDOUT.print(f"drawn with {describe(variation)}", soft_wrap=True)
        figures["recipe"] = variation.model_dump()
    write_figures(json_file, figures)
