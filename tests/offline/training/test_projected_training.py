"""Training with the projection limits the spectral radius."""

import numpy as np
from run_contents import history

from offline.training.checkpoint import load_checkpoint
from offline.training.train import train

PROJECTED = {"stability": "projection"}


def radii(config, dataset, run) -> list[float]:
    train(config, dataset, run)
    return [line["spectral_radius"] for line in history(run)]


def test_projection_keeps_the_spectral_radius_at_one_where_it_would_exceed_it(
    tiny_recommended, toy_dataset, new_run
):
    """The evaluated steps are projected."""
    projected = tiny_recommended.model_copy(update=PROJECTED | {"steps": 31, "evaluate_every": 10})
    free = projected.model_copy(update={"stability": "gelfand"})
    run = new_run(projected)
    assert max(radii(projected, toy_dataset, run)) <= 1.0 + 1e-5
    assert min(radii(free, toy_dataset, new_run(free))) > 1.0 + 1e-4
    A = load_checkpoint(run.last).model["A_rows"].double().numpy()
    assert np.abs(np.linalg.eigvals(A[:, : len(A)])).max() <= 1.0 + 1e-5


def test_projection_limits_the_spectral_radius_at_a_high_learning_rate(
    tiny_recommended, toy_dataset, new_run
):
    """Single precision separates eigenvalues that were moved to 1."""
    wild = {"learning_rate": 0.05, "operator_rate": 1.0, "steps": 31, "evaluate_every": 10}
    projected = tiny_recommended.model_copy(update=PROJECTED | wild)
    free = projected.model_copy(update={"stability": "gelfand"})
    assert max(radii(projected, toy_dataset, new_run(projected))) <= 1.0 + 1e-3
    assert max(radii(free, toy_dataset, new_run(free))) > 1.0 + 1e-2
