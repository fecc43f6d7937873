"""The evaluation as one HTML page: its first table and four pictures."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from offline.evaluation.comparison import Comparison, Row
from offline.evaluation.lane_change import LaneChange
from offline.evaluation.metrics import state_units
from offline.evaluation.tables import headline, mse_table
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import VEHICLE, InputColumn, StateColumn
from rt_controller.model.bundle import Bundle
from rt_controller.report.canvas import (
    FAINT,
    INK,
    add_legend,
    empty_figure,
    line_styles,
    set_log_scale,
)
from rt_controller.report.page import Page, Part, Plot, Section
from rt_controller.report.table import format_number

LARGEST_DRAWN = 1e4
"""ratio, and multiple of the models' errors, at which bars and axes end"""
_BETTER, _WORSE = "#2f6fb3", "#c98b86"


def evaluation_page(
    comparison: Comparison,
    bundles: Sequence[Bundle],
    lane_change: tuple[LaneChange, Mapping[str, Array]] | None,
) -> Page:
    """The page of the evaluated `bundles`.

    `lane_change`: a drive, and the states (W, K+1, n) that each model predicts for its windows;
    None if the data are not of the simulated car.
    """
    names = comparison.models
    text = f"Errors of the other models over those of {comparison.names[0]}."
    bars = [Plot(ratio_bars(comparison), text)] if comparison.names[1:] else []
    caption = "RMS error over the time since the measured state; the bands are 95 % intervals."
    sections = [
        Section(
            "Errors", ("Mean squared errors; the terminal has their roots.", mse_table(comparison))
        ),
        Section("Comparison with baselines", (*bars,)),
        Section("Eigenvalues", (Plot(eigenvalues(names, bundles), "Of A, and the unit circle."),)),
    ]
    if lane_change is not None:
        driven, predicted = lane_change
        text = (
            f"{driven.description}. The models start from the measured state every 2 s, at the "
            "dotted lines, and get the inputs only. Curves of baselines may leave the panels."
        )
        plot = Plot(lane_change_plot(driven, predicted, comparison.models, comparison.baselines))
        sections.append(Section("Double lane change, open loop", (text, plot)))
    first: tuple[Part, ...] = (headline(comparison), Plot(rms_over_time(comparison), caption))
    title = f"Prediction errors of {', '.join(names)}"
    return Page(title, tuple(each for each in sections if each.parts), first)


