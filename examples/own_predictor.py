"""A predictor of your own, constant yaw rate, on the test part of a data set, beside `mdk-net`.

pip install -e ".[offline]" && offline-data --episodes 20 --seed 1 --data small
python examples/own_predictor.py

Seed 1, because episodes of seed 0 are the training data of `mdk-net`.
"""

from pathlib import Path

import numpy as np

from offline import Predictor, load_dataset
from offline.evaluation.predictor import prediction_errors
from offline.model.bundle_predictor import BundlePredictor
from rt_controller import Bundle
from rt_controller.contract.timing import PERIOD_S


class ConstantYawRate:
    def predict(self, x0, past, U, W):
        x = np.repeat(x0[:, None], U.shape[1] + 1, axis=1)
        for k in range(U.shape[1]):
            vx, vy, yaw_rate, _, ey, epsi = x[:, k].T
            ds = x[:, k + 1, 3] = PERIOD_S * vx
            x[:, k + 1, 4] = ey + PERIOD_S * (vx * np.sin(epsi) + vy)
            x[:, k + 1, 5] = epsi + PERIOD_S * yaw_rate - W[:, k, 0] * ds
        return x


dataset = load_dataset(Path("small"))
models: list[Predictor] = [ConstantYawRate(), BundlePredictor(Bundle.load("mdk-net"))]
print("root mean square errors over two seconds:", *dataset.schema.state_names)
for model in models:
    errors = prediction_errors(model, dataset.select("test"))
    print(type(model).__name__, np.sqrt(np.mean(errors**2, axis=(0, 1))))
