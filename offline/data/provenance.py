"""Which episodes a bundle was trained on, and whether a data set is held out from it.

Two simulated data sets of one seed but different lengths share episodes and split them
differently, so one may train on what the other tests on. With equal seed and length the split is
the same; with different seeds no episode is shared. Both hold whatever the conditions that the
recipes vary.
"""

import json
from collections.abc import Mapping

from offline.data.manifest import Manifest, Origin, Simulated
from offline.data.variation import describe
from rt_controller.contract.model.bundle import Bundle
from sim_bridge.plant.shipped_cars import DEFAULT_CAR

CAR_OF_LOGS = (
    "the car of the logs, not the simulated one: rt-controller --bus virtual drives another car "
    "with it"
)


def car_of(origin: Origin) -> str:
    """The car that a model of this data set is of, as printed on its card."""
    return f"simulated {DEFAULT_CAR}" if isinstance(origin, Simulated) else CAR_OF_LOGS


def describe_training(settings: Mapping[str, object], origin: Origin) -> str:
    """The field `training` of a bundle as JSON: the settings, and the origin of the episodes."""
    kind = (
        {"data": "driven", "conditions": describe(origin.recipe.variation)}
        if isinstance(origin, Simulated)
        else {"data": "imported"}
    )
    return json.dumps(
        {
            **settings,
            **kind,
            "episodes": origin.episodes,
            "data_seed": origin.seed,
        }
    )


def is_held_out(bundle: Bundle, manifest: Manifest) -> bool:
    """True if no test episode of that data set was used to train the model.

    Two imports may share a log, so a model trained on one import is not held out from another.
    """
    if bundle.data_sha256 == manifest.sha256:
        return True
    try:
        training = json.loads(bundle.training)
        is_of_drives = bool(training["data"] == "driven")
        seed, episodes = int(training["data_seed"]), int(training["episodes"])
    except (ValueError, KeyError, TypeError):
        return False
    origin = manifest.origin
    if not (is_of_drives and isinstance(origin, Simulated)):
        return is_of_drives != isinstance(origin, Simulated)
    return seed != origin.seed or episodes == origin.episodes
