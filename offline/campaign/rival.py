"""The fair linear model that a campaign's trainings are measured against."""

import numpy as np
from numpy.typing import NDArray

from offline.baselines import roster
from offline.campaign.score import mean_squared_errors
from offline.dataset import Dataset
from offline.judgement import LTI_RIVALS
from offline.rivals import rival_cache
from rt_controller.contract.errors import DatasetError

Array = NDArray[np.float64]


def fair_linear_errors(dataset: Dataset) -> Array:
    """Mean squared errors (n,) on the validation part: in each state the better linear model's.

    One model for all roads, and one for each where the data know roads, as `offline-evaluate` has
    it on the test part.
    """
    validation = dataset.select("validation")
    errors = []
    for name in LTI_RIVALS:
        try:
            rival = roster.fit(name, dataset, rival_cache())
        except DatasetError:
            continue  # these data know no roads
        errors.append(mean_squared_errors(rival, validation))
    return np.asarray(np.min(errors, axis=0))