def rms_over_time(comparison: Comparison) -> Figure:
    """RMS error of each step, one panel for each state, with an interval for each model."""
    rows = -(-len(comparison.states) // 3)
    figure, panels = empty_figure(rows, 3, 0.5 + 2.3 * rows)
    styles = line_styles(comparison.models, comparison.baselines)
    for i, (axes, state) in enumerate(zip(panels, comparison.states, strict=False)):
        for k, (name, found) in enumerate(comparison.by_step.items()):
            value, low, high = (_finite_or_nan(part[:, i]) for part in found)
            time_s = comparison.dt_s * np.arange(1, len(value) + 1)
            axes.plot(time_s, value, **styles[name], label=name, zorder=3 - 0.01 * k)
            if name in comparison.models:
                color = styles[name]["color"]
                axes.fill_between(time_s, low, high, color=color, alpha=0.18, linewidth=0.0)
        axes.set_yscale("log")
        errors = np.concatenate([comparison.by_step[n].value[:, i] for n in comparison.models])
        drawn = errors[np.isfinite(errors) & (errors > 0.0)]
        if len(drawn):  # a baseline with very large errors would flatten the models
            bottom, top = axes.get_ylim()
            bottom = max(bottom, drawn.min() / LARGEST_DRAWN)
            axes.set_ylim(bottom, min(top, drawn.max() * LARGEST_DRAWN))
        set_log_scale(axes, "y")
        axes.set_title(f"{state.symbol} / {state.unit or '1'}", loc="left")
        axes.set_xlabel("time / s")
    for axes in panels[len(comparison.states) :]:
        axes.set_axis_off()
    add_legend(figure, panels[0])
    return figure


def ratio_bars(comparison: Comparison) -> Figure:
    """Errors of the others over the reference's: a panel for each state and the geometric mean."""
    others = [name for name in comparison.library if name != comparison.names[0]]
    heads = [*(state.symbol for state in comparison.states), "geom. mean"]
    figure, panels = empty_figure(1, len(heads), 0.9 + 0.3 * len(others), sharex=True, sharey=True)
    ends = [1.0]
    for i, (axes, head) in enumerate(zip(panels, heads, strict=True)):
        for place, name in enumerate(others):
            ends += _bar(axes, place, comparison.library[name][i])
        axes.axvline(1.0, color=INK, linewidth=0.8)
        axes.set_title(head)
        axes.grid(visible=False, axis="y")
        axes.set_axisbelow(True)
    low, high = 0.7 * min(ends), 1.4 * max(ends)
    for axes in panels:
        axes.set_xlim(low, high * (high / low) ** 0.35)  # space for the numbers
        set_log_scale(axes, "x")
    panels[0].set_yticks(range(len(others)), others)
    panels[0].invert_yaxis()
    figure.supxlabel(f"MSE / MSE of {comparison.names[0]}", fontsize=9)
    return figure


def eigenvalues(names: Sequence[str], bundles: Sequence[Bundle]) -> Figure:
    """Eigenvalues of A of each model in the complex plane: all of them, and those near 1."""
    figure, panels = empty_figure(1, 2, 4.6)
    styles = line_styles(names, ())
    turn = np.linspace(0.0, 2.0 * np.pi, 400)
    for axes in panels:
        axes.plot(np.cos(turn), np.sin(turn), color=FAINT, linewidth=0.8)
        for name, bundle in zip(names, bundles, strict=True):
            found = np.linalg.eigvals(bundle.A)
            color = styles[name]["color"]
            axes.plot(found.real, found.imag, "o", color=color, markersize=4, alpha=0.7, label=name)
        axes.set_xlabel("real part")
    panels[0].set_ylabel("imaginary part")
    panels[0].set_aspect("equal")
    panels[1].set_xlim(0.9, 1.01)
    panels[1].set_ylim(-0.055, 0.055)
    add_legend(figure, panels[0])
    return figure


def lane_change_plot(
    driven: LaneChange, predicted: Mapping[str, Array], main: Sequence[str], others: Sequence[str]
) -> Figure:
    """Six states and the steering wheel angle over time; dotted lines where predictions start.

    `main` and `others` name the `predicted` models, `main` those that every panel shows fully.
    """
    columns, time_s = state_units(VEHICLE), driven.time_s
    styles = line_styles(main, others)
    figure, panels = empty_figure(4, 2, 9.6, sharex=True)
    for i, (axes, column) in enumerate(zip(panels, columns, strict=False)):
        measured = driven.windows.x[..., i].astype(np.float64) * column.per_si
        axes.plot(time_s.ravel(), measured.ravel(), color=INK, linewidth=1.1, label="car", zorder=2)
        for k, (name, states) in enumerate(predicted.items()):
            for window, series in enumerate(states[..., i] * column.per_si):
                label = name if window == 0 else None
                axes.plot(time_s[window], series, **styles[name], label=label, zorder=3 - 0.01 * k)
        models = [predicted[name][..., i] * column.per_si for name in main]
        _limit_to_car_and_models(axes, measured, models)
        axes.set_title(f"{column.name} / {column.unit}", loc="left")
    steering, path = panels[6], panels[7]
    steer_deg = np.degrees(driven.windows.u[..., InputColumn.steer_rad])
    steering.plot(time_s[:, :-1].ravel(), steer_deg.ravel(), color=INK, linewidth=1.1)
    steering.set_title("input: steering wheel angle / deg", loc="left")
    wanted_m, ey_m = driven.desired_ey_m, driven.windows.x[..., StateColumn.ey_m]
    path.plot(time_s.ravel(), wanted_m.ravel(), color=FAINT, linestyle="--", label="scenario")
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


def _bar(axes: Axes, place: int, row: Row) -> list[float]:
    """Draw a bar from 1 to a ratio with its interval and number; returns the drawn ends."""
    value, low, high = row.over_reference, row.over_reference_low, row.over_reference_high
    if not (np.isfinite(value) and value > 0.0):
        axes.text(1.0, place, " not finite", va="center", fontsize=7, color=FAINT)
        return []
    color = _BETTER if value >= 1.0 else _WORSE
    ends = np.array([value, low, high] if np.isfinite(low + high) else [value])
    drawn = np.clip(ends, 1.0 / LARGEST_DRAWN, LARGEST_DRAWN)
    axes.barh(place, drawn[0] - 1.0, left=1.0, height=0.62, color=color, alpha=0.75)
    axes.plot(drawn[1:], np.full(len(drawn) - 1, place), color=INK, linewidth=1.1)
    axes.text(max(1.0, *drawn), place, f" {format_number(value, 3)}", va="center", fontsize=7)
    return [float(end) for end in drawn]


def _limit_to_car_and_models(axes: Axes, measured: Array, models: list[Array]) -> None:
    """Cut the y axis to the car and the models."""
    errors = np.concatenate([np.abs(model - measured).ravel() for model in models])
    largest = float(np.max(errors[np.isfinite(errors)], initial=0.0))
    margin = max(0.5 * float(np.ptp(measured)), 1.3 * largest, 1e-9)
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, measured.min() - margin), min(high, measured.max() + margin))


def _finite_or_nan(values: Array) -> Array:
    return np.asarray(np.where(np.isfinite(values), values, np.nan), dtype=np.float64)
