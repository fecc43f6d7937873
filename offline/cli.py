"""The offline commands: data, train, export, evaluate, report, ablate, tune.

Arguments and exit codes only. What the commands do is in `offline.commands`, which is loaded when
one of them runs, and with it torch, numba and onnx: help and complaints need none of them.
"""

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from offline.backend import Backend, BackendName
from offline.config import PRESETS, TrainingConfig
from offline.terminal import ERRORS
from rt_controller.contract.errors import ConfigError, MissingExtraError, RtControllerError
from rt_controller.contract.figures import require_writable

RUNS = Path("runs")
NEEDED = ("torch", "numba", "onnx", "onnxscript", "joblib", "onnxruntime")

Config = Annotated[TrainingConfig | None, Parameter(name="*", negative_none="no-")]
JsonFile = Annotated[Path | None, Parameter(name="--json")]
Folders = Annotated[list[Path] | None, Parameter(consume_multiple=True, negative="")]
Names = Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")]

data_app = App(name="offline-data", help="Make the data set: episodes of the simulated car.")
import_app = App(
    name="offline-import",
    help="Make a data set of recorded logs: CSV, Parquet, MF4, npz, MATLAB, or CAN with a DBC. "
    "Nothing is written unless every log is found good. docs/own-data.md has the mapping file.",
)
train_app = App(
    name="offline-train", help="Train a model; the defaults are those of the preset recommended."
)
export_app = App(name="offline-export", help="Make the bundle that rt-controller drives with.")
evaluate_app = App(
    name="offline-evaluate", help="Predict two seconds ahead on held-out data, beside the rivals."
)
report_app = App(
    name="offline-report", help="The evaluation with its plots, as one page that needs no network."
)
ablate_app = App(
    name="offline-ablate", help="Train variants of a model on the same data, and compare them."
)
tune_app = App(
    name="offline-tune", help="Search for the settings of a training; several processes may join."
)


def data_main() -> None:
    """Entry of `offline-data`."""
    _run(data_app)


def import_main() -> None:
    """Entry of `offline-import`."""
    _run(import_app)


def train_main() -> None:
    """Entry of `offline-train`."""
    _run(train_app)


def export_main() -> None:
    """Entry of `offline-export`."""
    _run(export_app)


def evaluate_main() -> None:
    """Entry of `offline-evaluate`."""
    _run(evaluate_app)


def report_main() -> None:
    """Entry of `offline-report`."""
    _run(report_app)


def ablate_main() -> None:
    """Entry of `offline-ablate`."""
    _run(ablate_app)


def tune_main() -> None:
    """Entry of `offline-tune`."""
    _run(tune_app)


