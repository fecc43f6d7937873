"""Baselines by name: found, fitted, and kept in a cache once fitted."""

import hashlib
import time
from functools import cache as remember
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from offline.baselines.baseline import Baseline, FittedBaseline
from offline.baselines.catalogue import CATALOGUE
from offline.data.cache import cache
from offline.data.dataset import Dataset
from rt_controller.contract.errors import ConfigError, DatasetError


class Fitted(NamedTuple):
    """A fitted baseline and how long the fit took."""

    baseline: FittedBaseline
    fit_cpu_s: float
    """CPU time of all threads, also if the baseline comes from the cache"""


def names() -> tuple[str, ...]:
    """Names of all baselines in alphabetical order."""
    return tuple(sorted(CATALOGUE))


def find_baseline(name: str) -> Baseline:
    """The baseline of that name.

    Raises:
        ConfigError: there is none.
    """
    if name not in CATALOGUE:
        raise ConfigError(f"baseline: expected one of {', '.join(names())}, found {name!r}.")
    return CATALOGUE[name]


def fit(name: str, dataset: Dataset) -> Fitted:
    """The baseline fitted to these data, from the cache if it was fitted to them before.

    A fit of the cache counts for its data, its settings, the version of this package, and the
    files of this folder. A file of the cache that cannot be read is replaced by a new fit.

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
    fitted: Fitted = cached(name, dataset.sha256, settings, _code_version(), dataset)
    return fitted


def _fit(name: str, data_sha256: str, settings: str, code: str, dataset: Dataset) -> Fitted:
    """The key of the cache is all arguments but the last."""
    begin = time.process_time()
    fitted = find_baseline(name).fit(dataset)
    return Fitted(fitted, time.process_time() - begin)


@remember
def _code_version() -> str:
    """Version of the package and digest of the files of this folder.

    The catalogue does not count, so that a new row leaves the other fits in the cache.
    """
    files = sorted(Path(__file__).parent.glob("*.py"))
    source = b"".join(file.read_bytes() for file in files if file.stem != "catalogue")
    return f"{version('rt-controller')} {hashlib.sha256(source).hexdigest()}"
