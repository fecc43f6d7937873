"""The evaluation as one HTML page."""

from collections.abc import Mapping, Sequence

from offline.evaluation import plots
from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES, SEED
from offline.evaluation.comparison import FAIR_LTI, LINEAR, LTI_BASELINES, Comparison
from offline.evaluation.lane_change import LaneChange
from offline.evaluation.metrics import PROGRESS, Figures
from offline.evaluation.tables import (
    MEANINGS,
    conditions_table,
    headline,
    interval_cells,
    means_of,
    mse_table,
    ratio_table,
    rms_table,
)
from offline.evaluation.test_sets import LIBRARY, NEW_ROADS, ROBUSTNESS
from rt_controller.contract.arrays import Array
from rt_controller.report.page import Bullets, Page, Part, Plot, Section
from rt_controller.report.table import Fact, Table, facts_table, format_number


def evaluation_page(
    comparison: Comparison, sources: Sequence[Table], lane_change: Section | None
) -> Page:
    """The whole page; `sources` are tables of the models, the baselines, data and software.

    `lane_change` is as from `lane_change_section`; None if the data are not of the simulated car.
    """
    sections = (
        _errors(comparison),
        _ratios(comparison),
        _conditions(comparison),
        _roads(comparison),
        lane_change,
        _sources(comparison, sources),
    )
    names = comparison.models
    listed = " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
    return Page(
        f"Prediction errors of {listed}",
        tuple(section for section in sections if section is not None),
        _introduction(comparison),
    )


def _introduction(comparison: Comparison) -> tuple[Part, ...]:
    library = comparison.sets[0]
    seconds = comparison.dt_s * comparison.steps
    caption = (
        "RMS error over the time since the measured state; the bands are intervals. The "
        "controller plans 0.5 s ahead with a linear model, 1 s with any other."
    )
    task = (
        f"Each model gets one measured state, the past before it, and the inputs of the next "
        f"{seconds:g} s; it predicts the states of these {seconds:g} s without further "
        f"measurements. Errors are averaged over all {comparison.steps} steps of "
        f"{1000 * comparison.dt_s:g} ms, on {library.count} that no model was trained on "
        f"({library.description})."
    )
    names = [column.name for column in comparison.columns]
    states = "; ".join(f"{name}: {MEANINGS[name]}" for name in names if name in MEANINGS)
    described = (f"States: {states}.",) if states else ()
    results = Bullets(tuple(_main_results(comparison)))
    plot = Plot(plots.rms_over_time(comparison), caption)
    return (headline(comparison), plot, task, *described, results)


def _main_results(comparison: Comparison) -> list[str]:
    """A sentence for each model and question."""
    lines = []
    library = comparison.library
    best = library["best_baseline"].get(LINEAR)
    for model in comparison.models:
        ratios = library["baseline_mse_over_model_mse"][model]
        medians = library["baseline_mse_quantile_over_model_mse_quantile"][model]["p50"]
        if FAIR_LTI in ratios:
            lines.append(
                f"On the {LIBRARY}, the mean squared error of the better of "
                f"{' and '.join(LTI_BASELINES)} in each state is "
                f"{_means(comparison, ratios[FAIR_LTI], f'that of {model}')}."
            )
        if best is not None:
            lines.append(
                f"On the {LIBRARY}, the mean squared error of {best}, the best linear baseline, is "
                f"{_means(comparison, ratios[best], f'that of {model}')}; in the median over the "
                f"trajectories it is {_means(comparison, medians[best], f'that of {model}')}."
            )
        for test in filter(None, map(comparison.find_set, (NEW_ROADS, ROBUSTNESS))):
            ratio = comparison.figures["sets"][test.name]["mse_over_library_mse"][model]
            worst, largest = comparison.worst_state(ratio)
            lines.append(
                f"On {test.name}, the mean squared error of {model} is "
                f"{_means(comparison, ratio, f'its own on the {LIBRARY}')}, "
                f"{format_number(largest, 3)} times in the worst state, {worst}."
            )
    return lines


def _means(comparison: Comparison, ratio: Figures, of: str) -> str:
    """Geometric means, the first with its interval, as text."""
    cell, *others = interval_cells(means_of(ratio))
    interval = f" ({cell.detail})" if cell.detail else ""
    text = f"{cell.text}{interval} times {of} in the geometric mean of "
    text += f"{len(comparison.columns)} states"
    return text + "".join(f", {other.text} times without {PROGRESS}" for other in others)


