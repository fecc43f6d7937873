"""The table has the pooled figures of each variant, and every training."""

from pathlib import Path

import pytest

from offline.config import TrainingConfig
from offline.experiments.comparison import (
    Row,
    Training,
    Variant,
    comparison_figures,
    comparison_markdown,
)
from offline.experiments.training_task import CampaignData, Result

WHOLE = Variant(name="whole", why="nothing left out")
LINEAR = Variant(name="linear", why="a constant B", changes={"mirror": False})
DATA = CampaignData(Path("data"), "0" * 64, {"vx_mps": 2.0, "ey_m": 0.5})


def row(variant: Variant, seed: int, result: Result) -> Row:
    return Row(Training(variant, TrainingConfig(steps=9, batch=3, seed=seed)), result)


def finished(vx: float, ey: float, geometric_mean: float, cpu_s: float) -> Result:
    ratios = {"vx_mps": vx, "ey_m": ey}
    return Result("finished", 8, cpu_s, "", ratios, geometric_mean, 0.5, 1234)


def figures(*rows: Row) -> list[dict[str, object]]:
    return comparison_figures("mine: a question", DATA, rows)["variants"]


def markdown(*rows: Row) -> str:
    return comparison_markdown(comparison_figures("mine: a question", DATA, rows))


TWO_SEEDS = (
    row(WHOLE, 0, finished(2.0, 8.0, 4.0, 10.0)),
    row(WHOLE, 1, finished(8.0, 32.0, 16.0, 30.0)),
)
NO_MODEL = (
    row(LINEAR, 0, Result("refused", 9, 5.0, "it grows", None, None, 1.2, 1111)),
    row(LINEAR, 1, Result("diverged", 2, 1.0, "not finite")),
)


def test_seeds_are_pooled_by_geometric_means_with_the_least_and_the_most():
    (variant,) = figures(*TWO_SEEDS)
    assert variant["geometric_mean_ratio"] == pytest.approx(8.0)
    assert variant["least_geometric_mean_ratio"] == 4.0
    assert variant["most_geometric_mean_ratio"] == pytest.approx(16.0)
    assert variant["mse_ratio"] == pytest.approx({"vx_mps": 4.0, "ey_m": 16.0})
    assert variant["training_cpu_s"] == 20.0
    assert variant["n_parameters"] == 1234
    text = markdown(*TWO_SEEDS)
    assert "| whole | 8 | 4 | 16 | 4 | 16 | 1234 | 20 |" in text


def test_every_training_has_a_row_with_its_seed():
    text = markdown(*TWO_SEEDS)
    assert "| whole | 0 | finished | 2 | 8 | 4 | 0.5 | 8 | 10 |" in text
    assert "| whole | 1 | finished | 8 | 32 | 16 | 0.5 | 8 | 30 |" in text


def test_variant_is_described_by_its_changes_and_its_purpose():
    text = markdown(*NO_MODEL)
    assert "| linear | `mirror = false` | a constant B |" in text


def test_seed_without_a_model_is_a_row_and_not_part_of_the_mean():
    """The variant stays in the table even if no seed has a model."""
    text = markdown(TWO_SEEDS[0], *NO_MODEL)
    assert "| linear | – | – | – | – | – | – | – |" in text
    assert "| linear | 0 | refused | – | – | – | 1.2 | 9 | 5 |" in text
    assert "| linear | 1 | diverged | – | – | – | – | 2 | 1 |" in text
    whole, linear = figures(TWO_SEEDS[0], *NO_MODEL)
    assert whole["geometric_mean_ratio"] == pytest.approx(4.0)
    assert linear["geometric_mean_ratio"] is None
    assert [training["ending"] for training in linear["trainings"]] == ["refused", "diverged"]


def test_ratio_of_zero_makes_the_geometric_mean_zero():
    rows = (*TWO_SEEDS, row(WHOLE, 2, finished(0.0, 32.0, 0.0, 30.0)))
    (variant,) = figures(*rows)
    assert variant["geometric_mean_ratio"] == 0.0
    assert variant["mse_ratio"]["vx_mps"] == 0.0


def test_table_has_the_cost_of_each_variant():
    longer = Variant(name="longer", why="more time", changes={"steps": 18})
    config = TrainingConfig(steps=18, batch=3)
    text = markdown(*TWO_SEEDS, Row(Training(longer, config), NO_MODEL[0].result))
    assert "| whole | – | nothing left out | 9 | 3 |" in text
    assert "| longer | `steps = 18` | more time | 18 | 3 |" in text
