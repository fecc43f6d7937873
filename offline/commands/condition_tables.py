"""What `offline-data` reports of the conditions of a data set."""

from typing import Any

from offline.data.dataset import Dataset
from rt_controller.report.table import Column, Table

CONDITION_COLUMNS = (
    Column("condition", is_text=True),
    Column("minimum"),
    Column("mean"),
    Column("maximum"),
)
BAND_COLUMNS = (
    Column("lowest friction", is_text=True),
    Column("episodes"),
    Column("rejected", "%"),
)


def condition_figures(dataset: Dataset) -> dict[str, Any]:
    """Extremes and means over all samples, and the rejected drives by friction."""
    rows = dataset.conditions_at(slice(None))
    extremes = zip(rows.min(axis=0), rows.mean(axis=0, dtype=float), rows.max(axis=0), strict=True)
    return {
        "conditions": {
            name: dict(zip(("minimum", "mean", "maximum"), map(float, values), strict=True))
            for name, values in zip(dataset.manifest.conditions, extremes, strict=True)
        },
        "rejected_by_lowest_friction": [
            {
                "friction_from": band.friction[0],
                "friction_below": band.friction[1],
                "n_episodes": band.episodes,
                "rejected_fraction": band.rejected_fraction,
            }
            for band in dataset.manifest.rejected_by_friction
        ],
    }


def condition_tables(figures: dict[str, Any]) -> tuple[Table, Table]:
    """The figures as tables."""
    conditions = tuple(
        (name, *(f"{value:.3f}" for value in values.values()))
        for name, values in figures["conditions"].items()
    )
    bands = tuple(
        (
            f"{band['friction_from']:g} to {band['friction_below']:g}",
            str(band["n_episodes"]),
            f"{100 * band['rejected_fraction']:.1f}",
        )
        for band in figures["rejected_by_lowest_friction"]
    )
    return (
        Table("conditions of all samples", CONDITION_COLUMNS, conditions),
        Table("rejected drives", BAND_COLUMNS, bands),
    )
