"""The table has the pooled figures of each variant, and every training."""

from pathlib import Path

import pytest

from offline.config import TrainingConfig
from offline.experiments.comparison import Row, Variant, comparison_figures, comparison_markdown
from offline.experiments.training_task import CampaignData, ErrorRatios, Result

WHOLE = Variant("whole", "nothing left out", {}, TrainingConfig(steps=9, batch=3))
LINEAR = Variant(
    "linear", "a constant B", {"mirror": False}, TrainingConfig(steps=9, batch=3, mirror=False)
)


def finished(by_state: tuple[float, float], geometric_mean: float, cpu_s: float) -> Result:
    return Result("finished", 8, cpu_s, "", ErrorRatios(by_state, geometric_mean), 0.5, 1234)


DATA = CampaignData(Path("data"), "0" * 64, ("vx_mps", "ey_m"), (2.0, 0.5))


def figures(*rows: Row) -> list[dict[str, object]]:
    return comparison_figures("mine: a question", DATA, rows)["variants"]


def markdown(*rows: Row) -> str:
    return comparison_markdown(comparison_figures("mine: a question", DATA, rows))


TWO_SEEDS = (
    Row(WHOLE, 0, finished((2.0, 8.0), 4.0, 10.0)),
    Row(WHOLE, 1, finished((8.0, 32.0), 16.0, 30.0)),
)
NO_MODEL = (
    Row(LINEAR, 0, Result("refused", 9, 5.0, "it grows", None, 1.2, 1111)),
    Row(LINEAR, 1, Result("diverged", 2, 1.0, "not finite")),
)


def test_seeds_are_pooled_by_geometric_means_with_the_least_and_the_most():
    (variant,) = figures(*TWO_SEEDS)
    assert variant["geometric_mean_ratio"] == pytest.approx(8.0)
    assert variant["least_geometric_mean_ratio"] == 4.0
    assert variant["most_geometric_mean_ratio"] == 16.0
    assert variant["mse_ratio"] == pytest.approx({"vx_mps": 4.0, "ey_m": 16.0})
    assert variant["training_cpu_s"] == 20.0
    assert variant["n_parameters"] == 1234
    text = markdown(*TWO_SEEDS)
    assert "| whole | 8 | 4 … 16 | 4 | 16 | 1234 | 20 |" in text
    assert "over 2 seeds" in text


def test_every_training_has_a_row_with_its_seed():
    text = markdown(*TWO_SEEDS)
    assert "| whole | 0 | 2 | 8 | 4 | 0.50000 | 8 | 10 |" in text
    assert "| whole | 1 | 8 | 32 | 16 | 0.50000 | 8 | 30 |" in text


def test_variant_is_described_by_its_changes_and_its_purpose():
    text = markdown(*NO_MODEL)
    assert "| linear | `mirror = false` | a constant B |" in text


def test_seed_without_a_model_is_a_row_and_not_part_of_the_mean():
    """The variant stays in the table even if no seed has a model."""
    text = markdown(TWO_SEEDS[0], *NO_MODEL)
    assert "| linear | – | – | – | – | – | – |" in text
    assert "| linear | 0 | – | – | refused |  | 9 | 5 |" in text
    assert "| linear | 1 | – | – | diverged |  | 2 | 1 |" in text
    whole, linear = figures(TWO_SEEDS[0], *NO_MODEL)
    assert whole["geometric_mean_ratio"] == pytest.approx(4.0)
    assert linear["geometric_mean_ratio"] is None
    assert [training["ending"] for training in linear["trainings"]] == ["refused", "diverged"]


def test_ratio_of_zero_makes_the_geometric_mean_zero():
    rows = (*TWO_SEEDS, Row(WHOLE, 2, finished((0.0, 32.0), 0.0, 30.0)))
    (variant,) = figures(*rows)
    assert variant["geometric_mean_ratio"] == 0.0
    assert variant["mse_ratio"]["vx_mps"] == 0.0


def test_table_says_whether_all_variants_have_the_same_cost():
    text = markdown(*TWO_SEEDS)
    assert "Every training has 9 steps of 3 trajectories." in text
    longer = Variant("longer", "more time", {"steps": 18}, TrainingConfig(steps=18, batch=3))
    text = markdown(*TWO_SEEDS, Row(longer, 0, NO_MODEL[0].result))
    assert "The variants differ in steps or in trajectories per step" in text
    assert "Every training" not in text
