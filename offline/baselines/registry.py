"""The baselines: one row each, fitted once, kept in a cache, and chosen for an evaluation.

A new baseline is a fit function and a row of `BASELINES`. For the settings that a row lists, every
combination is fitted, and the one with the smallest error on the validation part is kept.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from typing import Any, Literal

from offline.baselines.bilinear import fit_bilinear
from offline.baselines.linear import (
    Persistence,
    find_objection_to_roads,
    fit_linear,
    fit_per_curvature,
    to_bundle,
)
from offline.baselines.scheduled import fit_scheduled
from offline.config import PAST_STEPS
from offline.data.dataset import Dataset, cache
from offline.evaluation.held_out import find_objection
from offline.evaluation.predictor import Predictor
from offline.model.bundle_predictor import BundlePredictor
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import LiftSample


@dataclass(frozen=True, slots=True)
class Baseline:
    """How a baseline is made: a row of `BASELINES`."""

    model_class: Literal["linear", "recurrent", "other"]
    """linear: in states, past and inputs, also scheduled by speed or road, without other
    observables; an evaluation names the best linear baseline"""
    fit: Callable[[Dataset], Predictor]
    """fits to the training part, and chooses settings on the validation part; a function, or a
    `functools.partial` of one with its settings; the result can be pickled"""
    to_bundle: Callable[[str, Any, Dataset, LiftSample], Bundle] | None = None
    """name, fitted baseline, data, self-test instants → bundle; None if no controller can use it"""
    find_objection: Callable[[Dataset], str | None] = lambda dataset: None
    """why it cannot be fitted to these data, as the end of a sentence; None if it can"""


def _fit_gru(dataset: Dataset) -> Predictor:
    from offline.baselines.recurrent import fit_network  # imports torch, which takes seconds

    return fit_network(dataset)


_fit_delays = partial(fit_scheduled, past_steps=(1, 2, 3, 4, 6, 8, 12, 16, PAST_STEPS))
_fit_blended = partial(
    fit_scheduled, past_steps=(2, 8, 20), knots=(2, 4, 8), ridges=(1e-10, 1e-6, 1e-4)
)
_fit_products = partial(fit_bilinear, observables=(66, 150, 300), past_steps=(4, 12))

BASELINES = {
    "dmdc-delays-path": Baseline("linear", _fit_delays),
    "edmd-bilinear": Baseline("other", _fit_products, to_bundle),
    "gru": Baseline("recurrent", _fit_gru),
    "lti": Baseline("linear", fit_linear, to_bundle),
    "lti-per-curvature": Baseline(
        "linear", fit_per_curvature, find_objection=find_objection_to_roads
    ),
    "lti-scheduled-delays": Baseline("linear", _fit_blended),
    "persistence": Baseline("other", lambda dataset: Persistence()),
}
"""by name, in alphabetical order"""

SHIPPED = "mdk-net-paper"
"""the paper's network with the training of the preset paper, a bundle of this package"""

PLAIN_BASELINES = ("lti", "lti-per-curvature", "persistence")
DEFAULT_BASELINES = (*PLAIN_BASELINES, "dmdc-delays-path", "lti-scheduled-delays", SHIPPED)
"""those that take seconds to fit: linear ones, persistence, and the paper's network, which ships"""

ALL, NONE = "all", "none"


def find_baseline(name: str) -> Baseline:
    """The baseline of that name.

    Raises:
        ConfigError: there is none.
    """
    if name not in BASELINES:
        raise ConfigError(f"baseline: expected one of {', '.join(BASELINES)}, found {name!r}.")
    return BASELINES[name]


def fit(name: str, dataset: Dataset) -> Predictor:
    """The baseline fitted to these data, from the cache if it was fitted to them before.

    A fit of the cache counts for its data, the settings in its row of the table, and the version
    of this package; one that cannot be read is replaced. After a change of a baseline's code delete
    the folder.

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
        cached = Memory(folder, verbose=0).cache(_fit, ignore=["dataset"])
    except OSError as error:
        raise ConfigError(
            f"{folder}: expected a folder for fitted baselines, found: {error.strerror}. Set "
            f"XDG_CACHE_HOME to a folder that can be written."
        ) from error
    settings = repr(getattr(baseline.fit, "keywords", ""))
    fitted: Predictor = cached(name, dataset.sha256, settings, version("rt-controller"), dataset)
    return fitted


def _fit(name: str, data_sha256: str, settings: str, release: str, dataset: Dataset) -> Predictor:
    """The key of the cache is all arguments but the last."""
    return find_baseline(name).fit(dataset)


def choose_baselines(names: Sequence[str]) -> tuple[str, ...]:
    """The baselines of these names, each once; `DEFAULT_BASELINES` if there are none.

    Raises:
        ConfigError: a name is unknown.
    """
    known = (*BASELINES, SHIPPED)
    if not names:
        return DEFAULT_BASELINES
    if tuple(names) in ((ALL,), (NONE,)):
        return known if names[0] == ALL else ()
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ConfigError(
            f"--baselines: expected {ALL}, {NONE}, or some of {', '.join(known)}, found "
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
) -> dict[str, Predictor]:
    """The baselines by name, taken from the cache, or fitted now.

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
            opened[name] = fit(name, dataset)
    return opened


def _find_objection(name: str, dataset: Dataset, models: Sequence[Bundle]) -> str | None:
    """Why it cannot be a baseline here, as the end of a sentence; None if it can."""
    if name != SHIPPED:
        return find_baseline(name).find_objection(dataset)
    shipped = load_bundle(shipped_model(SHIPPED))
    if any(shipped.sha256 == bundle.sha256 for bundle in models):
        return "it is one of the evaluated models"
    return find_objection([shipped], dataset.manifest)


def linear_ones(names: Iterable[str]) -> tuple[str, ...]:
    """Those of these baselines that are linear."""
    linear = {name for name, baseline in BASELINES.items() if baseline.model_class == "linear"}
    return tuple(name for name in names if name in linear)


def not_converged(opened: Mapping[str, Predictor]) -> tuple[str, ...]:
    """Names of those whose training ended before their validation error was flat."""
    return tuple(name for name, model in opened.items() if not getattr(model, "is_converged", True))
