"""The work of `offline-evaluate`: load models, compare them with baselines, print, write."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from offline.baselines.registry import (
    ALL,
    SHIPPED,
    choose_baselines,
    not_converged,
    open_baselines,
    table_of_classes,
)
from offline.commands.options import LATEST_RUN, EvaluationOptions
from offline.commands.terminal import STDERR, STDOUT
from offline.data.dataset import Dataset
from offline.data.manifest import Simulated
from offline.evaluation.comparison import LTI_BASELINES, Comparison, compare_models
from offline.evaluation.held_out import choose_test_data, find_objection
from offline.evaluation.lane_change import drive_lane_change
from offline.evaluation.predictor import Predictor, predict_trajectories
from offline.evaluation.series import make_series
from offline.evaluation.simulated_sets import SIMULATED, open_simulated_set, straight_braking_set
from offline.evaluation.tables import comparison_tables, headline
from offline.evaluation.test_sets import (
    BENDS,
    BRAKING,
    NEW_ROADS,
    NOISE,
    TestSet,
    bends_sets,
    choose_levels,
    choose_sets,
    library_set,
    new_roads_set,
    noisy_set,
)
from offline.files import source_revision
from offline.model.bundle_predictor import BundlePredictor
from rt_controller.contract.errors import ConfigError, OutputError
from rt_controller.contract.figures import require_writable
from rt_controller.contract.files import write_text
from rt_controller.model.artifact import find_model, load_bundle
from rt_controller.model.bundle import Bundle
from rt_controller.report.page import render_page, require_report_extra
from rt_controller.report.table import print_table


@dataclass(frozen=True, slots=True)
class Evaluation:
    """A comparison, and everything it was made from."""

    comparison: Comparison
    bundles: tuple[Bundle, ...]
    """of the evaluated models, in their order"""
    predictors: dict[str, Predictor]
    """models and baselines by name"""
    dataset: Dataset
    revision: str


def evaluate_models(options: EvaluationOptions, html: Path | None = None) -> dict[str, Any]:
    """Figures of `offline-evaluate`; with `html` a page of pictures too.

    Raises:
        ConfigError: the page cannot be written there; raised before the evaluation.
    """
    require_writable(html, "--html")
    if html is not None:
        require_report_extra("offline-evaluate --html")
    evaluation = run_evaluation(options)
    print_comparison(evaluation.comparison)
    if html is not None:
        with STDERR.status("drawing"):
            _write_page(evaluation, html)
        STDOUT.print(f"{html}", soft_wrap=True)
    return evaluation_figures(evaluation)


def _write_page(evaluation: Evaluation, html: Path) -> None:
    """With more baselines than the linear models and the paper's network it would be unreadable."""
    from offline.evaluation.page import evaluation_page

    comparison, lane_change = evaluation.comparison, None
    if isinstance(evaluation.dataset.origin, Simulated):
        driven, shown = drive_lane_change(), (*comparison.models, *LTI_BASELINES, SHIPPED)
        predicted = {
            name: predict_trajectories(model, driven.windows)
            for name, model in evaluation.predictors.items()
            if name in shown
        }
        lane_change = driven, predicted
    text = render_page(evaluation_page(comparison, evaluation.bundles, lane_change))
    try:
        write_text(html, text)
    except OSError as error:
        raise OutputError(
            f"--html {html}: expected room for the page, found {error.strerror}. The fitted "
            f"baselines are in the cache: free some space and give the command again."
        ) from error


def evaluation_figures(evaluation: Evaluation) -> dict[str, Any]:
    """All results and what they were made from, for `--json`."""
    names = evaluation.comparison.models
    hashes = [bundle.sha256 for bundle in evaluation.bundles]
    return {
        "revision": evaluation.revision,
        "model_sha256": dict(zip(names, hashes, strict=True)),
        "data_sha256": evaluation.dataset.sha256,
        **evaluation.comparison.figures,
    }


def run_evaluation(options: EvaluationOptions) -> Evaluation:
    """The bundles in these folders, evaluated on data that no bundle was trained on.

    Raises:
        ConfigError, ArtifactError, DatasetError: an argument, bundle or data set does not fit.
    """
    revision = source_revision()
    baselines = options.baselines or []
    baseline_names, set_names = choose_baselines(baselines), choose_sets(options.sets or [])
    levels = choose_levels(options.noise)
    folders = [find_model(model) for model in options.model or [_bundle_of_latest_run()]]
    bundles = tuple(load_bundle(folder) for folder in folders)
    dataset = choose_test_data(bundles, options.data, LATEST_RUN, _notify)
    tests = open_sets(set_names, dataset, bundles, levels)
    is_required = bool(baselines) and tuple(baselines) != (ALL,)
    with STDERR.status("fitting baselines") as status:
        opened = open_baselines(
            baseline_names,
            dataset,
            bundles,
            is_required,
            _notify,
            lambda name: status.update(f"fitting {name}"),
            options.refit,
        )
    names = label_models(folders, taken=opened)
    named = {name: BundlePredictor(bundle) for name, bundle in zip(names, bundles, strict=True)}
    with STDERR.status("evaluating") as status:
        comparison = compare_models(
            named,
            opened,
            tests,
            dataset.schema,
            classes=table_of_classes(opened),
            not_converged=not_converged(opened),
            series=make_series(tests, dataset.schema),
            on_progress=lambda model, test: status.update(f"evaluating {model} on {test}"),
        )
    return Evaluation(comparison, bundles, {**named, **opened}, dataset, revision)


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
    names: Sequence[str], dataset: Dataset, bundles: Sequence[Bundle], levels: Sequence[float]
) -> list[TestSet]:
    """The test sets of these names, with noise of these levels.

    Why one is left out is printed.
    """
    library = library_set(dataset)
    tests = [library]
    if NEW_ROADS in names:
        new_roads = new_roads_set(dataset)
        if new_roads is None:
            _notify(f"without {NEW_ROADS}: the data have no roads, or all of the new ones.")
        else:
            tests.append(new_roads)
    if BENDS in names:
        bends = bends_sets(dataset)
        if not bends:
            _notify(f"without {BENDS}: the data have no poses, or no car turns in them.")
        tests += bends
    tests += _open_simulated_sets(names, dataset, bundles)
    if NOISE in names:
        noisy = [noisy_set(library, level, dataset.schema, dataset.roles) for level in levels]
        tests += [test for test in noisy if test is not None]
        if None in noisy:
            _notify(f"without {NOISE}: the noise of none of the states is known.")
    return tests


def _open_simulated_sets(
    names: Sequence[str], dataset: Dataset, bundles: Sequence[Bundle]
) -> list[TestSet]:
    """Those of the sets of the simulated car that fit the data set and the bundles."""
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
    for depth in range(1, max(len(path.parts) for path in paths) + 1):
        names = ["/".join(path.parts[-depth:]) for path in paths]
        if len({*names, *taken}) == len(names) + len(taken):
            return tuple(names)
    raise ConfigError(
        f"--model: expected different bundles, found one of them twice among "
        f"{', '.join(map(str, folders))}."
    )


def print_comparison(comparison: Comparison) -> None:
    """Print the first sentence, and all tables."""
    library = comparison.sets[0]
    STDOUT.print(headline(comparison), markup=False)
    STDOUT.print(f"{library.name}: {library.description}; {library.count}", soft_wrap=True)
    for table in comparison_tables(comparison):
        print_table(table, STDOUT)


def _notify(text: str) -> None:
    STDERR.print(text, soft_wrap=True, markup=False)
