"""The tables of an evaluation, for the terminal, the model card and the report page.

The title of each table says what is compared with what, on which trajectories.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES, Estimate
from offline.evaluation.comparison import FAIR_LTI, LTI_BASELINES, Comparison
from offline.evaluation.metrics import (
    LARGEST_RATIO_ON_NEW_ROADS,
    PROGRESS,
    SHARES,
    WORST_SHARE,
    Ratio,
)
from offline.evaluation.series import Series
from offline.evaluation.test_sets import LIBRARY, NEW_ROADS, ROBUSTNESS, TestSet
from rt_controller.report.table import NO_VALUE, Cell, Column, Row, Table, format_number

INTERVALS = (
    f"Second line: {100 * CONFIDENCE:g} % interval, bootstrap by episode, {RESAMPLES} resamples."
)
TABLES_OF_RATIOS = (NEW_ROADS, ROBUSTNESS)
"""test sets with a table of the ratio to the library in each state; all are in the series"""

_SHARE_NAMES = ["median" if share == 0.5 else f"{100 * share:g} %" for share in SHARES]


def comparison_tables(comparison: Comparison) -> list[Table]:
    """All tables, in the order in which `offline-evaluate` prints them."""
    tables = error_tables(comparison) + road_tables(comparison)
    for model in comparison.models:
        tables.append(quantile_table(comparison, model))
        if comparison.baselines:
            tables.append(ratio_table(comparison, model, comparison.sets[0]))
            tables.append(quantile_ratio_table(comparison, model))
        tables += series_tables(comparison, model)
    found = (comparison.find_set(name) for name in TABLES_OF_RATIOS)
    return tables + [library_ratio_table(comparison, test) for test in found if test is not None]


def error_tables(comparison: Comparison) -> list[Table]:
    """Means, roots, medians, and the worst trajectories on the library."""
    library = comparison.sets[0]
    errors = comparison.errors_on(library.name)
    median = SHARES.index(0.5)
    return [
        mse_table(comparison, library),
        rms_table(comparison, library),
        _table(
            f"MSE of the median trajectory of each model on {library.size}",
            ["model", *_squared(comparison)],
            {name: interval_cells(each.quantiles().at(median)) for name, each in errors.items()},
        ),
        _table(
            f"Part of the MSE of each model that its worst {100 * WORST_SHARE:g} % of the "
            f"trajectories have, {library.size}",
            ["model", *(Column(each.name) for each in comparison.columns)],
            {name: interval_cells(each.worst_part) for name, each in errors.items()},
            ["1: all of it. The worst trajectories are chosen for each model and state."],
        ),
    ]


def mse_table(comparison: Comparison, test: TestSet) -> Table:
    """Mean squared errors with intervals. Paper: Table I."""
    scores = comparison.scores[test.name]
    diverged = [
        f"{name} on {scores[name].diverged}" for name in comparison.names if scores[name].diverged
    ]
    note = f"No finite prediction: {', '.join(diverged)} trajectories." if diverged else INTERVALS
    return _table(
        f"MSE over {comparison.steps} steps of each model on {test.size}",
        ["model", *_squared(comparison)],
        {name: interval_cells(scores[name].mse()) for name in comparison.names},
        [note, *_not_converged(comparison)],
    )


def rms_table(comparison: Comparison, test: TestSet, with_intervals: bool = False) -> Table:
    """Root mean square errors."""
    scores, to_cells = comparison.scores[test.name], interval_cells if with_intervals else _values
    return _table(
        f"RMS error over {comparison.steps} steps of each model on {test.size}",
        ["model", *_states(comparison)],
        {name: to_cells(scores[name].rms()) for name in comparison.names},
    )


def road_tables(comparison: Comparison) -> list[Table]:
    """Mean squared errors on the roads of each curvature of the library."""
    library = comparison.sets[0]
    errors = comparison.errors_on(library.name)
    return [
        _table(
            f"MSE of each model on curvature {kappa:g} 1/m, {library.name}",
            ["model", *_squared(comparison)],
            {
                name: _values(each.take(library.is_on_road(kappa)).mean())
                for name, each in errors.items()
            },
        )
        for kappa in library.curvatures_per_m
    ]


def quantile_table(comparison: Comparison, model: str) -> Table:
    """Quantiles of the absolute error after 0.5, 1 and 2 s."""
    scores = comparison.library[model]
    at_marks = scores.quantiles_at_marks()
    return _table(
        f"Absolute error of {model}: quantiles over trajectories, {LIBRARY}",
        ["after", *_states(comparison)],
        {
            f"{step * comparison.dt_s:g} s, {share}": interval_cells(at_marks.at(i, j))
            for j, step in enumerate(scores.marked_steps)
            for i, share in enumerate(_SHARE_NAMES)
        },
    )


def ratio_table(comparison: Comparison, model: str, test: TestSet) -> Table:
    """Mean errors of each baseline over those of the model."""
    ratios = comparison.ratios_to_baselines(model, test.name)
    note = f"{FAIR_LTI}: for each state the better of {' and '.join(LTI_BASELINES)}."
    notes = [note] if FAIR_LTI in ratios else []
    best = comparison.best_linear(comparison.errors_on(test.name))
    if best is not None:
        notes.append(f"Best linear baseline in the geometric mean: {best}.")
    title = f"MSE of each baseline over MSE of {model} on {test.size}: above 1, {model} is better"
    return _ratio_table(title, "baseline", comparison, ratios, notes + _not_converged(comparison))


def quantile_ratio_table(comparison: Comparison, model: str) -> Table:
    """Medians and tails of the errors of each baseline over those of the model, on the library."""
    by_share = comparison.ratios_of_quantiles(model)
    ratios = [comparison.ratios_to_baselines(model), *by_share.values()]
    heads = _mean_heads(comparison)
    return _table(
        f"Mean, median, 90 % and 99 % quantile over trajectories of the squared error of each "
        f"baseline, over the same of {model}: geometric means over the states, "
        f"{comparison.sets[0].size}",
        ["baseline", *(Column(each, h.unit) for each in ("mean", *_SHARE_NAMES) for h in heads)],
        {
            name: [cell for found in ratios for cell in interval_cells(*found[name].means)]
            for name in comparison.baselines
        },
    )


def library_ratio_table(comparison: Comparison, test: TestSet) -> Table:
    """Errors of every model on another set over those on the library."""
    ratios = {name: comparison.ratio_to_library(name, test.name) for name in comparison.names}
    notes = []
    if test.name == NEW_ROADS:
        found = "; ".join(_goal(comparison, name, ratios[name]) for name in comparison.models)
        notes = [f"Goal: no state above {LARGEST_RATIO_ON_NEW_ROADS:g}. {found}"]
    title = f"MSE of each model on {test.name} over its own on {LIBRARY}, {test.count}"
    return _ratio_table(title, "model", comparison, ratios, notes)


def series_tables(comparison: Comparison, model: str) -> list[Table]:
    """For each series: the best linear baseline over the model, and the model over itself."""
    return [_series_table(comparison, model, each) for each in comparison.series]


def interval_cells(*estimates: Estimate) -> list[Cell]:
    """The numbers of estimates with their intervals; of an estimate (n,), one for each state."""
    cells = []
    for value, low, high in (
        row for each in estimates for row in np.transpose(each).reshape(-1, 3)
    ):
        has_interval = low <= high < float("inf")
        interval = f"{format_number(low, 3)}{NO_VALUE}{format_number(high, 3)}"
        cells.append(Cell(format_number(value), interval if has_interval else ""))
    return cells


def _series_table(comparison: Comparison, model: str, series: Series) -> Table:
    rows: list[Row] = []
    has_linear = False
    for part in series.slices:
        errors = comparison.errors_in(part)
        cells: list[Cell | str] = [part.label, *map(str, comparison.size_of(part))]
        if best := comparison.best_linear(errors):
            has_linear = True
            ratio = comparison.ratios(model, errors)[best]
            least = ratio.least_state
            smallest = format_number(float(ratio.by_state.value[least]))
            cells += [
                best,
                *interval_cells(*ratio.means),
                Cell(smallest, comparison.columns[least].name),
            ]
        rows.append((*cells, *interval_cells(*comparison.growth(model, errors[model]).means)))
    columns = [Column(series.quantity, series.unit, is_text=True)]
    columns += map(Column, ("trajectories", "episodes"))
    compared = f"MSE of {model} over its own on the whole {LIBRARY}"
    heads = _mean_heads(comparison)
    if has_linear:
        compared = f"MSE of the best linear baseline over that of {model}, and {compared}"
        columns.append(Column("best linear", is_text=True, width="short"))
        columns += [head._replace(title="MSE ratio") for head in heads]
        columns.append(Column("smallest", "of a state"))
    columns += [head._replace(title=f"over {LIBRARY}") for head in heads]
    head = series.quantity.capitalize() + (f" ({series.unit})" if series.unit else "")
    title = f"{head}: {compared}; geometric means over the states; {series.on}"
    return Table(title, tuple(columns), tuple(rows))


def _ratio_table(
    title: str,
    first: str,
    comparison: Comparison,
    ratios: Mapping[str, Ratio],
    notes: Sequence[str],
) -> Table:
    states = (Column(each.name) for each in comparison.columns)
    rows = {name: interval_cells(each.by_state, *each.means) for name, each in ratios.items()}
    return _table(title, [first, *states, *_mean_heads(comparison)], rows, notes)


def _table(
    title: str,
    heads: Sequence[Column | str],
    rows: Mapping[str, Sequence[Cell | str]],
    notes: Sequence[str] = (),
) -> Table:
    """A table whose rows have a name; a head without a unit is text: that of the names."""
    columns = tuple(Column(each, is_text=True) if isinstance(each, str) else each for each in heads)
    return Table(title, columns, tuple((name, *row) for name, row in rows.items()), (*notes,))


def _states(comparison: Comparison) -> list[Column]:
    return [Column(each.name, each.unit) for each in comparison.columns]


def _squared(comparison: Comparison) -> list[Column]:
    return [Column(each.name, each.squared_unit) for each in comparison.columns]


def _mean_heads(comparison: Comparison) -> list[Column]:
    """Heads of `Ratio.means`."""
    names = [column.name for column in comparison.columns]
    has_progress = PROGRESS in names and len(names) > 1
    units = (f"{len(names)} states", *([f"without {PROGRESS}"] if has_progress else []))
    return [Column("geometric mean", unit) for unit in units]


def _values(estimate: Estimate) -> list[str]:
    return [format_number(float(value)) for value in estimate.value]


def _not_converged(comparison: Comparison) -> list[str]:
    """A footnote if a baseline could have been trained for longer."""
    names = ", ".join(comparison.not_converged)
    return [f"Not converged within the time of a fit: {names}."] if names else []


def _goal(comparison: Comparison, model: str, ratio: Ratio) -> str:
    verdict = "reached" if ratio.is_within_goal else "missed"
    worst = ratio.worst_state
    figure = format_number(float(ratio.by_state.value[worst]), 3)
    return f"{model}: {verdict}, worst state {comparison.columns[worst].name} with {figure}"
