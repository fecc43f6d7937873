"""What `offline-evaluate` does: load models, judge them beside their rivals, print, write."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from offline.dataset import Dataset
from offline.evaluation_figures import judgement_figures
from offline.evaluation_sheets import (
    growth_sheet,
    mse_sheet,
    quantile_sheet,
    ratio_sheet,
    rms_sheet,
    road_sheets,
    size,
)
from offline.held_out import choose_test_set, find_objection
from offline.judgement import Judgement, judge
from offline.manifest import Driven
from offline.predictor import BundlePredictor, Predictor
from offline.revision import source_revision
from offline.rivals import ALL, choose_rivals, open_rivals
from offline.robustness import ensure_robustness_data
from offline.sheet import print_sheet
from offline.terminal import CONSOLE
from offline.test_sets import (
    LIBRARY,
    NEW_ROADS,
    ROBUSTNESS,
    SET_NAMES,
    TestSet,
    library_set,
    new_roads_set,
    robustness_set,
)
from rt_controller.contract.artifact import Bundle, load_bundle
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import write_figures


@dataclass(frozen=True, slots=True)
class Evaluation:
    """A judgement, and everything it was made from."""

    judgement: Judgement
    judged: tuple[Bundle, ...]
    predictors: dict[str, Predictor]
    """judged models and rivals by name"""
    dataset: Dataset
    revision: str


def evaluate_models(
    models: Sequence[Path],
    data: Path | None,
    run: Path,
    rivals: Sequence[str],
    sets: Sequence[str],
    json_file: Path | None,
) -> int:
    """Exit code of `offline-evaluate`."""
    evaluation = run_evaluation(models, data, run, rivals, sets)
    print_judgement(evaluation.judgement)
    write_figures(json_file, evaluation_figures(evaluation))
    return 0


def evaluation_figures(evaluation: Evaluation) -> dict[str, Any]:
    """Everything that is printed, and what it was made from, for `--json`."""
    names = evaluation.judgement.judged
    hashes = [bundle.sha256 for bundle in evaluation.judged]
    return {
        "revision": evaluation.revision,
        "model_sha256": dict(zip(names, hashes, strict=True)),
        "data_sha256": evaluation.dataset.sha256,
        **judgement_figures(evaluation.judgement),
    }


def run_evaluation(
    models: Sequence[Path],
    data: Path | None,
    run: Path,
    rivals: Sequence[str],
    sets: Sequence[str],
) -> Evaluation:
    """Judge the bundles in these folders on the data set that none of them was trained on.

    Raises:
        ConfigError, ArtifactError, DatasetError: as their remedies say.
    """
    revision = source_revision()
    chosen_rivals, chosen_sets = choose_rivals(rivals), choose_sets(sets)
    bundles = tuple(load_bundle(folder) for folder in models)
    dataset = choose_test_set(bundles, data, run)
    tests = open_sets(chosen_sets, dataset, bundles)
    insists = bool(rivals) and tuple(rivals) != (ALL,)
    opened = open_rivals(chosen_rivals, dataset, bundles, insists)
    names = label_models(models, taken=opened)
    judged = {name: BundlePredictor(bundle) for name, bundle in zip(names, bundles, strict=True)}
    with CONSOLE.status("judging") as status:
        judgement = judge(
            judged,
            opened,
            tests,
            dataset.schema,
            lambda model, test: status.update(f"judging {model} on {test}"),
        )
    return Evaluation(judgement, bundles, {**judged, **opened}, dataset, revision)


def choose_sets(asked: Sequence[str]) -> tuple[str, ...]:
    """The test sets that were asked for, all without a wish; the library is always one.

    Raises:
        ConfigError: one of them is not known.
    """
    unknown = [name for name in asked if name not in SET_NAMES]
    if unknown:
        raise ConfigError(
            f"--sets: expected some of {', '.join(SET_NAMES)}, found {', '.join(unknown)}."
        )
    return tuple(name for name in SET_NAMES if not asked or name in asked or name == LIBRARY)


def open_sets(names: Sequence[str], dataset: Dataset, bundles: Sequence[Bundle]) -> list[TestSet]:
    """These test sets; one that cannot be made from these data is left out with a word."""
    tests = [library_set(dataset)]
    if NEW_ROADS in names:
        laid = new_roads_set(dataset)
        if laid is None:
            CONSOLE.print(f"without {NEW_ROADS}: the data know no roads, or every one of them.")
        else:
            tests.append(laid)
    if ROBUSTNESS in names:
        objection: str | None = "the data are not of the simulated car"
        if isinstance(dataset.origin, Driven):
            with CONSOLE.status("driving other cars"):
                others = ensure_robustness_data()
            objection = find_objection(bundles, others.manifest)
            if objection is None:
                tests.append(robustness_set(others))
        if objection is not None:
            CONSOLE.print(f"without {ROBUSTNESS}: {objection}.", soft_wrap=True)
    return tests


def label_models(folders: Sequence[Path], taken: Collection[str] = ()) -> tuple[str, ...]:
    """A name for each bundle: its folder's, with as many folders above as tell them apart.

    The folder `bundle` of a run goes by the name of the run.
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


def print_judgement(judgement: Judgement) -> None:
    """All tables; the report has the drawings."""
    library = judgement.sets[0]
    for test in judgement.sets:
        CONSOLE.print(f"{test.name}: {test.words}; {size(test)}", soft_wrap=True)
    print_sheet(mse_sheet(judgement, library))
    print_sheet(rms_sheet(judgement, library))
    for sheet in road_sheets(judgement, library):
        print_sheet(sheet)
    for model in judgement.judged:
        print_sheet(quantile_sheet(judgement, model))
        if len(judgement.names) > 1:
            print_sheet(ratio_sheet(judgement, model, library))
    for test in judgement.sets[1:]:
        print_sheet(growth_sheet(judgement, test))
