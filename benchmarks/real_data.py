"""`python -m benchmarks.real_data`: the tables of docs/real-data.md, from logs of two real cars."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import cyclopts

from offline.commands.bundle import export_run
from offline.commands.evaluation import evaluation_figures, run_evaluation
from offline.commands.log_import import import_logs
from offline.commands.options import THIS_MACHINE, EvaluationOptions
from offline.commands.terminal import STDOUT
from offline.commands.training_run import start_run
from offline.config import TrainingConfig
from offline.data.dataset import exists
from offline.evaluation.tables import ratio_table, rms_table
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.report.table import to_markdown
from rt_controller.terminal.command_line import run_command

EXAMPLES = Path(__file__).parents[1] / "examples"
SEVERAL = cyclopts.Parameter(consume_multiple=True, negative="")
BASELINES = ("persistence", "lti", "dmdc-delays-path", "lti-scheduled-delays", "edmd-bilinear")


class Experiment(NamedTuple):
    """A data set of recorded drives, and which of them are held back."""

    name: str
    mapping: str
    """file among the examples"""
    split: str = ""
    """[split] in its place"""


GTI = (
    Experiment("gti", "import_gti.toml"),
    Experiment(
        "gti-other-courses",
        "import_gti.toml",
        '[split]\nvalidation = ["*exp_8.npz"]\ntest = ["*exp_6.npz", "*exp_11.npz"]\n'
        "longest_episode_s = 15.0\n",
    ),
)
AV21 = (Experiment("av21", "import_av21.toml"),)
OTHER_TRACK = Experiment(
    "av21-other-track",
    "import_av21.toml",
    '[split]\ntest = ["{test}"]\nlongest_episode_s = 10.0\nshare = 0.2\n',
)
"""trained on one track, tested on the other"""

app = cyclopts.App(name="python -m benchmarks.real_data", version_flags=[])


@app.default
def main(
    folder: Path,
    *,
    gti: Path | None = None,
    av21: Path | None = None,
    other_track: Path | None = None,
    preset: str = "quick",
    steps: int | None = None,
    seeds: Annotated[tuple[int, ...], SEVERAL] = (0, 1, 2),
    baselines: Annotated[tuple[str, ...], SEVERAL] = BASELINES,
    json: Annotated[Path | None, cyclopts.Parameter(name="--json")] = None,
) -> int:
    """Import, train, export and evaluate, and print the tables in Markdown.

    What the folder has already is not made again.

    Parameters
    ----------
    folder
        Gets mappings, data sets, runs and models, in a folder for each experiment.
    gti
        Folder of the drives exp_*.npz.
    av21
        Log of one track, Putnam_park2023_run4_2.csv.
    other_track
        Log of another track, such as LVMS_23_01_04_B.csv: the test of an experiment of its own.
    preset
        Of the training.
    steps
        Of the training; default: those of the preset.
    seeds
        One model for each; the first is also trained with a constant B.
    baselines
        As in offline-evaluate.
    json
        File for all figures.
    """
    require_writable(json)
    figures = {}
    for experiment, logs in _experiments(gti, av21, other_track):
        place = folder / experiment.name
        data = place / "data"
        imported = {} if exists(data) else _import(experiment, logs, place)
        models = [
            _model(place / "models" / name, data, config)
            for name, config in _configs(preset, steps, seeds)
        ]
        options = EvaluationOptions(models, data, list(baselines), sets=["library"])
        evaluation = run_evaluation(options)
        comparison = evaluation.comparison
        library = comparison.sets[0]
        STDOUT.print(f"\n**{experiment.name}**\n", markup=False)
        ratios = (ratio_table(comparison, model, library) for model in comparison.models)
        for table in (rms_table(comparison, library, with_intervals=True), *ratios):
            lines = (table.title, "", to_markdown(table), "", *table.footnotes, "")
            STDOUT.print("\n".join(lines), soft_wrap=True, markup=False, highlight=False)
        figures[experiment.name] = {"import": imported, **evaluation_figures(evaluation)}
    write_figures(json, figures)
    return 0


def _experiments(
    gti: Path | None, av21: Path | None, other_track: Path | None
) -> Iterator[tuple[Experiment, Sequence[Path]]]:
    """Those of the logs that are given, with their logs."""
    if gti is None and av21 is None:
        raise ConfigError("expected logs, found none. Name them with --gti or --av21.")
    for experiment in GTI if gti else ():
        yield experiment, [gti] if gti else []
    for experiment in AV21 if av21 else ():
        yield experiment, [av21] if av21 else []
    if av21 and other_track:
        split = OTHER_TRACK.split.replace("{test}", other_track.name)
        yield OTHER_TRACK._replace(split=split), [av21, other_track]


def _import(experiment: Experiment, logs: Sequence[Path], place: Path) -> dict[str, Any]:
    text = (EXAMPLES / experiment.mapping).read_text(encoding="utf-8")
    if experiment.split:
        text = text[: text.index("[split]")] + experiment.split
    place.mkdir(parents=True, exist_ok=True)
    mapping = place / experiment.mapping
    mapping.write_text(text, encoding="utf-8")
    return import_logs(mapping, logs, place / "data", replace=False)


def _configs(
    preset: str, steps: int | None, seeds: Sequence[int]
) -> Iterator[tuple[str, TrainingConfig]]:
    """Name and configuration of every model."""
    given: dict[str, Any] = {"preset": preset} | ({} if steps is None else {"steps": steps})
    for seed in seeds:
        yield f"lifted-{seed}", TrainingConfig(seed=seed, **given)
    yield "lifted-constant-b", TrainingConfig(seed=seeds[0], bilinear_rank=0, **given)


def _model(bundle: Path, data: Path, config: TrainingConfig) -> Path:
    """The bundle, trained on the data set unless it exists."""
    if not bundle.is_dir():
        trained, exit_code = start_run(config, bundle.parents[1] / "runs", data, THIS_MACHINE)
        if exit_code:
            raise SystemExit(exit_code)
        export_run(Path(trained["run"]), bundle, None)
    return bundle


if __name__ == "__main__":
    run_command(app)
