"""The plots of the report page, one function each, in the units of the tables."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from offline.evaluation.comparison import LINEAR, Comparison
from offline.evaluation.lane_change import LaneChange
from offline.evaluation.metrics import Figures, ratios_of, state_units
from offline.evaluation.tables import SHARE_NAMES
from offline.evaluation.test_sets import LIBRARY, NEW_ROADS
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import VEHICLE, InputColumn, StateColumn
from rt_controller.report.canvas import (
    FAINT,
    INK,
    add_legend,
    empty_figure,
    line_styles,
    set_log_scale,
)
from rt_controller.report.table import NO_VALUE, format_number

LARGEST_DRAWN = 1e4
"""ratio, and multiple of the models' errors, at which bars and axes end"""

_BETTER, _WORSE = "#2f6fb3", "#c98b86"


def rms_over_time(comparison: Comparison) -> Figure:
    """RMS error of each step, one panel for each state, with an interval for each model."""
    figure, panels = _state_panels(comparison)
    time_s = _time_s(comparison)
    styles = line_styles(comparison.models, comparison.baselines)
    found = comparison.library["by_step"]
    for column, axes in zip(comparison.columns, panels, strict=True):
        for k, name in enumerate(comparison.names):
            value, low, high = map(_finite_or_nan, found[name]["rms"][column.key].values())
            axes.plot(time_s, value, **styles[name], label=name, zorder=3 - 0.01 * k)
            if name in comparison.models:
                color = styles[name]["color"]
                axes.fill_between(time_s, low, high, color=color, alpha=0.18, linewidth=0.0)
        axes.set_yscale("log")
        rms = (found[name]["rms"][column.key]["value"] for name in comparison.models)
        errors = np.concatenate([*rms])
        drawn = errors[np.isfinite(errors) & (errors > 0.0)]
        if len(drawn):  # a baseline with very large errors would flatten the models
            bottom, top = axes.get_ylim()
            bottom = max(bottom, drawn.min() / LARGEST_DRAWN)
            axes.set_ylim(bottom, min(top, drawn.max() * LARGEST_DRAWN))
        set_log_scale(axes, "y")
    add_legend(figure, panels[0])
    return figure


def quantiles_over_time(comparison: Comparison, model: str) -> Figure:
    """Absolute error of each step: quantiles over the trajectories."""
    figure, panels = _state_panels(comparison)
    time_s = _time_s(comparison)
    quantiles = comparison.library["by_step"][model]["absolute_error"].values()
    drawn = [*zip(quantiles, SHARE_NAMES, (0.75, 0.35, 0.15), strict=True)]
    for column, axes in zip(comparison.columns, panels, strict=True):
        for by_state, label, alpha in reversed(drawn):
            axes.fill_between(
                time_s, 0.0, _finite_or_nan(by_state[column.key]), label=label,
                color=_BETTER, alpha=alpha, linewidth=0.0,
            )  # fmt: skip
        axes.set_ylim(bottom=0.0)
    add_legend(figure, panels[0])
    return figure


def ratio_bars(comparison: Comparison, model: str) -> Figure:
    """Errors of each baseline over the model's: a panel for each state and the geometric mean."""
    ratios = comparison.library["baseline_mse_over_model_mse"][model]
    heads = {column.name: column.name for column in comparison.columns}
    heads["geometric_mean"] = "geom. mean"
    figure, panels = empty_figure(1, len(heads), 0.9 + 0.3 * len(ratios), sharex=True, sharey=True)
    ends = [1.0]
    for axes, (key, head) in zip(panels, heads.items(), strict=True):
        for row, ratio in enumerate(ratios.values()):
            ends += _bar(axes, row, ratio[key])
        axes.axvline(1.0, color=INK, linewidth=0.8)
        axes.set_title(head)
        axes.grid(visible=False, axis="y")
        axes.set_axisbelow(True)
    low, high = 0.7 * min(ends), 1.4 * max(ends)
    for axes in panels:
        axes.set_xlim(low, high * (high / low) ** 0.35)  # space for the numbers
        set_log_scale(axes, "x")
    panels[0].set_yticks(range(len(ratios)), list(ratios))
    panels[0].invert_yaxis()
    figure.supxlabel(f"MSE of the baseline / MSE of {model}", fontsize=9)
    return figure


