"""The page of `offline-evaluate --html`: the first table and the plots."""

from collections.abc import Mapping

from offline.evaluation import plots
from offline.evaluation.comparison import Comparison
from offline.evaluation.lane_change import LaneChange
from offline.evaluation.tables import headline, mse_table
from rt_controller.contract.arrays import Array
from rt_controller.model.bundle import Bundle
from rt_controller.report.page import Page, Part, Plot, Section


def evaluation_page(
    comparison: Comparison,
    bundles: Mapping[str, Bundle],
    lane_change: tuple[LaneChange, Mapping[str, Array]] | None,
) -> Page:
    """The whole page.

    Args:
        comparison: models and baselines on all test sets.
        bundles: the models by name.
        lane_change: the drive, and the states (W, K+1, n) of its windows that each model predicts;
            None if the data are not of the simulated car.
    """
    library = comparison.sets[0]
    rms = Plot(
        plots.rms_over_time(comparison),
        f"RMS error over the time since the measured state, on {library.count} "
        f"({library.description}); the bands are intervals.",
    )
    parts: dict[str, tuple[Part, ...]] = {"Errors": (rms, mse_table(comparison, library))}
    if comparison.baselines:
        parts["Comparison with baselines"] = tuple(
            Plot(
                plots.ratio_bars(comparison, model),
                f"Mean squared error of the baselines over that of {model}, with intervals: above "
                f"1, {model} is better.",
            )
            for model in comparison.models
        )
    hashes = "; ".join(f"{name} {bundle.sha256:.16}" for name, bundle in bundles.items())
    circle = Plot(plots.eigenvalues(bundles), "All eigenvalues of A, and those near 1.")
    parts["Eigenvalues"] = (circle, f"Models, SHA-256: {hashes}.")
    if lane_change is not None:
        driven, predicted = lane_change
        caption = (
            f"{driven.description}. A preview driver steers the simulated car; the models get its "
            f"inputs and the measured state every 2 s, at the dotted lines."
        )
        plot = Plot(plots.lane_change_plot(driven, predicted, comparison), caption)
        parts["Double lane change, open loop"] = (plot,)
    sections = tuple(Section(title, shown) for title, shown in parts.items())
    names = ", ".join(comparison.models)
    return Page(f"Prediction errors of {names}", sections, (headline(comparison),))