@data_app.default
def make_data(
    *,
    episodes: int = PRESETS["paper"].episodes,
    seed: int = PRESETS["paper"].data_seed,
    data: Path | None = None,
    backend: BackendName = "loky",
    address: str | None = None,
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
    backend
        who does the work: processes or threads of this machine, a Dask or a Ray cluster
    address
        HOST:PORT of the cluster; without it one is made on this machine
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
    workers = Backend(backend, address, jobs)
    _prepare(json_file)
    from offline import commands

    return commands.make_data(episodes, seed, data, workers, json_file)


@import_app.default
def import_logs(
    mapping: Path,
    logs: Annotated[list[Path], Parameter(consume_multiple=True, negative="")],
    *,
    data: Path | None = None,
    replace: bool = False,
    json_file: JsonFile = None,
) -> int:
    """Bring logs of a real car into the form that models are trained on, and say what is in them.

    Reads CSV, Parquet, MF4, npz, MATLAB files, and CAN logs with a DBC; docs/own-data.md has the
    mapping file. Nothing is written unless every log is found good.

    Parameters
    ----------
    mapping
        TOML file that says which columns are which signals
    logs
        files, or folders of them
    data
        folder that gets the data set; without it the logs are only looked at
    replace
        a data set that is there may go
    json_file
        write the figures to this file
    """
    require_writable(json_file)
    from offline.import_run import import_logs as run_import

    return run_import(mapping, logs, data, replace=replace, json_file=json_file)


@train_app.default
def train_model(
    *,
    config: Config = None,
    resume: Path | None = None,
    runs: Path = RUNS,
    data: Path | None = None,
    backend: BackendName = "loky",
    address: str | None = None,
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
    backend
        who makes the data set: processes or threads of this machine, a Dask or a Ray cluster
    address
        HOST:PORT of the cluster; without it one is made on this machine
    jobs
        processes that make the data set; -1 is one per core
    json_file
        write the figures to this file
    """
    workers = Backend(backend, address, jobs)
    _prepare(json_file)
    from offline import commands

    if resume is not None:
        return commands.resume_training(resume, config, data, json_file)
    return commands.train_model(config, runs, data, workers, json_file)


@export_app.default
def export_model(
    run: Path | None = None,
    *,
    output: Path | None = None,
    rival: str | None = None,
    data: Path | None = None,
    json_file: JsonFile = None,
) -> int:
    """Export the best model of a run, or a rival fitted to a data set.

    Parameters
    ----------
    run
        folder of the run; without it the latest below runs/
    output
        folder of the bundle; without it `bundle` in the folder of the run, or runs/RIVAL
    rival
        export that rival of the data set instead, for instance lti or edmd-polynomial-66;
        docs/rivals.md says which there are
    data
        folder of the data set; without it the one the run was trained on
    json_file
        write the figures to this file
    """
    _prepare(json_file)
    from offline import commands

    if rival is not None:
        latest = run or RUNS / "latest"
        return commands.export_rival(rival, data, output or RUNS / rival, latest, json_file)
    return commands.export_run(run or RUNS / "latest", output, data, json_file)


@evaluate_app.default
def evaluate_models(
    *,
    model: Folders = None,
    data: Path | None = None,
    rivals: Names = None,
    sets: Names = None,
    json_file: JsonFile = None,
) -> int:
    """Errors over 80 open-loop steps on the test trajectories, in the form of the paper's Table I.

    Parameters
    ----------
    model
        folders of bundles; without it that of the latest run
    data
        folder of a data set; without it the full one if it is in the cache, else one that a
        model, or the latest run, was trained on. A data set whose test episodes a model may have
        been trained on is refused
    rivals
        names of rivals, "all" or "none"; without it linear models, persistence, and the paper's
        network. A rival that is not in the cache is fitted first
    sets
        library, new-roads, robustness; without it all of them
    json_file
        write the figures to this file
    """
    _prepare(json_file)
    from offline import evaluation_run

    latest = RUNS / "latest"
    return evaluation_run.evaluate_models(
        model or [latest / "bundle"], data, latest, rivals or [], sets or [], json_file
    )


@report_app.default
def write_report(
    *,
    output: Path,
    model: Folders = None,
    data: Path | None = None,
    rivals: Names = None,
    sets: Names = None,
    json_file: JsonFile = None,
) -> int:
    """The evaluation as a page with tables, plots and the paper's double lane change.

    Parameters
    ----------
    output
        HTML file to write
    model
        folders of bundles; without it that of the latest run
    data
        folder of a data set, chosen as by offline-evaluate
    rivals
        names of rivals, "all" or "none"; without it those of offline-evaluate
    sets
        library, new-roads, robustness; without it all of them
    json_file
        write the figures to this file
    """
    _prepare(json_file)
    _require_plots()
    from offline import report_run

    latest = RUNS / "latest"
    return report_run.write_report(
        output, model or [latest / "bundle"], data, latest, rivals or [], sets or [], json_file
    )


@ablate_app.default
def ablate(
    variants: str = "ladder",
    *,
    config: Config = None,
    seeds: str = "0",
    only: str = "",
    lists: Path | None = None,
    folder: Path | None = None,
    data: Path | None = None,
    backend: BackendName = "loky",
    address: str | None = None,
    jobs: int = -1,
    json_file: JsonFile = None,
) -> int:
    """Train every variant with every seed, and write how each compares with a linear model.

    Ctrl-C stops; the same command goes on. What has ended is not done again. Options of
    offline-train, like --steps, hold for all variants. docs/scale-out.md has the file of variants.

    Parameters
    ----------
    variants
        a list of the file: ladder, leave-one-out, sizes, paper-readings; or a preset, which is a
        list of one
    seeds
        seeds of every variant, like 0,1,2
    only
        names of variants, like paper,history; without it all of the list
    lists
        TOML file with lists of one's own; without it the one that ships
    folder
        folder of the campaign; without it ablation-LIST below runs/
    data
        folder of the data set; without it a cache folder, which is printed
    backend
        who trains: processes or threads of this machine, a Dask or a Ray cluster
    address
        HOST:PORT of the cluster; without it one is made on this machine
    jobs
        trainings at a time; -1 is one per core
    json_file
        write the figures to this file
    """
    workers = Backend(backend, address, jobs)
    _prepare(json_file)
    from offline.ablation import Question, parse_names, parse_seeds
    from offline.ablation import ablate as run_ablation

    question = Question(variants, parse_seeds(seeds), parse_names(only), lists, config)
    place = folder or RUNS / f"ablation-{variants}"
    return run_ablation(question, place, data, workers, json_file)


@tune_app.default
def tune(
    space: str = "method",
    *,
    config: Config = None,
    trials: int = 50,
    search_seed: int = 0,
    spaces: Path | None = None,
    folder: Path | None = None,
    data: Path | None = None,
    backend: BackendName = "loky",
    address: str | None = None,
    jobs: int = -1,
    json_file: JsonFile = None,
) -> int:
    """Search for the settings whose model is furthest ahead of a linear one on validation data.

    Ctrl-C stops; the same command goes on, and may be given several times at once to work on one
    study. Options of offline-train, like --steps, hold for all trials. docs/scale-out.md has the
    file of spaces.

    Parameters
    ----------
    space
        a search space of the file: method, structure, paper-weights
    trials
        trials all in all, those of earlier commands and of other processes included
    search_seed
        of the search; --seed is that of every training
    spaces
        TOML file with spaces of one's own; without it the one that ships
    folder
        folder of the study; without it tuning-SPACE below runs/
    data
        folder of the data set; without it a cache folder, which is printed
    backend
        who trains: processes or threads of this machine, a Dask or a Ray cluster
    address
        HOST:PORT of the cluster; without it one is made on this machine
    jobs
        trials at a time; -1 is one per core
    json_file
        write the figures to this file
    """
    workers = Backend(backend, address, jobs)
    _prepare(json_file)
    if find_spec("optuna") is None:
        raise MissingExtraError(
            "offline-tune expects the extra 'tune', found no optuna. Run: pip install -e "
            '".[offline,tune]"'
        )
    from offline.tuning import Search
    from offline.tuning import tune as run_search

    search = Search(space, spaces, search_seed, trials, config)
    place = folder or RUNS / f"tuning-{space}"
    return run_search(search, place, data, workers, json_file)


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


def _require_plots() -> None:
    if find_spec("matplotlib") is None:
        raise MissingExtraError(
            "a report expects the extra 'report', found no matplotlib. "
            'Run: pip install -e ".[offline,report]"'
        )
