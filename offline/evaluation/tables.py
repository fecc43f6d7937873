"""The tables of an evaluation, for the terminal, the model card and the report page.

The title of each table says what is compared with what, on which trajectories.
"""

from collections.abc import Mapping, Sequence

from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES, Estimate
from offline.evaluation.comparison import FAIR_LTI, LTI_BASELINES, Comparison, ScoredSeries
from offline.evaluation.metrics import (
    LARGEST_RATIO_ON_NEW_ROADS,
    PROGRESS,
    SHARES,
    WORST_SHARE,
    Ratio,
)
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
    medians = {name: each.quantiles().at(SHARES.index(0.5)) for name, each in errors.items()}
    worst = {name: each.worst_part for name, each in errors.items()}
    states = [Column(each.name) for each in comparison.columns]
    return [
        mse_table(comparison, library),
        rms_table(comparison, library),
        _table(
            f"MSE of the median trajectory of each model on {_size(library)}",
            [Column("model", is_text=True), *_squared(comparison)],
            {name: _cells(each) for name, each in medians.items()},
        ),
        _table(
            f"Part of the MSE of each model that its worst {100 * WORST_SHARE:g} % of the "
            f"trajectories have, {_size(library)}",
            [Column("model", is_text=True), *states],
            {name: _cells(each) for name, each in worst.items()},
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
        f"MSE over {comparison.steps} steps of each model on {_size(test)}",
        [Column("model", is_text=True), *_squared(comparison)],
        {name: _cells(scores[name].mse()) for name in comparison.names},
        [note, *_not_converged(comparison)],
    )


def rms_table(comparison: Comparison, test: TestSet, with_intervals: bool = False) -> Table:
    """Root mean square errors."""
    scores, to_cells = comparison.scores[test.name], _cells if with_intervals else _values
    return _table(
        f"RMS error over {comparison.steps} steps of each model on {_size(test)}",
        [Column("model", is_text=True), *_states(comparison)],
        {name: to_cells(scores[name].rms()) for name in comparison.names},
    )


def road_tables(comparison: Comparison) -> list[Table]:
    """Mean squared errors on the roads of each curvature of the library."""
    library = comparison.sets[0]
    errors = comparison.errors_on(library.name)
    return [
        _table(
            f"MSE of each model on curvature {kappa:g} 1/m, {library.name}",
            [Column("model", is_text=True), *_squared(comparison)],
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
        [Column("after", is_text=True), *_states(comparison)],
        {
            f"{step * comparison.dt_s:g} s, {share}": _cells(at_marks.at(i, j))
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
    title = f"MSE of each baseline over MSE of {model} on {_size(test)}: above 1, {model} is better"
    return _ratio_table(title, "baseline", comparison, ratios, notes + _not_converged(comparison))


def quantile_ratio_table(comparison: Comparison, model: str) -> Table:
    """Medians and tails of the errors of each baseline over those of the model, on the library."""
    by_share = comparison.ratios_of_quantiles(model)
    ratios = [comparison.ratios_to_baselines(model), *by_share.values()]
    heads = _mean_heads(comparison)
    return _table(
        f"Mean, median, 90 % and 99 % quantile over trajectories of the squared error of each "
        f"baseline, over the same of {model}: geometric means over the states, "
        f"{_size(comparison.sets[0])}",
        [
            Column("baseline", is_text=True),
            *(Column(each, head.unit) for each in ("mean", *_SHARE_NAMES) for head in heads),
        ],
        {
            name: [cell for found in ratios for cell in _mean_cells(found[name])]
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
    title = f"MSE of each model on {test.name} over its own on {LIBRARY}, {set_size(test)}"
    return _ratio_table(title, "model", comparison, ratios, notes)


def series_tables(comparison: Comparison, model: str) -> list[Table]:
    """For each series: the best linear baseline over the model, and the model over itself."""
    return [_series_table(comparison, model, each) for each in comparison.series]


def set_size(test: TestSet) -> str:
    """Number of trajectories and episodes, as text."""
    return f"{test.n_trajectories} trajectories of {test.n_episodes} episodes"


def interval_cell(estimate: Estimate) -> Cell:
    """A single value with its interval."""
    value, low, high = (float(part) for part in estimate)
    if not low <= high < float("inf"):
        return Cell(format_number(value))
    return Cell(format_number(value), f"{format_number(low, 3)}{NO_VALUE}{format_number(high, 3)}")


def _series_table(comparison: Comparison, model: str, scored: ScoredSeries) -> Table:
    series, slices = scored
    heads = _mean_heads(comparison)
    columns = [
        Column(series.quantity, series.unit, is_text=True),
        Column("trajectories"),
        Column("episodes"),
    ]
    rows: list[Row] = []
    has_linear = False
    for part in slices:
        cells: list[Cell | str] = [part.label, f"{part.n_trajectories}", f"{part.n_episodes}"]
        if best := comparison.best_linear(part.errors):
            has_linear = True
            ratio = comparison.ratios(model, part.errors)[best]
            least = ratio.least_state
            smallest = format_number(float(ratio.by_state.value[least]))
            cells += [best, *_mean_cells(ratio), Cell(smallest, comparison.columns[least].name)]
        rows.append((*cells, *_mean_cells(comparison.growth(model, part.errors[model]))))
    compared = f"MSE of {model} over its own on the whole {LIBRARY}"
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
    heads = [Column(first, is_text=True), *states, *_mean_heads(comparison)]
    rows = {name: [*_cells(each.by_state), *_mean_cells(each)] for name, each in ratios.items()}
    return _table(title, heads, rows, notes)


def _table(
    title: str,
    heads: Sequence[Column],
    rows: Mapping[str, Sequence[Cell | str]],
    notes: Sequence[str] = (),
) -> Table:
    """A table whose rows have a name."""
    return Table(title, tuple(heads), tuple((name, *row) for name, row in rows.items()), (*notes,))


def _states(comparison: Comparison) -> list[Column]:
    return [Column(each.name, each.unit) for each in comparison.columns]


def _squared(comparison: Comparison) -> list[Column]:
    return [Column(each.name, each.squared_unit) for each in comparison.columns]


def _mean_heads(comparison: Comparison) -> list[Column]:
    """Heads of the geometric means of a ratio: over all states, and without progress."""
    names = [column.name for column in comparison.columns]
    over_all = Column("geometric mean", f"{len(names)} states")
    if PROGRESS not in names or len(names) == 1:
        return [over_all]
    return [over_all, Column("geometric mean", f"without {PROGRESS}")]


def _mean_cells(ratio: Ratio) -> list[Cell]:
    """Cells below `_mean_heads`."""
    means = (ratio.geometric_mean, ratio.without_progress)
    return [interval_cell(mean) for mean in means if mean is not None]


def _cells(estimate: Estimate) -> list[Cell]:
    """One cell for each state of an estimate (n,)."""
    return [interval_cell(estimate.at(i)) for i in range(len(estimate.value))]


def _values(estimate: Estimate) -> list[str]:
    return [format_number(float(value)) for value in estimate.value]


def _size(test: TestSet) -> str:
    return f"{test.name}, {set_size(test)}"


def _not_converged(comparison: Comparison) -> list[str]:
    """A footnote if a baseline could have been trained for longer."""
    names = ", ".join(comparison.not_converged)
    return [f"Not converged within the time of a fit: {names}."] if names else []


def _goal(comparison: Comparison, model: str, ratio: Ratio) -> str:
    verdict = "reached" if ratio.is_within_goal else "missed"
    worst = ratio.worst_state
    figure = format_number(float(ratio.by_state.value[worst]), 3)
    return f"{model}: {verdict}, worst state {comparison.columns[worst].name} with {figure}"
