"""The tables of an evaluation, for the terminal, the model card and the report page."""

from collections.abc import Mapping

from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES, Estimate
from offline.evaluation.comparison import (
    FAIR_LTI,
    LARGEST_RATIO_ON_NEW_ROADS,
    LTI_BASELINES,
    Comparison,
    Ratio,
)
from offline.evaluation.metrics import SHARES
from offline.evaluation.test_sets import LIBRARY, NEW_ROADS, TestSet
from rt_controller.report.table import NO_VALUE, Cell, Column, Row, Table, format_number

INTERVALS = (
    f"Second line: {100 * CONFIDENCE:g} % interval, bootstrap by episode, {RESAMPLES} resamples."
)


def mse_table(comparison: Comparison, test: TestSet) -> Table:
    """Mean squared errors with intervals. Paper: Table I."""
    scores = comparison.scores[test.name]
    diverged = [
        f"{name} on {scores[name].diverged}" for name in comparison.names if scores[name].diverged
    ]
    return Table(
        f"MSE over {comparison.steps} steps, {set_size(test)}",
        _state_heads("model", comparison, squared=True),
        tuple((name, *_cells(scores[name].mse())) for name in comparison.names),
        (f"No finite prediction: {', '.join(diverged)} trajectories." if diverged else INTERVALS,),
    )


def rms_table(comparison: Comparison, test: TestSet) -> Table:
    """Root mean square errors without intervals."""
    scores = comparison.scores[test.name]
    return Table(
        f"RMS error over {comparison.steps} steps, {set_size(test)}",
        _state_heads("model", comparison),
        tuple((name, *_values(scores[name].rms())) for name in comparison.names),
    )


def road_tables(comparison: Comparison, test: TestSet) -> list[Table]:
    """Mean squared errors on the roads of each curvature."""
    scores = comparison.scores[test.name]
    return [
        Table(
            f"MSE on curvature {kappa:g} 1/m",
            _state_heads("model", comparison, squared=True),
            tuple((name, *_values(scores[name].mse_on_road(kappa))) for name in comparison.names),
        )
        for kappa in test.curvatures_per_m
    ]


def ratio_table(comparison: Comparison, model: str, test: TestSet) -> Table:
    """Errors of each baseline over those of the model."""
    ratios = comparison.ratios_to_baselines(model, test.name)
    linear = " and ".join(name for name in LTI_BASELINES if name in comparison.baselines)
    note = f"{FAIR_LTI}: for each state the better of {linear}."
    title = f"MSE of each baseline over MSE of {model}, {test.name}: above 1, {model} is better"
    notes = (note,) if FAIR_LTI in ratios else ()
    return _ratio_table(title, "baseline", comparison, ratios, notes)


def quantile_table(comparison: Comparison, model: str) -> Table:
    """Quantiles of the absolute error after 0.5, 1 and 2 s."""
    scores = comparison.library[model]
    at_marks = scores.quantiles_at_marks()
    rows: list[Row] = [
        (
            f"{step * comparison.dt_s:g} s, {'median' if share == 0.5 else f'{100 * share:g} %'}",
            *_cells(at_marks.at(i, j)),
        )
        for j, step in enumerate(scores.marked_steps)
        for i, share in enumerate(SHARES)
    ]
    title = f"Absolute error of {model}: quantiles over trajectories, {LIBRARY}"
    return Table(title, _state_heads("after", comparison), tuple(rows))


def library_ratio_table(comparison: Comparison, test: TestSet) -> Table:
    """Errors of every model on another set over those on the library."""
    ratios = {name: comparison.ratio_to_library(name, test.name) for name in comparison.names}
    notes: tuple[str, ...] = ()
    if test.name == NEW_ROADS:
        found = "; ".join(_goal(comparison, name, ratios[name]) for name in comparison.models)
        notes = (f"Goal: no state above {LARGEST_RATIO_ON_NEW_ROADS:g}. {found}",)
    title = f"MSE on {test.name} over MSE on {LIBRARY}, {set_size(test)}"
    return _ratio_table(title, "model", comparison, ratios, notes)


def comparison_tables(comparison: Comparison) -> list[Table]:
    """All tables, in the order in which `offline-evaluate` prints them."""
    library = comparison.sets[0]
    tables = [mse_table(comparison, library), rms_table(comparison, library)]
    tables += road_tables(comparison, library)
    for model in comparison.models:
        tables.append(quantile_table(comparison, model))
        if len(comparison.names) > 1:
            tables.append(ratio_table(comparison, model, library))
    return tables + [library_ratio_table(comparison, test) for test in comparison.sets[1:]]


def set_size(test: TestSet) -> str:
    """Number of trajectories and episodes, as text."""
    return f"{test.n_trajectories} trajectories of {test.n_episodes} episodes"


def interval_cell(estimate: Estimate) -> Cell:
    """A single value with its interval."""
    value, low, high = (float(part) for part in estimate)
    if not low <= high < float("inf"):
        return Cell(format_number(value))
    return Cell(format_number(value), f"{format_number(low, 3)}{NO_VALUE}{format_number(high, 3)}")


def _cells(estimate: Estimate) -> tuple[Cell, ...]:
    """One cell for each value (n,)."""
    return tuple(interval_cell(estimate.at(i)) for i in range(len(estimate.value)))


def _values(estimate: Estimate) -> tuple[str, ...]:
    return tuple(format_number(float(value)) for value in estimate.value)


def _ratio_table(
    title: str,
    first: str,
    comparison: Comparison,
    ratios: Mapping[str, Ratio],
    notes: tuple[str, ...],
) -> Table:
    states = (Column(each.name) for each in comparison.columns)
    rows: list[Row] = [
        (name, *_cells(ratio.by_state), interval_cell(ratio.geometric_mean))
        for name, ratio in ratios.items()
    ]
    heads = (Column(first, is_text=True), *states, Column("geometric mean"))
    return Table(title, heads, tuple(rows), notes)


def _state_heads(first: str, comparison: Comparison, squared: bool = False) -> tuple[Column, ...]:
    states = (
        Column(each.name, each.squared_unit if squared else each.unit)
        for each in comparison.columns
    )
    return (Column(first, is_text=True), *states)


def _goal(comparison: Comparison, model: str, ratio: Ratio) -> str:
    verdict = "reached" if ratio.is_within_goal else "missed"
    worst = ratio.worst_state
    figure = format_number(float(ratio.by_state.value[worst]), 3)
    return f"{model}: {verdict}, worst state {comparison.columns[worst].name} with {figure}"
