"""The table says of each variant what its seeds have in common, and what it cost."""

import pytest

from offline.campaign.result import Result
from offline.campaign.score import Score
from offline.campaign.table import Row, Table, to_figures, to_markdown
from offline.campaign.variants import Variant
from offline.config import TrainingConfig

WHOLE = Variant("whole", "nothing left out", {}, TrainingConfig(steps=9, batch=3))
LINEAR = Variant(
    "linear", "a constant B", {"mirror": False}, TrainingConfig(steps=9, batch=3, mirror=False)
)


def finished(ratios: tuple[float, float], geometric_mean: float, cpu_s: float) -> Result:
    return Result("finished", 8, cpu_s, "", Score(ratios, geometric_mean), 0.5, 1234)


def table(*rows: Row) -> Table:
    return Table("mine: a question", ("vx_mps", "ey_m"), (2.0, 0.5), rows)


TWO_SEEDS = (
    Row(WHOLE, 0, finished((2.0, 8.0), 4.0, 10.0)),
    Row(WHOLE, 1, finished((8.0, 32.0), 16.0, 30.0)),
)
NO_MODEL = (
    Row(LINEAR, 0, Result("refused", 9, 5.0, "it grows", None, 1.2, 1111)),
    Row(LINEAR, 1, None),
)


def test_seeds_are_one_by_geometric_means_with_the_least_and_the_most_beside_it():
    (variant,) = to_figures(table(*TWO_SEEDS))["variants"]
    assert variant["geometric_mean_ratio"] == pytest.approx(8.0)
    assert variant["least_geometric_mean_ratio"] == 4.0
    assert variant["most_geometric_mean_ratio"] == 16.0
    assert variant["mse_ratio"] == pytest.approx({"vx_mps": 4.0, "ey_m": 16.0})
    assert variant["training_cpu_s"] == 20.0
    assert variant["n_parameters"] == 1234
    text = to_markdown(table(*TWO_SEEDS))
    assert "| whole | 8 | 4 … 16 | 4 | 16 | 1234 | 20 |" in text
    assert "over 2 seeds" in text


def test_every_training_has_a_row_with_its_seed():
    text = to_markdown(table(*TWO_SEEDS))
    assert "| whole | 0 | 2 | 8 | 4 | 0.50000 | 8 | 10 |" in text
    assert "| whole | 1 | 8 | 32 | 16 | 0.50000 | 8 | 30 |" in text


def test_a_variant_is_told_by_its_changes_as_a_list_has_them_and_by_its_reason():
    assert "| linear | `mirror = false` | a constant B |" in to_markdown(table(*NO_MODEL))


def test_a_seed_without_a_model_is_a_row_and_no_part_of_the_mean():
    """Nor is it a reason to leave the variant out."""
    text = to_markdown(table(TWO_SEEDS[0], *NO_MODEL))
    assert "| linear | – | – | – | – | – | – |" in text
    assert "| linear | 0 | – | – | refused |  | 9 | 5 |" in text
    assert "| linear | 1 | – | – | not ended |  |  |  |" in text
    whole, linear = to_figures(table(TWO_SEEDS[0], *NO_MODEL))["variants"]
    assert whole["geometric_mean_ratio"] == pytest.approx(4.0)
    assert linear["geometric_mean_ratio"] is None
    assert [training["ending"] for training in linear["trainings"]] == ["refused", None]


def test_a_state_that_one_seed_misses_without_limit_leaves_nothing_of_the_mean():
    rows = (*TWO_SEEDS, Row(WHOLE, 2, finished((0.0, 32.0), 0.0, 30.0)))
    (variant,) = to_figures(table(*rows))["variants"]
    assert variant["geometric_mean_ratio"] == 0.0
    assert variant["mse_ratio"]["vx_mps"] == 0.0


def test_it_says_whether_the_variants_were_given_the_same():
    assert "Every training has 9 steps of 3 trajectories." in to_markdown(table(*TWO_SEEDS))
    longer = Variant("longer", "more time", {"steps": 18}, TrainingConfig(steps=18, batch=3))
    text = to_markdown(table(*TWO_SEEDS, Row(longer, 0, None)))
    assert "The variants differ in steps or in trajectories a step" in text
    assert "Every training" not in text
