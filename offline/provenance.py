"""What a bundle says about the episodes it was trained on, and whether others are news to it.

Every episode has a random stream of its own, spawned from the seed. Two data sets of one seed and
different lengths therefore begin with the same episodes and split them differently: what one
tests on, the other may train on. With one seed and one length the split is the same; with two
seeds no episode is.
"""

import json
from collections.abc import Mapping

from offline.manifest import Driven, Manifest, Origin
from rt_controller.contract.artifact import Bundle


def describe_training(settings: Mapping[str, object], origin: Origin) -> str:
    """The field `training` of a bundle, JSON: the settings, and which episodes they met."""
    return json.dumps(
        {
            **settings,
            "data": "driven" if isinstance(origin, Driven) else "imported",
            "episodes": origin.episodes,
            "data_seed": origin.seed,
        }
    )


def is_held_out(bundle: Bundle, manifest: Manifest) -> bool:
    """Whether the model saw no test episode of that data set while it was trained.

    Two imports may share a log, so a model of one is held out from another only if it was trained
    on none.
    """
    if bundle.data_sha256 == manifest.sha256:
        return True
    try:
        training = json.loads(bundle.training)
        is_of_drives = bool(training["data"] == "driven")
        seed, episodes = int(training["data_seed"]), int(training["episodes"])
    except (ValueError, KeyError, TypeError):
        return False  # it does not say
    origin = manifest.origin
    if not (is_of_drives and isinstance(origin, Driven)):
        return is_of_drives != isinstance(origin, Driven)
    return seed != origin.seed or episodes == origin.episodes
