"""`offline-evaluate`: load models, compare them with baselines, print tables, draw a page."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from offline.commands.options import LATEST_RUN, JsonFile, Several, require_ready
from offline.commands.terminal import STDERR, STDOUT
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.names import label_paths
from rt_controller.terminal.command_line import new_app, run_command

if TYPE_CHECKING:
    from offline.data.dataset import Dataset
    from offline.evaluation.comparison import Comparison
    from offline.evaluation.predictor import Predictor
    from offline.evaluation.test_sets import TestSet
    from rt_controller.model.bundle import Bundle

app = new_app(
    "offline-evaluate", "Predict two seconds ahead on held-out data, beside the baselines."
)
main = partial(run_command, app)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """A comparison, and everything it was made from."""

    comparison: "Comparison"
    bundles: "dict[str, Bundle]"
    """the evaluated models by name, in their order"""
    predictors: "dict[str, Predictor]"
    """models and baselines by name"""
    dataset: "Dataset"
    revision: str


@app.default
def evaluate(
    *,
    model: Annotated[list[Path] | None, Several] = None,
    data: Path | None = None,
    baselines: Annotated[list[str] | None, Several] = None,
    sets: Annotated[list[str] | None, Several] = None,
    all_tables: Annotated[bool, Parameter(name="--all", negative="")] = False,
    html: Path | None = None,
    json_file: JsonFile = None,
) -> None:
    """Errors over 80 open-loop steps on the test trajectories; ratios are to the first model.

    Args:
        model: shipped models by name, or folders of bundles (./lti if a folder has the name of a
            shipped model); default: that of the latest run
        data: folder of a data set; default: the full one if it is in the cache, otherwise one that
            a model, or the latest run, was trained on. A data set whose test episodes a model may
            have been trained on is refused
        baselines: names of baselines, "all" or "none"; default: linear models, persistence, and the
            paper's network. A baseline that is not in the cache is fitted first
        sets: library, new-roads, bends, robustness, varied, noise, sliding, fast, braking,
            friction, mass; default: all of them
        all_tables: also print the paper's Table II, every ratio, and every part of the test sets:
            roads, ranges of speed, sideslip and brake
        html: also write this page with plots: errors over time, ratios, eigenvalues, and the
            paper's double lane change; needs the extra report
    """
    require_ready(json_file)
    if html is not None:
        from rt_controller.report.page import require_report_extra

        require_report_extra("--html")
        require_writable(html, "--html", suffix=".html")
    from offline.evaluation import tables
    from rt_controller.report.table import print_table, print_text

    evaluation = run_evaluation(model, data, baselines, sets)
    comparison, library = evaluation.comparison, evaluation.comparison.parts[0]
    print_text(tables.headline(comparison), STDOUT)
    print_text(f"{library.size}: {library.description}", STDOUT)
    chosen = tables.all_tables if all_tables else tables.screen_tables
    for table in chosen(comparison):
        print_table(table, STDOUT)
    if html is not None:
        write_page(html, evaluation)
    write_figures(json_file, evaluation_figures(evaluation))


def evaluation_figures(evaluation: Evaluation) -> dict[str, Any]:
    """All results and what they were made from, for `--json`."""
    return {
        "revision": evaluation.revision,
        "model_sha256": {name: bundle.sha256 for name, bundle in evaluation.bundles.items()},
        "data_sha256": evaluation.dataset.sha256,
        **evaluation.comparison.figures(),
    }


def write_page(path: Path, evaluation: Evaluation) -> None:
    """Draw the page, and print its size.

    The lane change shows few baselines: with all of them it would be unreadable.

    Raises:
        OutputError: there is no room for it.
    """
    from offline.baselines.registry import SHIPPED
    from offline.data.manifest import Simulated
    from offline.evaluation.comparison import LTI_BASELINES
    from offline.evaluation.lane_change import drive_lane_change
    from offline.evaluation.page import evaluation_page
    from offline.evaluation.predictor import predict_trajectories
    from rt_controller.report.page import save_page

    with STDERR.status("drawing"):
        lane_change = None
        if isinstance(evaluation.dataset.origin, Simulated):
            driven = drive_lane_change()
            shown = (*evaluation.bundles, *LTI_BASELINES, SHIPPED)
            predicted = {
                name: predict_trajectories(model, driven.windows)
                for name, model in evaluation.predictors.items()
                if name in shown
            }
            lane_change = driven, predicted
        page = evaluation_page(evaluation.comparison, [*evaluation.bundles.values()], lane_change)
        written = save_page(page, path, "--html")
    STDOUT.print(written, soft_wrap=True)


def run_evaluation(
    models: Sequence[Path] | None = None,
    data: Path | None = None,
    baselines: Sequence[str] | None = None,
    sets: Sequence[str] | None = None,
) -> Evaluation:
    """The bundles in these folders, evaluated on data that no bundle was trained on.

    The arguments are the options of the command.

    Raises:
        ConfigError, ArtifactError, DatasetError: an argument, bundle or data set does not fit.
    """
    from offline.baselines import registry
    from offline.evaluation.comparison import compare_models
    from offline.evaluation.held_out import choose_test_data
    from offline.evaluation.parts import parts_of
    from offline.evaluation.test_sets import choose_sets
    from offline.model.bundle_predictor import BundlePredictor
    from rt_controller.contract.revision import source_revision
    from rt_controller.model.artifact import find_model, load_bundle

    revision = source_revision()
    baseline_names = registry.choose_baselines(baselines or ())
    set_names = choose_sets(sets or ())
    folders = [find_model(model) for model in models or [_bundle_of_latest_run()]]
    bundles = tuple(load_bundle(folder) for folder in folders)
    dataset = choose_test_data(bundles, data, LATEST_RUN, _notify)
    tests = open_sets(set_names, dataset, bundles)
    is_required = tuple(baselines or ()) not in ((), (registry.ALL,))
    with STDERR.status("fitting baselines") as status:
        opened = registry.open_baselines(
            baseline_names,
            dataset,
            bundles,
            is_required,
            _notify,
            lambda name: status.update(f"fitting {name}"),
        )
    named = dict(zip(label_models(folders, taken=opened), bundles, strict=True))
    predictors = {name: BundlePredictor(bundle) for name, bundle in named.items()}
    with STDERR.status("evaluating") as status:
        comparison = compare_models(
            predictors,
            opened,
            parts_of(tests, dataset.schema),
            dataset.schema,
            linear=registry.linear_ones(opened),
            not_converged=registry.not_converged(opened),
            on_progress=lambda model, test: status.update(f"evaluating {model} on {test}"),
        )
    return Evaluation(comparison, named, {**predictors, **opened}, dataset, revision)


def _bundle_of_latest_run() -> Path:
    bundle = LATEST_RUN / "bundle"
    if not bundle.is_dir():
        command = "offline-export" if LATEST_RUN.is_dir() else "offline-train, then offline-export"
        raise ConfigError(
            f"--model: none is given, so the bundle of the latest run is expected in {bundle}, "
            f"found no such folder. Make it with {command}, or name models, such as --model "
            f"mdk-net."
        )
    return bundle


def open_sets(
    names: Sequence[str], dataset: "Dataset", bundles: "Sequence[Bundle]"
) -> "list[TestSet]":
    """The test sets of these names; why one is left out is printed."""
    from offline.evaluation import test_sets

    library = test_sets.library_set(dataset)
    tests = [library]
    if test_sets.NEW_ROADS in names:
        new_roads = test_sets.new_roads_set(dataset)
        if new_roads is None:
            _notify("without new-roads: the data have no roads, or all of the new ones.")
        else:
            tests.append(new_roads)
    if test_sets.BENDS in names:
        bends = test_sets.bends_sets(dataset)
        if not bends:
            _notify("without bends: the data have no poses, or no car turns in them.")
        tests += bends
    tests += _open_simulated_sets(names, dataset, bundles)
    if test_sets.NOISE in names:
        signals = dataset.schema, dataset.roles
        noisy = [test_sets.noisy_set(library, k, *signals) for k in test_sets.NOISE_LEVELS]
        tests += [test for test in noisy if test is not None]
        if None in noisy:
            _notify("without noise: the noise of none of the states is known.")
    return tests


def _open_simulated_sets(
    names: Sequence[str], dataset: "Dataset", bundles: "Sequence[Bundle]"
) -> "list[TestSet]":
    """Those of the sets of the simulated car that fit the data set and the bundles."""
    from offline.data.manifest import Simulated
    from offline.evaluation.held_out import find_objection
    from offline.evaluation.simulated_sets import (
        SIMULATED,
        open_simulated_set,
        straight_braking_set,
    )
    from offline.evaluation.test_sets import BRAKING

    wanted = [each for each in SIMULATED if set(each.options) & set(names)]
    if not isinstance(dataset.origin, Simulated):
        options = [option for each in wanted for option in each.options if option in names]
        options += [BRAKING] if BRAKING in names else []
        if options:
            listed = ", ".join(dict.fromkeys(options))
            _notify(f"without {listed}: the data are not of the simulated car.")
        return []
    tests = []
    for each in wanted:
        with STDERR.status(f"simulating {each.name}"):
            others, test = open_simulated_set(each)
        objection = find_objection(bundles, others.manifest)
        if objection is None:
            tests.append(test)
        else:
            _notify(f"without {each.name}: {objection}.")
    if BRAKING in names:
        with STDERR.status(f"simulating {BRAKING}"):
            tests.append(straight_braking_set())
    return tests


def label_models(folders: Sequence[Path], taken: Collection[str] = ()) -> tuple[str, ...]:
    """A name for each bundle: its folder, with as many parent folders as make it unique.

    The folder `bundle` of a run gets the name of the run.
    """
    paths = [folder.resolve() for folder in folders]
    paths = [path.parent if path.name == "bundle" else path for path in paths]
    return label_paths(paths, "--model", taken)


def _notify(text: str) -> None:
    STDERR.print(text, soft_wrap=True, markup=False)
