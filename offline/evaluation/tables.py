"""The tables of an evaluation, for the terminal, the model card and the report page.

The title of each table says what is compared with what, on which trajectories.
"""

from collections.abc import Mapping, Sequence

from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES, Estimate
from offline.evaluation.comparison import FAIR_LTI, LTI_BASELINES, Comparison, ScoredSeries
from offline.evaluation.ratio import LARGEST_RATIO_ON_NEW_ROADS, PROGRESS, Ratio
from offline.evaluation.test_sets import LIBRARY, NEW_ROADS, ROBUSTNESS, TestSet
from offline.evaluation.trajectory_errors import SHARES, WORST_SHARE
from rt_controller.report.table import NO_VALUE, Cell, Column, Row, Table, format_number

INTERVALS = (
    f"Second line: {100 * CONFIDENCE:g} % interval, bootstrap by episode, {RESAMPLES} resamples."
)
TABLES_OF_RATIOS = (NEW_ROADS, ROBUSTNESS)
"""test sets with a table of the ratio to the library in each state; all are in the series"""


def mse_table(comparison: Comparison, test: TestSet) -> Table:
    """Mean squared errors with intervals. Paper: Table I."""
    scores = comparison.scores[test.name]
    diverged = [
        f"{name} on {scores[name].diverged}" for name in comparison.names if scores[name].diverged
    ]
    return Table(
        f"MSE over {comparison.steps} steps of each model on {test.name}, {set_size(test)}",
        _state_heads("model", comparison, squared=True),
        tuple((name, *_cells(scores[name].mse())) for name in comparison.names),
        (f"No finite prediction: {', '.join(diverged)} trajectories." if diverged else INTERVALS,),
    )


def rms_table(comparison: Comparison, test: TestSet, with_intervals: bool = False) -> Table:
    """Root mean square errors."""
    scores, to_cells = comparison.scores[test.name], _cells if with_intervals else _values
    return Table(
        f"RMS error over {comparison.steps} steps of each model on {test.name}, {set_size(test)}",
        _state_heads("model", comparison),
        tuple((name, *to_cells(scores[name].rms())) for name in comparison.names),
    )


def median_table(comparison: Comparison, test: TestSet) -> Table:
    """Median over the trajectories of the mean squared error of each."""
    errors = comparison.errors_on(test.name)
    median = SHARES.index(0.5)
    return Table(
        f"MSE of the median trajectory of each model on {test.name}, {set_size(test)}",
        _state_heads("model", comparison, squared=True),
        tuple((name, *_cells(errors[name].quantiles(), median)) for name in comparison.names),
    )


def worst_table(comparison: Comparison, test: TestSet) -> Table:
    """Part of the mean squared error that the trajectories with the largest errors have."""
    errors = comparison.errors_on(test.name)
    states = (Column(each.name) for each in comparison.columns)
    return Table(
        f"Part of the MSE of each model that its worst {100 * WORST_SHARE:g} % of the trajectories "
        f"have, {test.name}, {set_size(test)}",
        (Column("model", is_text=True), *states),
        tuple((name, *_cells(errors[name].worst_part)) for name in comparison.names),
        ("1: all of it. The worst trajectories are chosen for each model and state.",),
    )


def road_tables(comparison: Comparison, test: TestSet) -> list[Table]:
    """Mean squared errors on the roads of each curvature."""
    errors = comparison.errors_on(test.name)
    return [
        Table(
            f"MSE of each model on curvature {kappa:g} 1/m, {test.name}",
            _state_heads("model", comparison, squared=True),
            tuple(
                (name, *_values(errors[name].take(test.is_on_road(kappa)).mean()))
                for name in comparison.names
            ),
        )
        for kappa in test.curvatures_per_m
    ]


def ratio_table(comparison: Comparison, model: str, test: TestSet) -> Table:
    """Mean errors of each baseline over those of the model."""
    ratios = comparison.ratios_to_baselines(model, test.name)
    note = f"{FAIR_LTI}: for each state the better of {' and '.join(LTI_BASELINES)}."
    notes = [note] if FAIR_LTI in ratios else []
    best = comparison.best_baselines(comparison.errors_on(test.name))
    notes += [f"Best {kind} baseline in the geometric mean: {name}." for kind, name in best.items()]
    title = (
        f"MSE of each baseline over MSE of {model} on {test.name}, {set_size(test)}: above 1, "
        f"{model} is better"
    )
    return _ratio_table(title, "baseline", comparison, ratios, notes)


def quantile_ratio_table(comparison: Comparison, model: str, test: TestSet) -> Table:
    """Medians and tails of the errors of each baseline over those of the model."""
    means = comparison.ratios_to_baselines(model, test.name)
    by_share = comparison.ratios_of_quantiles(model, test.name)
    heads = _mean_heads(comparison)
    rows: list[Row] = [
        (
            name,
            *_mean_cells(means[name]),
            *(cell for ratios in by_share.values() for cell in _mean_cells(ratios[name])),
        )
        for name in comparison.baselines
    ]
    of = ["mean", *("median" if share == 0.5 else f"{100 * share:g} %" for share in by_share)]
    columns = (Column(each, head.unit) for each in of for head in heads)
    return Table(
        f"Mean, median, 90 % and 99 % quantile over trajectories of the squared error of each "
        f"baseline, over the same of {model}: geometric means over the states, {test.name}, "
        f"{set_size(test)}",
        (Column("baseline", is_text=True), *columns),
        tuple(rows),
    )


