"""Baselines by name: found, fitted, and kept in a cache once fitted.

The baselines are the modules in `offline.baselines.catalogue`; a module, with all that it imports,
is imported only when its baseline is used.
"""

import pkgutil
import time
from importlib import import_module
from typing import NamedTuple

from offline.baselines import catalogue
from offline.baselines.baseline import Baseline, FittedBaseline
from offline.baselines.code_digest import digest_of_code
from offline.data.cache import cache
from offline.data.dataset import Dataset
from rt_controller.contract.errors import ConfigError, DatasetError


class Fitted(NamedTuple):
    """A fitted baseline and how long the fit took."""

    baseline: FittedBaseline
    fit_cpu_s: float
    """CPU time of all threads, also if the baseline comes from the cache"""


def names() -> tuple[str, ...]:
    """Names of all baselines in alphabetical order; no baseline is imported."""
    modules = pkgutil.iter_modules(catalogue.__path__)
    return tuple(sorted(module.name.replace("_", "-") for module in modules))


def find_baseline(name: str) -> Baseline:
    """The baseline of that name.

    Raises:
        ConfigError: there is none.
    """
    if name not in names():
        raise ConfigError(f"baseline: expected one of {', '.join(names())}, found {name!r}.")
    baseline: Baseline = import_module(_module_of(name)).BASELINE
    return baseline


def fit(name: str, dataset: Dataset, is_short: bool = False) -> Fitted:
    """The baseline fitted to these data, from the cache if data and code are unchanged.

    A file of the cache that cannot be read is replaced by a new fit. With `is_short`, a baseline
    whose fit takes long is trained less.

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
    is_short = is_short and baseline.fit_short is not None
    digest = digest_of_code(_module_of(name))
    fitted: Fitted = cached(name, dataset.sha256, digest, is_short, dataset)
    return fitted


def _fit(name: str, data_sha256: str, code_digest: str, is_short: bool, dataset: Dataset) -> Fitted:
    """The key of the cache is all arguments but the last."""
    baseline = find_baseline(name)
    chosen = baseline.fit_short if is_short and baseline.fit_short else baseline.fit
    begin = time.process_time()
    fitted = chosen(dataset)
    return Fitted(fitted, time.process_time() - begin)


def _module_of(name: str) -> str:
    return f"{catalogue.__name__}.{name.replace('-', '_')}"
