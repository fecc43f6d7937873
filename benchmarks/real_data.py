"""`python -m benchmarks.real_data`: the tables of docs/real-data.md, from logs of two real cars."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import cyclopts

from offline.commands.evaluate import evaluation_figures, run_evaluation
from offline.commands.export import export_run
from offline.commands.import_logs import import_logs
from offline.commands.options import JsonFile, Several
from offline.commands.terminal import STDOUT
from offline.commands.train import start_run
from offline.config import TrainingConfig
from offline.data.dataset import exists
from offline.evaluation.tables import ratio_table, rms_table
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import require_folder, require_writable, write_figures
from rt_controller.report.table import to_markdown
from rt_controller.terminal.command_line import run_command
from sim_bridge.campaign import THIS_MACHINE

EXAMPLES = Path(__file__).parents[1] / "examples"
BASELINES = ("persistence", "lti", "dmdc-delays-path", "lti-scheduled-delays", "edmd-bilinear")


_COURSES = """\
[split]
validation = ["*exp_8.npz"]
test = ["*exp_6.npz", "*exp_11.npz"]
longest_episode_s = 15.0
"""
_TRACK = """\
[split]
test = ["{test}"]
longest_episode_s = 10.0
share = 0.2
"""
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
    seeds: Annotated[tuple[int, ...], Several] = (0, 1, 2),
    baselines: Annotated[tuple[str, ...], Several] = BASELINES,
    json: JsonFile = None,
) -> int:
    """Import, train, export and evaluate, and print the tables in Markdown.

    What the folder has already is not made again.

    Args:
        folder: gets mappings, data sets, runs and models, in a folder for each experiment.
        gti: folder of the drives exp_*.npz.
        av21: log of one track, Putnam_park2023_run4_2.csv.
        other_track: log of another track, such as LVMS_23_01_04_B.csv: the test of an experiment of
            its own.
        preset: of the training.
        steps: of the training; default: those of the preset.
        seeds: one model for each; the first is also trained with a constant B.
        baselines: as in offline-evaluate.
    """
    require_writable(json)
    require_folder(folder, "FOLDER")
    if gti is None and av21 is None:
        raise ConfigError("expected logs, found none. Name them with --gti or --av21.")
    figures = {}
    for name, mapping, split, logs in _experiments(gti, av21, other_track):
        place = folder / name
        data, imported = place / "data", {}
        if not exists(data):
            text = (EXAMPLES / mapping).read_text(encoding="utf-8")
            place.mkdir(parents=True, exist_ok=True)
            own = text[: text.index("[split]")] + split if split else text
            (place / mapping).write_text(own, encoding="utf-8")
            imported = import_logs(place / mapping, logs, data, replace=False)
        given: dict[str, Any] = {"preset": preset} | ({} if steps is None else {"steps": steps})
        configs = {f"lifted-{seed}": TrainingConfig(seed=seed, **given) for seed in seeds}
        constant_b = TrainingConfig(seed=seeds[0], bilinear_rank=0, **given)
        models = []
        for model, config in {**configs, "lifted-constant-b": constant_b}.items():
            models.append(place / "models" / model)
            if not models[-1].is_dir():
                trained, exit_code = start_run(config, place / "runs", data, THIS_MACHINE)
                if exit_code:
                    return exit_code
                export_run(Path(trained["run"]), models[-1], None)
        evaluation = run_evaluation(models, data, baselines, ["library"])
        comparison = evaluation.comparison
        STDOUT.print(f"\n**{name}**\n", markup=False)
        for table in (rms_table(comparison, with_intervals=True), ratio_table(comparison)):
            lines = (table.title, "", to_markdown(table), "", *table.footnotes, "")
            STDOUT.print("\n".join(lines), soft_wrap=True, markup=False, highlight=False)
        figures[name] = {"import": imported, **evaluation_figures(evaluation)}
    write_figures(json, figures)
    return 0


def _experiments(
    gti: Path | None, av21: Path | None, other_track: Path | None
) -> Iterator[tuple[str, str, str, list[Path]]]:
    """Name, mapping among the examples, [split] in its place, and logs of each experiment."""
    if gti:
        yield "gti", "import_gti.toml", "", [gti]
        yield "gti-other-courses", "import_gti.toml", _COURSES, [gti]
    if av21:
        yield "av21", "import_av21.toml", "", [av21]
    if av21 and other_track:
        split = _TRACK.format(test=other_track.name)
        yield "av21-other-track", "import_av21.toml", split, [av21, other_track]


if __name__ == "__main__":
    run_command(app)
