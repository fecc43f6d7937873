"""Trainings that begin with the model of a bundle."""

from dataclasses import replace

import numpy as np
import pytest
from run_contents import history

from offline.data.dataset import Dataset
from offline.model.bundle_predictor import BundlePredictor
from offline.training import export as export_module
from offline.training.export import export_checkpoint
from offline.training.initial import with_structure_of
from offline.training.run import load_checkpoint
from offline.training.train import train
from rt_controller.contract.errors import ConfigError
from rt_controller.model.bundle import Bundle


@pytest.fixture(autouse=True)
def any_model_is_exported(monkeypatch):
    """A model that was trained for seconds does not pass the checks."""
    monkeypatch.setattr(export_module, "check_export", lambda *rest: None)


@pytest.fixture
def bundle(config, toy_dataset, new_run) -> Bundle:
    run = new_run(config)
    train(config, toy_dataset, run)
    return export_checkpoint(load_checkpoint(run.best), toy_dataset)[0]


def other_inputs(dataset: Dataset) -> Dataset:
    """The same drives by a car with half the effect of every input."""
    recording = dataset.recording
    return replace(dataset, recording=recording._replace(u=2.0 * recording.u))


def predictions(bundle: Bundle, dataset: Dataset) -> np.ndarray:
    x, u, w, past = (part.astype(float) for part in dataset.select("validation")[:4])
    return BundlePredictor(bundle).predict(x[:, 0], past, u, w)


def test_a_training_begins_with_the_predictions_of_the_bundle(bundle, config, toy_dataset, new_run):
    data = other_inputs(toy_dataset)
    still = with_structure_of(bundle, config.model_copy(update={"learning_rate": 1e-30}), {})
    run = new_run(still)
    train(still, data, run, first_model=bundle)
    begun, _ = export_checkpoint(load_checkpoint(run.last), data)
    expected, found = (predictions(each, toy_dataset) for each in (bundle, begun))
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()


def test_it_starts_below_a_training_from_random_weights(bundle, config, toy_dataset, new_run):
    first = {}
    for model in (None, bundle):
        run = new_run(with_structure_of(bundle, config, {}))
        train(run.config, toy_dataset, run, first_model=model)
        first[model is bundle] = history(run)[0]["validation"]["states"]
    assert first[True] < first[False]


def test_the_structure_is_that_of_the_bundle(bundle, config):
    wider = config.model_copy(update={"hidden": (7,)})
    assert with_structure_of(bundle, wider, {}).hidden == config.hidden


@pytest.mark.parametrize(
    ("changed", "explicit", "named"),
    [({"training": "{}"}, {}, "hidden"), ({}, {"hidden": (7,)}, "--hidden")],
    ids=["no network", "another width"],
)
def test_a_structure_that_cannot_be_taken_is_refused(bundle, config, changed, explicit, named):
    with pytest.raises(ConfigError, match=named):
        with_structure_of(replace(bundle, **changed), config, explicit)


def test_a_model_of_other_signals_is_refused(bundle, config, toy_dataset, new_run):
    other = replace(bundle, schema=replace(bundle.schema, dt_s=0.05))
    with pytest.raises(ConfigError, match="every 0\\.05 s"):
        train(config, toy_dataset, new_run(config), first_model=other)
