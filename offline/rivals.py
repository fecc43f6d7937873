"""Who a model is judged beside: the roster's rivals, and the paper's network that ships.

Rivals of the roster are fitted to the training part of the data set that all are judged on.
"""

from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from offline.baselines import roster
from offline.dataset import Dataset, cache
from offline.held_out import has_signals
from offline.predictor import BundlePredictor, Predictor
from offline.provenance import is_held_out
from offline.terminal import CONSOLE
from rt_controller.contract.artifact import Bundle, load_bundle
from rt_controller.contract.errors import ConfigError, DatasetError

SHIPPED = "mdk-net-paper"
"""the paper's network and training, a bundle of this package"""

PLAIN_RIVALS = ("lti", "lti-per-curvature", "persistence")
DEFAULT_RIVALS = (*PLAIN_RIVALS, SHIPPED)

ALL, NONE = "all", "none"


def known_rivals() -> tuple[str, ...]:
    """Every rival that can be asked for."""
    return (*roster.names(), SHIPPED)


def choose_rivals(asked: Sequence[str]) -> tuple[str, ...]:
    """The rivals that were asked for, once each; those of `DEFAULT_RIVALS` without a wish.

    Raises:
        ConfigError: one of them is not known.
    """
    if not asked:
        return DEFAULT_RIVALS
    if tuple(asked) in ((ALL,), (NONE,)):
        return known_rivals() if asked[0] == ALL else ()
    unknown = [name for name in asked if name not in known_rivals()]
    if unknown:
        raise ConfigError(
            f"--rivals: expected {ALL}, {NONE}, or some of {', '.join(known_rivals())}, found "
            f"{', '.join(unknown)}."
        )
    return tuple(dict.fromkeys(asked))


def open_rivals(
    names: Sequence[str], dataset: Dataset, judged: Sequence[Bundle], insisted: bool
) -> dict[str, Predictor]:
    """The rivals by name, fitted now unless they were before.

    One that cannot be a rival on these data is left out with a word, or refused if it was
    insisted on: before any of them is fitted.

    Raises:
        DatasetError: as said.
    """
    objections = {name: _find_objection(name, dataset, judged) for name in names}
    for name, objection in objections.items():
        if objection is not None and insisted:
            raise DatasetError(f"--rivals {name}: expected a rival on these data, but {objection}.")
        if objection is not None:
            CONSOLE.print(f"without {name}: {objection}.", soft_wrap=True)
    rivals: dict[str, Predictor] = {}
    for name in names:
        if objections[name] is None:
            with CONSOLE.status(f"rival {name}"):
                rivals[name] = _open(name, dataset)
    return rivals


def describe_rival(name: str, dataset: Dataset) -> list[tuple[str, str]]:
    """What is known of a rival that was opened: name and value."""
    if name == SHIPPED:
        shipped = load_bundle(shipped_folder())
        return [
            ("model, SHA-256", shipped.sha256),
            ("trained on data set, SHA-256", shipped.data_sha256),
        ]
    found = roster.report(name, dataset, rival_cache())
    return [*found.findings, ("CPU time of the fit", f"{found.fit_cpu_s:.3g} s")]


def shipped_folder() -> Path:
    """Where the paper's network lies."""
    return Path(str(resources.files("rt_controller"))) / "models" / SHIPPED


def rival_cache() -> Path:
    """Where fitted rivals are kept."""
    return cache().parent / "rivals"


def _open(name: str, dataset: Dataset) -> Predictor:
    if name == SHIPPED:
        return BundlePredictor(load_bundle(shipped_folder()))
    return roster.fit(name, dataset, rival_cache())


def _find_objection(name: str, dataset: Dataset, judged: Sequence[Bundle]) -> str | None:
    """Why it cannot be a rival here, in words; None if it can."""
    if name != SHIPPED:
        return roster.find_objection(name, dataset)
    shipped = load_bundle(shipped_folder())
    if any(shipped.sha256 == bundle.sha256 for bundle in judged):
        return "it is judged itself"
    if not has_signals(shipped, dataset.manifest):
        return "it is a model of other signals"
    if not is_held_out(shipped, dataset.manifest):
        return "it may have been trained on their test episodes"
    return None
