"""The tables of an evaluation, for the terminal, the model card and the report page.

They are views of `Comparison.figures`. The title of each table says what is compared with what, on
which trajectories.
"""

from collections.abc import Iterable, Mapping, Sequence

from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES
from offline.evaluation.comparison import FAIR_LTI, LINEAR, LTI_BASELINES, SHARE_KEYS, Comparison
from offline.evaluation.metrics import (
    LARGEST_RATIO_ON_NEW_ROADS,
    MEANS,
    PROGRESS,
    SHARES,
    WORST_SHARE,
    Figures,
)
from offline.evaluation.series import Series
from offline.evaluation.test_sets import LIBRARY, NEW_ROADS, ROBUSTNESS, TestSet
from rt_controller.report.table import NO_VALUE, Cell, Column, Row, Table, format_number

INTERVALS = (
    f"Second line: {100 * CONFIDENCE:g} % interval, bootstrap by episode, {RESAMPLES} resamples."
)
TABLES_OF_RATIOS = (NEW_ROADS, ROBUSTNESS)
"""test sets with a table of the ratio to the library in each state; all are in the series"""

SHARE_NAMES = tuple("median" if share == 0.5 else f"{100 * share:g} %" for share in SHARES)


def comparison_tables(comparison: Comparison) -> list[Table]:
    """All tables, in the order in which `offline-evaluate` prints them."""
    tables = error_tables(comparison) + road_tables(comparison)
    for model in comparison.models:
        tables.append(quantile_table(comparison, model))
        if comparison.baselines:
            tables.append(ratio_table(comparison, model, comparison.sets[0]))
            tables.append(quantile_ratio_table(comparison, model))
        tables += [series_table(comparison, model, each) for each in comparison.series]
    found = (comparison.find_set(name) for name in TABLES_OF_RATIOS)
    return tables + [library_ratio_table(comparison, test) for test in found if test is not None]


def error_tables(comparison: Comparison) -> list[Table]:
    """Means, roots, medians, and the worst trajectories on the library."""
    library, models = comparison.sets[0], comparison.library["models"]
    median = SHARE_KEYS[SHARES.index(0.5)]
    return [
        mse_table(comparison, library),
        rms_table(comparison, library),
        _table(
            f"MSE of the median trajectory of each model on {library.size}",
            ["model", *_squared(comparison)],
            {
                name: interval_cells(each["mse_quantiles_over_trajectories"][median].values())
                for name, each in models.items()
            },
        ),
        _table(
            f"Part of the MSE of each model that its worst {100 * WORST_SHARE:g} % of the "
            f"trajectories have, {library.size}",
            ["model", *(Column(each.name) for each in comparison.columns)],
            {
                name: interval_cells(each["part_of_mse_of_worst_trajectories"].values())
                for name, each in models.items()
            },
            ["1: all of it. The worst trajectories are chosen for each model and state."],
        ),
    ]


def mse_table(comparison: Comparison, test: TestSet) -> Table:
    """Mean squared errors with intervals. Paper: Table I."""
    models = comparison.figures["sets"][test.name]["models"]
    counts = {n: each["trajectories_without_finite_prediction"] for n, each in models.items()}
    diverged = ", ".join(f"{name} on {count}" for name, count in counts.items() if count)
    note = f"No finite prediction: {diverged} trajectories." if diverged else INTERVALS
    return _table(
        f"MSE over {comparison.steps} steps of each model on {test.size}",
        ["model", *_squared(comparison)],
        {name: interval_cells(each["mse"].values()) for name, each in models.items()},
        [note, *_not_converged(comparison)],
    )


def rms_table(comparison: Comparison, test: TestSet, with_intervals: bool = False) -> Table:
    """Root mean square errors."""
    models = comparison.figures["sets"][test.name]["models"]
    to_cells = interval_cells if with_intervals else _values
    return _table(
        f"RMS error over {comparison.steps} steps of each model on {test.size}",
        ["model", *_states(comparison)],
        {name: to_cells(each["rms"].values()) for name, each in models.items()},
    )


def road_tables(comparison: Comparison) -> list[Table]:
    """Mean squared errors on the roads of each curvature of the library."""
    library, models = comparison.sets[0], comparison.library["models"]
    return [
        _table(
            f"MSE of each model on curvature {kappa:g} 1/m, {library.name}",
            ["model", *_squared(comparison)],
            {
                name: _values(each["mse_by_curvature_per_m"][f"{kappa:g}"].values())
                for name, each in models.items()
            },
        )
        for kappa in library.curvatures_per_m
    ]


def quantile_table(comparison: Comparison, model: str) -> Table:
    """Quantiles of the absolute error after 0.5, 1 and 2 s."""
    found = comparison.library["absolute_error_quantiles"][model]
    return _table(
        f"Absolute error of {model}: quantiles over trajectories, {LIBRARY}",
        ["after", *_states(comparison)],
        {
            f"{after.removeprefix('after_').replace('_', ' ')}, {share}": interval_cells(
                shares[key].values()
            )
            for after, shares in found.items()
            for key, share in zip(SHARE_KEYS, SHARE_NAMES, strict=True)
        },
    )


