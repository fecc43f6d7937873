"""A model beside its rivals, on held-out data: as a table for people, as figures for programs."""

from typing import Any

from offline.baselines.lti import fit_lti
from offline.baselines.persistence import PersistencePredictor
from offline.dataset import Dataset
from offline.evaluate import UNITS, Evaluation, choose_test_trajectories, evaluate
from offline.export import choose_selftest_states
from offline.predictor import BundlePredictor, Predictor
from offline.terminal import CONSOLE, error_table
from rt_controller.contract.artifact import Bundle


def compare(bundle: Bundle, dataset: Dataset) -> Evaluation:
    """Errors of the bundle, a linear model and persistence on the test part of the data set.

    The linear model is fitted to the training part of the same data set, unless the bundle itself
    is one.
    """
    models: dict[str, Predictor] = {bundle.name: BundlePredictor(bundle)}
    if bundle.name != "lti":
        models["lti"] = BundlePredictor(fit_lti(dataset, choose_selftest_states(dataset)))
    models["persistence"] = PersistencePredictor()
    return evaluate(models, choose_test_trajectories(dataset.select("test")))


def print_pooled(evaluation: Evaluation) -> None:
    """The table over all curvatures."""
    title = f"MSE over 80 steps, {evaluation.n_trajectories} test trajectories"
    CONSOLE.print(error_table(title, evaluation.pooled, _heads()))


def print_per_curvature(evaluation: Evaluation) -> None:
    """One table a curvature."""
    for curvature, by_model in evaluation.per_curvature.items():
        CONSOLE.print(error_table(f"curvature {curvature:g} 1/m", by_model, _heads()))


def evaluation_figures(evaluation: Evaluation) -> dict[str, Any]:
    """The same for `--json`."""
    return {
        "n_trajectories": evaluation.n_trajectories,
        "units": UNITS,
        "models": {
            name: {
                "mse": errors._asdict(),
                "mse_by_curvature_per_m": {
                    f"{curvature:g}": by_model[name]._asdict()
                    for curvature, by_model in evaluation.per_curvature.items()
                },
            }
            for name, errors in evaluation.pooled.items()
        },
    }


def _heads() -> tuple[str, ...]:
    return tuple(f"{name}\n{unit}" for name, unit in UNITS.items())
