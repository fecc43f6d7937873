"""Learning of models from data: the public names, imported on first use."""

from typing import TYPE_CHECKING

from rt_controller.public_names import public_names

if TYPE_CHECKING:
    from offline.data.dataset import Dataset as Dataset
    from offline.data.dataset import load_dataset as load_dataset
    from offline.evaluation.predictor import Predictor as Predictor

__all__, __getattr__, __dir__ = public_names(
    __name__,
    {
        "Dataset": "data.dataset",
        "Predictor": "evaluation.predictor",
        "load_dataset": "data.dataset",
    },
)
