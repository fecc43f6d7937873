"""`offline-data`: the data set of the simulated car."""

import time
from functools import partial
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from offline.commands.options import DataFolder, JsonFile, require_ready
from offline.commands.terminal import STDOUT
from offline.config import PRESETS
from offline.data.variation import RecipeName, Variation, choose_variation, describe
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import require_folder, write_figures
from rt_controller.terminal.command_line import new_app, run_command
from sim_bridge.campaign import THIS_MACHINE, Backend

if TYPE_CHECKING:
    from offline.data.dataset import Dataset

LEAST_EPISODES = 10
EXTREMES = ("minimum", "mean", "maximum")

Ranges = Annotated[
    Variation | None,
    Parameter(
        name="*",
        group="Road, wind, load and tyres",
        negative_none="no-",
        negative_iterable="",
    ),
]

app = new_app("offline-data", "Make the data set: episodes of the simulated car.")
main = partial(run_command, app)


@app.default
def make_data(
    *,
    episodes: int = PRESETS["paper"].episodes,
    seed: int = PRESETS["paper"].data_seed,
    recipe: RecipeName = "nominal",
    ranges: Ranges = None,
    largest_steer_deg: Annotated[float | None, Parameter(negative_none="no-")] = None,
    data: DataFolder = None,
    backend: Backend = THIS_MACHINE,
    json_file: JsonFile = None,
) -> None:
    """Make the data set of the paper's recipe, or check an existing one.

    Args:
        episodes: episodes of 10 s, each of five trajectories
        seed: seed of the random streams and of the split into parts
        recipe: nominal: the car and the road of the car file, without wind; varied: other roads,
            wind, load and tyres too. The ranges below replace or add to those of the recipe
        largest_steer_deg: largest angle of the steering wheel, 40 to 300; default: what a plan may
            use at the speed, up to 300. Linear baselines need small angles
    """
    if episodes < LEAST_EPISODES:
        raise ConfigError(
            f"--episodes: expected at least {LEAST_EPISODES}, so that train, validation and test "
            f"each get some, found {episodes}."
        )
    if largest_steer_deg is not None and not 40.0 <= largest_steer_deg <= 300.0:
        raise ConfigError(
            f"--largest-steer-deg: expected 40 to 300, the angles that the controller may use, "
            f"found {largest_steer_deg:g}."
        )
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
    figures = {
        "folder": str(folder),
        "n_episodes": episodes,
        "n_trajectories": manifest.trajectories,
        "rejected_fraction": manifest.rejected_fraction,
        "sha256": dataset.sha256,
        "wall_s": wall_s,
    }
    if variation is not None:
        STDOUT.print(f"drawn with {describe(variation)}", soft_wrap=True)
        conditions = print_conditions(dataset)
        figures |= {"recipe": variation.model_dump(), "conditions": conditions}
    write_figures(json_file, figures)


def print_conditions(dataset: "Dataset") -> dict[str, dict[str, float]]:
    """Extremes and means of each condition over all samples, after they were printed."""
    from rt_controller.report.table import Column, Table, print_table

    rows = dataset.conditions_at(slice(None))
    extremes = zip(rows.min(axis=0), rows.mean(axis=0, dtype=float), rows.max(axis=0), strict=True)
    figures = {
        name: dict(zip(EXTREMES, map(float, values), strict=True))
        for name, values in zip(dataset.manifest.conditions, extremes, strict=True)
    }
    heads = (Column("condition", is_text=True), *map(Column, EXTREMES))
    lines = ((name, *(f"{v:.3f}" for v in found.values())) for name, found in figures.items())
    print_table(Table("conditions of all samples", heads, tuple(lines)), STDOUT)
    return figures
