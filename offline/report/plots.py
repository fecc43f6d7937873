"""The plots of the report, one function each; figures in the units of the tables."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from offline.bootstrap import Estimate
from offline.evaluate import SHARES, mse, mse_on_road, rms_by_step
from offline.judgement import Judgement, ratios_to_rivals
from offline.report.canvas import FAINT, INK, add_legend, blank, log_scale, pens
from offline.sheet import in_digits
from offline.test_sets import LIBRARY, NEW_ROADS

_FARTHEST = 1e4
"""that a bar reaches, or an error from the judged models': what is beyond is in the tables"""

_BETTER, _WORSE = "#2f6fb3", "#c98b86"


def rms_over_time(judgement: Judgement) -> Figure:
    """RMS error of each step, one panel a state, with a band for each judged model."""
    figure, panels = _state_panels(judgement)
    time_s = _time_s(judgement)
    drawn = pens(judgement.judged, judgement.rivals)
    for k, name in enumerate(judgement.names):
        found, pen = rms_by_step(judgement.library[name]), drawn[name]
        for i, axes in enumerate(panels[: len(judgement.columns)]):
            axes.plot(time_s, _drawable(found.value[:, i]), color=pen.color,
                      linestyle=pen.dashes, linewidth=pen.width, label=name,
                      zorder=3 - 0.01 * k)  # fmt: skip
            if name in judgement.judged:
                low, high = _drawable(found.low[:, i]), _drawable(found.high[:, i])
                axes.fill_between(time_s, low, high, color=pen.color, alpha=0.18, linewidth=0.0)
    for i, axes in enumerate(panels[: len(judgement.columns)]):
        judged = [rms_by_step(judgement.library[name]).value[:, i] for name in judgement.judged]
        axes.set_yscale("log")
        _stay_near(axes, np.concatenate(judged))
        log_scale(axes, "y")
    add_legend(figure, panels[0])
    return figure


def quantiles_over_time(judgement: Judgement, model: str) -> Figure:
    """Absolute error of each step: median, and what 90 and 99 % of the trajectories stay below."""
    figure, panels = _state_panels(judgement)
    time_s = _time_s(judgement)
    quantiles = judgement.library[model].quantiles
    for i, axes in enumerate(panels[: len(judgement.columns)]):
        for q in reversed(range(len(SHARES))):
            label = "median" if SHARES[q] == 0.5 else f"{100 * SHARES[q]:g} %"
            axes.fill_between(
                time_s, 0.0, _drawable(quantiles[q, :, i]), label=label,
                color=_BETTER, alpha=(0.75, 0.35, 0.15)[q], linewidth=0.0,
            )  # fmt: skip
        axes.set_ylim(bottom=0.0)
    add_legend(figure, panels[0])
    return figure


def ratio_bars(judgement: Judgement, model: str, on: str = LIBRARY) -> Figure:
    """Each rival's errors over the model's, one panel a state and one for the geometric mean."""
    ratios = ratios_to_rivals(judgement, model, on)
    heads = [column.name for column in judgement.columns] + ["geom. mean"]
    figure, panels = blank(1, len(heads), 0.9 + 0.3 * len(ratios), sharex=True, sharey=True)
    drawn = [1.0]
    for i, (axes, head) in enumerate(zip(panels, heads, strict=True)):
        for row, one in enumerate(ratios.values()):
            is_state = i < len(judgement.columns)
            drawn += _bar(axes, row, one.by_state.at(i) if is_state else one.geometric_mean)
        axes.axvline(1.0, color=INK, linewidth=0.8)
        axes.set_title(head)
        axes.grid(visible=False, axis="y")
        axes.set_axisbelow(True)
    low, high = 0.7 * min(drawn), 1.4 * max(drawn)
    for axes in panels:
        axes.set_xlim(low, high * (high / low) ** 0.35)  # room for the numbers
        log_scale(axes, "x")
    panels[0].set_yticks(range(len(ratios)), list(ratios))
    panels[0].invert_yaxis()
    figure.supxlabel(f"MSE of the rival / MSE of {model}", fontsize=9)
    return figure


def _bar(axes: Axes, row: int, estimate: Estimate) -> list[float]:
    """From 1 to a ratio, with its interval and its number; how far what is drawn reaches."""
    value, low, high = (float(part) for part in estimate)
    if not (np.isfinite(value) and value > 0.0):
        axes.text(1.0, row, " no number", va="center", fontsize=7, color=FAINT)
        return []
    color = _BETTER if value >= 1.0 else _WORSE
    ends = np.array([value, low, high] if np.isfinite(low + high) else [value])
    drawn = np.clip(ends, 1.0 / _FARTHEST, _FARTHEST)
    axes.barh(row, drawn[0] - 1.0, left=1.0, height=0.62, color=color, alpha=0.75)
    axes.plot(drawn[1:], np.full(len(drawn) - 1, row), color=INK, linewidth=1.1)
    axes.text(max(1.0, *drawn), row, f" {in_digits(value, 3)}", va="center", fontsize=7)
    return [float(end) for end in drawn]


def road_heat(judgement: Judgement, model: str) -> Figure:
    """RMS error on each road over that on all roads of the library; new roads have a star."""
    pooled = mse(judgement.library[model]).value
    found = {
        curvature: (mse_on_road(judgement.scores[on][model], curvature).value, on)
        for on in (LIBRARY, NEW_ROADS)
        if on in judgement.scores
        for curvature in judgement.scores[on][model].squared_on_road
    }
    roads = sorted(found)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.sqrt(np.array([found[road][0] for road in roads]).T / pooled[:, None])
    figure, (axes,) = blank(1, 1, 0.9 + 0.36 * len(share))
    axes.imshow(
        np.log2(np.nan_to_num(share, nan=1.0, posinf=4.0)),
        cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto",
    )  # fmt: skip
    for (i, j), value in np.ndenumerate(share):
        axes.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=8,
                  color="white" if abs(np.log2(max(value, 1e-9))) > 0.7 else INK)  # fmt: skip
    stars = [f"{1e3 * road:g}" + ("*" if found[road][1] == NEW_ROADS else "") for road in roads]
    axes.set_xticks(range(len(roads)), stars)
    axes.set_yticks(range(len(share)), [column.name for column in judgement.columns])
    has_new = any(on == NEW_ROADS for _, on in found.values())
    axes.set_xlabel("curvature / (1/km)" + ("; * not in the library" if has_new else ""))
    axes.grid(visible=False)
    return figure


def _state_panels(judgement: Judgement) -> tuple[Figure, list[Axes]]:
    rows = -(-len(judgement.columns) // 3)
    figure, panels = blank(rows, 3, 0.5 + 2.3 * rows)
    for axes, column in zip(panels, judgement.columns, strict=False):
        axes.set_title(f"{column.name} / {column.unit or '1'}", loc="left")
        axes.set_xlabel("time / s")
    for axes in panels[len(judgement.columns) :]:
        axes.set_axis_off()
    return figure, panels


def _stay_near(axes: Axes, judged: np.ndarray) -> None:
    """No rival may squeeze the judged models into a line."""
    seen = judged[np.isfinite(judged) & (judged > 0.0)]
    if len(seen):
        low, high = axes.get_ylim()
        axes.set_ylim(max(low, seen.min() / _FARTHEST), min(high, seen.max() * _FARTHEST))


def _time_s(judgement: Judgement) -> np.ndarray:
    return judgement.dt_s * np.arange(1, judgement.steps + 1)


def _drawable(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, np.nan)
