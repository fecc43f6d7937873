"""Baselines by name: found, fitted, kept in a cache once fitted, and chosen for an evaluation."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import version

from offline.baselines.baseline import Baseline, FittedBaseline
from offline.baselines.catalogue import CATALOGUE
from offline.data.dataset import Dataset, cache
from offline.evaluation.comparison import Comparison, compare_models
from offline.evaluation.held_out import find_objection
from offline.evaluation.model_card import identity_facts
from offline.evaluation.predictor import Predictor
from offline.evaluation.test_sets import library_set
from offline.model.bundle_predictor import BundlePredictor
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.report.table import Fact

SHIPPED = "mdk-net-paper"
"""the paper's network with the training of the preset paper, a bundle of this package"""

PLAIN_BASELINES = ("lti", "lti-per-curvature", "persistence")
DEFAULT_BASELINES = (*PLAIN_BASELINES, "dmdc-delays-path", "lti-scheduled-delays", SHIPPED)
"""those that take seconds to fit: linear ones, persistence, and the paper's network, which ships"""

ALL, NONE = "all", "none"


def names() -> tuple[str, ...]:
    """Names of all baselines that can be fitted, in alphabetical order."""
    return tuple(sorted(CATALOGUE))


def all_baselines() -> tuple[str, ...]:
    """Those, and the paper's network, which ships."""
    return (*names(), SHIPPED)


def find_baseline(name: str) -> Baseline:
    """The baseline of that name.

    Raises:
        ConfigError: there is none.
    """
    if name not in CATALOGUE:
        raise ConfigError(f"baseline: expected one of {', '.join(names())}, found {name!r}.")
    return CATALOGUE[name]


def fit(name: str, dataset: Dataset, refit: bool = False) -> FittedBaseline:
    """The baseline fitted to these data, from the cache if it was fitted to them before.

    A fit of the cache counts for its data, the settings in its row of the catalogue, and the
    version of this package; `refit` replaces it, as after a change of the baseline's code. A file
    of the cache that cannot be read is replaced too.

    Raises:
        ConfigError: there is no such baseline, or the folder cannot be written.
        DatasetError: it cannot be fitted to these data.
    """
    from joblib import Memory

    baseline = find_baseline(name)
    objection = baseline.find_objection(dataset)
    if objection is not None:
        raise DatasetError(
            f"baseline {name}: expected data that it can be fitted to, found that {objection}. "
            f"Leave out this baseline."
        )
    folder = cache().parent / "baselines"
    try:
        cached = Memory(folder, verbose=0).cache(
            _fit, ignore=["dataset"], cache_validation_callback=lambda metadata: not refit
        )
    except OSError as error:
        raise ConfigError(
            f"{folder}: expected a folder for fitted baselines, found: {error.strerror}. Set "
            f"XDG_CACHE_HOME to a folder that can be written."
        ) from error
    settings = repr(getattr(baseline.fit, "keywords", ""))
    release = version("rt-controller")
    fitted: FittedBaseline = cached(name, dataset.sha256, settings, release, dataset)
    return fitted


def _fit(
    name: str, data_sha256: str, settings: str, release: str, dataset: Dataset
) -> FittedBaseline:
    """The key of the cache is all arguments but the last."""
    return find_baseline(name).fit(dataset)


def choose_baselines(names: Sequence[str]) -> tuple[str, ...]:
    """The baselines of these names, each once; `DEFAULT_BASELINES` if there are none.

    Raises:
        ConfigError: a name is unknown.
    """
    if not names:
        return DEFAULT_BASELINES
    if tuple(names) in ((ALL,), (NONE,)):
        return all_baselines() if names[0] == ALL else ()
    unknown = [name for name in names if name not in all_baselines()]
    if unknown:
        raise ConfigError(
            f"--baselines: expected {ALL}, {NONE}, or some of {', '.join(all_baselines())}, found "
            f"{', '.join(unknown)}."
        )
    return tuple(dict.fromkeys(names))


def open_baselines(
    names: Sequence[str],
    dataset: Dataset,
    models: Sequence[Bundle],
    is_required: bool,
    notify: Callable[[str], None] = lambda text: None,
    on_progress: Callable[[str], None] = lambda name: None,
    refit: bool = False,
) -> dict[str, Predictor]:
    """The baselines by name, taken from the cache, or fitted now if `refit` or not in the cache.

    `on_progress` is called with the name of each before it is waited for.
    One that these data or models do not allow is left out, and `notify` gets the reason.

    Raises:
        DatasetError: one is not allowed and `is_required`; raised before any is fitted.
    """
    objections = {name: _find_objection(name, dataset, models) for name in names}
    refused = {name: objection for name, objection in objections.items() if objection}
    for name, objection in refused.items():
        if is_required:
            raise DatasetError(
                f"--baselines {name}: expected a baseline for these data, but {objection}."
            )
        notify(f"without {name}: {objection}.")
    opened: dict[str, Predictor] = {}
    for name in (name for name in names if name not in refused):
        on_progress(name)
        if name == SHIPPED:
            opened[name] = BundlePredictor(load_bundle(shipped_model(SHIPPED)))
        else:
            opened[name] = fit(name, dataset, refit)
    return opened


def table_of_classes(names: Iterable[str]) -> dict[str, str]:
    """Class of those of these baselines that are linear or recurrent."""
    found = {name: find_baseline(name).model_class for name in names if name != SHIPPED}
    return {name: each for name, each in found.items() if each != "other"}


def not_converged(opened: Mapping[str, Predictor]) -> tuple[str, ...]:
    """Names of those whose training ended before their validation error was flat."""
    return tuple(name for name, model in opened.items() if not getattr(model, "is_converged", True))


def compare_with_plain_baselines(bundle: Bundle, dataset: Dataset) -> Comparison:
    """Errors of a new bundle, linear models and persistence on the test part of the data set.

    A bundle with the name of a baseline replaces it.
    """
    names = tuple(name for name in PLAIN_BASELINES if name != bundle.name)
    baselines = open_baselines(names, dataset, [bundle], is_required=False)
    models = {bundle.name: BundlePredictor(bundle)}
    return compare_models(models, baselines, [library_set(dataset)], dataset.schema)


def baseline_facts(name: str, dataset: Dataset) -> list[Fact]:
    """What is to be reported of a baseline that was opened."""
    if name == SHIPPED:
        return identity_facts(load_bundle(shipped_model(SHIPPED)))
    return [*fit(name, dataset).fit_info()]


def _find_objection(name: str, dataset: Dataset, models: Sequence[Bundle]) -> str | None:
    """Why it cannot be a baseline here, as the end of a sentence; None if it can."""
    if name != SHIPPED:
        return find_baseline(name).find_objection(dataset)
    shipped = load_bundle(shipped_model(SHIPPED))
    if any(shipped.sha256 == bundle.sha256 for bundle in models):
        return "it is one of the evaluated models"
    return find_objection([shipped], dataset.manifest)
