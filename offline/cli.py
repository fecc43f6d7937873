"""The offline commands: their options and entry points.

Everything heavy is imported inside the functions, so that `--help` and refused options need neither
torch nor onnx.
"""

from functools import partial
from math import inf
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from pydantic import Field

from offline.campaign import THIS_MACHINE, Backend
from offline.commands.options import (
    LATEST_RUN,
    RUNS,
    Config,
    DataFolder,
    EvaluationOptions,
    JsonFile,
    Ranges,
    require_ready,
)
from offline.config import PRESETS
from offline.data.variation import RecipeName, choose_variation
from rt_controller.contract.errors import ConfigError, require_packages
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.terminal.command_line import new_app, run_command
from sim_bridge.plant.shipped_cars import DEFAULT_CAR

LEAST_EPISODES = 10
HELD_OUT = EvaluationOptions()
_MAIN_OPTIONS = "preset steps seed data resume runs init json"
_TRAINING = {
    "Main options": _MAIN_OPTIONS,
    "Data": "episodes data-seed windows rare-share near-roads mirror noise",
    "Optimisation": "batch optimizer learning-rate matrix-rate operator-rate rate-schedule "
    "patience evaluate-every gradient-clip best-rule",
    "Loss": "objective horizon-start horizon-growth forgetting weight-single-step "
    "weight-multi-step weight-stability weight-regularisation decay-encoder decay-operator "
    "operator-prior stability through-last-step target-samples",
    "Model": "activation hidden latents latents-start constant-observable lift-exogenous products "
    "history-steps separate-motion bilinear-rank "
    "saturating-gains drift-rank bilinear-follows",
    "Machine": "threads device backend address jobs",
}
"""options of offline-train by group"""

data_app = new_app("offline-data", "Make the data set: episodes of the simulated car.")
import_app = new_app(
    "offline-import",
    "Make a data set of recorded logs: CSV, Parquet, MF4, npz, MATLAB, or CAN with a DBC. "
    "Nothing is written unless every log passes the checks. docs/own-data.md has the mapping file.",
    "MAPPING LOGS",
)
train_app = new_app(
    "offline-train",
    "Train a model; the defaults are those of the preset recommended.",
    groups=_TRAINING,
)
export_app = new_app("offline-export", "Make the bundle that rt-controller drives with.", "[RUN]")
evaluate_app = new_app(
    "offline-evaluate", "Predict two seconds ahead on held-out data, beside the baselines."
)
replay_app = new_app(
    "offline-replay",
    "Drive the simulated car with the recorded steering and speed of a real one, and print how far "
    "its other signals are from the recorded ones. Nothing is judged. docs/validation.md has the "
    "names of columns.",
    "LOGS",
)


@data_app.default
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
    from offline.commands import dataset
    from offline.data.recipe import Recipe

    wanted = Recipe(variation=variation, largest_steer_deg=largest_steer_deg)
    write_figures(json_file, dataset.make_data(episodes, seed, wanted, data, backend))


@import_app.default
def import_logs(
    mapping: Path,
    logs: Annotated[list[Path], Parameter(consume_multiple=True, negative="")],
    *,
    data: Path | None = None,
    replace: bool = False,
    json_file: JsonFile = None,
) -> None:
    """Convert logs of a real car into a data set to train on, and report what they contain.

    Args:
        mapping: TOML file that maps columns to signals
        logs: log files, or folders of them
        data: folder for the data set; default: none, the logs are only checked
        replace: overwrite an existing data set
    """
    require_packages("offline,logs", ("pandas",), "offline-import")
    require_writable(json_file)
    from offline.commands import log_import

    write_figures(json_file, log_import.import_logs(mapping, logs, data, replace=replace))