def ratio_table(comparison: Comparison, model: str, test: TestSet) -> Table:
    """Mean errors of each baseline over those of the model."""
    found = comparison.figures["sets"][test.name]
    ratios = found["baseline_mse_over_model_mse"][model]
    note = f"{FAIR_LTI}: for each state the better of {' and '.join(LTI_BASELINES)}."
    notes = [note] if FAIR_LTI in ratios else []
    if LINEAR in found["best_baseline"]:
        best = found["best_baseline"][LINEAR]
        notes.append(f"Best linear baseline in the geometric mean: {best}.")
    title = f"MSE of each baseline over MSE of {model} on {test.size}: above 1, {model} is better"
    return _ratio_table(title, "baseline", comparison, ratios, notes + _not_converged(comparison))


def quantile_ratio_table(comparison: Comparison, model: str) -> Table:
    """Medians and tails of the errors of each baseline over those of the model, on the library."""
    library = comparison.library
    by_share = library["baseline_mse_quantile_over_model_mse_quantile"][model]
    ratios = [library["baseline_mse_over_model_mse"][model], *by_share.values()]
    heads = _mean_heads(comparison)
    return _table(
        f"Mean, median, 90 % and 99 % quantile over trajectories of the squared error of each "
        f"baseline, over the same of {model}: geometric means over the states, "
        f"{comparison.sets[0].size}",
        ["baseline", *(Column(each, h.unit) for each in ("mean", *SHARE_NAMES) for h in heads)],
        {
            name: [cell for found in ratios for cell in interval_cells(means_of(found[name]))]
            for name in comparison.baselines
        },
    )


def library_ratio_table(comparison: Comparison, test: TestSet) -> Table:
    """Errors of every model on another set over those on the library."""
    found = comparison.figures["sets"][test.name]
    ratios, notes = found["mse_over_library_mse"], []
    if test.name == NEW_ROADS:
        texts = []
        for model in comparison.models:
            verdict = "reached" if found["is_within_goal"][model] else "missed"
            state, ratio = comparison.worst_state(ratios[model])
            figure = format_number(ratio, 3)
            texts.append(f"{model}: {verdict}, worst state {state} with {figure}")
        notes = [f"Goal: no state above {LARGEST_RATIO_ON_NEW_ROADS:g}. {'; '.join(texts)}"]
    title = f"MSE of each model on {test.name} over its own on {LIBRARY}, {test.count}"
    return _ratio_table(title, "model", comparison, ratios, notes)


def series_table(comparison: Comparison, model: str, series: Series) -> Table:
    """For each slice: the best linear baseline over the model, and the model over itself."""
    slices = comparison.figures["series"][series.name]["slices"]
    has_linear = any(part["best_baseline"] for part in slices)
    rows: list[Row] = []
    for part in slices:
        cells = [part["label"], str(part["n_trajectories"]), str(part["n_episodes"])]
        if best := part["best_baseline"].get(LINEAR):
            ratios = part["baseline_mse_over_model_mse"][model][best]
            state = part["state_of_smallest_ratio"][model][best]
            smallest = Cell(format_number(ratios[state]["value"]), state)
            cells += [best, *interval_cells(means_of(ratios)), smallest]
        growth = part["mse_over_library_mse"][model]
        rows.append((*cells, *interval_cells(means_of(growth))))
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


def means_of(ratios: Figures) -> list[Figures]:
    """The geometric means that there are."""
    return [ratios[name] for name in MEANS if name in ratios]


def interval_cells(estimates: Iterable[Figures]) -> list[Cell]:
    """The numbers of estimates with their intervals."""
    cells = []
    for value, low, high in (each.values() for each in estimates):
        has_interval = low <= high < float("inf")
        interval = f"{format_number(low, 3)}{NO_VALUE}{format_number(high, 3)}"
        cells.append(Cell(format_number(value), interval if has_interval else ""))
    return cells


def _ratio_table(
    title: str, first: str, comparison: Comparison, ratios: Figures, notes: Sequence[str]
) -> Table:
    states = (Column(each.name) for each in comparison.columns)
    rows = {name: interval_cells(each.values()) for name, each in ratios.items()}
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
    """Heads of the geometric means."""
    names = [column.name for column in comparison.columns]
    has_progress = PROGRESS in names and len(names) > 1
    units = (f"{len(names)} states", *([f"without {PROGRESS}"] if has_progress else []))
    return [Column("geometric mean", unit) for unit in units]


def _values(estimates: Iterable[Figures]) -> list[str]:
    return [format_number(each["value"]) for each in estimates]


def _not_converged(comparison: Comparison) -> list[str]:
    """A footnote if a baseline could have been trained for longer."""
    names = ", ".join(comparison.not_converged)
    return [f"Not converged within the time of a fit: {names}."] if names else []