def _errors(comparison: Comparison) -> Section:
    text = (
        "Mean squared errors in squared units, as in the paper's Table I, and their roots. "
        f"Intervals: {100 * CONFIDENCE:g} %, from {RESAMPLES} bootstrap resamples of whole "
        "episodes, because trajectories of one episode are not independent."
    )
    library = comparison.sets[0]
    parts: list[Part] = [text, mse_table(comparison, library), rms_table(comparison, library)]
    for model in comparison.models:
        caption = f"Absolute error of {model}: median, 90 % and 99 % quantile of the trajectories."
        parts.append(Plot(plots.quantiles_over_time(comparison, model), caption))
    return Section("Errors", tuple(parts))


def _ratios(comparison: Comparison) -> Section:
    text = (
        "A ratio of 2 means that the baseline's mean squared error is twice the model's. Both "
        "errors of a ratio are averaged over the same drawn episodes, so an interval above 1 is a "
        "difference that these data show."
    )
    if set(LTI_BASELINES) <= set(comparison.baselines):
        text += (
            f" “{FAIR_LTI}” combines two baselines: one linear model with an offset for all roads "
            "and one for each road, the better of them for each state."
        )
    parts: list[Part] = [text]
    for model in comparison.models:
        bars = plots.ratio_bars(comparison, model)
        parts.append(Plot(bars, f"Errors of the baselines over {model}."))
        parts.append(ratio_table(comparison, model, comparison.sets[0]))
    return Section("Comparison with baselines", tuple(parts))


def _conditions(comparison: Comparison) -> Section:
    text = (
        "Errors on parts of the test sets: which part, how many trajectories and episodes, the "
        "best linear of the evaluated baselines there, and how much the error of the model grows. "
        "The best baseline has the smallest geometric mean of its mean squared errors; it is "
        "chosen for each part."
    )
    parts: list[Part] = [text]
    if any(each.is_ordered for each in comparison.series):
        caption = (
            f"Geometric mean over the states of the mean squared error, over that of "
            f"{comparison.models[0]} on the library; bars are intervals."
        )
        parts.append(Plot(plots.errors_by_condition(comparison), caption))
    parts += [conditions_table(comparison, model) for model in comparison.models]
    return Section("Conditions", tuple(parts))


def _roads(comparison: Comparison) -> Section | None:
    if not comparison.sets[0].curvatures_per_m:
        return None
    new = comparison.find_set(NEW_ROADS)
    text = "Errors by the curvature of the road."
    if new is not None:
        text += (
            f" Roads with a star are not in the training data of this library ({new.description}). "
            "The road does not act on the car, so laying another road under a drive is exact."
        )
    parts: list[Part] = [text]
    for model in comparison.models:
        caption = f"RMS error of {model} on each road, over that on all roads of the library."
        parts.append(Plot(plots.road_heat_map(comparison, model), caption))
    return Section("Roads", tuple(parts))


def lane_change_section(
    driven: LaneChange, predicted: Mapping[str, Array], comparison: Comparison
) -> Section:
    """`predicted` has the states (W, K+1, n) of each window that each model predicts."""
    text = (
        f"The paper's manoeuvre: {driven.description}. A preview driver steers the simulated car; "
        "the models get its inputs. They start from the measured state every 2 s, at the dotted "
        "lines, and predict without measurements in between. The panels are scaled to the car and "
        "the models; curves of baselines may leave them."
    )
    shown = [name for name in comparison.baselines if name in predicted]
    if len(shown) < len(comparison.baselines):
        text += f" Baselines shown: {', '.join(shown) or 'none'}."
    plot = Plot(plots.lane_change_plot(driven, predicted, comparison))
    return Section("Double lane change, open loop", (text, plot))


def _sources(comparison: Comparison, sources: Sequence[Table]) -> Section:
    sets = [
        Fact(test.name, f"{test.description}; {test.count}; data set {test.data_sha256}")
        for test in comparison.sets
    ]
    bootstrap = Fact("bootstrap", f"{RESAMPLES} resamples of episodes, seed {SEED}, percentiles")
    tables = (*sources, facts_table([*sets, bootstrap], "Test sets"))
    return Section("Models, test sets and software", tables)
