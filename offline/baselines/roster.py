"""Every rival by name: how it is fitted, and where fitted ones are found again.

Nothing heavy is imported before a rival that needs it is asked for.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from offline.baselines.finding import Finding
from offline.baselines.shelf import FittedRival, Kept, keep, place, recall
from offline.dataset import Dataset
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.schema import VEHICLE

if TYPE_CHECKING:
    from offline.baselines.edmd import EdmdSettings


@dataclass(frozen=True, slots=True)
class NoSettings:
    """Of a rival that leaves nothing to choose."""


class Entry(NamedTuple):
    """How one rival is made."""

    kind: type[FittedRival]
    settings: object
    """a frozen dataclass of what the fit may choose from"""
    fit: Callable[[Dataset], FittedRival]


class Report(NamedTuple):
    """What the fit of a rival found, and how long it took."""

    name: str
    fit_cpu_s: float
    """of all threads together: what else the machine was doing does not count"""
    findings: tuple[Finding, ...]


def names() -> tuple[str, ...]:
    """All rivals, the plainest first."""
    return tuple(_ENTRIES)


def find_objection(name: str, dataset: Dataset) -> str | None:
    """Why that rival cannot be fitted to these data, in words; None if it can."""
    if name == "bicycle" and dataset.schema != VEHICLE:
        return "the data are not of the car's signals"
    if name == "lti-per-curvature":
        if dataset.manifest.roads is None:
            return "the data know no roads"
        if len(dataset.schema.exogenous) != 1:
            return "the data have other exogenous signals than curvature"
    return None


def is_drivable(name: str) -> bool:
    """Whether a controller can plan with that rival: linear, or bilinear, in what it lifts.

    Raises:
        ConfigError: there is no such rival.
    """
    from offline.baselines.lifted_model import LiftedModel
    from offline.baselines.linear_model import LinearModel

    return _entry(name).kind in (LinearModel, LiftedModel)


def fit(name: str, dataset: Dataset, cache_folder: Path, refit: bool = False) -> FittedRival:
    """The rival of that name, fitted to the training part and tuned on the validation part.

    Taken from `cache_folder` if it was fitted to the same data, with the same settings and code,
    before; `refit` fits it again all the same.

    Raises:
        ConfigError: there is no such rival.
        DatasetError: it cannot be fitted to these data.
        ArtifactError: the kept one is damaged, or there is no room to keep it.
    """
    return _ensure(name, dataset, cache_folder, refit).rival


def report(name: str, dataset: Dataset, cache_folder: Path) -> Report:
    """What the fit found, and how long it took; fitted now if it was not before.

    Raises:
        ConfigError, DatasetError, ArtifactError: as `fit`.
    """
    kept = _ensure(name, dataset, cache_folder, refit=False)
    return Report(name, kept.fit_cpu_s, kept.rival.findings())


def _ensure(name: str, dataset: Dataset, cache_folder: Path, refit: bool) -> Kept:
    entry = _entry(name)
    fitted_by = entry.fit.func if isinstance(entry.fit, partial) else entry.fit
    modules = {entry.kind.__module__, fitted_by.__module__}
    path = place(cache_folder, name, dataset.sha256, entry.settings, modules)
    if not refit and (kept := recall(path, entry.kind)) is not None:
        return kept
    begin = time.process_time()
    rival = entry.fit(dataset)
    kept = Kept(rival, time.process_time() - begin)
    keep(path, kept)
    return kept


def _entry(name: str) -> Entry:
    if name not in _ENTRIES:
        raise ConfigError(f"rival: expected one of {', '.join(_ENTRIES)}, found {name!r}.")
    return _ENTRIES[name]()


def _persistence() -> Entry:
    from offline.baselines.persistence import PersistencePredictor, fit_persistence

    return Entry(PersistencePredictor, NoSettings(), fit_persistence)


def _lti() -> Entry:
    from offline.baselines.linear_model import LinearModel
    from offline.baselines.lti import fit_linear

    return Entry(LinearModel, NoSettings(), fit_linear)


def _lti_by_curvature() -> Entry:
    from offline.baselines.lti_by_curvature import LinearByCurvature, fit_by_curvature

    return Entry(LinearByCurvature, NoSettings(), fit_by_curvature)


def _lti_on_horizon() -> Entry:
    from offline.baselines.linear_model import LinearModel
    from offline.baselines.lti_horizon import HorizonSettings, fit_on_horizon

    return Entry(LinearModel, HorizonSettings(), fit_on_horizon)


def _delays() -> Entry:
    from offline.baselines.edmd import DELAYS

    return _edmd(DELAYS)


def _small(family: str) -> Entry:
    from offline.baselines.edmd import small
    from offline.baselines.functions import Family

    return _edmd(small(Family(family)))


def _large(family: str) -> Entry:
    from offline.baselines.edmd import large
    from offline.baselines.functions import Family

    return _edmd(large(Family(family)))


def _bilinear() -> Entry:
    from offline.baselines.edmd import BILINEAR

    return _edmd(BILINEAR)


def _bilinear_frozen() -> Entry:
    from offline.baselines.edmd import BILINEAR_FROZEN

    return _edmd(BILINEAR_FROZEN)


def _edmd(settings: "EdmdSettings") -> Entry:
    from offline.baselines.edmd import fit_edmd
    from offline.baselines.lifted_model import LiftedModel

    return Entry(LiftedModel, settings, partial(fit_edmd, settings=settings))


def _acceleration() -> Entry:
    from offline.baselines.constant_acceleration import (
        AccelerationSettings,
        ConstantAcceleration,
        fit_acceleration,
    )

    return Entry(ConstantAcceleration, AccelerationSettings(), fit_acceleration)


def _bicycle() -> Entry:
    from offline.baselines.bicycle import BicycleModel, BicycleSettings, fit_bicycle

    return Entry(BicycleModel, BicycleSettings(), fit_bicycle)


def _gru() -> Entry:
    from offline.baselines.gru import GruModel, GruSettings, fit_gru

    return Entry(GruModel, GruSettings(), fit_gru)


_ENTRIES: dict[str, Callable[[], Entry]] = {
    "persistence": _persistence,
    "constant-acceleration": _acceleration,
    "lti": _lti,
    "lti-per-curvature": _lti_by_curvature,
    "lti-horizon": _lti_on_horizon,
    "dmdc-delays": _delays,
    "edmd-polynomial-66": partial(_small, "monomials"),
    "edmd-rbf-66": partial(_small, "gaussians"),
    "edmd-fourier-66": partial(_small, "cosines"),
    "edmd-polynomial": partial(_large, "monomials"),
    "edmd-rbf": partial(_large, "gaussians"),
    "edmd-fourier": partial(_large, "cosines"),
    "edmd-bilinear-frozen": _bilinear_frozen,
    "edmd-bilinear": _bilinear,
    "bicycle": _bicycle,
    "gru": _gru,
}