def quantile_table(comparison: Comparison, model: str) -> Table:
    """Quantiles of the absolute error after 0.5, 1 and 2 s."""
    scores = comparison.library[model]
    at_marks = scores.quantiles_at_marks()
    rows: list[Row] = [
        (
            f"{step * comparison.dt_s:g} s, {'median' if share == 0.5 else f'{100 * share:g} %'}",
            *_cells(at_marks, i, j),
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
    title = f"MSE of each model on {test.name} over its own on {LIBRARY}, {set_size(test)}"
    return _ratio_table(title, "model", comparison, ratios, notes)


def series_tables(comparison: Comparison, model: str) -> list[Table]:
    """For each series: the best baselines over the model, and the model over itself."""
    return [_series_table(comparison, model, each) for each in comparison.series]


def _series_table(comparison: Comparison, model: str, scored: ScoredSeries) -> Table:
    series, slices = scored
    heads, kinds = _mean_heads(comparison), comparison.known_classes
    columns = [
        Column(series.quantity, series.unit, is_text=True),
        Column("trajectories"),
        Column("episodes"),
    ]
    for kind in kinds:
        columns += [
            Column(f"best {kind}", is_text=True, width="short"),
            *_renamed(heads, "MSE ratio"),
        ]
        columns.append(Column("smallest", "of a state"))
    rows: list[Row] = []
    for part in slices:
        cells: list[Cell | str] = [part.label, f"{part.n_trajectories}", f"{part.n_episodes}"]
        for name in comparison.best_baselines(part.errors).values():
            ratio = comparison.ratio_to(model, name, part.errors)
            cells += [name, *_mean_cells(ratio), _smallest_cell(comparison, ratio)]
        rows.append((*cells, *_mean_cells(comparison.growth(model, part.errors[model]))))
    compared = [f"MSE of the best {kind} baseline over that of {model}" for kind in kinds]
    compared.append(f"MSE of {model} over its own on the whole {LIBRARY}")
    head = series.quantity.capitalize() + (f" ({series.unit})" if series.unit else "")
    return Table(
        f"{head}: {', and '.join(compared)}; geometric means over the states; {series.on}",
        (*columns, *_renamed(heads, f"over {LIBRARY}")),
        tuple(rows),
    )


def comparison_tables(comparison: Comparison) -> list[Table]:
    """All tables, in the order in which `offline-evaluate` prints them."""
    library = comparison.sets[0]
    tables = [mse_table(comparison, library), rms_table(comparison, library)]
    tables += [median_table(comparison, library), worst_table(comparison, library)]
    tables += road_tables(comparison, library)
    for model in comparison.models:
        tables.append(quantile_table(comparison, model))
        if comparison.baselines:
            tables.append(ratio_table(comparison, model, library))
            tables.append(quantile_ratio_table(comparison, model, library))
        tables += series_tables(comparison, model)
    found = (comparison.find_set(name) for name in TABLES_OF_RATIOS)
    return tables + [library_ratio_table(comparison, test) for test in found if test is not None]


def set_size(test: TestSet) -> str:
    """Number of trajectories and episodes, as text."""
    return f"{test.n_trajectories} trajectories of {test.n_episodes} episodes"


def interval_cell(estimate: Estimate) -> Cell:
    """A single value with its interval."""
    value, low, high = (float(part) for part in estimate)
    if not low <= high < float("inf"):
        return Cell(format_number(value))
    return Cell(format_number(value), f"{format_number(low, 3)}{NO_VALUE}{format_number(high, 3)}")


def _cells(estimate: Estimate, *index: int) -> tuple[Cell, ...]:
    """One cell for each state of an estimate (..., n), at these leading indices."""
    n = estimate.value.shape[-1]
    return tuple(interval_cell(estimate.at(*index, i)) for i in range(n))


def _values(estimate: Estimate) -> tuple[str, ...]:
    return tuple(format_number(float(value)) for value in estimate.value)


def _mean_heads(comparison: Comparison) -> tuple[Column, ...]:
    """Heads of the geometric means of a ratio: over all states, and without progress."""
    names = [column.name for column in comparison.columns]
    over_all = Column("geometric mean", f"{len(names)} states")
    if PROGRESS not in names or len(names) == 1:
        return (over_all,)
    return over_all, Column("geometric mean", f"without {PROGRESS}")


def _mean_cells(ratio: Ratio) -> tuple[Cell, ...]:
    """Cells below `_mean_heads`."""
    means = (ratio.geometric_mean, ratio.without_progress)
    return tuple(interval_cell(mean) for mean in means if mean is not None)


def _smallest_cell(comparison: Comparison, ratio: Ratio) -> Cell:
    """The smallest ratio of a state, and which state."""
    least = ratio.least_state
    value = float(ratio.by_state.value[least])
    return Cell(format_number(value), comparison.columns[least].name)


def _renamed(heads: Sequence[Column], title: str) -> tuple[Column, ...]:
    return tuple(head._replace(title=title) for head in heads)


def _ratio_table(
    title: str,
    first: str,
    comparison: Comparison,
    ratios: Mapping[str, Ratio],
    notes: Sequence[str],
) -> Table:
    states = (Column(each.name) for each in comparison.columns)
    rows: list[Row] = [
        (name, *_cells(ratio.by_state), *_mean_cells(ratio)) for name, ratio in ratios.items()
    ]
    heads = (Column(first, is_text=True), *states, *_mean_heads(comparison))
    return Table(title, heads, tuple(rows), tuple(notes))


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