def errors_by_condition(comparison: Comparison) -> Figure:
    """Pooled errors over each series, of the models and the best linear baseline.

    An error is the geometric mean over the states of the mean squared error over that of the first
    model on the library; bars are intervals.
    """
    drawn = [each for each in comparison.series if each.is_ordered]
    unit = comparison.errors[LIBRARY][comparison.models[0]].mean_draws
    styles = line_styles(comparison.models, ("best linear",))
    rows = -(-len(drawn) // 2)
    figure, panels = empty_figure(rows, 2, 0.6 + 2.4 * rows)
    for axes, series in zip(panels, drawn, strict=False):
        slices = series.slices
        parts = comparison.figures["series"][series.name]["slices"]
        curves = {name: [name] * len(slices) for name in comparison.models}
        if all(part["best_baseline"] for part in parts):
            curves["best linear"] = [part["best_baseline"][LINEAR] for part in parts]
        for label, names in curves.items():
            means = []
            for part, name in zip(slices, names, strict=True):
                draws = comparison.errors[part.of][name].take(part.rows).mean_draws
                means.append(ratios_of(draws, unit, comparison.columns)["geometric_mean"].values())
            value, low, high = map(_finite_or_nan, zip(*means, strict=True))
            axes.errorbar(
                range(len(slices)), value, [value - low, high - value],
                **styles[label], label=label, marker="o", markersize=3.5, elinewidth=0.9,
            )  # fmt: skip
        set_log_scale(axes, "y")
        axes.set_xticks(range(len(slices)), [part.label for part in slices], fontsize=8)
        title = f"{series.quantity} / {series.unit}" if series.unit else series.quantity
        sets = {part.of for part in slices}
        axes.set_title(f"{title}, {sets.pop()}" if len(sets) == 1 else title, loc="left")
    for axes in panels[len(drawn) :]:
        axes.set_axis_off()
    add_legend(figure, panels[0])
    return figure


def road_heat_map(comparison: Comparison, model: str) -> Figure:
    """RMS error on each road over that on all roads of the library; new roads have a star."""
    sets = comparison.figures["sets"]
    pooled = _values(sets[LIBRARY]["models"][model]["mse"])
    found = {
        kappa: (_values(by_road[f"{kappa:g}"]), test.name)
        for test in comparison.sets
        if test.name in (LIBRARY, NEW_ROADS)
        for by_road in [sets[test.name]["models"][model]["mse_by_curvature_per_m"]]
        for kappa in test.curvatures_per_m
    }
    roads = sorted(found)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.sqrt(np.array([found[road][0] for road in roads]).T / pooled[:, None])
    figure, (axes,) = empty_figure(1, 1, 0.9 + 0.36 * len(share))
    axes.imshow(
        np.log2(np.nan_to_num(share, nan=1.0, posinf=4.0)),
        cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto",
    )  # fmt: skip
    for (i, j), value in np.ndenumerate(share):
        text = NO_VALUE if np.isnan(value) else f"{value:.2f}"
        axes.text(j, i, text, ha="center", va="center", fontsize=8,
                  color="white" if abs(np.log2(max(value, 1e-9))) > 0.7 else INK)  # fmt: skip
    stars = [f"{1e3 * road:g}" + ("*" if found[road][1] == NEW_ROADS else "") for road in roads]
    axes.set_xticks(range(len(roads)), stars)
    axes.set_yticks(range(len(share)), [column.name for column in comparison.columns])
    has_new = any(on == NEW_ROADS for _, on in found.values())
    axes.set_xlabel("curvature / (1/km)" + ("; * not in the library" if has_new else ""))
    axes.grid(visible=False)
    return figure


def lane_change_plot(
    driven: LaneChange, predicted: Mapping[str, Array], comparison: Comparison
) -> Figure:
    """Six states and the steering wheel angle over time; dotted lines where predictions start.

    `predicted` has the states (W, K+1, n) that each model predicts for the windows.
    """
    columns, time_s = state_units(VEHICLE), driven.time_s
    styles = line_styles(comparison.models, comparison.baselines)
    figure, panels = empty_figure(4, 2, 9.6, sharex=True)
    for i, (axes, column) in enumerate(zip(panels, columns, strict=False)):
        measured = driven.windows.x[..., i].astype(np.float64) * column.per_si
        axes.plot(time_s.ravel(), measured.ravel(), color=INK, linewidth=1.1, label="car", zorder=2)
        for k, (name, states) in enumerate(predicted.items()):
            for window, series in enumerate(states[..., i] * column.per_si):
                label = name if window == 0 else None
                axes.plot(time_s[window], series, **styles[name], label=label, zorder=3 - 0.01 * k)
        models = [predicted[name][..., i] * column.per_si for name in comparison.models]
        _limit_to_car_and_models(axes, measured, models)
        axes.set_title(f"{column.name} / {column.unit}", loc="left")
    steering, path = panels[6], panels[7]
    steer_deg = np.degrees(driven.windows.u[..., InputColumn.steer_rad])
    steering.plot(time_s[:, :-1].ravel(), steer_deg.ravel(), color=INK, linewidth=1.1)
    steering.set_title("input: steering wheel angle / deg", loc="left")
    path.plot(time_s.ravel(), driven.desired_ey_m.ravel(), color=FAINT, linewidth=1.1,
              linestyle="--", label="scenario")  # fmt: skip
    ey_m = driven.windows.x[..., StateColumn.ey_m]
    path.plot(time_s.ravel(), ey_m.ravel(), color=INK, linewidth=1.1, label="car")
    path.set_title("lateral position on the road: scenario and car / m", loc="left")
    path.legend(fontsize=8, frameon=False)
    for axes in panels:
        for start_s in time_s[1:, 0]:
            axes.axvline(start_s, color=FAINT, linewidth=0.6, linestyle=":")
    for axes in panels[-2:]:
        axes.set_xlabel("time / s")
    add_legend(figure, panels[0])
    return figure


def _bar(axes: Axes, row: int, estimate: Figures) -> list[float]:
    """Draw a bar from 1 to a ratio with its interval and number; returns the drawn ends."""
    value, low, high = estimate.values()
    if not (np.isfinite(value) and value > 0.0):
        axes.text(1.0, row, " not finite", va="center", fontsize=7, color=FAINT)
        return []
    color = _BETTER if value >= 1.0 else _WORSE
    ends = np.array([value, low, high] if np.isfinite(low + high) else [value])
    drawn = np.clip(ends, 1.0 / LARGEST_DRAWN, LARGEST_DRAWN)
    axes.barh(row, drawn[0] - 1.0, left=1.0, height=0.62, color=color, alpha=0.75)
    axes.plot(drawn[1:], np.full(len(drawn) - 1, row), color=INK, linewidth=1.1)
    axes.text(max(1.0, *drawn), row, f" {format_number(value, 3)}", va="center", fontsize=7)
    return [float(end) for end in drawn]


def _state_panels(comparison: Comparison) -> tuple[Figure, list[Axes]]:
    """A panel for each state, three in a row."""
    rows = -(-len(comparison.columns) // 3)
    figure, panels = empty_figure(rows, 3, 0.5 + 2.3 * rows)
    for axes, column in zip(panels, comparison.columns, strict=False):
        axes.set_title(f"{column.name} / {column.unit or '1'}", loc="left")
        axes.set_xlabel("time / s")
    for axes in panels[len(comparison.columns) :]:
        axes.set_axis_off()
    return figure, panels[: len(comparison.columns)]


def _limit_to_car_and_models(axes: Axes, measured: Array, models: list[Array]) -> None:
    """Cut the y axis to the car and the models; curves of baselines may leave the panel."""
    errors = np.concatenate([np.abs(model - measured).ravel() for model in models])
    largest = float(np.max(errors[np.isfinite(errors)], initial=0.0))
    margin = max(0.5 * float(np.ptp(measured)), 1.3 * largest, 1e-9)
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, measured.min() - margin), min(high, measured.max() + margin))


def _time_s(comparison: Comparison) -> Array:
    return np.asarray(comparison.dt_s * np.arange(1, comparison.steps + 1), dtype=np.float64)


def _values(by_state: Figures) -> Array:
    return np.array([each["value"] for each in by_state.values()])


def _finite_or_nan(values: Sequence[float]) -> Array:
    return np.asarray(np.where(np.isfinite(values), values, np.nan), dtype=np.float64)
