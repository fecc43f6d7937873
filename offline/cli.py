"""The four offline commands: data, train, export, evaluate.

Arguments and exit codes only. What the commands do is in `offline.commands`, which is loaded when
one of them runs, and with it torch, numba and onnx: help and complaints need none of them.
"""

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from offline.config import PRESETS, TrainingConfig
from offline.terminal import ERRORS
from rt_controller.contract.errors import ConfigError, MissingExtraError, RtControllerError
from rt_controller.contract.figures import require_writable

RUNS = Path("runs")
NEEDED = ("torch", "numba", "onnx", "onnxscript", "joblib", "onnxruntime")

JsonFile = Annotated[Path | None, Parameter(name="--json")]

data_app = App(name="offline-data", help="Make the data set: episodes of the simulated car.")
train_app = App(name="offline-train", help="Train MDK-Net. The defaults are the paper's.")
export_app = App(name="offline-export", help="Make the bundle that rt-controller drives with.")
evaluate_app = App(
    name="offline-evaluate", help="Predict two seconds ahead on held-out data, beside the rivals."
)


def data_main() -> None:
    """Entry of `offline-data`."""
    _run(data_app)


def train_main() -> None:
    """Entry of `offline-train`."""
    _run(train_app)


def export_main() -> None:
    """Entry of `offline-export`."""
    _run(export_app)


def evaluate_main() -> None:
    """Entry of `offline-evaluate`."""
    _run(evaluate_app)


@data_app.default
def make_data(
    *,
    episodes: int = PRESETS["paper"].episodes,
    seed: int = PRESETS["paper"].data_seed,
    data: Path | None = None,
    jobs: int = -1,
    json_file: JsonFile = None,
) -> int:
    """Make the data set of the paper's recipe, or check the one that is there.

    Parameters
    ----------
    episodes
        episodes of 10 s, five trajectories each
    seed
        of the random streams and of the split
    data
        folder of the data set; without it a cache folder, which is printed
    jobs
        processes; -1 is one per core
    json_file
        write the figures to this file
    """
    if episodes < 10:
        raise ConfigError(
            f"--episodes: expected at least 10, so that train, validation and test each get some, "
            f"found {episodes}."
        )
    _prepare(json_file)
    from offline import commands

    return commands.make_data(episodes, seed, data, jobs, json_file)


@train_app.default
def train_model(
    *,
    config: Annotated[TrainingConfig | None, Parameter(name="*")] = None,
    resume: Path | None = None,
    runs: Path = RUNS,
    data: Path | None = None,
    jobs: int = -1,
    json_file: JsonFile = None,
) -> int:
    """Train a model; make the data set first where there is none.

    Ctrl-C ends the run after a checkpoint, with the command that resumes it.

    Parameters
    ----------
    resume
        go on with this run; only --steps and --threads may differ from its configuration
    runs
        folder that gets a new folder for each run
    data
        folder of the data set; without it a cache folder, which is printed
    jobs
        processes that make the data set; -1 is one per core
    json_file
        write the figures to this file
    """
    _prepare(json_file)
    from offline import commands

    if resume is not None:
        return commands.resume_training(resume, config, data, json_file)
    return commands.train_model(config, runs, data, jobs, json_file)


@export_app.default
def export_model(
    run: Path | None = None,
    *,
    output: Path | None = None,
    lti: bool = False,
    data: Path | None = None,
    json_file: JsonFile = None,
) -> int:
    """Export the best model of a run, or the linear rival of a data set.

    Parameters
    ----------
    run
        folder of the run; without it the latest below runs/
    output
        folder of the bundle; without it `bundle` in the folder of the run, or runs/lti
    lti
        export the linear model of the data set instead
    data
        folder of the data set; without it the one the run was trained on
    json_file
        write the figures to this file
    """
    _prepare(json_file)
    from offline import commands

    if lti:
        return commands.export_lti(data, output or RUNS / "lti", run or RUNS / "latest", json_file)
    return commands.export_run(run or RUNS / "latest", output, data, json_file)


@evaluate_app.default
def evaluate_model(
    *, model: Path | None = None, data: Path | None = None, json_file: JsonFile = None
) -> int:
    """Errors over 80 open-loop steps on the test trajectories, in the form of the paper's Table I.

    Parameters
    ----------
    model
        folder of a bundle; without it that of the latest run
    data
        folder of a data set; without it the full one if it is in the cache, else the one that the
        model, or the latest run, was trained on. A data set whose test episodes the model may
        have been trained on is refused
    json_file
        write the figures to this file
    """
    _prepare(json_file)
    from offline import commands

    latest = RUNS / "latest"
    return commands.evaluate_model(model or latest / "bundle", data, latest, json_file)


def _run(app: App) -> None:
    try:
        app(sys.argv[1:])
    except RtControllerError as error:
        ERRORS.print(f"{app.name[0]}: {error}", style="red", markup=False, highlight=False)
        sys.exit(error.exit_code)


def _prepare(json_file: Path | None) -> None:
    """Raise now what would otherwise be found after an hour of work."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise MissingExtraError(
            f"training expects the extra 'offline', found no {', '.join(missing)}. "
            f'Run: pip install -e ".[offline]"'
        )
    require_writable(json_file)