@train_app.default
def train(
    *,
    config: Config = None,
    resume: Path | None = None,
    runs: Path = RUNS,
    data: DataFolder = None,
    backend: Backend = THIS_MACHINE,
    json_file: JsonFile = None,
) -> int:
    """Train a model, on the data set --data or on one in the cache, which is made if necessary.

    Ctrl-C ends the run after a checkpoint and prints the command that resumes it.

    Args:
        resume: continue this run; only --threads may differ from its configuration, and --steps if
            its learning rate follows no cosine
        runs: folder that gets a new folder for each run
    """
    require_ready(json_file)
    from offline.commands import training_run

    if resume is not None:
        figures, exit_code = training_run.resume_run(resume, config, data)
    else:
        figures, exit_code = training_run.start_run(config, runs, data, backend)
    write_figures(json_file, figures)
    return exit_code


@export_app.default
def export(
    run: Path = LATEST_RUN,
    *,
    output: Path | None = None,
    baseline: str | None = None,
    data: Path | None = None,
    bundle: Path | None = None,
    model_trial: Literal["auto", "off"] = "auto",
    json_file: JsonFile = None,
) -> None:
    """Export the best model of a run, or a baseline, or an existing bundle in the present format.

    Args:
        run: folder of the run
        output: folder of the bundle; default: bundle in the run, runs/BASELINE, or --bundle
        baseline: export this baseline of the data set instead, for instance lti or
            edmd-bilinear; docs/baselines.md lists them
        data: folder of the data set; default: the one the run was trained on
        bundle: store plans in this bundle, a folder or a shipped name; needs neither run nor data
        model_trial: auto: drive the simulated car with a model of it for eleven simulated seconds,
            and refuse one that does not hold or predict it; off: export any model
    """
    is_tried = model_trial == "auto"
    if bundle is not None:
        if baseline is not None or data is not None or run != LATEST_RUN:
            raise ConfigError(
                "--bundle: expected no run, --baseline or --data beside it, found one of them. "
                "Leave it out, or leave out --bundle."
            )
        require_writable(json_file)
        from offline.commands.stored_plans import store_plans

        write_figures(json_file, store_plans(bundle, output, is_tried))
        return
    require_ready(json_file)
    from offline.commands.bundle import export_baseline, export_run

    if baseline is not None:
        figures = export_baseline(baseline, data, output or RUNS / baseline, run, is_tried)
    else:
        figures = export_run(run, output, data, is_tried)
    write_figures(json_file, figures)


@evaluate_app.default
def evaluate(
    *,
    options: EvaluationOptions = HELD_OUT,
    html: Path | None = None,
    json_file: JsonFile = None,
) -> None:
    """Errors over 80 open-loop steps on the test trajectories, as in the paper's Table I.

    Args:
        html: write a page with the first table and four pictures: errors over time, comparison
            with the baselines, eigenvalues, and the paper's double lane change
    """
    require_ready(json_file)
    from offline.commands import evaluation

    write_figures(json_file, evaluation.evaluate_models(options, html))


@replay_app.default
def replay(
    logs: Annotated[list[Path], Parameter(consume_multiple=True, negative="")],
    *,
    car: str = DEFAULT_CAR,
    column: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = (),
    period_s: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None,
    from_s: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = 0.0,
    to_s: Annotated[float, Field(gt=0.0), Parameter(show_default=False)] = inf,
    friction: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None,
    json_file: JsonFile = None,
) -> None:
    """Compare the simulated car with recorded drives.

    Args:
        logs: log files: CSV, npz, npy, MATLAB or Parquet
        car: name or file of the car
        column: NAME=COLUMN: signal and unit of a column, as in yaw_rate_degps=r; NAME=-COLUMN
            changes the sign; may be given several times
        period_s: period of a log without a column of times
        from_s: use the log from this time on, counted from its beginning
        to_s: use the log until this time
        friction: of the road of the recording; default: that of the car file
    """
    require_packages("offline,logs", ("pandas",), "offline-replay")
    require_writable(json_file)
    from offline.commands.replay import replay_logs
    from offline.logs.recorded_drive import Window

    figures = replay_logs(logs, car, column, period_s, Window(from_s, to_s), friction)
    write_figures(json_file, figures)


data_main = partial(run_command, data_app)
import_main = partial(run_command, import_app)
train_main = partial(run_command, train_app)
export_main = partial(run_command, export_app)
evaluate_main = partial(run_command, evaluate_app)
replay_main = partial(run_command, replay_app)
